//! The `schuler` command from the outside: exit status, messages, JSON, files.
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use schuler_core::module::FlightModule;
use schuler_link::configuration;
use serde_json::Value;

fn schuler(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn scenario(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios").join(name)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A scenario of ten minutes: a Schuler loop and five gyros of which one fails.
fn short(directory: &Path) -> PathBuf {
    let path = directory.join("short.toml");
    let text = r#"
format = "schuler-scenario/1"
title = "short"
[time]
duration_s = 600.0
[motion]
kind = "vehicle"
level_platform = true
[loop]
velocity_white = 0.1
[loop.nominal]
velocity_white = 0.1
[block]
id = "g"
[block.noise]
white = 0.02
[block.nominal]
white = 0.02
[[fault]]
sensor = "g_3"
kind = "step"
size = 0.4
onset_s = 300.0
[[gap]]
start_s = 100.0
duration_s = 7.0
"#;
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn simulate_then_fly_gives_json_and_whole_files_and_says_nothing_else() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("run");
    let simulated = schuler(&[
        "simulate",
        short(directory.path()).to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
        "--json",
        "--plot",
        "svg",
    ]);
    assert_eq!(text(&simulated.stderr), "");
    let answer = json(&simulated);
    assert_eq!(answer["format"], "schuler-simulation/1");
    let case = answer["case"].as_str().unwrap().to_owned();

    let flown_to = directory.path().join("flown");
    let flown = schuler(&["fly", &case, "--json", "--out", flown_to.to_str().unwrap(), "--plot", "svg,png"]);
    assert_eq!(text(&flown.stderr), "");
    let answer = json(&flown);
    let channel = &answer["channels"][0];
    assert_eq!(channel["steps"], 600);
    assert_eq!(channel["filter"]["missing"], 7);
    let faults: Vec<&Value> =
        channel["gyros"]["verdicts"].as_array().unwrap().iter().filter(|v| v["verdict"] == "fault").collect();
    assert_eq!(faults[0]["gyro"], "g_3");
    assert!((300.0..310.0).contains(&faults[0]["time_s"].as_f64().unwrap()), "{faults:?}");
    assert!(channel["truth"]["states"][1]["rmse"].as_f64().unwrap() < 1e-3);
    for file in answer["files"].as_array().unwrap() {
        assert!(std::fs::metadata(file.as_str().unwrap()).unwrap().len() > 0, "{file}");
    }
    // What flight software configures itself by, and what a board is loaded with, are the same.
    let bytes = |ending: &str| {
        let mut paths = answer["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap());
        std::fs::read(paths.find(|path| path.ends_with(ending)).unwrap()).unwrap()
    };
    let (mut loaded, mut configured) = (Box::new(FlightModule::new()), Box::new(FlightModule::new()));
    loaded.restore(&bytes("_state.bin")).unwrap();
    configured.configure(&configuration::decode(&bytes("_configuration.bin")).unwrap()).unwrap();
    let [one, other] = [loaded, configured].map(|mut module| {
        let mut state = vec![0; module.state_length().unwrap() as usize];
        module.save(&mut state).unwrap();
        state
    });
    assert!(one == other);
    // Nothing temporary is left.
    for entry in std::fs::read_dir(&flown_to).unwrap() {
        let name = entry.unwrap().file_name();
        assert!(!name.to_string_lossy().starts_with('.'), "{name:?}");
    }
    // The text for people has the same.
    let words = text(&schuler(&["fly", &case]).stdout);
    assert!(words.contains("g_3 has failed") && words.contains("NIS: mean"), "{words}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_does_not() {
    let directory = tempfile::tempdir().unwrap();
    let scenario = short(directory.path());
    let recording = |name: &str, seed: &str| {
        let out = directory.path().join(name);
        json(&schuler(&[
            "simulate",
            scenario.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--json",
            "--seed",
            seed,
        ]));
        std::fs::read(out.join("recording.csv.gz")).unwrap()
    };
    assert_eq!(recording("a", "7"), recording("b", "7"));
    assert_ne!(recording("a", "7"), recording("c", "8"));
}

#[test]
fn bad_input_is_one_line_with_file_line_field_and_expectation_and_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let path = short(directory.path());
    let broken =
        std::fs::read_to_string(&path).unwrap().replace("duration_s = 600.0", "duration_s = \"long\"");
    std::fs::write(&path, broken).unwrap();
    let out = directory.path().join("run");
    let failed = schuler(&["simulate", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(failed.status.code(), Some(2));
    let line = text(&failed.stderr);
    assert_eq!(line.lines().count(), 1, "{line}");
    assert!(
        line.contains("short.toml:5: time.duration_s: found \"long\"; expected a number greater than zero"),
        "{line}"
    );
    assert!(!out.exists());

    for (arguments, expected) in [
        (vec!["fly", "/no/such/case.toml"], "/no/such/case.toml: cannot read the case"),
        (vec!["fly"], "required arguments"),
        (vec!["simulate", "x.toml"], "--out"),
        (vec!["fly", "x.toml", "--on", "paper"], "possible values: host, qemu"),
    ] {
        let failed = schuler(&arguments);
        assert_eq!(failed.status.code(), Some(2), "{arguments:?}");
        assert!(text(&failed.stderr).contains(expected), "{arguments:?}: {}", text(&failed.stderr));
    }
}

#[test]
fn a_configuration_that_cannot_be_flown_is_bad_input() {
    let directory = tempfile::tempdir().unwrap();
    let case = directory.path().join("case.toml");
    std::fs::write(
        &case,
        r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[motion]
kind = "velocity_error"
[loop]
accelerometer = { sigma = 1e-3, tau_s = 0.1 }
[[sensor]]
id = "v"
kind = "ins_velocity"
column = "v"
unit = "m/s"
"#,
    )
    .unwrap();
    std::fs::write(directory.path().join("r.csv"), "t,v\n0,0\n1,0\n2,0\n").unwrap();
    let failed = schuler(&["fly", case.to_str().unwrap()]);
    assert_eq!(failed.status.code(), Some(2), "{}", text(&failed.stdout));
    assert!(
        text(&failed.stderr).contains("case.toml: filter.accelerometer.tau_s: "),
        "{}",
        text(&failed.stderr)
    );
}

#[test]
fn compare_isolation_gives_table_figure_and_json_for_any_block() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("isolation");
    let arguments = ["compare-isolation", "--trials", "2000", "--faults", "4,8", "--seed", "3"];
    let all =
        schuler(&[&arguments[..], &["--json", "--out", out.to_str().unwrap(), "--plot", "svg"]].concat());
    let answer = json(&all);
    // Nine methods, two fault sizes; the optimum is no worse than any other.
    let rows = answer["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 18);
    assert!(rows.iter().all(|row| row["ratio"].as_f64().unwrap() <= 1.0 + 1e-9 || row["ratio_error"] != 0.0));
    assert!(out.join("isolation.svg").exists() && out.join("isolation.json").exists());
    let words = text(&schuler(&arguments).stdout);
    assert!(
        words.contains("sequential filter") && words.contains("condition number, as published"),
        "{words}"
    );

    // Seven gyros: everything but the five determinants.
    let seven = schuler(&[&arguments[..], &["--gyros", "7", "--json"]].concat());
    let answer = json(&seven);
    assert_eq!(answer["rows"].as_array().unwrap().len(), 14);
    assert_eq!(answer["left_out"], serde_json::json!(["determinants", "raw-determinants"]));
    assert_eq!(schuler(&["compare-isolation", "--gyros", "4"]).status.code(), Some(2));
    assert_eq!(schuler(&["compare-isolation", "--faults", "nan"]).status.code(), Some(2));
}

#[test]
fn compare_isolation_prints_the_tables_of_the_paper() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("paper");
    let words = text(&schuler(&["compare-isolation", "--tables", "--out", out.to_str().unwrap()]).stdout);
    // First and last number of each table, calculated and printed.
    for pair in ["0.2849   (0.2849)", "2.0705   (2.0705)", "0.0814   (0.0814)", "0.0354   (0.0354)"] {
        assert!(words.contains(pair), "{pair}\n{words}");
    }
    assert_eq!(words.matches("25 of 25 numbers equal the printed ones").count(), 2, "{words}");
    let written = std::fs::read_to_string(out.join("isolation-tables.json")).unwrap();
    let answer: serde_json::Value = serde_json::from_str(&written).unwrap();
    assert_eq!(answer["differing"], serde_json::json!([0, 0]));
    assert_eq!(answer["rows"].as_array().unwrap().len(), 6);
    assert_eq!(schuler(&["compare-isolation", "--tables", "--gyros", "7"]).status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn ctrl_c_stops_the_run_and_leaves_no_half_written_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = short(directory.path());
    let long = std::fs::read_to_string(&path).unwrap().replace("duration_s = 600.0", "duration_s = 2e6");
    std::fs::write(&path, long).unwrap();
    let out = directory.path().join("run");
    let child = Command::new(env!("CARGO_BIN_EXE_schuler"))
        .args(["simulate", path.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_secs(2));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130), "{}", text(&ended.stderr));
    assert!(text(&ended.stderr).contains("stopped"));
    assert!(!out.exists());
}

/// The concealed scenario's gyro drifts by 1.35·10⁻⁷ rad/s per K and −2.60·10⁻⁶ rad/s per g: least squares of its true error.
#[test]
fn the_demonstration_goes_the_whole_way() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("demo");
    let arguments = ["demo", "--on", "host", "--out", out.to_str().unwrap(), "--plot", "svg"];
    let answer = json(&schuler(&[&arguments[..], &["--json"]].concat()));
    println!("{answer:#}");
    let findings = answer["findings"].as_array().unwrap();
    let effects: Vec<&str> = findings.iter().map(|it| it["effect"].as_str().unwrap()).collect();
    assert_eq!(effects, ["bias_temperature", "g_mass_unbalance"]);
    assert!(findings.iter().all(|it| it["sensor"] == "gyro"));
    let explanation = std::fs::read_to_string(out.join("explanation.html")).unwrap();
    assert!(explanation.contains("</html>"));
    let pair = |key: &str| [0, 1].map(|k| answer[key][k].as_f64().unwrap());
    let [before, after] = pair("held_out");
    assert!(before > 1.1 && (0.98..1.02).contains(&after), "{before} {after}");
    let [before, after] = pair("simulation");
    assert!(after < 0.2 * before, "{before} {after}");
    // Nothing of what was told; what is in the description and was not is said.
    let left_out = answer["not_in_the_scenario"].to_string();
    assert!(effects.iter().all(|effect| !left_out.contains(effect)), "{left_out}");
    let tilt = [0, 1].map(|k| answer["tilt"][k]["rmse"].as_f64().unwrap());
    assert!(tilt[1] < 0.3 * tilt[0], "{tilt:?}");
    assert!(answer["tilt"][1]["beyond_three_sigma"].as_f64().unwrap() < 0.02);
    assert_eq!(answer["board"]["because"], "this machine was asked for");
    assert!(out.join("closed_circle.svg").exists() && out.join("demo.json").exists());
    // The explanation is that of the case alone: what made the recording is not beside it.
    assert!(!std::fs::read_to_string(out.join("case.toml")).unwrap().contains("stiffness"));
    let again = json(&schuler(&["explain", out.join("case.toml").to_str().unwrap(), "--json"]));
    let coefficient = again["findings"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((coefficient / 1.35e-7 - 1.0).abs() < 0.1, "{coefficient}");
    let said = text(&schuler(&arguments).stdout);
    println!("{said}");
    assert!((10..=16).contains(&said.lines().count()), "{said}");
}

#[test]
fn the_demonstration_of_identification_finds_the_noise_and_the_fault() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("demo");
    let arguments = ["demo", "--identification", "--out", out.to_str().unwrap(), "--json", "--plot", "svg"];
    let answer = json(&schuler(&arguments));
    let beyond = |which: &str| answer[which]["tilt"]["beyond_three_sigma"].as_f64().unwrap();
    let rmse = |which: &str| answer[which]["tilt"]["rmse"].as_f64().unwrap();
    // The divergence to be reproduced, and its cure.
    assert!(beyond("mistuned") > 0.25, "{}", beyond("mistuned"));
    assert!(beyond("retuned") < 0.015, "{}", beyond("retuned"));
    assert!(rmse("retuned") < 0.85 * rmse("mistuned"));
    assert_eq!(answer["fault"]["isolated"], answer["fault"]["failed"]);
    assert_eq!(answer["fault"]["alarms_before_the_fault"], 0);
    assert!(out.join("before_and_after.svg").exists() && out.join("demo.json").exists());
    assert!(scenario("demo.toml").exists());
}
