//! The flight module on the emulated target, behind the same interface as the module in this process.
//!
//! [`Emulator::start`] builds the image, starts QEMU on it and waits for its banner. The line to the module is QEMU's
//! own standard input and output: either the emulated serial port ([`Transport::Uart`], the link as it flies, some
//! hundred steps a second) or semihosting ([`Transport::Fifo`], some ten thousand). QEMU ends when the [`Emulator`] is
//! dropped.
use std::fs;
use std::hash::{BuildHasher, RandomState};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use schuler_core::config::ConfigError;
use schuler_core::module::{FlightModule, ModuleConfig, StateError, StepInput, StepOutput};
use schuler_link::SOURCE_HASH;
use schuler_link::block::{self, BlockBytes, BlockError};
use schuler_link::frame::{Decoder, Frame, FrameError, Wire};
use schuler_link::message::{
    Banner, Counters, HostMessage, ModuleMessage, Pace, Refusal, STATE_PART, StateBytes,
};

pub use image::{Image, build};

mod image;

/// Before a command is sent again. An emulator on a busy machine stands still for seconds.
const PATIENCE: Duration = Duration::from_secs(5);
/// Before a module counts as silent. On a machine with twenty other things to do an emulator takes more than half a minute to
/// start.
const GIVE_UP: Duration = Duration::from_mins(3);

/// Inputs on their way at a time. They must fit into what lies between: a pipe of 64 kB, the module's receive queue of
/// 4 kB.
const PIPE_WINDOW: usize = 128;
const SERIAL_WINDOW: usize = 4;

/// An input is no longer on the wire: fields of postcard at one and a half times their size in memory, header, checksum,
/// COBS and borders.
const LONGEST_INPUT: usize = size_of::<StepInput>() * 3 / 2 + 28;
const _: () = assert!(PIPE_WINDOW * LONGEST_INPUT <= 1 << 16);
const _: () = assert!(SERIAL_WINDOW * LONGEST_INPUT <= 4096);

/// Number of the question who is there: its answer is told from the banner of a restart, which bears 0.
const HELLO: u32 = u32::MAX;

/// The machine that runs the module.
pub const QEMU: &str = "qemu-system-arm";

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

/// The line between this process and the emulated module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// The emulated serial port: the link as it flies.
    Uart,
    /// Semihosting on a pair of pipes: for long runs.
    Fifo,
}

/// Does something to the bytes on their way, in one direction of the line.
pub type Disturbance = Box<dyn FnMut(&[u8]) -> Vec<u8> + Send>;

/// QEMU with an image, and the line to the module in it.
pub struct Emulator {
    child: Child,
    to_module: Option<ChildStdin>,
    from_module: Receiver<Vec<u8>>,
    /// Received and not yet looked at.
    pending: std::vec::IntoIter<u8>,
    decoder: Decoder,
    wire: Box<Wire>,
    /// Frames not yet handed to the system.
    outbox: Vec<u8>,
    sequence: u32,
    /// The session that the module has begun; zero while there is none.
    session: u64,
    /// What is offered to begin the next one.
    offer: u64,
    banner: Banner,
    complaints: Arc<Mutex<String>>,
    image: PathBuf,
    log: tempfile::TempPath,
    window: usize,
    patience: Duration,
    disturb_outgoing: Option<Disturbance>,
    disturb_incoming: Option<Disturbance>,
}

impl Emulator {
    /// Builds the image for the transport, starts it, and checks that it was built from the same sources as this program.
    ///
    /// # Errors
    /// QEMU or the compiler is missing, the image does not build, or does not come up.
    pub fn start(transport: Transport) -> Result<Self, TargetError> {
        let image = match transport {
            Transport::Uart => Image::Serial,
            Transport::Fifo => Image::Semihosting,
        };
        let emulator = Self::start_image(image, &build(image)?)?;
        match emulator.banner.source_hash {
            SOURCE_HASH => Ok(emulator),
            other => Err(TargetError::OtherSources { image: other, host: SOURCE_HASH }),
        }
    }

