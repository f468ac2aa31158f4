//! The physics that a simulation can have left out, as data.
//!
//! | module | rows |
//! | --- | --- |
//! | `additive` | what time alone makes: constants, steps, drifts, warm-up, lines |
//! | `thermal` | temperature, its rate, difference and history |
//! | `environment` | supply, field, pressure, vibration, pick-off, any recorded quantity |
//! | `general` | functions of recorded quantities, for sensors of any kind |
//! | `input` | scale factor and its non-linearity, misalignment, cross coupling, dead zone |
//! | `g_sensitivity` | drift of gyros with specific force and its products |
//! | `rotation` | rates and forces other than the sensor's own input, and their past |
//! | `instrument` | time, bandwidth and place of a whole instrument, its attitude against the Earth |
//! | `gravity`, `tide` | anomaly of gravity, tide of the solid Earth |
//! | `failures` | stuck, clipped, coarse or jumping readings |
//! | `noise` | another random part |
//! | `setup`, `heading` | what is simply wrong in a case, and the noise of its reference |
//! | `unnamed` | what is in no catalogue, as a rival of all that is |
//! | `user`, `formula` | what the case itself defines by a formula |
//!
//! `in_flight` says what the flight module can do about an effect, `form` how it is computed outside.
mod additive;
mod draft;
mod effect;
mod environment;
mod failures;
mod form;
mod formula;
mod g_sensitivity;
mod general;
mod gravity;
mod heading;
mod in_flight;
mod input;
mod instrument;
mod noise;
mod rotation;
mod setup;
mod thermal;
mod tide;
mod unnamed;
mod user;

pub(crate) use additive::schuler_rate;
pub(crate) use effect::IN_COMMON;
pub use effect::{
    AT_MEAN, AT_START, Amplitude, Candidate, Column, Effect, NoiseChange, Nonlinear, OnsetShape, Port,
    ReadingFault, Search, Signature, SignatureOf, Target, share_equal_series,
};
pub(crate) use environment::EQUATORIAL_FIELD;
pub use form::Form;
pub use in_flight::{GyroAxis, HAS_NO_TERM, InFlight, Part};
pub(crate) use instrument::{rate_over_earth, straight_on};
pub use user::of_case;

use crate::nominal::Model;

/// Effects whose signatures are of the motion: what an instrument's readings make of it comes as late as the readings.
const OF_THE_MOTION: &[&str] = &[
    failures::OUTPUT_SATURATED.id,
    input::DEAD_ZONE.id,
    input::SCALE_FACTOR.id,
    input::SCALE_FACTOR_ASYMMETRY.id,
    input::SCALE_FACTOR_QUADRATIC.id,
    input::SCALE_FACTOR_CUBIC.id,
    input::SCALE_FACTOR_ODD_QUADRATIC.id,
    input::MISALIGNMENT.id,
    input::CROSS_COUPLING.id,
    thermal::SCALE_FACTOR_TEMPERATURE.id,
    thermal::MISALIGNMENT_TEMPERATURE.id,
    thermal::G_MASS_UNBALANCE_TEMPERATURE.id,
    g_sensitivity::G_MASS_UNBALANCE.id,
    g_sensitivity::G_QUADRATURE.id,
    g_sensitivity::G_SPIN.id,
    g_sensitivity::G2_ANISOELASTICITY.id,
    g_sensitivity::G2_CROSS.id,
    rotation::TORQUER_SELF_HEATING.id,
    rotation::POST_G_TRANSIENT.id,
    rotation::ANISOINERTIA.id,
    rotation::ANGULAR_ACCELERATION.id,
    rotation::RATE_CROSS_AXIS.id,
    rotation::CONING_SCULLING.id,
    instrument::BANDWIDTH_LAG.id,
    instrument::CLOCK_DRIFT.id,
    instrument::LEVER_ARM.id,
    instrument::EARTH_RATE_ATTITUDE.id,
    setup::SIGN_FLIPPED.id,
    setup::AXES_SWAPPED.id,
    setup::UNIT_MISTAKEN.id,
    setup::GRAVITY_REMOVED.id,
    heading::HEADING_OFF.id,
];

impl Effect {
    /// Whether its signature is of the motion.
    pub fn is_of_the_motion(&self) -> bool {
        OF_THE_MOTION.contains(&self.id)
    }

    /// Whether it stands for what is in no catalogue.
    pub fn is_unnamed(&self) -> bool {
        self.id == unnamed::UNNAMED.id
    }

    /// Whether it is another random part, isolated readings among them.
    pub fn is_noise(&self) -> bool {
        self.id.starts_with("noise_")
    }

    /// Whether it is isolated readings far from the others.
    pub fn is_outliers(&self) -> bool {
        self.id == noise::NOISE_OUTLIERS.id
    }

    /// Whether it is an output in steps.
    pub fn is_coarse_output(&self) -> bool {
        self.id == failures::QUANTISATION.id
    }

