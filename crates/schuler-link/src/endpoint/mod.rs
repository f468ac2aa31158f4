//! The module's side of the conversation.
//!
//! **Each command at most once.** A step must not run twice because its answer was lost, nor may a late copy of an
//! old frame run at all: the filter would propagate a second that never passed. Commands bear running numbers
//! (modulo 2³²), and the endpoint keeps the number, the checksum and the answer of the last one:
//!
//! | number of the command, against the last | what happens |
//! | --- | --- |
//! | ahead, by less than 2³¹ | carried out; a jump is a lost frame, which the module sees in the times of its inputs |
//! | the same, and the same checksum | not carried out again: the stored answer is sent once more |
//! | the same, another checksum | [`Refusal::Conflict`] |
//! | behind | [`Refusal::Stale`] |
//!
//! **Sessions.** Numbers tell what is old only since the start: what was ahead before a reset would be carried out after it.
//! So a session begins with the first [`Hello`](crate::message::HostMessageOf::Hello) after a start, and every frame bears its
//! number: the count of starts in the upper half, the clock at that moment, in microseconds, in the lower, and over
//! both, bit by bit, the number that the question bears, of which the host takes another each time. No two starts have the same:
//! the count tells those without loss of power apart, clock and host the others. A command of another session, or before
//! there is one, is refused ([`Refusal::Session`]), whatever its number.
//!
//! So a host that hears nothing sends the same frame again until it hears the answer, and each of its steps has
//! then been run exactly once. A host that has just started asks [`Hello`](crate::message::HostMessageOf::Hello) and goes on from
//! [`Banner::last_sequence`], in the session that the answer bears. After a reset any number of the new session is accepted, but steps are refused until a state comes: a module that lost its state says so instead of flying on with defaults.
//!
//! **Pace.** At the host's pace each input is a step. At the clock's pace the endpoint runs one step a period with
//! the newest input; where none has come it runs the step with missing readings, and where the module is not back
//! in time it says so ([`Tick::overrun`], [`Tick::skipped`]). It holds no clock: times are microseconds since start,
//! from the caller.
use schuler_core::module::{FlightModule, StateLoader, StepInput};

use crate::frame::{Decoder, Frame, FrameError, ShortWire, on_the_wire};
use crate::message::{
    Banner, Board, Counters, HeardMessage, Identity, MAX_ANSWER, ModuleMessage, Pace, Refusal, STATE_PART,
    Start, StateBytes, Tick, Transport,
};

/// What the module says is shorter than what it is told.
type Answer = ShortWire<{ on_the_wire(MAX_ANSWER) }>;

/// Longest period of the clock's pace, ms.
const MAX_PERIOD_MS: u32 = 60_000;

/// What is to be done after a byte has been taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaction<'a> {
    /// Nothing.
    None,
    /// Send these bytes.
    Send(&'a [u8]),
    /// Reset the processor.
    Reset,
}

/// The module's side of the link. Fixed memory; never panics.
#[derive(Debug)]
pub struct Endpoint {
    decoder: Decoder,
    conversation: Conversation,
}

/// What it has heard and said. It stands beside the decoder, in which a message lies while it is carried out.
#[derive(Debug)]
struct Conversation {
    identity: Identity,
    /// The session; zero until it begins, and for good where there are no starts to tell apart.
    session: u64,
    last: Option<Accepted>,
    /// Answer to the last command; empty while there is none.
    answer: Answer,
    /// Frame of a question, a refusal or a tick.
    passing: Answer,
    configured: bool,
    /// Time of the last step, as the module was told: the base for a step without input, milliseconds.
    time_ms: u64,
    pace: Stepping,
    /// Of a saved state that comes in parts.
    loader: StateLoader,
    counters: Counters,
}

/// What makes the module take a step.
///
/// The tag stands by itself, so that an endpoint at the host's pace is all zeros and a static one costs no flash.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
#[allow(clippy::large_enum_variant)] // No heap to box it in.
enum Stepping {
    Host,
    Clock(ClockPace),
}

impl Stepping {
    fn clock(&mut self) -> Option<&mut ClockPace> {
        match self {
            Self::Host => None,
            Self::Clock(clock) => Some(clock),
        }
    }
}

/// The last command accepted.
#[derive(Clone, Copy, Debug)]
struct Accepted {
    sequence: u32,
    checksum: u32,
}

/// The clock's pace.
#[derive(Clone, Copy, Debug)]
struct ClockPace {
    period_ms: u32,
    /// When the next tick is due.
    due_us: u64,
    /// The newest input since the last tick.
    input: Option<StepInput>,
}

