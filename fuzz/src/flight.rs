//! The flight step, and whole flights.
use std::cell::RefCell;
use std::sync::OnceLock;

use arbitrary::{Result, Unstructured};
use schuler_core::compensation::{Block, Factor, Quantity, Target, Term};
use schuler_core::health::{Estimate, HealthConfig};
use schuler_core::identification::{IdentificationConfig, Method};
use schuler_core::isolation::Verdict;
use schuler_core::module::{FlightModule, ModuleConfig, StepInput, StepOutput, THERMOMETERS};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::TemperatureRateConfig;

use crate::source;

/// Most steps of one flight: a bound on its time.
const FLIGHT_STEPS: u64 = 400;
/// And of one stretch of a flight.
const STRETCH_STEPS: u64 = 12;
/// Steps of a quiet flight before the stretch, in which identifications have begun and ended.
const QUIET_STEPS: u32 = 100;
/// Steps in which much goes wrong.
const TROUBLED_STEPS: u32 = 40;

/// Configurations as they are flown: everything on, with each method of identification, which start early.
pub fn configurations() -> &'static [ModuleConfig] {
    static ALL: OnceLock<Vec<ModuleConfig>> = OnceLock::new();
    ALL.get_or_init(|| {
        let early =
            IdentificationConfig { first_s: 30.0, interval_s: 20.0, ..IdentificationConfig::default() };
        [Method::Off, Method::Published, Method::Likelihood]
            .map(|method| ModuleConfig {
                identification: IdentificationConfig { method, ..early },
                thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); THERMOMETERS],
                health: Some(HealthConfig::doppler_against_inertial()),
                ..ModuleConfig::default()
            })
            .to_vec()
    })
}

/// A block with a term of several kinds.
fn corrections() -> Block {
    let one = Factor::default();
    let temperature = Factor { quantity: Quantity::Temperature(1), reference: 20.0, power: 2 };
    let term = |target, coefficient, factor| Term { target, coefficient, factors: [factor, one] };
    let terms = [
        term(Target::Gyro(0), 1e-7, temperature),
        term(Target::Gyro(4), 1e-4, Quantity::Input.into()),
        term(Target::Accelerometer(2), 1e-4, Quantity::InputMagnitude.into()),
        term(Target::Velocity, 1e-3, temperature),
        term(Target::LoopAccelerometer, 1e-5, one),
        term(Target::LoopGyro, 1e-8, temperature),
    ];
    Block { terms: terms.into_iter().collect(), ..Block::default() }
}

/// Modules that have been started, one a configuration, without and with corrections.
pub(crate) fn started() -> Vec<Box<FlightModule>> {
    let modules = configurations().iter().flat_map(|config| {
        let mut plain = Box::new(FlightModule::new());
        plain.configure(config).expect("the configuration is sound");
        let mut corrected = plain.clone();
        corrected.load_compensation(&corrections()).expect("the block is sound");
        [plain, corrected]
    });
    modules.collect()
}

/// Modules to go on from: just started, in a quiet flight, and after a bad one, of each configuration.
fn in_flight() -> Vec<Box<FlightModule>> {
    let flights = started().into_iter().flat_map(|start| {
        let mut quiet = start.clone();
        for k in 0..QUIET_STEPS {
            quiet.step(&quiet_step(k));
        }
        let mut troubled = quiet.clone();
        for k in QUIET_STEPS..QUIET_STEPS + TROUBLED_STEPS {
            troubled.step(&troubled_step(k));
        }
        [start, quiet, troubled]
    });
    flights.collect()
}

/// The `k`-th step of a quiet flight.
pub(crate) fn quiet_step(k: u32) -> StepInput {
    ordinary(u64::from(k) * 1000, k.wrapping_mul(0x9e37_79b9))
}

