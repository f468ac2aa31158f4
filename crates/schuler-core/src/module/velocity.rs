//! The velocity channel: the error filter, the identification of the noise that it flies with, and what is known of the
//! sensor errors in the Schuler loop.
use super::config::StepConfig;
use super::output::Status;
use super::time::Passage;
use crate::compensation::LoopResponse;
use crate::config::ConfigError;
use crate::filter::{ColouredGaussian, ErrorFilter, FilterConfig, FilterOutput, Kernel};
use crate::identification::{
    AveragedEstimate, ChannelNoise, ChannelStatus, ColouredChannels, EstimateSource, Hypothesis,
    IdentificationConfig, IdentificationOutput, LikelihoodIdentifier, Method, NoiseEstimate, PublishedLoop,
    Retuned,
};
use crate::reading::{Quality, Reading};
use crate::saved::{Saved, Visitor, saved};

/// The identifier that the configuration asks for. Large: it stays where it is built.
///
/// The tag stands by itself and the first variant, idle, is all zeros: a module that waits costs no flash.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
#[expect(clippy::large_enum_variant, reason = "there is exactly one, and it is never moved")]
pub(super) enum Identifier {
    Likelihood(LikelihoodIdentifier),
    Published(PublishedLoop),
    Off,
}

impl Identifier {
    /// Before the configuration.
    pub(super) const IDLE: Self = Self::Likelihood(LikelihoodIdentifier::new());

    /// Starts anew, in place.
    pub(super) fn start(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        // Zeros written where they are to be. Any other value would be made on the stack first, for which it is too large,
        // unless nothing of it is left by the start.
        self.become_of(config.method);
        match self {
            Self::Off => (),
            Self::Published(published) => published.start(filter, config),
            Self::Likelihood(likelihood) => likelihood.start(filter, config),
        }
    }

    /// One of this method, with what is left of before if it was one already.
    fn become_of(&mut self, method: Method) {
        match (method, &*self) {
            (Method::Off, _) => *self = Self::Off,
            (Method::Published, Self::Published(_)) | (Method::Likelihood, Self::Likelihood(_)) => (),
            (Method::Published, _) => *self = Self::Published(PublishedLoop::new()),
            (Method::Likelihood, _) => *self = Self::IDLE,
        }
    }

    fn method(&self) -> Method {
        match self {
            Self::Off => Method::Off,
            Self::Published(_) => Method::Published,
            Self::Likelihood(_) => Method::Likelihood,
        }
    }

    /// Starts the likelihood identifier anew, whose window must not reach over a jump of the clock.
    fn restart(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, velocity: f32) {
        if let Self::Likelihood(likelihood) = self {
            likelihood.restart(filter, config, velocity);
        }
    }

    fn break_off_if(&mut self, condition: bool) {
        if let Self::Likelihood(likelihood) = self {
            likelihood.break_off_if(condition);
        }
    }

    fn skip(&mut self, steps: u32) {
        if let Self::Likelihood(likelihood) = self {
            likelihood.skip(steps);
        }
    }
}

/// What is measured in a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measurement {
    /// Velocity error, m/s, less the known error of its measurement.
    pub(super) velocity: Option<f32>,
    /// What it counts for; one where nothing speaks against it.
    pub(super) weight: f32,
}

/// The filter and the noise that it flies with.
#[derive(Clone, Copy, Debug)]
pub(super) struct VelocityChannel {
    filter: ErrorFilter<f32>,
    /// Noise that the filter flies with.
    in_use: ChannelNoise,
    retunes: u16,
    /// The filter that is listened to where an exponential-cosine was accepted.
    coloured: Option<(ErrorFilter<f32, ColouredGaussian<f32>>, ColouredChannels)>,
    /// What the known errors make of the loop; the filter sees what is left.
    response: LoopResponse,
}

