//! The noise of a block by band: what its sources add up to, how far that is believed, and its fit to band sums.
//!
//! | module | gives |
//! | --- | --- |
//! | `form` | the noise of a source: its parts, spectrum and states |
//! | [`trust`] | the likelihood of the power in bands whose level is known only within a factor |
//! | [`weights`] | covariances of the channels by band, and what a band counts |
//! | [`fit`] | parameters of the noise by Fisher scoring |
//! | [`parts`] | the parts by which the noise of a source may differ from the stated one |
pub mod fit;
mod form;
pub mod parts;
pub mod trust;
pub mod weights;

pub use form::*;
