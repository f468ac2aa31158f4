//! Calibration of a complete unit (TMP-12, TMP-13) on runs simulated without any of its code.
use host_sim::calibration_table::{CalibrationTable, Programme, SensorTemperature};
use nalgebra::Vector3;
use schuler_core::reading::Reading;
use schuler_core::thermal::{Compensator, TemperatureRate, TemperatureRateConfig, ThermalState};
use schuler_explain::calibration::{
    Calibration, CalibrationError, Determination, Element, Experiment, Feature, FeatureSet, Priors,
    ThermalPoint, Thermometry, Verdict, calibrate,
};
use schuler_tests::calibration_run::{
    DEGREE_PER_HOUR, Known, UP_AND_DOWN, complete_unit, draw_errors, experiment, normalised_errors, rms,
};
use schuler_tests::temperature_rate::heat::SLOW;

/// A kind of element, with the largest sigmas of its parts in practical units.
type Kind = (fn(&Element) -> bool, [f64; 3]);
/// What spoils an experiment.
type Spoil = fn(&mut Experiment);

/// One run of a table with errors drawn from the priors.
fn run(
    mut table: CalibrationTable,
    features: FeatureSet,
    known: Known,
    seed: u64,
) -> (CalibrationTable, Experiment) {
    draw_errors(&mut table, &Priors::default(), features, seed);
    let record = table.run(seed);
    let experiment = experiment(&table, &record, features, known);
    (table, experiment)
}

/// Consistency of estimates with their sigmas over many runs.
struct Consistency {
    rms: f64,
    beyond_3_sigma: f64,
    nis: f64,
    /// Root mean square over coefficients of the mean over runs, in its own sigma: one without bias.
    bias: f64,
    calibrations: Vec<Calibration>,
}

fn consistency(
    table: &CalibrationTable,
    features: FeatureSet,
    known: Known,
    seeds: std::ops::Range<u64>,
) -> Consistency {
    let runs = (seeds.end - seeds.start) as f64;
    let mut errors: Vec<Vec<f64>> = Vec::new();
    let mut calibrations = Vec::new();
    for seed in seeds {
        let (table, experiment) = run(*table, features, known, seed);
        let calibration = calibrate(&experiment).expect("a calibration");
        errors.push(normalised_errors(&table, &calibration));
        calibrations.push(calibration);
    }
    let all: Vec<f64> = errors.concat();
    let means: Vec<f64> =
        (0..errors[0].len()).map(|k| errors.iter().map(|e| e[k]).sum::<f64>() / runs.sqrt()).collect();
    let found = Consistency {
        rms: rms(&all),
        beyond_3_sigma: all.iter().filter(|z| z.abs() > 3.0).count() as f64 / all.len() as f64,
        nis: calibrations.iter().map(|c| c.nis).sum::<f64>() / runs,
        bias: rms(&means),
        calibrations,
    };
    let largest = all.iter().fold(0.0f64, |m, z| m.max(z.abs()));
    println!(
        "{known:?}, {features:?}: rms of error/sigma {:.3}, beyond 3 sigma {:.2} %, largest {largest:.2}, NIS {:.4}, bias {:.2}",
        found.rms,
        100.0 * found.beyond_3_sigma,
        found.nis,
        found.bias
    );
    found
}

fn assert_consistent(found: &Consistency) {
    assert!((0.85..=1.15).contains(&found.rms), "rms of error/sigma {}", found.rms);
    assert!(found.beyond_3_sigma <= 0.015, "{} beyond 3 sigma", found.beyond_3_sigma);
    assert!((0.98..=1.02).contains(&found.nis), "NIS {}", found.nis);
    assert!(found.bias < 1.25, "normalised bias {}", found.bias);
}

