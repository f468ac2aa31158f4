//! Readings that pile up at a limit of the output, and those near it.
use schuler_recording::Recording;
use statrs::function::gamma::ln_gamma;

use super::Fault;
use super::spikes::ALONE;
use crate::catalogue::{Column, Port, ReadingFault};
use crate::nominal::{Block, Model, of_input};
use crate::numeric::statistics::median;

/// Fewest readings at a limit that are more than at the next value; and fewest that are equal where others do not coincide.
pub const FEWEST_PILED: usize = 8;
const FEWEST_EQUAL: usize = 3;
/// Fewest separate stays at a limit where the last of them lasts until the end: a stuck output stays for good, and that of a
/// growing input stays at its largest reading.
const FEWEST_STAYS: usize = 3;
/// How many times as many readings as at the next value.
const CLIPPED_RATIO: f64 = 4.0;
/// Evidence of a limit, and of one beside a known input, nats.
const LEAST_CLIPPED: f64 = 10.0;
pub(super) const LEAST_BESIDE_INPUT: f64 = 20.0;
/// Fewest different values of an output that may be clipped.
const FEWEST_LEVELS: usize = 12;
/// Deviations within which readings at a limit are alike.
const ALIKE_AT_LIMIT: f64 = 5.0;
/// Readings at the next largest inputs with which clipped ones are compared.
const COMPARED: usize = 5;
/// Deviations by which what should be read must stay off a limit that has cut readings off, for its error to be as others are: at so many
/// the mean error of what is left is half a hundredth of the deviation.
const NEAR_LIMIT: f64 = 3.0;

