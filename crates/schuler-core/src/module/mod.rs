//! The one fixed step that strings everything together: one plain struct in, one plain struct out.
//!
//! ```
//! use schuler_core::module::{FlightModule, ModuleConfig, StepInput};
//! use schuler_core::reading::Reading;
//!
//! // The state is large: keep it in a static on the target, in a box on the host.
//! let mut module = Box::new(FlightModule::new());
//! module.configure(&ModuleConfig::default())?;
//! let output = module.step(&StepInput {
//!     time_ms: 1000,
//!     velocity_error: Reading::good(0.12),
//!     gyros: [Reading::missing(); 5],
//!     ..StepInput::default()
//! });
//! assert!(output.filter.nis < 9.0);
//! # Ok::<(), schuler_core::config::ConfigError>(())
//! ```
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use crate::config::ConfigError;
use crate::filter::{
    ColouredGaussian, ErrorFilter, FilterConfig, FilterOutput, Kernel, MarkovNoise, positive,
};
use crate::identification::{
    AveragedEstimate, ChannelNoise, ChannelStatus, ColouredChannels, Hypothesis, IdentificationConfig,
    IdentificationOutput, LikelihoodIdentifier, Method, NoiseEstimate, PublishedLoop, Retuned,
};
use crate::isolation::{FaultIsolation, IsolationConfig, IsolationOutput};
use crate::reading::{Quality, Reading};

/// Number of gyros in the block.
pub const GYROS: usize = 5;

/// What the navigation computer hands over once a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepInput {
    /// Time of the step since power-on, milliseconds.
    pub time_ms: u64,
    /// Inertial velocity minus reference velocity in the channel, m/s.
    pub velocity_error: Reading<f32>,
    /// Rates of the gyros along their input axes, rad/s.
    pub gyros: [Reading<f64>; GYROS],
    /// A command from the ground.
    pub command: Command,
}

impl StepInput {
    /// The input of a step for which nothing came.
    pub fn without_readings(time_ms: u64) -> Self {
        Self { time_ms, ..Self::default() }
    }
}

/// A command from the ground, carried out in the step that brings it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Nothing.
    #[default]
    None,
    /// Take a gyro that was declared faulty back into the block.
    ReadmitGyro(u8),
}

/// What the module gives back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepOutput {
    /// Steps since configuration, this one included.
    pub step: u64,
    /// Time of the step, as it came in.
    pub time_ms: u64,
    /// What was out of the ordinary.
    pub status: Status,
    /// Error filter with the noise parameters in use.
    pub filter: FilterOutput<f32>,
    /// Noise identification.
    pub identification: IdentificationOutput,
    /// Gyro block.
    pub isolation: IsolationOutput,
}

bitflags! {
    /// What was out of the ordinary in a step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Status: u32 {
        /// No usable velocity measurement: missing or not a number.
        const VELOCITY_MISSING = 1;
        /// The velocity measurement was at the end of its range and was not used.
        const VELOCITY_SATURATED = 1 << 1;
        /// The velocity measurement was too old and was not used.
        const VELOCITY_STALE = 1 << 2;
        /// The innovation was beyond the gate and was not used.
        const INNOVATION_GATED = 1 << 3;
        /// The covariance lost its positive diagonal and was reset.
        const COVARIANCE_RESET = 1 << 4;
        /// The time of the step ran backwards or repeated; the step was taken as one nominal step without measurement.
        const CLOCK_BACKWARDS = 1 << 5;
        /// Steps were missing before this one; the filter has coasted over them.
        const STEPS_MISSING = 1 << 6;
        /// More steps were missing than can be bridged, or the clock has jumped: the velocity started from the
        /// measurement and the identification anew.
        const CLOCK_JUMPED = 1 << 7;
        /// So many innovations in a row were beyond the gate that the filter started from the measurement.
        const VELOCITY_REACQUIRED = 1 << 8;
        /// The filter was retuned after this step's measurement.
        const RETUNED = 1 << 9;
        /// The module has no configuration; nothing was computed.
        const NOT_CONFIGURED = 1 << 10;
    }
}

/// Everything that the module can be told before the flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModuleConfig {
    /// Error filter.
    pub filter: FilterConfig<f32>,
    /// Noise identification.
    pub identification: IdentificationConfig,
    /// Gyro block.
    pub isolation: IsolationConfig,
    /// Readings older than this are not used, milliseconds.
    pub max_age_ms: u32,
    /// Velocity errors beyond this are saturated or nonsense and are not used, m/s.
    pub velocity_range: f32,
}

