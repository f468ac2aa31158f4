//! Why a recording does not look like its simulation.

pub mod calibration;
pub mod catalogue;
pub mod explanation;
pub mod inputs;
pub mod noise;
pub mod radio_identification;
pub mod statistics;
pub mod whiten;
pub mod description;
pub mod least_squares;
pub mod minimise;
pub mod nominal;
pub mod noise_fit;
pub mod spectrum;
pub mod noise_change;
pub mod library;
pub mod scan;
pub mod search;
pub mod state;
pub mod select;
pub mod equivalence;
pub mod refit;
pub mod hold_out;
pub mod explain;
pub mod sentence;
pub mod locate;
