//! Faults that readings show without a model of the sensor: stuck, clipped, coarse, spiked.
//!
//! They are sought before anything else, and the readings that they spoil are missing from then on: a single spike
//! would breed findings of every kind. Evidence is −ln of a probability on the safe side:
//! - stuck: runs of L equal readings or more, where neighbours are equal with the probability p outside of them: N pᴸ;
//! - clipped: more readings at the extreme value than at the next, which in a tail are fewer: binomial with ½; or more
//!   that are equal than coincide elsewhere;
//! - coarse: all readings on a lattice coarser than nominal, and than the noise or than so many readings let pass unseen;
//! - spikes: n readings that stand off from their neighbours on both sides more than the next does: n P(χ²₂ₙ > 2 Σ (xᵢ − x₍ₙ₊₁₎)),
//!   x = −ln 2Φ(−u), at the n that shows most. u is the distance from the median of the neighbours, as many of them as make it
//!   spread least: few where the output wanders, many where its noise is white.
mod lattice;
mod limits;
mod spikes;
mod stuck;

use nalgebra::DVector;
use rayon::prelude::*;
use schuler_recording::Recording;
use schuler_recording::recording::SensorSeries;

use self::lattice::coarse;
pub use self::lattice::{LEAST_STEP, OFF_LATTICE, lattice};
pub use self::limits::FEWEST_PILED;
use self::limits::{LEAST_BESIDE_INPUT, at_a_limit, clipped, few_clipped, goes_beyond, mask_near_limits};
use self::spikes::{jumps, spikes, take_single_stays_off};
use self::stuck::{Repeats, same_at_rest, stuck};
use crate::catalogue::{Candidate, ReadingFault};
use crate::description::{Term, blocks_of, remainder};
use crate::noise::Noise;
use crate::nominal::{Block, Model};

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
        described: (&[Term], &[Noise]),
        amplitudes: &DVector<f64>,
    ) {
        let (terms, noises) = described;
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
