//! Standard deviations where the innovations are not what the model says.
//!
//! The covariance of generalised least squares, G⁻¹ with G = XᵀX of whitened regressors, holds where the innovations e are
//! white with variance 1. What the noise model leaves (colour, a level that changes) makes it too small, for a lever arm
//! by several times. An estimate's error is the sum over the rows of u = (G⁻¹Xᵀ)e, so that its variance is the sum of the
//! autocovariances of u whatever e is: the sandwich of White (1982) and Newey & West (1987), with the number of lags that
//! Andrews (1991) gives for Bartlett's weights.
//!
//! Regressors are those of all amplitudes, and the derivatives by the parameters in which the term is not linear and by
//! the delay that moves it.
use nalgebra::{DMatrix, DVector};

use crate::catalogue::{OnsetShape, Search};
use crate::description::{Delays, Term, remainder};
use crate::least_squares::{dot, solve};
use crate::state::{Bench, Case, State};

/// Step of a derivative, as a part of the parameter, and for a frequency as a part of the record's resolution.
const STEP: f64 = 1e-3;
const FREQUENCY_STEP: f64 = 0.02;
/// Fewest rows, by their weights, from which a variance is taken: of fewer it is itself too uncertain.
const FEWEST_ROWS: f64 = 30.0;
/// Largest correlation from row to row of which lags are reckoned.
const MOST_CORRELATION: f64 = 0.97;
/// Most lags, as a part of the rows.
const MOST_LAGS: f64 = 0.1;

/// Variances of one estimate.
#[derive(Clone, Copy, Debug)]
pub struct Variance {
    /// Under the model, beside everything that is fitted, the delay that moves it as well.
    pub of_model: f64,
    /// By how much what is left widens it, at least 1.
    pub widened: f64,
}

/// Whitened regressors of a block by their places among all parameters; its residual stands beside them.
type Regressors = Vec<(usize, Vec<f64>)>;

/// Variances of a term's amplitudes and of the parameters in which it is not linear.
pub fn variances(case: &Case<'_>, state: &State, place: usize) -> (Vec<Variance>, Vec<Option<Variance>>) {
    let model = case.model;
    let term = &state.terms[place];
    let bench = Bench::new(case, &state.terms, &state.noises);
    let amplitudes = &bench.solution.amplitudes;
    let linear = amplitudes.len();
    // Parameters by which it is derived: term, axis.
    let mut by: Vec<(usize, usize)> = Vec::new();
    let smooth = |term: &Term| {
        let step = matches!(case.candidates[term.candidate].search, Search::Onset(OnsetShape::Step));
        !step && term.nonlinear.iter().all(|&value| value != 0.0)
    };
    if smooth(term) {
        by.extend((0..term.nonlinear.len()).map(|axis| (place, axis)));
    }
    let own = by.len();
    for (other, delay) in state.terms.iter().enumerate() {
        if other != place && smooth(delay) && Delays::new(std::slice::from_ref(delay)).move_term(term) {
            by.push((other, 0));
        }
    }
    let size = linear + by.len();
    let mut normal = DMatrix::zeros(size, size);
    let mut blocks: Vec<(Regressors, Vec<f64>)> = Vec::new();
    for (index, whitened) in bench.blocks.iter().enumerate() {
        let (Some(whitened), Some(filter)) = (whitened, &bench.filters.of_block[index]) else { continue };
        let [data, columns @ ..] = whitened.columns.as_slice() else { continue };
        let mut left = data.clone();
        let mut regressors: Regressors = Vec::new();
        for (&at, column) in bench.places[index].iter().zip(columns) {
            left.iter_mut().zip(column).for_each(|(left, value)| *left -= amplitudes[at] * value);
            regressors.push((at, column.clone()));
        }
        for (number, &(moved, axis)) in by.iter().enumerate() {
            let without = |by: f64| {
                let mut terms = state.terms.clone();
                let mut point = terms[moved].nonlinear.clone();
                point[axis] += by;
                let candidate = &case.candidates[terms[moved].candidate];
                terms[moved] = terms[moved].at(candidate, &point, case.time_s);
                remainder(model, index, &terms, amplitudes)
            };
            let step = step_of(case, &state.terms[moved], axis);
            let derivative: Vec<f64> = (without(-step).iter().zip(without(step)))
                .map(|(before, after)| (before - after) / (2.0 * step))
                .map(|slope| if slope.is_finite() { slope } else { 0.0 })
                .collect();
            if derivative.iter().any(|&slope| slope != 0.0) {
                regressors.push((linear + number, filter.whiten(&[&derivative]).swap_remove(0)));
            }
        }
        for (i, a) in &regressors {
            for (j, b) in &regressors {
                normal[(*i, *j)] += dot(a, b);
            }
        }
        blocks.push((regressors, left));
    }
    if size == 0 {
        return (Vec::new(), vec![None; term.nonlinear.len()]);
    }
    let covariance = solve(&normal, &DVector::zeros(size)).covariance;
    let variance = |parameter: usize| {
        let (mut errors, mut weights) = (vec![0.0; model.rows], vec![0.0; model.rows]);
        for (regressors, left) in &blocks {
            let mut gain = vec![0.0; left.len()];
            for (at, column) in regressors {
                let weight = covariance[(parameter, *at)];
                gain.iter_mut().zip(column).for_each(|(gain, value)| *gain += weight * value);
            }
            for (flat, (gain, left)) in gain.iter().zip(left).enumerate() {
                errors[flat % model.rows] += gain * left;
                weights[flat % model.rows] += gain * gain;
            }
        }
        let of_model = covariance[(parameter, parameter)].max(0.0);
        let rows = weights.iter().sum::<f64>().powi(2) / weights.iter().map(|w| w * w).sum::<f64>();
        let ratio = long_run_variance(&errors) / of_model;
        let widened = if rows >= FEWEST_ROWS && ratio.is_finite() { ratio.max(1.0) } else { 1.0 };
        Variance { of_model, widened }
    };
    let first = model.constants.len() + state.terms[..place].iter().map(Term::amplitudes).sum::<usize>();
    let of_amplitudes = (first..first + term.amplitudes()).map(variance).collect();
    let of_nonlinear =
        (0..term.nonlinear.len()).map(|axis| (axis < own).then(|| variance(linear + axis))).collect();
    (of_amplitudes, of_nonlinear)
}

