//! One recording in the formats that people have, written by other people's tools: the same answers from each, and what we
//! write is read by them as it was.
//!
//! `tests/oracle/make_tables.py` writes the recordings, `tests/oracle/check_tables.py` compares what became of them with
//! what pyulog, mcap and pyarrow read (`check_log.py` so for the log of a real flight controller), in a virtual environment under `target` that is made the first time.
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::{flight, identify};
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_recording::table::{self, Format};
use schuler_recording::{CaseFile, Error, Recording};
use schuler_tests::python::python;

const TABLES: [&str; 5] =
    ["recording.csv", "recording.csv.gz", "recording.parquet", "recording.mcap", "recording.ulg"];
const CASE: &str = r#"
format = "schuler-case/1"
title = "Rate table"
[recording]
path = "TABLE"
time = "sensor_gyro_0.timestamp"
step_s = 0.01
[site]
latitude_deg = 48.1
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 30.0 }
[[sensor]]
id = "x"
kind = "mems_gyro"
column = "sensor_gyro_0.x"
unit = "rad/s"
axis = [1.0, 0.0, 0.0]
  [sensor.nominal]
  white = 1.0
[[sensor]]
id = "y"
kind = "mems_gyro"
column = "sensor_gyro_0.y"
unit = "rad/s"
axis = [0.0, 1.0, 0.0]
  [sensor.nominal]
  white = 0.001
[[aux]]
column = "sensor_temp_0.temperature"
quantity = "temperature"
unit = "degC"
"#;

fn samples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/schuler-recording/tests/samples")
}

fn recording(directory: &Path, table: &str) -> Recording {
    let file = CaseFile::parse(&directory.join("case.toml"), &CASE.replace("TABLE", table)).expect("a case");
    let mut recording = Recording::of_case(file).unwrap_or_else(|error| panic!("{error:#}"));
    // What differs by design: where the table is, and that two of the formats count a message that has no row.
    recording.case.recording.path = PathBuf::new();
    recording.warnings.clear();
    recording
}

/// Runs a script of the oracles to its good end.
fn oracle(script: &str, arguments: &[&Path]) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("oracle").join(script);
    let mut python = Command::new(python());
    let output =
        python.arg("-B").arg(script).args(arguments).output().expect("the environment's Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
}

/// What identification, explanation and flight make of a recording, every number with all its digits.
fn answers(recording: &Recording) -> [String; 3] {
    let identified = identify::identify(recording, identify::Options::default());
    let explained = explain(recording, &Config::default());
    let channels = flight::plan(recording).unwrap_or_else(|problem| panic!("{problem:?}"));
    let json = |it: Result<String, _>| it.expect("an answer is JSON");
    [
        json(serde_json::to_string(&identified)),
        format!("{explained:?}"),
        format!("{:?}", channels.iter().map(|it| it.steps(recording)).collect::<Vec<_>>()),
    ]
}

#[test]
fn identification_explanation_and_flight_are_the_same_from_every_format() {
    let first = answers(&recording(&samples(), TABLES[0]));
    assert!(first.iter().all(|answer| answer.len() > 500), "{first:?}");
    for table in TABLES {
        let others = answers(&recording(&samples(), table));
        for (part, (answer, expected)) in ["identify", "explain", "fly"].iter().zip(others.iter().zip(&first))
        {
            assert!(answer == expected, "{table}: {part}:\n{answer}\nexpected\n{expected}");
        }
    }
}

#[test]
fn what_is_written_is_read_by_others_as_they_read_the_original() {
    let directory = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("formats");
    oracle("make_tables.py", &[&directory]);
    for table in TABLES {
        // The samples that the crate is tested with are those of the script.
        let (made, sample) = (recording(&directory, table), recording(&samples(), table));
        assert_eq!(format!("{made:?}"), format!("{sample:?}"), "{table}");
    }
    for name in TABLES.into_iter().chain(["ros2.mcap", "ros1.mcap", "protobuf.mcap"]) {
        for format in Format::ALL {
            let path = directory.join(name);
            let table = table::open(&path).unwrap_or_else(|error| panic!("{error}"));
            let wanted = table.all().unwrap_or_else(|_| {
                let case = CaseFile::parse(Path::new("case.toml"), CASE).expect("a case").case;
                let counts = ["sensor_gyro_0.counts[0]", "sensor_gyro_0.counts[1]"];
                let columns = case.columns().into_iter().chain(counts);
                columns.map(|name| table.index(name).expect("a column")).collect()
            });
            let copy = directory.join(format!("{name}-copy{}", format.ending()));
            let file = fs::File::create(&copy).expect("writable");
            let copied = table::copy(table, &wanted, table::Span::default(), (file, &copy), format, |_| {
                Ok::<(), Error>(())
            });
            assert_eq!(copied.expect("a copy").rows, 113, "{name}");
        }
    }
    oracle("check_tables.py", &[&directory]);
}

/// Where the crate is kept that holds a log of a real flight controller (MIT), fetched by Cargo and not part of the project; none,
/// and loud about it, where it cannot be reached.
fn real_log() -> Option<PathBuf> {
    let directory = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("real_log");
    let log = directory.join("vendor/yule_log/data/sample_log_small.ulg");
    if !log.exists() {
        fs::create_dir_all(directory.join("src")).expect("writable");
        fs::write(directory.join("src/lib.rs"), "").expect("writable");
        let manifest = "[package]\nname = \"real_log\"\nedition = \"2024\"\n[dependencies]\nyule_log = \"=0.4.0\"\n[workspace]\n";
        fs::write(directory.join("Cargo.toml"), manifest).expect("writable");
        let vendored =
            Command::new(env!("CARGO")).args(["vendor", "--quiet"]).current_dir(&directory).output();
        let output = vendored.expect("cargo runs");
        if !output.status.success() {
            eprintln!("SKIPPED: no log of a real PX4: {}", String::from_utf8_lossy(&output.stderr));
            return None;
        }
    }
    Some(log)
}

#[test]
fn the_log_of_a_real_flight_controller_is_read_as_pyulog_reads_it() {
    let Some(log) = real_log() else { return };
    let directory = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("real_log/topics");
    let _ = fs::remove_dir_all(&directory);
    fs::create_dir_all(&directory).expect("writable");
    let open = || table::open(&log).unwrap_or_else(|error| panic!("{error}"));
    let topic = |name: &str| name.split('.').next().unwrap_or_default().to_owned();
    let topics: BTreeSet<String> = open().names().iter().map(|name| topic(name)).collect();
    assert!(topics.len() > 10, "{topics:?}");
    for of in topics {
        let table = open();
        let time = table.index(&format!("{of}.timestamp")).expect("a time");
        let fields =
            (0..table.names().len()).filter(|&index| index != time && topic(&table.names()[index]) == of);
        let wanted: Vec<usize> = std::iter::once(time).chain(fields).collect();
        let path = directory.join(format!("{of}.parquet"));
        let file = fs::File::create(&path).expect("writable");
        table::copy(table, &wanted, table::Span::default(), (file, &path), Format::Parquet, |_| {
            Ok::<(), Error>(())
        })
        .unwrap_or_else(|error| panic!("{of}: {error}"));
    }
    oracle("check_log.py", &[&log, &directory]);
}
