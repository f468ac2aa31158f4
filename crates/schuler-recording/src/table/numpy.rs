//! NumPy arrays: `.npy`, and `.npz`, which are those in a ZIP archive, stored or deflated.
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>
//!
//! Arrays of integers, floating-point numbers, booleans and `datetime64` (in seconds since 1970) are read; the fields of a
//! structured array are columns under their names.
use std::io::Read;
use std::path::Path;

use flate2::read::DeflateDecoder;

use super::arrays::{ArrayTable, LARGEST_BYTES, Shape, TOO_LARGE};
use super::number::Number;
use super::seconds::seconds;
use crate::error::{Error, Problem};

/// First bytes of an array, and of an archive.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";
pub(super) const ZIP_MAGIC: &[u8] = b"PK\x03\x04";
/// What begins the records of an archive, and their lengths without names.
const CENTRAL: &[u8] = b"PK\x01\x02";
const CENTRAL_BYTES: usize = 46;
const END: &[u8] = b"PK\x05\x06";
const LOCAL_BYTES: usize = 30;

/// The table of an array in memory.
///
/// # Errors
/// An array that cannot be read.
pub(super) fn array_table(path: &Path, bytes: &[u8]) -> Result<ArrayTable, Error> {
    let mut table = ArrayTable::new(path);
    add(&mut table, "", bytes).map_err(|message| Error::one(path, Problem::of_file(message)))?;
    table.with_columns("")
}

/// The table of an archive in memory.
///
/// # Errors
/// An archive without arrays, or with one that cannot be read.
pub(super) fn archive_table(path: &Path, bytes: &[u8]) -> Result<ArrayTable, Error> {
    let wrong = |message: String| Error::one(path, Problem::of_file(message));
    let damaged = || wrong("cannot read the table: the archive is damaged, or larger than 4 GiB".to_owned());
    let entries = entries(bytes).ok_or_else(damaged)?;
    let mut table = ArrayTable::new(path);
    let mut left = LARGEST_BYTES;
    let mut arrays = 0;
    for entry in &entries {
        let Some(name) = entry.name.strip_suffix(".npy") else { continue };
        arrays += 1;
        let content = entry.unpacked(left).ok_or_else(damaged)?;
        left = left.checked_sub(content.len() as u64).ok_or_else(|| wrong(TOO_LARGE.to_owned()))?;
        add(&mut table, name, &content).map_err(|message| wrong(format!("{name}: {message}")))?;
    }
    if arrays > 0 {
        return table.with_columns("");
    }
    let has = |part: &str| entries.iter().any(|entry| entry.name == part);
    Err(wrong(if has("xl/workbook.xml") || has("content.xml") {
        "found a spreadsheet, which is not read; save its sheet as CSV".to_owned()
    } else {
        "found a ZIP archive without NumPy arrays, which is not read; unpack it first".to_owned()
    }))
}

/// A file of an archive.
struct Entry<'b> {
    name: String,
    method: usize,
    packed: &'b [u8],
}

impl Entry<'_> {
    /// What was packed, or of that a byte more than `most`; `None` where it cannot be unpacked.
    fn unpacked(&self, most: u64) -> Option<Vec<u8>> {
        match self.method {
            0 => Some(self.packed.to_vec()),
            8 => {
                let mut all = Vec::new();
                DeflateDecoder::new(self.packed).take(most + 1).read_to_end(&mut all).ok()?;
                Some(all)
            }
            _ => None,
        }
    }
}

/// The files of an archive.
fn entries(bytes: &[u8]) -> Option<Vec<Entry<'_>>> {
    let end = bytes.windows(END.len()).rposition(|window| window == END)?;
    let u16_at =
        |at: usize| bytes.get(at..)?.first_chunk().map(|bytes| usize::from(u16::from_le_bytes(*bytes)));
    let u32_at = |at: usize| bytes.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes) as usize);
    let mut at = u32_at(end + 16)?;
    let mut found = Vec::new();
    for _ in 0..u16_at(end + 10)? {
        if !bytes.get(at..)?.starts_with(CENTRAL) {
            return None;
        }
        let (method, length) = (u16_at(at + 10)?, u32_at(at + 20)?);
        let [name, extra, comment] = [u16_at(at + 28)?, u16_at(at + 30)?, u16_at(at + 32)?];
        let local = u32_at(at + 42)?;
        let text = bytes.get(at + CENTRAL_BYTES..at + CENTRAL_BYTES + name)?;
        let begin = local + LOCAL_BYTES + u16_at(local + 26)? + u16_at(local + 28)?;
        let packed = bytes.get(begin..begin.checked_add(length)?)?;
        found.push(Entry { name: String::from_utf8_lossy(text).into_owned(), method, packed });
        at += CENTRAL_BYTES + name + extra + comment;
    }
    Some(found)
}

/// How a number is written in an array.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Written {
    number: Number,
    big_endian: bool,
    /// Decimal places of a time stamp.
    places: Option<u8>,
}

