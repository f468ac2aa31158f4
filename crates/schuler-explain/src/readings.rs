//! Faults that readings show without a model of the sensor: stuck, clipped, coarse, spiked; and jumps on and off.
//!
//! They are sought before anything else, and the readings that they spoil are missing from then on: a single spike
//! would breed findings of every kind. Evidence is −ln of a probability on the safe side:
//! - stuck: a run of L equal readings, where neighbours are equal with the probability p elsewhere: N pᴸ;
//! - clipped: more readings at the extreme value than at the next, which in a tail are fewer: binomial with ½;
//! - coarse: all readings on a lattice coarser than nominal and than the noise;
//! - spikes: n readings that stand off from their neighbours on both sides: C(N, n) Π 2Φ(−uᵢ).
//!
//! A mean that jumps on and off is a deterministic term whose switching times were found on the innovations: it pays
//! ln N for each of them.
use schuler_recording::Recording;
use statrs::function::gamma::ln_gamma;

use crate::catalogue::{Candidate, Column, Port, ReadingFault, Search, Target};
use crate::description::Term;
use crate::nominal::Model;
use crate::search::{Proposal, evidence};
use crate::state::Bench;
use crate::statistics::ln_chi_squared_tail;

/// Shortest run of equal readings that may be a stuck output.
const SHORTEST_RUN: usize = 20;
/// Fewest readings at a limit.
const FEWEST_CLIPPED: usize = 8;
/// Fewest separate stays at a limit: one may be a stuck output.
const FEWEST_STAYS: usize = 3;
/// How many times as many readings as at the next value.
const CLIPPED_RATIO: f64 = 4.0;
/// Fewest different values of an output that may be clipped.
const FEWEST_LEVELS: usize = 12;
/// A lattice matters if its step is at least this part of the white noise.
const LEAST_STEP: f64 = 1.0;
/// A lattice is coarser than nominal by at least this factor.
const COARSER: f64 = 1.5;
/// Largest number of steps between readings off a lattice, as a part of the step.
const OFF_LATTICE: f64 = 1e-3;
/// Expected number of spikes without any.
const FALSE_SPIKES: f64 = 1e-3;
/// Readings on each side with which one is compared.
const NEIGHBOURS: usize = 3;
/// Most spikes, as a part of the readings.
const MOST_SPIKES: f64 = 0.02;
/// Difference of means, in their spreads, of a switching.
const SWITCHING: f64 = 4.0;
/// Readings on each side of a switching whose means make its height.
const LEVEL_ROWS: usize = 8;
/// Most switchings.
const MOST_SWITCHINGS: usize = 400;

