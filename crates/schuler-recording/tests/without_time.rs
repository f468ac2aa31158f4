//! Tables without a column of time, whose rows are evenly spaced by the step that the case states.
use std::fmt::Write;
use std::fs;

use proptest::prelude::*;
use schuler_recording::recording::Stream;
use schuler_recording::table::{self, Format, Span};
use schuler_recording::{CaseFile, Error, Leniency, Recording};
use tempfile::TempDir;

const SENSORS: &str = r#"
[[sensor]]
id = "gyro"
kind = "mems_gyro"
column = "gyro"
unit = "deg/s"
axis = [0.0, 0.0, 1.0]
[[aux]]
column = "temp"
quantity = "temperature"
unit = "degC"
"#;

/// A folder with a case, whose keys of the recording are `keys`, and its table.
fn folder(keys: &str, table: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    let case = format!("format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\n{keys}\n{SENSORS}");
    fs::write(folder.path().join("case.toml"), case).unwrap();
    fs::write(folder.path().join("r.csv"), table).unwrap();
    folder
}

fn case_of(folder: &TempDir) -> Result<CaseFile, Error> {
    CaseFile::read(&folder.path().join("case.toml"))
}

fn read(keys: &str, table: &str) -> Result<Recording, String> {
    let folder = folder(keys, table);
    case_of(&folder)
        .and_then(Recording::of_case)
        .map_err(|error| format!("{error:#}").replace(&format!("{}/", folder.path().display()), ""))
}

/// A row of cells, an empty one for what is missing, with the time in front of it.
fn line(time: Option<f64>, cells: &[Option<f64>]) -> String {
    let cells = cells.iter().map(|cell| cell.map(|value| format!("{value:?}")).unwrap_or_default());
    let mut text: Vec<String> = time.map(|time| format!("{time:?}")).into_iter().collect();
    text.extend(cells);
    text.join(",") + "\n"
}

/// But for the key of the time and what is said of it.
fn comparable(mut recording: Recording) -> Recording {
    recording.case.recording.time = None;
    recording.case.recording.path = "r.csv".into();
    recording.warnings.clear();
    // A reading that is missing equals one that is missing.
    let all = recording.sensors.iter_mut().map(|it| &mut it.values);
    for values in all.chain(recording.auxiliaries.iter_mut().map(|it| &mut it.values)) {
        values.iter_mut().filter(|value| value.is_nan()).for_each(|value| *value = 1e99);
    }
    recording
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same table with an even time column and without one is the same recording, whole and in chunks, also where rows hold nothing.
    #[test]
    fn an_even_time_column_and_none_are_one_recording(
        step_s in prop_oneof![Just(0.0016384), Just(0.01), Just(1.0), 1e-4..10.0_f64],
        rows in prop::collection::vec(
            prop_oneof![
                8 => (-1e3..1e3_f64, prop::option::of(-40.0..90.0_f64)).prop_map(|(gyro, temp)| [Some(gyro), temp]),
                1 => Just([None, None]),
                1 => (-40.0..90.0_f64).prop_map(|temp| [None, Some(temp)]),
            ],
            2..120,
        ),
    ) {
        // The first row says something, as a table begins with it.
        let mut rows = rows;
        for row in [0, 1] {
            rows[row] = [Some(1.0), Some(20.0)];
        }
        let table = |timed: bool| {
            let header = if timed { "t,gyro,temp\n" } else { "gyro,temp\n" };
            rows.iter().enumerate().fold(header.to_owned(), |text, (row, cells)| {
                text + &line(timed.then_some(row as f64 * step_s), cells)
            })
        };
        let with = read(&format!("time = \"t\"\ntime_unit = \"s\"\nstep_s = {step_s:?}"), &table(true));
        let without = read(&format!("step_s = {step_s:?}"), &table(false));
        match (with, without) {
            (Ok(mut with), Ok(without)) => {
                with.case.recording.time_unit = None;
                prop_assert!(without.warnings.iter().any(|it| it.contains("evenly spaced")));
                prop_assert_eq!(comparable(with), comparable(without));
            }
            (with, without) => prop_assert_eq!(with.is_err(), without.is_err()),
        }
        // In chunks.
        let folder = folder(&format!("step_s = {step_s:?}"), &table(false));
        if let (Ok(stream), Ok(whole)) = (
            Stream::open(case_of(&folder).unwrap(), |_| Ok::<_, Error>(())),
            Recording::of_case(case_of(&folder).unwrap()),
        ) {
            let time_s: Vec<f64> = stream.chunks().unwrap().flat_map(|chunk| chunk.unwrap().time_s).collect();
            prop_assert_eq!(time_s, whole.time_s);
            prop_assert_eq!(&stream.head().warnings, &whole.warnings);
        }
    }
}

