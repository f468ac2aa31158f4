//! Geometry of a block of five gyros: the space of measurements that no rate can produce.
//!
//! Source: Larin (2015), §§1–2; parity vectors after Potter and Suman (1977). Equation ids FDI-2, FDI-8.
//!
//! In: unit input axes `A` (5×3, one row a gyro) and the 1-σ noise of each gyro, rad/s.
//! Out: the parity matrix `V` (2×5) with `V A = 0`, `V Vᵀ = I`, for measurements divided by their σ. All
//! quantities are dimensionless.
use nalgebra::{Matrix3, RealField, SMatrix, SVector, Vector2};

use crate::config::{ConfigError, Problem};

/// Number of gyros.
pub const GYROS: usize = 5;

/// Five input axes, one row a gyro.
pub type Axes<T> = SMatrix<T, GYROS, 3>;

/// Largest deviation of the length of an axis from one.
const UNIT_NORM_TOLERANCE: f64 = 1e-3;
/// Least ratio of the diagonal elements of R at which the axes count as spanning space.
const RANK_TOLERANCE: f64 = 1e-6;
/// Least `‖v_k‖²` at which a fault of gyro k can be seen.
const MIN_SENSITIVITY_SQUARED: f64 = 0.05;
/// Cosine of the least angle between two parity lines (10°).
const MAX_LINE_COSINE: f64 = 0.984_807_753_012_208;

/// Names of the fields that hold an axis, for errors.
const AXIS_FIELDS: [&str; GYROS] =
    ["isolation.axes[0]", "isolation.axes[1]", "isolation.axes[2]", "isolation.axes[3]", "isolation.axes[4]"];
/// Why two gyros cannot be told apart, by the second of them; the field names the first.
const SAME_LINE: [&str; GYROS] = [
    "has within 10° the same parity line as axes[0]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[1]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[2]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[3]: their faults cannot be told apart",
    "has within 10° the same parity line as axes[4]: their faults cannot be told apart",
];

/// The parity space of one geometry, whitened: built once, then constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParitySpace<T> {
    /// Whitened axes: row k is the axis of gyro k times `σ_ref/σ_k`.
    axes: Axes<T>,
    /// Reference `σ_ref`: the least noise of the five, rad/s.
    reference_sigma: T,
    /// Parity matrix V.
    matrix: SMatrix<T, 2, GYROS>,
    /// √det(AᵀA) of the whitened axes.
    volume: T,
    /// `‖v_k‖`: what a fault of one `σ_k` in gyro k adds to the parity vector.
    sensitivity: [T; GYROS],
    /// Unit directions `u_k = v_k/‖v_k‖`.
    directions: [Vector2<T>; GYROS],
}

impl<T: RealField + Copy> ParitySpace<T> {
    /// Whitens the axes by the noise of their gyros and splits off the parity space by QR. `[FDI-2]` `[FDI-8]`
    ///
    /// # Errors
    /// A number that is not finite, an axis whose length is not one, axes that do not span space, a gyro whose
    /// fault would not be seen, two gyros whose faults cannot be told apart.
    pub fn try_build(axes: &[[T; 3]; GYROS], sigma: &[T; GYROS]) -> Result<Self, ConfigError> {
        for (axis, field) in axes.iter().zip(AXIS_FIELDS) {
            if !axis.iter().all(nalgebra::ComplexField::is_finite) {
                return Err(ConfigError::new(field, Problem::NotFinite));
            }
            let norm = SVector::<T, 3>::from(*axis).norm();
            if (norm - T::one()).abs() > constant(UNIT_NORM_TOLERANCE) {
                return Err(ConfigError::new(
                    field,
                    Problem::Geometry("is not a unit vector within one thousandth"),
                ));
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
        let [first, others @ ..] = *sigma;
        let reference_sigma = others.iter().fold(first, |least, &sigma| least.min(sigma));
        let mut whitened = Axes::from_row_iterator(axes.iter().flatten().copied());
        for (mut row, &sigma) in whitened.row_iter_mut().zip(sigma) {
            row *= reference_sigma / sigma;
        }

        let qr = whitened.qr();
        let pivots = qr.r().diagonal();
        if pivots.min() <= constant::<T>(RANK_TOLERANCE) * pivots.max() {
            return Err(ConfigError::new(
                "isolation.axes",
                Problem::Geometry("do not span three-dimensional space"),
            ));
        }
        let mut orthogonal = SMatrix::<T, GYROS, GYROS>::identity();
        qr.q_tr_mul(&mut orthogonal);
        let matrix = orthogonal.fixed_rows::<2>(3).into_owned();

        let mut sensitivity = [T::zero(); GYROS];
        let mut directions = [Vector2::zeros(); GYROS];
        for (((column, norm), unit), field) in
            matrix.column_iter().zip(&mut sensitivity).zip(&mut directions).zip(AXIS_FIELDS)
        {
            *norm = column.norm();
            if *norm * *norm < constant(MIN_SENSITIVITY_SQUARED) {
                return Err(ConfigError::new(
                    field,
                    Problem::Geometry(
                        "leaves less than 5 % of the fault's square in the parity space: it would not be seen",
                    ),
                ));
            }
            *unit = column / *norm;
        }
        for (first, (one, field)) in directions.iter().zip(AXIS_FIELDS).enumerate() {
            for (other, reason) in directions.iter().zip(SAME_LINE).skip(first + 1) {
                if one.dot(other).abs() > constant(MAX_LINE_COSINE) {
                    return Err(ConfigError::new(field, Problem::Geometry(reason)));
                }
            }
        }
        Ok(Self {
            axes: whitened,
            reference_sigma,
            matrix,
            volume: pivots.product(),
            sensitivity,
            directions,
        })
    }

    /// Whitened axes: row k is the axis of gyro k times `σ_ref/σ_k`.
    pub fn axes(&self) -> &Axes<T> {
        &self.axes
    }

    /// The least noise of the five, to which the axes are scaled, rad/s.
    pub fn reference_sigma(&self) -> T {
        self.reference_sigma
    }

    /// Parity matrix V (2×5), unique up to an orthogonal 2×2 factor.
    pub fn matrix(&self) -> &SMatrix<T, 2, GYROS> {
        &self.matrix
    }

    /// √det(AᵀA) of the whitened axes.
    pub fn volume(&self) -> T {
        self.volume
    }

    /// `‖v_k‖` of each gyro.
    pub fn sensitivity(&self) -> &[T; GYROS] {
        &self.sensitivity
    }

    /// Unit parity directions `u_k = v_k/‖v_k‖`.
    pub fn directions(&self) -> &[Vector2<T>; GYROS] {
        &self.directions
    }

    /// Information matrix `AᵀA` of the whitened axes; `σ_ref²` times its inverse is the rate's covariance.
    pub fn information(&self) -> Matrix3<T> {
        self.axes.tr_mul(&self.axes)
    }

    /// Parity vector z = V y of measurements that were divided by their σ. `[FDI-1]`
    #[inline]
    pub fn parity(&self, whitened: &SVector<T, GYROS>) -> Vector2<T> {
        self.matrix * whitened
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

/// A constant in the scalar of the computation.
#[inline]
pub(super) fn constant<T: RealField>(value: f64) -> T {
    nalgebra::convert(value)
}
