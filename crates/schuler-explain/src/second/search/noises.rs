//! Other noises that would add to a description.
use std::sync::Arc;

use rayon::prelude::*;

use super::known::Known;
use crate::catalogue::{NoiseChange, Search};
use crate::description::sensors_of;
use crate::noise::{Knob, Noise};
use crate::second::evidence::fit::{Bench, Change, Description};
use crate::second::evidence::system::System;
use crate::second::noise::fit::{Observed, SourceKnob};
use crate::second::noise::parts::{Start, starts};

/// Starts of a change of noise, those that fit best, from which it is fitted.
const STARTS: usize = 2;
/// Tolerance of such a fit, nats.
const TOLERANCE: f64 = 0.1;

/// A change of the noise of a block.
#[derive(Clone)]
pub struct Promised {
    /// What it gains, prior odds and cost of its parameters included, nats.
    pub ln_gain: f64,
    /// The change.
    pub change: Change,
    /// The noises with it.
    pub noises: Vec<Noise>,
    /// The block.
    pub block: usize,
}

/// A candidate for another noise, and the source that it is of.
#[derive(Clone, Copy)]
struct Other {
    candidate: usize,
    source: usize,
    change: NoiseChange,
}

/// The changes of noise that promise most in some of the blocks.
pub fn other_noises(
    bench: &Bench<'_>,
    known: &Known,
    description: &Description,
    among: &[usize],
) -> Vec<Promised> {
    let problem = bench.problem;
    let other = |(candidate, of): (usize, &crate::catalogue::Candidate)| match of.search {
        Search::Noise(change) => {
            let sensor = sensors_of(of).first().copied()?;
            Some(Other { candidate, source: problem.model.source_of(sensor, of.port)?, change })
        }
        _ => None,
    };
    let others: Vec<Other> = problem.candidates.iter().enumerate().filter_map(other).collect();
    let of_block = |&block: &usize| {
        let compute = || Arc::new(of_block(bench, description, &others, block));
        let promised = known.noises(bench, description, block, compute);
        // The noises of other blocks are those of the description.
        let sources = &problem.model.blocks[block].sources;
        let moved = |promised: &Promised| {
            let mut noises = description.noises.clone();
            for &source in sources {
                noises[source].clone_from(&promised.noises[source]);
            }
            Promised { noises, ..promised.clone() }
        };
        promised.iter().map(moved).collect::<Vec<_>>()
    };
    among.par_iter().flat_map_iter(of_block).collect()
}

fn of_block(bench: &Bench<'_>, description: &Description, others: &[Other], index: usize) -> Vec<Promised> {
    let problem = bench.problem;
    let (Some(sums), Some(fit)) = (&bench.sums[index], &description.blocks[index]) else {
        return Vec::new();
    };
    let block = &problem.model.blocks[index];
    let system = System { sums: &bench.sums, weights: &description.weights };
    let power = system.power_left(index, &description.described(bench), &description.amplitudes);
    let noise_level_range = problem.config.noise_level_range;
    let observed = Observed { block, sums, power: &power, nu: fit.nu, noise_level_range };
    let here = observed.log_likelihood(&description.noises) + fit.occam;
    let of_sources = others.iter().filter(|other| block.sources.contains(&other.source));
    let mut promised: Vec<Promised> = of_sources
        .filter_map(|other| best_of(bench, description, &observed, *other))
        .map(|promised| Promised { ln_gain: promised.ln_gain - here, ..promised })
        .filter(|promised| {
            let prior = problem.ln_prior[promised.change.candidate];
            promised.ln_gain - prior > problem.config.least_promised
        })
        .collect();
    promised.sort_by(|a, b| b.ln_gain.total_cmp(&a.ln_gain));
    promised.truncate(problem.config.fitted_moves);
    promised
}

/// A change at its best, what else is free of the block at its best beside it.
fn best_of(
    bench: &Bench<'_>,
    description: &Description,
    observed: &Observed<'_>,
    other: Other,
) -> Option<Promised> {
    let problem = bench.problem;
    let Other { candidate, source, change } = other;
    let (block, rows) = (observed.block, observed.sums.rows());
    let index = problem.model.block_of_source(source)?;
    let known = description.free_in(problem, index);
    let duration_s = rows as f64 * block.step_s();
    let of_start = |start: Start| {
        let free: Vec<SourceKnob> = start.knobs.iter().map(|&knob| (source, knob)).collect();
        let mut noises = description.noises.clone();
        noises[source] = start.noise;
        let is_new = !free.iter().all(|knob| known.contains(knob));
        is_new.then(|| (observed.log_likelihood(&noises), start.knobs, noises))
    };
    let starts = starts(&description.noises[source], change, observed.spread(), block.step_s(), duration_s);
    let mut starts: Vec<(f64, Vec<Knob>, Vec<Noise>)> = starts.into_iter().filter_map(of_start).collect();
    starts.sort_by(|a, b| b.0.total_cmp(&a.0));
    starts.truncate(STARTS);
    let fitted = starts.into_iter().filter_map(|(_, knobs, noises)| {
        let new = knobs.iter().map(|&knob| (source, knob)).filter(|knob| !known.contains(knob));
        let free: Vec<SourceKnob> = known.iter().copied().chain(new).collect();
        let fitted = observed.fit(&noises, &free, TOLERANCE)?;
        let ln_gain = fitted.log_likelihood + fitted.ln_cost + problem.ln_prior[candidate];
        let change = Change { candidate, source, change, knobs, ln_cost: 0.0 };
        Some(Promised { ln_gain, change, noises: fitted.noises, block: index })
    });
    fitted.max_by(|a, b| a.ln_gain.total_cmp(&b.ln_gain))
}