    /// Starts an image that is there.
    ///
    /// # Errors
    /// QEMU is missing, or the image does not come up.
    pub fn start_image(kind: Image, elf: &Path) -> Result<Self, TargetError> {
        Self::launch(kind, elf, &[])?.wait_for_banner()
    }

    /// Waits until the module says who it is.
    ///
    /// # Errors
    /// It does not.
    pub fn wait_for_banner(mut self) -> Result<Self, TargetError> {
        self.greet(PATIENCE)?;
        Ok(self)
    }

    /// Waits for a session: says hello where the module has started and nobody has yet. `patience`: before it is said without
    /// that the module has been heard.
    fn greet(&mut self, patience: Duration) -> Result<(), TargetError> {
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

    /// Starts an image without waiting for its banner, with further options for QEMU.
    ///
    /// # Errors
    /// QEMU is missing or cannot be run.
    pub fn launch(kind: Image, elf: &Path, options: &[&str]) -> Result<Self, TargetError> {
        let log = tempfile::Builder::new()
            .prefix("schuler-log-")
            .tempfile()
            .map_err(TargetError::Run)?
            .into_temp_path();
        let mut command = Command::new(QEMU);
        command.args([
            "-machine",
            kind.machine(),
            "-display",
            "none",
            "-monitor",
            "none",
            "-parallel",
            "none",
        ]);
        command.arg("-kernel").arg(elf);
        if kind.has_semihosting() {
            command.args(["-semihosting-config", "enable=on,target=native", "-serial", "null"]);
        } else {
            command.args(["-chardev", "stdio,id=link,signal=off", "-serial", "chardev:link"]);
        }
        command.args(["-serial", &format!("file:{}", log.display())]);
        command.args(options);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => TargetError::MissingTool {
                program: QEMU.to_owned(),
                advice: "Debian and Ubuntu: apt-get install qemu-system-arm",
            },
            _ => TargetError::Run(error),
        })?;

