//! Readings that are stuck, coarse or spiked.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::catalogue::{NoiseChange, ReadingFault, Search};
use schuler_explain::config::Config;
use schuler_explain::explain::{explain, explain_with};
use schuler_explain::faults::faults;
use schuler_explain::inputs::Inputs;
use schuler_explain::nominal::Model;
use schuler_recording::case::{Markov, MotionKind, Nominal, SchulerLoop, SensorKind};
use schuler_recording::unit::Unit;

use crate::common;
use crate::detection::assert_named;
use crate::schuler_loop::{loop_noise, schuler_loop};
use crate::synthetic::{ANGLE, ROWS, candidate, candidates, markov, noise, recording, with};

/// Readings that never move are those of a stuck output or of steps coarser than all there is to read; ones that moved until then are not.
#[test]
fn readings_that_never_move_may_be_coarse() {
    let class = |moves_until: usize| {
        let mut values = noise(170_000, ROWS);
        values[moves_until..].fill(0.25);
        let recording = recording(vec![values, noise(170_001, ROWS)]);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let of_it = answer.findings.into_iter().find(|finding| finding.sensor == "sensor_0");
        let class = of_it.into_iter().flat_map(|finding| finding.class);
        class.map(|member| member.effect).collect::<Vec<String>>()
    };
    assert_eq!(class(0), ["output_stuck", "quantisation"]);
    assert_eq!(class(ROWS / 2), ["output_stuck"]);
}

#[test]
fn faults_in_readings_are_named_and_do_not_breed() {
    assert_named("noise_outliers", |seed, mut values| {
        for spike in 0..4 {
            values[200 + 400 * spike + seed as usize] += 15.0;
        }
        values
    });
    // None of them would stand out of so many readings alone.
    assert_named("noise_outliers", |seed, mut values| {
        for spike in 0..10 {
            values[100 + 180 * spike + seed as usize] += if spike % 3 == 0 { -3.3 } else { 3.3 };
        }
        values
    });
    assert_named("output_stuck", |_, mut values| {
        let held = values[1500];
        values[1500..].fill(held);
        values
    });
    assert_named("output_saturated", |_, mut values| {
        for value in &mut values {
            *value = value.clamp(-1.5, 1.5);
        }
        values
    });
    // A few readings at a limit, among thousands that never coincide.
    assert_named("output_saturated", |_, mut values| {
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = sorted[14];
        for value in &mut values {
            *value = value.max(limit);
        }
        values
    });
    assert_named("quantisation", |_, mut values| {
        for value in &mut values {
            *value = value.round();
        }
        values
    });
    assert_named("jumps", |seed, values| {
        let start = 100.0 + seed as f64;
        with(values, |time| if (time - start).rem_euclid(500.0) < 120.0 { 5.0 } else { 0.0 })
    });
}

/// A reading like the largest integer is one that is set aside; all else is told as without it.
#[test]
fn one_huge_reading_hides_nothing() {
    for huge in [1e6, 2_147_483_647.0, -1e18, 1e30] {
        let drifts = |mut values: Vec<f64>| {
            values[700] = huge;
            with(values, |time| 0.002 * time)
        };
        let recording = recording(vec![drifts(noise(77, ROWS))]);
        let inputs = Inputs::new(&recording);
        let config = Config { hold_out: false, ..Config::default() };
        let answer = explain_with(&inputs, candidates(ROWS, 1), &config).unwrap();
        let mut told: Vec<&str> = answer.findings.iter().map(|it| it.effect.as_str()).collect();
        told.sort_unstable();
        assert_eq!(told, ["noise_outliers", "trend"], "{huge}");
    }
}

