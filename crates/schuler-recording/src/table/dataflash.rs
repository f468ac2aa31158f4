//! ArduPilot DataFlash logs (`.bin`): <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html>.
//!
//! A log describes itself: messages `FMT` say the name, the letters of the types and the labels of each kind of message. A column is
//! the message and a label, `ATT.Roll`; of messages of several instances, told by their field `I`, the topic is `IMU_0`. Values are as
//! they are logged, the hundredths and the degrees · 10⁷ of scaled types undone; `TimeUS` is in microseconds.
use std::collections::{BTreeMap, HashMap};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::log::{MOST_COLUMNS, Messages, Topic, left_out};
use super::number::Number;
use super::{BUFFER_BYTES, Bytestream};
use crate::error::{Error, Problem};

/// First bytes of a log: the head of a `FMT` message.
pub(super) const MAGIC: &[u8] = &[HEAD[0], HEAD[1], FMT];
const HEAD: [u8; 2] = [0xa3, 0x95];
/// The kind of messages that describe kinds.
const FMT: u8 = 0x80;
/// Bytes of a head, and of a `FMT` message behind its head.
const HEAD_BYTES: usize = 3;
const FMT_BYTES: usize = 86;
/// The field that tells instances.
const INSTANCE: &str = "I";

/// A log of which the topics are known.
pub(super) struct DataFlash {
    path: PathBuf,
    bytes: BufReader<Box<dyn Bytestream>>,
    kinds: HashMap<u8, Kind>,
    topics: Vec<Topic>,
    /// The topic of a kind and an instance.
    indices: BTreeMap<(u8, u8), usize>,
    /// Of each topic the fields that are asked for.
    wanted: Vec<Vec<Field>>,
    content: Vec<u8>,
    skipped: u64,
    cut_off: bool,
}

/// A kind of messages.
#[derive(Clone, Debug)]
struct Kind {
    name: String,
    /// Bytes behind the head.
    bytes: usize,
    labels: Vec<String>,
    fields: Vec<Field>,
    /// Where the instance stands.
    instance: Option<usize>,
}

/// Where a number stands, how it is written and by what it is multiplied.
#[derive(Clone, Copy, Debug)]
struct Field {
    offset: usize,
    number: Number,
    scale: f64,
}

impl Field {
    fn read(self, content: &[u8]) -> f64 {
        let number = content.get(self.offset..).and_then(|bytes| self.number.read(bytes));
        number.map_or(
            f64::NAN,
            |number| if self.scale == 1.0 { number } else { number / self.scale.recip().round() },
        )
    }
}

impl DataFlash {
    /// Reads the file for kinds and instances of messages.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn new(path: &Path, bytes: Box<dyn Bytestream>) -> Result<Self, Error> {
        let mut log = Self {
            path: path.to_owned(),
            bytes: BufReader::with_capacity(BUFFER_BYTES, bytes),
            kinds: HashMap::new(),
            topics: Vec::new(),
            indices: BTreeMap::new(),
            wanted: Vec::new(),
            content: Vec::new(),
            skipped: 0,
            cut_off: false,
        };
        let mut columns = 0;
        while let Some(id) = log.advance().map_err(|error| Error::io(path, "read the log", &error))? {
            let Some((key, kind)) = log.key(id) else { continue };
            if log.indices.contains_key(&key) {
                continue;
            }
            let name =
                if kind.instance.is_some() { format!("{}_{}", kind.name, key.1) } else { kind.name.clone() };
            let fields: Vec<String> = kind.labels.iter().map(|label| format!(".{label}")).collect();
            columns += fields.len();
            if columns > MOST_COLUMNS {
                let problem = format!("found more than {MOST_COLUMNS} fields; expected no more");
                return Err(Error::one(path, Problem::of_file(problem)));
            }
            log.indices.insert(key, log.topics.len());
            log.topics.push(Topic { name, fields, unreadable: None });
        }
        Ok(log)
    }

    /// The kind and instance of the last message.
    fn key(&self, id: u8) -> Option<((u8, u8), &Kind)> {
        let kind = self.kinds.get(&id).filter(|kind| !kind.fields.is_empty())?;
        let instance = kind.instance.and_then(|at| self.content.get(at)).copied().unwrap_or_default();
        Some(((id, instance), kind))
    }

    /// Puts the next message behind its head into `content` and gives its kind; understands the descriptions.
    fn advance(&mut self) -> io::Result<Option<u8>> {
        loop {
            let buffer = self.bytes.fill_buf()?;
            if buffer.is_empty() {
                return Ok(None);
            }
            // What is no head is passed over to the next byte that may begin one.
            if buffer.first() != Some(&HEAD[0]) {
                let pass = buffer.iter().position(|byte| *byte == HEAD[0]).unwrap_or(buffer.len());
                self.bytes.consume(pass);
                self.skipped += pass as u64;
                continue;
            }
            let mut head = [0; HEAD_BYTES];
            if !self.read(&mut head)? {
                return Ok(None);
            }
            let [_, second, id] = head;
            let known = self.kinds.get(&id).map(|kind| kind.bytes);
            let Some(bytes) = known.or((id == FMT).then_some(FMT_BYTES)).filter(|_| second == HEAD[1]) else {
                self.skipped += HEAD_BYTES as u64;
                continue;
            };
            let mut content = std::mem::take(&mut self.content);
            content.resize(bytes, 0);
            let whole = self.read(&mut content)?;
            self.content = content;
            if !whole {
                return Ok(None);
            }
            if id != FMT {
                return Ok(Some(id));
            }
            if let Some((id, kind)) = described(&self.content) {
                self.kinds.entry(id).or_insert(kind);
            }
        }
    }

    /// Fills `buffer`; says whether there was enough.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<bool> {
        match self.bytes.read_exact(buffer) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                self.cut_off = true;
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }
}

