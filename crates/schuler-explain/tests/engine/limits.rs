//! Readings that are clipped at a limit or swallowed by a dead zone.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::faults::faults;
use schuler_explain::nominal::Model;
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, Nominal, SensorKind};
use schuler_recording::unit::Unit;

use crate::common;
use crate::synthetic::{ROWS, most};

#[test]
#[ignore = "steps are told beside a threshold that is a reading off"]
fn the_threshold_of_a_dead_zone_is_found_between_the_points_of_any_grid() {
    // Swaying about a rate near the threshold, and far from it now and then.
    let rate = |row: usize| {
        let sway = 0.0002 * (0.013 * row as f64).sin() + 0.00015 * (0.0041 * row as f64).sin();
        if row / 700 % 3 == 2 { 0.02 + sway } else { 0.01 + sway }
    };
    let rates: Vec<f64> = (0..ROWS).map(rate).collect();
    let named = |trial: u64| {
        let threshold = 0.00994 + 2e-5 * trial as f64;
        let white = if trial.is_multiple_of(2) { 1e-5 } else { 1e-4 };
        let mut random = Pcg64::seed_from_u64(400 + trial);
        let silent = |value: f64| if value.abs() < threshold { 0.0 } else { value };
        let mut reading = |&rate: &f64| {
            let noise: f64 = StandardNormal.sample(&mut random);
            silent(rate) + white * noise
        };
        let values: Vec<f64> = rates.iter().map(&mut reading).collect();
        let nominal = Nominal { white, ..Nominal::default() };
        let gyro =
            common::series("gyro", SensorKind::Fog, Unit::RadianPerSecond, [1.0, 0.0, 0.0], nominal, values);
        let mut recording = common::recording(MotionKind::Recorded, vec![gyro]);
        recording.motion.rate = Some([rates.clone(), vec![0.0; ROWS], vec![0.0; ROWS]]);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(told, ["dead_zone"], "threshold {threshold}");
        let parameters = &answer.findings[0].parameters;
        let found = parameters.iter().find(|parameter| parameter.name == "threshold").unwrap();
        let found = found.value.unwrap();
        // No reading lies between what was hidden and what was found, but for those at the ends, of which a delay may know nothing.
        let between = |rate: &&f64| (rate.abs() < threshold) != (rate.abs() < found);
        assert_eq!(rates[10..ROWS - 10].iter().filter(between).count(), 0, "{found} for {threshold}");
    };
    (0..8_u64).into_par_iter().for_each(named);
}

/// A gyro beside the rate that it should read.
pub fn beside_rate(rates: Vec<f64>, white: f64, values: Vec<f64>) -> Recording {
    let nominal = Nominal { white, ..Nominal::default() };
    let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
    let gyro = common::series("gyro", kind, unit, [1.0, 0.0, 0.0], nominal, values);
    let mut recording = common::recording(MotionKind::Recorded, vec![gyro]);
    recording.motion.rate = Some([rates, vec![0.0; ROWS], vec![0.0; ROWS]]);
    recording
}

/// A torquer that can no more is clipped before the noise, a converter after it, and a gyro may have both.
#[test]
fn a_limit_is_found_before_the_noise_and_after_it() {
    const TRIALS: u64 = 12;
    let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 * (0.003 * row as f64 + 0.3).sin()).collect();
    let white = 3e-5;
    let named = |trial: u64| {
        let limit = 0.0097 + 2e-5 * trial as f64;
        let (before, after) = (trial % 3 != 1, !trial.is_multiple_of(3));
        let mut random = Pcg64::seed_from_u64(8200 + trial);
        let clipped = |value: f64, clips: bool| if clips { value.clamp(-limit, limit) } else { value };
        let mut reading = |&rate: &f64| {
            let noise: f64 = StandardNormal.sample(&mut random);
            clipped(clipped(rate, before) + white * noise, after)
        };
        let values: Vec<f64> = rates.iter().map(&mut reading).collect();
        let recording = beside_rate(rates.clone(), white, values);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(told[0], "output_saturated", "trial {trial}");
        let parameters = &answer.findings[0].parameters;
        let found = parameters.iter().find(|parameter| parameter.name == "limit").unwrap();
        // Where readings equal the limit it is exact, and has no deviation.
        let off = (found.value.unwrap() - limit).abs();
        assert_eq!(found.sigma.is_none(), after, "trial {trial}");
        assert!(off < 3.0 * found.sigma.unwrap_or(1e-12), "trial {trial}: {found:?} for {limit}");
        // What else is told is what chance tells at the level, and no more.
        let others = answer.findings.iter().skip(1);
        assert!(others.map(|finding| finding.evidence.p_value).all(|p| p > 1e-3), "trial {trial}: {told:?}");
        told.len() == 1
    };
    let alone = (0..TRIALS).into_par_iter().filter(|trial| named(*trial)).count();
    // By chance, at the level.
    assert!(TRIALS as usize - alone <= most(TRIALS as usize, 0.01), "{alone}");
}

