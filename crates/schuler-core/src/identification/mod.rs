//! Identification of the noise of each sensor.
use serde::{Deserialize, Serialize};

mod autocorrelation;
mod structure;

pub use autocorrelation::SlidingAutocorrelation;
pub use structure::{
    Comparison, EXPONENTIAL_FLOOR, Exponential, ExponentialCosine, Structure, choose_structure, compare,
    fit_exponential, fit_exponential_cosine, removed_mean_bias,
};

/// The noise structure and parameters found for one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NoiseEstimate {
    /// Standard deviation σ, in the sensor's unit.
    pub sigma: f32,
    /// Rate α of the exponential, 1/s (1/τ for the first-order process).
    pub alpha: f32,
    /// Angular frequency β of the cosine, rad/s; zero for the first-order process.
    pub beta: f32,
}

/// What the identifier says each step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IdentificationOutput {
    /// Accelerometer noise in use, m/s².
    pub accelerometer: NoiseEstimate,
    /// Gyro noise in use, rad/s.
    pub gyro: NoiseEstimate,
    /// How often the filter has been retuned.
    pub retunes: u16,
}

/// How the identifier works.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IdentificationConfig {
    /// Placeholder.
    pub enabled: bool,
}
