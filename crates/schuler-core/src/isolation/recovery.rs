//! When a block that was found faulty is whole again. Equation id FDI-9.
use crate::saved::saved;
use nalgebra::Vector2;

/// Bound of the squared mean parity over its variance: chi-square with 2 degrees of freedom, 95 %.
const MAX_MEAN_STATISTIC: f64 = 5.991;
/// Mean of ‖z‖² without a fault.
const HEALTHY_ENERGY: f64 = 2.0;

/// Judges blocks of samples of the five-gyro parity.
///
/// A block passes when the mean of ‖z‖² is not above its healthy mean and the mean parity is zero within its
/// standard error; the second condition finds faults below the noise that the first would pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct RecoveryMonitor {
    /// Samples in a block; zero: never.
    needed: u32,
    samples: u32,
    energy: f64,
    sum: Vector2<f64>,
}

impl RecoveryMonitor {
    pub(super) fn new(needed: u32) -> Self {
        Self { needed, samples: 0, energy: 0.0, sum: Vector2::zeros() }
    }

    pub(super) fn reset(&mut self) {
        *self = Self::new(self.needed);
    }

    /// One sample, when all five gyros can be read. True when a block has just passed.
    pub(super) fn step(&mut self, parity: &Vector2<f64>, counts: bool) -> bool {
        let weight = if counts { 1.0 } else { 0.0 };
        self.samples = self.samples.saturating_add(u32::from(counts));
        self.energy += weight * parity.norm_squared();
        self.sum += parity * weight;

        let samples = f64::from(self.samples);
        let complete = self.needed > 0 && self.samples >= self.needed;
        let passed = complete
            && self.energy <= HEALTHY_ENERGY * samples
            && self.sum.norm_squared() <= MAX_MEAN_STATISTIC * samples;
        if complete {
            self.reset();
        }
        passed
    }
}

saved!([] RecoveryMonitor { samples, energy, sum, needed });
