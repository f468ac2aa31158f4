//! MAVLink telemetry logs (`.tlog`): messages of either version of the protocol, each behind the
//! time when it came, in µs since 1970: <https://mavlink.io/en/guide/serialization.html>.
//!
//! A log does not describe itself. The layouts of the messages of ArduPilot and of the common set
//! stand in `messages.txt`; other messages are passed over and counted. A column is the message and
//! the field, `ATTITUDE.roll`, `@log_time` is when it came, in seconds; fields are as they are sent.
//! Where several senders or instances sent a kind of message, the topic is followed by `_SYSTEM_COMPONENT`
//! or `_INSTANCE`.
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::Bytestream;
use super::log::{LONGEST_ARRAY, MOST_COLUMNS, Messages, Topic, left_out};
use super::number::Number;
use super::seconds::seconds;
use crate::error::{Error, Problem};

/// The messages that are known.
const MESSAGES: &str = include_str!("messages.txt");
/// First bytes of frames of the first and the second version.
const FIRST: u8 = 0xfe;
const SECOND: u8 = 0xfd;
/// Bytes of a time stamp, of the heads of frames, of a checksum, of a signature.
const STAMP_BYTES: usize = 8;
const FIRST_HEAD_BYTES: usize = 6;
const SECOND_HEAD_BYTES: usize = 10;
const CHECKSUM_BYTES: usize = 2;
const SIGNATURE_BYTES: usize = 13;
/// The flag of a frame with a signature.
const SIGNED: u8 = 1;
const LONGEST_PAYLOAD: usize = 255;
const LONGEST_FRAME: usize =
    STAMP_BYTES + SECOND_HEAD_BYTES + LONGEST_PAYLOAD + CHECKSUM_BYTES + SIGNATURE_BYTES;
/// Bytes read at a time.
const READ_BYTES: usize = 1 << 16;
/// Time stamps of the years 2001 to 2128, µs since 1970.
const STAMPS: std::ops::RangeInclusive<u64> = 978_307_200_000_000..=4_986_000_000_000_000;
/// The first field of every topic.
const LOG_TIME: &str = "@log_time";
/// Unknown kinds of messages that a warning lists.
const LISTED: usize = 8;

/// Whether a file that begins so is a log.
pub(super) fn is_log(beginning: &[u8]) -> bool {
    stamp_of(beginning).is_some() && matches!(beginning.get(STAMP_BYTES), Some(&(FIRST | SECOND)))
}

fn stamp_of(bytes: &[u8]) -> Option<u64> {
    bytes.first_chunk().map(|bytes| u64::from_be_bytes(*bytes)).filter(|stamp| STAMPS.contains(stamp))
}

/// A kind of messages.
struct Kind {
    name: &'static str,
    /// What the checksum is begun with behind the frame.
    extra: u8,
    fields: Vec<Field>,
    /// The field that tells instances.
    instance: Option<usize>,
}

/// A number in a payload.
#[derive(Clone)]
struct Field {
    name: String,
    offset: usize,
    number: Number,
}

impl Field {
    /// The number; missing where a payload of the first version ends before it.
    fn read(&self, payload: &Payload) -> f64 {
        if payload.first_version && self.offset + self.number.bytes() > payload.length {
            return f64::NAN;
        }
        payload.bytes.get(self.offset..).and_then(|bytes| self.number.read(bytes)).unwrap_or(f64::NAN)
    }
}

