//! Effects in coloured noise are found and named, and nothing is found where nothing is hidden.
use rayon::prelude::*;
use schuler_explain::catalogue::{Nonlinear, Search};
use schuler_explain::config::Config;
use schuler_explain::explain::explain_with;
use schuler_explain::explanation::Verdict;
use schuler_explain::inputs::Inputs;

use crate::synthetic::{
    DELAY, ROWS, WAVE, WAVE_RATE, amplitude, answer, candidate, candidates, low_pass, most, noise, recording,
    signature, wave, with,
};

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

/// Share of `trials` in which the effect is in the class of the first finding on the first sensor, and nothing else is
/// found.
pub fn named(effect: &str, trials: u64, hide: impl Fn(u64, Vec<f64>) -> Vec<f64> + Sync) -> (usize, usize) {
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

pub fn assert_named(effect: &str, hide: impl Fn(u64, Vec<f64>) -> Vec<f64> + Sync) {
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

/// Two steps within one stretch that is held out are one column on what is fitted: the priors decide, and not rounding.
#[test]
fn the_score_of_what_was_held_out_is_not_of_rounding() {
    let score = |of_one: f64| {
        let step = |time: f64, onset: f64| if time >= onset { 4.0 } else { 0.0 };
        let mut values = with(noise(61, ROWS), |time| step(time, 1450.0) + step(time, 1550.0));
        for (row, value) in values.iter_mut().enumerate() {
            *value *= 1.0 + if row % 3 == 0 { of_one } else { -of_one };
        }
        let fit = answer(vec![values], true).unwrap().fit.held_out;
        fit.after.nll_per_sample
    };
    let scores = [0.0, 1e-12, -1e-12, 1e-11].map(score);
    assert!(scores.iter().all(|score| (score - scores[0]).abs() < 1e-3 && score.abs() < 3.0), "{scores:?}");
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
