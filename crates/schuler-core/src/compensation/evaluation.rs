//! The corrections of one step. The work does not depend on the block nor on the data: every place of the table is
//! evaluated three times, empty ones with a coefficient of zero.
//!
//! A term that is proportional to a sensor's input needs the input to find the output's error. It is found by
//! substitution, `u₀ = y`, `u₍ₙ₊₁₎ = y − e(uₙ)`: after three rounds a scale factor of k leaves k⁴.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use super::block::{
    Block, BlockHead, Calibration, Factor, Limits, MAX_TERMS, Quantity, SIGNALS, TARGETS, Target, Term,
    Validity, power,
};
use crate::config::ConfigError;
use crate::module::{ACCELEROMETERS, GYROS, THERMOMETERS};
use crate::saved::saved;
use crate::thermal::{self, CompensationStatus, ThermalState};

/// Rounds of substitution.
const ROUNDS: usize = 3;

/// Places in the list of quantities.
mod place {
    use super::{SIGNALS, THERMOMETERS};
    pub(super) const ZERO: usize = 0;
    pub(super) const ONE: usize = 1;
    pub(super) const TEMPERATURE: usize = 2;
    pub(super) const RATE: usize = TEMPERATURE + THERMOMETERS;
    /// The signals stand in the order of the targets.
    pub(super) const SIGNAL: usize = RATE + THERMOMETERS;
    pub(super) const COUNT: usize = SIGNAL + SIGNALS;
}

bitflags! {
    /// What limited the correction by terms.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct TermStatus: u8 {
        /// What a term is proportional to is not known: the term counted as zero.
        const INPUT_MISSING = 1;
        /// A temperature or a rate is outside the validity, and was held.
        const OUT_OF_RANGE = 1 << 1;
        /// A correction was beyond its limit and was held there, or was not a number and was left out.
        const LIMITED = 1 << 2;
    }
}

/// What is known in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// Temperatures (degC) and rates (degC/s).
    pub thermometers: [ThermalState; THERMOMETERS],
    /// Outputs of the gyros, rad/s.
    pub gyros: [Option<f64>; GYROS],
    /// Outputs of the accelerometers, m/s².
    pub accelerometers: [Option<f64>; ACCELEROMETERS],
    /// Velocity error, m/s.
    pub velocity: Option<f32>,
}

/// What a step says of the compensation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// A block is loaded; without, the corrected values are those that came in.
    pub loaded: bool,
    /// What limited the calibration of a complete unit; empty without one.
    pub calibration: CompensationStatus,
    /// What limited the terms.
    pub terms: TermStatus,
    /// Corrected rates of the gyros, rad/s; zero where there is no reading that can be used.
    pub gyros: [f64; GYROS],
    /// Corrected specific forces, m/s²; zero where there is no reading that can be used.
    pub accelerometers: [f64; ACCELEROMETERS],
    /// What was taken off the velocity error as error of its measurement, m/s.
    pub velocity: f32,
    /// Known errors within the Schuler loop: accelerometer, m/s², and gyro, rad/s.
    pub loop_errors: [f32; 2],
}

/// A checked block.
#[derive(Clone, Copy, Debug)]
pub struct Compensator {
    loaded: bool,
    has_calibration: bool,
    thermometer: u8,
    calibration: thermal::Compensator,
    validity: Validity,
    limits: [f32; TARGETS],
    products: [Product; MAX_TERMS],
    /// Quantities that a term uses, one bit each.
    used: u32,
}

/// A term, with places for names.
#[derive(Clone, Copy, Debug)]
struct Product {
    target: u8,
    coefficient: f32,
    factors: [Difference; 2],
}

/// `(plus − minus − reference)^power`.
#[derive(Clone, Copy, Debug)]
struct Difference {
    plus: u8,
    minus: u8,
    power: u8,
    magnitude: bool,
    reference: f32,
}

/// The list of quantities, and which of them are known.
#[derive(Clone, Copy)]
struct Quantities {
    values: [f32; place::COUNT],
    known: u32,
}

impl Compensator {
    /// Corrects nothing.
    pub fn none() -> Self {
        Self {
            loaded: false,
            has_calibration: false,
            thermometer: 0,
            calibration: thermal::Compensator::default(),
            validity: Validity::default(),
            limits: limits(&Limits::default()),
            products: [Product::NOTHING; MAX_TERMS],
            used: 0,
        }
    }

