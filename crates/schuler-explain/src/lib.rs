//! Why a recording does not look like its simulation.

pub mod calibration;
pub mod radio_identification;
