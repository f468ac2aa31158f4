//! Golden numbers of the autocorrelation, of the two fits and of the choice between them.

use schuler_core::filter::{DiscreteModel, ErrorFilter, Kernel};
use schuler_core::identification::{
    SlidingAutocorrelation, Structure, choose_structure, compare, fit_exponential, fit_exponential_cosine,
};
use schuler_tests::golden_records::{MinimalStandard, mistuned, record_k1, scenario_r1};

#[track_caller]
fn assert_close(found: f64, golden: f64, relative: f64) {
    assert!((found - golden).abs() <= relative * golden.abs(), "found {found:.10e}, golden {golden:.10e}");
}

/// [FIL-11] over a whole series with zero mean.
fn autocorrelation(series: &[f64], lags: usize) -> Vec<f64> {
    let lagged = |j: usize| series[j..].iter().zip(series).map(|(a, b)| a * b).sum::<f64>();
    (0..=lags).map(|j| lagged(j) / (series.len() - j) as f64).collect()
}

fn first_order_series() -> Vec<f64> {
    let mut generator = MinimalStandard::new(12_345);
    let phi = (-10.0_f64 / 600.0).exp();
    let mut x = generator.normal();
    let mut next = || {
        x = phi * x + (1.0 - phi * phi).sqrt() * generator.normal();
        x
    };
    (0..4096).map(|_| next()).collect()
}

fn exponential_cosine_series() -> Vec<f64> {
    let mut generator = MinimalStandard::new(54_321);
    let (alpha, beta, step) = (1.0_f64 / 600.0, std::f64::consts::TAU / 1800.0, 10.0);
    let decay = (-alpha * step).exp();
    let (cosine, sine) = (decay * (beta * step).cos(), decay * (beta * step).sin());
    let driving = (1.0 - decay * decay).sqrt();
    let mut x = [generator.normal(), generator.normal()];
    let mut next = || {
        x = [cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]];
        x[0] += driving * generator.normal();
        x[1] += driving * generator.normal();
        x[0]
    };
    (0..4096).map(|_| next()).collect()
}

#[test]
fn fil_15_exponential_fit_of_the_golden_series() {
    let series = first_order_series();
    for (found, golden) in series.iter().zip([0.7325592248, 0.7782955219, 0.7786968871]) {
        assert_close(*found, golden, 1e-9);
    }
    let r = autocorrelation(&series, 400);
    for (lag, golden) in [(0, 0.696872734), (1, 0.6806621873), (10, 0.5432390771), (60, 0.1698597742)] {
        assert_close(r[lag], golden, 1e-8);
    }
    for (floor, tau, lags) in [(0.7, 405.671696, 13), (0.5, 391.059189, 26), (0.3, 378.257807, 45)] {
        let fit = fit_exponential(&r, 10.0, floor).unwrap();
        assert_eq!(fit.lags, lags);
        assert_close(1.0 / fit.alpha, tau, 1e-6);
        assert_close(fit.variance, 0.696872734, 1e-8);
    }
}

#[test]
fn fil_21_exponential_cosine_fit_of_the_golden_series() {
    let series = exponential_cosine_series();
    for (found, golden) in series.iter().zip([-0.3136693777, -0.1618400895, -0.3761139910]) {
        assert_close(*found, golden, 1e-9);
    }
    let r = autocorrelation(&series, 400);
    for (lag, golden) in [(0, 0.9559107138), (1, 0.938122808), (20, 0.5211547672)] {
        assert_close(r[lag], golden, 1e-8);
    }
    let cosine = fit_exponential_cosine(&r, 10.0).unwrap();
    assert_eq!((cosine.crossing_lag, cosine.lags), (46, 36));
    assert_close(cosine.crossing_s, 457.4531458, 1e-8);
    assert_close(cosine.beta, 0.00343378626, 1e-8);
    assert_close(cosine.alpha, 0.00180802782, 1e-8);
    let exponential = fit_exponential(&r, 10.0, 0.5).unwrap();
    assert_close(exponential.alpha, 0.00271767778, 1e-8);
}

