//! The noise as the flight module identified it.
use schuler_core::filter::MarkovNoise;
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
    /// How well it is known. `not_judged`: retuned by the published loop, which does not say how well.
    pub status: &'static str,
}

/// The noise in use beside that of the data sheet, `configured`.
pub(super) fn noise(estimate: &NoiseEstimate, configured: MarkovNoise<f32>) -> NoiseSummary {
    let noise = &estimate.noise;
    // A channel whose fit fails keeps its noise to the last bit.
    let is_retuned = noise.sigma.to_bits() != configured.sigma.to_bits();
    NoiseSummary {
        structure: if noise.beta > 0.0 { "exponential_cosine" } else { "exponential" },
        sigma: f64::from(noise.sigma),
        tau_s: 1.0 / f64::from(noise.alpha),
        beta: f64::from(noise.beta),
        status: match estimate.status {
            ChannelStatus::DataSheet if is_retuned => "not_judged",
            ChannelStatus::DataSheet => "data_sheet",
            ChannelStatus::Determined => "determined",
            ChannelStatus::Weak => "weak",
            ChannelStatus::Indeterminate => "indeterminate",
            ChannelStatus::Unobserved => "unobserved",
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schuler_core::filter::ColouredNoise;

    #[test]
    fn noise_that_was_retuned_is_not_called_that_of_the_data_sheet() {
        let configured = MarkovNoise { sigma: 1e-3_f32, tau_s: 60.0 };
        let status = |sigma, status| {
            let noise = ColouredNoise { sigma, alpha: 1.0 / 60.0, beta: 0.0 };
            super::noise(&NoiseEstimate { noise, status }, configured).status
        };
        assert_eq!(status(1e-3, ChannelStatus::DataSheet), "data_sheet");
        assert_eq!(status(2e-3, ChannelStatus::DataSheet), "not_judged");
        assert_eq!(status(2e-3, ChannelStatus::Determined), "determined");
    }
}
