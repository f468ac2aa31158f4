//! Why a recording does not look like its simulation.

pub mod calibration;
pub mod catalogue;
pub mod deploy;
pub mod evidence;
pub mod explanation;
pub mod inputs;
pub mod radio_identification;
