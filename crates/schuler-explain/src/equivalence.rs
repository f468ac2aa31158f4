//! What the data cannot tell from a finding.
//!
//! With x = (1 − ρ²) · gain the log-likelihoods of a wrong and of the true candidate differ by a normal variable with
//! mean −x and variance 2x, so that a wrong one leads by more than c with a probability of at most Φ(−√(2c)), whatever
//! x is: 0.7 % for c = 3. Identifiers on the same sensor within that distance of the best are the finding's class;
//! others are its rivals.
use std::collections::HashSet;

use crate::catalogue::{Candidate, Search};
use crate::description::{Term, blocks_of};
use crate::explanation::Rival;
use crate::nominal::Model;
use crate::search::{Family, deterministic, evidence, library};
use crate::select::{Item, Price, touches, without};
use crate::state::{Bench, Case, State, refitted};

/// Nats behind the best within which an identifier belongs to the class.
pub const CLASS_NATS: f64 = 3.0;

/// One way to describe what a finding describes.
#[derive(Clone, Debug)]
pub struct Alternative {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The term, if it is one.
    pub term: Option<Term>,
    /// −ln p.
    pub evidence: f64,
    /// How it is judged.
    pub price: Price,
}

/// Name of what a candidate acts on.
pub fn target_name(model: &Model, candidate: &Candidate) -> String {
    match &candidate.target {
        crate::catalogue::Target::Group { name, .. } => name.clone(),
        crate::catalogue::Target::Sensor(sensor) => model
            .source_of(*sensor, candidate.port)
            .and_then(|source| model.sources.get(source))
            .map_or_else(String::new, |source| source.name.clone()),
    }
}

/// All ways to describe what `item` describes that are within the class's distance of the best, best first.
pub fn alternatives(
    case: &Case<'_>,
    state: &State,
    item: Item,
    family: &Family,
) -> (Vec<Alternative>, State) {
    let model = case.model;
    let blocks = match item {
        Item::Term(place) => blocks_of(model, std::slice::from_ref(&state.terms[place])),
        Item::Change(place) => {
            let source = state.changes[place].source;
            (0..model.blocks.len()).filter(|&block| model.blocks[block].sources.contains(&source)).collect()
        }
    };
    let (less, bench) = without(case, state, item);
    let touched = |candidate: usize| touches(case, candidate, &blocks);
    let mut found: Vec<Alternative> = Vec::new();
    // Under the noises fitted with the item, which are those that the terms are to be compared under.
    let mut kept = less.clone();
    if matches!(item, Item::Term(_)) {
        kept.noises.clone_from(&state.noises);
    }
    let kept_bench = Bench::new(case, &kept.terms, &kept.noises);
    let free = blocks.iter().any(|&block| !kept.free_in(model, block).is_empty());
    for proposal in deterministic(&kept_bench, &library(&kept_bench, false, &touched), family, &touched) {
        let mut evidence_here = proposal.evidence;
        if free {
            let mut with = kept.clone();
            with.terms.push(proposal.term.clone());
            let (with, _) = refitted(case, &with, Some(&blocks));
            evidence_here =
                evidence(with.log_likelihood - less.log_likelihood, proposal.freedom, proposal.ln_places);
        }
        found.push(Alternative {
            candidate: proposal.term.candidate,
            price: Price { freedom: proposal.freedom, ln_places: proposal.ln_places },
            term: Some(proposal.term),
            evidence: evidence_here,
        });
    }
    for (candidate, fit) in bench.noise_changes(&less) {
        if blocks.iter().any(|&block| model.blocks[block].sources.contains(&fit.source)) {
            found.push(Alternative {
                candidate,
                term: None,
                evidence: -fit.ln_p,
                price: Price { freedom: fit.freedom, ln_places: fit.ln_places },
            });
        }
    }
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let best = found.first().map_or(0.0, |best| best.evidence);
    found.retain(|alternative| alternative.evidence > best - CLASS_NATS);
    prefer_instrument(case, &mut found);
    (found, less)
}

/// What one sensor shows and its whole instrument explains as well is of the instrument: a mounting, a clock.
fn prefer_instrument(case: &Case<'_>, found: &mut [Alternative]) {
    let Some(first) = found.first().map(|first| &case.candidates[first.candidate]) else { return };
    let crate::catalogue::Target::Sensor(sensor) = first.target else { return };
    let whole = found.iter().position(|other| {
        let candidate = &case.candidates[other.candidate];
        candidate.effect.id == first.effect.id
            && matches!(&candidate.target, crate::catalogue::Target::Group { sensors, .. } if sensors.contains(&sensor))
    });
    if let Some(whole) = whole {
        found[..=whole].rotate_right(1);
    }
}

/// The class of the first of `alternatives` and its rivals.
pub fn class(case: &Case<'_>, bench: &Bench<'_>, alternatives: &[Alternative]) -> (Vec<String>, Vec<Rival>) {
    let Some(first) = alternatives.first() else { return (Vec::new(), Vec::new()) };
    let own = &case.candidates[first.candidate];
    let name = target_name(case.model, own);
    let mut class = vec![own.effect.id.to_owned()];
    let mut rivals = Vec::new();
    let mut seen = HashSet::from([(name.clone(), own.effect.id)]);
    for other in alternatives.iter().skip(1) {
        let candidate = &case.candidates[other.candidate];
        let sensor = target_name(case.model, candidate);
        if !seen.insert((sensor.clone(), candidate.effect.id)) {
            continue;
        }
        let angle = match (&first.term, &other.term) {
            (Some(a), Some(b)) => bench.angle_deg(a, b),
            _ => 90.0,
        };
        if sensor == name {
            class.push(candidate.effect.id.to_owned());
        }
        rivals.push(Rival {
            sensor,
            effect: candidate.effect.id.to_owned(),
            principal_angle_deg: angle,
            behind_nats: first.evidence - other.evidence,
            separated_by: separated_by(own, candidate),
        });
    }
    (class, rivals)
}

fn separated_by(own: &Candidate, other: &Candidate) -> String {
    if matches!(other.search, Search::Noise(_)) && !matches!(own.search, Search::Noise(_)) {
        return own.effect.separated_by.to_owned();
    }
    other.effect.separated_by.to_owned()
}