impl Endpoint {
    /// An endpoint that has heard nothing yet; a constant, so that it can live in a static.
    pub const fn new(identity: Identity) -> Self {
        let conversation = Conversation {
            identity,
            session: 0,
            last: None,
            answer: Answer::new(),
            passing: Answer::new(),
            configured: false,
            time_ms: 0,
            pace: Stepping::Host,
            loader: StateLoader::new(),
            counters: Counters::NONE,
        };
        Self { decoder: Decoder::new(), conversation }
    }

    /// An endpoint of nothing but zeros, which as a static costs no flash; to be [identified](Self::identify) before it
    /// speaks.
    pub const fn unidentified() -> Self {
        Self::new(Identity {
            board: Board::Host,
            transport: Transport::Memory,
            start: Start::PowerOn,
            boots: 0,
        })
    }

    /// Says who is there and why; known only after the start.
    pub fn identify(&mut self, identity: Identity) {
        self.conversation.identity = identity;
    }

    /// Takes up a module that has been configured, or brought back, by somebody else than the host.
    pub fn take_up(&mut self, module: &mut FlightModule) {
        self.conversation.take_up(module);
    }

    /// The frame to be sent once after a start, when the line is up.
    pub fn banner(&mut self) -> &[u8] {
        self.conversation.banner()
    }

    /// Takes the next byte from the line. `now_us` reads the clock.
    pub fn receive(
        &mut self,
        byte: u8,
        module: &mut FlightModule,
        now_us: impl FnMut() -> u64,
    ) -> Reaction<'_> {
        match &decode(&mut self.decoder, byte) {
            Some(Ok(frame)) => self.conversation.take(frame, module, now_us),
            Some(Err(error)) => self.conversation.refuse(*error),
            None => Reaction::None,
        }
    }

    /// At the clock's pace, runs the step that is due. Call often; `Some` is the frame to be sent.
    pub fn tick(&mut self, module: &mut FlightModule, now_us: impl FnMut() -> u64) -> Option<&[u8]> {
        self.conversation.tick(module, now_us)
    }

    /// Bytes were lost on the way from the line to [`receive`](Self::receive).
    pub fn count_lost_bytes(&mut self, bytes: u32) {
        let lost_bytes = &mut self.conversation.counters.lost_bytes;
        *lost_bytes = lost_bytes.saturating_add(bytes);
    }

    /// How it has gone.
    pub fn counters(&self) -> Counters {
        self.conversation.counters
    }

    /// What makes the module take a step.
    pub fn pace(&self) -> Pace {
        match &self.conversation.pace {
            Stepping::Host => Pace::Host,
            Stepping::Clock(clock) => Pace::Clock { period_ms: clock.period_ms },
        }
    }
}

// Not generic, so that what reads a message is compiled with this crate, for size.
#[inline(never)]
fn decode(decoder: &mut Decoder, byte: u8) -> Option<Result<Frame<HeardMessage<'_>>, FrameError>> {
    decoder.push(byte)
}

impl Conversation {
    fn banner(&mut self) -> &[u8] {
        let message = self.banner_message();
        write(&mut self.passing, 0, &message);
        self.passing.as_bytes()
    }

