//! Many steps with some of them on their way at any time.
use schuler_core::module::{StepInput, StepOutput};
use schuler_link::message::{HostMessage, ModuleMessage};

use super::session::unexpected;
use super::target::TargetError;
use super::{Emulator, GIVE_UP};

impl Emulator {
    /// Runs many steps with some of them on their way at any time. The answers come in the order of the inputs.
    pub fn run<I: IntoIterator<Item = StepInput>>(&mut self, inputs: I) -> Run<'_, I::IntoIter> {
        Run {
            inputs: inputs.into_iter().fuse(),
            answered: self.sequence,
            in_flight: 0,
            failed: false,
            emulator: self,
        }
    }
}

/// Steps on their way; see [`Emulator::run`]. Ends after the first error.
pub struct Run<'a, I> {
    emulator: &'a mut Emulator,
    inputs: std::iter::Fuse<I>,
    /// Number of the last command answered.
    answered: u32,
    in_flight: usize,
    failed: bool,
}

impl<I: Iterator<Item = StepInput>> Iterator for Run<'_, I> {
    type Item = Result<StepOutput, TargetError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let result = self.advance().transpose()?;
        self.failed = result.is_err();
        Some(result)
    }
}

impl<I: Iterator<Item = StepInput>> Run<'_, I> {
    fn advance(&mut self) -> Result<Option<StepOutput>, TargetError> {
        // Refilled by halves: a call to the system for many frames.
        if self.in_flight <= self.emulator.window / 2 {
            self.emulator.be_in_session()?;
            for input in self.inputs.by_ref().take(self.emulator.window - self.in_flight) {
                self.emulator.sequence = self.emulator.sequence.wrapping_add(1);
                self.emulator.put(self.emulator.sequence, &HostMessage::Step(input));
                self.in_flight += 1;
            }
            self.emulator.flush()?;
        }
        if self.in_flight == 0 {
            return Ok(None);
        }
        let frame = self.emulator.receive(GIVE_UP)?.ok_or(TargetError::Silent(GIVE_UP))?;
        self.answered = self.answered.wrapping_add(1);
        self.in_flight -= 1;
        match frame.message {
            ModuleMessage::Output(output) if frame.sequence == self.answered => Ok(Some(output)),
            ModuleMessage::Banner(banner) => Err(self.emulator.restarted(banner)),
            ModuleMessage::Output(_) => Err(TargetError::Unexpected(format!(
                "step {} where {} was due: a frame was lost",
                frame.sequence, self.answered
            ))),
            other => Err(unexpected(other)),
        }
    }
}
