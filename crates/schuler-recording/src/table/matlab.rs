//! MATLAB files of version 5, as MATLAB saves them without `-v7.3`, and SciPy and Octave, too:
//! <https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf>.
//!
//! Variables that are real arrays of numbers are columns under their names, fields of structures
//! under `NAME.FIELD`. Text, cells, sparse and complex arrays, arrays of structures and objects, of
//! which tables and timetables are some, have no columns.
use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::arrays::{ArrayTable, LARGEST_BYTES, Shape, TOO_LARGE};
use super::number::Number;
use crate::error::{Error, Problem};

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"MATLAB 5.0 MAT-file";
/// Bytes before the first variable; the last two of them tell the order of bytes.
const HEADER_BYTES: usize = 128;
const BIG_ENDIAN: &[u8] = b"MI";
/// Structures in structures that are gone into.
const DEEPEST: usize = 16;

/// Types of elements that are not numbers.
mod element {
    pub(super) const MATRIX: u32 = 14;
    pub(super) const COMPRESSED: u32 = 15;
}
/// Classes of arrays.
mod class {
    pub(super) const STRUCTURE: u32 = 2;
    pub(super) const NUMBERS: std::ops::RangeInclusive<u32> = 6..=15;
    pub(super) const OPAQUE: u32 = 17;
}
/// The flag of a complex array.
const COMPLEX: u32 = 0x800;

/// The table of a file in memory.
///
/// # Errors
/// A file that cannot be read, or has no columns.
pub(super) fn table(path: &Path, bytes: &[u8]) -> Result<ArrayTable, Error> {
    let failed = |message: String| Error::one(path, Problem::of_file(message));
    let order = bytes.get(HEADER_BYTES - 2..HEADER_BYTES);
    let rest = bytes.get(HEADER_BYTES..).unwrap_or_default();
    let mut file = File {
        table: ArrayTable::new(path),
        big_endian: order == Some(BIG_ENDIAN),
        left: LARGEST_BYTES,
        objects: false,
    };
    file.variables(rest).map_err(|wrong| failed(wrong.message()))?;
    let hint = if file.objects {
        "; tables, timetables and objects are not read: in MATLAB s = table2struct(T, \"ToScalar\", true), or writetable"
    } else {
        ""
    };
    file.table.with_columns(hint)
}

/// Why a file cannot be read.
enum Wrong {
    Damaged,
    /// A message.
    Said(String),
}

impl Wrong {
    fn message(self) -> String {
        match self {
            Self::Damaged => "cannot read the arrays: the file is damaged or cut off".to_owned(),
            Self::Said(message) => message,
        }
    }
}

/// A file that is gone through.
struct File {
    table: ArrayTable,
    big_endian: bool,
    /// Bytes that may still be unpacked.
    left: u64,
    /// Whether there are objects, which are not read.
    objects: bool,
}

/// A part of a file: its type, and its content.
struct Element<'b> {
    kind: u32,
    content: &'b [u8],
}

