//! How the modelled errors move over a span of n steps without a residual, in closed form [HLT-3], [HLT-6].
//!
//! Prediction is linear once the mode at both ends of the span is fixed, and what lies between can be averaged
//! beforehand: transition matrices become their powers, the radio's noise becomes its mean over the paths of
//! levels, and a jump has a probability of having lasted unbroken. The moments after one span of n steps are
//! therefore those after n predictions of one step, at the work of one. Spans compose, so that any n is put
//! together from those of 1, 2, 3, 4, 8, 12, 16 … steps with a fixed number of operations.
use core::array;

use nalgebra::RealField;

use super::config::HealthConfig;
use crate::number::select;
use crate::saved::{Blank, saved};

/// Digits of the number of steps, to the base [`BASE`].
const DIGITS: usize = 5;
const BASE: usize = 4;

/// The longest span, steps.
pub const MAX_SPAN_STEPS: u32 = BASE.pow(DIGITS as u32) as u32 - 1;

/// Motion over a number of steps; what depends on the mode is given the mode at both ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span<T, const LEVELS: usize> {
    /// `f^n`, autocorrelation of the radio error over the span.
    pub(super) correlation: T,
    /// n·dt, s.
    pub(super) duration: T,
    /// Variances and covariance that the inertial walk adds to (ξ, ξ), (ξ, μ), (μ, μ).
    pub(super) inertial_noise: [T; 3],
    /// `P_λ^n`.
    pub(super) jump_transition: [[T; 2]; 2],
    /// Probability that a jump present at both ends has lasted through every step between.
    pub(super) unbroken: T,
    /// `P_γ^n`.
    pub(super) level_transition: [[T; LEVELS]; LEVELS],
    /// Variance that the radio's noise adds to ε, averaged over the paths of levels between both ends, (m/s)².
    pub(super) level_noise: [[T; LEVELS]; LEVELS],
}

/// A span in what adds up: probabilities instead of conditional ones.
#[derive(Clone, Copy, Debug)]
struct Stage<T, const LEVELS: usize> {
    correlation: T,
    duration: T,
    inertial_noise: [T; 3],
    jump_transition: [[T; 2]; 2],
    /// Probability that a jump present at the beginning lasts through every step.
    lasts: T,
    level_transition: [[T; LEVELS]; LEVELS],
    /// The level's transition times the variance that the radio's noise adds to ε on the way, (m/s)².
    weighted_noise: [[T; LEVELS]; LEVELS],
}

impl<T: RealField + Copy, const LEVELS: usize> Stage<T, LEVELS> {
    /// No step: nothing moves.
    fn none() -> Self {
        Self {
            correlation: T::one(),
            duration: T::zero(),
            inertial_noise: [T::zero(); 3],
            jump_transition: identity(),
            lasts: T::one(),
            level_transition: identity(),
            weighted_noise: [[T::zero(); LEVELS]; LEVELS],
        }
    }

    /// One step of a validated configuration [HLT-3].
    fn one(config: &HealthConfig<T, LEVELS>) -> Self {
        let dt = config.step_s;
        let two = T::one() + T::one();
        let exponent = dt / config.radio.tau_s;
        // 1 − f² without the cancellation at dt ≪ τ.
        let innovation = -(-two * exponent).exp_m1();
        let jump_transition = config.jump.transition.map(normalised);
        let level_transition = config.radio.transition.map(normalised);
        let walk = |density: T| density * density * dt;
        let noise = config.radio.sigma.map(|sigma| sigma * sigma * innovation);
        Self {
            correlation: (-exponent).exp(),
            duration: dt,
            inertial_noise: [
                walk(config.inertial.random_walk),
                T::zero(),
                walk(config.inertial.drift_random_walk),
            ],
            jump_transition,
            lasts: jump_transition[1][1],
            level_transition,
            weighted_noise: level_transition.map(|row| array::from_fn(|to| row[to] * noise[to])),
        }
    }

    /// This span followed by `next`.
    fn then(&self, next: &Self) -> Self {
        let (t, two) = (next.duration, T::one() + T::one());
        let ([xx, xm, mm], [nxx, nxm, nmm]) = (self.inertial_noise, next.inertial_noise);
        let decay = next.correlation * next.correlation;
        let before = product(&self.weighted_noise, &next.level_transition);
        let mut weighted_noise = product(&self.level_transition, &next.weighted_noise);
        for (all, before) in weighted_noise.as_flattened_mut().iter_mut().zip(before.as_flattened()) {
            *all += decay * *before;
        }
        Self {
            correlation: self.correlation * next.correlation,
            duration: self.duration + t,
            inertial_noise: [xx + t * (two * xm + t * mm) + nxx, xm + t * mm + nxm, mm + nmm],
            jump_transition: product(&self.jump_transition, &next.jump_transition),
            lasts: self.lasts * next.lasts,
            level_transition: product(&self.level_transition, &next.level_transition),
            weighted_noise,
        }
    }

    fn span(&self) -> Span<T, LEVELS> {
        let mut level_noise = self.weighted_noise;
        let transitions = self.level_transition.as_flattened();
        for (noise, transition) in level_noise.as_flattened_mut().iter_mut().zip(transitions) {
            *noise = ratio_or_zero(*noise, *transition);
        }
        Span {
            correlation: self.correlation,
            duration: self.duration,
            inertial_noise: self.inertial_noise,
            jump_transition: self.jump_transition,
            unbroken: ratio_or_zero(self.lasts, self.jump_transition[1][1]),
            level_transition: self.level_transition,
            level_noise,
        }
    }
}

