//! Answers of the command as Python's dictionaries.
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde::Serialize;

/// The dictionary that `json.loads` makes of the answer: the same document as the command prints with `--json`.
///
/// # Errors
/// Never for the answers of this workspace, which all are JSON.
pub(crate) fn python_of(py: Python<'_>, answer: &impl Serialize) -> PyResult<Py<PyAny>> {
    let text = serde_json::to_string(answer).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(py.import("json")?.call_method1("loads", (text,))?.unbind())
}
