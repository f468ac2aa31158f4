//! Flies a recording: from a case to the flight module's inputs, through the module, to outputs, figures and a summary. All of
//! it goes step by step, so that a recording may be longer than memory.
//!
//! | module | does |
//! | --- | --- |
//! | [`mod@plan`] | case and recording → one or more channels: configuration and steps of the module |
//! | [`sensors`] | which sensors stand at which inputs |
//! | `velocities` | velocity errors, and radio against inertial velocities |
//! | [`mission`] | runs a channel on this machine or on the emulated target |
//! | [`summary`] | what a run says of the filter, the noise and the gyros |
//! | [`truth`] | what a simulation has left of the truth |
//! | [`outputs`] | the module's outputs as a table |
//! | [`figures`] | the module's outputs as figures |
pub mod figures;
pub mod mission;
pub mod outputs;
pub mod plan;
pub mod sensors;
pub mod summary;
pub mod truth;
mod velocities;

pub use mission::{Flown, On, fly, initial_state};
pub use plan::{Channel, Step, plan, plan_stream};
pub use summary::{Summary, Summing};
pub use truth::{LoopStates, LoopTruth};
