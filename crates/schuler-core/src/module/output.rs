//! What comes out each step.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use super::{HEALTH_LEVELS, THERMOMETERS};
use crate::compensation::Compensation;
use crate::filter::FilterOutput;
use crate::health::HealthOutput;
use crate::identification::IdentificationOutput;
use crate::isolation::IsolationOutput;
use crate::saved::saved_flags;
use crate::thermal::TemperatureRateOutput;

/// What the module gives back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepOutput {
    /// Steps since configuration, this one included.
    pub step: u64,
    /// Time of the step, as it came in.
    pub time_ms: u64,
    /// What was out of the ordinary.
    pub status: Status,
    /// Error filter with the noise parameters in use. The estimate includes what the compensation knows.
    pub filter: FilterOutput<f32>,
    /// Noise identification.
    pub identification: IdentificationOutput,
    /// Gyro block.
    pub isolation: IsolationOutput,
    /// Temperature and its rate at each thermometer.
    pub thermometers: [TemperatureRateOutput<f32>; THERMOMETERS],
    /// Corrected gyros and accelerometers.
    pub compensation: Compensation,
    /// Radio sensor against inertial sensor.
    pub health: HealthOutput<f32, HEALTH_LEVELS>,
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
        /// Steps were missing before this one; the filter has coasted over them.
        const STEPS_MISSING = 1 << 6;
        /// More steps were missing than can be bridged, or the clock has jumped: the velocity started from the
        /// measurement and the identification anew.
        const CLOCK_JUMPED = 1 << 7;
        /// So many innovations in a row were beyond the gate that the filter started from the measurement.
        const VELOCITY_REACQUIRED = 1 << 8;
        /// The filter was retuned after this step's measurement.
        const RETUNED = 1 << 9;
        /// The module has no configuration; nothing was computed.
        const NOT_CONFIGURED = 1 << 10;
        /// A compensation block was loaded before this step.
        const COMPENSATION_LOADED = 1 << 11;
        /// That block, or the one before it, acts on the velocity channel, which has therefore started anew.
        const VELOCITY_RESTARTED = 1 << 12;
        /// The velocity measurement could have been used and was not, as the radio behind it is held faulty.
        const VELOCITY_WITHHELD = 1 << 13;
    }
}

saved_flags!(Status);
