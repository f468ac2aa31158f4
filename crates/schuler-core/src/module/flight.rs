//! The module: its state, configuration, and the step.
use core::array;

use super::config::{ModuleConfig, StepConfig};
use super::input::{Command, StepInput};
use super::output::{Status, StepOutput};
use super::thermometer::Thermometer;
use super::time::{Clock, Passage};
use super::trust::Withholding;
use super::velocity::{Identifier, Measurement, VelocityChannel, usable};
use super::{HEALTH_LEVELS, THERMOMETERS};
use crate::compensation::{Block, BlockHead, Compensation, Compensator, Known, Term};
use crate::config::{ConfigError, Problem};
use crate::health::{HealthConfig, HealthMonitor, HealthOutput};
use crate::isolation::{FaultIsolation, IsolationOutput};
use crate::reading::{Quality, Reading};
use crate::saved::{Blank, Saved, Visitor, saved};
use crate::thermal::{TemperatureRateOutput, ThermalState};

/// The flight module's whole state: about 50 kB. Keep it in a static and configure it there.
#[derive(Clone, Copy, Debug)]
pub struct FlightModule {
    stage: Stage,
    /// A saved state is being brought back; there is no step until it is whole.
    loading: bool,
    identifier: Identifier,
    parts: Parts,
}

/// Parts that are built one by one where they stay: together they are too large for a small stack.
#[derive(Clone, Copy, Debug)]
struct Parts {
    isolation: Slot<FaultIsolation>,
    thermometers: [Slot<Thermometer>; THERMOMETERS],
    compensator: Slot<Compensator>,
    health: Slot<HealthMonitor<f32, HEALTH_LEVELS>>,
}

/// A part that is there once there is a configuration. The tag stands by itself, as in [`Stage`]; it is as long as what may have
/// to be aligned behind it, or else a part would be put together on the stack with the bytes in between.
#[derive(Clone, Copy, Debug)]
#[repr(u64)]
#[allow(clippy::large_enum_variant)] // Never moved.
enum Slot<T> {
    Empty,
    Full(T),
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
    config: StepConfig,
    /// Of the whole configuration.
    fingerprint: u32,
    steps: u64,
    clock: Clock,
    /// The block in force has terms of the velocity channel.
    corrects_velocity: bool,
    velocity: VelocityChannel,
    withholding: Withholding,
    /// What happened since the last step, for its status.
    news: Status,
    /// What the block in force was called by whoever loaded it.
    compensation_name: Option<u32>,
}

impl FlightModule {
    /// A module that waits for its configuration; until then every step answers [`Status::NOT_CONFIGURED`].
    pub const fn new() -> Self {
        let parts = Parts {
            isolation: Slot::Empty,
            thermometers: [Slot::Empty; THERMOMETERS],
            compensator: Slot::Empty,
            health: Slot::Empty,
        };
        Self { stage: Stage::Waiting, loading: false, identifier: Identifier::IDLE, parts }
    }

    /// Checks the configuration and starts the module anew from it, in place and without a compensation block. On an error the
    /// module goes on as it was.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    #[inline(never)]
    pub fn configure(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        // After this nothing fails.
        config.validate()?;
        self.stage.start(config)?;
        self.parts.start(config)?;
        self.identifier.start(&config.filter, &config.identification);
        self.loading = false;
        Ok(())
    }

    /// Checks a compensation block and corrects by it from the next step on, in place of the one before. Best before the first
    /// step: where it, or the one before, acts on the velocity channel, filter and identification start anew. On an error the
    /// module goes on as it was.
    ///
    /// # Errors
    /// The first field that cannot be flown, or that there is no configuration yet.
    pub fn load_compensation(&mut self, block: &Block) -> Result<(), ConfigError> {
        self.load_terms(&block.head(), block.terms.iter().copied())
    }

