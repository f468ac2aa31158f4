//! The deterministic records against which the golden numbers of the filter and of the identification stand.
//!
//! Generator: s ← 16807 s mod 2147483647, u = s / 2147483647, normals in pairs by Box and Muller.

use std::f64::consts::TAU;

use schuler_core::filter::{DiscreteModel, FilterConfig, MarkovNoise};

/// 1 °/h in rad/s.
pub const DEGREE_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

/// The minimal-standard generator with normal deviates in pairs.
#[derive(Clone, Debug)]
pub struct MinimalStandard {
    state: u64,
    second: Option<f64>,
}

impl MinimalStandard {
    /// Starts from `seed`.
    pub const fn new(seed: u64) -> Self {
        Self { state: seed, second: None }
    }

    /// The next uniform deviate in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.state = 16807 * self.state % 2_147_483_647;
        self.state as f64 / 2_147_483_647.0
    }

    /// The next standard normal deviate.
    pub fn normal(&mut self) -> f64 {
        if let Some(second) = self.second.take() {
            return second;
        }
        let (u1, u2) = (self.uniform(), self.uniform());
        let radius = (-2.0 * u1.ln()).sqrt();
        self.second = Some(radius * (TAU * u2).sin());
        radius * (TAU * u2).cos()
    }
}

/// A scenario of the specification, with velocity noise r = 0.1 m/s and a step of 1 s.
pub fn scenario(sigma_a: f64, tau_a: f64, sigma_w: f64, tau_w: f64) -> FilterConfig<f64> {
    FilterConfig {
        radius_m: 6_371_000.0,
        gravity: 9.80665,
        step_s: 1.0,
        accelerometer: MarkovNoise { sigma: sigma_a, tau_s: tau_a },
        gyro: MarkovNoise { sigma: sigma_w, tau_s: tau_w },
        velocity_noise: 0.1,
        initial_velocity_sigma: 0.1,
        initial_vertical_sigma: 1e-4,
        gate_sigma: 1e9,
    }
}

/// Reference scenario R1: σ_a = 1e-4 g, τ_a = 60 s, σ_w = 0.1 °/h, τ_w = 1800 s.
pub fn scenario_r1() -> FilterConfig<f64> {
    scenario(9.80665e-4, 60.0, 0.1 * DEGREE_PER_HOUR, 1800.0)
}

/// The channel's noise with its rates and diffusions multiplied: the mis-tuned starts.
pub fn mistuned(truth: &FilterConfig<f64>, rates: [f64; 2], diffusions: [f64; 2]) -> FilterConfig<f64> {
    let off = |noise: MarkovNoise<f64>, rate: f64, diffusion: f64| MarkovNoise {
        sigma: noise.sigma * diffusion / rate.sqrt(),
        tau_s: noise.tau_s / rate,
    };
    FilterConfig {
        accelerometer: off(truth.accelerometer, rates[0], diffusions[0]),
        gyro: off(truth.gyro, rates[1], diffusions[1]),
        ..*truth
    }
}

/// The truth and the measurements of one flight.
#[derive(Clone, Debug)]
pub struct Flight {
    /// True states [ΔV, δ, a, ω] after each step.
    pub truth: Vec<[f64; 4]>,
    /// Measured velocity error, m/s.
    pub measured: Vec<f64>,
}

/// A flight of `steps` steps from the specification's third-order model. `normal` yields standard normals.
pub fn fly(config: &FilterConfig<f64>, steps: usize, mut normal: impl FnMut() -> f64) -> Flight {
    let model = DiscreteModel::third_order(config);
    let sigma = [0.1, 1e-4, config.accelerometer.sigma, config.gyro.sigma];
    let mut x = sigma.map(|s| s * normal());
    let driving = [model.noise[7].sqrt(), model.noise[9].sqrt()];
    let mut flight = Flight { truth: Vec::with_capacity(steps), measured: Vec::with_capacity(steps) };
    for _ in 0..steps {
        let dot = |row: &[f64; 4]| row.iter().zip(&x).map(|(f, x)| f * x).sum::<f64>();
        x = [dot(&model.velocity), dot(&model.vertical), model.decay[0] * x[2], model.decay[1] * x[3]];
        x[2] += driving[0] * normal();
        x[3] += driving[1] * normal();
        flight.truth.push(x);
        flight.measured.push(x[0] + config.velocity_noise * normal());
    }
    flight
}

/// Record K1: R1, seed 20261120, six hours.
pub fn record_k1() -> Flight {
    let mut generator = MinimalStandard::new(20_261_120);
    fly(&scenario_r1(), 21_600, || generator.normal())
}

/// A flight of `steps` seconds in which one sensor's error (0 accelerometer, 1 gyro) is exponential-cosine with
/// the standard deviation of `config` and the given α (1/s) and β (rad/s); the other's is of first order.
///
/// Independent of the filter's models: the sensors' errors by their own recursions, the loop by the trapezoidal
/// rule with ten substeps.
pub fn fly_exponential_cosine(
    config: &FilterConfig<f64>,
    sensor: usize,
    [alpha, beta]: [f64; 2],
    steps: usize,
    mut normal: impl FnMut() -> f64,
) -> Flight {
    let substep = 0.1;
    let mut noise = [
        (config.accelerometer.sigma, 1.0 / config.accelerometer.tau_s, 0.0),
        (config.gyro.sigma, 1.0 / config.gyro.tau_s, 0.0),
    ];
    (noise[sensor].1, noise[sensor].2) = (alpha, beta);
    let mut error = noise.map(|(sigma, ..)| [sigma * normal(), sigma * normal()]);
    let (mut velocity, mut vertical) = (0.1 * normal(), 1e-4 * normal());
    let mut flight = Flight { truth: Vec::with_capacity(steps), measured: Vec::with_capacity(steps) };
    for _ in 0..steps {
        for _ in 0..10 {
            let before = error;
            for ((sigma, alpha, beta), x) in noise.into_iter().zip(&mut error) {
                let decay = (-alpha * substep).exp();
                let (sine, cosine) = (beta * substep).sin_cos();
                let driving = sigma * (1.0 - decay * decay).sqrt();
                *x = [
                    decay * (cosine * x[0] - sine * x[1]) + driving * normal(),
                    decay * (sine * x[0] + cosine * x[1]) + driving * normal(),
                ];
            }
            let (a, w) = (0.5 * (before[0][0] + error[0][0]), 0.5 * (before[1][0] + error[1][0]));
            let middle = vertical + 0.5 * substep * (velocity / config.radius_m + w);
            velocity += substep * (a - config.gravity * middle);
            vertical += substep * (velocity / config.radius_m + w);
        }
        flight.truth.push([velocity, vertical, error[0][0], error[1][0]]);
        flight.measured.push(velocity + config.velocity_noise * normal());
    }
    flight
}

/// The same configuration in the flight module's precision, with its gate.
pub fn in_flight_precision(config: &FilterConfig<f64>) -> FilterConfig<f32> {
    let noise =
        |noise: MarkovNoise<f64>| MarkovNoise { sigma: noise.sigma as f32, tau_s: noise.tau_s as f32 };
    FilterConfig {
        radius_m: config.radius_m as f32,
        gravity: config.gravity as f32,
        step_s: config.step_s as f32,
        accelerometer: noise(config.accelerometer),
        gyro: noise(config.gyro),
        velocity_noise: config.velocity_noise as f32,
        initial_velocity_sigma: config.initial_velocity_sigma as f32,
        initial_vertical_sigma: config.initial_vertical_sigma as f32,
        gate_sigma: 6.0,
    }
}
