//! Whatever comes in, the flight module flags it, stays usable and gives finite numbers.

use proptest::prelude::*;
use schuler_core::config::Problem;
use schuler_core::module::{Command, FlightModule, ModuleConfig, Status, StepInput, StepOutput};
use schuler_core::reading::{Quality, Reading};
use schuler_tests::golden_records::{MinimalStandard, fly, scenario_r1};

fn started() -> Box<FlightModule> {
    let mut module = Box::new(FlightModule::new());
    module.configure(&ModuleConfig::default()).unwrap();
    module
}

fn input(time_ms: u64, velocity_error: Reading<f32>) -> StepInput {
    StepInput { time_ms, velocity_error, gyros: [Reading::good(1e-5); 5], command: Command::None }
}

fn is_finite(output: &StepOutput) -> bool {
    let filter = &output.filter;
    let averaged = &output.identification.averaged;
    let singles =
        filter.estimate.iter().chain(&filter.sigma).chain(&averaged.estimate).chain(&averaged.sigma);
    let isolation = &output.isolation;
    singles.chain([&filter.innovation, &filter.innovation_variance, &filter.nis]).all(|x| x.is_finite())
        && isolation.rate.iter().chain(&isolation.parity).all(|x| x.is_finite())
}

fn quality() -> impl Strategy<Value = Quality> {
    prop_oneof![Just(Quality::Good), Just(Quality::Saturated), Just(Quality::Missing)]
}

