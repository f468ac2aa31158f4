//! `schuler compare`, `schuler init` and `schuler explain TABLE` from the outside.
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn schuler(directory: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).current_dir(directory).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn refused(directory: &Path, arguments: &[&str]) -> String {
    let output = schuler(directory, arguments);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    text(&output.stderr)
}

/// Noise without a generator: the fractional parts of a large sine, twelve of which are nearly normal.
fn noise(row: usize) -> f64 {
    let part = |k: usize| {
        let x = ((12 * row + k) as f64 * 12.9898).sin() * 43_758.547;
        x - x.floor() - 0.5
    };
    (0..12).map(part).sum()
}

/// A pendulum's torque: simulated each 0.013 s, and recorded each 0.01 s with 2 % more scale and noise, beside a temperature.
fn tables(directory: &Path) {
    let torque = |t: f64| 3.0 * (0.7 * t).sin() + 1.4 * (2.3 * t).cos();
    let mut sim = "Time [s],Torque [N m]\n".to_owned();
    for row in 0..2400 {
        let t = 0.013 * f64::from(row);
        writeln!(sim, "{t},{}", torque(t)).unwrap();
    }
    let mut real = "time,torque_measured,T\n".to_owned();
    for row in 0..3000 {
        let t = 0.01 * f64::from(row);
        let noise = 0.02 * noise(row as usize);
        writeln!(real, "{t},{},{}", 1.02 * torque(t) + noise, 20.0 + 0.1 * t).unwrap();
    }
    std::fs::write(directory.join("sim.csv"), sim).unwrap();
    std::fs::write(directory.join("real.csv"), real).unwrap();
}

#[test]
fn two_tables_become_a_case_that_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    tables(at);
    let output = schuler(at, &["compare", "sim.csv", "real.csv", "--json", "--quiet"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let finding = &answer["findings"][0];
    assert_eq!(
        (finding["sensor"].as_str(), finding["effect"].as_str()),
        (Some("torque_measured"), Some("scale_factor"))
    );
    let value = finding["parameters"][0]["value"].as_f64().unwrap();
    assert!((value - 2e4).abs() < 1e3, "{value}");
    let said = answer["proposal"]["said"].to_string();
    assert!(said.contains("torque_measured is compared with Torque [N m]"), "{said}");
    // The case is one to go on with, and is not written over.
    let case = std::fs::read_to_string(at.join("real.toml")).unwrap();
    assert!(
        case.contains("predicted = \"Torque [N m]\"") && case.contains("quantity = \"temperature\""),
        "{case}"
    );
    let again = refused(at, &["compare", "sim.csv", "real.csv"]);
    assert!(again.contains("real.toml") && again.contains("--case"), "{again}");
    let explained = schuler(at, &["explain", "real.toml", "--quiet"]);
    assert!(text(&explained.stdout).contains("another scale factor"), "{}", text(&explained.stdout));
    // Nor is a table.
    let said = refused(at, &["compare", "sim.csv", "real.csv", "--case", "sim.csv"]);
    assert!(said.contains("sim.csv"), "{said}");
}

#[test]
fn the_unit_of_stamps_and_an_uneven_step_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let reading = |row: i32| (0.01 * f64::from(row)).sin() + 0.1 * noise(row as usize);
    let mut sim = "time_ms,rate\n".to_owned();
    let mut real = "time_ms,rate\n".to_owned();
    for row in 0..2000 {
        writeln!(sim, "{},{}", 10 * row, (0.01 * f64::from(row)).sin()).unwrap();
        // Intervals of 5 and 15 ms in turn; of 5 there is one more, which makes that the median.
        writeln!(real, "{},{}", 10 * row - 5 * (row % 2), reading(row)).unwrap();
    }
    std::fs::write(at.join("sim.csv"), sim).unwrap();
    std::fs::write(at.join("real.csv"), real).unwrap();
    let output = schuler(at, &["compare", "sim.csv", "real.csv", "--only-case", "--json", "--quiet"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains("the stamps are taken for ms"), "{said}");
    assert!(said.contains("a row each 0.005000 s by the median, 0.009997 s on the mean"), "{said}");
}

#[test]
fn what_cannot_be_compared_is_said_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    tables(at);
    std::fs::write(at.join("other.csv"), "t,flow\n0,1\n1,2\n2,1\n").unwrap();
    let said = refused(at, &["compare", "sim.csv", "other.csv"]);
    assert!(said.contains("--map Torque [N m]=flow"), "{said}");
    let said = refused(at, &["compare", "sim.csv", "real.csv", "--map", "Torqe=torque_measured"]);
    assert!(said.contains("expected a column of sim.csv: Torque [N m]"), "{said}");
    std::fs::write(at.join("no_time.csv"), "a,b\n1,2\n1,3\n0,1\n").unwrap();
    let said = refused(at, &["compare", "no_time.csv", "real.csv"]);
    assert!(said.contains("no_time.csv") && said.contains("found no column that is a time"), "{said}");
    std::fs::write(at.join("no_names.csv"), "0,2\n1,3\n2,1\n").unwrap();
    assert!(refused(at, &["init", "no_names.csv"]).contains("no_names.csv:1"));
    let written: Vec<_> = std::fs::read_dir(at).unwrap().map(|it| it.unwrap().path()).collect();
    assert!(written.iter().all(|path| path.extension().is_some_and(|it| it == "csv")), "{written:?}");
}

