//! Tables of numbers: named columns, one row a step; empty, null or `nan` = missing.
//!
//! | format | known by | columns are called |
//! | --- | --- | --- |
//! | CSV, gzipped CSV | being none of the others | as in its header row |
//! | Parquet | `PAR1` | as in its schema; time stamps are in seconds |
//! | MCAP | its magic bytes | `TOPIC.FIELD`: `/imu.angular_velocity.x`, `/imu.header.stamp`, `/imu@log_time` |
//! | PX4 ULog | its magic bytes | `TOPIC_INSTANCE.FIELD`: `sensor_gyro_0.x`, `sensor_gyro_0.timestamp` |
//!
//! A format is known by its first bytes, whatever the name. Readers go through a file a chunk of rows at a time
//! ([`TableReader::chunks`]), so that a file may be larger than memory; [`TableReader::read`] keeps the columns asked
//! for, 8 bytes a value, and nothing else. MCAP and ULog hold messages of several topics at rates of their own; which
//! of them are rows is described in [`log`].
//!
//! Nothing is read without a bound: a line of text of at most 64 MiB, a record of a log of at most 128 MiB, and of a log no more
//! records than its size lets expect; what is longer is an error. A chunk ends after 16 MiB of text or 65 536 messages even if it
//! has no rows, so that whoever reads can stop.
//!
//! Integers of 64 bits are rounded to the nearest double, time stamps to the double nearest to the seconds they mean:
//! a time stamp of 1 700 000 000 123 456 789 ns is the number that `1700000000.123456789` is in a CSV file. A further
//! format is one more [`TableReader`] and one more arm of [`open`].
mod copy;
mod csv;
mod join;
mod lines;
pub mod log;
mod mcap;
mod number;
mod parquet;
mod seconds;
mod ulog;
mod write;

use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;

use bytes::Bytes;
use flate2::bufread::MultiGzDecoder;

use crate::document::suggestion;
use crate::error::{Error, Problem};
use crate::file;
use crate::leniency::Leniency;

pub use copy::{Copied, copy};
pub use write::{Format, TableWriter, write, write_to};

/// Size of the buffers between file, decompressor and parser.
const BUFFER_BYTES: usize = 1 << 18;
/// Rows of a chunk.
pub(crate) const CHUNK_ROWS: usize = 1 << 12;
/// First bytes of a gzip file.
const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
/// First bytes of a Parquet file.
const PARQUET_MAGIC: &[u8] = b"PAR1";

/// Columns that were read from a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Values in the order in which the columns were asked for; NaN = missing.
    pub values: Vec<Vec<f64>>,
    /// Number of infinite cells of each column, which are missing as well.
    pub infinite: Vec<usize>,
    /// Line of each row in the file, from 1; in formats without lines the row, from 1.
    pub lines: Vec<u64>,
    /// What the reader of the table should be told, e.g. that its last row is cut off.
    pub warnings: Vec<String>,
}

impl Columns {
    /// No rows of so many columns.
    pub(crate) fn none(columns: usize) -> Self {
        Self { values: vec![Vec::new(); columns], infinite: vec![0; columns], ..Self::default() }
    }

    /// Appends a value to a column; an infinite one is missing.
    fn push(&mut self, column: usize, value: f64) {
        if let (Some(values), Some(infinite)) = (self.values.get_mut(column), self.infinite.get_mut(column)) {
            *infinite += usize::from(value.is_infinite());
            values.push(if value.is_finite() { value } else { f64::NAN });
        }
    }

    /// Appends rows of the same columns.
    pub(crate) fn append(&mut self, mut rows: Self) {
        for (values, more) in self.values.iter_mut().zip(&mut rows.values) {
            values.append(more);
        }
        for (infinite, more) in self.infinite.iter_mut().zip(rows.infinite) {
            *infinite += more;
        }
        self.lines.append(&mut rows.lines);
        self.warnings.append(&mut rows.warnings);
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.lines.len()
    }
}

/// Rows of a table in chunks, in order; nothing follows an error.
pub type Chunks = Box<dyn Iterator<Item = Result<Columns, Error>>>;

/// A table that can be read once.
pub trait TableReader {
    /// Names of all columns.
    fn names(&self) -> &[String];

    /// What the file says of itself: names and values.
    fn metadata(&self) -> &[(String, String)] {
        &[]
    }

    /// Index of the column `name`, or what is wrong with asking for it.
    ///
    /// # Errors
    /// As [`column_index`].
    fn index(&self, name: &str) -> Result<usize, String> {
        column_index(self.names(), name)
    }

    /// The columns that stand in the same rows, if that is all of them.
    ///
    /// # Errors
    /// What rows there are to choose from, where messages of several topics are.
    fn all(&self) -> Result<Vec<usize>, String> {
        Ok((0..self.names().len()).collect())
    }