        let (sender, from_module) = channel();
        let complaints = Arc::new(Mutex::new(String::new()));
        if let Some(mut output) = child.stdout.take() {
            thread::spawn(move || {
                let mut buffer = vec![0; 1 << 16];
                while let Ok(count @ 1..) = output.read(&mut buffer) {
                    if sender.send(buffer[..count].to_vec()).is_err() {
                        break;
                    }
                }
            });
        }
        if let Some(mut errors) = child.stderr.take() {
            let complaints = Arc::clone(&complaints);
            thread::spawn(move || {
                let mut buffer = [0; 4096];
                while let Ok(count @ 1..) = errors.read(&mut buffer) {
                    if let Ok(mut text) = complaints.lock() {
                        text.push_str(&String::from_utf8_lossy(&buffer[..count]));
                    }
                }
            });
        }
        Ok(Self {
            to_module: child.stdin.take(),
            child,
            from_module,
            pending: Vec::new().into_iter(),
            decoder: Decoder::new(),
            wire: Box::new(Wire::new()),
            outbox: Vec::new(),
            sequence: 0,
            session: 0,
            offer: fresh_offer(),
            banner: Banner::new(kind.identity()),
            complaints,
            image: elf.to_owned(),
            log,
            window: if kind == Image::Semihosting { PIPE_WINDOW } else { SERIAL_WINDOW },
            patience: PATIENCE,
            disturb_outgoing: None,
            disturb_incoming: None,
        })
    }

    /// Who is there.
    pub fn banner(&self) -> &Banner {
        &self.banner
    }

    /// The image that runs; it holds the texts of the log.
    pub fn image(&self) -> &Path {
        &self.image
    }

    /// What has been logged so far: defmt frames in rzCOBS, to be decoded with [`image`](Self::image).
    ///
    /// # Errors
    /// The file in which QEMU collects it cannot be read.
    pub fn log(&self) -> std::io::Result<Vec<u8>> {
        fs::read(&self.log)
    }

    /// How long to wait for an answer before a command is sent again.
    pub fn set_patience(&mut self, patience: Duration) {
        self.patience = patience;
    }

    /// Disturbs the line from now on: frames to the module one by one, bytes from the module as they come.
    pub fn disturb(&mut self, outgoing: Disturbance, incoming: Disturbance) {
        self.disturb_outgoing = Some(outgoing);
        self.disturb_incoming = Some(incoming);
    }

    /// Leaves the line alone again.
    pub fn leave_alone(&mut self) {
        self.disturb_outgoing = None;
        self.disturb_incoming = None;
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

    /// Closes the line and waits for the emulator to end by itself; a semihosting image does then. Returns whether it
    /// ended well, and what it logged.
    ///
    /// # Errors
    /// It did not end, or its log cannot be read.
    pub fn finish(mut self) -> Result<(bool, Vec<u8>), TargetError> {
        self.flush()?;
        drop(self.to_module.take());
        let deadline = Instant::now() + GIVE_UP;
        loop {
            if let Some(status) = self.child.try_wait().map_err(TargetError::Run)? {
                return Ok((status.success(), self.log().map_err(TargetError::Run)?));
            }
            if Instant::now() > deadline {
                return Err(TargetError::Silent(GIVE_UP));
            }
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Sends a command until its answer comes: the module carries it out once, however often it hears it.
    fn command(&mut self, message: &HostMessage) -> Result<ModuleMessage, TargetError> {
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
    fn be_in_session(&mut self) -> Result<(), TargetError> {
        if self.session == 0 { self.greet(Duration::ZERO) } else { Ok(()) }
    }

    fn leave_session(&mut self) {
        self.session = 0;
        self.offer = fresh_offer();
    }

    fn exchange(&mut self, sequence: u32, message: &HostMessage) -> Result<ModuleMessage, TargetError> {
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

    fn send(&mut self, sequence: u32, message: &HostMessage) -> Result<(), TargetError> {
        self.put(sequence, message);
        self.flush()
    }

    fn put(&mut self, sequence: u32, message: &HostMessage) {
        // Every message of the host fits; the crate asserts it.
        if self.wire.encode(sequence, message).is_ok() {
            match &mut self.disturb_outgoing {
                Some(disturb) => self.outbox.extend(disturb(self.wire.as_bytes())),
                None => self.outbox.extend_from_slice(self.wire.as_bytes()),
            }
        }
    }

    fn flush(&mut self) -> Result<(), TargetError> {
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

    fn restarted(&mut self, banner: Banner) -> TargetError {
        self.resume_after(&banner);
        self.leave_session();
        let text = format!("that it has restarted ({:?})", banner.start);
        self.banner = banner;
        TargetError::Unexpected(text)
    }

    /// QEMU has closed the line: why.
    fn ended(&mut self) -> TargetError {
        // It closes its output a moment before it is gone.
        let deadline = Instant::now() + PATIENCE;
        let status = loop {
            match self.child.try_wait() {
                Ok(Some(status)) => break status.to_string(),
                Ok(None) if Instant::now() < deadline => thread::sleep(Duration::from_millis(5)),
                _ => break "its output is closed".to_owned(),
            }
        };
        let complaint = self.complaints.lock().ok().and_then(|text| text.lines().next().map(str::to_owned));
        TargetError::Ended(complaint.map_or_else(|| status.clone(), |text| format!("{status}: {text}")))
    }
}

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

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have ended already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
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

/// Of no other session than this one, if there is one; who is there is always heard.
fn is_of(session: u64, frame: &Frame<ModuleMessage>) -> bool {
    let introduces = matches!(frame.message, ModuleMessage::Banner(_));
    introduces || session == 0 || frame.session == session
}

/// Another number each time: hashers are seeded at random.
fn fresh_offer() -> u64 {
    RandomState::new().hash_one(std::process::id())
}

fn unexpected(message: ModuleMessage) -> TargetError {
    match message {
        ModuleMessage::Refused(Refusal::State(error)) => TargetError::State(error),
        ModuleMessage::Refused(refusal) => TargetError::Refused(Box::new(refusal)),
        other => TargetError::Unexpected(format!("{other:?}")),
    }
}
