//! Smooth dependences on recorded quantities, for what no effect of the catalogue has.
//!
//! | on | columns |
//! | --- | --- |
//! | one quantity | a constant and a natural cubic spline |
//! | two | a constant, both, and their product |
//!
//! What depends so on what is recorded goes as slow noise does, which is then found in its place. The two are told apart by how likely the
//! record is under each.
use std::sync::Arc;

use rayon::prelude::*;

use crate::catalogue::Column;
use crate::description::Term;
use crate::explanation::Finding;
use crate::inputs::series::{deviation, mean, product};
use crate::inputs::{Condition, Inputs};
use crate::nominal::Source;
use crate::price::Price;
use crate::select::{Item, Selection, is_of_slow_noise, speaks};
use crate::state::{Accepted, Bench, Case, State};

/// Knots of a spline.
const KNOTS: usize = 6;
/// Nats by which a record must be likelier under a dependence, after what its parameters and places cost, than under slow noise: to one in a
/// thousand.
const LIKELIER: f64 = 6.9;

/// A dependence on recorded quantities.
#[derive(Clone, Debug)]
pub struct Dependence {
    /// The source's place.
    pub source: usize,
    /// The quantities.
    pub on: String,
    /// What it gains, nats.
    pub gain_nats: f64,
    /// −ln p of the gain, over all dependences that were tried.
    evidence: f64,
    /// Candidates of terms in whose place it is, beside the source's slow noise.
    terms: Vec<usize>,
}

impl Dependence {
    /// Whether it is in the place of a finding of a description.
    pub fn replaces(&self, case: &Case<'_>, state: &State, finding: &Finding) -> bool {
        let is_noise = |change: &&Accepted| change.source == self.source && is_of_slow_noise(change);
        let noises = state.changes.iter().filter(is_noise).map(|change| change.candidate);
        let mut replaced = noises.chain(self.terms.iter().copied());
        finding.sensor == case.model.sources[self.source].name
            && replaced.any(|candidate| case.candidates[candidate].effect.id == finding.effect)
    }
}

/// Dependences that describe the record better than the slow noise that was selected of a source, and the shapes in time beside it that nothing
/// recorded causes. The description keeps these: they stand for what has no name.
pub fn in_the_place_of_noise(
    case: &Case<'_>,
    selection: &Selection<'_>,
    inputs: &Inputs<'_>,
) -> Vec<Dependence> {
    let of_source = |source: usize| {
        let (noises, terms) = selection.uncaused(case, source);
        if noises.is_empty() {
            return None;
        }
        let instead = |terms: &[Item]| {
            let (less, saved) = selection.without(case, &[&noises, terms].concat(), terms);
            let bench = Bench::new(case, &less.terms, &less.noises);
            let dependence = strongest(&bench, inputs, source)?;
            let more =
                bench.log_likelihood + saved + speaks(-dependence.evidence) - selection.state.log_likelihood;
            let candidate = |item: &Item| match *item {
                Item::Term(place) => Some(selection.state.terms[place].candidate),
                Item::Change(_) => None,
            };
            let terms = terms.iter().filter_map(candidate).collect();
            (more > LIKELIER).then_some((more, Dependence { terms, ..dependence }))
        };
        let alone = instead(&[]);
        let with_terms = if terms.is_empty() { None } else { instead(&terms) };
        alone
            .into_iter()
            .chain(with_terms)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, dependence)| dependence)
    };
    (0..case.model.sources.len()).filter_map(of_source).collect()
}

