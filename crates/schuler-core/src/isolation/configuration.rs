//! What the isolation is told before the flight.
use serde::{Deserialize, Serialize};

use super::parity::GYROS;
use super::thresholds::{FALSE_ALARM_INTERVAL, SLOW_REFERENCE};
use crate::config::{ConfigError, Problem};
use crate::filter::positive;
use crate::saved::saved;

/// Largest relative error of a gyro for which a hard fault still stands out of the noise that is inflated with
/// the rate which the fault itself feigns.
const MAX_RELATIVE_ERROR: f64 = 0.05;

/// Largest part of the slow sums' reference that errors of scale and alignment may feed before the rate limit
/// suspends them: at half of it they would shorten the time between false alarms many times.
const MAX_LEAK: f64 = 0.5 * SLOW_REFERENCE;

/// Geometry and noise of the gyro block, and how sure the isolation must be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IsolationConfig {
    /// Unit input axes of the five gyros in body axes, one row a gyro.
    pub axes: [[f64; 3]; GYROS],
    /// 1-σ noise of each gyro per sample, rad/s.
    pub sigma: [f64; GYROS],
    /// Largest rate that a gyro can report, rad/s.
    pub range: f64,
    /// Calibrated constant error of each gyro, rad/s, subtracted before all else.
    pub offset: [f64; GYROS],
    /// Samples at the start over which the constant parity is measured and then frozen; zero: none, `offset` is
    /// all there is. No fault is detected meanwhile.
    pub calibration_samples: u32,
    /// A measured constant above this in any gyro is a fault, not an offset, and is not taken, rad/s.
    pub offset_limit: f64,
    /// Mean time between false alarms, samples, 10⁴ to 10⁷.
    pub false_alarm_interval: f64,
    /// Isolation margin M between the two largest likelihood statistics; 9.2 is odds of 100 to 1.
    pub margin: f64,
    /// Samples in a row beyond the single-sample threshold that make an alarm; fewer are outliers, which cost
    /// the sample and not the gyro.
    pub persistence: u32,
    /// Samples after an alarm after which isolation is given up.
    pub give_up_samples: u32,
    /// Bound ε of each gyro's error relative to the rate (scale, alignment); the noise is inflated by it.
    pub relative_error: f64,
    /// Rate above which the cumulative sums are suspended, rad/s: where the errors that grow with the rate,
    /// ε·rate·√Σσ⁻², are no more than a twentieth of a standard deviation.
    pub rate_limit: f64,
    /// Identical readings in a row, while others vary, that make a gyro stuck.
    pub stuck_samples: u32,
    /// Readings in a row that could not be used that make a gyro lost.
    pub lost_samples: u32,
    /// Samples of agreement of all five gyros after which excluded ones are taken back; zero: only on command.
    pub readmit_samples: u32,
}

impl IsolationConfig {
    /// Five axes on the symmetric cone of half-angle 54.74°, of navigation grade.
    pub const CONE: Self = Self {
        axes: [
            [0.97204, 0.0, -0.23482],
            [-0.60075, -0.77653, -0.18997],
            [0.0, 0.47992, 0.87731],
            [0.0, -0.47992, 0.87731],
            [-0.60075, 0.77653, -0.18997],
        ],
        sigma: [1e-7; GYROS],
        range: 1.0,
        offset: [0.0; GYROS],
        calibration_samples: 0,
        offset_limit: 1e-6,
        false_alarm_interval: 1e5,
        margin: 9.2,
        persistence: 3,
        give_up_samples: 2000,
        relative_error: 1e-5,
        rate_limit: 2e-4,
        stuck_samples: 10,
        lost_samples: 60,
        readmit_samples: 3600,
    };

    /// Checks everything but the geometry, which is checked where it is built.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        positive("isolation.range", self.range)?;
        for offset in self.offset {
            finite("isolation.offset", offset)?;
        }
        positive("isolation.offset_limit", self.offset_limit)?;
        finite("isolation.false_alarm_interval", self.false_alarm_interval)?;
        finite("isolation.margin", self.margin)?;
        finite("isolation.relative_error", self.relative_error)?;
        positive("isolation.rate_limit", self.rate_limit)?;
        let precision = self.sigma.iter().fold(0.0, |sum, sigma| sum + 1.0 / (sigma * sigma));
        let leak = self.relative_error * self.rate_limit;
        for (field, within) in [
            ("isolation.false_alarm_interval", FALSE_ALARM_INTERVAL.contains(&self.false_alarm_interval)),
            ("isolation.margin", (0.0..=100.0).contains(&self.margin)),
            ("isolation.persistence", (1..=100).contains(&self.persistence)),
            ("isolation.give_up_samples", self.give_up_samples >= 1),
            ("isolation.relative_error", (0.0..=MAX_RELATIVE_ERROR).contains(&self.relative_error)),
            ("isolation.rate_limit", leak * leak * precision <= MAX_LEAK * MAX_LEAK),
            ("isolation.stuck_samples", self.stuck_samples >= 2),
            ("isolation.lost_samples", self.lost_samples >= 1),
        ] {
            if !within {
                return Err(ConfigError::new(field, Problem::OutOfRange));
            }
        }
        Ok(())
    }
}

fn finite(field: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() { Ok(()) } else { Err(ConfigError::new(field, Problem::NotFinite)) }
}

saved!([] IsolationConfig {
    axes,
    sigma,
    range,
    offset,
    calibration_samples,
    offset_limit,
    false_alarm_interval,
    margin,
    persistence,
    give_up_samples,
    relative_error,
    rate_limit,
    stuck_samples,
    lost_samples,
    readmit_samples,
});
