//! Tables of numbers: one header row with the names of the columns, one row a step; empty or `nan` = missing.
//!
//! CSV and gzipped CSV (known by its first bytes, whatever the name). A further format is one more
//! [`TableReader`] and one more arm of [`open`].
use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use csv::{ByteRecord, ReaderBuilder};
use flate2::bufread::MultiGzDecoder;
use flate2::write::GzEncoder;

use crate::document::suggestion;
use crate::error::{Error, Problem};

/// Size of the buffers between file, decompressor and parser.
const BUFFER_BYTES: usize = 1 << 18;
/// First bytes of a gzip file.
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// How much of a bad cell is shown.
const SHOWN_CHARACTERS: usize = 40;

/// Columns that were read from a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Values in the order in which the columns were asked for; NaN = missing.
    pub values: Vec<Vec<f64>>,
    /// Number of infinite cells of each column, which are missing as well.
    pub infinite: Vec<usize>,
    /// Line of each row in the file, from 1.
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
/// A file that cannot be read, or whose header is not one row of names.
pub fn open(path: &Path) -> Result<Box<dyn TableReader>, Error> {
    let unreadable = |error: io::Error| Error::io(path, "read the table", &error);
    let file = File::open(path).map_err(unreadable)?;
    let mut raw = BufReader::with_capacity(BUFFER_BYTES, file);
    let gzipped = raw.fill_buf().map_err(unreadable)?.starts_with(&GZIP_MAGIC);
    let bytes: Box<dyn BufRead> = if gzipped {
        Box::new(BufReader::with_capacity(BUFFER_BYTES, MultiGzDecoder::new(raw)))
    } else {
        Box::new(raw)
    };
    CsvTable::new(path, bytes).map(|table| Box::new(table) as Box<dyn TableReader>)
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

/// A CSV table of which the header has been read.
struct CsvTable {
    path: PathBuf,
    names: Vec<String>,
    reader: csv::Reader<Box<dyn BufRead>>,
    /// Whether lines end in CR LF, of which the parser takes the LF for the beginning of the next line.
    crlf: bool,
}

impl CsvTable {
    fn new(path: &Path, mut bytes: Box<dyn BufRead>) -> Result<Self, Error> {
        let beginning = bytes.fill_buf().map_err(|error| Error::io(path, "read the table", &error))?;
        let first_line_end = beginning.iter().position(|&byte| byte == b'\n').unwrap_or_default();
        let crlf = first_line_end.checked_sub(1).and_then(|at| beginning.get(at)) == Some(&b'\r');
        let mut reader = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .buffer_capacity(BUFFER_BYTES)
            .from_reader(bytes);
        let mut header = ByteRecord::new();
        let found = reader.read_byte_record(&mut header).map_err(|error| csv_error(path, &error))?;
        let mut names = header
            .iter()
            .map(|name| {
                let name = name.strip_prefix(b"\xef\xbb\xbf").unwrap_or(name).trim_ascii();
                std::str::from_utf8(name).map(|name| name.trim_matches('"').to_owned())
            })
            .collect::<Result<Vec<_>, _>>()
            .map_err(|_| header_error(path, "found bytes that are not UTF-8"))?;
        while names.last().is_some_and(String::is_empty) {
            names.pop();
        }
        if !found || names.is_empty() {
            return Err(header_error(path, "found an empty table"));
        }
        if names.iter().all(|name| name.parse::<f64>().is_ok()) {
            return Err(header_error(path, "found numbers only"));
        }
        Ok(Self { path: path.to_owned(), names, reader, crlf })
    }

    fn bad_cell(&self, line: u64, column: usize, cell: &[u8]) -> Error {
        let name = self.names.get(column).map_or("", String::as_str);
        let cell = String::from_utf8_lossy(cell);
        let shown: String = cell.chars().take(SHOWN_CHARACTERS).collect();
        let problem = format!("found {shown:?}; expected a number, nan or nothing");
        Error::one(&self.path, Problem::new(Some(line as usize), name, problem))
    }

    fn bad_length(&self, line: u64, cells: usize) -> Error {
        let problem =
            format!("found a row of {cells} cells; expected {}, as in the header", self.names.len());
        Error::one(&self.path, Problem::new(Some(line as usize), "", problem))
    }
}

impl TableReader for CsvTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn read(mut self: Box<Self>, wanted: &[usize]) -> Result<Columns, Error> {
        let mut columns = Columns {
            values: vec![Vec::new(); wanted.len()],
            infinite: vec![0; wanted.len()],
            ..Columns::default()
        };
        let mut row = ByteRecord::new();
        // A short row is an error unless it is the last: a recorder that lost its power leaves one.
        let mut short_row: Option<(u64, usize)> = None;
        loop {
            if !self.reader.read_byte_record(&mut row).map_err(|error| csv_error(&self.path, &error))? {
                break;
            }
            let next_line = self.reader.position().line();
            let last_line = if self.crlf { next_line } else { next_line.saturating_sub(1) };
            let line = row.position().map_or(0, csv::Position::line).max(last_line);
            if row.len() == 1
                && row.get(0).is_some_and(|cell| cell.trim_ascii().is_empty())
                && self.names.len() > 1
            {
                continue;
            }
            if let Some((line, cells)) = short_row {
                return Err(self.bad_length(line, cells));
            }
            if row.len() < self.names.len() {
                short_row = Some((line, row.len()));
                continue;
            }
            if row.iter().skip(self.names.len()).any(|cell| !cell.trim_ascii().is_empty()) {
                return Err(self.bad_length(line, row.len()));
            }
            for ((&column, values), infinite) in
                wanted.iter().zip(&mut columns.values).zip(&mut columns.infinite)
            {
                let cell = row.get(column).unwrap_or_default();
                let value = number(cell).ok_or_else(|| self.bad_cell(line, column, cell))?;
                *infinite += usize::from(value.is_infinite());
                values.push(if value.is_finite() { value } else { f64::NAN });
            }
            columns.lines.push(line);
        }
        if let Some((line, cells)) = short_row {
            columns.warnings.push(format!(
                "{}:{line}: the last row has {cells} of {} cells and is left out",
                self.path.display(),
                self.names.len()
            ));
        }
        Ok(columns)
    }
}

