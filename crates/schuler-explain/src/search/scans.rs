//! Steps and ramps at every row, and lines at every frequency, beside what is described.
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::beside::Beside;
use super::library::Offer;
use crate::bands::scan::{lines, ramps, steps};
use crate::bands::sums::Sums;
use crate::catalogue::{Candidate, OnsetShape, Port, Search, Target};
use crate::evidence::amplitude::ln_gain;
use crate::evidence::regressor::Regressor;
use crate::evidence::system::add;
use crate::noise::trust::ln_mean;
use crate::nominal::Block;

/// Part of a shape's information that must be left beside what is described: less is lost in the interpolation.
const LEAST_LEFT: f64 = 0.02;
/// Best places of a shape that are offered.
const OFFERED: usize = 2;
/// Frequencies at the upper end where cosine and sine are not told apart.
const NYQUIST_BINS: usize = 4;

/// Scores of the unit impulses of what is left of a block and of what is described there.
struct Impulses {
    left: Vec<f64>,
    described: Vec<Vec<f64>>,
    /// Places of the latter among the free amplitudes.
    free: Vec<usize>,
}

/// What a step, a ramp or a line of each source of some of the blocks would add to a description.
pub fn scans(beside: &Beside<'_>, among: &[usize]) -> Vec<Offer> {
    let problem = beside.bench.problem;
    let of_block = |&index: &usize| -> Vec<Offer> {
        let (Some(sums), block) = (&beside.bench.sums[index], &problem.model.blocks[index]) else {
            return Vec::new();
        };
        let impulses = impulses(beside, index, sums);
        let of = |(number, candidate): (usize, &Candidate)| {
            // What is in common is found on each sensor by itself.
            let Target::Sensor(sensor) = candidate.target else { return None };
            block.sensors.contains(&sensor).then_some(())?;
            let source =
                Source { beside, block, sums, index, impulses: &impulses, sensor, port: candidate.port };
            match candidate.search {
                Search::Onset(shape) => Some(source.onsets(number, shape)),
                Search::Frequency => Some(source.lines(number)),
                _ => None,
            }
        };
        problem.candidates.par_iter().enumerate().filter_map(of).flatten().collect()
    };
    among.iter().flat_map(of_block).collect()
}

