//! Runs the flight module over a channel.
use std::cell::RefCell;
use std::collections::VecDeque;

use schuler_core::module::StepOutput;
use schuler_recording::{Error, Recording};

use super::{Channel, Step};
use crate::emulator::{Emulator, HostModule, Target, TargetError, Transport};
use crate::output::Interrupted;

/// What the module runs on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum On {
    /// This machine.
    #[default]
    Host,
    /// The emulated target, through semihosting: some ten thousand steps a second.
    Qemu,
    /// The emulated target, through its serial port as it flies: some hundred steps a second.
    QemuUart,
}

impl On {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Host => "host",
            Self::Qemu => "qemu",
            Self::QemuUart => "qemu-uart",
        }
    }
}

/// Why a channel could not be flown.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// The target refuses, or is out of reach.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// The recording cannot be read, or what comes of it not be written.
    #[error(transparent)]
    File(#[from] Error),
    /// The user has stopped the run.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Flies a channel's steps; `take` is given each with what the module said, and may stop the flight.
///
/// # Errors
/// A configuration that cannot be flown, a target that is out of reach, a step that cannot be read, an error of `take`.
pub fn fly<E: Into<FlightError>>(
    channel: &Channel,
    steps: impl IntoIterator<Item = Result<Step, E>>,
    on: On,
    mut take: impl FnMut(&Step, &StepOutput) -> Result<(), FlightError>,
) -> Result<(), FlightError> {
    match on {
        On::Host => {
            let mut module = HostModule::new();
            prepare(&mut module, channel)?;
            for step in steps {
                let step = step.map_err(Into::into)?;
                take(&step, &module.step(&step.input)?)?;
            }
        }
        On::Qemu | On::QemuUart => {
            let transport = if on == On::Qemu { Transport::Fifo } else { Transport::Uart };
            let mut emulator = Emulator::start(transport)?;
            prepare(&mut emulator, channel)?;
            // Several steps are on their way at any time.
            let sent = RefCell::new(VecDeque::new());
            let mut unreadable = None;
            let inputs = steps.into_iter().map_while(|step| {
                let step = step.map_err(|error| unreadable = Some(error.into())).ok()?;
                sent.borrow_mut().push_back(step);
                Some(step.input)
            });
            for output in emulator.run(inputs) {
                let output = output?;
                let step = sent.borrow_mut().pop_front();
                if let Some(step) = step {
                    take(&step, &output)?;
                }
            }
            unreadable.map_or(Ok(()), Err)?;
        }
    }
    Ok(())
}

/// What a board is loaded with to fly this channel: the state of a module that has been configured and corrected and has made no
/// step.
///
/// # Errors
/// The configuration or the compensation block cannot be flown.
pub fn initial_state(channel: &Channel) -> Result<Vec<u8>, TargetError> {
    let mut ground = HostModule::new();
    prepare(&mut ground, channel)?;
    ground.save()
}

fn prepare(target: &mut impl Target, channel: &Channel) -> Result<(), TargetError> {
    target.configure(&channel.config)?;
    channel.compensation.as_ref().map_or(Ok(()), |block| target.load_compensation(block))
}

/// A channel that was flown, with all its steps in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// The channel.
    pub channel: Channel,
    /// What the module was told, step by step.
    pub steps: Vec<Step>,
    /// What the module said, step by step.
    pub outputs: Vec<StepOutput>,
}

impl Flown {
    /// Flies a channel over a recording; `progress` hears the number of steps done and may stop the flight.
    ///
    /// # Errors
    /// As [`fly`].
    pub fn of(
        channel: Channel,
        recording: &Recording,
        on: On,
        mut progress: impl FnMut(usize) -> Result<(), Interrupted>,
    ) -> Result<Self, FlightError> {
        let planned = |problem| Error::one(&recording.case.recording.path, problem);
        let steps = channel.steps(recording).map_err(planned)?;
        let mut outputs = Vec::with_capacity(steps.len());
        fly(&channel, steps.iter().copied().map(Ok::<_, Error>), on, |_, output| {
            outputs.push(*output);
            Ok(progress(outputs.len())?)
        })?;
        Ok(Self { channel, steps, outputs })
    }

    /// Each step with what the module said.
    pub fn iter(&self) -> impl Iterator<Item = (&Step, &StepOutput)> {
        self.steps.iter().zip(&self.outputs)
    }
}
