//! The engine on synthetic records with signatures of the tests' own: false alarms, detection, naming, uncertainties.
//!
//! Seeds are fixed; no bound is set to what they give: bounds are those of the acceptance figures with their binomial
//! allowance.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::catalogue::{
    Amplitude, CATALOGUE, Candidate, Column, Effect, Form, InFlight, NoiseChange, Nonlinear, OnsetShape,
    Port, ReadingFault, Search, Signature, Target,
};
use schuler_explain::config::Config;
use schuler_explain::explain::{Error, explain, explain_with};
use schuler_explain::explanation::{Explanation, Finding, Verdict};
use schuler_explain::faults::faults;
use schuler_explain::inputs::Inputs;
use schuler_explain::nominal::Model;
use schuler_recording::Recording;
use schuler_recording::case::{
    Auxiliary, Markov, MotionKind, Nominal, Quantity, SchulerLoop, SensorKind, TemperatureBias,
};
use schuler_recording::recording::{AuxiliarySeries, Quality};
use schuler_recording::unit::Unit;

mod common;

macro_rules! effect {
    ($name:ident, $id:literal) => {
        static $name: Effect = Effect {
            id: $id,
            formula: "",
            sentence: "{sensor} is wrong",
            needs: "",
            separated_by: "another record",
            source: "",
            in_flight: InFlight::Never("it is not"),
            form: Form::Values,
            acts_on: |_| true,
            candidates: |_, _| Vec::new(),
        };
    };
}

effect!(TREND, "trend");
effect!(CONSTANT, "constant");
effect!(WARM, "warm");
effect!(WAVE, "wave");
effect!(WAVE_RATE, "wave_rate");
effect!(LAGGED, "lagged");
effect!(DELAY, "delay");
effect!(STEP, "step");
effect!(RAMP, "ramp");
effect!(LINE, "line");
effect!(WHITE, "white");
effect!(MARKOV, "markov");
effect!(COSINE, "cosine");
effect!(WALK, "walk");
effect!(VARIANCE, "variance");
effect!(FLICKER, "flicker");
effect!(ANGLE, "angle");
effect!(JUMPS, "jumps");

const WHITE_SIGMA: f64 = 0.5;
const MARKOV_SIGMA: f64 = 1.0;
const TAU_S: f64 = 40.0;

/// A slow wave that never repeats within a record.
fn wave(time: f64, length: f64) -> f64 {
    (7.0 * time / length).sin() + 0.5 * (17.0 * time / length + 1.0).cos()
}

fn wave_rate(time: f64, length: f64) -> f64 {
    7.0 * (7.0 * time / length).cos() - 8.5 * (17.0 * time / length + 1.0).sin()
}

fn low_pass(values: &[f64], tau: f64) -> Vec<f64> {
    let mut state = values.first().copied().unwrap_or_default();
    values
        .iter()
        .map(|value| {
            state += (value - state) / tau.max(1.0);
            state
        })
        .collect()
}

fn amplitude() -> Amplitude {
    Amplitude { name: "coefficient".to_owned(), unit: "m/s".to_owned(), in_unit: 1.0, plausible: None }
}

fn candidate(effect: &'static Effect, sensor: usize, search: Search) -> Candidate {
    let amplitudes = match search {
        Search::Frequency => vec![amplitude(), amplitude()],
        Search::Readings(ReadingFault::IntermittentJump) => vec![amplitude()],
        Search::Noise(_) | Search::Readings(_) => Vec::new(),
        _ => vec![amplitude()],
    };
    Candidate {
        effect,
        target: Target::Sensor(sensor),
        port: Port::Output,
        variant: Vec::new(),
        search,
        amplitudes,
        noise_factor: 1.0,
    }
}

fn signature(sensor: usize, values: Vec<f64>) -> Signature {
    Signature { columns: vec![Column::on(sensor, values)] }
}

/// Every kind of candidate on every sensor.
fn candidates(rows: usize, sensors: usize) -> Vec<Candidate> {
    let times: Vec<f64> = (0..rows).map(|row| row as f64).collect();
    let length = rows as f64;
    let waved: Vec<f64> = times.iter().map(|&time| wave(time, length)).collect();
    (0..sensors)
        .flat_map(|sensor| {
            let linear =
                |effect, values| candidate(effect, sensor, Search::Linear(signature(sensor, values)));
            let noise = |effect, change| candidate(effect, sensor, Search::Noise(change));
            let fault = |effect, fault| candidate(effect, sensor, Search::Readings(fault));
            let lagged = waved.clone();
            let lag = Search::Grid {
                parameters: vec![Nonlinear {
                    name: "tau_s",
                    unit: "s",
                    grid: vec![20.0, 50.0, 120.0, 300.0, 800.0],
                }],
                signature: Box::new(move |point| signature(sensor, low_pass(&lagged, point[0]))),
                unit_amplitude: false,
            };
            vec![
                linear(&TREND, times.iter().map(|time| time / length).collect()),
                linear(&WAVE, waved.clone()),
                linear(&WAVE_RATE, times.iter().map(|&time| wave_rate(time, length)).collect()),
                candidate(&LAGGED, sensor, lag),
                candidate(&STEP, sensor, Search::Onset(OnsetShape::Step)),
                candidate(&RAMP, sensor, Search::Onset(OnsetShape::Ramp)),
                candidate(&LINE, sensor, Search::Frequency),
                noise(&WHITE, NoiseChange::White),
                noise(&MARKOV, NoiseChange::Markov),
                noise(&COSINE, NoiseChange::ExponentialCosine),
                noise(&WALK, NoiseChange::RandomWalk),
                noise(&VARIANCE, NoiseChange::VarianceStep),
                fault(&JUMPS, ReadingFault::IntermittentJump),
            ]
        })
        .collect()
}

fn markov(random: &mut Pcg64, rows: usize, sigma: f64, tau: f64) -> Vec<f64> {
    let phi = (-1.0 / tau).exp();
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let mut state = sigma * normal();
    (0..rows)
        .map(|_| {
            let now = state;
            state = phi * state + sigma * (1.0 - phi * phi).sqrt() * normal();
            now
        })
        .collect()
}

/// Coloured noise as the nominal model says.
fn noise(seed: u64, rows: usize) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut values = markov(&mut random, rows, MARKOV_SIGMA, TAU_S);
    for value in &mut values {
        let white: f64 = StandardNormal.sample(&mut random);
        *value += WHITE_SIGMA * white;
    }
    values
}

fn recording(series: Vec<Vec<f64>>) -> Recording {
    let nominal = Nominal {
        white: WHITE_SIGMA,
        markov: Some(Markov { sigma: MARKOV_SIGMA, tau_s: TAU_S }),
        ..Nominal::default()
    };
    let kind = (SensorKind::Doppler, Unit::MetrePerSecond);
    let sensors = series.into_iter().enumerate().map(|(index, values)| {
        common::series(&format!("sensor_{index}"), kind, [1.0, 0.0, 0.0], nominal.clone(), values)
    });
    common::recording(MotionKind::Static, sensors.collect())
}