/// TMP-13: ten runs with 63 coefficients, and posterior sigmas of the size of the specification.
#[test]
fn tmp_13_estimates_agree_with_their_sigmas() {
    let found = consistency(&complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate, Known::Truth, 0..10);
    assert_consistent(&found);
    for calibration in &found.calibrations {
        assert_eq!(calibration.verdicts, [Verdict::Sound]);
        assert!(calibration.elements.iter().all(|e| e.worst_ratio < 0.42), "{:?}", calibration.elements);
    }
    // Largest sigmas of the specification's programmes: deg/h, ppm, mm/s^2, ppm; a third more for another programme.
    let largest = |pick: fn(&Element) -> bool, feature: Feature| {
        let coefficients = found.calibrations[0].coefficients.iter();
        let of_kind = coefficients.filter(|c| pick(&c.element) && c.feature == feature);
        of_kind.map(|c| c.sigma * c.element.practical_unit().1).fold(0.0, f64::max)
    };
    let kinds: [Kind; 4] = [
        (|e| matches!(e, Element::GyroBias(_)), [0.16, 0.39, 0.06]),
        (|e| matches!(e, Element::GyroMatrix(..)), [151.0, 363.0, 45.0]),
        (|e| matches!(e, Element::AccelerometerBias(_)), [0.46, 1.1, 0.12]),
        (|e| matches!(e, Element::AccelerometerMatrix(..)), [124.0, 297.0, 37.0]),
    ];
    for (pick, bars) in kinds {
        for (feature, bar) in Feature::ALL.into_iter().zip(bars) {
            let sigma = largest(pick, feature);
            assert!(sigma < 1.33 * bar, "{feature}: sigma {sigma}, specification {bar}");
        }
    }
}

/// Another programme, latitude and temperature range; the stated azimuth is off by 2.5 degrees, and the axis tilted by 0.3.
#[test]
fn tmp_13_estimates_agree_in_another_set_up() {
    let mut table = CalibrationTable {
        latitude: -0.6,
        azimuth: 2.0,
        tilt: 0.3f64.to_radians(),
        rotation_s: 50.0,
        dwell_s: 25.0,
        ..complete_unit(Programme::UpAndDown { low: -20.0, high: 45.0, period_s: 3000.0, load: 4.0 })
    };
    table.gravity = 9.797;
    let mut all = Vec::new();
    let (mut nis, runs) = (0.0, 8);
    for seed in 100..100 + runs {
        let (table, mut experiment) = run(table, FeatureSet::TemperatureRate, Known::Truth, seed);
        for cycle in &mut experiment.cycles {
            cycle.azimuth += 2.5f64.to_radians();
        }
        let calibration = calibrate(&experiment).expect("a calibration");
        all.extend(normalised_errors(&table, &calibration));
        nis += calibration.nis / runs as f64;
    }
    let beyond = all.iter().filter(|z| z.abs() > 3.0).count() as f64 / all.len() as f64;
    println!("rms of error/sigma {:.3}, beyond 3 sigma {:.2} %, NIS {nis:.4}", rms(&all), 100.0 * beyond);
    assert!((0.85..=1.15).contains(&rms(&all)), "rms of error/sigma {}", rms(&all));
    assert!(beyond <= 0.015 && (0.98..=1.02).contains(&nis), "{beyond} beyond 3 sigma, NIS {nis}");
}

/// Three components of the gradient beside temperature and rate: 126 coefficients, 129 states.
#[test]
fn tmp_13_estimates_agree_with_gradients() {
    let found =
        consistency(&complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRateGradient, Known::Truth, 20..28);
    assert_consistent(&found);
    assert!(found.calibrations.iter().all(|c| c.cycles.iter().all(|c| c.programme.sufficient)));
}

/// A unit that depends on the rate, calibrated without it: the innovations tell.
#[test]
fn tmp_13_an_omitted_rate_is_noticed() {
    let (_, mut experiment) = run(complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate, Known::Truth, 1);
    experiment.features = FeatureSet::Temperature;
    let calibration = calibrate(&experiment).expect("a calibration");
    println!("NIS without the rate: {:.1}", calibration.nis);
    assert!(calibration.nis > 10.0);
    assert!(matches!(calibration.verdicts[0], Verdict::ModelDoesNotFit { .. }), "{:?}", calibration.verdicts);
}

