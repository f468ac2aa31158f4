//! What several sensors have in common: a step at one time, a line of one frequency, with an amplitude of each.
//!
//! Such an item is searched for on each sensor by itself. Where another sensor has it at the same time or frequency as well, one item
//! of both says more with less: its time is free once.
use rayon::prelude::*;

use super::library::{Offer, placed};
use super::moves::{touched_by, with_placed};
use crate::catalogue::{Candidate, Search};
use crate::description::sensors_of;
use crate::evidence::fit::{Bench, Description, Placed};
use crate::search::beside::Beside;

/// The description in which what sensors have in common is told once, where that is better.
pub fn with_common(bench: &Bench<'_>, description: &Description) -> Option<Description> {
    let mut best: Option<Description> = None;
    loop {
        let from = best.as_ref().unwrap_or(description);
        let shared: Vec<Description> =
            moves(bench, from).par_iter().filter_map(|shared| shared.of(bench, from)).collect();
        let found = shared.into_iter().max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence));
        match found.filter(|found| found.ln_evidence > from.ln_evidence) {
            Some(better) => best = Some(better),
            None => return best,
        }
    }
}

/// An item that one more sensor has as well.
struct Shared {
    /// The item's place, and that of the other sensor's own item, which goes.
    places: Vec<usize>,
    /// The candidate of all its sensors.
    candidate: usize,
    /// Its time or frequency.
    at: f64,
    ln_spread: f64,
}

impl Shared {
    fn of(&self, bench: &Bench<'_>, description: &Description) -> Option<Description> {
        let mut rest = description.clone();
        let mut place = 0;
        rest.placed.retain(|_| {
            place += 1;
            !self.places.contains(&(place - 1))
        });
        let blocks: Vec<usize> =
            self.places.iter().flat_map(|&place| touched_by(&description.placed[place])).collect();
        let rest = bench.fitted(&rest, &blocks)?;
        let beside = Beside::as_trusted(bench, &rest)?;
        let Self { candidate, at, ln_spread, .. } = *self;
        let offer = Offer { candidate, ln_gain: 0.0, blocks, point: vec![at], ln_spread };
        with_placed(bench, &rest, &placed(&beside, &offer)?)
    }
}

/// Every step and line of a description with one more of the sensors that may have it in common: beside what that sensor has, and in the
/// place of its own that is nearest.
fn moves(bench: &Bench<'_>, description: &Description) -> Vec<Shared> {
    let problem = bench.problem;
    let ln_in_common = problem.config.in_common.ln();
    let mut all = Vec::new();
    for (place, own) in description.placed.iter().enumerate() {
        let candidate = &problem.candidates[own.term.candidate];
        let Some(at) = place_of(candidate, own) else { continue };
        for (number, wider) in problem.candidates.iter().enumerate() {
            let Some(sensor) = one_more(candidate, wider) else { continue };
            let shared = |other: Option<usize>, at: f64| {
                let of_other = other.map_or(own.ln_spread, |other| description.placed[other].ln_spread);
                Shared {
                    places: std::iter::once(place).chain(other).collect(),
                    candidate: number,
                    at,
                    ln_spread: own.ln_spread.min(of_other) + ln_in_common,
                }
            };
            let of_sensor = |(other, placed): (usize, &Placed)| {
                let its = &problem.candidates[placed.term.candidate];
                let is_of_it = its.effect.id == candidate.effect.id && sensors_of(its) == [sensor];
                Some((other, place_of(its, placed).filter(|_| is_of_it)?))
            };
            let nearest = (description.placed.iter().enumerate().filter_map(of_sensor))
                .min_by(|a, b| (a.1 - at).abs().total_cmp(&(b.1 - at).abs()));
            all.push(shared(None, at));
            if let Some((other, there)) = nearest {
                all.extend([at, there].map(|at| shared(Some(other), at)));
            }
        }
    }
    all
}

/// The time of a step or the frequency of a line; none of other effects.
fn place_of(candidate: &Candidate, placed: &Placed) -> Option<f64> {
    let has_place = matches!(candidate.search, Search::Onset(_) | Search::Frequency);
    placed.term.nonlinear.first().copied().filter(|_| has_place)
}

/// The sensor that a candidate has more than another one of the same effect.
fn one_more(candidate: &Candidate, wider: &Candidate) -> Option<usize> {
    let (own, all) = (sensors_of(candidate), sensors_of(wider));
    let is_same = wider.effect.id == candidate.effect.id && wider.port == candidate.port;
    let is_wider = is_same && all.len() == own.len() + 1 && own.iter().all(|sensor| all.contains(sensor));
    all.into_iter().find(|sensor| is_wider && !own.contains(sensor))
}
