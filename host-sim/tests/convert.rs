//! `schuler convert` from the outside: files, messages, exit status.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use schuler_recording::{CaseFile, Recording, table};
use serde_json::Value;

const CASE: &str = r#"
format = "schuler-case/1"
title = "Rate table"
[recording]
path = "recording.ulg"
time = "sensor_gyro_0.timestamp"
step_s = 0.01
[[sensor]]
id = "x"
kind = "mems_gyro"
column = "sensor_gyro_0.x"
unit = "rad/s"
axis = [1.0, 0.0, 0.0]
[[aux]]
column = "sensor_temp_0.temperature"
quantity = "temperature"
unit = "degC"
"#;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/schuler-recording/tests/samples").join(name)
}

fn convert(from: &Path, to: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler"))
        .args(["convert", "--json"])
        .args([from, to])
        .args(options)
        .output()
        .unwrap()
}

fn answer(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{said}");
    said
}

#[test]
fn a_log_is_converted_by_columns_and_time() {
    let directory = tempfile::tempdir().unwrap();
    let to = directory.path().join("new/x.csv");
    let columns = ["--columns", "sensor_gyro_0.timestamp,sensor_gyro_0.c*", "--from", "1700000000.095"];
    let said = answer(&convert(&sample("recording.ulg"), &to, &columns));
    assert_eq!(said["format"], "schuler-conversion/1");
    assert_eq!(said["rows"], 103);
    let text = fs::read_to_string(&to).unwrap();
    assert_eq!(
        text.lines().next(),
        Some("sensor_gyro_0.timestamp,sensor_gyro_0.counts[0],sensor_gyro_0.counts[1]")
    );
    assert_eq!(text.lines().count(), 104);
}

#[test]
fn a_case_is_converted_with_the_columns_that_it_names() {
    let directory = tempfile::tempdir().unwrap();
    let case = directory.path().join("case.toml");
    fs::write(&case, CASE).unwrap();
    fs::copy(sample("recording.ulg"), directory.path().join("recording.ulg")).unwrap();
    let to = directory.path().join("converted");
    let said = answer(&convert(&case, &to, &[]));
    assert!(said["warnings"][0].as_str().unwrap().contains("1 messages are left out"), "{said}");
    assert_eq!(said["columns"].as_array().unwrap().len(), 3);
    assert_eq!(table::open(&to.join("recording.parquet")).unwrap().names().len(), 3);
    let [before, after] = [case.clone(), to.join("case.toml")]
        .map(|case| Recording::of_case(CaseFile::read(&case).unwrap()).unwrap());
    assert_eq!(after.sensors[0].quality.present, 113);
    assert_eq!(format!("{:?}", before.sensors), format!("{:?}", after.sensors));
    assert_eq!(format!("{:?}", before.auxiliaries), format!("{:?}", after.auxiliaries));
    let said = refused(&convert(&case, directory.path(), &["--format", "csv-gz"]));
    assert!(said.contains("case.toml: would be replaced, but this run reads it"), "{said}");
    assert_eq!(fs::read_to_string(&case).unwrap(), CASE);
}

#[test]
fn what_cannot_be_converted_is_named_and_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let to = |name: &str| directory.path().join(name);
    let log = sample("recording.ulg");
    let said = refused(&convert(&log, &to("x.parquet"), &[]));
    assert!(said.contains("--columns: found messages of 2 topics (sensor_gyro_0, sensor_temp_0)"), "{said}");
    let said = refused(&convert(&log, &to("x.xlsx"), &[]));
    assert!(said.contains("x.xlsx: found another ending; expected one of .csv, .csv.gz, .parquet"), "{said}");
    let said = refused(&convert(&log, &to("x.csv"), &["--columns", "sensor_gyro_0.z"]));
    assert!(
        said.contains("recording.ulg: --columns: found \"sensor_gyro_0.z\"; expected a column"),
        "{said}"
    );
    let said = refused(&convert(&log, &to("x.csv"), &["--columns", "sensor_temp_0.*", "--to", "5"]));
    assert!(said.contains("recording.ulg: --from, --to: found none of 12 rows"), "{said}");
    let damaged = to("damaged.csv");
    fs::write(&damaged, "t,x\n0,1\n1,2\n2,three\n").unwrap();
    fs::write(to("x.csv"), "before").unwrap();
    let said = refused(&convert(&damaged, &to("x.csv"), &[]));
    assert!(said.contains("damaged.csv:4: x: found \"three\"; expected a number"), "{said}");
    assert_eq!(fs::read_to_string(to("x.csv")).unwrap(), "before");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 2);
}
