//! Tables as text: one header row with the names of the columns, cells separated as
//! [`super::dialect`] finds.
//!
//! A line is a row. Rows that differ from the header in their number of cells, quotes that do not close and cells that are no
//! numbers are errors by line, or, leniently, left out and counted.
use std::io::{self, BufRead, BufReader, Cursor, Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::dialect::{Dialect, SAMPLE_BYTES, unmarked};
use super::lines::{LONGEST_LINE, LineError, Lines};
use super::{BUFFER_BYTES, CHUNK_ROWS, Chunks, Columns, TableReader, known};
use crate::error::{Error, Problem};
use crate::leniency::Leniency;

/// How much of a bad cell is shown.
const SHOWN_CHARACTERS: usize = 40;
/// Bytes after which a chunk is handed on though it has not all its rows: it takes no more memory however wide the table is,
/// and whoever reads can stop however little is found.
const CHUNK_BYTES: u64 = 1 << 24;

/// A text table of which the header has been read.
pub(super) struct CsvTable {
    path: PathBuf,
    names: Vec<String>,
    lines: Lines,
    dialect: Dialect,
    leniency: Leniency,
}

impl CsvTable {
    /// Reads the header.
    ///
    /// # Errors
    /// A file that cannot be read, that is of a format known and not read, or whose header is not
    /// one row of names.
    pub(super) fn new(path: &Path, mut bytes: Box<dyn BufRead>, leniency: Leniency) -> Result<Self, Error> {
        let unreadable = |error: io::Error| Error::io(path, "read the table", &error);
        let mut sample = Vec::new();
        // A table that cannot be read further is a table all the same, up to there.
        let failed = bytes.by_ref().take(SAMPLE_BYTES as u64).read_to_end(&mut sample).err();
        if let Some(error) = failed.as_ref().filter(|_| sample.is_empty()) {
            return Err(Error::io(path, "read the table", error));
        }
        if let Some(message) = known::named(&sample) {
            return Err(Error::one(path, Problem::of_file(message)));
        }
        let dialect = Dialect::of(&sample);
        let bytes = Cursor::new(sample).chain(BufReader::new(Failed(failed))).chain(bytes);
        let lines = Lines::new(Box::new(bytes)).map_err(unreadable)?;
        let mut table = Self { path: path.to_owned(), names: Vec::new(), lines, dialect, leniency };
        for _ in 0..dialect.preamble {
            table.advance()?;
        }
        table.names = table.header()?;
        if dialect.units {
            table.advance()?;
        }
        Ok(table)
    }

    /// The names in the next line.
    fn header(&mut self) -> Result<Vec<String>, Error> {
        if !self.advance()? {
            return Err(self.bad_header("found an empty table"));
        }
        let line = self.lines.line();
        let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
        let line = if self.dialect.marked { unmarked(line) } else { line };
        let mut cells = Vec::new();
        self.dialect
            .split(line, &mut cells)
            .map_err(|_| self.bad_header("found a quote that does not close"))?;
        let mut names = cells
            .into_iter()
            .map(|cell| std::str::from_utf8(line[cell].trim_ascii()).map(|name| name.replace("\"\"", "\"")))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|_| self.bad_header("found bytes that are not UTF-8"))?;
        while names.last().is_some_and(String::is_empty) {
            names.pop();
        }
        if names.is_empty() {
            return Err(self.bad_header("found an empty table"));
        }
        if names.iter().all(|name| name.parse::<f64>().is_ok()) {
            return Err(self.bad_header("found numbers only"));
        }
        if names.iter().any(|name| name.contains('\0')) {
            return Err(self.bad_header("found binary data of no format that is known"));
        }
        Ok(names)
    }

    /// Goes to the next line.
    fn advance(&mut self) -> Result<bool, Error> {
        self.lines.advance().map_err(|error| match error {
            LineError::Io(error) => {
                let message = format!("cannot read the table: {error}");
                Error::one(&self.path, Problem::new(Some(self.lines.number() as usize), "", message))
            }
            LineError::TooLong => {
                let found = format!("found a line of more than {} MB", LONGEST_LINE / 1_000_000);
                self.bad_line(format!("{found}; expected a row of a table"))
            }
        })
    }

    fn bad_header(&self, found: &str) -> Error {
        self.bad_line(format!("{found}; expected a header row with the names of the columns"))
    }

    fn bad_line(&self, problem: String) -> Error {
        Error::one(&self.path, Problem::new(Some(self.lines.number() as usize), "", problem))
    }

    fn bad_cell(&self, column: usize, cell: &[u8]) -> Error {
        let name = self.names.get(column).map_or("", String::as_str);
        let cell = String::from_utf8_lossy(cell);
        let shown: String = cell.chars().take(SHOWN_CHARACTERS).collect();
        let problem = format!("found {shown:?}; expected a number, nan or nothing");
        Error::one(&self.path, Problem::new(Some(self.lines.number() as usize), name, problem))
    }
}

impl TableReader for CsvTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        Ok(Box::new(CsvRows::new(*self, wanted, None)))
    }

    fn numbered_chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        Ok(Box::new(CsvRows::new(*self, wanted, Some(Numbers::default()))))
    }
}

/// What was left out.
#[derive(Default)]
struct Counted {
    count: u64,
    /// What is wrong with the first.
    first: Option<Error>,
}

impl Counted {
    fn add(&mut self, error: impl FnOnce() -> Error) {
        self.count += 1;
        self.first.get_or_insert_with(error);
    }
}

