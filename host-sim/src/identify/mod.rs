//! x
pub mod allan;
pub mod autocorrelation;
pub mod likelihood;
pub mod power_law;
pub mod series;
pub mod trend;
