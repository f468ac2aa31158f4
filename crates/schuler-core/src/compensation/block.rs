//! What is loaded: the calibration of a complete unit, and single terms.
use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, Problem};
use crate::filter::positive;
use crate::module::{ACCELEROMETERS, GYROS, THERMOMETERS};
use crate::saved::saved;
use crate::thermal::{self, CompensationBlock};

/// Version of a block's meaning. A block of another version is refused as a whole.
pub const BLOCK_VERSION: u16 = 2;
/// Most terms of a block: ten for each of five gyros, seven for each of three accelerometers, nine for the velocity channel.
pub const MAX_TERMS: usize = 80;
/// Largest scale-factor error of one sensor over the range of validity.
const SCALE_LIMIT: f32 = 0.2;
/// Highest power of a factor.
const MAX_POWER: u8 = 3;

/// Everything that is known of the sensors' errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Thermal model of a complete unit, taken off first.
    pub calibration: Option<Calibration>,
    /// Where the terms hold.
    pub validity: Validity,
    /// Corrections by the terms are held within these.
    pub limits: Limits,
    /// Single effects; those on one target add up.
    pub terms: Vec<Term, MAX_TERMS>,
}

/// Thermal model of a complete unit, whose triads are gyros 0 to 2 and the accelerometers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The thermometer whose temperature and rate the coefficients are functions of. There is no gradient in flight.
    pub thermometer: u8,
    /// The coefficients.
    pub coefficients: CompensationBlock,
}

/// Where the terms hold. Outside, temperatures are held a quarter of the range beyond its ends and rates at one and a half
/// times their limit, with a flag.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validity {
    /// Lowest and highest temperature, degC.
    pub temperature_range: [f32; 2],
    /// Largest magnitude of a temperature's rate, degC/s.
    pub rate_limit: f32,
}

impl Default for Validity {
    fn default() -> Self {
        Self { temperature_range: [-60.0, 85.0], rate_limit: 60.0 / 3600.0 }
    }
}

/// Largest corrections by terms. What would go beyond is held there, with a flag: a compensation is small, and one that is not
/// comes from a block for another unit or from an input that is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Of a gyro, and of the drift in the Schuler loop, rad/s.
    pub gyro: f32,
    /// Of an accelerometer, and of the accelerometer error in the Schuler loop, m/s².
    pub accelerometer: f32,
    /// Of the velocity error, m/s.
    pub velocity: f32,
}

impl Default for Limits {
    fn default() -> Self {
        Self { gyro: 0.1, accelerometer: 1.0, velocity: 100.0 }
    }
}

/// One effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Term {
    /// What it disturbs.
    pub target: Target,
    /// In the target's unit over the units of the factors.
    pub coefficient: f32,
    /// What it is proportional to; a default factor is one.
    pub factors: [Factor; 2],
}

/// What a term disturbs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Target {
    /// The output of a gyro, rad/s.
    Gyro(u8),
    /// The output of an accelerometer, m/s².
    Accelerometer(u8),
    /// The velocity error that the module is given, m/s.
    Velocity,
    /// The accelerometer within the Schuler loop, m/s².
    LoopAccelerometer,
    /// The gyro within the Schuler loop, rad/s.
    LoopGyro,
}

impl Default for Target {
    fn default() -> Self {
        Self::Gyro(0)
    }
}

/// The first place of the accelerometers among the targets, and that of the velocity.
const ACCELEROMETER: usize = GYROS;
const VELOCITY: usize = ACCELEROMETER + ACCELEROMETERS;
/// Targets that are signals of the module.
pub(super) const SIGNALS: usize = VELOCITY + 1;
/// All targets, those within the loop behind the signals.
pub(super) const TARGETS: usize = SIGNALS + 2;

impl Target {
    /// Its place in the list of targets.
    pub(super) fn place(self) -> usize {
        match self {
            Self::Gyro(gyro) => usize::from(gyro),
            Self::Accelerometer(one) => ACCELEROMETER + usize::from(one),
            Self::Velocity => VELOCITY,
            Self::LoopAccelerometer => SIGNALS,
            Self::LoopGyro => SIGNALS + 1,
        }
    }

