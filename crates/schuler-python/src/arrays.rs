//! Tables that Python has as dictionaries of arrays.
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use schuler_recording::table::{Chunks, Columns, TableReader};
use schuler_recording::{Error, Problem};

use crate::input::{vector, wrong};

/// Columns in memory.
pub(crate) struct Arrays {
    /// What the table is called in messages of its readers.
    called: &'static str,
    names: Vec<String>,
    values: Vec<Vec<f64>>,
}

impl Arrays {
    /// The columns of a dictionary, the argument `argument`.
    ///
    /// # Errors
    /// `ValueError` for what is no array of numbers of shape (n,), the same n for all; `TypeError` for no dictionary.
    pub(crate) fn new(argument: &str, called: &'static str, table: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (mut names, mut values) = (Vec::new(), Vec::<Vec<f64>>::new());
        for item in table.cast::<PyMapping>()?.items()? {
            let (name, column): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let name: String = name
                .extract()
                .map_err(|_| wrong(format!("{argument}: found the key {name}; expected names of columns")))?;
            let column = vector(&format!("{argument}[{name:?}]"), &column)?;
            if let (Some(first), Some(rows)) = (names.first(), values.first().map(Vec::len))
                && column.len() != rows
            {
                let found = format!("{argument}[{name:?}]: found {} rows", column.len());
                return Err(wrong(format!("{found}; expected {rows}, as {argument}[{first:?}] has")));
            }
            names.push(name);
            values.push(column);
        }
        Ok(Self { called, names, values })
    }
}

impl TableReader for Arrays {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let rows = self.values.first().map_or(0, Vec::len);
        if rows == 0 {
            let empty = Problem::of_file("found no rows; expected at least two");
            return Err(Error::one(self.called, empty));
        }
        let mut columns = Columns { lines: (1..=rows as u64).collect(), ..Columns::default() };
        for &index in wanted {
            let mut values = self.values.get(index).cloned().unwrap_or_default();
            let mut infinite = 0;
            for value in values.iter_mut().filter(|value| value.is_infinite()) {
                *value = f64::NAN;
                infinite += 1;
            }
            columns.values.push(values);
            columns.infinite.push(infinite);
        }
        // They are in memory already, so that one chunk is as good as many.
        Ok(Box::new(std::iter::once(Ok(columns))))
    }
}
