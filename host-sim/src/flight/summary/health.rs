//! The health monitor: verdicts and how long each stood.
use schuler_core::health::{self, Estimate, HealthStatus, Suspect};
use schuler_core::module::{Status, StepOutput};
use serde::Serialize;

use super::MOST_EVENTS;

/// The health monitor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HealthSummary {
    /// Changes of the verdict.
    pub verdicts: Vec<HealthChange>,
    /// Share of the steps with each verdict, where there is one.
    pub shares: Vec<(&'static str, f64)>,
    /// Steps with both readings.
    pub residuals: usize,
    /// Residuals beyond every mode.
    pub out_of_model: usize,
    /// Starts from the priors after a gap that is too long.
    pub restarts: usize,
    /// Steps whose velocity measurement was withheld from the filter.
    pub withheld: usize,
    /// Error of the radio at the end and its standard deviation, m/s.
    pub radio_error: [f64; 2],
    /// Error of the inertial velocity at the end and its standard deviation, m/s.
    pub inertial_error: [f64; 2],
}

/// A change of the health monitor's verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HealthChange {
    /// When, s.
    pub time_s: f64,
    /// As in the table of verdicts.
    pub verdict: &'static str,
    /// `neither`, `radio`, `inertial` or `either`.
    pub suspect: &'static str,
}

/// Name of a verdict of the health monitor.
pub fn health_name(verdict: health::Verdict) -> &'static str {
    match verdict {
        health::Verdict::Unobserved => "unobserved",
        health::Verdict::Nominal => "nominal",
        health::Verdict::ShiftedMean => "shifted_mean",
        health::Verdict::GrownNoise => "grown_noise",
        health::Verdict::ShiftedMeanAndGrownNoise => "shifted_mean_and_grown_noise",
        health::Verdict::UndecidedFault => "undecided_fault",
        health::Verdict::InertialDivergence => "inertial_divergence",
        health::Verdict::OutOfModel => "out_of_model",
        health::Verdict::HeldReading => "held_reading",
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct HealthSums {
    before: Option<(&'static str, &'static str)>,
    verdicts: Vec<HealthChange>,
    /// Steps with each verdict, in the order in which they came.
    steps: Vec<(&'static str, usize)>,
    residuals: usize,
    out_of_model: usize,
    restarts: usize,
    withheld: usize,
}

impl HealthSums {
    pub(super) fn add(&mut self, time_s: f64, step: &StepOutput) {
        let output = &step.health;
        self.withheld += usize::from(step.status.contains(Status::VELOCITY_WITHHELD));
        let is = |flag: HealthStatus| usize::from(output.status.contains(flag));
        let verdict = health_name(output.verdict);
        let suspect = match output.suspect {
            Suspect::Neither => "neither",
            Suspect::Radio => "radio",
            Suspect::Inertial => "inertial",
            Suspect::Either => "either",
        };
        if self.before != Some((verdict, suspect)) && self.verdicts.len() < MOST_EVENTS {
            self.verdicts.push(HealthChange { time_s, verdict, suspect });
        }
        self.before = Some((verdict, suspect));
        match self.steps.iter_mut().find(|(name, _)| *name == verdict) {
            Some((_, steps)) => *steps += 1,
            None => self.steps.push((verdict, 1)),
        }
        let unusable = HealthStatus::RADIO_UNUSABLE | HealthStatus::INERTIAL_UNUSABLE;
        self.residuals += usize::from(!output.status.intersects(unusable));
        self.out_of_model += is(HealthStatus::OUT_OF_MODEL);
        self.restarts += is(HealthStatus::RESTARTED);
    }

    pub(super) fn finish(self, last: &StepOutput, steps: usize) -> HealthSummary {
        let estimate = |it: Estimate<f32>| [f64::from(it.value), f64::from(it.sigma)];
        HealthSummary {
            verdicts: self.verdicts,
            shares: self.steps.into_iter().map(|(name, of)| (name, of as f64 / steps as f64)).collect(),
            residuals: self.residuals,
            out_of_model: self.out_of_model,
            restarts: self.restarts,
            withheld: self.withheld,
            radio_error: estimate(last.health.radio_error),
            inertial_error: estimate(last.health.inertial_error),
        }
    }
}