    /// Whether it belongs to the velocity channel.
    pub(crate) fn is_of_velocity(self) -> bool {
        matches!(self, Self::Velocity | Self::LoopAccelerometer | Self::LoopGyro)
    }
}

/// `(quantity − reference)^power`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Factor {
    /// The quantity.
    pub quantity: Quantity,
    /// What is taken off it, in its unit.
    pub reference: f32,
    /// 1, 2 or 3.
    pub power: u8,
}

impl Default for Factor {
    fn default() -> Self {
        Self { quantity: Quantity::One, reference: 0.0, power: 1 }
    }
}

impl From<Quantity> for Factor {
    fn from(quantity: Quantity) -> Self {
        Self { quantity, ..Self::default() }
    }
}

/// What a term may be proportional to. Signals are those after correction: the sensors' inputs, not their outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// 1.
    #[default]
    One,
    /// A thermometer's temperature, degC.
    Temperature(u8),
    /// Its rate, degC/s.
    TemperatureRate(u8),
    /// Temperature of the first less that of the second, degC.
    TemperatureDifference(u8, u8),
    /// Rate along a gyro's axis, rad/s.
    Rate(u8),
    /// Specific force along an accelerometer's axis, m/s².
    SpecificForce(u8),
    /// The target's own input, in its unit; not for targets within the loop.
    Input,
    /// Its magnitude.
    InputMagnitude,
}

impl Block {
    /// What it says beside its terms.
    pub fn head(&self) -> BlockHead {
        let Self { calibration, validity, limits, .. } = *self;
        BlockHead { calibration, validity, limits }
    }

    /// Checks everything.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.head().validate(self.terms.iter().copied())
    }
}

/// What a block says beside its terms, for who has no memory for all of these: they may come one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BlockHead {
    /// As in [`Block`].
    pub calibration: Option<Calibration>,
    /// As in [`Block`].
    pub validity: Validity,
    /// As in [`Block`].
    pub limits: Limits,
}

impl BlockHead {
    /// Checks everything.
    ///
    /// # Errors
    /// The first field that cannot be flown, or too many terms.
    pub fn validate(&self, terms: impl Iterator<Item = Term>) -> Result<(), ConfigError> {
        if let Some(calibration) = &self.calibration {
            index("compensation.calibration.thermometer", calibration.thermometer, THERMOMETERS)?;
            thermal::Compensator::try_build(&calibration.coefficients)?;
        }
        self.validity.check()?;
        positive("compensation.limits.gyro", self.limits.gyro)?;
        positive("compensation.limits.accelerometer", self.limits.accelerometer)?;
        positive("compensation.limits.velocity", self.limits.velocity)?;
        let mut scales = [0.0; SIGNALS];
        for (count, term) in terms.enumerate() {
            within("compensation.terms", count < MAX_TERMS)?;
            term.check()?;
            if let Some(scale) = scales.get_mut(term.target.place()) {
                *scale += term.largest_scale(&self.validity);
            }
        }
        // Within it the correction, which is found by repeated substitution, is exact to 10⁻³ of itself.
        within("compensation.terms.coefficient", scales.iter().all(|scale| *scale <= SCALE_LIMIT))
    }
}

impl Validity {
    fn check(&self) -> Result<(), ConfigError> {
        let [low, high] = self.temperature_range;
        finite("compensation.validity.temperature_range", low)?;
        finite("compensation.validity.temperature_range", high)?;
        within("compensation.validity.temperature_range", -100.0 <= low && low <= high && high <= 200.0)?;
        finite("compensation.validity.rate_limit", self.rate_limit)?;
        within("compensation.validity.rate_limit", self.rate_limit >= 0.0)
    }

    /// The ends at which temperatures are held, degC.
    pub(super) fn temperature_ends(&self) -> [f32; 2] {
        let [low, high] = self.temperature_range;
        let margin = 0.25 * (high - low);
        [low - margin, high + margin]
    }

