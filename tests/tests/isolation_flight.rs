//! What the isolation does in flight: verdicts, reconfiguration, bad input, re-admission.

use crate::isolation_common::{Rates, axes_of_the_paper, generator, good, noise};
use nalgebra::{Matrix5x3, Vector3};
use proptest::prelude::*;
use rand::RngExt;
use rand_pcg::Pcg64;
use schuler_core::config::{ConfigError, Problem};
use schuler_core::isolation::{FaultIsolation, IsolationConfig, IsolationFlags, IsolationOutput, Verdict};
use schuler_core::reading::{Quality, Reading};

const SIGMA: f64 = 1e-7;
const ALL: u8 = 0b1_1111;

/// A block in flight with its own noise.
struct Flight {
    block: FaultIsolation,
    rng: Pcg64,
    /// Body rate, rad/s.
    rate: Vector3<f64>,
    /// Errors of the gyros, rad/s.
    errors: Rates,
}

impl Flight {
    fn with(config: &IsolationConfig, seed: u64) -> Self {
        Self {
            block: FaultIsolation::try_build(config).expect("can be flown"),
            rng: generator(100, seed),
            rate: Vector3::new(3e-5, -5e-5, 7e-5),
            errors: Rates::zeros(),
        }
    }

    fn new(seed: u64) -> Self {
        Self::with(&IsolationConfig::CONE, seed)
    }

    fn readings(&mut self) -> [Reading<f64>; 5] {
        good(&(axes_of_the_paper() * self.rate + self.errors + noise::<5>(&mut self.rng) * SIGMA))
    }

    fn step(&mut self) -> IsolationOutput {
        let readings = self.readings();
        self.block.step(&readings, None)
    }

    /// Steps until the condition holds; fails after `limit` samples.
    fn until(&mut self, limit: u32, condition: impl Fn(&IsolationOutput) -> bool) -> (u32, IsolationOutput) {
        (1..=limit)
            .map(|sample| (sample, self.step()))
            .find(|(_, output)| condition(output))
            .unwrap_or_else(|| panic!("did not happen in {limit} samples"))
    }

    fn last(&mut self, samples: u32) -> IsolationOutput {
        (0..samples).map(|_| self.step()).last().expect("at least one sample")
    }

    fn error_in_sigmas(&self, output: &IsolationOutput) -> f64 {
        (0..3).map(|i| ((output.rate[i] - self.rate[i]) / output.rate_sigma[i]).abs()).fold(0.0, f64::max)
    }
}

#[test]
fn fdi_9_hard_fault_is_isolated_and_the_rate_comes_from_the_other_four() {
    for faulty in 0..5_u8 {
        let mut flight = Flight::new(u64::from(faulty));
        let healthy = flight.last(1000);
        assert_eq!((healthy.verdict, healthy.gyros_used), (Verdict::NoFault, ALL));
        flight.errors[usize::from(faulty)] = 1e-4;
        let (samples, output) = flight.until(10, |o| o.flags.contains(IsolationFlags::ISOLATED));
        assert_eq!(samples, 3, "the persistence");
        assert_eq!(output.verdict, Verdict::Fault(faulty));
        assert_eq!(output.gyros_used, ALL & !(1 << faulty));
        for _ in 0..3000 {
            let output = flight.step();
            assert_eq!(output.verdict, Verdict::Fault(faulty));
            assert!(flight.error_in_sigmas(&output) < 5.0, "the fault leaks into the rate");
        }
        let output = flight.step();
        assert!((output.fault_size - 1e-4).abs() < 5.0 * output.fault_sigma);
        assert!(output.fault_sigma < SIGMA * 1.581 / 30.0);
        let variance = |o: &IsolationOutput| o.rate_sigma.iter().map(|s| s * s).sum::<f64>();
        assert!((variance(&output) / variance(&healthy) - 1.5).abs() < 1e-3);
    }
}

#[test]
fn fdi_6_slow_fault_is_isolated() {
    let mut flight = Flight::new(20);
    flight.last(1000);
    let mut size = 0.0;
    let output = loop {
        size += 0.002 * SIGMA;
        flight.errors[3] = -size;
        let output = flight.step();
        if output.flags.contains(IsolationFlags::ISOLATED) {
            break output;
        }
        assert!(size < 3.0 * SIGMA, "never isolated");
    };
    assert_eq!(output.verdict, Verdict::Fault(3));
    let output = flight.last(500);
    assert!(output.fault_size < 0.0 && (output.fault_size + size).abs() < 6.0 * output.fault_sigma);
}

