//! The body rate from all five gyros, or from the four that are left.
//!
//! Least squares with each gyro weighted by its noise, formed once for the six sets of gyros. Equation id FDI-9.
//!
//! In: measurements divided by their σ. Out: rate in body axes, rad/s, and its covariance, (rad/s)².
use nalgebra::{Matrix3, RealField, SMatrix, SVector, Vector3};

use super::orthogonal::ThinQr;
use super::parity::{GYROS, ParitySpace};

/// Weighted least squares over one set of gyros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateFit<T> {
    /// Maps whitened measurements to the rate, rad/s; the column of an excluded gyro is zero.
    gain: SMatrix<T, 3, GYROS>,
    /// Covariance of the rate, (rad/s)².
    covariance: Matrix3<T>,
    /// Standard deviations of the rate, rad/s.
    sigma: Vector3<T>,
}

impl<T: RealField + Copy> RateFit<T> {
    /// Body rate, rad/s.
    #[inline]
    pub fn rate(&self, whitened: &SVector<T, GYROS>) -> Vector3<T> {
        self.gain * whitened
    }

    /// Covariance of the rate, (rad/s)².
    pub fn covariance(&self) -> &Matrix3<T> {
        &self.covariance
    }

    /// Standard deviations of the rate, rad/s.
    pub fn sigma(&self) -> &Vector3<T> {
        &self.sigma
    }
}

/// The fits over all five gyros and over every four of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateEstimator<T> {
    all: RateFit<T>,
    without: [RateFit<T>; GYROS],
}

impl<T: RealField + Copy> RateEstimator<T> {
    /// Forms the six fits. A geometry that passed the guards of [`ParitySpace`] has full rank without any one gyro.
    pub fn new(space: &ParitySpace<T>) -> Self {
        let all = fit(space, None);
        let mut without = [all; GYROS];
        for (gyro, slot) in without.iter_mut().enumerate() {
            *slot = fit(space, Some(gyro));
        }
        Self { all, without }
    }

    /// The fit over all gyros, or over those without `excluded`.
    #[inline]
    pub fn select(&self, excluded: Option<usize>) -> &RateFit<T> {
        excluded.and_then(|gyro| self.without.get(gyro)).unwrap_or(&self.all)
    }
}

/// The fit over one set of gyros by the inverse of the triangular factor: `ω̂ = σ_ref R⁻¹ Qᵀ y`.
fn fit<T: RealField + Copy>(space: &ParitySpace<T>, excluded: Option<usize>) -> RateFit<T> {
    let mut axes = *space.geometry().axes();
    for (row, mut axis) in axes.row_iter_mut().enumerate() {
        if Some(row) == excluded {
            axis.fill(T::zero());
        }
    }
    let qr = ThinQr::new(&axes);
    let factor = qr.triangle.solve_upper_triangular(&Matrix3::identity()).unwrap_or_else(Matrix3::zeros)
        * space.geometry().reference_sigma();
    let covariance = factor * factor.transpose();
    RateFit {
        gain: factor * qr.range().transpose(),
        covariance,
        sigma: covariance.diagonal().map(nalgebra::ComplexField::sqrt),
    }
}
