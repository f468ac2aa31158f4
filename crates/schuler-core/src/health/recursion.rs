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

use super::conditional::{Conditional, JumpMotion, Prediction};
use super::config::HealthConfig;
use super::span::Span;
use crate::number::select;
use crate::saved::{Blank, saved};

/// Floor under the mode probabilities, so that every mode can recover.
const PROBABILITY_FLOOR: f64 = 1e-9;
/// A mode whose share of the posterior is below this merges its paths by their prior weights.
const NEGLIGIBLE_SHARE: f64 = 1e-30;

/// Keeps the arguments of the exponential where it is always the same work: below −1.5 ln 2 …
const EXPONENT_SHIFT: f64 = 2.0;
/// … and above those at which it underflows in single precision. Paths so much worse than the best, in squares of
/// standard deviations, have no share.
const WORST: f64 = 160.0;

/// A quantity for each mode: first index λ (jump absent, present), second index the level of noise.
pub(super) type PerMode<Q, const LEVELS: usize> = [[Q; LEVELS]; 2];

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
}

impl<T: RealField + Copy> Evidence<T> {
    /// Of a residual that was not used.
    pub(super) fn none() -> Self {
        let zero = T::zero();
        Self { innovation: zero, variance: zero, log_likelihood: zero, out_of_model: false }
    }
}

/// The paths from one mode i to all levels of noise under one λ. They share the prediction.
#[derive(Clone, Copy)]
struct Fan<T, const LEVELS: usize> {
    prediction: Prediction<T>,
    /// v = d − H X, m/s.
    innovation: T,
    paths: [Path<T>; LEVELS],
}

/// The path from one mode i to one mode r.
#[derive(Clone, Copy)]
struct Path<T> {
    /// w(i) Π(i, r).
    prior: T,
    /// Variance that the radio's noise adds to ε on the way, (m/s)².
    level_noise: T,
    /// 1/S, S the variance of the residual's prediction, 1/(m/s)².
    inverse_variance: T,
    /// v²/S.
    q: T,
    /// W(i, r), not normalised.
    posterior: T,
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
        let mut fans: [PerMode<_, LEVELS>; 2] = array::from_fn(|to| self.fans(span, d, to));

        // Likelihoods relative to the best path's, so that they cannot all vanish.
        let limit = T::max_value().unwrap_or(self.gate_squared);
        let better = |q: T, path: &Path<T>| select((path.prior > T::zero()) & (path.q < q), path.q, q);
        let mut best = limit;
        for fan in fans.as_flattened().as_flattened() {
            best = fan.paths.iter().fold(best, better);
        }
        let out_of_model = present && (best > self.gate_squared);
        let usable = present && !out_of_model;
        let half = convert::<f64, T>(0.5);
        let (shift, worst) = (convert::<f64, T>(EXPONENT_SHIFT), convert::<f64, T>(WORST));
        let mut total = T::zero();
        for fan in fans.as_flattened_mut().as_flattened_mut() {
            for path in &mut fan.paths {
                let worse = select(path.q > best, path.q - best, T::zero());
                let worse = select(worse < worst, worse, worst);
                let fit = (-half * worse - shift).exp() * path.inverse_variance.sqrt();
                path.posterior = path.prior * select(usable, fit, T::one());
                total += path.posterior;
            }
        }

        let per_total = T::one() / total;
        let mut after = *self;
        for ((fans, weights), conditionals) in
            fans.iter().zip(&mut after.weights).zip(&mut after.conditionals)
        {
            for (level, (weight, conditional)) in weights.iter_mut().zip(conditionals).enumerate() {
                (*weight, *conditional) = merge(fans, level, per_total, usable);
            }
        }
        after.weights = floored(after.weights);