#[test]
fn the_assumption_is_said() {
    let recording = read("step_s = 0.01", "gyro,temp,\n1,20,\n2,20,\n3,21,\n").unwrap();
    assert_eq!(recording.time_s, [0.0, 0.01, 0.02]);
    let said = "r.csv has no column of time: its rows are taken to be evenly spaced by the stated step of 0.01 s, from 0 s";
    assert!(recording.warnings[0].ends_with(said), "{:?}", recording.warnings);
}

#[test]
fn what_is_missing_is_named_with_both_keys() {
    let table = "gyro,temp\n1,20\n2,20\n";
    let error = read("", table).unwrap_err();
    let said =
        "case.toml:2: recording.time: missing, as is step_s; expected the name of the time column, or step_s";
    assert!(error.starts_with(said), "{error}");
    for key in ["time_unit = \"s\"", "duplicates = \"drop\""] {
        let error = read(&format!("step_s = 1.0\n{key}"), table).unwrap_err();
        let name = key.split(' ').next().unwrap();
        assert!(error.contains(&format!("recording.{name}: found without time")), "{error}");
    }
    let error = read("step_s = 0.0", table).unwrap_err();
    assert!(error.contains("recording.step_s"), "{error}");
}

/// Rows that cannot be read leave a gap, and do not make later rows early.
#[test]
fn rows_left_out_keep_their_time() {
    let folder = folder("step_s = 0.5", "gyro,temp\n1,20\n2\n3,20\nx,20\n5,20\n6,21\n7,21\n");
    let path = folder.path().join("case.toml");
    let lenient = || CaseFile::read_with(&path, Leniency::Lenient).unwrap();
    let recording = Recording::of_case(lenient()).unwrap();
    assert_eq!(recording.time_s, [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
    let gyro: Vec<f64> = recording.sensors[0].values.iter().map(|value| value.to_degrees().round()).collect();
    assert_eq!((gyro[0], gyro[2], gyro[4], gyro[6]), (1.0, 3.0, 5.0, 7.0));
    assert!(gyro[1].is_nan() && gyro[3].is_nan());
    // And so they do in a copy.
    let copy = folder.path().join("copy.csv");
    let table = lenient().open_table().unwrap();
    let span = Span { of_s: Some([0.5, 2.5]), step_s: Some(0.5) };
    let file = (fs::File::create(&copy).unwrap(), copy.as_path());
    let copied = table::copy(table, &[0, 1], span, file, Format::Csv, |_| Ok::<_, Error>(())).unwrap();
    assert_eq!((copied.rows, copied.span_s), (5, Some([0.5, 2.5])));
    assert_eq!(fs::read_to_string(copy).unwrap(), "gyro,temp\n,\n3.0,20.0\n,20.0\n5.0,20.0\n6.0,21.0\n");
}

/// Of a table longer than a chunk each row is where it belongs.
#[test]
fn rows_are_counted_over_chunks() {
    let table = (0..10_000).fold("gyro,temp\n".to_owned(), |mut text, row| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{row},20");
        text
    });
    let recording = read("step_s = 0.25", &table).unwrap();
    assert_eq!((recording.time_s[9_999], recording.step_s), (2499.75, 0.25));
}

#[test]
fn a_simulation_may_lack_times_as_well() {
    let folder = folder("step_s = 0.1", "gyro,temp\n0,20\n1,20\n2,21\n3,21\n");
    let simulation = |keys: &str| {
        let case = format!(
            "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\nstep_s = 0.1\n\
             [simulation]\npath = \"s.csv\"\n{keys}\n{}",
            SENSORS.replacen("unit = \"deg/s\"", "unit = \"deg/s\"\npredicted = \"w\"", 1)
        );
        fs::write(folder.path().join("case.toml"), case).unwrap();
        fs::write(folder.path().join("s.csv"), "w\n0\n2\n4\n").unwrap();
        case_of(&folder).and_then(Recording::of_case).map_err(|error| error.to_string())
    };
    let recording = simulation("step_s = 0.2").unwrap();
    let predicted = recording.sensors[0].predicted.as_ref().unwrap();
    assert!((predicted[1].to_degrees() - 1.0).abs() < 1e-9 && (predicted[3].to_degrees() - 3.0).abs() < 1e-9);
    assert_eq!(recording.warnings.iter().filter(|it| it.contains("evenly spaced")).count(), 2);
    let error = simulation("").unwrap_err();
    assert!(error.contains("case.toml:5: simulation.time: missing, as is step_s"), "{error}");
}
