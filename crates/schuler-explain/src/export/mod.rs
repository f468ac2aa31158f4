//! What was found, for others to use.
//!
//! | module | gives |
//! | --- | --- |
//! | [`compensation`] | the block by which the flight module corrects its inputs |
//! | [`model`] | what the findings add to the readings, as a model for a simulation |
pub mod compensation;
pub mod model;
