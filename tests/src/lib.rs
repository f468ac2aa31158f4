//! What the workspace tests share.
pub mod health_reference;
