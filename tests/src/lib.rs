//! What the workspace tests share.

pub mod calibration_run;
pub mod temperature_rate;
