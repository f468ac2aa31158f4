//! Another white level in part of the rows: from a time on, or where a quantity is large.
//!
//! Dividing rows by a level would scale the slow part of the noise as well, so that the record is whitened anew by a filter whose
//! measurement noise has two levels. What a level promises is seen on the squares of the innovations of what is described.
use std::collections::HashMap;

use super::library::whitened_again;
use crate::catalogue::{NoiseChange, Search};
use crate::description::sensors_of;
use crate::evidence::fit::{Bench, Change, Description};
use crate::evidence::system::System;
use crate::noise::trust::ln_mean;
use crate::noise::weights::levels as levels_of_bands;
use crate::noise::{Knob, Noise, RowsOfLevel, VarianceStep};
use crate::nominal::Block;

/// How often the ratio of two levels is measured anew.
const MEASURED: usize = 3;
/// Change of its logarithm at which it stays.
const SAME: f64 = 0.01;
/// Smallest part that is left of a variance of which another part was taken.
const LEAST_PART: f64 = 0.01;

/// A level that innovations promise.
pub struct Level {
    /// The change; its noises have the level.
    pub change: Change,
    /// The noises of all sources.
    pub noises: Vec<Noise>,
    /// What it promises, prior odds included, nats.
    pub ln_gain: f64,
}

/// The levels that would add to a description, the best first.
pub fn levels(bench: &Bench<'_>, description: &Description) -> Vec<Level> {
    let problem = bench.problem;
    let mut all: Vec<Level> = Vec::new();
    let mut of_blocks: HashMap<usize, Option<Vec<f64>>> = HashMap::new();
    for (number, candidate) in problem.candidates.iter().enumerate() {
        let Search::Noise(change) = candidate.search else { continue };
        let Some(&sensor) = sensors_of(candidate).first() else { continue };
        let Some(source) = problem.model.source_of(sensor, candidate.port) else { continue };
        let Some(index) = problem.model.block_of_source(source) else { continue };
        let block = &problem.model.blocks[index];
        let noise = &description.noises[source];
        let is_its_own = !block.is_redundant() && block.sources.first() == Some(&source);
        let is_level = matches!(change, NoiseChange::VarianceStep | NoiseChange::LevelAbove(_));
        if !is_level || !is_its_own || noise.step.is_some() || noise.white <= 0.0 {
            continue;
        }
        // The same for every level of a block.
        let of_block = of_blocks.entry(index).or_insert_with(|| innovations(bench, description, index));
        let Some(innovations) = of_block else { continue };
        let found = match change {
            NoiseChange::VarianceStep => {
                let is_free = description.free_in(problem, index).contains(&(source, Knob::White));
                from_a_time_on(bench, block, innovations, is_free)
            }
            NoiseChange::LevelAbove(quantity) => above(bench, block, innovations, quantity),
            _ => None,
        };
        let Some(found) = found else { continue };
        let mut noises = description.noises.clone();
        let white_part = white_part(bench, index, noise);
        let of_white = |variance: f64| ((variance - 1.0 + white_part) / white_part).max(LEAST_PART).sqrt();
        let (within, beyond) = (of_white(found.within), of_white(found.beyond));
        let part = found.number as f64 / innovations.len() as f64;
        noises[source].white *= beyond;
        noises[source].step = Some(VarianceStep { rows: found.rows, part, ratio: within / beyond });
        let is_both = matches!(found.rows, RowsOfLevel::Above { .. });
        let knobs = if is_both { vec![Knob::White, Knob::StepRatio] } else { vec![Knob::StepRatio] };
        let change = Change { candidate: number, source, kind: change, knobs, ln_cost: found.ln_cost };
        all.push(Level { change, noises, ln_gain: found.ln_gain + problem.ln_prior[number] });
    }
    all.sort_by(|a, b| b.ln_gain.total_cmp(&a.ln_gain));
    all
}

/// A description with a level, on sums that are whitened by it; `whitened` makes them.
pub fn with_level<'b>(
    description: &Description,
    level: &Level,
    whitened: &dyn Fn(&[Noise]) -> Bench<'b>,
) -> Option<(Bench<'b>, Description)> {
    let (source, mut noises) = (level.change.source, level.noises.clone());
    for round in 0..MEASURED {
        let bench = whitened(&noises);
        let mut start = whitened_again(&bench, description);
        start.noises.clone_from(&noises);
        start.changes.push(level.change.clone());
        let index = bench.problem.model.block_of_source(source)?;
        let fitted = bench.fitted_whole(&start)?;
        let step = fitted.noises[source].step?;
        let innovations = innovations(&bench, &fitted, index)?;
        let ratio = ratio_of(&bench.problem.model.blocks[index], &innovations, step.rows)?;
        if round + 1 == MEASURED || ratio.ln().abs() < SAME {
            return Some((bench, fitted));
        }
        noises.clone_from(&fitted.noises);
        noises[source].step = Some(VarianceStep { ratio: step.ratio * ratio, ..step });
    }
    None
}