impl Written {
    /// Of a type such as `<f8`; `None` where that is no number.
    fn of(kind: &str) -> Option<Self> {
        let order = kind.chars().next().filter(|order| "<>|=".contains(*order));
        let (letter, size) = kind.trim_start_matches(['<', '>', '|', '=']).split_at_checked(1)?;
        let (size, unit) =
            size.split_once('[').map_or((size, None), |(size, unit)| (size, unit.strip_suffix(']')));
        let number = match (letter, size) {
            ("f", "8") => Number::F64,
            ("f", "4") => Number::F32,
            ("i", "1") => Number::I8,
            ("i", "2") => Number::I16,
            ("i", "4") => Number::I32,
            ("i" | "M", "8") => Number::I64,
            ("u" | "b", "1") => Number::U8,
            ("u", "2") => Number::U16,
            ("u", "4") => Number::U32,
            ("u", "8") => Number::U64,
            _ => return None,
        };
        let places = match (letter, unit) {
            ("M", Some("s")) => Some(0),
            ("M", Some("ms")) => Some(3),
            ("M", Some("us")) => Some(6),
            ("M", Some("ns")) => Some(9),
            ("M", _) => return None,
            _ => None,
        };
        Some(Self { number, big_endian: order == Some('>'), places })
    }

    fn read(self, bytes: &[u8]) -> Option<f64> {
        let Some(places) = self.places else { return self.number.read_in_order(bytes, self.big_endian) };
        let count = *bytes.first_chunk()?;
        let count = if self.big_endian { i64::from_be_bytes(count) } else { i64::from_le_bytes(count) };
        // The least is what is no time.
        Some(if count == i64::MIN { f64::NAN } else { seconds(count.into(), places) })
    }
}

/// What stands before the numbers of an array.
struct Header {
    shape: Shape,
    /// Names and types of the fields; one without a name where there are none.
    fields: Vec<(String, String)>,
}

impl Header {
    /// The header, and what is behind it; `None` of a damaged one.
    fn parse(bytes: &[u8]) -> Option<(Result<Self, String>, &[u8])> {
        let (&[major, _], rest) = bytes.strip_prefix(MAGIC)?.split_first_chunk()?;
        let (length, rest) = if major == 1 {
            let (length, rest) = rest.split_first_chunk()?;
            (usize::from(u16::from_le_bytes(*length)), rest)
        } else {
            let (length, rest) = rest.split_first_chunk()?;
            (u32::from_le_bytes(*length) as usize, rest)
        };
        let (header, data) = rest.split_at_checked(length)?;
        let header = std::str::from_utf8(header).ok()?;
        let after = |key: &str| header.split_once(key).map(|(_, rest)| rest.trim_start_matches([' ', ':']));
        let axes = after("'shape'")?.strip_prefix('(')?.split_once(')')?.0;
        let axes = axes.split(',').map(str::trim).filter(|length| !length.is_empty());
        let axes = axes.map(|length| length.parse().ok()).collect::<Option<_>>()?;
        let by_columns = after("'fortran_order'")?.starts_with("True");
        let descr = after("'descr'")?;
        let fields = match descr.strip_prefix('[') {
            Some(list) => fields_of(list),
            None => Ok(vec![(String::new(), quoted(descr)?)]),
        };
        Some((fields.map(|fields| Self { shape: Shape { axes, by_columns }, fields }), data))
    }
}

/// Adds the columns of a file: those of one array, or of one a field.
fn add(table: &mut ArrayTable, name: &str, bytes: &[u8]) -> Result<(), String> {
    let damaged = || "cannot read the array: it is damaged".to_owned();
    let (header, data) = Header::parse(bytes).ok_or_else(damaged)?;
    let Header { shape, fields } = header?;
    let mut sizes = Vec::new();
    for (field, kind) in &fields {
        let size = bytes_of(kind).ok_or_else(|| {
            format!("found values of the type {kind:?} in {name:?} {field:?}; expected numbers")
        })?;
        sizes.push(size);
    }
    let row = sizes.iter().try_fold(0_usize, |row, size| row.checked_add(*size)).ok_or_else(damaged)?;
    let bytes = shape.count().and_then(|count| count.checked_mul(row)).ok_or_else(damaged)?;
    if bytes > data.len() {
        return Err(damaged());
    }
    let mut offset = 0;
    for ((field, kind), size) in fields.into_iter().zip(sizes) {
        if let Some(written) = Written::of(&kind) {
            let name = match (name.is_empty(), field.is_empty()) {
                (true, true) => "array".to_owned(),
                (false, true) => name.to_owned(),
                (true, false) => field,
                (false, false) => format!("{name}.{field}"),
            };
            let at = |index: usize| data.get(index * row + offset..).and_then(|bytes| written.read(bytes));
            table.add(&name, &shape, |index| at(index).unwrap_or(f64::NAN))?;
        }
        offset += size;
    }
    Ok(())
}

/// Bytes of a value of a type, a number or not.
fn bytes_of(kind: &str) -> Option<usize> {
    let letters = kind.trim_start_matches(['<', '>', '|', '=']);
    let (letter, size) = letters.split_at_checked(1)?;
    let size: usize = size.split('[').next()?.parse().ok()?;
    match letter {
        "f" | "i" | "u" | "b" | "c" | "S" | "V" | "M" | "m" => Some(size),
        "U" => size.checked_mul(4),
        _ => None,
    }
}

/// Names and types of the fields in `('t', '<f8'), …]`.
fn fields_of(list: &str) -> Result<Vec<(String, String)>, String> {
    let mut fields = Vec::new();
    let list = list.split("'fortran_order'").next().unwrap_or_default();
    for tuple in list.split('(').skip(1) {
        let mut parts = tuple.split('\'');
        let (name, kind) = (parts.nth(1), parts.nth(1));
        let (Some(name), Some(kind)) = (name, kind) else {
            return Err("found fields of several values or fields in fields; expected fields of one number"
                .to_owned());
        };
        fields.push((name.to_owned(), kind.to_owned()));
    }
    Ok(fields)
}

fn quoted(text: &str) -> Option<String> {
    text.strip_prefix('\'')?.split_once('\'').map(|(kind, _)| kind.to_owned())
}
