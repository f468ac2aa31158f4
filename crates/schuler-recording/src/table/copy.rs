//! Tables copied from one format to another, a chunk of rows at a time.
use std::fs::File;
use std::path::Path;

use super::{Format, TableReader, TableWriter};
use crate::error::Error;

/// What was copied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Copied {
    /// Rows written.
    pub rows: u64,
    /// Rows outside the span, which are left out.
    pub left_out: u64,
    /// First and last time written, s, where there is a time column.
    pub span_s: Option<[f64; 2]>,
    /// What the user should be told.
    pub warnings: Vec<String>,
}

/// Copies the columns with the given indices, each once, to an open file, in memory that does not grow with the number of
/// rows; `path` is what errors call the file. `span_s`, first and last time in seconds, leaves out the rows outside, by the time in the first column.
///
/// `progress` is given the number of rows read so far; its error ends the copying.
///
/// # Errors
/// What is wrong with the table, a file that cannot be written, an error of `progress`. What is in the file then is not whole.
pub fn copy<E: From<Error>>(
    table: Box<dyn TableReader>,
    wanted: &[usize],
    span_s: Option<[f64; 2]>,
    (file, path): (File, &Path),
    format: Format,
    mut progress: impl FnMut(u64) -> Result<(), E>,
) -> Result<Copied, E> {
    let names: Vec<String> = wanted.iter().filter_map(|&index| table.names().get(index).cloned()).collect();
    let metadata = table.metadata().to_vec();
    let chunks = table.chunks(wanted)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut writer = TableWriter::new(file, path, format, &names, &metadata)?;
    let mut copied = Copied::default();
    let mut infinite = vec![0; wanted.len()];
    let mut read = 0;
    for chunk in chunks {
        let mut chunk = chunk?;
        read += chunk.rows() as u64;
        progress(read)?;
        copied.warnings.append(&mut chunk.warnings);
        for (all, more) in infinite.iter_mut().zip(&chunk.infinite) {
            *all += more;
        }
        if let Some([from, to]) = span_s {
            let time_s = chunk.values.first().cloned().unwrap_or_default();
            for values in &mut chunk.values {
                let mut time_s = time_s.iter();
                values.retain(|_| time_s.next().is_some_and(|&time| from <= time && time <= to));
            }
        }
        let columns: Vec<&[f64]> = chunk.values.iter().map(Vec::as_slice).collect();
        writer.write(&columns)?;
        let time_s = columns.first().copied().unwrap_or_default();
        copied.rows += time_s.len() as u64;
        if let (Some(&first), Some(&last)) = (time_s.first(), time_s.last()) {
            copied.span_s = Some([copied.span_s.map_or(first, |[earliest, _]| earliest), last]);
        }
    }
    copied.left_out = read - copied.rows;
    for (name, infinite) in names.iter().zip(infinite).filter(|&(_, infinite)| infinite > 0) {
        copied.warnings.push(format!("{name}: {infinite} infinite values are missing"));
    }
    writer.finish()?;
    Ok(copied)
}
