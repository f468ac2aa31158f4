//! Single readings that stand off from their neighbours.
use std::borrow::Cow;

use nalgebra::DVector;

use super::Fault;
use crate::catalogue::{Candidate, Column, Port, ReadingFault};
use crate::description::Term;
use crate::nominal::{Block, Model};
use crate::numeric::statistics::{ln_chi_squared_tail, median};

/// Standoff from which on a reading may be a spike, in standard deviations.
const LEAST_STANDOFF: f64 = 4.5;
/// Largest standoff that says more than a smaller one.
const LARGEST_STANDOFF: f64 = 1e3;
/// Standoff from which on spikes are compared with a reading.
const LEAST_COMPARED: f64 = 2.5;
/// Evidence below which readings that stand off are left as they are: one sensor in five thousand shows as much by chance.
const LEAST_SPIKES: f64 = 8.5;
/// Readings on each side with which one may be compared.
const NEIGHBOURS: [usize; 3] = [2, 4, MOST_NEIGHBOURS];
const MOST_NEIGHBOURS: usize = 8;
/// Distance of readings, as a multiple of the usual one, beyond which one is no neighbour of the other.
const FURTHEST_NEIGHBOUR: f64 = 3.0;
/// Part of its distance from the median of all neighbours by which a spike stands off from those of either side, and from the one
/// before and the one after it: what lasts for a few readings is no spike.
pub(super) const ALONE: f64 = 0.5;
/// Readings whose distances have one spread; where the noise grows, it is a larger one.
const ONE_SPREAD: usize = 500;
/// Standard deviation of a normal distribution over the median of its magnitudes.
const PER_MEDIAN: f64 = 1.4826;
/// Part of one by which multiples of it are spread most evenly: that of the golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Fewest readings among which spikes are sought.
const FEWEST_WITH_SPIKES: usize = 30;
/// Most spikes, as a part of the readings.
const MOST_SPIKES: f64 = 0.02;

/// What each jump of a mean among `terms` would add to a reading that is on where the term says off, and the other way round: sensor, and
/// values by rows.
pub(super) fn jumps(
    model: &Model,
    candidates: &[Candidate],
    terms: &[Term],
    amplitudes: &DVector<f64>,
) -> Vec<(usize, Vec<f64>)> {
    let mut first = model.constants.len();
    let mut jumps = Vec::new();
    for term in terms {
        let amplitude = amplitudes.get(first).copied().unwrap_or_default();
        first += term.amplitudes();
        let jumps_on = candidates.get(term.candidate).is_some_and(Candidate::is_jump);
        let parts = term.columns.first().filter(|_| jumps_on);
        if let Some((sensor, on)) = parts.and_then(|column| column.parts.first()) {
            jumps.push((*sensor, on.iter().map(|on| amplitude * (1.0 - 2.0 * on)).collect()));
        }
    }
    jumps
}

/// Takes the jumps off the spikes that they describe better than that there was none; whether there is such a one.
pub(super) fn take_single_stays_off(
    block: &mut Block,
    jumps: &[(usize, Vec<f64>)],
    spikes: &[(Fault, Vec<usize>)],
) -> bool {
    let rows = block.rows();
    let mut any = false;
    for (sensor, other) in jumps {
        let of_sensor = spikes.iter().filter(|(fault, _)| fault.sensor == *sensor);
        let single: Vec<usize> = of_sensor.flat_map(|(_, rows)| rows.iter().copied()).collect();
        let mut values = vec![0.0; rows];
        for &row in &single {
            values[row] = other[row];
        }
        let column = Column::on(*sensor, values);
        let Some(stays) = block.project(&column, Port::Output).map(Cow::into_owned) else { continue };
        for row in single {
            let of = |value: &dyn Fn(usize) -> f64| -> f64 {
                (0..block.channels).map(|channel| value(channel * rows + row).powi(2)).sum()
            };
            let (with, without) = (of(&|at| block.data[at] - stays[at]), of(&|at| block.data[at]));
            if with < ALONE * ALONE * without {
                (0..block.channels)
                    .for_each(|channel| block.data[channel * rows + row] -= stays[channel * rows + row]);
                any = true;
            }
        }
    }
    any
}

