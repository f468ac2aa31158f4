//! What the workspace tests share: the specification's generator of golden records.

pub mod golden_records;