/// What is clipped is not known, and what else there is shows in the other readings: a step of a millionth of what the limit gains.
#[test]
fn what_is_beside_a_limit_is_told() {
    let (white, limit, step) = (3e-6, 0.0095, 1e-6);
    let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 * (0.003 * row as f64 + 0.3).sin()).collect();
    let mut random = Pcg64::seed_from_u64(8300);
    let mut reading = |(row, rate): (usize, &f64)| {
        let noise: f64 = StandardNormal.sample(&mut random);
        rate.clamp(-limit, limit) + white * noise + if row >= ROWS / 2 { step } else { 0.0 }
    };
    let values: Vec<f64> = rates.iter().enumerate().map(&mut reading).collect();
    let recording = beside_rate(rates, white, values);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(told, ["output_saturated", "bias_step"], "{:?}", answer.notes);
}

/// One reading is clipped: it stands off alone, and is where the input is largest, on a level that no other input passes. A spike elsewhere is
/// a spike.
#[test]
fn a_single_reading_beyond_a_limit_is_clipped_and_no_spike() {
    let (white, peak) = (1e-6, ROWS / 3);
    let off_peak = |row: usize| row as f64 - peak as f64;
    let rates: Vec<f64> = (0..ROWS)
        .map(|row| 4e-3 + 0.01 * (0.05 * off_peak(row)).cos() - 2e-6 * off_peak(row).abs())
        .collect();
    for (at, told) in [(peak, "output_saturated"), (2 * ROWS / 3, "noise_outliers")] {
        let mut random = Pcg64::seed_from_u64(8800);
        let mut reading = |(row, rate): (usize, &f64)| {
            let noise: f64 = StandardNormal.sample(&mut random);
            rate - if row == at { 1e-5 } else { 0.0 } + white * noise
        };
        let values: Vec<f64> = rates.iter().enumerate().map(&mut reading).collect();
        let recording = beside_rate(rates.clone(), white, values);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(found, [told], "{:?}", answer.findings);
    }
}

/// A log that is clipped in its noise reads too little near the limit as well, where it reads at all: that is no error of its scale.
#[test]
fn what_is_left_beside_a_limit_is_not_out_of_scale() {
    let named = |trial: u64| {
        let mut random = Pcg64::seed_from_u64(8700 + trial);
        let sensors = [0, 1].map(|sensor| {
            let white = [5e-3, 0.2][sensor];
            let mut reading = |row: usize| {
                let noise: f64 = StandardNormal.sample(&mut random);
                let value = 2.0 + 1.8 * (0.004 * row as f64 + trial as f64).sin() + white * noise;
                if sensor == 1 { value.min(3.6) } else { value }
            };
            let kind = [SensorKind::InsVelocity, SensorKind::Doppler][sensor];
            let nominal = Nominal { white, ..Nominal::default() };
            let values = (0..ROWS).map(&mut reading).collect();
            common::series(
                ["ins", "log"][sensor],
                kind,
                Unit::MetrePerSecond,
                [1.0, 0.0, 0.0],
                nominal,
                values,
            )
        });
        let recording = common::recording(MotionKind::Unknown, sensors.to_vec());
        let found = |recording: &Recording| {
            let answer = explain(recording, &Config { hold_out: false, ..Config::default() }).unwrap();
            let found = answer.findings.into_iter().map(|finding| (finding.sensor, finding.effect));
            found.collect::<Vec<(String, String)>>()
        };
        assert_eq!(found(&recording), [("log".to_owned(), "output_saturated".to_owned())], "{trial}");
        // And a gyro beside the rate that it should read.
        let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 * (0.004 * row as f64 + trial as f64).sin()).collect();
        let mut reading = |rate: &f64| {
            let noise: f64 = StandardNormal.sample(&mut random);
            (rate + 5e-4 * noise).min(0.0095)
        };
        let values = rates.iter().map(&mut reading).collect();
        let recording = beside_rate(rates, 5e-4, values);
        assert_eq!(found(&recording), [("gyro".to_owned(), "output_saturated".to_owned())], "{trial}");
    };
    (0..8_u64).into_par_iter().for_each(named);
}

