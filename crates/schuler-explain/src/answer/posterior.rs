//! How probable the items of the best description are, and what else each may be.
//!
//! An item stands against the descriptions that have another in its place, or none. Those that were scored are the whole;
//! each is as probable as its evidence says.
use crate::evidence::fit::{Bench, Description};
use crate::noise::trust::ln_sum;
use crate::search::beam::Beam;
use crate::search::beside::Beside;
use crate::search::library::{Shelf, offers};
use crate::search::moves::{Item, Structure, candidate_of, items, reached_by, structure};
use crate::search::scans::scans;

/// What an item may be.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// The item of the best description.
    pub item: Item,
    /// Logarithm of the odds that it or another in its place is there.
    pub ln_odds: f64,
    /// The candidates that may be it, by themselves or together with another, the most probable first, each with its probability given that
    /// some are in its place.
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
    let (best, scored) = (beam.best(), beam.scored());
    let own = structure(best);
    let of = |item: Item| {
        let (rest, candidate) = (structure_without(best, item), candidate_of(best, item));
        let mut absent: Vec<f64> = Vec::new();
        let mut alone: Vec<(usize, f64)> = vec![(candidate, best.ln_evidence)];
        let mut pairs: Vec<([usize; 2], f64)> = Vec::new();
        for (other, ln_evidence) in scored.iter().filter(|(other, _)| *other != own) {
            match more_than(other, &rest).as_deref() {
                Some([]) => absent.push(*ln_evidence),
                Some(&[member]) => alone.push((member, *ln_evidence)),
                Some(&[first, second]) => pairs.push(([first, second], *ln_evidence)),
                _ => {}
            }
        }
        let mut more = not_fitted(bench, library, best, item);
        more.retain(|(member, _)| alone.iter().all(|(known, _)| known != member));
        alone.extend(more);
        // Two stand in its place where neither would alone.
        pairs.retain(|(pair, ln_evidence)| {
            alone.iter().all(|(member, ln)| !pair.contains(member) || ln < ln_evidence)
        });
        let present = ln_sum(alone.iter().map(|(_, ln)| *ln).chain(pairs.iter().map(|(_, ln)| *ln)));
        let mut class: Vec<(usize, f64)> = Vec::new();
        let of_pairs = pairs.iter().flat_map(|(pair, ln)| pair.map(|member| (member, *ln)));
        for (member, ln) in alone.iter().copied().chain(of_pairs) {
            let probability = (ln - present).exp();
            match class.iter_mut().find(|(known, _)| *known == member) {
                Some((_, sum)) => *sum += probability,
                None => class.push((member, probability)),
            }
        }
        if absent.is_empty() {
            // A level is never taken out of the record that it has whitened; what had none is its absence.
            let lacks = |(other, _): &&(Structure, f64)| other.iter().all(|(known, _)| *known != candidate);
            absent.extend(scored.iter().filter(lacks).map(|(_, ln_evidence)| *ln_evidence));
        }
        let ln_odds = present - ln_sum(absent.iter().copied());
        class.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let least = class.first().map_or(0.0, |(_, most)| most * problem.config.least_class_probability);
        class.retain(|(member, probability)| *member == candidate || *probability >= least);
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
        // What was not fitted is no better than the best that was.
        .map(|offer| (offer.candidate, best.ln_evidence + (offer.ln_gain - of_own).min(0.0)))
        .filter(|(_, ln_evidence)| ln_evidence.is_finite())
        .collect()
}

/// The structure of a description without an item.
fn structure_without(description: &Description, item: Item) -> Structure {
    let mut less = description.clone();
    match item {
        Item::Placed(place) => drop(less.placed.remove(place)),
        Item::Change(place) => drop(less.changes.remove(place)),
    }
    structure(&less)
}

/// The candidates that a structure has beside another; none where it lacks something of that.
fn more_than(structure: &Structure, rest: &Structure) -> Option<Vec<usize>> {
    let mut others: Vec<usize> = structure.iter().map(|(candidate, _)| *candidate).collect();
    for (candidate, _) in rest {
        others.remove(others.iter().position(|other| other == candidate)?);
    }
    Some(others)
}
