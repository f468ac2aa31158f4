//! Faults that readings show without a model of the sensor: stuck, clipped, coarse, spiked.
//!
//! They are sought before anything else, and the readings that they spoil are missing from then on: a single spike
//! would breed findings of every kind. Evidence is −ln of a probability on the safe side:
//! - stuck: a run of L equal readings, where neighbours are equal with the probability p elsewhere: N pᴸ;
//! - clipped: more readings at the extreme value than at the next, which in a tail are fewer: binomial with ½; or more
//!   that are equal than coincide elsewhere;
//! - coarse: all readings on a lattice coarser than nominal, and than the noise or than so many readings let pass unseen;
//! - spikes: n readings that stand off from their neighbours on both sides more than the next does: n P(χ²₂ₙ > 2 Σ (xᵢ − x₍ₙ₊₁₎)),
//!   x = −ln 2Φ(−u), at the n that shows most. u is the distance from the median of the neighbours, as many of them as make it
//!   spread least: few where the output wanders, many where its noise is white.
use std::borrow::Cow;

use nalgebra::DVector;
use rayon::prelude::*;
use schuler_recording::Recording;
use schuler_recording::recording::SensorSeries;
use statrs::function::erf::erf;
use statrs::function::gamma::ln_gamma;

use crate::catalogue::{Candidate, Column, Port, ReadingFault};
use crate::description::{Term, blocks_of, remainder};
use crate::noise::Noise;
use crate::nominal::{Block, Model, of_input};
use crate::statistics::{ln_chi_squared_tail, median};

/// Shortest run of equal readings that may be a stuck output.
const SHORTEST_RUN: usize = 5;
/// Fewest readings at a limit that are more than at the next value; and fewest that are equal where others do not coincide.
pub const FEWEST_PILED: usize = 8;
const FEWEST_EQUAL: usize = 3;
/// Fewest separate stays at a limit where the last of them lasts until the end: a stuck output stays for good, and that of a
/// growing input stays at its largest reading.
const FEWEST_STAYS: usize = 3;
/// How many times as many readings as at the next value.
const CLIPPED_RATIO: f64 = 4.0;
/// Evidence of a stuck output, of a limit, and of one beside a known input, nats.
const LEAST_STUCK: f64 = 20.0;
const LEAST_CLIPPED: f64 = 10.0;
const LEAST_BESIDE_INPUT: f64 = 20.0;
/// Fewest different values of an output that may be clipped.
const FEWEST_LEVELS: usize = 12;
/// A lattice matters if its step is at least this part of the white noise,
pub const LEAST_STEP: f64 = 1.0;
/// or if the noise of rounding, which is step²/12, is worth so many nats in a record of that length.
const LEAST_OF_ROUNDING: f64 = 10.0;
/// A lattice is coarser than nominal by at least this factor.
const COARSER: f64 = 1.5;
/// Fewest different readings that show a lattice: two lie on one anyhow, and show it if they come again so often.
const FEWEST_OF_LATTICE: usize = 3;
const FEWEST_CROSSINGS: usize = 20;
/// Most levels from the least to the largest reading: with more, the digits of a table are a lattice, unless readings come to a level so
/// often.
const MOST_LEVELS: f64 = 1e5;
const VISITS: usize = 4;
/// Largest number of steps between readings off a lattice, as a part of the step.
pub const OFF_LATTICE: f64 = 1e-3;
/// Standoff from which on a reading may be a spike, in standard deviations.
const LEAST_STANDOFF: f64 = 4.5;
/// Largest standoff that says more than a smaller one.
const LARGEST_STANDOFF: f64 = 1e3;
/// Deviations within which readings at a limit are alike.
const ALIKE_AT_LIMIT: f64 = 5.0;
/// Readings at the next largest inputs with which clipped ones are compared.
const COMPARED: usize = 5;
/// Deviations by which what should be read must stay off a limit that has cut readings off, for its error to be as others are: at so many
/// the mean error of what is left is half a hundredth of the deviation.
const NEAR_LIMIT: f64 = 3.0;
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
const ALONE: f64 = 0.5;
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

