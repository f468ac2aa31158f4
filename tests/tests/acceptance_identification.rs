//! Acceptance of the identification: fifty flights from each mis-tuned start.

use rayon::prelude::*;
use schuler_core::filter::{ErrorFilter, FilterConfig, MarkovNoise};
use schuler_core::identification::IdentificationOutput;
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput};
use schuler_core::reading::Reading;
use schuler_tests::golden_records::{MinimalStandard, fly, mistuned, scenario_r1};

#[derive(Clone, Copy, Debug)]
enum Start {
    Low,
    High,
    Random,
}

/// One flight's figures over its last three hours.
#[derive(Clone, Debug)]
struct Figures {
    nees: f64,
    outside: f64,
    rmse_ratio: f64,
    /// ln of found over true: σ_a, τ_a, σ_w, τ_w.
    off: [f64; 4],
    true_nees: f64,
    retunes: Vec<usize>,
    status: String,
}

fn narrow(config: &FilterConfig<f64>) -> FilterConfig<f32> {
    let noise =
        |noise: MarkovNoise<f64>| MarkovNoise { sigma: noise.sigma as f32, tau_s: noise.tau_s as f32 };
    FilterConfig {
        radius_m: config.radius_m as f32,
        gravity: config.gravity as f32,
        step_s: config.step_s as f32,
        accelerometer: noise(config.accelerometer),
        gyro: noise(config.gyro),
        velocity_noise: config.velocity_noise as f32,
        initial_velocity_sigma: config.initial_velocity_sigma as f32,
        initial_vertical_sigma: config.initial_vertical_sigma as f32,
        gate_sigma: 6.0,
    }
}

fn flight(truth: &FilterConfig<f64>, start: Start, seed: u64) -> Figures {
    let mut generator = MinimalStandard::new(seed);
    let steps = 21_600;
    let flight = fly(truth, steps, || generator.normal());
    let mut factor = || 10f64.powf(2.0 * generator.uniform() - 1.0);
    let config = match start {
        Start::Low => mistuned(truth, [0.1; 2], [0.1; 2]),
        Start::High => mistuned(truth, [10.0; 2], [0.1; 2]),
        Start::Random => mistuned(truth, [factor(), factor()], [factor(), factor()]),
    };
    let mut module = Box::new(FlightModule::new());
    module.configure(&ModuleConfig { filter: narrow(&config), ..ModuleConfig::default() }).unwrap();
    let mut tuned = ErrorFilter::try_build(truth).unwrap();
    let (mut nees, mut outside, mut square, mut true_square, mut true_nees, mut count) =
        (0., 0., 0., 0., 0., 0.);
    let mut retunes = Vec::new();
    let mut found = IdentificationOutput::default();
    for (k, (x, &z)) in flight.truth.iter().zip(&flight.measured).enumerate() {
        tuned.step(Some(z));
        let input = StepInput {
            time_ms: 1000 * (k as u64 + 1),
            velocity_error: Reading::good(z as f32),
            ..StepInput::default()
        };
        let output = module.step(&input);
        if output.status.contains(Status::RETUNED) {
            retunes.push(k);
        }
        found = output.identification;
        if k >= std::env::var("FROM").ok().and_then(|s| s.parse().ok()).unwrap_or(steps / 2) {
            let error = f64::from(found.averaged.estimate[1]) - x[1];
            let normalised = error * error / f64::from(found.averaged.sigma[1]).powi(2);
            nees += normalised;
            outside += f64::from(normalised > 9.0);
            square += error * error;
            let error = tuned.state().mean[1] - x[1];
            true_square += error * error;
            true_nees += error * error / tuned.state().variances()[1];
            count += 1.0;
        }
    }
    let ln = |found: f32, truth: f64| (f64::from(found) / truth).ln();
    Figures {
        nees: nees / count,
        outside: outside / count,
        rmse_ratio: (square / true_square).sqrt(),
        true_nees: true_nees / count,
        off: [
            ln(found.accelerometer.sigma, truth.accelerometer.sigma),
            -ln(found.accelerometer.alpha, 1.0 / truth.accelerometer.tau_s),
            ln(found.gyro.sigma, truth.gyro.sigma),
            -ln(found.gyro.alpha, 1.0 / truth.gyro.tau_s),
        ],
        retunes,
        status: format!("{:?} {:?}", found.accelerometer.status, found.gyro.status),
    }
}

fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

#[test]
fn level_b_meets_its_bars_from_every_start() {
    let truth = scenario_r1();
    let runs: u64 = std::env::var("RUNS").ok().and_then(|s| s.parse().ok()).unwrap_or(50);
    for start in [Start::Low, Start::High, Start::Random] {
        let all: Vec<Figures> =
            (0..runs).into_par_iter().map(|run| flight(&truth, start, 1_000_003 * (run + 1) + 17)).collect();
        let mean = |f: fn(&Figures) -> f64| all.iter().map(f).sum::<f64>() / all.len() as f64;
        let worst = all.iter().map(|f| f.rmse_ratio).fold(0.0, f64::max);
        let rms_ratio = mean(|f| f.rmse_ratio);
        println!(
            "{start:?}: NEES {:.3} (true-tuned {:.3}), outside {:.4}, RMSE ratio {:.3}, worst {:.3}; 90 % |ln| {:?}",
            mean(|f| f.nees),
            mean(|f| f.true_nees),
            mean(|f| f.outside),
            rms_ratio,
            worst,
            [0, 1, 2, 3].map(|i| quantile(all.iter().map(|f| f.off[i].abs()).collect(), 0.9)),
        );
        let mut ratios: Vec<_> = all.iter().map(|f| (f.rmse_ratio, f.retunes.clone(), f.status.clone(), f.off, f.nees)).collect();
        ratios.sort_by(|a, b| b.0.total_cmp(&a.0));
        for r in ratios.iter().take(5) { println!("    worst {r:?}"); }
        println!("   retunes {:?} {:?} {}", all[0].retunes, all[1].retunes, all[0].status);
    }
}
