//! The health monitor's guards: gaps, unusable readings, residuals out of the model, restarts; the verdict and
//! whom it names [HLT-5], [HLT-6].
use proptest::prelude::*;
use schuler_core::config::Problem;
use schuler_core::health::{
    HealthAlarms, HealthConfig, HealthMonitor, HealthOutput, HealthStatus, Suspect, Verdict,
};
use schuler_core::reading::{Quality, Reading};
use schuler_tests::health_reference::generator::{Generator, Sample};
use schuler_tests::health_reference::model::{Filter, Mode, Model};
use schuler_tests::health_reference::monitored::Monitored;

const NOMINAL: Mode = Mode { jump: false, level: 0 };
const JUMP: Mode = Mode { jump: true, level: 0 };
const NOISE: Mode = Mode { jump: false, level: 1 };

fn flight(seed: u64, modes: &[(Mode, usize)], jump: f64) -> Vec<Sample> {
    let modes: Vec<_> = modes.iter().flat_map(|&(mode, steps)| vec![mode; steps]).collect();
    Generator::new(&Model::doppler(), seed).scripted(&modes, Some(jump))
}

fn feed<const LEVELS: usize>(monitored: &mut Monitored<f64, LEVELS>, samples: &[Sample]) {
    for sample in samples {
        monitored.step(Some(sample.d));
    }
}

/// Everything of an output that a gap must not change, as plain numbers.
fn numbers(output: &HealthOutput<f64, 2>) -> Vec<f64> {
    let estimates = [output.radio_error, output.inertial_error, output.jump, output.inertial_drift];
    let mut all: Vec<f64> = output.mode_probability.as_flattened().to_vec();
    all.extend(estimates.iter().flat_map(|estimate| [estimate.value, estimate.sigma]));
    all.extend([output.innovation, output.innovation_variance, output.nis, output.log_likelihood]);
    all
}

/// One call over a gap of n steps gives what n calls without a residual give.
#[test]
fn hlt_6_gap_is_as_many_missing_steps() {
    let samples = flight(1, &[(NOMINAL, 200), (JUMP, 40), (NOISE, 700)], 1.0);
    for start in [150, 205, 250] {
        for gap in [1, 2, 3, 7, 40, 59, 60, 333, 600] {
            let mut at_once = Monitored::<f64, 2>::delivered();
            feed(&mut at_once, &samples[..start]);
            let mut one_by_one = at_once;
            let d = samples[start + gap - 1].d;
            for _ in 1..gap {
                one_by_one.feed(None, 1);
            }
            one_by_one.feed(Some(d), 1);
            at_once.feed(Some(d), gap as u32);
            assert_eq!(at_once.output.status.contains(HealthStatus::GAP), gap > 1);
            assert_eq!(numbers(&at_once.output), numbers(&one_by_one.output), "gap {gap} from {start}");
        }
    }
}

#[test]
fn hlt_6_unusable_readings_are_missing_residuals() {
    let good = Reading::good;
    let with = |quality, age_ms| Reading { value: 1.0_f32, age_ms, quality };
    let radio = HealthStatus::RADIO_UNUSABLE;
    let inertial = HealthStatus::INERTIAL_UNUSABLE;
    let cases = [
        (Reading::missing(), good(0.0), radio),
        (good(f32::NAN), good(0.0), radio),
        (good(f32::INFINITY), good(0.0), radio),
        (with(Quality::Saturated, 0), good(0.0), radio),
        (with(Quality::Good, 1501), good(0.0), radio),
        (good(0.4), Reading::missing(), inertial),
        (good(0.4), good(f32::NAN), inertial),
        (good(0.4), with(Quality::Good, 2000), inertial),
        (good(f32::NAN), good(f32::NEG_INFINITY), radio | inertial),
        // Each is a number, their difference is not.
        (good(f32::MAX), good(-f32::MAX), HealthStatus::empty()),
    ];
    let mut before = Monitored::<f32, 2>::delivered();
    for sample in flight(2, &[(NOMINAL, 100), (JUMP, 5)], 1.0) {
        before.step(Some(sample.d));
    }
    let mut missing = before;
    missing.feed(None, 1);
    for (radio, inertial, status) in cases {
        let mut monitored = before;
        let output = monitored.monitor.step(&radio, &inertial, 1);
        assert_eq!(output.status, status, "{radio:?} {inertial:?}");
        assert_eq!(output.mode_probability, missing.output.mode_probability);
        assert_eq!(output.inertial_error, missing.output.inertial_error);
        assert_eq!(
            (output.residual, output.innovation, output.nis, output.log_likelihood),
            (0.0, 0.0, 0.0, 0.0)
        );
    }
}

