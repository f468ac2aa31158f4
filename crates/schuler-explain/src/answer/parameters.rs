//! The parameters of an item with their standard deviations, from the same sums and weights as its evidence.
//!
//! Amplitudes have the covariance of generalised least squares beside all else that is described, widened by what the non-linear
//! parameters leave open: Σ = Σ_GLS + J Σ_ψ Jᵀ with J the change of the amplitudes with the parameters ψ. Those have a width by where
//! the likelihood, profiled over the amplitudes, has fallen by what three standard deviations mean.
use nalgebra::{DMatrix, DVector};

use crate::catalogue::{Candidate, Column, NoiseChange, OnsetShape, Search};
use crate::description::{Term, nonlinear_names};
use crate::evidence::fit::{Bench, Change, Description};
use crate::evidence::regressor::regressors;
use crate::evidence::system::Described;
use crate::exact::telegraph::mean_stays;
use crate::explanation::{Parameter, is_plausible};
use crate::noise::{Knob, Noise, RowsOfLevel, VarianceStep};
use crate::nominal::{Model, Source};
use crate::search::beside::Beside;
use crate::search::late::columns_beside;
use crate::search::levels::{LevelSpread, spread_of_level};
use crate::search::moves::Item;

/// Fall of the log-likelihood at three standard deviations.
const THREE_SIGMA_NATS: f64 = 4.5;
/// Steps by which the search for that fall grows, and how often.
const GROWTH: f64 = 1.6;
const GROWTHS: usize = 40;
/// Step of a derivative as a part of the distance at which the profile has fallen.
const STEP: f64 = 0.3;
/// Least eigenvalue of a curvature in units of the widths.
const LEAST_CURVATURE: f64 = 0.05;

/// The parameters of an item of a description.
pub fn parameters(bench: &Bench<'_>, description: &Description, item: Item) -> Vec<Parameter> {
    match item {
        Item::Placed(place) => of_effect(bench, description, place),
        Item::Change(place) => of_change(bench, description, &description.changes[place]),
    }
}

/// The likelihood of an effect beside the rest of a description, by its non-linear parameters.
pub struct Profile<'p> {
    beside: &'p Beside<'p>,
    described: Described<'p>,
    candidate: &'p Candidate,
    is_unit: bool,
}

/// What a profile tells at a point.
pub struct Told {
    /// Gain of log-likelihood over the rest alone, amplitudes at their best.
    pub gain: f64,
    /// Amplitudes, 0 of columns that the rest describes.
    pub amplitudes: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
}

impl<'p> Profile<'p> {
    /// The profile of a term of a candidate.
    pub fn new(beside: &'p Beside<'p>, term: &Term) -> Self {
        let candidate = &beside.bench.problem.candidates[term.candidate];
        Self { beside, described: beside.described(), candidate, is_unit: term.unit_amplitude }
    }

    /// The candidate.
    pub fn candidate(&self) -> &'p Candidate {
        self.candidate
    }

    /// At given values of the non-linear parameters; none where the rest describes it.
    pub fn at(&self, point: &[f64]) -> Option<Told> {
        self.of_columns(&columns_beside(self.beside, self.candidate, point))
    }

    fn of_columns(&self, columns: &[Column]) -> Option<Told> {
        let bench = self.beside.bench;
        let whitened = regressors(bench.problem.model, &bench.sums, columns, self.candidate.port);
        let number = whitened.len();
        let normal = self.beside.normal(&self.described, &whitened)?;
        if self.is_unit {
            let gain = normal.scores.sum() - 0.5 * normal.information.sum();
            return Some(Told { gain, amplitudes: DVector::zeros(0), covariance: DMatrix::zeros(0, 0) });
        }
        let kept = normal.amplitudes()?;
        let inverse = normal.covariance()?;
        let (mut amplitudes, mut covariance) = (DVector::zeros(number), DMatrix::zeros(number, number));
        for (i, &row) in normal.kept.iter().enumerate() {
            amplitudes[row] = kept[i];
            for (j, &column) in normal.kept.iter().enumerate() {
                covariance[(row, column)] = inverse[(i, j)];
            }
        }
        Some(Told { gain: 0.5 * kept.dot(&normal.scores), amplitudes, covariance })
    }

    /// The gain, −∞ where the rest describes it.
    pub fn gain(&self, point: &[f64]) -> f64 {
        self.at(point).map_or(f64::NEG_INFINITY, |told| told.gain)
    }
}

/// A description without one of its effects.
pub fn without_effect(description: &Description, place: usize) -> Description {
    let mut rest = description.clone();
    rest.placed.remove(place);
    rest
}

