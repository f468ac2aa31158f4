//! The physics that a simulation can have left out, as data.
mod effect;

pub use effect::{
    Amplitude, Candidate, Column, Effect, NoiseChange, Nonlinear, OnsetShape, Port, ReadingFault, Search,
    Signature, SignatureOf, Target,
};

/// Every effect known.
pub const CATALOGUE: &[Effect] = &[];
