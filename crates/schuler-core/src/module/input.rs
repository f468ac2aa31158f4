//! What comes in each step.
use serde::{Deserialize, Serialize};

use super::{ACCELEROMETERS, GYROS, THERMOMETERS};
use crate::reading::Reading;

/// What the navigation computer hands over once a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepInput {
    /// Time of the step since power-on, milliseconds.
    pub time_ms: u64,
    /// Inertial velocity minus reference velocity in the channel, m/s.
    pub velocity_error: Reading<f32>,
    /// Rates of the gyros along their input axes, rad/s.
    pub gyros: [Reading<f64>; GYROS],
    /// Specific forces along the accelerometers' input axes, m/s². Only the compensation looks at them.
    pub accelerometers: [Reading<f64>; ACCELEROMETERS],
    /// Temperatures, degC.
    pub thermometers: [Reading<f32>; THERMOMETERS],
    /// Velocity that a radio sensor (Doppler, satellite) measures, m/s; for the health monitor.
    pub radio_velocity: Reading<f32>,
    /// Velocity along the same axis from an inertial sensor, m/s; for the health monitor. Of both only the difference
    /// counts: they may be given relative to any common velocity.
    pub inertial_velocity: Reading<f32>,
    /// A command from the ground.
    pub command: Command,
}

impl StepInput {
    /// The input of a step for which nothing came.
    pub fn without_readings(time_ms: u64) -> Self {
        Self { time_ms, ..Self::default() }
    }
}

/// A command from the ground, carried out in the step that brings it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Nothing.
    #[default]
    None,
    /// Take a gyro that was declared faulty back into the block.
    ReadmitGyro(u8),
}
