//! The constant part of the parity, from gyro biases, measured over a fault-free period and then frozen.
//! Equation id FDI-7.
use crate::saved::saved;
use nalgebra::Vector2;

/// Mean parity over the first samples of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct OffsetCalibration {
    needed: u32,
    samples: u32,
    sum: Vector2<f64>,
}

impl OffsetCalibration {
    pub(super) fn new(needed: u32) -> Self {
        Self { needed, samples: 0, sum: Vector2::zeros() }
    }

    pub(super) fn running(&self) -> bool {
        self.samples < self.needed
    }

    /// One sample; the mean parity when this sample was the last that was needed.
    pub(super) fn step(&mut self, parity: &Vector2<f64>, usable: bool) -> Option<Vector2<f64>> {
        let counts = usable && self.running();
        self.samples += u32::from(counts);
        self.sum += parity * if counts { 1.0 } else { 0.0 };
        let mean = self.sum / f64::from(self.samples.max(1));
        (counts && !self.running()).then_some(mean)
    }
}

saved!([] OffsetCalibration { samples, sum, needed });
