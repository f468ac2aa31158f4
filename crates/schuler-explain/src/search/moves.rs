//! The descriptions that are one item away from another.
use std::sync::Arc;

use rayon::prelude::*;

use super::beside::Beside;
use super::known::{Known, Move};
use super::library::{Offer, Shelf, offers, placed, undescribed};
use super::noises::{Promised, other_noises};
use super::pairs::with_pairs;
use super::scans::scans;
use crate::catalogue::Search;
use crate::description::Term;
use crate::evidence::fit::{Bench, Change, Description, Placed};
use crate::evidence::late::late_columns;
use crate::evidence::regressor::regressors;
use crate::noise::{Knob, Noise};

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

/// The candidate that an item is of, by its place among all.
pub fn candidate_of(description: &Description, item: Item) -> usize {
    match item {
        Item::Placed(place) => description.placed[place].term.candidate,
        Item::Change(place) => description.changes[place].candidate,
    }
}

/// The blocks that an item reaches.
pub fn reached_by(bench: &Bench<'_>, description: &Description, item: Item) -> Vec<usize> {
    match item {
        Item::Placed(place) => touched_by(&description.placed[place]),
        Item::Change(place) => {
            let source = description.changes[place].source;
            bench.problem.model.block_of_source(source).into_iter().collect()
        }
    }
}

/// A description without an item, fitted.
pub fn without(bench: &Bench<'_>, description: &Description, item: Item) -> Option<Description> {
    without_several(bench, description, &[item])
}

/// A description without some of its items, fitted.
pub fn without_several(
    bench: &Bench<'_>,
    description: &Description,
    several: &[Item],
) -> Option<Description> {
    let mut touched: Vec<usize> =
        several.iter().flat_map(|&item| reached_by(bench, description, item)).collect();
    touched.sort_unstable();
    touched.dedup();
    let stays = |item: Item| !several.contains(&item);
    let mut less = description.clone();
    less.placed = (description.placed.iter().enumerate())
        .filter(|&(place, _)| stays(Item::Placed(place)))
        .map(|(_, placed)| placed.clone())
        .collect();
    // Before the changes are taken back, which leaves the noise as it is stated beside the effects that stay.
    for (place, placed) in description.placed.iter().enumerate() {
        if !stays(Item::Placed(place)) {
            scale_noises(bench, &mut less, placed, placed.noise_factor.recip());
        }
    }
    for place in (0..description.changes.len()).rev().filter(|&place| !stays(Item::Change(place))) {
        let change = less.changes.remove(place);
        // The record is whitened by a level, so that it stays.
        if change.is_level() {
            return None;
        }
        take_back(bench, &mut less, &change);
    }
    // What was described a part of an effect's signature leaves it to that when it goes.
    let whole = with_whole_signatures(bench, &less).and_then(|whole| bench.fitted(&whole, &touched));
    let fitted = [bench.fitted(&less, &touched), whole].into_iter().flatten();
    fitted.max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence))
}

/// A description whose effects have all columns of their signatures that nothing else describes; none where they have them.
fn with_whole_signatures(bench: &Bench<'_>, description: &Description) -> Option<Description> {
    let lacking = |placed: &Placed| placed.regressors.iter().filter(|it| it.parts.is_empty()).count();
    let mut whole = description.clone();
    for index in 0..whole.placed.len() {
        let lacks = lacking(&whole.placed[index]);
        if lacks == 0 {
            continue;
        }
        let mut rest = whole.clone();
        let mut placed = rest.placed.remove(index);
        let columns = late_columns(bench.problem.model, &placed.delays, &placed.term);
        let whitened = regressors(bench.problem.model, &bench.sums, &columns, placed.term.port);
        let undescribed = Beside::trusting(bench, &rest).and_then(|beside| undescribed(&beside, whitened));
        placed.regressors = Arc::new(undescribed?);
        if lacking(&placed) < lacks {
            whole.placed[index] = placed;
        }
    }
    let before: usize = description.placed.iter().map(lacking).sum();
    (whole.placed.iter().map(lacking).sum::<usize>() < before).then_some(whole)
}

