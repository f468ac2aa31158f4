//! Tables as comma-separated values: one header row with the names of the columns.
use std::io::{self, BufRead, Write};
use std::path::{Path, PathBuf};

use csv::{ByteRecord, ReaderBuilder};

use super::{BUFFER_BYTES, CHUNK_ROWS, Chunks, Columns, TableReader};
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

    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let wanted = wanted.to_vec();
        Ok(Box::new(CsvRows { table: *self, wanted, row: ByteRecord::new(), short_row: None, ended: false }))
    }
}

/// The rows of a CSV table.
struct CsvRows {
    table: CsvTable,
    wanted: Vec<usize>,
    row: ByteRecord,
    /// A short row, which is an error unless it is the last: a recorder that lost its power leaves one.
    short_row: Option<(u64, usize)>,
    ended: bool,
}

impl Iterator for CsvRows {
    type Item = Result<Columns, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let chunk = self.chunk();
        self.ended |= chunk.is_err();
        Some(chunk)
    }
}

impl CsvRows {
    fn chunk(&mut self) -> Result<Columns, Error> {
        let table = &mut self.table;
        let mut columns = Columns::none(self.wanted.len());
        while columns.rows() < CHUNK_ROWS {
            if !table
                .reader
                .read_byte_record(&mut self.row)
                .map_err(|error| csv_error(&table.path, &error))?
            {
                self.ended = true;
                break;
            }
            let row = &self.row;
            let next_line = table.reader.position().line();
            let last_line = if table.crlf { next_line } else { next_line.saturating_sub(1) };
            let line = row.position().map_or(0, csv::Position::line).max(last_line);
            if row.len() == 1
                && row.get(0).is_some_and(|cell| cell.trim_ascii().is_empty())
                && table.names.len() > 1
            {
                continue;
            }
            if let Some((line, cells)) = self.short_row {
                return Err(table.bad_length(line, cells));
            }
            if row.len() < table.names.len() {
                self.short_row = Some((line, row.len()));
                continue;
            }
            if row.iter().skip(table.names.len()).any(|cell| !cell.trim_ascii().is_empty()) {
                return Err(table.bad_length(line, row.len()));
            }
            for (place, &column) in self.wanted.iter().enumerate() {
                let cell = row.get(column).unwrap_or_default();
                columns.push(place, number(cell).ok_or_else(|| table.bad_cell(line, column, cell))?);
            }
            columns.lines.push(line);
        }
        if let Some((line, cells)) = self.short_row.filter(|_| self.ended) {
            columns.warnings.push(format!(
                "{}:{line}: the last row has {cells} of {} cells and is left out",
                table.path.display(),
                table.names.len()
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

/// Writes rows beneath a header.
pub(super) struct CsvWriter<W: Write> {
    writer: csv::Writer<W>,
    cell: Vec<u8>,
}

impl<W: Write> CsvWriter<W> {
    /// Writes the header.
    pub(super) fn new(sink: W, names: &[&str]) -> io::Result<Self> {
        let mut writer = csv::WriterBuilder::new().buffer_capacity(BUFFER_BYTES).from_writer(sink);
        writer.write_record(names)?;
        Ok(Self { writer, cell: Vec::new() })
    }

    /// Writes rows, given by columns of one length.
    pub(super) fn write(&mut self, columns: &[&[f64]]) -> io::Result<()> {
        for row in 0..columns.first().map_or(0, |values| values.len()) {
            for values in columns {
                self.cell.clear();
                if let Some(value) = values.get(row).filter(|value| !value.is_nan()) {
                    // Debug prints the shortest digits that round-trip, with an exponent where that is shorter.
                    write!(self.cell, "{value:?}")?;
                }
                self.writer.write_field(&self.cell)?;
            }
            self.writer.write_record(None::<&[u8]>)?;
        }
        Ok(())
    }

    /// Hands the sink back when everything is in it.
    pub(super) fn finish(self) -> io::Result<W> {
        self.writer.into_inner().map_err(|error| io::Error::new(error.error().kind(), error.to_string()))
    }
}
