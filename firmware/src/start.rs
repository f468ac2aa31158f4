//! Why the processor started, and the ways to make it start again.
//!
//! A reset clears everything but two words at the end of RAM (`stack.x`): one says that there has been a start since
//! power came on, the other why the next one will come. No reason there means that the reset came without
//! notice: the watchdog, a lock-up or the pin.
#![allow(unsafe_code)]
use core::ptr;

use cortex_m::peripheral::SCB;
use schuler_link::message::{Board, Identity, Start};
use schuler_link::{PROTOCOL, SOURCE_HASH, VERSION};

use crate::log;

/// In the first word: there has been a start. Chance does not leave it in memory that has just got power.
const STARTED: u32 = 0x5c4d_71e5;
/// In the second word: no reason.
const NO_REASON: u32 = 0;

/// Completes the identity, and logs it as the first line.
pub fn introduce(identity: Identity) -> Identity {
    let start = take_reason();
    let (board, reason) = (name(identity.board), describe(start));
    defmt::info!(
        "schuler {=str}, sources {=u64:016x}, protocol {=u8}, {=str}, started by {=str}",
        VERSION,
        SOURCE_HASH,
        PROTOCOL,
        board,
        reason
    );
    Identity { start, ..identity }
}

/// Resets the processor, and tells the next start why.
pub fn restart(reason: Start) -> ! {
    cortex_m::interrupt::disable();
    log::flush();
    leave_reason(code(reason));
    SCB::sys_reset()
}

fn take_reason() -> Start {
    // SAFETY: two aligned words in RAM which belong to no section; only this file knows of them. They are not Rust's:
    // volatile accesses take them as they come.
    let (started, reason) = unsafe { (note().read_volatile(), note().add(1).read_volatile()) };
    leave_reason(NO_REASON);
    if started == STARTED { reason_of(reason) } else { Start::PowerOn }
}

fn leave_reason(code: u32) {
    // SAFETY: as in `take_reason`.
    unsafe {
        note().add(1).write_volatile(code);
        note().write_volatile(STARTED);
    }
}

fn note() -> *mut u32 {
    unsafe extern "C" {
        static mut _note_for_next_start: [u32; 2];
    }
    ptr::addr_of_mut!(_note_for_next_start).cast()
}

const fn code(reason: Start) -> u32 {
    match reason {
        Start::PowerOn | Start::Watchdog => NO_REASON,
        Start::Command => 1,
        Start::Panic => 2,
        Start::Fault => 3,
    }
}

const fn reason_of(code: u32) -> Start {
    match code {
        1 => Start::Command,
        2 => Start::Panic,
        3 => Start::Fault,
        _ => Start::Watchdog,
    }
}

const fn describe(start: Start) -> &'static str {
    match start {
        Start::PowerOn => "power",
        Start::Command => "command",
        Start::Panic => "panic",
        Start::Fault => "fault",
        Start::Watchdog => "watchdog",
    }
}

const fn name(board: Board) -> &'static str {
    match board {
        Board::Host => "host",
        Board::Mps2An386 => "mps2-an386",
        Board::Stm32f405 => "stm32f405",
    }
}
