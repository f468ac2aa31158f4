//! Smooth dependences on recorded quantities, for what no effect of the catalogue has.
//!
//! | on | columns |
//! | --- | --- |
//! | one quantity | a constant and a natural cubic spline |
//! | two | a constant, both, and their product |
//!
//! What depends so on what is recorded goes as some noise or shape in time does, which is then found in its place. It is told from them by how
//! likely the record is: what a dependence that is not there promises more than the noise that is, it does with a probability of e to the
//! power of less that.
use std::sync::Arc;

use rayon::prelude::*;

use crate::catalogue::Column;
use crate::description::Term;
use crate::inputs::Inputs;
use crate::inputs::series::{deviation, mean};
use crate::nominal::Source;
use crate::price::Price;
use crate::select::{Selection, speaks};
use crate::state::{Bench, Case};

/// Knots of a spline.
const KNOTS: usize = 6;
/// Nats by which a dependence must be the better description than what is not caused by anything recorded.
const WORTH_UNEXPLAINED: f64 = 10.0;

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
    pub evidence: f64,
}

/// Takes what nothing recorded causes, slow noise, steps, lines, out of a selection where a smooth dependence on what is recorded is the
/// better description, and gives these dependences.
pub fn in_the_place_of_uncaused<'c>(
    case: &'c Case<'c>,
    selection: &mut Selection<'c>,
    inputs: &Inputs<'_>,
    level: f64,
) -> Vec<Dependence> {
    let mut found = Vec::new();
    // One of each block: beside it, which is no term, the noise of another source would seem to be the same dependence.
    for block in &case.model.blocks {
        let instead = |&source: &usize| {
            let items = selection.uncaused(case, source);
            if items.is_empty() || case.watch.is_cancelled() {
                return None;
            }
            let (worth, less) = selection.without(case, &items, level.ln());
            // Where sources meet, what goes as the noise of one may be another's.
            let dependence = strongest(&less.1, inputs, &block.sources)?;
            let more = speaks(-dependence.evidence) + worth - selection.worth();
            (more > WORTH_UNEXPLAINED).then_some((more, less, dependence))
        };
        let best = block.sources.iter().filter_map(instead).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, less, dependence)) = best {
            selection.put(case, less);
            found.push(dependence);
        }
    }
    found
}

/// The dependence of one of some sources that shows most beside a description.
pub fn strongest(bench: &Bench<'_>, inputs: &Inputs<'_>, sources: &[usize]) -> Option<Dependence> {
    let quantities = quantities(inputs);
    let places = 0..quantities.len();
    let on = places.flat_map(|one| (0..one).map(Some).chain([None]).map(move |other| (one, other)));
    let tried: Vec<(usize, usize, Option<usize>)> =
        on.flat_map(|(one, other)| sources.iter().map(move |&source| (source, one, other))).collect();
    let ln_places = (tried.len() as f64).ln();
    let dependence = |&(source, one, other): &(usize, usize, Option<usize>)| {
        let (name, values) = &quantities[one];
        let (on, columns) = match other.map(|other| &quantities[other]) {
            None => (name.clone(), of_one(values)?),
            Some((other, others)) => (format!("{other} and {name}"), of_two(others, values)),
        };
        let (gain_nats, rank) = bench.gain_of(&term(&bench.case.model.sources[source], columns));
        let evidence = Price::among(rank, ln_places).evidence(gain_nats);
        Some(Dependence { source, on, gain_nats, evidence })
    };
    tried.par_iter().filter_map(dependence).max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// What a dependence may be on: the conditions, and how fast the body goes and turns whatever the direction.
fn quantities<'i>(inputs: &'i Inputs<'_>) -> Vec<(String, &'i [f64])> {
    let conditions = inputs.conditions().into_iter().map(|it| (it.name, it.values));
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
    let product = one.iter().zip(&other).map(|(one, other)| one * other).collect();
    vec![vec![1.0; one.len()], one, other, product]
}

/// Constant and natural cubic spline (linear, then one for each inner knot), knots at equal numbers of values; `None` of less than three knots.
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
