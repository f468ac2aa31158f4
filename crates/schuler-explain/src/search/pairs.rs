//! Two effects at once: a constant of a sensor and what else it has. Where a dependence is none at the mean of what it depends on, or a
//! drift passes through zero amid the record, either alone shows little.
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::beside::Beside;
use super::known::Move;
use super::library::{Offer, Shelf, placed};
use super::moves::{Promises, touched_by, with_placed};
use crate::description::Term;
use crate::evidence::fit::{Bench, Description, Placed};
use crate::evidence::regressor::Regressor;

/// A constant and what it would be with.
struct Pair<'s> {
    constant: &'s Shelf,
    with: Offer,
}

/// The best descriptions that have such a pair more, fitted; what promises less than `behind` the best that is known is not.
pub fn with_pairs(promises: &Promises<'_>) -> Vec<Description> {
    let Promises { ways, library, known, among, behind, .. } = promises;
    let Some(Beside { bench, description, .. }) = ways.first() else { return Vec::new() };
    let config = bench.problem.config;
    let mut pairs: Vec<Pair<'_>> = ways.iter().flat_map(|way| pairs(way, library, among)).collect();
    pairs.retain(|pair| pair.with.ln_gain > *behind - config.within_reach);
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
    let beside_constants: HashMap<usize, Beside<'_>> = (of_constants.iter())
        .filter_map(|(&constant, base)| Some((constant, Beside::as_trusted(bench, base.as_ref()?)?)))
        .collect();
    let with_both = |pair: &Pair<'_>| {
        let beside = beside_constants.get(&pair.constant.candidate)?;
        let effect = placed(beside, &pair.with)?;
        let (blocks, candidate) = (touched_by(&effect), pair.with.candidate);
        Some(Move { description: beside.description, blocks, candidate, added: effect })
    };
    let moves: Vec<Move<'_, Placed>> = pairs.par_iter().filter_map(with_both).collect();
    known.fitted(bench, moves, |it| with_placed(bench, it.description, &it.added))
}

/// The pairs that promise more than either of their effects alone.
fn pairs<'s>(beside: &Beside<'_>, library: &'s [Shelf], among: &[usize]) -> Vec<Pair<'s>> {
    let problem = beside.bench.problem;
    let described = beside.described();
    let gain = |shelf: &Shelf, regressors: &[Regressor]| {
        beside.ln_gain(&described, regressors, &problem.candidates[shelf.candidate], false)
    };
    let is_free =
        |shelf: &&Shelf| !shelf.is_unit && !beside.description.has(shelf.candidate) && shelf.reaches(among);
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
            let [prior, other] = [shelf, constant].map(|it| problem.ln_prior[it.candidate]);
            let with = shelf.offer(prior + other, |whitened| {
                gain(shelf, &whitened.iter().chain(&**own).cloned().collect::<Vec<Regressor>>())
            })?;
            let (_, whitened) = shelf.points.iter().find(|(point, _)| *point == with.point)?;
            let is_more = with.ln_gain > gain(shelf, whitened) + prior && with.ln_gain > alone + other;
            is_more.then_some(Pair { constant, with })
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
    with_placed(bench, description, &Placed::new(term, regressors, ln_spread))
}
