//! The descriptions that are one item away from another.
use rayon::prelude::*;

use super::beside::Beside;
use super::library::{Offer, Shelf, offers, placed};
use super::scans::scans;
use crate::catalogue::{NoiseChange, Search};
use crate::description::sensors_of;
use crate::noise::{Knob, Noise};
use crate::second::evidence::fit::{Bench, Change, Description, Placed};
use crate::second::evidence::system::System;
use crate::second::noise::fit::{Observed, occam};
use crate::second::noise::parts::{Start, starts};

/// Starts of a change of noise, those that fit best, from which it is fitted.
const STARTS: usize = 2;

/// An item of a description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// The deterministic effect at a place.
    Placed(usize),
    /// The change of noise at a place.
    Change(usize),
}

/// The items of a description.
pub fn items(description: &Description) -> Vec<Item> {
    let placed = (0..description.placed.len()).map(Item::Placed);
    placed.chain((0..description.changes.len()).map(Item::Change)).collect()
}

/// A description without an item, fitted.
pub fn without(bench: &Bench<'_>, description: &Description, item: Item) -> Option<Description> {
    let mut less = description.clone();
    let touched = match item {
        Item::Placed(place) => touched_by(&less.placed.remove(place)),
        Item::Change(place) => {
            let change = less.changes.remove(place);
            // The record is whitened by a level, so that it stays.
            if change.is_level() {
                return None;
            }
            take_back(bench, &mut less, &change);
            bench.problem.model.block_of_source(change.source).into_iter().collect()
        }
    };
    bench.fitted(&less, &touched)
}

/// Takes the parts of a change out of the noises; what the case states comes back.
pub fn take_back(bench: &Bench<'_>, description: &mut Description, change: &Change) {
    let source = &bench.problem.model.sources[change.source];
    let mut noise = source.nominal.clone();
    let stays = description.changes.iter().filter(|other| other.source == change.source);
    let nuisances = description.nuisances.iter().filter(|(source, _)| *source == change.source);
    let current = description.noises[change.source].clone();
    let kept: Vec<Knob> = (stays.flat_map(|other| other.knobs.iter().copied()))
        .chain(nuisances.map(|(_, knob)| *knob))
        .collect();
    // Parts stand in the order in which they came, so that those behind one that goes move up.
    let (mut markov, mut cosine) = (Vec::new(), Vec::new());
    for &knob in &kept {
        match knob {
            Knob::MarkovSigma(part) if part >= noise.markov.len() => markov.push(part),
            Knob::CosineSigma(part) if part >= noise.exp_cos.len() => cosine.push(part),
            Knob::MarkovSigma(_)
            | Knob::MarkovTau(_)
            | Knob::CosineSigma(_)
            | Knob::CosineAlpha(_)
            | Knob::CosineBeta(_) => {}
            _ => noise.adopt(&current, &[knob]),
        }
    }
    for &knob in &kept {
        if noise.has_shape(knob) && noise.get(knob) > 0.0 && current.get(knob) > 0.0 {
            noise.set(knob, current.get(knob));
        }
    }
    let (own_markov, own_cosine) = (noise.markov.len(), noise.exp_cos.len());
    noise.markov.extend(markov.iter().filter_map(|&part| current.markov.get(part).copied()));
    noise.exp_cos.extend(cosine.iter().filter_map(|&part| current.exp_cos.get(part).copied()));
    let moved = |knob: Knob| {
        let at = |parts: &[usize], own: usize, part: usize| {
            parts.iter().position(|&it| it == part).map_or(part, |place| own + place)
        };
        match knob {
            Knob::MarkovSigma(part) => Knob::MarkovSigma(at(&markov, own_markov, part)),
            Knob::MarkovTau(part) => Knob::MarkovTau(at(&markov, own_markov, part)),
            Knob::CosineSigma(part) => Knob::CosineSigma(at(&cosine, own_cosine, part)),
            Knob::CosineAlpha(part) => Knob::CosineAlpha(at(&cosine, own_cosine, part)),
            Knob::CosineBeta(part) => Knob::CosineBeta(at(&cosine, own_cosine, part)),
            other => other,
        }
    };
    for other in description.changes.iter_mut().filter(|other| other.source == change.source) {
        other.knobs = other.knobs.iter().map(|&knob| moved(knob)).collect();
    }
    for (source, knob) in &mut description.nuisances {
        if *source == change.source {
            *knob = moved(*knob);
        }
    }
    description.noises[change.source] = noise;
}

fn touched_by(placed: &Placed) -> Vec<usize> {
    let mut blocks: Vec<usize> =
        placed.regressors.iter().flat_map(|it| &it.parts).map(|part| part.block).collect();
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}

