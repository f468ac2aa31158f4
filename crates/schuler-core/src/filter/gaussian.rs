//! Mean and covariance of the four states, carried over a step and corrected by a velocity.
//!
//! The one kernel that the filter, the bank and the likelihood search all run.

use nalgebra::RealField;

use super::DiscreteModel;
use super::kernel::{Farthest, Innovation, Kernel, Restart, are_finite, at_most, certain};
use crate::number::select;
use crate::saved::{Blank, saved};

/// A Gaussian over [ΔV, δ, a, ω].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<T> {
    /// Mean: m/s, rad, m/s², rad/s.
    pub mean: [T; 4],
    /// Covariance, upper triangle row by row: vv, vδ, va, vω, δδ, δa, δω, aa, aω, ωω.
    pub covariance: [T; 10],
}

impl<T: RealField + Copy> Gaussian<T> {
    /// Independent states with the given means and standard deviations.
    pub fn independent(mean: [T; 4], sigma: [T; 4]) -> Self {
        let mut covariance = [T::zero(); 10];
        covariance[0] = sigma[0] * sigma[0];
        covariance[4] = sigma[1] * sigma[1];
        covariance[7] = sigma[2] * sigma[2];
        covariance[9] = sigma[3] * sigma[3];
        Self { mean, covariance }
    }
}

impl<T: RealField + Copy> Kernel<T> for Gaussian<T> {
    type Model = DiscreteModel<T>;

    fn mean(&self) -> [T; 4] {
        self.mean
    }

    #[inline]
    fn variances(&self) -> [T; 4] {
        [self.covariance[0], self.covariance[4], self.covariance[7], self.covariance[9]]
    }

    /// x ← Φx, P ← ΦPΦᵀ + Q. [FIL-6]
    ///
    /// With Φ = [A B; 0 D] and P = [L C; Cᵀ S], all of them 2×2, D diagonal, and N = AC + BS:
    /// ΦPΦᵀ = [ALAᵀ + NBᵀ + B(AC)ᵀ, ND; ·, DSD].
    #[inline]
    fn predict(&mut self, model: &DiscreteModel<T>) {
        let [v, d, a, w] = self.mean;
        let ([a11, a12, b11, b12], [a21, a22, b21, b22]) = (model.velocity, model.vertical);
        let [da, dw] = model.decay;
        self.mean =
            [a11 * v + a12 * d + b11 * a + b12 * w, a21 * v + a22 * d + b21 * a + b22 * w, da * a, dw * w];

        let [l11, l12, c11, c12, l22, c21, c22, s11, s12, s22] = self.covariance;
        let q = &model.noise;
        // AC, N = AC + BS, and N + AC for the diagonal.
        let (g11, g12) = (a11 * c11 + a12 * c21, a11 * c12 + a12 * c22);
        let (g21, g22) = (a21 * c11 + a22 * c21, a21 * c12 + a22 * c22);
        let (n11, n12) = (g11 + b11 * s11 + b12 * s12, g12 + b11 * s12 + b12 * s22);
        let (n21, n22) = (g21 + b21 * s11 + b22 * s12, g22 + b21 * s12 + b22 * s22);
        // AL.
        let (t11, t12) = (a11 * l11 + a12 * l12, a11 * l12 + a12 * l22);
        let (t21, t22) = (a21 * l11 + a22 * l12, a21 * l12 + a22 * l22);
        self.covariance = [
            q[0] + t11 * a11 + t12 * a12 + (n11 + g11) * b11 + (n12 + g12) * b12,
            q[1] + t11 * a21 + t12 * a22 + n11 * b21 + n12 * b22 + g21 * b11 + g22 * b12,
            q[2] + n11 * da,
            q[3] + n12 * dw,
            q[4] + t21 * a21 + t22 * a22 + (n21 + g21) * b21 + (n22 + g22) * b22,
            q[5] + n21 * da,
            q[6] + n22 * dw,
            q[7] + da * da * s11,
            q[8] + da * dw * s12,
            q[9] + dw * dw * s22,
        ];
    }

    #[inline]
    fn spread_velocity(&mut self, variance: T) {
        self.covariance[0] += variance;
    }

    /// With H = [1 0 0 0] the Joseph form is P − K P₁· + (K S − P·₁) Kᵀ; the bracket is the rounding error of
    /// the gain, and carrying it is what keeps P symmetric. What `certain` leaves in the variances keeps it positive.
    /// [FIL-5] [FIL-6]
    #[inline]
    fn correct(&mut self, innovation: &Innovation<T>, used: bool) {
        let s = innovation.variance;
        let inverse = select(used, s.recip(), T::zero());
        let value = select(used, innovation.value, T::zero());
        let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = self.covariance;
        let [kv, kd, ka, kw] = [vv * inverse, vd * inverse, va * inverse, vw * inverse];
        let [v, d, a, w] = self.mean;
        self.mean = [v + kv * value, d + kd * value, a + ka * value, w + kw * value];
        // What is left of the velocity's row: r²/S.
        let left = select(used, innovation.noise * inverse, T::one());
        let [ed, ea, ew] = [kd * s - vd, ka * s - va, kw * s - vw];
        let certain = certain::<T>();
        self.covariance = [
            vv * left,
            vd * left,
            va * left,
            vw * left,
            dd + kd * (ed - certain * vd),
            da + ka * ed - kd * va,
            dw + kw * ed - kd * vw,
            aa + ka * (ea - certain * va),
            aw + kw * ea - ka * vw,
            ww + kw * (ew - certain * vw),
        ];
    }

    #[inline]
    fn is_sound(&self) -> bool {
        let variances = self.variances();
        let finite = are_finite(self.mean.iter().chain(&variances));
        variances.iter().fold(finite, |sound, &p| sound & (p > T::zero()))
    }

    #[inline]
    fn restart_if(&mut self, restart: &Restart<T>, prior: &Self, most: &Farthest<T>) {
        let mean = |own: T, prior: T, most: T| {
            let start = select(own.abs() <= most, own, prior);
            select(restart.condition, start, own)
        };
        let variance = |own: T, prior: T, most: T| {
            let start = select(restart.variance_of_prior, prior, at_most(own * restart.factor, most));
            select(restart.condition, start, own)
        };
        let correlation = |own: T| select(restart.condition, T::zero(), own);

        let [_, d, a, w] = self.mean;
        let [_, prior_d, prior_a, prior_w] = prior.mean;
        let [_, most_d, most_a, most_w] = most.mean;
        self.mean =
            [restart.velocity, mean(d, prior_d, most_d), mean(a, prior_a, most_a), mean(w, prior_w, most_w)];
        let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = self.covariance;
        let [_, prior_d, prior_a, prior_w] = prior.variances();
        let [_, most_d, most_a, most_w] = most.variance;
        self.covariance = [
            select(restart.condition, restart.velocity_variance, vv),
            correlation(vd),
            correlation(va),
            correlation(vw),
            variance(dd, prior_d, most_d),
            correlation(da),
            correlation(dw),
            variance(aa, prior_a, most_a),
            correlation(aw),
            variance(ww, prior_w, most_w),
        ];
    }
}

saved!([T: Blank] Gaussian<T> { mean, covariance });
