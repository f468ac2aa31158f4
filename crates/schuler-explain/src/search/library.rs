//! Every signature of a fixed shape: linear ones, and every point of the grids of others.
use std::sync::Arc;

use rayon::prelude::*;

use super::beside::Beside;
use super::late::columns_beside;
use crate::bands::sums::Sums;
use crate::catalogue::{Candidate, Column, Nonlinear, Search};
use crate::description::{Delays, Term, columns};
use crate::evidence::fit::{Bench, Description, Placed};
use crate::evidence::late::{delays_of, late_columns};
use crate::evidence::regressor::{Regressor, regressors};
use crate::evidence::system::{Described, left_beside, root_of};
use crate::noise::fit::left_of;
use crate::noise::trust::ln_mean;
use crate::numeric::minimise::golden;
use crate::problem::Problem;

/// Steps at most by which the parameters of a grid are refined, and how often each is shortened.
const REFINED: usize = 4;
const HALVED: usize = 3;
/// Gain, nats, at which they are.
const REFINED_TO: f64 = 0.05;
/// Part of what a step promises that it gains where the gain is smooth.
const KEPT_PROMISE: f64 = 0.3;
/// Part of a half step of the raster to which a frequency is sought.
const SOUGHT_TO: f64 = 0.02;
/// Values at which a parameter is tried where steps lead nowhere, and how often the interval is narrowed to the best of them: to some
/// ten thousandth.
const BETWEEN: usize = 12;
const NARROWED: usize = 5;
/// How often the distance to where the gain has fallen is halved.
const HALVED_TO_THE_SIDE: usize = 8;
/// Difference over which a signature is differentiated, of the distance of two points of the grid.
const DIFFERENCE: f64 = 1e-2;

/// A candidate with its signatures.
pub struct Shelf {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Whether its amplitudes are 1.
    pub is_unit: bool,
    /// Whether it is the same at all times.
    pub is_constant: bool,
    /// The blocks that it reaches.
    pub blocks: Vec<usize>,
    /// Points of its grid, one empty point of a linear one, with the signature there.
    pub points: Vec<(Vec<f64>, Arc<Vec<Regressor>>)>,
}

impl Shelf {
    /// Whether it reaches some of the blocks.
    pub fn reaches(&self, among: &[usize]) -> bool {
        self.blocks.iter().any(|block| among.contains(block))
    }

    /// What it would add, averaged over its points, where a signature alone gains so much.
    pub fn offer(&self, ln_prior: f64, gain: impl Fn(&[Regressor]) -> f64) -> Option<Offer> {
        let gains: Vec<f64> = self.points.iter().map(|(_, whitened)| gain(whitened)).collect();
        let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b]))?;
        let mean = ln_mean(gains.iter().copied());
        Some(Offer {
            candidate: self.candidate,
            ln_gain: mean + ln_prior,
            blocks: self.blocks.clone(),
            point: self.points[best].0.clone(),
            ln_spread: mean - gains[best],
        })
    }
}

/// What a candidate would add to a description.
#[derive(Clone)]
pub struct Offer {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Logarithm of what the evidence is multiplied by, prior odds included.
    pub ln_gain: f64,
    /// The blocks that it reaches.
    pub blocks: Vec<usize>,
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
        let points: Vec<(Vec<f64>, Arc<Vec<Regressor>>)> = points.into_par_iter().map(at).collect();
        let parts = points.iter().flat_map(|(_, whitened)| &**whitened).flat_map(|it| &it.parts);
        let mut blocks: Vec<usize> = parts.map(|part| part.block).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let is_constant = is_constant(&candidate.search);
        Some(Shelf { candidate: index, is_unit, is_constant, blocks, points })
    };
    problem.candidates.par_iter().enumerate().filter_map(of).collect()
}