/// Readings that pile up at the largest or the smallest value. Of an output that dwells on a level while its input hardly
/// moves, coarser than its noise, only the first of a stay counts.
pub(super) fn clipped(sensor: usize, values: &[f64], dwells: bool, mask: &mut [bool]) -> Option<Fault> {
    let mut sorted: Vec<f64> =
        values.iter().zip(&*mask).filter(|(v, masked)| v.is_finite() && !**masked).map(|(v, _)| *v).collect();
    if dwells {
        sorted.dedup();
    }
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
    let singles = held_once(values, &ends.map(|(end, _)| end));
    let mut evidence = 0.0;
    let mut limits = Vec::new();
    // An output that gives nothing for a while is dead, and not at a limit.
    for (end, next) in ends.into_iter().filter(|(end, _)| *end != 0.0) {
        let (at_end, at_next) = (count(end), count(next));
        let mut own = 0.0_f64;
        if at_end >= FEWEST_PILED && at_end as f64 > CLIPPED_RATIO * at_next as f64 {
            // P(at least so many of the sum at the end) ≤ C(n, k) 2⁻ⁿ · 2 for k ≫ n/2.
            let n = (at_end + at_next) as f64;
            own = n * std::f64::consts::LN_2
                - (ln_gamma(n + 1.0) - ln_gamma(at_end as f64 + 1.0) - ln_gamma(at_next as f64 + 1.0))
                - std::f64::consts::LN_2;
        }
        let equal = singles.iter().filter(|&&value| value == end).count().min(at_end);
        if equal >= FEWEST_EQUAL {
            // Where readings seldom coincide, so many that are equal are no chance wherever they lie.
            let coincide = (sorted.len() - levels.len()).saturating_sub(at_end - 1) as f64 + 1.0;
            let rate = coincide / (sorted.len() as f64 + 2.0);
            own = own.max(-(equal as f64 - 1.0) * rate.ln() - (sorted.len() as f64).ln());
        }
        if own > 0.0 {
            evidence += own;
            limits.push(end);
        }
    }
    let limit = *limits.first()?;
    if evidence < LEAST_CLIPPED {
        return None;
    }
    let present: Vec<bool> =
        values.iter().filter(|value| value.is_finite()).map(|value| limits.contains(value)).collect();
    let stays = present.windows(2).filter(|pair| !pair[0] && pair[1]).count();
    if stays < FEWEST_STAYS && present.last() == Some(&true) {
        return None;
    }
    // The first few readings of an output that has not begun are no limit.
    if stays == 0 && present.iter().filter(|&&at_limit| at_limit).count() < FEWEST_PILED {
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

/// Whether the output would go beyond the limit at which it is said to be clipped: of a coarse one that is held at its largest input the
/// largest reading is the right one. `residuals` are what the readings are less what they should be.
pub(super) fn goes_beyond(fault: &Fault, values: &[f64], residuals: &[f64], step: f64) -> bool {
    let limit = fault.parameters.first().map_or(0.0, |&(_, limit, _)| limit);
    let short = |(value, residual): (&f64, &f64)| {
        (value.abs() == limit && residual.is_finite()).then(|| -residual * value.signum())
    };
    let short: Vec<f64> = values.iter().zip(residuals).filter_map(short).collect();
    short.iter().sum::<f64>() > 0.5 * step * short.len() as f64
}

/// Readings of an output; of one that is held now and then, between the `ends` of its range too, each hold once.
pub(super) fn held_once(values: &[f64], ends: &[f64]) -> Vec<f64> {
    let mut kept: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let is_held = kept.windows(2).any(|pair| pair[0] == pair[1] && !ends.contains(&pair[0]));
    if is_held {
        kept.dedup();
    }
    kept
}

/// The spikes of a sensor that a limit of its output explains, or that of another whose spikes look the same, and which of them it is.
pub(super) fn at_a_limit(
    recording: &Recording,
    model: &Model,
    sensor: usize,
    spikes: &[usize],
) -> Option<(usize, Vec<usize>)> {
    let block = &model.blocks[model.block_of(sensor)?];
    let place = block.sensors.iter().position(|&other| other == sensor)?;
    let alike = block.alike(place).into_iter().map(|place| block.sensors[place]);
    alike
        .map(|sensor| (sensor, at_limits(recording, model, sensor, spikes)))
        .find(|(_, rows)| !rows.is_empty())
}

/// A limit that only the readings in `rows` have come to.
pub(super) fn few_clipped(recording: &Recording, sensor: usize, rows: &[usize], evidence: f64) -> Fault {
    let level = |&row: &usize| recording.sensors[sensor].values[row].abs();
    let limit = rows.iter().map(level).fold(f64::INFINITY, f64::min);
    let (first, last) =
        rows.iter().fold((usize::MAX, 0), |(first, last), &row| (first.min(row), last.max(row)));
    let parameters = vec![("limit", limit, true)];
    Fault { sensor, fault: ReadingFault::Saturated, evidence, rows: (first, last + 1), parameters }
}

/// The errors of a sensor by rows, as far as they would be its alone: of the residuals of a known input, or of what others read. `None` where
/// neither is known.
pub(super) fn errors_of(block: &Block, sensor: usize) -> Option<Vec<f64>> {
    let rows = block.rows();
    let unit = Column::on(sensor, vec![1.0; rows]);
    let shape =
        block.project(&unit, Port::Output).filter(|_| block.is_of_one_sensor() || block.is_redundant())?;
    let error = |row: usize| {
        let places = (0..block.channels).map(|channel| channel * rows + row);
        let (along, of_unit) = places.fold((0.0, 0.0), |(along, of_unit), at| {
            (along + shape[at] * block.data[at], of_unit + shape[at] * shape[at])
        });
        along / of_unit
    };
    Some((0..rows).map(error).collect())
}

/// Masks the readings of a clipped sensor that should lie so near its limit that some like them were cut off: those that were not have
/// an error of one sign. By what they should be, which is known or read by others, and not by what they are, which would choose by the
/// error. Where that is most of the readings they stay.
pub(super) fn mask_near_limits(recording: &Recording, model: &Model, clipped: &Fault, masked: &mut [bool]) {
    let sensor = clipped.sensor;
    let Some(&(_, level, _)) = clipped.parameters.first() else { return };
    let Some(block) = model.block_of(sensor).map(|block| &model.blocks[block]) else { return };
    let (Some(errors), Some(source)) = (errors_of(block, sensor), model.source_of(sensor, Port::Output))
    else {
        return;
    };
    let readings = of_input(recording, &[], sensor);
    let is_left = |&row: &usize| block.present[row] && !masked[row] && errors[row].is_finite();
    let left: Vec<usize> = (0..block.rows()).filter(is_left).collect();
    let usual = median(&mut left.iter().map(|&row| errors[row]).collect::<Vec<f64>>());
    let reach = NEAR_LIMIT * model.sources[source].nominal.bounded_variance().sqrt();
    // What is masked may be stuck as well.
    let is_at_limit = |row: &usize| masked[*row] && recording.sensors[sensor].values[*row].abs() == level;
    let at_limit = (0..block.rows()).filter(is_at_limit).map(|row| readings[row]);
    let (least, most) = left.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), &row| {
        (least.min(readings[row]), most.max(readings[row]))
    });
    // What is clipped is beyond all other readings.
    let (below, above) = at_limit.fold((f64::NEG_INFINITY, f64::INFINITY), |(below, above), limit| {
        (if limit < least { limit } else { below }, if limit > most { limit } else { above })
    });
    let is_near = |row: &usize| {
        let expected = readings[*row] - errors[*row] + usual;
        expected < below + reach || expected > above - reach
    };
    let near: Vec<usize> = left.iter().copied().filter(is_near).collect();
    if 2 * near.len() <= left.len() {
        for row in near {
            masked[row] = true;
        }
    }
}

