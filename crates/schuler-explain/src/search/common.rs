//! What several sensors have in common: a step at one time, a line of one frequency, with an amplitude of each.
//!
//! Such an item is searched for on each sensor by itself. Where another sensor has it at the same time or frequency as well, one item
//! of both says more with less: its time is free once.
use rayon::prelude::*;

use super::library::{Offer, placed};
use super::moves::with_placed;
use crate::catalogue::Candidate;
use crate::description::sensors_of;
use crate::evidence::fit::{Bench, Description, Placed};
use crate::search::beside::Beside;

/// The description in which what sensors have in common is told once, where that is better.
pub fn with_common(bench: &Bench<'_>, description: &Description) -> Option<Description> {
    let mut best = description.clone();
    let mut is_better = false;
    loop {
        let gain = |shared: Shared| {
            let gain = shared.of(bench, &best)?.ln_evidence - best.ln_evidence;
            (gain > 0.0).then_some((gain, shared))
        };
        let mut found: Vec<(f64, Shared)> = moves(bench, &best).into_par_iter().filter_map(gain).collect();
        if found.is_empty() {
            return is_better.then_some(best);
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.candidate.cmp(&b.1.candidate)));
        for (_, shared) in found {
            let with = shared.of(bench, &best).filter(|with| with.ln_evidence > best.ln_evidence);
            if let Some(with) = with {
                (best, is_better) = (with, true);
            }
        }
    }
}

/// An item that one more sensor has as well.
struct Shared {
    /// Candidate and time or frequency of the item, and of the other sensor's own one; both go.
    items: Vec<(usize, f64)>,
    /// The candidate of all its sensors.
    candidate: usize,
    /// Its time or frequency.
    at: f64,
    ln_spread: f64,
}

impl Shared {
    /// A description with it, fitted; none where that lacks one of the items.
    fn of(&self, bench: &Bench<'_>, description: &Description) -> Option<Description> {
        let mut rest = description.clone();
        for item in &self.items {
            let is_it = |placed: &Placed| {
                placed.term.candidate == item.0 && placed.term.nonlinear.first() == Some(&item.1)
            };
            rest.placed.remove(rest.placed.iter().position(is_it)?);
        }
        let beside = Beside::as_trusted(bench, &rest)?;
        let Self { candidate, at, ln_spread, .. } = *self;
        let offer = Offer { candidate, ln_gain: 0.0, blocks: Vec::new(), point: vec![at], ln_spread };
        with_placed(bench, &rest, &placed(&beside, &offer)?)
    }
}

/// Every step and line of a description with one more of the sensors that may have it in common: beside what that sensor has, and in the
/// place of its own that is nearest.
fn moves(bench: &Bench<'_>, description: &Description) -> Vec<Shared> {
    let problem = bench.problem;
    let ln_in_common = problem.config.in_common.ln();
    let mut all = Vec::new();
    for own in &description.placed {
        let candidate = &problem.candidates[own.term.candidate];
        let Some(at) = at_of(candidate, own) else { continue };
        for (number, wider) in problem.candidates.iter().enumerate() {
            let Some(sensor) = one_more(candidate, wider) else { continue };
            let shared = |other: Option<(&Placed, f64)>, at_both: f64| Shared {
                items: (std::iter::once((own.term.candidate, at)))
                    .chain(other.map(|(other, there)| (other.term.candidate, there)))
                    .collect(),
                candidate: number,
                at: at_both,
                ln_spread: other.map_or(own.ln_spread, |(other, _)| other.ln_spread.min(own.ln_spread))
                    + ln_in_common,
            };
            let of_sensor = |placed: &Placed| {
                let its = &problem.candidates[placed.term.candidate];
                let is_of_it = its.effect.id == candidate.effect.id && sensors_of(its) == [sensor];
                at_of(its, placed).filter(|_| is_of_it)
            };
            let nearest = (description.placed.iter().filter_map(|it| Some((it, of_sensor(it)?))))
                .min_by(|a, b| (a.1 - at).abs().total_cmp(&(b.1 - at).abs()));
            all.push(shared(None, at));
            if let Some((other, there)) = nearest {
                all.extend([at, there].map(|at| shared(Some((other, there)), at)));
            }
        }
    }
    all
}

/// The time of a step or the frequency of a line; none of other effects.
fn at_of(candidate: &Candidate, placed: &Placed) -> Option<f64> {
    placed.term.nonlinear.first().copied().filter(|_| candidate.search.is_scanned())
}

/// The sensor that a candidate has more than another one of the same effect.
fn one_more(candidate: &Candidate, wider: &Candidate) -> Option<usize> {
    let (own, all) = (sensors_of(candidate), sensors_of(wider));
    let is_same = wider.effect.id == candidate.effect.id && wider.port == candidate.port;
    let is_wider = is_same && all.len() == own.len() + 1 && own.iter().all(|sensor| all.contains(sensor));
    all.into_iter().find(|sensor| is_wider && !own.contains(sensor))
}