fn any_input() -> impl Strategy<Value = StepInput> {
    let velocity = (any::<f32>(), 0..4000u32, quality()).prop_map(|(value, age_ms, quality)| Reading {
        value,
        age_ms,
        quality,
    });
    let gyro = (any::<f64>(), 0..4000u32, quality()).prop_map(|(value, age_ms, quality)| Reading {
        value,
        age_ms,
        quality,
    });
    let command = prop_oneof![Just(Command::None), any::<u8>().prop_map(Command::ReadmitGyro)];
    (any::<u64>(), velocity, prop::array::uniform5(gyro), command).prop_map(
        |(time_ms, velocity_error, gyros, command)| StepInput { time_ms, velocity_error, gyros, command },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_input_poisons_the_state(garbage in prop::collection::vec(any_input(), 1..60)) {
        let mut module = started();
        let mut generator = MinimalStandard::new(99);
        let flight = fly(&scenario_r1(), 900, || generator.normal());
        let mut garbage = garbage.into_iter();
        for (k, &z) in flight.measured.iter().enumerate() {
            let time_ms = 1000 * (k as u64 + 1);
            let spoilt = if k % 7 == 3 { garbage.next() } else { None };
            let output = module.step(&spoilt.unwrap_or(input(time_ms, Reading::good(z as f32))));
            prop_assert!(is_finite(&output), "{output:?}");
        }
        // Ten minutes after the last piece of garbage the velocity is followed again.
        let output = module.step(&input(901_000, Reading::good(flight.measured[899] as f32)));
        prop_assert!((output.filter.estimate[0] - flight.truth[899][0] as f32).abs() < 0.6, "{output:?}");
    }
}

#[test]
fn each_problem_has_its_flag() {
    let good = Reading::good(0.01_f32);
    let cases = [
        (Reading { value: f32::NAN, ..good }, Status::VELOCITY_MISSING),
        (Reading { quality: Quality::Missing, ..good }, Status::VELOCITY_MISSING),
        (Reading { quality: Quality::Saturated, ..good }, Status::VELOCITY_SATURATED),
        (Reading { value: 1e30, ..good }, Status::VELOCITY_SATURATED),
        (Reading { age_ms: 1501, ..good }, Status::VELOCITY_STALE),
        (Reading { value: 50.0, ..good }, Status::INNOVATION_GATED),
        (good, Status::empty()),
    ];
    for (reading, flag) in cases {
        let mut module = started();
        module.step(&input(1000, good));
        let with = module.step(&input(2000, reading));
        assert_eq!(with.status, flag, "{reading:?}");
        // What is not used changes nothing but the passage of time.
        if !flag.is_empty() {
            let mut other = started();
            other.step(&input(1000, good));
            let without = other.step(&input(2000, Reading::missing()));
            assert_eq!(with.filter.estimate, without.filter.estimate);
            assert_eq!(with.filter.sigma, without.filter.sigma);
        }
    }
}

#[test]
fn the_clock_is_watched() {
    let mut module = started();
    let at = |module: &mut FlightModule, time_ms| module.step(&input(time_ms, Reading::good(0.0))).status;
    assert_eq!(at(&mut module, 1000), Status::empty());
    assert_eq!(at(&mut module, 2030), Status::empty());
    assert_eq!(at(&mut module, 2030), Status::CLOCK_BACKWARDS);
    assert_eq!(at(&mut module, 1500), Status::CLOCK_BACKWARDS);
    assert_eq!(at(&mut module, 2500), Status::empty());
    assert_eq!(at(&mut module, 12_500), Status::STEPS_MISSING);
    assert_eq!(at(&mut module, 10_000_000), Status::CLOCK_JUMPED);
    assert_eq!(at(&mut module, 10_001_000), Status::empty());
}

#[test]
fn coasting_over_missing_steps_is_stepping_without_measurement() {
    let (mut gap, mut stepped) = (started(), started());
    let mut generator = MinimalStandard::new(7);
    let flight = fly(&scenario_r1(), 400, || generator.normal());
    let mut last = (StepOutput::default(), StepOutput::default());
    for (k, &z) in flight.measured.iter().enumerate() {
        let time_ms = 1000 * (k as u64 + 1);
        let outage = (100..160).contains(&k);
        let reading = if outage { Reading::missing() } else { Reading::good(z as f32) };
        last.1 = stepped.step(&input(time_ms, reading));
        if !outage {
            last.0 = gap.step(&input(time_ms, reading));
        }
    }
    for (x, y) in last.0.filter.estimate.iter().zip(last.1.filter.estimate) {
        assert!((x - y).abs() <= 1e-3 * y.abs(), "{x} {y}");
    }
    for (x, y) in last.0.filter.sigma.iter().zip(last.1.filter.sigma) {
        assert!((x / y - 1.0).abs() < 1e-3);
    }
}

#[test]
fn a_velocity_that_stays_away_is_believed_in_the_end() {
    let mut module = started();
    for k in 1..200u64 {
        module.step(&input(1000 * k, Reading::good(0.0)));
    }
    let mut reacquired = None;
    for k in 200..300u64 {
        let output = module.step(&input(1000 * k, Reading::good(25.0)));
        if output.status.contains(Status::VELOCITY_REACQUIRED) {
            reacquired = reacquired.or(Some(k));
        }
    }
    assert_eq!(reacquired, Some(209));
    let output = module.step(&input(300_000, Reading::good(25.0)));
    assert!((output.filter.estimate[0] - 25.0).abs() < 0.5);
}

#[test]
fn a_wrong_configuration_names_its_field_and_leaves_the_module_as_it_was() {
    let mut module = started();
    module.step(&input(1000, Reading::good(0.1)));
    let good = ModuleConfig::default();
    let mut wrong = [good; 6];
    wrong[0].filter.velocity_noise = 0.0;
    wrong[1].filter.gyro.tau_s = 0.2;
    wrong[2].filter.radius_m = f32::NAN;
    wrong[3].identification.interval_s = -1.0;
    wrong[4].identification.limit_factor = 0.5;
    wrong[5].filter.accelerometer.sigma = f32::INFINITY;
    let fields = [
        ("filter.velocity_noise", Problem::NotPositive),
        ("filter.gyro.tau_s", Problem::OutOfRange),
        ("filter.radius_m", Problem::NotFinite),
        ("identification.interval_s", Problem::NotPositive),
        ("identification.limit_factor", Problem::OutOfRange),
        ("filter.accelerometer.sigma", Problem::NotFinite),
    ];
    for (config, (field, problem)) in wrong.iter().zip(fields) {
        let error = module.configure(config).unwrap_err();
        assert_eq!((error.field, error.problem), (field, problem));
    }
    assert_eq!(module.step(&input(2000, Reading::good(0.1))).step, 2);
}

#[test]
fn without_configuration_nothing_is_computed() {
    let mut module = Box::new(FlightModule::new());
    let output = module.step(&input(1000, Reading::good(0.1)));
    assert_eq!(output.status, Status::NOT_CONFIGURED);
    println!("the module's state takes {} bytes", size_of::<FlightModule>());
}
