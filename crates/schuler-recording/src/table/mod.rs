//! Tables of numbers: named columns, one row a step; empty, null or `nan` = missing.
//!
//! CSV, gzipped CSV and Parquet, each known by its first bytes, whatever the name. A further format is one more
//! [`TableReader`] and one more arm of [`open`].
mod csv;
mod parquet;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor};
use std::path::Path;

use bytes::Bytes;
use flate2::bufread::MultiGzDecoder;
use flate2::write::GzEncoder;

use crate::document::suggestion;
use crate::error::{Error, Problem};

/// Size of the buffers between file, decompressor and parser.
const BUFFER_BYTES: usize = 1 << 18;
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

/// A table that can be read once.
pub trait TableReader {
    /// Names of all columns.
    fn names(&self) -> &[String];

    /// Reads the columns with the given indices (into [`names`](Self::names)), in this order; repetitions are fine.
    ///
    /// # Errors
    /// A cell that is neither a number nor missing, a row of another length, a file that cannot be read.
    fn read(self: Box<Self>, wanted: &[usize]) -> Result<Columns, Error>;
}

/// Opens the table at `path`.
///
/// # Errors
/// A file that cannot be read, or whose columns have no names.
pub fn open(path: &Path) -> Result<Box<dyn TableReader>, Error> {
    let unreadable = |error: io::Error| Error::io(path, "read the table", &error);
    let file = File::open(path).map_err(unreadable)?;
    let mut raw = BufReader::with_capacity(BUFFER_BYTES, file);
    if raw.fill_buf().map_err(unreadable)?.starts_with(PARQUET_MAGIC) {
        let file = File::open(path).map_err(unreadable)?;
        return Ok(Box::new(parquet::ParquetTable::new(path, file)?));
    }
    open_text(path, raw)
}

/// Opens a table in memory; `path` is the name by which errors call it.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(path: &Path, bytes: Vec<u8>) -> Result<Box<dyn TableReader>, Error> {
    if bytes.starts_with(PARQUET_MAGIC) {
        return Ok(Box::new(parquet::ParquetTable::new(path, Bytes::from(bytes))?));
    }
    open_text(path, Cursor::new(bytes))
}

fn open_text(path: &Path, mut raw: impl BufRead + 'static) -> Result<Box<dyn TableReader>, Error> {
    let beginning = raw.fill_buf().map_err(|error| Error::io(path, "read the table", &error))?;
    let bytes: Box<dyn BufRead> = if beginning.starts_with(GZIP_MAGIC) {
        Box::new(BufReader::with_capacity(BUFFER_BYTES, MultiGzDecoder::new(raw)))
    } else {
        Box::new(raw)
    };
    Ok(Box::new(csv::CsvTable::new(path, bytes)?))
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

/// Writes `columns` under their names to `path`, gzipped if its name ends in `.gz`.
///
/// Every finite value is written with the fewest digits that read back to the same bits; NaN is an empty cell.
///
/// # Errors
/// Columns of different lengths, a file that cannot be written.
pub fn write(path: &Path, columns: &[(&str, &[f64])]) -> Result<(), Error> {
    let rows = columns.first().map_or(0, |(_, values)| values.len());
    if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != rows) {
        let message = format!("cannot write a column of {} rows beside one of {rows}", values.len());
        return Err(Error::one(path, Problem::new(None, *name, message)));
    }
    let unwritable = |error: &io::Error| Error::io(path, "write the table", error);
    let file = File::create(path).map_err(|error| unwritable(&error))?;
    let written = if path.extension().is_some_and(|extension| extension == "gz") {
        let mut encoder = GzEncoder::new(file, flate2::Compression::default());
        csv::write(&mut encoder, columns, rows).and_then(|()| encoder.finish()).map(drop)
    } else {
        csv::write(file, columns, rows)
    };
    written.map_err(|error| unwritable(&error))
}
