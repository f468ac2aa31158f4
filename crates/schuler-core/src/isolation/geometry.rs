//! Axes of a block of n gyros, whitened, and whether they can serve.
//!
//! Source: Larin (2015), §§1–2, for any number of gyros. Equation ids FDI-2, FDI-8.
//!
//! In: unit input axes (n×3, one row a gyro) and the 1-σ noise of each gyro, rad/s.
//! Out: axes divided by the noise, and the projector on what no rate can produce; dimensionless.
use nalgebra::{RealField, SMatrix, SVector, Vector3};

use super::orthogonal::{ThinQr, columns, elements};
use crate::config::{ConfigError, Problem};
use crate::saved::{Blank, saved};

/// Largest deviation of the length of an axis from one.
const UNIT_NORM_TOLERANCE: f64 = 1e-3;
/// Least ratio of the diagonal elements of R at which the axes count as spanning space.
const RANK_TOLERANCE: f64 = 1e-6;
/// Least `‖v_k‖²` at which a fault of gyro k can be seen.
const MIN_SENSITIVITY_SQUARED: f64 = 0.05;
/// Cosine of the least angle between two parity lines (10°).
const MAX_LINE_COSINE: f64 = 0.984_807_753_012_208;

/// Names of the fields that hold an axis, for errors; gyros beyond them go by the name of the whole.
const AXIS_FIELDS: [&str; 8] = [
    "isolation.axes[0]",
    "isolation.axes[1]",
    "isolation.axes[2]",
    "isolation.axes[3]",
    "isolation.axes[4]",
    "isolation.axes[5]",
    "isolation.axes[6]",
    "isolation.axes[7]",
];
/// Name of the field that holds all axes.
const AXES_FIELD: &str = "isolation.axes";
/// Why two gyros cannot be told apart, by the second of them; the field names the first.
const SAME_LINE: [&str; 8] = [
    "has within 10° the same parity line as axes[0]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[1]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[2]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[3]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[4]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[5]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[6]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[7]: their faults cannot be told apart",
];

/// Whitened axes of n gyros that passed the guards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockGeometry<T, const N: usize> {
    /// The axis of each gyro times `σ_ref/σ_k`.
    axes: [Vector3<T>; N],
    /// Reference `σ_ref`: the least noise of all, rad/s.
    reference_sigma: T,
    /// √det(AᵀA) of the whitened axes.
    volume: T,
}

impl<T: RealField + Copy, const N: usize> BlockGeometry<T, N> {
    /// Whitens the axes by the noise of their gyros and checks them, by QR. `[FDI-2]` `[FDI-8]`
    ///
    /// # Errors
    /// A number that is not finite, an axis whose length is not one, axes that do not span space, a gyro whose
    /// fault would not be seen, two gyros whose faults cannot be told apart (always with fewer than five).
    pub fn try_build(axes: &[[T; 3]; N], sigma: &[T; N]) -> Result<Self, ConfigError> {
        for (gyro, axis) in axes.iter().enumerate() {
            if !axis.iter().all(nalgebra::ComplexField::is_finite) {
                return Err(ConfigError::new(axis_field(gyro), Problem::NotFinite));
            }
            let norm = Vector3::from(*axis).norm();
            if (norm - T::one()).abs() > constant(UNIT_NORM_TOLERANCE) {
                let reason = Problem::Geometry("is not a unit vector within one thousandth");
                return Err(ConfigError::new(axis_field(gyro), reason));
            }
        }
        for &sigma in sigma {
            if !sigma.is_finite() {
                return Err(ConfigError::new("isolation.sigma", Problem::NotFinite));
            }
            if sigma <= T::zero() {
                return Err(ConfigError::new("isolation.sigma", Problem::NotPositive));
            }
        }
        let reference_sigma = SVector::<T, N>::from(*sigma).min();
        let mut whitened = axes.map(Vector3::from);
        for (axis, &sigma) in whitened.iter_mut().zip(sigma) {
            *axis *= reference_sigma / sigma;
        }

        let qr = ThinQr::new(&whitened);
        let pivots = qr.triangle.diagonal();
        if pivots.min() <= constant::<T>(RANK_TOLERANCE) * pivots.max() {
            let reason = Problem::Geometry("do not span three-dimensional space");
            return Err(ConfigError::new(AXES_FIELD, reason));
        }
        let geometry = Self { axes: whitened, reference_sigma, volume: pivots.product() };
        check_lines(&geometry.projector())?;
        Ok(geometry)
    }

    /// Whitened axes: the axis of each gyro times `σ_ref/σ_k`.
    pub fn axes(&self) -> &[Vector3<T>; N] {
        &self.axes
    }

    /// Whitened axes as the matrix A, one row a gyro.
    pub fn matrix(&self) -> SMatrix<T, N, 3> {
        columns(self.axes).transpose()
    }

    /// The least noise of all, to which the axes are scaled, rad/s.
    pub fn reference_sigma(&self) -> T {
        self.reference_sigma
    }

    /// √det(AᵀA) of the whitened axes.
    pub fn volume(&self) -> T {
        self.volume
    }

    /// Projector `G = I − A(AᵀA)⁻¹Aᵀ` on what no rate can produce; `G_kk = ‖v_k‖²`.
    pub fn projector(&self) -> SMatrix<T, N, N> {
        let range = ThinQr::new(&self.axes).range();
        SMatrix::identity() - range * range.transpose()
    }
}

impl<const N: usize> BlockGeometry<f64, N> {
    /// The same in single precision.
    pub(super) fn single(&self) -> BlockGeometry<f32, N> {
        BlockGeometry {
            axes: self.axes.map(|axis| axis.map(|x| x as f32)),
            reference_sigma: self.reference_sigma as f32,
            volume: self.volume as f32,
        }
    }
}

/// Every gyro must be seen in the parity space, and no two of them along one line.
fn check_lines<T: RealField + Copy, const N: usize>(projector: &SMatrix<T, N, N>) -> Result<(), ConfigError> {
    let seen = elements(projector.diagonal());
    for (gyro, &square) in seen.iter().enumerate() {
        if square < constant(MIN_SENSITIVITY_SQUARED) {
            let reason =
                "leaves less than 5 % of its fault's square in the parity space: it would not be seen";
            return Err(ConfigError::new(axis_field(gyro), Problem::Geometry(reason)));
        }
    }
    let limit = constant::<T>(MAX_LINE_COSINE * MAX_LINE_COSINE);
    for (one, (column, &square)) in projector.data.0.iter().zip(&seen).enumerate() {
        for (other, (&product, &other_square)) in column.iter().zip(&seen).enumerate().skip(one + 1) {
            if product * product > limit * square * other_square {
                let reason =
                    SAME_LINE.get(other).copied().unwrap_or("shares its parity line with another gyro");
                return Err(ConfigError::new(axis_field(one), Problem::Geometry(reason)));
            }
        }
    }
    Ok(())
}

fn axis_field(gyro: usize) -> &'static str {
    AXIS_FIELDS.get(gyro).copied().unwrap_or(AXES_FIELD)
}

/// A constant in the scalar of the computation.
#[inline]
pub(super) fn constant<T: RealField>(value: f64) -> T {
    nalgebra::convert(value)
}

saved!([T: Blank, const N: usize] BlockGeometry<T, N> { axes, reference_sigma, volume });