fn of_effect(bench: &Bench<'_>, description: &Description, place: usize) -> Vec<Parameter> {
    let term = &description.placed[place].term;
    let (candidate, model) = (&bench.problem.candidates[term.candidate], bench.problem.model);
    let mut parameters = if candidate.effect.is_a_delay() {
        of_delay(bench, description, place)
    } else {
        let rest = without_effect(description, place);
        Beside::as_trusted(bench, &rest)
            .and_then(|beside| numbers(&Profile::new(&beside, term), model, term))
            .unwrap_or_default()
    };
    parameters.extend(of_stays(candidate, term, model.step_s));
    parameters.extend(texts(candidate));
    parameters
}

/// A delay, which moves the other effects of the motion.
fn of_delay(bench: &Bench<'_>, description: &Description, place: usize) -> Vec<Parameter> {
    let term = &description.placed[place].term;
    let (candidate, model) = (&bench.problem.candidates[term.candidate], bench.problem.model);
    let gain = bench.gain_at(description, place, &term.nonlinear);
    let fall = |point: &[f64]| gain - bench.gain_at(description, place, point);
    let parameter = |(axis, (name, unit)): (usize, (&str, &str))| Parameter {
        name: name.to_owned(),
        value: Some(term.nonlinear[axis]),
        sigma: Some(width(candidate, model, &term.nonlinear, axis, &fall)),
        unit: Some(unit.to_owned()),
        ..Parameter::default()
    };
    nonlinear_names(candidate).into_iter().enumerate().map(parameter).collect()
}

/// Amplitudes and non-linear parameters.
fn numbers(profile: &Profile<'_>, model: &Model, term: &Term) -> Option<Vec<Parameter>> {
    let candidate = profile.candidate;
    // The columns of a history of jumps do not follow from parameters.
    let told =
        if candidate.is_jump() { profile.of_columns(&term.columns)? } else { profile.at(&term.nonlinear)? };
    let spread = Spread::new(profile, model, term, told.gain);
    let mut covariance = told.covariance;
    if !covariance.is_empty() {
        covariance += spread.of_amplitudes(profile, term);
    }
    let amplitude = |(index, amplitude): (usize, &crate::catalogue::Amplitude)| {
        let value = told.amplitudes[index] * amplitude.in_unit;
        let sigma = covariance[(index, index)].max(0.0).sqrt() * amplitude.in_unit.abs();
        Parameter {
            name: amplitude.name.clone(),
            value: Some(value),
            sigma: Some(sigma),
            unit: Some(amplitude.unit.clone()),
            plausible: amplitude.plausible.map(|range| is_plausible(value, sigma, range)),
            ..Parameter::default()
        }
    };
    let number = told.amplitudes.len();
    let mut all: Vec<Parameter> =
        candidate.amplitudes.iter().take(number).enumerate().map(amplitude).collect();
    for (axis, (name, unit)) in nonlinear_names(candidate).into_iter().enumerate() {
        all.push(Parameter {
            name: name.to_owned(),
            value: Some(term.nonlinear[axis]),
            sigma: Some(spread.covariance[(axis, axis)].sqrt()),
            unit: Some(unit.to_owned()),
            ..Parameter::default()
        });
    }
    Some(all)
}

/// What the data leave open of the non-linear parameters of a term.
struct Spread {
    widths: Vec<f64>,
    /// Their covariance.
    covariance: DMatrix<f64>,
    bounds: Vec<[f64; 2]>,
    is_smooth: bool,
}

impl Spread {
    fn new(profile: &Profile<'_>, model: &Model, term: &Term, gain: f64) -> Self {
        let (candidate, size) = (profile.candidate, term.nonlinear.len());
        let bounds: Vec<[f64; 2]> = (0..size).map(|axis| bounds(candidate, model, axis)).collect();
        let fall = |point: &[f64]| gain - profile.gain(point);
        let widths: Vec<f64> =
            (0..size).map(|axis| width(candidate, model, &term.nonlinear, axis, &fall)).collect();
        // Of a drift over the whole record the onset is the beginning.
        let is_whole = matches!(candidate.search, Search::Onset(OnsetShape::Ramp)) && term.nonlinear == [0.0];
        let is_smooth = !matches!(candidate.search, Search::Onset(OnsetShape::Step)) && !is_whole;
        let mut spread = Self { widths, covariance: DMatrix::identity(size, size), bounds, is_smooth };
        if size > 1 && is_smooth {
            spread.covariance = spread.inverse_curvature(&|by| fall(&spread.moved(term, by)));
        }
        let scale = DMatrix::from_diagonal(&DVector::from_column_slice(&spread.widths));
        spread.covariance = &scale * &spread.covariance * &scale;
        spread
    }

