//! MCAP files: <https://mcap.dev/spec>.
//!
//! A column is the topic, a dot and the path of a number in its messages: `/imu.angular_velocity.x`,
//! `/temperatures.values[2]`. Each topic has two more, the times that stand beside a message and not in it:
//! `/imu@log_time` (when it was recorded) and `/imu@publish_time`, in seconds. A time stamp in a message, be it of ROS,
//! of Protobuf or an object of seconds and nanoseconds, is one column of seconds: `/imu.header.stamp`. Which of them is
//! the time is said by the case.
//!
//! | messages | with a schema of |
//! | --- | --- |
//! | `json` | any or none: what is a number or true or false in the messages is a column |
//! | `protobuf` | `protobuf`, the file descriptors |
//! | `ros1` | `ros1msg` |
//! | `cdr` | `ros2msg` |
//!
//! Text, bytes, maps, and arrays longer than 64 have no columns. A column is there if any message has it, missing where
//! a message has not. Chunks may be compressed with LZ4 or Zstandard; every checksum is held to. A file that was not
//! closed, without footer, summary or the end of its last chunk, is read as far as it goes, with a warning.
//!
//! ROS 1 bags ([`bag`]) and ROS 2 bags in SQLite hold the same: channels with schemas, and messages.
pub(super) mod bag;
mod json;
mod protobuf;
mod records;
mod ros;
#[cfg(feature = "rosbag2")]
pub(super) mod rosbag2;

use std::collections::{BTreeMap, HashMap};
use std::io::{self, SeekFrom};
use std::path::{Path, PathBuf};

use ::mcap::McapError;
use ::mcap::records::op;
use ::mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::log::{MOST_COLUMNS, Messages, Topic};
use super::seconds::seconds;
use super::{Bytestream, guarded};
use crate::error::{Error, Problem};
use records::Record;

/// Bytes of the longest record or decompressed chunk.
const LONGEST_RECORD: usize = 1 << 27;
/// Records that a file may have: so many, and so many for each of its bytes. A message takes 31 bytes, so that more are no
/// log but a decompressor kept busy: 128 MiB of empty records fit into 17 kB.
const MOST_RECORDS: u64 = 100_000;
const MOST_RECORDS_PER_BYTE: u64 = 64;
/// Bytes read at a time.
const READ_BYTES: usize = 1 << 16;
/// The times of every topic, which are its first fields.
const TIMES: [&str; 2] = ["@log_time", "@publish_time"];

/// The records of a log, in the order of the file.
trait Source {
    /// Goes to the first.
    fn rewind(&mut self, path: &Path) -> Result<(), Error>;

    /// The next record.
    fn next(&mut self, path: &Path) -> Result<Option<Record<'_>>, Error>;

    /// What the user should be told when the last has been read.
    fn warnings(&self) -> Vec<String>;
}

/// A log of channels with schemas, of which the topics are known.
pub(super) struct Mcap {
    path: PathBuf,
    records: Box<dyn Source>,
    channels: HashMap<u16, Channel>,
    topics: Vec<Topic>,
    metadata: BTreeMap<String, String>,
    /// Messages that there are, and that there should be.
    messages: [u64; 2],
    /// Of each topic, how many fields are asked for and which places each has among them.
    wanted: Vec<(usize, HashMap<String, Vec<usize>>)>,
}

struct Channel {
    topic: usize,
    /// None where the messages cannot be read.
    decoder: Option<Decoder>,
}

/// How the messages of a channel are read.
enum Decoder {
    Json,
    Protobuf(protobuf::Protobuf),
    Ros(ros::Ros),
}

impl Decoder {
    fn new(encoding: &str, schema: Option<&Schema>) -> Result<Self, String> {
        let described =
            schema.map_or("no schema".to_owned(), |schema| format!("schema {:?}", schema.encoding));
        match (encoding, schema, schema.map_or("", |schema| schema.encoding.as_str())) {
            ("json", ..) => Ok(Self::Json),
            ("protobuf", Some(schema), "protobuf") => {
                protobuf::Protobuf::new(&schema.name, &schema.data).map(Self::Protobuf)
            }
            ("ros1", Some(schema), "ros1msg") => {
                ros::Ros::new(&schema.name, &schema.data, ros::Wire::Ros1).map(Self::Ros)
            }
            ("cdr", Some(schema), "ros2msg") => {
                ros::Ros::new(&schema.name, &schema.data, ros::Wire::Cdr).map(Self::Ros)
            }
            _ => Err(format!(
                "encoded as {encoding:?} with {described}, which is not read; json, protobuf, ros1 with ros1msg and \
                 cdr with ros2msg are"
            )),
        }
    }

    fn decode(&self, message: &[u8], leaves: &mut Leaves<'_>) -> Result<(), String> {
        match self {
            Self::Json => json::decode(message, leaves),
            Self::Protobuf(decoder) => decoder.decode(message, leaves),
            Self::Ros(decoder) => decoder.decode(message, leaves),
        }
    }
}

struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

