//! The kept measurements once more, through a filter with other noise parameters.
//!
//! What the likelihood search, the read-out and the start of the narrow bank are made of. A replay is cut into
//! slices, so that each step of the flight module does the same bounded work.

use super::bank::ChannelNoise;
use super::read_out::ReadOut;
use super::window::{DECIMATION, MeasurementWindow};
use crate::filter::{
    ColouredGaussian, ColouredModel, ColouredNoise, DiscreteModel, FilterConfig, Gaussian, Kernel,
};
use crate::number::{CompensatedSum, select};
use crate::saved::{Blank, saved};

/// Spread of the velocity error about the first sample where a window does not begin at power-on,
/// m/s, and of the error of the vertical there, rad: half a degree.
pub(super) const DIFFUSE: [f32; 2] = [1.0, 1e-2];

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

/// What the two channels' noise is taken to be, with the filter that goes with it.
pub trait Hypothesis: Sized {
    /// The filter's kernel.
    type Kernel: Kernel<f32>;

    /// Its model over `step_s` seconds.
    fn model(&self, config: &FilterConfig<f32>, step_s: f32) -> ModelOf<Self>;

    /// The state with ΔV and δ as given (m/s, rad) and the sensors' errors stationary.
    fn stationary(&self, mean: [f32; 2], sigma: [f32; 2]) -> Self::Kernel;

    /// What is believed before the first measurement.
    fn prior(&self, config: &FilterConfig<f32>) -> Self::Kernel {
        self.stationary([0.0; 2], [config.initial_velocity_sigma, config.initial_vertical_sigma])
    }
}

impl Hypothesis for ChannelNoise {
    type Kernel = Gaussian<f32>;

    fn model(&self, config: &FilterConfig<f32>, step_s: f32) -> DiscreteModel<f32> {
        config.model(&self.accelerometer, &self.gyro, step_s)
    }

    fn stationary(&self, [velocity, vertical]: [f32; 2], sigma: [f32; 2]) -> Gaussian<f32> {
        let sigma = [sigma[0], sigma[1], self.accelerometer.sigma, self.gyro.sigma];
        Gaussian::independent([velocity, vertical, 0.0, 0.0], sigma)
    }
}

/// Exponential-cosine noise of both channels; β = 0 where a channel is of first order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredChannels {
    /// Accelerometer error, m/s².
    pub accelerometer: ColouredNoise<f32>,
    /// Gyro drift, rad/s.
    pub gyro: ColouredNoise<f32>,
}

impl From<&ChannelNoise> for ColouredChannels {
    fn from(noise: &ChannelNoise) -> Self {
        Self {
            accelerometer: ColouredNoise::from(&noise.accelerometer),
            gyro: ColouredNoise::from(&noise.gyro),
        }
    }
}

impl Hypothesis for ColouredChannels {
    type Kernel = ColouredGaussian<f32>;

    fn model(&self, config: &FilterConfig<f32>, step_s: f32) -> ColouredModel<f32> {
        ColouredModel::exact(config, &self.accelerometer, &self.gyro, step_s)
    }

    fn stationary(&self, mean: [f32; 2], sigma: [f32; 2]) -> ColouredGaussian<f32> {
        ColouredGaussian::stationary(mean, sigma, &self.accelerometer, &self.gyro)
    }
}

/// The model of a hypothesis.
type ModelOf<H> = <<H as Hypothesis>::Kernel as Kernel<f32>>::Model;

/// A replay under way.
#[derive(Clone, Copy, Debug)]
pub struct Replay<H: Hypothesis> {
    /// The hypothesis' model and state; none before the first replay.
    filter: Option<(ModelOf<H>, H::Kernel)>,
    variance_of_one: f32,
    cursor: u32,
    end: u32,
    log_likelihood: CompensatedSum<f32>,
}

impl<H: Hypothesis> Replay<H> {
    /// Nothing to replay.
    pub const fn idle() -> Self {
        Self {
            filter: None,
            variance_of_one: 0.0,
            cursor: 0,
            end: 0,
            log_likelihood: CompensatedSum::new(0.0),
        }
    }

    /// Begins a replay of `stretch` under a hypothesis.
    pub fn begin(
        &mut self,
        config: &FilterConfig<f32>,
        window: &MeasurementWindow,
        stretch: Stretch,
        hypothesis: &H,
    ) {
        let state = if stretch.from_start {
            hypothesis.prior(config)
        } else {
            let first = window.sample(stretch.begin).mean;
            hypothesis.stationary([first, 0.0], DIFFUSE)
        };
        self.filter = Some((hypothesis.model(config, config.step_s * DECIMATION as f32), state));
        self.variance_of_one = config.velocity_noise * config.velocity_noise;
        self.cursor = stretch.begin;
        self.end = stretch.end;
        self.log_likelihood = CompensatedSum::new(0.0);
    }

    /// Moves the end on, as samples have arrived since.
    pub fn extend_to(&mut self, end: u32) {
        self.end = end;
    }

    /// Replays up to `samples` more, of which a read-out takes the states. True at the end.
    ///
    /// The work is that of `samples` samples, however few are left: past the end nothing that is computed counts. It is one
    /// function for every phase of an identification, so that a sample takes the same work in each, and the image holds it once.
    #[inline(never)]
    pub fn advance(
        &mut self,
        window: &MeasurementWindow,
        samples: u32,
        mut read_out: Option<&mut ReadOut>,
    ) -> bool {
        let Some((model, state)) = &mut self.filter else { return false };
        // What is computed past the end goes here: to copy a state back would take longer than not to.
        let mut in_vain = *state;
        for _ in 0..samples {
            let counts = self.cursor < self.end;
            let sample = window.sample(self.cursor);
            let state = select(counts, &mut *state, &mut in_vain);
            state.predict(model);
            let innovation = state.innovation(sample.mean, sample.variance(self.variance_of_one));
            let innovation = state.after_jump_if(sample.jumped, innovation);
            let present = sample.is_present();
            state.correct(&innovation, present);
            let gained = innovation.log_likelihood();
            self.log_likelihood.add(select(counts & present, gained, 0.0));
            if let Some(read_out) = &mut read_out {
                read_out.take(self.cursor, state, counts);
            }
            self.cursor += u32::from(counts);
        }
        self.cursor >= self.end
    }

    /// Log-likelihood −½ Σ (ln S + ν²/S) of what has been replayed; minus infinity where the filter broke down.
    pub fn log_likelihood(&self) -> f32 {
        let value = self.log_likelihood.value();
        let sound = self.filter.as_ref().is_some_and(|(_, state)| state.is_sound());
        if value.is_finite() && sound { value } else { f32::NEG_INFINITY }
    }

    /// State after what has been replayed; it holds for the middle of the last sample's interval.
    pub fn state(&self) -> Option<&H::Kernel> {
        self.filter.as_ref().map(|(_, state)| state)
    }
}

saved!([] Stretch { begin, end, from_start });
saved!([] ColouredChannels { accelerometer, gyro });
saved!([H: Hypothesis] Replay<H> where [ModelOf<H>: Blank, H::Kernel: Blank] {
    filter,
    variance_of_one,
    cursor,
    end,
    log_likelihood,
});