/// With one sensor gone the other is still corrected, and with both there is no value.
#[test]
fn hlt_5_corrected_value_from_what_there_is() {
    let mut before = Monitored::<f64, 2>::delivered();
    feed(&mut before, &flight(3, &[(NOMINAL, 300), (JUMP, 30)], 2.0));
    let (radio, inertial) = (Reading::good(102.3), Reading::good(100.2));
    let step = |radio: &Reading<f64>, inertial: &Reading<f64>| { before }.monitor.step(radio, inertial, 1);

    let both = step(&radio, &inertial);
    let corrected = both.corrected.expect("two readings");
    assert!((corrected.value - (102.3 - both.radio_error.value)).abs() < 1e-12);
    assert!((corrected.value - (100.2 - both.inertial_error.value)).abs() < 1e-12);
    assert_eq!(corrected.sigma, both.inertial_error.sigma);

    let no_radio = step(&Reading::missing(), &inertial);
    let corrected = no_radio.corrected.expect("an inertial reading");
    assert!((corrected.value - (100.2 - no_radio.inertial_error.value)).abs() < 1e-12);

    let no_inertial = step(&radio, &Reading::missing());
    let corrected = no_inertial.corrected.expect("a radio reading");
    assert!((corrected.value - (102.3 - no_inertial.radio_error.value)).abs() < 1e-12);
    // The jump of 2 m/s is known and taken off; what is left is ε, 0.3 m/s, and the jump's own end.
    assert!((no_inertial.radio_error.value - 2.0).abs() < 0.7, "{:?}", no_inertial.radio_error);
    assert!(corrected.sigma > 0.2);

    assert_eq!(step(&Reading::missing(), &Reading::missing()).corrected, None);
}

/// A repeated step brings no information, however often it comes.
#[test]
fn hlt_6_repeated_step_changes_nothing() {
    let mut monitored = Monitored::<f64, 2>::delivered();
    feed(&mut monitored, &flight(4, &[(NOMINAL, 100)], 0.0));
    let before = monitored.output;
    for _ in 0..10 {
        monitored.feed(Some(5.0), 0);
        assert!(monitored.output.status.contains(HealthStatus::REPEATED));
        for (now, before) in monitored
            .output
            .mode_probability
            .as_flattened()
            .iter()
            .zip(before.mode_probability.as_flattened())
        {
            assert!((now - before).abs() < 1e-12);
        }
        assert!((monitored.output.inertial_error.sigma - before.inertial_error.sigma).abs() < 1e-12);
    }
}

#[test]
fn hlt_6_restart_after_the_limit_and_not_before() {
    let samples = flight(5, &[(NOMINAL, 900)], 0.0);
    let mut settled = Monitored::<f64, 2>::delivered();
    assert_eq!(settled.output.verdict, Verdict::Unobserved);
    feed(&mut settled, &samples[..200]);
    assert_eq!(settled.output.verdict, Verdict::Nominal);
    let mut fresh = Monitored::<f64, 2>::delivered();
    fresh.feed(Some(samples[850].d), 1);

    let mut bridged = settled;
    bridged.feed(Some(samples[850].d), 600);
    assert!(!bridged.output.status.contains(HealthStatus::RESTARTED));
    assert!(bridged.output.inertial_error.sigma < 0.4);

    let mut restarted = settled;
    restarted.feed(Some(samples[850].d), 601);
    assert!(restarted.output.status.contains(HealthStatus::RESTARTED));
    assert_eq!(restarted.output.mode_probability, fresh.output.mode_probability);
    assert_eq!(restarted.output.inertial_error, fresh.output.inertial_error);
    // Nobody's fault that the counter ran over.
    let mut overflown = settled;
    overflown.feed(None, u32::MAX);
    overflown.feed(Some(samples[850].d), u32::MAX);
    assert_eq!(overflown.output.mode_probability, fresh.output.mode_probability);

    // Silent second by second: no verdict after a minute, the priors after ten.
    let mut silent = settled;
    for second in 1..=650 {
        silent.feed(None, 1);
        let verdict = if second <= 60 { Verdict::Nominal } else { Verdict::Unobserved };
        assert_eq!(silent.output.verdict, verdict, "{second}");
        assert_eq!(silent.output.status.contains(HealthStatus::RESTARTED), second == 601, "{second}");
    }
    silent.feed(Some(samples[850].d), 1);
    assert_eq!(silent.output.mode_probability, fresh.output.mode_probability);
}