#[test]
fn fdi_6_outlier_costs_the_sample_and_not_the_gyro() {
    let mut flight = Flight::new(30);
    flight.last(500);
    for _ in 0..20 {
        flight.errors[1] = 1e-3;
        let output = flight.step();
        assert_eq!(output.verdict, Verdict::Fault(1));
        assert!(output.flags.contains(IsolationFlags::OUTLIER));
        assert!(flight.error_in_sigmas(&output) < 5.0, "the outlier is in the rate");
        flight.errors[1] = 0.0;
        assert_eq!(flight.step().verdict, Verdict::NoFault);
        assert_eq!(flight.last(100).verdict, Verdict::NoFault);
    }
    assert_eq!(flight.block.excluded(), 0);
}

#[test]
fn fdi_9_second_fault_is_detected_and_there_is_no_rate() {
    let mut flight = Flight::new(40);
    flight.errors[0] = 1e-5;
    flight.last(3000);
    assert_eq!(flight.block.excluded(), 1);
    flight.errors[4] = 3.0 * SIGMA;
    let (samples, output) = flight.until(60, |o| o.flags.contains(IsolationFlags::SECOND_FAULT));
    println!("second fault of 3 σ found after {samples} samples");
    assert_eq!((output.verdict, output.gyros_used, output.rate), (Verdict::BlockUntrusted, 0, [0.0; 3]));
    assert_eq!(flight.last(5000).verdict, Verdict::BlockUntrusted);
}

#[test]
fn fdi_9_second_fault_that_goes_away_is_withdrawn() {
    let mut flight = Flight::new(41);
    flight.errors[0] = 1e-5;
    flight.last(3000);
    flight.errors[4] = 2.0 * SIGMA;
    flight.until(100, |o| o.flags.contains(IsolationFlags::SECOND_FAULT));
    flight.errors[4] = 0.0;
    let (_, output) = flight.until(600, |o| o.flags.contains(IsolationFlags::ALARM_WITHDRAWN));
    assert_eq!(output.verdict, Verdict::Fault(0));
}

#[test]
fn fdi_5_two_faults_at_once_leave_no_verdict_of_a_single_fault() {
    // Any two parity lines span the parity space, so that some pairs of faults look exactly like one in a third
    // gyro. Between neighbouring lines there is no third.
    for (second, size) in [(1, 0.6), (1, 1.0), (1, 2.0), (4, 0.5), (4, 1.4)] {
        let mut flight = Flight::new(50 + second as u64);
        flight.last(100);
        flight.errors[0] = 10.0 * SIGMA;
        flight.errors[second] = size * 10.0 * SIGMA;
        let mut verdicts = (0..500).map(|_| flight.step().verdict).collect::<Vec<_>>();
        assert_ne!(verdicts[2], Verdict::NoFault);
        let last = verdicts.pop().expect("many");
        println!("two faults, the second of {size} in {second}: {last:?}");
        assert!(matches!(last, Verdict::DetectedNotIsolated | Verdict::BlockUntrusted), "{last:?}");
        for verdict in verdicts {
            let named = if let Verdict::Fault(gyro) = verdict { usize::from(gyro) } else { 0 };
            assert!(named == 0 || named == second, "healthy gyro {named} is named");
        }
    }
}

#[test]
fn fdi_5_isolation_is_given_up_and_the_alarm_stays() {
    let mut config = IsolationConfig::CONE;
    config.give_up_samples = 50;
    config.margin = 100.0;
    let mut flight = Flight::with(&config, 55);
    flight.errors[0] = 1.0 * SIGMA;
    let (_, output) = flight.until(200, |o| o.flags.contains(IsolationFlags::GIVEN_UP));
    assert_eq!(output.verdict, Verdict::DetectedNotIsolated);
    assert_eq!(flight.last(1000).verdict, Verdict::DetectedNotIsolated);
    // When the disturbance is gone, agreement clears the alarm, as does the ground.
    flight.errors = Rates::zeros();
    assert_eq!(flight.last(1000).verdict, Verdict::DetectedNotIsolated);
    let readings = flight.readings();
    assert_eq!(flight.block.step(&readings, Some(0)).verdict, Verdict::NoFault);
}

