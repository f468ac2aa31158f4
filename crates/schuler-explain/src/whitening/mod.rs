//! The state-space filter that whitens the channels of a block.
//!
//! | module | gives |
//! | --- | --- |
//! | [`filter`] | gains row by row, and columns whitened by them |
//! | [`course`] | the gains where they have not settled |
//! | [`laid_out`] | runs over many columns side by side |
pub(crate) mod course;
pub mod filter;
mod laid_out;
