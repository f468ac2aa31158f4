//! The truth of a single-channel, Schuler-tuned inertial system.
//!
//! A platform carried over a sphere of radius R is kept level by torquing it at V/R. With δ its tilt, ΔV the error of its
//! velocity, a the accelerometer's error, ω the gyro's drift and V̇ the true acceleration:
//!
//! d(ΔV)/dt = V̇ (cos δ − 1) − g sin δ + a,  dδ/dt = ΔV/R + ω
//!
//! which for small δ is the first two rows of FILTER's F. Integrated with fourth-order Runge–Kutta; at a step of 1 s
//! the truncation is below double precision. SI units.

use std::collections::VecDeque;

/// The system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SchulerLoop {
    /// Radius of the Earth, m.
    pub radius_m: f64,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Error of the velocity ΔV, m/s.
    pub velocity_error: f64,
    /// Tilt δ, rad.
    pub tilt: f64,
}

impl SchulerLoop {
    /// Moves on by a step, with the sensors' mean errors over it (m/s², rad/s) and the true acceleration (m/s²).
    pub fn advance(&mut self, step_s: f64, accelerometer_error: f64, gyro_drift: f64, acceleration: f64) {
        let slope = |v: f64, d: f64| {
            let (s, c) = d.sin_cos();
            (
                acceleration * (c - 1.0) - self.gravity * s + accelerometer_error,
                v / self.radius_m + gyro_drift,
            )
        };
        // At most 10 s at a time: (ω_S h)⁵ stays below 1e-9.
        let parts = (step_s / 10.0).ceil().max(1.0);
        let h = step_s / parts;
        for _ in 0..parts as usize {
            let (v, d) = (self.velocity_error, self.tilt);
            let k1 = slope(v, d);
            let k2 = slope(v + 0.5 * h * k1.0, d + 0.5 * h * k1.1);
            let k3 = slope(v + 0.5 * h * k2.0, d + 0.5 * h * k2.1);
            let k4 = slope(v + h * k3.0, d + h * k3.1);
            self.velocity_error = v + h / 6.0 * (k1.0 + 2.0 * (k2.0 + k3.0) + k4.0);
            self.tilt = d + h / 6.0 * (k1.1 + 2.0 * (k2.1 + k3.1) + k4.1);
        }
    }
}

/// The past of a quantity, to read it with a delay.
#[derive(Clone, Debug)]
pub struct Delay {
    delay_s: f64,
    past: VecDeque<(f64, f64)>,
}

impl Delay {
    /// A delay of this many seconds.
    pub const fn new(delay_s: f64) -> Self {
        Self { delay_s, past: VecDeque::new() }
    }

    /// Takes the present value and gives the delayed one, linear between the values taken; before the first, the first.
    pub fn pass(&mut self, time_s: f64, value: f64) -> f64 {
        self.past.push_back((time_s, value));
        let wanted = time_s - self.delay_s;
        while self.past.len() > 2 && self.past[1].0 <= wanted {
            self.past.pop_front();
        }
        let (t0, v0) = self.past[0];
        let (t1, v1) = if self.past.len() > 1 { self.past[1] } else { (t0, v0) };
        if wanted <= t0 || t1 <= t0 { v0 } else { v0 + (v1 - v0) * ((wanted - t0) / (t1 - t0)).min(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::earth::{MEAN_RADIUS, STANDARD_GRAVITY};
    use nalgebra::Matrix4;

    const LEVEL: SchulerLoop =
        SchulerLoop { radius_m: MEAN_RADIUS, gravity: STANDARD_GRAVITY, velocity_error: 0.0, tilt: 0.0 };

    #[test]
    fn the_period_is_84_4_minutes() {
        let mut it = SchulerLoop { tilt: 1e-5, ..LEVEL };
        let mut crossings = Vec::new();
        for k in 1..20_000 {
            let before = it.tilt;
            it.advance(1.0, 0.0, 0.0, 0.0);
            if before < 0.0 && it.tilt >= 0.0 {
                crossings.push(f64::from(k) - it.tilt / (it.tilt - before));
            }
        }
        let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
        let expected = std::f64::consts::TAU * (MEAN_RADIUS / STANDARD_GRAVITY).sqrt();
        assert!((period - expected).abs() < 0.01 && (period / 60.0 - 84.4).abs() < 0.1, "{period}");
    }

    #[test]
    fn constant_errors_give_the_closed_forms() {
        // a: δ → (a/g)(1 − cos ω_S t), ΔV = (a/ω_S) sin ω_S t. Drift: ΔV = −R ω (1 − cos ω_S t).
        let w = (STANDARD_GRAVITY / MEAN_RADIUS).sqrt();
        let (a, drift) = (1e-4, 5e-8);
        let (mut by_a, mut by_drift) = (LEVEL, LEVEL);
        for k in 1..=7000 {
            by_a.advance(1.0, a, 0.0, 0.0);
            by_drift.advance(1.0, 0.0, drift, 0.0);
            let phase = w * f64::from(k);
            assert!((by_a.velocity_error - a / w * phase.sin()).abs() < 1e-6);
            assert!((by_a.tilt - a / STANDARD_GRAVITY * (1.0 - phase.cos())).abs() < 1e-12);
            assert!((by_drift.velocity_error + MEAN_RADIUS * drift * (1.0 - phase.cos())).abs() < 1e-5);
        }
    }

    #[test]
    fn fil_3_transition_agrees_with_the_truth() {
        // Φ = I + FΔ + (FΔ)²/2 + (FΔ)³/6 with held sensor errors.
        let mut f = Matrix4::zeros();
        (f[(0, 1)], f[(0, 2)], f[(1, 0)], f[(1, 3)]) = (-STANDARD_GRAVITY, 1.0, 1.0 / MEAN_RADIUS, 1.0);
        let phi = Matrix4::identity() + f + f * f * 0.5 + f * f * f / 6.0;
        let mut it = SchulerLoop { velocity_error: 0.3, tilt: 2e-4, ..LEVEL };
        it.advance(1.0, 1e-3, 1e-6, 0.0);
        let linear = phi * nalgebra::Vector4::new(0.3, 2e-4, 1e-3, 1e-6);
        assert!((it.velocity_error - linear[0]).abs() < 1e-10 && (it.tilt - linear[1]).abs() < 1e-14);
    }

    #[test]
    fn a_delay_reads_the_past() {
        let mut delay = Delay::new(2.5);
        let told: Vec<f64> = (0..10).map(|k| delay.pass(f64::from(k), f64::from(k * k))).collect();
        assert_eq!(told[..3], [0.0; 3]);
        assert_eq!(told[6], 12.5);
        let mut none = Delay::new(0.0);
        assert!((0..5).all(|k| none.pass(f64::from(k), f64::from(k)) == f64::from(k)));
    }
}
