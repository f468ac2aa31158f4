//! `schuler explain` from the outside: what it prints, what it writes, what it says of bad input.
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;

const CASE: &str = r#"
format = "schuler-case/1"
title = "one gyro at rest"
[recording]
path = "recording.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 55.0
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 30.0 }
[[sensor]]
id = "gyro_x"
kind = "dtg"
column = "gyro_x"
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
relative = true
  [sensor.nominal]
  white = 0.05
  markov = { sigma = 0.05, tau_s = 200.0 }
[[aux]]
column = "temp_x"
quantity = "temperature"
unit = "degC"
near = "gyro_x"
"#;

/// A gyro that drifts by `coefficient` °/h per K/h.
fn recorded(directory: &Path, rows: usize, coefficient: f64) -> PathBuf {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
    let transition = f64::exp(-1.0 / 200.0);
    let mut markov = 0.05 * draw();
    let mut table = String::from("t,gyro_x,temp_x\n");
    for k in 0..rows {
        let phase = TAU * k as f64 / 5000.0;
        let rate = 4.0 * TAU / 5000.0 * 3600.0 * phase.cos();
        let reading = 10.0 + markov + 0.05 * draw() + coefficient * rate;
        writeln!(table, "{k},{reading:.5},{:.3}", 30.0 + 4.0 * phase.sin()).unwrap();
        markov = transition * markov + 0.05 * (1.0 - transition * transition).sqrt() * draw();
    }
    std::fs::write(directory.join("recording.csv"), table).unwrap();
    let case = directory.join("case.toml");
    std::fs::write(&case, CASE).unwrap();
    case
}

fn explain(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).arg("explain").args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_drift_with_the_rate_of_temperature_is_said_shown_and_written() {
    let directory = tempfile::tempdir().unwrap();
    let case = recorded(directory.path(), 10_000, 0.02);
    let (out, page) = (directory.path().join("out"), directory.path().join("page.html"));
    let (out, page) = (out.to_str().unwrap(), page.to_str().unwrap());
    let case = case.to_str().unwrap();
    let said = explain(&[case, "--out", out, "--plot", "svg,png", "--report", page]);
    assert!(said.status.success(), "{}", text(&said.stderr));
    let words = text(&said.stdout);
    assert!(words.contains("1. gyro_x drifts with the rate of its temperature: 0.0"), "{words}");
    assert!(words.contains("°/h per K/h"), "{words}");
    assert!(words.contains("Left out: bias_temperature_rate, k·Ṫ."), "{words}");
    let flat = words.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(flat.contains("expects, and the likelihood gains 0.0"), "{words}");

    let html = std::fs::read_to_string(page).unwrap();
    assert!(html.contains("against Ṫ") && html.contains("Residual over time"));
    let files = [
        "explanation.json",
        "gyro_x_explained.svg",
        "gyro_x_whiteness.png",
        "gyro_x_1_bias_temperature_rate.svg",
    ];
    for name in files {
        assert!(Path::new(out).join(name).exists(), "{name}");
    }

    let json: Value = serde_json::from_slice(&explain(&[case, "--json"]).stdout).unwrap();
    assert_eq!(json["format"], "schuler-explanation/2");
    let parameters = json["findings"][0]["parameters"].as_array().unwrap();
    let coefficient = parameters.iter().find(|it| it["name"] == "coefficient").unwrap();
    let (value, sigma) = (coefficient["value"].as_f64().unwrap(), coefficient["sigma"].as_f64().unwrap());
    assert!((value - 0.02).abs() < 4.0 * sigma, "{value} ± {sigma}");

    // How much of the mismatch that is, what it does, which noise was taken, and what could still be there.
    let [share, all] =
        [&json["findings"][0]["share"], &json["explained_share"]].map(|it| it.as_f64().unwrap());
    assert!((0.0..=1.0).contains(&share) && share <= all + 1e-9 && all <= 1.0, "{share} of {all}");
    assert!(json["noise"].as_array().is_some_and(|it| !it.is_empty()));
    let certificate = json["certificate"].as_array().unwrap();
    let (known, unknown): (Vec<&Value>, Vec<&Value>) =
        certificate.iter().partition(|it| it["bound"].is_f64());
    assert!(!known.is_empty() && known.iter().all(|it| it["adds_rms"].as_f64().is_some_and(|rms| rms > 0.0)));
    assert!(!unknown.is_empty() && unknown.iter().all(|it| it["because"].is_string()));
    let listed = text(&explain(&[case, "--certificate"]).stdout);
    assert!(listed.contains("the largest effects that would not have been found"), "{listed}");
}

#[test]
fn nothing_concealed_is_nothing_found_and_still_a_success() {
    let directory = tempfile::tempdir().unwrap();
    let case = recorded(directory.path(), 5000, 0.0);
    let page = directory.path().join("page.html");
    let said = explain(&[case.to_str().unwrap(), "--report", page.to_str().unwrap()]);
    assert_eq!(said.status.code(), Some(0));
    assert!(text(&said.stdout).contains("Nothing was found"), "{}", text(&said.stdout));
    assert!(std::fs::read_to_string(page).unwrap().contains("No mismatch"));
}

