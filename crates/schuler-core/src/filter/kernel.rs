//! What the filter, the bank and the likelihood search need of an estimate, whatever its states.

use core::fmt::Debug;

use nalgebra::RealField;

use crate::number::real;

/// What a measurement said that the prediction did not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<T> {
    /// ν = z − H x̂⁻, m/s.
    pub value: T,
    /// S = H P⁻ Hᵀ + r², (m/s)².
    pub variance: T,
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
pub trait Kernel<T: RealField + Copy>: Copy + Debug {
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
        Innovation { value: velocity - self.mean()[0], variance: self.variances()[0] + variance }
    }

    /// Corrects by an innovation, in the Joseph form (I − KH) P (I − KH)ᵀ + K r² Kᵀ.
    ///
    /// `used` = false leaves mean and covariance as they are, with the same work.
    fn correct(&mut self, innovation: &Innovation<T>, used: bool);

    /// Every variance is positive and everything is finite.
    fn is_sound(&self) -> bool;

    /// The same mean but for the velocity, without correlations and with the standard deviations of the other
    /// states multiplied. Neither their means nor their standard deviations go beyond `most` ([ΔV, δ, a, ω], that
    /// of ΔV is not used): far from there the model says nothing, and single precision fails.
    #[must_use]
    fn spread_out(&self, velocity: T, velocity_sigma: T, factor: T, most: [T; 4]) -> Self;

    /// This covariance about another's mean.
    #[must_use]
    fn with_mean_of(&self, other: &Self) -> Self;
}
