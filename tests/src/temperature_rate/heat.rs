//! Two masses in a changing environment [TMP-9]: `Ti' = (To − Ti)/τ1 + P·R1/τ1`, `To' = (env − To)/τ2`, Euler at 1 s.
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

/// Temperature of the environment, degC, at a time in s.
pub type Environment = fn(f64) -> f64;
/// Dissipated power, relative, at a time in s.
pub type Power = fn(f64) -> f64;

/// One history of temperature.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Time constant of the inner mass, s.
    pub inner_s: f64,
    /// Time constant of the outer mass, s.
    pub outer_s: f64,
    /// Rise of the inner over the outer mass at full power, degC.
    pub rise: f64,
    /// Relative power.
    pub power: Power,
    /// Environment.
    pub environment: Environment,
    /// Length, s.
    pub length_s: usize,
}

/// True temperature (degC) and rate (degC/s), a sample a second.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// degC.
    pub temperature: Vec<f64>,
    /// degC/s.
    pub rate: Vec<f64>,
}

impl Profile {
    /// Integrates the model with `offset` (degC) added to the environment.
    pub fn history(&self, offset: f64) -> History {
        let mut inner = (self.environment)(0.0) + offset;
        let mut outer = inner;
        let mut history = History::default();
        for t in 0..self.length_s {
            let t = t as f64;
            let rate = (outer - inner) / self.inner_s + (self.power)(t) * self.rise / self.inner_s;
            history.temperature.push(inner);
            history.rate.push(rate);
            inner += rate;
            outer += ((self.environment)(t) + offset - outer) / self.outer_s;
        }
        history
    }
}

/// Readings of a rounding thermometer with white noise before the converter, both in degC.
///
/// # Panics
/// On a noise that is not a number.
pub fn read(history: &History, quantum: f64, noise: f64, seed: u64) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let normal = Normal::new(0.0, noise).expect("a finite sigma");
    history
        .temperature
        .iter()
        .map(|t| ((t + normal.sample(&mut random)) / quantum + 0.5).floor() * quantum)
        .collect()
}

/// Straight lines between knots `(t, value)`, constant beyond.
fn polyline(knots: &[(f64, f64)], t: f64) -> f64 {
    let after = knots.iter().position(|k| k.0 > t);
    match after {
        Some(0) => knots[0].1,
        None => knots[knots.len() - 1].1,
        Some(k) => {
            let ((t0, v0), (t1, v1)) = (knots[k - 1], knots[k]);
            v0 + (v1 - v0) * (t - t0) / (t1 - t0)
        }
    }
}

fn wave(t: f64, period: f64) -> f64 {
    (std::f64::consts::TAU * t / period).sin()
}

/// The three profiles of slow change on which the defaults were picked.
pub const SLOW: [Profile; 3] = [
    Profile {
        inner_s: 2400.0,
        outer_s: 7200.0,
        rise: 22.0,
        power: |t| 1.0 - (-t / 600.0).exp(),
        environment: |_| 20.0,
        length_s: 6 * 3600,
    },
    Profile {
        inner_s: 2400.0,
        outer_s: 1800.0,
        rise: 15.0,
        power: |t| 1.0 - (-t / 600.0).exp(),
        environment: |t| {
            polyline(
                &[
                    (0.0, 20.0),
                    (5400.0, 20.0),
                    (10800.0, 50.0),
                    (14400.0, 50.0),
                    (21600.0, 10.0),
                    (28800.0, 10.0),
                ],
                t,
            )
        },
        length_s: 8 * 3600,
    },
    Profile {
        inner_s: 2400.0,
        outer_s: 3600.0,
        rise: 15.0,
        power: |t| 1.0 - (-t / 600.0).exp(),
        environment: |t| 20.0 + 8.0 * wave(t, 18_000.0),
        length_s: 8 * 3600,
    },
];

/// Three profiles that nobody tuned on.
pub const HELD_OUT: [Profile; 3] = [
    Profile {
        inner_s: 1500.0,
        outer_s: 5400.0,
        rise: 17.0,
        power: |t| 1.0 - (-t / 400.0).exp(),
        environment: |_| 12.0,
        length_s: 6 * 3600,
    },
    Profile {
        inner_s: 1800.0,
        outer_s: 2700.0,
        rise: 12.0,
        power: |t| 1.0 - (-t / 400.0).exp(),
        environment: |t| {
            polyline(
                &[
                    (0.0, 25.0),
                    (3000.0, 25.0),
                    (9000.0, -5.0),
                    (12000.0, -5.0),
                    (20000.0, 35.0),
                    (25200.0, 35.0),
                ],
                t,
            )
        },
        length_s: 8 * 3600,
    },
    Profile {
        inner_s: 3000.0,
        outer_s: 2400.0,
        rise: 14.0,
        power: |t| 1.0 - (-t / 400.0).exp(),
        environment: |t| 10.0 + 6.0 * wave(t, 11_000.0) + 3.0 * wave(t, 5_200.0),
        length_s: 8 * 3600,
    },
];

/// Fractions of a quantum added to the environment where methods are compared.
pub const PHASES: [f64; 3] = [0.19, 0.55, 0.87];
/// Fractions of a quantum where the competitors are tuned.
pub const TUNING_PHASES: [f64; 2] = [0.03, 0.37];