    /// Whether its one parameter is a delay of the readings.
    pub fn is_a_delay(&self) -> bool {
        self.id == instrument::TIME_DELAY.id
    }
}

/// What is in no catalogue.
pub const UNNAMED: &Effect = &unnamed::UNNAMED;

/// What is no error of a sensor: what is simply wrong in a case, the noise of its reference, and clocks that go apart.
pub const SETUP: &[&Effect] = &[
    &setup::SIGN_FLIPPED,
    &setup::AXES_SWAPPED,
    &setup::UNIT_MISTAKEN,
    &setup::GRAVITY_REMOVED,
    &setup::REFERENCE_NOISE,
    &instrument::CLOCK_DRIFT,
    &heading::HEADING_OFF,
];

/// Effects that readings show of themselves.
pub const OF_READINGS: &[Effect] = &[
    failures::OUTPUT_STUCK,
    failures::OUTPUT_SATURATED,
    failures::QUANTISATION,
    failures::INTERMITTENT_JUMP,
    noise::NOISE_OUTLIERS,
];

/// Every effect known.
pub const CATALOGUE: &[Effect] = &[
    additive::BIAS_CONSTANT,
    additive::BIAS_STEP,
    additive::BIAS_DRIFT_LINEAR,
    additive::BIAS_WARMUP,
    thermal::BIAS_TEMPERATURE,
    thermal::BIAS_TEMPERATURE_SQ,
    thermal::BIAS_TEMPERATURE_CUBIC,
    thermal::BIAS_TEMPERATURE_RATE,
    thermal::BIAS_THERMAL_LAG,
    thermal::BIAS_TEMPERATURE_GRADIENT,
    thermal::BIAS_THERMAL_HYSTERESIS,
    environment::BIAS_SUPPLY_VOLTAGE,
    environment::BIAS_MAGNETIC_FIELD,
    thermal::BIAS_ELECTRONICS_TEMPERATURE,
    environment::BIAS_PICKOFF_OFFSET,
    additive::BIAS_RESTART,
    environment::BIAS_PRESSURE,
    environment::BIAS_ON_AUX,
    additive::PERIODIC_LINE,
    additive::SCHULER_OSCILLATION,
    failures::OUTPUT_STUCK,
    failures::OUTPUT_SATURATED,
    input::DEAD_ZONE,
    failures::QUANTISATION,
    failures::INTERMITTENT_JUMP,
    input::SCALE_FACTOR,
    input::SCALE_FACTOR_ASYMMETRY,
    input::SCALE_FACTOR_QUADRATIC,
    input::SCALE_FACTOR_CUBIC,
    thermal::SCALE_FACTOR_TEMPERATURE,
    input::MISALIGNMENT,
    thermal::MISALIGNMENT_TEMPERATURE,
    input::CROSS_COUPLING,
    g_sensitivity::G_MASS_UNBALANCE,
    g_sensitivity::G_QUADRATURE,
    g_sensitivity::G_SPIN,
    g_sensitivity::G2_ANISOELASTICITY,
    g_sensitivity::G2_CROSS,
    thermal::G_MASS_UNBALANCE_TEMPERATURE,
    rotation::TORQUER_SELF_HEATING,
    rotation::POST_G_TRANSIENT,
    input::SCALE_FACTOR_ODD_QUADRATIC,
    environment::VIBRATION_RECTIFICATION,
    rotation::ANISOINERTIA,
    rotation::ANGULAR_ACCELERATION,
    rotation::RATE_CROSS_AXIS,
    rotation::CONING_SCULLING,
    instrument::TIME_DELAY,
    instrument::BANDWIDTH_LAG,
    instrument::LEVER_ARM,
    instrument::EARTH_RATE_ATTITUDE,
    gravity::GRAVITY_ANOMALY,
    gravity::EARTH_TIDE,
    noise::NOISE_WHITE,
    noise::NOISE_MARKOV,
    noise::NOISE_EXP_COS,
    noise::NOISE_RANDOM_WALK,
    noise::NOISE_FLICKER,
    noise::NOISE_ANGLE_QUANTISATION,
    noise::NOISE_VARIANCE_STEP,
    noise::NOISE_OUTLIERS,
];

/// The row of an identifier, of the catalogue or of what may be wrong in a case.
pub fn named(id: &str) -> Option<&'static Effect> {
    CATALOGUE.iter().chain(SETUP.iter().copied()).find(|effect| effect.id == id)
}

/// Name of what a candidate acts on.
pub fn target_name(model: &Model, candidate: &Candidate) -> String {
    match &candidate.target {
        Target::Group { name, .. } => name.clone(),
        Target::Sensor(sensor) => model
            .source_of(*sensor, candidate.port)
            .and_then(|source| model.sources.get(source))
            .map_or_else(String::new, |source| source.name.clone()),
    }
}
