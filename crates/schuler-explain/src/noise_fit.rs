//! Maximum likelihood of noise parameters: Whittle's likelihood finds the place, the exact one has the last word.
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::common_motion::CommonMotion;
use crate::description::{Projected, Sums, take_off};
use crate::minimise::{IMPOSSIBLE, simplex};
use crate::noise::{Knob, Noise};
use crate::nominal::Block;
use crate::spectrum::{Derivatives, OneSource, SEVERAL_CHANNELS, Spectrum};
use crate::steady::Steady;
use crate::whiten::Filter;

/// Side of the first simplex, in logarithms.
const SIDE: f64 = 0.7;
/// Spread of the simplex's log-likelihoods at which it ends.
const SPREAD: f64 = 0.01;
/// Iterations of the simplex for each parameter.
const ITERATIONS: u64 = 80;
/// Step of the derivatives, in logarithms.
pub const STEP: f64 = 0.05;
/// Newton steps on the exact likelihood.
const NEWTON: usize = 8;
/// Gain that the next Newton step must promise.
const PROMISE: f64 = 0.01;
/// Times that a Newton step may gain what it promises.
const DOUBTED: f64 = 3.0;
/// Nats, beside what Whittle's likelihood would gain that often, by which a fit must stay behind to be left at once.
const FAR_NATS: f64 = 10.0;
/// Gain of Whittle's likelihood that is worth a look at the exact one.
const WORTH_MOVING: f64 = 1.0;
/// Least information about a logarithm that a step takes for granted.
const LEAST_INFORMATION: f64 = 1.0;
/// Most change of a logarithm in one step.
const MOST_STEP: f64 = 1.0;

/// A parameter of the noise of a source.
pub type SourceKnob = (usize, Knob);

/// Noises at the maximum of their likelihood.
#[derive(Clone, Debug)]
pub struct NoiseFit {
    /// All noises.
    pub noises: Vec<Noise>,
    /// Exact log-likelihood of the block's residuals, with what its readings tell beside them.
    pub log_likelihood: f64,
}

/// `noises` with the logarithms of the given parameters.
pub fn with_logs(noises: &[Noise], knobs: &[SourceKnob], logs: &[f64]) -> Vec<Noise> {
    let mut noises = noises.to_vec();
    for (&(source, knob), log) in knobs.iter().zip(logs) {
        noises[source].set(knob, log.exp());
    }
    noises
}

/// Logarithms of the given parameters.
pub fn logs_of(noises: &[Noise], knobs: &[SourceKnob]) -> Vec<f64> {
    knobs.iter().map(|&(source, knob)| noises[source].get(knob).max(1e-300).ln()).collect()
}

/// Square of how far parameters lie outside of what a record of `rows` steps can tell.
fn outside(knobs: &[SourceKnob], logs: &[f64], step_s: f64, rows: usize) -> f64 {
    let length_s = step_s * rows as f64;
    let beyond = |(&(_, knob), &log): (&SourceKnob, &f64)| {
        let (low, high): (f64, f64) = match knob {
            Knob::MarkovTau(_) => (0.3 * step_s, length_s),
            Knob::CosineAlpha(_) => (0.3 / length_s, 1.0 / step_s),
            Knob::CosineBeta(_) => (1.0 / length_s, 3.0 / step_s),
            Knob::StepRatio => (0.01, 100.0),
            _ => return 0.0,
        };
        (low.ln() - log).max(log - high.ln()).max(0.0).powi(2)
    };
    knobs.iter().zip(logs).map(beyond).sum()
}

/// Exact log-likelihood of a block under `noises`, its regressors at their best; −∞ where it cannot be computed.
pub fn exact(block: &Block, noises: &[Noise], projected: &Projected) -> f64 {
    exact_with_amplitudes(block, noises, projected).0
}

/// The same, and the amplitudes.
fn exact_with_amplitudes(block: &Block, noises: &[Noise], projected: &Projected) -> (f64, DVector<f64>) {
    let nothing = || (f64::NEG_INFINITY, DVector::zeros(projected.columns.len()));
    let space = block.space(noises);
    let columns: Vec<&[f64]> =
        std::iter::once(&projected.data).chain(&projected.columns).map(Vec::as_slice).collect();
    let sums = match Steady::new(&space, &block.present) {
        Some(steady) => steady.sums(&columns),
        None => match Filter::new(&space, &block.present) {
            Some(filter) => Sums::of_whitened(&filter, &filter.whiten(&columns)),
            None => return nothing(),
        },
    };
    let solution = sums.solution();
    let best = sums.log_likelihood + solution.gain;
    if best.is_finite() { (best, solution.amplitudes) } else { nothing() }
}