/// Step of the derivative by a parameter.
fn step_of(case: &Case<'_>, term: &Term, axis: usize) -> f64 {
    let length_s = case.time_s.last().copied().unwrap_or(1.0).max(f64::MIN_POSITIVE);
    match case.candidates[term.candidate].search {
        Search::Frequency => FREQUENCY_STEP / length_s,
        Search::Onset(_) => case.model.step_s,
        _ => STEP * term.nonlinear[axis].abs(),
    }
}

/// Variance of the sum of a series: its autocovariances under Bartlett's weights.
fn long_run_variance(series: &[f64]) -> f64 {
    let product = |lag: usize| -> f64 {
        let later = series.get(lag..).unwrap_or_default();
        dot(&series[..later.len()], later)
    };
    let square = product(0);
    if square <= 0.0 {
        return 0.0;
    }
    let rows = series.iter().filter(|&&value| value != 0.0).count() as f64;
    let correlation = (product(1) / square).clamp(-MOST_CORRELATION, MOST_CORRELATION);
    let alpha = 4.0 * correlation.powi(2) / (1.0 - correlation.powi(2)).powi(2);
    let lags = (1.1447 * (alpha * rows).cbrt()).min(MOST_LAGS * rows) as usize;
    let weighted = (1..=lags).map(|lag| 2.0 * (1.0 - lag as f64 / (lags + 1) as f64) * product(lag));
    square + weighted.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::long_run_variance;

    /// AR(1) with coefficient φ has a sum whose variance is (1 + φ)/(1 − φ) times that of white noise of its level.
    #[test]
    fn the_variance_of_a_sum_counts_its_colour() {
        let (rows, phi) = (20_000, 0.7_f64);
        let mut random = Pcg64::seed_from_u64(1);
        let mut state = 0.0;
        let series: Vec<f64> = (0..rows)
            .map(|_| {
                let noise: f64 = StandardNormal.sample(&mut random);
                state = phi * state + noise;
                state
            })
            .collect();
        let white: f64 = series.iter().map(|value| value * value).sum();
        let expected = (1.0 + phi) / (1.0 - phi);
        assert!((long_run_variance(&series) / white / expected - 1.0).abs() < 0.2);
    }
}