impl VelocityChannel {
    /// Checks the configuration and builds the filter.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub(super) fn try_build(config: &FilterConfig<f32>) -> Result<Self, ConfigError> {
        Ok(Self {
            filter: ErrorFilter::try_build(config)?,
            in_use: ChannelNoise { accelerometer: config.accelerometer, gyro: config.gyro },
            retunes: 0,
            coloured: None,
            response: LoopResponse::default(),
        })
    }

    /// One step. `loop_errors`: known errors of accelerometer, m/s², and gyro, rad/s, in the loop.
    #[inline(never)]
    pub(super) fn step(
        &mut self,
        identifier: &mut Identifier,
        config: &StepConfig,
        passage: Passage,
        measurement: Measurement,
        loop_errors: [f32; 2],
        status: &mut Status,
    ) -> (FilterOutput<f32>, IdentificationOutput) {
        let duration_s = f64::from(passage.moved()) * f64::from(config.filter.step_s);
        self.response.pass(loop_errors, config.filter.radius_m, config.filter.gravity, duration_s);
        let Measurement { velocity: measured, weight } = measurement;
        let measured = measured.map(|velocity| velocity - self.response.velocity());
        self.pass(identifier, config, passage, measured);
        let measured = measured.filter(|_| passage != Passage::Backwards);

        // Filter.
        let variance = config.filter.velocity_noise * config.filter.velocity_noise / weight;
        self.filter.set_measurement_variance(variance);
        let mut step = self.filter.step(measured);
        let mut filter = self.filter.output(&step);
        if let Some((coloured, _)) = &mut self.coloured {
            coloured.set_measurement_variance(variance);
            step = coloured.step(measured);
            filter = coloured.output(&step);
        }
        identifier.break_off_if(step.reacquired);
        status.set(Status::INNOVATION_GATED, step.gated);
        status.set(Status::VELOCITY_REACQUIRED, step.reacquired);
        status.set(Status::COVARIANCE_RESET, step.reset);

        // Identification.
        let usable = measured.filter(|_| !step.gated);
        let (averaged, known) = self.identify(identifier, config, usable, status);
        let in_use = self
            .coloured
            .as_ref()
            .map_or_else(|| ColouredChannels::from(&self.in_use), |(_, coloured)| *coloured);
        let own = AveragedEstimate {
            estimate: filter.estimate,
            sigma: filter.sigma,
            source: EstimateSource::Filter,
        };
        let mut averaged = averaged.filter(AveragedEstimate::is_sound).unwrap_or(own);

        // What is known belongs to the error as a whole.
        for estimate in [&mut filter.estimate, &mut averaged.estimate] {
            for (state, known) in estimate.iter_mut().zip(self.response.states()) {
                *state += known;
            }
        }
        let identification = IdentificationOutput {
            averaged,
            accelerometer: NoiseEstimate { noise: in_use.accelerometer, status: known[0] },
            gyro: NoiseEstimate { noise: in_use.gyro, status: known[1] },
            retunes: self.retunes,
        };
        (filter, identification)
    }

    /// Moves over what has passed before the step.
    fn pass(
        &mut self,
        identifier: &mut Identifier,
        config: &StepConfig,
        passage: Passage,
        measured: Option<f32>,
    ) {
        // Missing steps are coasted over; the work is done where none is missing, too.
        let missing = if let Passage::Missing(steps) = passage { steps } else { 0 };
        let duration_s = missing.max(1) as f32 * config.filter.step_s;
        self.filter.coast_if(missing > 0, &self.in_use.model(&config.filter, duration_s));
        if let Some((coloured, noise)) = &mut self.coloured {
            coloured.coast_if(missing > 0, &noise.model(&config.filter, duration_s));
        }
        identifier.skip(missing);
        if passage == Passage::Jump {
            // How long it really was is unknown: the velocity starts from the measurement.
            let velocity = measured.unwrap_or(self.filter.state().mean()[0]);
            self.filter.reacquire(velocity);
            self.coloured = None;
            identifier.restart(&config.filter, &config.identification, velocity);
        }
    }

    /// The estimate averaged over what is not known of the noise, if there is one, and how well the noise is known.
    fn identify(
        &mut self,
        identifier: &mut Identifier,
        config: &StepConfig,
        usable: Option<f32>,
        status: &mut Status,
    ) -> (Option<AveragedEstimate>, [ChannelStatus; 2]) {
        let (filter, identification) = (&config.filter, &config.identification);
        let state = *self.filter.state();
        match identifier {
            Identifier::Off => (None, [ChannelStatus::DataSheet; 2]),
            Identifier::Published(published) => {
                if let Some(noise) = published.step(filter, identification, &self.in_use, &state) {
                    self.retune(filter, &noise);
                    *status |= Status::RETUNED;
                }
                (None, [ChannelStatus::DataSheet; 2])
            }
            Identifier::Likelihood(likelihood) => {
                let retuned = likelihood.step(filter, identification, usable, &state);
                if let Some(Retuned { noise, state, coloured }) = retuned {
                    self.retune(filter, &noise);
                    self.filter.set_state(&state);
                    self.coloured = coloured.map(|(noise, state)| {
                        let (model, prior) = (noise.model(filter, filter.step_s), noise.prior(filter));
                        let mut filter = ErrorFilter::with_model(filter, model, prior);
                        filter.set_state(&state);
                        (filter, noise)
                    });
                    *status |= Status::RETUNED;
                }
                let averaged = likelihood.averaged(filter, self.filter.state());
                (averaged.filter(|_| self.coloured.is_none()), likelihood.status())
            }
        }
    }

    fn retune(&mut self, config: &FilterConfig<f32>, noise: &ChannelNoise) {
        self.filter.retune(noise.model(config, config.step_s), noise.prior(config));
        self.in_use = *noise;
        self.retunes = self.retunes.saturating_add(1);
    }
}

/// The velocity error if it can be used, and in the status why not.
pub(super) fn usable(reading: &Reading<f32>, config: &StepConfig, status: &mut Status) -> Option<f32> {
    let finite = reading.value.is_finite();
    let problem = match reading.quality {
        Quality::Missing => Status::VELOCITY_MISSING,
        Quality::Good if !finite => Status::VELOCITY_MISSING,
        Quality::Saturated => Status::VELOCITY_SATURATED,
        Quality::Good if reading.value.abs() > config.velocity_range => Status::VELOCITY_SATURATED,
        Quality::Good if reading.age_ms > config.max_age_ms => Status::VELOCITY_STALE,
        Quality::Good => return Some(reading.value),
    };
    *status |= problem;
    None
}

saved!([] VelocityChannel { filter, in_use, retunes, coloured, response });

impl Saved for Identifier {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        let mut method = self.method();
        method.visit(visitor);
        self.become_of(method);
        match self {
            Self::Off => {}
            Self::Published(published) => published.visit(visitor),
            Self::Likelihood(likelihood) => likelihood.visit(visitor),
        }
    }
}