/// An effect that grows is found from a low probability on before it is from a high one, with the probability that it says.
#[test]
fn findings_are_told_from_the_probability_on_that_is_asked_for() {
    let directory = tempfile::tempdir().unwrap();
    let absent = |coefficient: f64, least: &str| -> Option<f64> {
        let case = recorded(directory.path(), 10_000, coefficient);
        let said = explain(&[case.to_str().unwrap(), "--json", "--probability", least]);
        let json: Value = serde_json::from_slice(&said.stdout).unwrap();
        json["findings"].as_array().unwrap().first()?["evidence"]["p_value"].as_f64()
    };
    let weak = (0..12)
        .map(|k| 0.002 * 1.1_f64.powi(k))
        .find_map(|coefficient| Some((coefficient, absent(coefficient, "0.2")?)));
    let (coefficient, p) = weak.expect("it grows");
    assert!((0.05..=0.8).contains(&p), "{p}");
    assert_eq!(absent(coefficient, "0.95"), None);
    let case = recorded(directory.path(), 10_000, coefficient);
    let failed = explain(&[case.to_str().unwrap(), "--probability", "1"]);
    assert_eq!(failed.status.code(), Some(2));
    assert!(
        text(&failed.stderr).contains("probability: found 1; expected a probability"),
        "{}",
        text(&failed.stderr)
    );
}

/// Both noises of the demonstration's loop are wrong by ten on its data sheet, which an oscillating noise of the gyro alone
/// nearly makes good.
#[test]
fn two_noises_that_are_wrong_are_not_taken_for_one_of_another_kind() {
    let directory = tempfile::tempdir().unwrap();
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/demo.toml");
    let simulated = Command::new(env!("CARGO_BIN_EXE_schuler"))
        .arg("simulate")
        .arg(scenario)
        .arg("--out")
        .arg(directory.path())
        .output()
        .unwrap();
    assert!(simulated.status.success(), "{}", text(&simulated.stderr));
    let case = directory.path().join("case.toml");
    let json: Value = serde_json::from_slice(&explain(&[case.to_str().unwrap(), "--json"]).stdout).unwrap();
    let findings = json["findings"].as_array().unwrap();
    let mut named: Vec<String> =
        findings.iter().map(|it| format!("{} {}", it["sensor"], it["effect"]).replace('"', "")).collect();
    named.sort();
    assert_eq!(named, ["accelerometer noise_markov", "gyro noise_markov"]);
    let truth =
        [("accelerometer", [100e-6 * 9.80665, 60.0]), ("gyro", [(0.1_f64 / 3600.0).to_radians(), 1800.0])];
    for (sensor, expected) in truth {
        let finding = findings.iter().find(|it| it["sensor"] == sensor).unwrap();
        for (parameter, expected) in finding["parameters"].as_array().unwrap().iter().zip(expected) {
            let (value, sigma) = (parameter["value"].as_f64().unwrap(), parameter["sigma"].as_f64().unwrap());
            assert!((value - expected).abs() < 4.0 * sigma, "{sensor} {parameter}");
        }
    }
}

#[test]
fn bad_input_is_one_line_that_says_what_and_where() {
    let directory = tempfile::tempdir().unwrap();
    let case = recorded(directory.path(), 20, 0.0);
    for (path, expected) in [
        ("/no/such/case.toml", "/no/such/case.toml: cannot read the case"),
        (case.to_str().unwrap(), "case.toml: the recording has 20 rows; expected at least 50"),
    ] {
        let failed = explain(&[path]);
        assert_eq!(failed.status.code(), Some(2), "{}", text(&failed.stderr));
        let line = text(&failed.stderr);
        assert!(line.lines().count() == 1 && line.contains(expected), "{line}");
    }
    let failed = explain(&[case.to_str().unwrap(), "--plot", "svg"]);
    assert_eq!(failed.status.code(), Some(2));
}

/// The model that is asked for is written in every form, with its inputs beside it; another ending is refused before any work.
#[test]
fn what_was_found_leaves_as_a_model() {
    let directory = tempfile::tempdir().unwrap();
    let case = recorded(directory.path(), 5000, 0.02);
    let case = case.to_str().unwrap();
    let files: Vec<String> = ["json", "py", "c", "rs"]
        .iter()
        .map(|ending| directory.path().join(format!("model.{ending}")).to_str().unwrap().to_owned())
        .collect();
    let arguments = files.iter().flat_map(|file| ["--export", file.as_str()]);
    let said = explain(&std::iter::once(case).chain(arguments).collect::<Vec<_>>());
    assert!(said.status.success(), "{}", text(&said.stderr));
    let words = text(&said.stdout);
    assert!(files.iter().all(|file| words.contains(file.as_str())), "{words}");
    let model: Value = serde_json::from_str(&std::fs::read_to_string(&files[0]).unwrap()).unwrap();
    assert_eq!(model["format"], "schuler-model/1");
    let term = &model["terms"][0];
    assert_eq!(
        (term["output"].as_str(), term["effect"].as_str()),
        (Some("gyro_x"), Some("bias_temperature_rate"))
    );
    // 0.02 °/h per K/h, in rad/s per K/s.
    let expected = 0.02 * (1.0_f64 / 3600.0).to_radians() * 3600.0;
    let amplitude = term["amplitude"].as_f64().unwrap();
    assert!((amplitude / expected - 1.0).abs() < 0.1, "{amplitude} {expected}");
    let inputs = std::fs::read_to_string(directory.path().join("model_inputs.csv")).unwrap();
    assert_eq!((inputs.lines().next(), inputs.lines().count()), (Some("time_s,rate_of_temp_x"), 5001));

    let refused = explain(&[case, "--export", "model.txt"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("expected .json, .py, .c or .rs"), "{}", text(&refused.stderr));
}