/// Whether a signature is one column that is the same at all times.
fn is_constant(search: &Search) -> bool {
    let Search::Linear(signature) = search else { return false };
    let [column] = signature.columns.as_slice() else { return false };
    let is_level = |values: &[f64]| values.iter().all(|value| Some(value) == values.first());
    column.parts.iter().all(|(_, values)| is_level(values))
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

/// What each candidate that reaches some of the blocks would add to a description.
pub fn offers(beside: &Beside<'_>, library: &[Shelf], among: &[usize]) -> Vec<Offer> {
    let problem = beside.bench.problem;
    let described = beside.described();
    let of = |shelf: &Shelf| {
        let candidate = &problem.candidates[shelf.candidate];
        let gain = |whitened: &[Regressor]| beside.ln_gain(&described, whitened, candidate, shelf.is_unit);
        shelf.offer(problem.ln_prior[shelf.candidate], gain).filter(|offer| offer.ln_gain.is_finite())
    };
    let shelves = library.par_iter().filter(|shelf| shelf.reaches(among));
    shelves.filter(|shelf| !beside.description.has(shelf.candidate)).filter_map(of).collect()
}

/// The effect of an offer with its parameters refined between the points of the grid; none of one that is described already where
/// effects come late.
pub fn placed(beside: &Beside<'_>, offer: &Offer) -> Option<Placed> {
    let problem = beside.bench.problem;
    let candidate = &problem.candidates[offer.candidate];
    let (mut point, mut ln_spread) = (offer.point.clone(), offer.ln_spread);
    if let (Search::Frequency, [frequency]) = (&candidate.search, offer.point.as_slice()) {
        point = vec![refined_frequency(beside, candidate, *frequency)];
    }
    if let Search::Grid { parameters, unit_amplitude, .. } = &candidate.search
        && !parameters.is_empty()
    {
        let refine = Refine { beside, candidate, is_unit: *unit_amplitude, parameters };
        (point, ln_spread) = refine.refined(&point, ln_spread);
    }
    let term = Term::new(offer.candidate, candidate, &point, problem.time_s());
    let delays = delays_of(beside.description.placed.iter());
    let delays = if delays.move_term(&term) { delays.among(&term.sensors()) } else { Delays::default() };
    let late = late_columns(problem.model, &delays, &term).into_owned();
    let whitened = regressors(problem.model, &beside.bench.sums, &late, term.port);
    let whitened = Arc::new(undescribed(beside, whitened)?);
    Some(Placed { delays, ..Placed::new(term, whitened, ln_spread) })
}

/// A signature without the columns that are described already; none where the first of them is.
pub fn undescribed(beside: &Beside<'_>, mut whitened: Vec<Regressor>) -> Option<Vec<Regressor>> {
    let normal = beside.normal(&beside.described(), &whitened)?;
    let left_out = |(place, _): &(usize, &mut Regressor)| !normal.kept.contains(place);
    whitened.iter_mut().enumerate().filter(left_out).for_each(|(_, it)| *it = Regressor::default());
    Some(whitened)
}

/// The frequency of a line sought beyond the raster of the scan, which is that of the record's length.
fn refined_frequency(beside: &Beside<'_>, candidate: &Candidate, frequency_hz: f64) -> f64 {
    let (bench, described) = (beside.bench, beside.described());
    let time_s = bench.problem.time_s();
    let length_s = time_s.last().copied().unwrap_or_default() - time_s.first().copied().unwrap_or_default();
    let cost = |frequency: f64| {
        let columns = columns(candidate, &[frequency], time_s);
        let whitened = regressors(bench.problem.model, &bench.sums, &columns, candidate.port);
        -beside.ln_gain(&described, &whitened, candidate, false)
    };
    let half = 0.5 / length_s;
    // At the upper end cosine and sine are not told apart.
    let highest = 0.5 / bench.problem.model.step_s - 4.0 * half;
    golden(frequency_hz - half, (frequency_hz + half).min(highest), SOUGHT_TO * half, cost).0
}

/// A step of the parameters of a grid.
struct Step {
    by: Vec<f64>,
    /// What it should gain, nats.
    promised: f64,
    /// Logarithm of the part of the grid that the parameters are left with.
    ln_width: f64,
}

/// Parameters of a grid refined by Gauss–Newton steps.
struct Refine<'r> {
    beside: &'r Beside<'r>,
    candidate: &'r Candidate,
    is_unit: bool,
    parameters: &'r [Nonlinear],
}