/// A wild value is flagged and leaves no trace; several in a row are a verdict; then all is as before.
#[test]
fn hlt_6_residual_out_of_the_model() {
    let samples = flight(6, &[(NOMINAL, 400)], 0.0);
    for wild in [15.0, -900.0, 1e30, f64::MAX] {
        let mut monitored = Monitored::<f64, 2>::delivered();
        feed(&mut monitored, &samples[..200]);
        let mut missing = monitored;
        monitored.feed(Some(wild), 1);
        missing.feed(None, 1);
        let output = monitored.output;
        assert!(output.status.contains(HealthStatus::OUT_OF_MODEL));
        assert_eq!(output.mode_probability, missing.output.mode_probability);
        assert_eq!(output.verdict, Verdict::Nominal);
        assert!(output.nis > 100.0 && output.nis <= 1e12);
        monitored.feed(Some(wild), 1);
        monitored.feed(Some(wild), 1);
        assert_eq!(
            (monitored.output.verdict, monitored.output.suspect),
            (Verdict::OutOfModel, Suspect::Either)
        );
        for sample in &samples[200..300] {
            monitored.feed(Some(sample.d), 1);
        }
        assert_eq!(
            (monitored.output.verdict, monitored.output.suspect),
            (Verdict::Nominal, Suspect::Neither)
        );
    }
}

/// One wild value, whatever its size and whenever it comes, is no lasting fault. The worst time is the start, when the
/// inertial error is known least: with a wider gate a part of the value would be taken for it, and what is left then looks
/// like a jump that does not end, to the exact posterior also.
#[test]
fn hlt_6_one_wild_residual_is_forgotten() {
    for before in [0, 1, 3, 10, 200] {
        for seed in 20..24 {
            let samples = flight(seed, &[(NOMINAL, before + 120)], 0.0);
            let mut start = Monitored::<f64, 2>::delivered();
            feed(&mut start, &samples[..before]);
            for wild in (-200..=200).map(|half| 0.5 * f64::from(half)) {
                let mut monitored = start;
                monitored.feed(Some(wild), 1);
                feed(&mut monitored, &samples[before..]);
                let found = (monitored.output.verdict, monitored.output.suspect);
                let nothing = (Verdict::Nominal, Suspect::Neither);
                assert_eq!(found, nothing, "{wild} m/s after {before} residuals, seed {seed}");
            }
        }
    }
}

/// What each fault is called, and whom it is put down to.
#[test]
fn hlt_5_verdicts_and_suspects() {
    let both = Mode { jump: true, level: 1 };
    let after = |modes: &[(Mode, usize)], jump: f64, inertial: &dyn Fn(usize) -> f64| {
        let mut monitored = Monitored::<f64, 2>::delivered();
        for (k, sample) in flight(7, modes, jump).iter().enumerate() {
            monitored.feed(Some(sample.d - inertial(k)), 1);
        }
        (monitored.output.verdict, monitored.output.suspect)
    };
    let healthy = |_: usize| 0.0;
    let fault = |mode, seconds| after(&[(NOMINAL, 300), (mode, seconds)], 2.0, &healthy);
    assert_eq!(fault(NOMINAL, 60), (Verdict::Nominal, Suspect::Neither));
    assert_eq!(fault(JUMP, 60), (Verdict::ShiftedMean, Suspect::Radio));
    assert_eq!(fault(NOISE, 60), (Verdict::GrownNoise, Suspect::Radio));
    assert_eq!(fault(both, 60), (Verdict::ShiftedMeanAndGrownNoise, Suspect::Radio));
    // The same residual from the other sensor: put down to the radio …
    let step = |k: usize| if k >= 300 { -2.0 } else { 0.0 };
    assert_eq!(after(&[(NOMINAL, 360)], 0.0, &step), (Verdict::ShiftedMean, Suspect::Radio));
    // … until it has lasted longer than the radio's jumps do.
    assert_eq!(after(&[(NOMINAL, 1400)], 0.0, &step), (Verdict::ShiftedMean, Suspect::Radio));
    assert_eq!(after(&[(NOMINAL, 1600)], 0.0, &step), (Verdict::ShiftedMean, Suspect::Either));
    // A drift of the inertial sensor beyond its specification.
    let drift = |k: usize| 0.003 * k as f64;
    assert_eq!(after(&[(NOMINAL, 500)], 0.0, &drift), (Verdict::Nominal, Suspect::Neither));
    assert_eq!(after(&[(NOMINAL, 1200)], 0.0, &drift), (Verdict::InertialDivergence, Suspect::Inertial));
}

