//! Fault isolation in a block of five gyros.
use serde::{Deserialize, Serialize};

use crate::config::ConfigError;
use crate::reading::Reading;

/// Stub, replaced by the isolation work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IsolationConfig {
    /// Unit input axes of the five gyros in body axes, one row a gyro.
    pub axes: [[f64; 3]; 5],
    /// 1-σ noise of each gyro per sample, rad/s.
    pub sigma: [f64; 5],
    /// Largest rate that a gyro can report, rad/s.
    pub range: f64,
}

impl IsolationConfig {
    /// Five axes on the symmetric cone.
    pub const CONE: Self = Self {
        axes: [
            [0.97204, 0.0, -0.23482],
            [-0.60075, -0.77653, -0.18997],
            [0.0, 0.47992, 0.87731],
            [0.0, -0.47992, 0.87731],
            [-0.60075, 0.77653, -0.18997],
        ],
        sigma: [1e-7; 5],
        range: 1.0,
    };
}

/// What the isolation says each step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IsolationOutput {
    /// Body rate from the gyros in use, rad/s.
    pub rate: [f64; 3],
    /// Parity vector, rad/s.
    pub parity: [f64; 2],
}

/// The isolator's state.
#[derive(Clone, Copy, Debug)]
pub struct FaultIsolation {}

impl FaultIsolation {
    /// Build.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn try_build(_config: &IsolationConfig) -> Result<Self, ConfigError> {
        Ok(Self {})
    }

    /// One sample of the five gyros, rad/s. `readmit`: ground command to take a gyro back.
    pub fn step(&mut self, _gyros: &[Reading<f64>; 5], _readmit: Option<u8>) -> IsolationOutput {
        IsolationOutput::default()
    }
}
