//! Placeholder.

pub mod emulator;
pub mod identify;