/// What the regressors leave of the data, as data without regressors.
pub fn left_by(projected: &Projected, amplitudes: &DVector<f64>) -> Projected {
    let mut data = projected.data.clone();
    take_off(&mut data, &projected.columns, amplitudes.iter().copied());
    Projected { data, places: Vec::new(), columns: Vec::new() }
}

/// The maximum of Whittle's likelihood over `knobs` of one source from the noises given; noises and log-likelihood.
pub fn whittle(block: &Block, one: &OneSource, noises: &[Noise], knobs: &[SourceKnob]) -> (Vec<Noise>, f64) {
    let start = logs_of(noises, knobs);
    let (step_s, rows) = (block.step_s(), block.rows());
    let cost = |logs: &[f64]| {
        let beyond = outside(knobs, logs, step_s, rows);
        100.0 * beyond - one_source_likelihood(one, noises, knobs, logs)
    };
    let iterations = ITERATIONS * knobs.len() as u64;
    let (best, cost) = simplex(&start, &vec![SIDE; start.len()], SPREAD, iterations, cost);
    (with_logs(noises, knobs, &best), -cost)
}

/// The maximum of Whittle's likelihood over `knobs` of all sources of a block, from the noises given.
pub fn whittle_jointly(
    block: &Block,
    spectrum: &Spectrum,
    noises: &[Noise],
    knobs: &[SourceKnob],
) -> Vec<Noise> {
    let (step_s, rows) = (block.step_s(), block.rows());
    let cost = |logs: &[f64]| {
        100.0 * outside(knobs, logs, step_s, rows)
            - spectrum.log_likelihood(block, &with_logs(noises, knobs, logs))
    };
    let (sides, iterations) = (vec![SIDE; knobs.len()], ITERATIONS * knobs.len() as u64);
    // A simplex that has gone flat in a curved valley goes on from there with a new one.
    let once = |start: &[f64]| simplex(start, &sides, SPREAD, iterations, cost).0;
    with_logs(noises, knobs, &once(&once(&logs_of(noises, knobs))))
}

/// Whittle's log-likelihood with the logarithms of `knobs`, all of one source.
fn one_source_likelihood(one: &OneSource, noises: &[Noise], knobs: &[SourceKnob], logs: &[f64]) -> f64 {
    let Some(&(source, _)) = knobs.first() else { return f64::NEG_INFINITY };
    one.log_likelihood(&one_with_logs(&noises[source], knobs, logs))
}

/// The noise of a source with the logarithms of the given parameters, all its own.
pub fn one_with_logs(noise: &Noise, knobs: &[SourceKnob], logs: &[f64]) -> Noise {
    let mut noise = noise.clone();
    for (&(_, knob), log) in knobs.iter().zip(logs) {
        noise.set(knob, log.exp());
    }
    noise
}

/// Where Newton's steps on Whittle's likelihood, and on what the readings tell beside, lead from some logarithms of `knobs`, and what they
/// gain there; `None` where the noises are singular.
fn climbed(
    observations: Observations<'_>,
    noises: &[Noise],
    knobs: &[SourceKnob],
    from: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let Observations { block, spectrum, .. } = observations;
    let (step_s, rows) = (block.step_s(), block.rows());
    let likelihood = |logs: &[f64]| {
        let beyond = outside(knobs, logs, step_s, rows);
        let noises = with_logs(noises, knobs, logs);
        let told = observations.beside_residuals(&noises);
        (spectrum.log_likelihood(block, &noises) + told - 100.0 * beyond, ())
    };
    let mut logs = from.to_vec();
    let start = likelihood(&logs).0;
    let mut here = start;
    for _ in 0..NEWTON {
        let here_are = with_logs(noises, knobs, &logs);
        let Derivatives { mut slopes, mut curvature } =
            spectrum.derivatives(block, &here_are, knobs, STEP)?;
        if let Some(beside) = observations.derivatives_beside(&here_are, knobs) {
            slopes += beside.slopes;
            curvature += beside.curvature;
        }
        let step = newton_step(curvature, &slopes);
        if 0.5 * slopes.dot(&step) < PROMISE {
            break;
        }
        let Some(ahead) = ahead(&logs, &step, here, likelihood) else { break };
        (logs, here) = (ahead.logs, ahead.log_likelihood);
    }
    (here - start).is_finite().then_some((logs, here - start))
}

