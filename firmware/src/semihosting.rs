//! The main loop on the emulator's standard input and output, through semihosting (Arm IHI 0057): some fifty times as
//! fast as the emulated serial line, for runs of days. Not for silicon, where a semihosting call faults.
#![allow(unsafe_code)]
use core::arch::asm;
use core::fmt;

use cortex_m::singleton;
use heapless::Vec;
use schuler_core::module::FlightModule;
use schuler_link::endpoint::{Endpoint, Reaction};
use schuler_link::message::{Identity, Start, Transport};

use crate::{board, log, start, time};

/// Who speaks here.
pub const IDENTITY: Identity =
    Identity { board: board::BOARD, transport: Transport::Semihosting, start: Start::PowerOn, boots: 0 };

const OPEN: usize = 0x01;
const WRITE: usize = 0x05;
const READ: usize = 0x06;
const EXIT: usize = 0x18;
const MODE_READ: usize = 1;
const MODE_WRITE: usize = 5;
const APPLICATION_EXIT: usize = 0x2_0026;

const INPUT: &core::ffi::CStr = c"/dev/stdin";
const OUTPUT: &core::ffi::CStr = c"/dev/stdout";

/// Serves the host until it closes the line.
pub fn run(endpoint: &mut Endpoint, module: &mut FlightModule) -> ! {
    let (Some(input), Some(output)) = (open(INPUT, MODE_READ), open(OUTPUT, MODE_WRITE)) else {
        defmt::panic!("the emulator does not open its standard input and output");
    };
    // Not on the stack, which is as small as on the board.
    let (Some(queue), Some(bytes)) =
        (singleton!(: Vec<u8, 8192> = Vec::new()), singleton!(: [u8; 4096] = [0; 4096]))
    else {
        defmt::panic!("the main loop is entered once");
    };
    let mut answers = Answers { bytes: queue, output };
    answers.push(endpoint.banner());
    loop {
        answers.flush();
        log::drain();
        let received = read(input, bytes);
        if received.is_empty() {
            defmt::info!("the host has closed the line");
            log::flush();
            exit();
        }
        for byte in received {
            match endpoint.receive(*byte, module, time::now_us) {
                Reaction::None => (),
                Reaction::Send(frame) => answers.push(frame),
                Reaction::Reset => {
                    answers.flush();
                    start::restart(Start::Command);
                }
            }
        }
    }
}

/// The emulator's standard output, for images that speak text.
#[derive(Debug)]
pub struct Console {
    output: usize,
}

impl Console {
    /// Opens it; nothing where the emulator does not let it.
    pub fn open() -> Option<Self> {
        open(OUTPUT, MODE_WRITE).map(|output| Self { output })
    }

    /// Writes bytes as they are.
    pub fn send(&mut self, bytes: &[u8]) {
        write(self.output, bytes);
    }
}

/// The emulator's standard input, for images that do not speak the protocol.
#[derive(Debug)]
pub struct Input {
    input: usize,
}

impl Input {
    /// Opens it; nothing where the emulator does not let it.
    pub fn open() -> Option<Self> {
        open(INPUT, MODE_READ).map(|input| Self { input })
    }

    /// Waits for so many bytes; false where the other side closes before.
    pub fn fill(&mut self, bytes: &mut [u8]) -> bool {
        let mut rest = bytes;
        while !rest.is_empty() {
            let received = read(self.input, rest).len();
            if received == 0 {
                return false;
            }
            rest = rest.get_mut(received..).unwrap_or_default();
        }
        true
    }
}

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        write(self.output, text.as_bytes());
        Ok(())
    }
}

/// Frames on their way out: a call into the emulator costs as much as many frames.
struct Answers {
    bytes: &'static mut Vec<u8, 8192>,
    output: usize,
}

impl Answers {
    fn push(&mut self, frame: &[u8]) {
        if self.bytes.extend_from_slice(frame).is_err() {
            self.flush();
            // A frame is shorter than the empty buffer.
            let _ = self.bytes.extend_from_slice(frame);
        }
    }

    fn flush(&mut self) {
        if !self.bytes.is_empty() {
            write(self.output, self.bytes);
            self.bytes.clear();
        }
    }
}

/// Opens a file of the emulator's.
fn open(path: &core::ffi::CStr, mode: usize) -> Option<usize> {
    let arguments = [path.as_ptr() as usize, mode, path.count_bytes()];
    // SAFETY: the block has the fields of SYS_OPEN; the path is only read.
    let handle = unsafe { call(OPEN, arguments.as_ptr() as usize) };
    (handle != usize::MAX).then_some(handle)
}

/// Waits for bytes; none when the other side has closed.
fn read(file: usize, bytes: &mut [u8]) -> &[u8] {
    let arguments = [file, bytes.as_mut_ptr() as usize, bytes.len()];
    // SAFETY: the block has the fields of SYS_READ; the emulator writes into the buffer, within its length.
    let left = unsafe { call(READ, arguments.as_ptr() as usize) };
    bytes.get(..bytes.len().saturating_sub(left)).unwrap_or_default()
}

/// Writes all bytes.
fn write(file: usize, bytes: &[u8]) {
    let mut rest = bytes;
    while !rest.is_empty() {
        let arguments = [file, rest.as_ptr() as usize, rest.len()];
        // SAFETY: the block has the fields of SYS_WRITE; the bytes are only read.
        let left = unsafe { call(WRITE, arguments.as_ptr() as usize) };
        if left >= rest.len() {
            // Nobody reads any more.
            exit();
        }
        rest = rest.get(rest.len() - left..).unwrap_or_default();
    }
}

/// Ends the emulator.
pub fn exit() -> ! {
    loop {
        // SAFETY: on a 32-bit processor SYS_EXIT takes the reason itself.
        unsafe { call(EXIT, APPLICATION_EXIT) };
    }
}

/// Calls into the emulator.
///
/// # Safety
/// `argument` is what `operation` asks for; where it is the address of a block, the block outlives the call and says the
/// truth about the memory it points to.
unsafe fn call(operation: usize, argument: usize) -> usize {
    let result;
    // SAFETY: the emulator changes r0 and the memory that the block names, as the caller has promised.
    unsafe { asm!("bkpt 0xab", inlateout("r0") operation => result, in("r1") argument, options(nostack)) };
    result
}
