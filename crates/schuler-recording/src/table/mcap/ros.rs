//! Messages of ROS 1 (`ros1msg`) and ROS 2 (`cdr` with `ros2msg`), described by message definitions.
//!
//! A definition is the text of the message's file, and behind lines of `=` and `MSG: package/Type` those of the messages
//! in it. ROS 1 writes the fields without a space between, least significant byte first; the Common Data Representation
//! of ROS 2 aligns each number to its size, behind four bytes that say the order of bytes.
//!
//! Those who read ROS messages in Rust either know the messages when they are compiled, or take what a message says of
//! its length as it is; hence this.
use std::collections::HashMap;

use super::Leaves;
use crate::table::log::LONGEST_ARRAY;
use crate::table::number::Number;
use crate::table::seconds::of_parts;

/// Messages in messages; more than there are, few enough for the stack.
const DEEPEST: usize = 32;
/// Values of a message; a definition of nested arrays can mean any number of them in no bytes.
const MOST_VALUES: usize = 1 << 22;

/// How messages are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wire {
    Ros1,
    Cdr,
}

/// A kind of message.
pub(super) struct Ros {
    wire: Wire,
    structs: Vec<Vec<Field>>,
}

struct Field {
    name: String,
    kind: Kind,
    array: Array,
}

#[derive(Clone, Copy)]
enum Kind {
    Number(Number),
    /// Seconds and nanoseconds, each so.
    Stamp(Number, Number),
    Text,
    Struct(usize),
}

#[derive(Clone, Copy)]
enum Array {
    None,
    Fixed(usize),
    /// With its length before it.
    Counted,
}

impl Ros {
    /// The message called `name`; what is wrong completes "its messages are …".
    pub(super) fn new(name: &str, definitions: &[u8], wire: Wire) -> Result<Self, String> {
        let text = std::str::from_utf8(definitions)
            .map_err(|_| "described by a definition that is not UTF-8".to_owned())?;
        let mut definitions: HashMap<String, Vec<&str>> = HashMap::new();
        let mut current = full_name(name, "");
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.starts_with("===") {
                current.clear();
            } else if let Some(name) = line.strip_prefix("MSG:") {
                current = full_name(name.trim(), "");
                definitions.entry(current.clone()).or_default();
            } else if !line.is_empty() {
                definitions.entry(current.clone()).or_default().push(line);
            }
        }
        let mut ros = Self { wire, structs: Vec::new() };
        ros.compile(&full_name(name, ""), &definitions, &mut HashMap::new(), 0)?;
        Ok(ros)
    }

    /// The place of a message among `structs`.
    fn compile(
        &mut self,
        name: &str,
        definitions: &HashMap<String, Vec<&str>>,
        known: &mut HashMap<String, usize>,
        depth: usize,
    ) -> Result<usize, String> {
        if let Some(&place) = known.get(name) {
            return Ok(place);
        }
        if depth > DEEPEST {
            return Err(format!("messages in messages, deeper than {DEEPEST}"));
        }
        let place = self.structs.len();
        self.structs.push(Vec::new());
        let package = name.split_once('/').map_or("", |(package, _)| package);
        let mut fields = Vec::new();
        let lines = match definitions.get(name) {
            Some(lines) => lines.as_slice(),
            // A message without fields.
            None if depth == 0 => &[],
            None => return Err(format!("described by a definition that lacks {name:?}")),
        };
        for line in lines {
            let wrong = || format!("of a definition that is not understood, {line:?}");
            let (kind, rest) = line.split_once(char::is_whitespace).ok_or_else(wrong)?;
            let rest = rest.trim_start();
            let end = rest.find(|c: char| c.is_whitespace() || c == '=').unwrap_or(rest.len());
            let (field, rest) = rest.split_at(end);
            if rest.trim_start().starts_with('=') {
                // A constant.
                continue;
            }
            let (kind, array) = match kind.split_once('[') {
                None => (kind, Array::None),
                Some((kind, length)) => {
                    let length = length.strip_suffix(']').ok_or_else(wrong)?;
                    let counted = length.is_empty() || length.starts_with("<=");
                    let fixed = || length.parse().map(Array::Fixed).map_err(|_| wrong());
                    (kind, if counted { Array::Counted } else { fixed()? })
                }
            };
            let kind = match self.simple(kind) {
                Some(kind) => kind,
                None if kind == "wstring" || kind.starts_with("wstring<=") => {
                    return Err("of a definition with wide strings, which are not read".to_owned());
                }
                None => {
                    let inner = full_name(kind, package);
                    Kind::Struct(self.compile(&inner, definitions, known, depth + 1)?)
                }
            };
            fields.push(Field { name: field.to_owned(), kind, array });
        }
        if fields.is_empty() && self.wire == Wire::Cdr {
            // What ROS 2 puts into a message without fields.
            let (kind, array) = (Kind::Number(Number::U8), Array::None);
            fields.push(Field { name: "structure_needs_at_least_one_member".to_owned(), kind, array });
        }
        self.structs[place] = fields;
        known.insert(name.to_owned(), place);
        Ok(place)
    }

    fn simple(&self, name: &str) -> Option<Kind> {
        let number = match name {
            "bool" | "uint8" | "char" | "octet" => Number::U8,
            "byte" if self.wire == Wire::Cdr => Number::U8,
            "int8" | "byte" => Number::I8,
            "int16" => Number::I16,
            "uint16" => Number::U16,
            "int32" => Number::I32,
            "uint32" => Number::U32,
            "int64" => Number::I64,
            "uint64" => Number::U64,
            "float32" => Number::F32,
            "float64" => Number::F64,
            "string" => return Some(Kind::Text),
            _ if name.starts_with("string<=") => return Some(Kind::Text),
            _ => {
                return match (self.wire, full_name(name, "").as_str()) {
                    (Wire::Ros1, "time") => Some(Kind::Stamp(Number::U32, Number::U32)),
                    (Wire::Ros1, "duration") => Some(Kind::Stamp(Number::I32, Number::I32)),
                    (Wire::Cdr, "builtin_interfaces/Time" | "builtin_interfaces/Duration") => {
                        Some(Kind::Stamp(Number::I32, Number::U32))
                    }
                    _ => None,
                };
            }
        };
        Some(Kind::Number(number))
    }

    pub(super) fn decode(&self, message: &[u8], leaves: &mut Leaves<'_>) -> Result<(), String> {
        let mut cursor = Cursor::new(message, self.wire)?;
        self.walk(0, &mut cursor, leaves)
    }

    fn walk(&self, place: usize, cursor: &mut Cursor<'_>, leaves: &mut Leaves<'_>) -> Result<(), String> {
        for field in self.structs.get(place).into_iter().flatten() {
            let count = match field.array {
                Array::None => {
                    leaves.within(format_args!(".{}", field.name), |leaves| {
                        self.value(field.kind, cursor, Some(leaves))
                    })?;
                    continue;
                }
                Array::Fixed(count) => count,
                Array::Counted => cursor.count()?,
            };
            if let (Kind::Number(number), true) = (field.kind, count > LONGEST_ARRAY) {
                cursor.skip(number, count)?;
                continue;
            }
            for index in 0..count {
                if count > LONGEST_ARRAY {
                    self.value(field.kind, cursor, None)?;
                } else {
                    leaves.within(format_args!(".{}[{index}]", field.name), |leaves| {
                        self.value(field.kind, cursor, Some(leaves))
                    })?;
                }
            }
        }
        Ok(())
    }

    fn value(
        &self,
        kind: Kind,
        cursor: &mut Cursor<'_>,
        leaves: Option<&mut Leaves<'_>>,
    ) -> Result<(), String> {
        cursor.values += 1;
        if cursor.values > MOST_VALUES {
            return Err(format!("it has more than {MOST_VALUES} values"));
        }
        let number = match kind {
            Kind::Number(number) => cursor.number(number)?,
            Kind::Stamp(whole, nanoseconds) => {
                of_parts(cursor.number(whole)? as i64, cursor.number(nanoseconds)? as i64)
            }
            Kind::Text => return cursor.text(),
            Kind::Struct(place) => {
                let mut nowhere = |_: &str, _: f64| ();
                return match leaves {
                    Some(leaves) => self.walk(place, cursor, leaves),
                    None => self.walk(place, cursor, &mut Leaves::new(&mut nowhere)),
                };
            }
        };
        if let Some(leaves) = leaves {
            leaves.number(number);
        }
        Ok(())
    }
}

