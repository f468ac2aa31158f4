//! From description to description.
//!
//! | module | gives |
//! | --- | --- |
//! | [`library`] | every signature of a fixed shape, and what it would add to a description |
//! | [`beside`] | scores of signatures beside what is described |
//! | [`scans`] | the same of steps, ramps and lines, at every place |
//! | [`reaches`] | how well such a shape would be known, over all places |
//! | [`known`] | what was computed of parts of descriptions |
//! | [`late`] | what comes as late as the readings that it is in |
//! | [`levels`] | another white level in part of the rows |
//! | [`moves`] | the descriptions that are one item away |
//! | [`noises`] | other noises |
//! | [`common`] | what several sensors have in common, told once |
//! | [`crowds`] | lines that crowd in one band, and narrower bands for them |
//! | [`pairs`] | a constant and what it hides |
//! | [`telegraph`] | a mean that jumps on and off |
//! | [`blocks`] | what is better in each of several blocks, taken together |
//! | [`beam`] | the descriptions that are kept, and which of them are expanded |
//! | [`passes`] | the same again, the record whitened by what was found |
pub mod beam;
pub mod beside;
pub mod blocks;
pub mod common;
pub mod crowds;
pub mod known;
pub mod late;
pub mod levels;
pub mod library;
pub mod moves;
pub mod noises;
pub mod pairs;
pub mod passes;
pub mod reaches;
pub mod scans;
pub mod telegraph;

pub use passes::{Searched, searched};