        let (predicted, variance) = residual_prediction(&fans);
        let log_likelihood = total.ln() + shift - half * (best + T::two_pi().ln());
        let evidence = Evidence {
            innovation: select(present, d - predicted, T::zero()),
            variance,
            log_likelihood: select(usable, log_likelihood, T::zero()),
            out_of_model,
        };
        (after, evidence)
    }

    /// First two moments of X over all modes.
    pub(super) fn over_modes(&self) -> Conditional<T> {
        let components: PerMode<_, LEVELS> = array::from_fn(|jump| {
            array::from_fn(|level| (self.weights[jump][level], self.conditionals[jump][level]))
        });
        Conditional::merged(components.as_flattened())
    }

    /// False if a number is NaN or infinite or a variance is negative.
    pub(super) fn is_sound(&self) -> bool {
        let weights = self.weights.iter().flatten().all(ComplexField::is_finite);
        weights && self.conditionals.iter().flatten().all(Conditional::is_sound)
    }

    /// Step 1 and the variances of step 2 [HLT-5]: all modes predicted to λ = `to`.
    fn fans(&self, span: &Span<T, LEVELS>, d: T, to: usize) -> PerMode<Fan<T, LEVELS>, LEVELS> {
        let lambda = if to == 1 { T::one() } else { T::zero() };
        array::from_fn(|from| {
            let jump = JumpMotion {
                kept: if from & to == 1 { span.unbroken } else { T::zero() },
                fresh_variance: if to == 1 { self.jump_variance } else { T::zero() },
            };
            array::from_fn(|from_level| {
                let conditional = &self.conditionals[from][from_level];
                let prediction = conditional.predict(span, jump, lambda, self.residual_variance);
                let weight = self.weights[from][from_level] * span.jump_transition[from][to];
                let innovation = d - prediction.residual;
                let paths = array::from_fn(|to_level| {
                    let level_noise = span.level_noise[from_level][to_level];
                    let inverse_variance = T::one() / (prediction.variance + level_noise);
                    Path {
                        prior: weight * span.level_transition[from_level][to_level],
                        level_noise,
                        inverse_variance,
                        q: innovation * innovation * inverse_variance,
                        posterior: T::zero(),
                    }
                });
                Fan { prediction, innovation, paths }
            })
        })
    }
}

/// Steps 2 to 4 [HLT-5] for one mode r: updates the paths to it and merges them to their first two moments.
/// Returns the mode's share of the posterior and its Gaussian.
fn merge<T: RealField + Copy, const LEVELS: usize>(
    fans: &PerMode<Fan<T, LEVELS>, LEVELS>,
    level: usize,
    per_total: T,
    usable: bool,
) -> (T, Conditional<T>) {
    let mut share = T::zero();
    let mut prior = T::zero();
    for fan in fans.as_flattened() {
        share += fan.paths[level].posterior * per_total;
        prior += fan.paths[level].prior;
    }
    let negligible = share < convert(NEGLIGIBLE_SHARE);
    let scale = T::one() / select(negligible, prior, share);
    let components: PerMode<_, LEVELS> = array::from_fn(|from| {
        array::from_fn(|from_level| {
            let fan = &fans[from][from_level];
            let path = &fan.paths[level];
            let weight = scale * select(negligible, path.prior, path.posterior * per_total);
            let precision = select(usable, path.inverse_variance, T::zero());
            (weight, fan.prediction.update(path.level_noise, precision, fan.innovation))
        })
    });
    (share, Conditional::merged(components.as_flattened()))
}

/// Mean and variance of the residual's prediction over all paths.
fn residual_prediction<T: RealField + Copy, const LEVELS: usize>(
    fans: &[PerMode<Fan<T, LEVELS>, LEVELS>; 2],
) -> (T, T) {
    let fans = fans.as_flattened().as_flattened();
    let mut mean = T::zero();
    for fan in fans {
        for path in &fan.paths {
            mean += path.prior * fan.prediction.residual;
        }
    }
    let mut variance = T::zero();
    for fan in fans {
        let spread = fan.prediction.residual - mean;
        for path in &fan.paths {
            variance += path.prior * (fan.prediction.variance + path.level_noise + spread * spread);
        }
    }
    (mean, variance)
}

/// Step 5 [HLT-5]: nothing below the floor, sum one.
fn floored<T: RealField + Copy, const LEVELS: usize>(weights: PerMode<T, LEVELS>) -> PerMode<T, LEVELS> {
    let floor = convert(PROBABILITY_FLOOR);
    let raised = weights.map(|row| row.map(|weight| select(weight > floor, weight, floor)));
    let total = raised.iter().flatten().fold(T::zero(), |sum, &weight| sum + weight);
    raised.map(|row| row.map(|weight| weight / total))
}

saved!([T: Blank, const LEVELS: usize] Recursion<T, LEVELS> { weights, conditionals, jump_variance, residual_variance, gate_squared });
