//! The boards. Each gives the same few names; the feature chooses one.
//!
//! | name | what it is |
//! | --- | --- |
//! | `BOARD` | its name |
//! | `CLOCK_HZ` | rate of `clock`, a multiple of 1 MHz |
//! | `CORE_HZ` | rate of the processor |
//! | `INTERRUPTS` | number of interrupts that devices can raise |
//! | `start` | starts clocks, pins, serial lines and watchdog |
//! | `clock` | a counter that runs freely through all of its 32 bits |
//! | `feed_watchdog` | puts the reset off |
//! | `link_send`, `log_send` | one byte to the first or second serial line; false when there is no room yet |
//! | `interrupt` | serves a device's interrupt; false when it is not one that the board has asked for |
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use schuler_link::ring::Ring;

use core::sync::atomic::{AtomicU32, Ordering};

use crate::{fault, start};

#[cfg(feature = "mps2-an386")]
mod mps2_an386;
#[cfg(feature = "mps2-an386")]
pub use mps2_an386::{BOARD, CLOCK_HZ, clock, feed_watchdog, link_send, log_send};
#[cfg(feature = "mps2-an386")]
use mps2_an386::{CORE_HZ, INTERRUPTS, interrupt, start as start_board};

#[cfg(feature = "stm32f405")]
mod stm32f405;
#[cfg(feature = "stm32f405")]
pub use stm32f405::{BOARD, CLOCK_HZ, clock, feed_watchdog, link_send, log_send};
#[cfg(feature = "stm32f405")]
use stm32f405::{CORE_HZ, INTERRUPTS, interrupt, start as start_board};

#[cfg(not(any(feature = "mps2-an386", feature = "stm32f405")))]
compile_error!("choose the board: --features mps2-an386 or --features stm32f405");
#[cfg(all(feature = "mps2-an386", feature = "stm32f405"))]
compile_error!("choose one board, not both");
#[cfg(all(feature = "semihosting", not(feature = "mps2-an386")))]
compile_error!("semihosting is for the emulator: it hard-faults on silicon");

/// The main loop wakes at least this often.
const WAKE_HZ: u32 = 1000;

/// What has come on the link's serial line: several inputs may wait here while a step runs, at 115 200 baud a sixth of a second.
pub static RECEIVED: Ring<2048> = Ring::new();

/// Bytes that came and found no room.
static LOST: AtomicU32 = AtomicU32::new(0);

/// Starts the board, and the beat that wakes the main loop.
pub fn start() {
    let Some(mut core) = cortex_m::Peripherals::take() else { return };
    fault::guard_stack(&mut core.MPU);
    start_board();
    start_beat(&mut core.SYST);
}

/// Bytes lost since the last call.
pub fn take_lost() -> u32 {
    LOST.swap(0, Ordering::Relaxed)
}

/// A byte has come, from within an interrupt.
fn received(byte: u8) {
    if !RECEIVED.push(byte) {
        lost();
    }
}

/// A byte has been lost, from within an interrupt.
fn lost() {
    LOST.fetch_add(1, Ordering::Relaxed);
}

fn start_beat(syst: &mut SYST) {
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(CORE_HZ / WAKE_HZ - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
}

/// The vectors of the devices: as many as the processor has. All 240 that a core can have would take 630 bytes more.
#[allow(unsafe_code)]
mod vectors {
    use super::INTERRUPTS;

    unsafe extern "C" {
        /// The one below.
        fn DefaultHandler();
    }

    // SAFETY: the section is that of the vectors behind those of the core, and nothing else defines the name.
    #[unsafe(link_section = ".vector_table.interrupts")]
    #[unsafe(no_mangle)]
    static __INTERRUPTS: [unsafe extern "C" fn(); INTERRUPTS] = [DefaultHandler; INTERRUPTS];
}

/// Waking is all it does.
#[exception]
fn SysTick() {}

#[exception]
#[allow(unsafe_code)]
unsafe fn DefaultHandler(number: i16) {
    if !interrupt(number) {
        defmt::error!("unexpected interrupt {=i16}", number);
        start::restart(schuler_link::message::Start::Fault);
    }
}