/// Where the numbers of a message go, each with its path.
struct Leaves<'a> {
    path: String,
    take: &'a mut dyn FnMut(&str, f64),
}

impl<'a> Leaves<'a> {
    fn new(take: &'a mut dyn FnMut(&str, f64)) -> Self {
        Self { path: String::new(), take }
    }

    /// The number at the path.
    fn number(&mut self, value: f64) {
        (self.take)(&self.path, value);
    }

    /// What `inside` does, a step deeper.
    fn within<T>(&mut self, step: std::fmt::Arguments<'_>, inside: impl FnOnce(&mut Self) -> T) -> T {
        let length = self.path.len();
        // Writing to a string does not fail.
        let _ = std::fmt::Write::write_fmt(&mut self.path, step);
        let done = inside(self);
        self.path.truncate(length);
        done
    }
}

impl Mcap {
    /// Reads the file for topics and fields.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn new(path: &Path, bytes: Box<dyn Bytestream>) -> Result<Self, Error> {
        Self::of(path, Box::new(Records::new(bytes)))
    }

    /// Reads a ROS 1 bag for topics and fields.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn of_bag(path: &Path, bytes: Box<dyn Bytestream>) -> Result<Self, Error> {
        Self::of(path, Box::new(bag::Bag::new(bytes)))
    }

    /// Reads a ROS 2 bag in SQLite for topics and fields.
    ///
    /// # Errors
    /// A file that cannot be read.
    #[cfg(feature = "rosbag2")]
    pub(super) fn of_sqlite(path: &Path, bag: rosbag2::Rosbag2) -> Result<Self, Error> {
        Self::of(path, Box::new(bag))
    }

    fn of(path: &Path, records: Box<dyn Source>) -> Result<Self, Error> {
        let mut mcap = Self {
            path: path.to_owned(),
            records,
            channels: HashMap::new(),
            topics: Vec::new(),
            metadata: BTreeMap::new(),
            messages: [0; 2],
            wanted: Vec::new(),
        };
        guarded(path, || mcap.find_topics())?;
        Ok(mcap)
    }

    fn find_topics(&mut self) -> Result<(), Error> {
        let path = &self.path;
        let mut schemas: HashMap<u16, Schema> = HashMap::new();
        let mut topics: HashMap<String, usize> = HashMap::new();
        let mut fields: Vec<HashMap<String, usize>> = Vec::new();
        let mut columns = 0;
        self.records.rewind(path)?;
        let (mut messages, mut counted) = (0, None);
        while let Some(record) = self.records.next(path)? {
            match record {
                Record::Header { profile, library } => {
                    for (key, value) in [("profile", profile), ("library", library)] {
                        self.metadata.insert(key.to_owned(), value.to_owned());
                    }
                }
                Record::Metadata { name, pairs } => {
                    let pairs = pairs.into_iter();
                    self.metadata
                        .extend(pairs.map(|(key, value)| (format!("{name}.{key}"), value.to_owned())));
                }
                Record::Schema { id, name, encoding, data } => {
                    let (name, encoding) = (name.to_owned(), encoding.to_owned());
                    schemas.insert(id, Schema { name, encoding, data: data.to_owned() });
                }
                Record::Channel { id, schema, topic, encoding } => {
                    if self.channels.contains_key(&id) {
                        continue;
                    }
                    let topic = *topics.entry(topic.to_owned()).or_insert_with(|| {
                        self.topics.push(Topic { name: topic.to_owned(), ..Topic::default() });
                        fields.push(HashMap::new());
                        self.topics.len() - 1
                    });
                    let decoder = Decoder::new(encoding, schemas.get(&schema));
                    if decoder.is_ok() && self.topics[topic].fields.is_empty() {
                        self.topics[topic].fields.extend(TIMES.map(str::to_owned));
                    }
                    let decoder = decoder.map_err(|why| self.topics[topic].unreadable = Some(why)).ok();
                    self.channels.insert(id, Channel { topic, decoder });
                }
                Record::Message { channel, data, .. } => {
                    messages += 1;
                    let Some(Channel { topic, decoder: Some(decoder) }) = self.channels.get(&channel) else {
                        continue;
                    };
                    let (topic, known) = (&mut self.topics[*topic], &mut fields[*topic]);
                    let mut take = |field: &str, _: f64| {
                        if !known.contains_key(field) && columns <= MOST_COLUMNS {
                            known.insert(field.to_owned(), topic.fields.len());
                            topic.fields.push(field.to_owned());
                            columns += 1;
                        }
                    };
                    let decoded = decoder.decode(data, &mut Leaves::new(&mut take));
                    decoded.map_err(|why| undecodable(path, &topic.name, messages, &why))?;
                    if columns > MOST_COLUMNS {
                        let problem = format!("found more than {MOST_COLUMNS} fields; expected no more");
                        return Err(Error::one(path, Problem::of_file(problem)));
                    }
                }
                Record::Statistics { messages } => counted = Some(messages),
                Record::Other => {}
            }
        }
        self.messages = [messages, counted.unwrap_or(messages)];
        Ok(())
    }
}

