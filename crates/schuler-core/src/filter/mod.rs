//! The error filter of a single-channel, Schuler-tuned inertial system.
//!
//! Input: the inertial velocity less a reference velocity, m/s, once a step. Output: velocity error, error of
//! the vertical, accelerometer error and gyro drift with their standard deviations, the innovation and its
//! normalised square.
//!
//! Source: the paper on noise identification, equations (3)–(9).

use nalgebra::{ComplexField, RealField};
use serde::{Deserialize, Serialize};

mod coloured;
mod gaussian;
mod kernel;
mod model;

pub use coloured::{ColouredGaussian, ColouredModel, ColouredNoise};
pub use gaussian::Gaussian;
pub use kernel::{Farthest, Innovation, Kernel, Restart};
pub use model::DiscreteModel;

use crate::config::{ConfigError, Problem};
use crate::number::{real, select};
use crate::saved::{Blank, saved};
use kernel::are_finite;

/// A first-order Markov process: R(t) = σ² exp(−|t|/τ) [FIL-7].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkovNoise<T> {
    /// Standard deviation σ, in the state's unit (m/s² for the accelerometer, rad/s for the gyro).
    pub sigma: T,
    /// Correlation time τ, s.
    pub tau_s: T,
}

impl<T: RealField + Copy> MarkovNoise<T> {
    /// Level q = b² = 2σ²/τ of the white noise that drives the process [FIL-8].
    #[inline]
    pub fn spectral_level(&self) -> T {
        real::<T>(2.0) * self.sigma * self.sigma / self.tau_s
    }

    fn check(&self, fields: [&'static str; 2], step_s: T) -> Result<(), ConfigError> {
        positive(fields[0], self.sigma)?;
        positive(fields[1], self.tau_s)?;
        if self.tau_s * real(3.0) > step_s {
            Ok(())
        } else {
            Err(ConfigError::new(fields[1], Problem::OutOfRange))
        }
    }
}

/// The single channel and what is believed of its noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterConfig<T> {
    /// Radius of the Earth R, m.
    pub radius_m: T,
    /// Gravity g, m/s².
    pub gravity: T,
    /// Step Δ, s.
    pub step_s: T,
    /// Accelerometer error a, m/s².
    pub accelerometer: MarkovNoise<T>,
    /// Gyro drift ω, rad/s.
    pub gyro: MarkovNoise<T>,
    /// 1-σ white noise r of the velocity measurement, m/s.
    pub velocity_noise: T,
    /// 1-σ of the velocity error at the start, m/s.
    pub initial_velocity_sigma: T,
    /// 1-σ of the error of the vertical at the start, rad.
    pub initial_vertical_sigma: T,
    /// An innovation beyond this many of its standard deviations is not used.
    pub gate_sigma: T,
}

impl<T: RealField + Copy> FilterConfig<T> {
    /// Whether the filter can be built from this.
    ///
    /// # Errors
    /// The first field that cannot be flown: everything must be finite and positive, and τ longer than a
    /// third of the step.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("filter.radius_m", self.radius_m)?;
        positive("filter.gravity", self.gravity)?;
        positive("filter.step_s", self.step_s)?;
        let accelerometer = ["filter.accelerometer.sigma", "filter.accelerometer.tau_s"];
        self.accelerometer.check(accelerometer, self.step_s)?;
        self.gyro.check(["filter.gyro.sigma", "filter.gyro.tau_s"], self.step_s)?;
        positive("filter.velocity_noise", self.velocity_noise)?;
        positive("filter.initial_velocity_sigma", self.initial_velocity_sigma)?;
        positive("filter.initial_vertical_sigma", self.initial_vertical_sigma)?;
        positive("filter.gate_sigma", self.gate_sigma)
    }

    /// The exact model over `step_s` seconds with the given noise.
    pub fn model(
        &self,
        accelerometer: &MarkovNoise<T>,
        gyro: &MarkovNoise<T>,
        step_s: T,
    ) -> DiscreteModel<T> {
        DiscreteModel::exact(self.radius_m, self.gravity, accelerometer, gyro, step_s)
    }

    /// What is believed before the first measurement: x₀ = 0, P₀ = diag(σ_V², σ_δ², σ_a², σ_w²).
    pub fn prior(&self) -> Gaussian<T> {
        let sigma = [
            self.initial_velocity_sigma,
            self.initial_vertical_sigma,
            self.accelerometer.sigma,
            self.gyro.sigma,
        ];
        Gaussian::independent([T::zero(); 4], sigma)
    }
}

