//! Cases with redundant gyros, thermometers and two velocities, flown on this machine and on the emulated target.
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use schuler_core::compensation::{Block, Factor, Quantity, Target, Term};
use schuler_core::isolation::IsolationConfig;
use schuler_link::block::encode;
use serde_json::Value;

fn schuler(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn fly(case: &Path, out: &Path, more: &[&str]) -> Value {
    let mut arguments = vec!["fly", case.to_str().unwrap(), "--json", "--out", out.to_str().unwrap()];
    arguments.extend(more);
    json(&schuler(&arguments))
}

fn skipped(test: &str) -> bool {
    let skip = std::env::var("SCHULER_SKIP_QEMU").is_ok_and(|value| value == "1");
    if skip {
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "SKIPPED: {test} needs QEMU, and SCHULER_SKIP_QEMU=1 is set");
    }
    skip
}

/// What the module said on this machine and on the target, whole files of it: the same bytes.
fn assert_same_on_the_target(case: &Path, directory: &Path, more: &[&str]) -> Value {
    let (host, target) = (directory.join("on_host"), directory.join("on_target"));
    let here = fly(case, &host, more);
    let there = fly(case, &target, &[more, &["--on", "qemu"]].concat());
    assert_eq!(here["channels"], there["channels"]);
    let outputs: Vec<PathBuf> = std::fs::read_dir(&host)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.to_string_lossy().ends_with("_outputs.csv.gz"))
        .collect();
    assert_eq!(outputs.len(), here["channels"].as_array().unwrap().len());
    for path in outputs {
        let name = path.file_name().unwrap();
        assert!(
            std::fs::read(&path).unwrap() == std::fs::read(target.join(name)).unwrap(),
            "{} differs",
            name.display()
        );
    }
    there
}

/// A coefficient of 0.02 °/h/K on the fourth gyro, rad/s/K.
const COEFFICIENT: f64 = 0.02 * std::f64::consts::PI / 180.0 / 3600.0;

const STEPS: usize = 5400;

/// Temperature at the fourth gyro, degC.
fn temperature_at(t: f64) -> f64 {
    20.0 + 15.0 * (t / 2500.0).sin()
}

/// Five gyros of unknown motion; the fourth follows the temperature beside it.
fn redundant(directory: &Path) -> PathBuf {
    let mut random = rand_pcg::Pcg64::seed_from_u64(8);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let noise = 0.02 * std::f64::consts::PI / 180.0 / 3600.0;
    let mut table = "t,g1,g2,g3,g4,g5,temperature,far\n".to_owned();
    for k in 0..STEPS {
        let t = k as f64;
        let temperature = temperature_at(t);
        let rate = [2e-5 * (t / 300.0).sin(), 4e-5, 7e-5 * (t / 500.0).cos()];
        write!(table, "{t}").unwrap();
        for (gyro, axis) in IsolationConfig::CONE.axes.iter().enumerate() {
            let projected: f64 = axis.iter().zip(rate).map(|(a, w)| a * w).sum();
            let warmth = if gyro == 3 { COEFFICIENT * (temperature - 20.0) } else { 0.0 };
            write!(table, ",{:e}", projected + warmth + noise * normal()).unwrap();
        }
        let read = |temperature: f64| (temperature * 16.0).round() / 16.0;
        writeln!(table, ",{},{}", read(temperature), read(20.0 + 0.1 * temperature)).unwrap();
    }
    std::fs::write(directory.join("r.csv"), table).unwrap();
    let mut case = r#"
format = "schuler-case/1"
title = "Five gyros and two thermometers"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[motion]
kind = "unknown"
[[aux]]
column = "far"
quantity = "temperature"
unit = "degC"
[[aux]]
column = "temperature"
quantity = "temperature"
unit = "degC"
near = "g4"
"#
    .to_owned();
    for (gyro, axis) in IsolationConfig::CONE.axes.iter().enumerate() {
        let id = format!("g{}", gyro + 1);
        write!(
            case,
            "[[sensor]]\nid = \"{id}\"\nkind = \"fog\"\ncolumn = \"{id}\"\nunit = \"rad/s\"\naxis = {axis:?}\n[sensor.nominal]\nwhite = {noise:e}\n"
        )
        .unwrap();
    }
    let path = directory.join("case.toml");
    std::fs::write(&path, case).unwrap();
    path
}

