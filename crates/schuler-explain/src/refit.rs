//! The parameters of a finding with honest standard deviations.
//!
//! Amplitudes have the covariance of generalised least squares, widened by what the non-linear parameters leave open:
//! Σ = Σ_GLS + J Σ_ψ Jᵀ with J the change of the amplitudes with the parameters ψ. Σ_ψ is the inverse curvature of the
//! likelihood profiled over the amplitudes. Where that is no parabola (an onset, a plateau) the distance at which the
//! profile has fallen by what three standard deviations mean counts, if it is larger. Innovations that are not white
//! widen both ([`sandwich`](crate::sandwich)).
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::catalogue::{Candidate, OnsetShape, Search};
use crate::description::{Term, nonlinear_names};
use crate::explanation::{Parameter, is_plausible};
use crate::noise::{Knob, Noise, RowsOfLevel, VarianceStep};
use crate::noise_fit::{Observations, SourceKnob, curvature, exact, logs_of, with_logs};
use crate::sandwich::variances;
use crate::second::answer::parameters::{
    bounds, distance_of_fall, is_replaced, of_knob, of_stays, texts, width,
};
use crate::select::Item;
use crate::spectrum::Derivatives;
use crate::state::{Bench, Case, State};

/// Step of a derivative as a part of the distance at which the profile has fallen.
const STEP: f64 = 0.3;
/// Times at which a drift over the whole record may as well have begun.
const LATER_ONSETS: usize = 24;
/// Noise parameters of a block up to which the exact likelihood is differenced by each two of them: of more the correlations are
/// taken from Whittle's, as pairs grow as the square, and each is four runs over the record.
const FEW_PARAMETERS: usize = 6;
/// Step of the derivatives in logarithms of noise parameters.
const LOG_STEP: f64 = 0.03;

/// The parameters of a term of `state`.
pub fn of_term(case: &Case<'_>, state: &State, place: usize) -> Vec<Parameter> {
    let term = &state.terms[place];
    let candidate = &case.candidates[term.candidate];
    let others: Vec<Term> = state
        .terms
        .iter()
        .enumerate()
        .filter(|(index, _)| *index != place)
        .map(|(_, term)| term.clone())
        .collect();
    let bench = Bench::new(case, &others, &state.noises);
    let at = |point: &[f64]| term.at(candidate, point, case.time_s);
    let profile = |point: &[f64]| bench.with_term(&at(point));
    let (gain, solution) = profile(&term.nonlinear);
    let first = bench.solution.amplitudes.len();
    let number = term.amplitudes();
    let amplitudes = solution.amplitudes.rows(first, number).into_owned();
    let mut covariance = solution.covariance.view((first, first), (number, number)).into_owned();
    let size = term.nonlinear.len();
    let mut widths = vec![0.0; size];
    let mut of_nonlinear = DMatrix::zeros(size, size);
    if size > 0 {
        for axis in 0..size {
            widths[axis] =
                width(candidate, case.model, &term.nonlinear, axis, &|point| gain - profile(point).0);
        }
        // In units of the widths the profile is near a unit parabola.
        let scaled = |by: &[f64]| -> Vec<f64> {
            let range = |axis: usize| bounds(candidate, case.model, axis);
            (term.nonlinear.iter().zip(&widths).zip(by).enumerate())
                .map(|(axis, ((value, width), by))| {
                    let [low, high] = range(axis);
                    (value + width * by).clamp(low, high)
                })
                .collect()
        };
        let smooth = !matches!(candidate.search, Search::Onset(OnsetShape::Step));
        let mut unit = DMatrix::identity(size, size);
        if size > 1 && smooth {
            let information = curvature(&vec![0.0; size], STEP, |by| -profile(&scaled(by)).0);
            let eigen = information.symmetric_eigen();
            let inverse = eigen.eigenvalues.map(|value| value.max(0.05).recip());
            unit = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
            for axis in 0..size {
                // A profile's own width is at least the joint one's along its axis.
                unit[(axis, axis)] = unit[(axis, axis)].max(1.0);
            }
        }
        of_nonlinear = DMatrix::from_fn(size, size, |i, j| unit[(i, j)] * widths[i] * widths[j]);
        // A drift over the whole record has its onset where the record begins, not somewhere about it.
        let whole = matches!(candidate.search, Search::Onset(OnsetShape::Ramp)) && term.nonlinear[0] == 0.0;
        if number > 0 && smooth && !whole {
            let mut jacobian = DMatrix::zeros(number, size);
            for axis in 0..size {
                let mut by = vec![0.0; size];
                by[axis] = STEP;
                let up = scaled(&by);
                by[axis] = -STEP;
                let down = scaled(&by);
                let span = up[axis] - down[axis];
                if span > 0.0 {
                    let of = |point: &[f64]| profile(point).1.amplitudes.rows(first, number).into_owned();
                    jacobian.set_column(axis, &((of(&up) - of(&down)) / span));
                }
            }
            covariance += &jacobian * &of_nonlinear * jacobian.transpose();
        }
    }
    covariance += by_later_onsets(case, &bench, term, gain, (&amplitudes, &covariance));
    // What the noise model leaves widens what it says; see `sandwich`.
    let (of_amplitudes, of_shape) = variances(case, state, place);
    for (i, variance) in of_amplitudes.iter().enumerate().take(number) {
        let own = covariance[(i, i)];
        covariance[(i, i)] = own.max(variance.of_model) * variance.widened;
    }
    for (axis, variance) in of_shape.iter().enumerate().take(size) {
        of_nonlinear[(axis, axis)] *= variance.map_or(1.0, |variance| variance.widened);
    }
    let mut parameters = Vec::new();
    for (index, amplitude) in candidate.amplitudes.iter().enumerate().take(number) {
        let value = amplitudes[index] * amplitude.in_unit;
        let sigma = covariance[(index, index)].max(0.0).sqrt() * amplitude.in_unit.abs();
        parameters.push(Parameter {
            name: amplitude.name.clone(),
            value: Some(value),
            sigma: Some(sigma),
            unit: Some(amplitude.unit.clone()),
            plausible: amplitude.plausible.map(|range| is_plausible(value, sigma, range)),
            ..Parameter::default()
        });
    }
    for (axis, (name, unit)) in nonlinear_names(candidate).into_iter().enumerate() {
        parameters.push(Parameter {
            name: name.to_owned(),
            value: Some(term.nonlinear[axis]),
            sigma: Some(of_nonlinear[(axis, axis)].sqrt()),
            unit: Some(unit.to_owned()),
            ..Parameter::default()
        });
    }
    parameters.extend(of_stays(candidate, term, case.model.step_s));
    parameters.extend(texts(candidate));
    parameters
}

