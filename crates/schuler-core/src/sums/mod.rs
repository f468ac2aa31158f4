//! Band sums: what a day of readings says about its causes, in eight kilobytes.
//!
//! A navigation computer cannot send a day of readings to the ground. It can send sums of products: of what the module did not
//! expect (the whitened innovation of the velocity channel, the two parity channels of the gyro block) and of the
//! series that may be the cause (time, temperature, its rate …), octave by octave. From them the ground fits coefficients,
//! weighs one cause against another, and sees the spectrum of what is left.
//!
//! The field's words: the mean product of a channel with itself in octave j is 2ʲ times its **Allan variance** at 2ʲ steps, that
//! of a channel and a series 2ʲ times their **Allan covariance** (of pairs that do not overlap).
//!
//! The innovation is white where the filter knows its noise, so that coefficients of all octaves are independent and of
//! variance one, and evidence is not counted twice. The series have gone through the same filter with the same gains
//! ([`FilterPass`]). The parity channels are white as they are, in σ of the block, and are compared with the series
//! themselves.
//!
//! | file | holds |
//! | --- | --- |
//! | `cascade` | [`BandSums`]: products by octave, for any channels and series |
//! | `whitening` | [`FilterPass`]: what the filter did in a step, and the series going the same way |
//! | `dictionary` | the series, step by step |
//! | `config` | [`SumsConfig`], [`Series`], [`Regressor`] |
//!
//! ```
//! use schuler_core::sums::BandSums;
//!
//! // Two series, three products, two octaves and what is left.
//! let mut sums = BandSums::<2, 3, 3>::EMPTY;
//! for k in 0..9 {
//!     let alternating = if k % 2 == 0 { 1.0 } else { -1.0 };
//!     sums.push(&[alternating, 1.0], true);
//! }
//! let first = sums.bands().next().expect("there are three");
//! // Four differences of ±√2 so far; the second series has none.
//! assert_eq!(first.count, 4);
//! assert!((first.products[0] - 8.0).abs() < 1e-5);
//! assert_eq!(first.products[1..], [0.0, 0.0]);
//! ```
//!
//! A gap is no row: the filter, and the series with it, coast over it, and neighbours are neighbours among the rows that are there.
mod cascade;
mod config;
mod dictionary;
mod whitening;

pub use cascade::{Band, BandSums};
pub use config::{Port, Regressor, Series, SumsConfig};
pub use dictionary::Heard;
pub use whitening::{FilterPass, Transition};

use crate::compensation::Known;
use crate::filter::{FilterConfig, MarkovNoise};
use crate::saved::saved;
use dictionary::Dictionary;
use whitening::Signatures;

/// Series in a dictionary.
pub const SERIES: usize = 8;
/// Octaves, and one row for what is left: averages of 4096 steps.
pub const ROWS: usize = 13;

/// Sums of the velocity channel: z = (innovation, series).
pub type VelocitySums = BandSums<{ 1 + SERIES }, 45, ROWS>;
/// Sums of the parity channels: z = (first, second, series).
pub type ParitySums = BandSums<{ 2 + SERIES }, 55, ROWS>;

/// Stands where no configuration was given.
const NO_FILTER: FilterConfig<f32> = FilterConfig {
    radius_m: 0.0,
    gravity: 0.0,
    step_s: 0.0,
    accelerometer: MarkovNoise { sigma: 0.0, tau_s: 0.0 },
    gyro: MarkovNoise { sigma: 0.0, tau_s: 0.0 },
    velocity_noise: 0.0,
    initial_velocity_sigma: 0.0,
    initial_vertical_sigma: 0.0,
    gate_sigma: 0.0,
};

/// What a step brings to the sums.
#[derive(Clone, Copy, Debug)]
pub struct SumsInput {
    /// Nominal steps since the last one, at least one.
    pub elapsed: u32,
    /// Readings that are series.
    pub heard: Heard,
    /// What the error filter has done.
    pub pass: FilterPass,
    /// Parity of the gyro block in σ, if it has one in this step.
    pub parity: Option<[f32; 2]>,
}

/// The sums of all channels with what they need to go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightSums {
    on: bool,
    config: SumsConfig,
    filter: FilterConfig<f32>,
    dictionary: Dictionary,
    signatures: Signatures<SERIES>,
    velocity: VelocitySums,
    parity: ParitySums,
}

impl FlightSums {
    /// Before the configuration: all zeros, so that a static one costs no flash.
    pub const IDLE: Self = Self {
        on: false,
        config: SumsConfig::IDLE,
        filter: NO_FILTER,
        dictionary: Dictionary::START,
        signatures: Signatures::NONE,
        velocity: VelocitySums::EMPTY,
        parity: ParitySums::EMPTY,
    };

    /// Starts from a configuration that was checked, in place: they are too large for a small stack. Without configuration they
    /// stay empty, with the same work a step.
    pub fn start(&mut self, config: Option<&SumsConfig>, filter: &FilterConfig<f32>) {
        self.on = config.is_some();
        self.config = config.copied().unwrap_or_default();
        self.filter = *filter;
        self.restart();
    }

