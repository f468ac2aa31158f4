//! The flight module: what a navigation computer runs once a second beside a single-channel,
//! Schuler-tuned inertial system.
//!
//! | module | computes |
//! | --- | --- |
//! | [`filter`] | velocity error, vertical error, accelerometer error and gyro drift from velocity differences |
//! | [`identification`] | the structure and parameters of each sensor's noise; retunes the filter |
//! | [`isolation`] | which of five gyros has failed, and the rate from the healthy ones |
//! | [`thermal`] | temperature and its rate from quantised readings; compensation of the sensors' thermal errors |
//! | [`health`] | whether a radio sensor's mean has shifted or its noise has grown, against an inertial one |
//! | [`compensation`] | the inputs corrected by a loaded block of coefficients |
//! | [`sums`] | sums of products by octave: what a day of readings says about its causes |
//! | [`module`] | the one fixed step that strings them together |
//!
//! No heap, no panic, no unsafe, no loop whose length depends on the data. Inside, everything is in SI units
//! and radians. Elementary functions come from `libm` on every platform, so that the same input gives the
//! same bits on a PC and on a Cortex-M.
//!
//! Equation ids (`FIL-11`, `FDI-4` …) name the equations of the papers; the doc comment of the code that
//! implements one names it, and so does its test.
//!
//! ```
//! use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput};
//! use schuler_core::reading::Reading;
//!
//! let mut module = Box::new(FlightModule::new());
//! module.configure(&ModuleConfig::default())?;
//! // Once a second, whether there is a measurement or not.
//! let input = StepInput { velocity_error: Reading::good(0.12), ..StepInput::without_readings(1000) };
//! assert_eq!(module.step(&input).status, Status::empty());
//! let output = module.step(&StepInput::without_readings(2000));
//! assert_eq!(output.status, Status::VELOCITY_MISSING);
//! let [velocity, ..] = output.filter.estimate;
//! assert!((velocity - 0.06).abs() < 0.01, "half of it, by a prior as uncertain as the measurement: {velocity}");
//! # Ok::<(), schuler_core::config::ConfigError>(())
//! ```
#![no_std]
// A lazy operator is a branch: the work of a step would depend on its data.
#![allow(clippy::needless_bitwise_bool)]

pub mod compensation;
pub mod config;
pub mod filter;
pub mod health;
pub mod identification;
pub mod isolation;
pub mod module;
mod number;
pub mod reading;
mod saved;
pub mod sums;
pub mod thermal;

/// How often a test repeats something. Miri, some hundred times as slow, sees the same code in a hundredth of it.
#[cfg(test)]
const fn repeats(often: u32) -> u32 {
    if cfg!(miri) { often.div_ceil(100) } else { often }
}
