//! The paths from one mode to all modes [HLT-5]. Numbers of one kind stand side by side, that of each path next to those of the
//! others: so a host works on several paths at once, and the target on one after another.
use core::array;

use nalgebra::RealField;

use super::conditional::{Conditional, JumpMotion, Prediction, spread};
use super::span::Span;
use crate::number::select;

/// A quantity for each mode: first index λ (jump absent, present), second index the level of noise.
pub(super) type PerMode<Q, const LEVELS: usize> = [[Q; LEVELS]; 2];

/// The quantity of one mode. Modes are numbered in the order in which they stand.
#[inline(always)]
pub(super) fn of<Q: Copy, const LEVELS: usize>(quantity: &PerMode<Q, LEVELS>, mode: usize) -> Q {
    quantity.as_flattened()[mode]
}

/// The place of one mode's quantity.
#[inline(always)]
pub(super) fn place<Q, const LEVELS: usize>(quantity: &mut PerMode<Q, LEVELS>, mode: usize) -> &mut Q {
    &mut quantity.as_flattened_mut()[mode]
}

/// Puts several numbers of one mode into their places.
#[inline(always)]
fn put<T: Copy, const N: usize, const LEVELS: usize>(
    quantities: &mut [PerMode<T, LEVELS>; N],
    mode: usize,
    numbers: &[T; N],
) {
    for (quantity, number) in quantities.iter_mut().zip(numbers) {
        *place(quantity, mode) = *number;
    }
}

/// Several numbers of one mode from their places.
#[inline(always)]
fn take<T: Copy, const N: usize, const LEVELS: usize>(
    quantities: &[PerMode<T, LEVELS>; N],
    mode: usize,
) -> [T; N] {
    array::from_fn(|i| of(&quantities[i], mode))
}

/// A Gaussian of X for each mode.
#[derive(Clone, Copy)]
pub(super) struct Gaussians<T, const LEVELS: usize> {
    mean: [PerMode<T, LEVELS>; 4],
    covariance: [PerMode<T, LEVELS>; 10],
}

/// What all paths have in common.
pub(super) struct Common<'a, T, const LEVELS: usize> {
    span: &'a Span<T, LEVELS>,
    /// d, the residual, m/s; zero if there is none.
    residual: T,
    /// `Rq`, (m/s)².
    residual_variance: T,
    /// λ at the end, zero or one.
    lambda: PerMode<T, LEVELS>,
    /// Variance of a fresh jump's value, (m/s)²; zero where there is no jump at the end.
    fresh_variance: PerMode<T, LEVELS>,
}

/// The paths from one mode i to all modes r.
#[derive(Clone, Copy)]
pub(super) struct Paths<T, const LEVELS: usize> {
    /// As predicted. The mean is overwritten by that after the residual while paths are merged, and the covariance is not.
    estimate: Gaussians<T, LEVELS>,
    /// P Hᵀ.
    cross: [PerMode<T, LEVELS>; 4],
    /// H X, the residual predicted, m/s.
    pub(super) residual: PerMode<T, LEVELS>,
    /// Variance that the radio's noise adds to ε on the way, (m/s)².
    level_noise: PerMode<T, LEVELS>,
    /// S, variance of the residual's prediction, (m/s)².
    pub(super) variance: PerMode<T, LEVELS>,
    /// 1/S, 1/(m/s)².
    pub(super) inverse_variance: PerMode<T, LEVELS>,
    /// (d − H X)²/S.
    pub(super) q: PerMode<T, LEVELS>,
    /// w(i) Π(i, r).
    pub(super) prior: PerMode<T, LEVELS>,
    /// W(i, r), not normalised.
    pub(super) posterior: PerMode<T, LEVELS>,
    /// Its share, or that of the prior, among those that lead to the same mode.
    pub(super) share: PerMode<T, LEVELS>,
}

impl<'a, T: RealField + Copy, const LEVELS: usize> Common<'a, T, LEVELS> {
    /// `residual`: d, m/s; `residual_variance`, `jump_variance`: `Rq` and `γ_m²`, (m/s)².
    pub(super) fn new(
        span: &'a Span<T, LEVELS>,
        residual: T,
        residual_variance: T,
        jump_variance: T,
    ) -> Self {
        let [none, one, fresh] = [T::zero(), T::one(), jump_variance].map(|number| [number; LEVELS]);
        Self { span, residual, residual_variance, lambda: [none, one], fresh_variance: [none, fresh] }
    }
}

impl<T: RealField + Copy, const LEVELS: usize> Paths<T, LEVELS> {
    pub(super) fn none() -> Self {
        let zero = [[T::zero(); LEVELS]; 2];
        Self {
            estimate: Gaussians::zero(),
            cross: [zero; 4],
            residual: zero,
            level_noise: zero,
            variance: zero,
            inverse_variance: zero,
            q: zero,
            prior: zero,
            posterior: zero,
            share: zero,
        }
    }