/// The innovations of the rows of a block that are present, under the noise of a description, without what is described.
fn innovations(bench: &Bench<'_>, description: &Description, index: usize) -> Option<Vec<f64>> {
    let sums = bench.sums[index].as_ref()?;
    let system = System { sums: &bench.sums, weights: &description.weights };
    let mut left =
        system.left(index, &description.described(bench), &description.amplitudes).into_iter().next()?;
    let levels = levels_of_bands(&bench.problem.model.blocks[index], sums, &description.noises)?;
    for (edge, level) in sums.layout.edges.windows(2).zip(levels) {
        left[edge[0]..edge[1]].iter_mut().for_each(|value| *value /= level.sqrt());
    }
    sums.layout.inverse(&mut left);
    let most = bench.problem.config.largest_innovation;
    Some(left.into_iter().map(|value| value.clamp(-most, most)).collect())
}

/// Standard deviation of the innovations in some rows over that in the others.
fn ratio_of(block: &Block, innovations: &[f64], rows: RowsOfLevel) -> Option<f64> {
    let is_in = block.rows_of_level(rows);
    let present = (0..block.rows()).filter(|&row| block.present[row]);
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for (row, value) in present.zip(innovations) {
        let of = usize::from(is_in[row]);
        sums[of] += value * value;
        counts[of] += 1.0;
    }
    let ratio = ((sums[1] / counts[1]) / (sums[0] / counts[0])).sqrt();
    ratio.is_finite().then_some(ratio)
}

/// What the innovations leave open of a level.
pub struct LevelSpread {
    /// Standard deviation of the logarithm of its ratio.
    pub of_ln_ratio: f64,
    /// What the likelihood falls by where it begins so many rows later or earlier, whichever falls less; empty where it does not
    /// begin at a time.
    falls: Vec<f64>,
}

impl LevelSpread {
    /// What the likelihood falls by at some rows from where the level begins.
    pub fn fall(&self, rows: f64) -> f64 {
        let place = (rows.round() as usize).min(self.falls.len().saturating_sub(1));
        self.falls.get(place).copied().unwrap_or(f64::INFINITY)
    }
}

/// What the innovations of a description with a level leave open of it.
pub fn spread_of_level(
    bench: &Bench<'_>,
    description: &Description,
    index: usize,
    step: VarianceStep,
) -> Option<LevelSpread> {
    let block = &bench.problem.model.blocks[index];
    let innovations = innovations(bench, description, index)?;
    let is_in = block.rows_of_level(step.rows);
    let present: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    let within = present.iter().filter(|&&row| is_in[row]).count() as f64;
    let beyond = present.len() as f64 - within;
    let of_ln_ratio = (0.5 / within + 0.5 / beyond).sqrt();
    let mut falls = Vec::new();
    if let RowsOfLevel::From(first) = step.rows {
        // What the white level makes of the whole.
        let white_part = white_part(bench, index, &description.noises[own_source(block)]);
        let ratio = (1.0 + white_part * (step.ratio * step.ratio - 1.0)).sqrt();
        let place = present.partition_point(|&row| row < first);
        // A row of the level taken for one before it, and one before it for one of the level.
        let late = |e: &f64| 0.5 * (ratio * e).powi(2) - 0.5 * e * e - ratio.ln();
        let early = |e: &f64| 0.5 * (e / ratio).powi(2) - 0.5 * e * e + ratio.ln();
        let summed = |falls: Vec<f64>| {
            let sum = |sum: &mut f64, fall: f64| {
                *sum += fall;
                Some(*sum)
            };
            falls.into_iter().scan(0.0, sum).collect::<Vec<f64>>()
        };
        let later = summed(innovations[place..].iter().map(late).collect());
        let earlier = summed(innovations[..place].iter().rev().map(early).collect());
        let longest = later.len().max(earlier.len());
        let at = |falls: &[f64], rows: usize| falls.get(rows).copied().unwrap_or(f64::INFINITY);
        falls = std::iter::once(0.0)
            .chain((0..longest).map(|rows| at(&later, rows).min(at(&earlier, rows))))
            .collect();
    }
    Some(LevelSpread { of_ln_ratio, falls })
}

