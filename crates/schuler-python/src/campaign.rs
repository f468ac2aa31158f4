//! Campaigns case by case, for whoever distributes them: cases with concealed effects, made, sealed, explained and scored.
use std::path::{Path, PathBuf};

use host_sim::campaign::plan::{Plan, PlanFile};
use host_sim::campaign::run::{Campaign, Ended};
use host_sim::campaign::score::CaseScore;
use host_sim::campaign::summary::summary;
use host_sim::output::Interrupted;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain_watched;
use schuler_explain::watch::Watch;
use schuler_recording::Recording;

use crate::answer::python_of;
use crate::case::unusable;
use crate::input::wrong;
use crate::watched::{Shared, watched};

/// The number of cases of a plan, a file as `schuler campaign` takes it.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what pyo3 hands over")]
pub(crate) fn campaign_cases(plan: PathBuf) -> PyResult<usize> {
    Ok(read(&plan)?.plan.cases())
}

/// Make case `index` of a plan from the campaign's seed, explain it and score the answer against what was concealed, as
/// `schuler campaign` does: the score, with its time_s in seconds.
///
/// Raises ValueError for a plan that cannot be used, KeyboardInterrupt within a moment of Ctrl-C.
#[pyfunction]
#[pyo3(signature = (plan, *, seed, index))]
#[expect(clippy::needless_pass_by_value, reason = "what pyo3 hands over")]
pub(crate) fn campaign_case(py: Python<'_>, plan: PathBuf, seed: u64, index: usize) -> PyResult<Py<PyAny>> {
    let plan = read(&plan)?;
    if index >= plan.plan.cases() {
        return Err(wrong(format!("index: found {index}; expected a number below {}", plan.plan.cases())));
    }
    let directory = tempfile::tempdir()?;
    let scores = watched(py, None, |watch| {
        let campaign =
            Campaign { plan: &plan, seed, cases: &[index], directory: directory.path(), keep: false };
        campaign.run(&|case| explained(case, watch), &|_| (), &|| go_on(watch))
    })?;
    let score =
        scores.map_err(ended)?.pop().ok_or_else(|| PyRuntimeError::new_err("a case without a score"))?;
    python_of(py, &score)
}

/// The summary of the scores of a plan's cases against the plan's bars, as `schuler campaign` makes it.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "what pyo3 hands over")]
pub(crate) fn campaign_summary(
    py: Python<'_>,
    plan: PathBuf,
    scores: &Bound<'_, PyAny>,
) -> PyResult<Py<PyAny>> {
    let plan = read(&plan)?;
    let text: String = py.import("json")?.call_method1("dumps", (scores,))?.extract()?;
    let mut scores: Vec<CaseScore> =
        serde_json::from_str(&text).map_err(|error| wrong(format!("scores: {error}")))?;
    scores.sort_by_key(|score| score.index);
    python_of(py, &summary(&scores, &plan.plan.bars))
}

fn read(plan: &Path) -> PyResult<PlanFile> {
    Plan::read(plan).map_err(|error| unusable(&error))
}

fn explained(case: &Path, watch: &Shared) -> anyhow::Result<serde_json::Value> {
    let recording = Recording::read(case)?;
    let (explanation, _) = explain_watched(&recording, &Config::default(), watch)?;
    Ok(serde_json::to_value(explanation)?)
}

fn go_on(watch: &Shared) -> Result<(), Interrupted> {
    if watch.is_cancelled() { Err(Interrupted) } else { Ok(()) }
}

fn ended(ended: Ended) -> PyErr {
    match ended {
        Ended::File(error) => unusable(&error),
        other => wrong(other.to_string()),
    }
}
