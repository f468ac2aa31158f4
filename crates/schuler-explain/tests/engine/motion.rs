//! Motion that is known, estimated from redundant sensors, or not known at all.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::catalogue::CATALOGUE;
use schuler_explain::config::Config;
use schuler_explain::explain::{explain, explain_with};
use schuler_explain::inputs::Inputs;
use schuler_recording::Recording;
use schuler_recording::case::{Markov, MotionKind, Nominal, SensorKind};
use schuler_recording::unit::Unit;

use crate::common;
use crate::synthetic::{MARKOV_SIGMA, ROWS, TAU_S, WHITE_SIGMA, block_of_five, most, noise, recording, wave};

#[test]
fn the_noise_of_the_motion_is_not_taken_for_a_lag() {
    const TRIALS: u64 = 60;
    const INERTIAL: f64 = 0.05;
    let named: Vec<String> = (0..TRIALS)
        .into_par_iter()
        .flat_map_iter(|seed| {
            let mut random = Pcg64::seed_from_u64(150_000 + seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let velocity = |row: usize| 5.0 + 2.0 * wave(row as f64, ROWS as f64);
            let inertial: Vec<f64> = (0..ROWS).map(|row| velocity(row) + INERTIAL * normal()).collect();
            let radio: Vec<f64> = noise(160_000 + seed, ROWS)
                .iter()
                .enumerate()
                .map(|(row, e)| velocity(row) + 0.3 * e)
                .collect();
            let mut recording = recording(vec![radio, inertial]);
            recording.case.motion.kind = MotionKind::Unknown;
            let nominal = &mut recording.sensors[0].sensor.nominal;
            nominal.white = 0.3 * WHITE_SIGMA;
            nominal.markov = Some(Markov { sigma: 0.3 * MARKOV_SIGMA, tau_s: TAU_S });
            let inertial = &mut recording.sensors[1].sensor;
            inertial.kind = SensorKind::InsVelocity;
            inertial.nominal = Nominal { white: INERTIAL, ..Nominal::default() };
            let inputs = Inputs::new(&recording);
            let lags = CATALOGUE.iter().filter(|effect| ["time_delay", "bandwidth_lag"].contains(&effect.id));
            let candidates = lags.flat_map(|effect| (effect.candidates)(effect, &inputs)).collect();
            let answer =
                explain_with(&inputs, candidates, &Config { hold_out: false, ..Config::default() }).unwrap();
            answer.findings.into_iter().map(|finding| finding.effect).collect::<Vec<_>>()
        })
        .collect();
    assert!(named.len() <= most(TRIALS as usize, 0.01), "{named:?}");
}

/// The drift of an inertial velocity is in its reading and in the difference from the log. As the input it would be one to which the log
/// does not answer where the body rests.
#[test]
fn the_drift_of_an_inertial_velocity_is_no_motion() {
    const TRIALS: u64 = 40;
    const WALK: f64 = 0.02;
    let named: Vec<String> = (0..TRIALS)
        .into_par_iter()
        .flat_map_iter(|seed| {
            let mut random = Pcg64::seed_from_u64(152_000 + seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            // Half of the time at rest.
            let velocity = |row: usize| 4.0 * (row as f64 * 0.004 + seed as f64).sin().max(0.0);
            let mut drift = 0.0;
            let mut inertial = |row: usize| {
                drift += WALK * normal();
                velocity(row) + drift + 0.005 * normal()
            };
            let inertial: Vec<f64> = (0..ROWS).map(&mut inertial).collect();
            let log: Vec<f64> = (0..ROWS).map(|row| velocity(row) + 0.1 * normal()).collect();
            let mut recording = recording(vec![log, inertial]);
            recording.case.motion.kind = MotionKind::Unknown;
            recording.sensors[0].sensor.nominal = Nominal { white: 0.1, ..Nominal::default() };
            let inertial = &mut recording.sensors[1].sensor;
            inertial.kind = SensorKind::InsVelocity;
            inertial.nominal = Nominal { white: 0.005, random_walk: WALK, ..Nominal::default() };
            let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
            answer.findings.into_iter().map(|finding| finding.effect).collect::<Vec<_>>()
        })
        .collect();
    assert!(named.len() <= most(TRIALS as usize, 0.01), "{named:?}");
}

/// Two sensors that only check each other: their difference has the sum of their noises, their readings tell whose the rest is. Motion that
/// is estimated with the noises as they are stated would have it as an input.
#[test]
fn noise_that_was_stated_wrongly_is_told_of_the_sensor_that_has_it() {
    const TRIALS: u64 = 30;
    const LOG: f64 = 0.1;
    let answers: Vec<(String, Vec<String>)> = (0..TRIALS)
        .into_par_iter()
        .map(|seed| {
            let mut random = Pcg64::seed_from_u64(171_000 + seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            // Half of the time at rest.
            let velocity = |row: usize| 4.0 * (row as f64 * 0.004 + seed as f64).sin().max(0.0);
            let log: Vec<f64> = (0..ROWS).map(|row| velocity(row) + LOG * normal()).collect();
            let inertial: Vec<f64> = (0..ROWS).map(|row| velocity(row) + LOG * normal()).collect();
            let mut recording = recording(vec![log, inertial]);
            recording.case.motion.kind = MotionKind::Unknown;
            // Of one sensor a third is stated, of every other trial's another.
            let wrong = (seed % 2) as usize;
            for (place, series) in recording.sensors.iter_mut().enumerate() {
                let white = if place == wrong { LOG / 3.0 } else { LOG };
                series.sensor.nominal = Nominal { white, ..Nominal::default() };
            }
            recording.sensors[1].sensor.kind = SensorKind::InsVelocity;
            let expected = format!("{} noise_white", recording.sensors[wrong].sensor.id);
            let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
            let told = answer.findings.into_iter().map(|found| format!("{} {}", found.sensor, found.effect));
            (expected, told.collect())
        })
        .collect();
    let other = |(expected, told): &&(String, Vec<String>)| told.as_slice() != std::slice::from_ref(expected);
    let wrong: Vec<_> = answers.iter().filter(other).collect();
    assert!(wrong.len() <= most(TRIALS as usize, 0.01), "{wrong:?}");
}

/// Five sensors in a slow motion, and what the third has of its own.
fn block_in_slow_motion(seed: u64, own: impl Fn(f64) -> f64) -> Recording {
    const WHITE: f64 = 0.06;
    let mut random = Pcg64::seed_from_u64(173_000 + seed);
    let of_axis = |place: usize| {
        let (sin, cos) = (1.2 * place as f64).sin_cos();
        let motion = move |time: f64| 9.0 * wave(time, 900.0) * cos + 5.0 * wave(time, 1500.0) * sin + 4.0;
        let noise = (0..ROWS).map(|_| StandardNormal.sample(&mut random)).collect::<Vec<f64>>();
        let values = noise.into_iter().enumerate().map(|(row, noise)| {
            let time = row as f64;
            WHITE * noise + motion(time) + if place == 2 { own(time) } else { 0.0 }
        });
        values.collect()
    };
    let mut recording = block_of_five((0..5).map(of_axis).collect());
    for series in &mut recording.sensors {
        series.sensor.kind = SensorKind::Fog;
        series.sensor.unit = Unit::RadianPerSecond;
        series.sensor.nominal = Nominal { white: WHITE, ..Nominal::default() };
    }
    recording
}

/// A line is in the residuals and in the readings: noise is judged by what both have without it, and the line by what both have with it.
#[test]
fn a_line_of_one_of_five_sensors_is_no_noise_of_it() {
    const TRIALS: u64 = 8;
    let answers: Vec<Vec<String>> = (0..TRIALS)
        .into_par_iter()
        .map(|seed| {
            let rate = 0.9 + 0.05 * seed as f64;
            let recording = block_in_slow_motion(seed, |time| 0.08 * (time * rate).sin());
            let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
            answer.findings.into_iter().map(|found| format!("{} {}", found.sensor, found.effect)).collect()
        })
        .collect();
    let wrong: Vec<_> = answers.iter().filter(|told| **told != ["sensor_2 periodic_line"]).collect();
    assert!(wrong.len() <= most(TRIALS as usize, 0.01), "{wrong:?}");
}

/// Steps that are missing for all sensors are gaps, whatever part of the record they are.
#[test]
fn redundant_sensors_are_compared_where_they_read() {
    let values = |seed: u64| -> Vec<f64> {
        let there = |row: usize| row % 400 < 120;
        let values = noise(seed, ROWS).into_iter().enumerate();
        values.map(|(row, e)| if there(row) { e } else { f64::NAN }).collect()
    };
    let mut biased = values(91);
    for value in &mut biased {
        *value += 6.0;
    }
    let mut recording = recording(vec![values(90), biased]);
    recording.case.motion.kind = MotionKind::Unknown;
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    assert_eq!(answer.findings.len(), 1, "{:?}", answer.findings);
    assert_eq!(answer.findings[0].effect, "bias_constant");
}

/// Velocities over the Earth need no attitude of the body: their axes are then north, east and down, which a note says.
#[test]
fn velocities_over_the_earth_are_compared_without_an_attitude() {
    let mut random = Pcg64::seed_from_u64(8952);
    let wave = |period: f64| -> Vec<f64> {
        (0..ROWS).map(|row| 10.0 * (std::f64::consts::TAU * row as f64 / period).sin()).collect()
    };
    let velocity = [wave(300.0), wave(410.0), wave(170.0)];
    let mut read = |axis: usize| -> Vec<f64> {
        let error: Vec<f64> = (0..ROWS).map(|_| StandardNormal.sample(&mut random)).collect();
        let scale = if axis == 1 { 1.002 } else { 1.0 };
        velocity[axis].iter().zip(error).map(|(velocity, error)| scale * velocity + 0.03 * error).collect()
    };
    let (kind, unit) = (SensorKind::GnssVelocity, Unit::MetrePerSecond);
    let nominal = || Nominal { white: 0.03, ..Nominal::default() };
    let sensors = [("north", [1.0, 0.0, 0.0]), ("east", [0.0, 1.0, 0.0]), ("down", [0.0, 0.0, 1.0])];
    let sensors: Vec<_> = (sensors.into_iter().enumerate())
        .map(|(axis, (id, direction))| common::series(id, kind, unit, direction, nominal(), read(axis)))
        .collect();
    let mut recording = common::recording(MotionKind::Recorded, sensors);
    recording.motion.velocity_ned = Some(velocity.clone());
    let answer = explain(&recording, &Config::default()).unwrap();
    let said: Vec<(&str, &str)> =
        answer.findings.iter().map(|finding| (finding.sensor.as_str(), finding.effect.as_str())).collect();
    assert_eq!(said, [("east", "scale_factor")], "{:?}", answer.findings);
    assert!(
        answer.notes.iter().any(|note| note.contains("taken as north, east, down")),
        "{:?}",
        answer.notes
    );
}

/// A body at rest of which no attitude is given has an input that nobody knows, and it is a constant: steps are found beside it, it is none.
#[test]
fn at_rest_an_input_that_is_not_told_is_a_constant() {
    let mut random = Pcg64::seed_from_u64(8954);
    let mut reading = |row: usize| {
        let error: f64 = StandardNormal.sample(&mut random);
        5e-5 + 1e-6 * error + if row > ROWS / 2 { 5e-7 } else { 0.0 }
    };
    let values = (0..ROWS).map(&mut reading).collect();
    let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 1e-6, ..Nominal::default() };
    let gyro = common::series("g", kind, unit, [1.0, 0.0, 0.0], nominal, values);
    let answer = explain(&common::recording(MotionKind::Static, vec![gyro]), &Config::default()).unwrap();
    let found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["bias_step"], "{:?}", answer.findings);
    assert!(answer.notes.iter().any(|note| note.contains("unknown constant")), "{:?}", answer.notes);
}

/// Of a log and an inertial velocity nothing but the difference is seen. What jumps, or comes late, is the log's, whichever of
/// them the case names first.
#[test]
fn what_an_integral_does_not_do_is_the_radio_sensors() {
    let velocity = |time: f64| 5.0 + 3.0 * (0.05 * time).sin() + 2.0 * (0.013 * time).sin();
    let inertial: Vec<f64> =
        noise(63, ROWS).iter().zip(0..).map(|(e, row)| velocity(f64::from(row)) + 0.01 * e).collect();
    let log: Vec<f64> =
        noise(64, ROWS).iter().zip(0..).map(|(e, row)| velocity(f64::from(row) - 0.7) + 0.2 * e).collect();
    let mut recording = recording(vec![inertial, log]);
    recording.case.motion.kind = MotionKind::Unknown;
    for (series, scale) in recording.sensors.iter_mut().zip([0.01, 0.2]) {
        series.sensor.nominal.white = scale * WHITE_SIGMA;
        series.sensor.nominal.markov = Some(Markov { sigma: scale * MARKOV_SIGMA, tau_s: TAU_S });
    }
    recording.sensors[0].sensor.kind = SensorKind::InsVelocity;
    for spike in 0..4 {
        recording.sensors[1].values[200 + 400 * spike] += 5.0;
    }
    let inputs = Inputs::new(&recording);
    let wanted = ["time_delay", "noise_outliers"];
    let effects = CATALOGUE.iter().filter(|effect| wanted.contains(&effect.id));
    let candidates = effects.flat_map(|effect| (effect.candidates)(effect, &inputs)).collect();
    let options = Config { hold_out: false, ..Config::default() };
    let answer = explain_with(&inputs, candidates, &options).unwrap();
    let mut found: Vec<(&str, &str)> =
        answer.findings.iter().map(|finding| (finding.effect.as_str(), finding.sensor.as_str())).collect();
    found.sort_unstable();
    assert_eq!(found, [("noise_outliers", "sensor_1"), ("time_delay", "sensor_1")]);
}