/// A spectrum does not tell a white level from another one in part of the rows: of the logarithm of their ratio the record tells as much as of
/// that of the level in these rows, whatever the other levels are.
fn tell_levels_apart(information: &mut DMatrix<f64>, knobs: &[SourceKnob]) {
    for (ratio, &(source, _)) in knobs.iter().enumerate().filter(|(_, (_, knob))| *knob == Knob::StepRatio) {
        let own = information[(ratio, ratio)];
        for (other, knob) in knobs.iter().enumerate().filter(|(other, _)| *other != ratio) {
            let both = if *knob == (source, Knob::White) { own } else { 0.0 };
            information[(ratio, other)] = both;
            information[(other, ratio)] = both;
        }
    }
}

/// Newton's step, which takes some information about every combination of parameters for granted.
fn newton_step(information: DMatrix<f64>, slopes: &DVector<f64>) -> DVector<f64> {
    let eigen = information.symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|value| value.max(LEAST_INFORMATION).recip());
    &eigen.eigenvectors * inverse.component_mul(&(eigen.eigenvectors.transpose() * slopes))
}

/// A place with a larger likelihood.
struct Ahead<T> {
    logs: Vec<f64>,
    log_likelihood: f64,
    /// What the likelihood was told with.
    with: T,
    /// Whether it is a whole step away.
    whole: bool,
}

/// Along a step, or a part of it, to where the likelihood is larger than `here`; `None` where it is not.
fn ahead<T>(
    logs: &[f64],
    step: &DVector<f64>,
    here: f64,
    likelihood: impl Fn(&[f64]) -> (f64, T),
) -> Option<Ahead<T>> {
    let mut scale = (MOST_STEP / step.amax()).min(1.0);
    for _ in 0..4 {
        let next: Vec<f64> = logs.iter().zip(step.iter()).map(|(log, step)| log + scale * step).collect();
        let (log_likelihood, with) = likelihood(&next);
        if log_likelihood > here {
            return Some(Ahead { logs: next, log_likelihood, with, whole: scale == 1.0 });
        }
        scale *= 0.3;
    }
    None
}

/// What noises of a block are fitted to.
#[derive(Clone, Copy)]
pub struct Observations<'o> {
    /// The block.
    pub block: &'o Block,
    /// Spectrum of its residual.
    pub spectrum: &'o Spectrum,
    /// Its data and regressors.
    pub projected: &'o Projected,
    /// What its readings tell beside the residuals, if they are redundant.
    pub common: Option<&'o CommonMotion>,
}

impl Observations<'_> {
    /// What the readings tell of noises beside the residuals, log-likelihood up to a constant.
    pub fn beside_residuals(&self, noises: &[Noise]) -> f64 {
        self.common.map_or(0.0, |common| common.beside_residual(noises))
    }

    /// Derivatives of that by the logarithms of `knobs`; `None` where there are no such readings, or they are not finite.
    pub fn derivatives_beside(&self, noises: &[Noise], knobs: &[SourceKnob]) -> Option<Derivatives> {
        self.common?.derivatives(noises, knobs, STEP)
    }
}

