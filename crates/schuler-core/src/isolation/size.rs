//! The size of the fault of the excluded gyro. Equation id FDI-5.
use nalgebra::Vector2;

use super::parity::ParitySpace;
use crate::saved::saved;

/// Number of samples over which the size is averaged at most.
const WINDOW: u32 = 1000;

/// Mean parity since the alarm; exponentially forgetting once the window is full.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaultSize {
    samples: u32,
    mean: Vector2<f64>,
}

impl FaultSize {
    pub(super) fn none() -> Self {
        Self { samples: 0, mean: Vector2::zeros() }
    }

    /// One sample of the five-gyro parity, when all gyros could be read.
    pub(super) fn step(&mut self, parity: &Vector2<f64>, counts: bool) {
        let next = self.samples.wrapping_add(u32::from(counts)).min(WINDOW);
        let weight = if counts { 1.0 / f64::from(next.max(1)) } else { 0.0 };
        self.samples = next;
        self.mean += (parity - self.mean) * weight;
    }

    /// Size and its standard deviation, in σ of the gyro; zeros without a sample. `[FDI-5]`
    pub(super) fn of(&self, space: &ParitySpace<f64>, gyro: usize) -> (f64, f64) {
        let samples = f64::from(self.samples.max(1));
        let sigma = nalgebra::ComplexField::sqrt(1.0 / samples) / space.sensitivity_of(gyro);
        let known = if self.samples > 0 { 1.0 } else { 0.0 };
        (space.fault_size(&self.mean, gyro), sigma * known)
    }
}

saved!([] FaultSize { samples, mean });
