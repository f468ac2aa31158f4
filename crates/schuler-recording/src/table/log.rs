//! Logs as tables: messages of several topics at rates of their own, as rows of one of them.
//!
//! A column is a field of a topic, `TOPIC.FIELD`. **The rows are the messages of the topic of the first column asked
//! for**, which for a case is its time column: under `time = "sensor_gyro_0.timestamp"` there is one row for each message
//! of `sensor_gyro_0`. A message of another topic stands in the row whose time is nearest to its own (the earlier of two
//! that are equally near), and in no other; where it has no message, a column is missing. So nothing is held, repeated
//! or interpolated here, and a slow sensor has as many values as it gave readings.
//!
//! - Of several messages of a topic nearest to one row, the nearest is taken; a topic faster than the rows is thinned,
//!   which a warning counts.
//! - A message farther from its row than the shorter of the distances to the rows beside it is left out and counted: it
//!   was recorded while there were no rows.
//! - The time of a message is the field of the same name as the time column: under `time = "/imu.header.stamp"` a column
//!   of `/gnss` needs `/gnss.header.stamp`. Times of different clocks are never compared.
//! - Rows of several topics must be in the order of their times. Messages of the others may be late by up to
//!   8192 rows; later ones are left out and counted.
use std::path::{Path, PathBuf};

use super::join::Join;
use super::{CHUNK_ROWS, Chunks, Columns, TableReader, column_index, guarded, listed};
use crate::error::{Error, Problem};

/// Elements of the longest array that has columns; longer ones are pictures and point clouds.
pub(super) const LONGEST_ARRAY: usize = 64;
/// Messages after which a chunk is handed on though it has not all its rows, so that whoever reads can stop.
const CHUNK_MESSAGES: usize = 1 << 16;
/// Columns that a log may have.
pub(super) const MOST_COLUMNS: usize = 100_000;

/// Warnings of what a log has beside its messages: bytes that are none, and a last one that is cut off.
pub(super) fn left_out(skipped: u64, cut_off: bool) -> impl Iterator<Item = String> {
    let none = (skipped > 0).then(|| format!("{skipped} bytes are no messages and are left out"));
    let cut_off = cut_off.then(|| "the last message is cut off and is left out".to_owned());
    none.into_iter().chain(cut_off)
}

/// A topic of a log and its numeric fields.
#[derive(Clone, Debug, Default)]
pub(super) struct Topic {
    /// Name.
    pub(super) name: String,
    /// What joins the name and each field, which begins with it, as in `.x` or `@log_time`.
    pub(super) fields: Vec<String>,
    /// Why it has no fields, completing "its messages are …", where it cannot be read.
    pub(super) unreadable: Option<String>,
}

/// A log of which the topics are known.
pub(super) trait Messages {
    /// The file.
    fn path(&self) -> &Path;

    /// The topics; this order is that of indices into them.
    fn topics(&self) -> &[Topic];

    /// What the file says of itself.
    fn metadata(&self) -> Vec<(String, String)>;

    /// Goes to the first message and asks for fields of each topic by their indices; a topic with none is passed over.
    ///
    /// # Errors
    /// A file that cannot be read.
    fn select(&mut self, fields: Vec<Vec<usize>>) -> Result<(), Error>;

    /// Puts the fields of the next message into `values` and gives the index of its topic.
    ///
    /// # Errors
    /// A message that cannot be read.
    fn next(&mut self, values: &mut Vec<f64>) -> Result<Option<usize>, Error>;

    /// What the user should be told when the last message has been read.
    fn warnings(&mut self) -> Vec<String>;
}

/// A log as a table.
pub(super) struct LogTable<M> {
    messages: M,
    path: PathBuf,
    names: Vec<String>,
    /// Topic and field of each column.
    places: Vec<(usize, usize)>,
    metadata: Vec<(String, String)>,
}

impl<M: Messages + 'static> LogTable<M> {
    /// A table of all topics.
    ///
    /// # Errors
    /// No column, or too many.
    pub(super) fn new(messages: M) -> Result<Self, Error> {
        let path = messages.path().to_owned();
        let mut names = Vec::new();
        let mut places = Vec::new();
        for (index, topic) in messages.topics().iter().enumerate() {
            names.extend(topic.fields.iter().map(|field| format!("{}{field}", topic.name)));
            places.extend((0..topic.fields.len()).map(|field| (index, field)));
        }
        if names.is_empty() {
            let unreadable = messages.topics().iter().find_map(|topic| topic.unreadable.as_ref());
            let why = unreadable.map(|why| format!(": its messages are {why}")).unwrap_or_default();
            let problem = format!("found no numbers{why}; expected at least one column of numbers");
            return Err(Error::one(path, Problem::of_file(problem)));
        }
        let metadata = messages.metadata();
        Ok(Self { messages, path, names, places, metadata })
    }
}