#[test]
fn hlt_5_alarms_have_hysteresis() {
    let mut monitored = Monitored::<f64, 2>::delivered();
    let (mut above, mut between) = (0, 0);
    let mut on = false;
    for sample in flight(8, &[(NOMINAL, 300), (JUMP, 120), (NOMINAL, 60), (JUMP, 120), (NOMINAL, 300)], 0.9) {
        monitored.step(Some(sample.d));
        let p = monitored.output.p_jump;
        on = p > 0.9 || (on && p >= 0.45);
        above += u32::from(p > 0.9);
        between += u32::from(on && p <= 0.9);
        assert_eq!(monitored.output.alarms.contains(HealthAlarms::JUMP), on);
    }
    assert!(above > 20 && between > 5, "the flight did not exercise the hysteresis: {above} {between}");
}

/// A broad prior is where single precision without Joseph's form loses the covariance within seconds.
#[test]
fn hlt_5_single_precision_with_a_broad_prior() {
    let model = Model { sigma_xi0: 1000.0, ..Model::doppler() };
    for seed in 0..5 {
        let mut single = Monitored::<f32, 2>::new(&model);
        let mut double = Monitored::<f64, 2>::new(&model);
        for (k, sample) in Generator::new(&model, seed).natural(1800).iter().enumerate() {
            let (a, b) = (single.step(Some(sample.d)), double.step(Some(sample.d)));
            assert!(!single.output.status.contains(HealthStatus::NUMERICAL_RESET), "seed {seed}, step {k}");
            let difference = (a.state.mean.y - b.state.mean.y).abs();
            assert!(difference < 0.1, "seed {seed}, step {k}: ξ differs by {difference}");
        }
    }
}

/// A day in single precision takes the same decisions as in double precision.
#[test]
fn hlt_5_single_precision_over_a_day() {
    let model = Model::doppler();
    let (mut single, mut double) = (Monitored::<f32, 2>::delivered(), Monitored::<f64, 2>::delivered());
    let (mut probability, mut verdicts): (f64, u32) = (0.0, 0);
    for sample in Generator::new(&model, 9).natural(86_400) {
        let (a, b) = (single.step(Some(sample.d)), double.step(Some(sample.d)));
        probability = a.modes.iter().zip(&b.modes).map(|(a, b)| (a - b).abs()).fold(probability, f64::max);
        verdicts += u32::from(single.output.verdict != double.output.verdict);
    }
    println!("24 h, f32 against f64: largest |w difference| {probability:.1e}, {verdicts} verdicts differ");
    assert!(probability < 5e-3);
    assert!(verdicts <= 2);
}

fn arbitrary_value() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -3.0_f32..3.0,
        2 => -100.0_f32..100.0,
        1 => any::<f32>(),
        1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::MAX), Just(f32::MIN), Just(f32::MIN_POSITIVE)],
    ]
}

fn arbitrary_reading() -> impl Strategy<Value = Reading<f32>> {
    let quality =
        prop_oneof![8 => Just(Quality::Good), 1 => Just(Quality::Saturated), 1 => Just(Quality::Missing)];
    (arbitrary_value(), 0..2000_u32, quality).prop_map(|(value, age_ms, quality)| Reading {
        value,
        age_ms,
        quality,
    })
}

fn arbitrary_gap() -> impl Strategy<Value = u32> {
    prop_oneof![8 => Just(1_u32), 1 => 0..1100_u32, 1 => any::<u32>()]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever comes in, what comes out are numbers, probabilities and positive variances.
    #[test]
    fn hlt_6_any_input_leaves_the_state_usable(
        inputs in prop::collection::vec((arbitrary_reading(), arbitrary_reading(), arbitrary_gap()), 1..150),
    ) {
        let mut monitor = HealthMonitor::try_build(&HealthConfig::<f32, 2>::doppler_against_inertial()).expect("valid");
        for (radio, inertial, elapsed) in &inputs {
            let output = monitor.step(radio, inertial, *elapsed);
            prop_assert!(!output.status.contains(HealthStatus::NUMERICAL_RESET));
            let w = output.mode_probability.as_flattened();
            prop_assert!(w.iter().all(|w| *w >= 0.9e-9 && *w <= 1.0));
            prop_assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            let estimates = [output.radio_error, output.inertial_error, output.jump, output.inertial_drift];
            for estimate in estimates.iter().chain(&output.corrected) {
                prop_assert!(estimate.value.is_finite() && estimate.sigma.is_finite() && estimate.sigma >= 0.0);
            }
            prop_assert!(output.innovation.is_finite() && output.innovation_variance > 0.0);
            prop_assert!(output.nis >= 0.0 && output.nis <= 1e12 && output.log_likelihood.is_finite());
        }
    }
}