/// One with a gyro that has failed, velocities and a thermometer that come and go, and in the end a silence.
fn troubled_step(k: u32) -> StepInput {
    let mut input = quiet_step(k);
    input.gyros[2].value += 1e-3;
    input.accelerometers[0].quality = Quality::Saturated;
    if k.is_multiple_of(3) {
        input.velocity_error.value += 50.0;
        input.thermometers[1].value = -300.0;
    }
    if k % 5 < 2 {
        input.radio_velocity.value = f32::NAN;
    }
    if k + 1 == QUIET_STEPS + TROUBLED_STEPS {
        input.time_ms += 500_000;
    }
    input
}

thread_local! {
    static STARTED: Vec<Box<FlightModule>> = started();
    static IN_FLIGHT: Vec<Box<FlightModule>> = in_flight();
    static MODULE: RefCell<Box<FlightModule>> = RefCell::new(Box::new(FlightModule::new()));
}

/// Works on a module that is made once a thread, and is as the last input left it.
pub(crate) fn on_a_module<R>(work: impl FnOnce(&mut FlightModule) -> R) -> R {
    MODULE.with_borrow_mut(|module| work(module))
}

/// A whole flight: steps of any readings at any time, and stretches of ordinary ones in between.
pub fn flight(data: &[u8]) {
    STARTED.with(|all| fly(&mut Unstructured::new(data), all, FLIGHT_STEPS));
}

/// A stretch of a flight: the same for a few steps, from modules in flight as well.
pub fn step(data: &[u8]) {
    IN_FLIGHT.with(|all| fly(&mut Unstructured::new(data), all, STRETCH_STEPS));
}

fn fly(source: &mut Unstructured<'_>, starts: &[Box<FlightModule>], most_steps: u64) {
    let chosen = source.arbitrary::<u8>().unwrap_or_default();
    on_a_module(|module| {
        if let Some(start) = starts.get(usize::from(chosen) % starts.len()) {
            module.clone_from(start);
        }
        // Bytes that end too early end the flight.
        let _ = go_on(source, module, most_steps);
    });
}

fn go_on(source: &mut Unstructured<'_>, module: &mut FlightModule, most_steps: u64) -> Result<()> {
    let mut time_ms = module.last_time_ms().unwrap_or(0);
    let last = module.steps() + most_steps;
    let mut random = 1u32;
    // Past their end, the bytes are zeros.
    while module.steps() < last && !source.is_empty() {
        if source.arbitrary::<u8>()? < 32 {
            for _ in 0..u64::from(source.arbitrary::<u8>()?).min(last - module.steps()) {
                time_ms = time_ms.wrapping_add(1000);
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                checked_step(module, &ordinary(time_ms, random));
            }
        } else {
            time_ms = source::next_time(source, time_ms)?;
            let input = source::step_input(source, time_ms)?;
            checked_step(module, &input);
        }
    }
    Ok(())
}

fn checked_step(module: &mut FlightModule, input: &StepInput) {
    let expected = module.steps() + 1;
    let output = module.step(input);
    assert_eq!((output.step, output.time_ms), (expected, input.time_ms));
    check_output(&output);
}

/// Readings of a quiet flight with a little noise.
pub(crate) fn ordinary(time_ms: u64, random: u32) -> StepInput {
    let noise = f64::from(random >> 8) / f64::from(1 << 24) - 0.5;
    StepInput {
        velocity_error: Reading::good(noise as f32),
        gyros: [1.0, -0.5, 0.7, -0.3, 0.2].map(|k| Reading::good(1e-5 + 1e-7 * k * noise)),
        accelerometers: [0.1, -0.2, -9.8].map(|force| Reading::good(force + 1e-4 * noise)),
        thermometers: [20.0, 21.0, 22.0, 23.0]
            .map(|t: f32| Reading::good(t + (noise * 16.0).round() as f32 / 16.0)),
        radio_velocity: Reading::good(100.0 + noise as f32),
        inertial_velocity: Reading::good(100.0),
        ..StepInput::without_readings(time_ms)
    }
}

