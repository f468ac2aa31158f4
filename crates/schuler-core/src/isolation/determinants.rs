//! The five determinants of a five-gyro block.
//!
//! Source: Larin (2015), §4, equation (4.1) and Table 2. Equation ids FDI-3.1, FDI-3.2. [FDI-3.1]
//!
//! Determinant j is that of the 4×4 matrix [A y] left when row j is removed: it vanishes when the four remaining
//! gyros agree, so that the least of the five names the failed gyro. Removing a second row from A leaves a 3×3
//! minor; the ten minors serve all five determinants and are constants of the geometry, so that a sample costs
//! twenty multiplications.
//!
//! Divided by `√det(AᵀA)·‖v_j‖` the determinant is the parity of the block without gyro j in standard deviations,
//! whatever the geometry. It does not contain `y_j` at all: that makes it the check of the remaining four when gyro
//! j has failed or is silent.
//!
//! In: measurements (for the normalised form divided by their σ). Out: five numbers of the measurements' unit.
use core::array::from_fn;

use nalgebra::{RealField, SVector, Vector3};

use super::orthogonal::elements;
use super::parity::{GYROS, ParitySpace};
use crate::saved::{Blank, saved};

/// Coefficients of the five determinants as linear forms of the measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiveDeterminants<T> {
    /// Row j holds the signed minors of determinant j; its diagonal is zero.
    minors: [[T; GYROS]; GYROS],
}

impl<T: RealField + Copy> FiveDeterminants<T> {
    /// Forms the ten minors of the axes. `[FDI-3]`
    pub fn new(axes: &[Vector3<T>; GYROS]) -> Self {
        Self { minors: from_fn(|removed| from_fn(|expanded| signed_minor(axes, removed, expanded))) }
    }

    /// The determinants of whitened measurements, scaled to unit variance for any geometry. `[FDI-3.2]`
    pub fn normalised(space: &ParitySpace<T>) -> Self {
        let (axes, volume) = (space.geometry().axes(), space.geometry().volume());
        Self {
            minors: from_fn(|removed| {
                let scale = volume * space.sensitivity_of(removed);
                from_fn(|expanded| signed_minor(axes, removed, expanded) / scale)
            }),
        }
    }

    /// The five signed determinants of [A y] with one row removed each. Element j does not depend on `y_j`.
    #[inline]
    pub fn of(&self, measurements: &SVector<T, GYROS>) -> SVector<T, GYROS> {
        // Written out: the image does not unroll loops.
        let [a, b, c, d, e] = elements(*measurements);
        let determinant = |&[p, q, r, s, t]: &[T; GYROS]| p * a + q * b + r * c + s * d + t * e;
        let [first, second, third, fourth, fifth] = &self.minors;
        let determinants = [
            determinant(first),
            determinant(second),
            determinant(third),
            determinant(fourth),
            determinant(fifth),
        ];
        SVector::from(determinants)
    }
}

/// Coefficient of y_`expanded` in the determinant of [A y] without row `removed`: the expansion along the last
/// of the four columns, in which row p has the sign (−1)^(p+1).
fn signed_minor<T: RealField + Copy>(axes: &[Vector3<T>; GYROS], removed: usize, expanded: usize) -> T {
    let mut rest =
        axes.iter().enumerate().filter(|(row, _)| *row != removed && *row != expanded).map(|(_, axis)| *axis);
    let mut next = || rest.next().unwrap_or_else(Vector3::zeros);
    let (a, b, c) = (next(), next(), next());
    let minor = a.dot(&b.cross(&c));
    let position = expanded - usize::from(expanded > removed);
    match (expanded == removed, position.is_multiple_of(2)) {
        (true, _) => T::zero(),
        (false, true) => -minor,
        (false, false) => minor,
    }
}

saved!([T: Blank] FiveDeterminants<T> { minors });
