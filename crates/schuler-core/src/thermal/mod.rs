//! Temperature, its rate, and what they do to the sensors.
//!
//! | part | computes |
//! | --- | --- |
//! | [`rate`] | temperature (degC) and its rate (degC/s) from a coarsely quantised thermometer, with sigmas |
//! | [`regression`] | the window's least-squares fit behind it |
//! | [`window`] | the ring of instants at which the temperature was known |
//! | [`features`] | the functions of temperature, rate and gradient in which sensor coefficients are linear |
//! | [`compensation`] | rates and specific forces corrected by a checked coefficient block |
//!
//! Source: I. Tarygin's dissertation on extended thermal models (2024); A. Kozlov, I. Tarygin, Sensors 2020,
//! 20(5), 1299. `TMP-n` names a section of the specification of this part, `M1`..`M3` its measurements.
//!
//! Time is integer milliseconds; only differences of times become floating point. Temperature is in degC by
//! convention, its rate in degC/s.
use nalgebra::RealField;
use num_traits::FromPrimitive;

pub mod compensation;
mod dither;
pub mod features;
pub mod rate;
pub mod regression;
pub mod window;

pub use compensation::{AxisCoefficients, CompensationBlock, Compensator, Correction, TriadCoefficients};
pub use features::{Coefficient, CompensationStatus, FeatureMap, ThermalState};
pub use rate::{
    Quantiser, TemperatureRate, TemperatureRateConfig, TemperatureRateCounts, TemperatureRateOutput,
    ThermalStatus,
};

/// What the thermal part computes with: `f32` on the target, `f64` in tests.
pub trait Scalar: RealField + Copy + FromPrimitive {}
impl<F: RealField + Copy + FromPrimitive> Scalar for F {}

pub(crate) use crate::number::real;

/// `later − earlier` in seconds; exact in `f32` below 4.6 h, and saturated at 24 days.
pub(crate) fn seconds_between<F: Scalar>(earlier_ms: u64, later_ms: u64) -> F {
    let limit = i32::MAX.unsigned_abs();
    let span = |from: u64, to: u64| u32::try_from(to.saturating_sub(from)).unwrap_or(limit).min(limit);
    // One of the two spans is zero.
    let signed = span(earlier_ms, later_ms).cast_signed() - span(later_ms, earlier_ms).cast_signed();
    F::from_i32(signed).unwrap_or_else(F::zero) * real(1e-3)
}
