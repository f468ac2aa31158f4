//! Cases with the output of the user's own simulator, and sensors of any kind.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_recording::case::{Clock, SensorKind};
use schuler_recording::motion::{Prediction, predict};
use schuler_recording::{CaseFile, Error, Leniency, Recording};

const HEAD: &str =
    "format = \"schuler-case/1\"\n[recording]\npath = \"real.csv\"\ntime = \"t\"\nstep_s = 0.1\n";
const SENSOR: &str =
    "[[sensor]]\nid = \"p\"\nkind = \"other\"\ncolumn = \"p\"\nunit = \"kPa\"\npredicted = \"q\"\n";

fn signal(t: f64) -> f64 {
    (0.9 * t).sin() + 0.4 * (0.31 * t).cos()
}

/// A table of time and values.
fn table(columns: &str, rows: impl Iterator<Item = (f64, f64)>) -> String {
    rows.fold(format!("{columns}\n"), |mut text, (time, value)| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{time},{value}");
        text
    })
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new(case: &str, real: &str, sim: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("case.toml", case), ("real.csv", real), ("sim.csv", sim)] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        Self(folder)
    }

    fn case(&self) -> PathBuf {
        self.0.path().join("case.toml")
    }

    fn read(&self) -> Result<Recording, Error> {
        Recording::read(&self.case())
    }

    fn refused(&self) -> String {
        self.read().unwrap_err().to_string()
    }
}

fn real() -> String {
    table("t,p", (0..1000).map(|k| (0.1 * f64::from(k), 2.0 + signal(0.1 * f64::from(k)))))
}

fn with_table(more: &str) -> String {
    format!("{HEAD}[simulation]\npath = \"sim.csv\"\ntime = \"s\"\n{more}{SENSOR}")
}

#[test]
fn a_prediction_is_interpolated_to_the_rows() {
    // Steps of another length, uneven, over a little more than the recording.
    let times = (0..800).map(|k| 0.13 * f64::from(k) + 0.01 * f64::from(k % 3) - 0.5);
    let folder = Folder::new(&with_table(""), &real(), &table("s,q", times.map(|t| (t, signal(t)))));
    let recording = folder.read().unwrap();
    let series = &recording.sensors[0];
    assert_eq!((series.sensor.kind, series.written_unit.name()), (SensorKind::Other, "kPa"));
    let Ok(Prediction::Series(predicted)) = predict(&recording, &series.sensor) else { panic!("a series") };
    for (time, value) in recording.time_s.iter().zip(&predicted) {
        assert!((value - signal(*time)).abs() < 2e-5, "{time}: {value}");
    }
    assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
}

#[test]
fn a_prediction_may_be_in_the_recordings_own_table() {
    let rows = (0..200).fold("t,p,q\n".to_owned(), |mut text, k| {
        let _ = writeln!(text, "{},{},{}", 0.1 * f64::from(k), k, 2 * k);
        text
    });
    let folder = Folder::new(&format!("{HEAD}{SENSOR}"), &rows, "");
    let predicted = folder.read().unwrap().sensors[0].predicted.clone().unwrap();
    assert_eq!(predicted[7], 14.0);
    // What is written reads back to the same.
    let case = CaseFile::read(&folder.case()).unwrap().case;
    let again = CaseFile::parse(Path::new("c.toml"), &case.to_toml().unwrap()).unwrap();
    assert_eq!(again.case, case);
}

#[test]
fn a_case_with_a_simulation_reads_back_to_itself() {
    let text = with_table("clock = \"unknown\"\ncovers = \"part\"\n");
    let case = CaseFile::parse(Path::new("c.toml"), &text).unwrap().case;
    assert_eq!(case.simulation.as_ref().unwrap().clock, Clock::Unknown);
    let again = CaseFile::parse(Path::new("c.toml"), &case.to_toml().unwrap()).unwrap();
    assert_eq!(again.case, case);
}

#[test]
fn a_motion_of_the_simulator_comes_with_its_rows() {
    let sim = (0..1100).fold("s,q,wx,wy,wz\n".to_owned(), |mut text, k| {
        let t = 0.1 * f64::from(k) - 2.0;
        let _ = writeln!(text, "{t},{},{},0,0", signal(t), 0.5 * t);
        text
    });
    let motion = "[motion]\nkind = \"recorded\"\nrate = [\"wx\", \"wy\", \"wz\"]\n";
    let folder = Folder::new(&format!("{}{motion}", with_table("")), &real(), &sim);
    let recording = folder.read().unwrap();
    let [x, ..] = recording.motion.rate.as_ref().unwrap();
    assert!((x[100] - 0.5 * recording.time_s[100]).abs() < 1e-9);
}

