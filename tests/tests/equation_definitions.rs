//! Equations that are proved by their definition: what the code returns satisfies them.
use schuler_core::filter::{DiscreteModel, MarkovNoise};
use schuler_core::health::HealthConfig;
use schuler_core::identification::{compare, fit_exponential, fit_exponential_cosine};

/// Spacing of the autocorrelations, s.
const SPACING_S: f64 = 10.0;

/// An autocorrelation that is neither of the two forms exactly: sums over lags do not cancel by accident.
fn rough(k: usize, beta: f64) -> f64 {
    let t = k as f64 * SPACING_S;
    2.5 * (-t / 400.0).exp() * (beta * t).cos() * (1.0 + 0.03 * (0.7 * k as f64).sin())
}

/// White noise of the level that the code gives makes the variance of the process: q τ/2 = σ², and over
/// a step that is short against τ the discrete noise is q Δ.
#[test]
fn fil_8_fil_9_level_of_the_driving_noise_gives_the_variance() {
    for (sigma, tau_s) in [(9.8e-4_f64, 60.0_f64), (4.8e-7, 3600.0)] {
        let noise = MarkovNoise { sigma, tau_s };
        let q = noise.spectral_level();
        assert!((q * tau_s / 2.0 / (sigma * sigma) - 1.0).abs() < 1e-14);
        // R(Δ) = σ² e^(−Δ/τ), and what the step adds: σ² (1 − e^(−2Δ/τ)) = q Δ (1 − Δ/τ + …).
        let other = MarkovNoise { sigma: 1.0, tau_s: 100.0 };
        let step = tau_s / 1000.0;
        let model = DiscreteModel::exact(6_371_000.0, 9.80665, &other, &noise, step);
        assert!((model.decay[1] - (-1e-3_f64).exp()).abs() < 1e-14);
        assert!((model.noise[9] / (q * step) - (1.0 - 1e-3)).abs() < 1e-6, "{}", model.noise[9] / (q * step));
    }
}

/// The misfits by which structures are compared are the paper's sums of squares, over the normalised correlation and the
/// number of lags.
#[test]
fn fil_10_fil_18_misfits_are_the_sums_of_squares() {
    let r: Vec<f64> = (0..400).map(|k| rough(k, 2.0e-3)).collect();
    let exponential = fit_exponential(&r, SPACING_S, 0.5).expect("a fit");
    let cosine = fit_exponential_cosine(&r, SPACING_S).expect("a fit");
    let found = compare(&r, SPACING_S, 4000.0, &exponential, &cosine);
    let lags = 3 * cosine.crossing_lag as usize;
    assert!(lags < r.len());
    let misfit = |model: &dyn Fn(f64) -> f64| {
        let square = |k: usize| (r[k] / r[0] - model(k as f64 * SPACING_S)).powi(2);
        (0..=lags).map(square).sum::<f64>() / (lags + 1) as f64
    };
    let first = misfit(&|t| (-exponential.alpha * t).exp());
    let second = misfit(&|t| (-cosine.alpha * t).exp() * (cosine.beta * t).cos());
    assert!((found.exponential / first - 1.0).abs() < 1e-12, "{} {first}", found.exponential);
    assert!((found.exponential_cosine / second - 1.0).abs() < 1e-12, "{} {second}", found.exponential_cosine);
}

/// The decay that is returned solves Σ ln r_j = −α Σ jΔ over the lags that were used, and those are the first run above the
/// floor.
#[test]
fn fil_14_decay_solves_the_log_linear_equation() {
    let r: Vec<f64> = (0..100).map(|k| rough(k, 1e-3)).collect();
    for floor in [0.2, 0.5, 0.8] {
        let fit = fit_exponential(&r, SPACING_S, floor).expect("a fit");
        let lags = r.iter().skip(1).take_while(|value| **value / r[0] > floor).count();
        assert_eq!(fit.lags as usize, lags);
        let (mut logarithms, mut times) = (0.0, 0.0);
        for (k, value) in r.iter().enumerate().take(lags + 1).skip(1) {
            logarithms += (value / r[0]).ln();
            times += k as f64 * SPACING_S;
        }
        assert!((logarithms + fit.alpha * times).abs() < 1e-12 * logarithms.abs(), "{floor}");
    }
}

