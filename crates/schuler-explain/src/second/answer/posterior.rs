//! How probable the items of the best description are, and what else each may be.
//!
//! An item stands against the descriptions that have another in its place, or none. Those that were scored are the whole;
//! each is as probable as its evidence says.
use crate::second::evidence::fit::{Bench, Description};
use crate::second::noise::trust::ln_sum;
use crate::second::search::beam::Beam;
use crate::second::search::beside::Beside;
use crate::second::search::library::{Shelf, offers};
use crate::second::search::moves::{Item, items, reached_by, structure};
use crate::second::search::scans::scans;

/// What an item may be.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// The item of the best description.
    pub item: Item,
    /// Logarithm of the odds that it or another in its place is there.
    pub ln_odds: f64,
    /// The candidates that may be it, the most probable first, each with its probability given that one of them is.
    pub class: Vec<(usize, f64)>,
}

impl Posterior {
    /// Probability that it or another in its place is there.
    pub fn probability(&self) -> f64 {
        (1.0 + (-self.ln_odds).exp()).recip()
    }
}

/// The items of the best description with their probabilities.
pub fn posterior(bench: &Bench<'_>, library: &[Shelf], beam: &Beam) -> Vec<Posterior> {
    let problem = bench.problem;
    let Some(best) = beam.descriptions.first() else { return Vec::new() };
    let own = structure(best);
    let scored: Vec<_> = (beam.descriptions.iter().map(|it| (structure(it), it.ln_evidence)))
        .chain(beam.others.iter().cloned())
        .collect();
    let of = |item: Item| {
        let (rest, candidate) = rest_of(best, item);
        let mut absent: Vec<f64> = Vec::new();
        let mut members: Vec<(usize, Vec<f64>)> = vec![(candidate, vec![best.ln_evidence])];
        for (other, ln_evidence) in scored.iter().filter(|(other, _)| *other != own) {
            match more_than(other, &rest) {
                More::Nothing => absent.push(*ln_evidence),
                More::One(member) => match members.iter_mut().find(|(known, _)| *known == member) {
                    Some((_, all)) => all.push(*ln_evidence),
                    None => members.push((member, vec![*ln_evidence])),
                },
                More::Other => {}
            }
        }
        for (member, ln_evidence) in not_fitted(bench, library, best, item) {
            if members.iter().all(|(known, _)| *known != member) {
                members.push((member, vec![ln_evidence]));
            }
        }
        let mut class: Vec<(usize, f64)> =
            members.into_iter().map(|(member, all)| (member, ln_sum(all.iter().copied()))).collect();
        let present = ln_sum(class.iter().map(|(_, ln)| *ln));
        if absent.is_empty() {
            // A level is never taken out of the record that it has whitened; what had none is its absence.
            let lacks = |(other, _): &&(Structure, f64)| other.iter().all(|(known, _)| *known != candidate);
            absent.extend(scored.iter().filter(lacks).map(|(_, ln_evidence)| *ln_evidence));
        }
        let ln_odds = present - ln_sum(absent.iter().copied());
        for (_, ln) in &mut class {
            *ln = (*ln - present).exp();
        }
        class.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let least = class.first().map_or(0.0, |(_, most)| most * problem.config.least_class_probability);
        class.retain(|(_, probability)| *probability >= least);
        Posterior { item, ln_odds, class }
    };
    items(best).into_iter().map(of).collect()
}

/// Candidates in the place of an effect with the evidence that they would have, by their gain in closed form against that of the
/// effect under the same weights: more are alike than are fitted.
fn not_fitted(bench: &Bench<'_>, library: &[Shelf], best: &Description, item: Item) -> Vec<(usize, f64)> {
    let Item::Placed(place) = item else { return Vec::new() };
    let mut rest = best.clone();
    let own = rest.placed.remove(place);
    let Some(beside) = Beside::as_trusted(bench, &rest) else { return Vec::new() };
    let candidate = &bench.problem.candidates[own.term.candidate];
    let described = beside.described();
    let of_own = beside.ln_gain(&described, &own.regressors, candidate, own.term.unit_amplitude)
        + own.ln_spread
        + bench.problem.ln_prior[own.term.candidate];
    let among = reached_by(bench, best, item);
    (offers(&beside, library, &among).into_iter().chain(scans(&beside, &among)))
        .map(|offer| (offer.candidate, best.ln_evidence + offer.ln_gain - of_own))
        .filter(|(_, ln_evidence)| ln_evidence.is_finite())
        .collect()
}

type Structure = Vec<(usize, Vec<String>)>;

/// The structure of a description without an item, and the item's candidate.
fn rest_of(description: &Description, item: Item) -> (Structure, usize) {
    let mut less = description.clone();
    let candidate = match item {
        Item::Placed(place) => less.placed.remove(place).term.candidate,
        Item::Change(place) => less.changes.remove(place).candidate,
    };
    (structure(&less), candidate)
}

/// What a structure has beside another.
enum More {
    /// Nothing: they are the same.
    Nothing,
    /// One candidate.
    One(usize),
    /// More, or it lacks something.
    Other,
}

fn more_than(structure: &Structure, rest: &Structure) -> More {
    let mut others = structure.clone();
    for (candidate, _) in rest {
        match others.iter().position(|(other, _)| other == candidate) {
            Some(at) => others.remove(at),
            None => return More::Other,
        };
    }
    match others.as_slice() {
        [] => More::Nothing,
        [(candidate, _)] => More::One(*candidate),
        _ => More::Other,
    }
}