/// Of two sensors that are only held against each other the one that is clipped for one reading reads its largest while the other goes on; a
/// spike at rest is none, whichever way it goes.
#[test]
fn a_single_clipped_reading_of_a_pair_is_told() {
    let of_pair = |rate: &dyn Fn(usize) -> f64, change: &dyn Fn(usize) -> [f64; 2]| {
        let mut random = Pcg64::seed_from_u64(8900);
        let sensors = [0, 1].map(|sensor| {
            let mut reading = |row: usize| {
                let noise: f64 = StandardNormal.sample(&mut random);
                rate(row) + 1e-6 * noise + change(row)[sensor]
            };
            let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
            let nominal = Nominal { white: 1e-6, ..Nominal::default() };
            let values = (0..ROWS).map(&mut reading).collect();
            common::series(&format!("gyro_{sensor}"), kind, unit, [1.0, 0.0, 0.0], nominal, values)
        });
        let recording = common::recording(MotionKind::Unknown, sensors.to_vec());
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let found = answer.findings.iter().map(|finding| (finding.sensor.clone(), finding.effect.clone()));
        found.collect::<Vec<(String, String)>>()
    };
    let peak = ROWS / 3;
    let swings = |row: usize| 4e-3 + 0.01 * (0.05 * (row as f64 - peak as f64)).cos() - 2e-7 * row as f64;
    let swings = |row: usize| swings(row) + if row == peak { 1e-3 } else { 0.0 };
    let short = |row: usize| [0.0, if row == peak { -2e-5 } else { 0.0 }];
    assert_eq!(of_pair(&swings, &short), [("gyro_1".to_owned(), "output_saturated".to_owned())]);
    // Out of scale, and turned twice as fast for one reading.
    let jerks = |row: usize| swings(row) + if row == peak { 0.014 } else { 0.0 };
    let found = of_pair(&jerks, &|row| [0.0, -2e-3 * jerks(row)]);
    assert!(found.iter().all(|(_, effect)| effect != "output_saturated"), "{found:?}");
    for size in [2e-5, -2e-5] {
        let spike = |row: usize| [if row == 700 { size } else { 0.0 }, 0.0];
        let found = of_pair(&|_| 0.0, &spike);
        assert!(matches!(&found[..], [(_, effect)] if effect == "noise_outliers"), "{size}: {found:?}");
    }
}

/// Three readings that are equal are little, and how far they fall short of a known input is much.
#[test]
fn three_equal_readings_that_fall_short_are_clipped() {
    // So many that three are just enough to be asked for.
    const LONG: usize = 24_000;
    let swing = |row: usize| 0.01 * (0.03 * row as f64 + 0.3).sin() * (1.0 + 2e-5 * row as f64);
    let rates: Vec<f64> = (0..LONG).map(swing).collect();
    let mut sizes: Vec<f64> = rates.iter().map(|rate| rate.abs()).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    let limit = 0.5 * (sizes[2] + sizes[3]);
    let mut random = Pcg64::seed_from_u64(8990);
    let mut reading = |rate: &f64| {
        let noise: f64 = StandardNormal.sample(&mut random);
        (rate + 5e-7 * noise).clamp(-limit, limit)
    };
    let values: Vec<f64> = rates.iter().map(&mut reading).collect();
    assert_eq!(values.iter().filter(|value| value.abs() == limit).count(), 3);
    let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 5e-7, ..Nominal::default() };
    let gyro = common::series("gyro", kind, unit, [1.0, 0.0, 0.0], nominal, values);
    let mut recording = common::recording(MotionKind::Recorded, vec![gyro]);
    recording.motion.rate = Some([rates, vec![0.0; LONG], vec![0.0; LONG]]);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let found = answer.findings.iter().map(|finding| (finding.effect.as_str(), finding.evidence.gain_nats));
    let found: Vec<(&str, f64)> = found.collect();
    assert!(matches!(found[..], [("output_saturated", gain)] if gain > 40.0), "{found:?}");
}

/// A spike of a sensor that nothing acts on is at no limit, though any input is its largest.
#[test]
fn a_spike_without_an_input_is_no_limit() {
    let mut random = Pcg64::seed_from_u64(8950);
    let mut reading = |row: usize| {
        let noise: f64 = StandardNormal.sample(&mut random);
        1e-6 * noise - if row == ROWS / 2 { 2e-5 } else { 0.0 }
    };
    let values = (0..ROWS).map(&mut reading).collect();
    // As a computation leaves it that should give 0.
    let rates = (0..ROWS).map(|row| if row == ROWS / 2 { 1e-18 } else { 0.0 }).collect();
    let recording = beside_rate(rates, 1e-6, values);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["noise_outliers"]);
}

/// What a dead zone swallows of a rate that passes it within a step or two stands off from its neighbours as spikes do.
#[test]
#[ignore = "readings that are set aside before the search are not given back to what explains them"]
fn a_dead_zone_that_is_passed_within_a_step_has_no_spikes() {
    let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 * (0.05 * row as f64 + 0.3).sin()).collect();
    let (threshold, white) = (4e-4, 6e-5);
    let named = |trial: u64| {
        let mut random = Pcg64::seed_from_u64(170_000 + trial);
        let mut reading = |rate: &f64| {
            let noise: f64 = StandardNormal.sample(&mut random);
            (if rate.abs() < threshold { 0.0 } else { *rate }) + white * noise
        };
        let values = rates.iter().map(&mut reading).collect();
        let recording = beside_rate(rates.clone(), white, values);
        let unexplained = faults(&recording, &Model::new(&recording, &[]).unwrap()).found;
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(told, ["dead_zone"], "trial {trial}");
        let parameters = &answer.findings[0].parameters;
        let found = parameters.iter().find(|parameter| parameter.name == "threshold").unwrap();
        let (found, sigma) = (found.value.unwrap(), found.sigma.unwrap());
        assert!((found - threshold).abs() < 3.0 * sigma, "trial {trial}: {found} ± {sigma}");
        unexplained.len()
    };
    let spikes: usize = (0..8_u64).into_par_iter().map(named).sum();
    assert!(spikes >= 4, "of eight records {spikes} have spikes to be taken back");
}