impl Fault {
    /// The step of the lattice on which coarse readings lie, SI; `None` of another fault.
    pub fn lattice_step(&self) -> Option<f64> {
        let (_, step, _) = self.parameters.first().filter(|_| self.fault == ReadingFault::Quantised)?;
        Some(*step)
    }
}

/// Faults of all sensors, and the readings spoilt by them.
pub struct Faults {
    /// The faults.
    pub found: Vec<Fault>,
    /// Whether a reading is spoilt, by sensor and row.
    pub masked: Vec<Vec<bool>>,
    /// The same but for spikes.
    masked_without_spikes: Vec<Vec<bool>>,
    /// Steps of the lattices that were found, by sensor.
    steps: Vec<f64>,
    /// Sensors of which some spikes are where a limit would be, and are left to the search.
    clipped: Vec<usize>,
}

impl Faults {
    /// Takes the spikes back that do not stand off from what `terms` with their amplitudes describe: what an effect moves for one
    /// reading, as a dead zone that is passed within a step, is none, and where a mean jumps on and off one that is on or off for a
    /// single reading. What is louder in part of the rows has fewer than its readings as a whole. `model` is that of all readings.
    pub fn spikes_beside(
        &mut self,
        model: &Model,
        candidates: &[Candidate],
        (terms, noises): (&[Term], &[Noise]),
        amplitudes: &DVector<f64>,
    ) {
        let jumps = jumps(model, candidates, terms, amplitudes);
        let mut blocks = blocks_of(model, terms);
        blocks.extend(self.clipped.iter().filter_map(|&sensor| model.block_of(sensor)));
        blocks.sort_unstable();
        blocks.dedup();
        for index in blocks {
            let own = &model.blocks[index].sensors;
            let is_own = |fault: &Fault| fault.fault == ReadingFault::Outliers && own.contains(&fault.sensor);
            let told = self.found.iter().filter(|fault| is_own(fault)).map(|fault| fault.sensor);
            let clipped = self.clipped.iter().copied().filter(|sensor| own.contains(sensor));
            let before: Vec<usize> = told.chain(clipped).collect();
            if before.is_empty() {
                continue;
            }
            let mut block = model.blocks[index].clone();
            block.data = remainder(model, index, terms, amplitudes);
            block.level(noises);
            let mut left = spikes(model, &block, &self.steps, &self.masked_without_spikes);
            if take_single_stays_off(&mut block, &jumps, &left) {
                left = spikes(model, &block, &self.steps, &self.masked_without_spikes);
            }
            self.found.retain(|fault| !is_own(fault));
            self.found.extend(
                left.into_iter().map(|(fault, _)| fault).filter(|fault| before.contains(&fault.sensor)),
            );
        }
    }

    /// Gives the spikes back that are none in readings which `noises` are louder in; whether there are such.
    pub fn spikes_of_levels(&mut self, model: &Model, noises: &[Noise]) -> bool {
        let mut any = false;
        for block in model.blocks.iter().filter(|block| block.has_level(noises)) {
            let mut block = block.clone();
            block.level(noises);
            let is_own = |fault: &Fault| {
                fault.fault == ReadingFault::Outliers && block.sensors.contains(&fault.sensor)
            };
            if !self.found.iter().any(is_own) {
                continue;
            }
            let left = spikes(model, &block, &self.steps, &self.masked_without_spikes);
            for &sensor in &block.sensors {
                let own = left.iter().filter(|(fault, _)| fault.sensor == sensor);
                let mut masked = self.masked_without_spikes[sensor].clone();
                own.flat_map(|(_, rows)| rows).for_each(|&row| masked[row] = true);
                any |= masked != self.masked[sensor];
                self.masked[sensor] = masked;
            }
            self.found.retain(|fault| !is_own(fault));
            self.found.extend(left.into_iter().map(|(fault, _)| fault));
        }
        any
    }
}

