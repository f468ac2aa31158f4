//! What host and module can say to each other.
use core::fmt;

use heapless::{String, Vec};
use schuler_core::module::{StateError, StepInput, StepOutput};
use serde::{Deserialize, Serialize};

use crate::frame::{FrameError, MAX_MESSAGE, Message};
use crate::{PROTOCOL, SOURCE_HASH, VERSION};

/// Longest part of a saved state in one message, bytes. No longer than a step's output: a message takes no more memory for it.
pub const STATE_PART: usize = 512;

/// A part of a saved state.
pub type StateBytes = Vec<u8, STATE_PART>;

/// What the host says, with bytes of its own.
pub type HostMessage = HostMessageOf<StateBytes>;

/// The same as the module hears it: its bytes stay where the decoder has put them.
pub type HeardMessage<'a> = HostMessageOf<&'a [u8]>;

/// From the host to the module. `S` holds the bytes of a part of a saved state.
///
/// [`Hello`](Self::Hello), [`Counters`](Self::Counters) and [`ReadState`](Self::ReadState) are questions: they change nothing and are answered
/// always. The others are commands: each is carried out at most once (see [`crate::endpoint`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // No heap to box it in.
pub enum HostMessageOf<S> {
    /// Who are you? Answered with [`ModuleMessage::Banner`].
    Hello,
    /// How has it gone? Answered with [`ModuleMessage::Counters`].
    Counters,
    /// Forget everything and wait for a state, as after a reset. Answered with [`ModuleMessage::Forgotten`].
    Forget,
    /// The input of a step. At the host's pace it is run at once and answered with [`ModuleMessage::Output`]; at the
    /// clock's pace it waits for the next tick and is not answered by itself.
    Step(StepInput),
    /// Change the pace. Answered with [`ModuleMessage::PaceSet`] or a refusal.
    SetPace(Pace),
    /// Reset the processor. Answered with a new banner.
    Reset,
    /// The part of the module's state ([`schuler_core::module::FlightModule::save_part`]) that begins at this byte. Answered with
    /// [`ModuleMessage::State`] or [`Refusal::State`].
    ReadState {
        /// In bytes from the start of the saved state.
        begin: u32,
    },
    /// Take this part of a saved state ([`schuler_core::module::StateLoader`]): one of before an outage, or one that a computer on the
    /// ground has made from a configuration and a compensation block. A module with another configuration has to
    /// [forget](Self::Forget) it first. Answered with [`ModuleMessage::StateTaken`] or
    /// [`Refusal::State`]. From the first part to the last the module makes no step; then it is at the host's pace.
    LoadState {
        /// Where the part begins, in bytes from the start of the saved state.
        begin: u32,
        /// The part.
        bytes: S,
    },
}

impl<S: Serialize> Message for HostMessageOf<S> {
    const DIRECTION: u8 = b'>';
}

/// From the module to the host.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // No heap to box it in.
pub enum ModuleMessage {
    /// Sent unasked after a reset, and in answer to [`HostMessage::Hello`].
    Banner(Banner),
    /// The counters since the reset.
    Counters(Counters),
    /// The module waits for a state.
    Forgotten,
    /// The result of a step at the host's pace.
    Output(StepOutput),
    /// The pace is in force.
    PaceSet(Pace),
    /// The result of a step at the clock's pace. The frame bears the number of the input used, or of the last command.
    Tick(Tick),
    /// A command was not carried out.
    Refused(Refusal),
    /// A part of the module's state.
    State {
        /// Where it begins, in bytes from the start of the saved state.
        begin: u32,
        /// Length of the whole, bytes.
        length: u32,
        /// Steps of the module so far: parts from before and after a step do not belong together.
        step: u64,
        /// The part; empty behind the last one.
        bytes: StateBytes,
    },
    /// A part of a saved state was taken.
    StateTaken {
        /// Where the next part begins; the length of the whole when this was the last one.
        next: u32,
    },
}

