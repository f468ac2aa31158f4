//! Bags of ROS 2 in SQLite (`.db3`), read with SQLite itself: <https://github.com/ros2/rosbag2>.
//!
//! The table `topics` names the topics, `messages` has a row each message, in the order in which they were recorded. From ROS 2 Iron on
//! `message_definitions` describes them; before that a bag does not say what its messages are, and only those that ROS
//! itself defines are read.
//!
//! The file is opened for reading, as one that nobody changes, so that SQLite leaves no file beside it. What must be a table is one: a view
//! could be made to have rows without end.
use std::collections::VecDeque;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use rusqlite::limits::Limit;
use rusqlite::{Connection, MAIN_DB, OpenFlags, OptionalExtension};

use super::records::Record;
use super::{LONGEST_RECORD, Source};
use crate::error::{Error, Problem};

/// First bytes of a file.
pub(in crate::table) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Definitions of the messages that ROS itself defines.
const STANDARD: &str = include_str!("ros2_standard.msg");
/// Messages that are read from the file at once, and bytes after which it is fewer.
const BATCH: i64 = 64;
const BATCH_BYTES: usize = 1 << 22;
/// Topics that a bag may have.
const MOST_TOPICS: usize = 10_000;

/// The records of a bag.
pub(in crate::table) struct Rosbag2 {
    database: Connection,
    topics: Vec<Topic>,
    /// Definitions given so far, and channels.
    schemas: usize,
    channels: usize,
    /// The row of the last message that was read from the file.
    row: i64,
    read: VecDeque<Message>,
    /// The message given last.
    given: Message,
    ended: bool,
    /// What the user should be told.
    warning: Option<String>,
}

struct Topic {
    /// Its number in the file.
    number: i64,
    name: String,
    /// Of the message, such as `sensor_msgs/msg/Imu`.
    kind: String,
    serialization: String,
    /// What describes its messages, and how, if anything does.
    definition: Option<(String, String)>,
}

#[derive(Default)]
struct Message {
    topic: i64,
    time_ns: i64,
    data: Vec<u8>,
}

impl Rosbag2 {
    /// Opens a file.
    ///
    /// # Errors
    /// What SQLite says is wrong with it, or that it is no bag.
    pub(in crate::table) fn open(path: &Path) -> Result<Self, Error> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI;
        let absolute = std::path::absolute(path).map_err(|error| Error::io(path, "read the log", &error))?;
        // As of a medium that cannot be written, of which nothing is locked.
        let uri = format!("file:{}?immutable=1", escaped(&absolute));
        let database = Connection::open_with_flags(uri, flags).map_err(|error| failed(path, &error))?;
        let mut bag = Self::of(path, database)?;
        // SQLite writes there first what it has not yet put into the file.
        let log = PathBuf::from(format!("{}-wal", path.display()));
        if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
            let name = log.display();
            bag.warning = Some(format!(
                "the bag was not closed: what is in {name} is not read; sqlite3 BAG 'PRAGMA wal_checkpoint' puts it into the bag"
            ));
        }
        Ok(bag)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub(in crate::table) fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let opened = || {
            let mut database = Connection::open_in_memory()?;
            database.deserialize_read_exact(MAIN_DB, Cursor::new(bytes), bytes.len(), true)?;
            Ok(database)
        };
        Self::of(path, opened().map_err(|error| failed(path, &error))?)
    }

    fn of(path: &Path, database: Connection) -> Result<Self, Error> {
        let topics = || {
            database
                .set_limit(Limit::SQLITE_LIMIT_LENGTH, i32::try_from(LONGEST_RECORD).unwrap_or(i32::MAX))?;
            database.pragma_update(None, "trusted_schema", false)?;
            if !(is_table(&database, "topics")? && is_table(&database, "messages")?) {
                return Ok(None);
            }
            topics(&database).map(Some)
        };
        let Some(topics) = topics().map_err(|error| failed(path, &error))? else {
            let message =
                "found an SQLite database that is no bag of ROS 2; expected the tables topics and messages";
            return Err(Error::one(path, Problem::of_file(message)));
        };
        Ok(Self {
            database,
            topics,
            schemas: 0,
            channels: 0,
            row: i64::MIN,
            read: VecDeque::new(),
            given: Message::default(),
            ended: false,
            warning: None,
        })
    }

    /// Reads some more messages from the file.
    fn fill(&mut self) -> rusqlite::Result<()> {
        let query =
            "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ?1 ORDER BY rowid LIMIT ?2";
        let mut statement = self.database.prepare(query)?;
        let mut rows = statement.query((self.row, BATCH))?;
        let mut bytes = 0;
        while bytes < BATCH_BYTES
            && let Some(row) = rows.next()?
        {
            self.row = row.get(0)?;
            let message = Message { topic: row.get(1)?, time_ns: row.get(2)?, data: row.get(3)? };
            bytes += message.data.len();
            self.read.push_back(message);
        }
        self.ended = self.read.is_empty();
        Ok(())
    }
}

