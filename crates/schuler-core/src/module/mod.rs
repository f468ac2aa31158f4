//! The one fixed step.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, Problem};
use crate::filter::{FilterConfig, FilterOutput, MarkovNoise};
use crate::identification::{IdentificationConfig, IdentificationOutput};
use crate::isolation::{FaultIsolation, IsolationConfig, IsolationOutput};
use crate::reading::Reading;

/// Number of gyros in the block.
pub const GYROS: usize = 5;

/// What the navigation computer hands over once a second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepInput {
    /// Time of the step since power-on, milliseconds.
    pub time_ms: u64,
    /// Inertial velocity minus reference velocity in the channel, m/s.
    pub velocity_error: Reading<f32>,
    /// Rates of the gyros along their input axes, rad/s.
    pub gyros: [Reading<f64>; GYROS],
    /// A command from the ground.
    pub command: Command,
}

impl StepInput {
    /// The input of a step for which nothing came.
    pub fn without_readings(time_ms: u64) -> Self {
        Self {
            time_ms,
            velocity_error: Reading::missing(),
            gyros: [Reading::missing(); GYROS],
            command: Command::None,
        }
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

/// What the module gives back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepOutput {
    /// Steps since configuration, this one included.
    pub step: u64,
    /// Time of the step, as it came in.
    pub time_ms: u64,
    /// What was out of the ordinary.
    pub status: Status,
    /// Error filter with the noise parameters in use.
    pub filter: FilterOutput<f32>,
    /// Noise identification.
    pub identification: IdentificationOutput,
    /// Gyro block.
    pub isolation: IsolationOutput,
}

bitflags! {
    /// What was out of the ordinary in a step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Status: u32 {
        /// No usable velocity measurement: missing or not a number.
        const VELOCITY_MISSING = 1;
        /// The velocity measurement was at the end of its range and was not used.
        const VELOCITY_SATURATED = 1 << 1;
        /// The velocity measurement was too old and was not used.
        const VELOCITY_STALE = 1 << 2;
        /// The innovation was beyond the gate and was not used.
        const INNOVATION_GATED = 1 << 3;
        /// The covariance lost its positive diagonal and was reset.
        const COVARIANCE_RESET = 1 << 4;
        /// The time of the step ran backwards or repeated; the step was taken as one nominal step without measurement.
        const CLOCK_BACKWARDS = 1 << 5;
        /// Steps were missing before this one.
        const STEPS_MISSING = 1 << 6;
    }
}

/// Everything that the module can be told before the flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModuleConfig {
    /// Error filter.
    pub filter: FilterConfig<f32>,
    /// Noise identification.
    pub identification: IdentificationConfig,
    /// Gyro block.
    pub isolation: IsolationConfig,
    /// Readings older than this are not used, milliseconds.
    pub max_age_ms: u32,
}

impl Default for ModuleConfig {
    fn default() -> Self {
        Self {
            filter: FilterConfig {
                radius_m: 6_371_000.0,
                gravity: 9.80665,
                step_s: 1.0,
                accelerometer: MarkovNoise { sigma: 9.80665e-4, tau_s: 60.0 },
                gyro: MarkovNoise { sigma: 4.84814e-7, tau_s: 1800.0 },
                velocity_noise: 0.1,
                initial_velocity_sigma: 0.1,
                initial_vertical_sigma: 1e-4,
                gate_sigma: 6.0,
            },
            identification: IdentificationConfig::default(),
            isolation: IsolationConfig::CONE,
            max_age_ms: 1500,
        }
    }
}

/// The flight module's whole state.
#[derive(Clone, Copy, Debug)]
pub struct FlightModule {
    steps: u64,
    isolation: FaultIsolation,
}

impl Default for FlightModule {
    fn default() -> Self {
        Self::new()
    }
}

impl FlightModule {
    /// A module with the default configuration; a constant, so that it can live in a static.
    pub const fn new() -> Self {
        Self { steps: 0, isolation: FaultIsolation {} }
    }

    /// Checks the configuration and starts afresh with it, in place. On error nothing has changed.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn configure(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        *self = Self::try_build(config)?;
        Ok(())
    }

    /// Checks the configuration and builds the module.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn try_build(config: &ModuleConfig) -> Result<Self, ConfigError> {
        if config.filter.step_s.is_nan() || config.filter.step_s <= 0.0 {
            return Err(ConfigError::new("filter.step_s", Problem::NotPositive));
        }
        Ok(Self { steps: 0, isolation: FaultIsolation::try_build(&config.isolation)? })
    }

    /// One step. Never panics; whatever the input, the state stays usable.
    pub fn step(&mut self, input: &StepInput) -> StepOutput {
        self.steps += 1;
        StepOutput {
            step: self.steps,
            time_ms: input.time_ms,
            isolation: self.isolation.step(&input.gyros, None),
            ..StepOutput::default()
        }
    }
}