/// The number in a cell, NaN where it is missing, `None` where there is something else.
fn number(cell: &[u8]) -> Option<f64> {
    let cell = cell.trim_ascii();
    if cell.is_empty() {
        return Some(f64::NAN);
    }
    std::str::from_utf8(cell).ok()?.parse().ok()
}

fn header_error(path: &Path, found: &str) -> Error {
    Error::one(
        path,
        Problem::new(Some(1), "", format!("{found}; expected a header row with the names of the columns")),
    )
}

fn csv_error(path: &Path, error: &csv::Error) -> Error {
    let line = error.position().map(|position| position.line() as usize);
    let message = match error.kind() {
        csv::ErrorKind::Io(error) => format!("cannot read the table: {error}"),
        _ => format!("cannot read the table: {error}"),
    };
    Error::one(path, Problem::new(line, "", message))
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
        write_csv(&mut encoder, columns, rows).and_then(|()| encoder.finish()).map(drop)
    } else {
        write_csv(file, columns, rows)
    };
    written.map_err(|error| unwritable(&error))
}

fn write_csv(sink: impl Write, columns: &[(&str, &[f64])], rows: usize) -> io::Result<()> {
    let mut writer = csv::WriterBuilder::new().buffer_capacity(BUFFER_BYTES).from_writer(sink);
    writer.write_record(columns.iter().map(|(name, _)| name))?;
    let mut cell = Vec::new();
    for row in 0..rows {
        for (_, values) in columns {
            cell.clear();
            if let Some(value) = values.get(row).filter(|value| !value.is_nan()) {
                // Debug prints the shortest digits that round-trip, with an exponent where that is shorter.
                write!(cell, "{value:?}")?;
            }
            writer.write_field(&cell)?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.flush()
}
