//! Sensor and environment physics from first principles, and what the `schuler` command is made of.
pub mod physics;