/// What each jump of a mean among `terms` would add to a reading that is on where the term says off, and the other way round: sensor, and
/// values by rows.
fn jumps(
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
fn take_single_stays_off(
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

/// Faults of all sensors, and the readings spoilt by them.
pub fn faults(recording: &Recording, model: &Model) -> Faults {
    let of_sensors: Vec<(Vec<Fault>, Vec<bool>)> = (recording.sensors.par_iter().enumerate())
        .map(|(index, series)| of_itself(index, series, model))
        .collect();
    let (found, mut masked): (Vec<Vec<Fault>>, Vec<Vec<bool>>) = of_sensors.into_iter().unzip();
    let mut found: Vec<Fault> = found.into_iter().flatten().collect();
    let mut steps = vec![0.0; recording.sensors.len()];
    for fault in &found {
        if let Some(step) = fault.lattice_step() {
            steps[fault.sensor] = step;
        }
    }
    for fault in found.iter().filter(|fault| fault.fault == ReadingFault::Saturated) {
        mask_near_limits(recording, model, fault, &mut masked[fault.sensor]);
    }
    // A sensor is in one block.
    let spikes: Vec<(Fault, Vec<usize>)> =
        model.blocks.par_iter().flat_map_iter(|block| spikes(model, block, &steps, &masked)).collect();
    let mut masked_without_spikes = masked.clone();
    let mut clipped = Vec::new();
    for (mut fault, mut rows) in spikes {
        if let Some((sensor, at_limit)) = at_a_limit(recording, model, fault.sensor, &rows) {
            // Beside a known input the search finds the limit itself.
            if model.block_of(sensor).is_some_and(|block| model.blocks[block].is_redundant()) {
                let part = at_limit.len() as f64 / rows.len() as f64;
                found.push(few_clipped(recording, sensor, &at_limit, part * fault.evidence));
                fault.evidence *= 1.0 - part;
                for masked in [&mut masked, &mut masked_without_spikes] {
                    for &row in &at_limit {
                        masked[sensor][row] = true;
                    }
                }
            } else {
                clipped.push(sensor);
            }
            rows.retain(|row| !at_limit.contains(row));
            fault.parameters = vec![("count", rows.len() as f64, false)];
        }
        for &row in &rows {
            masked[fault.sensor][row] = true;
        }
        if !rows.is_empty() {
            found.push(fault);
        }
    }
    Faults { found, masked, masked_without_spikes, steps, clipped }
}

/// What the readings of a sensor show alone, and the rows spoilt by it.
fn of_itself(index: usize, series: &SensorSeries, model: &Model) -> (Vec<Fault>, Vec<bool>) {
    let mut mask = vec![false; series.values.len()];
    let sensor = &series.sensor;
    let block = model.block_of(index).map(|block| &model.blocks[block]);
    let moves = sensor.nominal.white > 2.0 * sensor.quantisation;
    let lattice = lattice(&series.values);
    let coarse_step = lattice.map_or(0.0, |lattice| lattice.step);
    // Clipped first: a stay at the limit is no stuck output.
    let dwells = coarse_step > sensor.nominal.white;
    let clipped = clipped(index, &series.values, dwells, &mut mask);
    let clipped = clipped.filter(|fault| {
        let residuals = block.filter(|block| dwells && block.is_of_one_sensor() && !sensor.relative);
        let is_beyond =
            residuals.is_none_or(|block| goes_beyond(fault, &series.values, &block.data, coarse_step));
        // Beside a known input the search sees how far the few that are equal fall short.
        let is_known = block.is_some_and(Block::is_of_one_sensor) && !sensor.relative;
        let is_told = is_beyond && (!is_known || fault.evidence >= LEAST_BESIDE_INPUT);
        if !is_told {
            mask.fill(false);
        }
        is_told
    });
    let repeats = Repeats { moves, at_rest: same_at_rest(coarse_step, sensor.nominal.white) };
    let stuck = stuck(index, &series.values, repeats, &mut mask);
    let coarse = lattice.and_then(|lattice| {
        coarse(index, &series.values, lattice, sensor.quantisation, model.white_of(index))
    });
    (clipped.into_iter().chain(stuck).chain(coarse).collect(), mask)
}

/// How often readings repeat without being stuck.
#[derive(Clone, Copy, Debug)]
struct Repeats {
    /// Whether the noise alone would move the output.
    moves: bool,
    /// Probability that the next reading is the same while the input stands still.
    at_rest: f64,
}

/// Probability that a reading rounded to `step` repeats at a constant input, at most: noise of standard deviation `white`
/// stays within half a step of the middle of one.
fn same_at_rest(step: f64, white: f64) -> f64 {
    if step > 0.0 && white > 0.0 { erf(step / (8.0_f64.sqrt() * white)) } else { 0.0 }
}

/// The longest run of equal readings.
fn stuck(sensor: usize, values: &[f64], repeats: Repeats, mask: &mut [bool]) -> Option<Fault> {
    let mut longest = (0, 0);
    let (mut equal, mut pairs) = (0usize, 0usize);
    let mut start = 0;
    let mut last: Option<f64> = None;
    for (row, &value) in values.iter().enumerate() {
        if !value.is_finite() {
            continue;
        }
        // Two alike on both sides of a stay at a limit are no run.
        if mask[row] {
            last = None;
            continue;
        }
        if let Some(before) = last {
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
        last = Some(value);
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
        return repeats.moves.then(|| Fault {
            sensor,
            fault: ReadingFault::Stuck,
            evidence: present as f64,
            rows: (first, end + 1),
            parameters: vec![("onset_s", first as f64, false)],
        });
    }
    let outside = pairs.saturating_sub(length);
    let elsewhere = (equal.saturating_sub(length) as f64 + 1.0) / (outside as f64 + 2.0);
    // A record that moves most of the time says nothing of how readings repeat where it stands still.
    let p = elsewhere.max(repeats.at_rest);
    let evidence = -(pairs as f64).ln() - length as f64 * p.ln();
    if evidence < LEAST_STUCK {
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

/// Readings that pile up at the largest or the smallest value. Of an output that dwells on a level while its input hardly
/// moves, coarser than its noise, only the first of a stay counts.
fn clipped(sensor: usize, values: &[f64], dwells: bool, mask: &mut [bool]) -> Option<Fault> {
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
fn goes_beyond(fault: &Fault, values: &[f64], residuals: &[f64], step: f64) -> bool {
    let limit = fault.parameters.first().map_or(0.0, |&(_, limit, _)| limit);
    let short = |(value, residual): (&f64, &f64)| {
        (value.abs() == limit && residual.is_finite()).then(|| -residual * value.signum())
    };
    let short: Vec<f64> = values.iter().zip(residuals).filter_map(short).collect();
    short.iter().sum::<f64>() > 0.5 * step * short.len() as f64
}

/// Readings of an output; of one that is held now and then, between the `ends` of its range too, each hold once.
fn held_once(values: &[f64], ends: &[f64]) -> Vec<f64> {
    let mut kept: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let is_held = kept.windows(2).any(|pair| pair[0] == pair[1] && !ends.contains(&pair[0]));
    if is_held {
        kept.dedup();
    }
    kept
}

/// Whether the lattice on which all readings lie is coarser than nominal and matters beside the noise.
fn coarse(sensor: usize, values: &[f64], lattice: Lattice, nominal: f64, white: f64) -> Option<Fault> {
    let Lattice { step, levels } = lattice;
    let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let crossings = finite.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let is_lattice = levels >= FEWEST_OF_LATTICE || crossings >= FEWEST_CROSSINGS;
    // N readings whose variance is 1 + x of what it is held for: ½N (x − ln(1 + x)) nats.
    let rounding = (step.powi(2) - nominal.powi(2)) / (12.0 * white.powi(2) + nominal.powi(2));
    let worth = 0.5 * finite.len() as f64 * (rounding - rounding.ln_1p());
    let matters = step >= LEAST_STEP * white || worth >= LEAST_OF_ROUNDING;
    (is_lattice && step > COARSER * nominal && matters).then(|| Fault {
        sensor,
        fault: ReadingFault::Quantised,
        // Each reading has fallen into the tolerance about the lattice.
        evidence: finite.len() as f64,
        rows: (0, values.len()),
        parameters: vec![("step", step, true)],
    })
}

/// Levels at equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Distance of neighbouring levels.
    pub step: f64,
    /// Number of different readings.
    pub levels: usize,
}

/// The lattice on which all readings lie, if there is one; of readings that take two values only, those two.
pub fn lattice(values: &[f64]) -> Option<Lattice> {
    let mut levels: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let readings = levels.len();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let (first, last) = (*levels.first()?, *levels.last()?);
    let span = last - first;
    let differences = || levels.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-9 * span);
    let step = differences().fold(f64::INFINITY, f64::min);
    let off = |difference: f64| {
        let steps = difference / step;
        (steps - steps.round()).abs()
    };
    let tolerance = OFF_LATTICE + 1e-9 * first.abs().max(span) / step;
    let found = step.is_finite()
        && (span / step <= MOST_LEVELS || readings >= VISITS * levels.len())
        && differences().all(|difference| off(difference) <= tolerance * 10.0);
    found.then_some(Lattice { step, levels: levels.len() })
}

/// The spikes of a sensor that a limit of its output explains, or that of another whose spikes look the same, and which of them it is.
fn at_a_limit(
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
fn few_clipped(recording: &Recording, sensor: usize, rows: &[usize], evidence: f64) -> Fault {
    let level = |&row: &usize| recording.sensors[sensor].values[row].abs();
    let limit = rows.iter().map(level).fold(f64::INFINITY, f64::min);
    let (first, last) =
        rows.iter().fold((usize::MAX, 0), |(first, last), &row| (first.min(row), last.max(row)));
    let parameters = vec![("limit", limit, true)];
    Fault { sensor, fault: ReadingFault::Saturated, evidence, rows: (first, last + 1), parameters }
}

/// The errors of a sensor by rows, as far as they would be its alone: of the residuals of a known input, or of what others read. `None` where
/// neither is known.
fn errors_of(block: &Block, sensor: usize) -> Option<Vec<f64>> {
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
fn mask_near_limits(recording: &Recording, model: &Model, clipped: &Fault, masked: &mut [bool]) {
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
fn at_limits(recording: &Recording, model: &Model, sensor: usize, spikes: &[usize]) -> Vec<usize> {
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

/// Readings of a block that stand off from their neighbours on both sides, with their rows.
///
/// Of sensors that are only compared with each other a spike may be any one's; an inertial velocity, which is an integral, has
/// none where there is another.
fn spikes(model: &Model, block: &Block, steps: &[f64], masked: &[Vec<bool>]) -> Vec<(Fault, Vec<usize>)> {
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
fn standoffs(values: &[f64], neighbours: usize, step: f64, floor: f64) -> (f64, Vec<f64>) {
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
fn sides(values: &[f64], place: usize, neighbours: usize) -> [&[f64]; 2] {
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
fn is_alone(values: &[f64], place: usize, neighbours: usize) -> bool {
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
fn most_evidence(standoffs: &mut [(usize, f64)], rows: usize) -> Option<(usize, f64)> {
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
    use super::{
        Fault, LEAST_COMPARED, LEAST_STANDOFF, NEIGHBOURS, Repeats, clipped, coarse, goes_beyond, lattice,
        most_evidence, same_at_rest, standoffs, stuck,
    };
    use crate::catalogue::ReadingFault;
    use rand::{RngExt, SeedableRng};
    use rand_distr::Distribution;
    use statrs::function::erf::erfc_inv;

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

    /// A gyro that is coarse at rest is so though it was turned fast for a few readings; the digits of a table are no lattice.
    #[test]
    fn a_coarse_output_may_have_been_far_away() {
        let step = 3.87e-6;
        let coarse = |k: usize| {
            let far = if k % 500 == 7 { 500_000.0 + k as f64 } else { 0.0 };
            step * (far + (k * 37 % 5) as f64)
        };
        let found = lattice(&(0..4000).map(coarse).collect::<Vec<f64>>()).unwrap();
        assert!((found.step / step - 1.0).abs() < 1e-6 && found.levels == 13, "{found:?}");
        let digits = |k: usize| 1e-6 * ((k as f64 * 0.618_034).fract() * 1e6).round();
        assert!(lattice(&(0..4000).map(digits).collect::<Vec<f64>>()).is_none());
    }

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

    /// Two levels lie on a lattice anyhow: what comes again and again is one, a step or a few glitches are none.
    #[test]
    fn two_levels_that_come_again_are_a_lattice() {
        let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0);
        let found = |is_up: &dyn Fn(usize) -> bool| {
            let values: Vec<f64> = (0..2000).map(|k| if is_up(k) { 3.0 } else { 0.0 }).collect();
            coarse(0, &values, lattice(&values).unwrap(), 0.0, 1.0).map(|fault| fault.parameters[0].1)
        };
        assert_eq!(found(&|k| jitter(k) > 0.97), Some(3.0));
        assert_eq!(found(&|k| k > 700), None);
        assert_eq!(found(&|k| k % 300 == 7), None);
    }

    /// Rounding to less than the noise matters where there are so many readings that its variance is seen.
    #[test]
    fn a_step_below_the_noise_matters_in_a_long_record() {
        let found = |rows: usize| {
            let values: Vec<f64> = (0..rows).map(|k| 0.8 * (k % 9) as f64).collect();
            coarse(0, &values, lattice(&values).unwrap(), 0.0, 1.0).is_some()
        };
        // 0.8²/12 of the variance: half of 0.053² a reading, halved again, is 10 nats from 14 600 readings on.
        assert!(!found(14_000));
        assert!(found(16_000));
    }

    /// A coarse output that stands still between manoeuvres repeats itself; one as fine as its noise does not.
    #[test]
    fn coarse_readings_at_rest_are_not_stuck() {
        let mut values: Vec<f64> = (0..2000).map(|k| f64::from((k * 7919) % 997)).collect();
        values[900..940].fill(3.0);
        let found = |step: f64, white: f64| {
            let repeats = Repeats { moves: true, at_rest: same_at_rest(step, white) };
            stuck(0, &values, repeats, &mut vec![false; values.len()]).is_some()
        };
        assert!(found(1.0, 5.0));
        assert!(!found(1.0, 0.28));
    }

    /// Where no readings are equal by chance a few that are show more than many where some are.
    #[test]
    fn a_short_run_is_stuck_where_no_others_are_equal() {
        let run = |equal: usize| {
            let mut values: Vec<f64> = (0..2000).map(|k| f64::from((k * 7919) % 1999)).collect();
            values.truncate(2000 - equal);
            values.extend(vec![0.5; equal]);
            let repeats = Repeats { moves: true, at_rest: 0.0 };
            stuck(0, &values, repeats, &mut vec![false; values.len()]).map(|fault| fault.rows)
        };
        assert_eq!(run(17), Some((1983, 2000)));
        assert_eq!(run(6), Some((1994, 2000)));
        assert_eq!(run(4), None);
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
