//! Arm MPS2 with image AN386 (Arm DAI 0386), as emulated by QEMU: a Cortex-M4F at 25 MHz with CMSDK peripherals
//! (Arm DDI 0479). Link on UART 0, log on UART 1.
//!
//! The watchdog asks first, by the non-maskable interrupt after a minute, and resets after another: long against a step,
//! because an emulator on a busy machine may stand still for many seconds, and its clock goes on meanwhile.
#![allow(unsafe_code)]
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m_rt::exception;
use schuler_link::message::{Board, Start};

use super::received;
use crate::register::Peripheral;
use crate::start;

/// This board.
pub const BOARD: Board = Board::Mps2An386;
/// Rate of the processor.
pub(super) const CORE_HZ: u32 = 25_000_000;

/// Number of interrupts that devices can raise.
pub(super) const INTERRUPTS: usize = 32;
/// Rate of [`clock`].
pub const CLOCK_HZ: u32 = 25_000_000;

const WATCHDOG_S: u32 = 60;

// SAFETY: the addresses are those of the memory map in DAI 0386; only this file uses them.
const TIMER: Peripheral = unsafe { Peripheral::at(0x4000_0000) };
// SAFETY: as above.
const LINK: Peripheral = unsafe { Peripheral::at(0x4000_4000) };
// SAFETY: as above.
const LOG: Peripheral = unsafe { Peripheral::at(0x4000_5000) };
// SAFETY: as above.
const WATCHDOG: Peripheral = unsafe { Peripheral::at(0x4000_8000) };

mod timer {
    pub(super) const CONTROL: usize = 0x0;
    pub(super) const VALUE: usize = 0x4;
    pub(super) const RELOAD: usize = 0x8;
    pub(super) const ENABLE: u32 = 1;
}

mod uart {
    pub(super) const DATA: usize = 0x0;
    pub(super) const STATE: usize = 0x4;
    pub(super) const CONTROL: usize = 0x8;
    pub(super) const INTERRUPT_CLEAR: usize = 0xC;
    pub(super) const BAUD_DIVISOR: usize = 0x10;
    pub(super) const TRANSMIT_FULL: u32 = 1;
    pub(super) const RECEIVE_FULL: u32 = 1 << 1;
    pub(super) const TRANSMIT_ENABLE: u32 = 1;
    pub(super) const RECEIVE_ENABLE: u32 = 1 << 1;
    pub(super) const RECEIVE_INTERRUPT_ENABLE: u32 = 1 << 3;
    pub(super) const RECEIVE_INTERRUPT: u32 = 1 << 1;
}

mod watchdog {
    pub(super) const LOAD: usize = 0x0;
    pub(super) const CONTROL: usize = 0x8;
    pub(super) const INTERRUPT_CLEAR: usize = 0xC;
    pub(super) const LOCK: usize = 0xC00;
    pub(super) const UNLOCK: u32 = 0x1ACC_E551;
    pub(super) const INTERRUPT_AND_RESET: u32 = 0b11;
}

#[derive(Clone, Copy)]
struct LinkReceive;

// SAFETY: UART 0 receive is interrupt 0 in DAI 0386.
unsafe impl InterruptNumber for LinkReceive {
    fn number(self) -> u16 {
        0
    }
}

pub(super) fn start() {
    TIMER.write(timer::RELOAD, u32::MAX);
    TIMER.write(timer::VALUE, u32::MAX);
    TIMER.write(timer::CONTROL, timer::ENABLE);

    for line in [LINK, LOG] {
        line.write(uart::BAUD_DIVISOR, CORE_HZ / 115_200);
        line.write(uart::CONTROL, uart::TRANSMIT_ENABLE);
    }
    if cfg!(not(feature = "semihosting")) {
        let control = uart::TRANSMIT_ENABLE | uart::RECEIVE_ENABLE | uart::RECEIVE_INTERRUPT_ENABLE;
        LINK.write(uart::CONTROL, control);
        // SAFETY: the handler is in place and shares nothing with the main loop but atomics.
        unsafe { NVIC::unmask(LinkReceive) };

        // Semihosting stands still while the host thinks, for as long as it likes: there the watchdog stays off.
        WATCHDOG.write(watchdog::LOCK, watchdog::UNLOCK);
        WATCHDOG.write(watchdog::LOAD, CORE_HZ * WATCHDOG_S);
        WATCHDOG.write(watchdog::CONTROL, watchdog::INTERRUPT_AND_RESET);
        WATCHDOG.write(watchdog::LOCK, 0);
    }
}

/// A counter that runs freely through all of its 32 bits. The timer counts down.
pub fn clock() -> u32 {
    !TIMER.read(timer::VALUE)
}

/// Puts the reset off.
pub fn feed_watchdog() {
    WATCHDOG.write(watchdog::LOCK, watchdog::UNLOCK);
    WATCHDOG.write(watchdog::INTERRUPT_CLEAR, 1);
    WATCHDOG.write(watchdog::LOCK, 0);
}

/// One byte to the host; false when there is no room yet.
pub fn link_send(byte: u8) -> bool {
    send(LINK, byte)
}

/// One byte of log; false when there is no room yet.
pub fn log_send(byte: u8) -> bool {
    send(LOG, byte)
}

pub(super) fn interrupt(number: i16) -> bool {
    if u16::try_from(number) != Ok(LinkReceive.number()) {
        return false;
    }
    // Acknowledged first: a byte that comes while this drains raises the interrupt again.
    LINK.write(uart::INTERRUPT_CLEAR, uart::RECEIVE_INTERRUPT);
    while LINK.read(uart::STATE) & uart::RECEIVE_FULL != 0 {
        received(LINK.read(uart::DATA) as u8);
    }
    true
}

fn send(line: Peripheral, byte: u8) -> bool {
    let room = line.read(uart::STATE) & uart::TRANSMIT_FULL == 0;
    if room {
        line.write(uart::DATA, u32::from(byte));
    }
    room
}

/// The watchdog's first warning. The main loop has hung: there is nothing to go back to.
#[exception]
unsafe fn NonMaskableInt() {
    defmt::error!("the main loop has hung");
    start::restart(Start::Watchdog);
}
