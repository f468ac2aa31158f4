//! The other case [TMP-9]: noise of about a third of a quantum or more makes every reading useful, and makes the
//! instants of level changes useless.
//!
//! [`Dither`] tells the case from the reversals of the level; [`ConstantRate`] is the estimator for it, a Kalman
//! filter of temperature (degC) and a rate (degC/s) that walks at random, on every reading. The variance of the
//! readings is learned from the innovations, at least that of rounding, q²/12; the sigma of the rate then stays
//! within a factor of two of its error for noise from 0.2 to 3 quanta.
use super::regression::Estimate;
use super::{Scalar, real};
use crate::number::select;
use crate::saved::{Blank, saved};

/// The level reversed this recently, s, counts as dithering now.
const RECENT: f64 = 30.0;
/// Memory of the share of time with dithering, s; shorter after a start.
const MEMORY: (f64, f64) = (300.0, 1800.0);
/// Share above which readings dither, and below which they no longer do.
const SHARE: (f64, f64) = (0.5, 0.4);
/// Spectral density of the rate's random walk, degC²/s³.
const RATE_NOISE: f64 = 1e-10;
/// Prior sigma of the rate, degC/s: 30 degC/h.
const RATE_SIGMA: f64 = 30.0 / 3600.0;
/// Memory of the variance of the readings, s.
const VARIANCE_MEMORY: f64 = 600.0;
/// Squared innovation, relative to its variance, that is far away, and how many in a row mean a jump.
const OUTLYING: f64 = 16.0;
const JUMP_SAMPLES: u8 = 3;

/// Whether readings dither.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dither<F> {
    /// Time since the start and since the last reversal, s.
    elapsed: F,
    since_reversal: F,
    rose: bool,
    share: F,
    found: bool,
}

impl<F: Scalar> Dither<F> {
    pub(super) fn start() -> Self {
        Self { elapsed: F::zero(), since_reversal: real(1e6), rose: false, share: F::zero(), found: false }
    }

    /// Takes the change of level (degC) of a step of `dt` seconds, at most 300.
    pub(super) fn update(&mut self, dt: F, change: F) {
        let (rises, falls) = (change > F::zero(), change < F::zero());
        let reversed = (rises & !self.rose) | (falls & self.rose);
        self.rose = rises | (self.rose & !falls);
        self.elapsed = (self.elapsed + dt).min(real(MEMORY.1));
        self.since_reversal = select(reversed, F::zero(), (self.since_reversal + dt).min(real(1e6)));
        let now = select(self.since_reversal <= real(RECENT), F::one(), F::zero());
        self.share += (now - self.share) * dt / self.elapsed.max(real(MEMORY.0));
        self.found = self.share > select(self.found, real(SHARE.1), real(SHARE.0));
    }

    pub(super) fn found(&self) -> bool {
        self.found
    }
}

/// Temperature and a rate that walks at random.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConstantRate<F> {
    temperature: F,
    rate: F,
    /// Covariance: temperature, cross, rate.
    p: [F; 3],
    /// Variance of the innovation, learned, degC².
    innovation: F,
    rounding: F,
    /// Innovations in a row far beyond their sigma.
    misses: u8,
}

impl<F: Scalar> ConstantRate<F> {
    /// At a first reading, degC, of a thermometer with this variance of rounding, degC².
    pub(super) fn start(reading: F, rounding: F) -> Self {
        let rate_variance = real(RATE_SIGMA * RATE_SIGMA);
        Self {
            temperature: reading,
            rate: F::zero(),
            p: [rounding, F::zero(), rate_variance],
            innovation: rounding,
            rounding,
            misses: 0,
        }
    }

    /// Takes a reading `dt` seconds (at most 300) after the last.
    pub(super) fn update(&mut self, dt: F, reading: F) {
        let w = real::<F>(RATE_NOISE) * dt;
        let [a, b, c] = self.p;
        let c1 = c + w;
        let b1 = b + c * dt + w * dt * real(0.5);
        let a1 = a + (b + b + c * dt) * dt + w * dt * dt / real(3.0);

        self.temperature += self.rate * dt;
        let innovation = reading - self.temperature;
        // A reading far away teaches little of the noise; three in a row are a temperature that jumped.
        let far = real::<F>(OUTLYING) * self.innovation;
        let square = innovation * innovation;
        self.misses = select(square > far, self.misses.saturating_add(1), 0);
        let jumped = self.misses >= JUMP_SAMPLES;
        self.innovation += (square.min(far) - self.innovation) * (dt / real(VARIANCE_MEMORY));
        let s = a1 + (self.innovation - a1).max(self.rounding);
        let (k0, k1) = (a1 / s, b1 / s);
        self.temperature += k0 * innovation;
        self.rate += k1 * innovation;
        // (1 − k0) from the measurement's variance: no cancellation.
        let rest = (s - a1) / s;
        self.p = [a1 * rest, b1 * rest, (c1 - k1 * b1).max(w)];
        if jumped {
            *self = Self { innovation: self.innovation, ..Self::start(reading, self.rounding) };
        }
    }

    /// 1-σ of the innovations, degC.
    pub(super) fn innovation_sigma(&self) -> F {
        self.innovation.sqrt()
    }

    pub(super) fn estimate(&self) -> Estimate<F> {
        let [a, _, c] = self.p;
        Estimate {
            temperature: self.temperature,
            rate: self.rate,
            temperature_sigma: a.sqrt(),
            rate_sigma: c.sqrt(),
        }
    }
}

saved!([F: Blank] Dither<F> { elapsed, since_reversal, rose, share, found });
saved!([F: Blank] ConstantRate<F> { temperature, rate, p, innovation, rounding, misses });