#[test]
fn a_rounded_angle_is_told_from_rounded_readings() {
    const TRIALS: u64 = 12;
    for step in [1.0, 2.0] {
        for seed in 0..TRIALS {
            let (mut angle, mut before) = (0.0, 0.0);
            let values: Vec<f64> = (noise(9000 + seed, ROWS).iter())
                .map(|value| {
                    angle += value;
                    let now = step * (angle / step).round();
                    let told = now - before;
                    before = now;
                    told
                })
                .collect();
            let recording = recording(vec![values]);
            let inputs = Inputs::new(&recording);
            let mut all = candidates(ROWS, 1);
            all.push(candidate(&ANGLE, 0, Search::Noise(NoiseChange::AngleQuantisation)));
            let answer =
                explain_with(&inputs, all, &Config { hold_out: false, ..Config::default() }).unwrap();
            let first = answer.findings.first().map(|finding| finding.effect.as_str());
            assert_eq!(first, Some("angle"), "step {step}, seed {seed}");
            assert!(answer.findings.iter().all(|finding| finding.effect != "quantisation"));
        }
    }
}

/// What is seen of one sensor at rest whose noise is stated as white of so much.
fn seen_at_rest(stated: f64, values: Vec<f64>) -> Vec<String> {
    let mut recording = recording(vec![values]);
    recording.sensors[0].sensor.nominal = Nominal { white: stated, ..Nominal::default() };
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    answer.findings.into_iter().map(|finding| finding.effect).collect()
}