/// What the filter says each step. Order of the states: ΔV (m/s), δ (rad), a (m/s²), ω (rad/s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FilterOutput<T> {
    /// Estimate x̂.
    pub estimate: [T; 4],
    /// Standard deviations √diag P.
    pub sigma: [T; 4],
    /// Innovation ν = z − H x̂⁻, m/s; zero when there was no measurement.
    pub innovation: T,
    /// Innovation variance S, (m/s)².
    pub innovation_variance: T,
    /// Normalised innovation squared ν²/S; zero when there was no measurement.
    pub nis: T,
}

/// What became of the measurement, and of the filter, in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterStep<T> {
    /// Innovation; its value is zero when there was no measurement.
    pub innovation: Innovation<T>,
    /// There was a measurement, but beyond the gate: it was not used.
    pub gated: bool,
    /// So many measurements in a row were beyond the gate that the filter must be wrong, not they: the velocity
    /// was taken from the measurement and everything else made ten times as uncertain.
    pub reacquired: bool,
    /// The covariance had lost its positive diagonal, or a number was not finite: the covariance was set back to
    /// the prior, and so was a mean that was not finite.
    pub reset: bool,
}

/// Measurements in a row beyond the gate after which the filter starts from the measurement.
pub const GATED_IN_A_ROW: u32 = 10;

/// Standard deviations are multiplied by this when the filter starts from the measurement.
const REACQUISITION: f64 = 10.0;

/// The farthest that a state may be from zero when the filter starts again, in standard deviations of its prior.
const FARTHEST: f64 = 100.0;

/// The error filter: over four states, or over six where a sensor's noise is exponential-cosine.
#[derive(Clone, Copy, Debug)]
pub struct ErrorFilter<T: RealField + Copy, K: Kernel<T> = Gaussian<T>> {
    model: K::Model,
    state: K,
    /// Where a reset goes back to.
    prior: K,
    farthest: Farthest<T>,
    measurement_variance: T,
    gate_squared: T,
    gated_in_a_row: u32,
}

impl<T: RealField + Copy> ErrorFilter<T> {
    /// Checks the configuration and builds the four-state filter.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn try_build(config: &FilterConfig<T>) -> Result<Self, ConfigError> {
        config.validate()?;
        let model = config.model(&config.accelerometer, &config.gyro, config.step_s);
        Ok(Self::with_model(config, model, config.prior()))
    }
}

impl<T: RealField + Copy, K: Kernel<T>> ErrorFilter<T, K> {
    /// A filter over a given model, starting from `prior`. The configuration must have been validated.
    pub fn with_model(config: &FilterConfig<T>, model: K::Model, prior: K) -> Self {
        Self {
            model,
            state: prior,
            prior,
            farthest: Farthest::of(&prior, real(FARTHEST)),
            measurement_variance: config.velocity_noise * config.velocity_noise,
            gate_squared: config.gate_sigma * config.gate_sigma,
            gated_in_a_row: 0,
        }
    }

