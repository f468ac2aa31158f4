//! The compensation, the temperature rate and the health monitor as parts of the one step.
use schuler_core::compensation::{
    Block, Calibration, Compensator, Factor, Known, Limits, LoopResponse, Quantity, Target, Term, TermStatus,
    Validity,
};
use schuler_core::health::{HealthConfig, Suspect, Verdict};
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput};
use schuler_core::reading::Reading;
use schuler_core::thermal::{self, CompensationBlock, TemperatureRateConfig, ThermalState, ThermalStatus};
use schuler_tests::golden_records::{MinimalStandard, fly, scenario_r1};

fn factor(quantity: Quantity, reference: f32, power: u8) -> Factor {
    Factor { quantity, reference, power }
}

fn block(terms: &[Term]) -> Block {
    Block { terms: terms.iter().copied().collect(), ..Block::default() }
}

fn module(config: &ModuleConfig, block: Option<&Block>) -> Box<FlightModule> {
    let mut module = Box::new(FlightModule::new());
    module.configure(config).unwrap();
    if let Some(block) = block {
        module.load_compensation(block).unwrap();
    }
    module
}

/// Every kind of term, alone: the error that it describes, put on a true input in double precision, is taken off again.
#[test]
fn each_kind_of_term_takes_its_error_off() {
    let one = Factor::default();
    let (temperature, other, rate) = (41.0, 38.5, 3e-3);
    let state =
        |temperature, rate| ThermalState { temperature: Some(temperature), rate: Some(rate), gradient: None };
    let thermometers = [state(20.0, 0.0), state(temperature, rate), state(other, 0.0), state(0.0, 0.0)];
    // True inputs: rates of a manoeuvre, 1 g and a bit.
    let gyros = [0.3, -0.2, 0.1, 0.4, -0.5];
    let forces = [0.4, -0.9, -9.7];
    let warm = 41.0 - 20.0;
    let t = factor(Quantity::Temperature(1), 20.0, 1);
    // Coefficient, factors, and what they come to for gyro 3, whose input is 0.4 rad/s.
    let kinds: [(f32, [Factor; 2], f64); 14] = [
        (2e-6, [one, one], 2e-6),
        (1e-7, [t, one], 1e-7 * warm),
        (1e-8, [factor(Quantity::Temperature(1), 20.0, 2), one], 1e-8 * warm * warm),
        (1e-9, [factor(Quantity::Temperature(1), 20.0, 3), one], 1e-9 * warm * warm * warm),
        (1e-4, [factor(Quantity::TemperatureRate(1), 0.0, 1), one], 1e-4 * 3e-3),
        (1e-6, [factor(Quantity::TemperatureDifference(1, 2), 0.0, 1), one], 1e-6 * 2.5),
        (2e-3, [Quantity::Input.into(), one], 2e-3 * 0.4),
        (1e-5, [Quantity::Input.into(), t], 1e-5 * 0.4 * warm),
        (1e-4, [Quantity::InputMagnitude.into(), one], 1e-4 * 0.4),
        (1e-4, [factor(Quantity::Input, 0.0, 2), one], 1e-4 * 0.16),
        (3e-8, [Quantity::SpecificForce(2).into(), one], 3e-8 * -9.7),
        (1e-9, [Quantity::SpecificForce(0).into(), Quantity::SpecificForce(2).into()], 1e-9 * 0.4 * -9.7),
        (1e-9, [Quantity::SpecificForce(1).into(), t], 1e-9 * -0.9 * warm),
        (5e-4, [Quantity::Rate(0).into(), one], 5e-4 * 0.3),
    ];
    let mut all = Vec::new();
    let mut total = 0.0;
    for (coefficient, factors, error) in kinds {
        let term = Term { target: Target::Gyro(3), coefficient, factors };
        all.push(term);
        total += error;
        let check = |terms: &[Term], error: f64, what: &str| {
            let mut outputs = gyros.map(Some);
            outputs[3] = Some(gyros[3] + error);
            let known =
                Known { thermometers, gyros: outputs, accelerometers: forces.map(Some), velocity: None };
            let corrected = Compensator::try_build(&block(terms)).unwrap().correct(&known);
            assert_eq!(corrected.terms, TermStatus::empty(), "{what}");
            let left = corrected.gyros[3] - gyros[3];
            // Three rounds leave the fourth power of a scale factor; single precision leaves a ten-millionth.
            assert!(left.abs() < 2e-7 * error.abs() + 1e-11, "{what}: {left} of {error}");
            for k in [0, 1, 2, 4] {
                assert_eq!(corrected.gyros[k], gyros[k], "{what}");
            }
            assert_eq!(corrected.accelerometers, forces, "{what}");
        };
        check(&[term], error, &format!("{factors:?}"));
    }
    let outputs = gyros.map(Some);
    let known = Known {
        thermometers,
        gyros: [outputs[0], outputs[1], outputs[2], Some(gyros[3] + total), outputs[4]],
        accelerometers: forces.map(Some),
        velocity: None,
    };
    let corrected = Compensator::try_build(&block(&all)).unwrap().correct(&known);
    assert!((corrected.gyros[3] - gyros[3]).abs() < 1e-9, "all together: {}", corrected.gyros[3] - gyros[3]);
}

