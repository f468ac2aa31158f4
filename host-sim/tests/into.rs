//! What is found goes back into a scenario: a fresh simulation shows it, and mistakes in a block are named.
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// What the simulation believes: a gyro and an accelerometer at rest, at changing temperature and supply.
const NOMINAL: &str = r#"
format = "schuler-scenario/1"
title = "Bench"
seed = 4
supply_V = { value = [27.0], amplitude = 0.5, period_s = 1700.0 }
[time]
duration_s = 12000.0
[site]
latitude_deg = 55.57
[motion]
kind = "static"
[thermal]
ambient_degC = { value = [25.0], amplitude = 8.0, period_s = 5000.0 }
[case]
voltage = true
[[thermometer]]
column = "temp"
near = "gyro_x"
white = 0.002
[[gyro]]
id = "gyro_x"
unit = "deg/h"
relative = true
  [gyro.noise]
  white = 0.01
  [gyro.nominal]
  white = 0.01
[[accelerometer]]
id = "ax"
unit = "ug"
relative = true
  [accelerometer.noise]
  white = 5.0
  [accelerometer.nominal]
  white = 5.0
"#;

/// What is true: the rotor follows the housing late and is pulled as it is warm, the supply reaches the accelerometer, whose output jumps.
fn truth() -> String {
    NOMINAL
        .replace("  [gyro.noise]", "  [gyro.rotor]\n  lag_s = 500.0\n  [gyro.torque]\n  reaction_Nm_per_K = [0.0, 5e-9]\n  [gyro.noise]")
        .replace("  [accelerometer.noise]", "  [accelerometer.electronics]\n  offset_per_V = 20.0\n  [accelerometer.noise]")
        + "[[fault]]\nsensor = \"ax\"\nkind = \"step\"\nsize = 8.0\nonset_s = 7000.0\n"
}

fn schuler(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn succeeds(arguments: &[&str]) -> String {
    let output = schuler(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Sensor, effect, and every number with its standard deviation.
type Found = Vec<(String, String, Vec<(String, f64, f64)>)>;

fn found(answer: &str) -> Found {
    let json: Value = serde_json::from_str(answer).unwrap();
    let word = |it: &Value, key: &str| it[key].as_str().unwrap_or_default().to_owned();
    let number = |it: &Value| Some((word(it, "name"), it["value"].as_f64()?, it["sigma"].as_f64()?));
    let finding = |it: &Value| {
        let numbers = it["parameters"].as_array().unwrap().iter().filter_map(number).collect();
        (word(it, "sensor"), word(it, "effect"), numbers)
    };
    let mut all: Found = json["findings"].as_array().unwrap().iter().map(finding).collect();
    all.sort_by(|a, b| (&a.0, &a.1).cmp(&(&b.0, &b.1)));
    all
}

fn name(folder: &Path, file: &str) -> String {
    folder.join(file).to_str().unwrap().to_owned()
}

#[test]
fn a_fresh_simulation_with_what_was_found_shows_it() {
    let directory = tempfile::tempdir().unwrap();
    let at = |file: &str| name(directory.path(), file);
    std::fs::write(at("truth.toml"), truth()).unwrap();
    std::fs::write(at("nominal.toml"), NOMINAL).unwrap();
    succeeds(&["simulate", &at("truth.toml"), "--out", &at("true")]);
    let answer = succeeds(&[
        "explain",
        &at("true/case.toml"),
        "--into",
        &at("nominal.toml"),
        "--out",
        &at("put"),
        "--json",
    ]);
    let scenario = std::fs::read_to_string(at("put/scenario.toml")).unwrap();
    println!("{}", &scenario[NOMINAL.len()..]);
    assert!(scenario.starts_with(NOMINAL));
    assert!(!answer.contains("not_in_the_scenario"), "{answer}");
    // One that a part makes, and one by its fitted term.
    assert!(scenario.contains("effect = \"bias_step\"\ncoefficient"), "{scenario}");
    assert!(scenario.contains("effect = \"bias_thermal_lag\"\namplitude"), "{scenario}");
    succeeds(&["simulate", &at("put/scenario.toml"), "--seed", "77", "--out", &at("again")]);
    let again = found(&succeeds(&["explain", &at("again/case.toml"), "--json"]));
    let first = found(&answer);
    let names = |all: &Found| all.iter().map(|it| format!("{} {}", it.0, it.1)).collect::<Vec<_>>();
    assert_eq!(names(&first), ["ax bias_step", "ax bias_supply_voltage", "gyro_x bias_thermal_lag"]);
    assert_eq!(names(&again), names(&first));
    for ((sensor, effect, first), (_, _, again)) in first.iter().zip(&again) {
        for (name, value, sigma) in first.iter().filter(|(name, ..)| name != "at_mean") {
            let (_, other, of_other) = again.iter().find(|it| it.0 == *name).unwrap();
            let apart = (value - other).abs() / sigma.hypot(*of_other);
            assert!(apart < 4.0, "{sensor} {effect} {name}: {value} ± {sigma}, then {other} ± {of_other}");
        }
    }
    // Without the blocks there is nothing.
    succeeds(&["simulate", &at("nominal.toml"), "--out", &at("nothing")]);
    assert!(found(&succeeds(&["explain", &at("nothing/case.toml"), "--json"])).is_empty());
}

#[test]
fn mistakes_in_a_block_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = name(directory.path(), "scenario.toml");
    let line = NOMINAL.lines().count();
    let said = |block: &str| {
        std::fs::write(&path, format!("{NOMINAL}[[disturbance]]\n{block}")).unwrap();
        let output = schuler(&["simulate", &path, "--out", &name(directory.path(), "out")]);
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let unknown = said("sensor = \"ax\"\neffect = \"bias_stepp\"\n");
    assert!(unknown.contains(&format!("scenario.toml:{}: disturbance[0].effect", line + 3)), "{unknown}");
    assert!(unknown.contains("did you mean \"bias_step\"?"), "{unknown}");
    let key =
        said("sensor = \"ax\"\neffect = \"bias_step\"\ncoefficient = 1.0\nonset_s = 5.0\ntau_s = 3.0\n");
    assert!(key.contains(&format!("scenario.toml:{}: disturbance[0].tau_s: unknown key", line + 6)), "{key}");
    let sensor = said("sensor = \"ay\"\neffect = \"bias_constant\"\ncoefficient = 1.0\n");
    assert!(sensor.contains("disturbance[0].sensor: found \"ay\"; expected one of gyro_x, ax"), "{sensor}");
    let missing = said("sensor = \"ax\"\neffect = \"g2_cross\"\n");
    assert!(missing.contains("disturbance[0].signal: missing"), "{missing}");
    let signal = "{\"sum\":[{\"coefficient\":1.0,\"factors\":[{\"of\":[{\"input\":\"rate_q\",\"weight\":1.0}],\"reference\":0.0,\"function\":{\"kind\":\"magnitude\"}}]}]}";
    let input =
        said(&format!("sensor = \"ax\"\neffect = \"g2_cross\"\namplitude = 1.0\nsignal = '{signal}'\n"));
    assert!(
        input.contains("disturbance[0].signal: found the input rate_q; expected one of time_s, rate_x"),
        "{input}"
    );
}