/// Where the functions of temperature are dependent, one combination for each element keeps its prior sigma, the cause is
/// named, and what was estimated is still honest.
#[test]
fn tmp_12_what_a_run_cannot_determine_is_named() {
    let cases = [
        (Programme::Steady(20.0), "the temperature stayed within 0.0 degC"),
        (Programme::Ramp(10.0, 15.0 / 3600.0), "of 15.0 degC/h, a steady temperature or a linear ramp"),
        (Programme::Exponential(10.0, 60.0, 1500.0), "a single exponential of time constant 1500 s"),
    ];
    for (programme, words) in cases {
        let (table, experiment) = run(complete_unit(programme), FeatureSet::TemperatureRate, Known::Truth, 3);
        let calibration = calibrate(&experiment).expect("a calibration");
        for (k, cycle) in calibration.cycles.iter().enumerate() {
            assert!(
                cycle.programme.smallest() < 1e-3 && cycle.programme.words.contains(words),
                "{:?}",
                cycle.programme
            );
            let poor = |v: &Verdict| matches!(v, Verdict::ProgrammeTooPoor { cycle, .. } if *cycle == k + 1);
            assert!(calibration.verdicts.iter().any(poor), "{:?}", calibration.verdicts);
        }
        for element in &calibration.elements {
            assert_eq!(element.determination, Determination::Undetermined);
            assert!(element.worst_ratio > 0.9995 && element.worst_ratio < 1.0005, "{}", element.worst_ratio);
            assert!(element.words.contains("cycle 1, 2, 3"), "{}", element.words);
        }
        let errors = rms(&normalised_errors(&table, &calibration));
        assert!((0.7..1.3).contains(&errors), "{programme:?}: {errors}");
        println!("{programme:?}: {}", calibration.verdicts[0]);
    }
}

/// In a unit that is heated from its walls alone the rate is a combination of the gradient and a constant: the law of
/// conduction shows up as a dependence of the features.
#[test]
fn tmp_12_conduction_makes_rate_and_gradient_dependent() {
    let programme = Programme::UpAndDown { low: 10.0, high: 70.0, period_s: 3600.0, load: 0.0 };
    let (_, mut experiment) =
        run(complete_unit(programme), FeatureSet::TemperatureRateGradient, Known::Truth, 4);
    // The electronics have warmed up in the last cycle.
    experiment.cycles.drain(..2);
    let calibration = calibrate(&experiment).expect("a calibration");
    let programme = &calibration.cycles[0].programme;
    assert!(programme.smallest() < 1e-3, "{programme:?}");
    let weight = |feature: Feature| programme.weakest.iter().find(|w| w.0 == feature).map_or(0.0, |w| w.1);
    // D = mean of (wall − block)/1500 s and a constant; the gradient is that difference in degC/m, Ds 20 degC/h, Gs 5 degC/m.
    let expected = -(5.0 / 1500.0 / 3.0) / (20.0 / 3600.0);
    for gradient in [Feature::GradientX, Feature::GradientY, Feature::GradientZ] {
        let ratio = weight(gradient) / weight(Feature::Rate);
        assert!((ratio - expected).abs() < 0.01, "{gradient}: {ratio}, expected {expected}");
    }
    assert!(programme.words.contains("dependent"), "{}", programme.words);
}

/// An axis that was never turned.
#[test]
fn tmp_12_a_missing_cycle_is_named() {
    let (table, mut experiment) =
        run(complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate, Known::Truth, 5);
    experiment.cycles.remove(2);
    let calibration = calibrate(&experiment).expect("a calibration");
    assert!(calibration.verdicts.contains(&Verdict::AxisNotTurned { axis: 2 }), "{:?}", calibration.verdicts);
    let scale =
        calibration.elements.iter().find(|e| e.element == Element::GyroMatrix(2, 2)).expect("in the model");
    assert_eq!(scale.determination, Determination::Undetermined);
    assert!(scale.words.contains("no cycle turned the unit about its z axis"), "{}", scale.words);
    let errors = rms(&normalised_errors(&table, &calibration));
    assert!((0.7..1.3).contains(&errors), "{errors}");
}