#[test]
fn a_recording_alone_becomes_a_case() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut table = "t,gyro_x,temp\n".to_owned();
    for row in 0..2000 {
        let temperature = 20.0 + 0.005 * f64::from(row) + 2.0 * (0.02 * f64::from(row)).sin();
        let rate = 1e-3 + 2e-5 * (temperature - 20.0) + 1e-5 * noise(row as usize);
        writeln!(table, "{},{rate},{temperature}", 0.1 * f64::from(row)).unwrap();
    }
    std::fs::write(at.join("run.csv"), table).unwrap();
    let output = schuler(at, &["init", "run.csv"]);
    let said = text(&output.stdout);
    assert!(
        output.status.success() && said.contains("gyro_x is taken for a gyro, in rad/s (a guess)"),
        "{said}"
    );
    let of_case = schuler(at, &["explain", "run.toml", "--quiet"]);
    assert!(of_case.status.success(), "{}", text(&of_case.stderr));
    // A table alone is explained as the case that would be written, which is said.
    let of_table = schuler(at, &["explain", "run.csv", "--quiet"]);
    let said = text(&of_table.stderr);
    assert!(said.contains("no case was given"), "{said}");
    assert!(text(&of_table.stdout).contains("drifts with its temperature"), "{}", text(&of_table.stdout));
}

/// Columns alone, sampled at a known rate; a counter of rows is no time.
#[test]
fn a_table_without_a_time_is_read_with_its_stated_step() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut with = "t,gyro_x,temp\n".to_owned();
    let mut without = "sample,gyro_x,temp\n".to_owned();
    for row in 0..2000 {
        let temperature = 20.0 + 0.005 * f64::from(row) + 2.0 * (0.02 * f64::from(row)).sin();
        let rate = 1e-3 + 2e-5 * (temperature - 20.0) + 1e-5 * noise(row as usize);
        writeln!(with, "{},{rate},{temperature}", 0.1 * f64::from(row)).unwrap();
        writeln!(without, "{row},{rate},{temperature}").unwrap();
    }
    std::fs::write(at.join("with.csv"), with).unwrap();
    std::fs::write(at.join("run.csv"), without).unwrap();
    for arguments in [&["init", "run.csv"][..], &["explain", "run.csv"]] {
        let said = refused(at, arguments);
        assert!(said.contains("run.csv") && said.contains("sample counts the rows"), "{said}");
        assert!(said.contains("state --step-s, in a case recording.step_s"), "{said}");
    }
    assert!(refused(at, &["compare", "with.csv", "run.csv"]).contains("--real-step-s"));
    assert!(refused(at, &["init", "run.csv", "--step-s", "0"]).contains("expected seconds, more than 0"));
    let output = schuler(at, &["init", "run.csv", "--step-s", "0.1"]);
    let said = text(&output.stdout);
    assert!(said.contains("taken to be evenly spaced by the stated step of 0.1 s"), "{said}");
    assert!(said.contains("sample (counts the rows)"), "{said}");
    let case = std::fs::read_to_string(at.join("run.toml")).unwrap();
    assert!(case.contains("step_s = 0.1") && !case.contains("time ="), "{case}");
    assert!(
        refused(at, &["explain", "run.toml", "--step-s", "0.1"]).contains("expected a table without one")
    );
    // The answer is that of the table with its times, whichever way it is asked for.
    let findings = |arguments: &[&str]| {
        let output = schuler(at, arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(!answer["findings"].as_array().unwrap().is_empty(), "{answer}");
        answer["findings"].clone()
    };
    let expected = findings(&["explain", "with.csv", "--json", "--quiet"]);
    assert_eq!(findings(&["explain", "run.toml", "--json", "--quiet"]), expected);
    assert_eq!(findings(&["explain", "run.csv", "--step-s", "0.1", "--json", "--quiet"]), expected);
    // A part of it is cut out by the same times.
    let output = schuler(at, &["convert", "run.toml", "part", "--from", "10", "--to", "20", "--json"]);
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((answer["rows"].as_u64(), answer["span_s"][0].as_f64()), (Some(101), Some(10.0)));
    let case = std::fs::read_to_string(at.join("part/run.toml")).unwrap();
    assert!(case.contains("step_s = 0.1") && !case.contains("time ="), "{case}");
    let fly = schuler(at, &["identify", "part/run.toml", "--json"]);
    assert!(fly.status.success(), "{}", text(&fly.stderr));
    // And beside a simulation, which may lack times as well.
    let output = schuler(
        at,
        &["compare", "run.csv", "with.csv", "--sim-step-s", "0.1", "--only-case", "--case", "pair.toml"],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let case = std::fs::read_to_string(at.join("pair.toml")).unwrap();
    assert!(case.contains("[simulation]\npath = \"run.csv\"\nstep_s = 0.1"), "{case}");
}
