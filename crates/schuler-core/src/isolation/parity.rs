//! The space of five measurements that no rate can produce: two-dimensional, a line for each gyro.
//!
//! Source: Larin (2015), §§1–2; parity vectors after Potter and Suman (1977). Equation ids FDI-1, FDI-2.
//!
//! In: unit input axes `A` (5×3, one row a gyro) and the 1-σ noise of each gyro, rad/s.
//! Out: the parity matrix `V` (2×5) with `V A = 0`, `V Vᵀ = I`, for measurements divided by their σ. All
//! quantities are dimensionless.
use nalgebra::{RealField, SMatrix, SVector, Vector2};

use super::geometry::BlockGeometry;
use super::orthogonal::{ThinQr, columns, normalised};
use crate::config::ConfigError;
use crate::saved::{Blank, saved};

/// Number of gyros.
pub const GYROS: usize = 5;

/// The parity space of one geometry, whitened: built once, then constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParitySpace<T> {
    geometry: BlockGeometry<T, GYROS>,
    /// Parity matrix V.
    matrix: SMatrix<T, 2, GYROS>,
    /// `‖v_k‖`: what a fault of one `σ_k` in gyro k adds to the parity vector.
    sensitivity: [T; GYROS],
    /// Unit directions `u_k = v_k/‖v_k‖`.
    directions: [Vector2<T>; GYROS],
}

impl<T: RealField + Copy> ParitySpace<T> {
    /// Checks and whitens the axes and splits off the parity space by QR. V is unique up to an orthogonal factor; it
    /// is taken with gyro 0 on its first axis and gyro 1 on the positive side of its second. `[FDI-2]`
    ///
    /// # Errors
    /// Those of [`BlockGeometry::try_build`].
    pub fn try_build(axes: &[[T; 3]; GYROS], sigma: &[T; GYROS]) -> Result<Self, ConfigError> {
        let geometry = BlockGeometry::try_build(axes, sigma)?;
        let qr = ThinQr::new(geometry.axes());
        // The guards leave every gyro a part in the complement, and the parts of no two along one line.
        let (first, _) = normalised(&qr.complement(SVector::ith(0, T::one()), &[]));
        let (second, _) = normalised(&qr.complement(SVector::ith(1, T::one()), &[first]));
        let mut lines = [Vector2::zeros(); GYROS];
        for (line, (&x, &y)) in lines.iter_mut().zip(first.iter().zip(&second)) {
            *line = Vector2::new(x, y);
        }
        let (sensitivity, directions) = (lines.map(|v| v.norm()), lines.map(|v| v.normalize()));
        let matrix = columns(lines);
        Ok(Self { geometry, matrix, sensitivity, directions })
    }

    /// The checked and whitened axes.
    pub fn geometry(&self) -> &BlockGeometry<T, GYROS> {
        &self.geometry
    }

    /// Parity matrix V (2×5).
    pub fn matrix(&self) -> &SMatrix<T, 2, GYROS> {
        &self.matrix
    }

    /// `‖v_k‖` of each gyro.
    pub fn sensitivity(&self) -> &[T; GYROS] {
        &self.sensitivity
    }

    /// Unit parity directions `u_k = v_k/‖v_k‖`.
    pub fn directions(&self) -> &[Vector2<T>; GYROS] {
        &self.directions
    }

    /// Parity vector z = V y of measurements that were divided by their σ. `[FDI-1]`
    #[inline]
    pub fn parity(&self, whitened: &SVector<T, GYROS>) -> Vector2<T> {
        self.matrix * whitened
    }

    /// Size of the fault of a gyro that explains a parity vector best, `f̂ = v_kᵀp/‖v_k‖²`, in its σ. `[FDI-5]`
    #[inline]
    pub fn fault_size(&self, parity: &Vector2<T>, gyro: usize) -> T {
        let direction = self.directions.get(gyro).copied().unwrap_or_else(Vector2::zeros);
        direction.dot(parity) / self.sensitivity_of(gyro)
    }

    /// `‖v_k‖` of one gyro.
    #[inline]
    pub fn sensitivity_of(&self, gyro: usize) -> T {
        self.sensitivity.get(gyro).copied().unwrap_or_else(T::one)
    }

    /// GLT statistics `q_k` = (`u_kᵀ` s)²/N of a sum s of N parity vectors. `[FDI-1]`
    ///
    /// Without a fault each is chi-square distributed with one degree of freedom; the largest names the gyro.
    #[inline]
    pub fn likelihood(&self, sum: &Vector2<T>, samples: T) -> [T; GYROS] {
        let mut statistics = [T::zero(); GYROS];
        for (statistic, direction) in statistics.iter_mut().zip(&self.directions) {
            let along = direction.dot(sum);
            *statistic = along * along / samples;
        }
        statistics
    }
}

impl ParitySpace<f64> {
    /// The same space in single precision: enough for what adds up parity vectors, not for what forms them.
    pub fn single(&self) -> ParitySpace<f32> {
        ParitySpace {
            geometry: self.geometry.single(),
            matrix: self.matrix.map(|x| x as f32),
            sensitivity: self.sensitivity.map(|x| x as f32),
            directions: self.directions.map(|direction| direction.map(|x| x as f32)),
        }
    }
}

saved!([T: Blank] ParitySpace<T> { geometry, matrix, sensitivity, directions });
