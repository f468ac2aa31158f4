//! The noise as the flight module identified it.
use schuler_core::identification::{ChannelStatus, NoiseEstimate};
use serde::Serialize;

/// The identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentificationSummary {
    /// Accelerometer noise in use at the end, m/s².
    pub accelerometer: NoiseSummary,
    /// Gyro noise in use at the end, rad/s.
    pub gyro: NoiseSummary,
    /// Times of the retunings, s.
    pub retuned_at_s: Vec<f64>,
}

/// Noise in use.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NoiseSummary {
    /// `exponential` or `exponential_cosine`.
    pub structure: &'static str,
    /// Standard deviation, SI.
    pub sigma: f64,
    /// Correlation time 1/α, s.
    pub tau_s: f64,
    /// Angular frequency β, rad/s.
    pub beta: f64,
    /// How well it is known.
    pub status: &'static str,
}

pub(super) fn noise(estimate: &NoiseEstimate) -> NoiseSummary {
    let noise = &estimate.noise;
    NoiseSummary {
        structure: if noise.beta > 0.0 { "exponential_cosine" } else { "exponential" },
        sigma: f64::from(noise.sigma),
        tau_s: 1.0 / f64::from(noise.alpha),
        beta: f64::from(noise.beta),
        status: match estimate.status {
            ChannelStatus::DataSheet => "data_sheet",
            ChannelStatus::Determined => "determined",
            ChannelStatus::Weak => "weak",
            ChannelStatus::Indeterminate => "indeterminate",
            ChannelStatus::Unobserved => "unobserved",
        },
    }
}
