//! Temperature and its rate from a quantised thermometer [TMP-3]..[TMP-7].
//!
//! A quantised reading stays the same for minutes; only the instants at which it changes tell the temperature
//! exactly, because then it equals a known threshold. Those instants are kept in a [`Window`], and a [`Fit`] of
//! `[1, s, exp(−s)]` to them gives temperature (degC) and rate (degC/s) with sigmas.
//!
//! Inputs: readings in degC on a 1 Hz clock of integer milliseconds. A step does the same work whatever they are: on a
//! Cortex-M4F in single precision 9200 to 9300 instructions. Single precision is within
//! 4e-6 degC/h and 3e-6 degC of double.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use super::dither::{ConstantRate, Dither};
use super::regression::{Estimate, Fit, Model};
use super::window::{Entry, Window};
use super::{Scalar, real, seconds_between};
use crate::config::{ConfigError, Problem};
use crate::number::select;
use crate::reading::{Quality, Reading};
use crate::saved::{Blank, saved, saved_choice, saved_flags};

/// Readings outside this range are not temperatures, degC.
const VALID_RANGE: (f64, f64) = (-80.0, 150.0);
/// A gap longer than this starts anew, ms.
const RESTART_GAP_MS: u64 = 300_000;
/// As many readings in a row whose time does not increase mean that the clock was set back: start anew.
const CLOCK_PATIENCE: u32 = 300;
/// Samples in a row beyond one quantum that force an entry (M2).
const FORCED_SAMPLES: u8 = 3;
/// Least distance of a forced entry from the newest, ms.
const FORCED_SPACING_MS: u64 = 3_000;
/// Internal time of time zero, so that the fictitious entries fit before it.
const EPOCH_MS: u64 = 360_000;

/// How the converter maps a temperature to a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantiser {
    /// The nearest level: thresholds half a quantum from the levels.
    #[default]
    Rounding,
    /// The level below: thresholds at the levels.
    Floor,
}

/// How temperature and rate are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TemperatureRateConfig<F> {
    /// Quantisation step of the thermometer, degC.
    pub quantum: F,
    /// How the thermometer quantises.
    pub quantiser: Quantiser,
    /// Time constant `T_p` of the model, s. The result depends weakly on it.
    pub time_constant_s: u16,
    /// Window `T_w`, s: 150..300 for fast transients, 600..900 for a quantum of 1 degC with noise.
    pub window_s: u16,
    /// A reading is stored when nothing was for so long (M3), s.
    pub hold_s: u16,
    /// Crossings of one threshold at most so far apart are chatter, s.
    pub chatter_s: u16,
}

impl<F: Scalar> TemperatureRateConfig<F> {
    /// The specification's setting for a thermometer with this quantum, degC [TMP-7].
    pub fn of_quantum(quantum: F) -> Self {
        Self {
            quantum,
            quantiser: Quantiser::Rounding,
            time_constant_s: 3600,
            window_s: 450,
            hold_s: 900,
            chatter_s: 120,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let error = |field, problem| Err(ConfigError::new(field, problem));
        if !self.quantum.is_finite() {
            return error("thermal.rate.quantum", Problem::NotFinite);
        }
        if self.quantum <= F::zero() {
            return error("thermal.rate.quantum", Problem::NotPositive);
        }
        if self.quantum < real(1e-4) || self.quantum > real(10.0) {
            return error("thermal.rate.quantum", Problem::OutOfRange);
        }
        for (field, value) in [
            ("thermal.rate.time_constant_s", self.time_constant_s),
            ("thermal.rate.window_s", self.window_s),
            ("thermal.rate.hold_s", self.hold_s),
            ("thermal.rate.chatter_s", self.chatter_s),
        ] {
            if value == 0 {
                return error(field, Problem::NotPositive);
            }
        }
        // The ring then never spans more than four time constants, where the model's basis is computed exactly.
        if self.window_s < 48 || self.window_s > self.time_constant_s {
            return error("thermal.rate.window_s", Problem::OutOfRange);
        }
        if 6 * (u32::from(self.hold_s) + 300) > 4 * u32::from(self.time_constant_s) {
            return error("thermal.rate.hold_s", Problem::OutOfRange);
        }
        Ok(())
    }

    /// From a level to the middle of its interval, degC.
    fn middle(&self) -> F {
        self.quantiser.middle(self.quantum)
    }

    fn model(&self) -> Model<F> {
        Model {
            time_constant: F::from_u16(self.time_constant_s).unwrap_or_else(F::one),
            sigma: self.quantum * real(0.25),
        }
    }
}

/// What a step gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TemperatureRateOutput<F> {
    /// Temperature, degC.
    pub temperature: F,
    /// Rate of the temperature, degC/s.
    pub rate: F,
    /// 1-σ of the temperature, degC; nominal.
    pub temperature_sigma: F,
    /// 1-σ of the rate, degC/s; nominal, pessimistic in slow change, optimistic after a step of heat.
    pub rate_sigma: F,
    /// What was out of the ordinary.
    pub status: ThermalStatus,
}

