//! The filter: what it used, and whether it is consistent.
use schuler_core::module::{Status, StepOutput};
use serde::Serialize;

use crate::flight::outputs::STATES;
use crate::statistics::{LagProducts, LjungBox, MeanTest, nis_mean};

/// The filter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FilterSummary {
    /// Measurements that were used.
    pub used: usize,
    /// Steps without one.
    pub missing: usize,
    /// Measurements beyond the gate.
    pub gated: usize,
    /// Share of the measurements beyond the gate.
    pub gated_share: f64,
    /// Measurements not used because they were saturated or too old.
    pub refused: usize,
    /// Resets of the covariance, re-acquisitions of the velocity, jumps of the clock.
    pub upsets: usize,
    /// Mean innovation, m/s.
    pub innovation_mean: f64,
    /// Its standard deviation for a consistent filter, m/s.
    pub innovation_mean_sigma: f64,
    /// Mean of the normalised innovations squared of the measurements used; 1 for a consistent filter.
    pub nis: MeanTest,
    /// Whiteness of the normalised innovations.
    pub whiteness: LjungBox,
    /// Estimates at the end.
    pub end: Vec<StateSummary>,
}

/// One state at the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StateSummary {
    /// Its name.
    pub state: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Estimate, averaged over what is not known of the noise.
    pub estimate: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Lags of the test of whiteness.
const WHITENESS_LAGS: usize = 20;

/// Whether the step's measurement was used.
pub fn was_used(output: &StepOutput) -> bool {
    let unused = Status::VELOCITY_MISSING
        | Status::VELOCITY_SATURATED
        | Status::VELOCITY_STALE
        | Status::INNOVATION_GATED
        | Status::CLOCK_BACKWARDS
        | Status::VELOCITY_REACQUIRED
        | Status::CLOCK_JUMPED;
    !output.status.intersects(unused) && output.filter.innovation_variance > 0.0
}

/// The normalised innovation of a step; NaN where the measurement was not used.
pub fn normalised_innovation(output: &StepOutput) -> f64 {
    if was_used(output) {
        f64::from(output.filter.innovation) / f64::from(output.filter.innovation_variance).sqrt()
    } else {
        f64::NAN
    }
}

#[derive(Clone, Debug)]
pub(super) struct FilterSums {
    pub(super) steps: usize,
    used: usize,
    missing: usize,
    gated: usize,
    refused: usize,
    upsets: usize,
    innovation: f64,
    variance: f64,
    nis: f64,
    normalised: LagProducts,
}

impl Default for FilterSums {
    fn default() -> Self {
        Self {
            steps: 0,
            used: 0,
            missing: 0,
            gated: 0,
            refused: 0,
            upsets: 0,
            innovation: 0.0,
            variance: 0.0,
            nis: 0.0,
            normalised: LagProducts::new(WHITENESS_LAGS),
        }
    }
}

impl FilterSums {
    pub(super) fn add(&mut self, output: &StepOutput) {
        let is = |flags: Status| usize::from(output.status.intersects(flags));
        self.steps += 1;
        self.missing += is(Status::VELOCITY_MISSING);
        self.gated += is(Status::INNOVATION_GATED);
        self.refused += is(Status::VELOCITY_SATURATED | Status::VELOCITY_STALE);
        self.upsets += is(Status::COVARIANCE_RESET | Status::VELOCITY_REACQUIRED | Status::CLOCK_JUMPED);
        if was_used(output) {
            self.used += 1;
            self.innovation += f64::from(output.filter.innovation);
            self.variance += f64::from(output.filter.innovation_variance);
            self.nis += f64::from(output.filter.nis);
        }
        self.normalised.add(normalised_innovation(output));
    }

    pub(super) fn finish(&self, last: &StepOutput) -> FilterSummary {
        let n = self.used.max(1) as f64;
        let end = &last.identification.averaged;
        FilterSummary {
            used: self.used,
            missing: self.missing,
            gated: self.gated,
            gated_share: self.gated as f64 / (self.used + self.gated).max(1) as f64,
            refused: self.refused,
            upsets: self.upsets,
            innovation_mean: self.innovation / n,
            innovation_mean_sigma: self.variance.sqrt() / n,
            nis: nis_mean(self.nis, self.used),
            whiteness: self.normalised.ljung_box(),
            end: STATES
                .iter()
                .enumerate()
                .map(|(k, (state, unit))| StateSummary {
                    state,
                    unit,
                    estimate: f64::from(end.estimate[k]),
                    sigma: f64::from(end.sigma[k]),
                })
                .collect(),
        }
    }
}