#[test]
fn fil_18_structure_choice_on_the_golden_series() {
    let series = exponential_cosine_series();
    let r = autocorrelation(&series, 400);
    let Structure::ExponentialCosine(cosine, exponential, comparison) = choose_structure(&r, 10.0, 40_960.0)
    else {
        panic!("the exponential-cosine was not found")
    };
    assert_eq!(comparison, compare(&r, 10.0, 40_960.0, &exponential, &cosine));
    assert_close(comparison.exponential, 0.04734018, 1e-6);
    assert_close(comparison.exponential_cosine, 0.00193256, 2e-6);
    assert_close(comparison.depth, 2.3511, 1e-4);

    let r = autocorrelation(&first_order_series(), 400);
    assert!(matches!(choose_structure(&r, 10.0, 40_960.0), Structure::Exponential(_)));
}

#[test]
fn fil_11_and_fil_15_on_the_running_estimates_of_record_k1() {
    let flight = record_k1();
    let truth = scenario_r1();
    let low = mistuned(&truth, [0.1; 2], [0.1; 2]);
    let estimates = |config| {
        let mut filter = ErrorFilter::with_model(config, DiscreteModel::third_order(config), config.prior());
        let (mut a, mut w, mut p) = (Vec::new(), Vec::new(), [0.0; 2]);
        for (k, &z) in flight.measured.iter().enumerate() {
            filter.step(Some(z));
            if k >= 600 && k % 10 == 0 {
                let state = filter.state();
                a.push(state.mean[2]);
                w.push(state.mean[3]);
                p[0] += state.variances()[2];
                p[1] += state.variances()[3];
            }
        }
        let count = a.len() as f64;
        (autocorrelation(&a, 180), autocorrelation(&w, 180), p.map(|p| p / count))
    };

    let (a, w, p) = estimates(&truth);
    for (lag, golden) in [(0, 1.788081957e-7), (1, 1.528309634e-7), (5, 8.270565e-8), (10, 4.801640e-8)] {
        assert_close(a[lag], golden, 1e-6);
    }
    let fit = fit_exponential(&a, 10.0, 0.5).unwrap();
    assert_eq!(fit.lags, 4);
    assert_close(1.0 / fit.alpha, 63.938761, 1e-6);
    assert_close(p[0], 7.848203e-7, 1e-6);
    assert_close((fit.variance + p[0]).sqrt(), 9.816458e-4, 1e-6);

    assert_close(w[0], 2.159438639e-13, 1e-6);
    assert_close(w[1], 2.151817344e-13, 1e-6);
    let fit = fit_exponential(&w, 10.0, 0.5).unwrap();
    assert_eq!(fit.lags, 110);
    assert_close(1.0 / fit.alpha, 1865.18265, 1e-6);
    assert_close(p[1], 7.498784e-14, 1e-6);
    assert_close((fit.variance + p[1]).sqrt(), 5.393809e-7, 1e-6);

    let (a, w, p) = estimates(&low);
    let golden = [
        (&a, 4.524397317e-7, 1605.31471, 88, 7.341420e-4, p[0]),
        (&w, 2.213958870e-13, 3406.33548, 161, 4.727341e-7, p[1]),
    ];
    for (r, variance, tau, lags, sigma, mean_variance) in golden {
        let fit = fit_exponential(r, 10.0, 0.5).unwrap();
        assert_eq!(fit.lags, lags);
        assert_close(fit.variance, variance, 1e-6);
        assert_close(1.0 / fit.alpha, tau, 1e-6);
        assert_close((fit.variance + mean_variance).sqrt(), sigma, 1e-6);
    }
    let mut sliding = SlidingAutocorrelation::<f64, 4096, 181>::new(0.0);
    let mut filter = ErrorFilter::with_model(&low, DiscreteModel::third_order(&low), low.prior());
    for (k, &z) in flight.measured.iter().enumerate() {
        filter.step(Some(z));
        if k >= 600 && k % 10 == 0 {
            sliding.push(Some(filter.state().mean[2]));
        }
    }
    for (found, golden) in sliding.autocorrelation().into_iter().zip(&a) {
        assert!((found - golden).abs() < 1e-9 * a[0]);
    }
}
