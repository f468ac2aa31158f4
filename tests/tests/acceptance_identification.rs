//! Acceptance of the identification: fifty flights from each mis-tuned start, and what the published loop does.
//!
//! The bars are the specification's. Seeds differ from those that anything was tried on while it was written.

use rayon::prelude::*;
use schuler_core::filter::{DiscreteModel, ErrorFilter, FilterConfig, Kernel, MarkovNoise};
use schuler_core::identification::{IdentificationOutput, fit_exponential};
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput};
use schuler_core::reading::Reading;
use schuler_tests::golden_records::{
    DEGREE_PER_HOUR, Flight, MinimalStandard, fly, fly_exponential_cosine, in_flight_precision, mistuned,
    scenario, scenario_r1,
};

const FLIGHTS: u64 = 50;
const HOUR: usize = 3600;

#[derive(Clone, Copy, Debug)]
enum Start {
    /// Rates and diffusions a tenth of the truth.
    Low,
    /// Rates ten times the truth, diffusions a tenth.
    High,
    /// Each of the four off by a factor from a tenth to ten.
    Random,
}

/// NEES, share beyond 3σ and RMSE of δ.
#[derive(Clone, Copy, Debug, Default)]
struct Consistency {
    nees: f64,
    outside: f64,
    square: f64,
    count: f64,
}

impl Consistency {
    fn add(&mut self, error: f64, variance: f64) {
        self.nees += error * error / variance;
        self.outside += f64::from(error * error > 9.0 * variance);
        self.square += error * error;
        self.count += 1.0;
    }

    fn nees(&self) -> f64 {
        self.nees / self.count
    }

    fn outside(&self) -> f64 {
        self.outside / self.count
    }

    fn rmse(&self) -> f64 {
        (self.square / self.count).sqrt()
    }
}

/// What one flight showed over three hours.
struct Result {
    averaged: Consistency,
    true_tuned: Consistency,
    mistuned: Consistency,
    found: IdentificationOutput,
    retuned: Option<usize>,
}

fn start_config(
    truth: &FilterConfig<f64>,
    start: Start,
    generator: &mut MinimalStandard,
) -> FilterConfig<f64> {
    let mut factor = || 10f64.powf(2.0 * generator.uniform() - 1.0);
    match start {
        Start::Low => mistuned(truth, [0.1; 2], [0.1; 2]),
        Start::High => mistuned(truth, [10.0; 2], [0.1; 2]),
        Start::Random => mistuned(truth, [factor(), factor()], [factor(), factor()]),
    }
}

/// Flies the module; the three hours begin at the first retuning after `not_before` steps.
fn fly_module(
    truth: &FilterConfig<f64>,
    believed: &FilterConfig<f64>,
    flight: &Flight,
    not_before: usize,
) -> Result {
    let filter = in_flight_precision(believed);
    let mut module = Box::new(FlightModule::new());
    module.configure(&ModuleConfig { filter, ..ModuleConfig::default() }).unwrap();
    let mut tuned = ErrorFilter::try_build(truth).unwrap();
    let mut untouched = ErrorFilter::try_build(believed).unwrap();
    let mut result = Result {
        averaged: Consistency::default(),
        true_tuned: Consistency::default(),
        mistuned: Consistency::default(),
        found: IdentificationOutput::default(),
        retuned: None,
    };
    for (k, (x, &z)) in flight.truth.iter().zip(&flight.measured).enumerate() {
        tuned.step(Some(z));
        untouched.step(Some(z));
        let output = module.step(&StepInput {
            time_ms: 1000 * (k as u64 + 1),
            velocity_error: Reading::good(z as f32),
            ..StepInput::default()
        });
        if output.status.contains(Status::RETUNED) && k >= not_before && result.retuned.is_none() {
            result.retuned = Some(k);
        }
        result.found = output.identification;
        if result.retuned.is_some_and(|retuned| k - retuned < 3 * HOUR) {
            let averaged = &output.identification.averaged;
            let sigma = f64::from(averaged.sigma[1]);
            result.averaged.add(f64::from(averaged.estimate[1]) - x[1], sigma * sigma);
            result.true_tuned.add(tuned.state().mean[1] - x[1], tuned.state().variances()[1]);
            result.mistuned.add(untouched.state().mean[1] - x[1], untouched.state().variances()[1]);
        }
    }
    result
}

fn campaign(
    truth: &FilterConfig<f64>,
    start: Start,
    hours: usize,
    not_before: usize,
    seed: u64,
) -> Vec<Result> {
    let one = |run| {
        let mut generator = MinimalStandard::new(seed + 7_919 * run);
        for _ in 0..16 {
            generator.uniform();
        }
        let believed = start_config(truth, start, &mut generator);
        let flight = fly(truth, hours * HOUR, || generator.normal());
        fly_module(truth, &believed, &flight, not_before)
    };
    (0..FLIGHTS).into_par_iter().map(one).collect()
}

