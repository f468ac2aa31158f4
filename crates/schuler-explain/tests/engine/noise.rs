//! Noise that is not the nominal one: its parts and its level.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::catalogue::{NoiseChange, Search};
use schuler_explain::config::Config;
use schuler_explain::explain::{explain, explain_with};
use schuler_explain::explanation::Verdict;
use schuler_explain::inputs::Inputs;
use schuler_recording::Recording;
use schuler_recording::case::Nominal;

use crate::detection::assert_named;
use crate::limits::beside_rate;
use crate::synthetic::{
    FLICKER, MARKOV_SIGMA, ROWS, TAU_S, WHITE_SIGMA, answer, candidate, candidates, markov, most, noise,
    recording, wave,
};

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

#[test]
fn noise_that_nobody_knows_is_estimated_and_said() {
    let mut recording = recording(vec![noise(9, ROWS)]);
    recording.sensors[0].sensor.nominal = Nominal::default();
    let inputs = Inputs::new(&recording);
    let options = Config { hold_out: false, ..Config::default() };
    let answer = explain_with(&inputs, candidates(ROWS, 1), &options).unwrap();
    assert!(answer.findings.is_empty(), "{:?}", answer.findings);
    // What was fitted in the place of what nobody states is told whole: white of 0.5 and a Markov part, here.
    let note = answer.notes.iter().find(|note| note.contains("estimated from the record: white 0.")).unwrap();
    assert!(note.contains("markov sigma") && note.contains("markov tau") && note.contains(" ± "), "{note}");
}
