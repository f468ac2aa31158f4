//! Isolation by the orthogonal projector, for any number of gyros from five.
//!
//! Source: Larin (2015), §§1–2, equations (1.4)–(1.6), (2.8), (2.9), with the projector from a QR factorisation
//! as the paper recommends beside its singular value decomposition. Equation id FDI-3.
//!
//! In: measurements divided by their σ. Out: for each gyro how much its fault would leave unexplained, how large it
//! would be, in σ.
use nalgebra::{RealField, SMatrix, SVector};

use super::geometry::BlockGeometry;

/// The projector with the lengths of its columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrthogonalProjector<T, const N: usize> {
    projector: SMatrix<T, N, N>,
    /// `1/G_kk`.
    inverse_diagonal: SVector<T, N>,
}

/// What the projector says of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection<T, const N: usize> {
    /// `T = ‖G y‖²`: chi-square with N − 3 degrees of freedom without a fault.
    pub total: T,
    /// `J_k = ‖g_k ε_k − G y‖²`: what a fault of gyro k leaves unexplained. The least names the gyro.
    pub unexplained: SVector<T, N>,
    /// `ε_k = g_kᵀ G y/‖g_k‖²`: size of the fault if it is gyro k's.
    pub sizes: SVector<T, N>,
}

impl<T: RealField + Copy, const N: usize> OrthogonalProjector<T, N> {
    /// Of a block that passed the guards: no column of its projector vanishes.
    pub fn new(geometry: &BlockGeometry<T, N>) -> Self {
        let projector = geometry.projector();
        Self { projector, inverse_diagonal: projector.diagonal().map(|square| T::one() / square) }
    }

    /// Projects one sample. Because `G² = G`, a column's product with `G y` is an element of `G y`. `[FDI-3]`
    pub fn project(&self, whitened: &SVector<T, N>) -> Projection<T, N> {
        let least_norm = self.projector * whitened;
        let total = least_norm.norm_squared();
        let sizes = least_norm.component_mul(&self.inverse_diagonal);
        let unexplained = sizes.zip_map(&least_norm, |size, element| total - size * element);
        Projection { total, unexplained, sizes }
    }
}