fn impulses(beside: &Beside<'_>, index: usize, sums: &Sums) -> Impulses {
    let (system, described) = (beside.system(), beside.described());
    let weighted = |channels: &[Vec<f64>]| -> Vec<f64> {
        let Some(weights) = &beside.weights[index] else { return Vec::new() };
        let mut all = vec![vec![0.0; sums.layout.coefficients()]; channels.len()];
        for (band, edge) in sums.layout.edges.windows(2).enumerate() {
            let weight = &weights.of_channels[band];
            for (c, to) in all.iter_mut().enumerate() {
                for (d, from) in channels.iter().enumerate() {
                    let weight = weight[(c, d)];
                    let pairs = to[edge[0]..edge[1]].iter_mut().zip(&from[edge[0]..edge[1]]);
                    pairs.for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        sums.impulses(&all).concat()
    };
    let left = weighted(&system.left(index, &described, &beside.solved.amplitudes));
    let here: Vec<(usize, &Regressor)> = (beside.solved.free.iter().enumerate())
        .map(|(place, &number)| (place, described.regressors[number]))
        .filter(|(_, regressor)| regressor.reaches(index))
        .collect();
    let of = |(_, regressor): &(usize, &Regressor)| {
        let mut channels = vec![vec![0.0; sums.layout.coefficients()]; sums.width()];
        add(sums, index, regressor, 1.0, &mut channels);
        weighted(&channels)
    };
    Impulses {
        left,
        described: here.par_iter().map(of).collect(),
        free: here.iter().map(|(place, _)| *place).collect(),
    }
}

/// A source whose shapes are scanned.
struct Source<'s> {
    beside: &'s Beside<'s>,
    block: &'s Block,
    sums: &'s Sums,
    index: usize,
    impulses: &'s Impulses,
    sensor: usize,
    port: Port,
}

impl Source<'_> {
    fn place(&self) -> usize {
        let own = || self.block.sensors.iter().position(|&sensor| sensor == self.sensor);
        if self.block.is_redundant() { own().unwrap_or_default() } else { 0 }
    }

    /// Scores of the unit impulses of the source.
    fn through(&self, channels: &[f64]) -> Vec<f64> {
        self.block.back_project(channels, self.sensor, self.port).unwrap_or_default()
    }

    fn onsets(&self, candidate: usize, shape: OnsetShape) -> Vec<Offer> {
        let config = self.beside.bench.problem.config;
        let scan = if shape == OnsetShape::Step { steps } else { ramps };
        let scores = scan(&self.through(&self.impulses.left));
        let with: Vec<Vec<f64>> =
            self.impulses.described.iter().map(|channels| scan(&self.through(channels))).collect();
        let Some(onsets) = self.sums.onsets(self.block, self.sensor, self.port, shape, config) else {
            return Vec::new();
        };
        let Some(weights) = &self.beside.weights[self.index] else { return Vec::new() };
        let place = self.place();
        let of_sensor: Vec<f64> = weights.of_places.iter().map(|weight| weight[(place, place)]).collect();
        let free = self.beside.solved.free.len();
        // With M⁻¹ of the described in rows, the information taken by them is a square.
        let inverse = self.inverse_of_described(free);
        let gain = |(&row, whole): (&usize, f64)| {
            let of: DVector<f64> = DVector::from_iterator(with.len(), with.iter().map(|scores| scores[row]));
            let left = whole - (&inverse * &of).dot(&of);
            if left > LEAST_LEFT * whole && whole > 0.0 {
                ln_gain(scores[row] * scores[row] / left, 1, config)
            } else {
                f64::NEG_INFINITY
            }
        };
        let gains: Vec<f64> = onsets.rows.iter().zip(onsets.weighted(&of_sensor)).map(gain).collect();
        let time_s = self.beside.bench.problem.time_s();
        self.offered(candidate, &gains, |place| time_s[onsets.rows[place]])
    }

    fn inverse_of_described(&self, free: usize) -> DMatrix<f64> {
        let own = &self.impulses.free;
        let column = |&place: &usize| {
            let unit = DVector::from_fn(free, |i, _| f64::from(u8::from(i == place)));
            let solved = self.beside.solved.root.solve(&unit);
            DVector::from_iterator(own.len(), own.iter().map(|&row| solved[row]))
        };
        let columns: Vec<DVector<f64>> = own.iter().map(column).collect();
        if columns.is_empty() { DMatrix::zeros(0, 0) } else { DMatrix::from_columns(&columns) }
    }

    fn lines(&self, candidate: usize) -> Vec<Offer> {
        let config = self.beside.bench.problem.config;
        let scores = lines(&self.through(&self.impulses.left));
        let rows = self.sums.rows();
        let step_s = self.block.step_s();
        let lowest = std::f64::consts::TAU * config.least_periods / self.block.rows() as f64;
        let first = (lowest / scores.step).ceil() as usize;
        let last = scores.scores.len().saturating_sub(NYQUIST_BINS);
        let Some(weights) = &self.beside.weights[self.index] else { return Vec::new() };
        let place = self.place();
        let port = [Port::Output, Port::Accelerometer, Port::Gyro].iter().position(|it| *it == self.port);
        let informations: Vec<f64> =
            (self.sums.layout.omega.iter().zip(&self.sums.base).zip(&weights.of_places))
                .map(|((&omega, base), weight)| {
                    let through = if self.block.is_redundant() {
                        1.0
                    } else {
                        let transfer = self.block.transfer(port.unwrap_or_default(), omega);
                        transfer.iter().map(nalgebra::Complex::norm_sqr).sum()
                    };
                    0.5 * rows as f64 * weight[(place, place)] / base * through
                })
                .collect();
        let gain = |bin: usize| {
            let information = informations[self.sums.layout.band_of(scores.step * bin as f64)];
            ln_gain(scores.scores[bin].norm_sqr() / information, 2, config)
        };
        let bins: Vec<usize> = (first..last).collect();
        let gains: Vec<f64> = bins.iter().map(|&bin| gain(bin)).collect();
        self.offered(candidate, &gains, |place| {
            scores.step * bins[place] as f64 / (std::f64::consts::TAU * step_s)
        })
    }

    /// The best places of a shape, apart from each other.
    fn offered(&self, candidate: usize, gains: &[f64], value: impl Fn(usize) -> f64) -> Vec<Offer> {
        let problem = self.beside.bench.problem;
        let mean = ln_mean(gains.iter().copied());
        if !mean.is_finite() {
            return Vec::new();
        }
        let is_peak = |&place: &usize| {
            let from = place.saturating_sub(1);
            gains[from..(place + 2).min(gains.len())].iter().all(|other| *other <= gains[place])
        };
        let mut peaks: Vec<usize> = (0..gains.len()).filter(is_peak).collect();
        peaks.sort_by(|&a, &b| gains[b].total_cmp(&gains[a]));
        (peaks.into_iter().take(OFFERED))
            .map(|place| Offer {
                candidate,
                ln_gain: mean + problem.ln_prior[candidate] - (gains[peaks_best(gains)] - gains[place]),
                blocks: vec![self.index],
                point: vec![value(place)],
                ln_spread: mean - gains[peaks_best(gains)],
            })
            .collect()
    }
}

fn peaks_best(gains: &[f64]) -> usize {
    (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])).unwrap_or_default()
}
