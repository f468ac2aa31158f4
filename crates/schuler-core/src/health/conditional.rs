//! Mean and covariance of the continuous state given the mode, and what prediction, a residual and merging do
//! to them [HLT-3], [HLT-5].
//!
//! State X = [ε, ξ, m, μ]: radio error, m/s; inertial error, m/s; value of the jump, m/s; inertial drift, m/s².
//! The transition is so sparse that writing it out costs a fifth of the matrix products.
use nalgebra::RealField;

use super::span::Span;
use crate::number::each;
use crate::saved::{Blank, saved};

/// Gaussian of X given one mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditional<T> {
    /// E X.
    pub(super) mean: [T; 4],
    /// Upper triangle of the covariance by rows: 00 01 02 03 11 12 13 22 23 33.
    pub(super) covariance: [T; 10],
}

/// What happens to the jump's value between two modes.
#[derive(Clone, Copy, Debug)]
pub(super) struct JumpMotion<T> {
    /// c: probability that the value is the old one; the paper's `λ_i λ_r` for a single step.
    pub(super) kept: T,
    /// Variance of the value where it is a fresh one, (m/s)²; zero where there is no jump at the end.
    pub(super) fresh_variance: T,
}

/// A prediction, with all of the residual's moments that do not depend on the level of noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prediction<T> {
    pub(super) estimate: Conditional<T>,
    /// P Hᵀ.
    pub(super) cross: [T; 4],
    /// λ, the only entry of H that varies.
    pub(super) lambda: T,
    /// `Rq`, (m/s)².
    pub(super) residual_variance: T,
    /// S = H P Hᵀ + `Rq` without the radio's own noise, (m/s)².
    pub(super) variance: T,
    /// Residual predicted, H X, m/s.
    pub(super) residual: T,
}

impl<T: RealField + Copy> Conditional<T> {
    /// Independent components of zero mean with these variances.
    pub(super) fn independent([v0, v1, v2, v3]: [T; 4]) -> Self {
        let o = T::zero();
        Self { mean: [o; 4], covariance: [v0, o, o, o, v1, o, o, v2, o, v3] }
    }

    /// Prediction without the radio's own noise, and the residual's moments under `lambda` = 1 with, 0 without a
    /// jump: H = [1, −1, λ, 0] [HLT-3].
    #[inline]
    pub(super) fn predict<const LEVELS: usize>(
        &self,
        span: &Span<T, LEVELS>,
        jump: JumpMotion<T>,
        lambda: T,
        residual_variance: T,
    ) -> Prediction<T> {
        let (f, t, c) = (span.correlation, span.duration, jump.kept);
        let [eps, xi, m, mu] = self.mean;
        let [p00, p01, p02, p03, p11, p12, p13, p22, p23, p33] = self.covariance;
        let [q_xi, q_xi_mu, q_mu] = span.inertial_noise;
        let mean = [f * eps, xi + t * mu, c * m, mu];
        let q13 = p13 + t * p33;
        let broken = T::one() - c;
        let covariance = [
            f * f * p00,
            f * (p01 + t * p03),
            c * f * p02,
            f * p03,
            p11 + t * (p13 + q13) + q_xi,
            c * (p12 + t * p23),
            q13 + q_xi_mu,
            // Spread between the old value and a fresh one of zero mean.
            c * p22 + c * broken * m * m + broken * jump.fresh_variance,
            c * p23,
            p33 + q_mu,
        ];
        let [p00, p01, p02, p03, p11, p12, p13, p22, p23, _] = covariance;
        let cross = [
            p00 - p01 + lambda * p02,
            p01 - p11 + lambda * p12,
            p02 - p12 + lambda * p22,
            p03 - p13 + lambda * p23,
        ];
        let [h0, h1, h2, _] = cross;
        Prediction {
            estimate: Self { mean, covariance },
            cross,
            lambda,
            residual_variance,
            // Never below the residual's own noise, whatever rounding has done to a covariance.
            variance: (h0 - h1 + lambda * h2 + residual_variance).max(residual_variance),
            residual: mean[0] - mean[1] + lambda * mean[2],
        }
    }

    /// First two moments of a mixture; the weights sum to one [HLT-5].
    #[inline]
    pub(super) fn merged(components: &[(T, Self)]) -> Self {
        let (mut mean, mut covariance) = ([T::zero(); 4], [T::zero(); 10]);
        for (weight, component) in components {
            mean = each!(|i| mean[i] + *weight * component.mean[i]; 0 1 2 3);
        }
        for (weight, component) in components {
            let spread = spread(each!(|i| component.mean[i] - mean[i]; 0 1 2 3));
            let term = &component.covariance;
            covariance = each!(|i| covariance[i] + *weight * (term[i] + spread[i]); 0 1 2 3 4 5 6 7 8 9);
        }
        Self { mean, covariance }
    }
}

/// d dᵀ, upper triangle by rows.
#[inline]
pub(super) fn spread<T: RealField + Copy>([d0, d1, d2, d3]: [T; 4]) -> [T; 10] {
    [d0 * d0, d0 * d1, d0 * d2, d0 * d3, d1 * d1, d1 * d2, d1 * d3, d2 * d2, d2 * d3, d3 * d3]
}

