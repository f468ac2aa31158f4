//! Where the parameters may lie, and how likely they are before anything is measured.
use crate::filter::{FilterConfig, MarkovNoise};
use crate::identification::IdentificationConfig;
use crate::identification::bank::ChannelNoise;
use crate::identification::window::DECIMATION;

/// Longest correlation time that the search may reach, s.
pub(super) const LONGEST_TAU_S: f32 = 2e5;

/// Where the parameters may lie.
pub(super) struct Limits {
    centre: [MarkovNoise<f32>; 2],
    factor: f32,
    shortest_tau_s: f32,
}

impl Limits {
    pub(super) fn new(filter: &FilterConfig<f32>, config: &IdentificationConfig) -> Self {
        Self {
            centre: [filter.accelerometer, filter.gyro],
            factor: config.limit_factor,
            shortest_tau_s: 0.5 * DECIMATION as f32 * filter.step_s,
        }
    }

    pub(super) fn clip(&self, channel: usize, noise: MarkovNoise<f32>) -> MarkovNoise<f32> {
        let centre = &self.centre[channel & 1];
        let within = |value: f32, centre: f32| value.min(centre * self.factor).max(centre / self.factor);
        self.clip_tau(MarkovNoise {
            sigma: within(noise.sigma, centre.sigma),
            tau_s: within(noise.tau_s, centre.tau_s),
        })
    }

    pub(super) fn clip_tau(&self, noise: MarkovNoise<f32>) -> MarkovNoise<f32> {
        MarkovNoise { tau_s: noise.tau_s.min(LONGEST_TAU_S).max(self.shortest_tau_s), ..noise }
    }

    pub(super) fn clip_both(&self, noise: &ChannelNoise) -> ChannelNoise {
        ChannelNoise { accelerometer: self.clip(0, noise.accelerometer), gyro: self.clip(1, noise.gyro) }
    }
}

/// −½ Σ (ln θ_i/θ_i⁰)²/w² about the data sheet.
pub(super) fn prior(filter: &FilterConfig<f32>, config: &IdentificationConfig, noise: &ChannelNoise) -> f32 {
    let data_sheet = ChannelNoise { accelerometer: filter.accelerometer, gyro: filter.gyro };
    let away = noise.logarithms().into_iter().zip(data_sheet.logarithms());
    let square = away.fold(0.0, |sum, (x, x0)| sum + (x - x0) * (x - x0));
    -0.5 * square / (config.prior_width * config.prior_width)
}
