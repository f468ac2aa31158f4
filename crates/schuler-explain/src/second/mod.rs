//! The second engine: one evidence for a description of the record, one search between descriptions, one answer.
//!
//! | folder | stage |
//! | --- | --- |
//! | [`problem`] | the recording against its nominal model, and what may have been left out |
//! | [`bands`] | the whitened record as sums of products over bands |
//! | [`noise`] | spectra of the noise, how far they are believed, their fit |
//! | [`evidence`] | the one number of a description |
//! | [`search`] | from description to description |
//! | [`exact`] | the few that stand, over all rows |
//! | [`answer`] | from the best descriptions to an explanation |
pub mod answer;
pub mod bands;
pub mod config;
pub mod evidence;
pub mod exact;
pub mod noise;
pub mod problem;
pub mod search;

use answer::told;
use config::Config;
use problem::prepared::prepared;
use problem::{Problem, candidates, within_delays};
use schuler_recording::Recording;
use search::searched;

use crate::evidence::CaseArrays;
use crate::explain::{Error, as_explained, long_enough, unless_cancelled};
use crate::explanation::Explanation;
use crate::inputs::Inputs;
use crate::watch::{Phase, Unwatched, Watch};

/// Explains a recording by the catalogue.
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
    long_enough(recording)?;
    watch.progress(Phase::Prepare, 0.0);
    let recording = as_explained(recording);
    let inputs = Inputs::new(&recording);
    unless_cancelled(watch)?;
    watch.progress(Phase::Prepare, 0.3);
    let mut prepared = prepared(&inputs, config)?;
    let candidates = candidates(&inputs, &prepared);
    let model = within_delays(&prepared.model, &candidates);
    let problem = Problem::new(&inputs, &model, candidates, config, watch);
    unless_cancelled(watch)?;
    watch.progress(Phase::Search, 0.0);
    let searched = searched(&problem, &prepared.unstated)?;
    unless_cancelled(watch)?;
    let answer = told(&searched, &mut prepared);
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 1.0);
    Ok(answer)
}