/// The calibration of a complete unit is the one that was there before, and terms are taken off what it leaves.
#[test]
fn tmp_11_the_calibration_of_a_unit_comes_first() {
    let mut coefficients = CompensationBlock::default();
    coefficients.gyro.bias[0] = [1e-5, 2e-6, 3e-6, 0.0, 0.0, 0.0];
    coefficients.gyro.matrix[1][2] = [2e-3, 1e-4, 0.0, 0.0, 0.0, 0.0];
    coefficients.accelerometer.matrix[2][0] = [-1e-3, 0.0, 0.0, 0.0, 0.0, 0.0];
    let state = ThermalState { temperature: Some(50.0), rate: Some(2e-3), gradient: None };
    let term = Term { target: Target::Gyro(1), coefficient: 1e-6, ..Term::default() };
    let both = Block { calibration: Some(Calibration { thermometer: 2, coefficients }), ..block(&[term]) };
    let mut thermometers = [ThermalState::default(); 4];
    thermometers[2] = state;
    let (rates, forces) = ([0.1, -0.2, 0.3], [1.0, 2.0, -9.0]);
    let known = Known {
        thermometers,
        gyros: [Some(0.1), Some(-0.2), Some(0.3), Some(0.4), None],
        accelerometers: forces.map(Some),
        velocity: None,
    };
    let corrected = Compensator::try_build(&both).unwrap().correct(&known);
    let expected = thermal::Compensator::try_build(&coefficients).unwrap().correction(&state);
    let [x, y, z] = expected.rate(rates);
    assert_eq!(corrected.gyros, [x, y - f64::from(1e-6f32), z, 0.4, 0.0]);
    assert_eq!(corrected.accelerometers, expected.specific_force(forces));
    assert_eq!(corrected.calibration, expected.status);
}

