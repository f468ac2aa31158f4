//! Why the processor started, and the ways to make it start again.
//!
//! A reset clears everything but three words at the end of RAM (`stack.x`): one says that there has been a start since
//! power came on, the second why the next one will come, the third how many there have been. No
//! reason there means that the reset came without notice: the watchdog, a lock-up or the pin.
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
    let (start, boots) = take_note();
    let (board, reason) = (name(identity.board), describe(start));
    defmt::info!(
        "schuler {=str}, sources {=u64:016x}, protocol {=u8}, {=str}, started by {=str}",
        VERSION,
        SOURCE_HASH,
        PROTOCOL,
        board,
        reason
    );
    Identity { start, boots, ..identity }
}

/// Resets the processor, and tells the next start why.
pub fn restart(reason: Start) -> ! {
    cortex_m::interrupt::disable();
    log::flush();
    leave_reason(code(reason));
    SCB::sys_reset()
}

/// Why this start has come, and which one it is. The count goes on from whatever stands in memory that has just got power: all
/// that counts is that the next one is another.
fn take_note() -> (Start, u32) {
    // SAFETY: three aligned words in RAM which belong to no section; only this file knows of them. They are not Rust's:
    // volatile accesses take them as they come.
    let (started, reason, boots) =
        unsafe { (note().read_volatile(), note().add(1).read_volatile(), note().add(2).read_volatile()) };
    // Zero is for who has no starts.
    let boots = boots.wrapping_add(1).max(1);
    // SAFETY: as above.
    unsafe { note().add(2).write_volatile(boots) };
    leave_reason(NO_REASON);
    (if started == STARTED { reason_of(reason) } else { Start::PowerOn }, boots)
}

fn leave_reason(code: u32) {
    // SAFETY: as in `take_note`.
    unsafe {
        note().add(1).write_volatile(code);
        note().write_volatile(STARTED);
    }
}

fn note() -> *mut u32 {
    unsafe extern "C" {
        static mut _note_for_next_start: [u32; 3];
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
