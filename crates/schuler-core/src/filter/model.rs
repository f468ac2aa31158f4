//! The single channel over one step: transition matrix and process noise.
//!
//! State x = [ΔV (m/s), δ (rad), a (m/s²), ω (rad/s)]: velocity error, error of the vertical, accelerometer
//! error, gyro drift. In continuous time, with a and ω first-order Markov processes,
//!
//! ```text
//! ΔV' = −g δ + a        δ' = ΔV / R + ω        a' = −a/τ_a + b_a n        ω' = −ω/τ_w + b_w n
//! ```
//!
//! Source: equations (3), (7) and (9) of the paper on noise identification, for one channel.

use nalgebra::RealField;

use super::{FilterConfig, Gaussian, Kernel, MarkovNoise};
use crate::number::{real, sine_and_cosine};
use crate::saved::{Blank, saved};

/// Halvings of the step before the series is summed; the result is composed with itself as often.
pub(super) const DOUBLINGS: u32 = 6;

/// Terms of the series of the transition matrix over the short step. With a step of at most three correlation
/// times the first term left out is below 1e-15 of the sum.
pub(super) const TERMS: u32 = 8;

/// Nodes and weights of the three-point Gauss–Legendre rule on [0, 1].
pub(super) const QUADRATURE: [(f64, f64); 3] =
    [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// x(k+1) = Φ x(k) + w(k), w ~ N(0, Q), with only the elements of Φ that can differ from zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscreteModel<T> {
    /// Row ΔV of Φ.
    pub velocity: [T; 4],
    /// Row δ of Φ.
    pub vertical: [T; 4],
    /// Φ₃₃ = e^(−Δ/τ_a) and Φ₄₄ = e^(−Δ/τ_w); the rest of rows a and ω is zero.
    pub decay: [T; 2],
    /// Q, upper triangle row by row: vv, vδ, va, vω, δδ, δa, δω, aa, aω, ωω.
    pub noise: [T; 10],
}

impl<T: RealField + Copy> DiscreteModel<T> {
    /// Exact discretisation over `step_s` seconds [FIL-3] [FIL-7] [FIL-9]: scaling and squaring for Φ, and for
    /// Q = ∫ Φ(s) G q Gᵀ Φᵀ(s) ds a Gauss rule over the short step, composed with itself.
    pub fn exact(
        radius_m: T,
        gravity: T,
        accelerometer: &MarkovNoise<T>,
        gyro: &MarkovNoise<T>,
        step_s: T,
    ) -> Self {
        let earth = Earth { radius_m, gravity };
        let short = step_s * real(1.0 / f64::from(1u32 << DOUBLINGS));
        let mut model = earth.short_step(accelerometer, gyro, short);
        for _ in 0..DOUBLINGS {
            model = model.then(&model);
        }
        // The loop's and the sensors' own terms in closed form: the distances of Φ₁₁, Φ₂₂, Φ₃₃ and Φ₄₄ from one
        // have few digits to lose in single precision.
        let schuler = (gravity / radius_m).sqrt();
        let (sine, cosine) = sine_and_cosine(schuler * step_s);
        (model.velocity[0], model.vertical[1]) = (cosine, cosine);
        (model.velocity[1], model.vertical[0]) = (-gravity * sine / schuler, sine / (schuler * radius_m));
        let ratios = [step_s / accelerometer.tau_s, step_s / gyro.tau_s];
        model.decay = ratios.map(|ratio| (-ratio).exp());
        let [aa, ww] = ratios.map(|ratio| -(-(ratio + ratio)).exp_m1());
        model.noise[7] = accelerometer.sigma * accelerometer.sigma * aa;
        model.noise[9] = gyro.sigma * gyro.sigma * ww;
        model
    }

    /// The model as the specification tabulates it: Φ to third order with exact Φ₃₃ and Φ₄₄, and
    /// Q = diag(0, 0, σ_a²(1 − Φ₃₃²), σ_w²(1 − Φ₄₄²)). Kept as the reference of the golden numbers; it is
    /// good to a per cent in variance for steps far below the correlation times.
    pub fn third_order(config: &FilterConfig<T>) -> Self {
        let step = config.step_s;
        let earth = Earth { radius_m: config.radius_m, gravity: config.gravity };
        let (noise_a, noise_w) = (&config.accelerometer, &config.gyro);
        let column =
            |initial: [T; 4]| earth.series(initial, noise_a.tau_s.recip(), noise_w.tau_s.recip(), step, 3);
        let (zero, one) = (T::zero(), T::one());
        let [v, d, a, w] = [
            column([one, zero, zero, zero]),
            column([zero, one, zero, zero]),
            column([zero, zero, one, zero]),
            column([zero, zero, zero, one]),
        ];
        let decay = [(-step / noise_a.tau_s).exp(), (-step / noise_w.tau_s).exp()];
        let variance = |noise: &MarkovNoise<T>, decay: T| noise.sigma * noise.sigma * (one - decay * decay);
        let mut noise = [zero; 10];
        noise[7] = variance(noise_a, decay[0]);
        noise[9] = variance(noise_w, decay[1]);
        Self { velocity: [v[0], d[0], a[0], w[0]], vertical: [v[1], d[1], a[1], w[1]], decay, noise }
    }