impl<M: Messages + 'static> TableReader for LogTable<M> {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn metadata(&self) -> &[(String, String)] {
        &self.metadata
    }

    fn index(&self, name: &str) -> Result<usize, String> {
        column_index(&self.names, name).map_err(|message| {
            let topics = self.messages.topics().iter();
            // The longest, as `/imu` is the beginning of `/imu_raw`, too.
            let topic =
                topics.filter(|topic| name.starts_with(&topic.name)).max_by_key(|topic| topic.name.len());
            match topic.and_then(|topic| Some((topic, topic.unreadable.as_ref()?))) {
                Some((topic, why)) => format!(
                    "found \"{name}\"; expected a column of the table, but the messages of \"{}\" are {why}",
                    topic.name
                ),
                None => message,
            }
        })
    }

    fn all(&self) -> Result<Vec<usize>, String> {
        let topics = self.messages.topics().iter().filter(|topic| !topic.fields.is_empty());
        let names: Vec<&str> = topics.map(|topic| topic.name.as_str()).collect();
        if names.len() == 1 {
            return Ok((0..self.names.len()).collect());
        }
        Err(format!(
            "found messages of {} topics ({}); expected a choice of columns, of which the first is the time",
            names.len(),
            listed(&names)
        ))
    }

    fn chunks(mut self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let topics = self.messages.topics();
        let places: Vec<(usize, usize)> =
            wanted.iter().filter_map(|&column| self.places.get(column).copied()).collect();
        let Some(&(leading, time)) = places.first() else { return Ok(Box::new(std::iter::empty())) };
        let time = topics[leading].fields[time].clone();
        // Of each topic first its time, then the columns.
        let mut fields: Vec<Vec<usize>> = vec![Vec::new(); topics.len()];
        let mut columns: Vec<Vec<usize>> = vec![Vec::new(); topics.len()];
        for (column, &(index, field)) in places.iter().enumerate() {
            let (fields, columns, topic) = (&mut fields[index], &mut columns[index], &topics[index]);
            if fields.is_empty() {
                let Some(at) = topic.fields.iter().position(|name| *name == time) else {
                    let name = format!("{}{}", topic.name, topic.fields[field]);
                    let message = format!(
                        "found no \"{}{time}\"; expected one, by which to tell the row of each message, as \
                         the time is \"{}{time}\"",
                        topic.name, topics[leading].name
                    );
                    return Err(Error::one(&self.path, Problem::new(None, name, message)));
                };
                fields.push(at);
            }
            fields.push(field);
            columns.push(column);
        }
        let names = topics.iter().map(|topic| topic.name.clone()).collect();
        let time = format!("{}{time}", topics[leading].name);
        self.messages.select(fields)?;
        Ok(Box::new(LogRows {
            join: Join::new(names, leading, time, columns, places.len()),
            messages: self.messages,
            path: self.path,
            values: Vec::new(),
            ended: false,
        }))
    }

    fn numbered_chunks(self: Box<Self>, _wanted: &[usize]) -> Result<Chunks, Error> {
        let message = "found a log of messages, which are not evenly spaced; expected the name of a time column: state time";
        Err(Error::one(self.path, Problem::of_file(message)))
    }
}

/// The rows of a log.
struct LogRows<M> {
    messages: M,
    path: PathBuf,
    join: Join,
    values: Vec<f64>,
    ended: bool,
}

impl<M: Messages> Iterator for LogRows<M> {
    type Item = Result<Columns, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let path = self.path.clone();
        let chunk = guarded(&path, || self.chunk());
        self.ended |= chunk.is_err();
        Some(chunk)
    }
}

impl<M: Messages> LogRows<M> {
    fn chunk(&mut self) -> Result<Columns, Error> {
        let mut read = 0;
        while self.join.settled() < CHUNK_ROWS && read < CHUNK_MESSAGES {
            read += 1;
            let Some(topic) = self.messages.next(&mut self.values)? else {
                self.ended = true;
                self.join.end();
                break;
            };
            self.join.add(topic, &self.values).map_err(|problem| Error::one(&self.path, problem))?;
        }
        let mut chunk = self.join.take();
        if self.ended {
            let said = self.messages.warnings().into_iter().chain(self.join.warnings());
            chunk.warnings = said.map(|warning| format!("{}: {warning}", self.path.display())).collect();
        }
        Ok(chunk)
    }
}