/// The source of a block of one sensor.
fn own_source(block: &Block) -> usize {
    block.sources.first().copied().unwrap_or_default()
}

/// Two levels in the innovations.
struct Found {
    rows: RowsOfLevel,
    /// Rows in it.
    number: usize,
    /// Variances in these rows and in the others.
    within: f64,
    beyond: f64,
    /// What it gains, averaged over where it may be and over its ratio.
    ln_gain: f64,
    /// That less what it gains at its best, but for the level of the others.
    ln_cost: f64,
}

/// Part of the innovations' variance that is white noise.
fn white_part(bench: &Bench<'_>, index: usize, noise: &Noise) -> f64 {
    let Some(sums) = &bench.sums[index] else { return 1.0 };
    let variance = (sums.filter.log_variances / sums.rows() as f64).exp();
    (noise.white * noise.white / variance).clamp(LEAST_PART, 1.0)
}

/// The level that begins at the time where it gains most; that before is another one as well where it is free.
fn from_a_time_on(bench: &Bench<'_>, block: &Block, innovations: &[f64], is_free: bool) -> Option<Found> {
    let present: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    let squares: Vec<f64> = innovations.iter().rev().map(|value| value * value).collect();
    let (place, within, beyond, [ln_gain, ln_cost]) = divided(bench, &squares, is_free, &|_| true)?;
    let rows = RowsOfLevel::From(present[present.len() - place]);
    Some(Found { rows, number: place, within, beyond, ln_gain, ln_cost })
}

/// The level where a quantity is large.
fn above(bench: &Bench<'_>, block: &Block, innovations: &[f64], quantity: usize) -> Option<Found> {
    let loudness = block.loudness.get(quantity)?;
    let mut of_row = vec![None; block.rows()];
    let present = (0..block.rows()).filter(|&row| block.present[row]);
    present.zip(innovations).for_each(|(row, value)| of_row[row] = Some(value * value));
    let (values, squares): (Vec<f64>, Vec<f64>) =
        loudness.descending.iter().filter_map(|&row| Some((loudness.values[row], of_row[row]?))).unzip();
    let divides = |place: usize| values[place - 1] > values[place];
    let (place, within, beyond, [ln_gain, ln_cost]) = divided(bench, &squares, true, &divides)?;
    let value = 0.5 * (values[place - 1] + values[place]);
    let rows = RowsOfLevel::Above { quantity, value };
    Some(Found { rows, number: place, within, beyond, ln_gain, ln_cost })
}

/// How many of the first of the squares gain most by a variance of their own, both variances, the gain averaged over all places and
/// over the variances, and that less the gain at its best. The others keep a variance of 1 unless `both` have their own.
fn divided(
    bench: &Bench<'_>,
    squares: &[f64],
    both: bool,
    divides: &dyn Fn(usize) -> bool,
) -> Option<(usize, f64, f64, [f64; 2])> {
    let config = bench.problem.config;
    let all: f64 = squares.iter().sum();
    let count = squares.len();
    let gain_of = |sum: f64, number: f64| {
        let ratio = (sum / number).max(f64::MIN_POSITIVE);
        0.5 * number * (ratio - 1.0 - ratio.ln())
    };
    // The logarithm of a variance is known to √(2/n), and its half has a flat prior over some decades.
    let occam = |number: f64| ((std::f64::consts::PI / number).sqrt() / config.noise_level_range).ln();
    let mut sum = 0.0;
    let mut gains: Vec<(usize, f64, f64, f64)> = Vec::new();
    for (place, square) in squares.iter().enumerate().map(|(row, square)| (row + 1, square)) {
        sum += square;
        let others = count - place;
        if place < config.least_segment || others < config.least_segment || !divides(place) {
            continue;
        }
        let (number, others) = (place as f64, others as f64);
        let mut gain = gain_of(sum, number);
        let mut cost = occam(number).min(0.0);
        if both {
            gain += gain_of(all - sum, others);
            cost += occam(others).min(0.0);
        }
        gains.push((place, gain, cost, sum));
    }
    let ln_gain = ln_mean(gains.iter().map(|(_, gain, cost, _)| gain + cost));
    let &(place, gain, _, sum) = gains.iter().max_by(|a, b| (a.1 + a.2).total_cmp(&(b.1 + b.2)))?;
    let beyond = if both { (all - sum) / (count - place) as f64 } else { 1.0 };
    // What the level of the others costs is counted where it is fitted.
    let counted = if both { occam((count - place) as f64).min(0.0) } else { 0.0 };
    Some((place, sum / place as f64, beyond, [ln_gain, ln_gain - gain - counted]))
}
