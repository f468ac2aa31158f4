//! Cases that are proposed from tables, for a person to go on editing: what is guessed is marked as a guess.
//!
//! | module | does |
//! | --- | --- |
//! | [`mod@column`] | what the name and the values of a column say of it |
//! | [`look`] | a table as far as a proposal needs it: time, rate, columns of numbers |
//! | [`mod@pairs`] | columns of a simulation that belong to columns of a recording |
//! | [`mod@write`] | the case as text with comments |
//!
//! Nothing here writes a file.
pub mod column;
pub mod look;
pub mod pairs;
pub mod write;

pub use look::{Look, Times, look_at, look_in};
pub use pairs::{Pairs, pairs};
pub use write::{Proposed, of_pair, of_recording};
