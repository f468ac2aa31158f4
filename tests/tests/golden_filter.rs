//! Golden numbers of the error filter: record K1 through filters that are tuned and mis-tuned.

use schuler_core::filter::{DiscreteModel, ErrorFilter, FilterConfig, Kernel};
use schuler_tests::golden_records::{Flight, mistuned, record_k1, scenario_r1};

const ARCSECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;

struct Run {
    log_likelihood: f64,
    end: [f64; 4],
    sigma: [f64; 4],
    /// NEES of δ, share outside 3σ, RMSE of δ in arc seconds, all after the first quarter.
    consistency: [f64; 3],
}

fn run(config: &FilterConfig<f64>, flight: &Flight) -> Run {
    let mut filter = ErrorFilter::with_model(config, DiscreteModel::third_order(config), config.prior());
    let mut log_likelihood = 0.0;
    let (mut nees, mut outside, mut square, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (k, (truth, &z)) in flight.truth.iter().zip(&flight.measured).enumerate() {
        let step = filter.step(Some(z));
        assert!(!step.gated && !step.reset);
        log_likelihood += step.innovation.log_likelihood();
        if k >= flight.truth.len() / 4 {
            let error = filter.state().mean[1] - truth[1];
            let normalised = error * error / filter.state().variances()[1];
            nees += normalised;
            outside += f64::from(normalised > 9.0);
            square += error * error;
            count += 1.0;
        }
    }
    Run {
        log_likelihood,
        end: filter.state().mean,
        sigma: filter.state().variances().map(f64::sqrt),
        consistency: [nees / count, outside / count, (square / count).sqrt() / ARCSECOND],
    }
}

#[track_caller]
fn assert_close(found: f64, golden: f64, relative: f64) {
    assert!((found - golden).abs() <= relative * golden.abs(), "found {found:.10e}, golden {golden:.10e}");
}

#[test]
fn fil_7_record_k1_is_the_golden_record() {
    let flight = record_k1();
    let golden = [-0.009924023, 0.083134697, 0.043607948, 0.177473599, -0.010746510];
    for (found, golden) in flight.measured.iter().zip(golden) {
        assert!((found - golden).abs() < 1e-9, "{found} {golden}");
    }
    assert_close(flight.measured[21_599], -9.784849536, 1e-9);
    let end = flight.truth[21_599];
    for (found, golden) in end.into_iter().zip([-9.799552462, 2.796664847e-3, -7.367754e-4, -1.233820e-7]) {
        assert_close(found, golden, 1e-6);
    }
}

#[test]
fn fil_3_filter_reproduces_the_golden_table() {
    let flight = record_k1();
    let truth = scenario_r1();
    let low = mistuned(&truth, [0.1; 2], [0.1; 2]);
    let high = mistuned(&truth, [10.0; 2], [0.1; 2]);
    #[rustfmt::skip]
    let table = [
        (truth, 38468.53320, [-9.7915115, 2.796670e-3, -2.712617e-4, 1.379912e-8],
         [7.197764e-5, 8.858363e-4, 2.738028e-7], [1.036551, 0.011481, 15.115349]),
        (low, 37201.55404, [-9.7758159, 2.812297e-3, 1.850195e-4, -1.817460e-8],
         [3.169292e-5, 2.935779e-4, 4.510743e-8], [13.586552, 0.432778, 24.095864]),
        (high, -6468.38261, [-9.7913058, 2.786448e-3, -3.099394e-8, -1.060676e-8],
         [3.830369e-6, 3.101123e-5, 1.515854e-8], [1718.4336, 0.916667, 32.751569]),
    ];
    for (config, log_likelihood, end, sigma, consistency) in table {
        let run = run(&config, &flight);
        assert_close(run.log_likelihood, log_likelihood, 1e-6);
        // Seven digits are given: half a unit in the last one is the tolerance.
        for (found, golden) in run.end.into_iter().zip(end) {
            assert_close(found, golden, 1e-6);
        }
        for (found, golden) in run.sigma[1..].iter().zip(sigma) {
            assert_close(*found, golden, 1e-6);
        }
        assert_close(run.consistency[0], consistency[0], 1e-6);
        assert!((run.consistency[1] - consistency[1]).abs() < 1e-6);
        assert_close(run.consistency[2], consistency[2], 1e-6);
    }
}

#[test]
fn fil_7_exact_discretisation_agrees_with_the_third_order_model() {
    let flight = record_k1();
    let config = scenario_r1();
    let published = run(&config, &flight);
    let mut exact = ErrorFilter::try_build(&config).unwrap();
    let mut square = 0.0;
    let mut count = 0.0;
    for (truth, &z) in flight.truth.iter().zip(&flight.measured).skip(0) {
        exact.step(Some(z));
        square += (exact.state().mean[1] - truth[1]).powi(2);
        count += 1.0;
    }
    let rmse = (square / count as f64).sqrt() / ARCSECOND;
    assert!(rmse < 1.05 * published.consistency[2], "{rmse}");
}
