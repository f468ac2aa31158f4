//! From a recording to its explanation: calls the stages.
//!
//! | module | gives |
//! | --- | --- |
//! | [`posterior`] | how probable the items of the best description are, and what else each may be |
//! | [`findings`] | findings with their parameters, from the exact likelihood of all rows |
pub mod findings;
pub mod posterior;

use schuler_recording::Recording;

use crate::arrays::arrays;
use crate::evidence::CaseArrays;
use crate::explain::{
    Error, account_for_lattices, as_explained, estimate_unknown, is_of_angle, long_enough, model_without,
    no_singular_noise, unless_cancelled,
};
use crate::explanation::{Explanation, FORMAT, Fit, Verdict};
use crate::hold_out::hold_out;
use crate::inputs::Inputs;
use crate::locate;
use crate::nominal::Model;
use crate::readings::{Fault, faults};
use crate::second::bands::sums::Sums;
use crate::second::config::Config;
use crate::second::evidence::fit::{Bench, Description};
use crate::second::evidence::regressor::regressors;
use crate::second::noise::fit::SourceKnob;
use crate::second::noise::weights::Covariances;
use crate::second::problem::{Problem, candidates, within_delays};
use crate::second::search::beam::{Beam, search};
use crate::second::search::levels::{levels, with_level};
use crate::second::search::library::{Shelf, library, whitened_again};
use crate::second::search::moves::{nothing, structure, take_back};
use crate::state::{Case, State};
use crate::watch::{Phase, Unwatched, Watch};

/// Passes in which the record is whitened anew by the noise that was found.
const PASSES: usize = 2;

/// Explains a recording by the catalogue.
///
/// # Errors
/// What in the recording or the case leaves nothing to explain.
pub fn explain(recording: &Recording, config: &Config) -> Result<Explanation, Error> {
    explain_watched(recording, config, &Unwatched).map(|(explanation, _)| explanation)
}

/// As [`explain`], with the arrays that show it, and watched.
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
    let unmasked = model_without(&[], &inputs)?;
    let mut faults = faults(&recording, &unmasked);
    let angles: Vec<Fault> = faults.found.extract_if(.., |fault| is_of_angle(&unmasked, fault)).collect();
    let of_angle: Vec<usize> = angles.iter().map(|fault| fault.sensor).collect();
    let mut model =
        if faults.found.is_empty() { unmasked.clone() } else { model_without(&faults.masked, &inputs)? };
    account_for_lattices(&mut model, &recording, &of_angle);
    let nuisances = estimate_unknown(&mut model);
    no_singular_noise(&model, &model.nominal_noises())?;
    let candidates = candidates(&inputs, &model);
    let model = within_delays(&model, &candidates);
    unless_cancelled(watch)?;
    let problem = Problem::new(&inputs, &model, candidates, config, watch);
    watch.progress(Phase::Search, 0.0);
    let searched = searched(&problem, &nuisances)?;
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 0.0);
    Ok(told(&searched, &faults.found, &nuisances))
}

/// The sums of all blocks whitened by given noises.
fn bench<'b>(problem: &'b Problem<'b>, noises: &[crate::noise::Noise]) -> Bench<'b> {
    let model = problem.model;
    let sums: Vec<Option<Sums>> =
        model.blocks.iter().map(|block| Sums::new(block, noises, problem.config)).collect();
    let constants = (model.constants.iter())
        .flat_map(|column| {
            regressors(model, &sums, std::slice::from_ref(column), crate::catalogue::Port::Output)
        })
        .filter(|constant| !constant.parts.is_empty())
        .collect();
    Bench { problem, sums, constants }
}

/// What a search came to.
struct Searched<'s> {
    bench: Bench<'s>,
    library: Vec<Shelf>,
    beam: Beam,
}

/// The search, again with the record whitened by what was found where that is far from what it was whitened by, and where the
/// innovations have another level in part of the rows.
fn searched<'b>(problem: &'b Problem<'b>, nuisances: &[SourceKnob]) -> Result<Searched<'b>, Error> {
    let singular = || Error::NothingToCompare("no description of the record can be computed".to_owned());
    let noises = problem.model.nominal_noises();
    let first = bench(problem, &noises);
    let start = nothing(&first, &noises, nuisances).ok_or_else(singular)?;
    let mut now = Searched::new(first, start);
    for _ in 1..PASSES {
        let best = &now.beam.descriptions[0];
        if !is_far(&now.bench, best) {
            break;
        }
        let again = bench(problem, &best.noises);
        let start = whitened_again(&again, best);
        let Some(start) = again.fitted_whole(&start) else { break };
        now = Searched::new(again, start);
    }
    for _ in 0..problem.config.most_levels {
        let Some(leveled) = now.with_level() else { break };
        now = leveled;
    }
    Ok(now)
}

