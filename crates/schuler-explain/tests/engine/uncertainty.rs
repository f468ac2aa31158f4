//! Standard deviations of what is fitted.
use rayon::prelude::*;
use schuler_explain::catalogue::{OnsetShape, Search};
use schuler_explain::config::Config;
use schuler_explain::explain::explain_with;
use schuler_explain::inputs::Inputs;

use crate::synthetic::{RAMP, ROWS, answer, candidate, most, noise, recording, signature, wave, with};

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