/// The best of the descriptions that have one item more, fitted.
pub fn with_one_more(bench: &Bench<'_>, library: &[Shelf], description: &Description) -> Vec<Description> {
    let config = bench.problem.config;
    let is_grid =
        |offer: &Offer| matches!(bench.problem.candidates[offer.candidate].search, Search::Grid { .. });
    let best = |mut offers: Vec<Offer>| {
        let least = config.least_promised;
        offers.retain(|offer| offer.ln_gain - bench.problem.ln_prior[offer.candidate] > least);
        offers.sort_by(|a, b| b.ln_gain.total_cmp(&a.ln_gain).then(a.candidate.cmp(&b.candidate)));
        offers.truncate(config.fitted_moves);
        offers
    };
    let is_robust = description.blocks.iter().flatten().any(|fit| fit.nu.is_finite());
    let mut ways = vec![Beside::trusting(bench, description)];
    if is_robust {
        ways.push(Beside::as_trusted(bench, description));
    }
    let mut effects: Vec<(usize, Placed)> = Vec::new();
    for beside in ways.iter().flatten() {
        // A grid may miss the best by much, so that its offers are compared with each other.
        let (grids, linear): (Vec<Offer>, Vec<Offer>) =
            offers(beside, library).into_iter().partition(is_grid);
        let chosen: Vec<Offer> = [best(linear), best(grids), best(scans(beside))].concat();
        let more: Vec<(usize, Placed)> =
            chosen.par_iter().map(|offer| (offer.candidate, placed(beside, offer))).collect();
        for (candidate, placed) in more {
            let is_known = effects
                .iter()
                .any(|(known, other)| *known == candidate && other.term.nonlinear == placed.term.nonlinear);
            if !is_known {
                effects.push((candidate, placed));
            }
        }
    }
    let with_effect = |(_, placed): &(usize, Placed)| {
        let mut more = description.clone();
        let touched = touched_by(placed);
        more.placed.push(placed.clone());
        bench.fitted(&more, &touched)
    };
    let mut all: Vec<Description> = effects.par_iter().filter_map(with_effect).collect();
    all.extend(with_other_noise(bench, description));
    all
}

/// The best of the descriptions with another noise, fitted.
fn with_other_noise(bench: &Bench<'_>, description: &Description) -> Vec<Description> {
    let problem = bench.problem;
    let searched = |(number, candidate): (usize, &crate::catalogue::Candidate)| match candidate.search {
        Search::Noise(change) => {
            let sensor = sensors_of(candidate).first().copied()?;
            Some((number, problem.model.source_of(sensor, candidate.port)?, change))
        }
        _ => None,
    };
    let changes: Vec<(usize, usize, NoiseChange)> =
        problem.candidates.iter().enumerate().filter_map(searched).collect();
    let mut blocks: Vec<usize> =
        changes.iter().filter_map(|&(_, source, _)| problem.model.block_of_source(source)).collect();
    blocks.dedup();
    let of_block = |&index: &usize| -> Vec<(f64, Change, Vec<Noise>, usize)> {
        let (Some(sums), Some(fit)) = (&bench.sums[index], &description.blocks[index]) else {
            return Vec::new();
        };
        let block = &problem.model.blocks[index];
        let system = System { sums: &bench.sums, weights: &description.weights };
        let power = system.power_left(index, &description.described(bench), &description.amplitudes);
        let observed = Observed { block, sums, power: &power, nu: fit.nu };
        let duration_s = sums.rows() as f64 * block.step_s();
        let mut promised = Vec::new();
        for &(candidate, source, change) in changes.iter().filter(|change| block.sources.contains(&change.1))
        {
            let spread = observed.spread();
            let known = description.free_in(problem, index);
            let of_start = |start: Start| {
                let free: Vec<(usize, Knob)> = start.knobs.iter().map(|&knob| (source, knob)).collect();
                let mut noises = description.noises.clone();
                noises[source] = start.noise;
                let is_new = !free.iter().all(|knob| known.contains(knob));
                is_new.then(|| (observed.log_likelihood(&noises), start.knobs, free, noises))
            };
            let mut starts: Vec<_> =
                (starts(&description.noises[source], change, spread, block.step_s(), duration_s).into_iter())
                    .filter_map(of_start)
                    .collect();
            starts.sort_by(|a, b| b.0.total_cmp(&a.0));
            starts.truncate(STARTS);
            let fitted = starts.into_iter().filter_map(|(_, knobs, free, noises)| {
                let fitted = observed.fit(&noises, &free, 0.1)?;
                let cost = occam(&fitted.sigmas, &free, block, sums.rows(), problem.config);
                let gain = fitted.log_likelihood + cost + problem.ln_prior[candidate];
                Some((gain, Change { candidate, source, change, knobs, ln_cost: 0.0 }, fitted.noises, index))
            });
            promised.extend(fitted.max_by(|a, b| a.0.total_cmp(&b.0)));
        }
        let here = observed.log_likelihood(&description.noises);
        let promises = |(gain, change, ..): &(f64, Change, Vec<Noise>, usize)| {
            gain - here - problem.ln_prior[change.candidate] > problem.config.least_promised
        };
        promised.retain(promises);
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.truncate(problem.config.fitted_moves);
        promised
    };
    let promised: Vec<_> = blocks.par_iter().flat_map_iter(of_block).collect();
    let fitted = |(_, change, noises, index): &(f64, Change, Vec<Noise>, usize)| {
        let mut more = description.clone();
        more.noises.clone_from(noises);
        more.changes.push(change.clone());
        bench.fitted(&more, &[*index])
    };
    promised.par_iter().filter_map(fitted).collect()
}

/// What makes descriptions the same but for the values of their parameters.
pub fn structure(description: &Description) -> Vec<(usize, Vec<String>)> {
    let placed = description.placed.iter().map(|placed| (placed.term.candidate, Vec::new()));
    let changes = description
        .changes
        .iter()
        .map(|change| (change.candidate, change.knobs.iter().map(|knob| format!("{knob:?}")).collect()));
    let mut all: Vec<(usize, Vec<String>)> = placed.chain(changes).collect();
    all.sort();
    all
}

/// A description with nothing in it but the constants, fitted.
pub fn nothing(bench: &Bench<'_>, noises: &[Noise], nuisances: &[(usize, Knob)]) -> Option<Description> {
    let blocks = bench.sums.len();
    let description = Description {
        placed: Vec::new(),
        changes: Vec::new(),
        noises: noises.to_vec(),
        nuisances: nuisances.to_vec(),
        blocks: vec![None; blocks],
        weights: vec![None; blocks],
        amplitudes: nalgebra::DVector::zeros(0),
        ln_evidence: f64::NEG_INFINITY,
    };
    bench.fitted_whole(&description)
}
