//! What really happened, where a simulation has left it beside the case.
use std::path::Path;

use schuler_recording::Error;
use schuler_recording::table::{self, Chunks, Columns};

use crate::simulation::TRUTH;

/// Times that differ by less are one, s.
const SAME_TIME_S: f64 = 1e-6;

/// The states of a Schuler loop: ΔV (m/s), δ (rad), a (m/s²), ω (rad/s).
pub type LoopStates = [f64; 4];

/// The truth of a Schuler loop, read in the order of its times.
pub struct LoopTruth {
    rest: Chunks,
    /// Time and states that were read last, and the row that is next.
    rows: Columns,
    next: usize,
}

impl LoopTruth {
    /// The truth of the loop whose recorded velocity error is called `id`; none where there is no such file or no such loop.
    ///
    /// # Errors
    /// A truth that cannot be read.
    pub fn beside(case: &Path, id: &str) -> Result<Option<Self>, Error> {
        let path = case.parent().unwrap_or(Path::new("")).join(TRUTH);
        if !path.exists() {
            return Ok(None);
        }
        let table = table::open(&path)?;
        let states = ["velocity_error", "tilt", "accelerometer_error", "gyro_drift"];
        let names = states.map(|state| format!("{id}.{state}"));
        let wanted: Result<Vec<usize>, String> = std::iter::once("t")
            .chain(names.iter().map(String::as_str))
            .map(|name| table.index(name))
            .collect();
        let Ok(wanted) = wanted else { return Ok(None) };
        Ok(Some(Self { rest: table.chunks(&wanted)?, rows: Columns::default(), next: 0 }))
    }

    /// The states at a time that is not before the one asked for last; NaN where the truth has no row.
    ///
    /// # Errors
    /// A truth that cannot be read.
    pub fn at(&mut self, time_s: f64) -> Result<LoopStates, Error> {
        loop {
            let times = self.rows.values.first().map_or(&[][..], Vec::as_slice);
            let ahead = times.get(self.next..).unwrap_or_default();
            self.next += ahead.partition_point(|truth_s| *truth_s < time_s - SAME_TIME_S);
            if let Some(truth_s) = times.get(self.next) {
                let row = (truth_s - time_s <= SAME_TIME_S).then_some(self.next);
                let state = |k: usize| self.rows.values.get(k + 1)?.get(row?).copied();
                return Ok(std::array::from_fn(|k| state(k).unwrap_or(f64::NAN)));
            }
            match self.rest.next() {
                Some(rows) => (self.rows, self.next) = (rows?, 0),
                None => return Ok([f64::NAN; 4]),
            }
        }
    }
}