/// Residual gyro bias of a flight along `history`, corrected with the calibration and the real-time temperature and rate of
/// a thermometer with this quantum; square sums of residual and of the uncorrected thermal variation.
fn fly(
    table: &CalibrationTable,
    calibration: &Calibration,
    history: &[SensorTemperature],
    quantum: f64,
) -> (f64, f64) {
    let compensator = Compensator::try_build(&calibration.compensation_block()).expect("a valid block");
    let config = TemperatureRateConfig::of_quantum(quantum as f32);
    let mut thermometer = TemperatureRate::try_build(&config).expect("valid");
    let (mut residual, mut variation) = (0.0, 0.0);
    for (t, truth) in history.iter().enumerate() {
        let reading = (truth.temperature / quantum + 0.5).floor() * quantum;
        let estimate = thermometer.step(1000 * t as u64, &Reading::good(reading as f32));
        if t < 600 {
            continue;
        }
        let output = table.gyro.output(&Vector3::zeros(), truth);
        let corrected = compensator.correction(&ThermalState::from(&estimate)).rate(output.into());
        residual += corrected.iter().map(|w| w * w).sum::<f64>();
        variation += (0..3).map(|i| (output[i] - table.gyro.bias[i].constant).powi(2)).sum::<f64>();
    }
    (residual, variation)
}

/// TMP-13: features by hindsight from a quantised thermometer, and flights with the coefficients so found: along the chamber
/// history of the slow set, for which the bars are, and along a faster one with loads that come and go every twenty minutes.
#[test]
fn tmp_13_quantised_thermometer_on_the_ground_and_in_flight() {
    let slow = SLOW[1].history(0.03);
    let slow: Vec<SensorTemperature> = slow
        .temperature
        .iter()
        .zip(&slow.rate)
        .map(|(temperature, rate)| SensorTemperature {
            temperature: *temperature,
            rate: *rate,
            gradient: [0.0; 3],
        })
        .collect();
    let programme = Programme::UpAndDown { low: 15.0, high: 50.0, period_s: 9000.0, load: 3.0 };
    let fast = CalibrationTable { programme, ..complete_unit(programme) }.run(77).temperature;
    for (quantum, bar, fast_bar) in [(0.0625, 0.10, 0.15), (0.25, 0.10, 0.15), (1.0, 0.25, 0.5)] {
        let mut errors = Vec::new();
        let mut sums = [(0.0, 0.0); 2];
        for seed in 40..44 {
            let (table, experiment) =
                run(complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate, Known::Quantum(quantum), seed);
            let calibration = calibrate(&experiment).expect("a calibration");
            errors.extend(normalised_errors(&table, &calibration));
            for (sum, history) in sums.iter_mut().zip([&slow, &fast]) {
                let (residual, variation) = fly(&table, &calibration, history, quantum);
                *sum = (sum.0 + residual, sum.1 + variation);
            }
        }
        let [on_slow, on_fast] = sums.map(|(residual, variation)| (residual / variation).sqrt());
        println!(
            "q = {quantum}: rms of error/sigma {:.3}; residual/variation {on_slow:.3} in slow, {on_fast:.3} in fast change",
            rms(&errors)
        );
        assert!(rms(&errors) < 1.5, "q = {quantum}: {}", rms(&errors));
        assert!(on_slow <= bar, "q = {quantum}: residual/variation {on_slow}, at most {bar}");
        assert!(on_fast <= fast_bar, "q = {quantum}: residual/variation {on_fast}, at most {fast_bar}");
    }
}

/// Why hindsight is needed: with the real-time temperature and rate as regressors the errors exceed their sigmas.
#[test]
fn tmp_13_real_time_rate_must_not_be_a_regressor() {
    let quantum = 1.0;
    let (mut table, features) = (complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate);
    draw_errors(&mut table, &Priors::default(), features, 50);
    let record = table.run(50);
    let mut experiment = experiment(&table, &record, features, Known::Truth);
    let config = TemperatureRateConfig::of_quantum(quantum as f32);
    let mut thermometer = TemperatureRate::try_build(&config).expect("valid");
    let estimates: Vec<ThermalPoint> = record
        .thermometer(quantum, 0.0, 1)
        .iter()
        .enumerate()
        .map(|(t, y)| {
            let out = thermometer.step(1000 * t as u64, &Reading::good(*y as f32));
            ThermalPoint {
                temperature: f64::from(out.temperature),
                rate: f64::from(out.rate),
                gradient: [0.0; 3],
            }
        })
        .collect();
    for (cycle, recorded) in experiment.cycles.iter_mut().zip(&record.cycles) {
        cycle.thermometry =
            Thermometry::Known(estimates[recorded.began_s..=recorded.began_s + table.cycle_s].to_vec());
    }
    let errors = normalised_errors(&table, &calibrate(&experiment).expect("a calibration"));
    let largest = errors.iter().fold(0.0f64, |m, z| m.max(z.abs()));
    println!("real-time rate as regressor: rms of error/sigma {:.2}, largest {largest:.1}", rms(&errors));
    assert!(largest > 6.0, "{largest}");
}