/// Readings of a block that stand off from their neighbours on both sides, with their rows.
///
/// Of sensors that are only compared with each other a spike may be any one's; an inertial velocity, which is an integral, has
/// none where there is another.
pub(super) fn spikes(
    model: &Model,
    block: &Block,
    steps: &[f64],
    masked: &[Vec<bool>],
) -> Vec<(Fault, Vec<usize>)> {
    let mut found = Vec::new();
    let rows = block.rows();
    let visible = |row: usize| {
        block.present[row]
            && block.sensors.iter().all(|&sensor| !masked[sensor].get(row).copied().unwrap_or(false))
    };
    let used: Vec<usize> = (0..rows).filter(|&row| visible(row)).collect();
    if used.len() < FEWEST_WITH_SPIKES {
        return found;
    }
    let found_step = |source: usize| steps.get(model.sources[source].sensor).copied().unwrap_or_default();
    let floor = (block.sources.iter())
        .map(|&source| {
            let (noise, step) = (&model.sources[source].nominal, found_step(source));
            (noise.white_variance() + step * step / 4.0).sqrt()
        })
        .fold(f64::INFINITY, f64::min);
    // What is made of several outputs goes by no step.
    let step = match block.sources[..] {
        [source] => found_step(source).max(model.sources[source].nominal.rounding),
        _ => 0.0,
    };
    let standoffs: Vec<Vec<f64>> = (0..block.channels)
        .map(|channel| {
            let values: Vec<f64> = used.iter().map(|row| block.data[channel * rows + row]).collect();
            // Readings that seldom move have no spread of their own.
            let of = NEIGHBOURS.map(|neighbours| standoffs(&values, neighbours, step, floor));
            let closest = of.into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b));
            closest.map(|(_, standoffs)| standoffs).unwrap_or_default()
        })
        .collect();
    // In a gap the motion may have turned back.
    let apart: Vec<f64> = used.windows(2).map(|pair| (pair[1] - pair[0]) as f64).collect();
    let furthest = FURTHEST_NEIGHBOUR * median(&mut apart.clone());
    let is_beside_gap = |place: usize| {
        let sides = [place.checked_sub(1), Some(place)].into_iter().flatten();
        sides.filter_map(|side| apart.get(side)).any(|&rows| rows > furthest)
    };
    let mut of_sensor: Vec<Vec<(usize, f64)>> = vec![Vec::new(); block.sensors.len()];
    for (place, &row) in used.iter().enumerate().filter(|(place, _)| !is_beside_gap(*place)) {
        let vector: Vec<f64> = standoffs.iter().map(|channel| channel[place]).collect();
        let size = vector.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if size > LEAST_COMPARED {
            let nearest = block.nearest(&vector);
            let jumps = |place: &usize| !model.sources[block.sources[*place]].integrates;
            let sensor = block.alike(nearest).into_iter().find(jumps).unwrap_or(nearest);
            of_sensor[sensor].push((row, size));
        }
    }
    for (place, mut furthest) in of_sensor.into_iter().enumerate() {
        let Some((number, evidence)) = most_evidence(&mut furthest, used.len()) else { continue };
        let mut spikes = furthest;
        spikes.truncate(number);
        spikes.sort_by_key(|spike| spike.0);
        let sensor = block.sensors[place];
        let rows: Vec<usize> = spikes.iter().map(|spike| spike.0).collect();
        let first = rows.first().copied().unwrap_or_default();
        let last = rows.last().copied().unwrap_or_default();
        let fault = Fault {
            sensor,
            fault: ReadingFault::Outliers,
            evidence,
            rows: (first, last + 1),
            parameters: vec![("count", number as f64, false)],
        };
        found.push((fault, rows));
    }
    found
}