impl Source for Rosbag2 {
    fn rewind(&mut self, _: &Path) -> Result<(), Error> {
        (self.schemas, self.channels, self.row, self.ended) = (0, 0, i64::MIN, false);
        self.read.clear();
        Ok(())
    }

    fn next(&mut self, path: &Path) -> Result<Option<Record<'_>>, Error> {
        // Definitions first, then channels, then messages.
        if self.schemas < self.topics.len() {
            let topic = &self.topics[self.schemas];
            self.schemas += 1;
            let Some((encoding, data)) = &topic.definition else { return Ok(Some(Record::Other)) };
            let id = self.schemas as u16;
            return Ok(Some(Record::Schema { id, name: &topic.kind, encoding, data: data.as_bytes() }));
        }
        if self.channels < self.topics.len() {
            let topic = &self.topics[self.channels];
            self.channels += 1;
            let id = self.channels as u16;
            return Ok(Some(Record::Channel {
                id,
                schema: id,
                topic: &topic.name,
                encoding: &topic.serialization,
            }));
        }
        if self.read.is_empty() && !self.ended {
            self.fill().map_err(|error| failed(path, &error))?;
        }
        let Some(message) = self.read.pop_front() else { return Ok(None) };
        self.given = message;
        let Message { topic, time_ns, data } = &self.given;
        let Some(place) = self.topics.iter().position(|it| it.number == *topic) else {
            return Ok(Some(Record::Other));
        };
        let time_ns = u64::try_from(*time_ns).unwrap_or_default();
        Ok(Some(Record::Message {
            channel: place as u16 + 1,
            sequence: 0,
            log_time: time_ns,
            publish_time: time_ns,
            data,
        }))
    }

    fn warnings(&self) -> Vec<String> {
        self.warning.iter().cloned().collect()
    }
}

/// Whether the database has a table of this name that holds its own rows.
fn is_table(database: &Connection, name: &str) -> rusqlite::Result<bool> {
    let query = "SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?1";
    let made: Option<String> = database.query_row(query, [name], |row| row.get(0)).optional()?;
    let words = made.unwrap_or_default().to_lowercase();
    let mut words = words.split_whitespace();
    Ok(words.next() == Some("create") && words.next() == Some("table"))
}

/// The topics with what describes them.
fn topics(database: &Connection) -> rusqlite::Result<Vec<Topic>> {
    let mut definitions: Vec<(String, String, String)> = Vec::new();
    if is_table(database, "message_definitions")? {
        let query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions";
        let mut statement = database.prepare(query)?;
        let rows = statement.query_map((), |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?;
        definitions = rows.take(MOST_TOPICS).collect::<Result<_, _>>()?;
    }
    let mut statement =
        database.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
    let rows = statement.query_map((), |row| {
        let kind: String = row.get(2)?;
        let stated = definitions.iter().find(|(of, _, text)| *of == kind && !text.is_empty());
        let definition = stated.map(|(_, encoding, text)| (encoding.clone(), text.clone()));
        let definition = definition.or_else(|| is_standard(&kind).then(standard));
        let (number, name, serialization) = (row.get(0)?, row.get(1)?, row.get(3)?);
        Ok(Topic { number, name, kind, serialization, definition })
    })?;
    rows.take(MOST_TOPICS).collect()
}

/// Whether ROS itself defines this message.
fn is_standard(kind: &str) -> bool {
    let short = kind.replace("/msg/", "/");
    STANDARD.lines().any(|line| line.strip_prefix("MSG: ") == Some(&short))
}

fn standard() -> (String, String) {
    ("ros2msg".to_owned(), STANDARD.to_owned())
}

/// A path as it stands in a URI.
fn escaped(path: &Path) -> String {
    path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23")
}

fn failed(path: &Path, error: &rusqlite::Error) -> Error {
    Error::one(path, Problem::of_file(format!("cannot read the log: {error}")))
}
