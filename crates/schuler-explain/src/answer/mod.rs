//! From the best descriptions of a search to an explanation.
//!
//! | module | gives |
//! | --- | --- |
//! | [`posterior`] | how probable the items of the best description are, and what else each may be |
//! | [`polish`] | its non-linear parameters at their best beside each other |
//! | [`parameters`] | values with standard deviations |
//! | [`findings`] | findings in words and numbers |
//! | [`held_out`] | how well it predicts what it was not fitted to |
//! | [`located`] | where record and simulation differ, and what is left |
//! | [`mod@arrays`] | what shows that it holds |
//! | [`shares`] | which share of the mismatch each finding explains |
//! | [`impact`] | what they do to a navigation solution |
//! | [`noise_table`] | the noise of every sensor |
//! | [`certificate`] | what could still hide |
//! | [`mod@model`] | what the findings add, as a model for a simulation |
//! | [`unstated`] | the noise of sensors of which the case states none |
pub mod arrays;
pub mod certificate;
pub mod findings;
pub mod held_out;
pub mod impact;
pub mod located;
pub mod model;
pub mod noise_table;
pub mod parameters;
pub mod polish;
pub mod posterior;
pub mod shares;
pub mod unstated;

use arrays::arrays;
use held_out::hold_out;
use polish::polished;

use crate::diagnostics::CaseArrays;
use crate::exact::OverRows;
use crate::explanation::{Explanation, FORMAT, Fit, Verdict};
use crate::problem::prepared::Prepared;
use crate::search::Searched;
use crate::search::moves::nothing;
use crate::watch::Phase;

/// The explanation that the descriptions of a search tell, with the arrays that show it.
pub fn told(searched: &Searched<'_>, prepared: &mut Prepared) -> (Explanation, CaseArrays) {
    let Searched { bench, library, beam } = searched;
    let (inputs, config) = (bench.problem.inputs, bench.problem.config);
    let watch = bench.problem.watch;
    let posterior = posterior::posterior(bench, library, beam);
    watch.progress(Phase::Refine, 0.0);
    let best = polished(bench, beam.best());
    let null = nothing(bench, &prepared.model.nominal_noises(), &prepared.unstated);
    let null = null.unwrap_or_else(|| best.clone());
    let (before, after) = (OverRows::new(bench, &null), OverRows::new(bench, &best));
    let mut found = findings::findings(&after, &posterior);
    found.extend(findings::of_readings(&after, prepared));
    findings::in_order(&mut found);
    let (shares, explained_share) = shares::shares(&after, &found);
    let (impacts, impact) = impact::impacts(&after, &found);
    for ((finding, share), impact) in found.iter_mut().zip(shares).zip(impacts) {
        (finding.share, finding.impact) = (share, impact);
    }
    let noise = noise_table::noise_table(&after, prepared);
    let unnamed = findings::unnamed(bench, &best, &posterior);
    let remainder = unnamed.or_else(|| located::left(&after));
    let verdict = match (found.is_empty(), remainder.is_some()) {
        (true, false) => Verdict::NoMismatch,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
    };
    watch.progress(Phase::Judge, 0.0);
    let fit =
        if config.hold_out && !watch.is_cancelled() { hold_out(bench, &null, &best) } else { Fit::default() };
    let located = located::located(&before);
    let mut notes = inputs.recording.warnings.clone();
    notes.extend(prepared.model.notes.iter().cloned());
    notes.extend(unstated::notes(&prepared.model, &best));
    let mut shown = arrays(&before, &after, &found);
    shown.model = model::model(&after, &found, &fit);
    let certificate = if config.certify && !watch.is_cancelled() {
        certificate::certificate(bench, library, &best)
    } else {
        Vec::new()
    };
    let explanation = Explanation {
        format: FORMAT,
        verdict,
        findings: found,
        fit,
        located,
        remainder,
        explained_share,
        impact,
        noise,
        certificate,
        notes,
    };
    (explanation, shown)
}
