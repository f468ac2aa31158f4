//! Numbers: least squares, minimisers, curves, tails of distributions.
pub mod least_squares;
pub mod minimise;
pub(crate) mod spline;
pub mod statistics;
pub(crate) mod within_step;
