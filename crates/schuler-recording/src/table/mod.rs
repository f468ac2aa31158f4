//! Tables of numbers: named columns, one row a step; empty, null or `nan` = missing.
//!
//! | format | known by | columns are called |
//! | --- | --- | --- |
//! | text: CSV, with semicolons, tabs or blanks; gzipped, too | being none of the others | as in its header row |
//! | Parquet | `PAR1` | as in its schema; time stamps are in seconds |
//! | MCAP | its magic bytes | `TOPIC.FIELD`: `/imu.angular_velocity.x`, `/imu.header.stamp`, `/imu@log_time` |
//! | ROS 1 bag | its magic bytes | as in MCAP; when a message was recorded is `/imu@log_time` |
//! | ArduPilot DataFlash | a first message `FMT` | `MESSAGE.LABEL`, `MESSAGE_INSTANCE.LABEL`: `ATT.Roll`, `IMU_0.GyrX` |
//! | NumPy `.npy`, `.npz` | its magic bytes | the array's or field's name, of two axes `NAME[k]`; alone `array` |
//! | MATLAB 5 `.mat` | its magic bytes | the variable's name, of a structure `NAME.FIELD`, of two axes `NAME[k]` |
//! | MATLAB 7.3 `.mat` | its magic bytes | as of MATLAB 5; with the feature `hdf5` |
//! | HDF5, netCDF-4 | its magic bytes | the dataset's path, of two axes `PATH[k]`, of records `PATH.FIELD`; with the feature `hdf5` |
//! | ROS 2 bag in SQLite, `.db3` | its magic bytes | as in MCAP; with the feature `rosbag2` |
//! | MAVLink `.tlog` | a time stamp and a frame | `MESSAGE.FIELD`: `ATTITUDE.roll`, `ATTITUDE@log_time` |
//! | PX4 ULog | its magic bytes | `TOPIC_INSTANCE.FIELD`: `sensor_gyro_0.x`, `sensor_gyro_0.timestamp` |
//!
//! A format is known by its first bytes, whatever the name. Readers go through a file a chunk of rows at a time
//! ([`TableReader::chunks`]), so that a file may be larger than memory; [`TableReader::read`] keeps the columns asked
//! for, 8 bytes a value, and nothing else. MCAP and ULog hold messages of several topics at rates of their own; which
//! of them are rows is described in [`log`].
//!
//! Nothing is read without a bound: a line of text of at most 64 MiB, a record of a log of at most 128 MiB, and of a log no more
//! records than its size lets expect; of a file of arrays 1 GiB, packed and
//! unpacked; what is longer is an error. A chunk ends after 16 MiB of text or 65 536 messages even if it
//! has no rows, so that whoever reads can stop.
//!
//! Integers of 64 bits are rounded to the nearest double, time stamps to the double nearest to the seconds they mean:
//! a time stamp of 1 700 000 000 123 456 789 ns is the number that `1700000000.123456789` is in a CSV file. A further
//! format is one more [`TableReader`] and one more arm of [`open`].
mod arrays;
mod copy;
mod csv;
mod dataflash;
mod dates;
mod dialect;
#[cfg(feature = "hdf5")]
mod hdf5;
mod join;
mod kind;
mod known;
mod lines;
pub mod log;
mod matlab;
mod mavlink;
mod mcap;
mod number;
mod numpy;
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
use kind::Kind;

pub use copy::{Copied, Span, copy};
pub use write::{Format, TableWriter, write, write_to};

/// Size of the buffers between file, decompressor and parser.
const BUFFER_BYTES: usize = 1 << 18;
/// Rows of a chunk.
pub(crate) const CHUNK_ROWS: usize = 1 << 12;
/// Names that a message lists.
const LISTED: usize = 12;
/// First bytes of a gzip file.
const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];

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

    /// The same rows with a further first column.
    fn with_first(mut self, values: Vec<f64>) -> Self {
        self.values.insert(0, values);
        self.infinite.insert(0, 0);
        self
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
    /// fine. Of logs the first of them decides what the rows are ([`log`]).
    ///
    /// # Errors
    /// Columns that cannot be read. In the chunks: a cell that is neither a number nor missing, a row of another
    /// length, a file that cannot be read.
    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error>;

    /// The rows of [`chunks`](Self::chunks) with the number of each, from 0, as a further first column. A row that is left out has its
    /// number all the same: where there is no column of time, that says when the rows behind it are.
    ///
    /// # Errors
    /// As [`chunks`](Self::chunks); of logs, whose messages have times and are no even rows.
    fn numbered_chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let mut next = 0;
        Ok(Box::new(self.chunks(wanted)?.map(move |chunk| {
            let chunk = chunk?;
            let first = next;
            next += chunk.rows();
            Ok(chunk.with_first((first..next).map(|row| row as f64).collect()))
        })))
    }

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
    let kind = Kind::of(raw.fill_buf().map_err(unreadable)?);
    match kind {
        Kind::Parquet => Ok(Box::new(parquet::ParquetTable::new(path, raw.into_inner())?)),
        Kind::Array | Kind::Archive | Kind::Matlab => {
            let mut bytes = Vec::new();
            raw.take(arrays::LARGEST_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
            open_arrays(path, kind, &bytes)
        }
        #[cfg(feature = "hdf5")]
        Kind::Hdf5 => {
            let mut bytes = Vec::new();
            raw.take(arrays::LARGEST_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
            open_hdf5(path, bytes)
        }
        #[cfg(feature = "rosbag2")]
        Kind::Sqlite => Ok(Box::new(log::LogTable::new(mcap::Mcap::of_sqlite(
            path,
            mcap::rosbag2::Rosbag2::open(path)?,
        )?)?)),
        Kind::Text => open_text(path, raw, leniency),
        _ => open_log(path, kind, Box::new(raw)),
    }
}

/// Opens a table in memory; `path` is the name by which errors call it.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(path: &Path, bytes: Vec<u8>) -> Result<Box<dyn TableReader>, Error> {
    match Kind::of(&bytes) {
        Kind::Parquet => Ok(Box::new(parquet::ParquetTable::new(path, Bytes::from(bytes))?)),
        kind @ (Kind::Array | Kind::Archive | Kind::Matlab) => open_arrays(path, kind, &bytes),
        #[cfg(feature = "hdf5")]
        Kind::Hdf5 => open_hdf5(path, bytes),
        #[cfg(feature = "rosbag2")]
        Kind::Sqlite => Ok(Box::new(log::LogTable::new(mcap::Mcap::of_sqlite(
            path,
            mcap::rosbag2::Rosbag2::of_bytes(path, &bytes)?,
        )?)?)),
        Kind::Text => open_text(path, Cursor::new(bytes), Leniency::Strict),
        kind => open_log(path, kind, Box::new(Cursor::new(bytes))),
    }
}

