//! Runs the flight module over a channel.
use schuler_core::config::ConfigError;
use schuler_core::module::{FlightModule, StepOutput};

use super::Channel;
use crate::output::Interrupted;

/// What the module runs on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum On {
    /// This machine.
    #[default]
    Host,
    /// The emulated target.
    Qemu,
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
    /// The module refuses the configuration that follows from the case.
    #[error("the flight module refuses the configuration: {0}")]
    Configuration(#[from] ConfigError),
    /// The user has stopped the run.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// The target is not part of this program.
    #[error("the emulated target is not part of this build")]
    NoTarget,
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
    let outputs = match on {
        On::Host => {
            let mut module = Box::new(FlightModule::new());
            module.configure(&channel.config)?;
            let mut outputs = Vec::with_capacity(channel.inputs.len());
            for (step, input) in channel.inputs.iter().enumerate() {
                progress(step + 1)?;
                outputs.push(module.step(input));
            }
            outputs
        }
        On::Qemu => return Err(FlightError::NoTarget),
    };
    Ok(Flown { channel, outputs })
}
