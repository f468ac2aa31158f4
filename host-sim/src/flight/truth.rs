//! What really happened, where a simulation has left it beside the case.
use std::path::Path;

use schuler_recording::{Error, table};

use crate::simulation::TRUTH;

/// The truth of a Schuler loop at the recording's steps.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopTruth {
    /// ΔV (m/s), δ (rad), a (m/s²), ω (rad/s); NaN where the truth has no row.
    pub states: [Vec<f64>; 4],
}

impl LoopTruth {
    /// Reads the truth of the loop whose recorded velocity error is called `id`, for these times; none where there is no
    /// such file or no such loop.
    ///
    /// # Errors
    /// A truth that cannot be read.
    pub fn beside(case: &Path, id: &str, time_s: &[f64]) -> Result<Option<Self>, Error> {
        let path = case.parent().unwrap_or(Path::new("")).join(TRUTH);
        if !path.exists() {
            return Ok(None);
        }
        let table = table::open(&path)?;
        let mut names = vec!["t".to_owned()];
        let states = ["velocity_error", "tilt", "accelerometer_error", "gyro_drift"];
        names.extend(states.iter().map(|state| format!("{id}.{state}")));
        let wanted: Result<Vec<usize>, String> =
            names.iter().map(|name| table::column_index(table.names(), name)).collect();
        let Ok(wanted) = wanted else { return Ok(None) };
        let mut columns = table.read(&wanted)?.values.into_iter();
        let Some(times) = columns.next() else { return Ok(None) };
        let mut at = 0;
        let rows: Vec<Option<usize>> = time_s
            .iter()
            .map(|t| {
                while times.get(at).is_some_and(|truth| *truth < t - 1e-6) {
                    at += 1;
                }
                times.get(at).filter(|truth| (**truth - t).abs() <= 1e-6).map(|_| at)
            })
            .collect();
        let mut state = || {
            let values = columns.next().unwrap_or_default();
            rows.iter()
                .map(|row| row.and_then(|row| values.get(row).copied()).unwrap_or(f64::NAN))
                .collect::<Vec<f64>>()
        };
        Ok(Some(Self { states: [state(), state(), state(), state()] }))
    }
}
