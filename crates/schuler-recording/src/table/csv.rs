//! Tables as comma-separated values: one header row with the names of the columns.
use std::io::{self, BufRead, Write};
use std::path::{Path, PathBuf};

use csv::{ByteRecord, ReaderBuilder};

use super::{BUFFER_BYTES, Columns, TableReader};
use crate::error::{Error, Problem};

/// How much of a bad cell is shown.
const SHOWN_CHARACTERS: usize = 40;

/// A CSV table of which the header has been read.
pub(super) struct CsvTable {
    path: PathBuf,
    names: Vec<String>,
    reader: csv::Reader<Box<dyn BufRead>>,
    /// Whether lines end in CR LF, of which the parser takes the LF for the beginning of the next line.
    crlf: bool,
}

impl CsvTable {
    /// Reads the header.
    ///
    /// # Errors
    /// A file that cannot be read, or whose header is not one row of names.
    pub(super) fn new(path: &Path, mut bytes: Box<dyn BufRead>) -> Result<Self, Error> {
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

/// Writes columns of `rows` rows.
pub(super) fn write(sink: impl Write, columns: &[(&str, &[f64])], rows: usize) -> io::Result<()> {
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
