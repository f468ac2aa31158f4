//! STM32F405 (ST RM0090): what one flashes. Link on USART 1 (PA9 out, PA10 in), log on USART 2 (PA2), 115 200 baud.
//!
//! The processor runs on the internal 16 MHz oscillator: a step takes milliseconds of its second, the crystal is a
//! matter of the carrier board, and an emulator has neither. It holds 1 % at room temperature, enough for the serial
//! line; the time of a flight comes with its inputs.
#![allow(unsafe_code)]
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use schuler_link::message::Board;

use super::{lost, received};
use crate::register::Peripheral;

/// This board.
pub const BOARD: Board = Board::Stm32f405;
/// Rate of the processor.
pub(super) const CORE_HZ: u32 = 16_000_000;

/// Number of interrupts that devices can raise (RM0090, table 61).
pub(super) const INTERRUPTS: usize = 82;
/// Rate of [`clock`].
pub const CLOCK_HZ: u32 = 1_000_000;

const BAUD: u32 = 115_200;

// SAFETY: the addresses are those of the memory map in RM0090; only this file uses them.
const TIMER_2: Peripheral = unsafe { Peripheral::at(0x4000_0000) };
// SAFETY: as above.
const WATCHDOG: Peripheral = unsafe { Peripheral::at(0x4000_3000) };
// SAFETY: as above.
const LOG: Peripheral = unsafe { Peripheral::at(0x4000_4400) };
// SAFETY: as above.
const LINK: Peripheral = unsafe { Peripheral::at(0x4001_1000) };
// SAFETY: as above.
const PORT_A: Peripheral = unsafe { Peripheral::at(0x4002_0000) };
// SAFETY: as above.
const CLOCKS: Peripheral = unsafe { Peripheral::at(0x4002_3800) };

mod clocks {
    pub(super) const AHB1_ENABLE: usize = 0x30;
    pub(super) const APB1_ENABLE: usize = 0x40;
    pub(super) const APB2_ENABLE: usize = 0x44;
    /// Port A, after the reset value (the core-coupled memory).
    pub(super) const AHB1: u32 = 1 << 20 | 1;
    /// Timer 2 and USART 2.
    pub(super) const APB1: u32 = 1 << 17 | 1;
    /// USART 1.
    pub(super) const APB2: u32 = 1 << 4;
}

mod port {
    pub(super) const MODE: usize = 0x0;
    pub(super) const PULL: usize = 0xC;
    pub(super) const FUNCTION_LOW: usize = 0x20;
    pub(super) const FUNCTION_HIGH: usize = 0x24;
    /// Reset values: the debugger's pins.
    pub(super) const MODE_RESET: u32 = 0xA800_0000;
    pub(super) const PULL_RESET: u32 = 0x6400_0000;
    /// PA2, PA9 and PA10 to their peripherals.
    pub(super) const MODE_ALTERNATE: u32 = 0b10 << (2 * 2) | 0b10 << (2 * 9) | 0b10 << (2 * 10);
    /// A receiver without a cable hears silence.
    pub(super) const PULL_UP_RECEIVE: u32 = 0b01 << (2 * 10);
    /// Function 7 is the USART.
    pub(super) const PA2_USART: u32 = 7 << (4 * 2);
    /// The upper register counts from PA8.
    pub(super) const PA9_PA10_USART: u32 = 7 << 4 | 7 << (4 * 2);
}

mod timer {
    pub(super) const CONTROL: usize = 0x0;
    pub(super) const EVENT: usize = 0x14;
    pub(super) const COUNT: usize = 0x24;
    pub(super) const PRESCALER: usize = 0x28;
    pub(super) const RELOAD: usize = 0x2C;
    pub(super) const ENABLE: u32 = 1;
    /// Takes the prescaler over now.
    pub(super) const UPDATE: u32 = 1;
}

mod usart {
    pub(super) const STATUS: usize = 0x0;
    pub(super) const DATA: usize = 0x4;
    pub(super) const BAUD_RATE: usize = 0x8;
    pub(super) const CONTROL: usize = 0xC;
    pub(super) const OVERRUN: u32 = 1 << 3;
    pub(super) const RECEIVED: u32 = 1 << 5;
    pub(super) const TRANSMIT_EMPTY: u32 = 1 << 7;
    pub(super) const RECEIVE_ENABLE: u32 = 1 << 2;
    pub(super) const TRANSMIT_ENABLE: u32 = 1 << 3;
    pub(super) const RECEIVE_INTERRUPT_ENABLE: u32 = 1 << 5;
    pub(super) const ENABLE: u32 = 1 << 13;
}

