//! Every signature of a fixed shape: linear ones, and every point of the grids of others.
use std::sync::Arc;

use rayon::prelude::*;

use super::beside::Beside;
use crate::catalogue::{Candidate, Search};
use crate::description::columns;
use crate::second::bands::sums::Sums;
use crate::second::evidence::fit::{Bench, Description, Placed};
use crate::second::evidence::regressor::{Regressor, regressors};
use crate::second::noise::trust::ln_mean;
use crate::second::problem::Problem;
use crate::description::Term;

/// Rounds in which each parameter of a grid is refined.
const REFINED: usize = 1;
/// Part of the distance of two points of a grid to which a parameter is refined before it is fitted to all rows.
const REFINED_TO: f64 = 0.05;

/// A candidate with its signatures.
pub struct Shelf {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Whether its amplitudes are 1.
    pub is_unit: bool,
    /// Points of its grid, one empty point of a linear one, with the signature there.
    pub points: Vec<(Vec<f64>, Arc<Vec<Regressor>>)>,
}

/// What a candidate would add to a description.
#[derive(Clone)]
pub struct Offer {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Logarithm of what the evidence is multiplied by, prior odds included.
    pub ln_gain: f64,
    /// Its parameters at their best.
    pub point: Vec<f64>,
    /// Mean over its parameters less the best, nats.
    pub ln_spread: f64,
}

/// All signatures of fixed shape.
pub fn library(problem: &Problem<'_>, sums: &[Option<Sums>]) -> Vec<Shelf> {
    let of = |(index, candidate): (usize, &Candidate)| -> Option<Shelf> {
        let (points, is_unit) = match &candidate.search {
            Search::Linear(_) => (vec![Vec::new()], false),
            Search::Grid { parameters, unit_amplitude, .. } => {
                let grids: Vec<&[f64]> = parameters.iter().map(|it| it.grid.as_slice()).collect();
                (product(&grids), *unit_amplitude)
            }
            _ => return None,
        };
        let at = |point: Vec<f64>| {
            let columns = columns(candidate, &point, problem.time_s());
            let whitened = regressors(problem.model, sums, &columns, candidate.port);
            (point, Arc::new(whitened))
        };
        Some(Shelf { candidate: index, is_unit, points: points.into_par_iter().map(at).collect() })
    };
    problem.candidates.par_iter().enumerate().filter_map(of).collect()
}

/// All combinations of the values of grids.
fn product(grids: &[&[f64]]) -> Vec<Vec<f64>> {
    grids.iter().fold(vec![Vec::new()], |points, grid| {
        let longer = |point: &Vec<f64>| {
            let point = point.clone();
            grid.iter().map(move |&value| point.iter().copied().chain([value]).collect())
        };
        points.iter().flat_map(longer).collect()
    })
}

/// What each candidate would add to a description.
pub fn offers(beside: &Beside<'_>, library: &[Shelf]) -> Vec<Offer> {
    let problem = beside.bench.problem;
    let described = beside.described();
    let is_placed =
        |candidate: usize| beside.description.placed.iter().any(|placed| placed.term.candidate == candidate);
    let of = |shelf: &Shelf| {
        let candidate = &problem.candidates[shelf.candidate];
        let gain = |(_, whitened): &(_, Arc<Vec<Regressor>>)| {
            beside.ln_gain(&described, whitened, candidate, shelf.is_unit)
        };
        let gains: Vec<f64> = shelf.points.iter().map(gain).collect();
        let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b]))?;
        let mean = ln_mean(gains.iter().copied());
        Some(Offer {
            candidate: shelf.candidate,
            ln_gain: mean + problem.ln_prior[shelf.candidate],
            point: shelf.points[best].0.clone(),
            ln_spread: mean - gains[best],
        })
        .filter(|offer| offer.ln_gain.is_finite())
    };
    library.par_iter().filter(|shelf| !is_placed(shelf.candidate)).filter_map(of).collect()
}

/// The effect of an offer with its parameters refined between the points of the grid.
pub fn placed(beside: &Beside<'_>, offer: &Offer) -> Placed {
    let problem = beside.bench.problem;
    let candidate = &problem.candidates[offer.candidate];
    let mut point = offer.point.clone();
    let mut spread = offer.ln_spread;
    if let Search::Grid { parameters, unit_amplitude, .. } = &candidate.search {
        let described = beside.described();
        let gain = |point: &[f64]| {
            let columns = columns(candidate, point, problem.time_s());
            let whitened = regressors(problem.model, &beside.bench.sums, &columns, candidate.port);
            beside.ln_gain(&described, &whitened, candidate, *unit_amplitude)
        };
        let before = gain(&point);
        for _ in 0..REFINED {
            for (axis, parameter) in parameters.iter().enumerate() {
                let at = parameter.grid.partition_point(|value| *value < point[axis]);
                let low = parameter.grid[at.saturating_sub(1)];
                let high = parameter.grid[(at + 1).min(parameter.grid.len() - 1)];
                let cost = |value: f64| {
                    let mut there = point.clone();
                    there[axis] = value;
                    -gain(&there)
                };
                let (value, _) = crate::minimise::golden(low, high, REFINED_TO * (high - low), cost);
                let mut there = point.clone();
                there[axis] = value;
                if gain(&there) > gain(&point) {
                    point = there;
                }
            }
        }
        let gained = gain(&point) - before;
        spread -= if gained.is_finite() { gained } else { 0.0 };
    }
    let term = Term::new(offer.candidate, candidate, &point, problem.time_s());
    let whitened = regressors(problem.model, &beside.bench.sums, &term.columns, term.port);
    Placed { term, regressors: Arc::new(whitened), ln_spread: spread.min(0.0) }
}

/// The same description whitened by other sums.
pub fn whitened_again(bench: &Bench<'_>, description: &Description) -> Description {
    let mut again = description.clone();
    for placed in &mut again.placed {
        let whitened =
            regressors(bench.problem.model, &bench.sums, &placed.term.columns, placed.term.port);
        placed.regressors = Arc::new(whitened);
    }
    again
}
