//! PX4 ULog files: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>.
//!
//! Messages of a size and a type follow a header: formats (`F`) say what the fields of a topic are, subscriptions (`A`)
//! give a topic's instance a number, data (`D`) begin with that number. A column is `TOPIC_INSTANCE.FIELD`, as in the
//! names of the files that `ulog2csv` writes: `sensor_gyro_0.x`, `esc_status_0.esc[2].esc_rpm`. The fields `timestamp`
//! and `timestamp_sample`, microseconds in the file, are in seconds. Text (`char`) has no column.
//!
//! Logs end when the power does: a last message cut off is left out. Data that the vehicle appended after a crash are
//! read where they are. Where bytes are no messages, reading goes on at the next synchronisation message. Dropouts of the
//! logger leave no trace in the data but missing rows. Each of these is a warning.
//!
//! The reader is our own since the crate of the PX4 project (px4-ulog 0.6) indexes beyond short `A` and `P` messages,
//! does not end on formats of nested empty arrays, and reads nothing behind the first damaged message.
use std::collections::{BTreeMap, HashMap};
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use super::log::{LONGEST_ARRAY, MOST_COLUMNS, Messages, Topic, left_out};
use super::number::Number;
use super::seconds::seconds;
use super::{BUFFER_BYTES, Bytestream};
use crate::error::{Error, Problem};

/// First bytes of a ULog file.
pub(super) const MAGIC: &[u8] = &[b'U', b'L', b'o', b'g', 0x01, 0x12, 0x35];
/// The content of a synchronisation message.
const SYNCHRONISATION: &[u8] = &[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Bytes of the header: magic, version, time of the start in µs.
const HEADER_BYTES: u64 = 16;
/// Bytes of size and type of a message.
const FRAME_BYTES: usize = 3;
/// Longer than any file.
const LONGEST_FILE: u64 = 1 << 62;
/// Formats in formats; more than vehicles have, few enough for the stack.
const DEEPEST: usize = 16;
/// Fields of 64-bit unsigned integers that are microseconds: by the specification, and by PX4's custom.
const TIME_STAMPS: [&str; 2] = ["timestamp", "timestamp_sample"];
/// Incompatible flags that are understood: data are appended.
const DATA_APPENDED: u64 = 1;

/// Types of messages that are understood here.
mod kind {
    pub(super) const FLAGS: u8 = b'B';
    pub(super) const FORMAT: u8 = b'F';
    pub(super) const INFORMATION: u8 = b'I';
    pub(super) const SUBSCRIPTION: u8 = b'A';
    pub(super) const UNSUBSCRIPTION: u8 = b'R';
    pub(super) const DATA: u8 = b'D';
    pub(super) const DROPOUT: u8 = b'O';
    pub(super) const SYNCHRONISATION: u8 = b'S';
}

/// A ULog file of which the topics are known.
pub(super) struct Ulog {
    path: PathBuf,
    frames: Frames,
    topics: Vec<Topic>,
    layouts: Vec<Layout>,
    indices: HashMap<String, usize>,
    metadata: BTreeMap<String, String>,
    /// Topic of each number that is subscribed to.
    subscribed: HashMap<u16, usize>,
    /// Fields asked for of each topic.
    wanted: Vec<Vec<Field>>,
    said: Said,
}

/// What the user should be told of.
#[derive(Default)]
struct Said {
    dropouts: u64,
    dropped_ms: u64,
    /// Data of no topic, or too short.
    damaged: u64,
}

/// Where the numbers of a topic stand in its data.
#[derive(Clone, Debug, Default)]
struct Layout {
    fields: Vec<Field>,
    /// Bytes of a message at least.
    bytes: usize,
}

#[derive(Clone, Copy, Debug)]
struct Field {
    offset: usize,
    number: Number,
    /// Whether it is microseconds.
    stamp: bool,
}

impl Field {
    fn read(&self, data: &[u8]) -> Option<f64> {
        let bytes = data.get(self.offset..)?;
        if self.stamp {
            return Some(seconds(u64::from_le_bytes(*bytes.first_chunk()?).into(), 6));
        }
        self.number.read(bytes)
    }
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "int8_t" => Number::I8,
        "uint8_t" | "bool" => Number::U8,
        "int16_t" => Number::I16,
        "uint16_t" => Number::U16,
        "int32_t" => Number::I32,
        "uint32_t" => Number::U32,
        "int64_t" => Number::I64,
        "uint64_t" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return None,
    })
}