/// What a `FMT` message describes.
fn described(content: &[u8]) -> Option<(u8, Kind)> {
    let (&[id, length], rest) = content.split_first_chunk()?;
    let (name, rest) = rest.split_at_checked(4)?;
    let (letters, labels) = rest.split_at_checked(16)?;
    let text = |bytes: &[u8]| {
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(bytes.get(..end).unwrap_or_default()).trim().to_owned()
    };
    let (mut offset, mut fields, mut labelled, mut instance) = (0, Vec::new(), Vec::new(), None);
    let labels = text(labels);
    for (letter, label) in text(letters).bytes().zip(labels.split(',')) {
        let (number, scale, bytes) = written(letter)?;
        if let Some(number) = number {
            if label == INSTANCE && number == Number::U8 {
                instance = Some(offset);
            }
            fields.push(Field { offset, number, scale });
            labelled.push(label.trim().to_owned());
        }
        offset += bytes;
    }
    let bytes = usize::from(length).checked_sub(HEAD_BYTES).filter(|bytes| *bytes >= offset)?;
    Some((id, Kind { name: text(name), bytes, labels: labelled, fields, instance }))
}

/// How a letter's values are written, none for text; by what they are multiplied; how many bytes they take.
fn written(letter: u8) -> Option<(Option<Number>, f64, usize)> {
    let number = |number: Number, scale: f64| Some((Some(number), scale, number.bytes()));
    match letter {
        b'b' => number(Number::I8, 1.0),
        b'B' | b'M' => number(Number::U8, 1.0),
        b'h' => number(Number::I16, 1.0),
        b'H' => number(Number::U16, 1.0),
        b'i' => number(Number::I32, 1.0),
        b'I' => number(Number::U32, 1.0),
        b'q' => number(Number::I64, 1.0),
        b'Q' => number(Number::U64, 1.0),
        b'f' => number(Number::F32, 1.0),
        b'd' => number(Number::F64, 1.0),
        b'c' => number(Number::I16, 1e-2),
        b'C' => number(Number::U16, 1e-2),
        b'e' => number(Number::I32, 1e-2),
        b'E' => number(Number::U32, 1e-2),
        b'L' => number(Number::I32, 1e-7),
        b'g' => Some((None, 1.0, 2)),
        b'n' => Some((None, 1.0, 4)),
        b'N' => Some((None, 1.0, 16)),
        b'Z' | b'a' => Some((None, 1.0, 64)),
        _ => None,
    }
}

impl Messages for DataFlash {
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
        for (&(id, _), &topic) in &self.indices {
            let Some(kind) = self.kinds.get(&id) else { continue };
            let chosen = fields.get(topic).into_iter().flatten();
            self.wanted[topic] = chosen.filter_map(|&field| kind.fields.get(field).copied()).collect();
        }
        (self.skipped, self.cut_off) = (0, false);
        let begun = self.bytes.seek(SeekFrom::Start(0));
        begun.map(drop).map_err(|error| Error::io(&self.path, "read the log", &error))
    }

    fn next(&mut self, values: &mut Vec<f64>) -> Result<Option<usize>, Error> {
        while let Some(id) = self.advance().map_err(|error| Error::io(&self.path, "read the log", &error))? {
            let topic = self.key(id).and_then(|(key, _)| self.indices.get(&key).copied());
            let wanted = topic.and_then(|topic| self.wanted.get(topic)).filter(|wanted| !wanted.is_empty());
            let (Some(topic), Some(wanted)) = (topic, wanted) else { continue };
            values.clear();
            values.extend(wanted.iter().map(|field| field.read(&self.content)));
            return Ok(Some(topic));
        }
        Ok(None)
    }

    fn warnings(&mut self) -> Vec<String> {
        left_out(self.skipped, self.cut_off).collect()
    }
}