/// A fault found in readings.
#[derive(Clone, Debug)]
pub struct Fault {
    /// The sensor.
    pub sensor: usize,
    /// What it is.
    pub fault: ReadingFault,
    /// −ln p.
    pub evidence: f64,
    /// Rows from the first to one past the last.
    pub rows: (usize, usize),
    /// Parameters: name, value in SI, whether in the sensor's unit.
    pub parameters: Vec<(&'static str, f64, bool)>,
}

/// Faults of all sensors, and the readings spoilt by them.
pub fn faults(recording: &Recording, model: &Model) -> (Vec<Fault>, Vec<Vec<bool>>) {
    let mut found = Vec::new();
    let mut masked = vec![Vec::new(); recording.sensors.len()];
    for (index, series) in recording.sensors.iter().enumerate() {
        let mut mask = vec![false; series.values.len()];
        let sensor = &series.sensor;
        let moves = sensor.nominal.white > 2.0 * sensor.quantisation;
        // Clipped first: a stay at the limit is no stuck output.
        found.extend(clipped(index, &series.values, &mut mask));
        found.extend(stuck(index, &series.values, moves, &mut mask));
        found.extend(coarse(index, &series.values, sensor.quantisation, sensor.nominal.white));
        masked[index] = mask;
    }
    let mut steps = vec![0.0; recording.sensors.len()];
    for fault in found.iter().filter(|fault| fault.fault == ReadingFault::Quantised) {
        steps[fault.sensor] = fault.parameters.first().map_or(0.0, |parameter| parameter.1);
    }
    found.extend(spikes(model, &steps, &mut masked));
    (found, masked)
}

/// The longest run of equal readings; `moves` says whether the noise alone would move the output.
fn stuck(sensor: usize, values: &[f64], moves: bool, mask: &mut [bool]) -> Option<Fault> {
    let mut longest = (0, 0);
    let (mut equal, mut pairs) = (0usize, 0usize);
    let mut start = 0;
    let mut last: Option<(f64, usize)> = None;
    for (row, &value) in values.iter().enumerate() {
        if !value.is_finite() || mask[row] {
            continue;
        }
        if let Some((before, _)) = last {
            pairs += 1;
            if before == value {
                equal += 1;
                if row - start > longest.1 - longest.0 {
                    longest = (start, row);
                }
            } else {
                start = row;
            }
        } else {
            start = row;
        }
        last = Some((value, row));
    }
    let (first, end) = longest;
    let length = values[first..end].iter().filter(|value| value.is_finite()).count();
    if length < SHORTEST_RUN {
        return None;
    }
    let present = values.iter().filter(|value| value.is_finite()).count();
    if length + 1 >= present {
        // It never moved at all.
        mask.fill(true);
        return moves.then(|| Fault {
            sensor,
            fault: ReadingFault::Stuck,
            evidence: present as f64,
            rows: (first, end + 1),
            parameters: vec![("onset_s", first as f64, false)],
        });
    }
    let outside = pairs.saturating_sub(length);
    let p = (equal.saturating_sub(length) as f64 + 1.0) / (outside as f64 + 2.0);
    let evidence = -(pairs as f64).ln() - length as f64 * p.ln();
    if evidence < 20.0 {
        return None;
    }
    mask[first..=end].fill(true);
    Some(Fault {
        sensor,
        fault: ReadingFault::Stuck,
        evidence,
        rows: (first, end + 1),
        parameters: vec![("onset_s", first as f64, false)],
    })
}

/// Readings that pile up at the largest or the smallest value.
fn clipped(sensor: usize, values: &[f64], mask: &mut [bool]) -> Option<Fault> {
    let mut sorted: Vec<f64> =
        values.iter().zip(&*mask).filter(|(v, masked)| v.is_finite() && !**masked).map(|(v, _)| *v).collect();
    sorted.sort_by(f64::total_cmp);
    let mut levels = sorted.clone();
    levels.dedup();
    if levels.len() < FEWEST_LEVELS {
        return None;
    }
    let count = |level: f64| {
        sorted.partition_point(|&value| value <= level) - sorted.partition_point(|&value| value < level)
    };
    let last = levels.len() - 1;
    let ends = [(levels[last], levels[last - 1]), (levels[0], levels[1])];
    let mut evidence = 0.0;
    let mut limits = Vec::new();
    for (end, next) in ends {
        let (at_end, at_next) = (count(end), count(next));
        if at_end >= FEWEST_CLIPPED && at_end as f64 > CLIPPED_RATIO * at_next as f64 {
            // P(at least so many of the sum at the end) ≤ C(n, k) 2⁻ⁿ · 2 for k ≫ n/2.
            let n = (at_end + at_next) as f64;
            evidence += n * std::f64::consts::LN_2
                - (ln_gamma(n + 1.0) - ln_gamma(at_end as f64 + 1.0) - ln_gamma(at_next as f64 + 1.0))
                - std::f64::consts::LN_2;
            limits.push(end);
        }
    }
    let limit = *limits.first()?;
    if evidence < 10.0 {
        return None;
    }
    let present: Vec<bool> =
        values.iter().filter(|value| value.is_finite()).map(|value| limits.contains(value)).collect();
    let stays = present.windows(2).filter(|pair| !pair[0] && pair[1]).count();
    if stays < FEWEST_STAYS {
        return None;
    }
    let mut rows = (values.len(), 0);
    for (row, value) in values.iter().enumerate() {
        if limits.contains(value) {
            mask[row] = true;
            rows = (rows.0.min(row), rows.1.max(row + 1));
        }
    }
    let parameters = vec![("limit", limit.abs(), true)];
    Some(Fault { sensor, fault: ReadingFault::Saturated, evidence, rows, parameters })
}

/// The step of the lattice on which all readings lie, if it is coarser than nominal and than the noise.
fn coarse(sensor: usize, values: &[f64], nominal: f64, white: f64) -> Option<Fault> {
    let mut levels: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let present = levels.len();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    if levels.len() < 3 {
        return None;
    }
    let span = levels.last()? - levels.first()?;
    let differences = || levels.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-9 * span);
    let step = differences().fold(f64::INFINITY, f64::min);
    let off = |difference: f64| {
        let steps = difference / step;
        (steps - steps.round()).abs()
    };
    let largest = levels.first().map_or(0.0, |first| first.abs()).max(span);
    let tolerance = OFF_LATTICE + 1e-9 * largest / step;
    let steps = span / step;
    if !step.is_finite() || steps > 1e5 || differences().any(|difference| off(difference) > tolerance * 10.0)
    {
        return None;
    }
    (step > COARSER * nominal && step >= LEAST_STEP * white).then(|| Fault {
        sensor,
        fault: ReadingFault::Quantised,
        // Each reading has fallen into the tolerance about the lattice.
        evidence: present as f64,
        rows: (0, values.len()),
        parameters: vec![("step", step, true)],
    })
}

