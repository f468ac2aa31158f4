//! Whatever comes in, the flight module flags it, stays usable and gives finite numbers.

use proptest::prelude::*;
use schuler_core::compensation::{Block, Quantity, Target};
use schuler_core::config::Problem;
use schuler_core::health::{HealthConfig, HealthStatus, Verdict};
use schuler_core::module::{Command, FlightModule, ModuleConfig, Status, StepInput, StepOutput};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::{TemperatureRateConfig, ThermalStatus};
use schuler_tests::golden_records::{MinimalStandard, fly, scenario_r1};

use crate::common::flight::{Flight, everything, full_block};

fn started() -> Box<FlightModule> {
    let mut module = Box::new(FlightModule::new());
    module.configure(&everything()).unwrap();
    module
}

/// Good readings. The radio's last digits move, as those of one that works do: a value that it holds would be withheld.
fn input(time_ms: u64, velocity_error: Reading<f32>) -> StepInput {
    StepInput {
        velocity_error,
        gyros: [Reading::good(1e-5); 5],
        accelerometers: [0.1, -0.2, -9.8].map(Reading::good),
        thermometers: [20.0, 21.0, 22.0, 23.0].map(Reading::good),
        radio_velocity: Reading::good(10.0 + 1e-3 * (time_ms % 7) as f32),
        inertial_velocity: Reading::good(10.0),
        ..StepInput::without_readings(time_ms)
    }
}

fn is_finite(output: &StepOutput) -> bool {
    let filter = &output.filter;
    let averaged = &output.identification.averaged;
    let singles =
        filter.estimate.iter().chain(&filter.sigma).chain(&averaged.estimate).chain(&averaged.sigma);
    let isolation = &output.isolation;
    let health = &output.health;
    let corrected = health.corrected.unwrap_or_default();
    let of_health = [
        corrected,
        health.radio_error,
        health.inertial_error,
        health.jump,
        health.inertial_drift,
        health.correlated_error,
    ]
    .into_iter()
    .flat_map(|it| [it.value, it.sigma])
    .chain(health.mode_probability.into_iter().flatten())
    .chain([health.residual, health.innovation, health.innovation_variance, health.nis])
    .chain([health.log_likelihood, health.p_jump, health.p_noise, health.p_fault]);
    let compensation = &output.compensation;
    let of_thermometers = output
        .thermometers
        .iter()
        .flat_map(|it| [it.temperature, it.rate, it.temperature_sigma, it.rate_sigma])
        .chain(compensation.loop_errors)
        .chain([compensation.velocity]);
    singles.chain([&filter.innovation, &filter.innovation_variance, &filter.nis]).all(|x| x.is_finite())
        && isolation.rate.iter().chain(&isolation.parity).all(|x| x.is_finite())
        && compensation.gyros.iter().chain(&compensation.accelerometers).all(|x| x.is_finite())
        && of_health.chain(of_thermometers).all(f32::is_finite)
}

fn quality() -> impl Strategy<Value = Quality> {
    prop_oneof![Just(Quality::Good), Just(Quality::Saturated), Just(Quality::Missing)]
}

/// Any number at all, often one at an end of the numbers.
fn any_f32() -> impl Strategy<Value = f32> {
    const ENDS: [f32; 9] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        1e-45,
        -f32::MIN_POSITIVE / 2.0,
        -0.0,
        1e4,
    ];
    prop_oneof![any::<f32>(), prop::sample::select(&ENDS[..]), -100.0..100.0f32]
}

fn any_f64() -> impl Strategy<Value = f64> {
    const ENDS: [f64; 9] =
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 5e-324, -1e-310, -0.0, 1e30];
    prop_oneof![any::<f64>(), prop::sample::select(&ENDS[..]), -100.0..100.0f64]
}

fn reading<T: std::fmt::Debug>(value: impl Strategy<Value = T>) -> impl Strategy<Value = Reading<T>> {
    let age_ms = prop_oneof![0..4000u32, any::<u32>()];
    (value, age_ms, quality()).prop_map(|(value, age_ms, quality)| Reading { value, age_ms, quality })
}

