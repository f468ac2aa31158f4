//! `schuler identify CASE.toml`.
use std::path::PathBuf;

use super::Failure;
use super::session::Session;

/// What to identify.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Case file.
    case: PathBuf,
}

pub(super) fn run(arguments: &Arguments, _session: &Session) -> Result<(), Failure> {
    let error = anyhow::anyhow!("{}: identification is not part of this build", arguments.case.display());
    Err(Failure::Other(error))
}
