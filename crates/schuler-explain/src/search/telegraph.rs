//! A mean that jumps on and off (a random telegraph), which has a likelihood of its own over all rows.
use std::sync::Arc;

use rayon::prelude::*;
use schuler_recording::case::Markov;

use super::beside::Beside;
use super::moves::with_placed;
use crate::catalogue::{Candidate, NoiseChange, Port, Target};
use crate::description::Term;
use crate::evidence::fit::{Bench, Description, Placed};
use crate::evidence::regressor::regressors;
use crate::evidence::system::System;
use crate::exact::OverRows;
use crate::exact::decoder::Decoded;
use crate::exact::telegraph::{Place, best_of_blocks, history};
use crate::noise::Knob;
use crate::noise::fit::{Observed, SourceKnob};
use crate::noise::parts::{Fitting, starts};

/// Gain of a further Markov part from which on jumps are sought.
const WORTH_TRYING: f64 = 3.0;

/// The descriptions that have a telegraph in one of some blocks beside what is described, fitted.
pub fn with_telegraph(bench: &Bench<'_>, description: &Description, among: &[usize]) -> Vec<Description> {
    let places: Vec<Place> = (bench.problem.candidates.par_iter().enumerate())
        .filter(|(index, candidate)| candidate.is_jump() && !description.has(*index))
        .filter_map(|(index, candidate)| place(bench, description, among, index, candidate))
        .collect();
    let places = best_of_blocks(places);
    if places.is_empty() {
        return Vec::new();
    }
    let rows = OverRows::new(bench, description);
    places.par_iter().filter_map(|place| described(&rows, place)).collect()
}

/// The place of a candidate, if jumps may be there.
fn place(
    bench: &Bench<'_>,
    description: &Description,
    among: &[usize],
    index: usize,
    candidate: &Candidate,
) -> Option<Place> {
    let Target::Sensor(sensor) = candidate.target else { return None };
    let model = bench.problem.model;
    let block = model.block_of(sensor).filter(|block| among.contains(block))?;
    let source = model.source_of(sensor, Port::Output)?;
    let (part, gain) = further_markov(bench, description, block, source)?;
    // One that is gone before the next row is white noise.
    let stays = part.tau_s >= model.step_s;
    (gain >= WORTH_TRYING && stays).then_some(Place { candidate: index, sensor, block, part, gain })
}

/// The description with the likeliest history.
fn described(rows: &OverRows<'_>, place: &Place) -> Option<Description> {
    let (bench, description) = (rows.bench, rows.description);
    let beside = Beside::as_trusted(bench, description)?;
    let described = beside.described();
    let whitened = |term: &Term| regressors(bench.problem.model, &bench.sums, &term.columns, term.port);
    let amplitude_of = |history: &Decoded| {
        Some(beside.normal(&described, &whitened(&place.term(&history.on)))?.amplitudes()?[0])
    };
    let best = history(rows, place, &amplitude_of)?;
    // A history that is given gains more than all histories together; it costs the difference under whatever noise.
    let [of_history, as_loud] = best.gains_of_history(rows, place)?;
    let ln_spread =
        (best.gain - of_history).min(0.0) + (as_loud - of_history).min(0.0) + ln_cost_of_rates(bench, &best);
    let term = place.term(&best.on);
    let regressors = Arc::new(whitened(&term));
    let placed = Placed::new(term, regressors, ln_spread);
    with_placed(bench, description, &placed)
}

/// What the rates cost: each is known to a part 1/√n by its switchings, and before them it may be anything from once in the record to
/// once a row.
fn ln_cost_of_rates(bench: &Bench<'_>, history: &Decoded) -> f64 {
    let range = (bench.problem.model.rows as f64).ln();
    let of = |number: usize| {
        let known = (2.0 * std::f64::consts::PI / (number as f64).max(1.0)).sqrt();
        (known / range).ln().min(0.0)
    };
    history.switchings().into_iter().map(of).sum()
}

/// The Markov part that fits best beside the noise of a source, and what it gains.
fn further_markov(
    bench: &Bench<'_>,
    description: &Description,
    index: usize,
    source: usize,
) -> Option<(Markov, f64)> {
    let sums = bench.sums[index].as_ref()?;
    let block = &bench.problem.model.blocks[index];
    let system = System { sums: &bench.sums, weights: &description.weights };
    let power = system.power_left(index, &description.described(bench), &description.amplitudes);
    let nu = description.blocks[index].as_ref()?.nu;
    let noise_level_range = bench.problem.config.noise_level_range;
    let observed = Observed { block, sums, power: &power, nu, noise_level_range };
    let here = observed.log_likelihood(&description.noises);
    let duration_s = sums.rows() as f64 * block.step_s();
    let noise = &description.noises[source];
    let part = noise.markov.len();
    let is_new = |knobs: &[Knob]| knobs.contains(&Knob::MarkovSigma(part));
    let fitting = Fitting { spread: observed.spread(), step_s: block.step_s(), duration_s, resolved: &[] };
    let fitted = starts(noise, NoiseChange::Markov, fitting)
        .into_iter()
        .filter(|start| is_new(&start.knobs))
        .filter_map(|start| {
            let free: Vec<SourceKnob> = start.knobs.iter().map(|&knob| (source, knob)).collect();
            let mut noises = description.noises.clone();
            noises[source] = start.noise;
            observed.fit(&noises, &free, 0.1)
        });
    let best = fitted.max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))?;
    Some((*best.noises[source].markov.get(part)?, best.log_likelihood - here))
}