/// The frequency has its quarter period at the crossing, which lies on the straight line between the lags beside it.
#[test]
fn fil_19_quarter_period_is_the_interpolated_crossing() {
    let r: Vec<f64> = (0..200).map(|k| rough(k, 4e-3)).collect();
    let fit = fit_exponential_cosine(&r, SPACING_S).expect("a fit");
    let k = r.iter().position(|value| *value <= 0.0).expect("a crossing");
    assert_eq!(fit.crossing_lag as usize, k);
    let share = (fit.crossing_s / SPACING_S) - (k - 1) as f64;
    assert!((r[k - 1] * (1.0 - share) + r[k] * share).abs() < 1e-12 * r[0], "{share}");
    assert!((fit.beta * fit.crossing_s - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
    assert_eq!(fit.variance, r[0]);
}

/// The decay that is returned solves Σ (ln r_j + α jΔ − ln cos β jΔ) = 0 over the lags that were used.
#[test]
fn fil_20_decay_solves_the_log_linear_equation() {
    let r: Vec<f64> = (0..200).map(|k| rough(k, 4e-3)).collect();
    let fit = fit_exponential_cosine(&r, SPACING_S).expect("a fit");
    let (mut rest, mut size, mut lags) = (0.0, 0.0, 0);
    for (k, value) in r.iter().enumerate().take(fit.crossing_lag as usize).skip(1) {
        let t = k as f64 * SPACING_S;
        let (correlation, cosine) = (value / r[0], (fit.beta * t).cos());
        if cosine > 0.3 && correlation > 0.05 {
            rest += correlation.ln() + fit.alpha * t - cosine.ln();
            size += (fit.alpha * t).abs();
            lags += 1;
        }
    }
    assert_eq!(fit.lags, lags);
    assert!(rest.abs() < 1e-12 * size, "{rest}");
}

/// The defaults are the specification's: a decay of 0.9048374180 a second, driving noises 0.12772718 and 0.38318154 m/s, modes
/// that last half an hour and two minutes, and a third level that is one of them.
#[test]
fn hlt_7_defaults_are_the_specified_ones() {
    let two = HealthConfig::<f64, 2>::doppler_against_inertial();
    let decay = (-two.step_s / two.radio.tau_s).exp();
    assert!((decay - 0.904_837_418_0).abs() < 1e-10);
    let driving = two.radio.sigma.map(|sigma| sigma * (1.0 - decay * decay).sqrt());
    for (found, expected) in driving.iter().zip([0.127_727_18, 0.383_181_54]) {
        assert!((found - expected).abs() < 5e-9, "{found}");
    }
    for chain in [two.radio.transition, two.jump.transition] {
        assert!((1.0 / chain[0][1] - 1800.0).abs() < 1e-9 && (1.0 / chain[1][0] - 120.0).abs() < 1e-9);
    }
    assert_eq!((two.jump.sigma, two.inertial.random_walk, two.inertial.initial_sigma), (0.9, 0.005, 0.5));
    assert_eq!((two.inertial.drift_sigma, two.residual_sigma * two.residual_sigma), (3e-4, 1e-4));
    assert_eq!((two.radio.initial, two.jump.initial), ([0.99, 0.01], [0.99, 0.01]));
    let three = HealthConfig::<f64, 3>::doppler_against_inertial_three_levels();
    assert_eq!((three.radio.sigma, three.radio.normal_levels), ([0.3, 0.9, 3.0], 1));
    for row in three.radio.transition {
        assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }
    assert!((three.radio.transition[0][1] / three.radio.transition[0][2] - 4.0).abs() < 1e-12);
}
