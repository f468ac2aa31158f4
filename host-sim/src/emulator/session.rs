//! The conversation with the emulated module: sessions, commands that are sent until they are answered, frames on the line.
use std::hash::{BuildHasher, RandomState};
use std::io::Write;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use schuler_core::module::StepInput;
use schuler_link::frame::{Frame, FrameError};
use schuler_link::message::{Banner, Counters, HostMessage, ModuleMessage, Pace, Refusal};

use super::target::TargetError;
use super::{Emulator, GIVE_UP, HELLO, PATIENCE};

impl Emulator {
    /// Waits for a session: says hello where the module has started and nobody has yet. `patience`: before it is said without
    /// that the module has been heard.
    pub(super) fn greet(&mut self, patience: Duration) -> Result<(), TargetError> {
        let deadline = Instant::now() + GIVE_UP;
        let mut wait = patience;
        loop {
            match self.receive(wait)? {
                Some(Frame { session: session @ 1.., message: ModuleMessage::Banner(banner), .. }) => {
                    self.resume_after(&banner);
                    self.banner = banner;
                    self.session = session;
                    self.wire.seal_with(session);
                    return Ok(());
                }
                Some(Frame { message: ModuleMessage::Banner(_), .. }) | None if Instant::now() < deadline => {
                    self.wire.seal_with(self.offer);
                    self.send(HELLO, &HostMessage::Hello)?;
                    wait = PATIENCE;
                }
                None => return Err(TargetError::Silent(GIVE_UP)),
                Some(_) => (),
            }
        }
    }

    /// The session in which frames are sent; zero while there is none.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// Changes what makes the module take a step.
    ///
    /// # Errors
    /// The module refuses, or is out of reach.
    pub fn set_pace(&mut self, pace: Pace) -> Result<(), TargetError> {
        match self.command(&HostMessage::SetPace(pace))? {
            ModuleMessage::PaceSet(set) if set == pace => Ok(()),
            other => Err(unexpected(other)),
        }
    }

    /// How it has gone since the start.
    ///
    /// # Errors
    /// The module is out of reach.
    pub fn counters(&mut self) -> Result<Counters, TargetError> {
        match self.exchange(self.sequence, &HostMessage::Counters)? {
            ModuleMessage::Counters(counters) => Ok(counters),
            other => Err(unexpected(other)),
        }
    }

    /// Sends an input and does not wait: at the clock's pace the module answers at its next tick.
    ///
    /// # Errors
    /// The module is out of reach.
    pub fn post(&mut self, input: &StepInput) -> Result<(), TargetError> {
        self.be_in_session()?;
        self.sequence = self.sequence.wrapping_add(1);
        self.send(self.sequence, &HostMessage::Step(*input))
    }

