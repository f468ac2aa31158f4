//! Files of arrays as tables: an array of one axis is a column under its name, one of two axes is a
//! column `NAME[k]` for each k of the second. The rows are those of the first axis; columns that are
//! asked for together must have as many.
use std::path::{Path, PathBuf};

use super::{CHUNK_ROWS, Chunks, Columns, TableReader};
use crate::error::{Error, Problem};

/// Columns of the widest array that has columns; wider ones are pictures and matrices.
const WIDEST: usize = 64;
/// Bytes of the largest file of arrays, of all its arrays when they are unpacked, and of the numbers
/// that they are in memory: more is kept in files that are read in parts.
pub(super) const LARGEST_BYTES: u64 = 1 << 30;
/// What is said of a larger one.
pub(super) const TOO_LARGE: &str =
    "found more than 1 GiB of arrays, which are read as a whole; expected less, or the table as Parquet";

/// A file of arrays, in memory.
pub(super) struct ArrayTable {
    path: PathBuf,
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

/// Where the numbers of an array stand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    /// Length of each axis.
    pub(super) axes: Vec<usize>,
    /// Whether the first axis is the fastest.
    pub(super) by_columns: bool,
}

impl Shape {
    /// Number of numbers; `None` of more than there can be.
    pub(super) fn count(&self) -> Option<usize> {
        self.axes.iter().try_fold(1_usize, |count, length| count.checked_mul(*length))
    }

    /// Rows and columns; `None` of an array that is no columns of a table.
    fn table(&self) -> Option<(usize, usize)> {
        match *self.axes.as_slice() {
            // A row of numbers is how some write a list.
            [rows] | [1, rows] | [rows, 1] if rows > 1 => Some((rows, 1)),
            [rows, wide] if rows > 1 && wide <= WIDEST => Some((rows, wide)),
            _ => None,
        }
    }
}

impl ArrayTable {
    /// A table without columns.
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), names: Vec::new(), columns: Vec::new() }
    }

    /// Adds the columns of an array, of which `at` gives the numbers in the order of the file.
    ///
    /// # Errors
    /// The message for a table that is too large.
    pub(super) fn add(&mut self, name: &str, shape: &Shape, at: impl Fn(usize) -> f64) -> Result<(), String> {
        let Some((rows, wide)) = shape.table() else { return Ok(()) };
        let held: usize = self.columns.iter().map(Vec::len).sum();
        let numbers = rows.checked_mul(wide).and_then(|more| held.checked_add(more)).unwrap_or(usize::MAX);
        if numbers as u64 > LARGEST_BYTES / size_of::<f64>() as u64 {
            return Err(TOO_LARGE.to_owned());
        }
        for column in 0..wide {
            let place = |row: usize| if shape.by_columns { column * rows + row } else { row * wide + column };
            self.names.push(if wide == 1 { name.to_owned() } else { format!("{name}[{column}]") });
            self.columns.push((0..rows).map(|row| at(place(row))).collect());
        }
        Ok(())
    }

    /// The table, when all its arrays have been added; `hint` is said besides where there are none.
    ///
    /// # Errors
    /// No columns.
    pub(super) fn with_columns(self, hint: &str) -> Result<Self, Error> {
        if self.names.is_empty() {
            let problem =
                format!("found no arrays of numbers with one or two axes; expected at least one{hint}");
            return Err(Error::one(self.path, Problem::of_file(problem)));
        }
        Ok(self)
    }

    fn rows(&self, column: usize) -> usize {
        self.columns.get(column).map_or(0, Vec::len)
    }
}

impl TableReader for ArrayTable {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn all(&self) -> Result<Vec<usize>, String> {
        let rows = self.rows(0);
        match (0..self.columns.len()).find(|&column| self.rows(column) != rows) {
            None => Ok((0..self.columns.len()).collect()),
            Some(other) => Err(format!(
                "found arrays of different lengths (\"{}\" of {rows}, \"{}\" of {}); expected a choice of columns, of which the \
                 first is the time",
                self.names[0],
                self.names[other],
                self.rows(other)
            )),
        }
    }

    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let Some(&first) = wanted.first() else { return Ok(Box::new(std::iter::empty())) };
        let rows = self.rows(first);
        if let Some(&other) = wanted.iter().find(|&&column| self.rows(column) != rows) {
            let name = |column: usize| self.names.get(column).map_or("", String::as_str);
            let message =
                format!("found {} rows; expected {rows}, as of \"{}\"", self.rows(other), name(first));
            return Err(Error::one(&self.path, Problem::new(None, name(other), message)));
        }
        let wanted = wanted.to_vec();
        Ok(Box::new((0..rows).step_by(CHUNK_ROWS).map(move |begin| {
            let end = rows.min(begin + CHUNK_ROWS);
            let mut chunk = Columns::none(wanted.len());
            for (place, &column) in wanted.iter().enumerate() {
                let values =
                    self.columns.get(column).and_then(|values| values.get(begin..end)).unwrap_or_default();
                for &value in values {
                    chunk.push(place, value);
                }
            }
            chunk.lines = (begin as u64 + 1..=end as u64).collect();
            Ok(chunk)
        })))
    }
}