/// Takes the parts of a change out of the noises; what the case states comes back.
pub fn take_back(bench: &Bench<'_>, description: &mut Description, change: &Change) {
    let mut noise = description.stated(bench.problem, change.source);
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

/// The blocks that an effect reaches.
pub fn touched_by(placed: &Placed) -> Vec<usize> {
    let mut blocks: Vec<usize> =
        placed.regressors.iter().flat_map(|it| &it.parts).map(|part| part.block).collect();
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}

/// A description to which an item is added.
pub struct Base {
    /// The description.
    pub description: Description,
    /// What it lacks of the one that it was made of: what is added is to be something else.
    pub lacks: Vec<Term>,
}

impl Base {
    /// Whether what is offered is what it lacks: the same candidate, a jump or a line at the same place.
    fn lacks(&self, bench: &Bench<'_>, offer: &Offer) -> bool {
        let problem = bench.problem;
        let width = match problem.candidates[offer.candidate].search {
            Search::Onset(_) => problem.config.least_segment as f64 * problem.model.step_s,
            Search::Frequency => problem.inputs.duration_s().recip(),
            _ => f64::INFINITY,
        };
        let is_it = |lacked: &Term| {
            let mut pairs = lacked.nonlinear.iter().zip(&offer.point);
            lacked.candidate == offer.candidate && pairs.all(|(a, b)| (a - b).abs() <= width)
        };
        self.lacks.iter().any(is_it)
    }
}

/// The best of the descriptions that have one item more than some others in some of the blocks, fitted; `best` is the evidence of the best that
/// is known.
pub fn with_one_more(
    bench: &Bench<'_>,
    library: &[Shelf],
    known: &Known,
    bases: &[Base],
    among: &[usize],
    best: f64,
) -> Vec<Description> {
    let promises = bases.iter().map(|base| {
        // Where the noise is trusted little a large misfit counts little, even one that an effect would take away: both ways are tried.
        let is_robust = base.description.blocks.iter().flatten().any(|fit| fit.nu.is_finite());
        let as_trusted = is_robust.then(|| Beside::as_trusted(bench, &base.description)).flatten();
        let ways = Beside::trusting(bench, &base.description).into_iter().chain(as_trusted).collect();
        Promises { base, ways, library, known, among, behind: best - base.description.ln_evidence }
    });
    let promises: Vec<Promises<'_>> = promises.collect();
    let effects = effects(bench, &promises).into_iter().map(|(base, placed)| Move {
        description: &base.description,
        blocks: touched_by(&placed),
        candidate: placed.term.candidate,
        added: placed,
    });
    let mut all = known.fitted(bench, effects.collect(), |it| with_placed(bench, it.description, &it.added));
    all.extend(promises.iter().flat_map(with_pairs));
    let noises = promises.iter().flat_map(|promises| {
        let least_gain = promises.behind - bench.problem.config.within_reach;
        let promised = other_noises(bench, known, &promises.base.description, among, least_gain);
        let base = promises.base;
        promised.into_iter().map(move |it| (it.ln_gain - promises.behind, (base, it)))
    });
    let promised = most_promising(bench, noises.collect()).into_iter().map(|(base, promised)| Move {
        description: &base.description,
        blocks: vec![promised.block],
        candidate: promised.change.candidate,
        added: promised,
    });
    all.extend(known.fitted(bench, promised.collect(), |it: &Move<'_, Promised>| {
        let mut more = it.description.clone();
        more.noises.clone_from(&it.added.noises);
        more.changes.push(it.added.change.clone());
        bench.fitted(&more, &it.blocks)
    }));
    all
}

/// Where effects that would improve a description are sought.
pub struct Promises<'p> {
    /// The description.
    pub base: &'p Base,
    /// The description under full trust in its noise, and under its own trust where that is another.
    pub ways: Vec<Beside<'p>>,
    /// All signatures of fixed shape.
    pub library: &'p [Shelf],
    /// What was computed before.
    pub known: &'p Known,
    /// The blocks that effects have to reach.
    pub among: &'p [usize],
    /// What the description is behind the best that is known, nats.
    pub behind: f64,
}

/// The first of some by what they promise beside the best that is known.
fn most_promising<T>(bench: &Bench<'_>, mut all: Vec<(f64, T)>) -> Vec<T> {
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.truncate(bench.problem.config.fitted_moves);
    all.into_iter().map(|(_, it)| it).collect()
}