bitflags! {
    /// What was out of the ordinary in a step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct ThermalStatus: u8 {
        /// No reading could be used yet; the outputs are zero.
        const NO_READING = 1;
        /// Entries of the start (rate zero at power-on) are still in use: the rate is not to be trusted.
        const SETTLING = 1 << 1;
        /// This step's reading was missing, not a temperature, or not newer than the last; the outputs are the last ones.
        const REJECTED = 1 << 2;
        /// The estimator started anew, after a gap or a clock set back.
        const RESTARTED = 1 << 3;
        /// The noise of the readings makes their level jump to and fro most of the time, where the fit of level changes
        /// loses: the outputs come from a constant-rate Kalman filter of all readings instead [TMP-9].
        const DITHER = 1 << 4;
    }
}

/// What was stored and rejected since the estimator was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TemperatureRateCounts {
    /// Entries at level changes (M1).
    pub crossings: u32,
    /// Entries forced by the model being off (M2).
    pub forced: u32,
    /// Entries of a constant reading (M3).
    pub held: u32,
    /// Readings not used.
    pub rejected: u32,
    /// Restarts.
    pub restarts: u32,
}

/// State of the estimator.
#[derive(Clone, Copy, Debug)]
pub struct TemperatureRate<F> {
    config: TemperatureRateConfig<F>,
    counts: TemperatureRateCounts,
    /// Readings whose time did not increase, in a row.
    clock_faults: u32,
    /// There has been a reading.
    started: bool,
    window: Window<F>,
    running: Running<F>,
    last: TemperatureRateOutput<F>,
}

/// State since the last start, but for the window: small enough to be copied.
#[derive(Clone, Copy, Debug)]
struct Running<F> {
    fit: Fit<F>,
    /// Time of the last reading used, ms.
    last_ms: u64,
    /// The two readings before this one.
    history: [F; 2],
    /// Median of the last step.
    level: F,
    /// Samples in a row that the model misses by more than a quantum.
    misses: u8,
    chatter: Chatter,
    /// Whether the newest entry is a crossing that chatter may move.
    newest_crossed: bool,
    dither: Dither<F>,
    constant_rate: ConstantRate<F>,
}

/// Crossings of one threshold to and fro [TMP-4].
#[derive(Clone, Copy, Debug)]
struct Chatter {
    first_ms: u64,
    last_ms: u64,
    /// Time spent on the side of the first crossing's origin since then, ms.
    old_side_ms: u64,
    on_old_side: bool,
}