mod watchdog {
    pub(super) const KEY: usize = 0x0;
    pub(super) const PRESCALER: usize = 0x4;
    pub(super) const RELOAD: usize = 0x8;
    pub(super) const STATUS: usize = 0xC;
    pub(super) const START: u32 = 0xCCCC;
    pub(super) const UNLOCK: u32 = 0x5555;
    pub(super) const FEED: u32 = 0xAAAA;
    /// 32 kHz (17 to 47) through 64.
    pub(super) const DIVIDE_BY_64: u32 = 4;
    /// Three seconds (2.0 to 5.6).
    pub(super) const THREE_SECONDS: u32 = 1500;
}

#[derive(Clone, Copy)]
struct Usart1;

// SAFETY: USART 1 is interrupt 37 in RM0090, table 61.
unsafe impl InterruptNumber for Usart1 {
    fn number(self) -> u16 {
        37
    }
}

pub(super) fn start() {
    CLOCKS.write(clocks::AHB1_ENABLE, clocks::AHB1);
    CLOCKS.write(clocks::APB1_ENABLE, clocks::APB1);
    CLOCKS.write(clocks::APB2_ENABLE, clocks::APB2);
    // A peripheral answers two cycles after its clock is on; the read back takes them.
    let _ = CLOCKS.read(clocks::APB2_ENABLE);

    PORT_A.write(port::FUNCTION_LOW, port::PA2_USART);
    PORT_A.write(port::FUNCTION_HIGH, port::PA9_PA10_USART);
    PORT_A.write(port::PULL, port::PULL_RESET | port::PULL_UP_RECEIVE);
    PORT_A.write(port::MODE, port::MODE_RESET | port::MODE_ALTERNATE);

    TIMER_2.write(timer::PRESCALER, CORE_HZ / CLOCK_HZ - 1);
    TIMER_2.write(timer::RELOAD, u32::MAX);
    TIMER_2.write(timer::EVENT, timer::UPDATE);
    TIMER_2.write(timer::CONTROL, timer::ENABLE);

    for line in [LINK, LOG] {
        line.write(usart::BAUD_RATE, (CORE_HZ + BAUD / 2) / BAUD);
        line.write(usart::CONTROL, usart::ENABLE | usart::TRANSMIT_ENABLE);
    }
    let receive = usart::RECEIVE_ENABLE | usart::RECEIVE_INTERRUPT_ENABLE;
    LINK.write(usart::CONTROL, usart::ENABLE | usart::TRANSMIT_ENABLE | receive);
    // SAFETY: the handler is in place and shares nothing with the main loop but atomics.
    unsafe { NVIC::unmask(Usart1) };

    WATCHDOG.write(watchdog::KEY, watchdog::START);
    WATCHDOG.write(watchdog::KEY, watchdog::UNLOCK);
    WATCHDOG.write(watchdog::PRESCALER, watchdog::DIVIDE_BY_64);
    WATCHDOG.write(watchdog::RELOAD, watchdog::THREE_SECONDS);
    while WATCHDOG.read(watchdog::STATUS) != 0 {}
    feed_watchdog();
}

/// A counter that runs freely through all of its 32 bits.
pub fn clock() -> u32 {
    TIMER_2.read(timer::COUNT)
}

/// Puts the reset off.
pub fn feed_watchdog() {
    WATCHDOG.write(watchdog::KEY, watchdog::FEED);
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
    if u16::try_from(number) != Ok(Usart1.number()) {
        return false;
    }
    // Reading status and then data clears both flags.
    let status = LINK.read(usart::STATUS);
    if status & (usart::RECEIVED | usart::OVERRUN) != 0 {
        received(LINK.read(usart::DATA) as u8);
    }
    if status & usart::OVERRUN != 0 {
        lost();
    }
    true
}

fn send(line: Peripheral, byte: u8) -> bool {
    let room = line.read(usart::STATUS) & usart::TRANSMIT_EMPTY != 0;
    if room {
        line.write(usart::DATA, u32::from(byte));
    }
    room
}