impl Kind {
    /// Of a line of [`MESSAGES`], with its number.
    fn parse(line: &'static str) -> Option<(u32, Self)> {
        let mut words = line.split(' ');
        let (id, name, extra) = (words.next()?.parse().ok()?, words.next()?, words.next()?.parse().ok()?);
        let (mut fields, mut instance, mut offset) = (Vec::new(), None, 0);
        for word in words {
            let (field, written) = word.split_once(':')?;
            let tells_instance = written.ends_with('!');
            let (letter, length) = match written.trim_end_matches('!').split_once('*') {
                Some((letter, length)) => (letter, Some(length.parse::<usize>().ok()?)),
                None => (written.trim_end_matches('!'), None),
            };
            let number = number_of(letter);
            if tells_instance {
                instance = Some(fields.len());
            }
            let count = length.unwrap_or(1);
            for index in 0..count {
                let Some(number) = number.filter(|_| count <= LONGEST_ARRAY) else { continue };
                let place = length.map(|_| format!("[{index}]")).unwrap_or_default();
                let offset = offset + index * number.bytes();
                fields.push(Field { name: format!(".{field}{place}"), offset, number });
            }
            offset += count * number.map_or(1, Number::bytes);
        }
        Some((id, Self { name, extra, fields, instance }))
    }
}

/// How a letter's numbers are written; none for text.
fn number_of(letter: &str) -> Option<Number> {
    Some(match letter {
        "b" => Number::I8,
        "B" => Number::U8,
        "h" => Number::I16,
        "H" => Number::U16,
        "i" => Number::I32,
        "I" => Number::U32,
        "q" => Number::I64,
        "Q" => Number::U64,
        "f" => Number::F32,
        "d" => Number::F64,
        _ => return None,
    })
}

/// What a frame carries; the second version leaves out zeros at its end.
struct Payload {
    bytes: [u8; LONGEST_PAYLOAD],
    length: usize,
    first_version: bool,
}

/// Where messages come from: system, component, kind and instance.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Origin {
    kind: u32,
    system: u8,
    component: u8,
    instance: u64,
}

/// A log of which the topics are known.
pub(super) struct Tlog {
    path: PathBuf,
    bytes: Box<dyn Bytestream>,
    /// Bytes that were read, and how many of them are done with.
    buffer: Vec<u8>,
    done: usize,
    kinds: HashMap<u32, Kind>,
    topics: Vec<Topic>,
    indices: BTreeMap<Origin, usize>,
    /// Of each topic the fields that are asked for; none is the time.
    wanted: Vec<Vec<Option<Field>>>,
    payload: Payload,
    /// Unknown kinds, and how many messages there are of each.
    unknown: BTreeMap<u32, u64>,
    skipped: u64,
    cut_off: bool,
}

/// A frame in the buffer.
struct Frame {
    bytes: usize,
    stamp: u64,
    origin: Origin,
}