#[test]
fn fdi_6_alarm_without_a_fault_is_withdrawn() {
    let mut flight = Flight::new(60);
    flight.last(100);
    // A disturbance between two parity lines that goes away again.
    flight.errors = Rates::new(2.0, 2.0, 0.0, 0.0, 0.0) * SIGMA;
    flight.errors[1] *= -1.0;
    flight.until(100, |o| o.flags.contains(IsolationFlags::ALARM_RAISED));
    flight.errors = Rates::zeros();
    let (samples, _) = flight.until(300, |o| o.flags.contains(IsolationFlags::ALARM_WITHDRAWN));
    println!("withdrawn after {samples} samples");
    assert_eq!(flight.last(100).verdict, Verdict::NoFault);
}

#[test]
fn fdi_9_readmission_by_command() {
    let mut flight = Flight::new(70);
    flight.errors[2] = 1e-5;
    flight.last(200);
    assert_eq!(flight.block.excluded(), 0b100);
    let readings = flight.readings();
    let output = flight.block.step(&readings, Some(5));
    assert!(output.flags.contains(IsolationFlags::COMMAND_REJECTED));
    assert_eq!(output.verdict, Verdict::Fault(2));

    // Taken back while it is still faulty: found again. Taken back healthy: it stays.
    let readings = flight.readings();
    let output = flight.block.step(&readings, Some(2));
    assert!(output.flags.contains(IsolationFlags::READMITTED));
    assert_eq!(flight.last(5).verdict, Verdict::Fault(2));
    flight.errors[2] = 0.0;
    assert_eq!(flight.last(100).verdict, Verdict::Fault(2));
    let readings = flight.readings();
    assert_eq!(flight.block.step(&readings, Some(2)).verdict, Verdict::NoFault);
    assert_eq!(flight.last(1000).verdict, Verdict::NoFault);
}

#[test]
fn fdi_9_readmission_after_agreement() {
    let mut config = IsolationConfig::CONE;
    config.readmit_samples = 1000;
    let mut flight = Flight::with(&config, 80);
    flight.errors[2] = 1e-5;
    flight.last(5000);
    assert_eq!(flight.block.excluded(), 0b100);
    // Half a σ in the mean is not health: the mean of ‖z‖² hardly shows it, the mean of z does.
    flight.errors[2] = 0.5 * SIGMA;
    flight.last(50_000);
    assert_eq!(flight.block.excluded(), 0b100);
    flight.errors[2] = 0.0;
    let (samples, output) = flight.until(20_000, |o| o.flags.contains(IsolationFlags::READMITTED));
    println!("taken back after {samples} samples");
    assert!(samples >= 1000);
    assert_eq!((output.verdict, output.gyros_used), (Verdict::NoFault, ALL));
    assert_eq!(flight.last(100).verdict, Verdict::NoFault);
}

#[test]
fn fdi_9_no_readmission_unless_it_is_configured() {
    let mut config = IsolationConfig::CONE;
    config.readmit_samples = 0;
    let mut flight = Flight::with(&config, 81);
    flight.errors[2] = 1e-5;
    flight.last(100);
    flight.errors[2] = 0.0;
    flight.last(50_000);
    assert_eq!(flight.block.excluded(), 0b100);
}

#[test]
fn fdi_10_every_kind_of_unusable_reading_costs_its_sample_only() {
    let unusable = [
        Reading::good(f64::NAN),
        Reading::good(f64::INFINITY),
        Reading::good(-f64::INFINITY),
        Reading::good(1.000_001),
        Reading::good(-1e300),
        Reading { value: 1e-5, age_ms: 0, quality: Quality::Saturated },
        Reading { value: 1e-5, age_ms: 0, quality: Quality::Missing },
        Reading { value: 1e-5, age_ms: 1501, quality: Quality::Good }.not_older_than(1500),
    ];
    let mut flight = Flight::new(90);
    flight.last(500);
    for (case, reading) in unusable.into_iter().enumerate() {
        let gyro = case % 5;
        let mut readings = flight.readings();
        readings[gyro] = reading;
        let output = flight.block.step(&readings, None);
        assert_eq!(output.verdict, Verdict::Fault(gyro as u8), "{reading:?}");
        assert_eq!(output.gyros_used, ALL & !(1 << gyro));
        assert!(output.flags.contains(IsolationFlags::READING_UNUSABLE));
        assert_eq!(output.parity, [0.0; 2]);
        assert_eq!(output.determinants.iter().filter(|d| **d != 0.0).count(), 1);
        assert!(flight.error_in_sigmas(&output) < 5.0);
        assert_eq!(flight.step().verdict, Verdict::NoFault);

        // Two of them: no rate in this sample, and nothing lost.
        let mut readings = flight.readings();
        readings[gyro] = reading;
        readings[(gyro + 2) % 5] = reading;
        let output = flight.block.step(&readings, None);
        assert_eq!((output.verdict, output.gyros_used, output.rate), (Verdict::BlockUntrusted, 0, [0.0; 3]));
        assert_eq!(flight.step().verdict, Verdict::NoFault);
    }
}

