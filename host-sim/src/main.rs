//! The `schuler` command.
fn main() {}
