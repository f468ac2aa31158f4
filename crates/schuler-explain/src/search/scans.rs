//! Steps and ramps at every row, and lines at every frequency, beside what is described.
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::beside::Beside;
use super::library::Offer;
use crate::bands::onsets::Onsets;
use crate::bands::scan::{lines, ramps, raster, steps};
use crate::bands::sums::Sums;
use crate::catalogue::{Candidate, Column, OnsetShape, Port, Search, Target};
use crate::evidence::amplitude::ln_gain;
use crate::evidence::regressor::{Regressor, regressors};
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
    let offers = |source: &Source<'_>, number: usize, search: &Search| match *search {
        Search::Onset(shape) => source.onsets(number, shape),
        Search::Frequency => source.lines(number),
        _ => Vec::new(),
    };
    of_sources(beside, among, offers).into_iter().flatten().collect()
}

/// What is said of each candidate that is a step, a ramp or a line of one source of some of the blocks.
pub(super) fn of_sources<T: Send>(
    beside: &Beside<'_>,
    among: &[usize],
    say: impl Fn(&Source<'_>, usize, &Search) -> T + Sync,
) -> Vec<T> {
    let problem = beside.bench.problem;
    let of_block = |&index: &usize| -> Vec<T> {
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
            candidate.search.is_scanned().then(|| say(&source, number, &candidate.search))
        };
        problem.candidates.par_iter().enumerate().filter_map(of).collect()
    };
    among.iter().flat_map(of_block).collect()
}

/// Scores of the unit impulses of coefficients of a block's channels.
fn weighted(beside: &Beside<'_>, index: usize, sums: &Sums, channels: &[Vec<f64>]) -> Vec<f64> {
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
}

/// Scores of the unit impulses of a regressor.
fn of_regressor(beside: &Beside<'_>, index: usize, sums: &Sums, regressor: &Regressor) -> Vec<f64> {
    let mut channels = vec![vec![0.0; sums.layout.coefficients()]; sums.width()];
    add(sums, index, regressor, 1.0, &mut channels);
    weighted(beside, index, sums, &channels)
}

fn impulses(beside: &Beside<'_>, index: usize, sums: &Sums) -> Impulses {
    let (system, described) = (beside.system(), beside.described());
    let left = weighted(beside, index, sums, &system.left(index, &described, &beside.solved.amplitudes));
    let here: Vec<(usize, &Regressor)> = (beside.solved.free.iter().enumerate())
        .map(|(place, &number)| (place, described.regressors[number]))
        .filter(|(_, regressor)| regressor.reaches(index))
        .collect();
    let of = |(_, regressor): &(usize, &Regressor)| of_regressor(beside, index, sums, regressor);
    Impulses {
        left,
        described: here.par_iter().map(of).collect(),
        free: here.iter().map(|(place, _)| *place).collect(),
    }
}

/// What is left of a shape beside what is described.
pub(super) struct Left {
    /// Rows at which it may begin.
    pub(super) onsets: Arc<Onsets>,
    /// Information at each of them; 0 where that is little of what the shape has.
    pub(super) of_rows: Vec<f64>,
    /// Products of the described with the shape at every row.
    with: Vec<Vec<f64>>,
    /// Inverse of the products of the described.
    inverse: DMatrix<f64>,
}

