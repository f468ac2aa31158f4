//! Sequential detection of a fault among five gyros, and the isolation of the one that has it.
//!
//! Sources: generalised likelihood test of Daly, Gai and Harrison (1979); cumulative sums for slow faults after
//! Nikiforov et al. (1993). Equation ids FDI-1, FDI-5, FDI-6.
//!
//! Three detectors watch together: one sample's squared parity (hard faults), cumulative sums with a large
//! reference (steps) and with a small one (slow faults). The evidence since the sum that raised the alarm last
//! stood at zero is accumulated further until one gyro leads all others by the isolation margin.
//!
//! In: parity in standard deviations. Out: alarm, leading gyro and its margin; all dimensionless.
use nalgebra::{RealField, Vector2};

use super::investigation::Investigation;
pub use super::investigation::{Alarm, Suspicion};
use super::parity::ParitySpace;
use super::sums::{Evidence, Watch};
use super::thresholds::Thresholds;
use crate::saved::{Blank, saved};

/// How sure the detector must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectorConfig<T> {
    /// Mean number of samples between false alarms.
    pub false_alarm_interval: T,
    /// Isolation margin M: least difference between the two largest likelihood statistics q. An alarm is withdrawn
    /// at the same odds.
    pub margin: T,
    /// Samples in a row beyond the single-sample threshold that make an alarm. One: every such sample is one.
    /// More: fewer in a row are outliers, and a sample enters the sums with no more than the threshold's norm.
    pub persistence: u32,
    /// Samples after an alarm (`N_max`) after which isolation is given up, or is final.
    pub give_up_samples: u32,
}

/// What one sample did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection<T> {
    /// This sample is beyond the single-sample threshold.
    pub outlier: bool,
    /// This sample raised the alarm.
    pub raised: bool,
    /// Where the alarm stands.
    pub alarm: Alarm,
    /// The gyro in which the fault is, when this sample leaves no doubt of it.
    pub isolated: Option<usize>,
    /// The gyro that explains the evidence of the alarm best; without an alarm, meaningless.
    pub suspicion: Suspicion<T>,
    /// The gyro that explains this sample best.
    pub of_sample: Suspicion<T>,
    /// The largest statistic over its threshold; an alarm is raised beyond one.
    pub level: T,
}

/// Detector and isolator for a block of five gyros.
#[derive(Clone, Copy, Debug)]
pub struct FiveGyroDetector<T> {
    watch: Watch<T>,
    investigation: Investigation<T>,
}

impl<T: RealField + Copy> FiveGyroDetector<T> {
    /// A detector that has seen nothing.
    pub fn new(config: &DetectorConfig<T>) -> Self {
        let thresholds = Thresholds::five(config.false_alarm_interval, config.persistence);
        Self {
            watch: Watch::new(&thresholds, config.persistence),
            investigation: Investigation::new(config.margin, config.give_up_samples),
        }
    }

    /// Forgets all evidence.
    pub fn reset(&mut self) {
        self.watch.reset();
        self.investigation.reset();
    }

    /// Where the alarm stands.
    pub fn alarm(&self) -> Alarm {
        self.investigation.alarm
    }

    /// One sample of parity, in standard deviations. `[FDI-6]`
    ///
    /// `usable`: the sample counts at all; else the state stays as it is. `sums`: whatever adds up samples takes
    /// it; only outliers count while the rate is so large that errors of scale and alignment would add up.
    pub fn step(
        &mut self,
        space: &ParitySpace<T>,
        parity: &Vector2<T>,
        usable: bool,
        sums: bool,
    ) -> Detection<T> {
        let seen = self.watch.step(space, parity, usable, sums);
        let (raised, suspicion, isolated) =
            self.investigation.step(space, &seen.limited, seen.alarm, usable, sums || seen.outlier);
        if self.investigation.alarm == Alarm::Withdrawn {
            self.watch.reset();
        }
        Detection {
            outlier: seen.outlier,
            raised,
            alarm: self.investigation.alarm,
            isolated,
            suspicion,
            of_sample: Suspicion::of(space, &Evidence { samples: 1, sum: *parity }),
            level: seen.level,
        }
    }
}

saved!([T: Blank] FiveGyroDetector<T> { watch, investigation });
