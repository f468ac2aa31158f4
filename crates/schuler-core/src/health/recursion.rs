//! The jump-Markov recursion: one Gaussian for each mode, merged to the exact first two moments after every
//! residual (second-order generalised pseudo-Bayes, GPB2) [HLT-4], [HLT-5].
//!
//! The exact posterior of mode and state is a mixture of (2N)^k Gaussians. Merging the paths that lead to the
//! same mode *after* the residual has weighed them keeps what tells a fresh jump from an old one; the
//! interacting-multiple-model filter merges before and is overconfident for it.
//!
//! What the merging costs: where a lasting jump and an offset of ξ explain the residual about equally well, the
//! exact posterior stays undecided while the merged one slowly settles for either. On recordings drawn from the
//! model that gave one false jump alarm of more than ten minutes in 1000 h.
use core::array;

use nalgebra::{ComplexField, RealField, convert};

use super::conditional::Conditional;
use super::config::HealthConfig;
use super::paths::{Common, Gaussians, Paths, PerMode, of, place};
use super::span::Span;
use crate::number::select;
use crate::saved::{Blank, saved};

/// Floor under the mode probabilities, so that every mode can recover.
const PROBABILITY_FLOOR: f64 = 1e-9;
/// A mode whose share of the posterior is below this merges its paths by their prior weights.
const NEGLIGIBLE_SHARE: f64 = 1e-30;

/// More than any v²/S that can be formed in single precision.
const LARGEST_Q: f64 = f32::MAX as f64;

/// Keeps the arguments of the exponential where it is always the same work: below −1.5 ln 2 …
const EXPONENT_SHIFT: f64 = 2.0;
/// … and above those at which it underflows in single precision. Paths so much worse than the best, in squares of
/// standard deviations, have no share.
const WORST: f64 = 160.0;

/// Probabilities and Gaussians of all modes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recursion<T, const LEVELS: usize> {
    /// w(r), mode probabilities.
    pub(super) weights: PerMode<T, LEVELS>,
    /// X given the mode.
    pub(super) conditionals: PerMode<Conditional<T>, LEVELS>,
    /// `γ_m²`, (m/s)².
    jump_variance: T,
    /// `Rq`, (m/s)².
    residual_variance: T,
    /// Square of the out-of-model gate, in standard deviations.
    gate_squared: T,
}

/// What a residual told.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence<T> {
    /// Residual minus its prediction over all modes, m/s; zero if there was none.
    pub(super) innovation: T,
    /// Variance of the residual's prediction over all modes, (m/s)².
    pub(super) variance: T,
    /// Natural logarithm of the residual's predictive density, density in 1/(m/s); zero if it was not used.
    pub(super) log_likelihood: T,
    /// The residual was beyond the gate of every mode and was not used.
    pub(super) out_of_model: bool,
    /// False if a number is NaN or infinite or a variance is negative.
    pub(super) sound: bool,
}

impl<T: RealField + Copy> Evidence<T> {
    /// Of a residual that was not used.
    pub(super) fn none() -> Self {
        let zero = T::zero();
        Self { innovation: zero, variance: zero, log_likelihood: zero, out_of_model: false, sound: false }
    }
}

impl<T: RealField + Copy, const LEVELS: usize> Recursion<T, LEVELS> {
    /// The priors of a validated configuration.
    pub(super) fn new(config: &HealthConfig<T, LEVELS>) -> Self {
        let square = |x: T| x * x;
        let jump_variance = square(config.jump.sigma);
        let weights = config.jump.initial.map(|jump| config.radio.initial.map(|level| jump * level));
        Self {
            weights: floored(weights),
            conditionals: [T::zero(), jump_variance].map(|jump| {
                config.radio.sigma.map(|sigma| {
                    Conditional::independent([
                        square(sigma),
                        square(config.inertial.initial_sigma),
                        jump,
                        square(config.inertial.drift_sigma),
                    ])
                })
            }),
            jump_variance,
            residual_variance: square(config.residual_sigma),
            gate_squared: square(config.out_of_model_sigma),
        }
    }

    /// Probabilities and Gaussians after `span` and, if it is `present`, the residual d, m/s [HLT-5]. The work is
    /// the same with and without a residual.
    pub(super) fn after(&self, span: &Span<T, LEVELS>, residual: T, present: bool) -> (Self, Evidence<T>) {
        let d = if present { residual } else { T::zero() };
        let common = Common::new(span, d, self.residual_variance, self.jump_variance);
        let mut paths = [[Paths::none(); LEVELS]; 2];
        for (jump, of_jump) in paths.iter_mut().enumerate() {
            for (level, paths) in of_jump.iter_mut().enumerate() {
                paths.lead(
                    [jump, level],
                    self.weights[jump][level],
                    &self.conditionals[jump][level],
                    &common,
                );
            }
        }
        let paths = paths.as_flattened_mut();

        // Likelihoods relative to the best path's, so that they cannot all vanish.
        let best = least_q(paths);
        let out_of_model = present && (best > self.gate_squared);
        let usable = present && !out_of_model;
        let total = weigh(paths, best, usable);

        let weights = share(paths, T::one() / total);
        let (predicted, variance) = residual_prediction(paths);
        let merged = Gaussians::merged(paths, &common, usable);
        let mut after = *self;
        after.weights = floored(weights);
        for (mode, conditional) in after.conditionals.as_flattened_mut().iter_mut().enumerate() {
            *conditional = merged.of(mode);
        }

        let (half, shift) = (convert::<f64, T>(0.5), convert::<f64, T>(EXPONENT_SHIFT));
        let log_likelihood = total.ln() + shift - half * (best + T::two_pi().ln());
        let innovation = select(present, d - predicted, T::zero());
        let log_likelihood = select(usable, log_likelihood, T::zero());
        let told = [innovation, variance, log_likelihood, sum(&after.weights)];
        let sound =
            told.iter().fold(merged.are_sound(), |sound, number| sound & ComplexField::is_finite(number));
        (after, Evidence { innovation, variance, log_likelihood, out_of_model, sound })
    }

