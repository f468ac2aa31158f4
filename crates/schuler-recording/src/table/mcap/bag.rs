//! ROS 1 bags, version 2.0: <http://wiki.ros.org/Bags/Format/2.0>.
//!
//! A bag is records of a header, which is fields of a name and a value, and data; messages stand in chunks, as they are or
//! compressed with LZ4. A connection carries the definition of its messages, so that no bag is of
//! unknown messages. The index at the end is not used: a bag that was not closed is read as far as
//! it goes. A record takes eight bytes and LZ4 packs at most 255 into one, so that the records of
//! a file are bounded by its size as those of MCAP are.
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::records::Record;
use super::{LONGEST_RECORD, Source};
use crate::error::{Error, Problem};
use crate::table::Bytestream;

/// First bytes of a bag that is read.
pub(in crate::table) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// What records are.
mod op {
    pub(super) const MESSAGE: u8 = 0x02;
    pub(super) const CHUNK: u8 = 0x05;
    pub(super) const CONNECTION: u8 = 0x07;
}

/// The records of a bag.
pub(super) struct Bag {
    bytes: Box<dyn Bytestream>,
    /// The chunk that is gone through, and how far.
    chunk: Vec<u8>,
    at: usize,
    /// The header and the data of the last record.
    header: Vec<u8>,
    data: Vec<u8>,
    /// The schema of a connection whose channel has been given, to be given next.
    connection: Option<Connection>,
    cut_off: bool,
}

struct Connection {
    id: u16,
    topic: String,
    kind: String,
    definition: Vec<u8>,
    /// Whether its schema has been given.
    described: bool,
}

impl Connection {
    fn channel(&mut self) -> Record<'_> {
        self.described = true;
        Record::Channel { id: self.id, schema: self.id, topic: &self.topic, encoding: "ros1" }
    }
}

impl Bag {
    pub(super) fn new(bytes: Box<dyn Bytestream>) -> Self {
        Self {
            bytes,
            chunk: Vec::new(),
            at: 0,
            header: Vec::new(),
            data: Vec::new(),
            connection: None,
            cut_off: false,
        }
    }

