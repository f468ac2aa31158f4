//! Two effects at once: a constant of a sensor and what else it has. Where a dependence is none at the mean of what it depends on, or a
//! drift passes through zero amid the record, either alone shows little.
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::beside::Beside;
use super::known::Known;
use super::library::{Offer, Shelf, placed};
use super::moves::touched_by;
use crate::description::{Delays, Term};
use crate::evidence::fit::{Bench, Description, Placed};
use crate::evidence::regressor::Regressor;
use crate::noise::trust::ln_mean;

/// A constant and what it would be with.
struct Pair<'s> {
    constant: &'s Shelf,
    with: Offer,
}

/// The best descriptions that have such a pair more in some of the blocks, fitted; what promises less than `behind` the best that is known
/// is not.
pub fn with_pairs(
    bench: &Bench<'_>,
    library: &[Shelf],
    known: &Known,
    description: &Description,
    among: &[usize],
    behind: f64,
) -> Vec<Description> {
    let config = bench.problem.config;
    // A large misfit is not believed where it is a pair that makes it.
    let ways = [Beside::trusting(bench, description), Beside::as_trusted(bench, description)];
    let mut pairs: Vec<Pair<'_>> = ways.iter().flatten().flat_map(|way| pairs(way, library, among)).collect();
    pairs.retain(|pair| pair.with.ln_gain > behind - config.within_reach);
    pairs.sort_by(|a, b| {
        b.with.ln_gain.total_cmp(&a.with.ln_gain).then(a.with.candidate.cmp(&b.with.candidate))
    });
    let mut seen = HashSet::new();
    pairs.retain(|pair| seen.insert((pair.constant.candidate, pair.with.candidate)));
    pairs.truncate(config.fitted_moves);
    let mut of_constants: HashMap<usize, Option<Description>> = HashMap::new();
    for pair in &pairs {
        let fitted = of_constants.entry(pair.constant.candidate);
        fitted.or_insert_with(|| with_constant(bench, description, pair.constant));
    }
    let with_both = |pair: &Pair<'_>| {
        let base = of_constants.get(&pair.constant.candidate)?.as_ref()?;
        let effect = placed(&Beside::as_trusted(bench, base)?, &pair.with)?;
        let touched = touched_by(&effect);
        known.if_worth(bench, base, &touched, pair.with.candidate, || {
            let mut more = base.clone();
            more.placed.push(effect);
            bench.fitted(&more, &touched)
        })
    };
    pairs.par_iter().filter_map(with_both).collect()
}

/// The pairs that promise more than either of their effects alone.
fn pairs<'s>(beside: &Beside<'_>, library: &'s [Shelf], among: &[usize]) -> Vec<Pair<'s>> {
    let problem = beside.bench.problem;
    let described = beside.described();
    let is_placed = |shelf: &Shelf| {
        beside.description.placed.iter().any(|placed| placed.term.candidate == shelf.candidate)
    };
    let gain = |shelf: &Shelf, regressors: &[Regressor]| {
        beside.ln_gain(&described, regressors, &problem.candidates[shelf.candidate], false)
    };
    let is_free = |shelf: &&Shelf| {
        !shelf.is_unit && !is_placed(shelf) && shelf.blocks.iter().any(|block| among.contains(block))
    };
    let of_constant = |constant: &'s Shelf| {
        let own = &constant.points[0].1;
        let alone = gain(constant, own);
        let (target, port) = {
            let candidate = &problem.candidates[constant.candidate];
            (&candidate.target, candidate.port)
        };
        let goes_with = |shelf: &&Shelf| {
            let candidate = &problem.candidates[shelf.candidate];
            shelf.candidate != constant.candidate && candidate.target == *target && candidate.port == port
        };
        let pair = |shelf: &'s Shelf| {
            let both = |(_, whitened): &(_, Arc<Vec<Regressor>>)| {
                gain(shelf, &whitened.iter().chain(&**own).cloned().collect::<Vec<Regressor>>())
            };
            let gains: Vec<f64> = shelf.points.iter().map(both).collect();
            let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b]))?;
            let [prior, other] = [shelf, constant].map(|it| problem.ln_prior[it.candidate]);
            let mean = ln_mean(gains.iter().copied());
            let (with_both, without) = (mean + prior + other, gain(shelf, &shelf.points[best].1));
            (with_both > without + prior && with_both > alone + other).then(|| Pair {
                constant,
                with: Offer {
                    candidate: shelf.candidate,
                    ln_gain: with_both,
                    blocks: shelf.blocks.clone(),
                    point: shelf.points[best].0.clone(),
                    ln_spread: mean - gains[best],
                },
            })
        };
        let others: Vec<&Shelf> = library.iter().filter(is_free).filter(goes_with).collect();
        if alone.is_finite() {
            others.par_iter().filter_map(|shelf| pair(shelf)).collect()
        } else {
            Vec::new()
        }
    };
    let constants: Vec<&Shelf> = library.iter().filter(|shelf| shelf.is_constant).filter(is_free).collect();
    constants.into_par_iter().flat_map_iter(of_constant).collect()
}

/// A description with a constant more, fitted.
fn with_constant(bench: &Bench<'_>, description: &Description, constant: &Shelf) -> Option<Description> {
    let problem = bench.problem;
    let candidate = &problem.candidates[constant.candidate];
    let term = Term::new(constant.candidate, candidate, &[], problem.time_s());
    let (regressors, ln_spread) = (Arc::clone(&constant.points[0].1), 0.0);
    let effect = Placed { term, regressors, ln_spread, delays: Delays::default() };
    let touched = touched_by(&effect);
    let mut more = description.clone();
    more.placed.push(effect);
    bench.fitted(&more, &touched)
}
