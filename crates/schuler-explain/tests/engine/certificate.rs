//! Effects as large as the certificate allows to hide are found, and much smaller ones are not.
//!
//! `SCHULER_RECORD=DIRECTORY cargo test -p schuler-explain --test engine as_many_are_found -- --ignored` writes the counts of 300
//! effects there, with date, commit and machine.
use std::fmt::Write;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain_with;
use schuler_explain::explanation::Explanation;
use schuler_explain::inputs::Inputs;

use crate::synthetic::{ROWS, answer, candidates, low_pass, noise, recording, wave, wave_rate};

const KINDS: [&str; 6] = ["trend", "wave", "wave_rate", "lagged", "step", "line"];
/// Size of what is not expected to be found, in bounds.
const SMALL: f64 = 1.0 / 3.0;

fn explained(values: Vec<f64>, certify: bool) -> Explanation {
    let recording = recording(vec![values]);
    let inputs = Inputs::new(&recording);
    let config = Config { hold_out: false, certify, ..Config::default() };
    explain_with(&inputs, candidates(recording.len(), 1), &config).unwrap()
}

/// What an effect of amplitude 1 adds where its other parameter is `at`; of a line with that phase.
fn signature(kind: &str, at: f64, phase: f64) -> Vec<f64> {
    let length = ROWS as f64;
    let of = |shape: &dyn Fn(f64) -> f64| (0..ROWS).map(|row| shape(row as f64)).collect::<Vec<f64>>();
    match kind {
        "trend" => of(&|time| time / length),
        "wave" => of(&|time| wave(time, length)),
        "wave_rate" => of(&|time| wave_rate(time, length)),
        "lagged" => low_pass(&of(&|time| wave(time, length)), at),
        "step" => of(&|time| f64::from(u8::from(time >= at))),
        "line" => of(&|time| (std::f64::consts::TAU * at * time + phase).cos()),
        other => panic!("expected one of {KINDS:?}, found {other}"),
    }
}

/// How many of the effects of a kind with so many bounds are found, by their bounds in other records of the same noise.
fn found(kind: &str, cases: u64, first_seed: u64, size: f64) -> usize {
    let is_found = |case: &u64| {
        let seed = first_seed + 2 * case;
        let certified = explained(noise(seed, ROWS), true);
        let bound = certified.certificate.iter().find(|it| it.effect == kind).expect("it is sought");
        let at = bound.at.first().map_or(0.0, |it| it.value);
        let phase = Pcg64::seed_from_u64(seed).random_range(0.0..std::f64::consts::TAU);
        let amplitude = size * bound.bound.expect("it can be told");
        let added = signature(kind, at, phase);
        let values =
            noise(seed + 1, ROWS).into_iter().zip(&added).map(|(noise, more)| noise + amplitude * more);
        let told = explained(values.collect(), false);
        told.findings.iter().any(|finding| finding.may_be(kind))
    };
    (0..cases).into_par_iter().filter(is_found).count()
}

#[test]
fn an_effect_as_large_as_its_bound_is_found_and_a_third_of_it_is_not() {
    const CASES: u64 = 7;
    let of_size = |size: f64| -> usize { KINDS.map(|kind| found(kind, CASES, 61_000, size)).iter().sum() };
    let (at_bound, small, all) = (of_size(1.0), of_size(SMALL), CASES as usize * KINDS.len());
    println!("{at_bound} at the bound and {small} at a third of it, of {all}");
    assert!(at_bound >= all - 2, "{at_bound} of {all}");
    assert!(small <= all / 4, "{small} of {all}");
}

#[test]
#[ignore = "minutes: the counts of a record"]
fn as_many_are_found_as_the_certificate_says() {
    const CASES: u64 = 50;
    const SEED: u64 = 62_000;
    let counts = KINDS.map(|kind| (kind, found(kind, CASES, SEED, 1.0), found(kind, CASES, SEED, SMALL)));
    let mut text = format!(
        "seed = {SEED}\nrows = {ROWS}\nfound_at = {}\ncases_of_each = {CASES}\n",
        Config::default().found_at
    );
    for (kind, at_bound, small) in counts {
        write!(text, "\n[{kind}]\nfound_at_bound = {at_bound}\nfound_at_a_third = {small}\n").unwrap();
    }
    println!("{text}");
    if let Some(directory) = std::env::var_os("SCHULER_RECORD") {
        let date = told_by("date", &["-u", "+%Y-%m-%d"]);
        let head = format!(
            "# Effects as large as their bounds, and a third of that: test `engine`, `certificate`, of schuler-explain.\n\
             date = {date}\ncommit = \"{}\"\nmachine = \"{}\"\n",
            told_by("git", &["rev-parse", "--short=12", "HEAD"]),
            told_by("uname", &["-srm"]),
        );
        let path = std::path::Path::new(&directory).join(format!("{date}-certificate.toml"));
        std::fs::write(path, head + &text).unwrap();
    }
    let all = CASES as usize * KINDS.len();
    let sum = |of: fn(&(&str, usize, usize)) -> usize| counts.iter().map(of).sum::<usize>();
    let (at_bound, small) = (sum(|it| it.1), sum(|it| it.2));
    assert!(100 * at_bound >= 97 * all, "{at_bound} of {all}");
    assert!(5 * small <= all, "{small} of {all}");
}

fn told_by(program: &str, arguments: &[&str]) -> String {
    let output = std::process::Command::new(program).args(arguments).output();
    output.map(|it| String::from_utf8_lossy(&it.stdout).trim().to_owned()).unwrap_or_default()
}

#[test]
fn what_is_found_or_alike_has_no_bound() {
    let length = ROWS as f64;
    let values: Vec<f64> = noise(63_000, ROWS)
        .iter()
        .enumerate()
        .map(|(row, noise)| noise + 2.0 * wave(row as f64, length))
        .collect();
    let told = answer(vec![values], false).unwrap();
    assert_eq!(told.findings.first().map(|it| it.effect.as_str()), Some("wave"));
    assert!(told.certificate.iter().all(|bound| bound.effect != "wave"), "its value is told");
    let trend = told.certificate.iter().find(|bound| bound.effect == "trend").expect("it is sought");
    let expected = trend.adds_rms.expect("it can be told") * 3.0_f64.sqrt();
    // The root of the mean square of a trend that ends at 1 is 1/√3.
    assert!((trend.bound.expect("it can be told") / expected - 1.0).abs() < 1e-3, "{trend:?}");
    assert!(told.certificate.iter().all(|bound| bound.bound.is_some() != bound.because.is_some()));
}
