//! The second engine: one evidence for a description of the record, one search between descriptions, one answer.
//!
//! | folder | stage |
//! | --- | --- |
//! | [`problem`] | the recording against its nominal model, and what may have been left out |
//! | [`bands`] | the whitened record as sums of products over bands |
//! | [`noise`] | spectra of the noise, how far they are believed, their fit |
//! | [`evidence`] | the one number of a description |
//! | [`search`] | from description to description |
//! | [`answer`] | from the best descriptions to an explanation |
pub mod answer;
pub mod bands;
pub mod config;
pub mod evidence;
pub mod noise;
pub mod problem;
pub mod search;

pub use answer::{explain, explain_watched};