/// For each digit of the number of steps the spans of one, two and three times its place value.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpanLadder<T, const LEVELS: usize> {
    stages: [[Stage<T, LEVELS>; BASE - 1]; DIGITS],
}

impl<T: RealField + Copy, const LEVELS: usize> SpanLadder<T, LEVELS> {
    /// From a validated configuration.
    pub(super) fn new(config: &HealthConfig<T, LEVELS>) -> Self {
        let mut one = Stage::one(config);
        let stages = array::from_fn(|_| {
            let two = one.then(&one);
            let three = two.then(&one);
            let stages = [one, two, three];
            one = three.then(&one);
            stages
        });
        Self { stages }
    }

    /// The span of `steps` ≤ [`MAX_SPAN_STEPS`] steps. The work does not depend on `steps`.
    pub(super) fn span(&self, steps: u32) -> Span<T, LEVELS> {
        let none = Stage::none();
        let mut rest = steps;
        let mut stage = |[one, two, three]: &[Stage<T, LEVELS>; BASE - 1]| {
            let digit = rest % BASE as u32;
            rest /= BASE as u32;
            *select(digit == 3, three, select(digit == 2, two, select(digit == 1, one, &none)))
        };
        let [first, others @ ..] = &self.stages;
        let first = stage(first);
        others.iter().fold(first, |total, next| total.then(&stage(next))).span()
    }
}

fn normalised<T: RealField + Copy, const COLUMNS: usize>(row: [T; COLUMNS]) -> [T; COLUMNS] {
    let total = row.iter().fold(T::zero(), |total, &p| total + p);
    row.map(|p| p / total)
}

/// Of two matrices, by rows.
fn product<T: RealField + Copy, const SIZE: usize>(
    one: &[[T; SIZE]; SIZE],
    other: &[[T; SIZE]; SIZE],
) -> [[T; SIZE]; SIZE] {
    let mut product = [[T::zero(); SIZE]; SIZE];
    for (row, factors) in product.iter_mut().zip(one) {
        for (factor, others) in factors.iter().zip(other) {
            for (element, other) in row.iter_mut().zip(others) {
                *element += *factor * *other;
            }
        }
    }
    product
}

fn identity<T: RealField + Copy, const SIZE: usize>() -> [[T; SIZE]; SIZE] {
    array::from_fn(|row| array::from_fn(|column| if row == column { T::one() } else { T::zero() }))
}

/// 0 where the denominator is 0: a transition that does not exist.
fn ratio_or_zero<T: RealField + Copy>(numerator: T, denominator: T) -> T {
    let exists = denominator > T::zero();
    select(exists, numerator / select(exists, denominator, T::one()), T::zero())
}

saved!([T: Blank, const LEVELS: usize] Stage<T, LEVELS> {
    correlation,
    duration,
    inertial_noise,
    jump_transition,
    lasts,
    level_transition,
    weighted_noise,
});
saved!([T: Blank, const LEVELS: usize] SpanLadder<T, LEVELS> { stages });

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    /// Golden H1: the modes' transition matrix is the Kronecker product of the chains'.
    #[test]
    fn hlt_3_h1_mode_transitions() {
        let span = SpanLadder::new(&HealthConfig::<f64, 2>::doppler_against_inertial()).span(1);
        let row = |jump: usize, level: usize| {
            let mut row = [0.0; 4];
            for (to, p) in row.iter_mut().enumerate() {
                *p = span.jump_transition[jump][to / 2] * span.level_transition[level][to % 2];
            }
            row
        };
        let close = |found: [f64; 4], expected: [f64; 4], tolerance: f64| {
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < tolerance, "{found} instead of {expected}");
            }
        };
        close(row(0, 0), [0.9988892, 0.00055525, 0.00055525, 3.1e-7], 5.1e-8);
        close(row(1, 1), [0.00006944, 0.00826389, 0.00826389, 0.98340278], 5.1e-9);
        assert!((span.correlation - 0.9048374180).abs() < 5e-11);
        for (noise, gamma) in span.level_noise[0].iter().zip([0.12772718_f64, 0.38318154]) {
            assert!((noise.sqrt() - gamma).abs() < 5e-9);
        }
    }

    /// The span of n steps is the n-fold composition of one step, whatever its digits.
    #[test]
    fn hlt_6_span_is_the_composition_of_single_steps() {
        let mut config = HealthConfig::<f64, 3>::doppler_against_inertial_three_levels();
        config.inertial.drift_random_walk = 1e-4;
        let ladder = SpanLadder::new(&config);
        let one = Stage::one(&config);
        let mut composed = Stage::none();
        for steps in 0..=crate::repeats(MAX_SPAN_STEPS) {
            let (found, expected) = (ladder.span(steps), composed.span());
            let flat = |span: &Span<f64, 3>| {
                let mut all = std::vec![span.correlation, span.duration, span.unbroken];
                all.extend(span.inertial_noise);
                all.extend(span.jump_transition.as_flattened());
                all.extend(span.level_transition.as_flattened());
                all.extend(span.level_noise.as_flattened());
                all
            };
            for (found, expected) in flat(&found).iter().zip(flat(&expected)) {
                assert!(
                    (found - expected).abs() <= 1e-12 * (1.0 + expected.abs()),
                    "{steps}: {found} {expected}"
                );
            }
            composed = composed.then(&one);
        }
    }
}