/// Configuration and output survive being sent.
#[test]
fn health_configuration_and_output_survive_being_sent() {
    let config = HealthConfig::<f32, 3>::doppler_against_inertial_three_levels();
    let text = serde_json::to_string(&config).expect("serialisable");
    assert_eq!(config, serde_json::from_str(&text).expect("the same"));
    let mut monitored = Monitored::with(&config);
    let output = *monitored.feed(Some(0.3), 1);
    let text = serde_json::to_string(&output).expect("serialisable");
    assert_eq!(output, serde_json::from_str(&text).expect("the same"));
}

/// Every field that cannot be flown is named.
#[test]
fn hlt_6_configuration_errors_name_the_field() {
    type Spoil = fn(&mut HealthConfig<f64, 2>);
    let cases: [(&str, Problem, Spoil); 26] = [
        ("health.step_s", Problem::NotPositive, |c| c.step_s = 0.0),
        ("health.radio.tau_s", Problem::NotFinite, |c| c.radio.tau_s = f64::NAN),
        ("health.radio.tau_s", Problem::OutOfRange, |c| c.radio.tau_s = 1e9),
        ("health.radio.sigma", Problem::NotPositive, |c| c.radio.sigma[1] = -0.3),
        ("health.radio.sigma", Problem::OutOfRange, |c| c.radio.sigma = [0.9, 0.3]),
        ("health.radio.normal_levels", Problem::OutOfRange, |c| c.radio.normal_levels = 0),
        ("health.radio.normal_levels", Problem::OutOfRange, |c| c.radio.normal_levels = 3),
        ("health.radio.transition", Problem::OutOfRange, |c| c.radio.transition[0][1] = 0.1),
        ("health.radio.transition", Problem::OutOfRange, |c| c.radio.transition[1] = [1.0, 0.0]),
        ("health.radio.transition", Problem::OutOfRange, |c| c.radio.transition[1] = [-0.1, 1.1]),
        ("health.radio.initial", Problem::OutOfRange, |c| c.radio.initial = [0.5, 0.4]),
        ("health.jump.sigma", Problem::NotPositive, |c| c.jump.sigma = 0.0),
        ("health.jump.transition", Problem::NotFinite, |c| c.jump.transition[1][0] = f64::INFINITY),
        ("health.jump.transition", Problem::OutOfRange, |c| c.jump.transition[0] = [0.0, 1.0]),
        ("health.jump.initial", Problem::OutOfRange, |c| c.jump.initial = [1.0, 1e-12]),
        ("health.jump.attribution_limit_s", Problem::NotPositive, |c| c.jump.attribution_limit_s = -1.0),
        ("health.inertial.random_walk", Problem::OutOfRange, |c| c.inertial.random_walk = -0.1),
        ("health.inertial.initial_sigma", Problem::NotPositive, |c| c.inertial.initial_sigma = 0.0),
        ("health.inertial.drift_sigma", Problem::NotFinite, |c| c.inertial.drift_sigma = f64::NAN),
        ("health.inertial.drift_random_walk", Problem::OutOfRange, |c| c.inertial.drift_random_walk = -1e-5),
        ("health.inertial.bound", Problem::NotPositive, |c| c.inertial.bound = 0.0),
        ("health.residual_sigma", Problem::NotPositive, |c| c.residual_sigma = 0.0),
        ("health.alarm.set", Problem::OutOfRange, |c| c.alarm.set = 1.0),
        ("health.alarm.clear", Problem::OutOfRange, |c| c.alarm.clear = 0.95),
        ("health.out_of_model_sigma", Problem::OutOfRange, |c| c.out_of_model_sigma = 2.0),
        ("health.restart_after_s", Problem::OutOfRange, |c| c.restart_after_s = 1024.0),
    ];
    let good = HealthConfig::<f64, 2>::doppler_against_inertial();
    assert!(HealthMonitor::try_build(&good).is_ok());
    for (field, problem, spoil) in cases {
        let mut config = good;
        spoil(&mut config);
        let error = HealthMonitor::try_build(&config).expect_err(field);
        assert_eq!((error.field, error.problem), (field, problem));
    }
    // A fault that never ends is a legitimate belief.
    let mut permanent = good;
    permanent.jump.transition[1] = [0.0, 1.0];
    assert!(HealthMonitor::try_build(&permanent).is_ok());
}
