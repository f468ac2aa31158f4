//! The kept measurements once more, through a filter with other noise parameters.
//!
//! What the likelihood search, the read-out and the start of the narrow bank are made of. A replay is cut into
//! slices, so that each step of the flight module does the same bounded work.

use super::bank::ChannelNoise;
use super::window::{DECIMATION, MeasurementWindow};
use crate::filter::{DiscreteModel, FilterConfig, Gaussian};
use crate::number::CompensatedSum;

/// Spread of the velocity error about the first sample where a window does not begin at power-on, m/s.
const DIFFUSE_VELOCITY: f32 = 1.0;
/// Spread of the error of the vertical there, rad: half a degree.
const DIFFUSE_VERTICAL: f32 = 1e-2;

/// The stretch of samples that one identification looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Index of the first sample.
    pub begin: u32,
    /// Index after the last one.
    pub end: u32,
    /// Whether it begins where the filter began, with the configured prior.
    pub from_start: bool,
}

/// A replay under way.
#[derive(Clone, Copy, Debug)]
pub struct Replay {
    model: DiscreteModel<f32>,
    state: Gaussian<f32>,
    variance_of_one: f32,
    cursor: u32,
    end: u32,
    log_likelihood: CompensatedSum<f32>,
}

impl Replay {
    /// Nothing to replay.
    pub const fn idle() -> Self {
        Self {
            model: DiscreteModel {
                velocity: [1.0, 0.0, 0.0, 0.0],
                vertical: [0.0, 1.0, 0.0, 0.0],
                decay: [1.0; 2],
                noise: [0.0; 10],
            },
            state: Gaussian { mean: [0.0; 4], covariance: [1.0; 10] },
            variance_of_one: 1.0,
            cursor: 0,
            end: 0,
            log_likelihood: CompensatedSum::new(0.0),
        }
    }

    /// Begins a replay of `stretch` with the given noise.
    pub fn begin(
        &mut self,
        config: &FilterConfig<f32>,
        window: &MeasurementWindow,
        stretch: Stretch,
        noise: &ChannelNoise,
    ) {
        let sample_s = config.step_s * DECIMATION as f32;
        let tuned = FilterConfig { accelerometer: noise.accelerometer, gyro: noise.gyro, ..*config };
        self.model = config.model(&noise.accelerometer, &noise.gyro, sample_s);
        self.state = if stretch.from_start {
            tuned.prior()
        } else {
            let first = window.sample(stretch.begin).mean;
            let sigma = [DIFFUSE_VELOCITY, DIFFUSE_VERTICAL, noise.accelerometer.sigma, noise.gyro.sigma];
            Gaussian::independent([first, 0.0, 0.0, 0.0], sigma)
        };
        self.variance_of_one = config.velocity_noise * config.velocity_noise;
        self.cursor = stretch.begin;
        self.end = stretch.end;
        self.log_likelihood = CompensatedSum::new(0.0);
    }

    /// Replays up to `samples` more; `after_each` sees the index and the state after every one. True at the end.
    ///
    /// The work is that of `samples` samples, whether there are so many left or not.
    #[inline]
    pub fn advance(
        &mut self,
        window: &MeasurementWindow,
        samples: u32,
        mut after_each: impl FnMut(u32, &Gaussian<f32>),
    ) -> bool {
        for _ in 0..samples {
            if self.cursor < self.end {
                let sample = window.sample(self.cursor);
                self.state.predict(&self.model);
                let innovation = self.state.innovation(sample.mean, sample.variance(self.variance_of_one));
                let present = sample.is_present();
                self.state.correct(&innovation, present);
                self.log_likelihood.add(if present { innovation.log_likelihood() } else { 0.0 });
                after_each(self.cursor, &self.state);
                self.cursor += 1;
            }
        }
        self.cursor >= self.end
    }

    /// Log-likelihood −½ Σ (ln S + ν²/S) of what has been replayed; minus infinity where the filter broke down.
    pub fn log_likelihood(&self) -> f32 {
        let value = self.log_likelihood.value();
        if value.is_finite() && self.state.is_sound() { value } else { f32::NEG_INFINITY }
    }

    /// State after what has been replayed.
    pub fn state(&self) -> &Gaussian<f32> {
        &self.state
    }
}
