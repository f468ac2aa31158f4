//! The command `schuler`, for the script that the package installs.
use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Run the command `schuler` with these arguments, of which the first is its path; gives the exit status.
///
/// It belongs to a process of its own: it takes Ctrl-C for itself, and help and mistakes in the arguments end the process.
#[pyfunction]
pub(crate) fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    let program = arguments.first().map(PathBuf::from).unwrap_or_default();
    py.detach(|| host_sim::command::run(program, arguments))
}
