//! Something that runs the flight module, and the module in this process.
use super::QEMU;
use std::time::Duration;

use schuler_core::config::ConfigError;
use schuler_core::module::{FlightModule, ModuleConfig, StateError, StepInput, StepOutput};
use schuler_link::block::{self, BlockBytes, BlockError};
use schuler_link::message::Refusal;

/// What can go wrong between here and a module.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// A program that is needed is not there.
    #[error("{program} is not on the PATH; install it ({advice})")]
    MissingTool {
        /// Its name.
        program: String,
        /// How to get it.
        advice: &'static str,
    },
    /// The image could not be built.
    #[error("the firmware does not build: {0}")]
    Build(String),
    /// QEMU could not be run.
    #[error("{QEMU} cannot be run: {0}")]
    Run(std::io::Error),
    /// QEMU has ended by itself.
    #[error("{QEMU} has ended ({0})")]
    Ended(String),
    /// No answer.
    #[error("the module has not answered for {0:?}")]
    Silent(Duration),
    /// The module refuses the configuration.
    #[error("{field}: {problem}")]
    Configuration {
        /// Path of the field.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// The bytes are not a compensation block.
    #[error("the compensation block {0}")]
    Block(#[from] BlockError),
    /// The state cannot be saved, or the bytes are not a state of the module.
    #[error("the saved state {0}")]
    State(#[from] StateError),
    /// The module refuses a command.
    #[error("the module refuses: {0:?}")]
    Refused(Box<Refusal>),
    /// The module says something else than what was asked.
    #[error("the module answers {0}")]
    Unexpected(String),
    /// The image was built from other sources than this program.
    #[error(
        "the image was built from other sources ({image:016x}) than this program ({host:016x}); build both again"
    )]
    OtherSources {
        /// Hash that the image bears.
        image: u64,
        /// Hash of this program.
        host: u64,
    },
}

impl From<ConfigError> for TargetError {
    fn from(error: ConfigError) -> Self {
        Self::Configuration { field: error.field.to_owned(), problem: error.problem.to_string() }
    }
}

/// Something that runs the flight module.
pub trait Target {
    /// Starts afresh with this configuration.
    ///
    /// # Errors
    /// The configuration cannot be flown, or the target is out of reach.
    fn configure(&mut self, config: &ModuleConfig) -> Result<(), TargetError>;

    /// Corrects the inputs by a compensation block from the next step on.
    ///
    /// # Errors
    /// The bytes are not a block that can be flown, or the target is out of reach.
    fn load_compensation(&mut self, block: &BlockBytes) -> Result<(), TargetError>;

    /// Saves the state: all that a module needs to go on from here.
    ///
    /// # Errors
    /// There is no configuration yet, or the target is out of reach.
    fn save(&mut self) -> Result<Vec<u8>, TargetError>;

    /// Goes on from a saved state; what the target was doing is forgotten. One that has been configured takes none of another
    /// configuration.
    ///
    /// # Errors
    /// The bytes are not a state that it takes, or the target is out of reach.
    fn restore(&mut self, state: &[u8]) -> Result<(), TargetError>;

    /// One step.
    ///
    /// # Errors
    /// The target is out of reach.
    fn step(&mut self, input: &StepInput) -> Result<StepOutput, TargetError>;
}

/// The module in this process.
#[derive(Debug)]
pub struct HostModule(Box<FlightModule>);

impl HostModule {
    /// A module with the default configuration.
    pub fn new() -> Self {
        Self(Box::new(FlightModule::new()))
    }
}

impl Default for HostModule {
    fn default() -> Self {
        Self::new()
    }
}

impl Target for HostModule {
    fn configure(&mut self, config: &ModuleConfig) -> Result<(), TargetError> {
        Ok(self.0.configure(config)?)
    }

    fn load_compensation(&mut self, block: &BlockBytes) -> Result<(), TargetError> {
        let (block, checksum) = block::decode(block)?;
        self.0.load_compensation(&block)?;
        self.0.name_compensation(checksum);
        Ok(())
    }

    fn save(&mut self) -> Result<Vec<u8>, TargetError> {
        let mut state = vec![0; self.0.state_length()? as usize];
        self.0.save(&mut state)?;
        Ok(state)
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), TargetError> {
        Ok(self.0.restore(state)?)
    }

    fn step(&mut self, input: &StepInput) -> Result<StepOutput, TargetError> {
        Ok(self.0.step(input))
    }
}
