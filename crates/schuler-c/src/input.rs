//! What comes in each step.
use bytemuck::{Pod, Zeroable};
use schuler_core::module::{ACCELEROMETERS, Command, GYROS, StepInput, THERMOMETERS};
use schuler_core::reading::{Quality, Reading};

/// Number of gyros in the block.
pub const SCHULER_GYROS: usize = 5;
/// Number of accelerometers.
pub const SCHULER_ACCELEROMETERS: usize = 3;
/// Number of thermometers.
pub const SCHULER_THERMOMETERS: usize = 4;
/// Size of an input, bytes.
pub const SCHULER_INPUT_SIZE: usize = 224;

const _: () = assert!(size_of::<SchulerInput>() == SCHULER_INPUT_SIZE);
const _: () = assert!(SCHULER_GYROS == GYROS && SCHULER_ACCELEROMETERS == ACCELEROMETERS);
const _: () = assert!(SCHULER_THERMOMETERS == THERMOMETERS);

/// What the interface electronics say of a reading: one of SCHULER_QUALITY_. Any other number counts as missing.
pub type SchulerQuality = u8;
/// No value this step. The quality of an input of zeros.
pub const SCHULER_QUALITY_MISSING: SchulerQuality = 0;
/// Converted and within range.
pub const SCHULER_QUALITY_GOOD: SchulerQuality = 1;
/// At the end of the converter's range: the true value is at least this large.
pub const SCHULER_QUALITY_SATURATED: SchulerQuality = 2;

/// A command from the ground: one of SCHULER_COMMAND_. Any other number counts as none.
pub type SchulerCommand = u8;
/// Nothing.
pub const SCHULER_COMMAND_NONE: SchulerCommand = 0;
/// Take the gyro command_gyro, counted from zero, back into the block. A number that no gyro has is refused in the output, by
/// SCHULER_ISOLATION_COMMAND_REJECTED.
pub const SCHULER_COMMAND_READMIT_GYRO: SchulerCommand = 1;

/// One reading in double precision. A value that is not a number counts as missing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerReading {
    /// The value, in the unit of the channel; looked at only where the quality is good.
    pub value: f64,
    /// Age of the value at the instant of the step, milliseconds. Readings older than the configuration allows are not used.
    pub age_ms: u32,
    /// What the interface electronics say of the value.
    pub quality: SchulerQuality,
    /// Not looked at.
    pub reserved: [u8; 3],
}

/// One reading in single precision. A value that is not a number counts as missing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerReadingSingle {
    /// The value, in the unit of the channel; looked at only where the quality is good.
    pub value: f32,
    /// Age of the value at the instant of the step, milliseconds. Readings older than the configuration allows are not used.
    pub age_ms: u32,
    /// What the interface electronics say of the value.
    pub quality: SchulerQuality,
    /// Not looked at.
    pub reserved: [u8; 3],
}

/// What the navigation computer hands over once a second. All zeros are an input without readings at time zero. Whatever the bytes,
/// the module stays usable.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerInput {
    /// Time of the step since power-on, milliseconds. The module has no other clock: a gap is a gap in these times.
    pub time_ms: u64,
    /// Rates of the gyros along their input axes, rad/s.
    pub gyros: [SchulerReading; SCHULER_GYROS],
    /// Specific forces along the accelerometers' input axes, m/s^2. Only the compensation looks at them.
    pub accelerometers: [SchulerReading; SCHULER_ACCELEROMETERS],
    /// Inertial velocity minus reference velocity in the channel, m/s.
    pub velocity_error: SchulerReadingSingle,
    /// Temperatures, degrees Celsius.
    pub thermometers: [SchulerReadingSingle; SCHULER_THERMOMETERS],
    /// Velocity that a radio sensor (Doppler, satellite) measures, m/s; for the health monitor.
    pub radio_velocity: SchulerReadingSingle,
    /// Velocity along the same axis from an inertial sensor, m/s; for the health monitor. Of both only the difference counts.
    pub inertial_velocity: SchulerReadingSingle,
    /// A command from the ground, carried out in the step that brings it.
    pub command: SchulerCommand,
    /// The gyro that the command is about, counted from zero.
    pub command_gyro: u8,
    /// Not looked at.
    pub reserved: [u8; 2],
}

fn quality(number: SchulerQuality) -> Quality {
    match number {
        SCHULER_QUALITY_GOOD => Quality::Good,
        SCHULER_QUALITY_SATURATED => Quality::Saturated,
        _ => Quality::Missing,
    }
}

impl From<SchulerReading> for Reading<f64> {
    fn from(reading: SchulerReading) -> Self {
        Self { value: reading.value, age_ms: reading.age_ms, quality: quality(reading.quality) }
    }
}

impl From<SchulerReadingSingle> for Reading<f32> {
    fn from(reading: SchulerReadingSingle) -> Self {
        Self { value: reading.value, age_ms: reading.age_ms, quality: quality(reading.quality) }
    }
}

impl From<&SchulerInput> for StepInput {
    fn from(input: &SchulerInput) -> Self {
        Self {
            time_ms: input.time_ms,
            velocity_error: input.velocity_error.into(),
            gyros: input.gyros.map(Into::into),
            accelerometers: input.accelerometers.map(Into::into),
            thermometers: input.thermometers.map(Into::into),
            radio_velocity: input.radio_velocity.into(),
            inertial_velocity: input.inertial_velocity.into(),
            command: match input.command {
                SCHULER_COMMAND_READMIT_GYRO => Command::ReadmitGyro(input.command_gyro),
                _ => Command::None,
            },
        }
    }
}