/// Spread of the distances of readings from the median of so many neighbours on each side, as there are near an end, and those
/// distances, in standard deviations of at least `floor`; 0 of one that matters where it is not that reading [alone](is_alone).
///
/// Distances of readings that go by a `step` are multiples of half of it. They are spread evenly over these: many equal ones would all
/// stand off from the next level, and their median would be a level.
pub(super) fn standoffs(values: &[f64], neighbours: usize, step: f64, floor: f64) -> (f64, Vec<f64>) {
    let last = values.len().saturating_sub(1);
    // What steadily rises is that far from the middle of those of one side.
    let rise = median(&mut values.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>());
    let risen = 0.5 * (MOST_NEIGHBOURS + 1) as f64 * rise;
    let mut both = Vec::with_capacity(2 * neighbours);
    let mut distance = |place: usize| {
        let [before, after] = sides(values, place, neighbours);
        both.clear();
        both.extend(before.iter().chain(after));
        // The median of fewer has a larger error.
        let of_fewer = (1.0 + 1.0 / both.len() as f64) / (1.0 + 0.5 / neighbours as f64);
        let evenly = (place as f64 * GOLDEN).fract() - 0.5;
        let of_trend = match place {
            0 => -risen,
            place if place == last => risen,
            _ => 0.0,
        };
        (values[place] - median(&mut both) - of_trend) / of_fewer.sqrt() + 0.5 * step * evenly
    };
    let mut distances: Vec<f64> = (0..values.len()).map(&mut distance).collect();
    let spread = |distances: &[f64]| {
        let mut sizes: Vec<f64> = distances.iter().map(|distance| distance.abs()).collect();
        PER_MEDIAN * median(&mut sizes)
    };
    let whole = spread(&distances).max(floor);
    // What turns back is further from those of one side than from those of both.
    let of_one_side = std::cell::LazyCell::new(|| {
        let from_before = |window: &[f64]| {
            let (last, before) = window.split_last().unwrap_or((&f64::NAN, &[]));
            last - median(&mut before.to_vec()) - risen
        };
        spread(&values.windows(MOST_NEIGHBOURS + 1).map(from_before).collect::<Vec<f64>>())
    });
    for (part, distances) in distances.chunks_mut(ONE_SPREAD).enumerate() {
        // Of a few readings the spread is not known.
        let own = if distances.len() > ONE_SPREAD / 2 { spread(distances).max(whole) } else { whole };
        for (place, distance) in (part * ONE_SPREAD..).zip(distances) {
            let standoff = |own: f64| if own > 0.0 { *distance / own } else { 0.0 };
            let is_far = standoff(own).abs() > LEAST_COMPARED;
            let is_at_end = place == 0 || place == last;
            *distance = standoff(if is_far && is_at_end { own.max(*of_one_side) } else { own });
            if distance.abs() > LEAST_COMPARED && !is_alone(values, place, neighbours) {
                *distance = 0.0;
            }
        }
    }
    (whole, distances)
}

/// The neighbours of a reading before and after it: as many on the one side as on the other, but for the first and the last reading, which
/// have those of one side, and more of them, as these must show a slope themselves.
pub(super) fn sides(values: &[f64], place: usize, neighbours: usize) -> [&[f64]; 2] {
    let (before, after) = (&values[..place], &values[place + 1..]);
    let reach = match before.len().min(after.len()) {
        0 => MOST_NEIGHBOURS,
        fewer => neighbours.min(fewer),
    };
    [&before[before.len().saturating_sub(reach)..], &after[..reach.min(after.len())]]
}

