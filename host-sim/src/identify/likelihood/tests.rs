//! The likelihood against dense matrices, simulations and itself.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use nalgebra::SMatrix;

use super::*;

fn whole(values: &[f64]) -> Blocks {
    Blocks::new(values, 1)
}

const MARKOV: Parts = Parts { markov: 1, cosine: false, walk: false };

fn markov(white: f64, sigma: f64, alpha: f64) -> Parameters {
    let part = Correlated { sigma, alpha };
    Parameters { white, markov: [part, Correlated::default()], ..Parameters::default() }
}

fn simulate(parameters: &Parameters, count: usize, seed: u64) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let filter = Filter::new(parameters);
    let mut state = filter.covariance.diagonal().map(|variance| variance.sqrt() * normal());
    (0..count)
        .map(|_| {
            let value = observed(&state) + parameters.white * normal();
            filter.turn.apply(&mut state);
            state += filter.noise.map(|variance| variance.sqrt() * normal());
            value
        })
        .collect()
}

/// The likelihood by its definition: contrasts of the data, their covariance matrix, its determinant and inverse.
fn directly(values: &[f64], parameters: &Parameters) -> f64 {
    const N: usize = 8;
    const CONTRASTS: usize = N - 1;
    let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| {
        let lag = i.abs_diff(j) as f64;
        let part =
            |part: Correlated, beta: f64| part.sigma.powi(2) * (-part.alpha * lag).exp() * (beta * lag).cos();
        let markov: f64 = parameters.markov.into_iter().map(|markov| part(markov, 0.0)).sum();
        let correlated = markov + part(parameters.cosine, parameters.beta);
        let walk = parameters.walk.powi(2) * i.min(j) as f64;
        correlated + walk + if i == j { parameters.white.powi(2) } else { 0.0 }
    });
    // Rows of an orthonormal basis of the contrasts: differences of each value from the mean of those before.
    let contrasts = SMatrix::<f64, CONTRASTS, N>::from_fn(|i, j| {
        let k = (i + 1) as f64;
        let size = (k * (k + 1.0)).sqrt();
        if j <= i {
            1.0 / size
        } else if j == i + 1 {
            -k / size
        } else {
            0.0
        }
    });
    let contrasted = contrasts * SVector::<f64, N>::from_iterator(values.iter().copied());
    let covariance = contrasts * covariance * contrasts.transpose();
    let cholesky = covariance.cholesky().unwrap();
    let log_determinant: f64 = 2.0 * cholesky.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    let squares = contrasted.dot(&cholesky.solve(&contrasted));
    -0.5 * (CONTRASTS as f64 * std::f64::consts::TAU.ln() + log_determinant + squares)
}

#[test]
fn fil_16_the_filter_gives_the_restricted_likelihood_of_the_covariance_matrix() {
    let values = [0.3, -1.2, 0.8, 2.5, 1.9, -0.4, 0.0, 1.1];
    let first = Correlated { sigma: 1.3, alpha: 0.2 };
    let second = Correlated { sigma: 0.6, alpha: 0.01 };
    for parameters in [
        markov(0.7, 0.0, 0.0),
        markov(0.7, 1.3, 0.2),
        Parameters { cosine: first, beta: 0.9, walk: 0.4, ..markov(0.2, 0.0, 0.0) },
        Parameters { markov: [first, second], cosine: first, beta: 0.3, ..markov(0.2, 0.0, 0.0) },
    ] {
        let found =
            profile(&whole(&values), &parameters, Removed::Mean).unwrap().log_likelihood_of_scale_one();
        // Harville's likelihood differs from that of orthonormal contrasts by ½ ln det(XᵀX).
        let expected = directly(&values, &parameters) - 0.5 * 8.0_f64.ln();
        assert!((found - expected).abs() < 1e-10, "{found} {expected}");
    }
}

