//! Cases that are proposed for tables in memory.
use std::path::Path;

use host_sim::proposal::{Look, Proposed, Times, look_in, of_pair, of_recording, pairs};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::answer::python_of;
use crate::arrays::Arrays;
use crate::input::wrong;

/// A time column and a step in seconds, of which one at most is stated.
type Stated = (Option<String>, Option<f64>);
/// A case as a dictionary, and what was found and guessed, a sentence each.
type Proposal = (Py<PyAny>, Vec<String>);

/// The case that a table is guessed to be, as a dictionary, and what was guessed. data: arrays of shape (n,) by column. stated: time column, and
/// step in seconds, or None.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what pyo3 hands over")]
pub(crate) fn propose(py: Python<'_>, data: &Bound<'_, PyAny>, stated: Stated) -> PyResult<Proposal> {
    let look = look("data", data, &stated, ["time", "step_s"])?;
    drafted(py, of_recording(&look, Path::new("data")))
}

/// The same of a simulation's table beside a recording's. map: pairs of a simulated and a recorded column.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what pyo3 hands over")]
pub(crate) fn propose_pair(
    sim: &Bound<'_, PyAny>,
    real: &Bound<'_, PyAny>,
    map: Vec<(String, String)>,
    sim_stated: Stated,
    real_stated: Stated,
) -> PyResult<Proposal> {
    let (simulated, recorded) = (
        look("sim", sim, &sim_stated, ["sim_time", "sim_step_s"])?,
        look("real", real, &real_stated, ["real_time", "real_step_s"])?,
    );
    let matched = pairs(&simulated, &recorded, &map).map_err(|message| {
        wrong(message.replace("--map SIMULATED=RECORDED", "map={simulated: recorded}").replace("--map ", ""))
    })?;
    drafted(sim.py(), of_pair(&simulated, &recorded, &matched, [Path::new("sim"), Path::new("real")]))
}

/// Looks at a table; messages name its arguments for time and step.
fn look(
    called: &'static str,
    table: &Bound<'_, PyAny>,
    stated: &Stated,
    [time, step_s]: [&str; 2],
) -> PyResult<Look> {
    let table = Arrays::new(called, called, table)?;
    let times = Times::stated(stated.0.as_deref(), stated.1);
    look_in(Box::new(table), Path::new(called), times).map_err(|error| {
        let message = error
            .to_string()
            .replace("state --step-s, in a case recording.step_s", &format!("state {step_s}="));
        wrong(message.replace("--time", time))
    })
}

fn drafted(py: Python<'_>, proposed: Proposed) -> PyResult<Proposal> {
    let case: toml::Table =
        toml::from_str(&proposed.text).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    let said = proposed.said.into_iter().map(|said| said.replace("--map SIMULATED=RECORDED", "map="));
    Ok((python_of(py, &case)?, said.collect()))
}
