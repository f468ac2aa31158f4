//! Placeholder.

pub mod compare_isolation;
pub mod emulator;
