//! Tables copied from one format to another, a chunk of rows at a time.
use std::fs::File;
use std::path::Path;

use super::{Columns, Format, TableReader, TableWriter};
use crate::error::Error;

/// What was copied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Copied {
    /// Rows written.
    pub rows: u64,
    /// Rows outside the span, which are left out.
    pub left_out: u64,
    /// First and last time written, s.
    pub span_s: Option<[f64; 2]>,
    /// What the user should be told.
    pub warnings: Vec<String>,
}

/// The rows that are copied.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// First and last time, s; without it all rows are copied.
    pub of_s: Option<[f64; 2]>,
    /// Step of evenly spaced rows, s, where the first column is no time. Rows that cannot be read are then copied without values,
    /// so that those behind them keep their time.
    pub step_s: Option<f64>,
}

/// Copies the columns with the given indices, each once, to an open file, in memory that does not grow with the number of
/// rows; `path` is what errors call the file. `span` leaves out rows by the time in the first column, or by their number.
///
/// `progress` is given the number of rows read so far; its error ends the copying.
///
/// # Errors
/// What is wrong with the table, a file that cannot be written, an error of `progress`. What is in the file then is not whole.
pub fn copy<E: From<Error>>(
    table: Box<dyn TableReader>,
    wanted: &[usize],
    span: Span,
    (file, path): (File, &Path),
    format: Format,
    mut progress: impl FnMut(u64) -> Result<(), E>,
) -> Result<Copied, E> {
    let names: Vec<String> = wanted.iter().filter_map(|&index| table.names().get(index).cloned()).collect();
    let metadata = table.metadata().to_vec();
    let counted = span.step_s.is_some();
    let chunks = if counted { table.numbered_chunks(wanted)? } else { table.chunks(wanted)? };
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut writer = TableWriter::new(file, path, format, &names, &metadata)?;
    let mut copied = Copied::default();
    let mut infinite = vec![0; wanted.len()];
    let mut read = 0;
    let mut next = 0;
    for chunk in chunks {
        let mut chunk = chunk?;
        let mut time_s = match span.step_s {
            Some(step_s) => {
                chunk = with_all_rows(&chunk, &mut next);
                chunk.infinite.remove(0);
                chunk.values.remove(0).into_iter().map(|row| row * step_s).collect()
            }
            None => chunk.values.first().cloned().unwrap_or_default(),
        };
        read += chunk.rows() as u64;
        progress(read)?;
        copied.warnings.append(&mut chunk.warnings);
        for (all, more) in infinite.iter_mut().zip(&chunk.infinite) {
            *all += more;
        }
        if let Some([from, to]) = span.of_s {
            let within = |time: &f64| from <= *time && *time <= to;
            for values in &mut chunk.values {
                let mut time_s = time_s.iter();
                values.retain(|_| time_s.next().is_some_and(within));
            }
            time_s.retain(within);
        }
        let columns: Vec<&[f64]> = chunk.values.iter().map(Vec::as_slice).collect();
        writer.write(&columns)?;
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

/// Numbered rows with those that were left out of them, from the row `next` on, without values.
fn with_all_rows(chunk: &Columns, next: &mut u64) -> Columns {
    let mut all = Columns::none(chunk.values.len());
    all.infinite.clone_from(&chunk.infinite);
    all.warnings.clone_from(&chunk.warnings);
    let numbers = chunk.values.first().map_or(&[][..], Vec::as_slice);
    for (row, (&number, &line)) in numbers.iter().zip(&chunk.lines).enumerate() {
        loop {
            let is_there = *next as f64 >= number;
            for (place, (values, of_chunk)) in all.values.iter_mut().zip(&chunk.values).enumerate() {
                let value = of_chunk.get(row).copied().filter(|_| is_there).unwrap_or(f64::NAN);
                values.push(if place == 0 { *next as f64 } else { value });
            }
            all.lines.push(line);
            *next += 1;
            if is_there {
                break;
            }
        }
    }
    all
}
