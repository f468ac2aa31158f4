//! Square-root filter of constant parameters and three attitude errors [TMP-12].
//!
//! `P = S Sᵀ` with `S` lower triangular and the attitude in its last three rows. So a step in time, which moves only the
//! attitude and drives it by white noise, changes three rows and refactors a 3 × 3 block; a scalar measurement is Carlson's
//! update, which keeps `S` triangular. Both are exact forms of the QR and Add steps of the specification.
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix};

/// State and square root of its covariance.
#[derive(Clone, Debug)]
pub(super) struct SquareRootFilter {
    /// Parameters, then attitude error.
    pub(super) x: DVector<f64>,
    s: DMatrix<f64>,
    /// Scratch: `Sᵀh` and the growing gain.
    phi: Vec<f64>,
    gain: Vec<f64>,
}

/// A scalar measurement's surprise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Innovation {
    /// Value less its prediction.
    pub(super) value: f64,
    /// Its predicted variance.
    pub(super) variance: f64,
}

impl SquareRootFilter {
    /// Parameters with independent sigmas, mean zero; attitude errors zero until [`SquareRootFilter::set_tail`].
    pub(super) fn new(sigma: &[f64]) -> Self {
        let parameters = sigma.len();
        let n = parameters + 3;
        let mut s = DMatrix::zeros(n, n);
        for (k, sigma) in sigma.iter().enumerate() {
            s[(k, k)] = *sigma;
        }
        Self { x: DVector::zeros(n), s, phi: vec![0.0; n], gain: vec![0.0; n] }
    }

    /// Number of parameters.
    pub(super) fn parameters(&self) -> usize {
        self.x.len() - 3
    }

    /// Replaces the last `rows.nrows()` states: their rows of `S` (lower triangular where they end) and their means.
    pub(super) fn set_tail(&mut self, rows: &DMatrix<f64>, mean: &DVector<f64>) {
        let first = self.x.len() - rows.nrows();
        self.s.rows_mut(first, rows.nrows()).copy_from(rows);
        self.x.rows_mut(first, rows.nrows()).copy_from(mean);
    }

    /// Rows of `S`.
    pub(super) fn rows(&self, first: usize, count: usize) -> DMatrix<f64> {
        self.s.rows(first, count).into_owned()
    }

    /// Attitude errors move: `β ← Φβ + Ψ·(φ ⊗ parameters)` over the twelve gyro slots from `gyro`, and take up white
    /// noise of sigma `q` each. `slots` holds, slot by slot, the sensitivity to one unit of the slot's coefficient, which
    /// is `features · its parameters`.
    pub(super) fn step(
        &mut self,
        transition: &Matrix3<f64>,
        slots: &SMatrix<f64, 3, 12>,
        gyro: usize,
        features: &[f64],
        q: f64,
    ) {
        let m = self.parameters();
        let np = features.len();
        // Means.
        let mut beta = transition * self.x.fixed_rows::<3>(m);
        for slot in 0..12 {
            let coefficient: f64 = (0..np).map(|f| features[f] * self.x[gyro + slot * np + f]).sum();
            beta += slots.column(slot) * coefficient;
        }
        self.x.fixed_rows_mut::<3>(m).copy_from(&beta);

        // Square root, column by column: only the rows of the attitude change.
        for j in 0..m {
            let mut column = self.s.column_mut(j);
            let mut moved = transition * column.fixed_rows::<3>(m);
            // Rows above the diagonal are zero.
            for slot in (j.saturating_sub(gyro) / np).min(12)..12 {
                let at = gyro + slot * np;
                let coefficient: f64 =
                    features.iter().zip(column.rows(at, np).iter()).map(|(f, s)| f * s).sum();
                moved += slots.column(slot) * coefficient;
            }
            column.fixed_rows_mut::<3>(m).copy_from(&moved);
        }
        let own = transition * self.s.fixed_view::<3, 3>(m, m);
        let covariance = own * own.transpose() + Matrix3::identity() * (q * q);
        // Positive definite by the noise; if rounding ever denied it, the old factor stays and the noise is left out.
        let factor = covariance.cholesky().map_or(own, |c| c.l());
        self.s.fixed_view_mut::<3, 3>(m, m).copy_from(&factor);
    }

