//! How fast the host replays: steps per second of CPU time of one core, the whole module and each of its parts.
//!
//! `cargo bench -p schuler-core --bench replay` prints the rates. With the name of a part it runs that alone, for
//! `tests/host_speed`, which counts its instructions under callgrind (between calls of `measured_…`).
use std::hint::black_box;

use cpu_time::ProcessTime;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use schuler_core::filter::ErrorFilter;
use schuler_core::health::{HealthConfig, HealthMonitor};
use schuler_core::identification::{IdentificationConfig, Method};
use schuler_core::isolation::{FaultIsolation, IsolationConfig};
use schuler_core::module::{FlightModule, ModuleConfig, StepInput, THERMOMETERS};
use schuler_core::reading::Reading;
use schuler_core::thermal::{TemperatureRate, TemperatureRateConfig};

const STEPS: usize = 40_000;
/// Rounds of which the fastest counts: others use the machine.
const ROUNDS: usize = 5;

fn inputs() -> Vec<StepInput> {
    let mut random = Pcg64::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut velocity, mut radio) = (0.0, 0.0);
    (1..=STEPS as u64)
        .map(|step| {
            velocity += 1e-3 * normal();
            radio += -radio / 10.0 + 0.13 * normal();
            let hours = step as f64 / 3600.0;
            let thermometer = |k: f64| {
                let temperature = 30.0 + 20.0 * ((hours - 0.2 * k) * 0.7).sin();
                Reading::good(((temperature * 16.0).round() / 16.0) as f32)
            };
            StepInput {
                velocity_error: Reading::good((velocity + 0.1 * normal()) as f32),
                gyros: [1.0, 0.3, -0.6, 0.1, 0.8].map(|k| Reading::good(1e-5 * k + 1e-7 * normal())),
                accelerometers: [0.1, -0.2, -9.8].map(|force| Reading::good(force + 1e-4 * normal())),
                thermometers: [0.0, 1.0, 2.0, 3.0].map(thermometer),
                radio_velocity: Reading::good((100.0 + radio) as f32),
                inertial_velocity: Reading::good((100.0 + velocity) as f32),
                ..StepInput::without_readings(1000 * step)
            }
        })
        .collect()
}

fn config(method: Method) -> ModuleConfig {
    ModuleConfig {
        identification: IdentificationConfig { method, ..IdentificationConfig::default() },
        thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); THERMOMETERS],
        health: Some(HealthConfig::doppler_against_inertial()),
        ..ModuleConfig::default()
    }
}

#[inline(never)]
fn measured_module(module: &mut FlightModule, inputs: &[StepInput]) {
    for input in inputs {
        black_box(module.step(input));
    }
}

#[inline(never)]
fn measured_filter(filter: &mut ErrorFilter<f32>, inputs: &[StepInput]) {
    for input in inputs {
        black_box(filter.step(Some(input.velocity_error.value)));
    }
}

#[inline(never)]
fn measured_isolation(isolation: &mut FaultIsolation, inputs: &[StepInput]) {
    for input in inputs {
        black_box(isolation.step(&input.gyros, None));
    }
}

#[inline(never)]
fn measured_thermometer(thermometer: &mut TemperatureRate<f32>, inputs: &[StepInput]) {
    for input in inputs {
        black_box(thermometer.step(input.time_ms, &input.thermometers[0]));
    }
}

#[inline(never)]
fn measured_health(health: &mut HealthMonitor<f32, 2>, inputs: &[StepInput]) {
    for input in inputs {
        black_box(health.step(&input.radio_velocity, &input.inertial_velocity, 1));
    }
}

/// Filter, isolation, one thermometer and the monitor one after another in each step, as in a replay.
#[inline(never)]
fn measured_four(
    (filter, isolation, thermometer, health): (
        &mut ErrorFilter<f32>,
        &mut FaultIsolation,
        &mut TemperatureRate<f32>,
        &mut HealthMonitor<f32, 2>,
    ),
    inputs: &[StepInput],
) {
    for input in inputs {
        black_box(filter.step(Some(input.velocity_error.value)));
        black_box(isolation.step(&input.gyros, None));
        black_box(thermometer.step(input.time_ms, &input.thermometers[0]));
        black_box(health.step(&input.radio_velocity, &input.inertial_velocity, 1));
    }
}

/// CPU time of a part over all inputs, s.
fn seconds(part: &str, inputs: &[StepInput]) -> f64 {
    let built = "the configuration is sound";
    let off = config(Method::Off);
    let timed = |run: &mut dyn FnMut()| {
        let start = ProcessTime::now();
        run();
        start.elapsed().as_secs_f64()
    };
    let mut filter = ErrorFilter::try_build(&off.filter).expect(built);
    let mut isolation = FaultIsolation::try_build(&IsolationConfig::CONE).expect(built);
    let mut thermometer =
        TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(0.0625)).expect(built);
    let mut health = HealthMonitor::try_build(&HealthConfig::doppler_against_inertial()).expect(built);
    match part {
        "filter" => timed(&mut || measured_filter(&mut filter, inputs)),
        "isolation" => timed(&mut || measured_isolation(&mut isolation, inputs)),
        "thermometer" => timed(&mut || measured_thermometer(&mut thermometer, inputs)),
        "health" => timed(&mut || measured_health(&mut health, inputs)),
        "four" => timed(&mut || {
            measured_four((&mut filter, &mut isolation, &mut thermometer, &mut health), inputs);
        }),
        _ => {
            let method = if part == "identification" { Method::Likelihood } else { Method::Off };
            let mut module = Box::new(FlightModule::new());
            module.configure(&config(method)).expect(built);
            timed(&mut || measured_module(&mut module, inputs))
        }
    }
}

fn main() {
    let inputs = inputs();
    let wanted: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let rounds = if wanted.is_empty() { ROUNDS } else { 1 };
    for part in ["filter", "isolation", "thermometer", "health", "four", "module", "identification"] {
        if wanted.is_empty() || wanted.iter().any(|name| name == part) {
            let best = (0..rounds).map(|_| seconds(part, &inputs)).fold(f64::INFINITY, f64::min);
            let rate = STEPS as f64 / best;
            println!("{part:<16} {rate:>12.0} steps/s {:>10.1} ns/step {STEPS} steps", 1e9 / rate);
        }
    }
}