impl<F: Scalar> TemperatureRate<F> {
    /// Checks the configuration and builds the estimator.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn try_build(config: &TemperatureRateConfig<F>) -> Result<Self, ConfigError> {
        config.validate()?;
        let zero = F::zero();
        let last = TemperatureRateOutput {
            temperature: zero,
            rate: zero,
            temperature_sigma: zero,
            rate_sigma: zero,
            status: ThermalStatus::NO_READING,
        };
        let counts = TemperatureRateCounts::default();
        let running = Running::start(EPOCH_MS, zero, config);
        let window = Window::start(EPOCH_MS, zero);
        Ok(Self { config: *config, counts, clock_faults: 0, started: false, window, running, last })
    }

    /// One reading of the thermometer, degC, at `time_ms` less its age [TMP-7]. Never panics; a reading that
    /// cannot be used is counted and the last output returned.
    pub fn step(&mut self, time_ms: u64, reading: &Reading<F>) -> TemperatureRateOutput<F> {
        let now_ms = time_ms.saturating_sub(u64::from(reading.age_ms)).saturating_add(EPOCH_MS);
        let y = reading.value;
        let usable = (reading.quality == Quality::Good)
            & y.is_finite()
            & (y >= real(VALID_RANGE.0))
            & (y <= real(VALID_RANGE.1));
        let backwards = self.started & (now_ms <= self.running.last_ms);
        self.clock_faults = select(usable & backwards, self.clock_faults.saturating_add(1), 0);
        let clock_was_set = self.clock_faults >= CLOCK_PATIENCE;
        let accepted = usable & (!backwards | clock_was_set);

        // The whole step is worked out on a copy, with zero in place of an unusable reading, and kept if accepted. The
        // window, too large to be copied, changes only then.
        let y = select(usable, y, F::zero());
        let gap = self.started & (now_ms.saturating_sub(self.running.last_ms) > RESTART_GAP_MS);
        let restarted = gap | clock_was_set;
        // A fresh start is made in every step and taken in few; so is the old state kept.
        let begins = restarted | !self.started;
        let fresh = Running::start(now_ms, y, &self.config);
        let mut running = *select(begins, &fresh, &self.running);
        let mut counts = self.counts;
        self.window.restart_if(begins & accepted, now_ms, y + self.config.middle());
        running.update(&mut self.window, accepted, now_ms, y, &self.config, &mut counts);
        self.window.expire_if(accepted, now_ms, u32::from(self.config.window_s) * 1000);
        running.fit = Fit::of(&self.window, self.config.model());
        running.last_ms = now_ms;
        counts.restarts = counts.restarts.saturating_add(u32::from(restarted));
        let fitted = running.fit.at(now_ms);
        let filtered = running.constant_rate.estimate();
        let dithers = running.dither.found();
        let Estimate { temperature, rate, temperature_sigma, rate_sigma } =
            if dithers { filtered } else { fitted };
        let mut status = ThermalStatus::empty();
        status.set(ThermalStatus::SETTLING, self.window.settling());
        status.set(ThermalStatus::RESTARTED, restarted);
        status.set(ThermalStatus::DITHER, dithers);

        self.started |= accepted;
        self.running = *select(accepted, &running, &self.running);
        if accepted {
            self.counts = counts;
            self.clock_faults = 0;
            self.last = TemperatureRateOutput { temperature, rate, temperature_sigma, rate_sigma, status };
        } else {
            self.counts.rejected = self.counts.rejected.saturating_add(1);
            self.last.status.insert(ThermalStatus::REJECTED);
            self.last.status.remove(ThermalStatus::RESTARTED);
        }
        self.last
    }

    /// What was stored and rejected so far.
    pub fn counts(&self) -> TemperatureRateCounts {
        self.counts
    }

    /// The updates in use, oldest first; times in ms on the clock of the readings plus 360 000, modulo 2³².
    pub fn entries(&self) -> impl Iterator<Item = Entry<F>> + '_ {
        let window = self.started.then_some(&self.window);
        window.into_iter().flat_map(|w| (0..w.len()).map(|age| w.entry(age)))
    }
}

impl<F: Scalar> Running<F> {
    /// First reading: the temperature was `y` for six minutes, its rate zero [TMP-6].
    fn start(now_ms: u64, y: F, config: &TemperatureRateConfig<F>) -> Self {
        let middle = y + config.middle();
        Self {
            fit: Fit::constant(now_ms, middle),
            last_ms: now_ms,
            history: [y; 2],
            level: y,
            misses: 0,
            chatter: Chatter::start(now_ms),
            newest_crossed: false,
            dither: Dither::start(),
            constant_rate: ConstantRate::start(middle, config.quantum * config.quantum / real(12.0)),
        }
    }

