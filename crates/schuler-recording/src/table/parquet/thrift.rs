//! What stands before the decoder of a Parquet file's metadata: the way through it must end.
//!
//! The metadata are structures of the [compact protocol](https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md)
//! of Thrift. Their decoder passes over a list of booleans in a field that it does not know without taking a byte of it: a list that
//! says it has 2³¹ of them costs six seconds, a list of such lists hours. So the whole is gone through once before, and refused where a
//! list has more elements than there are bytes, or is of booleans, which no list of the format is and which the decoder would
//! misread. A field that the decoder knows must be of its kind: it would take it for that unasked, and read another
//! structure from there on than was gone through here.
use std::io::{self, Read};

use parquet::errors::ParquetError;

/// Structures in structures; those of the format are nine deep.
const DEEPEST: usize = 32;
/// Groups of columns in each other; the decoder calls itself for each, and each column bears the names of them all.
const DEEPEST_GROUPS: usize = 64;

/// What the decoder takes a field for.
enum Kind {
    Boolean,
    Byte,
    Integer,
    /// An integer that is asked for.
    Kept(Kept),
    /// A boolean that is asked for.
    KeptBoolean(Kept),
    Double,
    Binary,
    List(&'static Kind),
    Structure(&'static [(i16, Kind)]),
    /// A column or a group of them; their tree is written as a list.
    Element(&'static [(i16, Kind)]),
}

/// What is asked for: of an element of the schema the first, of a page's header the others.
#[derive(Clone, Copy)]
pub(super) enum Kept {
    Children,
    Type,
    Bytes,
    CompressedBytes,
    Values,
    DictionaryValues,
    ValuesV2,
    DefinitionBytes,
    RepetitionBytes,
    Compressed,
}

impl Kept {
    fn name(self) -> &'static str {
        match self {
            Self::Children => "number of children",
            Self::Type => "type",
            Self::Bytes => "size",
            Self::CompressedBytes => "compressed size",
            Self::Values | Self::DictionaryValues | Self::ValuesV2 => "number of values",
            Self::DefinitionBytes | Self::RepetitionBytes => "size of levels",
            Self::Compressed => "compression",
        }
    }
}

/// Number of places of [`Kept`].
const KEPT: usize = Kept::Compressed as usize + 1;

const UNIT: Kind = Kind::Structure(&[]);
const INTEGERS: Kind = Kind::List(&Kind::Integer);

const LOGICAL_TYPE: Kind = {
    const TIME: Kind = Kind::Structure(&[(1, Kind::Boolean), (2, UNIT)]);
    Kind::Structure(&[
        (5, Kind::Structure(&[(1, Kind::Integer), (2, Kind::Integer)])),
        (7, TIME),
        (8, TIME),
        (10, Kind::Structure(&[(1, Kind::Byte), (2, Kind::Boolean)])),
        (16, Kind::Structure(&[(1, Kind::Byte)])),
        (17, Kind::Structure(&[(1, Kind::Binary)])),
        (18, Kind::Structure(&[(1, Kind::Binary), (2, Kind::Integer)])),
    ])
};

const SCHEMA_ELEMENT: Kind = Kind::Element(&[
    (1, Kind::Integer),
    (2, Kind::Integer),
    (3, Kind::Integer),
    (4, Kind::Binary),
    (5, Kind::Kept(Kept::Children)),
    (6, Kind::Integer),
    (7, Kind::Integer),
    (8, Kind::Integer),
    (9, Kind::Integer),
    (10, LOGICAL_TYPE),
]);

const STATISTICS: Kind = Kind::Structure(&[
    (1, Kind::Binary),
    (2, Kind::Binary),
    (3, Kind::Integer),
    (4, Kind::Integer),
    (5, Kind::Binary),
    (6, Kind::Binary),
    (7, Kind::Boolean),
    (8, Kind::Boolean),
    (9, Kind::Integer),
]);

const BOUNDING_BOX: Kind = Kind::Structure(&[
    (1, Kind::Double),
    (2, Kind::Double),
    (3, Kind::Double),
    (4, Kind::Double),
    (5, Kind::Double),
    (6, Kind::Double),
    (7, Kind::Double),
    (8, Kind::Double),
]);

const ENCODING_STATISTICS: Kind =
    Kind::Structure(&[(1, Kind::Integer), (2, Kind::Integer), (3, Kind::Integer)]);

const COLUMN_METADATA: Kind = Kind::Structure(&[
    (1, Kind::Integer),
    (2, INTEGERS),
    (4, Kind::Integer),
    (5, Kind::Integer),
    (6, Kind::Integer),
    (7, Kind::Integer),
    (9, Kind::Integer),
    (10, Kind::Integer),
    (11, Kind::Integer),
    (12, STATISTICS),
    (13, Kind::List(&ENCODING_STATISTICS)),
    (14, Kind::Integer),
    (15, Kind::Integer),
    (16, Kind::Structure(&[(1, Kind::Integer), (2, INTEGERS), (3, INTEGERS)])),
    (17, Kind::Structure(&[(1, BOUNDING_BOX), (2, INTEGERS)])),
]);

const COLUMN_CHUNK: Kind = Kind::Structure(&[
    (1, Kind::Binary),
    (2, Kind::Integer),
    (3, COLUMN_METADATA),
    (4, Kind::Integer),
    (5, Kind::Integer),
    (6, Kind::Integer),
    (7, Kind::Integer),
]);

const SORTING_COLUMN: Kind = Kind::Structure(&[(1, Kind::Integer), (2, Kind::Boolean), (3, Kind::Boolean)]);

const ROW_GROUP: Kind = Kind::Structure(&[
    (1, Kind::List(&COLUMN_CHUNK)),
    (2, Kind::Integer),
    (3, Kind::Integer),
    (4, Kind::List(&SORTING_COLUMN)),
    (5, Kind::Integer),
    (7, Kind::Integer),
]);

/// What stands at the end of a file.
const FILE: &[(i16, Kind)] = &[
    (1, Kind::Integer),
    (2, Kind::List(&SCHEMA_ELEMENT)),
    (3, Kind::Integer),
    (4, Kind::List(&ROW_GROUP)),
    (5, Kind::List(&Kind::Structure(&[(1, Kind::Binary), (2, Kind::Binary)]))),
    (6, Kind::Binary),
    // One of several orders, each of them an empty structure.
    (7, Kind::List(&Kind::Structure(&[(1, UNIT), (2, UNIT), (3, UNIT)]))),
];

/// What stands before a page. Its statistics are passed over by the decoder.
const PAGE: &[(i16, Kind)] = &[
    (1, Kind::Kept(Kept::Type)),
    (2, Kind::Kept(Kept::Bytes)),
    (3, Kind::Kept(Kept::CompressedBytes)),
    (4, Kind::Integer),
    (
        5,
        Kind::Structure(&[
            (1, Kind::Kept(Kept::Values)),
            (2, Kind::Integer),
            (3, Kind::Integer),
            (4, Kind::Integer),
        ]),
    ),
    (6, UNIT),
    (7, Kind::Structure(&[(1, Kind::Kept(Kept::DictionaryValues)), (2, Kind::Integer), (3, Kind::Boolean)])),
    (
        8,
        Kind::Structure(&[
            (1, Kind::Kept(Kept::ValuesV2)),
            (2, Kind::Integer),
            (3, Kind::Integer),
            (4, Kind::Integer),
            (5, Kind::Kept(Kept::DefinitionBytes)),
            (6, Kind::Kept(Kept::RepetitionBytes)),
            (7, Kind::KeptBoolean(Kept::Compressed)),
        ]),
    ),
];

/// The types of the protocol.
mod wire {
    pub(super) const STOP: u8 = 0;
    pub(super) const TRUE: u8 = 1;
    pub(super) const FALSE: u8 = 2;
    pub(super) const BYTE: u8 = 3;
    pub(super) const I16: u8 = 4;
    pub(super) const I64: u8 = 6;
    pub(super) const DOUBLE: u8 = 7;
    pub(super) const BINARY: u8 = 8;
    pub(super) const LIST: u8 = 9;
    pub(super) const SET: u8 = 10;
    pub(super) const MAP: u8 = 11;
    pub(super) const STRUCTURE: u8 = 12;
    pub(super) const UUID: u8 = 13;
}

impl Kind {
    /// Whether a value of the type `wire` is what the decoder takes it for.
    fn is(&self, wire: u8) -> bool {
        match self {
            Self::Boolean | Self::KeptBoolean(_) => matches!(wire, wire::TRUE | wire::FALSE),
            Self::Byte => wire == wire::BYTE,
            // Of any width: all are written in the same way.
            Self::Integer | Self::Kept(_) => (wire::I16..=wire::I64).contains(&wire),
            Self::Double => wire == wire::DOUBLE,
            Self::Binary => wire == wire::BINARY,
            Self::List(_) => wire == wire::LIST,
            Self::Structure(_) | Self::Element(_) => wire == wire::STRUCTURE,
        }
    }
}

/// Goes through the metadata at the end of a file.
///
/// # Errors
/// Metadata that say they have more than there are bytes of them, or other things than the format has.
pub(super) fn check_file(metadata: &[u8]) -> Result<(), ParquetError> {
    Walk::new(metadata, metadata.len() as u64).fields(FILE, DEEPEST)
}

/// The header of a page.
pub(super) struct PageHeader {
    kept: [Option<i64>; KEPT],
    /// The header as it stands in the file.
    pub(super) bytes: Vec<u8>,
}

impl PageHeader {
    /// Reads a header, of at most `left` bytes.
    ///
    /// # Errors
    /// As [`check_file`].
    pub(super) fn read(from: impl Read, left: u64) -> Result<Self, ParquetError> {
        let mut copied = Copied { from, bytes: Vec::new() };
        let mut walk = Walk::new(&mut copied, left);
        walk.fields(PAGE, DEEPEST)?;
        let kept = walk.kept;
        Ok(Self { kept, bytes: copied.bytes })
    }

    /// A number of the header; none, if it has none or a negative one.
    pub(super) fn get(&self, what: Kept) -> Option<u64> {
        self.kept.get(what as usize).copied().flatten().and_then(|number| u64::try_from(number).ok())
    }

    /// A number that the header must have.
    ///
    /// # Errors
    /// It has none or a negative one.
    pub(super) fn number(&self, what: Kept) -> Result<u64, ParquetError> {
        self.get(what)
            .ok_or_else(|| contradicts(&format!("a page's header with a negative or no {}", what.name())))
    }
}

/// Keeps what is read.
struct Copied<R> {
    from: R,
    bytes: Vec<u8>,
}

impl<R: Read> Read for Copied<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.from.read(buffer)?;
        self.bytes.extend(buffer.iter().take(read));
        Ok(read)
    }
}