    /// First two moments of X over all modes.
    pub(super) fn over_modes(&self) -> Conditional<T> {
        let components: PerMode<_, LEVELS> = array::from_fn(|jump| {
            array::from_fn(|level| (self.weights[jump][level], self.conditionals[jump][level]))
        });
        Conditional::merged(components.as_flattened())
    }
}

/// The least v²/S of the paths that there are.
fn least_q<T: RealField + Copy, const LEVELS: usize>(paths: &[Paths<T, LEVELS>]) -> T {
    let mut least = convert(LARGEST_Q);
    for paths in paths {
        for (&prior, &q) in paths.prior.as_flattened().iter().zip(paths.q.as_flattened()) {
            least = select((prior > T::zero()) & (q < least), q, least);
        }
    }
    least
}

/// Posterior weights of all paths, or the prior ones if the residual is not `usable`, and their sum. `best`: the least v²/S.
fn weigh<T: RealField + Copy, const LEVELS: usize>(
    paths: &mut [Paths<T, LEVELS>],
    best: T,
    usable: bool,
) -> T {
    let half = convert::<f64, T>(0.5);
    let (shift, worst) = (convert::<f64, T>(EXPONENT_SHIFT), convert::<f64, T>(WORST));
    let mut totals = [[T::zero(); LEVELS]; 2];
    for paths in paths {
        let mut fits = [[T::zero(); LEVELS]; 2];
        for mode in 0..2 * LEVELS {
            let q = of(&paths.q, mode);
            let worse = select(q > best, q - best, T::zero());
            *place(&mut fits, mode) = -half * select(worse < worst, worse, worst) - shift;
        }
        let deviations = paths.inverse_variance.map(|row| row.map(T::sqrt));
        let fits = fits.map(|row| row.map(T::exp));
        for mode in 0..2 * LEVELS {
            let fit = of(&fits, mode) * of(&deviations, mode);
            let posterior = of(&paths.prior, mode) * select(usable, fit, T::one());
            *place(&mut paths.posterior, mode) = posterior;
            *place(&mut totals, mode) += posterior;
        }
    }
    sum(&totals)
}

/// Shares of the paths among those to the same mode. Returns those of the modes in the whole posterior.
fn share<T: RealField + Copy, const LEVELS: usize>(
    paths: &mut [Paths<T, LEVELS>],
    per_total: T,
) -> PerMode<T, LEVELS> {
    let mut posteriors = [[T::zero(); LEVELS]; 2];
    let mut priors = posteriors;
    for paths in &*paths {
        for mode in 0..2 * LEVELS {
            *place(&mut posteriors, mode) += of(&paths.posterior, mode) * per_total;
            *place(&mut priors, mode) += of(&paths.prior, mode);
        }
    }
    for paths in paths {
        for mode in 0..2 * LEVELS {
            let whole = of(&posteriors, mode);
            let negligible = whole < convert(NEGLIGIBLE_SHARE);
            let scale = T::one() / select(negligible, of(&priors, mode), whole);
            let part = select(negligible, of(&paths.prior, mode), of(&paths.posterior, mode) * per_total);
            *place(&mut paths.share, mode) = scale * part;
        }
    }
    posteriors
}

/// Mean and variance of the residual's prediction over all paths.
fn residual_prediction<T: RealField + Copy, const LEVELS: usize>(all: &[Paths<T, LEVELS>]) -> (T, T) {
    let mut means = [[T::zero(); LEVELS]; 2];
    for paths in all {
        for mode in 0..2 * LEVELS {
            *place(&mut means, mode) += of(&paths.prior, mode) * of(&paths.residual, mode);
        }
    }
    let mean = sum(&means);
    let mut variances = [[T::zero(); LEVELS]; 2];
    for paths in all {
        for mode in 0..2 * LEVELS {
            let spread = of(&paths.residual, mode) - mean;
            *place(&mut variances, mode) +=
                of(&paths.prior, mode) * (of(&paths.variance, mode) + spread * spread);
        }
    }
    (mean, sum(&variances))
}

/// Sum over all modes.
fn sum<T: RealField + Copy, const LEVELS: usize>(of_modes: &PerMode<T, LEVELS>) -> T {
    of_modes.as_flattened().iter().fold(T::zero(), |sum, &of_mode| sum + of_mode)
}

/// Step 5 [HLT-5]: nothing below the floor, sum one.
fn floored<T: RealField + Copy, const LEVELS: usize>(weights: PerMode<T, LEVELS>) -> PerMode<T, LEVELS> {
    let floor = convert(PROBABILITY_FLOOR);
    let raised = weights.map(|row| row.map(|weight| select(weight > floor, weight, floor)));
    let total = sum(&raised);
    raised.map(|row| row.map(|weight| weight / total))
}

saved!([T: Blank, const LEVELS: usize] Recursion<T, LEVELS> { weights, conditionals, jump_variance, residual_variance, gate_squared });
