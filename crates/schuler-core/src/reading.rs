//! One reading of one sensor, as it reaches the module.
use serde::{Deserialize, Serialize};

/// A sensor's value with what the interface electronics know about it. The unit is the channel's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reading<T> {
    /// The value; ignored unless the quality is [`Quality::Good`]. May be NaN: that counts as missing.
    pub value: T,
    /// Age of the value at the instant of the step, milliseconds.
    pub age_ms: u32,
    /// What the interface electronics say of the value.
    pub quality: Quality,
}

/// What the interface electronics say of a reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quality {
    /// Converted and within range.
    Good,
    /// At the end of the converter's range: the true value is at least this large.
    Saturated,
    /// No value this step.
    #[default]
    Missing,
}

impl<T> Reading<T> {
    /// A fresh, good reading.
    pub const fn good(value: T) -> Self {
        Self { value, age_ms: 0, quality: Quality::Good }
    }
}

impl<T: num_traits::Zero> Reading<T> {
    /// No reading this step.
    pub fn missing() -> Self {
        Self { value: T::zero(), age_ms: 0, quality: Quality::Missing }
    }

    /// The reading, or a missing one when it is too old.
    #[must_use]
    pub fn not_older_than(self, max_age_ms: u32) -> Self {
        if self.age_ms > max_age_ms { Self::missing() } else { self }
    }
}