    /// Checks the block.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn try_build(block: &Block) -> Result<Self, ConfigError> {
        let mut all = Self::none();
        all.load(block)?;
        Ok(all)
    }

    /// Checks the block and takes it in place of the one before. On an error that one stays.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn load(&mut self, block: &Block) -> Result<(), ConfigError> {
        self.load_terms(&block.head(), block.terms.iter().copied())
    }

    /// The same of a block whose terms come one by one, twice: to be checked and to be taken.
    ///
    /// # Errors
    /// The first field that cannot be flown, or too many terms.
    pub fn load_terms(
        &mut self,
        head: &BlockHead,
        mut terms: impl Iterator<Item = Term> + Clone,
    ) -> Result<(), ConfigError> {
        head.validate(terms.clone())?;
        self.loaded = true;
        self.has_calibration = head.calibration.is_some();
        let none = Calibration::default();
        let calibration = head.calibration.as_ref().unwrap_or(&none);
        self.thermometer = calibration.thermometer;
        self.calibration = thermal::Compensator::try_build(&calibration.coefficients)?;
        self.validity = head.validity;
        self.limits = limits(&head.limits);
        self.used = 0;
        for product in &mut self.products {
            *product = terms.next().as_ref().map_or(Product::NOTHING, Product::of);
            for factor in product.factors {
                self.used |= bit(factor.plus) | bit(factor.minus);
            }
        }
        Ok(())
    }

    /// The corrections of a step. Never panics, and everything that it gives is finite.
    #[inline(never)]
    pub fn correct(&self, known: &Known) -> Compensation {
        let usable = |value: Option<f64>| value.filter(|value| value.is_finite());
        let gyros = known.gyros.map(usable);
        let accelerometers = known.accelerometers.map(usable);
        let velocity = known.velocity.filter(|value| value.is_finite());

        // The complete unit; what is missing of a triad counts as zero.
        let state = known.thermometers.get(usize::from(self.thermometer)).copied().unwrap_or_default();
        let correction = self.calibration.correction(&state);
        let [g0, g1, g2, g3, g4] = gyros.map(Option::unwrap_or_default);
        let [c0, c1, c2] = finite_or([g0, g1, g2], correction.rate([g0, g1, g2]));
        let forces = accelerometers.map(Option::unwrap_or_default);
        let [f0, f1, f2] = finite_or(forces, correction.specific_force(forces));
        let velocity_in = f64::from(velocity.unwrap_or_default());
        let calibrated = [c0, c1, c2, g3, g4, f0, f1, f2, velocity_in];

        // The terms.
        let mut status = TermStatus::empty();
        let mut quantities = self.quantities(known, &mut status);
        let present = gyros.iter().map(Option::is_some).chain(accelerometers.iter().map(Option::is_some));
        for (place, present) in (place::SIGNAL as u8..).zip(present.chain([velocity.is_some()])) {
            quantities.known |= if present { bit(place) } else { 0 };
        }
        let mut corrected = calibrated;
        let mut errors = [0.0; TARGETS];
        for _ in 0..ROUNDS {
            for (value, signal) in quantities.values.iter_mut().skip(place::SIGNAL).zip(&corrected) {
                *value = *signal as f32;
            }
            errors = self.errors(&quantities, &mut status);
            for ((corrected, calibrated), error) in corrected.iter_mut().zip(&calibrated).zip(&errors) {
                *corrected = calibrated - f64::from(*error);
            }
        }

        let [u0, u1, u2, u3, u4, a0, a1, a2, _] = corrected;
        let keep = |value: f64, reading: Option<f64>| if reading.is_some() { value } else { 0.0 };
        let [r0, r1, r2, r3, r4] = gyros;
        let [s0, s1, s2] = accelerometers;
        let error = |target: Target| errors.get(target.place()).copied().unwrap_or_default();
        Compensation {
            loaded: self.loaded,
            calibration: if self.has_calibration { correction.status } else { CompensationStatus::empty() },
            terms: status,
            gyros: [keep(u0, r0), keep(u1, r1), keep(u2, r2), keep(u3, r3), keep(u4, r4)],
            accelerometers: [keep(a0, s0), keep(a1, s1), keep(a2, s2)],
            velocity: if velocity.is_some() { error(Target::Velocity) } else { 0.0 },
            loop_errors: [error(Target::LoopAccelerometer), error(Target::LoopGyro)],
        }
    }

    /// Temperatures and rates, held within the validity.
    fn quantities(&self, known: &Known, status: &mut TermStatus) -> Quantities {
        let mut all = Quantities { values: [0.0; place::COUNT], known: 0b11 };
        let [_, one, rest @ ..] = &mut all.values;
        *one = 1.0;
        let [low, high] = self.validity.temperature_range;
        let ends = self.validity.temperature_ends();
        let temperatures = known.thermometers.map(|it| (it.temperature, [low, high], ends));
        let (limit, most) = (self.validity.rate_limit, self.validity.largest_rate());
        let rates = known.thermometers.map(|it| (it.rate, [-limit, limit], [-most, most]));
        let thermal = temperatures.into_iter().chain(rates);
        for ((place, slot), (value, range, ends)) in (place::TEMPERATURE as u8..).zip(rest).zip(thermal) {
            let value = value.filter(|value| value.is_finite());
            let held = value.unwrap_or_default();
            let outside = value.is_some() && (held < range[0] || held > range[1]);
            *slot = held.max(ends[0]).min(ends[1]);
            all.known |= if value.is_some() { bit(place) } else { 0 };
            let flagged = outside && self.used & bit(place) != 0;
            *status |= if flagged { TermStatus::OUT_OF_RANGE } else { TermStatus::empty() };
        }
        all
    }

    /// The sum of the terms on each target, within its limit. Not in line: once is enough in flash.
    #[inline(never)]
    fn errors(&self, quantities: &Quantities, status: &mut TermStatus) -> [f32; TARGETS] {
        let mut errors = [0.0; TARGETS];
        for product in &self.products {
            let (value, known) = product.of_quantities(quantities);
            // A target that is not there itself misses nothing.
            let wanted = usize::from(product.target) >= SIGNALS
                || quantities.known & bit(product.target.saturating_add(place::SIGNAL as u8)) != 0;
            let missing = wanted && !known;
            *status |= if missing { TermStatus::INPUT_MISSING } else { TermStatus::empty() };
            if let Some(error) = errors.get_mut(usize::from(product.target)) {
                *error += if known { value } else { 0.0 };
            }
        }
        for (error, limit) in errors.iter_mut().zip(self.limits) {
            let beyond = !error.is_finite() || error.abs() > limit;
            *status |= if beyond { TermStatus::LIMITED } else { TermStatus::empty() };
            *error = if error.is_finite() { error.max(-limit).min(limit) } else { 0.0 };
        }
        errors
    }
}

