//! Non-linear parameters at their best beside all else that is described.
//!
//! In the search a parameter is refined beside what is described when its effect enters; what enters later moves it.
use super::parameters::{Profile, bounds, without_effect};
use crate::catalogue::{OnsetShape, Search};
use crate::evidence::fit::{Bench, Description, Placed};
use crate::numeric::minimise::golden;
use crate::search::beside::Beside;
use crate::search::library::{Offer, placed};
use crate::search::moves::touched_by;

/// How often all parameters have their turn.
const ROUNDS: usize = 3;
/// Nats by which a description may become worse where one of its parameters moved: its weights are fitted anew.
const AS_GOOD: f64 = 0.05;
/// Longest step of the search for an onset, rows.
const LONGEST_STEP: usize = 64;
/// Part of a step to which a delay is sought, and nats that it must gain to be moved.
const DELAY_TO: f64 = 1e-3;
const DELAY_GAIN: f64 = 0.01;
/// Part of a step to which the onset of a ramp is sought.
const SOUGHT_TO: f64 = 0.05;

/// A description with its non-linear parameters at their best.
pub fn polished(bench: &Bench<'_>, description: &Description) -> Description {
    let mut best = description.clone();
    for _ in 0..ROUNDS {
        let mut has_moved = false;
        for place in 0..best.placed.len() {
            if let Some(moved) = with_moved(bench, &best, place) {
                has_moved = true;
                best = moved;
            }
        }
        if !has_moved {
            break;
        }
    }
    best
}

/// The description with the parameters of one effect moved, if that is better.
fn with_moved(bench: &Bench<'_>, description: &Description, place: usize) -> Option<Description> {
    let own = &description.placed[place];
    if own.term.nonlinear.is_empty() {
        return None;
    }
    let moved = if bench.problem.candidates[own.term.candidate].effect.is_a_delay() {
        with_best_delay(bench, description, place)
    } else {
        beside_the_rest(bench, description, place)?
    };
    if moved.term.nonlinear == own.term.nonlinear {
        return None;
    }
    let mut better = description.clone();
    better.placed[place] = moved;
    let touched = touched_by(&better.placed[place]);
    let fitted = bench.fitted(&better, &touched)?;
    (fitted.ln_evidence > description.ln_evidence - AS_GOOD).then_some(fitted)
}

/// An effect with its parameters at their best beside the rest as it is.
fn beside_the_rest(bench: &Bench<'_>, description: &Description, place: usize) -> Option<Placed> {
    let own = &description.placed[place];
    let rest = without_effect(description, place);
    let beside = Beside::as_trusted(bench, &rest)?;
    let mut point = own.term.nonlinear.clone();
    if let (Search::Onset(shape), [onset_s]) =
        (&bench.problem.candidates[own.term.candidate].search, point.as_slice())
    {
        let profile = Profile::new(&beside, &own.term);
        point = vec![best_onset(bench, &profile, *shape, *onset_s)];
    }
    let (candidate, blocks) = (own.term.candidate, touched_by(own));
    let offer = Offer { candidate, ln_gain: 0.0, blocks, point, ln_spread: own.ln_spread };
    placed(&beside, &offer)
}

/// A delay at its best, together with the effects of the motion that it moves.
fn with_best_delay(bench: &Bench<'_>, description: &Description, place: usize) -> Placed {
    let own = &description.placed[place];
    let (problem, here) = (bench.problem, own.term.nonlinear[0]);
    let candidate = &problem.candidates[own.term.candidate];
    let [low, high] = bounds(candidate, problem.model, 0);
    let step_s = problem.model.step_s;
    let (from, to) = ((here - step_s).max(low), (here + step_s).min(high));
    let cost = |delay_s: f64| -bench.gain_at(description, place, &[delay_s]);
    let (best, least) = golden(from, to, DELAY_TO * step_s, cost);
    if least >= cost(here) - DELAY_GAIN {
        return own.clone();
    }
    let term = own.term.at(candidate, &[best], problem.time_s());
    let regressors = bench.whitened_as(&term.columns, own);
    Placed { term, regressors, ..own.clone() }
}

/// The time at which a shape gains most, from a row near it on.
fn best_onset(bench: &Bench<'_>, profile: &Profile<'_>, shape: OnsetShape, onset_s: f64) -> f64 {
    let model = bench.problem.model;
    let time_s = &model.time_s;
    let last = time_s.len().saturating_sub(1);
    let gain = |row: usize| profile.gain(&[time_s[row]]);
    let mut row = time_s.partition_point(|time| *time < onset_s).min(last);
    let mut reached = gain(row);
    let mut step = 1;
    while step <= LONGEST_STEP {
        let sides = [row.saturating_sub(step), (row + step).min(last)];
        let better = sides.into_iter().map(|row| (row, gain(row))).max_by(|a, b| a.1.total_cmp(&b.1));
        match better.filter(|better| better.1 > reached) {
            Some(better) => (row, reached, step) = (better.0, better.1, 1),
            None => step *= 2,
        }
    }
    if shape == OnsetShape::Step {
        return time_s[row];
    }
    let [low, high] = bounds(profile.candidate(), model, 0);
    let (from, to) = ((time_s[row] - model.step_s).max(low), (time_s[row] + model.step_s).min(high));
    golden(from, to, SOUGHT_TO * model.step_s, |time| -profile.gain(&[time])).0
}
