//! Other noises that would add to a description.
use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::known::Known;
use crate::catalogue::{NoiseChange, Port, Search};
use crate::description::sensors_of;
use crate::evidence::fit::{Bench, Change, Description};
use crate::evidence::system::System;
use crate::noise::fit::{Observed, SourceKnob};
use crate::noise::parts::{Fitting, Start, starts};
use crate::noise::{Knob, Noise};
use crate::problem::Problem;

/// Starts of a change of noise, those of each of its parameters that fit best, from which it is fitted.
const STARTS: usize = 2;
/// Parts of the spread of the output from which a noise inside a loop is started, decades.
const DECADES_INSIDE: &[i32] = &[-6, -4, -2, 0];
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

/// The changes of noise that promise most in some of the blocks, of those that gain at least so much, nats.
pub fn other_noises(
    bench: &Bench<'_>,
    known: &Known,
    description: &Description,
    among: &[usize],
    least_gain: f64,
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
        let compute = || Arc::new(of_block(bench, description, &others, block, least_gain));
        let promised = known.noises(bench, description, block, least_gain, compute);
        // The noises of other blocks are those of the description.
        let sources = &problem.model.blocks[block].sources;
        let moved = |promised: &Promised| {
            let mut noises = description.noises.clone();
            for &source in sources {
                noises[source].clone_from(&promised.noises[source]);
            }
            Promised { noises, ..promised.clone() }
        };
        promised.iter().filter(|promised| promised.ln_gain > least_gain).map(moved).collect::<Vec<_>>()
    };
    among.par_iter().flat_map_iter(of_block).collect()
}

fn of_block(
    bench: &Bench<'_>,
    description: &Description,
    others: &[Other],
    index: usize,
    least_gain: f64,
) -> Vec<Promised> {
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
    let Some(largest) = observed.largest_gains(&description.noises) else { return Vec::new() };
    let may_gain = |other: &&Other| {
        let place = block.sources.iter().position(|&source| source == other.source);
        place.is_some_and(|place| largest[place] + problem.ln_prior[other.candidate] > least_gain)
    };
    let of_sources = others.iter().filter(may_gain);
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
    // How much of the output noise inside a loop makes depends on the loop.
    let is_inside = problem.model.sources[source].port != Port::Output;
    let decades = if is_inside { DECADES_INSIDE } else { &[0] };
    let from = |noises: &[Noise], most: usize| -> Vec<(Vec<Knob>, Vec<Noise>)> {
        let with_start = |start: Start| {
            let is_new = start.knobs.iter().any(|&knob| !known.contains(&(source, knob)));
            let mut noises = noises.to_vec();
            noises[source] = start.noise;
            is_new.then(|| (observed.log_likelihood(&noises), start.knobs, noises))
        };
        let at = |&decade: &i32| {
            let spread = observed.spread() * 10.0_f64.powi(decade);

            let resolved = &bench.resolved[index];
            let fitting = Fitting { spread, step_s: block.step_s(), duration_s, resolved };
            starts(&noises[source], change, fitting)
        };
        let mut all: Vec<_> = decades.iter().flat_map(at).filter_map(with_start).collect();
        all.sort_by(|a: &(f64, _, _), b: &(f64, _, _)| b.0.total_cmp(&a.0));
        let mut taken: HashMap<Vec<Knob>, usize> = HashMap::new();
        all.retain(|(_, knobs, _)| {
            let number = taken.entry(knobs.clone()).or_default();
            *number += 1;
            *number <= most
        });
        all.into_iter().map(|(_, knobs, noises)| (knobs, noises)).collect()
    };
    let mut starts = from(&description.noises, STARTS);
    // What one noise has taken of another does not come back step by step.
    let stated = as_stated(problem, &known, &description.noises);
    if stated != description.noises {
        starts.extend(from(&stated, 1));
    }
    let fitted = starts.into_iter().filter_map(|(knobs, noises)| {
        let new = knobs.iter().map(|&knob| (source, knob)).filter(|knob| !known.contains(knob));
        let free: Vec<SourceKnob> = known.iter().copied().chain(new).collect();
        let fitted = observed.fit(&noises, &free, TOLERANCE)?;
        let ln_gain = fitted.log_likelihood + fitted.ln_cost + problem.ln_prior[candidate];
        let change = Change { candidate, source, kind: change, knobs, ln_cost: 0.0 };
        Some(Promised { ln_gain, change, noises: fitted.noises, block: index })
    });
    fitted.max_by(|a, b| a.ln_gain.total_cmp(&b.ln_gain))
}

/// Noises whose free parameters are what the case states, as far as it states them.
fn as_stated(problem: &Problem<'_>, free: &[SourceKnob], noises: &[Noise]) -> Vec<Noise> {
    let mut stated = noises.to_vec();
    for &(source, knob) in free {
        let nominal = &problem.model.sources[source].nominal;
        if nominal.has_shape(knob) && nominal.get(knob) > 0.0 {
            stated[source].set(knob, nominal.get(knob));
        }
    }
    stated
}