/// Those of the spikes of a sensor that a limit of its output explains: they are its readings at its largest inputs, which are known or read
/// by others, all on one level, which no other input or reading passes, and those at the next largest are right. That a spike is just there
/// is as improbable as there are readings.
pub(super) fn at_limits(recording: &Recording, model: &Model, sensor: usize, spikes: &[usize]) -> Vec<usize> {
    let Some(block) = model.block_of(sensor).map(|block| &model.blocks[block]) else { return Vec::new() };
    let Some(errors) = errors_of(block, sensor) else { return Vec::new() };
    let rows = block.rows();
    let readings = of_input(recording, &[], sensor);
    let inputs: Vec<f64> = readings.iter().zip(&errors).map(|(reading, error)| reading - error).collect();
    let variance = |&source: &usize| model.sources[source].nominal.white_variance();
    let within = ALIKE_AT_LIMIT * block.sources.iter().map(variance).sum::<f64>().sqrt();
    let mut known: Vec<usize> =
        (0..rows).filter(|&row| block.present[row] && inputs[row].is_finite()).collect();
    known.sort_by(|&a, &b| inputs[b].abs().total_cmp(&inputs[a].abs()));
    // Of no input there is no limit: any reading is as large.
    let is_clipped =
        |row: &&usize| spikes.contains(*row) && (0.0..1.0).contains(&(readings[**row] / inputs[**row]));
    let clipped: Vec<usize> = known.iter().take_while(is_clipped).copied().collect();
    if clipped.is_empty() {
        return clipped;
    }
    let levels = || clipped.iter().map(|&row| readings[row].abs());
    let (least, most) = (levels().fold(f64::INFINITY, f64::min), levels().fold(0.0, f64::max));
    let next = known.get(clipped.len()).map_or(f64::INFINITY, |&row| inputs[row].abs());
    let others = known.iter().skip(clipped.len()).map(|&row| readings[row].abs());
    let is_largest = others.fold(0.0, f64::max) <= most;
    // What is out of scale falls short at all its inputs as they are large, and by no more at the largest.
    let mut all: Vec<f64> = known.iter().map(|&row| errors[row]).collect();
    let usual = median(&mut all);
    let of_input = |&row: &usize| ((errors[row] - usual) / inputs[row]).abs();
    let mut of_next: Vec<f64> = known.iter().skip(clipped.len()).take(COMPARED).map(of_input).collect();
    let of_clipped = clipped.iter().map(of_input).fold(f64::INFINITY, f64::min);
    let in_scale = median(&mut of_next) < ALONE * of_clipped;
    if most - least < within && least > next - within && is_largest && in_scale {
        clipped
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::stuck::{Repeats, stuck};

    /// Readings that pile up at the top are clipped where the input went on, and right where it did not.
    #[test]
    fn what_is_clipped_would_have_gone_beyond() {
        let values = [3.0, 5.0, 5.0, -5.0, 1.0];
        let fault = Fault {
            sensor: 0,
            fault: ReadingFault::Saturated,
            evidence: 20.0,
            rows: (1, 4),
            parameters: vec![("limit", 5.0, true)],
        };
        assert!(goes_beyond(&fault, &values, &[0.1, -1.2, -2.0, 0.9, f64::NAN], 1.0));
        assert!(!goes_beyond(&fault, &values, &[0.1, 0.3, -0.4, 0.2, 0.0], 1.0));
    }

    /// Two equal readings with a stay at the limit between them are no stuck output.
    #[test]
    fn a_stay_at_a_limit_is_no_run() {
        let mut values: Vec<f64> = (0..2000).map(|k| f64::from((k * 7919) % 1999)).collect();
        values[700] = 2999.0;
        values[701..800].fill(3000.0);
        values[800] = 2999.0;
        let mut mask: Vec<bool> = values.iter().map(|value| *value == 3000.0).collect();
        let clipped = mask.clone();
        let repeats = Repeats { moves: true, at_rest: 0.0 };
        assert!(stuck(0, &values, repeats, &mut mask).is_none());
        assert_eq!(mask, clipped);
    }

    /// One stay at the largest reading is clipping if the output leaves it again; one that lasts may be stuck.
    #[test]
    fn one_stay_that_ends_is_clipped() {
        let jitter = |k: usize| ((k * 7919) % 997) as f64 / 997.0;
        let pulse = |rows: usize| -> Vec<f64> {
            let input =
                (0..rows).map(|k| 300.0 * (k as f64 / 2000.0 * std::f64::consts::PI).sin() + jitter(k));
            input.map(|value| value.min(299.5)).collect()
        };
        let found = |values: &[f64]| {
            clipped(0, values, false, &mut vec![false; values.len()]).map(|it| it.parameters[0].1)
        };
        assert_eq!(found(&pulse(2000)), Some(299.5));
        let unclipped: Vec<f64> = pulse(2000).iter().enumerate().map(|(k, v)| v + jitter(k)).collect();
        assert_eq!(found(&unclipped), None);
        let mut stuck = pulse(950);
        stuck.extend([299.6; 15]);
        assert_eq!(found(&stuck), None);
    }

    /// A few equal readings at the top are clipping where no others are equal, and a hold where the output is held elsewhere.
    #[test]
    fn few_readings_are_clipped_where_no_others_are_equal() {
        let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0);
        let peak = |k: usize| 40.0 * (-0.5 * ((k as f64 - 1500.0) / 5.0).powi(2)).exp();
        let found = |values: &[f64]| clipped(0, values, false, &mut vec![false; values.len()]);
        let mut values: Vec<f64> = (0..4000).map(|k| jitter(k) + peak(k)).collect();
        assert!(found(&values).is_none());
        for value in &mut values {
            *value = value.min(34.0);
        }
        let rows = found(&values).unwrap().rows;
        let mut late = vec![-1.0; 5];
        late.extend((0..4000).map(jitter));
        assert!(found(&late).is_none());
        assert!((1495..1499).contains(&rows.0) && (1502..1506).contains(&rows.1), "{rows:?}");
        let held = values[300];
        values[300..305].fill(held);
        assert!(found(&values).is_none());
    }

    /// A coarse output that stands still at its largest input, time and again, repeats the largest reading.
    #[test]
    fn coarse_readings_that_dwell_at_the_top_are_not_clipped() {
        let stay = || (0..12).chain([12; 40]).chain((0..12).rev()).map(f64::from);
        let values: Vec<f64> = (0..4).flat_map(|_| stay()).collect();
        let found = |dwells: bool| clipped(0, &values, dwells, &mut vec![false; values.len()]).is_some();
        assert!(found(false));
        assert!(!found(true));
    }
}