#[test]
fn an_unknown_clock_is_fitted_and_said() {
    let sim =
        table("s,q", (0..2600).map(|k| (0.05 * f64::from(k), signal(1.0001 * (0.05 * f64::from(k) - 12.3)))));
    let folder = Folder::new(&with_table("clock = \"unknown\"\n"), &real(), &sim);
    let recording = folder.read().unwrap();
    let predicted = recording.sensors[0].predicted.as_ref().unwrap();
    let left = recording.sensors[0].values.iter().zip(predicted).map(|(y, s)| (y - s - 2.0).abs());
    assert!(left.fold(0.0, f64::max) < 1e-3);
    let said = recording.warnings.join("\n");
    assert!(said.contains("sim.csv") && (said.contains("+12.3") || said.contains("+12.29")), "{said}");
}

#[test]
fn what_is_wrong_is_named_by_file_line_and_field() {
    let whole = || table("s,q", (0..1000).map(|k| (0.1 * f64::from(k), signal(0.1 * f64::from(k)))));
    let refused = |case: &str, sim: &str| Folder::new(case, &real(), sim).refused();
    // Ends early.
    let half = table("s,q", (0..500).map(|k| (0.1 * f64::from(k), 0.0)));
    let said = refused(&with_table(""), &half);
    assert!(said.contains("sim.csv:501: s: found the last time 49.9") && said.contains("covers"), "{said}");
    // Goes back.
    let back = whole().replace("\n50,", "\n3,");
    let said = refused(&with_table(""), &back);
    assert!(said.contains("sim.csv:502: s: row 501: found time 3 after 49.9"), "{said}");
    // Lacks columns.
    let said = refused(&with_table(""), &whole().replace("s,q", "s,z"));
    assert!(said.contains("case.toml:14: sensor[0].predicted") && said.contains('q'), "{said}");
    let said = refused(&with_table(""), &whole().replace("s,q", "z,q"));
    assert!(said.contains("case.toml:8: simulation.time"), "{said}");
    // Is not there.
    let said = refused(&with_table("").replace("sim.csv", "none.csv"), "");
    assert!(said.contains("none.csv: cannot"), "{said}");
    // Is half stated.
    let said = refused(&format!("{HEAD}[simulation]\npath = \"sim.csv\"\n{SENSOR}"), "");
    assert!(said.contains("simulation.time: missing"), "{said}");
    let said = refused(&format!("{HEAD}[simulation]\nclock = \"unknown\"\n{SENSOR}"), "");
    assert!(said.contains("simulation.clock"), "{said}");
    let said = refused(&with_table("").replace("predicted = \"q\"\n", ""), &whole());
    assert!(said.contains("case.toml:6: simulation: found no sensor with `predicted`"), "{said}");
    // Is not alike.
    let noise = |k: i32| (f64::from(k) * 12.9898).sin() * 43_758.547 % 1.0;
    let other = table("s,q", (0..1000).map(|k| (0.1 * f64::from(k), noise(k))));
    let said = refused(&with_table("clock = \"unknown\"\n"), &other);
    assert!(said.contains("case.toml:9: simulation.clock: found no offset"), "{said}");
}

#[test]
fn a_simulation_of_a_part_is_taken_where_the_case_says_so() {
    let half = table("s,q", (0..500).map(|k| (0.1 * f64::from(k), 0.0)));
    let folder = Folder::new(&with_table("covers = \"part\"\n"), &real(), &half);
    let recording = folder.read().unwrap();
    let predicted = recording.sensors[0].predicted.as_ref().unwrap();
    assert_eq!(predicted.iter().filter(|value| value.is_nan()).count(), 500);
    assert!(
        recording.warnings[0].contains("500 of 1000 rows have no prediction"),
        "{:?}",
        recording.warnings
    );
    let folder = Folder::new(&with_table(""), &real(), &half);
    let lenient = CaseFile::read_with(&folder.case(), Leniency::Lenient).unwrap();
    assert!(Recording::of_case(lenient).is_ok());
}

#[test]
fn a_prediction_in_another_unit_is_converted() {
    let sim = table("s,q", (0..1000).map(|k| (0.1 * f64::from(k), 1.0)));
    let gyro =
        "[[sensor]]\nid = \"w\"\nkind = \"mems_gyro\"\ncolumn = \"p\"\nunit = \"deg/s\"\npredicted = \"q\"\n";
    let case = with_table("").replace(SENSOR, &format!("{gyro}predicted_unit = \"rad/s\"\n"));
    let recording = Folder::new(&case, &real(), &sim).read().unwrap();
    assert_eq!(recording.sensors[0].predicted.as_ref().unwrap()[3], 1.0);
    let said = Folder::new(&case.replace("rad/s", "m"), &real(), &sim).refused();
    assert!(said.contains("sensor[0].predicted_unit"), "{said}");
    // In degrees a second where nothing is said.
    let case = with_table("").replace(SENSOR, gyro);
    let recording = Folder::new(&case, &real(), &sim).read().unwrap();
    assert!((recording.sensors[0].predicted.as_ref().unwrap()[3] - 1f64.to_radians()).abs() < 1e-15);
}