/// What the covariance of a drift over the whole record grows by because it may have begun later: that costs the search for the time, and may be
/// as likely, so that each of several times has its share in the spread. 0 of anything else.
fn by_later_onsets(
    case: &Case<'_>,
    bench: &Bench<'_>,
    term: &Term,
    gain: f64,
    (amplitudes, covariance): (&DVector<f64>, &DMatrix<f64>),
) -> DMatrix<f64> {
    let number = amplitudes.len();
    let none = DMatrix::zeros(number, number);
    let Some(ramp) = ramp_instead(case, term) else { return none };
    let length_s = case.time_s.last().copied().unwrap_or_default();
    let first = bench.solution.amplitudes.len();
    let later: Vec<(f64, DMatrix<f64>)> = (1..=LATER_ONSETS)
        .into_par_iter()
        .map(|place| {
            let onset_s = length_s * place as f64 / (LATER_ONSETS + 1) as f64;
            let later = Term::new(ramp, &case.candidates[ramp], &[onset_s], case.time_s);
            let (other, solution) = bench.with_term(&later);
            let apart = solution.amplitudes.rows(first, number) - amplitudes;
            let own = solution.covariance.view((first, first), (number, number)) - covariance;
            (other, &apart * apart.transpose() + own)
        })
        .collect();
    let best = later.iter().map(|(other, _)| *other).fold(gain, f64::max);
    let weight = |other: f64| (other - best).exp() / LATER_ONSETS as f64;
    let all = (gain - best).exp() + later.iter().map(|(other, _)| weight(*other)).sum::<f64>();
    later.iter().fold(none, |sum, (other, spread)| sum + spread * (weight(*other) / all))
}

/// The candidate of a drift that begins at any time, of a term that is one over the whole record.
fn ramp_instead(case: &Case<'_>, term: &Term) -> Option<usize> {
    let own = &case.candidates[term.candidate];
    let is_ramp = |candidate: &Candidate| matches!(candidate.search, Search::Onset(OnsetShape::Ramp));
    let is_whole = matches!(own.search, Search::Linear(_)) || (is_ramp(own) && term.nonlinear == [0.0]);
    let is_it = |other: &Candidate| {
        is_ramp(other)
            && (other.effect.id, &other.target, other.port) == (own.effect.id, &own.target, own.port)
            && other.amplitudes.len() == own.amplitudes.len()
    };
    is_whole.then(|| case.candidates.iter().position(is_it)).flatten()
}