    /// Scalar measurement `value = h·x + noise` of variance `r` (Carlson 1973).
    pub(super) fn measure(&mut self, h: &[f64], value: f64, r: f64) -> Innovation {
        let n = self.x.len();
        let innovation = value - h.iter().zip(self.x.iter()).map(|(h, x)| h * x).sum::<f64>();
        let s = self.s.as_mut_slice();
        for (j, phi) in self.phi.iter_mut().enumerate() {
            let column = &s[j * n + j..(j + 1) * n];
            *phi = column.iter().zip(&h[j..]).map(|(s, h)| s * h).sum();
        }
        self.gain.fill(0.0);
        let mut alpha = r;
        for j in (0..n).rev() {
            let f = self.phi[j];
            let grown = alpha + f * f;
            let (keep, leave) = ((alpha / grown).sqrt(), f / (alpha * grown).sqrt());
            let column = &mut s[j * n + j..(j + 1) * n];
            for (s, gain) in column.iter_mut().zip(&mut self.gain[j..]) {
                let old = *s;
                *s = old * keep - *gain * leave;
                *gain += old * f;
            }
            alpha = grown;
        }
        let weight = innovation / alpha;
        for (x, gain) in self.x.iter_mut().zip(&self.gain) {
            *x += gain * weight;
        }
        Innovation { value: innovation, variance: alpha }
    }

    /// Covariance of the parameters.
    pub(super) fn covariance(&self) -> DMatrix<f64> {
        let m = self.parameters();
        let s = self.s.view((0, 0), (m, m));
        s * s.transpose()
    }

    /// Whether every number is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.x.iter().chain(self.s.iter()).all(|v| v.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// The same experiment in a textbook filter with the full covariance.
    #[test]
    fn tmp_12_square_root_filter_equals_the_covariance_filter() {
        let (np, gyro) = (2, 3);
        let m = gyro + 12 * np;
        let sigma: Vec<f64> = (0..m).map(|k| 1.0 + 0.1 * k as f64).collect();
        let mut filter = SquareRootFilter::new(&sigma);
        let mut p = DMatrix::<f64>::zeros(m + 3, m + 3);
        let mut x = DVector::<f64>::zeros(m + 3);
        // Attitude correlated with the first three parameters from the start.
        let tail = DMatrix::from_fn(3, m + 3, |i, j| match j {
            j if j < 3 => -0.4 * f64::from(u8::from(i == j)) * sigma[j] + 0.01 * (i + j) as f64,
            j if j == m + i => 0.7,
            _ => 0.0,
        });
        filter.set_tail(&tail, &DVector::from_element(3, 0.2));
        let mut s =
            DMatrix::from_diagonal(&DVector::from_iterator(m + 3, sigma.iter().copied().chain([0.0; 3])));
        s.rows_mut(m, 3).copy_from(&tail);
        p.copy_from(&(&s * s.transpose()));
        x.rows_mut(m, 3).fill(0.2);

        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as f64 / (1u64 << 31) as f64 * 2.0 - 1.0
        };
        for _ in 0..40 {
            let transition =
                nalgebra::Rotation3::new(Vector3::new(random(), random(), random())).into_inner();
            let slots = SMatrix::<f64, 3, 12>::from_fn(|_, _| random());
            let features = [1.0, random()];
            let mut f = DMatrix::<f64>::identity(m + 3, m + 3);
            f.view_mut((m, m), (3, 3)).copy_from(&transition);
            for slot in 0..12 {
                for (k, feature) in features.iter().enumerate() {
                    f.view_mut((m, gyro + slot * np + k), (3, 1)).copy_from(&(slots.column(slot) * *feature));
                }
            }
            filter.step(&transition, &slots, gyro, &features, 0.3);
            x = &f * x;
            p = &f * p * f.transpose();
            for k in m..m + 3 {
                p[(k, k)] += 0.09;
            }
            let h: Vec<f64> = (0..m + 3).map(|_| random()).collect();
            let (z, r) = (random(), 0.5);
            let row = DVector::from_column_slice(&h);
            let variance = (row.transpose() * &p * &row)[0] + r;
            let value = z - row.dot(&x);
            let gain = &p * &row / variance;
            x += &gain * value;
            p -= &gain * (row.transpose() * &p);
            let innovation = filter.measure(&h, z, r);
            assert!((innovation.value - value).abs() < 1e-9 * (1.0 + value.abs()));
            assert!((innovation.variance - variance).abs() < 1e-9 * variance);
        }
        assert!((&filter.x - &x).amax() < 1e-8);
        assert!((filter.covariance() - p.view((0, 0), (m, m))).amax() < 1e-8);
    }
}