/// Accelerometer samples missing, and a gap of the gyros in the middle of a cycle: the rest is used, and the result sound.
#[test]
fn tmp_12_gaps_are_bridged() {
    let (table, mut experiment) =
        run(complete_unit(UP_AND_DOWN), FeatureSet::TemperatureRate, Known::Truth, 6);
    for sample in 10_000..14_000 {
        experiment.cycles[0].specific_force[sample][1] = f64::NAN;
    }
    for sample in 30_000..30_030 {
        experiment.cycles[1].rate[sample][2] = f64::NAN;
    }
    experiment.cycles[2].rate[0][0] = f64::INFINITY;
    let calibration = calibrate(&experiment).expect("a calibration");
    let missing: Vec<usize> = calibration.cycles.iter().map(|c| c.missing).collect();
    assert_eq!(missing, [200, 2, 1]);
    let errors = rms(&normalised_errors(&table, &calibration));
    println!("with gaps: rms of error/sigma {errors:.3}, NIS {:.4}", calibration.nis);
    assert!(
        (0.7..1.3).contains(&errors) && (calibration.nis - 1.0).abs() < 0.04,
        "{errors}, {}",
        calibration.nis
    );
}

#[test]
fn tmp_12_errors_name_the_field() {
    let table = CalibrationTable { cycle_s: 120, ..complete_unit(UP_AND_DOWN) };
    let (_, good) = run(table, FeatureSet::TemperatureRate, Known::Quantum(0.25), 7);
    let cases: [(Spoil, &str); 13] = [
        (|e| e.site.gravity = f64::NAN, "site.gravity"),
        (|e| e.site.latitude = 1.57, "site.latitude"),
        (|e| e.sample_s = 0.03, "sample_s"),
        (|e| e.passes = 1, "passes"),
        (|e| e.noise.specific_force = 0.0, "noise.specific_force"),
        (|e| e.priors.gyro_matrix.rate = -1.0, "priors.gyro_matrix"),
        (|e| e.cycles.clear(), "cycles"),
        (|e| e.cycles[1].axis = 3, "cycles[1].axis"),
        (|e| e.cycles[1].axis = 0, "cycles[1].axis"),
        (|e| e.cycles[2].specific_force.truncate(100), "cycles[2].specific_force"),
        (|e| e.cycles[0].rate.truncate(100), "cycles[0].rate"),
        (|e| e.cycles[0].rate.iter_mut().step_by(500).for_each(|w| w[0] = f64::NAN), "cycles[0].rate"),
        (
            |e| e.cycles[0].thermometry = Thermometry::Known(vec![ThermalPoint::default(); 5]),
            "cycles[0].thermometry",
        ),
    ];
    for (spoil, expected) in cases {
        let mut experiment = good.clone();
        spoil(&mut experiment);
        match calibrate(&experiment) {
            Err(CalibrationError::Invalid { field, .. }) => assert_eq!(field, expected),
            other => panic!("{expected}: {:?}", other.map(|c| c.verdicts)),
        }
    }
    calibrate(&good).expect("the unspoilt one");
}

/// A calibration survives being written and read, and its block is valid.
#[test]
fn calibration_is_serialisable() {
    let table = CalibrationTable { cycle_s: 300, ..complete_unit(UP_AND_DOWN) };
    let (_, experiment) = run(table, FeatureSet::TemperatureRate, Known::Truth, 8);
    let calibration = calibrate(&experiment).expect("a calibration");
    let text = serde_json::to_string(&calibration).expect("written");
    let back: Calibration = serde_json::from_str(&text).expect("read");
    assert_eq!(back.verdicts, calibration.verdicts);
    assert_eq!(back.compensation_block(), calibration.compensation_block());
    Compensator::try_build(&back.compensation_block()).expect("a valid block");
    let bias = calibration.coefficient(Element::GyroBias(0), Feature::Constant).expect("in the model");
    assert_eq!(bias.element.unit(), "rad/s");
    assert!((bias.sigma * bias.element.practical_unit().1 - bias.sigma / DEGREE_PER_HOUR).abs() < 1e-9);
}