/// An information matrix with the curvatures of `cost` along its axes, and its own correlations.
fn with_own_curvatures(
    mut information: DMatrix<f64>,
    logs: &[f64],
    cost: &(impl Fn(&[f64]) -> f64 + Sync),
) -> DMatrix<f64> {
    let here = cost(logs);
    let own = |axis: usize| {
        let moved = |by: f64| {
            let mut moved = logs.to_vec();
            moved[axis] += by;
            cost(&moved)
        };
        (moved(LOG_STEP) + moved(-LOG_STEP) - 2.0 * here) / (LOG_STEP * LOG_STEP)
    };
    let own: Vec<f64> = (0..logs.len()).into_par_iter().map(own).collect();
    for (axis, own) in own.into_iter().enumerate() {
        let scale = (own / information[(axis, axis)]).sqrt();
        if scale.is_finite() && scale > 0.0 {
            information.row_mut(axis).scale_mut(scale);
            information.column_mut(axis).scale_mut(scale);
        }
    }
    information
}

/// Standard deviations of the logarithms of the free parameters of a block's noises.
fn sigmas_of_logs(observations: Observations<'_>, noises: &[Noise], free: &[SourceKnob]) -> DVector<f64> {
    let Observations { block, spectrum, projected, .. } = observations;
    // Of redundant sensors the readings tell what residuals do not.
    let cost = |logs: &[f64]| {
        let noises = with_logs(noises, free, logs);
        -observations.beside_residuals(&noises) - exact(block, &noises, projected)
    };
    let logs = logs_of(noises, free);
    let many = free.len() > FEW_PARAMETERS;
    let closed = many.then(|| spectrum.derivatives(block, noises, free, LOG_STEP)).flatten();
    let information = match closed {
        Some(Derivatives { curvature: mut closed, .. }) => {
            if let Some(beside) = observations.derivatives_beside(noises, free) {
                closed += beside.curvature;
            }
            with_own_curvatures(closed, &logs, &cost)
        }
        None => curvature(&logs, LOG_STEP, cost),
    };
    let eigen = information.symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|value| value.max(0.1).recip());
    let covariance = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    DVector::from_fn(free.len(), |i, _| covariance[(i, i)].max(0.0).sqrt())
}

/// The parameters of a noise change of `state`, beside what the case states in their place.
pub fn of_change(case: &Case<'_>, state: &State, place: usize) -> Vec<Parameter> {
    let change = &state.changes[place];
    let source = &case.model.sources[change.source];
    let candidate = &case.candidates[change.candidate];
    let Some(index) = case.model.block_of_source(change.source) else {
        return Vec::new();
    };
    let free = state.free_in(case.model, index);
    let bench = Bench::new(case, &state.terms, &state.noises);
    let sigmas = bench.observations(index).map(|observations| {
        // The same for all changes of the block.
        case.sigmas
            .get_or((bench.key(index), free.clone()), || sigmas_of_logs(observations, &bench.noises, &free))
    });
    let mut parameters: Vec<Parameter> = Vec::new();
    let step = state.noises[change.source].step.filter(|_| change.knobs.contains(&Knob::StepRatio));
    if let Some(VarianceStep { rows: RowsOfLevel::Above { quantity, value }, .. }) = step
        && let Some(loudness) = case.model.blocks[index].loudness.get(quantity)
    {
        parameters.push(Parameter {
            name: "above".to_owned(),
            value: Some(value),
            unit: Some(loudness.unit.to_owned()),
            ..Parameter::default()
        });
    }
    if let Some(step) = step
        && let RowsOfLevel::From(first) = step.rows
    {
        let sigma = bench.blocks[index].as_ref().map(|whitened| {
            let likelihood = |row: usize| {
                let mut noises = state.noises.clone();
                noises[change.source].step = Some(VarianceStep { rows: RowsOfLevel::From(row), ..step });
                exact(&case.model.blocks[index], &noises, &whitened.projected)
            };
            let best = likelihood(first);
            let rows = [(-1.0, first), (1.0, case.time_s.len().saturating_sub(first + 1))];
            let widest = rows.map(|(side, room)| {
                let moved = |distance: f64| (first as f64 + side * distance).round() as usize;
                distance_of_fall(1.0, room as f64, |distance| best - likelihood(moved(distance)))
            });
            (widest[0].max(widest[1]) / 3.0).max(0.5) * case.model.step_s
        });
        parameters.push(Parameter {
            name: "onset_s".to_owned(),
            value: case.time_s.get(first).copied(),
            sigma,
            unit: Some("s".to_owned()),
            ..Parameter::default()
        });
    }
    for &knob in change.knobs.iter().filter(|knob| !is_replaced(change.change, **knob)) {
        let value = state.noises[change.source].get(knob);
        let place = free.iter().position(|&other| other == (change.source, knob));
        let relative = place.zip(sigmas.as_ref()).map(|(place, sigmas)| sigmas[place]);
        parameters.push(of_knob(source, knob, value, relative));
    }
    parameters.extend(texts(candidate));
    parameters
}

/// The parameters of an item.
pub fn parameters(case: &Case<'_>, state: &State, item: Item) -> Vec<Parameter> {
    match item {
        Item::Term(place) => of_term(case, state, place),
        Item::Change(place) => of_change(case, state, place),
    }
}