impl Message for ModuleMessage {
    const DIRECTION: u8 = b'<';
}

/// Longest message of the module, bytes; by the rule below.
pub(crate) const MAX_ANSWER: usize = size_of::<ModuleMessage>() * 3 / 2 + TAG;

/// The tag of a message, bytes.
const TAG: usize = 1;

// A field of postcard takes at most one and a half times its size in memory (a u64 as ten bytes, a u16 as three).
// A message that outgrows the frame is to be found here and not in flight. Bytes stay what they are, after their number.
const _: () = assert!(size_of::<StepInput>() * 3 / 2 + TAG <= MAX_MESSAGE);
const _: () = assert!(size_of::<StateBytes>() * 3 / 2 + TAG <= MAX_MESSAGE);
const _: () = assert!(MAX_ANSWER <= MAX_MESSAGE);
const _: () = assert!(size_of::<StateBytes>() <= size_of::<StepOutput>() + 64);

/// What makes the module take a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Pace {
    /// Each input is a step, as fast as they come.
    #[default]
    Host,
    /// The module's own clock: one step a period, with the input that has come since the last one, or with missing readings.
    Clock {
        /// Period, milliseconds; 1 to 60 000.
        period_ms: u32,
    },
}

/// Who the module is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Banner {
    /// Version of the protocol; the same as in every frame.
    pub protocol: u8,
    /// Version of the module.
    pub version: String<16>,
    /// Hash of the sources of the image, [`SOURCE_HASH`].
    pub source_hash: u64,
    /// Where it runs.
    pub board: Board,
    /// Through what it speaks.
    pub transport: Transport,
    /// Why it started.
    pub start: Start,
    /// Number of the last command accepted since the start. A host goes on from here.
    pub last_sequence: Option<u32>,
    /// It has been configured since the start.
    pub configured: bool,
}

impl Banner {
    /// The banner of a module that has just started.
    pub fn new(identity: Identity) -> Self {
        Self {
            protocol: PROTOCOL,
            version: VERSION.try_into().unwrap_or_default(),
            source_hash: SOURCE_HASH,
            board: identity.board,
            transport: identity.transport,
            start: identity.start,
            last_sequence: None,
            configured: false,
        }
    }
}

/// The part of the banner that only the board knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Where it runs.
    pub board: Board,
    /// Through what it speaks.
    pub transport: Transport,
    /// Why it started.
    pub start: Start,
    /// Number of this start, from one; zero for a module that has no resets, in whose frames there are no sessions.
    pub boots: u32,
}

/// Where a module runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Board {
    /// In the host's own process.
    Host,
    /// Arm MPS2 with image AN386 (Cortex-M4F), emulated.
    Mps2An386,
    /// STM32F405 (Cortex-M4F).
    Stm32f405,
}

impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Board::Host => "host",
            Board::Mps2An386 => "mps2-an386",
            Board::Stm32f405 => "stm32f405",
        })
    }
}

/// Through what a module speaks to its host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Transport {
    /// Calls in one process.
    Memory,
    /// A serial line.
    Uart,
    /// Semihosting reads and writes of the emulator; host's pace only.
    Semihosting,
}

/// Why a module started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Start {
    /// Power came on.
    PowerOn,
    /// [`HostMessage::Reset`].
    Command,
    /// A panic.
    Panic,
    /// A fault of the processor.
    Fault,
    /// Without notice: the watchdog, a lock-up or the reset pin.
    Watchdog,
}

/// Why a command was not carried out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // No heap to box it in.
pub enum Refusal {
    /// The state can be neither read nor loaded.
    State(StateError),
    /// A step or a pace before any state: after a reset the module does not fly on with defaults.
    NotConfigured,
    /// The command's number is behind the last one: it came late, and its turn has passed.
    Stale {
        /// Number of the last command accepted.
        last_sequence: u32,
    },
    /// The command is of another session: from before a reset, or of a host that has not asked
    /// [`Hello`](HostMessageOf::Hello) since. This frame bears the session in force; zero while there is none.
    Session,
    /// The command bears the number of the last one and says something else.
    Conflict,
    /// The period is out of range, or this transport has no clock's pace.
    Pace,
    /// The answer did not fit into a frame. The command was carried out.
    AnswerTooLong,
}