/// The effects that promise most, each with the description that it is added to.
fn effects<'p>(bench: &Bench<'_>, promises: &'p [Promises<'p>]) -> Vec<(&'p Base, Placed)> {
    let (problem, config) = (bench.problem, bench.problem.config);
    let is_grid = |offer: &Offer| matches!(problem.candidates[offer.candidate].search, Search::Grid { .. });
    let mut effects: Vec<(&Base, Placed)> = Vec::new();
    for way in 0..2 {
        let sought = |it: &'p Promises<'p>| {
            let Some(beside) = it.ways.get(way) else { return Vec::new() };
            let is_promising = |offer: &Offer| {
                offer.ln_gain - problem.ln_prior[offer.candidate] > config.least_promised
                    && offer.ln_gain > it.behind - config.within_reach
                    && !it.base.lacks(bench, offer)
            };
            let all = offers(beside, it.library, it.among).into_iter().chain(scans(beside, it.among));
            let of = |offer: Offer| (offer.ln_gain - it.behind, (it, beside, offer));
            all.filter(is_promising).map(of).collect::<Vec<_>>()
        };
        let all: Vec<_> = promises.iter().flat_map(sought).collect();
        // A grid may miss the best by much, so that its offers are compared with each other.
        let kind = |offer: &Offer| (is_grid(offer), problem.candidates[offer.candidate].search.is_scanned());
        for of in [(false, false), (true, false), (false, true)] {
            let own = all.iter().filter(|(_, (_, _, offer))| kind(offer) == of).cloned().collect();
            let mut chosen = most_promising(bench, own);
            chosen.retain(|(it, beside, offer)| {
                !it.known.is_hopeless(bench, beside.description, &offer.blocks, offer.candidate)
            });
            let more: Vec<(&Base, Placed)> = (chosen.par_iter())
                .filter_map(|(it, beside, offer)| Some((it.base, placed(beside, offer)?)))
                .collect();
            for (base, placed) in more {
                let is_same = |(other, known): &(&Base, Placed)| {
                    std::ptr::eq(*other, base)
                        && known.term.candidate == placed.term.candidate
                        && known.term.nonlinear == placed.term.nonlinear
                };
                if !effects.iter().any(is_same) {
                    effects.push((base, placed));
                }
            }
        }
    }
    effects
}

/// A description with an effect more, fitted; with the stated noise of its sensors as it is or times the effect's factor, whichever is
/// likelier.
pub fn with_placed(bench: &Bench<'_>, description: &Description, effect: &Placed) -> Option<Description> {
    let touched = touched_by(effect);
    let factor = bench.problem.candidates[effect.term.candidate].noise_factor;
    let with = |noise_factor: f64| {
        let effect = Placed { noise_factor, ..effect.clone() };
        let mut more = description.clone();
        scale_noises(bench, &mut more, &effect, noise_factor);
        more.placed.push(effect);
        bench.fitted(&more, &touched)
    };
    let as_stated = with(1.0);
    if factor == 1.0 {
        return as_stated;
    }
    let all = [as_stated, with(factor)].into_iter().flatten();
    all.max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence))
}

/// Multiplies the noises that an effect scales.
fn scale_noises(bench: &Bench<'_>, description: &mut Description, effect: &Placed, factor: f64) {
    for (source, noise) in bench.problem.model.sources.iter().zip(&mut description.noises) {
        if effect.scales(source) {
            *noise = noise.times(factor);
        }
    }
}

/// What makes descriptions the same but for the values of their parameters: their candidates, each with the noise parameters that it
/// changes.
pub type Structure = Vec<(usize, Vec<String>)>;

/// The structure of a description.
pub fn structure(description: &Description) -> Structure {
    structure_of(&description.placed, &description.changes)
}

/// The structure of some items.
pub fn structure_of<'i>(
    placed: impl IntoIterator<Item = &'i Placed>,
    changes: impl IntoIterator<Item = &'i Change>,
) -> Structure {
    let of_effect = |placed: &Placed| (placed.term.candidate, Vec::new());
    let of_change =
        |change: &Change| (change.candidate, change.knobs.iter().map(|knob| format!("{knob:?}")).collect());
    let changes = changes.into_iter().map(of_change);
    let mut all: Structure = placed.into_iter().map(of_effect).chain(changes).collect();
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