/// `package/Type` of a name that may lack the package or have more parts.
fn full_name(name: &str, package: &str) -> String {
    match (name.split_once('/'), name.rsplit_once('/')) {
        (Some((package, _)), Some((_, name))) => format!("{package}/{name}"),
        _ if name == "Header" => "std_msgs/Header".to_owned(),
        _ if package.is_empty() => name.to_owned(),
        _ => format!("{package}/{name}"),
    }
}

/// A message that is read.
struct Cursor<'m> {
    left: &'m [u8],
    /// Bytes read since numbers were last aligned to the greatest alignment.
    at: usize,
    /// Greatest alignment, bytes.
    alignment: usize,
    big_endian: bool,
    values: usize,
}

impl<'m> Cursor<'m> {
    fn new(message: &'m [u8], wire: Wire) -> Result<Self, String> {
        let mut cursor = Self { left: message, at: 0, alignment: 1, big_endian: false, values: 0 };
        if wire == Wire::Cdr {
            let header = *cursor.take(4)?.first_chunk::<2>().unwrap_or(&[0, 0]);
            (cursor.at, cursor.alignment) = (0, 8);
            match header {
                [0, 0] => cursor.big_endian = true,
                [0, 1] => {}
                // The second version aligns to four bytes at most.
                [0, 6] => (cursor.big_endian, cursor.alignment) = (true, 4),
                [0, 7] => cursor.alignment = 4,
                [high, low] => {
                    return Err(format!("it is in representation {high:#04x}{low:02x}; plain CDR is read"));
                }
            }
        }
        Ok(cursor)
    }

    fn take(&mut self, bytes: usize) -> Result<&'m [u8], String> {
        let (taken, left) = self.left.split_at_checked(bytes).ok_or("it is too short")?;
        self.left = left;
        self.at += bytes;
        Ok(taken)
    }

    fn align(&mut self, bytes: usize) -> Result<(), String> {
        let padding = self.at.wrapping_neg() % bytes.min(self.alignment);
        self.take(padding).map(drop)
    }

    fn number(&mut self, number: Number) -> Result<f64, String> {
        self.align(number.bytes())?;
        let bytes = self.take(number.bytes())?;
        let mut turned = [0; 8];
        let read = if self.big_endian {
            turned.iter_mut().zip(bytes.iter().rev()).for_each(|(to, from)| *to = *from);
            number.read(&turned)
        } else {
            number.read(bytes)
        };
        read.ok_or_else(|| "it is too short".to_owned())
    }

    /// Passes over numbers.
    fn skip(&mut self, number: Number, count: usize) -> Result<(), String> {
        self.align(number.bytes())?;
        self.take(number.bytes().saturating_mul(count)).map(drop)
    }

    /// The length of an array.
    fn count(&mut self) -> Result<usize, String> {
        Ok(self.number(Number::U32)? as usize)
    }

    fn text(&mut self) -> Result<(), String> {
        let length = self.count()?;
        self.take(length).map(drop)
    }
}
