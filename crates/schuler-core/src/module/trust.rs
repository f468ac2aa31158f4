//! Whether the filter may use what the radio measures: what the health monitor's verdict does.
use serde::{Deserialize, Serialize};

use super::HEALTH_LEVELS;
use crate::config::{ConfigError, Problem};
use crate::filter::positive;
use crate::health::{HealthOutput, HealthStatus};
use crate::number::select;
use crate::saved::saved;

/// Least weight of a measurement that is used.
const LEAST_WEIGHT: f32 = 1e-6;

/// How the probability that the radio is faulty decides on the measurement of the velocity error, which is made of its readings.
/// The measurement counts for as much as the probability that the radio is well: its noise variance is divided by 1 − P. Above a
/// limit it is withheld: filter and identification go on as without, and do not start from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadioUse {
    /// The measurement is withheld where the radio is faulty with a greater probability than this, or is out of the monitor's
    /// model; one never withholds for the probability. Lower it where a false velocity costs more than a missing one.
    pub withhold_above: f32,
    /// After so long without pause, s, it is used all the same: a fault that does not end may be a step of the inertial
    /// sensor, which the monitor cannot tell from it. Raise it where the inertial sensor makes no steps.
    pub at_most_s: f32,
}

impl RadioUse {
    /// Withheld above one half, for twenty minutes at most.
    pub const DEFAULT: Self = Self { withhold_above: 0.5, at_most_s: 1200.0 };

    /// Whether it can be flown.
    ///
    /// # Errors
    /// The first field that cannot.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("radio_use.withhold_above", self.withhold_above)?;
        if self.withhold_above > 1.0 {
            return Err(ConfigError::new("radio_use.withhold_above", Problem::OutOfRange));
        }
        positive("radio_use.at_most_s", self.at_most_s)
    }
}

/// What becomes of a step's measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trust {
    /// It is not used.
    pub(super) withheld: bool,
    /// What it counts for otherwise.
    pub(super) weight: f32,
}

/// How long it has been so.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Withholding {
    /// Time since the radio has been held faulty, s.
    held_s: f32,
}

impl Withholding {
    /// `duration_s`: since the last step.
    pub(super) fn step(
        &mut self,
        rule: Option<&RadioUse>,
        health: &HealthOutput<f32, HEALTH_LEVELS>,
        duration_s: f32,
    ) -> Trust {
        let Some(rule) = rule else { return Trust { withheld: false, weight: 1.0 } };
        let held =
            (health.p_fault > rule.withhold_above) | health.status.contains(HealthStatus::OUT_OF_MODEL);
        self.held_s = select(held, self.held_s + duration_s, 0.0);
        let withheld = held & (self.held_s <= rule.at_most_s);
        let weight = select(held, 1.0, (1.0 - health.p_fault).max(LEAST_WEIGHT));
        Trust { withheld, weight }
    }
}

saved!([] RadioUse { withhold_above, at_most_s });
saved!([] Withholding { held_s });

#[cfg(test)]
mod tests {
    use super::*;

    fn output(p_fault: f32, out_of_model: bool) -> HealthOutput<f32, HEALTH_LEVELS> {
        let mut status = HealthStatus::empty();
        status.set(HealthStatus::OUT_OF_MODEL, out_of_model);
        HealthOutput { status, p_fault, ..HealthOutput::default() }
    }

    #[test]
    fn a_measurement_counts_for_the_probability_that_the_radio_is_well() {
        let (mut withholding, rule) = (Withholding::default(), RadioUse::DEFAULT);
        let trust = withholding.step(Some(&rule), &output(0.25, false), 1.0);
        assert_eq!(trust, Trust { withheld: false, weight: 0.75 });
        for faulty in [output(0.51, false), output(0.0, true)] {
            assert!(withholding.step(Some(&rule), &faulty, 1.0).withheld);
        }
        // As if there were no rule.
        let trust = withholding.step(None, &output(1.0, true), 1.0);
        assert_eq!(trust, Trust { withheld: false, weight: 1.0 });
    }

    #[test]
    fn nothing_is_withheld_for_good() {
        let (mut withholding, rule) = (Withholding::default(), RadioUse::DEFAULT);
        let faulty = output(0.99, false);
        let steps = (1..5000).take_while(|_| withholding.step(Some(&rule), &faulty, 1.0).withheld).count();
        assert_eq!(steps, 1200);
        assert_eq!(withholding.step(Some(&rule), &faulty, 1.0), Trust { withheld: false, weight: 1.0 });
        // Once it has been well, anew.
        withholding.step(Some(&rule), &output(0.1, false), 1.0);
        assert!(withholding.step(Some(&rule), &faulty, 1.0).withheld);
    }
}