#[test]
fn a_filter_that_has_settled_computes_what_one_that_has_not_would() {
    let parameters =
        Parameters { cosine: Correlated { sigma: 0.5, alpha: 0.02 }, beta: 0.4, ..markov(1.0, 2.0, 0.1) };
    let (mut settling, mut always) = (Filter::new(&parameters), Filter::new(&parameters));
    let mut settled = 0;
    for row in 0..3000 {
        let present = row % 1000 != 999;
        settled += usize::from(settling.settled);
        always.settled = false;
        let (found, expected) = (settling.advance(present, 1.0), always.advance(present, 1.0));
        assert!((found.variance / expected.variance - 1.0).abs() < 1e-9, "row {row}");
        assert!((found.gain - expected.gain).amax() < 1e-9, "row {row}");
    }
    assert!(settled > 1000, "{settled}");
}

#[test]
fn known_parameters_lie_within_their_standard_deviations() {
    let truth = markov(1.0, 0.5, 1.0 / 60.0);
    let cases = 40;
    let mut scores = [0.0; 3];
    let mut outside = 0;
    for seed in 0..cases {
        let values = simulate(&truth, 8000, seed);
        let fit = fit(&whole(&values), MARKOV, Removed::Mean, &[markov(1.0, 1.0, 0.1)]).unwrap();
        let sigmas = fit.log_sigmas.unwrap();
        let score = [
            fit.parameters.white.ln() / sigmas.white,
            (fit.parameters.markov[0].sigma / 0.5).ln() / sigmas.markov[0].sigma,
            (fit.parameters.markov[0].alpha * 60.0).ln() / sigmas.markov[0].alpha,
        ];
        for (sum, score) in scores.iter_mut().zip(score) {
            *sum += score * score / f64::from(cases as u32);
            outside += u32::from(score.abs() > 3.0);
        }
    }
    println!(
        "mean squares of the standardised errors of white, sigma, alpha: {scores:?}, {outside} beyond 3"
    );
    assert!(scores.iter().all(|square| (0.5..1.8).contains(square)), "{scores:?}");
    assert!(outside <= 2);
}

#[test]
fn the_level_and_slope_are_as_uncertain_as_the_noise_makes_them() {
    let truth = markov(1.0, 1.0, 1.0 / 40.0);
    let cases = 60;
    let (mut level, mut slope) = (0.0, 0.0);
    for seed in 0..cases {
        let values: Vec<f64> = simulate(&truth, 3000, 100 + seed)
            .into_iter()
            .enumerate()
            .map(|(row, value)| value + 5.0 + 1e-3 * (row as f64 - 1499.5))
            .collect();
        let fit = fit(&whole(&values), MARKOV, Removed::Line, &[truth]).unwrap();
        level += ((fit.level.0 - 5.0) / fit.level.1).powi(2) / cases as f64;
        slope += ((fit.slope.0 - 1e-3) / fit.slope.1).powi(2) / cases as f64;
    }
    assert!((0.6..1.6).contains(&level) && (0.6..1.6).contains(&slope), "{level} {slope}");
}

/// Means of ten steps of white noise of which half are lost are as white as those of which none is.
#[test]
fn blocks_with_lost_rows_have_the_white_noise_of_whole_ones() {
    let values = simulate(&markov(1.0, 0.0, 0.0), 40_000, 7);
    let lost: Vec<f64> = values
        .iter()
        .enumerate()
        .map(|(row, &value)| if row * 7 % 16 < 8 { f64::NAN } else { value })
        .collect();
    let uneven: Vec<f64> = lost
        .iter()
        .enumerate()
        .map(|(row, &value)| if row / 500 % 2 == 0 { values[row] } else { value })
        .collect();
    for series in [&values, &lost, &uneven] {
        let fit = fit(&Blocks::new(series, 10), Parts::default(), Removed::Mean, &[]).unwrap();
        let sigma = fit.log_sigmas.unwrap().white;
        let off = (fit.parameters.white * 10_f64.sqrt()).ln();
        assert!(off.abs() < 3.5 * sigma, "{off} {sigma}");
    }
}

#[test]
fn series_without_spread_or_values_are_not_fitted() {
    let start = markov(1.0, 1.0, 0.1);
    assert!(fit(&whole(&[1.0; 100]), MARKOV, Removed::Mean, &[start]).is_none());
    assert!(fit(&whole(&[f64::NAN; 100]), MARKOV, Removed::Line, &[start]).is_none());
    assert!(fit(&whole(&[]), MARKOV, Removed::Mean, &[start]).is_none());
}
