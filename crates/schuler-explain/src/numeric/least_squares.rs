//! Generalised least squares in whitened space: amplitudes, their covariance, and the gain in log-likelihood.
use nalgebra::{DMatrix, DVector};

/// Eigenvalue of the normal matrix, scaled to a unit diagonal, below which a combination is not seen.
const UNSEEN: f64 = 1e-9;

/// Sum of products. Several sums run side by side: one alone waits for each addition.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (a_lanes, b_lanes) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a_lanes.remainder().iter().zip(b_lanes.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; LANES];
    for (a, b) in a_lanes.zip(b_lanes) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// A least-squares solution.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Gain in log-likelihood over amplitudes of zero.
    pub gain: f64,
    /// The amplitudes; 0 for combinations that are not seen.
    pub amplitudes: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Number of combinations that are seen.
    pub rank: usize,
}

/// Solves `normal` · amplitudes = `scores`.
pub fn solve(normal: &DMatrix<f64>, scores: &DVector<f64>) -> Solution {
    solve_seen(normal, scores, UNSEEN)
}

/// [`solve`] with another bound below which a combination is not seen.
pub fn solve_seen(normal: &DMatrix<f64>, scores: &DVector<f64>, unseen: f64) -> Solution {
    let size = scores.len();
    let scale = DVector::from_fn(size, |i, _| {
        let diagonal = normal[(i, i)];
        if diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
    });
    if size == 1 {
        let inverse = scale[0] * scale[0];
        return Solution {
            gain: 0.5 * scores[0] * scores[0] * inverse,
            amplitudes: scores * inverse,
            covariance: DMatrix::from_element(1, 1, inverse),
            rank: usize::from(inverse > 0.0),
        };
    }
    let scaled = DMatrix::from_fn(size, size, |i, j| normal[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let mut rank = 0;
    let inverse = DVector::from_fn(size, |i, _| {
        if eigen.eigenvalues[i] > unseen {
            rank += 1;
            eigen.eigenvalues[i].recip()
        } else {
            0.0
        }
    });
    let vectors = &eigen.eigenvectors;
    let mut covariance = vectors * DMatrix::from_diagonal(&inverse) * vectors.transpose();
    for i in 0..size {
        for j in 0..size {
            covariance[(i, j)] *= scale[i] * scale[j];
        }
    }
    let amplitudes = &covariance * scores;
    Solution { gain: 0.5 * scores.dot(&amplitudes), amplitudes, covariance, rank }
}