#[test]
fn fdi_10_unusable_samples_leave_the_sums_as_they_were() {
    // Two blocks see the same good samples; one of them sees unusable ones in between.
    let mut flight = Flight::new(91);
    let mut other = flight.block;
    for sample in 0..2000 {
        flight.errors[3] = 0.5 * SIGMA;
        let readings = flight.readings();
        let mut broken = readings;
        broken[sample % 5] = Reading::missing();
        other.step(&broken, None);
        let output = other.step(&readings, None);
        assert_eq!(flight.block.step(&readings, None), output);
        if output.flags.contains(IsolationFlags::ISOLATED) {
            return;
        }
    }
    panic!("never isolated");
}

#[test]
fn fdi_10_outlier_beside_a_missing_gyro_is_seen_by_the_determinant_without_it() {
    let mut flight = Flight::new(92);
    flight.last(100);
    flight.errors[1] = 1e-5;
    let mut readings = flight.readings();
    readings[3] = Reading::missing();
    let output = flight.block.step(&readings, None);
    assert_eq!(output.verdict, Verdict::BlockUntrusted);
    assert!(output.flags.contains(IsolationFlags::OUTLIER));
}

#[test]
fn fdi_10_stuck_gyro_is_excluded() {
    let mut flight = Flight::new(93);
    flight.last(50);
    let stuck = flight.readings()[4];
    for sample in 1..=30 {
        let mut readings = flight.readings();
        readings[4] = stuck;
        let output = flight.block.step(&readings, None);
        assert_eq!(output.flags.contains(IsolationFlags::STUCK), sample >= 10);
        assert_eq!(output.verdict, if sample >= 10 { Verdict::Fault(4) } else { Verdict::NoFault });
    }
    // It stays out when it moves again.
    assert_eq!(flight.step().verdict, Verdict::Fault(4));
}

#[test]
fn fdi_10_block_at_rest_within_its_quantisation_is_not_stuck() {
    let mut flight = Flight::new(94);
    let readings = flight.readings();
    let output = (0..10_000).map(|_| flight.block.step(&readings, None)).last().expect("many");
    assert_eq!(output.verdict, Verdict::NoFault);
    assert!(output.flags.contains(IsolationFlags::FROZEN) && !output.flags.contains(IsolationFlags::STUCK));
    // A hard fault is found all the same.
    let mut faulty = readings;
    faulty[2].value += 1e-4;
    let output = (0..3).map(|_| flight.block.step(&faulty, None)).last().expect("three");
    assert_eq!(output.verdict, Verdict::Fault(2));
}

#[test]
fn fdi_10_silent_gyro_is_lost_and_the_other_four_are_watched() {
    let mut flight = Flight::new(95);
    flight.last(50);
    let silent = |flight: &mut Flight, samples: u32| {
        (0..samples)
            .map(|_| {
                let mut readings = flight.readings();
                readings[0] = Reading::missing();
                flight.block.step(&readings, None)
            })
            .last()
            .expect("at least one sample")
    };
    assert!(!silent(&mut flight, 59).flags.contains(IsolationFlags::LOST));
    let output = silent(&mut flight, 1);
    assert!(output.flags.contains(IsolationFlags::LOST));
    assert_eq!((output.verdict, flight.block.excluded()), (Verdict::Fault(0), 1));
    assert_eq!((output.fault_size, output.fault_sigma), (0.0, 0.0));
    flight.errors[2] = 2.0 * SIGMA;
    assert_eq!(silent(&mut flight, 200).verdict, Verdict::BlockUntrusted);
}

