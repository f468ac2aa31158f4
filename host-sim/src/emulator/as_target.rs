//! The emulated module as a target: configuration, compensation and state go to it as the state of a module in this process.
use schuler_core::module::{ModuleConfig, StateError, StepInput, StepOutput};
use schuler_link::block::BlockBytes;
use schuler_link::message::{HostMessage, ModuleMessage, STATE_PART, StateBytes};

use super::Emulator;
use super::session::unexpected;
use super::target::{HostModule, Target, TargetError};

impl Target for Emulator {
    /// The image cannot configure: a module in this process does, and its state is flown.
    fn configure(&mut self, config: &ModuleConfig) -> Result<(), TargetError> {
        let mut ground = HostModule::new();
        ground.configure(config)?;
        match self.command(&HostMessage::Forget)? {
            ModuleMessage::Forgotten => self.restore(&ground.save()?),
            other => Err(unexpected(other)),
        }
    }

    /// In a module in this process, which takes up the state and gives it back.
    fn load_compensation(&mut self, block: &BlockBytes) -> Result<(), TargetError> {
        let mut ground = HostModule::new();
        ground.restore(&self.save()?)?;
        ground.load_compensation(block)?;
        self.restore(&ground.save()?)
    }

    fn save(&mut self) -> Result<Vec<u8>, TargetError> {
        let (mut state, mut first_step) = (Vec::new(), None);
        loop {
            let wanted = state.len() as u32;
            match self.exchange(self.sequence, &HostMessage::ReadState { begin: wanted })? {
                ModuleMessage::State { begin, length, step, bytes } if begin == wanted => {
                    if step != *first_step.get_or_insert(step) {
                        // It has made a step meanwhile: from the start.
                        (state, first_step) = (Vec::new(), None);
                        continue;
                    }
                    state.extend_from_slice(&bytes);
                    if state.len() == length as usize {
                        return Ok(state);
                    }
                }
                other => return Err(unexpected(other)),
            }
        }
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), TargetError> {
        let mut begin = 0;
        loop {
            let rest = state.get(begin as usize..).unwrap_or_default();
            let bytes: StateBytes = rest.iter().copied().take(STATE_PART).collect();
            match self.command(&HostMessage::LoadState { begin, bytes })? {
                ModuleMessage::StateTaken { next } if next as usize == state.len() => return Ok(()),
                ModuleMessage::StateTaken { next } if next > begin => begin = next,
                // The module waits for more than there is.
                ModuleMessage::StateTaken { .. } => return Err(StateError::Form.into()),
                other => return Err(unexpected(other)),
            }
        }
    }

    fn step(&mut self, input: &StepInput) -> Result<StepOutput, TargetError> {
        match self.command(&HostMessage::Step(*input))? {
            ModuleMessage::Output(output) => Ok(output),
            other => Err(unexpected(other)),
        }
    }
}