/// The way through a structure.
struct Walk<R> {
    from: R,
    /// Bytes that there may still be.
    left: u64,
    kept: [Option<i64>; KEPT],
    /// Of each group of the schema that is open, how many children are to come.
    groups: Vec<u64>,
}

impl<R: Read> Walk<R> {
    fn new(from: R, left: u64) -> Self {
        Self { from, left, kept: [None; KEPT], groups: Vec::new() }
    }

    fn byte(&mut self) -> Result<u8, ParquetError> {
        let mut byte = [0];
        self.from.read_exact(&mut byte).map_err(|_| cut())?;
        self.left = self.left.checked_sub(1).ok_or_else(cut)?;
        let [byte] = byte;
        Ok(byte)
    }

    fn pass(&mut self, bytes: u64) -> Result<(), ParquetError> {
        self.left = self.left.checked_sub(bytes).ok_or_else(cut)?;
        let passed = io::copy(&mut self.from.by_ref().take(bytes), &mut io::sink())?;
        if passed == bytes { Ok(()) } else { Err(cut()) }
    }

    /// Seven bits a byte, the last byte without the eighth; what is beyond 64 bits is lost, as in the decoder.
    fn unsigned(&mut self) -> Result<u64, ParquetError> {
        let mut value = 0;
        let mut shift = 0_u32;
        loop {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f).wrapping_shl(shift);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
            shift = shift.wrapping_add(7);
        }
    }

    fn signed(&mut self) -> Result<i64, ParquetError> {
        let value = self.unsigned()?;
        Ok((value >> 1).cast_signed() ^ -(value & 1).cast_signed())
    }

    /// The fields of a structure, to its end.
    fn fields(&mut self, known: &'static [(i16, Kind)], depth: usize) -> Result<(), ParquetError> {
        let mut id = 0_i16;
        loop {
            let header = self.byte()?;
            let wire = header & 0x0f;
            if wire == wire::STOP {
                return Ok(());
            }
            id = match header >> 4 {
                // The decoder keeps the lower 16 bits.
                0 => self.signed()? as i16,
                step => id
                    .checked_add(step.into())
                    .ok_or_else(|| contradicts("a field's number beyond 16 bits"))?,
            };
            let kind = known.iter().find(|(number, _)| *number == id).map(|(_, kind)| kind);
            if kind.is_some_and(|kind| !kind.is(wire)) {
                return Err(contradicts(&format!(
                    "a field {id} of type {wire}, which is not that of the format"
                )));
            }
            if let Some(Kind::KeptBoolean(place)) = kind {
                self.keep(*place, i64::from(wire == wire::TRUE));
            }
            self.value(wire, kind, depth)?;
        }
    }

    fn keep(&mut self, place: Kept, value: i64) {
        if let Some(kept) = self.kept.get_mut(place as usize) {
            *kept = Some(value);
        }
    }

    fn value(&mut self, wire: u8, kind: Option<&'static Kind>, depth: usize) -> Result<(), ParquetError> {
        let depth = depth.checked_sub(1).ok_or_else(|| contradicts("structures too deep in each other"))?;
        match wire {
            // The field's header says which.
            wire::TRUE | wire::FALSE => Ok(()),
            wire::BYTE => self.pass(1),
            wire::I16..=wire::I64 => {
                let value = self.signed()?;
                if let Some(Kind::Kept(place)) = kind {
                    // The decoder keeps the lower 32 bits.
                    self.keep(*place, i64::from(value as i32));
                }
                Ok(())
            }
            wire::DOUBLE => self.pass(8),
            wire::BINARY => {
                let bytes = self.unsigned()?;
                self.pass(bytes)
            }
            wire::LIST | wire::SET => self.list(kind, depth),
            wire::MAP => {
                let size = self.unsigned()?;
                if size == 0 {
                    return Ok(());
                }
                let types = self.byte()?;
                for wire in [types >> 4, types & 0x0f] {
                    self.check_elements(size, wire)?;
                }
                for _ in 0..size {
                    self.value(types >> 4, None, depth)?;
                    self.value(types & 0x0f, None, depth)?;
                }
                Ok(())
            }
            wire::STRUCTURE => match kind {
                Some(Kind::Structure(known)) => self.fields(known, depth),
                Some(Kind::Element(known)) => {
                    self.fields(known, depth)?;
                    self.element()
                }
                _ => self.fields(&[], depth),
            },
            wire::UUID => self.pass(16),
            _ => Err(contradicts(&format!("a value of type {wire}"))),
        }
    }

    /// The place of an element in the tree of the schema, of which it has been gone through.
    fn element(&mut self) -> Result<(), ParquetError> {
        while self.groups.last() == Some(&0) {
            self.groups.pop();
        }
        if let Some(to_come) = self.groups.last_mut() {
            *to_come -= 1;
        }
        let children = self.kept.get_mut(Kept::Children as usize).and_then(Option::take).unwrap_or_default();
        // The decoder refuses a negative number.
        let Ok(children @ 1..) = u64::try_from(children) else { return Ok(()) };
        // The decoder reserves as many before it looks for them.
        if children > self.left {
            return Err(contradicts(&format!("a group of {children} columns in {} bytes", self.left)));
        }
        self.groups.push(children);
        if self.groups.len() > DEEPEST_GROUPS {
            return Err(contradicts(&format!("more than {DEEPEST_GROUPS} groups of columns in each other")));
        }
        Ok(())
    }

    fn list(&mut self, kind: Option<&'static Kind>, depth: usize) -> Result<(), ParquetError> {
        let header = self.byte()?;
        // Some writers leave an empty list without a type.
        if header == 0 {
            return Ok(());
        }
        let wire = header & 0x0f;
        let size = match header >> 4 {
            0x0f => self.unsigned()?,
            size => size.into(),
        };
        let element = if let Some(Kind::List(element)) = kind { Some(*element) } else { None };
        if element.is_some_and(|element| !element.is(wire)) {
            return Err(contradicts(&format!("a list of type {wire}, which is not that of the format")));
        }
        self.check_elements(size, wire)?;
        for _ in 0..size {
            self.value(wire, element, depth)?;
        }
        Ok(())
    }

    /// Each element takes a byte at least; booleans take none in the decoder.
    fn check_elements(&self, size: u64, wire: u8) -> Result<(), ParquetError> {
        if size > self.left {
            return Err(contradicts(&format!("a list of {size} elements in {} bytes", self.left)));
        }
        if size > 0 && matches!(wire, wire::TRUE | wire::FALSE) {
            return Err(contradicts(&format!("a list of {size} booleans, of which the format has none")));
        }
        Ok(())
    }
}

fn cut() -> ParquetError {
    contradicts("metadata that are cut off")
}

/// An error that names what was found.
pub(super) fn contradicts(found: &str) -> ParquetError {
    ParquetError::General(format!("found {found}; the file is damaged"))
}
