//! What is found goes back into a scenario: a fresh simulation shows it, and mistakes in a block are named.
use std::f64::consts::TAU;
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

/// What is true of the accelerometer: the supply reaches its electronics, and its output jumps.
fn truth() -> String {
    let reached = "  [accelerometer.electronics]\n  offset_per_V = 20.0\n  [accelerometer.noise]";
    NOMINAL.replace("  [accelerometer.noise]", reached)
        + "[[fault]]\nsensor = \"ax\"\nkind = \"step\"\nsize = 8.0\nonset_s = 7000.0\n"
}

/// What is true of the gyro: it drifts by 0.001 °/h per K/h of the ambient temperature 25 + 8 sin(2πt/5000 s).
fn with_rate_of_temperature(folder: &str) {
    let at = |name: &str| Path::new(folder).join(name);
    let (packed, plain) = (at("recording.csv.gz"), at("recording.csv"));
    succeeds(&["convert", packed.to_str().unwrap(), plain.to_str().unwrap()]);
    let text = std::fs::read_to_string(&plain).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let place = |name: &str| header.split(',').position(|it| it == name).unwrap();
    let (t, gyro) = (place("t"), place("gyro_x"));
    let mut table = header.to_owned();
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let time: f64 = cells[t].parse().unwrap();
        let rate = 8.0 * TAU / 5000.0 * 3600.0 * (TAU * time / 5000.0).cos();
        cells[gyro] = format!("{:?}", cells[gyro].parse::<f64>().unwrap() + 0.001 * rate);
        table.push('\n');
        table.push_str(&cells.join(","));
    }
    std::fs::write(&plain, table + "\n").unwrap();
    let case = std::fs::read_to_string(at("case.toml")).unwrap();
    std::fs::write(at("case.toml"), case.replace("recording.csv.gz", "recording.csv")).unwrap();
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
    with_rate_of_temperature(&at("true"));
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
    assert!(scenario.contains("effect = \"bias_temperature_rate\"\namplitude"), "{scenario}");
    succeeds(&["simulate", &at("put/scenario.toml"), "--seed", "77", "--out", &at("again")]);
    let again = found(&succeeds(&["explain", &at("again/case.toml"), "--json"]));
    let first = found(&answer);
    let names = |all: &Found| all.iter().map(|it| format!("{} {}", it.0, it.1)).collect::<Vec<_>>();
    assert_eq!(names(&first), ["ax bias_step", "ax bias_supply_voltage", "gyro_x bias_temperature_rate"]);
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
    let signal = "{\"sum\":[{\"coefficient\":1.0,\"factors\":[{\"of\":[{\"input\":\"rate_q\",\"weight\":1.0}],\"reference\":0.0,\"function\":\"magnitude\"}]}]}";
    let input =
        said(&format!("sensor = \"ax\"\neffect = \"g2_cross\"\namplitude = 1.0\nsignal = '{signal}'\n"));
    assert!(
        input.contains("disturbance[0].signal: found the input rate_q; expected one of time_s, rate_x"),
        "{input}"
    );
}