/// Five sensors on a cone in an unknown motion.
fn block_of_five(series: Vec<Vec<f64>>) -> Recording {
    let mut block = recording(series);
    block.case.motion.kind = MotionKind::Unknown;
    for (place, series) in block.sensors.iter_mut().enumerate() {
        let (sin, cos) = (1.2 * place as f64).sin_cos();
        series.sensor.axis = Some([0.6 * cos, 0.6 * sin, 0.8]);
    }
    block
}

fn answer(series: Vec<Vec<f64>>, hold_out: bool) -> Result<Explanation, Error> {
    let recording = recording(series);
    let inputs = Inputs::new(&recording);
    let candidates = candidates(recording.len(), recording.sensors.len());
    explain_with(&inputs, candidates, &Config { hold_out, ..Config::default() })
}

/// Records a quantity beside the sensors.
fn record(recording: &mut Recording, (column, quantity, unit): (&str, Quantity, &str), values: Vec<f64>) {
    let auxiliary = Auxiliary {
        column: column.to_owned(),
        quantity,
        unit: unit.to_owned(),
        scale: None,
        offset: None,
        near: None,
        position_m: None,
    };
    recording.auxiliaries.push(AuxiliarySeries { auxiliary, values, quality: Quality::default() });
}

fn with(mut values: Vec<f64>, add: impl Fn(f64) -> f64) -> Vec<f64> {
    values.iter_mut().enumerate().for_each(|(row, value)| *value += add(row as f64));
    values
}

/// Most successes that `trials` with the probability `p` show but once in a thousand.
fn most(trials: usize, p: f64) -> usize {
    let mean = trials as f64 * p;
    (mean + 3.1 * (mean * (1.0 - p)).sqrt() + 1.0) as usize
}

const ROWS: usize = 2000;

#[test]
fn nothing_is_found_where_nothing_is_hidden() {
    const TRIALS: usize = 200;
    let false_alarms: Vec<String> = (0..TRIALS as u64)
        .into_par_iter()
        .flat_map_iter(|seed| {
            let series = (0..2).map(|sensor| noise(1000 + 2 * seed + sensor, ROWS)).collect();
            let answer = answer(series, false).unwrap();
            if answer.findings.is_empty() {
                assert!(matches!(answer.verdict, Verdict::NoMismatch | Verdict::Unexplained));
            }
            let wrong = answer.verdict != Verdict::NoMismatch;
            wrong.then(|| {
                format!("{:?} {:?}", answer.verdict, answer.findings.first().map(|f| f.effect.clone()))
            })
        })
        .collect();
    println!("{} of {TRIALS}: {false_alarms:?}", false_alarms.len());
    assert!(false_alarms.len() <= most(TRIALS, 0.01), "{false_alarms:?}");
}

fn schuler_loop() -> SchulerLoop {
    SchulerLoop {
        radius_m: 6.371e6,
        gravity: 9.806_65,
        accelerometer: Some(Markov { sigma: 2e-4, tau_s: 200.0 }),
        gyro: Some(Markov { sigma: 5e-8, tau_s: 1500.0 }),
        velocity_white: 0.05,
    }
}

/// The velocity error of a Schuler loop as its nominal model says.
fn loop_noise(seed: u64, rows: usize, of: &SchulerLoop) -> Vec<f64> {
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
        let kind = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let series = common::series("velocity", kind, [1.0, 0.0, 0.0], Nominal::default(), values);
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
        let kind = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let values = loop_noise(60_000 + seed, 5000, &of);
        let series = common::series("velocity", kind, [1.0, 0.0, 0.0], Nominal::default(), values);
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
    // Not by a price that nothing can pay.
    assert!(false_alarms >= 1, "{false_alarms}");
}

/// Share of `trials` in which the effect is in the class of the first finding on the first sensor, and nothing else is
/// found.
fn named(effect: &str, trials: u64, hide: impl Fn(u64, Vec<f64>) -> Vec<f64> + Sync) -> (usize, usize) {
    let found: Vec<(bool, bool)> = (0..trials)
        .into_par_iter()
        .map(|seed| {
            let series = vec![hide(seed, noise(5000 + 2 * seed, ROWS)), noise(5001 + 2 * seed, ROWS)];
            let answer = answer(series, false).unwrap();
            let right = (answer.findings.first())
                .is_some_and(|first| first.sensor == "sensor_0" && first.may_be(effect));
            if !right || answer.findings.len() > 1 {
                println!(
                    "{effect} {seed}: {:?}",
                    answer.findings.iter().map(|f| &f.class).collect::<Vec<_>>()
                );
            }
            (right, answer.findings.len() > 1)
        })
        .collect();
    (found.iter().filter(|found| found.0).count(), found.iter().filter(|found| found.1).count())
}

fn assert_named(effect: &str, hide: impl Fn(u64, Vec<f64>) -> Vec<f64> + Sync) {
    const TRIALS: u64 = 30;
    let (right, several) = named(effect, TRIALS, hide);
    println!("{effect}: right {right}, several {several} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{effect}: {right}");
    assert!(several <= most(TRIALS as usize, 0.05), "{effect}: {several} with something beside");
}

#[test]
fn deterministic_effects_in_coloured_noise_are_named() {
    let length = ROWS as f64;
    assert_named("wave", |_, values| with(values, |time| 1.3 * wave(time, length)));
    assert_named("trend", |_, values| with(values, |time| 3.0 * time / length));
    assert_named("step", |seed, values| {
        with(values, |time| if time >= 500.0 + 30.0 * seed as f64 { 3.0 } else { 0.0 })
    });
    assert_named("line", |seed, values| {
        with(values, |time| 0.25 * (0.9 * time + 0.01 * seed as f64 * time).sin())
    });
    assert_named("lagged", |_, values| {
        let waved: Vec<f64> = (0..ROWS).map(|row| wave(row as f64, length)).collect();
        let lagged = low_pass(&waved, 200.0);
        values.iter().zip(&lagged).map(|(value, lagged)| value + 2.0 * lagged).collect()
    });
}

#[test]
fn noise_of_another_kind_is_named() {
    let white = |seed: u64, sigma: f64| {
        move |values: Vec<f64>| -> Vec<f64> {
            let mut random = Pcg64::seed_from_u64(90_000 + seed);
            values
                .into_iter()
                .map(|value| {
                    let more: f64 = StandardNormal.sample(&mut random);
                    value + sigma * more
                })
                .collect()
        }
    };
    assert_named("white", |seed, values| white(seed, 0.35)(values));
    assert_named("variance", |seed, values| {
        let rough = white(seed, 0.6)(values.clone());
        values
            .into_iter()
            .zip(rough)
            .enumerate()
            .map(|(row, (a, b))| if row < 1200 { a } else { b })
            .collect()
    });
    assert_named("markov", |seed, values| {
        let more = markov(&mut Pcg64::seed_from_u64(70_000 + seed), ROWS, 0.8, 4.0);
        values.iter().zip(more).map(|(value, more)| value + more).collect()
    });
}