impl<T: RealField + Copy> Prediction<T> {
    /// K = P Hᵀ / S. `level_noise`: variance that the radio's noise adds to ε, (m/s)². `inverse_variance`: 1/S with it, or
    /// zero to leave the residual aside.
    #[inline]
    pub(super) fn gain(&self, level_noise: T, inverse_variance: T) -> [T; 4] {
        let [h0, h1, h2, h3] = self.cross;
        [
            (h0 + level_noise) * inverse_variance,
            h1 * inverse_variance,
            h2 * inverse_variance,
            h3 * inverse_variance,
        ]
    }

    /// Mean after the residual [HLT-5]. `innovation`: d − H X, m/s.
    #[inline]
    pub(super) fn mean_after(&self, [k0, k1, k2, k3]: [T; 4], innovation: T) -> [T; 4] {
        let [x0, x1, x2, x3] = self.estimate.mean;
        [x0 + k0 * innovation, x1 + k1 * innovation, x2 + k2 * innovation, x3 + k3 * innovation]
    }

    /// Covariance after the residual, in Joseph's form [HLT-5].
    #[inline]
    pub(super) fn covariance_after(&self, [k0, k1, k2, k3]: [T; 4], level_noise: T) -> [T; 10] {
        let (lambda, residual_variance) = (self.lambda, self.residual_variance);
        let [mut h0, h1, h2, h3] = self.cross;
        h0 += level_noise;
        let [p00, p01, p02, p03, p11, p12, p13, p22, p23, p33] = self.estimate.covariance;
        let p00 = p00 + level_noise;
        // A = (I − K H) P, not symmetric; then A (I − K H)ᵀ + K Rq Kᵀ = A + (Rq K − A Hᵀ) Kᵀ.
        let (a00, a01, a02, a03) = (p00 - k0 * h0, p01 - k0 * h1, p02 - k0 * h2, p03 - k0 * h3);
        let (a10, a11, a12, a13) = (p01 - k1 * h0, p11 - k1 * h1, p12 - k1 * h2, p13 - k1 * h3);
        let (a20, a21, a22, a23) = (p02 - k2 * h0, p12 - k2 * h1, p22 - k2 * h2, p23 - k2 * h3);
        let (a30, a31, a32, a33) = (p03 - k3 * h0, p13 - k3 * h1, p23 - k3 * h2, p33 - k3 * h3);
        let b0 = residual_variance * k0 - (a00 - a01 + lambda * a02);
        let b1 = residual_variance * k1 - (a10 - a11 + lambda * a12);
        let b2 = residual_variance * k2 - (a20 - a21 + lambda * a22);
        let b3 = residual_variance * k3 - (a30 - a31 + lambda * a32);
        [
            a00 + b0 * k0,
            a01 + b0 * k1,
            a02 + b0 * k2,
            a03 + b0 * k3,
            a11 + b1 * k1,
            a12 + b1 * k2,
            a13 + b1 * k3,
            a22 + b2 * k2,
            a23 + b2 * k3,
            a33 + b3 * k3,
        ]
    }
}

saved!([T: Blank] Conditional<T> { mean, covariance });

#[cfg(test)]
mod tests {
    extern crate std;

    use nalgebra::{Matrix4, RowVector4, Vector4};
    use proptest::prelude::*;

    use super::super::config::HealthConfig;
    use super::super::span::SpanLadder;
    use super::*;

    impl Prediction<f64> {
        fn update(&self, level_noise: f64, inverse_variance: f64, innovation: f64) -> Conditional<f64> {
            let gain = self.gain(level_noise, inverse_variance);
            let covariance = self.covariance_after(gain, level_noise);
            Conditional { mean: self.mean_after(gain, innovation), covariance }
        }
    }

    const KEPT: JumpMotion<f64> = JumpMotion { kept: 1.0, fresh_variance: 0.81 };
    const FRESH: JumpMotion<f64> = JumpMotion { kept: 0.0, fresh_variance: 0.81 };
    const ABSENT: JumpMotion<f64> = JumpMotion { kept: 0.0, fresh_variance: 0.0 };
    const RESIDUAL_VARIANCE: f64 = 1e-4;

    fn assert_near(name: &str, found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{name}: {found} instead of {expected}");
    }

    fn golden_start() -> Conditional<f64> {
        Conditional {
            mean: [0.1, -0.2, 0.5, 0.001],
            covariance: [0.04, 0.01, -0.01, 0.0, 0.09, 0.02, 1e-4, 0.16, 0.0, 1e-6],
        }
    }