/// The maximum of the exact likelihood over `knobs`, from noises near it; curvatures from Whittle's. Residuals of redundant sensors do not
/// tell whose the noise is: there it is the maximum of what they and the readings tell together. Where it stays below `least` by all that is
/// seen on the way, it is left before it is reached. `known` are the log-likelihood of the residuals and the amplitudes at the noises given,
/// where they are known.
pub fn polish(
    observations: Observations<'_>,
    noises: &[Noise],
    knobs: &[SourceKnob],
    least: f64,
    known: Option<(f64, DVector<f64>)>,
) -> NoiseFit {
    let Observations { block, spectrum, projected, .. } = observations;
    let (step_s, rows) = (block.step_s(), block.rows());
    let penalty = |logs: &[f64]| 100.0 * outside(knobs, logs, step_s, rows);
    let likelihood = |logs: &[f64]| {
        let noises = with_logs(noises, knobs, logs);
        let (best, amplitudes) = exact_with_amplitudes(block, &noises, projected);
        (best + observations.beside_residuals(&noises) - penalty(logs), amplitudes)
    };
    let mut logs = logs_of(noises, knobs);
    let (mut here, mut amplitudes) = match known {
        Some((best, amplitudes)) => {
            (best + observations.beside_residuals(noises) - penalty(&logs), amplitudes)
        }
        None => likelihood(&logs),
    };
    // At its maximum over the regressors' amplitudes the likelihood changes with the noise as it does at these amplitudes: its
    // derivatives ask for one column to be whitened, however many regressors there are.
    let at_amplitudes = |logs: &[f64], left: &Projected| {
        let noises = with_logs(noises, knobs, logs);
        exact(block, &noises, left) + observations.beside_residuals(&noises) - penalty(logs)
    };
    let fit_at = |logs: &[f64], here: f64| NoiseFit {
        noises: with_logs(noises, knobs, logs),
        log_likelihood: here + penalty(logs),
    };
    if here == f64::NEG_INFINITY {
        return NoiseFit { noises: noises.to_vec(), log_likelihood: here };
    }
    let alone = (knobs.first().filter(|first| knobs.iter().all(|knob| knob.0 == first.0)))
        .and_then(|&(source, _)| spectrum.one_source(block, noises, source));
    let redundant = block.channels >= SEVERAL_CHANNELS;
    let several = redundant && alone.is_none();
    // Each derivative by one of the parameters is a run over the record; Whittle's likelihood costs next to nothing beside it.
    if several && let Some((near, gained)) = climbed(observations, noises, knobs, &logs) {
        if here + DOUBTED * gained + FAR_NATS < least {
            return fit_at(&logs, here);
        }
        if gained > WORTH_MOVING {
            let (there, with) = likelihood(&near);
            if there > here {
                (logs, here, amplitudes) = (near, there, with);
            }
        }
    }
    for _ in 0..NEWTON {
        let by_differences = || {
            curvature(&logs, STEP, |logs| match &alone {
                Some(one) => -one_source_likelihood(one, noises, knobs, logs),
                None => -spectrum.log_likelihood(block, &with_logs(noises, knobs, logs)),
            })
        };
        let closed = several
            .then(|| spectrum.derivatives(block, &with_logs(noises, knobs, &logs), knobs, STEP))
            .flatten()
            .map(|derivatives| derivatives.curvature);
        let mut information = closed.unwrap_or_else(by_differences);
        if let Some(beside) = observations.derivatives_beside(&with_logs(noises, knobs, &logs), knobs) {
            information += beside.curvature;
        }
        let size = logs.len();
        let mut gradient = DVector::zeros(size);
        let left = left_by(projected, &amplitudes);
        let moved = |place: usize| {
            let mut moved = logs.clone();
            moved[place / 2] += if place.is_multiple_of(2) { STEP } else { -STEP };
            at_amplitudes(&moved, &left)
        };
        let moved: Vec<f64> = (0..2 * size).into_par_iter().map(moved).collect();
        for (axis, moved) in moved.chunks_exact(2).enumerate() {
            let (up, down) = (moved[0], moved[1]);
            gradient[axis] =
                if up.is_finite() && down.is_finite() { (up - down) / (2.0 * STEP) } else { 0.0 };
            // The exact likelihood's own curvature along the axis, where it is larger.
            let own = (2.0 * here - up - down) / (STEP * STEP);
            if own.is_finite() && own > information[(axis, axis)] {
                information[(axis, axis)] = own;
            }
        }
        tell_levels_apart(&mut information, knobs);
        let step = newton_step(information, &gradient);
        let promised = 0.5 * gradient.dot(&step);
        if promised < PROMISE || here + DOUBTED * promised < least {
            break;
        }
        let Some(ahead) = ahead(&logs, &step, here, likelihood) else { break };
        let unforeseen = (ahead.log_likelihood - here - promised).abs();
        (logs, here, amplitudes) = (ahead.logs, ahead.log_likelihood, ahead.with);
        // A whole step that gained what it promised has led to the top.
        if redundant && ahead.whole && unforeseen < PROMISE {
            break;
        }
    }
    fit_at(&logs, here)
}

/// Second derivatives of `cost`.
pub fn curvature(at: &[f64], step: f64, cost: impl Fn(&[f64]) -> f64) -> DMatrix<f64> {
    let size = at.len();
    let moved = |i: usize, by_i: f64, j: usize, by_j: f64| {
        let mut moved = at.to_vec();
        moved[i] += by_i;
        moved[j] += by_j;
        let cost = cost(&moved);
        if cost.is_finite() { cost } else { IMPOSSIBLE }
    };
    let here = moved(0, 0.0, 0, 0.0);
    let mut curvature = DMatrix::zeros(size, size);
    for i in 0..size {
        for j in 0..=i {
            let value = if i == j {
                (moved(i, step, i, 0.0) + moved(i, -step, i, 0.0) - 2.0 * here) / (step * step)
            } else {
                let plus = moved(i, step, j, step) + moved(i, -step, j, -step);
                (plus - moved(i, step, j, -step) - moved(i, -step, j, step)) / (4.0 * step * step)
            };
            curvature[(i, j)] = value;
            curvature[(j, i)] = value;
        }
    }
    curvature
}
