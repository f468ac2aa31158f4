//! What the workspace tests share: records, generators and the methods that ours are compared with.

pub mod calibration_run;
pub mod equations;
pub mod golden_records;
pub mod health_reference;
pub mod python;
pub mod temperature_rate;
