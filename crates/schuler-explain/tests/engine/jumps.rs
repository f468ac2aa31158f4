//! Means that jump between two levels at random times.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_recording::case::{Markov, MotionKind, Nominal, SensorKind};
use schuler_recording::unit::Unit;

use crate::common;
use crate::detection::assert_named;
use crate::synthetic::{ROWS, answer, most, noise};

/// A mean that jumps on and off, with stays of these means on the average, s.
fn jumping(seed: u64, shift: f64, [on_s, off_s]: [f64; 2]) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(130_000 + seed);
    let mut uniform = || -> f64 { StandardUniform.sample(&mut random) };
    let mut on = false;
    (0..ROWS)
        .map(|_| {
            if uniform() < 1.0 / if on { on_s } else { off_s } {
                on = !on;
            }
            if on { shift } else { 0.0 }
        })
        .collect()
}

#[test]
fn a_mean_that_jumps_at_random_times_is_no_markov_noise() {
    // Of the height of the noise's own wandering, and with its autocorrelation.
    assert_named("jumps", |seed, values| {
        let shift = if seed % 2 == 0 { 2.5 } else { -2.5 };
        values.iter().zip(jumping(seed, shift, [40.0, 150.0])).map(|(value, jump)| value + jump).collect()
    });
}

#[test]
fn height_and_stays_of_jumps_have_honest_deviations() {
    const TRIALS: u64 = 24;
    let truth = [("coefficient", 4.0), ("on_s", 30.0), ("off_s", 90.0)];
    let told: Vec<_> = (0..TRIALS)
        .into_par_iter()
        .filter_map(|seed| {
            let jumps = jumping(500 + seed, 4.0, [30.0, 90.0]);
            let values = noise(40_000 + seed, ROWS).into_iter().zip(jumps).map(|(noise, jump)| noise + jump);
            let first = answer(vec![values.collect()], false).unwrap().findings.into_iter().next()?;
            let told = |name: &str| {
                let parameter = first.parameters.iter().find(|it| it.name == name)?;
                Some((parameter.value?, parameter.sigma?))
            };
            let deviation =
                |(name, truth): (&str, f64)| told(name).map(|(value, sigma)| (value - truth) / sigma);
            (first.effect == "jumps").then(|| truth.map(|it| deviation(it).expect("it is told")))
        })
        .collect();
    println!("{told:.1?}");
    assert!(told.len() as u64 >= TRIALS - 2, "{} of {TRIALS} found", told.len());
    let outside = told.as_flattened().iter().filter(|deviation| deviation.abs() > 3.0).count();
    println!("{outside} of {} beyond 3 σ", 3 * told.len());
    assert!(outside <= most(3 * told.len(), 0.003).max(3), "{outside}");
}

/// A white level that is stated too low does not make an oscillation out of slow effects beside it, one that has decayed from one reading to
/// the next.
#[test]
#[ignore = "in one of three records lines and oscillations are told in the place of jumps"]
fn jumps_beside_a_louder_noise_than_stated_are_told() {
    const LONG: usize = 12_000;
    for (seed, stated) in [(1, 0.7), (2, 0.8), (3, 0.6)] {
        let mut random = Pcg64::seed_from_u64(9000 + seed);
        let mut reading = |row: usize| {
            let noise: f64 = StandardNormal.sample(&mut random);
            noise + if (row / 1000) % 3 == 1 { 0.6 } else { 0.0 }
        };
        let values = (0..LONG).map(&mut reading).collect();
        let markov = Some(Markov { sigma: 0.02, tau_s: 300.0 });
        let nominal = Nominal { white: stated, markov, ..Nominal::default() };
        let (kind, unit) = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let sensor = common::series("velocity", kind, unit, [1.0, 0.0, 0.0], nominal, values);
        let recording = common::recording(MotionKind::Static, vec![sensor]);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        found.sort_unstable();
        assert_eq!(found, ["intermittent_jump", "noise_white"], "{stated}: {:?}", answer.findings);
    }
}

/// A mean that jumps may be on for one reading, and off for one.
#[test]
fn a_jump_of_one_reading_is_no_spike() {
    let is_on = |row: usize| (row % 500 >= 350 || row == 1130) && row != 1425;
    let mut random = Pcg64::seed_from_u64(8400);
    let mut reading = |row: usize| {
        let noise: f64 = StandardNormal.sample(&mut random);
        noise + if is_on(row) { 8.0 } else { 0.0 }
    };
    let values: Vec<f64> = (0..ROWS).map(&mut reading).collect();
    let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 1.0, ..Nominal::default() };
    let gyro = common::series("gyro", kind, unit, [1.0, 0.0, 0.0], nominal, values);
    let mut recording = common::recording(MotionKind::Static, vec![gyro]);
    recording.sensors[0].sensor.relative = true;
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(told, ["intermittent_jump"], "{:?}", answer.findings);
}