impl Default for ModuleConfig {
    fn default() -> Self {
        Self {
            filter: FilterConfig {
                radius_m: 6_371_000.0,
                gravity: 9.80665,
                step_s: 1.0,
                accelerometer: MarkovNoise { sigma: 9.80665e-4, tau_s: 60.0 },
                gyro: MarkovNoise { sigma: 4.84814e-7, tau_s: 1800.0 },
                velocity_noise: 0.1,
                initial_velocity_sigma: 0.1,
                initial_vertical_sigma: 1e-4,
                gate_sigma: 6.0,
            },
            identification: IdentificationConfig::default(),
            isolation: IsolationConfig::CONE,
            max_age_ms: 1500,
            velocity_range: 1000.0,
        }
    }
}

/// Longest gap that the filter coasts over, in steps. After a longer one the time that has passed is not trusted.
const LONGEST_GAP: u64 = 600;

/// The flight module's whole state: about 65 kB. Keep it in a static and configure it there.
#[derive(Clone, Copy, Debug)]
pub struct FlightModule {
    stage: Stage,
    likelihood: LikelihoodIdentifier,
    published: PublishedLoop,
}

/// Before and after the configuration.
///
/// The tag stands by itself, so that a module that waits is all zeros and a static one costs no flash.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
#[expect(clippy::large_enum_variant, reason = "there is exactly one, and it is never moved")]
enum Stage {
    Waiting,
    Running(Running),
}

/// What exists only once there is a configuration.
#[derive(Clone, Copy, Debug)]
struct Running {
    config: ModuleConfig,
    filter: ErrorFilter<f32>,
    /// Noise that the filter flies with.
    in_use: ChannelNoise,
    retunes: u16,
    /// The filter that is listened to where an exponential-cosine was accepted.
    coloured: Option<(ErrorFilter<f32, ColouredGaussian<f32>>, ColouredChannels)>,
    isolation: FaultIsolation,
    steps: u64,
    last_ms: Option<u64>,
}

impl Running {
    fn retune(&mut self, noise: &ChannelNoise) {
        let config = &self.config.filter;
        self.filter.retune(noise.model(config, config.step_s), noise.prior(config));
        self.in_use = *noise;
        self.retunes = self.retunes.saturating_add(1);
    }
}

impl ModuleConfig {
    /// Whether a module can be built from this.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.filter.validate()?;
        self.identification.validate()?;
        positive("velocity_range", self.velocity_range)
    }
}

impl FlightModule {
    /// A module that waits for its configuration; until then every step answers [`Status::NOT_CONFIGURED`].
    pub const fn new() -> Self {
        Self {
            stage: Stage::Waiting,
            likelihood: LikelihoodIdentifier::new(),
            published: PublishedLoop::new(),
        }
    }