/// Whether a reading stands off from its neighbours of either side alike, and from the nearest: from their levels, or, of readings that rise
/// or fall from row to row, from the lines through them. The first and the last reading have one side, and are alone where the nearest of
/// it does not stand off from the others.
pub(super) fn is_alone(values: &[f64], place: usize, neighbours: usize) -> bool {
    let value = values[place];
    let [before, after] = sides(values, place, neighbours);
    let middle = |values: &mut dyn Iterator<Item = f64>| median(&mut values.collect::<Vec<f64>>());
    let distance = value - middle(&mut before.iter().chain(after).copied());
    let stands_off = |from: f64| (value - from) / distance > ALONE;
    // Nearest first.
    let [before, after]: [Vec<f64>; 2] = [before.iter().rev().copied().collect(), after.to_vec()];
    match (before.as_slice(), after.as_slice()) {
        ([nearest, others @ ..], []) | ([], [nearest, others @ ..]) => {
            let of_nearest = nearest - middle(&mut others.iter().copied());
            stands_off(*nearest) && of_nearest.abs() < ALONE * distance.abs()
        }
        (before, after) => {
            let from_level =
                |side: &[f64]| stands_off(middle(&mut side.iter().copied())) && stands_off(side[0]);
            let from_line = |side: &[f64]| {
                let rise = middle(&mut side.windows(2).map(|pair| pair[0] - pair[1]));
                let centre = 0.5 * (side.len() + 1) as f64;
                stands_off(middle(&mut side.iter().copied()) + centre * rise) && stands_off(side[0] + rise)
            };
            [before, after].into_iter().all(from_level)
                || [before, after].into_iter().all(|side| side.len() > 1 && from_line(side))
        }
    }
}