#[test]
fn what_is_missing_or_out_of_range_is_flagged_and_held() {
    let term = |coefficient: f32, quantity: Quantity, reference: f32| Term {
        target: Target::Gyro(0),
        coefficient,
        factors: [factor(quantity, reference, 1), Factor::default()],
    };
    let validity = Validity { temperature_range: [0.0, 40.0], rate_limit: 1e-2 };
    let correct = |term: Term, thermometer: ThermalState| {
        let block = Block { validity, limits: Limits { gyro: 1e-4, ..Limits::default() }, ..block(&[term]) };
        let known = Known { thermometers: [thermometer; 4], gyros: [Some(0.0); 5], ..Known::default() };
        let corrected = Compensator::try_build(&block).unwrap().correct(&known);
        (-corrected.gyros[0], corrected.terms)
    };
    let at = |temperature: f32| ThermalState { temperature: Some(temperature), ..ThermalState::default() };
    let close = |(found, flags): (f64, TermStatus), expected: f64, flag: TermStatus| {
        assert!((found - expected).abs() <= 1e-6 * expected.abs(), "{found} instead of {expected}");
        assert_eq!(flags, flag);
    };
    let of_temperature = term(1e-6, Quantity::Temperature(0), 20.0);
    close(correct(of_temperature, at(30.0)), 1e-5, TermStatus::empty());
    close(correct(of_temperature, at(45.0)), 2.5e-5, TermStatus::OUT_OF_RANGE);
    close(correct(of_temperature, at(90.0)), 3e-5, TermStatus::OUT_OF_RANGE);
    close(correct(of_temperature, ThermalState::default()), 0.0, TermStatus::INPUT_MISSING);
    close(correct(of_temperature, at(f32::NAN)), 0.0, TermStatus::INPUT_MISSING);
    close(correct(term(1e-3, Quantity::TemperatureRate(0), 0.0), at(30.0)), 0.0, TermStatus::INPUT_MISSING);
    // A thermometer that no term looks at does not matter.
    close(correct(term(1e-6, Quantity::One, 0.0), at(90.0)), 1e-6, TermStatus::empty());
    close(correct(term(1.0, Quantity::SpecificForce(1), 0.0), at(30.0)), 0.0, TermStatus::INPUT_MISSING);
    close(correct(term(1e-2, Quantity::Temperature(0), 20.0), at(30.0)), 1e-4, TermStatus::LIMITED);
}

/// A sensor error in the loop that is known: the filter sees what it would see without it, and the estimate has both.
#[test]
fn known_errors_in_the_loop_leave_the_filter_as_it_would_be_without_them() {
    let temperature = |k: usize| 25.0 + 10.0 * (k as f32 / 400.0).sin();
    let terms = [
        Term {
            target: Target::LoopAccelerometer,
            coefficient: 2e-4,
            factors: [factor(Quantity::Temperature(0), 25.0, 1), Factor::default()],
        },
        Term { target: Target::LoopGyro, coefficient: 1e-6, ..Term::default() },
        Term { target: Target::Velocity, coefficient: 0.75, ..Term::default() },
    ];
    let config = ModuleConfig {
        thermometers: [Some(TemperatureRateConfig::of_quantum(1e-3)), None, None, None],
        ..ModuleConfig::default()
    };
    let (mut plain, mut corrected) = (module(&config, None), module(&config, Some(&block(&terms))));
    let mut generator = MinimalStandard::new(31);
    let flight = fly(&scenario_r1(), 3000, || generator.normal());
    let mut response = LoopResponse::default();
    let (mut furthest, mut last_ms) = (0.0f32, 0);
    for (k, &z) in flight.measured.iter().enumerate() {
        // A gap, which the loop does not know of.
        if (1500..1540).contains(&k) {
            continue;
        }
        let time_ms = 1000 * (k as u64 + 1);
        let mut input = StepInput::without_readings(time_ms);
        input.velocity_error = Reading::good(z as f32);
        input.thermometers[0] = Reading::good(temperature(k));
        let without = plain.step(&input);

        // What the module will know is what its own thermometer says.
        let known = without.thermometers[0].temperature;
        let errors = [2e-4 * (known - 25.0), 1e-6];
        let steps = (time_ms - last_ms) / 1000;
        last_ms = time_ms;
        response.pass(errors, config.filter.radius_m, config.filter.gravity, steps as f64);
        input.velocity_error = Reading::good((z + f64::from(response.velocity())) as f32 + 0.75);
        let with = corrected.step(&input);

        let scale = [1e-4, 1e-9, 1e-8, 1e-12];
        for (state, known) in response.states().iter().enumerate() {
            let averaged = with.identification.averaged.estimate[state];
            let expected = without.identification.averaged.estimate[state] + known;
            let tolerance = 20.0 * scale[state] + 1e-3 * without.identification.averaged.sigma[state];
            assert!(
                (averaged - expected).abs() < tolerance,
                "step {k}, state {state}: {averaged} {expected}"
            );
            let (found, expected) = (with.filter.estimate[state], without.filter.estimate[state] + known);
            assert!((found - expected).abs() < tolerance, "step {k}, state {state}: {found} {expected}");
        }
        assert!((with.filter.nis - without.filter.nis).abs() < 0.01 * (1.0 + without.filter.nis));
        furthest = furthest.max(response.velocity().abs());
    }
    assert!(furthest > 1.0, "the known part must be large against the noise: {furthest}");
}