    /// The parameters moved by parts of their widths.
    fn moved(&self, term: &Term, by: &[f64]) -> Vec<f64> {
        let all = term.nonlinear.iter().zip(&self.widths).zip(by).zip(&self.bounds);
        all.map(|(((value, width), by), [low, high])| (value + width * by).clamp(*low, *high)).collect()
    }

    /// In units of the widths, in which a profile is near a unit parabola.
    fn inverse_curvature(&self, fall: &dyn Fn(&[f64]) -> f64) -> DMatrix<f64> {
        let size = self.widths.len();
        let at = |i: usize, a: f64, j: usize, b: f64| {
            let mut by = vec![0.0; size];
            by[i] += a * STEP;
            by[j] += b * STEP;
            fall(&by)
        };
        let information = DMatrix::from_fn(size, size, |i, j| {
            let difference = if i == j {
                at(i, 1.0, i, 0.0) + at(i, -1.0, i, 0.0)
            } else {
                0.25 * (at(i, 1.0, j, 1.0) + at(i, -1.0, j, -1.0) - at(i, 1.0, j, -1.0) - at(i, -1.0, j, 1.0))
            };
            difference / (STEP * STEP)
        });
        let eigen = information.symmetric_eigen();
        let inverse = eigen.eigenvalues.map(|value| value.max(LEAST_CURVATURE).recip());
        let mut covariance =
            &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
        for axis in 0..size {
            // A profile's own width is at least the joint one's along its axis.
            covariance[(axis, axis)] = covariance[(axis, axis)].max(1.0);
        }
        covariance
    }

    /// By how much the covariance of the amplitudes grows.
    fn of_amplitudes(&self, profile: &Profile<'_>, term: &Term) -> DMatrix<f64> {
        let (number, size) = (term.columns.len(), self.widths.len());
        let mut jacobian = DMatrix::zeros(number, size);
        for axis in (0..size).filter(|_| self.is_smooth) {
            let mut by = vec![0.0; size];
            by[axis] = STEP;
            let up = self.moved(term, &by);
            by[axis] = -STEP;
            let down = self.moved(term, &by);
            let span = up[axis] - down[axis];
            if let (true, Some(above), Some(below)) = (span > 0.0, profile.at(&up), profile.at(&down)) {
                jacobian.set_column(axis, &((above.amplitudes - below.amplitudes) / span));
            }
        }
        &jacobian * &self.covariance * jacobian.transpose()
    }
}

/// Least and largest value of a non-linear parameter.
pub fn bounds(candidate: &Candidate, model: &Model, axis: usize) -> [f64; 2] {
    let length_s = model.time_s.last().copied().unwrap_or(1.0);
    match &candidate.search {
        Search::Grid { parameters, .. } => parameters.get(axis).map_or([0.0, 0.0], |parameter| {
            let first = parameter.grid.first().copied().unwrap_or_default();
            [first, parameter.grid.last().copied().unwrap_or(first)]
        }),
        Search::Frequency => [0.0, 0.5 / model.step_s],
        _ => [0.0, length_s],
    }
}

/// Standard deviation of the parameter of an axis from where its profile has fallen by 4.5 nats, the wider side's.
fn width(candidate: &Candidate, model: &Model, at: &[f64], axis: usize, fall: &dyn Fn(&[f64]) -> f64) -> f64 {
    let [low, high] = bounds(candidate, model, axis);
    let length_s = model.time_s.last().copied().unwrap_or(1.0).max(f64::MIN_POSITIVE);
    let smallest = match &candidate.search {
        Search::Onset(_) => model.step_s,
        Search::Frequency => 1e-3 / length_s,
        _ => 1e-3 * at[axis].abs().max(1e-3 * (high - low)),
    };
    let of_side = |side: f64| {
        let room = if side > 0.0 { high - at[axis] } else { at[axis] - low };
        let fallen = |distance: f64| {
            let mut moved = at.to_vec();
            moved[axis] += side * distance;
            fall(&moved)
        };
        distance_of_fall(smallest, room, fallen)
    };
    let least = if matches!(candidate.search, Search::Onset(_)) { 0.5 * model.step_s } else { 0.0 };
    (of_side(-1.0).max(of_side(1.0)) / 3.0).max(least)
}

/// Distance at which a profile has fallen by 4.5 nats, from the smallest that is tried up to the end of the range.
fn distance_of_fall(smallest: f64, room: f64, fall: impl Fn(f64) -> f64) -> f64 {
    let mut distance = smallest;
    let mut inside = 0.0_f64;
    for _ in 0..GROWTHS {
        if distance >= room {
            // The range ends before the profile has fallen.
            return inside.max(room);
        }
        let fallen = fall(distance);
        if fallen >= THREE_SIGMA_NATS {
            // Between the last two distances the fall grows as a square.
            return inside.max(distance * (THREE_SIGMA_NATS / fallen).sqrt());
        }
        inside = distance;
        distance *= GROWTH;
    }
    inside
}