    /// Stores what this reading tells: M1, else M2, else M3 [TMP-4]; in the window only what is `accepted`.
    fn update(
        &mut self,
        window: &mut Window<F>,
        accepted: bool,
        now_ms: u64,
        y: F,
        config: &TemperatureRateConfig<F>,
        counts: &mut TemperatureRateCounts,
    ) {
        let q = config.quantum;
        let window_ms = u64::from(config.window_s) * 1000;
        let level = median(self.history[0], self.history[1], y);
        self.history = [self.history[1], y];
        let crossed = level != self.level;
        let threshold = config.quantiser.threshold(self.level, level, q);
        let dt = seconds_between(self.last_ms, now_ms);
        self.dither.update(dt, level - self.level);
        // Spikes are for the median to stop; noise must pass as it is.
        let spread = q + self.constant_rate.innovation_sigma() * real(3.0);
        let within = y.max(level - spread).min(level + spread);
        self.constant_rate.update(dt, within + config.middle());
        self.level = level;

        // What a reading says by itself: the middle of its interval.
        let middle = level + config.middle();
        let missed = self.fit.above(middle, now_ms).abs() > q;
        self.misses = select(missed, self.misses.saturating_add(1), 0);

        let newest = window.newest();
        let since_newest_ms = u64::from(newest.age_ms(now_ms));
        let same_threshold = self.newest_crossed & ((threshold - newest.value).abs() < q * real(0.25));
        let chatter_ms = u64::from(config.chatter_s) * 1000;

        let continues = self.chatter.continues(now_ms, chatter_ms, window_ms / 4);
        let moved = crossed & same_threshold & continues;
        let crossing = crossed & !moved & (since_newest_ms >= window_ms / 48);
        let forced = (self.misses >= FORCED_SAMPLES) & (since_newest_ms >= FORCED_SPACING_MS);
        let forced = forced & !moved & !crossing;
        let held = !moved & !crossing & !forced & (since_newest_ms >= u64::from(config.hold_s) * 1000);
        let stored = crossing | forced | held;

        let mut chatter = self.chatter;
        let middle_of_crossings_ms = chatter.cross(now_ms);
        self.chatter = *select(moved, &chatter, &self.chatter);
        self.chatter = *select(crossing, &Chatter::start(now_ms), &self.chatter);
        window.move_newest_if(accepted & moved, middle_of_crossings_ms);
        let value = select(crossing, threshold, middle);
        window.push_if(accepted & stored, Entry::new(now_ms, value));
        self.newest_crossed = crossing | (self.newest_crossed & !stored);
        self.misses = select(stored, 0, self.misses);
        counts.crossings = counts.crossings.saturating_add(u32::from(crossing));
        counts.forced = counts.forced.saturating_add(u32::from(forced));
        counts.held = counts.held.saturating_add(u32::from(held));
    }
}

impl Quantiser {
    /// Middle of a level's interval, from the level, degC.
    fn middle<F: Scalar>(self, quantum: F) -> F {
        quantum * real(if self == Self::Floor { 0.5 } else { 0.0 })
    }

    /// Threshold that was crossed last on the way from level `from` to level `to`, degC.
    fn threshold<F: Scalar>(self, from: F, to: F, quantum: F) -> F {
        let (rising, falling) = match self {
            Self::Rounding => (real(-0.5), real(0.5)),
            Self::Floor => (F::zero(), F::one()),
        };
        to + quantum * if to > from { rising } else { falling }
    }
}

impl Chatter {
    fn start(now_ms: u64) -> Self {
        Self { first_ms: now_ms, last_ms: now_ms, old_side_ms: 0, on_old_side: false }
    }

    fn continues(&self, now_ms: u64, spacing_ms: u64, cluster_ms: u64) -> bool {
        (now_ms.saturating_sub(self.last_ms) <= spacing_ms)
            & (now_ms.saturating_sub(self.first_ms) < cluster_ms)
    }

    /// Takes one more crossing; returns the instant of the single crossing that spends as long on the old side.
    fn cross(&mut self, now_ms: u64) -> u64 {
        let since_ms = now_ms.saturating_sub(self.last_ms);
        // Disjoint intervals since the first crossing: their sum is at most now, but in a forged state.
        self.old_side_ms = self.old_side_ms.wrapping_add(select(self.on_old_side, since_ms, 0));
        self.on_old_side = !self.on_old_side;
        self.last_ms = now_ms;
        self.first_ms.wrapping_add(self.old_side_ms)
    }
}

/// Median of three.
fn median<F: Scalar>(a: F, b: F, c: F) -> F {
    a.max(b).min(a.min(b).max(c))
}

saved_choice!(Quantiser { Rounding, Floor });
saved!([F: Blank] TemperatureRateConfig<F> { quantum, quantiser, time_constant_s, window_s, hold_s, chatter_s });
saved!([F: Blank] TemperatureRateOutput<F> { temperature, rate, temperature_sigma, rate_sigma, status });
saved!([] TemperatureRateCounts { crossings, forced, held, rejected, restarts });
saved!([F: Blank] TemperatureRate<F> { counts, clock_faults, started, window, running, last, config });
saved!([F: Blank] Running<F> {
    fit,
    last_ms,
    history,
    level,
    misses,
    chatter,
    newest_crossed,
    dither,
    constant_rate,
});
saved!([] Chatter { first_ms, last_ms, old_side_ms, on_old_side });
saved_flags!(ThermalStatus);