impl Ulog {
    /// Reads formats, subscriptions and what the file says of itself.
    ///
    /// # Errors
    /// A file that cannot be read or is of an unknown kind.
    pub(super) fn new(path: &Path, bytes: Box<dyn Bytestream>) -> Result<Self, Error> {
        let unreadable = |error: io::Error| Error::io(path, "read the log", &error);
        let mut ulog = Self {
            path: path.to_owned(),
            frames: Frames::new(bytes).map_err(unreadable)?,
            topics: Vec::new(),
            layouts: Vec::new(),
            indices: HashMap::new(),
            metadata: BTreeMap::new(),
            subscribed: HashMap::new(),
            wanted: Vec::new(),
            said: Said::default(),
        };
        let mut formats = HashMap::new();
        let mut columns = 0;
        while let Some(kind) = ulog.frames.next().map_err(unreadable)? {
            let content = &ulog.frames.content;
            match kind {
                kind::FLAGS => ulog.frames.flags(path)?,
                kind::FORMAT => {
                    if let Some((name, fields)) =
                        std::str::from_utf8(content).ok().and_then(|it| it.split_once(':'))
                    {
                        formats.entry(name.to_owned()).or_insert_with(|| fields.to_owned());
                    }
                }
                kind::INFORMATION => {
                    if let Some((key, value)) = information(content) {
                        ulog.metadata.insert(key, value);
                    }
                }
                kind::SUBSCRIPTION => {
                    let Some((_, topic, format)) = subscription(content) else { continue };
                    if ulog.indices.contains_key(&topic) {
                        continue;
                    }
                    let mut fields = Fields::default();
                    let unreadable = fields.add(&formats, &format, "", 0).err();
                    if unreadable.is_some() {
                        fields = Fields::default();
                    }
                    columns += fields.names.len();
                    if columns > MOST_COLUMNS {
                        let problem = format!("found more than {MOST_COLUMNS} fields; expected no more");
                        return Err(Error::one(path, Problem::of_file(problem)));
                    }
                    ulog.indices.insert(topic.clone(), ulog.topics.len());
                    ulog.topics.push(Topic { name: topic, fields: fields.names, unreadable });
                    ulog.layouts.push(Layout { fields: fields.places, bytes: fields.needed });
                }
                _ => {}
            }
        }
        Ok(ulog)
    }
}

/// Number, topic with instance, and format of a subscription.
fn subscription(content: &[u8]) -> Option<(u16, String, String)> {
    let (&[instance, low, high], name) = content.split_first_chunk()?;
    let format = std::str::from_utf8(name).ok()?;
    Some((u16::from_le_bytes([low, high]), format!("{format}_{instance}"), format.to_owned()))
}

/// Key and value of an information message.
fn information(content: &[u8]) -> Option<(String, String)> {
    let (&length, content) = content.split_first()?;
    let (key, value) = content.split_at_checked(length.into())?;
    let (kind, name) = std::str::from_utf8(key).ok()?.split_once(' ')?;
    let value = if kind.starts_with("char") {
        String::from_utf8_lossy(value).trim_end_matches('\0').to_owned()
    } else {
        match number(kind)? {
            Number::U64 => u64::from_le_bytes(*value.first_chunk()?).to_string(),
            Number::I64 => i64::from_le_bytes(*value.first_chunk()?).to_string(),
            number => number.read(value)?.to_string(),
        }
    };
    Some((name.to_owned(), value))
}

/// The fields of a format, with those of the formats in it.
#[derive(Default)]
struct Fields {
    names: Vec<String>,
    places: Vec<Field>,
    offset: usize,
    /// Offset behind the last field that is not padding, which may be left out at the end.
    needed: usize,
}

