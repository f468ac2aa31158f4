//! Which readings can be used: quality, range, stuck and lost gyros. Equation id FDI-10.
//!
//! Readings that are too old arrive as missing: how old is too old is decided once for all sensors.
use super::parity::GYROS;
use crate::reading::{Quality, Reading};
use crate::saved::saved;

/// One bit a gyro.
pub(super) type GyroMask = u8;

/// Limits of the readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct InputLimits {
    /// Largest magnitude, rad/s.
    pub(super) range: f64,
    /// Identical samples in a row that make a gyro stuck.
    pub(super) stuck_samples: u32,
    /// Unusable samples in a row that make a gyro lost.
    pub(super) lost_samples: u32,
}

/// One sample after the checks.
#[derive(Clone, Copy, Debug)]
pub(super) struct CheckedInput {
    /// Values, rad/s; zero where not usable.
    pub(super) values: [f64; GYROS],
    /// Gyros whose reading can be used.
    pub(super) usable: GyroMask,
    /// Gyros that stand still while most others move.
    pub(super) stuck: GyroMask,
    /// Gyros that have been silent for too long.
    pub(super) lost: GyroMask,
    /// Most gyros stand still: the block rests within its quantisation, or its data are frozen.
    pub(super) frozen: bool,
}

/// Watches the readings of each gyro over time.
#[derive(Clone, Copy, Debug)]
pub(super) struct InputMonitor {
    limits: InputLimits,
    channels: [Channel; GYROS],
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    last: Option<f64>,
    /// Identical usable samples in a row, this one included.
    identical: u32,
    /// Unusable samples in a row.
    silent: u32,
}

impl InputMonitor {
    pub(super) fn new(limits: InputLimits) -> Self {
        Self { limits, channels: [Channel { last: None, identical: 0, silent: 0 }; GYROS] }
    }

    /// Checks one sample. `[FDI-10]`
    pub(super) fn check(&mut self, gyros: &[Reading<f64>; GYROS]) -> CheckedInput {
        let mut checked = CheckedInput { values: [0.0; GYROS], usable: 0, stuck: 0, lost: 0, frozen: false };
        let mut bit = 1;
        for ((reading, channel), value) in gyros.iter().zip(&mut self.channels).zip(&mut checked.values) {
            let usable = reading.quality == Quality::Good
                && reading.value.is_finite()
                && reading.value.abs() <= self.limits.range;
            *value = if usable { reading.value } else { 0.0 };
            channel.take(usable, reading.value);
            checked.usable |= if usable { bit } else { 0 };
            checked.stuck |= if channel.identical >= self.limits.stuck_samples { bit } else { 0 };
            checked.lost |= if channel.silent >= self.limits.lost_samples { bit } else { 0 };
            bit <<= 1;
        }
        // "While others vary": a minority that stands still is stuck, a majority is a block at rest.
        checked.frozen = 2 * checked.stuck.count_ones() >= checked.usable.count_ones() && checked.stuck != 0;
        checked.stuck = if checked.frozen { 0 } else { checked.stuck };
        checked
    }
}

impl Channel {
    fn take(&mut self, usable: bool, value: f64) {
        let same = self.last == Some(value);
        self.identical = match (usable, same) {
            (true, true) => self.identical.saturating_add(1),
            (true, false) => 1,
            (false, _) => self.identical,
        };
        self.last = if usable { Some(value) } else { self.last };
        self.silent = if usable { 0 } else { self.silent.saturating_add(1) };
    }
}

saved!([] Channel { last, identical, silent });
saved!([] InputLimits { range, stuck_samples, lost_samples });
saved!([] InputMonitor { limits, channels });