impl Product {
    const NOTHING: Self = Self { target: 0, coefficient: 0.0, factors: [Difference::ONE; 2] };

    fn of(term: &Term) -> Self {
        let target = term.target.place();
        let factors = term.factors.map(|factor| Difference::of(factor, target));
        Self { target: target as u8, coefficient: term.coefficient, factors }
    }

    /// Its value, and whether everything in it is known.
    fn of_quantities(&self, quantities: &Quantities) -> (f32, bool) {
        let mut product = self.coefficient;
        let mut needed = 0;
        for factor in &self.factors {
            let value = |place: u8| quantities.values.get(usize::from(place)).copied().unwrap_or_default();
            let difference = value(factor.plus) - value(factor.minus);
            let quantity = if factor.magnitude { difference.abs() } else { difference };
            product *= power(quantity - factor.reference, factor.power);
            needed |= bit(factor.plus) | bit(factor.minus);
        }
        (product, quantities.known & needed == needed)
    }
}

impl Difference {
    const ONE: Self =
        Self { plus: place::ONE as u8, minus: place::ZERO as u8, power: 1, magnitude: false, reference: 0.0 };

    fn of(factor: Factor, target: usize) -> Self {
        let at = |place: usize, index: u8| place.saturating_add(usize::from(index));
        let (plus, minus) = match factor.quantity {
            Quantity::One => (place::ONE, place::ZERO),
            Quantity::Temperature(one) => (at(place::TEMPERATURE, one), place::ZERO),
            Quantity::TemperatureRate(one) => (at(place::RATE, one), place::ZERO),
            Quantity::TemperatureDifference(one, other) => {
                (at(place::TEMPERATURE, one), at(place::TEMPERATURE, other))
            }
            Quantity::Rate(gyro) => (place::SIGNAL + Target::Gyro(gyro).place(), place::ZERO),
            Quantity::SpecificForce(one) => (place::SIGNAL + Target::Accelerometer(one).place(), place::ZERO),
            Quantity::Input | Quantity::InputMagnitude => (place::SIGNAL + target, place::ZERO),
        };
        Self {
            plus: plus as u8,
            minus: minus as u8,
            power: factor.power,
            magnitude: factor.quantity == Quantity::InputMagnitude,
            reference: factor.reference,
        }
    }
}

fn limits(limits: &Limits) -> [f32; TARGETS] {
    let Limits { gyro, accelerometer, velocity } = *limits;
    let [g, a] = [gyro, accelerometer];
    [g, g, g, g, g, a, a, a, velocity, a, g]
}

/// The bit of a place; none beyond the last.
fn bit(place: u8) -> u32 {
    1u32.checked_shl(u32::from(place)).unwrap_or(0)
}

/// Corrected values, or those that came where the correction overflows.
fn finite_or(raw: [f64; 3], corrected: [f64; 3]) -> [f64; 3] {
    if corrected.iter().all(|value| value.is_finite()) { corrected } else { raw }
}

saved!([] Compensator {
    loaded,
    has_calibration,
    thermometer,
    calibration,
    validity,
    limits,
    products,
    used,
});
saved!([] Product { target, coefficient, factors });
saved!([] Difference { plus, minus, power, magnitude, reference });
