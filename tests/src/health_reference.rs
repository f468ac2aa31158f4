//! Reference filters for the health monitor, written from the model alone and without a line of the monitor's:
//! dense 4×4 matrices where the monitor writes out sparse ones, mixtures where it merges.
//!
//! | part | holds |
//! | --- | --- |
//! | [`model`] | the model's matrices by mode [HLT-3] |
//! | [`generator`] | residuals and their truth, drawn from the model |
//! | [`mixture`] | the exact posterior by enumeration, and with a bounded number of components by optimal resampling |
//! | [`comparison`] | nominal Kalman filter, GPB1 and IMM |
//! | [`monitored`] | the monitor itself, behind the same trait |
//! | [`scoring`] | Brier scores, errors, consistency, reliability |
pub mod comparison;
pub mod generator;
pub mod mixture;
pub mod model;
pub mod monitored;
pub mod scoring;
