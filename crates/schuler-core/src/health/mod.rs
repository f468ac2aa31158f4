//! Health of a radio sensor and an inertial sensor that measure the same quantity, e.g. Doppler ground speed
//! against inertial velocity.
//!
//! Their difference, the residual d = radio − inertial, does not depend on the quantity. From it the monitor
//! decides in every step whether the mean of the radio's error has shifted, whether its noise has grown, or
//! neither, and estimates both sensors' errors. Where it is asked to, it also tells whether the radio
//! holds its last value. The radio error is a first-order Markov process whose level of noise and
//! whose shift are Markov chains; the inertial error is a random walk on a slow drift.
//!
//! | file | holds |
//! | --- | --- |
//! | `config` | [`HealthConfig`]: what is believed of the sensors, and its validation |
//! | `span` | motion of the model over n steps in closed form |
//! | `conditional` | prediction, update and merging of one mode's Gaussian |
//! | `paths` | the same for all paths from one mode to all modes, side by side |
//! | `recursion` | the mode probabilities and Gaussians from one residual to the next |
//! | `memory` | whether the radio holds its last value |
//! | `verdict` | alarms, [`Verdict`], [`Suspect`], and what cannot be told apart |
//! | `monitor` | [`HealthMonitor`]: guards in front, read-outs behind |
//!
//! Inputs: both readings, m/s. Outputs: [`HealthOutput`]. The work of a step does not depend on the data nor on
//! the length of a gap: with two levels 17 200 instructions on a Cortex-M4F in single precision and 415 000 in
//! double. Over a day single precision changes the probabilities by less than 10⁻³, so it is single precision that flies.
//!
//! Source: Bolelov & Sbitnev, optimisation of monitoring and diagnosis of a flight-navigation complex; Yarlykov
//! & Mironov, Markov theory of estimation (1993). The sections are cited as `[HLT-n]`: 3 model, 4 optimal
//! recursion, 5 implementable filter, 6 edge cases, 7 parameters, 10 golden numbers.
mod conditional;
mod config;
mod memory;
mod monitor;
mod output;
mod paths;
mod recursion;
mod span;
mod verdict;

pub use config::{
    AlarmThresholds, HealthConfig, InertialErrorModel, JumpModel, MemoryModel, RadioErrorModel,
};
pub use monitor::HealthMonitor;
pub use output::{Estimate, HealthOutput, HealthStatus};
pub use span::MAX_SPAN_STEPS;
pub use verdict::{HealthAlarms, Suspect, Verdict};
