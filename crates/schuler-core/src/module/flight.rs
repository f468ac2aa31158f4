//! The module: its state, configuration, and the step.
use core::array;

use super::config::ModuleConfig;
use super::input::{Command, StepInput};
use super::output::{Status, StepOutput};
use super::thermometer::Thermometer;
use super::time::{Clock, Passage};
use super::velocity::{Identifiers, VelocityChannel, usable};
use super::{HEALTH_LEVELS, THERMOMETERS};
use crate::compensation::{Block, Compensator, Known};
use crate::config::{ConfigError, Problem};
use crate::health::{HealthConfig, HealthMonitor};
use crate::isolation::FaultIsolation;
use crate::reading::{Quality, Reading};
use crate::thermal::{TemperatureRateOutput, ThermalState};

/// The flight module's whole state: about 75 kB. Keep it in a static and configure it there.
#[derive(Clone, Copy, Debug)]
pub struct FlightModule {
    stage: Stage,
    identifiers: Identifiers,
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
    steps: u64,
    clock: Clock,
    thermometers: [Thermometer; THERMOMETERS],
    compensator: Compensator,
    /// The block in force has terms of the velocity channel.
    corrects_velocity: bool,
    velocity: VelocityChannel,
    isolation: FaultIsolation,
    health: HealthMonitor<f32, HEALTH_LEVELS>,
    /// What happened since the last step, for its status.
    news: Status,
}

impl FlightModule {
    /// A module that waits for its configuration; until then every step answers [`Status::NOT_CONFIGURED`].
    pub const fn new() -> Self {
        Self { stage: Stage::Waiting, identifiers: Identifiers::new() }
    }

    /// Checks the configuration and starts the module anew from it, in place and without a compensation block. On an error the
    /// module goes on as it was.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn configure(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        config.validate()?;
        let [a, b, c, d] = config.thermometers.each_ref().map(|it| Thermometer::try_build(it.as_ref()));
        // A monitor that is off runs on missing readings.
        let off = HealthConfig::doppler_against_inertial();
        self.stage = Stage::Running(Running {
            config: *config,
            steps: 0,
            clock: Clock::default(),
            thermometers: [a?, b?, c?, d?],
            compensator: Compensator::none(),
            corrects_velocity: false,
            velocity: VelocityChannel::try_build(&config.filter)?,
            isolation: FaultIsolation::try_build(&config.isolation)?,
            health: HealthMonitor::try_build(config.health.as_ref().unwrap_or(&off))?,
            news: Status::empty(),
        });
        self.identifiers.start(&config.filter, &config.identification);
        Ok(())
    }

    /// Checks a compensation block and corrects by it from the next step on, in place of the one before. Best before the first
    /// step: where it, or the one before, acts on the velocity channel, filter and identification start anew. On an error the
    /// module goes on as it was.
    ///
    /// # Errors
    /// The first field that cannot be flown, or that there is no configuration yet.
    pub fn load_compensation(&mut self, block: &Block) -> Result<(), ConfigError> {
        let compensator = Compensator::try_build(block)?;
        let Stage::Running(running) = &mut self.stage else {
            return Err(ConfigError::new("compensation", Problem::BeforeConfiguration));
        };
        let corrects_velocity = block.has_velocity_terms();
        if corrects_velocity || running.corrects_velocity {
            running.velocity = VelocityChannel::try_build(&running.config.filter)?;
            self.identifiers.start(&running.config.filter, &running.config.identification);
            running.news |= Status::VELOCITY_RESTARTED;
        }
        running.news |= Status::COMPENSATION_LOADED;
        running.corrects_velocity = corrects_velocity;
        running.compensator = compensator;
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
        running.step(&mut self.identifiers, input)
    }
}

impl Default for FlightModule {
    fn default() -> Self {
        Self::new()
    }
}

impl Running {
    fn step(&mut self, identifiers: &mut Identifiers, input: &StepInput) -> StepOutput {
        self.steps += 1;
        let config = &self.config;
        let mut status = core::mem::replace(&mut self.news, Status::empty());

        // Time.
        let passage = self.clock.pass(input.time_ms, config.filter.step_s);
        let steady_ms = self.clock.steady_ms();
        status.set(Status::STEPS_MISSING, matches!(passage, Passage::Missing(_)));
        status.set(Status::CLOCK_BACKWARDS, passage == Passage::Backwards);
        status.set(Status::CLOCK_JUMPED, passage == Passage::Jump);

        // Readings.
        let max_age_ms = config.max_age_ms;
        let gyros = input.gyros.map(|reading| reading.not_older_than(max_age_ms));
        let accelerometers = input.accelerometers.map(|reading| reading.not_older_than(max_age_ms));
        let velocity = usable(&input.velocity_error, config, &mut status);
        // A temperature that came at a time that ran backwards may be an old one.
        let thermometers = input.thermometers.map(|reading| {
            let reading = reading.not_older_than(max_age_ms);
            if passage == Passage::Backwards { Reading::missing() } else { reading }
        });

        // Temperatures and rates.
        let mut temperatures = [TemperatureRateOutput::default(); THERMOMETERS];
        let mut states = [ThermalState::default(); THERMOMETERS];
        let all = self.thermometers.iter_mut().zip(&thermometers);
        for ((output, state), (thermometer, reading)) in temperatures.iter_mut().zip(&mut states).zip(all) {
            (*output, *state) = thermometer.step(steady_ms, reading);
        }

        // Corrections.
        let compensation = self.compensator.correct(&Known {
            thermometers: states,
            gyros: gyros.map(value_of),
            accelerometers: accelerometers.map(value_of),
            velocity,
        });

        // Velocity channel.
        let measured = velocity.map(|velocity| velocity - compensation.velocity);
        let (filter, identification) =
            self.velocity.step(identifiers, config, passage, measured, compensation.loop_errors, &mut status);

        // Gyro block.
        let readmit = match input.command {
            Command::None => None,
            Command::ReadmitGyro(gyro) => Some(gyro),
        };
        let errors = array::from_fn(|gyro| match (gyros.get(gyro), compensation.gyros.get(gyro)) {
            (Some(reading), Some(corrected)) => value_of(*reading).map_or(0.0, |value| value - corrected),
            _ => 0.0,
        });
        let isolation = self.isolation.step_corrected(&gyros, &errors, readmit);

        // Health monitor.
        let listened = |reading: &Reading<f32>| match config.health {
            Some(_) => *reading,
            None => Reading::missing(),
        };
        let (radio, inertial) = (listened(&input.radio_velocity), listened(&input.inertial_velocity));
        let health = self.health.step(&radio, &inertial, passage.elapsed());

        StepOutput {
            step: self.steps,
            time_ms: input.time_ms,
            status,
            filter,
            identification,
            isolation,
            thermometers: temperatures,
            compensation,
            health,
        }
    }
}

/// The value of a reading that can be used.
fn value_of(reading: Reading<f64>) -> Option<f64> {
    (reading.quality == Quality::Good && reading.value.is_finite()).then_some(reading.value)
}