    /// A host of another version is to learn whom it speaks to; everything else may be noise, and gets no answer.
    fn refuse(&mut self, error: FrameError) -> Reaction<'_> {
        self.counters.refused.count(error);
        match error {
            FrameError::Version(_) => Reaction::Send(self.banner()),
            _ => Reaction::None,
        }
    }

    #[inline(never)]
    fn tick(&mut self, module: &mut FlightModule, mut now_us: impl FnMut() -> u64) -> Option<&[u8]> {
        let pace = self.pace.clock()?;
        let begin_us = now_us();
        // Division of long integers takes a kilobyte: who is more than an hour late catches up in more than one tick.
        let late_us = clip(begin_us.checked_sub(pace.due_us)?);
        let period_us = pace.period_ms.saturating_mul(1000);
        let skipped = late_us.checked_div(period_us)?;
        // No later than now, but the next one may be beyond the end of the clock.
        let due_us = pace.due_us + u64::from(skipped * period_us);
        pace.due_us = due_us.saturating_add(u64::from(period_us));

        let fresh = pace.input.is_some();
        let input = pace.input.take().unwrap_or_else(|| {
            let passed_ms = (1 + u64::from(skipped)) * u64::from(pace.period_ms);
            StepInput::without_readings(self.time_ms.saturating_add(passed_ms))
        });
        self.time_ms = input.time_ms;
        let next_us = pace.due_us;

        let output = module.step(&input);
        let end_us = now_us();
        let overrun = end_us >= next_us;
        let step_us = clip(end_us.saturating_sub(begin_us));
        self.count_step(step_us);
        let counters = &mut self.counters;
        counters.missing_inputs = counters.missing_inputs.saturating_add(u32::from(!fresh));
        counters.overruns = counters.overruns.saturating_add(u32::from(overrun));
        counters.skipped_ticks = counters.skipped_ticks.saturating_add(skipped);

        let late_us = clip(begin_us.saturating_sub(due_us));
        let tick = Tick { output, fresh, skipped, overrun, due_us, late_us, step_us };
        let sequence = self.last.map_or(0, |last| last.sequence);
        write(&mut self.passing, sequence, &ModuleMessage::Tick(tick));
        Some(self.passing.as_bytes())
    }

    // These stand by themselves: a message is large, and what one of them needs of the stack the others have no use for.
    #[inline(never)]
    fn take(
        &mut self,
        frame: &Frame<HeardMessage<'_>>,
        module: &mut FlightModule,
        mut now_us: impl FnMut() -> u64,
    ) -> Reaction<'_> {
        let Frame { session, sequence, checksum, message } = frame;
        self.counters.frames = self.counters.frames.saturating_add(1);
        if let HeardMessage::Hello = message {
            self.begin_session(*session, now_us());
        }
        match message {
            HeardMessage::Hello | HeardMessage::Counters => return self.introduce(*sequence, message),
            HeardMessage::ReadState { begin } => return self.pass_state(*sequence, *begin, module),
            _ => (),
        }
        let begun = self.session != 0 || self.identity.boots == 0;
        if *session != self.session || !begun {
            self.counters.stale = self.counters.stale.saturating_add(1);
            return self.pass_refusal(*sequence, Refusal::Session);
        }
        if let Some(last) = self.last {
            match sequence.wrapping_sub(last.sequence) {
                0 if *checksum == last.checksum => {
                    self.counters.repeated = self.counters.repeated.saturating_add(1);
                    return send(&self.answer);
                }
                0 => {
                    self.counters.conflicts = self.counters.conflicts.saturating_add(1);
                    return self.pass_refusal(*sequence, Refusal::Conflict);
                }
                1..0x8000_0000 => (),
                _ => {
                    self.counters.stale = self.counters.stale.saturating_add(1);
                    return self.pass_refusal(*sequence, Refusal::Stale { last_sequence: last.sequence });
                }
            }
        }
        self.last = Some(Accepted { sequence: *sequence, checksum: *checksum });
        self.answer.clear();
        if let HeardMessage::Reset = message {
            return Reaction::Reset;
        }
        if let Some(answer) = self.carry_out(message, module, now_us) {
            write(&mut self.answer, *sequence, &answer);
        }
        send(&self.answer)
    }

    /// Begins the session, if there is none; `offered`: the host's number.
    fn begin_session(&mut self, offered: u64, now_us: u64) {
        if self.session != 0 || self.identity.boots == 0 {
            return;
        }
        let own = u64::from(self.identity.boots) << 32 | now_us & 0xffff_ffff;
        self.session = (own ^ offered).max(1);
        self.answer.seal_with(self.session);
        self.passing.seal_with(self.session);
    }

    /// Carries out a command; `None` for an input that waits for its tick.
    #[inline(never)]
    fn carry_out(
        &mut self,
        message: &HeardMessage<'_>,
        module: &mut FlightModule,
        mut now_us: impl FnMut() -> u64,
    ) -> Option<ModuleMessage> {
        Some(match message {
            HeardMessage::Step(_) | HeardMessage::SetPace(_) if !self.configured => {
                ModuleMessage::Refused(Refusal::NotConfigured)
            }
            HeardMessage::Forget => {
                module.forget();
                self.take_up(module);
                ModuleMessage::Forgotten
            }
            HeardMessage::LoadState { begin, bytes } => self.load_state(*begin, bytes, module),
            HeardMessage::Step(input) => {
                if let Some(clock) = self.pace.clock() {
                    let superseded = clock.input.replace(*input).is_some();
                    self.counters.superseded_inputs =
                        self.counters.superseded_inputs.saturating_add(u32::from(superseded));
                    return None;
                }
                self.time_ms = input.time_ms;
                let begin_us = now_us();
                let output = module.step(input);
                self.count_step(clip(now_us().saturating_sub(begin_us)));
                ModuleMessage::Output(output)
            }
            HeardMessage::SetPace(pace) => self.set_pace(*pace, now_us()),
            HeardMessage::Hello
            | HeardMessage::Counters
            | HeardMessage::ReadState { .. }
            | HeardMessage::Reset => return None,
        })
    }

    /// Answers with a part of the state.
    #[inline(never)]
    fn pass_state(&mut self, sequence: u32, begin: u32, module: &mut FlightModule) -> Reaction<'_> {
        let mut bytes = StateBytes::new();
        // It fits.
        let _ = bytes.resize(STATE_PART, 0);
        let part = module.state_length().and_then(|length| {
            let written = module.save_part(begin, &mut bytes)?;
            bytes.truncate(written);
            Ok(ModuleMessage::State { begin, length, step: module.steps(), bytes })
        });
        let message = part.unwrap_or_else(|error| ModuleMessage::Refused(Refusal::State(error)));
        self.pass(sequence, &message)
    }

    /// Takes a part of a saved state. While the module is not whole, it counts as not configured.
    #[inline(never)]
    fn load_state(&mut self, begin: u32, bytes: &[u8], module: &mut FlightModule) -> ModuleMessage {
        let result = self.loader.take(module, begin, bytes);
        let length = module.state_length();
        let complete = length.is_ok() && length == result;
        if complete {
            self.counters.states = self.counters.states.saturating_add(1);
        }
        // A part that was refused without any change leaves everything as it is.
        if complete || length.is_err() {
            self.take_up(module);
        }
        match result {
            Ok(next) => ModuleMessage::StateTaken { next },
            Err(error) => ModuleMessage::Refused(Refusal::State(error)),
        }
    }

    /// At the host's pace, with what the module has, if it has anything.
    fn take_up(&mut self, module: &mut FlightModule) {
        self.configured = module.state_length().is_ok();
        self.time_ms = module.last_time_ms().unwrap_or(0);
        self.pace = Stepping::Host;
        self.counters.compensation = module.compensation_name();
    }

    fn set_pace(&mut self, pace: Pace, now_us: u64) -> ModuleMessage {
        self.pace = match pace {
            Pace::Host => Stepping::Host,
            Pace::Clock { period_ms } => {
                let possible = self.identity.transport != Transport::Semihosting;
                if !(possible && (1..=MAX_PERIOD_MS).contains(&period_ms)) {
                    return ModuleMessage::Refused(Refusal::Pace);
                }
                let due_us = now_us.saturating_add(u64::from(period_ms) * 1000);
                Stepping::Clock(ClockPace { period_ms, due_us, input: None })
            }
        };
        ModuleMessage::PaceSet(pace)
    }

    /// Who is there, or how it has gone.
    #[inline(never)]
    fn introduce(&mut self, sequence: u32, question: &HeardMessage<'_>) -> Reaction<'_> {
        let message = match question {
            HeardMessage::Counters => ModuleMessage::Counters(self.counters),
            _ => self.banner_message(),
        };
        self.pass(sequence, &message)
    }

    #[inline(never)]
    fn pass_refusal(&mut self, sequence: u32, refusal: Refusal) -> Reaction<'_> {
        self.pass(sequence, &ModuleMessage::Refused(refusal))
    }

    /// A frame that is not kept.
    fn pass(&mut self, sequence: u32, message: &ModuleMessage) -> Reaction<'_> {
        write(&mut self.passing, sequence, message);
        send(&self.passing)
    }

    fn banner_message(&self) -> ModuleMessage {
        ModuleMessage::Banner(Banner {
            last_sequence: self.last.map(|last| last.sequence),
            configured: self.configured,
            ..Banner::new(self.identity)
        })
    }

    fn count_step(&mut self, step_us: u32) {
        self.counters.steps = self.counters.steps.saturating_add(1);
        self.counters.longest_step_us = self.counters.longest_step_us.max(step_us);
    }
}

fn send(wire: &Answer) -> Reaction<'_> {
    match wire.as_bytes() {
        [] => Reaction::None,
        frame => Reaction::Send(frame),
    }
}

/// Writes the frame; where it does not fit, a frame that says so.
fn write(wire: &mut Answer, sequence: u32, message: &ModuleMessage) {
    if wire.encode(sequence, message).is_err() {
        write_too_long(wire, sequence);
    }
}

// By itself, so that there is one message on the stack at a time.
#[inline(never)]
fn write_too_long(wire: &mut Answer, sequence: u32) {
    // A refusal is short: it fits.
    let _ = wire.encode(sequence, &ModuleMessage::Refused(Refusal::AnswerTooLong));
}

fn clip(value: u64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
