//! A recording of any length, a few thousand rows at a time.
use super::grid::{Survey, Walk};
use super::layout::{Layout, Rows, TIME, file_warnings, time_error, time_note};
use super::stamps::Timed;
use super::{Quality, Recording};
use crate::case::CaseFile;
use crate::error::Error;
use crate::table::{CHUNK_ROWS, Columns};

/// A recording that is read in order, as often as wanted, in memory that does not grow with its length. What is in a simulator's own table is
/// not in it.
#[derive(Debug)]
pub struct Stream {
    file: CaseFile,
    layout: Layout,
    quality: Vec<Quality>,
    head: Recording,
    rows: usize,
    start_s: f64,
    walk: Walk,
}

impl Stream {
    /// Goes through the table of a case once, to learn its step and its length and to find what is wrong with it. `look` is
    /// given the rows that were recorded, none put in, and may stop it.
    ///
    /// # Errors
    /// As [`Recording::of_case`], or what `look` returns.
    pub fn open<E: From<Error>>(
        file: CaseFile,
        mut look: impl FnMut(&Recording) -> Result<(), E>,
    ) -> Result<Self, E> {
        let table = file.open_table()?;
        let layout = Layout::new(&file, &*table, |_| false)?;
        let mut survey = Survey::new(file.case.recording.time_name(), file.case.recording.step_s);
        let mut quality = vec![Quality::default(); layout.width()];
        let mut warnings = file_warnings(&file);
        warnings.extend_from_slice(&layout.notes);
        for columns in Timed::new(&file, layout.chunks(table)?) {
            let mut columns = columns?;
            let time_s = columns.values.get(TIME).cloned().unwrap_or_default();
            survey.add(&time_s, &columns.lines).map_err(|problem| time_error(&file, problem))?;
            warnings.append(&mut columns.warnings);
            let of_chunk = layout.quality(&columns);
            for (sum, of_chunk) in quality.iter_mut().zip(&of_chunk) {
                sum.present += of_chunk.present;
                sum.missing += of_chunk.missing;
                sum.infinite += of_chunk.infinite;
            }
            let rows = Rows { inserted: vec![false; time_s.len()], time_s, ..Rows::default() };
            let recorded = layout.recording(file.case.clone(), rows, &of_chunk, Vec::new(), |place| {
                columns.values.get_mut(place).map(std::mem::take).unwrap_or_default()
            });
            recorded.refuse_degrees(&file.path, &file.lines)?;
            look(&recorded)?;
        }
        let times = survey.finish().map_err(|problem| time_error(&file, problem))?;
        let infinite: Vec<usize> = quality.iter().map(|it| it.infinite).collect();
        warnings.extend(layout.infinite_warnings(&file, &infinite));
        warnings.extend(time_note(&file, times.note));
        for it in &mut quality {
            it.in_gaps = times.rows - it.present - it.missing;
        }
        let none = Rows { step_s: times.step_s, ..Rows::default() };
        let head = layout.recording(file.case.clone(), none, &quality, warnings, |_| Vec::new());
        Ok(Self { file, layout, quality, head, rows: times.rows, start_s: times.start_s, walk: times.walk })
    }

    /// The case.
    pub fn file(&self) -> &CaseFile {
        &self.file
    }

    /// The recording without its rows; the quality of each series and the warnings are of all of them.
    pub fn head(&self) -> &Recording {
        &self.head
    }

    /// Number of rows, recorded and put in.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Time of the first row, s.
    pub fn start_s(&self) -> f64 {
        self.start_s
    }

    /// All rows from the first on, with those put in for missing steps. The recordings have the rows of [`Recording::of_case`] one
    /// after another; their gaps, which may reach from one into the next, are in none of their lists, and their quality is that of
    /// the [`head`](Self::head).
    ///
    /// # Errors
    /// A table that cannot be read any more. In the chunks: the same.
    pub fn chunks(&self) -> Result<impl Iterator<Item = Result<Recording, Error>> + use<'_>, Error> {
        let table = self.file.open_table()?;
        Ok(Chunks {
            of: self,
            rest: Timed::new(&self.file, self.layout.chunks(table)?),
            columns: Columns::default(),
            next: 0,
            walk: self.walk.clone(),
        })
    }
}

struct Chunks<'s> {
    of: &'s Stream,
    rest: Timed,
    /// What was read last, and the next row of it.
    columns: Columns,
    next: usize,
    walk: Walk,
}

impl Iterator for Chunks<'_> {
    type Item = Result<Recording, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.next >= self.columns.rows() {
            match self.rest.next()? {
                Ok(columns) => self.columns = columns,
                Err(error) => return Some(Err(error)),
            }
            self.next = 0;
        }
        Some(Ok(self.rows()))
    }
}

impl Chunks<'_> {
    /// The next rows of what was read, or of the gap before them.
    fn rows(&mut self) -> Recording {
        let mut rows = Rows { step_s: self.of.head.step_s, ..Rows::default() };
        // Of each row, which it is of those read.
        let mut source = Vec::new();
        while let Some(&recorded_s) = self.columns.values.get(TIME).and_then(|time_s| time_s.get(self.next))
            && source.len() < CHUNK_ROWS
        {
            let (time_s, put_in) = self.walk.next(recorded_s);
            rows.time_s.push(time_s);
            rows.inserted.push(put_in);
            source.push((!put_in).then_some(self.next));
            self.next += usize::from(!put_in);
        }
        let values = |place: usize| -> Vec<f64> {
            let values = self.columns.values.get(place).map_or(&[][..], Vec::as_slice);
            source
                .iter()
                .map(|row| row.and_then(|row| values.get(row).copied()).unwrap_or(f64::NAN))
                .collect()
        };
        self.of.layout.recording(self.of.file.case.clone(), rows, &self.of.quality, Vec::new(), values)
    }
}