fn mean(results: &[Result], f: impl Fn(&Result) -> f64) -> f64 {
    results.iter().map(f).sum::<f64>() / results.len() as f64
}

fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// ln of found over true: σ_a, τ_a, σ_w, τ_w.
fn off(result: &Result, truth: &FilterConfig<f64>) -> [f64; 4] {
    let (a, w) = (&result.found.accelerometer.noise, &result.found.gyro.noise);
    let ln = |found: f32, truth: f64| (f64::from(found) / truth).ln();
    [
        ln(a.sigma, truth.accelerometer.sigma),
        -ln(a.alpha, 1.0 / truth.accelerometer.tau_s),
        ln(w.sigma, truth.gyro.sigma),
        -ln(w.alpha, 1.0 / truth.gyro.tau_s),
    ]
}

fn report(name: &str, results: &[Result], truth: &FilterConfig<f64>) {
    let ratio = |r: &Result| r.averaged.rmse() / r.true_tuned.rmse();
    println!(
        "{name}: NEES {:.3}, outside {:.4}, RMSE ratio {:.3}, worst {:.3} | true-tuned NEES {:.3} | \
         mis-tuned NEES {:.1}, outside {:.2}, RMSE ratio {:.2}",
        mean(results, |r| r.averaged.nees()),
        mean(results, |r| r.averaged.outside()),
        mean(results, ratio),
        results.iter().map(ratio).fold(0.0, f64::max),
        mean(results, |r| r.true_tuned.nees()),
        mean(results, |r| r.mistuned.nees()),
        mean(results, |r| r.mistuned.outside()),
        mean(results, |r| r.mistuned.rmse() / r.true_tuned.rmse()),
    );
    let column = |i: usize| results.iter().map(|r| off(r, truth)[i]).collect::<Vec<_>>();
    println!(
        "    ln found/true of σ_a τ_a σ_w τ_w: median {:.2?}, 90 % within {:.2?}",
        [0, 1, 2, 3].map(|i| quantile(column(i), 0.5)),
        [0, 1, 2, 3].map(|i| quantile(column(i).into_iter().map(f64::abs).collect(), 0.9)),
    );
}

#[test]
fn fil_15_level_b_meets_its_bars_from_every_start() {
    let truth = scenario_r1();
    for (start, seed) in [(Start::Low, 4_001), (Start::High, 600_011), (Start::Random, 9_000_011)] {
        let results = campaign(&truth, start, 7, 0, seed);
        report(&format!("R1 {start:?}"), &results, &truth);
        assert!(results.iter().all(|r| r.retuned.is_some_and(|k| k < 5 * HOUR)));
        let nees = mean(&results, |r| r.averaged.nees());
        assert!((0.9..=1.3).contains(&nees), "NEES {nees}");
        assert!(mean(&results, |r| r.averaged.outside()) <= 0.015);
        let ratio = |r: &Result| r.averaged.rmse() / r.true_tuned.rmse();
        assert!(mean(&results, ratio) <= 1.05, "RMSE ratio {}", mean(&results, ratio));
        let worst = results.iter().map(ratio).fold(0.0, f64::max);
        assert!(worst <= 1.3, "worst RMSE ratio {worst}");
        for (i, bar) in [0.15, 0.6, 0.5, 1.4].into_iter().enumerate() {
            let all = results.iter().map(|r| off(r, &truth)[i].abs()).collect();
            let found = quantile(all, 0.9);
            assert!(found <= bar, "parameter {i}: {found} > {bar}");
        }
        // Spread against the Cramér–Rao bound, which is tabulated for six hours; the identification in force at
        // the end began after 15 000 s at the latest.
        let record = (6.0 * 3600.0 / 15_000.0_f64).sqrt();
        for (i, bound) in [0.05, 0.22, 0.21, 0.55].into_iter().enumerate() {
            let all: Vec<f64> = results.iter().map(|r| off(r, &truth)[i]).collect();
            let spread = (quantile(all.clone(), 0.75) - quantile(all, 0.25)) / 1.349;
            assert!(
                spread <= 1.4 * bound * record,
                "parameter {i}: spread {spread}, bound {}",
                bound * record
            );
        }
        // What the identification is for.
        let true_nees = mean(&results, |r| r.true_tuned.nees());
        assert!((0.9..=1.15).contains(&true_nees), "true-tuned NEES {true_nees}");
        if matches!(start, Start::Low) {
            assert!(mean(&results, |r| r.mistuned.outside()) >= 0.25);
        }
    }
}

