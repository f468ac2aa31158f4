//! The one number of a description: the logarithm of the evidence of the record under it.
//!
//! | module | gives |
//! | --- | --- |
//! | [`amplitude`] | the prior of amplitudes, and what the evidence makes of it |
//! | [`regressor`] | what a signature adds to the channels of the blocks, as series of their sums |
//! | [`system`] | scores and products of regressors, amplitudes, residual power |
//! | [`late`] | effects of the motion as late as the readings that they are in |
//! | [`fit`] | amplitudes, trust and noise of a description in turn, and its evidence |
pub mod amplitude;
pub mod fit;
pub mod late;
pub mod regressor;
pub mod system;