    /// This step followed by `next`: Φ = Φ₂Φ₁, Q = Φ₂ Q₁ Φ₂ᵀ + Q₂.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let row = |r: &[T; 4]| {
            [
                r[0] * self.velocity[0] + r[1] * self.vertical[0],
                r[0] * self.velocity[1] + r[1] * self.vertical[1],
                r[0] * self.velocity[2] + r[1] * self.vertical[2] + r[2] * self.decay[0],
                r[0] * self.velocity[3] + r[1] * self.vertical[3] + r[3] * self.decay[1],
            ]
        };
        let mut carried = Gaussian { mean: [T::zero(); 4], covariance: self.noise };
        carried.predict(next);
        Self {
            velocity: row(&next.velocity),
            vertical: row(&next.vertical),
            decay: [self.decay[0] * next.decay[0], self.decay[1] * next.decay[1]],
            noise: carried.covariance,
        }
    }

    /// This step taken `count` times: the model of a decimated measurement.
    #[must_use]
    pub fn repeated(&self, count: u32) -> Self {
        let mut model = *self;
        for _ in 1..count {
            model = model.then(self);
        }
        model
    }
}

/// The Earth as the loop sees it.
struct Earth<T> {
    /// R, m.
    radius_m: T,
    /// g, m/s².
    gravity: T,
}

impl<T: RealField + Copy> Earth<T> {
    /// e^(F s) applied to a state, by `terms` terms of the series; `rates` are 1/τ_a and 1/τ_w.
    fn series(&self, initial: [T; 4], rate_a: T, rate_w: T, s: T, terms: u32) -> [T; 4] {
        let mut sum = initial;
        let mut term = initial;
        for k in 1..=terms {
            let scale = s / real(f64::from(k));
            let [v, d, a, w] = term;
            term = [
                scale * (a - self.gravity * d),
                scale * (v / self.radius_m + w),
                -scale * rate_a * a,
                -scale * rate_w * w,
            ];
            sum = [sum[0] + term[0], sum[1] + term[1], sum[2] + term[2], sum[3] + term[3]];
        }
        sum
    }

    fn short_step(&self, accelerometer: &MarkovNoise<T>, gyro: &MarkovNoise<T>, step: T) -> DiscreteModel<T> {
        let (rate_a, rate_w) = (accelerometer.tau_s.recip(), gyro.tau_s.recip());
        let (zero, one) = (T::zero(), T::one());
        let column = |initial, s| self.series(initial, rate_a, rate_w, s, TERMS);
        let v = column([one, zero, zero, zero], step);
        let d = column([zero, one, zero, zero], step);
        let a = column([zero, zero, one, zero], step);
        let w = column([zero, zero, zero, one], step);
        let (level_a, level_w) = (accelerometer.spectral_level() * step, gyro.spectral_level() * step);
        let mut noise = [zero; 10];
        for (node, weight) in QUADRATURE {
            let s = step * real(node);
            let a = column([zero, zero, one, zero], s);
            let w = column([zero, zero, zero, one], s);
            let (qa, qw) = (level_a * real(weight), level_w * real(weight));
            noise[0] += qa * a[0] * a[0] + qw * w[0] * w[0];
            noise[1] += qa * a[0] * a[1] + qw * w[0] * w[1];
            noise[2] += qa * a[0] * a[2];
            noise[3] += qw * w[0] * w[3];
            noise[4] += qa * a[1] * a[1] + qw * w[1] * w[1];
            noise[5] += qa * a[1] * a[2];
            noise[6] += qw * w[1] * w[3];
            noise[7] += qa * a[2] * a[2];
            noise[9] += qw * w[3] * w[3];
        }
        DiscreteModel {
            velocity: [v[0], d[0], a[0], w[0]],
            vertical: [v[1], d[1], a[1], w[1]],
            decay: [a[2], w[3]],
            noise,
        }
    }
}

saved!([T: Blank] DiscreteModel<T> { velocity, vertical, decay, noise });