    /// One step: predict, then correct by the measured velocity error (m/s) if there is one.
    ///
    /// Never panics; the work is the same with, without and with a gated measurement.
    #[inline]
    pub fn step(&mut self, velocity_error: Option<T>) -> FilterStep<T> {
        self.state.predict(&self.model);
        let velocity = velocity_error.unwrap_or(self.state.mean()[0]);
        let innovation = self.state.innovation(velocity, self.measurement_variance);
        let value = innovation.value;
        let inside = value * value <= self.gate_squared * innovation.variance;
        let present = velocity_error.is_some();
        self.state.correct(&innovation, present & inside);
        let gated = present & !inside;
        let in_a_row = self.gated_in_a_row.saturating_add(u32::from(gated));
        let reacquired = gated & (in_a_row >= GATED_IN_A_ROW) & are_finite([&velocity].into_iter());
        self.gated_in_a_row = select(reacquired | (present & inside), 0, in_a_row);

        // A fresh start is made in every step and taken in few, so that all steps are the same work. What is not sound
        // goes back to the prior.
        let reset = !self.state.is_sound();
        let (own, prior) = (self.state.mean()[0], self.prior.mean()[0]);
        let restart = Restart {
            condition: reacquired | reset,
            velocity: select(reacquired, velocity, select(are_finite([&own].into_iter()), own, prior)),
            velocity_variance: select(reset, self.prior.variances()[0], self.measurement_variance),
            factor: real(REACQUISITION * REACQUISITION),
            variance_of_prior: reset,
        };
        self.state.restart_if(&restart, &self.prior, &self.farthest);
        FilterStep { innovation, gated, reacquired, reset }
    }

    /// Variance of the measurement's noise, (m/s)², from the next step on.
    #[inline]
    pub fn set_measurement_variance(&mut self, variance: T) {
        self.measurement_variance = variance;
    }

    /// Goes on without measurement over the interval of `model`.
    pub fn coast(&mut self, model: &K::Model) {
        self.coast_if(true, model);
    }

    /// The same where `condition` holds; with the same work where it does not.
    pub fn coast_if(&mut self, condition: bool, model: &K::Model) {
        let mut after = self.state;
        after.predict(model);
        self.state = *select(condition, &after, &self.state);
    }

    /// Starts from a velocity error (m/s), with everything else as it is but ten times as uncertain.
    pub fn reacquire(&mut self, velocity_error: T) {
        let restart = Restart {
            condition: true,
            velocity: velocity_error,
            velocity_variance: self.measurement_variance,
            factor: real(REACQUISITION * REACQUISITION),
            variance_of_prior: false,
        };
        self.state.restart_if(&restart, &self.prior, &self.farthest);
    }

    /// Takes a new model and the prior that goes with it; the state stays.
    pub fn retune(&mut self, model: K::Model, prior: K) {
        self.model = model;
        self.prior = prior;
        self.farthest = Farthest::of(&prior, real(FARTHEST));
    }

    /// Takes a state that was computed elsewhere, such as by a replay with other noise parameters.
    pub fn set_state(&mut self, state: &K) {
        self.state = *state;
    }

    /// What carries the state over a step.
    #[inline]
    pub fn model(&self) -> &K::Model {
        &self.model
    }

    /// Mean and covariance.
    #[inline]
    pub fn state(&self) -> &K {
        &self.state
    }

    /// The step's figures in the form of the output.
    pub fn output(&self, step: &FilterStep<T>) -> FilterOutput<T> {
        FilterOutput {
            estimate: self.state.mean(),
            sigma: self.state.variances().map(ComplexField::sqrt),
            innovation: step.innovation.value,
            innovation_variance: step.innovation.variance,
            nis: step.innovation.nis(),
        }
    }
}

/// Finite and greater than zero.
pub(crate) fn positive<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    if !value.is_finite() {
        Err(ConfigError::new(field, Problem::NotFinite))
    } else if value > T::zero() {
        Ok(())
    } else {
        Err(ConfigError::new(field, Problem::NotPositive))
    }
}

saved!([T: Blank] MarkovNoise<T> { sigma, tau_s });
saved!([T: Blank] FilterConfig<T> {
    radius_m,
    gravity,
    step_s,
    accelerometer,
    gyro,
    velocity_noise,
    initial_velocity_sigma,
    initial_vertical_sigma,
    gate_sigma,
});
saved!([T: RealField + Copy + Blank, K: Kernel<T> + Blank] ErrorFilter<T, K> where [K::Model: Blank] {
    model,
    state,
    prior,
    farthest,
    measurement_variance,
    gate_squared,
    gated_in_a_row,
});