/// How many of the readings (row, standoff) that stand off most are spikes, and how much they show: several that would not stand
/// out alone do together. They are left sorted by their standoff.
///
/// However many readings there are, −ln P of the n that stand off most, each less that of the next one, add up to a gamma
/// distribution of shape n where all are Gaussian (Rényi, Acta Mathematica Hungarica 4, 1953, 191).
pub(super) fn most_evidence(standoffs: &mut [(usize, f64)], rows: usize) -> Option<(usize, f64)> {
    standoffs.sort_by(|a, b| b.1.total_cmp(&a.1));
    let spikes = standoffs.partition_point(|(_, standoff)| *standoff > LEAST_STANDOFF);
    if spikes as f64 > MOST_SPIKES * rows as f64 {
        return None;
    }
    // Beyond doubt one is as good as another: the law of the next must not drown in the largest.
    let alone = |standoff: f64| -ln_chi_squared_tail(standoff.min(LARGEST_STANDOFF).powi(2), 1);
    let mut sum = 0.0;
    let mut best: Option<(usize, f64)> = None;
    for number in 1..=spikes {
        sum += alone(standoffs[number - 1].1);
        let next = standoffs.get(number).map_or(LEAST_COMPARED, |(_, standoff)| *standoff);
        let n = number as f64;
        // The number was sought as well.
        let evidence = -ln_chi_squared_tail(2.0 * (sum - n * alone(next)), 2 * number) - n.ln();
        if evidence > best.map_or(LEAST_SPIKES, |best| best.1) {
            best = Some((number, evidence));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::Distribution;
    use statrs::function::erf::erfc_inv;

    use super::*;

    /// One reading that stands off is a spike with any number of neighbours; a few in a row, a step and a ramp are none.
    #[test]
    fn only_single_readings_are_spikes() {
        let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0) - 0.5;
        let quiet: Vec<f64> = (0..2000).map(jitter).collect();
        for neighbours in NEIGHBOURS {
            let spikes = |change: &dyn Fn(usize) -> f64| -> Vec<usize> {
                let values: Vec<f64> = quiet.iter().enumerate().map(|(k, v)| v + change(k)).collect();
                let (_, found) = standoffs(&values, neighbours, 0.0, 0.0);
                (0..values.len()).filter(|k| found[*k].abs() > LEAST_STANDOFF).collect()
            };
            assert!(spikes(&|_| 0.0).is_empty());
            assert_eq!(spikes(&|k| if k == 700 { -4.0 } else { 0.0 }), [700]);
            assert!(spikes(&|k| if (700..703).contains(&k) { 4.0 } else { 0.0 }).is_empty());
            assert!(spikes(&|k| if k >= 700 { 4.0 } else { 0.0 }).is_empty());
            assert!(spikes(&|k| 0.1 * k as f64).is_empty());
            // At the ends, and on a slope that is steeper than the spike; but no kink, no step of a slope, and nothing that decays.
            for place in [0, 1, 2, 1996, 1998, 1999] {
                assert_eq!(spikes(&|k| if k == place { 6.0 } else { 0.0 }), [place]);
            }
            for place in [0, 1999] {
                let rise = if place == 0 { -0.3 } else { 0.3 };
                assert_eq!(spikes(&|k| rise * k as f64 + if k == place { 6.0 } else { 0.0 }), [place]);
            }
            // Nor what swings, wherever it is at the ends.
            for begin in 0..20 {
                assert!(spikes(&|k| 20.0 * (0.45 * (k + begin) as f64).sin()).is_empty());
            }
            for rise in [1.0, 10.0, 100.0] {
                assert_eq!(spikes(&|k| rise * k as f64 + if k == 700 { 6.0 } else { 0.0 }), [700]);
                assert!(spikes(&|k| rise * k.saturating_sub(700) as f64).is_empty());
                assert!(spikes(&|k| rise * k as f64 + if k >= 700 { 6.0 } else { 0.0 }).is_empty());
                assert!(spikes(&|k| rise * (-(k as f64) / 2.0).exp()).is_empty());
            }
        }
    }

    /// A month of Gaussian readings has many that stand off far: they are no spikes, and those that stand off further are.
    #[test]
    fn largest_of_a_month_of_gaussian_readings_are_no_spikes() {
        const ROWS: usize = 2_600_000;
        const EVERY: f64 = 4.0;
        let beyond = statrs::function::erf::erfc(EVERY / std::f64::consts::SQRT_2);
        let mut random = rand_pcg::Pcg64::seed_from_u64(5);
        let mut month = || -> Vec<(usize, f64)> {
            let tail = (0..(ROWS as f64 * beyond) as usize).map(|_| beyond * random.random::<f64>());
            tail.map(|p| (0, std::f64::consts::SQRT_2 * erfc_inv(p))).collect()
        };
        // One in five thousand, less than one of these, and the number that was sought.
        assert!((0..2000).filter(|_| most_evidence(&mut month(), ROWS).is_some()).count() <= 4);
        let mut with_spikes = month();
        with_spikes.extend([(1, 8.0), (2, 6.6), (3, 7.0), (4, 20.0), (5, 1e9)]);
        assert_eq!(most_evidence(&mut with_spikes, ROWS).unwrap().0, 5);
        assert_eq!(with_spikes[..5].iter().map(|spike| spike.0).collect::<Vec<_>>(), [5, 4, 1, 3, 2]);
    }

    /// Nor are those of readings that are coarse, of which many are equal.
    #[test]
    fn largest_of_coarse_readings_are_no_spikes() {
        let mut random = rand_pcg::Pcg64::seed_from_u64(6);
        for step in [0.5, 0.7, 1.5, 3.0] {
            let mut noise = || -> f64 { rand_distr::StandardNormal.sample(&mut random) };
            let values: Vec<f64> = (0..600_000).map(|_| (noise() / step).round() * step).collect();
            let floor = (1.0_f64 + step * step / 4.0).sqrt();
            for neighbours in NEIGHBOURS {
                let (_, found) = standoffs(&values, neighbours, step, floor);
                let far = found.iter().map(|standoff| standoff.abs()).enumerate();
                let mut far: Vec<(usize, f64)> = far.filter(|(_, it)| *it > LEAST_COMPARED).collect();
                assert!(most_evidence(&mut far, values.len()).is_none(), "{step} {neighbours}");
            }
        }
    }
}