    /// Puts the next record into `header` and `data`: of the chunk, else of the file.
    fn advance(&mut self, path: &Path) -> Result<bool, Error> {
        if self.at < self.chunk.len() {
            let mut left = self.chunk.get(self.at..).unwrap_or_default();
            let (Some(header), Some(data)) = (counted(&mut left), counted(&mut left)) else {
                return Err(damaged(path, "a record in a chunk is longer than the chunk"));
            };
            self.header.clear();
            self.header.extend_from_slice(header);
            self.data.clear();
            self.data.extend_from_slice(data);
            self.at = self.chunk.len() - left.len();
            return Ok(true);
        }
        self.at = 0;
        self.chunk.clear();
        for part in [&mut self.header, &mut self.data] {
            let mut length = [0; 4];
            let got = read_full(&mut self.bytes, &mut length)
                .map_err(|error| Error::io(path, "read the log", &error))?;
            if got < length.len() {
                self.cut_off |= got > 0;
                return Ok(false);
            }
            let length = u32::from_le_bytes(length) as usize;
            if length > LONGEST_RECORD {
                return Err(damaged(path, "a record is longer than 128 MiB"));
            }
            part.clear();
            let read = self.bytes.by_ref().take(length as u64).read_to_end(part);
            if read.map_err(|error| Error::io(path, "read the log", &error))? < length {
                self.cut_off = true;
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Makes the data of a chunk's record the chunk.
    fn open_chunk(&mut self, path: &Path) -> Result<(), Error> {
        let size = field(&self.header, "size").and_then(u32_of).unwrap_or_default() as usize;
        if size > LONGEST_RECORD {
            return Err(damaged(path, "a chunk is longer than 128 MiB"));
        }
        self.at = 0;
        self.chunk.clear();
        match field(&self.header, "compression") {
            Some(b"none") => std::mem::swap(&mut self.chunk, &mut self.data),
            Some(b"lz4") => {
                let decoder = lz4_flex::frame::FrameDecoder::new(self.data.as_slice());
                let read = decoder.take(size as u64).read_to_end(&mut self.chunk);
                read.map_err(|error| damaged(path, &format!("a chunk cannot be unpacked: {error}")))?;
            }
            other => {
                let found = String::from_utf8_lossy(other.unwrap_or_default()).into_owned();
                let message = format!(
                    "found chunks compressed with {found:?}, which are not read; rosbag decompress IN.bag, or rosbag compress --lz4"
                );
                return Err(Error::one(path, Problem::of_file(message)));
            }
        }
        Ok(())
    }
}

impl Source for Bag {
    fn rewind(&mut self, path: &Path) -> Result<(), Error> {
        (self.chunk, self.at, self.connection, self.cut_off) = (Vec::new(), 0, None, false);
        let begin = SeekFrom::Start(MAGIC.len() as u64);
        self.bytes.seek(begin).map(drop).map_err(|error| Error::io(path, "read the log", &error))
    }

    fn next(&mut self, path: &Path) -> Result<Option<Record<'_>>, Error> {
        if self.connection.as_ref().is_some_and(|it| it.described) {
            self.connection = None;
        }
        if self.connection.is_none() && (self.cut_off || !self.advance(path)?) {
            return Ok(None);
        }
        if self.connection.is_some() {
            return Ok(self.connection.as_mut().map(Connection::channel));
        }
        match field(&self.header, "op") {
            // A chunk within a chunk could hold itself, and there would be no end of it.
            Some([op::CHUNK]) if self.at > 0 => Err(damaged(path, "a chunk stands in a chunk")),
            Some([op::CHUNK]) => {
                self.open_chunk(path)?;
                Ok(Some(Record::Other))
            }
            Some([op::CONNECTION]) => {
                let text =
                    |bytes: Option<&[u8]>| String::from_utf8_lossy(bytes.unwrap_or_default()).into_owned();
                let id = connection_of(&self.header)
                    .ok_or_else(|| damaged(path, "a connection has no number below 65536"))?;
                let it = self.connection.insert(Connection {
                    id,
                    topic: text(field(&self.header, "topic")),
                    kind: text(field(&self.data, "type")),
                    definition: field(&self.data, "message_definition").unwrap_or_default().to_vec(),
                    described: false,
                });
                Ok(Some(Record::Schema { id, name: &it.kind, encoding: "ros1msg", data: &it.definition }))
            }
            Some([op::MESSAGE]) => {
                let channel = connection_of(&self.header)
                    .ok_or_else(|| damaged(path, "a message has no connection"))?;
                let time = field(&self.header, "time").and_then(|time| {
                    let (seconds, nanoseconds) = time.split_at_checked(4)?;
                    Some(u64::from(u32_of(seconds)?) * 1_000_000_000 + u64::from(u32_of(nanoseconds)?))
                });
                let log_time = time.ok_or_else(|| damaged(path, "a message has no time"))?;
                Ok(Some(Record::Message {
                    channel,
                    sequence: 0,
                    log_time,
                    publish_time: log_time,
                    data: &self.data,
                }))
            }
            _ => Ok(Some(Record::Other)),
        }
    }

    fn warnings(&self) -> Vec<String> {
        let cut_off = "the file is cut off; what is not whole at its end is left out".to_owned();
        if self.cut_off { vec![cut_off] } else { Vec::new() }
    }
}

fn damaged(path: &Path, what: &str) -> Error {
    Error::one(path, Problem::of_file(format!("cannot read the log: {what}; the file is damaged")))
}

fn read_full(from: &mut dyn Bytestream, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut got = 0;
    while let Some(rest) = buffer.get_mut(got..).filter(|rest| !rest.is_empty()) {
        match from.read(rest) {
            Ok(0) => break,
            Ok(more) => got += more,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(got)
}

fn u32_of(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

fn connection_of(header: &[u8]) -> Option<u16> {
    u16::try_from(field(header, "conn").and_then(u32_of)?).ok()
}

/// Bytes with their number before them.
fn counted<'b>(bytes: &mut &'b [u8]) -> Option<&'b [u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (taken, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *bytes = rest;
    Some(taken)
}

/// The value of a field of a header.
fn field<'h>(mut header: &'h [u8], name: &str) -> Option<&'h [u8]> {
    while let Some(pair) = counted(&mut header) {
        if let Some(value) = pair.strip_prefix(name.as_bytes()).and_then(|rest| rest.strip_prefix(b"=")) {
            return Some(value);
        }
    }
    None
}