impl Tlog {
    /// Reads the file for messages and senders.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn new(path: &Path, bytes: Box<dyn Bytestream>) -> Result<Self, Error> {
        let payload = Payload { bytes: [0; LONGEST_PAYLOAD], length: 0, first_version: false };
        let mut log = Self {
            path: path.to_owned(),
            bytes,
            buffer: Vec::new(),
            done: 0,
            kinds: MESSAGES.lines().filter_map(Kind::parse).collect(),
            topics: Vec::new(),
            indices: BTreeMap::new(),
            wanted: Vec::new(),
            payload,
            unknown: BTreeMap::new(),
            skipped: 0,
            cut_off: false,
        };
        let mut columns = 0;
        let mut origins = BTreeSet::new();
        while let Some(frame) = log.advance()? {
            if origins.insert(frame.origin) {
                columns += 1 + log.kinds.get(&frame.origin.kind).map_or(0, |kind| kind.fields.len());
            }
            if columns > MOST_COLUMNS {
                let problem = format!("found more than {MOST_COLUMNS} fields; expected no more");
                return Err(Error::one(path, Problem::of_file(problem)));
            }
        }
        log.name(&origins);
        Ok(log)
    }

    /// Makes a topic of each origin.
    fn name(&mut self, origins: &BTreeSet<Origin>) {
        for &origin in origins {
            let Some(kind) = self.kinds.get(&origin.kind) else { continue };
            let others = || origins.iter().filter(|other| other.kind == origin.kind);
            let sender = |it: &Origin| (it.system, it.component);
            let mut name = kind.name.to_owned();
            if others().any(|other| sender(other) != sender(&origin)) {
                name = format!("{name}_{}_{}", origin.system, origin.component);
            }
            if others().any(|other| other.instance != origin.instance) {
                name = format!("{name}_{}", origin.instance);
            }
            let fields = kind.fields.iter().map(|field| field.name.clone());
            let fields = std::iter::once(LOG_TIME.to_owned()).chain(fields).collect();
            self.indices.insert(origin, self.topics.len());
            self.topics.push(Topic { name, fields, unreadable: None });
        }
    }

    /// Goes to the next message of a known kind and puts what it carries into `payload`.
    fn advance(&mut self) -> Result<Option<Frame>, Error> {
        loop {
            self.fill().map_err(|error| Error::io(&self.path, "read the log", &error))?;
            let window = self.buffer.get(self.done..).unwrap_or_default();
            if window.is_empty() {
                return Ok(None);
            }
            let Some(length) = frame_bytes(window) else {
                self.done += 1;
                self.skipped += 1;
                continue;
            };
            if length > window.len() {
                self.cut_off = true;
                return Ok(None);
            }
            let Some(frame) = self.frame(length) else {
                self.done += 1;
                self.skipped += 1;
                continue;
            };
            self.done += frame.bytes;
            if self.kinds.contains_key(&frame.origin.kind) {
                return Ok(Some(frame));
            }
            *self.unknown.entry(frame.origin.kind).or_default() += 1;
        }
    }

    /// Reads on so that a whole frame is in the buffer, if there is one.
    fn fill(&mut self) -> io::Result<()> {
        if self.buffer.len() - self.done >= LONGEST_FRAME {
            return Ok(());
        }
        self.buffer.drain(..self.done);
        self.done = 0;
        let more = (READ_BYTES - self.buffer.len()) as u64;
        self.bytes.by_ref().take(more).read_to_end(&mut self.buffer).map(drop)
    }

    /// The frame of so many bytes; `None` where its checksum is another, or, of an unknown kind,
    /// no frame follows.
    fn frame(&mut self, length: usize) -> Option<Frame> {
        let (frame, behind) = self.buffer.get(self.done..)?.split_at_checked(length)?;
        let stamp = stamp_of(frame)?;
        let frame = frame.get(STAMP_BYTES..)?;
        let first_version = frame.first() == Some(&FIRST);
        let (head, system) = if first_version { (FIRST_HEAD_BYTES, 3) } else { (SECOND_HEAD_BYTES, 5) };
        let kind = match *frame.get(system + 2..head)? {
            [kind] => u32::from(kind),
            [low, middle, high] => u32::from_le_bytes([low, middle, high, 0]),
            _ => return None,
        };
        let payload_bytes = usize::from(*frame.get(1)?);
        let payload = frame.get(head..head + payload_bytes)?;
        let mut origin =
            Origin { kind, system: *frame.get(system)?, component: *frame.get(system + 1)?, instance: 0 };
        let Some(known) = self.kinds.get(&kind) else {
            let follows = behind.len() <= STAMP_BYTES || is_log(behind);
            return follows.then_some(Frame { bytes: length, stamp, origin });
        };
        let checked = frame.get(1..head + payload_bytes)?.iter().chain([&known.extra]);
        let found = frame.get(head + payload_bytes..)?.first_chunk()?;
        if checksum(checked) != u16::from_le_bytes(*found) {
            return None;
        }
        self.payload.bytes = [0; LONGEST_PAYLOAD];
        self.payload.bytes.get_mut(..payload_bytes)?.copy_from_slice(payload);
        (self.payload.length, self.payload.first_version) = (payload_bytes, first_version);
        // An instance is a small integer, and nothing where the first version does not have it.
        let instance = known.instance.and_then(|field| known.fields.get(field));
        origin.instance = instance.map_or(0, |field| field.read(&self.payload) as u64);
        Some(Frame { bytes: length, stamp, origin })
    }
}

