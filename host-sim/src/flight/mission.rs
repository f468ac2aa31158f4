//! Runs the flight module over a channel.
use schuler_core::module::StepOutput;

use super::Channel;
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

/// A channel that was flown.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// The channel.
    pub channel: Channel,
    /// What the module said, step by step.
    pub outputs: Vec<StepOutput>,
}

/// Why a channel could not be flown.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// The target refuses, or is out of reach.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// The user has stopped the run.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Flies a channel; `progress` hears the number of steps done and may stop the flight.
///
/// # Errors
/// A configuration that cannot be flown, a target that is out of reach, a stopped run.
pub fn fly(
    channel: Channel,
    on: On,
    mut progress: impl FnMut(usize) -> Result<(), Interrupted>,
) -> Result<Flown, FlightError> {
    let mut outputs = Vec::with_capacity(channel.inputs.len());
    let mut take = |output: StepOutput| {
        outputs.push(output);
        progress(outputs.len())
    };
    match on {
        On::Host => {
            let mut module = HostModule::new();
            module.configure(&channel.config)?;
            if let Some(block) = &channel.compensation {
                module.load_compensation(block)?;
            }
            for input in &channel.inputs {
                take(module.step(input)?)?;
            }
        }
        On::Qemu | On::QemuUart => {
            let transport = if on == On::Qemu { Transport::Fifo } else { Transport::Uart };
            let mut emulator = Emulator::start(transport)?;
            emulator.configure(&channel.config)?;
            if let Some(block) = &channel.compensation {
                emulator.load_compensation(block)?;
            }
            for output in emulator.run(channel.inputs.iter().copied()) {
                take(output?)?;
            }
        }
    }
    Ok(Flown { channel, outputs })
}