/// How long a mean that jumps stays on and off.
fn of_stays(candidate: &Candidate, term: &Term, step_s: f64) -> Vec<Parameter> {
    if !candidate.is_jump() {
        return Vec::new();
    }
    let stays = mean_stays(term, step_s).map(|(name, mean_s, sigma_s)| Parameter {
        name: name.to_owned(),
        value: Some(mean_s),
        sigma: Some(sigma_s),
        unit: Some("s".to_owned()),
        ..Parameter::default()
    });
    stays.to_vec()
}

/// The words that say which of several it is.
fn texts(candidate: &Candidate) -> impl Iterator<Item = Parameter> + '_ {
    candidate.variant.iter().map(|(name, text)| Parameter {
        name: (*name).to_owned(),
        text: Some(text.clone()),
        ..Parameter::default()
    })
}

/// The parameters of a change of noise, beside what the case states in their place.
fn of_change(bench: &Bench<'_>, description: &Description, change: &Change) -> Vec<Parameter> {
    let problem = bench.problem;
    let (source, stated) =
        (&problem.model.sources[change.source], description.stated(problem, change.source));
    let Some(index) = problem.model.block_of_source(change.source) else { return Vec::new() };
    let noise = &description.noises[change.source];
    let step = noise.step.filter(|_| change.is_level());
    let spread = step.and_then(|step| spread_of_level(bench, description, index, step));
    let mut parameters: Vec<Parameter> =
        step.and_then(|step| where_level_is(bench, index, step, spread.as_ref())).into_iter().collect();
    let sigmas = description.blocks[index].as_ref().map(|fit| fit.sigmas.as_slice()).unwrap_or_default();
    for &knob in change.knobs.iter().filter(|knob| !is_replaced(change.kind, **knob)) {
        let relative = if knob == Knob::StepRatio {
            spread.as_ref().map(|spread| spread.of_ln_ratio)
        } else {
            sigmas.iter().find(|(of, _)| *of == (change.source, knob)).map(|(_, sigma)| *sigma)
        };
        parameters.push(of_knob(source, &stated, knob, noise.get(knob), relative));
    }
    parameters.extend(texts(&problem.candidates[change.candidate]));
    parameters
}

/// Whether a parameter is the level of a Markov part that an exponential-cosine takes the place of.
fn is_replaced(change: NoiseChange, knob: Knob) -> bool {
    change == NoiseChange::ExponentialCosine && matches!(knob, Knob::MarkovSigma(_))
}

/// A parameter of the noise of a source, whose standard deviation is a part `relative` of it, beside what the case states.
pub(super) fn of_knob(
    source: &Source,
    stated: &Noise,
    knob: Knob,
    value: f64,
    relative: Option<f64>,
) -> Parameter {
    // Where the case says nothing of the noise its white level is an estimate, and a change at a time is never stated.
    let is_estimate = source.unknown && knob == Knob::White;
    let is_stated = !is_estimate && knob != Knob::StepRatio && stated.has_shape(knob);
    let stated = Some(stated.get(knob)).filter(|stated| is_stated && *stated > 0.0);
    let scale = if knob.in_sensor_unit() { source.unit.in_si().recip() } else { 1.0 };
    let unit = if knob.in_sensor_unit() {
        format!("{}{}", source.unit.name(), knob.unit())
    } else {
        knob.unit().to_owned()
    };
    Parameter {
        name: knob.name().0.to_owned(),
        value: Some(value * scale),
        sigma: relative.map(|relative| relative * value * scale),
        unit: Some(unit),
        stated: stated.map(|stated| stated * scale),
        ..Parameter::default()
    }
}

/// Since when there is another level, or above what.
fn where_level_is(
    bench: &Bench<'_>,
    index: usize,
    step: VarianceStep,
    spread: Option<&LevelSpread>,
) -> Option<Parameter> {
    let model = bench.problem.model;
    match step.rows {
        RowsOfLevel::Above { quantity, value } => Some(Parameter {
            name: "above".to_owned(),
            value: Some(value),
            unit: Some(model.blocks[index].loudness.get(quantity)?.unit.to_owned()),
            ..Parameter::default()
        }),
        RowsOfLevel::From(first) => Some(Parameter {
            name: "onset_s".to_owned(),
            value: model.time_s.get(first).copied(),
            sigma: spread.map(|spread| {
                let rows = distance_of_fall(1.0, model.rows as f64, |distance| spread.fall(distance));
                (rows / 3.0).max(0.5) * model.step_s
            }),
            unit: Some("s".to_owned()),
            ..Parameter::default()
        }),
    }
}
