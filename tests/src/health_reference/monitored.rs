//! The monitor under test, behind the same trait as the reference filters.
use nalgebra::{Matrix4, RealField, Vector4, convert, try_convert};
use schuler_core::health::{HealthConfig, HealthMonitor, HealthOutput};
use schuler_core::reading::Reading;

use super::model::{Filter, Gaussian, Model, Posterior};

/// The monitor, fed with the residual as radio reading against a true inertial zero.
#[derive(Clone, Copy, Debug)]
pub struct Monitored<T, const LEVELS: usize> {
    /// The monitor.
    pub monitor: HealthMonitor<T, LEVELS>,
    /// What it said last.
    pub output: HealthOutput<T, LEVELS>,
}

impl<T: RealField + Copy> Monitored<T, 2> {
    /// As it is delivered, for a Doppler radio.
    pub fn delivered() -> Self {
        Self::with(&HealthConfig::<T, 2>::doppler_against_inertial())
    }

    /// Two levels and exactly the model's drift.
    pub fn new(model: &Model) -> Self {
        Self::with(&model.config(&HealthConfig::<T, 2>::doppler_against_inertial()))
    }
}

impl<T: RealField + Copy> Monitored<T, 3> {
    /// Three levels and exactly the model's drift.
    pub fn three_levels(model: &Model) -> Self {
        Self::with(&model.config(&HealthConfig::<T, 3>::doppler_against_inertial_three_levels()))
    }
}

impl<T: RealField + Copy, const LEVELS: usize> Monitored<T, LEVELS> {
    /// A configuration of its own.
    ///
    /// # Panics
    /// If it is not valid.
    pub fn with(config: &HealthConfig<T, LEVELS>) -> Self {
        let monitor = HealthMonitor::try_build(config).expect("a valid configuration");
        Self { monitor, output: HealthOutput::default() }
    }

    /// One step with a residual or without, `elapsed` steps after the last.
    pub fn feed(&mut self, d: Option<f64>, elapsed: u32) -> &HealthOutput<T, LEVELS> {
        let radio = d.map_or_else(Reading::missing, |d| Reading::good(convert(d)));
        self.output = self.monitor.step(&radio, &Reading::good(T::zero()), elapsed);
        &self.output
    }
}

/// Any real scalar as f64.
///
/// # Panics
/// Never for f32 and f64.
pub fn number<T: RealField + Copy>(value: T) -> f64 {
    try_convert(value).expect("a real number")
}

impl<T: RealField + Copy, const LEVELS: usize> Filter for Monitored<T, LEVELS> {
    fn step(&mut self, d: Option<f64>) -> Posterior {
        let output = self.feed(d, 1);
        let estimates = [output.correlated_error, output.inertial_error, output.jump, output.inertial_drift];
        let mean = Vector4::from(estimates.map(|estimate| number(estimate.value)));
        let sigma = Vector4::from(estimates.map(|estimate| number(estimate.sigma)));
        Posterior {
            modes: output.mode_probability.as_flattened().iter().map(|&w| number(w)).collect(),
            state: Gaussian { mean, covariance: Matrix4::from_diagonal(&sigma.component_mul(&sigma)) },
        }
    }
}