/// Numbers of the rows of a chunk, where they are the first column.
#[derive(Default)]
struct Numbers {
    /// That of the next row; those left out have one, too.
    next: u64,
    of_chunk: Vec<f64>,
}

/// The rows of a text table.
struct CsvRows {
    table: CsvTable,
    wanted: Vec<usize>,
    numbered: Option<Numbers>,
    cells: Vec<Range<usize>>,
    /// A short row, with the number of its cells. It is an error unless it is the last: a recorder that lost its power leaves one.
    short_row: Option<(Error, usize)>,
    /// Rows left out, leniently.
    rows: Counted,
    /// Cells that are no numbers, leniently.
    numbers: Counted,
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
    fn new(table: CsvTable, wanted: &[usize], numbered: Option<Numbers>) -> Self {
        Self {
            table,
            wanted: wanted.to_vec(),
            numbered,
            cells: Vec::new(),
            short_row: None,
            rows: Counted::default(),
            numbers: Counted::default(),
            ended: false,
        }
    }

    fn chunk(&mut self) -> Result<Columns, Error> {
        let mut columns = Columns::none(self.wanted.len());
        let begun = self.table.lines.taken();
        while columns.rows() < CHUNK_ROWS && self.table.lines.taken() - begun < CHUNK_BYTES {
            if !self.table.advance()? {
                self.ended = true;
                break;
            }
            if self.table.names.len() > 1 && self.table.lines.line().trim_ascii().is_empty() {
                continue;
            }
            if let Some((error, _)) = self.short_row.take() {
                self.leave_out(error)?;
            }
            if let Some(numbers) = &mut self.numbered {
                numbers.next += 1;
            }
            match self.split() {
                Ok(()) => self.row(&mut columns)?,
                Err(Departure::Short(error, cells)) => self.short_row = Some((error, cells)),
                Err(Departure::Other(error)) => self.leave_out(error)?,
            }
        }
        if self.ended {
            columns.warnings = self.warnings();
        }
        Ok(match &mut self.numbered {
            Some(numbers) => columns.with_first(std::mem::take(&mut numbers.of_chunk)),
            None => columns,
        })
    }

    /// Finds the cells of the line, as many as the header has.
    fn split(&mut self) -> Result<(), Departure> {
        let table = &self.table;
        let line = table.lines.line();
        table.dialect.split(line, &mut self.cells).map_err(|_| {
            let problem = "found a quote that does not close; expected none, or two around a cell";
            Departure::Other(table.bad_line(problem.to_owned()))
        })?;
        let (found, expected) = (self.cells.len(), table.names.len());
        let bad_length =
            || table.bad_line(format!("found a row of {found} cells; expected {expected}, as in the header"));
        if found < expected {
            return Err(Departure::Short(bad_length(), found));
        }
        let empty = |cell: &Range<usize>| line[cell.clone()].trim_ascii().is_empty();
        if self.cells.iter().skip(expected).all(empty) { Ok(()) } else { Err(Departure::Other(bad_length())) }
    }

    /// Takes the numbers of the row.
    fn row(&mut self, columns: &mut Columns) -> Result<(), Error> {
        let table = &self.table;
        let line = table.lines.line();
        let lenient = table.leniency.is_lenient();
        for (place, &column) in self.wanted.iter().enumerate() {
            let cell = self.cells.get(column).map_or(&[][..], |cell| &line[cell.clone()]);
            let value = match table.dialect.number(cell) {
                Some(value) => value,
                None if !lenient => return Err(table.bad_cell(column, cell)),
                // The first column is the time, without which a row has no place, unless the rows are counted.
                None if place == 0 && self.numbered.is_none() => {
                    self.rows.add(|| table.bad_cell(column, cell));
                    return Ok(());
                }
                None => {
                    self.numbers.add(|| table.bad_cell(column, cell));
                    f64::NAN
                }
            };
            columns.push(place, value);
        }
        columns.lines.push(table.lines.number());
        if let Some(numbers) = &mut self.numbered {
            numbers.of_chunk.push(numbers.next.saturating_sub(1) as f64);
        }
        Ok(())
    }

    fn leave_out(&mut self, error: Error) -> Result<(), Error> {
        if !self.table.leniency.is_lenient() {
            return Err(error);
        }
        self.rows.add(|| error);
        Ok(())
    }

    /// What the user should be told when the last row has been read.
    fn warnings(&mut self) -> Vec<String> {
        let path = self.table.path.display();
        let mut warnings = Vec::new();
        for (counted, what) in [(&self.rows, "rows are left out"), (&self.numbers, "cells are missing")] {
            if let Some(first) = &counted.first {
                warnings.push(format!("{path}: {} {what}; the first: {first}", counted.count));
            }
        }
        if let Some((error, cells)) = &self.short_row {
            let line = error.problems.first().and_then(|problem| problem.line).unwrap_or_default();
            let expected = self.table.names.len();
            warnings
                .push(format!("{path}:{line}: the last row has {cells} of {expected} cells and is left out"));
        }
        warnings
    }
}

/// Why a line is no row of the table.
enum Departure {
    /// It has too few cells, so many.
    Short(Error, usize),
    Other(Error),
}

/// An error, once, and then nothing.
struct Failed(Option<io::Error>);

impl Read for Failed {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        self.0.take().map_or(Ok(0), Err)
    }
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
