//! Mean and covariance of the four states, carried over a step and corrected by a velocity.
//!
//! The one kernel that the filter, the bank and the likelihood search all run.

use nalgebra::RealField;

use super::DiscreteModel;
use super::kernel::{Innovation, Kernel};

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

    /// x ← Φx, P ← ΦPΦᵀ + Q, with Φ's zeros left out. [FIL-6]
    #[inline]
    fn predict(&mut self, model: &DiscreteModel<T>) {
        let [v, d, a, w] = self.mean;
        let dot = |row: &[T; 4], x: [T; 4]| row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] * x[3];
        let (rv, rd, [fa, fw]) = (&model.velocity, &model.vertical, model.decay);
        self.mean = [dot(rv, [v, d, a, w]), dot(rd, [v, d, a, w]), fa * a, fw * w];

        let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = self.covariance;
        // Columns of P, and the rows ΔV and δ of ΦP.
        let columns = [[vv, vd, va, vw], [vd, dd, da, dw], [va, da, aa, aw], [vw, dw, aw, ww]];
        let mv = columns.map(|column| dot(rv, column));
        let md = columns.map(|column| dot(rd, column));
        let q = &model.noise;
        self.covariance = [
            dot(rv, mv) + q[0],
            dot(rd, mv) + q[1],
            fa * mv[2] + q[2],
            fw * mv[3] + q[3],
            dot(rd, md) + q[4],
            fa * md[2] + q[5],
            fw * md[3] + q[6],
            fa * fa * aa + q[7],
            fa * fw * aw + q[8],
            fw * fw * ww + q[9],
        ];
    }

    /// With H = [1 0 0 0] the Joseph form is P − K P₁· + (K S − P·₁) Kᵀ; the bracket is the rounding error of
    /// the gain, and carrying it is what keeps P symmetric and positive. [FIL-5] [FIL-6]
    #[inline]
    fn correct(&mut self, innovation: &Innovation<T>, used: bool) {
        let [vv, vd, va, vw, ..] = self.covariance;
        let first = [vv, vd, va, vw];
        let inverse = if used { innovation.variance.recip() } else { T::zero() };
        let value = if used { innovation.value } else { T::zero() };
        let gain = first.map(|p| p * inverse);
        for (x, k) in self.mean.iter_mut().zip(gain) {
            *x += k * value;
        }
        let s = innovation.variance;
        let excess = [gain[0] * s - vv, gain[1] * s - vd, gain[2] * s - va, gain[3] * s - vw];
        let p = &mut self.covariance;
        p[0] += gain[0] * (excess[0] - vv);
        p[1] += gain[1] * excess[0] - gain[0] * vd;
        p[2] += gain[2] * excess[0] - gain[0] * va;
        p[3] += gain[3] * excess[0] - gain[0] * vw;
        p[4] += gain[1] * (excess[1] - vd);
        p[5] += gain[2] * excess[1] - gain[1] * va;
        p[6] += gain[3] * excess[1] - gain[1] * vw;
        p[7] += gain[2] * (excess[2] - va);
        p[8] += gain[3] * excess[2] - gain[2] * vw;
        p[9] += gain[3] * (excess[3] - vw);
    }

    /// Every variance is positive and everything is finite.
    #[inline]
    fn is_sound(&self) -> bool {
        let positive = self.variances().iter().all(|&p| p > T::zero());
        let sum = self.mean.iter().chain(&self.covariance).fold(T::zero(), |sum, &x| sum + x * T::zero());
        positive && sum == T::zero()
    }

    fn spread_out(&self, velocity: T, velocity_sigma: T, factor: T, most: [T; 4]) -> Self {
        let variances = self.variances();
        let mut spread = [velocity_sigma; 4];
        let mut mean = self.mean;
        for i in 1..4 {
            spread[i] = (variances[i].sqrt() * factor).min(most[i]);
            mean[i] = mean[i].min(most[i]).max(-most[i]);
        }
        mean[0] = velocity;
        Self::independent(mean, spread)
    }

    fn with_mean_of(&self, other: &Self) -> Self {
        Self { mean: other.mean, covariance: self.covariance }
    }
}
