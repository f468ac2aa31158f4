//! How fast the host replays: steps per second on one core, the whole module and each of its parts.
//!
//! `cargo bench -p schuler-core --bench replay` prints the rates; others use the machine, so the fastest of the rounds is what to
//! read. `tests/host_speed` runs each part once with `--test` and counts its instructions under callgrind (between calls of
//! `measured_…`).
use std::hint::black_box;

use divan::Bencher;
use divan::counter::ItemsCount;
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
const ROUNDS: u32 = 25;
const SOUND: &str = "the configuration is sound";

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
fn measured_module(module: &mut Box<FlightModule>, inputs: &[StepInput]) {
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
    parts: &mut (ErrorFilter<f32>, FaultIsolation, TemperatureRate<f32>, HealthMonitor<f32, 2>),
    inputs: &[StepInput],
) {
    let (filter, isolation, thermometer, health) = parts;
    for input in inputs {
        black_box(filter.step(Some(input.velocity_error.value)));
        black_box(isolation.step(&input.gyros, None));
        black_box(thermometer.step(input.time_ms, &input.thermometers[0]));
        black_box(health.step(&input.radio_velocity, &input.inertial_velocity, 1));
    }
}

/// Times `run` over all inputs from a part as it is built; what is built is not timed.
fn replay<P>(bencher: Bencher<'_, '_>, build: impl Fn() -> P, run: fn(&mut P, &[StepInput])) {
    let inputs = inputs();
    bencher.counter(ItemsCount::new(STEPS)).with_inputs(build).bench_local_refs(|part| run(part, &inputs));
}

fn error_filter() -> ErrorFilter<f32> {
    ErrorFilter::try_build(&config(Method::Off).filter).expect(SOUND)
}

fn gyro_block() -> FaultIsolation {
    FaultIsolation::try_build(&IsolationConfig::CONE).expect(SOUND)
}

fn thermometer_rate() -> TemperatureRate<f32> {
    TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(0.0625)).expect(SOUND)
}

fn monitor() -> HealthMonitor<f32, 2> {
    HealthMonitor::try_build(&HealthConfig::doppler_against_inertial()).expect(SOUND)
}

fn whole(method: Method) -> Box<FlightModule> {
    let mut module = Box::new(FlightModule::new());
    module.configure(&config(method)).expect(SOUND);
    module
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn filter(bencher: Bencher<'_, '_>) {
    replay(bencher, error_filter, measured_filter);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn isolation(bencher: Bencher<'_, '_>) {
    replay(bencher, gyro_block, measured_isolation);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn thermometer(bencher: Bencher<'_, '_>) {
    replay(bencher, thermometer_rate, measured_thermometer);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn health(bencher: Bencher<'_, '_>) {
    replay(bencher, monitor, measured_health);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn four(bencher: Bencher<'_, '_>) {
    replay(bencher, || (error_filter(), gyro_block(), thermometer_rate(), monitor()), measured_four);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn module(bencher: Bencher<'_, '_>) {
    replay(bencher, || whole(Method::Off), measured_module);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn identification(bencher: Bencher<'_, '_>) {
    replay(bencher, || whole(Method::Likelihood), measured_module);
}

fn main() {
    divan::main();
}