/// Readings that stand off from their neighbours on both sides.
fn spikes(model: &Model, steps: &[f64], masked: &mut [Vec<bool>]) -> Vec<Fault> {
    let mut found = Vec::new();
    for block in &model.blocks {
        let rows = block.rows();
        let visible = |row: usize| {
            block.present[row]
                && block.sensors.iter().all(|&sensor| !masked[sensor].get(row).copied().unwrap_or(false))
        };
        let used: Vec<usize> = (0..rows).filter(|&row| visible(row)).collect();
        if used.len() < 10 * NEIGHBOURS {
            continue;
        }
        let floor = (block.sources.iter())
            .map(|&source| {
                let noise = &model.sources[source].nominal;
                let step = steps.get(model.sources[source].sensor).copied().unwrap_or_default();
                (noise.white_variance() + step * step / 4.0).sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        // Standoff from the medians of both sides, 0 where they disagree.
        let mut standoffs = vec![vec![0.0; used.len()]; block.channels];
        for (channel, standoffs) in standoffs.iter_mut().enumerate() {
            let value = |place: usize| block.data[channel * rows + used[place]];
            let mut spread: Vec<f64> = Vec::with_capacity(used.len());
            for place in NEIGHBOURS..used.len() - NEIGHBOURS {
                let before = median3([value(place - 3), value(place - 2), value(place - 1)]);
                let after = median3([value(place + 1), value(place + 2), value(place + 3)]);
                let (left, right) = (value(place) - before, value(place) - after);
                spread.push(left.abs());
                standoffs[place] =
                    if left * right > 0.0 { left.abs().min(right.abs()) * left.signum() } else { 0.0 };
            }
            let middle = spread.len() / 2;
            let median = *spread.select_nth_unstable_by(middle, f64::total_cmp).1;
            // Readings that seldom move have no spread of their own.
            let scale = (1.4826 * median).max(floor);
            for standoff in standoffs.iter_mut() {
                *standoff = if scale > 0.0 { *standoff / scale } else { 0.0 };
            }
        }
        let bound = FALSE_SPIKES / used.len() as f64;
        let bound = crate::statistics::two_sided_quantile(bound);
        let mut of_sensor: Vec<Vec<(usize, f64)>> = vec![Vec::new(); block.sensors.len()];
        for (place, &row) in used.iter().enumerate() {
            let vector: Vec<f64> = standoffs.iter().map(|channel| channel[place]).collect();
            let size = vector.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            if size > bound {
                let sensor = block.nearest(&vector);
                of_sensor[sensor].push((row, size));
            }
        }
        for (place, spikes) in of_sensor.into_iter().enumerate() {
            let number = spikes.len() as f64;
            if spikes.is_empty() || number > MOST_SPIKES * used.len() as f64 {
                continue;
            }
            let n = used.len() as f64;
            let choose = ln_gamma(n + 1.0) - ln_gamma(number + 1.0) - ln_gamma(n - number + 1.0);
            let tails: f64 = spikes.iter().map(|(_, u)| ln_chi_squared_tail(u * u, 1)).sum();
            let sensor = block.sensors[place];
            let mask = &mut masked[sensor];
            mask.resize(rows, false);
            for (row, _) in &spikes {
                mask[*row] = true;
            }
            let first = spikes.first().map_or(0, |spike| spike.0);
            let last = spikes.last().map_or(0, |spike| spike.0);
            found.push(Fault {
                sensor,
                fault: ReadingFault::Outliers,
                evidence: (-tails - choose).max(0.0),
                rows: (first, last + 1),
                parameters: vec![("count", number, false)],
            });
        }
    }
    found
}

fn median3([a, b, c]: [f64; 3]) -> f64 {
    a.min(b).max(a.max(b).min(c))
}

/// A mean that jumps on and off, for each candidate of that kind.
pub fn jumps(bench: &Bench<'_>, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Vec<Proposal> {
    let mut proposals = Vec::new();
    for (index, candidate) in bench.case.candidates.iter().enumerate() {
        if !matches!(candidate.search, Search::Readings(ReadingFault::IntermittentJump)) || !wanted(index) {
            continue;
        }
        let known = bench.terms.iter().any(|term| term.candidate == index);
        if let (false, Some(proposal)) = (known, jump(bench, index, candidate)) {
            proposals.push(proposal);
        }
    }
    proposals
}

fn jump(bench: &Bench<'_>, index: usize, candidate: &Candidate) -> Option<Proposal> {
    let Target::Sensor(sensor) = candidate.target else { return None };
    let place = bench.case.model.block_of(sensor)?;
    let block = &bench.case.model.blocks[place];
    let whitened = bench.blocks[place].as_ref()?;
    let rows = block.rows();
    let used: Vec<usize> = (0..rows).filter(|&row| block.present[row]).collect();
    let value = |at: usize| whitened.projected.data[used[at]];
    // Switchings: where the means of the rows behind and before differ by many of the spreads of such differences.
    let mut sums = vec![0.0; used.len() + 1];
    for at in 0..used.len() {
        sums[at + 1] = sums[at] + value(at);
    }
    let difference =
        |at: usize| (sums[at + LEVEL_ROWS] - 2.0 * sums[at] + sums[at - LEVEL_ROWS]) / LEVEL_ROWS as f64;
    let range = LEVEL_ROWS..used.len().saturating_sub(LEVEL_ROWS);
    let mut sizes: Vec<f64> = range.clone().map(|at| difference(at).abs()).collect();
    if sizes.is_empty() {
        return None;
    }
    let middle = sizes.len() / 2;
    let spread = 1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut switchings: Vec<(usize, f64)> = Vec::new();
    for at in range {
        let height = difference(at);
        if height.abs() < SWITCHING * spread {
            continue;
        }
        match switchings.last_mut() {
            Some(last) if used[at] - last.0 < LEVEL_ROWS && height * last.1 > 0.0 => {
                if height.abs() > last.1.abs() {
                    *last = (used[at], height);
                }
            }
            _ => switchings.push((used[at], height)),
        }
        if switchings.len() > MOST_SWITCHINGS {
            return None;
        }
    }
    if switchings.len() < 3 {
        return None;
    }
    let mut heights: Vec<f64> = switchings.iter().map(|switching| switching.1.abs()).collect();
    let middle = heights.len() / 2;
    let height = *heights.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Up and down in turn, each about as high.
    let mut kept: Vec<(usize, f64)> = Vec::new();
    for switching in switchings {
        let fits = (switching.1.abs() / height - 1.0).abs() < 0.6;
        if fits && kept.last().is_none_or(|last| last.1.signum() != switching.1.signum()) {
            kept.push(switching);
        }
    }
    let first = kept.first()?.1.signum();
    let mut on = vec![0.0; rows];
    let mut pairs = 0;
    for pair in kept.chunks(2) {
        let end = pair.get(1).map_or(rows, |end| end.0);
        on[pair[0].0..end].fill(1.0);
        pairs += 1;
    }
    if pairs < 2 {
        return None;
    }
    let term = Term {
        candidate: index,
        nonlinear: Vec::new(),
        columns: vec![Column { parts: vec![(sensor, on.iter().map(|value| value * first).collect())] }],
        port: Port::Output,
        unit_amplitude: false,
    };
    let (gain, freedom) = bench.gain_of(&term);
    let ln_places = kept.len() as f64 * (rows as f64).ln() - ln_gamma(kept.len() as f64 + 1.0);
    Some(Proposal { term, gain, freedom, ln_places, evidence: evidence(gain, freedom, ln_places) })
}