/// The dependence of a source that shows most beside a description.
fn strongest(bench: &Bench<'_>, inputs: &Inputs<'_>, source: usize) -> Option<Dependence> {
    let quantities = quantities(inputs);
    let places = 0..quantities.len();
    let tried: Vec<(usize, Option<usize>)> =
        places.flat_map(|one| (0..one).map(Some).chain([None]).map(move |other| (one, other))).collect();
    let ln_places = (tried.len() as f64).ln();
    let dependence = |&(one, other): &(usize, Option<usize>)| {
        if bench.case.watch.is_cancelled() {
            return None;
        }
        let (name, values) = &quantities[one];
        let (on, columns) = match other.map(|other| &quantities[other]) {
            None => (name.clone(), of_one(values)?),
            Some((other, others)) => (format!("{other} and {name}"), of_two(others, values)),
        };
        let (gain_nats, rank) = bench.gain_of(&term(&bench.case.model.sources[source], columns));
        let evidence = Price::among(rank, ln_places).evidence(gain_nats);
        Some(Dependence { source, on, gain_nats, evidence, terms: Vec::new() })
    };
    tried.par_iter().filter_map(dependence).max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// What a smooth function of one quantity gains beside a description, nats; `None` of a quantity that has too few values.
pub fn gain_of_one(bench: &Bench<'_>, source: usize, values: &[f64]) -> Option<f64> {
    Some(bench.gain_of(&term(&bench.case.model.sources[source], of_one(values)?)).0)
}

/// What a dependence may be on: the conditions, and how fast the body goes and turns whatever the direction. A motion that is estimated from
/// the readings themselves is none.
fn quantities<'i>(inputs: &'i Inputs<'_>) -> Vec<(String, &'i [f64])> {
    let is_recorded = |condition: &Condition<'_>| !(inputs.motion.estimated && condition.of_motion);
    let conditions = inputs.conditions().into_iter().filter(is_recorded).map(|it| (it.name, it.values));
    let of_motion = inputs.loudness().iter().map(|it| (it.name.to_owned(), &*it.values));
    conditions.chain(of_motion).collect()
}

/// A term without a candidate.
fn term(source: &Source, columns: Vec<Vec<f64>>) -> Term {
    Term {
        candidate: usize::MAX,
        nonlinear: Vec::new(),
        columns: Arc::new(columns.into_iter().map(|values| Column::on(source.sensor, values)).collect()),
        port: source.port,
        unit_amplitude: false,
        of_the_motion: false,
        delay_s: None,
    }
}

/// Constant, both quantities in standard deviations from their means, and the product.
fn of_two(one: &[f64], other: &[f64]) -> Vec<Vec<f64>> {
    let standard = |values: &[f64]| -> Vec<f64> {
        let (mean, deviation) = (mean(values), deviation(values));
        values.iter().map(|value| (value - mean) / deviation).collect()
    };
    let (one, other) = (standard(one), standard(other));
    let both = product(&one, &other);
    vec![vec![1.0; one.len()], one, other, both]
}

/// Constant and natural cubic spline (linear, then one for each inner knot), knots at equal numbers of values; `None` of fewer than three knots.
/// `[Hastie, Tibshirani & Friedman, The Elements of Statistical Learning, eq. 5.4–5.5]`
fn of_one(values: &[f64]) -> Option<Vec<Vec<f64>>> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut knots: Vec<f64> =
        (0..KNOTS).filter_map(|knot| sorted.get(knot * (sorted.len() - 1) / (KNOTS - 1)).copied()).collect();
    knots.dedup();
    let ([first, _, .., last], number) = (&knots[..], knots.len()) else { return None };
    let (first, span) = (*first, last - first);
    let knots: Vec<f64> = knots.iter().map(|knot| (knot - first) / span).collect();
    let cube = |value: f64| value.max(0.0).powi(3);
    let basis = |x: f64| {
        let d =
            |k: usize| (cube(x - knots[k]) - cube(x - knots[number - 1])) / (knots[number - 1] - knots[k]);
        let mut row = vec![1.0, x];
        row.extend((0..number - 2).map(|k| d(k) - d(number - 2)));
        row
    };
    let mut columns = vec![Vec::with_capacity(values.len()); number];
    for value in values {
        for (column, part) in columns.iter_mut().zip(basis((value - first) / span)) {
            column.push(part);
        }
    }
    Some(columns)
}