/// Without the block the fourth gyro is taken for faulty; with it, it is as good as the others, here and on the target.
#[test]
fn a_block_heals_a_gyro_that_follows_its_temperature() {
    let directory = tempfile::tempdir().unwrap();
    let case = redundant(directory.path());
    let answer = fly(&case, &directory.path().join("without"), &["--plot", "svg"]);
    let channel = &answer["channels"][0];
    assert_eq!(channel["gyros"]["excluded"], "g4", "{channel}");
    // The thermometer at a sensor comes first.
    let columns: Vec<&Value> =
        channel["thermometers"].as_array().unwrap().iter().map(|it| &it["column"]).collect();
    assert_eq!(columns, ["temperature", "far"]);
    let thermometer = &channel["thermometers"][0];
    assert_eq!(thermometer["quantum"], 0.0625);
    let greatest = 15.0 / 2500.0;
    let rate = thermometer["rate"][1].as_f64().unwrap();
    assert!((rate / greatest - 1.0).abs() < 0.1, "{rate} instead of {greatest}");
    assert!(directory.path().join("without/gyros_temperature.svg").exists());

    let temperature = Factor { quantity: Quantity::Temperature(0), reference: 20.0, power: 1 };
    let term = Term {
        target: Target::Gyro(3),
        coefficient: COEFFICIENT as f32,
        factors: [temperature, Factor::default()],
    };
    let bytes = encode(&Block { terms: [term].into_iter().collect(), ..Block::default() });
    let block = directory.path().join("block.schc");
    std::fs::write(&block, &bytes).unwrap();
    let with = ["--compensation", block.to_str().unwrap()];
    let answer = if skipped("a_block_heals_a_gyro_that_follows_its_temperature, on the target,") {
        fly(&case, &directory.path().join("with"), &with)
    } else {
        assert_same_on_the_target(&case, directory.path(), &with)
    };
    let channel = &answer["channels"][0];
    assert_eq!(channel["gyros"]["excluded"], Value::Null, "{channel}");
    assert_eq!(channel["gyros"]["complete_share"], 1.0);
    let sensor = &channel["compensation"]["sensors"][3];
    assert_eq!(sensor["sensor"], "g4");
    let warmths: Vec<f64> = (0..STEPS).map(|k| temperature_at(k as f64) - 20.0).collect();
    let mean = warmths.iter().sum::<f64>() / STEPS as f64;
    let taken = sensor["mean"].as_f64().unwrap();
    assert!((taken / (mean * COEFFICIENT) - 1.0).abs() < 0.01, "{sensor}");

    // A damaged block is bad input, named.
    let mut damaged = bytes.to_vec();
    damaged[12] ^= 1;
    std::fs::write(&block, damaged).unwrap();
    let failed = schuler(&["fly", case.to_str().unwrap(), "--compensation", block.to_str().unwrap()]);
    assert_eq!(failed.status.code(), Some(2));
    let line = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(line.contains("block.schc") && line.contains("checksum"), "{line}");
}

fn simulated(scenario: &str, directory: &Path) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios").join(scenario);
    let out = directory.join("simulated");
    let answer =
        json(&schuler(&["simulate", path.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]));
    PathBuf::from(answer["case"].as_str().unwrap())
}

/// The block of the scenario: the step is found, and the target says the same.
#[test]
fn a_redundant_case_flies_on_the_target_as_here() {
    if skipped("a_redundant_case_flies_on_the_target_as_here") {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let case = simulated("gyro_block.toml", directory.path());
    let answer = assert_same_on_the_target(&case, directory.path(), &[]);
    assert_eq!(answer["channels"][0]["gyros"]["excluded"], "gyro_2");
}

/// A Doppler log against an inertial system: both channels, filter and health monitor, here and on the target.
#[test]
fn a_doppler_case_flies_on_the_target_as_here() {
    let directory = tempfile::tempdir().unwrap();
    let case = simulated("doppler_log.toml", directory.path());
    let answer = if skipped("a_doppler_case_flies_on_the_target_as_here, on the target,") {
        fly(&case, &directory.path().join("here"), &[])
    } else {
        assert_same_on_the_target(&case, directory.path(), &["--plot", "svg"])
    };
    let channels = answer["channels"].as_array().unwrap();
    assert_eq!(channels.len(), 2);
    for channel in channels {
        let health = &channel["health"];
        assert_eq!(health["residuals"], channel["steps"]);
        assert!(!health["verdicts"].as_array().unwrap().is_empty());
    }
}

/// A satellite velocity against an inertial one along the same axis: a jump of the radio is seen, and blamed on it.
#[test]
fn a_jump_of_the_radio_is_found() {
    let directory = tempfile::tempdir().unwrap();
    let mut random = rand_pcg::Pcg64::seed_from_u64(3);
    let mut table = "t,ins,gnss\n".to_owned();
    let mut error = 0.0;
    for k in 0..1800 {
        let speed = 100.0 + 5.0 * (f64::from(k) / 200.0).sin();
        let normal: f64 = StandardNormal.sample(&mut random);
        error += -0.1 * error + 0.3 * 0.43 * normal;
        let jump = if (900..1000).contains(&k) { 2.0 } else { 0.0 };
        let white = 0.01 * random.random_range(-1.0..1.0);
        writeln!(table, "{k},{speed},{}", speed + error + jump + white).unwrap();
    }
    std::fs::write(directory.path().join("r.csv"), table).unwrap();
    let case = directory.path().join("case.toml");
    let text = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[motion]
kind = "unknown"
[[sensor]]
id = "ins"
kind = "ins_velocity"
column = "ins"
unit = "m/s"
axis = [1.0, 0.0, 0.0]
[[sensor]]
id = "gnss"
kind = "gnss_velocity"
column = "gnss"
unit = "m/s"
axis = [1.0, 0.0, 0.0]
[sensor.nominal]
white = 0.01
markov = { sigma = 0.3, tau_s = 10.0 }
"#;
    std::fs::write(&case, text).unwrap();
    let answer = fly(&case, &directory.path().join("out"), &["--plot", "svg"]);
    let health = &answer["channels"][0]["health"];
    let faults: Vec<&Value> = health["verdicts"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|change| !["nominal", "unobserved"].contains(&change["verdict"].as_str().unwrap()))
        .collect();
    let first = faults.first().expect("a fault");
    assert!((900.0..905.0).contains(&first["time_s"].as_f64().unwrap()), "{health}");
    assert_eq!(first["suspect"], "radio");
    assert!(directory.path().join("out/ins_health.svg").exists());
    let words = String::from_utf8_lossy(&schuler(&["fly", case.to_str().unwrap()]).stdout).into_owned();
    assert!(words.contains("radio against inertial velocity") && words.contains("shifted mean"), "{words}");
}