fn undecodable(path: &Path, topic: &str, message: u64, why: &str) -> Error {
    Error::one(
        path,
        Problem::new(None, topic, format!("message {message} of the file cannot be read: {why}")),
    )
}

impl Messages for Mcap {
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
        self.wanted = (fields.iter().zip(&self.topics))
            .map(|(fields, topic)| {
                let mut places: HashMap<String, Vec<usize>> = HashMap::new();
                for (place, &field) in fields.iter().enumerate() {
                    places.entry(topic.fields[field].clone()).or_default().push(place);
                }
                (fields.len(), places)
            })
            .collect();
        self.records.rewind(&self.path)
    }

    fn next(&mut self, values: &mut Vec<f64>) -> Result<Option<usize>, Error> {
        while let Some(record) = self.records.next(&self.path)? {
            let Record::Message { channel, sequence, log_time, publish_time, data } = record else {
                continue;
            };
            let Some(Channel { topic, decoder: Some(decoder) }) = self.channels.get(&channel) else {
                continue;
            };
            let Some((count, places)) = self.wanted.get(*topic).filter(|(count, _)| *count > 0) else {
                continue;
            };
            values.clear();
            values.resize(*count, f64::NAN);
            let mut take = |field: &str, value: f64| {
                for &place in places.get(field).into_iter().flatten() {
                    values[place] = value;
                }
            };
            let mut from_file = 0;
            for (name, time) in TIMES.into_iter().zip([log_time, publish_time]) {
                take(name, seconds(time.into(), 9));
                from_file += places.get(name).map_or(0, Vec::len);
            }
            // What no field of the message is asked for needs not be read.
            if from_file < *count {
                let decoded = decoder.decode(data, &mut Leaves::new(&mut take));
                let name = &self.topics[*topic].name;
                decoded.map_err(|why| undecodable(&self.path, name, sequence.into(), &why))?;
            }
            return Ok(Some(*topic));
        }
        Ok(None)
    }

    fn warnings(&mut self) -> Vec<String> {
        let mut warnings = self.records.warnings();
        let [found, counted] = self.messages;
        if found != counted {
            warnings.push(format!("{found} messages are there, {counted} were written; the file is damaged"));
        }
        warnings
    }
}

/// The records of a file, those in chunks among them.
struct Records {
    bytes: Box<dyn Bytestream>,
    reader: LinearReader,
    /// The last record; the reader's own buffer cannot be lent and read on.
    record: Vec<u8>,
    footer: bool,
    cut_off: bool,
    /// Records that may still follow.
    left: u64,
}

impl Records {
    fn new(bytes: Box<dyn Bytestream>) -> Self {
        let reader = LinearReader::new();
        Self { bytes, reader, record: Vec::new(), footer: false, cut_off: false, left: 0 }
    }
}

impl Source for Records {
    fn warnings(&self) -> Vec<String> {
        let warning = if self.cut_off {
            "the file is cut off; what is not whole at its end is left out"
        } else if !self.footer {
            "the file was not closed; it is read as far as it goes"
        } else {
            return Vec::new();
        };
        vec![warning.to_owned()]
    }

    fn rewind(&mut self, path: &Path) -> Result<(), Error> {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(LONGEST_RECORD);
        self.reader = LinearReader::new_with_options(options);
        (self.footer, self.cut_off) = (false, false);
        let failed = |error: io::Error| Error::io(path, "read the log", &error);
        let bytes = self.bytes.seek(SeekFrom::End(0)).map_err(failed)?;
        self.left = bytes.saturating_mul(MOST_RECORDS_PER_BYTE).saturating_add(MOST_RECORDS);
        self.bytes.seek(SeekFrom::Start(0)).map(drop).map_err(failed)
    }

    fn next(&mut self, path: &Path) -> Result<Option<Record<'_>>, Error> {
        let opcode = loop {
            if self.footer || self.cut_off {
                return Ok(None);
            }
            match self.reader.next_event() {
                None => return Ok(None),
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => {
                    let buffer = self.reader.insert(bytes.min(READ_BYTES));
                    let read = match self.bytes.read(buffer) {
                        Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                        read => read.map_err(|error| Error::io(path, "read the log", &error))?,
                    };
                    self.reader.notify_read(read);
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    self.left = self.left.checked_sub(1).ok_or_else(|| {
                        let found = "cannot read the log: found more records than its size lets expect";
                        Error::one(path, Problem::of_file(format!("{found}; the file is damaged")))
                    })?;
                    self.footer |= opcode == op::FOOTER;
                    self.record.clear();
                    self.record.extend_from_slice(data);
                    break opcode;
                }
                Some(Err(McapError::UnexpectedEof)) => self.cut_off = true,
                Some(Err(error)) => {
                    return Err(Error::one(path, Problem::of_file(format!("cannot read the log: {error}"))));
                }
            }
        };
        let record = Record::parse(opcode, &self.record).ok_or_else(|| {
            let problem = format!("cannot read the log: a record of type {opcode} is damaged");
            Error::one(path, Problem::of_file(problem))
        })?;
        Ok(Some(record))
    }
}