impl Refine<'_> {
    fn columns(&self, point: &[f64]) -> Vec<Column> {
        columns_beside(self.beside, self.candidate, point)
    }

    fn whitened(&self, columns: &[Column]) -> Vec<Regressor> {
        let bench = self.beside.bench;
        regressors(bench.problem.model, &bench.sums, columns, self.candidate.port)
    }

    /// The neighbours of a value on the grid.
    fn neighbours(&self, axis: usize, value: f64) -> [f64; 2] {
        let grid = &self.parameters[axis].grid;
        let (below, above) =
            (grid.partition_point(|known| *known < value), grid.partition_point(|known| *known <= value));
        [grid[below.saturating_sub(1)], grid[above.min(grid.len() - 1)]]
    }

    /// Half of their distance.
    fn cell(&self, axis: usize, value: f64) -> f64 {
        let [low, high] = self.neighbours(axis, value);
        0.5 * (high - low)
    }

    /// Where steps lead from a point, and the mean of the evidence over the parameters there less the best, by Laplace's
    /// approximation where that is more than the grid tells.
    fn refined(&self, point: &[f64], of_grid: f64) -> (Vec<f64>, f64) {
        let described = self.beside.described();
        let gain =
            |whitened: &[Regressor]| self.beside.ln_gain(&described, whitened, self.candidate, self.is_unit);
        let mut here = point.to_vec();
        let mut whitened = self.whitened(&self.columns(&here));
        let first = gain(&whitened);
        let (mut reached, mut ln_width) = (first, f64::NEG_INFINITY);
        let mut is_smooth = false;
        for _ in 0..REFINED {
            let Some(Step { by: step, promised, ln_width: width }) = self.step(&described, &here, &whitened)
            else {
                is_smooth = false;
                break;
            };
            ln_width = width;
            let mut scale = 1.0;
            let mut gained = 0.0;
            for _ in 0..HALVED {
                let there: Vec<f64> = (here.iter().zip(&step).zip(self.parameters))
                    .map(|((value, step), parameter)| {
                        let (low, high) = (parameter.grid[0], parameter.grid[parameter.grid.len() - 1]);
                        (value + scale * step).clamp(low, high)
                    })
                    .collect();
                let moved = self.whitened(&self.columns(&there));
                let of_moved = gain(&moved);
                if of_moved > reached {
                    gained = of_moved - reached;
                    (here, whitened, reached) = (there, moved, of_moved);
                    break;
                }
                scale *= 0.3;
            }
            is_smooth = promised < REFINED_TO || gained > KEPT_PROMISE * promised;
            if gained < REFINED_TO {
                break;
            }
        }
        if let ([value], false) = (here.as_slice(), is_smooth) {
            let (value, ln_width) = self.sought(point[0], (*value, reached), &gain);
            return (vec![value], ln_width.min(0.0));
        }
        let spread = (of_grid - (reached - first)).max(ln_width.min(0.0));
        (here, if spread.is_finite() { spread.min(0.0) } else { of_grid })
    }

    /// The one parameter sought between the neighbours of a point of the grid, from where steps have led on, where steps do not
    /// lead to what they promise: a threshold changes what it adds from row to row. With the logarithm of the part of its range
    /// where the gain is no more than a nat less.
    fn sought(
        &self,
        of_grid: f64,
        (here, reached): (f64, f64),
        gain: &(dyn Fn(&[Regressor]) -> f64 + Sync),
    ) -> (f64, f64) {
        let [low, high] = self.neighbours(0, of_grid);
        let (low, high) = (low.min(here), high.max(here));
        let cell = 0.5 * (high - low);
        let at = |value: f64| gain(&self.whitened(&self.columns(&[value])));
        let (mut best, mut most) = (here, reached);
        let (mut from, mut to) = (low, high);
        for _ in 0..NARROWED {
            let step = (to - from) / (BETWEEN + 1) as f64;
            let values: Vec<f64> = (1..=BETWEEN).map(|k| from + k as f64 * step).collect();
            let gains: Vec<f64> = values.par_iter().map(|&value| at(value)).collect();
            for (value, gain) in values.into_iter().zip(gains) {
                if gain > most {
                    (best, most) = (value, gain);
                }
            }
            (from, to) = ((best - step).max(low), (best + step).min(high));
        }
        let side = |end: f64| {
            let (mut inside, mut outside) = (0.0, 1.0);
            for _ in 0..HALVED_TO_THE_SIDE {
                let part = 0.5 * (inside + outside);
                let falls = at(best + part * (end - best)) < most - 1.0;
                *(if falls { &mut outside } else { &mut inside }) = part;
            }
            0.5 * (inside + outside) * (end - best).abs()
        };
        let range = cell * self.parameters[0].grid.len() as f64;
        let [below, above] = [side(low), side(high)];
        // All is as good between two readings: the middle is the nearest to each.
        (best + 0.5 * (above - below), ((below + above) / range).ln())
    }

    /// A Gauss–Newton step of the parameters.
    fn step(&self, described: &Described<'_>, point: &[f64], whitened: &[Regressor]) -> Option<Step> {
        let own = self.beside.normal(described, whitened)?;
        let mut amplitudes = vec![0.0; whitened.len()];
        if self.is_unit {
            amplitudes.fill(1.0);
        } else {
            own.kept.iter().zip(own.amplitudes()?.iter()).for_each(|(&at, value)| amplitudes[at] = *value);
        }
        let count = own.kept.len();
        let mut all: Vec<Regressor> = own.kept.iter().map(|&place| whitened[place].clone()).collect();
        for axis in 0..point.len() {
            let difference = DIFFERENCE * self.cell(axis, point[axis]);
            let at = |sign: f64| {
                let mut there = point.to_vec();
                there[axis] += sign * difference;
                self.columns(&there)
            };
            let slope = slope(&at(1.0), &at(-1.0), &amplitudes, 2.0 * difference);
            all.extend(self.whitened(&[slope]));
        }
        let normal = self.beside.normal(described, &all).filter(|it| it.kept.len() == all.len())?;
        let (size, fixed) = (point.len(), if self.is_unit { count } else { 0 });
        // What is of amplitude 1 is taken out of the scores, and is not free.
        let mut scores = normal.scores.clone();
        for row in 0..scores.len() {
            scores[row] -= (0..fixed).map(|column| normal.information[(row, column)]).sum::<f64>();
        }
        let information =
            normal.information.view((fixed, fixed), (all.len() - fixed, all.len() - fixed)).into_owned();
        let root = root_of(&information)?;
        let solved = root.solve(&scores.rows(fixed, all.len() - fixed).into_owned());
        let from = all.len() - fixed - size;
        let mut step = Vec::with_capacity(size);
        let mut ranges = Vec::with_capacity(size);
        for axis in 0..size {
            let cell = self.cell(axis, point[axis]);
            step.push(solved[from + axis].clamp(-cell, cell));
            ranges.push(cell * self.parameters[axis].grid.len() as f64 / (2.0 * std::f64::consts::PI).sqrt());
        }
        let own = information.view((from, from), (size, size)).into_owned();
        let own = if from == 0 {
            own
        } else {
            let of_amplitudes = root_of(&information.view((0, 0), (from, from)).into_owned())?;
            left_beside(own, &information.view((0, from), (from, size)).into_owned(), &of_amplitudes)
        };
        let (_, ln_width) = left_of(&own, &ranges)?;
        let promised = 0.5 * (0..size).map(|axis| scores[fixed + from + axis] * step[axis]).sum::<f64>();
        Some(Step { by: step, promised, ln_width })
    }
}

/// The derivative of what columns with their amplitudes add, by a parameter.
fn slope(above: &[Column], below: &[Column], amplitudes: &[f64], difference: f64) -> Column {
    let mut parts: Vec<(usize, Vec<f64>)> = Vec::new();
    for ((above, below), amplitude) in above.iter().zip(below).zip(amplitudes) {
        for ((sensor, high), (_, low)) in above.parts.iter().zip(&below.parts) {
            let values = high.iter().zip(low.iter()).map(|(high, low)| amplitude * (high - low) / difference);
            match parts.iter_mut().find(|(known, _)| known == sensor) {
                Some((_, sums)) => sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value),
                None => parts.push((*sensor, values.collect())),
            }
        }
    }
    Column::of(parts)
}

/// The same description whitened by other sums.
pub fn whitened_again(bench: &Bench<'_>, description: &Description) -> Description {
    let mut again = description.clone();
    for placed in &mut again.placed {
        let columns = late_columns(bench.problem.model, &placed.delays, &placed.term);
        placed.regressors = bench.whitened_as(&columns, placed);
    }
    again
}