#[test]
fn fdi_7_constant_errors_are_calibrated_and_frozen() {
    let mut config = IsolationConfig::CONE;
    config.calibration_samples = 20_000;
    let mut flight = Flight::with(&config, 110);
    flight.errors = Rates::new(5e-7, -3e-7, 8e-7, -6e-7, 2e-7);
    for _ in 0..20_000 {
        let output = flight.step();
        assert!(output.flags.contains(IsolationFlags::CALIBRATING));
        assert_eq!(output.verdict, Verdict::NoFault);
    }
    for _ in 0..5000 {
        let output = flight.step();
        assert_eq!(output.verdict, Verdict::NoFault);
    }
    // What was measured is the part of the errors that no rate explains.
    let axes = axes_of_the_paper();
    let residual = flight.errors
        - axes * (axes.tr_mul(&axes)).try_inverse().expect("regular") * axes.tr_mul(&flight.errors);
    let offset = Rates::from(flight.block.offset());
    assert!((offset - residual).amax() < 5.0 * SIGMA / f64::sqrt(20_000.0));
    // A new constant on top of it is a fault.
    flight.errors[1] += 3.0 * SIGMA;
    let (_, output) = flight.until(60, |o| o.flags.contains(IsolationFlags::ISOLATED));
    assert_eq!(output.verdict, Verdict::Fault(1));
}

#[test]
fn fdi_7_constant_that_is_too_large_is_a_fault() {
    let mut config = IsolationConfig::CONE;
    config.calibration_samples = 1000;
    let mut flight = Flight::with(&config, 111);
    flight.errors[1] = 1e-5;
    let (samples, output) = flight.until(1010, |o| o.verdict == Verdict::Fault(1));
    assert!(samples > 1000 && output.flags.contains(IsolationFlags::OFFSET_REJECTED));
}

#[test]
fn fdi_7_given_offsets_are_subtracted() {
    let mut config = IsolationConfig::CONE;
    config.offset = [5e-7, -3e-7, 8e-7, -6e-7, 2e-7];
    let mut flight = Flight::with(&config, 112);
    flight.errors = Rates::from(config.offset);
    for _ in 0..2000 {
        let output = flight.step();
        assert_eq!(output.verdict, Verdict::NoFault);
        assert!(flight.error_in_sigmas(&output) < 5.5);
    }
}

/// Errors of scale and alignment at their bound, of one draw of signs.
fn relative_errors(bound: f64, rng: &mut Pcg64) -> Matrix5x3<f64> {
    Matrix5x3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64)) * (bound / 3.0_f64.sqrt())
}

#[test]
fn fdi_7_errors_that_grow_with_the_rate_are_not_faults() {
    let config = IsolationConfig::CONE;
    for draw in 0..20 {
        let mut flight = Flight::with(&config, 120 + draw);
        let leak = relative_errors(config.relative_error, &mut flight.rng);
        // Slow turns below the limit of the sums, fast ones far above it.
        for magnitude in [1e-4, 1e-3, 1e-2, 0.2] {
            for sample in 0..500 {
                let angle = f64::from(sample) * 0.01;
                flight.rate = Vector3::new(angle.cos(), angle.sin(), 0.5).normalize() * magnitude;
                flight.errors = leak * flight.rate;
                let output = flight.step();
                assert_eq!(output.verdict, Verdict::NoFault, "draw {draw} rate {magnitude}");
                let fast = output.flags.contains(IsolationFlags::SUMS_SUSPENDED);
                assert_eq!(fast, magnitude > config.rate_limit);
            }
        }
    }
}

#[test]
fn fdi_7_hard_fault_in_a_fast_turn_is_isolated() {
    let mut flight = Flight::new(130);
    flight.rate = Vector3::new(0.05, 0.05, 0.02);
    flight.last(100);
    flight.errors[4] = 1e-3;
    let (samples, output) = flight.until(10, |o| o.flags.contains(IsolationFlags::ISOLATED));
    assert_eq!((samples, output.verdict), (3, Verdict::Fault(4)));

    // The fault itself feigns a rate that suspends the sums and inflates the noise.
    let mut flight = Flight::new(131);
    flight.last(100);
    flight.errors[0] = 0.9;
    let (samples, output) = flight.until(10, |o| o.flags.contains(IsolationFlags::ISOLATED));
    assert_eq!((samples, output.verdict), (3, Verdict::Fault(0)));
    assert!(flight.error_in_sigmas(&output) < 5.0);
}

#[test]
fn fdi_10_exact_zero_is_not_a_division() {
    let mut block = FaultIsolation::try_build(&IsolationConfig::CONE).expect("can be flown");
    let output = block.step(&[Reading::good(0.0); 5], None);
    assert_eq!((output.verdict, output.parity, output.rate), (Verdict::NoFault, [0.0; 2], [0.0; 3]));
}