    /// Steps 1 and 2 [HLT-5]: predicts from the mode with this λ and level of noise, and of this weight, to all modes, and compares
    /// with the residual.
    pub(super) fn lead(
        &mut self,
        [jump, level]: [usize; 2],
        weight: T,
        conditional: &Conditional<T>,
        common: &Common<'_, T, LEVELS>,
    ) {
        let span = common.span;
        self.prior = span.jump_transition[jump].map(|of_jump| {
            let weight = weight * of_jump;
            span.level_transition[level].map(|of_level| weight * of_level)
        });
        self.level_noise = [span.level_noise[level]; 2];
        let kept = [[T::zero(); LEVELS], [select(jump == 1, span.unbroken, T::zero()); LEVELS]];
        for mode in 0..2 * LEVELS {
            let jump = JumpMotion { kept: of(&kept, mode), fresh_variance: of(&common.fresh_variance, mode) };
            let lambda = of(&common.lambda, mode);
            let prediction = conditional.predict(span, jump, lambda, common.residual_variance);
            put(&mut self.estimate.mean, mode, &prediction.estimate.mean);
            put(&mut self.estimate.covariance, mode, &prediction.estimate.covariance);
            put(&mut self.cross, mode, &prediction.cross);
            let variance = prediction.variance + of(&self.level_noise, mode);
            let inverse_variance = T::one() / variance;
            let innovation = common.residual - prediction.residual;
            *place(&mut self.residual, mode) = prediction.residual;
            *place(&mut self.variance, mode) = variance;
            *place(&mut self.inverse_variance, mode) = inverse_variance;
            *place(&mut self.q, mode) = innovation * innovation * inverse_variance;
        }
    }

    /// The prediction of one path, and its gain K, which is zero if the residual is not `usable`.
    #[inline(always)]
    fn gained(&self, mode: usize, common: &Common<'_, T, LEVELS>, usable: bool) -> (Prediction<T>, [T; 4]) {
        let prediction = Prediction {
            estimate: self.estimate.of(mode),
            cross: take(&self.cross, mode),
            lambda: of(&common.lambda, mode),
            residual_variance: common.residual_variance,
            // With the radio's noise, unlike where it is predicted; it is not asked for any more.
            variance: of(&self.variance, mode),
            residual: of(&self.residual, mode),
        };
        let precision = select(usable, of(&self.inverse_variance, mode), T::zero());
        (prediction, prediction.gain(of(&self.level_noise, mode), precision))
    }
}

impl<T: RealField + Copy, const LEVELS: usize> Gaussians<T, LEVELS> {
    fn zero() -> Self {
        let zero = [[T::zero(); LEVELS]; 2];
        Self { mean: [zero; 4], covariance: [zero; 10] }
    }

    /// Steps 3 and 4 [HLT-5]: takes all paths over the residual, if it is `usable`, and merges them by their shares to the first two
    /// moments of the mode they lead to.
    pub(super) fn merged(
        paths: &mut [Paths<T, LEVELS>],
        common: &Common<'_, T, LEVELS>,
        usable: bool,
    ) -> Self {
        let mut all = Self::zero();
        for paths in &mut *paths {
            for mode in 0..2 * LEVELS {
                let (prediction, gain) = paths.gained(mode, common, usable);
                let mean = prediction.mean_after(gain, common.residual - prediction.residual);
                let share = of(&paths.share, mode);
                put(&mut paths.estimate.mean, mode, &mean);
                for (all, mean) in all.mean.iter_mut().zip(mean) {
                    *place(all, mode) += share * mean;
                }
            }
        }
        for paths in paths {
            for mode in 0..2 * LEVELS {
                let (prediction, gain) = paths.gained(mode, common, usable);
                let covariance = prediction.covariance_after(gain, of(&paths.level_noise, mode));
                let [x0, x1, x2, x3] = prediction.estimate.mean;
                let [m0, m1, m2, m3] = take(&all.mean, mode);
                let spread = spread([x0 - m0, x1 - m1, x2 - m2, x3 - m3]);
                let share = of(&paths.share, mode);
                for ((all, covariance), spread) in all.covariance.iter_mut().zip(covariance).zip(spread) {
                    *place(all, mode) += share * (covariance + spread);
                }
            }
        }
        all
    }

    /// False if any number is NaN or infinite or a variance is negative.
    pub(super) fn are_sound(&self) -> bool {
        let mut sizes = [[T::zero(); LEVELS]; 2];
        for numbers in self.mean.iter().chain(&self.covariance) {
            for mode in 0..2 * LEVELS {
                *place(&mut sizes, mode) += of(numbers, mode).abs();
            }
        }
        let [p00, _, _, _, p11, _, _, p22, _, p33] = &self.covariance;
        let mut sound = true;
        for mode in 0..2 * LEVELS {
            sound &= of(&sizes, mode).is_finite();
            for variances in [p00, p11, p22, p33] {
                sound &= of(variances, mode) >= T::zero();
            }
        }
        sound
    }

    #[inline(always)]
    pub(super) fn of(&self, mode: usize) -> Conditional<T> {
        Conditional { mean: take(&self.mean, mode), covariance: take(&self.covariance, mode) }
    }
}