    /// Forgets everything but the configuration.
    #[inline(never)]
    pub fn restart(&mut self) {
        self.dictionary = Dictionary::START;
        self.signatures = Signatures::NONE;
        self.velocity = VelocitySums::EMPTY;
        self.parity = ParitySums::EMPTY;
    }

    /// The series' readings among what a step knows.
    pub fn hear(&self, known: &Known) -> Heard {
        let thermometer = known.thermometers.get(usize::from(self.config.thermometer));
        let force = known.accelerometers.get(usize::from(self.config.accelerometer));
        Heard {
            temperature: thermometer.and_then(|state| state.temperature),
            rate: thermometer.and_then(|state| state.rate),
            force: force.copied().flatten().map(|force| force as f32),
        }
    }

    /// One step, the same work whatever comes. Never panics.
    #[inline(never)]
    pub fn step(&mut self, input: &SumsInput) {
        let step_s = self.filter.step_s;
        self.dictionary.step(&self.config, step_s, input.elapsed, &input.heard);
        let regressors = &self.config.velocity;
        let values = regressors.map(|regressor| self.dictionary.value(regressor.series, step_s));
        let whitened = self.signatures.step(&input.pass, &self.filter, regressors, &values);
        let vector = joined([input.pass.whitened()], whitened);
        self.velocity.push(&vector, self.on & input.pass.counts());
        let vector = joined(input.parity.unwrap_or_default(), self.dictionary.all(step_s));
        self.parity.push(&vector, self.on & input.parity.is_some());
    }

    /// Whether there is a configuration.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// The dictionary.
    pub fn config(&self) -> &SumsConfig {
        &self.config
    }

    /// Innovation of the velocity channel and its regressors.
    pub fn velocity(&self) -> &VelocitySums {
        &self.velocity
    }

    /// Parity channels and [`Series::ALL`].
    pub fn parity(&self) -> &ParitySums {
        &self.parity
    }
}

/// One array behind the other.
fn joined<const A: usize, const B: usize, const N: usize>(one: [f32; A], other: [f32; B]) -> [f32; N] {
    const { assert!(N == A + B) };
    let mut both = [0.0; N];
    for (slot, x) in both.iter_mut().zip(one.iter().chain(&other)) {
        *slot = *x;
    }
    both
}

// A channel set is at most four kilobytes.
const _: () = assert!(size_of::<VelocitySums>() + size_of::<Signatures<SERIES>>() <= 4096);
const _: () = assert!(size_of::<ParitySums>() <= 4096);

saved!([] FlightSums { on, config, filter, dictionary, signatures, velocity, parity });

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::filter::ErrorFilter;
    use crate::module::ModuleConfig;
    use crate::saved::{Blank, Checksum, Saved, Visitor};

    /// Steps `from` to `to` of a flight in which readings are missing.
    fn fly(filter: &mut ErrorFilter<f32>, sums: &mut FlightSums, from: u32, to: u32) {
        for k in from..to {
            let noise = ((k * 7919 % 1013) as f32) / 1013.0 - 0.5;
            let measured = (k % 5 != 0).then_some(0.2 * noise);
            let step = filter.step(measured);
            let pass = FilterPass::of(filter, &step, &Transition::IDENTITY, 1.0, measured.is_some(), false);
            let heard =
                Heard { temperature: Some(20.0 + noise), rate: None, force: Some(9.8 + 1e-3 * k as f32) };
            let parity = (k % 3 != 0).then_some([noise, -2.0 * noise]);
            sums.step(&SumsInput { elapsed: 1, heard, pass, parity });
        }
    }

    #[test]
    fn saved_sums_go_on_as_if_nothing_had_been() {
        let config = ModuleConfig::default().filter;
        for before in [0, 1, 77, crate::repeats(3000)] {
            let mut filter = ErrorFilter::try_build(&config).unwrap();
            let mut sums = std::boxed::Box::new(FlightSums::IDLE);
            sums.start(Some(&SumsConfig::default()), &config);
            fly(&mut filter, &mut sums, 0, before);
            let mut visitor = Visitor::measure();
            sums.visit(&mut visitor);
            let mut bytes = std::vec![0; visitor.here() as usize];
            sums.visit(&mut Visitor::save(0, &mut bytes));
            let mut other = std::boxed::Box::new(FlightSums::blank());
            let mut visitor = Visitor::restore(0, &bytes, Checksum::EMPTY);
            other.visit(&mut visitor);
            assert!(!visitor.is_flawed() && *other == *sums);
            let mut same = filter;
            fly(&mut filter, &mut sums, before, before + 500);
            fly(&mut same, &mut other, before, before + 500);
            assert!(*other == *sums && sums.velocity().pushed() > 0);
        }
    }

    #[test]
    fn without_configuration_they_stay_empty() {
        let config = ModuleConfig::default().filter;
        let mut filter = ErrorFilter::try_build(&config).unwrap();
        let mut sums = std::boxed::Box::new(FlightSums::IDLE);
        sums.start(None, &config);
        fly(&mut filter, &mut sums, 0, 100);
        assert_eq!((sums.is_on(), sums.velocity().pushed(), sums.parity().pushed()), (false, 0, 0));
    }
}