    /// Puts bytes on the line as they are.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), TargetError> {
        self.outbox.extend_from_slice(bytes);
        self.flush()
    }

    /// The next frame from the module, if one comes in time. Damaged ones are skipped.
    ///
    /// # Errors
    /// The emulator has ended, or the module speaks another version of the protocol.
    pub fn receive(&mut self, patience: Duration) -> Result<Option<Frame<ModuleMessage>>, TargetError> {
        let deadline = Instant::now() + patience;
        loop {
            let session = self.session;
            for byte in self.pending.by_ref() {
                match self.decoder.push(byte) {
                    Some(Ok(frame)) if is_of(session, &frame) => return Ok(Some(frame)),
                    Some(Err(FrameError::Version(version))) => {
                        let ours = schuler_link::PROTOCOL;
                        let text =
                            format!("in version {version} of the protocol; this program speaks {ours}");
                        return Err(TargetError::Unexpected(text));
                    }
                    // Damaged, or an answer to somebody before a reset.
                    Some(_) | None => (),
                }
            }
            match self.next_bytes(deadline.saturating_duration_since(Instant::now()))? {
                Some(bytes) => self.pending = bytes.into_iter(),
                None => return Ok(None),
            }
        }
    }

    /// The next bytes from the line as they are, if some come in time.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn next_bytes(&mut self, patience: Duration) -> Result<Option<Vec<u8>>, TargetError> {
        match self.from_module.recv_timeout(patience) {
            Ok(bytes) => Ok(Some(match &mut self.disturb_incoming {
                Some(disturb) => disturb(&bytes),
                None => bytes,
            })),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(self.ended()),
        }
    }

    /// Sends a command until its answer comes: the module carries it out once, however often it hears it.
    pub(super) fn command(&mut self, message: &HostMessage) -> Result<ModuleMessage, TargetError> {
        self.be_in_session()?;
        self.sequence = self.sequence.wrapping_add(1);
        let answer = self.exchange(self.sequence, message)?;
        if answer == ModuleMessage::Refused(Refusal::Session) {
            // It has started again, and the banner that said so was lost.
            self.leave_session();
        }
        Ok(answer)
    }

    /// A module that has restarted has forgotten the session.
    pub(super) fn be_in_session(&mut self) -> Result<(), TargetError> {
        if self.session == 0 { self.greet(Duration::ZERO) } else { Ok(()) }
    }

    fn leave_session(&mut self) {
        self.session = 0;
        self.offer = fresh_offer();
    }

    pub(super) fn exchange(
        &mut self,
        sequence: u32,
        message: &HostMessage,
    ) -> Result<ModuleMessage, TargetError> {
        let question = matches!(message, HostMessage::Counters);
        let part = match message {
            HostMessage::ReadState { begin } => Some(*begin),
            _ => None,
        };
        let give_up = Instant::now() + GIVE_UP;
        while Instant::now() < give_up {
            self.send(sequence, message)?;
            let deadline = Instant::now() + self.patience;
            while let Some(frame) = self.receive(deadline.saturating_duration_since(Instant::now()))? {
                match frame.message {
                    ModuleMessage::Banner(banner) if frame.sequence != HELLO => {
                        return Err(self.restarted(banner));
                    }
                    answer @ ModuleMessage::Counters(_) if question => return Ok(answer),
                    answer @ ModuleMessage::State { begin, .. } if part == Some(begin) => return Ok(answer),
                    answer @ ModuleMessage::Refused(Refusal::State(_)) if part.is_some() => {
                        return Ok(answer);
                    }
                    // These bear the number of a command without being its answer.
                    ModuleMessage::Counters(_) | ModuleMessage::Tick(_) | ModuleMessage::State { .. } => (),
                    answer if frame.sequence == sequence && !question && part.is_none() => return Ok(answer),
                    // The answer to something earlier.
                    _ => (),
                }
            }
        }
        Err(TargetError::Silent(GIVE_UP))
    }

    pub(super) fn send(&mut self, sequence: u32, message: &HostMessage) -> Result<(), TargetError> {
        self.put(sequence, message);
        self.flush()
    }

    pub(super) fn put(&mut self, sequence: u32, message: &HostMessage) {
        // Every message of the host fits; the crate asserts it.
        if self.wire.encode(sequence, message).is_ok() {
            match &mut self.disturb_outgoing {
                Some(disturb) => self.outbox.extend(disturb(self.wire.as_bytes())),
                None => self.outbox.extend_from_slice(self.wire.as_bytes()),
            }
        }
    }

    pub(super) fn flush(&mut self) -> Result<(), TargetError> {
        let written = match &mut self.to_module {
            Some(line) => line.write_all(&self.outbox).and_then(|()| line.flush()),
            None => Ok(()),
        };
        self.outbox.clear();
        written.map_err(|_| self.ended())
    }

    fn resume_after(&mut self, banner: &Banner) {
        self.sequence = banner.last_sequence.unwrap_or(0);
    }

    pub(super) fn restarted(&mut self, banner: Banner) -> TargetError {
        self.resume_after(&banner);
        self.leave_session();
        let text = format!("that it has restarted ({:?})", banner.start);
        self.banner = banner;
        TargetError::Unexpected(text)
    }
}

/// Of no other session than this one, if there is one; who is there is always heard.
fn is_of(session: u64, frame: &Frame<ModuleMessage>) -> bool {
    let introduces = matches!(frame.message, ModuleMessage::Banner(_));
    introduces || session == 0 || frame.session == session
}

/// Another number each time: hashers are seeded at random.
pub(super) fn fresh_offer() -> u64 {
    RandomState::new().hash_one(std::process::id())
}

pub(super) fn unexpected(message: ModuleMessage) -> TargetError {
    match message {
        ModuleMessage::Refused(Refusal::State(error)) => TargetError::State(error),
        ModuleMessage::Refused(refusal) => TargetError::Refused(Box::new(refusal)),
        other => TargetError::Unexpected(format!("{other:?}")),
    }
}