fn any_input() -> impl Strategy<Value = StepInput> {
    let command = prop_oneof![Just(Command::None), any::<u8>().prop_map(Command::ReadmitGyro)];
    let singles = (reading(any_f32()), prop::array::uniform4(reading(any_f32())), reading(any_f32()));
    let doubles = (prop::array::uniform5(reading(any_f64())), prop::array::uniform3(reading(any_f64())));
    (any::<u64>(), singles, doubles, reading(any_f32()), command).prop_map(
        |(
            time_ms,
            (velocity_error, thermometers, radio_velocity),
            (gyros, accelerometers),
            inertial_velocity,
            command,
        )| StepInput {
            time_ms,
            velocity_error,
            gyros,
            accelerometers,
            thermometers,
            radio_velocity,
            inertial_velocity,
            command,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_input_poisons_the_state(
        garbage in prop::collection::vec(any_input(), 1..60),
        corrected in any::<bool>(),
    ) {
        let mut module = started();
        if corrected {
            // Without the terms that move the velocity: the truth below knows nothing of them.
            let mut block = full_block();
            block.terms.retain(|term| matches!(term.target, Target::Gyro(_) | Target::Accelerometer(_)));
            module.load_compensation(&block).unwrap();
        }
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
        // And so are, when their windows have passed, the temperatures and the radio.
        let mut output = output;
        for k in 902..3600 {
            output = module.step(&input(1000 * k, Reading::missing()));
        }
        for (thermometer, truth) in output.thermometers.iter().zip([20.0, 21.0, 22.0, 23.0]) {
            prop_assert!((thermometer.temperature - truth).abs() < 0.1, "{thermometer:?}");
        }
        prop_assert_eq!(output.health.verdict, Verdict::Nominal);
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
    let mut wrong = [good; 11];
    wrong[0].filter.velocity_noise = 0.0;
    wrong[1].filter.gyro.tau_s = 0.2;
    wrong[2].filter.radius_m = f32::NAN;
    wrong[3].identification.interval_s = -1.0;
    wrong[4].identification.limit_factor = 0.5;
    wrong[5].filter.accelerometer.sigma = f32::INFINITY;
    wrong[6].thermometers[3] = Some(TemperatureRateConfig::of_quantum(f32::NAN));
    wrong[7].thermometers[0] =
        Some(TemperatureRateConfig { window_s: 0, ..TemperatureRateConfig::of_quantum(0.1) });
    let mut health = HealthConfig::doppler_against_inertial();
    health.radio.tau_s = -1.0;
    wrong[8].health = Some(health);
    wrong[9].health = Some(HealthConfig { step_s: 2.0, ..HealthConfig::doppler_against_inertial() });
    wrong[10].isolation.sigma[2] = 0.0;
    let fields = [
        ("filter.velocity_noise", Problem::NotPositive),
        ("filter.gyro.tau_s", Problem::OutOfRange),
        ("filter.radius_m", Problem::NotFinite),
        ("identification.interval_s", Problem::NotPositive),
        ("identification.limit_factor", Problem::OutOfRange),
        ("filter.accelerometer.sigma", Problem::NotFinite),
        ("thermal.rate.quantum", Problem::NotFinite),
        ("thermal.rate.window_s", Problem::NotPositive),
        ("health.radio.tau_s", Problem::NotPositive),
        ("health.step_s", Problem::OutOfRange),
        ("isolation.sigma", Problem::NotPositive),
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

/// A day of disturbances, corrected by a full block, and not one number that is none.
#[test]
fn a_long_disturbed_flight_stays_finite() {
    for seed in 0..4 {
        let mut module = started();
        module.load_compensation(&full_block()).unwrap();
        for input in Flight::new(seed).take(40_000) {
            let output = module.step(&input);
            assert!(is_finite(&output), "seed {seed}: {input:?} {output:?}");
        }
    }
}

/// The time that the thermometers and the monitor live in: gaps are bridged, a repeated step is not new evidence, and a jump
/// starts both anew at once.
#[test]
fn the_new_parts_follow_the_clock() {
    let mut module = started();
    let at = |module: &mut FlightModule, time_ms| module.step(&input(time_ms, Reading::good(0.0)));
    // A constant temperature settles late, which is not the matter here.
    let thermal = |output: &StepOutput| output.thermometers[0].status - ThermalStatus::SETTLING;
    for k in 1..=700u64 {
        at(&mut module, 1000 * k);
    }
    let gap = at(&mut module, 800_000);
    assert_eq!(gap.health.status, HealthStatus::GAP);
    assert_eq!(thermal(&gap), ThermalStatus::empty());
    let repeated = at(&mut module, 800_000);
    assert_eq!(repeated.health.status, HealthStatus::REPEATED);
    assert_eq!(thermal(&repeated), ThermalStatus::REJECTED);
    // The clock was set back by an hour's tenth: one step is lost, not six minutes.
    let back = at(&mut module, 440_000);
    assert_eq!(thermal(&back), ThermalStatus::REJECTED);
    let next = at(&mut module, 441_000);
    assert_eq!((next.status, thermal(&next)), (Status::empty(), ThermalStatus::empty()));
    assert_eq!((next.health.status, next.health.verdict), (HealthStatus::empty(), Verdict::Nominal));
    // A gap longer than the thermometers bridge, and shorter than the filter does.
    let long = at(&mut module, 841_000);
    assert_eq!(thermal(&long), ThermalStatus::RESTARTED);
    // A jump.
    let jumped = at(&mut module, 90_000_000);
    assert_eq!(jumped.status, Status::CLOCK_JUMPED);
    assert!(jumped.thermometers[0].status.contains(ThermalStatus::RESTARTED));
    assert!(jumped.health.status.contains(HealthStatus::RESTARTED));
}

/// Old readings of the new sensors are not used either.
#[test]
fn stale_readings_of_the_new_sensors_are_not_used() {
    let mut module = started();
    module.load_compensation(&full_block()).unwrap();
    let mut old = input(1000, Reading::missing());
    old.accelerometers = old.accelerometers.map(|it| Reading { age_ms: 1501, ..it });
    old.thermometers = old.thermometers.map(|it| Reading { age_ms: 1501, ..it });
    old.radio_velocity.age_ms = 1501;
    let output = module.step(&old);
    assert_eq!(output.compensation.accelerometers, [0.0; 3]);
    assert_eq!(output.thermometers[2].status, ThermalStatus::NO_READING | ThermalStatus::REJECTED);
    assert_eq!(output.health.status, HealthStatus::RADIO_UNUSABLE);
    assert_eq!(output.health.verdict, Verdict::Unobserved);
}

/// A part that is off says that it has nothing, whatever it is given.
#[test]
fn parts_without_configuration_are_off() {
    let mut module = Box::new(FlightModule::new());
    module.configure(&ModuleConfig::default()).unwrap();
    for k in 1..=100 {
        let output = module.step(&input(1000 * k, Reading::good(0.0)));
        let thermometer = output.thermometers[1];
        assert_eq!(thermometer.status, ThermalStatus::NO_READING | ThermalStatus::REJECTED);
        assert_eq!((thermometer.temperature, thermometer.rate), (0.0, 0.0));
        assert_eq!(output.health.verdict, Verdict::Unobserved);
        assert!(!output.compensation.loaded);
        assert_eq!(output.compensation.gyros, [1e-5; 5], "as it came");
    }
}

/// A gyro that is stuck stays stuck though what is taken off it moves with the temperature.
#[test]
fn a_stuck_gyro_is_found_behind_a_correction_that_moves() {
    let mut module = started();
    let mut block = Block { calibration: None, ..full_block() };
    block.terms.retain(|term| {
        let [first, _] = term.factors;
        matches!(term.target, Target::Gyro(_)) && matches!(first.quantity, Quantity::Temperature(_))
    });
    assert!(block.terms.len() >= 10);
    module.load_compensation(&block).unwrap();
    let mut generator = MinimalStandard::new(5);
    let mut output = StepOutput::default();
    for k in 1..=200u64 {
        let mut step = input(1000 * k, Reading::good(0.0));
        step.gyros = [0; 5].map(|_| Reading::good(1e-7 * generator.normal()));
        step.gyros[3] = Reading::good(1e-7);
        step.thermometers = [20.0 + 0.01 * k as f32; 4].map(Reading::good);
        output = module.step(&step);
    }
    assert_eq!(output.isolation.excluded, 1 << 3, "{:?}", output.isolation);
}

#[test]
fn a_block_before_the_configuration_is_refused() {
    let mut module = Box::new(FlightModule::new());
    let error = module.load_compensation(&full_block()).unwrap_err();
    assert_eq!((error.field, error.problem), ("compensation", Problem::BeforeConfiguration));
}

/// A wrong block names its field and leaves the module as it was, bit by bit.
#[test]
fn a_wrong_block_names_its_field_and_leaves_the_module_as_it_was() {
    let (mut module, mut other) = (started(), started());
    for module in [&mut module, &mut other] {
        module.load_compensation(&full_block()).unwrap();
        module.step(&input(1000, Reading::good(0.1)));
    }
    let good = full_block();
    let mut wrong: Vec<_> = (0..14).map(|_| good.clone()).collect();
    wrong[0].terms[0].coefficient = f32::NAN;
    wrong[1].terms[1].factors[0].reference = f32::INFINITY;
    wrong[2].terms[2].factors[1].power = 0;
    wrong[3].terms[3].factors[1].power = 4;
    wrong[4].terms[4].target = Target::Gyro(5);
    wrong[5].terms[5].target = Target::Accelerometer(3);
    wrong[6].terms[6].factors[0].quantity = Quantity::TemperatureDifference(0, 4);
    wrong[7].validity.temperature_range = [50.0, 10.0];
    wrong[8].limits.gyro = 0.0;
    wrong[9].calibration.as_mut().unwrap().thermometer = 4;
    wrong[10].calibration.as_mut().unwrap().coefficients.version = 7;
    wrong[11].calibration.as_mut().unwrap().coefficients.gyro.bias[1][0] = f32::NAN;
    let scale = wrong[12].terms.iter_mut().find(|it| it.factors[0].quantity == Quantity::Input).unwrap();
    scale.coefficient = 0.5;
    let in_loop = wrong[13].terms.iter_mut().find(|it| it.target == Target::LoopGyro).unwrap();
    in_loop.factors[0].quantity = Quantity::Input;
    let fields = [
        "compensation.terms.coefficient",
        "compensation.terms.reference",
        "compensation.terms.power",
        "compensation.terms.power",
        "compensation.terms.target",
        "compensation.terms.target",
        "compensation.terms.quantity",
        "compensation.validity.temperature_range",
        "compensation.limits.gyro",
        "compensation.calibration.thermometer",
        "thermal.compensation.version",
        "thermal.compensation.gyro.bias",
        "compensation.terms.coefficient",
        "compensation.terms.quantity",
    ];
    for (block, field) in wrong.iter().zip(fields) {
        assert_eq!(module.load_compensation(block).unwrap_err().field, field);
    }
    for k in 2..20 {
        let input = input(1000 * k, Reading::good(0.1));
        assert_eq!(module.step(&input), other.step(&input));
    }
}
