//! Gaps, and input that cannot be explained.
use schuler_explain::config::Config;
use schuler_explain::explain::{Error, explain_with};
use schuler_explain::inputs::Inputs;

use crate::synthetic::{ROWS, answer, noise, recording, wave, with};

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