#[test]
fn flicker_is_told_from_a_markov_part_and_what_that_leaves() {
    const TRIALS: u64 = 12;
    let right = (0..TRIALS)
        .into_par_iter()
        .filter(|&seed| {
            // An octave apart, from some steps to the whole record.
            let mut random = Pcg64::seed_from_u64(110_000 + seed);
            let mut values = noise(8000 + seed, ROWS);
            let mut tau = 4.0;
            while tau <= ROWS as f64 {
                let part = markov(&mut random, ROWS, 0.6, tau);
                values.iter_mut().zip(part).for_each(|(value, part)| *value += part);
                tau *= 2.0;
            }
            let recording = recording(vec![values]);
            let inputs = Inputs::new(&recording);
            let mut all = candidates(ROWS, 1);
            all.push(candidate(&FLICKER, 0, Search::Noise(NoiseChange::Flicker)));
            let answer =
                explain_with(&inputs, all, &Config { hold_out: false, ..Config::default() }).unwrap();
            let right = matches!(&answer.findings[..], [one] if one.may_be("flicker"));
            if !right {
                println!("flicker {seed}: {:?}", answer.findings);
            }
            right
        })
        .count();
    println!("flicker: right {right} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
}

/// An oscillation whose frequency moves is in no catalogue, and some noise describes it best: the answer says that it is not all. One that
/// is the same at all times is.
#[test]
#[ignore = "in 7 of 12 records a step of the level beside Markov noise is told in another way"]
fn noise_that_is_not_the_same_at_all_times_is_not_all() {
    const TRIALS: u64 = 12;
    let answered = |values: Vec<f64>| {
        explain(&recording(vec![values]), &Config { hold_out: false, ..Config::default() }).unwrap()
    };
    let moves = |&seed: &u64| {
        let chirp = |row: usize| {
            let part = row as f64 / ROWS as f64;
            0.8 * (std::f64::consts::TAU * (20.0 + 40.0 * part) * part).cos()
        };
        let values = noise(140_000 + seed, ROWS).into_iter().enumerate();
        let answer = answered(values.map(|(row, value)| value + chirp(row)).collect());
        let left = answer.remainder.map_or(String::new(), |remainder| remainder.what);
        answer.verdict == Verdict::PartlyExplained && left.contains("is not the same at all times")
    };
    let stays = |&seed: &u64| {
        let mut random = Pcg64::seed_from_u64(141_000 + seed);
        let more = oscillating(&mut random, ROWS, 0.01, 0.15);
        let values = noise(142_000 + seed, ROWS).into_iter().zip(more);
        let answer = answered(values.map(|(value, more)| value + 0.7 * more).collect());
        answer.verdict == Verdict::Explained
    };
    // Markov noise that is not stated, beside a white level that is four times as large from half way on.
    let stays_beside_a_step = |&seed: &u64| {
        let mut random = Pcg64::seed_from_u64(143_000 + seed);
        let more = markov(&mut random, ROWS, 0.8, 4.0);
        let values =
            noise(144_000 + seed, ROWS).into_iter().zip(more).enumerate().map(|(row, (value, more))| {
                let white: f64 = StandardNormal.sample(&mut random);
                value + more + if row < ROWS / 2 { 0.0 } else { 2.0 * white }
            });
        let answer = answered(values.collect());
        answer.verdict == Verdict::Explained && answer.findings.len() > 1
    };
    let count = |told: &(dyn Fn(&u64) -> bool + Sync)| (0..TRIALS).into_par_iter().filter(told).count();
    let told = [count(&moves), count(&stays), count(&stays_beside_a_step)];
    println!("told of {TRIALS} that move, that stay, and that stay beside a step: {told:?}");
    assert!(told.iter().all(|told| told + 1 >= TRIALS as usize));
}

/// A product of two recorded quantities, and a broad resonance on one, are in no catalogue and go as slow noise does: the answer says what they depend
/// on. Slow noise beside the same quantities stays noise.
#[test]
fn what_depends_on_quantities_in_its_own_way_is_no_noise() {
    const TRIALS: u64 = 12;
    let answered = |seed: u64, more: &dyn Fn(&[f64; 2], f64) -> f64| {
        let mut random = Pcg64::seed_from_u64(150_000 + seed);
        let slow = markov(&mut random, ROWS, 0.8, 40.0);
        let phases: [f64; 6] = std::array::from_fn(|_| StandardUniform.sample(&mut random));
        let quantities: Vec<[f64; 2]> = (0..ROWS)
            .map(|row| {
                let turns = row as f64 / ROWS as f64;
                let of = |place: usize, number: f64| {
                    (std::f64::consts::TAU * (number * turns + phases[place])).sin() / number.sqrt()
                };
                [of(0, 1.3) + of(1, 3.7) + of(2, 8.1), of(3, 0.9) + of(4, 4.6) + of(5, 10.3)]
            })
            .collect();
        let values = noise(151_000 + seed, ROWS).into_iter().zip(&quantities).zip(slow);
        let mut recording =
            recording(vec![values.map(|((value, of), slow)| value + more(of, slow)).collect()]);
        for (place, column) in ["load", "humidity"].into_iter().enumerate() {
            let values = quantities.iter().map(|of| 50.0 + 10.0 * of[place]).collect();
            record(&mut recording, (column, Quantity::Other, "%"), values);
        }
        explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap()
    };
    let is_unexplained = |answer: Explanation, on: &str| {
        let said = answer.remainder.and_then(|remainder| remainder.on);
        let right = answer.verdict != Verdict::Explained && said.as_deref() == Some(on);
        if !right {
            println!("{on}: {said:?} {:?}", answer.findings.iter().map(|it| &it.effect).collect::<Vec<_>>());
        }
        right
    };
    let product = |&seed: &u64| is_unexplained(answered(seed, &|[a, b], _| 3.0 * a * b), "load and humidity");
    let resonance = |&seed: &u64| {
        let resonance = |[a, _]: &[f64; 2], _| 10.0 / (1.0 + ((a - 0.3) / 0.5).powi(2));
        is_unexplained(answered(100 + seed, &resonance), "load")
    };
    let noise = |&seed: &u64| answered(200 + seed, &|_, slow| slow).verdict == Verdict::Explained;
    let count = |told: &(dyn Fn(&u64) -> bool + Sync)| (0..TRIALS).into_par_iter().filter(told).count();
    let told = [count(&product), count(&resonance), count(&noise)];
    println!("told of {TRIALS} products, resonances and noises: {told:?}");
    assert!(told.iter().all(|told| told + 1 >= TRIALS as usize));
}

/// What a meter's noise adds to a quantity is no part of what acts: neither the coefficient nor the gain is less for it. Where the quantity itself
/// flickers, that acts as well.
#[test]
fn the_noise_of_a_meter_attenuates_no_coefficient() {
    const TRIALS: u64 = 24;
    const COEFFICIENT: f64 = 6.0;
    // Volts per row of a supply that wanders, and of what its meter or itself adds.
    let deviation = |flickers: bool, seed: u64| -> Option<f64> {
        let mut random = Pcg64::seed_from_u64(160_000 + seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let phases: [f64; 4] = std::array::from_fn(|_| normal());
        let (mut read, mut acts) = (Vec::new(), Vec::new());
        for row in 0..ROWS {
            let turns = std::f64::consts::TAU * row as f64 / ROWS as f64;
            let parts = [1.7, 3.9, 6.1, 11.3].iter().zip(phases);
            let wander: f64 =
                parts.map(|(number, phase)| (number * turns + phase).sin() / number.sqrt()).sum();
            let noise = 0.1 * normal();
            read.push((1e3 * (27.0 + wander + noise)).round() / 1e3);
            acts.push(if flickers { wander + noise } else { wander });
        }
        let values = noise(161_000 + seed, ROWS).into_iter().zip(acts);
        let mut recording = recording(vec![values.map(|(value, acts)| value + COEFFICIENT * acts).collect()]);
        record(&mut recording, ("supply", Quantity::Voltage, "V"), read);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let is_it = |finding: &&Finding| finding.effect == "bias_supply_voltage";
        let found = answer.findings.iter().find(is_it)?;
        let coefficient = found.parameters.iter().find(|parameter| parameter.name == "coefficient")?;
        Some((coefficient.value? - COEFFICIENT) / coefficient.sigma?)
    };
    for flickers in [false, true] {
        let deviations: Vec<Option<f64>> =
            (0..TRIALS).into_par_iter().map(|seed| deviation(flickers, seed)).collect();
        let found: Vec<f64> = deviations.into_iter().flatten().collect();
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        println!(
            "flickers {flickers}: found {} of {TRIALS}, mean deviation {mean:.2} σ: {found:.1?}",
            found.len()
        );
        assert!(found.len() == TRIALS as usize && found.iter().all(|deviation| deviation.abs() < 4.0));
        assert!(mean.abs() < 3.0 / (TRIALS as f64).sqrt());
    }
}

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

/// A random walk under white noise that is smaller than nominal, in short records: steps, drifts and lines are as good a description of
/// any one walk, and each gains more than it costs.
#[test]
fn a_random_walk_is_not_shared_out_to_shapes() {
    const TRIALS: u64 = 24;
    const SHORT: usize = 400;
    let right = |&seed: &u64| {
        let mut random = Pcg64::seed_from_u64(120_000 + seed);
        let mut walk = 0.0;
        let values = (0..SHORT).map(|_| {
            let [white, step]: [f64; 2] = [(); 2].map(|()| StandardNormal.sample(&mut random));
            walk += 0.1 * step;
            walk + 0.6 * white
        });
        let mut recording = recording(vec![values.collect()]);
        recording.sensors[0].sensor.nominal = Nominal { white: 2.0, ..Nominal::default() };
        let inputs = Inputs::new(&recording);
        let mut all = candidates(SHORT, 1);
        all.push(candidate(&FLICKER, 0, Search::Noise(NoiseChange::Flicker)));
        let options = Config { hold_out: false, ..Config::default() };
        let answer = explain_with(&inputs, all, &options).unwrap();
        let has = |id: &str| answer.findings.iter().any(|finding| finding.may_be(id));
        let right = answer.findings.len() == 2 && has("white") && has("walk");
        if !right {
            let named = answer.findings.iter().map(|finding| (&finding.class, finding.evidence.gain_nats));
            println!("walk {seed}: {:?}", named.collect::<Vec<_>>());
        }
        right
    };
    let right = (0..TRIALS).into_par_iter().filter(right).count();
    println!("walk: right {right} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
}

/// Exponential-cosine noise of unit deviation.
fn oscillating(random: &mut Pcg64, rows: usize, alpha: f64, beta: f64) -> Vec<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let (kept, driven) = ((-alpha).exp(), (1.0 - (-2.0 * alpha).exp()).sqrt());
    let (cosine, sine) = (kept * beta.cos(), kept * beta.sin());
    let mut state = [normal(), normal()];
    (0..rows)
        .map(|_| {
            let [x, y] = state;
            state = [cosine * x - sine * y + driven * normal(), sine * x + cosine * y + driven * normal()];
            x
        })
        .collect()
}

/// The nominal Markov process is not there: beside it an exponential-cosine would leave lines, in its place it leaves nothing.
#[test]
fn an_exponential_cosine_in_the_place_of_a_markov_process_is_the_only_finding() {
    const TRIALS: u64 = 12;
    const ROWS: usize = 8640;
    let (alpha, beta): (f64, f64) = (1.0 / 60.0, std::f64::consts::TAU / 90.0);
    let right = (0..TRIALS)
        .into_par_iter()
        .filter(|&seed| {
            let mut random = Pcg64::seed_from_u64(120_000 + seed);
            let mut values = oscillating(&mut random, ROWS, alpha, beta);
            for value in &mut values {
                let white: f64 = StandardNormal.sample(&mut random);
                *value += WHITE_SIGMA * white;
            }
            let answer = answer(vec![values], false).unwrap();
            let effects: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
            let right = effects == ["cosine"];
            if !right {
                println!("cosine {seed}: {effects:?}");
            }
            right
        })
        .count();
    println!("cosine: right {right} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
}

/// White and Markov noise both louder than stated: a part shorter than a step, and another one in the place of the stated slow one, are no
/// better a description, but begin with as much as the white level alone.
#[test]
fn noise_that_is_louder_than_stated_is_told_by_the_parts_that_are_stated() {
    const TRIALS: u64 = 16;
    const ROWS: usize = 20_000;
    let right = |&seed: &u64| {
        let mut random = Pcg64::seed_from_u64(125_000 + seed);
        let mut values = markov(&mut random, ROWS, 1.3 * MARKOV_SIGMA, 4.0 * TAU_S);
        for value in &mut values {
            let white: f64 = StandardNormal.sample(&mut random);
            *value += 1.1 * WHITE_SIGMA * white;
        }
        let mut recording = recording(vec![values]);
        if let Some(markov) = &mut recording.sensors[0].sensor.nominal.markov {
            markov.tau_s = 4.0 * TAU_S;
        }
        let options = Config { hold_out: false, ..Config::default() };
        let answer = explain_with(&Inputs::new(&recording), candidates(ROWS, 1), &options).unwrap();
        let mut effects: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        effects.sort_unstable();
        let right = effects == ["markov", "white"];
        if !right {
            println!("louder {seed}: {effects:?}");
        }
        right
    };
    let right = (0..TRIALS).into_par_iter().filter(right).count();
    println!("louder: right {right} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
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

/// Four effects look like slow noise, and the first of them that is found for two others: pairs in the place of terms that were found one
/// after the other lead to them.
#[test]
fn several_effects_behind_one_that_looks_like_two_are_not_taken_for_noise() {
    const TRIALS: u64 = 24;
    let length = ROWS as f64;
    let right = (0..TRIALS)
        .into_par_iter()
        .filter(|&seed| {
            let turned = seed as f64;
            let values = with(noise(17_000 + seed, ROWS), |time| {
                let step = if time >= 600.0 + 40.0 * turned { 8.0 } else { 0.0 };
                let waves = 4.0 * wave(time, length) - (0.4 + 0.01 * turned) * wave_rate(time, length);
                step + waves - 10.0 * time / length
            });
            let answer = answer(vec![values], false).unwrap();
            let names: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
            println!("{seed} {names:?}");
            // A wave that lags by nothing is a wave.
            let may_be = |effect: &str| answer.findings.iter().any(|finding| finding.may_be(effect));
            names.len() == 4 && ["step", "trend", "wave", "wave_rate"].into_iter().all(may_be)
        })
        .count();
    println!("{right} of {TRIALS}");
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
}

#[test]
fn several_effects_together_are_not_taken_for_noise() {
    const TRIALS: u64 = 12;
    let length = ROWS as f64;
    let right = (0..TRIALS)
        .into_par_iter()
        .filter(|&seed| {
            let values = with(noise(11_000 + seed, ROWS), |time| {
                let step = if time >= 700.0 + 20.0 * seed as f64 { -5.0 } else { 0.0 };
                8.0 * time / length + step + 2.0 * wave(time, length)
            });
            let answer = answer(vec![values], false).unwrap();
            let mut names: Vec<String> = answer.findings.into_iter().map(|finding| finding.effect).collect();
            names.sort();
            let right = names == ["step", "trend", "wave"];
            if !right {
                println!("several {seed}: {names:?}");
            }
            right
        })
        .count();
    assert!(TRIALS as usize - right <= most(TRIALS as usize, 0.05), "{right}");
}

#[test]
fn standard_deviations_are_honest() {
    const TRIALS: u64 = 100;
    let length = ROWS as f64;
    let outside = (0..TRIALS)
        .into_par_iter()
        .filter(|&seed| {
            let values = with(noise(20_000 + seed, ROWS), |time| 1.1 * wave(time, length));
            let answer = answer(vec![values], false).unwrap();
            answer.findings.first().is_some_and(|first| {
                first.effect == "wave"
                    && first.parameters.first().is_some_and(|parameter| {
                        let (value, sigma) = (parameter.value.unwrap(), parameter.sigma.unwrap());
                        (value - 1.1).abs() > 3.0 * sigma
                    })
            })
        })
        .count();
    println!("{outside} of {TRIALS} beyond 3 σ");
    assert!(outside <= most(TRIALS as usize, 0.003).max(3), "{outside}");
}

/// A drift that began a third of the record after its start, and is told as one over all of it because the search for its onset costs more
/// than it shows, is too flat: its deviation has to say that it may have begun later.
#[test]
#[ignore = "the deviation is that of one onset and not of all that are possible"]
fn a_drift_that_may_have_begun_later_has_an_honest_deviation() {
    const TRIALS: u64 = 32;
    let length = ROWS as f64;
    let slope = 3.0 / length;
    let told = |seed: u64| {
        let values = with(noise(80_000 + seed, ROWS), |time| slope * (time - length / 3.0).max(0.0));
        let whole = signature(0, (0..ROWS).map(|row| row as f64).collect());
        let all = vec![
            candidate(&RAMP, 0, Search::Linear(whole)),
            candidate(&RAMP, 0, Search::Onset(OnsetShape::Ramp)),
        ];
        let recording = recording(vec![values]);
        let inputs = Inputs::new(&recording);
        let answer = explain_with(&inputs, all, &Config { hold_out: false, ..Config::default() }).unwrap();
        let first = answer.findings.into_iter().next()?;
        let is_whole = first.parameters.iter().all(|parameter| parameter.name != "onset_s");
        let coefficient = first.parameters.into_iter().find(|parameter| parameter.name == "coefficient")?;
        is_whole.then(|| (coefficient.value.unwrap() - slope) / coefficient.sigma.unwrap())
    };
    let told: Vec<f64> = (0..TRIALS).into_par_iter().filter_map(told).collect();
    println!("{told:.1?}");
    assert!(told.len() >= 8, "{} of {TRIALS} over the whole record", told.len());
    let outside = told.iter().filter(|deviation| deviation.abs() > 3.0).count();
    assert!(outside <= most(told.len(), 0.03), "{outside} of {}", told.len());
}

#[test]
fn what_looks_the_same_is_a_class_and_not_a_name() {
    // Under one exponential a quantity and its rate are the same function up to a factor and a constant.
    let warm: Vec<f64> = (0..ROWS).map(|row| (-(row as f64) / 400.0).exp()).collect();
    let rate: Vec<f64> = warm.iter().map(|value| -value / 400.0).collect();
    let values: Vec<f64> =
        noise(31, ROWS).iter().zip(&warm).map(|(noise, warm)| noise + 3.0 * warm).collect();
    let recording = recording(vec![values]);
    let inputs = Inputs::new(&recording);
    let mut all = candidates(ROWS, 1);
    all.retain(|candidate| !matches!(candidate.search, Search::Linear(_) | Search::Grid { .. }));
    all.push(candidate(&WAVE, 0, Search::Linear(signature(0, warm))));
    all.push(candidate(&WAVE_RATE, 0, Search::Linear(signature(0, rate))));
    let answer = explain_with(&inputs, all, &Config { hold_out: false, ..Config::default() }).unwrap();
    let first = answer.findings.first().expect("a strong effect");
    assert!(first.may_be("wave") && first.may_be("wave_rate"));
    let rival = first.rivals().iter().find(|rival| rival.effect.starts_with("wave")).expect("a rival");
    assert!((0.05..0.95).contains(&rival.probability), "{}", rival.probability);
}

#[test]
fn a_delay_is_found_without_an_amplitude() {
    let input: Vec<f64> = (0..ROWS).map(|row| 20.0 * (0.05 * row as f64).sin()).collect();
    let delayed = |delay: f64| -> Vec<f64> {
        (0..ROWS)
            .map(|row| 20.0 * ((0.05 * (row as f64 - delay)).sin() - (0.05 * row as f64).sin()))
            .collect()
    };
    let values: Vec<f64> =
        noise(77, ROWS).iter().zip(delayed(0.7)).map(|(noise, more)| noise + more).collect();
    let recording = recording(vec![values]);
    let inputs = Inputs::new(&recording);
    let mut all = candidates(ROWS, 1);
    let search = Search::Grid {
        parameters: vec![Nonlinear { name: "delay_s", unit: "s", grid: vec![0.1, 0.3, 0.6, 1.0, 1.5] }],
        signature: Box::new(move |point| signature(0, delayed(point[0]))),
        unit_amplitude: true,
    };
    let mut delay = candidate(&DELAY, 0, search);
    delay.amplitudes = vec![amplitude()];
    all.push(delay);
    assert_eq!(input.len(), ROWS);
    let answer = explain_with(&inputs, all, &Config { hold_out: false, ..Config::default() }).unwrap();
    let first = answer.findings.first().expect("a strong effect");
    assert!(first.may_be("delay"), "{:?}", first.class);
    if first.effect == "delay" {
        let parameter = first.parameters.iter().find(|parameter| parameter.name == "delay_s").unwrap();
        let (value, sigma) = (parameter.value.unwrap(), parameter.sigma.unwrap());
        assert!((value - 0.7).abs() < 3.5 * sigma, "{value} {sigma}");
    }
}

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
        let gyro = common::series(
            "gyro",
            (SensorKind::Fog, Unit::RadianPerSecond),
            [1.0, 0.0, 0.0],
            nominal,
            values,
        );
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
fn beside_rate(rates: Vec<f64>, white: f64, values: Vec<f64>) -> Recording {
    let nominal = Nominal { white, ..Nominal::default() };
    let kind = (SensorKind::Fog, Unit::RadianPerSecond);
    let gyro = common::series("gyro", kind, [1.0, 0.0, 0.0], nominal, values);
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

/// A unit that is shaken by the faster ones of the turns of a table: four times the noise there.
fn shaken(seed: u64, stated: f64) -> Recording {
    let mut random = Pcg64::seed_from_u64(seed);
    let rates: Vec<f64> = (0..ROWS).map(|row| [0.001, -0.008, 0.003, 0.0095, -0.002][row / 30 % 5]).collect();
    let mut reading = |rate: &f64| -> f64 {
        let noise: f64 = StandardNormal.sample(&mut random);
        rate + 3e-5 * if rate.abs() > 0.005 { 4.0 } else { 1.0 } * noise
    };
    let values: Vec<f64> = rates.iter().map(&mut reading).collect();
    beside_rate(rates, stated, values)
}

/// Noise that is louder in turns is one finding, whatever level the case states, and no steps of the level, spikes or slow noise.
#[test]
#[ignore = "another Markov part is told where the level changes often"]
fn a_noise_level_that_goes_with_the_turns_is_told_of_them() {
    let named = |trial: u64| {
        let stated = [3e-5, 1e-4, 2e-5][(trial % 3) as usize];
        let recording = shaken(8700 + trial, stated);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(told, ["noise_variance_step"], "trial {trial}: {:?}", answer.findings);
        let parameters = &answer.findings[0].parameters;
        let parameter = |name: &str| parameters.iter().find(|parameter| parameter.name == name).unwrap();
        let is_near = |name: &str, value: f64, part: f64| {
            let found = parameter(name).value.unwrap();
            assert!((found / value - 1.0).abs() < part, "trial {trial}: {name} {found}");
        };
        assert_eq!(parameter("quantity").text.as_deref(), Some("turn rate"));
        // Between the largest rate of the quiet turns and the least of the others.
        is_near("above", 0.0055, 0.01);
        is_near("ratio", 4.0, 0.15);
        is_near("sigma", 3e-5, 0.1);
    };
    (0..9_u64).into_par_iter().for_each(named);
}

/// What follows the input is louder where the input is large, and is told by its form.
#[test]
fn what_follows_the_turns_is_no_noise_level() {
    let named = |trial: u64| {
        let mut random = Pcg64::seed_from_u64(8750 + trial);
        let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 * wave(row as f64, 240.0)).collect();
        let mut reading = |rate: &f64| -> f64 {
            let noise: f64 = StandardNormal.sample(&mut random);
            rate + 3e-3 * rate.abs() + 3e-5 * noise
        };
        let values: Vec<f64> = rates.iter().map(&mut reading).collect();
        let recording = beside_rate(rates, 3e-5, values);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(told, ["scale_factor_asymmetry"], "trial {trial}");
    };
    (0..6_u64).into_par_iter().for_each(named);
}

/// Readings that are rounded, of a gyro that has more noise than the case says: what holds more noise would be the likelier at the stated level,
/// and a rounded angle holds twice that of rounded readings.
#[test]
fn rounded_readings_with_more_noise_than_stated_are_no_rounded_angle() {
    for (seed, step) in [(1, 0.8), (2, 1.0), (3, 1.5)] {
        let values: Vec<f64> =
            (noise(9600 + seed, ROWS).iter()).map(|value| step * (value / step).round()).collect();
        let nominal = Nominal { white: 0.6, ..Nominal::default() };
        let kind = (SensorKind::Rlg, Unit::RadianPerSecond);
        let gyro = common::series("gyro", kind, [1.0, 0.0, 0.0], nominal, values);
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

/// A dependence counted from a stated reference, beside which the mean is nominal all the same: neither the dependence shows alone nor a
/// constant, and slow noise holds both.
#[test]
fn a_dependence_whose_mean_is_nominal_is_no_slow_noise() {
    let length = ROWS as f64;
    let of =
        |turns: f64, time: f64| (turns * std::f64::consts::TAU * time / length + turns).sin() / turns.sqrt();
    let wander = |time: f64| [7.0, 11.3, 18.1, 29.9].map(|turns| of(turns, time)).iter().sum::<f64>();
    let mean = (0..ROWS).map(|row| wander(row as f64)).sum::<f64>() / length;
    let error = |time: f64| 4.0 * (wander(time) - mean);
    let mut recording = recording(vec![with(noise(8970, ROWS), error)]);
    recording.sensors[0].sensor.nominal.temperature_bias =
        Some(TemperatureBias { column: "t".to_owned(), reference_deg_c: 20.0, coefficients: vec![0.0] });
    let values = (0..ROWS).map(|row| 28.0 + wander(row as f64)).collect();
    record(&mut recording, ("t", Quantity::Temperature, "degC"), values);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    found.sort_unstable();
    // Hysteresis of next to nothing is the same function with an effect less.
    let is_right = found == ["bias_constant", "bias_temperature"] || found == ["bias_thermal_hysteresis"];
    assert!(is_right, "{:?}", answer.findings);
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
            let kind = ([SensorKind::InsVelocity, SensorKind::Doppler][sensor], Unit::MetrePerSecond);
            let nominal = Nominal { white, ..Nominal::default() };
            let values = (0..ROWS).map(&mut reading).collect();
            common::series(["ins", "log"][sensor], kind, [1.0, 0.0, 0.0], nominal, values)
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

/// What is found in a gyro that is turned nearly steadily and has a constant and a warm-up.
fn turned_steadily(seed: u64, constant: f64, warm_up: f64) -> Explanation {
    let white = 3e-6;
    let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 + 1e-4 * (0.05 * row as f64).sin()).collect();
    let mut random = Pcg64::seed_from_u64(seed);
    let mut reading = |(row, rate): (usize, &f64)| {
        let noise: f64 = StandardNormal.sample(&mut random);
        rate + white * noise + constant + warm_up * (-(row as f64) / 150.0).exp()
    };
    let values = rates.iter().enumerate().map(&mut reading).collect();
    let recording = beside_rate(rates.clone(), white, values);
    explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap()
}

/// A constant and a warm-up of a gyro that is turned nearly steadily: the heat of a steady turn from a start that nobody knows is a constant and
/// a decay as well, and says nothing of the turn.
#[test]
fn a_constant_and_a_warm_up_may_be_the_heat_of_a_steady_turn() {
    for trial in 0..4_u64 {
        let answer = turned_steadily(8990 + trial, 6e-7, -3e-6);
        let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        found.sort_unstable();
        let is_right = found == ["bias_constant", "bias_warmup"] || found == ["torquer_self_heating"];
        assert!(is_right, "{trial}: {:?}", answer.findings);
    }
}

/// That needs evidence of its own to lead. Where it looks the same it is said to.
#[test]
fn a_constant_of_a_steady_turn_may_be_its_heat() {
    for trial in 0..4_u64 {
        let answer = turned_steadily(8995 + trial, 6e-7, 0.0);
        let [constant] = &answer.findings[..] else { panic!("{trial}: {:?}", answer.findings) };
        let may_be = constant.may_be("torquer_self_heating");
        assert!(constant.effect == "bias_constant" && may_be, "{trial}: {constant:?}");
    }
}

/// A lag and a scale factor of a gyro on a table that swings at one frequency, of which the amplitude changes: an oscillating error of that
/// frequency shows more than either.
#[test]
fn two_effects_at_the_frequency_of_a_table_are_no_oscillation() {
    let (white, turning) = (3e-5, 0.3);
    let rate = |time: f64| 0.01 * (0.002 * time).cos() * (turning * time).sin();
    for trial in 0..6_u64 {
        let mut random = Pcg64::seed_from_u64(8980 + trial);
        let [scale, delay] = [12e-4, 4e-3].map(|size| if trial.is_multiple_of(2) { size } else { -size });
        let mut reading = |row: usize| {
            let noise: f64 = StandardNormal.sample(&mut random);
            (1.0 + scale) * rate(row as f64 - delay) + white * noise
        };
        let values = (0..ROWS).map(&mut reading).collect();
        let recording = beside_rate((0..ROWS).map(|row| rate(row as f64)).collect(), white, values);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let found = answer.findings;
        let has = |effect: &str| found.iter().any(|finding| finding.may_be(effect));
        assert!(found.len() == 2 && has("scale_factor") && has("time_delay"), "{trial}: {found:?}");
    }
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
            let kind = (SensorKind::Fog, Unit::RadianPerSecond);
            let nominal = Nominal { white: 1e-6, ..Nominal::default() };
            let values = (0..ROWS).map(&mut reading).collect();
            common::series(&format!("gyro_{sensor}"), kind, [1.0, 0.0, 0.0], nominal, values)
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
    let kind = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 5e-7, ..Nominal::default() };
    let gyro = common::series("gyro", kind, [1.0, 0.0, 0.0], nominal, values);
    let mut recording = common::recording(MotionKind::Recorded, vec![gyro]);
    recording.motion.rate = Some([rates, vec![0.0; LONG], vec![0.0; LONG]]);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let found = answer.findings.iter().map(|finding| (finding.effect.as_str(), finding.evidence.gain_nats));
    let found: Vec<(&str, f64)> = found.collect();
    assert!(matches!(found[..], [("output_saturated", gain)] if gain > 40.0), "{found:?}");
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
        let kind = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let sensor = common::series("velocity", kind, [1.0, 0.0, 0.0], nominal, values);
        let recording = common::recording(MotionKind::Static, vec![sensor]);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        found.sort_unstable();
        assert_eq!(found, ["intermittent_jump", "noise_white"], "{stated}: {:?}", answer.findings);
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
        let kind = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let velocity = common::series("v", kind, [1.0, 0.0, 0.0], nominal, values.collect());
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
        let kind = (SensorKind::InsVelocity, Unit::MetrePerSecond);
        let velocity = common::series("v", kind, [1.0, 0.0, 0.0], Nominal::default(), values);
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
        let kind = (SensorKind::Fog, Unit::RadianPerSecond);
        let mut gyro = common::series("g", kind, [1.0, 0.0, 0.0], nominal, values);
        gyro.sensor.relative = true;
        let recording = common::recording(MotionKind::Static, vec![gyro]);
        let model = Model::new(&recording, &[]).unwrap();
        faults(&recording, &model).found.iter().any(|fault| fault.fault == ReadingFault::Quantised)
    };
    assert!(!found(1e-9));
    assert!(found(5e-7));
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
    let kind = (SensorKind::GnssVelocity, Unit::MetrePerSecond);
    let nominal = || Nominal { white: 0.03, ..Nominal::default() };
    let sensors = [("north", [1.0, 0.0, 0.0]), ("east", [0.0, 1.0, 0.0]), ("down", [0.0, 0.0, 1.0])];
    let sensors: Vec<_> = (sensors.into_iter().enumerate())
        .map(|(axis, (id, direction))| common::series(id, kind, direction, nominal(), read(axis)))
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
    let kind = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 1e-6, ..Nominal::default() };
    let gyro = common::series("g", kind, [1.0, 0.0, 0.0], nominal, values);
    let answer = explain(&common::recording(MotionKind::Static, vec![gyro]), &Config::default()).unwrap();
    let found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["bias_step"], "{:?}", answer.findings);
    assert!(answer.notes.iter().any(|note| note.contains("unknown constant")), "{:?}", answer.notes);
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
    let kind = (SensorKind::Fog, Unit::RadianPerSecond);
    let nominal = Nominal { white: 1.0, ..Nominal::default() };
    let gyro = common::series("gyro", kind, [1.0, 0.0, 0.0], nominal, values);
    let mut recording = common::recording(MotionKind::Static, vec![gyro]);
    recording.sensors[0].sensor.relative = true;
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let told: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(told, ["intermittent_jump"], "{:?}", answer.findings);
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

#[test]
fn what_was_held_out_is_predicted_better() {
    let length = ROWS as f64;
    let values = with(noise(41, ROWS), |time| 3.0 * wave(time, length));
    let answer = answer(vec![values], true).unwrap();
    let fit = &answer.fit.held_out;
    assert!(fit.after.nll_per_sample < fit.before.nll_per_sample, "{fit:?}");
    assert!((fit.after.nis_mean - 1.0).abs() < 0.2, "{fit:?}");
    assert_eq!(answer.verdict, Verdict::Explained);
    // What was held out is said, and no row of it was trained on.
    let rows = |intervals: &[[f64; 2]]| intervals.iter().map(|[from, to]| to - from + 1.0).sum::<f64>();
    assert!((rows(&fit.intervals_s) - fit.samples as f64).abs() < 0.5, "{fit:?}");
    let train = &answer.fit.train;
    assert!((rows(&train.intervals_s) - train.samples as f64).abs() < 0.5, "{train:?}");
    assert!(fit.samples + train.samples <= ROWS && fit.samples > ROWS / 5);
    let apart = |a: &[f64; 2], b: &[f64; 2]| a[1] < b[0] || b[1] < a[0];
    assert!(fit.intervals_s.iter().all(|held| train.intervals_s.iter().all(|train| apart(held, train))));
    let written = serde_json::to_value(&answer).unwrap();
    assert!(written["fit"]["held_out"]["samples"].as_u64().is_some_and(|samples| samples > 0));
    assert_eq!(written["fit"]["held_out"]["intervals_s"][0].as_array().map(Vec::len), Some(2));
    // Over the whole record, to the end of its last step.
    assert_eq!(answer.findings[0].interval_s, [0.0, ROWS as f64]);
}

#[test]
fn the_odds_of_a_finding_are_what_is_lost_without_it_less_what_it_costs() {
    let length = ROWS as f64;
    let values =
        with(noise(47, ROWS), |time| 2.0 * wave(time, length) + if time >= 1200.0 { 4.0 } else { 0.0 });
    let answer = answer(vec![values], false).unwrap();
    assert!(answer.findings.len() >= 2, "{:?}", answer.findings);
    let gains: Vec<f64> = answer.findings.iter().map(|finding| finding.evidence.gain_nats).collect();
    assert!(gains.windows(2).all(|pair| pair[0] >= pair[1]), "{gains:?}");
    // The parabola of one amplitude: half the square of its value over its deviation, less what the amplitude costs, ln of its range over
    // its deviation, and the prior odds of one effect among those that are sought.
    let finding = answer.findings.iter().find(|finding| finding.effect == "wave").expect("it is large");
    let parameter = &finding.parameters[0];
    let ratio = parameter.value.unwrap() / parameter.sigma.unwrap();
    let cost = 0.5 * ratio * ratio - finding.evidence.gain_nats;
    assert!((3.0..9.0).contains(&cost), "{cost} {finding:?}");
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

#[test]
fn gaps_do_no_harm() {
    let length = ROWS as f64;
    let mut values = with(noise(43, ROWS), |time| 2.0 * wave(time, length));
    values[300..420].fill(f64::NAN);
    (0..ROWS).step_by(37).for_each(|row| values[row] = f64::NAN);
    let answer = answer(vec![values], true).unwrap();
    assert!(answer.findings.first().is_some_and(|first| first.may_be("wave")));
}

#[test]
fn bad_input_is_named() {
    assert!(matches!(answer(vec![vec![0.0; 10]], false), Err(Error::TooShort { rows: 10, .. })));
    assert!(matches!(answer(vec![vec![f64::NAN; 500]], false), Err(Error::NothingToCompare(_))));
    let recording = recording(vec![noise(1, 500)]);
    let inputs = Inputs::new(&recording);
    let options = Config { told_at: 2.0, ..Config::default() };
    assert!(matches!(
        explain_with(&inputs, Vec::new(), &options),
        Err(Error::Config { name: "probability", .. })
    ));
    // One dead sensor beside a good one is a note, not the end.
    let answer = answer(vec![noise(3, ROWS), vec![f64::NAN; ROWS]], false).unwrap();
    assert!(answer.notes.iter().any(|note| note.contains("sensor_1")), "{:?}", answer.notes);
    assert!(answer.findings.is_empty());
}

#[test]
fn noise_that_nobody_knows_is_estimated_and_said() {
    let mut recording = recording(vec![noise(9, ROWS)]);
    recording.sensors[0].sensor.nominal = Nominal::default();
    let inputs = Inputs::new(&recording);
    let options = Config { hold_out: false, ..Config::default() };
    let answer = explain_with(&inputs, candidates(ROWS, 1), &options).unwrap();
    assert!(answer.findings.is_empty(), "{:?}", answer.findings);
    assert!(answer.notes.iter().any(|note| note.contains("estimated")));
}

/// A dependence on a wave whose reference is free holds the constant as a part, and is the name only where the wave shows.
#[test]
fn a_constant_is_not_called_what_holds_it_as_a_part() {
    let rows = 2000;
    let waved: Vec<f64> = (0..rows).map(|row| wave(row as f64, rows as f64)).collect();
    let ones = vec![1.0; rows];
    // The coefficient of the wave in its standard deviations, if it is the name.
    let found = |seed: u64, of_wave: f64| {
        let values = with(noise(seed, rows), |time| 2.0 + of_wave * wave(time, rows as f64));
        let recording = recording(vec![values]);
        let inputs = Inputs::new(&recording);
        let columns = [&waved, &ones].map(|values| Column::on(0, values.clone()));
        let mut warm = candidate(&WARM, 0, Search::Linear(Signature { columns: columns.to_vec() }));
        warm.amplitudes.push(Amplitude { name: "at_mean".to_owned(), ..amplitude() });
        let constant = candidate(&CONSTANT, 0, Search::Linear(signature(0, ones.clone())));
        let options = Config { hold_out: false, ..Config::default() };
        let explanation = explain_with(&inputs, vec![constant, warm], &options).expect("it can be explained");
        let whole = explanation.findings.into_iter().find(|finding| finding.effect == "warm")?;
        let coefficient = whole.parameters.into_iter().find(|parameter| parameter.name == "coefficient")?;
        Some(coefficient.value? / coefficient.sigma?)
    };
    let mut named = 0;
    for (seed, step) in (0..3).flat_map(|seed| (-20..=20).map(move |step| (seed, step))) {
        if let Some(deviations) = found(seed, 0.05 * f64::from(step)) {
            // A second amplitude beside one that is large costs 2.8 nats.
            assert!(deviations.abs() > 2.0, "seed {seed}, {step}: {deviations}");
            named += 1;
        }
    }
    assert!((10..100).contains(&named), "{named} of 123");
}

/// A constant and a drift that a slow decay imitates: what takes one term at a time takes the decay, beside which neither shows.
#[test]
fn two_effects_that_a_third_imitates_are_told_as_two() {
    const TRIALS: u64 = 24;
    let length = ROWS as f64;
    let decay = |tau: f64| (0..ROWS).map(|row| (-(row as f64) / tau).exp()).collect::<Vec<f64>>();
    let named = |hide: &(dyn Fn(f64) -> f64 + Sync), expected: &[&str]| {
        let right = |&seed: &u64| {
            let recording = recording(vec![with(noise(51_000 + seed, ROWS), hide)]);
            let search = Search::Grid {
                parameters: vec![Nonlinear {
                    name: "tau_s",
                    unit: "s",
                    grid: vec![50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0],
                }],
                signature: Box::new(move |point| signature(0, decay(point[0]))),
                unit_amplitude: false,
            };
            let mut all = candidates(ROWS, 1);
            all.push(candidate(&CONSTANT, 0, Search::Linear(signature(0, vec![1.0; ROWS]))));
            all.push(candidate(&WARM, 0, search));
            let inputs = Inputs::new(&recording);
            let options = Config { hold_out: false, ..Config::default() };
            let answer = explain_with(&inputs, all, &options).unwrap();
            let may_be = |effect: &&str| answer.findings.iter().any(|finding| finding.may_be(effect));
            // One that may be the two together is right as well: it is as good with an effect less.
            let right = answer.findings.len() <= expected.len() && expected.iter().all(may_be);
            if !right {
                println!(
                    "{expected:?} {seed}: {:?}",
                    answer.findings.iter().map(|it| &it.class).collect::<Vec<_>>()
                );
            }
            right
        };
        (0..TRIALS).into_par_iter().filter(right).count()
    };
    let allowed = most(TRIALS as usize, 0.05);
    for (scale, crossing) in [(6.0, 0.6), (8.0, 0.8), (12.0, 1.0)] {
        let right = named(&|time| scale * (time / length - crossing), &["constant", "trend"]);
        assert!(TRIALS as usize - right <= allowed, "two of {scale}, {crossing}: {right}");
        // And the decay itself is no pair.
        let right = named(&|time| scale * (-time / 700.0).exp(), &["warm"]);
        assert!(TRIALS as usize - right <= allowed, "one of {scale}: {right}");
    }
}
