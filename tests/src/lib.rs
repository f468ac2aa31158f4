//! What the workspace tests share.

pub mod temperature_rate;
