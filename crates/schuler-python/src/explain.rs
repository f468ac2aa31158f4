//! `explain`.
use pyo3::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain_watched;

use crate::answer::python_of;
use crate::case::{Given, unusable};
use crate::watched::watched;

/// Explain why a recording does not look like its simulation: the document of `schuler explain --json`.
///
/// case: path of a case file, or a dictionary of what would stand there. recording: path of a table instead of the case's,
/// or a dictionary of arrays of shape (n,) by column, in the units that the case says; NaN is missing. probability: posterior
/// probability from which on a finding is told, 0 to 1. hold_out: whether the description is judged on blocks held out. progress: called with the
/// phase and the part of it that is done, 0 to 1; what it raises ends the work.
///
/// Raises ValueError with file, line, field and expectation, KeyboardInterrupt within a moment of Ctrl-C.
#[pyfunction]
#[pyo3(signature = (case, recording=None, *, probability=0.95, hold_out=true, progress=None))]
pub(crate) fn explain(
    py: Python<'_>,
    case: &Bound<'_, PyAny>,
    recording: Option<&Bound<'_, PyAny>>,
    probability: f64,
    hold_out: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<PyAny>> {
    let given = Given::new(case, recording)?;
    let (path, options) = (given.path(), Config { told_at: probability, hold_out, ..Config::default() });
    let explained = watched(py, progress, |watch| {
        let recording = given.read()?;
        explain_watched(&recording, &options, watch)
            .map_err(|error| schuler_recording::Error::one(&path, error.problem()))
    })?;
    let (explanation, _) = explained.map_err(|error| unusable(&error))?;
    python_of(py, &explanation)
}
