//! What known sensor errors make of a Schuler loop.
//!
//! The loop is linear, `ΔV' = −g δ + a`, `δ' = ΔV/R + ω` [FIL-3]: its motion is the sum of what the known errors make of it
//! and of what everything else does. So the known part is moved here by itself, taken off the measurement before the filter
//! sees it and added to the estimate afterwards. That is the filter with a known input, exactly, for every filter that
//! looks at the measurements, and none of them has to know.
use crate::number::sine_and_cosine;
use crate::saved::saved;

/// The known part of velocity error and vertical error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopResponse {
    /// ΔV, m/s.
    velocity: f64,
    /// δ, rad.
    vertical: f64,
    /// Accelerometer error (m/s²) and gyro drift (rad/s) at the last step; none before the first.
    last: Option<[f64; 2]>,
}

impl LoopResponse {
    /// Moves over `duration_s` with the mean of the errors at both ends: accelerometer, m/s², gyro, rad/s. In double precision,
    /// for the loop forgets nothing. Never panics.
    pub fn pass(&mut self, errors: [f32; 2], radius_m: f32, gravity: f32, duration_s: f64) {
        let now = errors.map(f64::from);
        let [a0, w0] = self.last.unwrap_or(now);
        self.last = Some(now);
        let (a, w) = (0.5 * (a0 + now[0]), 0.5 * (w0 + now[1]));
        let (radius, gravity) = (f64::from(radius_m), f64::from(gravity));
        let schuler = libm::sqrt(gravity / radius);
        let (sine, cosine) = sine_and_cosine(schuler * duration_s);
        // Where the errors would hold the loop at rest.
        let (velocity_rest, vertical_rest) = (-radius * w, a / gravity);
        let (v, d) = (self.velocity - velocity_rest, self.vertical - vertical_rest);
        self.velocity = velocity_rest + v * cosine - gravity / schuler * d * sine;
        self.vertical = vertical_rest + d * cosine + v * sine / (radius * schuler);
    }

    /// ΔV, m/s.
    pub fn velocity(&self) -> f32 {
        self.velocity as f32
    }

    /// The known parts of the filter's states: ΔV (m/s), δ (rad), a (m/s²), ω (rad/s).
    pub fn states(&self) -> [f32; 4] {
        let [a, w] = self.last.unwrap_or_default();
        [self.velocity, self.vertical, a, w].map(|state| state as f32)
    }
}

saved!([] LoopResponse { velocity, vertical, last });

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS: f32 = 6_371_000.0;
    const GRAVITY: f32 = 9.80665;

    /// Against a Runge-Kutta integration of the two equations with errors that vary.
    #[test]
    fn fil_3_known_errors_move_the_loop_as_its_equations_say() {
        let errors = |t: f64| [1e-3 * libm::cos(t / 700.0), 4e-7 * libm::sin(t / 1500.0)];
        let mut response = LoopResponse::default();
        let (mut v, mut d) = (0.0, 0.0);
        let (r, g) = (f64::from(RADIUS), f64::from(GRAVITY));
        let slope = |t: f64, v: f64, d: f64| {
            let [a, w] = errors(t);
            (-g * d + a, v / r + w)
        };
        response.pass(errors(0.0).map(|e| e as f32), RADIUS, GRAVITY, 0.0);
        for k in 0..crate::repeats(20_000) {
            let t = f64::from(k);
            let (k1, l1) = slope(t, v, d);
            let (k2, l2) = slope(t + 0.5, v + 0.5 * k1, d + 0.5 * l1);
            let (k3, l3) = slope(t + 0.5, v + 0.5 * k2, d + 0.5 * l2);
            let (k4, l4) = slope(t + 1.0, v + k3, d + l3);
            v += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
            d += (l1 + 2.0 * l2 + 2.0 * l3 + l4) / 6.0;
            response.pass(errors(t + 1.0).map(|e| e as f32), RADIUS, GRAVITY, 1.0);
            let states = response.states();
            assert!((f64::from(states[0]) - v).abs() < 1e-4, "{k}: {states:?} {v} {d}");
            assert!((f64::from(states[1]) - d).abs() < 1e-8, "{k}: {states:?} {v} {d}");
        }
        // It has gone somewhere, or nothing was shown.
        assert!(v.abs() > 0.1, "{v}");
    }
}
