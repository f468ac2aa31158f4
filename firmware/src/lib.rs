//! Boards and transport for the flight module; not one line of estimation.
//!
//! | module | what it is |
//! | --- | --- |
//! | `board` | the few registers of each board: clock, two serial lines, watchdog |
//! | `serial` | the main loop on the serial line |
//! | `semihosting` | the main loop on the emulator's files, for long runs |
//! | `time` | microseconds since start |
//! | `log` | defmt frames to the second serial line |
//! | `double` | arithmetic in double precision, in assembly |
//! | `memory` | bytes moved in place, in assembly |
//! | `fault` | panics and faults: a line in the log, and a reset; a guard below the stack |
//! | `start` | why the processor started, and the ways to make it start again |
//!
//! Unsafe code is confined to `register` (access to a register), `log` (the contract of defmt), `start` (a note that
//! survives the reset), `fault` (guard and handler), `semihosting` (the call into the emulator), `double` and `memory` (assembly), and the unmasking of one interrupt in each board.
#![cfg(target_os = "none")]
#![no_std]

pub mod board;
mod double;
mod fault;
pub mod log;
mod memory;
mod register;
#[cfg(feature = "semihosting")]
pub mod semihosting;
#[cfg(not(feature = "semihosting"))]
pub mod serial;
pub mod start;
pub mod time;
