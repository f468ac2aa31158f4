//! Effects and noise inside a Schuler loop.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::catalogue::{Candidate, NoiseChange, OnsetShape, Port, Search};
use schuler_explain::config::Config;
use schuler_explain::explain::explain_with;
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{Markov, MotionKind, Nominal, SchulerLoop, SensorKind};
use schuler_recording::unit::Unit;

use crate::common;
use crate::synthetic::{MARKOV, RAMP, STEP, WHITE, candidate, markov, most};

pub fn schuler_loop() -> SchulerLoop {
    SchulerLoop {
        radius_m: 6.371e6,
        gravity: 9.806_65,
        accelerometer: Some(Markov { sigma: 2e-4, tau_s: 200.0 }),
        gyro: Some(Markov { sigma: 5e-8, tau_s: 1500.0 }),
        velocity_white: 0.05,
    }
}

/// The velocity error of a Schuler loop as its nominal model says.
pub fn loop_noise(seed: u64, rows: usize, of: &SchulerLoop) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let [a, w] = [of.accelerometer, of.gyro].map(|part| {
        let part = part.unwrap();
        markov(&mut random, rows, part.sigma, part.tau_s)
    });
    let (mut velocity, mut tilt) = (0.0, 0.0);
    (0..rows)
        .map(|row| {
            let white: f64 = StandardNormal.sample(&mut random);
            let now = velocity + of.velocity_white * white;
            velocity += a[row] - of.gravity * tilt;
            tilt += w[row] + velocity / of.radius_m;
            now
        })
        .collect()
}

/// Noise inside a loop goes on between rows that are a third of its time constant apart: what the loop makes of it there is neither another
/// noise nor a quieter velocity.
#[test]
fn noise_of_a_loop_with_a_long_step_is_as_stated() {
    const TRIALS: usize = 60;
    const STEP_S: usize = 240;
    let of = SchulerLoop {
        accelerometer: Some(Markov { sigma: 7e-4, tau_s: 720.0 }),
        gyro: Some(Markov { sigma: 4e-8, tau_s: 2200.0 }),
        velocity_white: 0.04,
        ..schuler_loop()
    };
    let false_alarms = (0..TRIALS as u64).into_par_iter().filter(|&seed| {
        let every_second = loop_noise(61_000 + seed, 2000 * STEP_S, &of);
        let values = every_second.into_iter().step_by(STEP_S).collect();
        let (kind, unit) = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let series = common::series("velocity", kind, unit, [1.0, 0.0, 0.0], Nominal::default(), values);
        let mut recording = common::recording(MotionKind::VelocityError, vec![series]);
        recording.case.schuler_loop = Some(of);
        recording.step_s = STEP_S as f64;
        recording.time_s = (0..2000).map(|row| (row * STEP_S) as f64).collect();
        let inputs = Inputs::new(&recording);
        let ports = [Port::Output, Port::Accelerometer, Port::Gyro];
        let noises = |port: Port| {
            [(&WHITE, NoiseChange::White), (&MARKOV, NoiseChange::Markov)]
                .map(|(effect, change)| Candidate { port, ..candidate(effect, 0, Search::Noise(change)) })
        };
        let candidates = ports.into_iter().flat_map(noises).collect();
        let options = Config { hold_out: false, ..Config::default() };
        !explain_with(&inputs, candidates, &options).unwrap().findings.is_empty()
    });
    let false_alarms = false_alarms.count();
    assert!(false_alarms <= most(TRIALS, 0.01), "{false_alarms}");
}

/// An accelerometer's step is integrated by the loop: its scores at neighbouring onsets are nearly the same, and yet there are
/// many onsets.
#[test]
fn onsets_inside_a_loop_are_counted() {
    const TRIALS: usize = 150;
    const LEVEL: f64 = 0.5;
    // The share of the level that onsets have.
    const SHARE: f64 = 0.2;
    let of = schuler_loop();
    let false_alarms = (0..TRIALS as u64).into_par_iter().filter(|&seed| {
        let (kind, unit) = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let values = loop_noise(60_000 + seed, 5000, &of);
        let series = common::series("velocity", kind, unit, [1.0, 0.0, 0.0], Nominal::default(), values);
        let mut recording = common::recording(MotionKind::VelocityError, vec![series]);
        recording.case.schuler_loop = Some(of);
        let inputs = Inputs::new(&recording);
        let ports = [Port::Output, Port::Accelerometer, Port::Gyro];
        let at = |port: Port| {
            [(&STEP, OnsetShape::Step), (&RAMP, OnsetShape::Ramp)]
                .map(|(effect, shape)| Candidate { port, ..candidate(effect, 0, Search::Onset(shape)) })
        };
        let options = Config { told_at: LEVEL, hold_out: false, ..Config::default() };
        let answer = explain_with(&inputs, ports.into_iter().flat_map(at).collect(), &options).unwrap();
        !answer.findings.is_empty()
    });
    let false_alarms = false_alarms.count();
    println!("{false_alarms} of {TRIALS} at {}", SHARE * LEVEL);
    assert!(false_alarms <= most(TRIALS, SHARE * LEVEL), "{false_alarms}");
    // A limit that no score can reach would give none.
    assert!(false_alarms >= 1, "{false_alarms}");
}