    /// Golden H2.
    #[test]
    fn hlt_5_h2_prediction_and_update_of_one_path() {
        let span = SpanLadder::new(&HealthConfig::<f64, 2>::doppler_against_inertial()).span(1);
        let degraded = span.level_noise[0][1];
        let prediction = golden_start().predict(&span, KEPT, 1.0, RESIDUAL_VARIANCE);
        let before = prediction.update(degraded, 0.0, 0.0);
        for (found, expected) in before.mean.iter().zip([0.0904837418, -0.199, 0.5, 0.001]) {
            assert_near("mean", *found, expected, 1e-10);
        }
        let [p00, p01, p02, _, p11, p12, p13, ..] = before.covariance;
        assert_near("P00", p00, 0.1795773201, 1e-10);
        assert_near("P01", p01, 0.0090483742, 1e-10);
        assert_near("P02", p02, -0.0090483742, 1e-10);
        assert_near("P11", p11, 0.090226, 1e-10);
        assert_near("P12", p12, 0.02, 1e-10);
        assert_near("P13", p13, 1.01e-4, 1e-10);

        let variance = prediction.variance + degraded;
        let innovation = 0.9 - prediction.residual;
        let after = prediction.update(degraded, 1.0 / variance, innovation);
        for (found, expected) in after.mean.iter().zip([0.14093817, -0.21811488, 0.54091570, 0.00096844]) {
            assert_near("updated mean", *found, expected, 6e-9);
        }
        let [p00, _, _, _, p11, _, _, p22, _, p33] = after.covariance;
        for (found, expected) in [p00, p11, p22].iter().zip([0.10585594, 0.07964472, 0.11151865]) {
            assert_near("updated variance", *found, expected, 6e-9);
        }
        assert_near("drift variance", p33, 9.7e-7, 6e-9);
        let log_likelihood =
            -0.5 * (innovation * innovation / variance + (std::f64::consts::TAU * variance).ln());
        assert_near("log likelihood", log_likelihood, -0.4165646719, 1e-9);

        let fresh = golden_start().predict(&span, FRESH, 1.0, RESIDUAL_VARIANCE).update(
            span.level_noise[0][0],
            0.0,
            0.0,
        );
        assert_eq!(fresh.mean[2], 0.0);
        let [p00, _, p02, _, _, p12, _, p22, p23, _] = fresh.covariance;
        assert_near("fresh P00", p00, 0.0490634623, 1e-10);
        assert_eq!([p02, p12, p23], [0.0; 3]);
        assert_near("fresh P22", p22, 0.81, 1e-15);
    }

    fn full(covariance: [f64; 10]) -> Matrix4<f64> {
        let [a, b, c, d, e, f, g, h, i, j] = covariance;
        Matrix4::new(a, b, c, d, b, e, f, g, c, f, h, i, d, g, i, j)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(crate::repeats(1000)))]

        /// Golden H4: the source's correlated-noise filter is the same as predicting and updating with H.
        #[test]
        fn hlt_3_h4_correlated_noise_form_is_predict_and_update(
            mean in prop::array::uniform4(-2.0..2.0_f64),
            root in prop::array::uniform16(-1.0..1.0_f64),
            d in -5.0..5.0_f64,
            which in 0..3_usize,
            degraded in any::<bool>(),
        ) {
            let mut config = HealthConfig::<f64, 2>::doppler_against_inertial();
            config.inertial.drift_random_walk = 0.0;
            let span = SpanLadder::new(&config).span(1);
            let (jump, lambda) = [(ABSENT, 0.0), (FRESH, 1.0), (KEPT, 1.0)][which];
            let root = Matrix4::from_column_slice(&root);
            let p = root * root.transpose();
            let upper = [p.m11, p.m12, p.m13, p.m14, p.m22, p.m23, p.m24, p.m33, p.m34, p.m44];
            let noise = span.level_noise[0][usize::from(degraded)];

            let prediction = Conditional { mean, covariance: upper }.predict(&span, jump, lambda, RESIDUAL_VARIANCE);
            let ours = prediction.update(noise, 1.0 / (prediction.variance + noise), d - prediction.residual);

            let f = Matrix4::new(
                span.correlation, 0.0, 0.0, 0.0,
                0.0, 1.0, 0.0, 1.0,
                0.0, 0.0, jump.kept, 0.0,
                0.0, 0.0, 0.0, 1.0,
            );
            let g_m = if jump.kept == 0.0 { jump.fresh_variance.sqrt() } else { 0.0 };
            let g = Matrix4::from_diagonal(&Vector4::new(noise.sqrt(), 0.005, g_m, 0.0));
            let f_d = RowVector4::new(span.correlation, -1.0, lambda * jump.kept, -1.0);
            let g_d = RowVector4::new(noise.sqrt(), -0.005, lambda * g_m, 0.0);
            let x = Vector4::from(mean);
            let s = (f_d * p * f_d.transpose() + g_d * g_d.transpose()).x + RESIDUAL_VARIANCE;
            let gain = (f * p * f_d.transpose() + g * g_d.transpose()) / s;
            let mean = f * x + gain * (d - (f_d * x).x);
            let covariance = f * p * f.transpose() + g * g.transpose() - gain * s * gain.transpose();

            prop_assert!((Vector4::from(ours.mean) - mean).amax() < 1e-12);
            prop_assert!((full(ours.covariance) - covariance).amax() < 1e-12);
        }
    }
}
