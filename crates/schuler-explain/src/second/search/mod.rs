//! From description to description.
//!
//! | module | gives |
//! | --- | --- |
//! | [`library`] | every signature of a fixed shape, and what it would add to a description |
//! | [`beside`] | scores of signatures beside what is described |
//! | [`scans`] | the same of steps, ramps and lines, at every place |
//! | [`levels`] | another white level in part of the rows |
//! | [`moves`] | the descriptions that are one item away |
//! | [`telegraph`] | a mean that jumps on and off |
//! | [`beam`] | the descriptions that are kept, and which of them are expanded |
pub mod beam;
pub mod beside;
pub mod levels;
pub mod library;
pub mod moves;
pub mod scans;
pub mod telegraph;