    /// The rows of the columns with the given indices (into [`names`](Self::names)), in this order; repetitions are
    /// fine. Of MCAP and ULog files the first of them decides what the rows are ([`log`]).
    ///
    /// # Errors
    /// Columns that cannot be read. In the chunks: a cell that is neither a number nor missing, a row of another
    /// length, a file that cannot be read.
    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error>;

    /// All rows of the columns with the given indices, as of [`chunks`](Self::chunks).
    ///
    /// # Errors
    /// As [`chunks`](Self::chunks).
    fn read(self: Box<Self>, wanted: &[usize]) -> Result<Columns, Error> {
        let mut columns = Columns::none(wanted.len());
        for chunk in self.chunks(wanted)? {
            columns.append(chunk?);
        }
        Ok(columns)
    }
}

/// Bytes that can be read from any place.
trait Bytestream: Read + Seek {}

impl<T: Read + Seek> Bytestream for T {}

/// Opens the table at `path`.
///
/// # Errors
/// A file that cannot be read, or whose columns have no names.
pub fn open(path: &Path) -> Result<Box<dyn TableReader>, Error> {
    open_with(path, Leniency::Strict)
}

/// Opens the table at `path`, of whose rows those that depart from the format are errors or left out.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, leniency: Leniency) -> Result<Box<dyn TableReader>, Error> {
    let unreadable = |error: io::Error| Error::io(path, "read the table", &error);
    let file = file::open(path, "read the table")?;
    let mut raw = BufReader::with_capacity(BUFFER_BYTES, file);
    let beginning = raw.fill_buf().map_err(unreadable)?;
    if beginning.starts_with(PARQUET_MAGIC) {
        return Ok(Box::new(parquet::ParquetTable::new(path, raw.into_inner())?));
    }
    if is_log(beginning) {
        return open_log(path, raw);
    }
    open_text(path, raw, leniency)
}

/// Opens a table in memory; `path` is the name by which errors call it.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(path: &Path, bytes: Vec<u8>) -> Result<Box<dyn TableReader>, Error> {
    if bytes.starts_with(PARQUET_MAGIC) {
        return Ok(Box::new(parquet::ParquetTable::new(path, Bytes::from(bytes))?));
    }
    if is_log(&bytes) {
        return open_log(path, Cursor::new(bytes));
    }
    open_text(path, Cursor::new(bytes), Leniency::Strict)
}

fn is_log(beginning: &[u8]) -> bool {
    beginning.starts_with(ulog::MAGIC) || beginning.starts_with(::mcap::MAGIC)
}

fn open_log(path: &Path, mut raw: impl BufRead + Seek + 'static) -> Result<Box<dyn TableReader>, Error> {
    let beginning = raw.fill_buf().map_err(|error| Error::io(path, "read the table", &error))?;
    Ok(if beginning.starts_with(ulog::MAGIC) {
        Box::new(log::LogTable::new(ulog::Ulog::new(path, Box::new(raw))?)?)
    } else {
        Box::new(log::LogTable::new(mcap::Mcap::new(path, Box::new(raw))?)?)
    })
}

fn open_text(
    path: &Path,
    mut raw: impl BufRead + 'static,
    leniency: Leniency,
) -> Result<Box<dyn TableReader>, Error> {
    let beginning = raw.fill_buf().map_err(|error| Error::io(path, "read the table", &error))?;
    let bytes: Box<dyn BufRead> = if beginning.starts_with(GZIP_MAGIC) {
        Box::new(BufReader::with_capacity(BUFFER_BYTES, MultiGzDecoder::new(raw)))
    } else {
        Box::new(raw)
    };
    Ok(Box::new(csv::CsvTable::new(path, bytes, leniency)?))
}

/// Index of the column `name`, or what is wrong with asking for it.
///
/// # Errors
/// The message for a column that is not there (with the nearest one that is) or is there twice.
pub fn column_index(names: &[String], name: &str) -> Result<usize, String> {
    let mut found =
        names.iter().enumerate().filter(|(_, column)| column.as_str() == name).map(|(index, _)| index);
    match (found.next(), found.next()) {
        (Some(index), None) => Ok(index),
        (Some(_), Some(_)) => {
            Err(format!("found \"{name}\", which the table has twice; expected a unique column"))
        }
        (None, _) => {
            let hint = suggestion(name, names.iter().map(String::as_str));
            let hint = hint.map(|meant| format!("; did you mean \"{meant}\"?")).unwrap_or_default();
            Err(format!("found \"{name}\"; expected a column of the table{hint}"))
        }
    }
}

/// The decoders' own checks end in a panic for some damaged files; here that is an error like any other.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let message = "cannot read the table: its contents contradict each other; the file is damaged";
        Err(Error::one(path, Problem::of_file(message)))
    })
}
