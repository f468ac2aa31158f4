//! Identification by the published loop: level A, for comparison.
//!
//! The estimates of the running filter go into a sliding-window autocorrelation; from time to time σ̂ = √R₀
//! [FIL-13] and τ̂ [FIL-15] are read off and the filter is retuned. It does not converge: the estimate's variance
//! is short by the filter's own, so that every retuning makes the filter more certain and the next estimate
//! smaller, until the error has vanished from the model. That is why level B exists.

use super::autocorrelation::SlidingAutocorrelation;
use super::bank::ChannelNoise;
use super::structure::{EXPONENTIAL_FLOOR, fit_exponential};
use super::window::DECIMATION;
use super::{IdentificationConfig, steps_in};
use crate::filter::{FilterConfig, Gaussian, MarkovNoise};
use crate::number::select;
use crate::saved::saved;

/// Estimates in the window, one in ten steps: 2.8 h.
const WINDOW: usize = 1024;
/// Lags of the autocorrelation, the zeroth included.
const LAGS: usize = 181;

/// The published loop's state.
#[derive(Clone, Copy, Debug)]
pub struct PublishedLoop {
    accelerometer: SlidingAutocorrelation<f32, WINDOW, LAGS>,
    gyro: SlidingAutocorrelation<f32, WINDOW, LAGS>,
    steps: u64,
    due: u64,
}

impl PublishedLoop {
    /// A loop that has not been started.
    pub const fn new() -> Self {
        Self {
            accelerometer: SlidingAutocorrelation::new(0.0),
            gyro: SlidingAutocorrelation::new(0.0),
            steps: 0,
            due: 0,
        }
    }

    /// Starts anew.
    pub fn start(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        self.accelerometer.clear();
        self.gyro.clear();
        self.steps = 0;
        self.due = steps_in(config.first_s, filter.step_s);
    }

    /// One step: takes the filter's estimate, and says with what the filter is to be retuned when it is time.
    /// A channel that cannot be fitted keeps its `in_use` parameters.
    pub fn step(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        in_use: &ChannelNoise,
        estimate: &Gaussian<f32>,
    ) -> Option<ChannelNoise> {
        self.steps = self.steps.saturating_add(1);
        let taken = self.steps.is_multiple_of(u64::from(DECIMATION));
        self.accelerometer.push_if(taken, Some(estimate.mean[2]));
        self.gyro.push_if(taken, Some(estimate.mean[3]));
        let spacing_s = filter.step_s * DECIMATION as f32;
        let read = |sliding: &SlidingAutocorrelation<f32, WINDOW, LAGS>, old: &MarkovNoise<f32>| {
            fit_exponential(&sliding.autocorrelation(), spacing_s, EXPONENTIAL_FLOOR as f32)
                .map(|fit| MarkovNoise { sigma: libm::sqrtf(fit.variance), tau_s: 1.0 / fit.alpha })
                .filter(|noise| noise.tau_s * 3.0 > filter.step_s)
                .unwrap_or(*old)
        };
        // Read off in every step, so that the step in which it is time takes no more work than the others.
        let noise = ChannelNoise {
            accelerometer: read(&self.accelerometer, &in_use.accelerometer),
            gyro: read(&self.gyro, &in_use.gyro),
        };
        let is_due = self.steps >= self.due;
        let next = self.steps.saturating_add(steps_in(config.interval_s, filter.step_s));
        self.due = select(is_due, next, self.due);
        is_due.then_some(noise)
    }
}

impl Default for PublishedLoop {
    fn default() -> Self {
        Self::new()
    }
}

saved!([] PublishedLoop { accelerometer, gyro, steps, due });