impl File {
    /// Adds the variables that stand one behind another.
    fn variables(&mut self, mut bytes: &[u8]) -> Result<(), Wrong> {
        while !bytes.is_empty() {
            let Element { kind, content } = self.element(&mut bytes).ok_or(Wrong::Damaged)?;
            match kind {
                element::MATRIX => self.array("", content, 0)?,
                element::COMPRESSED => {
                    let unpacked = self.unpacked(content)?;
                    let Element { kind, content } =
                        self.element(&mut unpacked.as_slice()).ok_or(Wrong::Damaged)?;
                    if kind == element::MATRIX {
                        self.array("", content, 0)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn unpacked(&mut self, content: &[u8]) -> Result<Vec<u8>, Wrong> {
        let mut unpacked = Vec::new();
        let mut decoder = ZlibDecoder::new(content).take(self.left + 1);
        decoder.read_to_end(&mut unpacked).map_err(|_| Wrong::Damaged)?;
        self.left =
            self.left.checked_sub(unpacked.len() as u64).ok_or_else(|| Wrong::Said(TOO_LARGE.to_owned()))?;
        Ok(unpacked)
    }

    /// Adds the columns of an array within the structure `within`.
    fn array(&mut self, within: &str, mut bytes: &[u8], depth: usize) -> Result<(), Wrong> {
        // A field that was never set is an array of nothing.
        if bytes.is_empty() {
            return Ok(());
        }
        let flags =
            self.element(&mut bytes).and_then(|flags| self.u32(flags.content)).ok_or(Wrong::Damaged)?;
        let class = flags & 0xff;
        if class == class::OPAQUE {
            self.objects = true;
            return Ok(());
        }
        let axes = self.element(&mut bytes).ok_or(Wrong::Damaged)?;
        let axes = axes.content.chunks(4).map(|axis| self.u32(axis).map(|length| length as usize));
        let axes: Vec<usize> = axes.collect::<Option<_>>().ok_or(Wrong::Damaged)?;
        let own = text(self.element(&mut bytes).ok_or(Wrong::Damaged)?.content);
        let name = if within.is_empty() { own } else { within.to_owned() };
        if class == class::STRUCTURE && axes.iter().all(|length| *length == 1) {
            return self.structure(&name, bytes, depth);
        }
        if !class::NUMBERS.contains(&class) || flags & COMPLEX != 0 {
            return Ok(());
        }
        let values = self.element(&mut bytes).ok_or(Wrong::Damaged)?;
        let number = number_of(values.kind).ok_or(Wrong::Damaged)?;
        let shape = Shape { axes, by_columns: true };
        let size = number.bytes();
        if shape.count().and_then(|count| count.checked_mul(size)) != Some(values.content.len()) {
            return Err(Wrong::Damaged);
        }
        let big_endian = self.big_endian;
        let at = |index: usize| number.read_in_order(values.content.get(index * size..)?, big_endian);
        self.table.add(&name, &shape, |index| at(index).unwrap_or(f64::NAN)).map_err(Wrong::Said)
    }

    /// Adds the fields of a structure, of which there is one.
    fn structure(&mut self, name: &str, mut bytes: &[u8], depth: usize) -> Result<(), Wrong> {
        if depth == DEEPEST {
            return Err(Wrong::Said(format!(
                "found more than {DEEPEST} structures in each other; expected less"
            )));
        }
        let length = self.element(&mut bytes).and_then(|length| self.u32(length.content));
        let length = length.filter(|length| *length > 0).ok_or(Wrong::Damaged)? as usize;
        let fields = self.element(&mut bytes).ok_or(Wrong::Damaged)?;
        for field in fields.content.chunks(length) {
            let Element { kind, content } = self.element(&mut bytes).ok_or(Wrong::Damaged)?;
            if kind == element::MATRIX {
                self.array(&format!("{name}.{}", text(field)), content, depth + 1)?;
            }
        }
        Ok(())
    }

    /// Takes the next element. One of at most four bytes has its length beside its type.
    fn element<'b>(&self, bytes: &mut &'b [u8]) -> Option<Element<'b>> {
        let (tag, rest) = bytes.split_at_checked(4)?;
        let tag = self.u32(tag)?;
        let (kind, length) = (tag & 0xffff, (tag >> 16) as usize);
        if length > 0 {
            let (content, rest) = rest.split_at_checked(4)?;
            *bytes = rest;
            return Some(Element { kind, content: content.get(..length)? });
        }
        let (length, rest) = rest.split_at_checked(4)?;
        let length = self.u32(length)? as usize;
        let content = rest.get(..length)?;
        // Elements begin at multiples of eight bytes, but behind those that are packed.
        let padded = if kind == element::COMPRESSED { length } else { length.checked_next_multiple_of(8)? };
        *bytes = rest.get(padded..).unwrap_or_default();
        Some(Element { kind, content })
    }

    fn u32(&self, bytes: &[u8]) -> Option<u32> {
        let bytes = *bytes.first_chunk()?;
        Some(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }
}

/// How the numbers of an element are written; `None` where they are none.
fn number_of(kind: u32) -> Option<Number> {
    Some(match kind {
        1 => Number::I8,
        2 => Number::U8,
        3 => Number::I16,
        4 => Number::U16,
        5 => Number::I32,
        6 => Number::U32,
        7 => Number::F32,
        9 => Number::F64,
        12 => Number::I64,
        13 => Number::U64,
        _ => return None,
    })
}

/// A name, up to the first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(bytes.get(..end).unwrap_or_default()).into_owned()
}
