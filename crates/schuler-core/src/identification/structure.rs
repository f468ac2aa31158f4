//! Noise structure and parameters from an autocorrelation: exponential or exponential-cosine.
//!
//! Input: R_0 … R_J of a series with spacing Δ_s. Output: R(t) = σ² e^(−α|t|) [FIL-13] [FIL-15], or
//! R(t) = σ² e^(−α|t|) cos βt [FIL-16] [FIL-19] [FIL-21], and which of the two the data ask for.
//!
//! Source: the paper on noise identification, equations (10)–(21), with the limits on the lags without which
//! the published sums have no use: logarithms of small correlations are noise, and beyond the first zero
//! crossing they do not exist.

use nalgebra::RealField;

use crate::number::{real, select, sine_and_cosine};
use crate::saved::{Blank, saved};

/// Correlations below this do not enter the exponential fit. Larger values cost accuracy on long records,
/// smaller ones bring in lags that are mostly noise.
pub const EXPONENTIAL_FLOOR: f64 = 0.5;

/// The exponential-cosine fit uses lags with cos β̂t above this …
const COSINE_FLOOR: f64 = 0.3;
/// … and a correlation above this.
const CORRELATION_FLOOR: f64 = 0.05;
/// The exponential-cosine must reduce the mean squared misfit by this factor …
const MISFIT_RATIO: f64 = 3.0;
/// … and the correlation must dip this many of its standard deviations √(τ̂/T) below zero.
const DEPTH: f64 = 2.0;

/// R(t) = σ² e^(−α|t|).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exponential<T> {
    /// σ̂² = R₀ [FIL-13], in the square of the series' unit.
    pub variance: T,
    /// α̂ [FIL-15], 1/s; the correlation time is its inverse.
    pub alpha: T,
    /// Lags used, M.
    pub lags: u32,
}

/// R(t) = σ² e^(−α|t|) cos βt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExponentialCosine<T> {
    /// σ̂² = R₀ [FIL-19], in the square of the series' unit.
    pub variance: T,
    /// α̂ [FIL-21], 1/s.
    pub alpha: T,
    /// β̂ = π/(2τ_β) [FIL-19], rad/s.
    pub beta: T,
    /// Time of the first zero crossing τ_β, s.
    pub crossing_s: T,
    /// First lag at or below zero, k.
    pub crossing_lag: u32,
    /// Lags used for α̂.
    pub lags: u32,
}

/// How well the two structures fit, over the lags up to three times the first zero crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison<T> {
    /// Mean squared misfit F₁ of the exponential to the correlation.
    pub exponential: T,
    /// Mean squared misfit F₂ of the exponential-cosine.
    pub exponential_cosine: T,
    /// Depth of the dip below zero in units of √(τ̂/T).
    pub depth: T,
}

/// What an autocorrelation shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Structure<T> {
    /// No variance, no correlation beyond white noise, or none that decays: nothing can be fitted.
    None,
    /// First-order process.
    Exponential(Exponential<T>),
    /// Second-order process; the exponential fit is there for comparison.
    ExponentialCosine(ExponentialCosine<T>, Exponential<T>, Comparison<T>),
}

/// Exponential fit [FIL-13] [FIL-14] [FIL-15] over the first run of lags with R_j/R₀ above `floor`.
///
/// `None` when R₀ is not positive or not finite, when already r₁ ≤ `floor` (a white series at this spacing), or
/// when the correlation does not decay.
pub fn fit_exponential<T: RealField + Copy>(
    autocorrelation: &[T],
    spacing_s: T,
    floor: T,
) -> Option<Exponential<T>> {
    let (&variance, lagged) = autocorrelation.split_first()?;
    let mut within = variance > T::zero() && variance.is_finite();
    let (mut logarithms, mut times) = (T::zero(), T::zero());
    let (mut lags, mut time) = (0, T::zero());
    for &covariance in lagged {
        time += spacing_s;
        let correlation = covariance / variance;
        within &= correlation > floor;
        // Of any other number but one: of that a logarithm is found sooner.
        let logarithm = select(within, correlation, real(0.5)).ln();
        logarithms += select(within, logarithm, T::zero());
        times += select(within, time, T::zero());
        lags += u32::from(within);
    }
    let alpha = -logarithms / times;
    (lags > 0 && alpha > T::zero()).then_some(Exponential { variance, alpha, lags })
}

