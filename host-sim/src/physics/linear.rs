//! Exact discretisation of small linear systems.
//!
//! nalgebra offers the matrix exponential only with its `std` feature, which would reach the flight crates through
//! the shared build; so it stands here.
use nalgebra::allocator::Allocator;
use nalgebra::{ArrayStorage, Const, DefaultAllocator, DimDiff, DimSub, SMatrix, Schur, U1};

/// Terms of the Taylor series: the remainder is below 1e-17 for a norm up to one half.
const TERMS: u32 = 14;

/// Iterations of the Schur decomposition, which otherwise might never end.
const MOST_ITERATIONS: usize = 10_000;

/// Matrix exponential, by scaling and squaring of the Taylor series.
pub fn exponential<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let norm = matrix.abs().row_sum().max();
    let halvings = if norm > 0.5 { (norm / 0.5).log2().ceil() as i32 } else { 0 };
    let scaled = matrix * 0.5f64.powi(halvings);
    // Horner form of Σ Xᵏ/k!.
    let mut sum = SMatrix::<f64, N, N>::identity();
    for k in (1..=TERMS).rev() {
        sum = SMatrix::identity() + scaled * sum / f64::from(k);
    }
    (0..halvings).for_each(|_| sum *= sum);
    sum
}

/// Transition matrix and covariance of the noise of ẋ = F x + w, E wwᵀ = Q δ(t), over a step (Van Loan's integrals, by
/// doubling).
pub fn discretise<const N: usize>(
    dynamics: &SMatrix<f64, N, N>,
    spectral: &SMatrix<f64, N, N>,
    step_s: f64,
) -> (SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
    // Start so short that the trapezoid with its first correction is exact to double precision after doubling.
    let doublings = 24;
    let h = step_s * 0.5f64.powi(doublings);
    // Φ − I, which keeps its digits where Φ would round them off against one.
    let short = dynamics * h;
    let mut growth = short + short * short * 0.5 + short * short * short / 6.0;
    let mut covariance =
        spectral * h + (dynamics * spectral + spectral * dynamics.transpose()) * (0.5 * h * h);
    for _ in 0..doublings {
        let change = growth * covariance;
        covariance = covariance * 2.0 + change + change.transpose() + change * growth.transpose();
        growth = growth * 2.0 + growth * growth;
    }
    (exponential(&(dynamics * step_s)), covariance)
}

/// Largest real part of the eigenvalues; NaN where they cannot be found.
pub fn growth<const N: usize>(matrix: &SMatrix<f64, N, N>) -> f64
where
    Const<N>: DimSub<U1>,
    DefaultAllocator: Allocator<DimDiff<Const<N>, U1>>
        + Allocator<Const<N>, DimDiff<Const<N>, U1>>
        + Allocator<DimDiff<Const<N>, U1>, DimDiff<Const<N>, U1>>
        + Allocator<Const<N>, Const<N>, Buffer<f64> = ArrayStorage<f64, N, N>>
        + Allocator<Const<N>>,
{
    if matrix.iter().any(|v| !v.is_finite()) {
        return f64::NAN;
    }
    let schur = Schur::try_new(*matrix, f64::EPSILON, MOST_ITERATIONS);
    schur.map_or(f64::NAN, |it| {
        it.complex_eigenvalues().iter().map(|e| e.re).fold(f64::NEG_INFINITY, f64::max)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3};

    #[test]
    fn exponential_of_a_rotation_is_a_rotation() {
        for angle in [1e-9, 0.3, 7.0, 400.0f64] {
            let (s, c) = angle.sin_cos();
            let found = exponential(&Matrix2::new(0.0, -angle, angle, 0.0));
            assert!((found - Matrix2::new(c, -s, s, c)).norm() < 1e-12 * angle.max(1.0));
        }
    }

    #[test]
    fn exponential_of_a_triangular_matrix_agrees_with_its_closed_form() {
        let m = Matrix3::new(-1.0, 2.0, 0.0, 0.0, -1.0, 2.0, 0.0, 0.0, -1.0) * 3.0;
        let e = (-3.0f64).exp();
        let expected = Matrix3::new(1.0, 6.0, 18.0, 0.0, 1.0, 6.0, 0.0, 0.0, 1.0) * e;
        assert!((exponential(&m) - expected).norm() < 1e-14);
    }

    #[test]
    fn discretised_noise_of_an_integrated_markov_process_agrees_with_its_closed_form() {
        let (tau, sigma, t): (f64, f64, f64) = (40.0, 2.0, 25.0);
        let f = Matrix2::new(0.0, 1.0, 0.0, -1.0 / tau);
        let q = Matrix2::new(0.0, 0.0, 0.0, 2.0 * sigma * sigma / tau);
        let (phi, cov) = discretise(&f, &q, t);
        let e = (-t / tau).exp();
        assert!((phi[(0, 1)] - tau * (1.0 - e)).abs() < 1e-9);
        let expected = sigma
            * sigma
            * Matrix2::new(
                2.0 * tau * (t - 2.0 * tau * (1.0 - e) + 0.5 * tau * (1.0 - e * e)),
                tau * (1.0 - e).powi(2),
                tau * (1.0 - e).powi(2),
                1.0 - e * e,
            );
        assert!((cov - expected).norm() < 1e-10 * expected.norm(), "{cov} {expected}");
    }
}
