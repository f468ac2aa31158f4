//! What can be wrong with a configuration, and where.
use core::fmt;

/// A configuration value that cannot be flown, with the field that holds it.
///
/// Configuration is checked once, when a part is built; after that no step fails because of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// Path of the field, e.g. `filter.gyro.tau_s`.
    pub field: &'static str,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What is wrong with a configuration value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    /// NaN or infinite.
    NotFinite,
    /// Must be greater than zero.
    NotPositive,
    /// Outside the range in which the algorithm is valid.
    OutOfRange,
    /// The geometry of the axes cannot serve; the reason is given.
    Geometry(&'static str),
    /// There is nothing yet that it could belong to.
    BeforeConfiguration,
}

impl ConfigError {
    /// An error in `field`.
    pub const fn new(field: &'static str, problem: Problem) -> Self {
        Self { field, problem }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.field, self.problem)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Problem::NotFinite => "is not a finite number",
            Problem::NotPositive => "must be greater than zero",
            Problem::OutOfRange => "is outside the range in which the algorithm is valid",
            Problem::Geometry(reason) => reason,
            Problem::BeforeConfiguration => "comes before any configuration of the module",
        })
    }
}

impl core::error::Error for ConfigError {}