/// Exponential-cosine fit [FIL-16] [FIL-19] [FIL-20] [FIL-21] over the lags before the first zero crossing.
///
/// `None` when R₀ is not positive or not finite, when the correlation never crosses zero within the lags given,
/// or when no lag is left that shows a decay: then the exponential is all that can be had.
pub fn fit_exponential_cosine<T: RealField + Copy>(
    autocorrelation: &[T],
    spacing_s: T,
) -> Option<ExponentialCosine<T>> {
    let (&variance, lagged) = autocorrelation.split_first()?;
    if !(variance > T::zero() && variance.is_finite()) {
        return None;
    }
    let (mut crossing, mut previous, mut lag) = (None, T::one(), 0u32);
    for &covariance in lagged {
        lag += 1;
        let correlation = covariance / variance;
        if crossing.is_none() && correlation <= T::zero() {
            let before: T = real(f64::from(lag - 1));
            crossing = Some((lag, (before + previous / (previous - correlation)) * spacing_s));
        }
        previous = correlation;
    }
    let (crossing_lag, crossing_s) = crossing?;
    let beta = T::frac_pi_2() / crossing_s;

    let (mut logarithms, mut times) = (T::zero(), T::zero());
    let (mut lags, mut time) = (0, T::zero());
    let mut turn = Rotation::new(beta * spacing_s);
    for (lag, &covariance) in (1u32..).zip(lagged) {
        time += spacing_s;
        turn.advance();
        let correlation = covariance / variance;
        let used =
            lag < crossing_lag && turn.cosine > real(COSINE_FLOOR) && correlation > real(CORRELATION_FLOOR);
        let ratio = if used { turn.cosine / correlation } else { T::one() };
        logarithms += ratio.ln();
        times += if used { time } else { T::zero() };
        lags += u32::from(used);
    }
    let alpha = logarithms / times;
    (lags > 0 && alpha > T::zero()).then_some(ExponentialCosine {
        variance,
        alpha,
        beta,
        crossing_s,
        crossing_lag,
        lags,
    })
}

/// Fits both structures and chooses [FIL-18]: the exponential-cosine only where it fits three times better and
/// the correlation dips below zero by more than chance would have it in a record of `duration_s`.
pub fn choose_structure<T: RealField + Copy>(
    autocorrelation: &[T],
    spacing_s: T,
    duration_s: T,
) -> Structure<T> {
    let Some(exponential) = fit_exponential(autocorrelation, spacing_s, real(EXPONENTIAL_FLOOR)) else {
        return Structure::None;
    };
    let Some(cosine) = fit_exponential_cosine(autocorrelation, spacing_s) else {
        return Structure::Exponential(exponential);
    };
    let comparison = compare(autocorrelation, spacing_s, duration_s, &exponential, &cosine);
    let better = comparison.exponential > real::<T>(MISFIT_RATIO) * comparison.exponential_cosine;
    if better && comparison.depth > real(DEPTH) {
        Structure::ExponentialCosine(cosine, exponential, comparison)
    } else {
        Structure::Exponential(exponential)
    }
}

/// Misfits of the two structures over lags 0 … 3k: the functions [FIL-10] and [FIL-18] over the number of lags. The paper
/// minimises them; here they choose between structures whose parameters come from the log-linear equations.
pub fn compare<T: RealField + Copy>(
    autocorrelation: &[T],
    spacing_s: T,
    duration_s: T,
    exponential: &Exponential<T>,
    cosine: &ExponentialCosine<T>,
) -> Comparison<T> {
    let last = 3 * cosine.crossing_lag;
    let (zero, one) = (T::zero(), T::one());
    let decay_1 = (-exponential.alpha * spacing_s).exp();
    let decay_2 = (-cosine.alpha * spacing_s).exp();
    let mut turn = Rotation::new(cosine.beta * spacing_s);
    let (mut model_1, mut envelope_2) = (one, one);
    let (mut square_1, mut square_2, mut lowest, mut count) = (zero, zero, zero, zero);
    for (lag, &covariance) in (0u32..).zip(autocorrelation) {
        let correlation = covariance / cosine.variance;
        let used = lag <= last;
        let weight = if used { one } else { zero };
        let (misfit_1, misfit_2) = (correlation - model_1, correlation - envelope_2 * turn.cosine);
        square_1 += weight * misfit_1 * misfit_1;
        square_2 += weight * misfit_2 * misfit_2;
        lowest = if used && correlation < lowest { correlation } else { lowest };
        count += weight;
        model_1 *= decay_1;
        envelope_2 *= decay_2;
        turn.advance();
    }
    let chance = (exponential.alpha * duration_s).recip().sqrt();
    Comparison {
        exponential: square_1 / count,
        exponential_cosine: square_2 / count,
        depth: -lowest / chance,
    }
}

/// What the removal of the sample mean took from every R_j: 2R₀τ/T for a record of length T ≫ τ. Add it once to
/// all of them.
pub fn removed_mean_bias<T: RealField + Copy>(variance: T, tau_s: T, duration_s: T) -> T {
    real::<T>(2.0) * variance * tau_s / duration_s
}

/// cos and sin of the multiples of an angle, by turning.
struct Rotation<T> {
    cosine: T,
    sine: T,
    step: (T, T),
}

impl<T: RealField + Copy> Rotation<T> {
    fn new(angle: T) -> Self {
        let (sine, cosine) = sine_and_cosine(angle);
        Self { cosine: T::one(), sine: T::zero(), step: (cosine, sine) }
    }

    fn advance(&mut self) {
        let (c, s) = self.step;
        (self.cosine, self.sine) = (self.cosine * c - self.sine * s, self.sine * c + self.cosine * s);
    }
}

saved!([T: Blank] ExponentialCosine<T> { variance, alpha, beta, crossing_s, crossing_lag, lags });
