//! What the filter, the bank and the likelihood search need of an estimate, whatever its states.

use core::fmt::Debug;

use nalgebra::RealField;

use crate::number::{real, select};
use crate::saved::{Blank, saved};

/// What a measurement said that the prediction did not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<T> {
    /// ν = z − H x̂⁻, m/s.
    pub value: T,
    /// S = H P⁻ Hᵀ + r², (m/s)².
    pub variance: T,
    /// r², (m/s)².
    pub noise: T,
}

impl<T: RealField + Copy> Innovation<T> {
    /// Normalised innovation squared ν²/S.
    #[inline]
    pub fn nis(&self) -> T {
        self.value * self.value / self.variance
    }

    /// Its share of the log-likelihood, −½(ln S + ν²/S); the constant −½ ln 2π is left out.
    #[inline]
    pub fn log_likelihood(&self) -> T {
        -real::<T>(0.5) * (self.variance.ln() + self.nis())
    }
}

/// Mean and covariance of a state whose first component is the measured velocity error.
///
/// Never panics; the work of every method is the same whatever the numbers.
pub trait Kernel<T: RealField + Copy>: Copy + Debug + Sized {
    /// What carries it over a step.
    type Model: Copy + Debug;

    /// Mean of [ΔV, δ, a, ω]: m/s, rad, m/s², rad/s.
    fn mean(&self) -> [T; 4];

    /// Variances of [ΔV, δ, a, ω].
    fn variances(&self) -> [T; 4];

    /// x ← Φ x, P ← Φ P Φᵀ + Q.
    fn predict(&mut self, model: &Self::Model);

    /// What a velocity with noise variance `variance` would say.
    #[inline]
    fn innovation(&self, velocity: T, variance: T) -> Innovation<T> {
        Innovation {
            value: velocity - self.mean()[0],
            variance: self.variances()[0] + variance,
            noise: variance,
        }
    }

    /// Adds to the variance of ΔV, (m/s)².
    fn spread_velocity(&mut self, variance: T);

    /// The innovation of a velocity before which, where `condition` holds, ΔV may have jumped.
    ///
    /// The variance of the jump is the most likely one, ν² − S, or zero where the velocity was
    /// foreseen. So an estimate that was right stays as it is, and one that was not takes the velocity
    /// and keeps the rest. What a jump costs in likelihood grows with ln ν only.
    #[inline]
    fn after_jump_if(&mut self, condition: bool, innovation: Innovation<T>) -> Innovation<T> {
        let Innovation { value, variance, noise } = innovation;
        let excess = value * value - variance;
        let jump = select(condition & (excess > T::zero()), excess, T::zero());
        self.spread_velocity(jump);
        Innovation { value, variance: variance + jump, noise }
    }

    /// Corrects by an innovation, in the Joseph form (I − KH) P (I − KH)ᵀ + K r² Kᵀ. Its first row is r² Kᵀ, which is
    /// formed as such: nothing cancels there.
    ///
    /// `used` = false leaves mean and covariance as they are, with the same work.
    fn correct(&mut self, innovation: &Innovation<T>, used: bool);

    /// Every mean is finite, every variance finite and positive. A covariance that is not finite anywhere else has no
    /// finite variance of ΔV one prediction later.
    fn is_sound(&self) -> bool;

    /// Starts again where `restart` says so; with the same work where it does not.
    fn restart_if(&mut self, restart: &Restart<T>, prior: &Self, most: &Farthest<T>);
}

/// Whether, and from what, a filter starts again: without correlations, from its own means and its own variances
/// multiplied. A mean farther away than the limit says nothing and gives way to the prior's; variances end at the limit,
/// where single precision fails.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restart<T> {
    /// Whether.
    pub condition: bool,
    /// Velocity error from now on, m/s, whether or not the filter starts again.
    pub velocity: T,
    /// Its variance where the filter starts again, (m/s)².
    pub velocity_variance: T,
    /// What the other variances are multiplied by.
    pub factor: T,
    /// The other variances are the prior's.
    pub variance_of_prior: bool,
}

/// How far [ΔV, δ, a, ω] may be from zero, and how large their variances, when a filter starts again; ΔV may be
/// anywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Farthest<T> {
    pub(super) mean: [T; 4],
    pub(super) variance: [T; 4],
}

impl<T: RealField + Copy> Farthest<T> {
    /// So many times the standard deviations of a prior.
    pub fn of<K: Kernel<T>>(prior: &K, times: T) -> Self {
        let variance = prior.variances().map(|p| p * (times * times));
        Self { mean: variance.map(T::sqrt), variance }
    }
}

/// How much of what a measurement takes from a variance is taken.
///
/// P⁻ comes to the correction with rounding errors of a few ε √(p_ii p_jj). Where a measurement takes nearly all of a variance,
/// as the first one after a gap does, they are as large as what is left, and would make correlations greater than one: so
/// 32 ε of what is taken stays in each variance. Where little is taken, in the steady state, that is nothing.
#[inline]
pub(super) fn certain<T: RealField + Copy>() -> T {
    T::one() - real::<T>(32.0) * T::default_epsilon()
}

/// Every number is finite: zero times any other number is none. Fewer instructions than looking at each.
#[inline]
pub(super) fn are_finite<'a, T: RealField + Copy>(values: impl Iterator<Item = &'a T>) -> bool {
    let zeros = values.map(|&x| x * T::zero()).reduce(|sum, zero| sum + zero);
    zeros.is_none_or(|sum| sum == T::zero())
}

/// The value, or what it may be at most.
#[inline]
pub(super) fn at_most<T: RealField + Copy>(value: T, most: T) -> T {
    select(value < most, value, most)
}

saved!([T: Blank] Farthest<T> { mean, variance });