#[test]
fn fil_15_level_b_in_the_scenario_with_slow_gyro_drift() {
    let truth = scenario(9.80665e-4, 120.0, 0.01 * DEGREE_PER_HOUR, 3600.0);
    // Three hours are three correlation times of this gyro: too few. The window holds 5.7 h when it is full.
    let results = campaign(&truth, Start::Random, 11, 6 * HOUR, 77_003);
    report("R2 Random", &results, &truth);
    let ratio = mean(&results, |r| r.averaged.rmse() / r.true_tuned.rmse());
    assert!(ratio <= 1.1, "RMSE ratio {ratio}");
    let outside = mean(&results, |r| r.averaged.outside());
    assert!(outside <= 0.03, "outside {outside}");
}

/// [FIL-11] with zero mean over a whole series.
fn autocorrelation(series: &[f64], lags: usize) -> Vec<f64> {
    let lagged = |j: usize| series[j..].iter().zip(series).map(|(a, b)| a * b).sum::<f64>();
    (0..=lags).map(|j| lagged(j) / (series.len() - j) as f64).collect()
}

#[test]
fn fil_13_the_published_loop_collapses() {
    let truth = scenario_r1();
    let mut generator = MinimalStandard::new(31_337);
    let flight = fly(&truth, 6 * HOUR, || generator.normal());
    let mut config = mistuned(&truth, [0.1; 2], [0.1; 2]);
    for pass in 1..=5 {
        let mut filter =
            ErrorFilter::with_model(&config, DiscreteModel::third_order(&config), config.prior());
        let (mut a, mut w) = (Vec::new(), Vec::new());
        for (k, &z) in flight.measured.iter().enumerate() {
            filter.step(Some(z));
            if k >= 600 && k % 10 == 0 {
                a.push(filter.state().mean[2]);
                w.push(filter.state().mean[3]);
            }
        }
        let read = |series: &[f64], old: MarkovNoise<f64>| {
            fit_exponential(&autocorrelation(series, 180), 10.0, 0.5)
                .map_or(old, |fit| MarkovNoise { sigma: fit.variance.sqrt(), tau_s: 1.0 / fit.alpha })
        };
        config.accelerometer = read(&a, config.accelerometer);
        config.gyro = read(&w, config.gyro);
        println!("pass {pass}: σ_a/true {:.2e}", config.accelerometer.sigma / truth.accelerometer.sigma);
    }
    assert!(config.accelerometer.sigma < 0.05 * truth.accelerometer.sigma);
}

#[test]
fn fil_16_an_exponential_cosine_sensor_is_found_and_flown() {
    // A gyro whose drift swings with a period of 15 min, and the first-order sensors of R1 for comparison.
    let truth = scenario(9.80665e-4, 60.0, 0.3 * DEGREE_PER_HOUR, 1200.0);
    let swing = [1.0 / 1200.0, std::f64::consts::TAU / 900.0];
    let one = |run: u64, coloured: bool| {
        let mut generator = MinimalStandard::new(55_001 + 104_729 * run);
        let flight = if coloured {
            fly_exponential_cosine(&truth, 1, swing, 7 * HOUR, || generator.normal())
        } else {
            fly(&truth, 7 * HOUR, || generator.normal())
        };
        fly_module(&truth, &truth, &flight, 0)
    };
    let runs = 20;
    let coloured: Vec<Result> = (0..runs).into_par_iter().map(|run| one(run, true)).collect();
    let plain: Vec<Result> = (0..runs).into_par_iter().map(|run| one(run, false)).collect();
    let swings = |r: &&Result| r.found.gyro.noise.beta > 0.0;
    let found: Vec<&Result> = coloured.iter().filter(swings).collect();
    let falsely = plain.iter().filter(|r| swings(r) || r.found.accelerometer.noise.beta > 0.0).count();
    let median = |f: &dyn Fn(&Result) -> f64| quantile(found.iter().map(|r| f(r)).collect(), 0.5);
    let sigma = median(&|r| f64::from(r.found.gyro.noise.sigma) / truth.gyro.sigma);
    let alpha = median(&|r| f64::from(r.found.gyro.noise.alpha) / swing[0]);
    let beta = median(&|r| f64::from(r.found.gyro.noise.beta) / swing[1]);
    println!(
        "exponential-cosine gyro found in {} of {runs}, falsely in {falsely}; median ratio to the truth: \
         σ {sigma:.2}, α {alpha:.2}, β {beta:.2}",
        found.len()
    );
    // The specification sets no bar here. Two thirds must be found, at most one in twenty falsely.
    assert!(found.len() >= 13);
    assert!(falsely <= 1);
    assert!((beta - 1.0).abs() < 0.1 && (0.5..2.0).contains(&alpha) && (0.7..1.4).contains(&sigma));
}
