//! The flight module on the emulated target, behind the same interface as the module in this process.
//!
//! [`Emulator::start`] builds the image, starts QEMU on it and waits for its banner. The line to the module is QEMU's
//! own standard input and output: either the emulated serial port ([`Transport::Uart`], the link as it flies, some
//! hundred steps a second) or semihosting ([`Transport::Fifo`], some ten thousand). QEMU ends when the [`Emulator`] is
//! dropped.
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use std::{fs, thread};

use schuler_core::module::StepInput;
use schuler_link::SOURCE_HASH;
use schuler_link::frame::{Decoder, Wire};
use schuler_link::message::Banner;
use session::fresh_offer;

pub use image::{Image, build};
pub use run::Run;
pub use target::{HostModule, Target, TargetError};

mod as_target;
mod image;
mod run;
mod session;
mod target;

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

/// Why QEMU was not run.
fn not_run(error: std::io::Error) -> TargetError {
    match error.kind() {
        std::io::ErrorKind::NotFound => TargetError::MissingTool {
            program: QEMU.to_owned(),
            advice: "Debian and Ubuntu: apt-get install qemu-system-arm",
        },
        _ => TargetError::Run(error),
    }
}

impl Emulator {
    /// Builds the image for the transport, starts it, and checks that it was built from the same sources as this program.
    ///
    /// # Errors
    /// QEMU or the compiler is missing, the image does not build, or does not come up.
    pub fn start(transport: Transport) -> Result<Self, TargetError> {
        // Before the image is built, which takes a minute.
        let mut version = Command::new(QEMU);
        version.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        version.status().map_err(not_run)?;
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
        let mut child = command.spawn().map_err(not_run)?;

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

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have ended already; then there is nothing to end.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
