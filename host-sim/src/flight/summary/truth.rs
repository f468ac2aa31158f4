//! The estimate against the truth, where it is known.
use serde::Serialize;

/// Against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthSummary {
    /// From this time on, s.
    pub from_s: f64,
    /// State by state, of the averaged estimate.
    pub states: Vec<TruthState>,
}

/// One state against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthState {
    /// Its name.
    pub state: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Root mean square of the error.
    pub rmse: f64,
    /// Share of the errors beyond three standard deviations.
    pub beyond_three_sigma: f64,
    /// Mean of (error/σ)².
    pub nees: f64,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TruthSums {
    count: usize,
    squares: f64,
    beyond: usize,
    nees: f64,
}

impl TruthSums {
    pub(super) fn add(&mut self, error: f64, sigma: f64) {
        self.count += 1;
        self.squares += error * error;
        self.beyond += usize::from(error.abs() > 3.0 * sigma);
        self.nees += (error / sigma).powi(2);
    }

    pub(super) fn finish(&self, state: &'static str, unit: &'static str) -> TruthState {
        let n = self.count.max(1) as f64;
        TruthState {
            state,
            unit,
            rmse: (self.squares / n).sqrt(),
            beyond_three_sigma: self.beyond as f64 / n,
            nees: self.nees / n,
        }
    }
}
