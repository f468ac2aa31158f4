//! How often the structure of a directly measured series is chosen rightly, and how well its parameters are found.

use rayon::prelude::*;
use schuler_core::identification::{Structure, choose_structure, fit_exponential};
use schuler_tests::golden_records::MinimalStandard;

const SPACING_S: f64 = 10.0;
const RUNS: u64 = 600;
const LAGS: usize = 400;

/// A series of `hours` with R(t) = e^(−α|t|) cos βt, started stationary.
fn series(run: u64, alpha: f64, beta: f64, hours: f64) -> Vec<f64> {
    let mut generator = MinimalStandard::new(8_191 * (run + 1) + 3);
    for _ in 0..16 {
        generator.uniform();
    }
    let decay = (-alpha * SPACING_S).exp();
    let (sine, cosine) = (beta * SPACING_S).sin_cos();
    let driving = (1.0 - decay * decay).sqrt();
    let mut x = [generator.normal(), generator.normal()];
    let mut next = || {
        x = [
            decay * (cosine * x[0] - sine * x[1]) + driving * generator.normal(),
            decay * (sine * x[0] + cosine * x[1]) + driving * generator.normal(),
        ];
        x[0]
    };
    (0..(hours * 3600.0 / SPACING_S) as usize).map(|_| next()).collect()
}

/// [FIL-11] with zero mean.
fn autocorrelation(series: &[f64]) -> Vec<f64> {
    let lagged = |j: usize| series[j..].iter().zip(series).map(|(a, b)| a * b).sum::<f64>();
    (0..=LAGS.min(series.len() / 2)).map(|j| lagged(j) / (series.len() - j) as f64).collect()
}

fn share_chosen(alpha: f64, beta: f64, hours: f64) -> f64 {
    let chosen = (0..RUNS)
        .into_par_iter()
        .filter(|&run| {
            let r = autocorrelation(&series(run, alpha, beta, hours));
            matches!(choose_structure(&r, SPACING_S, hours * 3600.0), Structure::ExponentialCosine(..))
        })
        .count();
    chosen as f64 / RUNS as f64
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let square = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
    (mean, (square / values.len() as f64).sqrt())
}

#[test]
fn fil_18_the_structure_is_chosen_as_often_as_specified() {
    // 1 σ of a share near one half is 0.02 with 600 runs; the specified shares are themselves of that kind.
    let tau = std::f64::consts::TAU;
    let cases = [
        (1.0 / 600.0, tau / 1800.0, 5.0, 0.46),
        (1.0 / 600.0, tau / 1800.0, 10.0, 0.77),
        (1.0 / 600.0, tau / 1800.0, 30.0, 1.0),
        (1.0 / 300.0, tau / 600.0, 10.0, 1.0),
        (1.0 / 1200.0, tau / 900.0, 10.0, 1.0),
    ];
    for (alpha, beta, hours, specified) in cases {
        let share = share_chosen(alpha, beta, hours);
        println!(
            "α 1/{:.0}, β 2π/{:.0}, {hours} h: {share:.3}, specified {specified}",
            1.0 / alpha,
            tau / beta
        );
        assert!((share - specified).abs() < 0.08, "{share} {specified}");
    }
    for hours in [5.0, 10.0, 30.0] {
        let share = share_chosen(1.0 / 600.0, 0.0, hours);
        println!("first order, {hours} h: {share:.3} falsely");
        assert!(share <= 0.02 + 3.0 * (0.02 * 0.98 / RUNS as f64).sqrt());
    }
}

#[test]
fn fil_15_and_fil_21_parameters_are_as_good_as_specified() {
    let (alpha, beta) = (1.0 / 600.0, std::f64::consts::TAU / 1800.0);
    let fits: Vec<_> = (0..RUNS)
        .into_par_iter()
        .filter_map(|run| {
            // Where it was chosen: what a user gets to see.
            let r = autocorrelation(&series(run, alpha, beta, 10.0));
            match choose_structure(&r, SPACING_S, 36_000.0) {
                Structure::ExponentialCosine(fit, ..) => Some(fit),
                _ => None,
            }
        })
        .collect();
    let a = mean_and_deviation(&fits.iter().map(|fit| fit.alpha / alpha).collect::<Vec<_>>());
    let b = mean_and_deviation(&fits.iter().map(|fit| fit.beta / beta).collect::<Vec<_>>());
    println!("exponential-cosine, 10 h: α̂/α {:.3} ± {:.3}, β̂/β {:.3} ± {:.3}", a.0, a.1, b.0, b.1);
    // Specified: 1.01 ± 0.16 and 1.008 ± 0.10, without saying which runs of the 600 are in it; leaving out those
    // where the structure is not chosen moves the means by 0.06 and 0.03, so much is allowed.
    assert!((a.0 - 1.01).abs() < 0.06 && a.1 < 0.2);
    assert!((b.0 - 1.008).abs() < 0.03 && b.1 < 0.13);

    // A hundred correlation times.
    let logarithms: Vec<f64> = (0..RUNS)
        .into_par_iter()
        .filter_map(|run| {
            let r = autocorrelation(&series(run, 1.0 / 300.0, 0.0, 100.0 * 300.0 / 3600.0));
            fit_exponential(&r, SPACING_S, 0.5).map(|fit| (1.0 / fit.alpha / 300.0).ln())
        })
        .collect();
    let (mean, deviation) = mean_and_deviation(&logarithms);
    println!("first order, T/τ = 100: ln τ̂/τ {mean:.3} ± {deviation:.3}; the Cramér–Rao bound is 0.14");
    assert!(mean.abs() < 0.04 && deviation < 0.19);
}