    /// The same of a block whose terms come one by one, three times over.
    ///
    /// # Errors
    /// As [`load_compensation`](Self::load_compensation), and more terms than a block has.
    #[inline(never)]
    pub fn load_terms(
        &mut self,
        head: &BlockHead,
        mut terms: impl Iterator<Item = Term> + Clone,
    ) -> Result<(), ConfigError> {
        let (Stage::Running(running), Slot::Full(compensator), false) =
            (&mut self.stage, &mut self.parts.compensator, self.loading)
        else {
            return Err(ConfigError::new("compensation", Problem::BeforeConfiguration));
        };
        compensator.load_terms(head, terms.clone())?;
        let corrects_velocity = terms.any(|term| term.target.is_of_velocity());
        if corrects_velocity || running.corrects_velocity {
            running.velocity = VelocityChannel::try_build(&running.config.filter)?;
            self.identifier.start(&running.config.filter, &running.config.identification);
            running.news |= Status::VELOCITY_RESTARTED;
        }
        running.news |= Status::COMPENSATION_LOADED;
        running.compensation_name = None;
        running.corrects_velocity = corrects_velocity;
        Ok(())
    }

    /// One step. Never panics; whatever the input, the state stays usable.
    pub fn step(&mut self, input: &StepInput) -> StepOutput {
        match &mut self.stage {
            Stage::Running(running) if !self.loading => {
                running.step(&mut self.identifier, &mut self.parts, input)
            }
            _ => {
                StepOutput { time_ms: input.time_ms, status: Status::NOT_CONFIGURED, ..StepOutput::default() }
            }
        }
    }

    /// Steps since configuration, those before a state was brought back included.
    pub fn steps(&self) -> u64 {
        self.running().map_or(0, |running| running.steps)
    }

    /// Time of the last step, milliseconds.
    pub fn last_time_ms(&self) -> Option<u64> {
        self.running()?.clock.last_ms()
    }

    /// Keeps what the compensation block in force is called; it is saved with the state.
    pub fn name_compensation(&mut self, name: u32) {
        if let Stage::Running(running) = &mut self.stage {
            running.compensation_name = Some(name);
        }
    }

    /// What the compensation block in force is called.
    pub fn compensation_name(&self) -> Option<u32> {
        self.running()?.compensation_name
    }

    fn running(&self) -> Option<&Running> {
        match &self.stage {
            Stage::Running(running) if !self.loading => Some(running),
            _ => None,
        }
    }

    /// Whether it can make a step.
    pub(super) fn is_whole(&self) -> bool {
        self.running().is_some()
    }

    /// Tells one configuration from another; none while there is none.
    pub(super) fn fingerprint(&self) -> Option<u32> {
        self.running().map(|running| running.fingerprint)
    }

    /// Whether a saved state is being brought back.
    pub(super) fn is_loading(&self) -> bool {
        self.loading
    }

    /// Forgets everything and makes room for a saved state; no step until it is whole.
    pub(super) fn begin_loading(&mut self) {
        self.loading = true;
        self.stage.make_room();
        self.parts.make_room();
    }

    /// The state is whole.
    pub(super) fn end_loading(&mut self) {
        self.loading = false;
    }

    /// Forgets everything and waits for a configuration or a state, as in the beginning.
    pub fn forget(&mut self) {
        self.loading = false;
        self.stage = Stage::Waiting;
    }

    /// Hands everything to the visitor.
    pub(crate) fn visit(&mut self, visitor: &mut Visitor<'_>) {
        if let Stage::Running(running) = &mut self.stage {
            self.identifier.visit(visitor);
            running.visit(visitor);
            self.parts.visit(visitor);
        }
    }
}

impl Default for FlightModule {
    fn default() -> Self {
        Self::new()
    }
}

// What follows stands by itself: what one of them needs of the stack the others have no use for.
impl Stage {
    #[inline(never)]
    fn start(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        *self = Self::Running(Running {
            config: config.into(),
            fingerprint: config.fingerprint(),
            steps: 0,
            clock: Clock::default(),
            corrects_velocity: false,
            velocity: VelocityChannel::try_build(&config.filter)?,
            withholding: Withholding::default(),
            news: Status::empty(),
            compensation_name: None,
        });
        Ok(())
    }

    #[inline(never)]
    fn make_room(&mut self) {
        *self = Self::Running(Running::blank());
    }
}

impl Parts {
    /// Starts all of them; the configuration has been checked.
    fn start(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        self.start_thermometers(config)?;
        self.start_isolation(config)?;
        self.start_compensator();
        self.start_health(config)
    }

    fn make_room(&mut self) {
        self.isolation.make_room();
        self.thermometers.iter_mut().for_each(Slot::make_room);
        self.compensator.make_room();
        self.health.make_room();
    }