    /// Checks the configuration and starts the module anew from it, in place. On an error the module goes on as
    /// it was.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn configure(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        config.validate()?;
        self.stage = Stage::Running(Running {
            config: *config,
            filter: ErrorFilter::try_build(&config.filter)?,
            in_use: ChannelNoise { accelerometer: config.filter.accelerometer, gyro: config.filter.gyro },
            retunes: 0,
            coloured: None,
            isolation: FaultIsolation::try_build(&config.isolation)?,
            steps: 0,
            last_ms: None,
        });
        self.likelihood.start(&config.filter, &config.identification);
        self.published.start(&config.filter, &config.identification);
        Ok(())
    }

    /// One step. Never panics; whatever the input, the state stays usable.
    pub fn step(&mut self, input: &StepInput) -> StepOutput {
        let Stage::Running(running) = &mut self.stage else {
            return StepOutput {
                time_ms: input.time_ms,
                status: Status::NOT_CONFIGURED,
                ..StepOutput::default()
            };
        };
        running.steps += 1;
        let config = running.config;
        let mut status = Status::empty();

        // Time.
        let passage = passage(running.last_ms, input.time_ms, config.filter.step_s);
        running.last_ms = Some(input.time_ms);
        let mut measured = velocity(&input.velocity_error, &config, &mut status);
        match passage {
            Passage::OneStep => {}
            Passage::Missing(steps) => {
                status |= Status::STEPS_MISSING;
                let duration_s = steps as f32 * config.filter.step_s;
                let noise = &running.in_use;
                running.filter.coast(&noise.model(&config.filter, duration_s));
                if let Some((coloured, noise)) = &mut running.coloured {
                    coloured.coast(&noise.model(&config.filter, duration_s));
                }
                self.likelihood.skip(steps);
            }
            Passage::Backwards => {
                status |= Status::CLOCK_BACKWARDS;
                measured = None;
            }
            Passage::Jump => {
                // How long it really was is unknown: the velocity starts from the measurement.
                status |= Status::CLOCK_JUMPED;
                let velocity = measured.unwrap_or(running.filter.state().mean()[0]);
                running.filter.reacquire(velocity);
                running.coloured = None;
                self.likelihood.start(&config.filter, &config.identification);
            }
        }

        // Filter.
        let mut step = running.filter.step(measured);
        let mut filter = running.filter.output(&step);
        if let Some((coloured, _)) = &mut running.coloured {
            step = coloured.step(measured);
            filter = coloured.output(&step);
        }
        status.set(Status::INNOVATION_GATED, step.gated);
        status.set(Status::VELOCITY_REACQUIRED, step.reacquired);
        status.set(Status::COVARIANCE_RESET, step.reset);

        // Identification.
        let usable = measured.filter(|_| !step.gated);
        let state = *running.filter.state();
        let (mut averaged, mut known) = (None, [ChannelStatus::DataSheet; 2]);
        match config.identification.method {
            Method::Off => {}
            Method::Published => {
                let found =
                    self.published.step(&config.filter, &config.identification, &running.in_use, &state);
                if let Some(noise) = found {
                    running.retune(&noise);
                    status |= Status::RETUNED;
                }
            }
            Method::Likelihood => {
                let retuned = self.likelihood.step(&config.filter, &config.identification, usable, &state);
                if let Some(Retuned { noise, state, coloured }) = retuned {
                    running.retune(&noise);
                    running.filter.set_state(&state);
                    running.coloured = coloured.map(|(noise, state)| {
                        let (model, prior) =
                            (noise.model(&config.filter, config.filter.step_s), noise.prior(&config.filter));
                        let mut filter = ErrorFilter::with_model(&config.filter, model, prior);
                        filter.set_state(&state);
                        (filter, noise)
                    });
                    status |= Status::RETUNED;
                }
                if running.coloured.is_none() {
                    averaged = Some(self.likelihood.averaged(&config.filter, running.filter.state()));
                }
                known = self.likelihood.status();
            }
        }
        let in_use = running
            .coloured
            .as_ref()
            .map_or_else(|| ColouredChannels::from(&running.in_use), |(_, coloured)| *coloured);
        let identification = IdentificationOutput {
            averaged: averaged.unwrap_or(AveragedEstimate { estimate: filter.estimate, sigma: filter.sigma }),
            accelerometer: NoiseEstimate { noise: in_use.accelerometer, status: known[0] },
            gyro: NoiseEstimate { noise: in_use.gyro, status: known[1] },
            retunes: running.retunes,
        };

        // Gyro block.
        let readmit = match input.command {
            Command::None => None,
            Command::ReadmitGyro(gyro) => Some(gyro),
        };
        let max_age_ms = config.max_age_ms;
        let gyros = input.gyros.map(|reading| reading.not_older_than(max_age_ms));
        let isolation = running.isolation.step(&gyros, readmit);

        StepOutput { step: running.steps, time_ms: input.time_ms, status, filter, identification, isolation }
    }
}

impl Default for FlightModule {
    fn default() -> Self {
        Self::new()
    }
}

/// What the time stamps say has happened since the last step.
enum Passage {
    OneStep,
    /// So many steps are missing in between.
    Missing(u32),
    Backwards,
    /// More than can be bridged.
    Jump,
}

fn passage(last_ms: Option<u64>, now_ms: u64, step_s: f32) -> Passage {
    let Some(last_ms) = last_ms else { return Passage::OneStep };
    if now_ms <= last_ms {
        return Passage::Backwards;
    }
    let steps = libm::roundf((now_ms - last_ms) as f32 / (1000.0 * step_s));
    if steps <= 1.0 {
        Passage::OneStep
    } else if steps <= LONGEST_GAP as f32 {
        Passage::Missing(steps as u32 - 1)
    } else {
        Passage::Jump
    }
}

/// The velocity error if it can be used, and in the status why not.
fn velocity(reading: &Reading<f32>, config: &ModuleConfig, status: &mut Status) -> Option<f32> {
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