impl<'s> Searched<'s> {
    fn new(bench: Bench<'s>, start: Description) -> Self {
        let library = library(bench.problem, &bench.sums);
        let beam = search(&bench, &library, start);
        Self { bench, library, beam }
    }

    /// The search with the level that the best description promises, if that is better; the record without it is an alternative.
    fn with_level(&self) -> Option<Self> {
        let problem = self.bench.problem;
        let best = &self.beam.descriptions[0];
        let level = levels(&self.bench, best).into_iter().next().filter(|level| level.ln_gain > 0.0)?;
        let (bench, start) = with_level(best, &level, &|noises| bench(problem, noises))?;
        let mut leveled = Self::new(bench, start);
        let found = &leveled.beam.descriptions[0];
        if found.ln_evidence <= best.ln_evidence {
            return None;
        }
        let mut rest = found.clone();
        let place = rest.changes.iter().position(|change| *change == level.change)?;
        let change = rest.changes.remove(place);
        take_back(&leveled.bench, &mut rest, &change);
        let rest = self.bench.fitted_whole(&whitened_again(&self.bench, &rest));
        let without = self.beam.descriptions.iter().chain(rest.as_ref());
        leveled.beam.others.extend(self.beam.others.iter().cloned());
        leveled.beam.others.extend(without.map(|it| (structure(it), it.ln_evidence)));
        Some(leveled)
    }
}

/// Whether the noise of a description is far from what the record was whitened by.
fn is_far(bench: &Bench<'_>, description: &Description) -> bool {
    let limit = bench.problem.config.whiten_again_at.ln();
    bench.problem.model.blocks.iter().zip(&bench.sums).any(|(block, sums)| {
        let Some(sums) = sums else { return false };
        let width = sums.width() as f64;
        Covariances::new(block, sums, &description.noises).is_some_and(|covariances| {
            covariances.ln_determinant.iter().any(|value| (value / width).abs() > limit)
        })
    })
}

/// The explanation that the descriptions of a search tell.
fn told(searched: &Searched<'_>, faults: &[Fault], nuisances: &[SourceKnob]) -> (Explanation, CaseArrays) {
    let Searched { bench, library, beam } = searched;
    let problem = bench.problem;
    let (inputs, model, config) = (problem.inputs, problem.model, problem.config);
    let case = Case::new(model, &problem.candidates, &inputs.time_s, problem.watch);
    let best = &beam.descriptions[0];
    let posterior = posterior::posterior(bench, library, beam);
    let null = State {
        terms: Vec::new(),
        noises: model.nominal_noises(),
        changes: Vec::new(),
        nuisances: nuisances.to_vec(),
        log_likelihood: f64::NEG_INFINITY,
        told_beside: 0.0,
    };
    let (null, _) = crate::state::refitted(&case, &null, None);
    let state = findings::exact(&case, best);
    let mut found = findings::findings(&case, &state, best, &posterior, config);
    found.extend(findings::of_faults(inputs, &case, faults));
    findings::in_order(&mut found);
    let located = locate::locate(&case, &null, inputs);
    let (left, remainder) = match findings::unnamed(&case, &posterior, config) {
        Some(unnamed) => (true, Some(unnamed)),
        None => locate::left(&case, &state, inputs, &[]),
    };
    let verdict = match (found.is_empty(), left) {
        (true, false) => Verdict::NoMismatch,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
    };
    let fit = if config.hold_out { hold_out(&case, &null, &state) } else { Fit::default() };
    let mut notes = inputs.recording.warnings.clone();
    notes.extend(model.notes.iter().cloned());
    let shown = arrays(&case, &null, &state, &found);
    (Explanation { format: FORMAT, verdict, findings: found, fit, located, remainder, notes }, shown)
}

/// Whether the noise of a source is not stated.
pub(crate) fn is_unstated(model: &Model, source: usize) -> bool {
    model.sources[source].unknown
}