#[test]
fn a_block_for_the_velocity_channel_loaded_in_flight_restarts_it_and_says_so() {
    let velocity = block(&[Term { target: Target::Velocity, coefficient: 0.25, ..Term::default() }]);
    let gyro = block(&[Term { target: Target::Gyro(0), coefficient: 1e-7, ..Term::default() }]);
    let mut module = module(&ModuleConfig::default(), None);
    let step = |module: &mut FlightModule, k: u64| {
        let mut input = StepInput::without_readings(1000 * k);
        input.velocity_error = Reading::good(0.25);
        module.step(&input)
    };
    for k in 1..100 {
        step(&mut module, k);
    }
    module.load_compensation(&gyro).unwrap();
    let output = step(&mut module, 100);
    assert_eq!(output.status, Status::COMPENSATION_LOADED);
    module.load_compensation(&velocity).unwrap();
    let output = step(&mut module, 101);
    assert_eq!(output.status, Status::COMPENSATION_LOADED | Status::VELOCITY_RESTARTED);
    assert_eq!(output.filter.innovation, 0.0);
    // And its leaving restarts it too.
    module.load_compensation(&gyro).unwrap();
    assert!(step(&mut module, 102).status.contains(Status::VELOCITY_RESTARTED));
    assert_eq!(step(&mut module, 103).status, Status::empty());
}

/// Temperature and rate of a quantised ramp, and a jump of a radio, through the whole step.
#[test]
fn a_ramp_and_a_jump_are_seen_through_the_step() {
    let config = ModuleConfig {
        thermometers: [None, Some(TemperatureRateConfig::of_quantum(0.0625)), None, None],
        health: Some(HealthConfig::doppler_against_inertial()),
        ..ModuleConfig::default()
    };
    let mut module = module(&config, None);
    let mut generator = MinimalStandard::new(4);
    let mut error = 0.0;
    let mut verdicts = Vec::new();
    for k in 1..=3600u64 {
        let mut input = StepInput::without_readings(1000 * k);
        let temperature = 20.0 + 12.0 * (k as f32 / 3600.0);
        input.thermometers[1] = Reading::good((temperature * 16.0).round() / 16.0);
        error += -0.1 * error + 0.128 * generator.normal() as f32;
        let jump = if (1800..2100).contains(&k) { 2.5 } else { 0.0 };
        input.radio_velocity = Reading::good(100.0 + error + jump);
        input.inertial_velocity = Reading::good(100.0);
        let output = module.step(&input);
        if k > 900 {
            let thermometer = output.thermometers[1];
            assert!((thermometer.rate * 3600.0 - 12.0).abs() < 0.5, "{k}: {thermometer:?}");
            assert!((thermometer.temperature - temperature).abs() < 0.05, "{k}: {thermometer:?}");
        }
        assert!(output.thermometers[0].status.contains(ThermalStatus::NO_READING));
        verdicts.push((output.health.verdict, output.health.suspect));
    }
    let jumped = verdicts.iter().position(|(verdict, _)| *verdict == Verdict::ShiftedMean).unwrap() + 1;
    assert!((1800..1815).contains(&jumped), "{jumped}");
    assert_eq!(verdicts[1900], (Verdict::ShiftedMean, Suspect::Radio));
    assert_eq!(verdicts[2400], (Verdict::Nominal, Suspect::Neither));
}