/// Any configuration: refused, or it flies without a panic. Whether its outputs are finite depends on its numbers.
pub fn configuration(data: &[u8]) {
    let Ok((config, _)) = postcard::take_from_bytes::<ModuleConfig>(data) else { return };
    on_a_module(|module| {
        *module = FlightModule::new();
        if module.configure(&config).is_err() {
            return;
        }
        for (k, time_ms) in
            [1000, 2000, 2000, 60_000, 61_000, 10_000_000, u64::MAX, 0].into_iter().enumerate()
        {
            let output = module.step(&ordinary(time_ms, (k as u32).wrapping_mul(0x9e37_79b9)));
            assert_eq!(output.step, k as u64 + 1);
        }
    });
}

/// All numbers of an output are finite and in range.
pub fn check_output(output: &StepOutput) {
    let filter = &output.filter;
    let averaged = &output.identification.averaged;
    let means = filter.estimate.iter().chain(&averaged.estimate).chain([&filter.innovation]);
    assert!(means.copied().all(f32::is_finite), "{filter:?} {averaged:?}");
    let mut sigmas = filter.sigma.iter().chain(&averaged.sigma);
    assert!(sigmas.all(|&sigma| sigma.is_finite() && sigma > 0.0), "{filter:?} {averaged:?}");
    assert!(filter.innovation_variance.is_finite() && filter.innovation_variance >= 0.0, "{filter:?}");
    assert!(filter.nis.is_finite() && filter.nis >= 0.0, "{filter:?}");
    for noise in [output.identification.accelerometer.noise, output.identification.gyro.noise] {
        let numbers = [noise.sigma, noise.alpha, noise.beta];
        assert!(numbers.iter().all(|number| number.is_finite() && *number >= 0.0), "{noise:?}");
    }

    let isolation = &output.isolation;
    let of_block = isolation.rate.iter().chain(&isolation.parity).chain(&isolation.determinants);
    let of_block = of_block.chain([&isolation.margin, &isolation.fault_size]);
    assert!(of_block.copied().all(f64::is_finite), "{isolation:?}");
    let at_least_zero = isolation.rate_sigma.iter().chain([&isolation.fault_sigma, &isolation.alarm_level]);
    assert!(at_least_zero.copied().all(|value| value.is_finite() && value >= 0.0), "{isolation:?}");
    assert!(isolation.gyros_used < 32 && isolation.excluded < 32, "{isolation:?}");
    if let Verdict::Fault(gyro) = isolation.verdict {
        assert!(gyro < 5, "{isolation:?}");
    }

    for thermometer in &output.thermometers {
        assert!(thermometer.temperature.is_finite() && thermometer.rate.is_finite(), "{thermometer:?}");
        let sigmas = [thermometer.temperature_sigma, thermometer.rate_sigma];
        assert!(sigmas.iter().all(|sigma| sigma.is_finite() && *sigma >= 0.0), "{thermometer:?}");
    }

    let compensation = &output.compensation;
    assert!(compensation.gyros.iter().chain(&compensation.accelerometers).all(|value| value.is_finite()));
    assert!(
        compensation.loop_errors.iter().all(|value| value.is_finite()) && compensation.velocity.is_finite()
    );

    let health = &output.health;
    let probabilities = health.mode_probability.iter().flatten().chain([&health.p_jump, &health.p_noise]);
    let mut probabilities = probabilities.chain([&health.p_fault]);
    assert!(probabilities.all(|p| (-1e-6..=1.0 + 1e-5).contains(p)), "{health:?}");
    let estimates = [health.radio_error, health.inertial_error, health.jump, health.inertial_drift];
    let sound = |it: &Estimate<f32>| it.value.is_finite() && it.sigma.is_finite() && it.sigma >= 0.0;
    assert!(
        estimates.iter().chain([&health.correlated_error]).chain(&health.corrected).all(sound),
        "{health:?}"
    );
    let singles = [health.residual, health.innovation, health.log_likelihood];
    assert!(singles.iter().all(|value| value.is_finite()), "{health:?}");
    let squares = [health.innovation_variance, health.nis];
    assert!(squares.iter().all(|value| value.is_finite() && *value >= 0.0), "{health:?}");
}
