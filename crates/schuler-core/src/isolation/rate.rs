//! The body rate from all five gyros, or from the four that are left.
//!
//! Least squares with each gyro weighted by its noise. Leaving a gyro out is taking the fault out of its reading
//! that makes it agree with the other four: the same rate, without a second fit. Equation id FDI-9.
//!
//! In: measurements divided by their σ. Out: rate in body axes, rad/s, and its covariance, (rad/s)².
use nalgebra::{Matrix3, RealField, SVector, Vector3};

use super::orthogonal::ThinQr;
use super::parity::{GYROS, ParitySpace};
use crate::number::select;
use crate::saved::{Blank, saved};

/// Weighted least squares over all five gyros, and over every four of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateEstimator<T> {
    /// What the rate takes from each whitened measurement, rad/s.
    gains: [Vector3<T>; GYROS],
    /// Covariance of the rate from all five, (rad/s)².
    covariance: Matrix3<T>,
}

impl<T: RealField + Copy> RateEstimator<T> {
    /// The fit by the inverse of the triangular factor: `ω̂ = σ_ref R⁻¹ Qᵀ y`.
    pub fn new(space: &ParitySpace<T>) -> Self {
        let qr = ThinQr::new(space.geometry().axes());
        let inverse = qr.triangle.solve_upper_triangular(&Matrix3::identity()).unwrap_or_else(Matrix3::zeros);
        let gain = inverse * qr.range().transpose() * space.geometry().reference_sigma();
        Self { gains: gain.data.0.map(Vector3::from), covariance: gain * gain.transpose() }
    }

    /// The rate from all gyros, or from those without `excluded`, whose reading has no part in it, rad/s. The work is
    /// the same where none is excluded. `[FDI-9]`
    #[inline]
    pub fn rate(
        &self,
        space: &ParitySpace<T>,
        whitened: &SVector<T, GYROS>,
        excluded: Option<usize>,
    ) -> Vector3<T> {
        let mut readings = *whitened;
        for (gyro, reading) in readings.iter_mut().enumerate() {
            *reading = select(Some(gyro) == excluded, T::zero(), *reading);
        }
        // The fault of the excluded gyro against the reading of nothing that stands for it, and its part in the rate.
        let gyro = excluded.unwrap_or(0);
        let fault = space.fault_size(&space.parity(&readings), gyro);
        let fault = select(excluded.is_some(), fault, T::zero());
        let mut rate = self.gain(Some(gyro)) * -fault;
        for (gain, &reading) in self.gains.iter().zip(&readings) {
            rate += gain * reading;
        }
        rate
    }

    /// Covariance of that rate from the noise of the gyros in use, (rad/s)². `[FDI-9]`
    pub fn covariance(&self, space: &ParitySpace<T>, excluded: Option<usize>) -> Matrix3<T> {
        let (gyro, share) = (excluded.unwrap_or(0), select(excluded.is_some(), T::one(), T::zero()));
        let lost = self.gain(Some(gyro)) * (share / space.sensitivity_of(gyro));
        self.covariance + lost * lost.transpose()
    }

    /// What the rate takes from a gyro; nothing for none.
    fn gain(&self, gyro: Option<usize>) -> Vector3<T> {
        gyro.and_then(|gyro| self.gains.get(gyro).copied()).unwrap_or_else(Vector3::zeros)
    }
}

saved!([T: Blank] RateEstimator<T> { gains, covariance });