/// A source whose shapes are scanned.
pub(super) struct Source<'s> {
    pub(super) beside: &'s Beside<'s>,
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

    /// Scores of a shape that begins at each row.
    fn scan(shape: OnsetShape, impulses: &[f64]) -> Vec<f64> {
        if shape == OnsetShape::Step { steps(impulses) } else { ramps(impulses) }
    }

    fn onsets(&self, candidate: usize, shape: OnsetShape) -> Vec<Offer> {
        let config = self.beside.bench.problem.config;
        let scores = Self::scan(shape, &self.through(&self.impulses.left));
        let Some(left) = self.left_of_onsets(shape) else { return Vec::new() };
        let gain = |(&row, &left): (&usize, &f64)| {
            if left > 0.0 { ln_gain(scores[row] * scores[row] / left, 1, config) } else { f64::NEG_INFINITY }
        };
        let rows = &left.onsets.rows;
        let gains: Vec<f64> = rows.iter().zip(&left.of_rows).map(gain).collect();
        let time_s = self.beside.bench.problem.time_s();
        self.offered(candidate, &gains, |place| time_s[rows[place]])
    }

    /// What is left of a shape beside what is described, by the row at which it begins.
    pub(super) fn left_of_onsets(&self, shape: OnsetShape) -> Option<Left> {
        let config = self.beside.bench.problem.config;
        let with: Vec<Vec<f64>> = (self.impulses.described.iter())
            .map(|channels| Self::scan(shape, &self.through(channels)))
            .collect();
        let onsets = self.sums.onsets(self.block, self.sensor, self.port, shape, config)?;
        let weights = self.beside.weights[self.index].as_ref()?;
        let place = self.place();
        let of_sensor: Vec<f64> = weights.of_places.iter().map(|weight| weight[(place, place)]).collect();
        // With M⁻¹ of the described in rows, the information taken by them is a square.
        let inverse = self.inverse_of_described(self.beside.solved.free.len());
        let left = |(&row, whole): (&usize, f64)| {
            let of: DVector<f64> = DVector::from_iterator(with.len(), with.iter().map(|scores| scores[row]));
            let left = whole - (&inverse * &of).dot(&of);
            if left > LEAST_LEFT * whole && whole > 0.0 { left } else { 0.0 }
        };
        let of_rows = onsets.rows.iter().zip(onsets.weighted(&of_sensor)).map(left).collect();
        Some(Left { onsets, of_rows, with, inverse })
    }

    /// Products of a shape that begins at a row with those that begin at every row, beside what is described.
    pub(super) fn products_of_onset(&self, shape: OnsetShape, left: &Left, row: usize) -> Vec<f64> {
        let bench = self.beside.bench;
        let begins = |at: usize| match shape {
            OnsetShape::Step => f64::from(u8::from(at >= row)),
            OnsetShape::Ramp => at.saturating_sub(row) as f64,
        };
        let column = Column::on(self.sensor, (0..self.block.rows()).map(begins).collect::<Vec<f64>>());
        let own = regressors(bench.problem.model, &bench.sums, &[column], self.port);
        let Some(own) = own.first() else { return Vec::new() };
        let channels = of_regressor(self.beside, self.index, self.sums, own);
        let products = Self::scan(shape, &self.through(&channels));
        let at =
            |row: usize| DVector::from_iterator(left.with.len(), left.with.iter().map(|scores| scores[row]));
        let taken = &left.inverse * at(row);
        left.onsets.rows.iter().map(|&other| products[other] - taken.dot(&at(other))).collect()
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
        let step_s = self.block.step_s();
        let bins = self.bins(scores.step, scores.scores.len());
        let Some(informations) = self.informations_of_lines() else { return Vec::new() };
        let gain = |bin: usize| {
            let information = informations[self.sums.layout.band_of(scores.step * bin as f64)];
            ln_gain(scores.scores[bin].norm_sqr() / information, 2, config)
        };
        let gains: Vec<f64> = bins.clone().map(gain).collect();
        self.offered(candidate, &gains, |place| {
            scores.step * (bins.start + place) as f64 / (std::f64::consts::TAU * step_s)
        })
    }

    /// The bins of frequencies at which a line is sought, of so many that are a step apart.
    fn bins(&self, step: f64, count: usize) -> std::ops::Range<usize> {
        let config = self.beside.bench.problem.config;
        let lowest = std::f64::consts::TAU * config.least_periods / self.block.rows() as f64;
        let first = (lowest / step).ceil() as usize;
        first..count.saturating_sub(NYQUIST_BINS).max(first)
    }

    /// Information of either amplitude of a line, by band.
    fn informations_of_lines(&self) -> Option<Vec<f64>> {
        let weights = self.beside.weights[self.index].as_ref()?;
        let (rows, place) = (self.sums.rows() as f64, self.place());
        let port = [Port::Output, Port::Accelerometer, Port::Gyro].iter().position(|it| *it == self.port);
        let of_band = |((&omega, base), weight): ((&f64, &f64), &DMatrix<f64>)| {
            let through = if self.block.is_redundant() {
                1.0
            } else {
                let transfer = self.block.transfer(port.unwrap_or_default(), omega);
                transfer.iter().map(nalgebra::Complex::norm_sqr).sum()
            };
            0.5 * rows * weight[(place, place)] / base * through
        };
        let bands = self.sums.layout.omega.iter().zip(&self.sums.base).zip(&weights.of_places);
        Some(bands.map(of_band).collect())
    }

    /// Frequencies at which a line is sought, Hz, each with the information of either of its amplitudes.
    pub(super) fn left_of_lines(&self) -> Option<Vec<(f64, f64)>> {
        let informations = self.informations_of_lines()?;
        let (step, count) = raster(self.block.rows());
        let at = |bin: usize| {
            let omega = step * bin as f64;
            let information = informations[self.sums.layout.band_of(omega)];
            (omega / (std::f64::consts::TAU * self.block.step_s()), information)
        };
        Some(self.bins(step, count).map(at).collect())
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