#[test]
fn configuration_errors_name_the_field() {
    let field = |change: fn(&mut IsolationConfig)| -> ConfigError {
        let mut config = IsolationConfig::CONE;
        change(&mut config);
        FaultIsolation::try_build(&config).map(|_| ()).expect_err("must be rejected")
    };
    let out_of_range = |field| ConfigError::new(field, Problem::OutOfRange);
    assert_eq!(field(|c| c.false_alarm_interval = 10.0), out_of_range("isolation.false_alarm_interval"));
    assert_eq!(field(|c| c.margin = -1.0), out_of_range("isolation.margin"));
    assert_eq!(field(|c| c.persistence = 0), out_of_range("isolation.persistence"));
    assert_eq!(field(|c| c.give_up_samples = 0), out_of_range("isolation.give_up_samples"));
    assert_eq!(field(|c| c.relative_error = 0.5), out_of_range("isolation.relative_error"));
    assert_eq!(field(|c| c.rate_limit = 0.1), out_of_range("isolation.rate_limit"));
    assert_eq!(field(|c| c.stuck_samples = 1), out_of_range("isolation.stuck_samples"));
    assert_eq!(field(|c| c.lost_samples = 0), out_of_range("isolation.lost_samples"));
    assert_eq!(field(|c| c.range = 0.0), ConfigError::new("isolation.range", Problem::NotPositive));
    assert_eq!(field(|c| c.offset[3] = f64::NAN), ConfigError::new("isolation.offset", Problem::NotFinite));
    assert_eq!(field(|c| c.sigma[0] = 0.0), ConfigError::new("isolation.sigma", Problem::NotPositive));
    assert_eq!(field(|c| c.axes[2] = [0.0; 3]).field, "isolation.axes[2]");
}

#[test]
fn configuration_and_output_survive_serialisation() {
    let config: IsolationConfig =
        serde_json::from_str(&serde_json::to_string(&IsolationConfig::CONE).expect("writes")).expect("reads");
    assert_eq!(config, IsolationConfig::CONE);
    let mut flight = Flight::new(140);
    flight.errors[0] = 1e-5;
    let output = flight.last(20);
    let mut buffer = [0; 256];
    let written = postcard::to_slice(&output, &mut buffer).expect("writes");
    assert_eq!(postcard::from_bytes::<IsolationOutput>(written).expect("reads"), output);
}

fn any_reading() -> impl Strategy<Value = Reading<f64>> {
    let value = prop_oneof![
        4 => -1e-6..1e-6f64,
        2 => -2.0..2.0f64,
        1 => prop::num::f64::ANY,
        1 => Just(0.0),
    ];
    let quality =
        prop_oneof![8 => Just(Quality::Good), 1 => Just(Quality::Saturated), 1 => Just(Quality::Missing)];
    (value, prop_oneof![9 => 0..1500_u32, 1 => any::<u32>()], quality)
        .prop_map(|(value, age_ms, quality)| Reading { value, age_ms, quality })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    /// Whatever comes in, only finite numbers come out, and the same in gives the same out.
    #[test]
    fn fdi_10_whatever_comes_in(
        samples in prop::collection::vec((prop::array::uniform5(any_reading()), prop::option::weighted(0.05, any::<u8>())), 1..200),
        persistence in 1..4_u32,
        calibration_samples in prop_oneof![Just(0_u32), 1..20_u32],
    ) {
        let mut config = IsolationConfig::CONE;
        config.persistence = persistence;
        config.calibration_samples = calibration_samples;
        config.give_up_samples = 20;
        config.readmit_samples = 10;
        let mut block = FaultIsolation::try_build(&config).expect("can be flown");
        let mut twin = block;
        for (readings, readmit) in samples {
            let output = block.step(&readings, readmit);
            prop_assert_eq!(output, twin.step(&readings, readmit));
            let numbers = output.rate.iter().chain(&output.rate_sigma).chain(&output.parity).chain(&output.determinants)
                .chain([&output.alarm_level, &output.margin, &output.fault_size, &output.fault_sigma]);
            for number in numbers {
                prop_assert!(number.is_finite());
            }
            prop_assert!(block.rate_covariance().iter().all(|x| x.is_finite()));
            prop_assert_eq!(output.excluded, block.excluded());
            prop_assert_eq!(output.gyros_used & output.excluded, 0);
            prop_assert_eq!(output.gyros_used == 0, output.verdict == Verdict::BlockUntrusted);
            if let Verdict::Fault(gyro) = output.verdict {
                prop_assert_eq!(output.gyros_used, ALL & !(1 << gyro));
            }
        }
    }
}