    #[inline(never)]
    fn start_thermometers(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        for (thermometer, config) in self.thermometers.iter_mut().zip(&config.thermometers) {
            *thermometer = Slot::Full(Thermometer::try_build(config.as_ref())?);
        }
        Ok(())
    }

    #[inline(never)]
    fn start_isolation(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        FaultIsolation::try_build(&config.isolation).map(|block| self.isolation = Slot::Full(block))
    }

    #[inline(never)]
    fn start_compensator(&mut self) {
        self.compensator = Slot::Full(Compensator::none());
    }

    /// A monitor that is off runs on missing readings.
    #[inline(never)]
    fn start_health(&mut self, config: &ModuleConfig) -> Result<(), ConfigError> {
        let off = HealthConfig::doppler_against_inertial();
        let monitor = HealthMonitor::try_build(config.health.as_ref().unwrap_or(&off))?;
        self.health = Slot::Full(monitor);
        Ok(())
    }
}

impl Running {
    #[inline(never)]
    fn step(&mut self, identifier: &mut Identifier, parts: &mut Parts, input: &StepInput) -> StepOutput {
        self.steps = self.steps.saturating_add(1);
        let config = &self.config;
        let mut status = core::mem::replace(&mut self.news, Status::empty());

        // Time.
        let passage = self.clock.pass(input.time_ms, config.filter.step_s);
        let monotonic_ms = self.clock.monotonic_ms();
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
        let all = parts.thermometers.iter_mut().zip(&thermometers);
        for ((output, state), (thermometer, reading)) in temperatures.iter_mut().zip(&mut states).zip(all) {
            if let Slot::Full(thermometer) = thermometer {
                (*output, *state) = thermometer.step(monotonic_ms, reading);
            }
        }

        // Corrections.
        let known = Known {
            thermometers: states,
            gyros: gyros.map(value_of),
            accelerometers: accelerometers.map(value_of),
            velocity,
        };
        let compensation = match &parts.compensator {
            Slot::Full(compensator) => compensator.correct(&known),
            Slot::Empty => Compensation::default(),
        };

        // Health monitor.
        let listened = |reading: &Reading<f32>| if config.monitored { *reading } else { Reading::missing() };
        let (radio, inertial) = (listened(&input.radio_velocity), listened(&input.inertial_velocity));
        let health = match &mut parts.health {
            Slot::Full(monitor) => monitor.step(&radio, &inertial, passage.elapsed()),
            Slot::Empty => HealthOutput::default(),
        };

        // Velocity channel.
        let duration_s = passage.moved() as f32 * config.filter.step_s;
        let trust = self.withholding.step(config.radio_use.as_ref(), &health, duration_s);
        status.set(Status::VELOCITY_WITHHELD, velocity.is_some() & trust.withheld);
        let measured = velocity.filter(|_| !trust.withheld).map(|velocity| velocity - compensation.velocity);
        let measurement = Measurement { velocity: measured, weight: trust.weight };
        let (filter, identification) = self.velocity.step(
            identifier,
            config,
            passage,
            measurement,
            compensation.loop_errors,
            &mut status,
        );

        // Gyro block.
        let readmit = match input.command {
            Command::None => None,
            Command::ReadmitGyro(gyro) => Some(gyro),
        };
        let errors = array::from_fn(|gyro| match (gyros.get(gyro), compensation.gyros.get(gyro)) {
            (Some(reading), Some(corrected)) => value_of(*reading).map_or(0.0, |value| value - corrected),
            _ => 0.0,
        });
        let isolation = match &mut parts.isolation {
            Slot::Full(block) => block.step_corrected(&gyros, &errors, readmit),
            Slot::Empty => IsolationOutput::default(),
        };

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

impl<T: Blank> Slot<T> {
    #[inline(never)]
    fn make_room(&mut self) {
        *self = Self::Full(T::blank());
    }
}

saved!([] Running {
    config,
    fingerprint,
    steps,
    clock,
    corrects_velocity,
    velocity,
    withholding,
    news,
    compensation_name,
});

saved!([] Parts { isolation, thermometers, compensator, health } always);

/// Full from the configuration on; before, nothing is saved.
impl<T: Saved> Saved for Slot<T> {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        if let Self::Full(part) = self {
            part.visit(visitor);
        }
    }
}
