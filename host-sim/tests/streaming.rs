//! Recordings of any length: `schuler fly` and `schuler convert` go through them in bounded memory and leave no half file when they
//! are stopped; what needs them whole says so before the memory is gone.
#![cfg(target_os = "linux")]
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use host_sim::flight::{self, Step};
use schuler_recording::{CaseFile, Error, Recording};

const CASE: &str = r#"
format = "schuler-case/1"
title = "velocity error and a thermometer"
[recording]
path = "recording.csv"
time = "t"
step_s = 1.0
[motion]
kind = "velocity_error"
[loop]
velocity_white = 0.05
[[sensor]]
id = "v"
kind = "ins_velocity"
column = "v"
unit = "m/s"
[[aux]]
column = "temperature"
quantity = "temperature"
unit = "degC"
"#;
/// More than the points of which a figure is made: only the length of the flight is different between these.
const SHORT: usize = 80_000;
const LONG: usize = 240_000;
/// What an output and its input take at least, bytes.
const STEP_BYTES: usize = 500;
/// How long a program may take to do what is waited for.
const PATIENCE: Duration = Duration::from_mins(5);

/// A case in a directory: velocity and temperature swing, single rows are missing, and longer than a chunk once.
fn case(directory: &Path, rows: usize) -> PathBuf {
    let mut table = String::from("t,v,temperature\n");
    for row in (0..rows).filter(|row| row % 1000 != 500 && !(10_000..15_000).contains(row)) {
        let t = row as f64;
        let noise = (t * 0.618_033_988_749_895).fract() - 0.5;
        let temperature = ((20.0 + 5.0 * (t / 9000.0).sin()) * 16.0).round() / 16.0;
        writeln!(table, "{t},{:.6},{temperature}", 0.1 * (t / 800.0).sin() + 0.1 * noise).unwrap();
    }
    fs::create_dir_all(directory).unwrap();
    fs::write(directory.join("recording.csv"), table).unwrap();
    let path = directory.join("case.toml");
    fs::write(&path, CASE).unwrap();
    path
}

fn schuler(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_schuler"));
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The most that a process had in memory, bytes, looked at until it ends.
fn peak(mut child: Child) -> usize {
    let mut peak = 0;
    let status = loop {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<usize>().ok());
        peak = peak.max(1024 * kilobytes.unwrap_or_default());
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(status.success(), "{}", message(&child.wait_with_output().unwrap()));
    peak
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_flight_takes_the_same_memory_however_long_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let [short, long] = [SHORT, LONG].map(|rows| {
        let folder = directory.path().join(rows.to_string());
        let case = case(&folder, rows);
        let out = folder.join("out");
        let arguments = ["fly", case.to_str().unwrap(), "--identification", "off", "--plot", "svg", "--out"];
        let peak = peak(schuler(&arguments).arg(&out).spawn().unwrap());
        let table = schuler_recording::table::open(&out.join("v_outputs.csv.gz")).unwrap();
        let time = table.index("t").unwrap();
        assert_eq!(table.read(&[time]).unwrap().rows(), rows);
        assert!(out.join("v_estimates.svg").exists() && out.join("v_temperature.svg").exists());
        peak
    });
    println!("{:.0} MB for {SHORT} steps, {:.0} MB for {LONG}", short as f64 / 1e6, long as f64 / 1e6);
    let kept = STEP_BYTES * (LONG - SHORT);
    assert!(long < short + kept / 2, "{short} bytes for {SHORT} steps, {long} for {LONG}");
}

#[test]
fn a_recording_is_planned_and_read_chunk_by_chunk_as_it_is_whole() {
    let directory = tempfile::tempdir().unwrap();
    let path = case(directory.path(), 20_000);
    let whole = Recording::read(&path).unwrap();
    let planned = flight::plan(&whole).unwrap();
    let file = CaseFile::read(&path).unwrap();
    let (stream, streamed) = flight::plan_stream(file, |_| Ok::<(), Error>(())).unwrap();
    assert_eq!(planned, streamed);
    assert_eq!([stream.rows(), whole.len()], [20_000; 2]);
    for channel in &planned {
        let steps: Vec<Step> = channel.stream(&stream).unwrap().collect::<Result<_, _>>().unwrap();
        assert_eq!(steps, channel.steps(&whole).unwrap());
    }
}

/// Stops a program once there is a file in its directory, which then is one that is being written; what it has left there.
fn stopped_while_writing(mut command: Command, directory: &Path) -> Vec<PathBuf> {
    let files = || -> Vec<PathBuf> {
        let entries = fs::read_dir(directory).into_iter().flatten();
        entries.map(|entry| entry.unwrap().path()).collect()
    };
    let child = command.spawn().unwrap();
    let begun = Instant::now();
    while files().is_empty() {
        assert!(begun.elapsed() < PATIENCE, "nothing is written");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(files().iter().all(|path| path.file_name().unwrap().to_string_lossy().starts_with('.')));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    assert!(message(&output).contains("stopped"), "{}", message(&output));
    files()
}

#[test]
fn ctrl_c_leaves_no_half_file_of_a_flight_or_a_conversion() {
    let directory = tempfile::tempdir().unwrap();
    let case = case(&directory.path().join("run"), LONG);
    for command in ["fly", "convert"] {
        let out = directory.path().join(command);
        let stopped = match command {
            "fly" => schuler(&["fly", case.to_str().unwrap(), "--out", out.to_str().unwrap()]),
            _ => schuler(&["convert", case.to_str().unwrap(), out.to_str().unwrap(), "--format", "csv-gz"]),
        };
        let left = stopped_while_writing(stopped, &out);
        assert!(left.is_empty(), "{command} has left {left:?}");
    }
}

#[test]
fn what_needs_the_whole_recording_refuses_one_that_does_not_fit() {
    let directory = tempfile::tempdir().unwrap();
    let case = case(directory.path(), LONG);
    // Address space of 300 MB: enough to begin with.
    let output = Command::new("sh")
        .args(["-c", "ulimit -v 300000; exec \"$0\" explain \"$1\"", env!("CARGO_BIN_EXE_schuler")])
        .arg(&case)
        .output()
        .unwrap();
    let said = message(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("needs the whole recording in memory, more than"), "{said}");
    assert!(said.contains("schuler convert") && said.lines().count() == 1, "{said}");
}
