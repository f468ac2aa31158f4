//! From a recording to an [`Explanation`]: calls the stages.
use schuler_recording::{Problem as ProblemOfCase, Recording};
use thiserror::Error;

use crate::answer::told;
use crate::catalogue::Candidate;
use crate::config::Config;
use crate::diagnostics::CaseArrays;
use crate::explanation::Explanation;
use crate::inputs::Inputs;
use crate::problem::prepared::{as_explained, long_enough, prepared};
use crate::problem::{Problem, catalogued, searchable, within_delays};
use crate::search::searched;
use crate::watch::{Phase, Unwatched, Watch};

/// Why nothing can be explained.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum Error {
    /// The record is too short.
    #[error("the recording has {rows} rows; expected at least {least}")]
    TooShort {
        /// Rows found.
        rows: usize,
        /// Rows needed.
        least: usize,
    },
    /// No sensor can be compared with the simulation.
    #[error("{0}")]
    NothingToCompare(String),
    /// The nominal noise of a sensor is singular.
    #[error("{sensor}: the nominal noise makes the model singular: {what}")]
    Singular {
        /// The sensors.
        sensor: String,
        /// What is wrong.
        what: String,
    },
    /// An effect that the case defines cannot be sought.
    #[error("{field}: {message}")]
    Effect {
        /// Line of the effect in the case, where it has one.
        line: Option<usize>,
        /// The field.
        field: String,
        /// What was found and what was expected.
        message: String,
    },
    /// Whoever watches has ended it.
    #[error("cancelled")]
    Cancelled,
    /// What decides is out of range.
    #[error("{name}: found {found}; expected {expected}")]
    Config {
        /// Name of the field.
        name: &'static str,
        /// What it is.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
}

impl Error {
    /// The same as a problem of the case.
    pub fn problem(&self) -> ProblemOfCase {
        match self {
            Self::Effect { line, field, message } => ProblemOfCase::new(*line, field, message),
            other => ProblemOfCase::of_file(other.to_string()),
        }
    }
}

/// Explains a recording by the catalogue and by the effects that its case defines.
///
/// # Errors
/// What in the recording or the case leaves nothing to explain.
pub fn explain(recording: &Recording, config: &Config) -> Result<Explanation, Error> {
    explain_watched(recording, config, &Unwatched).map(|(explanation, _)| explanation)
}

/// As [`explain`], with the arrays that show it, and watched: it tells how far it has come, and ends with
/// [`Error::Cancelled`] when it is told to.
///
/// # Errors
/// As [`explain`], and [`Error::Cancelled`].
pub fn explain_watched(
    recording: &Recording,
    config: &Config,
    watch: &dyn Watch,
) -> Result<(Explanation, CaseArrays), Error> {
    config.check()?;
    long_enough(recording)?;
    watch.progress(Phase::Prepare, 0.0);
    let recording = as_explained(recording);
    let inputs = Inputs::new(&recording);
    unless_cancelled(watch)?;
    watch.progress(Phase::Prepare, 0.3);
    explained(&inputs, None, config, watch)
}

/// Explains a recording by given candidates.
///
/// # Errors
/// As [`explain`].
pub fn explain_with(
    inputs: &Inputs<'_>,
    candidates: Vec<Candidate>,
    config: &Config,
) -> Result<Explanation, Error> {
    config.check()?;
    long_enough(inputs.recording)?;
    explained(inputs, Some(candidates), config, &Unwatched).map(|(explanation, _)| explanation)
}

/// The stages one after the other; without `given` candidates those of the whole catalogue.
fn explained(
    inputs: &Inputs<'_>,
    given: Option<Vec<Candidate>>,
    config: &Config,
    watch: &dyn Watch,
) -> Result<(Explanation, CaseArrays), Error> {
    let mut prepared = prepared(inputs, config)?;
    let candidates = match given {
        Some(given) => given,
        None => catalogued(inputs)?,
    };
    let candidates = searchable(candidates, &prepared);
    let model = within_delays(&prepared.model, &candidates);
    let problem = Problem::new(inputs, &model, candidates, config, watch);
    unless_cancelled(watch)?;
    watch.progress(Phase::Search, 0.0);
    let searched = searched(&problem, &prepared.unstated)?;
    unless_cancelled(watch)?;
    let answer = told(&searched, &mut prepared);
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 1.0);
    Ok(answer)
}

fn unless_cancelled(watch: &dyn Watch) -> Result<(), Error> {
    if watch.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
}