#[test]
fn rounding_that_the_noise_carries_hides_no_slow_noise() {
    const STEP: f64 = 3.0;
    for seed in 0..5 {
        let mut random = Pcg64::seed_from_u64(172_000 + seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut walk = 0.0;
        let mut reading = |_| {
            walk += 0.1 * normal();
            STEP * ((walk + normal()) / STEP).round()
        };
        let seen = seen_at_rest(1.0, (0..ROWS).map(&mut reading).collect());
        assert!(seen.iter().any(|effect| effect == "quantisation"), "{seen:?}");
        assert!(seen.iter().any(|effect| effect == "noise_random_walk"), "{seen:?}");
    }
}

/// Readings that are rounded, of a gyro that has more noise than the case says: what holds more noise would be the likelier at the stated level,
/// and a rounded angle holds twice that of rounded readings.
#[test]
fn rounded_readings_with_more_noise_than_stated_are_no_rounded_angle() {
    for (seed, step) in [(1, 0.8), (2, 1.0), (3, 1.5)] {
        let values: Vec<f64> =
            (noise(9600 + seed, ROWS).iter()).map(|value| step * (value / step).round()).collect();
        let nominal = Nominal { white: 0.6, ..Nominal::default() };
        let (kind, unit) = (SensorKind::Rlg, Unit::RadianPerSecond);
        let gyro = common::series("gyro", kind, unit, [1.0, 0.0, 0.0], nominal, values);
        let mut recording = common::recording(MotionKind::Recorded, vec![gyro]);
        recording.motion.rate = Some([vec![0.0; ROWS], vec![0.0; ROWS], vec![0.0; ROWS]]);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert!(
            told.contains(&"quantisation") && !told.contains(&"noise_angle_quantisation"),
            "{step}: {told:?}"
        );
    }
}

/// A velocity error that swings turns back in a gap: the first reading after it is the largest for a while, and no spike. A spike elsewhere is
/// one, and so is one in a record of which only every fifth row was read.
#[test]
fn what_turns_back_in_a_gap_is_no_spike() {
    let of_loop = schuler_loop();
    let found = |is_read: &dyn Fn(usize) -> bool, spike: Option<usize>| {
        let values = loop_noise(71, ROWS, &of_loop).into_iter().enumerate().map(|(row, error)| {
            let swing = 8.0 * (std::f64::consts::TAU * row as f64 / 88.0).cos();
            let read = error + swing + if Some(row) == spike { 6.0 } else { 0.0 };
            if is_read(row) { read } else { f64::NAN }
        });
        let nominal = Nominal { white: of_loop.velocity_white, ..Nominal::default() };
        let (kind, unit) = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let velocity = common::series("v", kind, unit, [1.0, 0.0, 0.0], nominal, values.collect());
        let mut recording = common::recording(MotionKind::VelocityError, vec![velocity]);
        recording.case.schuler_loop = Some(of_loop);
        let model = Model::new(&recording, &[]).unwrap();
        let of = |fault: schuler_explain::faults::Fault| (fault.fault, fault.rows.0);
        faults(&recording, &model).found.into_iter().map(of).collect::<Vec<_>>()
    };
    // From 7 rows before a turn to 6 rows after it.
    let turn = ROWS / 88 * 44;
    let read = |row: usize| !(turn - 7..turn + 7).contains(&row);
    assert_eq!(found(&read, None), []);
    assert_eq!(found(&read, Some(700)), [(ReadingFault::Outliers, 700)]);
    assert_eq!(found(&|row| row % 5 == 0, Some(700)), [(ReadingFault::Outliers, 700)]);
}

/// The digits in which a table is written are no coarse readings, wherever the case states the noise that they are fine beside, or if it states
/// none; a step as large as that noise is one.
#[test]
fn digits_of_a_table_are_fine_beside_noise_that_is_stated_elsewhere() {
    let of_loop = schuler_loop();
    let errors = loop_noise(8951, ROWS, &of_loop);
    let found = |step: f64, stated: bool| {
        let values = errors.iter().map(|error| (error / step).round() * step).collect();
        let (kind, unit) = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let velocity = common::series("v", kind, unit, [1.0, 0.0, 0.0], Nominal::default(), values);
        let mut recording = common::recording(MotionKind::VelocityError, vec![velocity]);
        let velocity_white = if stated { of_loop.velocity_white } else { 0.0 };
        recording.case.schuler_loop = Some(SchulerLoop { velocity_white, ..of_loop });
        let model = Model::new(&recording, &[]).unwrap();
        faults(&recording, &model).found.iter().any(|fault| fault.fault == ReadingFault::Quantised)
    };
    for stated in [true, false] {
        assert!(!found(1e-3, stated), "{stated}");
        assert!(found(0.2, stated), "{stated}");
    }
    // A gyro of which Markov noise alone is stated.
    let noise = markov(&mut Pcg64::seed_from_u64(8953), ROWS, 1e-6, 300.0);
    let found = |step: f64| {
        let values = noise.iter().map(|error| (error / step).round() * step).collect();
        let stated = Some(Markov { sigma: 1e-6, tau_s: 300.0 });
        let nominal = Nominal { markov: stated, ..Nominal::default() };
        let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
        let mut gyro = common::series("g", kind, unit, [1.0, 0.0, 0.0], nominal, values);
        gyro.sensor.relative = true;
        let recording = common::recording(MotionKind::Static, vec![gyro]);
        let model = Model::new(&recording, &[]).unwrap();
        faults(&recording, &model).found.iter().any(|fault| fault.fault == ReadingFault::Quantised)
    };
    assert!(!found(1e-9));
    assert!(found(5e-7));
}

#[test]
fn a_spike_between_two_sensors_may_be_of_either() {
    let mut recording = recording(vec![noise(61, ROWS), noise(62, ROWS)]);
    recording.case.motion.kind = MotionKind::Unknown;
    for spike in 0..4 {
        recording.sensors[0].values[200 + 400 * spike] += 25.0;
    }
    let inputs = Inputs::new(&recording);
    let options = Config { hold_out: false, ..Config::default() };
    let answer = explain_with(&inputs, candidates(ROWS, 2), &options).unwrap();
    let spikes =
        answer.findings.iter().find(|finding| finding.effect == "noise_outliers").expect("they are large");
    let mut either: Vec<&str> = spikes.class.iter().map(|member| member.sensor.as_str()).collect();
    either.sort_unstable();
    assert_eq!(either, ["sensor_0", "sensor_1"]);
}
