//! What the flight module can do about an effect.

/// Whether an effect is compensated in flight.
#[derive(Clone, Copy, Debug)]
pub enum InFlight {
    /// By terms proportional to the product of two quantities.
    Term([Part; 2]),
    /// By one of several, by the word of its parameter `axis`.
    ByAxis(&'static [(&'static str, [Part; 2])]),
    /// Not at all, and why.
    Never(&'static str),
}

/// What a term is proportional to, as the catalogue speaks of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Nothing.
    One,
    /// Temperature about its reference, to a power.
    Temperature(u8),
    /// The rate of the temperature.
    TemperatureRate,
    /// The difference of two thermometers.
    TemperatureDifference,
    /// The sensor's own input, to a power.
    Input(u8),
    /// The magnitude of that.
    InputMagnitude,
    /// The same quantity as the sensor's, along the body axis that the parameter `axis` names.
    InputAcross,
    /// Specific force along that axis.
    ForceAcross,
    /// Specific force along an axis of the gyro.
    Force(GyroAxis),
    /// Rate about an axis of the gyro.
    Rate(GyroAxis),
}

/// Axes of a gyro.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroAxis {
    /// The one that it senses.
    Input,
    /// The one across input and spin axis.
    Other,
    /// The one about which its rotor spins.
    Spin,
}

/// Of what is a function of time.
pub const OF_THIS_RECORD: InFlight =
    InFlight::Never("it is a function of the time in this recording, which says nothing of the next flight");
/// Of what depends on the past.
pub const HAS_A_MEMORY: InFlight = InFlight::Never("it has a memory, and the terms of the block have none");
/// Of what follows a quantity that only the recording has.
pub const IS_NOT_TOLD: InFlight = InFlight::Never("the flight module is not told the quantity");
/// Of what follows changes of the motion.
pub const WITHIN_A_STEP: InFlight =
    InFlight::Never("it follows changes of the motion within a step of the flight module");
/// Of oscillations.
pub const OF_UNKNOWN_PHASE: InFlight = InFlight::Never("its phase in the next flight is not known");
/// Of what is no error of a sensor.
pub const OF_THE_PLACE: InFlight =
    InFlight::Never("it belongs to the place and the attitude of this recording, not to a sensor");
/// Of failures.
pub const IS_A_FAILURE: InFlight =
    InFlight::Never("nothing can be taken off; isolation and health monitor deal with it");
/// Of noise.
pub const IS_NOISE: InFlight = InFlight::Never("it is noise, which the flight module identifies by itself");
/// Of all else.
pub const HAS_NO_TERM: InFlight = InFlight::Never("the block has no term for it");