    /// The magnitude at which rates are held, degC/s.
    pub(super) fn largest_rate(&self) -> f32 {
        1.5 * self.rate_limit
    }
}

impl Term {
    fn check(&self) -> Result<(), ConfigError> {
        finite("compensation.terms.coefficient", self.coefficient)?;
        match self.target {
            Target::Gyro(gyro) => index("compensation.terms.target", gyro, GYROS)?,
            Target::Accelerometer(one) => index("compensation.terms.target", one, ACCELEROMETERS)?,
            Target::Velocity | Target::LoopAccelerometer | Target::LoopGyro => (),
        }
        for factor in &self.factors {
            finite("compensation.terms.reference", factor.reference)?;
            within("compensation.terms.power", (1..=MAX_POWER).contains(&factor.power))?;
            let field = "compensation.terms.quantity";
            match factor.quantity {
                Quantity::One => (),
                Quantity::Temperature(one) | Quantity::TemperatureRate(one) => {
                    index(field, one, THERMOMETERS)?;
                }
                Quantity::TemperatureDifference(one, other) => {
                    index(field, one, THERMOMETERS)?;
                    index(field, other, THERMOMETERS)?;
                }
                Quantity::Rate(gyro) => index(field, gyro, GYROS)?,
                Quantity::SpecificForce(one) => index(field, one, ACCELEROMETERS)?,
                Quantity::Input | Quantity::InputMagnitude => {
                    let within_loop = matches!(self.target, Target::LoopAccelerometer | Target::LoopGyro);
                    within(field, !within_loop)?;
                }
            }
        }
        Ok(())
    }

    /// Largest scale-factor error that the term makes within the validity; zero if it is of another kind.
    fn largest_scale(&self, validity: &Validity) -> f32 {
        let own = |factor: &Factor| {
            matches!(factor.quantity, Quantity::Input | Quantity::InputMagnitude) && factor.power == 1
        };
        let [first, second] = &self.factors;
        let other = match (own(first), own(second)) {
            (true, false) => second,
            (false, true) => first,
            _ => return 0.0,
        };
        (self.coefficient * other.largest(validity)).abs()
    }
}

impl Factor {
    /// Largest magnitude within the validity; zero where that does not bound it.
    fn largest(self, validity: &Validity) -> f32 {
        let [low, high] = validity.temperature_ends();
        let [low, high] = match self.quantity {
            Quantity::One => [1.0; 2],
            Quantity::Temperature(_) => [low, high],
            Quantity::TemperatureRate(_) => [-validity.largest_rate(), validity.largest_rate()],
            Quantity::TemperatureDifference(..) => [low - high, high - low],
            _ => return 0.0,
        };
        power((low - self.reference).abs().max((high - self.reference).abs()), self.power)
    }
}

/// x, x² or x³.
pub(super) fn power(x: f32, power: u8) -> f32 {
    x * if power >= 2 { x } else { 1.0 } * if power >= 3 { x } else { 1.0 }
}

fn finite(field: &'static str, value: f32) -> Result<(), ConfigError> {
    if value.is_finite() { Ok(()) } else { Err(ConfigError::new(field, Problem::NotFinite)) }
}

fn within(field: &'static str, holds: bool) -> Result<(), ConfigError> {
    if holds { Ok(()) } else { Err(ConfigError::new(field, Problem::OutOfRange)) }
}

fn index(field: &'static str, value: u8, count: usize) -> Result<(), ConfigError> {
    within(field, usize::from(value) < count)
}

saved!([] Validity { temperature_range, rate_limit });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_terms_than_a_block_has_are_refused() {
        let terms = |count| core::iter::repeat_n(Term::default(), count);
        let head = BlockHead::default();
        assert_eq!(head.validate(terms(MAX_TERMS)), Ok(()));
        let error = ConfigError::new("compensation.terms", Problem::OutOfRange);
        assert_eq!(head.validate(terms(MAX_TERMS + 1)), Err(error));
    }
}