/// A step at the clock's pace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// What the module gave back.
    pub output: StepOutput,
    /// An input had come since the last tick; without, the step was made with missing readings.
    pub fresh: bool,
    /// Ticks before this one that were not run because the module was not back in time.
    pub skipped: u32,
    /// The step ended after the next tick was due.
    pub overrun: bool,
    /// When the tick was due, on the module's clock since start, microseconds.
    pub due_us: u64,
    /// From due to the start of the step, microseconds.
    pub late_us: u32,
    /// Duration of the step, microseconds.
    pub step_us: u32,
}

/// How it has gone since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Frames that arrived whole.
    pub frames: u32,
    /// Frames that were refused.
    pub refused: RefusedFrames,
    /// Bytes that came faster than they were taken.
    pub lost_bytes: u32,
    /// Commands that came again and got the stored answer.
    pub repeated: u32,
    /// Commands that came late, or from another session, and were refused.
    pub stale: u32,
    /// Commands with a number in use and another content.
    pub conflicts: u32,
    /// States that were brought back.
    pub states: u32,
    /// Checksum of the compensation block in force.
    pub compensation: Option<u32>,
    /// Steps run, at either pace.
    pub steps: u32,
    /// Clock's pace: ticks without input.
    pub missing_inputs: u32,
    /// Clock's pace: inputs that were replaced by a newer one before their tick.
    pub superseded_inputs: u32,
    /// Clock's pace: steps that ended after the next tick was due.
    pub overruns: u32,
    /// Clock's pace: ticks that were not run.
    pub skipped_ticks: u32,
    /// Longest step, microseconds.
    pub longest_step_us: u32,
}

impl Counters {
    /// Nothing yet.
    pub const NONE: Self = Self {
        frames: 0,
        refused: RefusedFrames::NONE,
        lost_bytes: 0,
        repeated: 0,
        stale: 0,
        conflicts: 0,
        states: 0,
        compensation: None,
        steps: 0,
        missing_inputs: 0,
        superseded_inputs: 0,
        overruns: 0,
        skipped_ticks: 0,
        longest_step_us: 0,
    };
}

/// Refused frames by reason. The counters stop at their end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusedFrames {
    /// Longer than the longest frame.
    pub too_long: u32,
    /// Not COBS.
    pub encoding: u32,
    /// Shorter than the shortest frame.
    pub too_short: u32,
    /// Wrong checksum.
    pub checksum: u32,
    /// Not from the other side of this link.
    pub direction: u32,
    /// Of another version of the protocol.
    pub version: u32,
    /// Sound, and not a message of this protocol.
    pub content: u32,
}

impl RefusedFrames {
    /// None yet.
    pub const NONE: Self =
        Self { too_long: 0, encoding: 0, too_short: 0, checksum: 0, direction: 0, version: 0, content: 0 };

    /// All of them.
    pub fn total(&self) -> u32 {
        [
            self.too_long,
            self.encoding,
            self.too_short,
            self.checksum,
            self.direction,
            self.version,
            self.content,
        ]
        .into_iter()
        .fold(0, u32::saturating_add)
    }

    /// One more.
    pub fn count(&mut self, error: FrameError) {
        let counter = match error {
            FrameError::TooLong => &mut self.too_long,
            FrameError::Encoding => &mut self.encoding,
            FrameError::TooShort => &mut self.too_short,
            FrameError::Checksum => &mut self.checksum,
            FrameError::Direction(_) => &mut self.direction,
            FrameError::Version(_) => &mut self.version,
            FrameError::Content => &mut self.content,
        };
        *counter = counter.saturating_add(1);
    }
}