impl Fields {
    /// Appends the fields of `format`, each name after `prefix`; what is wrong completes "its messages are …".
    fn add(
        &mut self,
        formats: &HashMap<String, String>,
        format: &str,
        prefix: &str,
        depth: usize,
    ) -> Result<(), String> {
        let fields = formats.get(format).ok_or_else(|| format!("of an undefined format, {format:?}"))?;
        for field in fields.split(';').filter(|field| !field.is_empty()) {
            let wrong = || format!("of a format that is not understood, {field:?}");
            let (kind, name) = field.trim().split_once(' ').ok_or_else(wrong)?;
            let (kind, length) = match kind.split_once('[') {
                Some((kind, length)) => {
                    let length = length.strip_suffix(']').and_then(|length| length.parse::<u16>().ok());
                    (kind, Some(length.map(usize::from).ok_or_else(wrong)?))
                }
                None => (kind, None),
            };
            let number = number(kind);
            let stamp = depth == 0 && number == Some(Number::U64) && TIME_STAMPS.contains(&name);
            let bytes = if kind == "char" { Some(1) } else { number.map(Number::bytes) };
            if let Some(bytes) = bytes
                && (kind == "char"
                    || name.starts_with("_padding")
                    || length.is_some_and(|it| it > LONGEST_ARRAY))
            {
                self.offset += bytes * length.unwrap_or(1);
                if !name.starts_with("_padding") {
                    self.needed = self.offset;
                }
                continue;
            }
            for index in 0..length.unwrap_or(1) {
                let name = if length.is_some() {
                    format!("{prefix}.{name}[{index}]")
                } else {
                    format!("{prefix}.{name}")
                };
                if let Some(number) = number {
                    self.names.push(name);
                    self.places.push(Field { offset: self.offset, number, stamp });
                    self.offset += number.bytes();
                    self.needed = self.offset;
                } else {
                    let before = self.offset;
                    if depth == DEEPEST {
                        return Err(format!("of formats in formats, deeper than {DEEPEST}"));
                    }
                    self.add(formats, kind, &name, depth + 1)?;
                    if self.offset == before {
                        return Err(format!("of a format without fields, {kind:?}"));
                    }
                }
                if self.offset > usize::from(u16::MAX) {
                    return Err(format!("longer than {} bytes", u16::MAX));
                }
            }
        }
        Ok(())
    }
}