/// Opens a file of arrays, which has all its bytes in memory.
fn open_arrays(path: &Path, kind: Kind, bytes: &[u8]) -> Result<Box<dyn TableReader>, Error> {
    if bytes.len() as u64 > arrays::LARGEST_BYTES {
        return Err(Error::one(path, Problem::of_file(arrays::TOO_LARGE)));
    }
    Ok(Box::new(match kind {
        Kind::Array => numpy::array_table(path, bytes)?,
        Kind::Matlab => matlab::table(path, bytes)?,
        _ => numpy::archive_table(path, bytes)?,
    }))
}

/// Opens an HDF5 file, which has all its bytes in memory.
#[cfg(feature = "hdf5")]
fn open_hdf5(path: &Path, bytes: Vec<u8>) -> Result<Box<dyn TableReader>, Error> {
    if bytes.len() as u64 > arrays::LARGEST_BYTES {
        return Err(Error::one(path, Problem::of_file(arrays::TOO_LARGE)));
    }
    Ok(Box::new(hdf5::table(path, bytes)?))
}

/// Opens a file of messages.
fn open_log(path: &Path, kind: Kind, bytes: Box<dyn Bytestream>) -> Result<Box<dyn TableReader>, Error> {
    Ok(match kind {
        Kind::Ulog => Box::new(log::LogTable::new(ulog::Ulog::new(path, bytes)?)?),
        Kind::DataFlash => Box::new(log::LogTable::new(dataflash::DataFlash::new(path, bytes)?)?),
        Kind::Tlog => Box::new(log::LogTable::new(mavlink::Tlog::new(path, bytes)?)?),
        Kind::Bag => Box::new(log::LogTable::new(mcap::Mcap::of_bag(path, bytes)?)?),
        _ => Box::new(log::LogTable::new(mcap::Mcap::new(path, bytes)?)?),
    })
}

fn open_text(
    path: &Path,
    mut raw: impl BufRead + 'static,
    leniency: Leniency,
) -> Result<Box<dyn TableReader>, Error> {
    let beginning = raw.fill_buf().map_err(|error| Error::io(path, "read the table", &error))?;
    let bytes: Box<dyn BufRead> = if beginning.starts_with(GZIP_MAGIC) {
        if let Some(message) = known::named_by_ending(path) {
            return Err(Error::one(path, Problem::of_file(message)));
        }
        let mut bytes = BufReader::with_capacity(BUFFER_BYTES, MultiGzDecoder::new(raw));
        // What does not begin at all is told by the reader of text.
        if bytes.fill_buf().is_ok_and(|beginning| Kind::of(beginning) != Kind::Text) {
            let message = "found a compressed file, of which only text is read; unpack it first: gunzip";
            return Err(Error::one(path, Problem::of_file(message)));
        }
        Box::new(bytes)
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
            let hint = hint.map_or_else(
                || format!("; it has {}", listed(names)),
                |meant| format!("; did you mean \"{meant}\"?"),
            );
            Err(format!("found \"{name}\"; expected a column of the table{hint}"))
        }
    }
}

/// The first of some names, for a message.
fn listed<S: AsRef<str>>(names: &[S]) -> String {
    let first: Vec<&str> = names.iter().take(LISTED).map(AsRef::as_ref).collect();
    let more =
        if names.len() > LISTED { format!(" and {} more", names.len() - LISTED) } else { String::new() };
    format!("{}{more}", first.join(", "))
}

/// The decoders' own checks end in a panic for some damaged files; here that is an error like any other.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let message = "cannot read the table: its contents contradict each other; the file is damaged";
        Err(Error::one(path, Problem::of_file(message)))
    })
}