/// Bytes of the frame, with its time stamp, that the bytes begin with; `None` where they begin none.
fn frame_bytes(bytes: &[u8]) -> Option<usize> {
    // At the end of a file that is cut off the stamp alone may be there.
    if bytes.len() < STAMP_BYTES + 3 {
        return Some(LONGEST_FRAME);
    }
    if !is_log(bytes) {
        return None;
    }
    let [version, payload, flags] = *bytes.get(STAMP_BYTES..)?.first_chunk()?;
    let head = if version == FIRST { FIRST_HEAD_BYTES } else { SECOND_HEAD_BYTES };
    let signature = if version == SECOND && flags & SIGNED != 0 { SIGNATURE_BYTES } else { 0 };
    Some(STAMP_BYTES + head + usize::from(payload) + CHECKSUM_BYTES + signature)
}

/// The checksum of the protocol, CRC-16/MCRF4XX.
fn checksum<'b>(bytes: impl Iterator<Item = &'b u8>) -> u16 {
    bytes.fold(0xffff, |crc, &byte| {
        let mixed = byte ^ crc as u8;
        let mixed = mixed ^ (mixed << 4);
        (crc >> 8) ^ (u16::from(mixed) << 8) ^ (u16::from(mixed) << 3) ^ (u16::from(mixed) >> 4)
    })
}

impl Messages for Tlog {
    fn path(&self) -> &Path {
        &self.path
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn metadata(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    fn select(&mut self, fields: Vec<Vec<usize>>) -> Result<(), Error> {
        self.wanted = vec![Vec::new(); self.topics.len()];
        for (origin, &topic) in &self.indices {
            let Some(kind) = self.kinds.get(&origin.kind) else { continue };
            let chosen = fields.get(topic).into_iter().flatten();
            let field = |&field: &usize| field.checked_sub(1).and_then(|at| kind.fields.get(at).cloned());
            self.wanted[topic] = chosen.map(field).collect();
        }
        self.buffer.clear();
        (self.done, self.skipped, self.cut_off) = (0, 0, false);
        self.unknown.clear();
        let begun = self.bytes.seek(SeekFrom::Start(0));
        begun.map(drop).map_err(|error| Error::io(&self.path, "read the log", &error))
    }

    fn next(&mut self, values: &mut Vec<f64>) -> Result<Option<usize>, Error> {
        while let Some(frame) = self.advance()? {
            let topic = self.indices.get(&frame.origin).copied();
            let wanted = topic.and_then(|topic| self.wanted.get(topic)).filter(|wanted| !wanted.is_empty());
            let (Some(topic), Some(wanted)) = (topic, wanted) else { continue };
            values.clear();
            let log_time = seconds(frame.stamp.into(), 6);
            let read = |field: &Option<Field>| field.as_ref().map_or(log_time, |it| it.read(&self.payload));
            values.extend(wanted.iter().map(read));
            return Ok(Some(topic));
        }
        Ok(None)
    }

    fn warnings(&mut self) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.unknown.is_empty() {
            let count: u64 = self.unknown.values().sum();
            let kinds: Vec<String> = self.unknown.keys().take(LISTED).map(u32::to_string).collect();
            let more = if self.unknown.len() > LISTED { ", …" } else { "" };
            warnings.push(format!(
                "{count} messages are of kinds that are not known here and are left out: {}{more}",
                kinds.join(", ")
            ));
        }
        warnings.extend(left_out(self.skipped, self.cut_off));
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_describes_a_message() {
        let kinds: HashMap<u32, Kind> = MESSAGES.lines().filter_map(Kind::parse).collect();
        assert_eq!(kinds.len(), MESSAGES.lines().count());
        let fits = |kind: &Kind| {
            kind.fields.iter().all(|field| field.offset + field.number.bytes() <= LONGEST_PAYLOAD)
        };
        assert!(kinds.values().all(fits));
        let imu = &kinds[&27];
        assert_eq!((imu.name, imu.fields[9].name.as_str(), imu.fields[9].offset), ("RAW_IMU", ".zmag", 24));
    }

    #[test]
    fn the_checksum_is_that_of_the_protocol() {
        // The check value of CRC-16/MCRF4XX in the catalogue of CRCs.
        assert_eq!(checksum(b"123456789".iter()), 0x6f91);
    }
}