impl Messages for Ulog {
    fn path(&self) -> &Path {
        &self.path
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn metadata(&self) -> Vec<(String, String)> {
        self.metadata.iter().map(|(key, value)| (key.clone(), value.clone())).collect()
    }

    fn select(&mut self, fields: Vec<Vec<usize>>) -> Result<(), Error> {
        self.wanted = (fields.iter().zip(&self.layouts))
            .map(|(fields, layout)| fields.iter().map(|&field| layout.fields[field]).collect())
            .collect();
        self.subscribed.clear();
        self.said = Said::default();
        self.frames.rewind().map_err(|error| Error::io(&self.path, "read the log", &error))
    }

    fn next(&mut self, values: &mut Vec<f64>) -> Result<Option<usize>, Error> {
        let unreadable = |error: io::Error| Error::io(&self.path, "read the log", &error);
        while let Some(kind) = self.frames.next().map_err(unreadable)? {
            let content = self.frames.content.as_slice();
            match kind {
                kind::FLAGS => self.frames.flags(&self.path)?,
                kind::SUBSCRIPTION => {
                    if let Some((number, topic, _)) = subscription(content)
                        && let Some(&topic) = self.indices.get(&topic)
                    {
                        self.subscribed.insert(number, topic);
                    }
                }
                kind::UNSUBSCRIPTION => {
                    if let Some(&number) = content.first_chunk() {
                        self.subscribed.remove(&u16::from_le_bytes(number));
                    }
                }
                kind::DROPOUT => {
                    if let Some(&duration_ms) = content.first_chunk() {
                        self.said.dropouts += 1;
                        self.said.dropped_ms += u64::from(u16::from_le_bytes(duration_ms));
                    }
                }
                kind::DATA => {
                    let Some((&number, data)) = content.split_first_chunk() else {
                        self.said.damaged += 1;
                        continue;
                    };
                    let Some(&topic) = self.subscribed.get(&u16::from_le_bytes(number)) else {
                        self.said.damaged += 1;
                        continue;
                    };
                    let Some(wanted) = self.wanted.get(topic).filter(|wanted| !wanted.is_empty()) else {
                        continue;
                    };
                    if data.len() < self.layouts.get(topic).map_or(0, |layout| layout.bytes) {
                        self.said.damaged += 1;
                        continue;
                    }
                    values.clear();
                    values.extend(wanted.iter().map(|field| field.read(data).unwrap_or(f64::NAN)));
                    return Ok(Some(topic));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    fn warnings(&mut self) -> Vec<String> {
        let Said { dropouts, dropped_ms, damaged } = self.said;
        let mut warnings = Vec::new();
        if dropouts > 0 {
            warnings.push(format!("the logger dropped data {dropouts} times, {dropped_ms} ms altogether"));
        }
        if damaged > 0 {
            warnings.push(format!("{damaged} messages are of no topic or too short and are left out"));
        }
        warnings.extend(left_out(self.frames.skipped, self.frames.cut_off));
        warnings
    }
}

/// The messages of a file, whatever they are.
struct Frames {
    bytes: BufReader<Box<dyn Bytestream>>,
    position: u64,
    /// Where data are appended, in order; the messages before end there.
    appended: Vec<u64>,
    /// The content of the last message.
    content: Vec<u8>,
    /// Bytes passed over since they are no messages.
    skipped: u64,
    cut_off: bool,
}

impl Frames {
    fn new(bytes: Box<dyn Bytestream>) -> io::Result<Self> {
        let bytes = BufReader::with_capacity(BUFFER_BYTES, bytes);
        let mut frames = Self {
            bytes,
            position: 0,
            appended: Vec::new(),
            content: Vec::new(),
            skipped: 0,
            cut_off: false,
        };
        frames.rewind()?;
        Ok(frames)
    }

    fn rewind(&mut self) -> io::Result<()> {
        self.appended.clear();
        self.skipped = 0;
        self.cut_off = false;
        self.go_to(HEADER_BYTES)
    }

    fn go_to(&mut self, position: u64) -> io::Result<()> {
        self.bytes.seek_relative(position.cast_signed().wrapping_sub(self.position.cast_signed()))?;
        self.position = position;
        Ok(())
    }

    /// Understands the flags in the last message.
    fn flags(&mut self, path: &Path) -> Result<(), Error> {
        let mut words = self
            .content
            .chunks_exact(8)
            .map(|word| word.iter().rev().fold(0, |all, &byte| all << 8 | u64::from(byte)));
        let incompatible = words.nth(1).unwrap_or_default();
        if incompatible & !DATA_APPENDED != 0 {
            let problem =
                format!("found incompatible flags {incompatible:#x}; expected those of ULog version 1");
            return Err(Error::one(path, Problem::of_file(problem)));
        }
        if incompatible & DATA_APPENDED != 0 {
            let position = self.position;
            self.appended =
                words.take(3).filter(|offset| (position..LONGEST_FILE).contains(offset)).collect();
            self.appended.sort_unstable();
        }
        Ok(())
    }

    /// Puts the content of the next message into `content` and gives its type.
    fn next(&mut self) -> io::Result<Option<u8>> {
        loop {
            let end = self.appended.first().copied();
            let mut frame = [0; FRAME_BYTES];
            let got = self.read(&mut frame, end)?;
            let [low, high, kind] = frame;
            let size = usize::from(u16::from_le_bytes([low, high]));
            if got == FRAME_BYTES && (size == 0 || !kind.is_ascii_alphabetic()) {
                self.synchronise(end)?;
                continue;
            }
            let mut content = std::mem::take(&mut self.content);
            content.resize(size, 0);
            let whole = got == FRAME_BYTES && self.read(&mut content, end)? == size;
            self.content = content;
            if whole {
                return Ok(Some(kind));
            }
            self.cut_off |= got > 0;
            let Some(appended) = end else { return Ok(None) };
            self.appended.remove(0);
            self.go_to(appended)?;
        }
    }

    /// Fills as much of `buffer` as there is before `end`.
    fn read(&mut self, buffer: &mut [u8], end: Option<u64>) -> io::Result<usize> {
        let left = end.map_or(u64::MAX, |end| end.saturating_sub(self.position));
        let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        let mut got = 0;
        while let Some(rest) = buffer.get_mut(got..most).filter(|rest| !rest.is_empty()) {
            match self.bytes.read(rest) {
                Ok(0) => break,
                Ok(more) => got += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        self.position += got as u64;
        Ok(got)
    }

    /// Passes over everything up to the end of the next synchronisation message; the last three bytes were no message.
    fn synchronise(&mut self, end: Option<u64>) -> io::Result<()> {
        let mark: Vec<u8> =
            [&[SYNCHRONISATION.len() as u8, 0, kind::SYNCHRONISATION], SYNCHRONISATION].concat();
        let mut last: Vec<u8> = Vec::new();
        self.skipped += FRAME_BYTES as u64;
        let mut byte = [0];
        while self.read(&mut byte, end)? == 1 {
            self.skipped += 1;
            if last.len() == mark.len() {
                last.remove(0);
            }
            last.extend(byte);
            if last == mark {
                self.skipped -= mark.len() as u64;
                break;
            }
        }
        Ok(())
    }
}
