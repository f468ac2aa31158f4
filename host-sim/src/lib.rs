//! Placeholder.
pub mod identify;
