//! A case and its table together: SI units, gaps, missing values, and mistakes by file and line.
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use schuler_recording::motion::{Prediction, predict};
use schuler_recording::recording::Stream;
use schuler_recording::{CaseFile, Error, Recording, table};
use tempfile::TempDir;

const CASE: &str = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 45.0
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 0.0 }
[[sensor]]
id = "gyro_z"
kind = "fog"
column = "gyro_z"
unit = "deg/h"
axis = [0.0, 0.0, 1.0]
[[sensor]]
id = "az"
kind = "accelerometer"
column = "az"
unit = "mg"
axis = [0.0, 0.0, 1.0]
  [sensor.nominal]
  temperature_bias = { column = "T", reference_degC = 20.0, coefficients = [0.1] }
[[aux]]
column = "B"
quantity = "magnetic_field_x"
unit = "G"
"#;

const TABLE: &str =
    "t,note,gyro_z,az,T,B\n0,a,15,-1000,20.5,0.5\n1,b,,-1000.5,nan,0.5\n4.1,c,inf,NaN,21,0.5\n";

fn case(folder: &TempDir, case: &str, table: &[u8]) -> PathBuf {
    fs::write(folder.path().join("r.csv"), table).unwrap();
    let path = folder.path().join("case.toml");
    fs::write(&path, case).unwrap();
    path
}

fn read(case_text: &str, table: &[u8]) -> Result<Recording, String> {
    let folder = TempDir::new().unwrap();
    Recording::read(&case(&folder, case_text, table))
        .map_err(|error| format!("{error:#}").replace(&format!("{}/", folder.path().display()), ""))
}

#[test]
fn columns_become_si_series_on_the_step_grid() {
    let recording = read(CASE, TABLE.as_bytes()).unwrap();
    assert_eq!(recording.len(), 5, "two missing steps between 1 and 4.1 s");
    assert_eq!(recording.inserted, [false, false, true, true, false]);
    assert_eq!(recording.time_s[4], 4.1);
    assert_eq!(recording.elapsed_s().last(), Some(4.1));
    let gz = recording.sensor("gyro_z").unwrap();
    assert!((gz.values[0] - 15_f64.to_radians() / 3600.0).abs() < 1e-19);
    assert!(gz.values[1..].iter().all(|value| value.is_nan()), "empty, gap, gap, infinite");
    assert_eq!(
        (gz.quality.present, gz.quality.missing, gz.quality.infinite, gz.quality.in_gaps),
        (1, 2, 1, 2)
    );
    assert!((recording.sensor("az").unwrap().values[1] + 9.80665 * 1.0005).abs() < 1e-12);
    assert_eq!(
        recording.auxiliary("T").unwrap().values[0],
        20.5,
        "the nominal model's temperature is there unasked"
    );
    let field = recording.auxiliary("B").unwrap();
    assert_eq!(field.auxiliary.unit, "T");
    assert!((field.values[4] - 50e-6).abs() < 1e-15);
    assert_eq!(recording.warnings.len(), 1, "{:?}", recording.warnings);
}

#[test]
fn a_static_body_is_predicted_from_site_and_attitude() {
    let recording = read(CASE, TABLE.as_bytes()).unwrap();
    let predicted = |id: &str| predict(&recording, &recording.sensor(id).unwrap().sensor).unwrap();
    let Prediction::Constant(rate) = predicted("gyro_z") else { panic!("a constant") };
    let down = -7.292115e-5 * 45_f64.to_radians().sin();
    assert!((rate - down).abs() < 1e-18);
    let Prediction::Constant(force) = predicted("az") else { panic!("a constant") };
    assert!((force + 9.8062).abs() < 1e-4);
}

#[test]
fn mistakes_name_the_file_they_are_in() {
    let missing = CASE.replace("column = \"gyro_z\"", "column = \"gyro_zz\"");
    assert_eq!(
        read(&missing, TABLE.as_bytes()).unwrap_err(),
        "case.toml:15: sensor[0].column: found \"gyro_zz\"; expected a column of the table; did you mean \"gyro_z\"?"
    );
    let tables = [
        (
            "t,note,gyro_z,az,T,B\n0,a,1,1,1,1\n1,a,1,x1,1,1\n",
            "r.csv:3: az: found \"x1\"; expected a number, nan or nothing",
        ),
        ("t,note,gyro_z,az,T,B\n0,a,1,1,1,1\n0,a,1,1,1,1\n", "r.csv:3: t: row 2: found time 0 after 0"),
        (
            "t,note,gyro_z,az,T,B\n0,a,1,1,1,1\n,a,1,1,1,1\n",
            "r.csv:3: t: row 2: found no time; expected seconds",
        ),
        ("t,note,gyro_z,az,T,B\n0,a,1,1\n1,a,1,1,1,1\n", "r.csv:2: found a row of 4 cells; expected 6"),
        ("t,note,gyro_z,az,T,B\n0,a,1,1,1,1,7\n1,a,1,1,1,1\n", "r.csv:2: found a row of 7 cells; expected 6"),
        (
            "t,note,gyro_z,az,T,B\n0,a,1,1,1,1\n1e9,a,1,1,1,1\n",
            "r.csv:3: t: row 2: found a jump of 1000000000 s",
        ),
        (
            "t,note,gyro_z,az,T,B,B\n0,a,1,1,1,1,1\n",
            "case.toml:27: aux[0].column: found \"B\", which the table has twice",
        ),
        (
            "t,note,gyro_z,az,T,B\n0,a,1,1,1,1\n0.01,a,1,1,1,1\n",
            "case.toml:6: recording.step_s: found 1; expected about 0.01",
        ),
        ("0,1,2\n3,4,5\n", "r.csv:1: found numbers only; expected a header row"),
        ("", "r.csv:1: found an empty table; expected a header row"),
        ("t,note,gyro_z,az,T,B\n", "r.csv: t: found 0 rows with values; expected at least two"),
    ];
    for (table, expected) in tables {
        let message = read(CASE, table.as_bytes()).unwrap_err();
        assert!(message.starts_with(expected), "{message}\nexpected {expected}");
    }
}

#[test]
fn a_last_row_cut_off_is_left_out_with_a_warning() {
    let recording =
        read(CASE, b"\xef\xbb\xbft,note,gyro_z,az,T,B\r\n0,a,1,1,1,1\r\n1, a, 1 ,1,1,1\r\n2,a,1").unwrap();
    assert_eq!(recording.len(), 2);
    assert!(
        recording.warnings[0].contains("r.csv:4: the last row has 3 of 6 cells"),
        "{:?}",
        recording.warnings
    );
}

#[test]
fn a_gzip_file_cut_off_is_an_error() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("r.csv.gz");
    let values: Vec<f64> = (0..5000).map(|row| f64::from(row).sin()).collect();
    table::write(&path, &[("t", &values)]).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::File::create(&path).unwrap().write_all(&bytes[..bytes.len() / 2]).unwrap();
    let error = table::open(&path).unwrap().read(&[0]).unwrap_err();
    assert!(error.to_string().contains("cannot read the table"), "{error}");
}

#[test]
fn files_that_are_not_there_are_named() {
    let folder = TempDir::new().unwrap();
    let error = Recording::read(&folder.path().join("none.toml")).unwrap_err().to_string();
    assert!(error.contains("none.toml: cannot read the case"), "{error}");
    let path = case(&folder, &CASE.replace("r.csv", "none.csv"), b"");
    let error = Recording::read(&path).unwrap_err().to_string();
    assert!(error.contains("none.csv: cannot read the table"), "{error}");
    let error = table::open(folder.path()).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.contains("cannot read the table"), "a folder is not a table: {error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Every finite value is written so that it reads back to the same bits; NaN as missing.
    #[test]
    fn tables_read_back_to_the_same_bits(
        rows in prop::collection::vec((any::<f64>(), any::<f64>()), 1..50),
        gzipped in any::<bool>(),
    ) {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join(if gzipped { "t.csv.gz" } else { "t.csv" });
        let finite = |value: f64| if value.is_finite() { value } else { f64::NAN };
        let first: Vec<f64> = rows.iter().map(|row| finite(row.0)).collect();
        let second: Vec<f64> = rows.iter().map(|row| finite(row.1)).collect();
        table::write(&path, &[("a \"name\", quoted", &first), ("b", &second)]).unwrap();
        let reader = table::open(&path).unwrap();
        prop_assert_eq!(table::column_index(reader.names(), "a \"name\", quoted"), Ok(0));
        let columns = reader.read(&[1, 0]).unwrap();
        for (written, read) in [(&second, &columns.values[0]), (&first, &columns.values[1])] {
            prop_assert_eq!(written.len(), read.len());
            for (written, read) in written.iter().zip(read) {
                prop_assert!(written.to_bits() == read.to_bits() || written.is_nan() && read.is_nan());
            }
        }
    }

    /// A table of one column, whose missing values are empty rows.
    #[test]
    fn a_single_column_keeps_its_missing_rows(present in prop::collection::vec(any::<bool>(), 1..20)) {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("t.csv");
        let values: Vec<f64> = present.iter().map(|&present| if present { 1.5 } else { f64::NAN }).collect();
        table::write(&path, &[("a", &values)]).unwrap();
        let read = table::open(&path).unwrap().read(&[0]).unwrap();
        prop_assert_eq!(read.values[0].iter().map(|value| value.is_finite()).collect::<Vec<_>>(), present);
    }

    /// Damaged files are refused with a message or read, never a panic, whatever the damage.
    #[test]
    fn damaged_files_never_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0_u8..4), 1..12),
        in_case in any::<bool>(),
        gzipped in any::<bool>(),
    ) {
        let folder = TempDir::new().unwrap();
        let mut table_bytes = TABLE.as_bytes().to_vec();
        if gzipped {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(&table_bytes).unwrap();
            table_bytes = encoder.finish().unwrap();
        }
        let mut case_bytes = CASE.as_bytes().to_vec();
        let bytes = if in_case { &mut case_bytes } else { &mut table_bytes };
        for (at, byte, action) in damage {
            if bytes.is_empty() {
                break;
            }
            let at = at.index(bytes.len());
            match action {
                0 => bytes[at] = byte,
                1 => bytes.truncate(at),
                2 => bytes.insert(at, byte),
                _ => { bytes.remove(at); }
            }
        }
        fs::write(folder.path().join("r.csv"), &table_bytes).unwrap();
        let path = folder.path().join("case.toml");
        fs::write(&path, &case_bytes).unwrap();
        match Recording::read(&path) {
            Ok(recording) => {
                for series in &recording.sensors {
                    prop_assert_eq!(series.values.len(), recording.len());
                    let _ = predict(&recording, &series.sensor);
                }
                prop_assert!(recording.time_s.windows(2).all(|pair| pair[0] < pair[1]));
            }
            Err(error) => {
                prop_assert!(!error.to_string().contains('\n'), "one line: {error}");
                prop_assert!(!error.problems.is_empty());
            }
        }
    }

    /// Nothing at all in common with a case.
    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("case.toml");
        fs::write(&path, &bytes).unwrap();
        prop_assert!(Recording::read(&path).is_err());
        if let Ok(table) = table::open(&path) {
            let _ = table.read(&[0]);
        }
    }
}

/// A case of one gyro in "r.csv", with further lines of its recording.
fn gyro_case(more: &str) -> String {
    format!(
        "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\n{more}\n[[sensor]]\nid = \"x\"\n\
         kind = \"mems_gyro\"\ncolumn = \"x\"\nunit = \"rad/s\"\naxis = [1.0, 0.0, 0.0]\n"
    )
}

/// A table of times and their row numbers.
fn numbered(times: impl Iterator<Item = String>) -> String {
    let mut table = String::from("t,x\n");
    for (row, time) in times.enumerate() {
        writeln!(table, "{time},{row}").unwrap();
    }
    table
}

/// Rows read whole and as a stream.
fn read_both(case_text: &str, table: &str) -> Recording {
    let folder = TempDir::new().unwrap();
    let path = case(&folder, case_text, table.as_bytes());
    let whole = Recording::read(&path).unwrap();
    let stream = Stream::open(CaseFile::read(&path).unwrap(), |_| Ok::<(), Error>(())).unwrap();
    assert_eq!((stream.rows(), stream.start_s()), (whole.len(), whole.time_s[0]));
    assert_eq!((stream.head().step_s, &stream.head().warnings), (whole.step_s, &whole.warnings));
    let chunks: Vec<Recording> = stream.chunks().unwrap().collect::<Result<_, _>>().unwrap();
    let time_s: Vec<f64> = chunks.iter().flat_map(|chunk| chunk.time_s.clone()).collect();
    assert_eq!(time_s, whole.time_s);
    let inserted: Vec<bool> = chunks.iter().flat_map(|chunk| chunk.inserted.clone()).collect();
    assert_eq!(inserted, whole.inserted);
    whole
}

/// Samples at 200 Hz, stamped when they arrive in bursts of five; a burst that is lost is five missing rows, wherever its stamps
/// leave them.
#[test]
fn bursts_of_arrivals_are_read_as_sampled_evenly() {
    let arrival = |row: usize| (row / 5 + 1) as f64 * 0.025 + (row % 5) as f64 * 1e-4;
    let whole = (0..10_000).map(|row| format!("{:.6}", arrival(row)));
    let lost =
        (0..10_000).filter(|row| !(6000..6005).contains(row)).map(|row| format!("{:.6}", arrival(row)));
    for (table, missing) in [(numbered(whole), 0), (numbered(lost), 5)] {
        for more in ["", "step_s = 0.005"] {
            let recording = read_both(&gyro_case(more), &table);
            assert_eq!(recording.step_s, 0.005);
            assert_eq!(recording.len(), 10_000);
            assert_eq!(recording.inserted.iter().filter(|&&inserted| inserted).count(), missing);
            let off = |row: usize| recording.time_s[row] - recording.time_s[0] - 0.005 * row as f64;
            assert!((0..10_000).all(|row| off(row).abs() < 0.005), "{}", off(9999));
            assert!(recording.warnings[0].contains("r.csv: t: the stamps come in bursts of about 5"));
        }
    }
    // The same with one stamp for the rows of a burst.
    let together = numbered((0..10_000).map(|row| format!("{:.3}", (row / 5 + 1) as f64 * 0.025)));
    assert_eq!(read_both(&gyro_case(""), &together).step_s, 0.005);
}

#[test]
fn a_unit_of_time_is_stated_or_guessed_and_said() {
    let stamps = |row: u64| (1_403_636_579_758_555_392 + 5_000_000 * row).to_string();
    let table = numbered((0..2000).map(stamps));
    let guessed = read_both(&gyro_case(""), &table);
    assert_eq!(guessed.step_s, 0.005);
    assert!(guessed.warnings[0].contains("time_unit = \"ns\""), "{:?}", guessed.warnings);
    let stated = read_both(&gyro_case("time_unit = \"ns\""), &table);
    assert_eq!((stated.step_s, stated.warnings.len()), (0.005, 0));
    assert_eq!(stated.time_s[0], 1_403_636_579.758_555_4);
    let milliseconds = numbered((0..100).map(|row| (row * 20).to_string()));
    assert_eq!(read_both(&gyro_case("time_unit = \"ms\""), &milliseconds).step_s, 0.02);
    let error = read(&gyro_case("time_unit = \"nanos\""), table.as_bytes()).unwrap_err();
    assert!(error.contains("recording.time_unit: found \"nanos\"; expected one of s, ms, us, ns"), "{error}");
}

#[test]
fn rows_that_come_twice_or_late_have_a_stated_remedy() {
    let mut table = String::from("t,x\n");
    for row in 0..9000 {
        writeln!(table, "{:.2},{row}", f64::from(row) * 0.01).unwrap();
        if row % 100 == 50 {
            writeln!(table, "{:.2},{}", f64::from(row) * 0.01, row + 1).unwrap();
            writeln!(table, "{:.2},0", f64::from(row - 3) * 0.01).unwrap();
        }
    }
    let error = read(&gyro_case(""), table.as_bytes()).unwrap_err();
    assert!(error.starts_with("r.csv:53: t: row 52: found time 0.5 after 0.5; expected"), "{error}");
    assert!(error.contains("recording.duplicates"), "{error}");
    let mean = |remedy: &str, row: usize| {
        let recording = read_both(&gyro_case(&format!("duplicates = \"{remedy}\"")), &table);
        assert_eq!((recording.len(), recording.step_s), (9000, 0.01));
        assert!(recording.warnings[0].contains("90 rows with the time of the row before"));
        assert!(recording.warnings[1].contains("90 rows earlier"), "{:?}", recording.warnings);
        recording.sensors[0].values[row]
    };
    assert_eq!((mean("drop", 50), mean("average", 50)), (50.0, 50.5));
    // The last row of a chunk of the table may be repeated in the next.
    assert_eq!((mean("drop", 8999), mean("average", 8999)), (8999.0, 8999.0));
    let back = numbered((0..500).chain(0..500).map(|row| row.to_string()));
    let error = read(&gyro_case("duplicates = \"drop\""), back.as_bytes()).unwrap_err();
    assert!(error.starts_with("r.csv:502: t: found 499 of 1000 rows earlier"), "{error}");
}

#[test]
fn sensors_with_the_same_readings_are_told_first() {
    let case = ["a", "b", "c", "d"].iter().fold(
        "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\n".to_owned(),
        |text, id| {
            text + &format!(
                "[[sensor]]\nid = \"{id}\"\nkind = \"fog\"\ncolumn = \"{id}\"\nunit = \"deg/h\"\naxis = [1, 0, 0]\n"
            )
        },
    );
    let table = |differs: &str| {
        (0..100).fold("t,a,b,c,d\n".to_owned(), |text, row| {
            let (one, missing) = (row * row % 17, if row == 50 { "nan" } else { differs });
            let other = if row == 99 { missing.to_owned() } else { one.to_string() };
            text + &format!("{row},{one},{},{one},{other}\n", row * 3 % 7)
        })
    };
    let warned = |table: &str| read(&case, table.as_bytes()).unwrap().warnings;
    let told = warned(&table("0.5"));
    assert!(told[0].contains("r.csv: a and c have the same readings, bit for bit"), "{told:?}");
    let told = warned(&table("nan"));
    assert!(told[0].contains("r.csv: a, c and d have the same readings"), "{told:?}");
    // Constants say nothing.
    let still = (0..100).fold("t,a,b,c,d\n".to_owned(), |text, row| text + &format!("{row},1,1,1,1\n"));
    assert!(warned(&still).is_empty());
}

#[test]
fn counts_and_other_units_of_columns_are_stated() {
    let case = r#"
        format = "schuler-case/1"
        [recording]
        path = "r.csv"
        time = "t"
        [motion]
        kind = "recorded"
        rate = ["p", "q", "r"]
        rate_unit = "deg/s"
        specific_force = ["fx", "fy", "fz"]
        specific_force_unit = "g"
        attitude = { columns = ["yaw", "pitch", "roll"], order = "zyx", unit = "deg" }
        [[sensor]]
        id = "g"
        kind = "mems_gyro"
        column = "counts"
        scale = 0.0625
        unit = "deg/s"
        axis = [1, 0, 0]
        [[aux]]
        column = "T"
        quantity = "temperature"
        scale = 0.5
        offset = 32.0
        unit = "degF"
    "#;
    let head = "t,p,q,r,fx,fy,fz,yaw,pitch,roll,counts,T\n";
    let table = (0..50)
        .fold(head.to_owned(), |text, row| text + &format!("{row},90,0,0,0,0,-1,30,10,20,{},36\n", 16 * row));
    let recording = read_both(case, &table);
    let motion = &recording.motion;
    assert_eq!(motion.rate.as_ref().unwrap()[0][7], 90.0 * (PI / 180.0));
    assert_eq!(motion.specific_force.as_ref().unwrap()[2][7], -9.80665);
    for (angles, degrees) in motion.attitude_rad.as_ref().unwrap().iter().zip([20.0_f64, 10.0, 30.0]) {
        assert!((angles[7] - degrees.to_radians()).abs() < 1e-12);
    }
    assert!((recording.sensors[0].values[7] - 7.0 * (PI / 180.0)).abs() < 1e-15);
    assert!((recording.auxiliaries[0].values[7] - 10.0).abs() < 1e-12);
    let (angles, quaternion) = (
        r#"["yaw", "pitch", "roll"], order = "zyx", unit = "deg""#,
        r#"["yaw", "pitch", "roll", "p"], order = "wxyz""#,
    );
    for case in [case.to_owned(), case.replace(angles, quaternion)] {
        let read = read_both(&case, &table).case;
        let written = read.to_toml().unwrap();
        assert_eq!(CaseFile::parse(Path::new("case.toml"), &written).unwrap().case, read, "{written}");
    }
    for (from, to, expected) in [
        (
            "order = \"zyx\"",
            "order = \"wxyz\"",
            "motion.attitude.columns: found 3 columns; expected 4, as order is",
        ),
        (
            "order = \"zyx\"",
            "order = \"zyxw\"",
            "motion.attitude.order: found \"zyxw\"; expected one of wxyz, xyzw, zyx",
        ),
        (
            "rate_unit = \"deg/s\"",
            "rate_unit = \"g\"",
            "motion.rate_unit: found \"g\"; expected one of rad/s, deg/s, deg/h",
        ),
        ("scale = 0.0625", "scale = 0", "sensor[0].scale: found 0; expected a number other than zero"),
    ] {
        let error = read(&case.replace(from, to), table.as_bytes()).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn times_of_switching_on_are_those_of_the_table() {
    let table = numbered((0..200).map(|row| row.to_string()));
    let stated = |text: &str| read(&gyro_case(&format!("switched_on_s = {text}")), table.as_bytes());
    for (text, expected) in [("[]", vec![]), ("[50, 120.5]", vec![50.0, 120.5])] {
        assert_eq!(stated(text).unwrap().case.recording.switched_on_s, Some(expected));
    }
    let wrong = [
        ("[50, 200]", "recording.switched_on_s[1]: found 200; expected a time of the table, 0 to 199 s"),
        ("[-1]", "recording.switched_on_s[0]: found -1; expected a time of the table, 0 to 199 s"),
        ("[50, 50]", "recording.switched_on_s: found 50 after 50; expected times in seconds, each later"),
        ("[nan]", "recording.switched_on_s[0]: found nan; expected a finite number"),
        ("50", "recording.switched_on_s: found 50; expected an array of finite numbers"),
    ];
    for (text, expected) in wrong {
        let error = stated(text).unwrap_err();
        assert!(error.starts_with("case.toml:") && error.contains(expected), "{error}");
    }
}

/// Every row of a stream is that of the recording read whole: gaps within a chunk, from one into the next and longer than one,
/// missing and infinite values, with the nominal step given and not.
#[test]
fn a_stream_has_the_rows_of_the_whole_recording() {
    let mut table = String::from("t,gyro_z,az,T,B\n");
    for row in (0..12_000)
        .filter(|row| row % 1000 != 7 && !(4090..4110).contains(row) && !(6000..11_000).contains(row))
    {
        let x = match row % 100 {
            3 => String::new(),
            5 => "inf".to_owned(),
            _ => format!("{}", f64::from(row).sin()),
        };
        let (time, temperature) = (f64::from(row) * 0.1 + 5.0, 20.0 + f64::from(row) / 1000.0);
        writeln!(table, "{time},{x},1000,{temperature},0.5").unwrap();
    }
    let text = CASE.replace("step_s = 1.0", "step_s = 0.1");
    for text in [text.clone(), text.replace("step_s = 0.1\n", "")] {
        let folder = tempfile::tempdir().unwrap();
        let path = case(&folder, &text, table.as_bytes());
        let whole = Recording::read(&path).unwrap();
        let mut seen = 0;
        let stream = Stream::open(CaseFile::read(&path).unwrap(), |chunk| {
            seen += chunk.len();
            Ok::<(), Error>(())
        })
        .unwrap();
        assert_eq!(seen, table.lines().count() - 1);
        assert_eq!((stream.rows(), stream.start_s()), (whole.len(), whole.time_s[0]));
        let head = stream.head();
        assert_eq!((head.step_s, &head.warnings, head.len()), (whole.step_s, &whole.warnings, 0));
        assert_eq!(head.sensors[0].quality, whole.sensors[0].quality);
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        // As often as wanted.
        for _ in 0..2 {
            let chunks: Vec<Recording> = stream.chunks().unwrap().collect::<Result<_, _>>().unwrap();
            assert!(chunks.len() > 3 && chunks.iter().all(|chunk| chunk.len() <= 4096));
            let joined =
                |of: &dyn Fn(&Recording) -> Vec<f64>| bits(&chunks.iter().flat_map(of).collect::<Vec<f64>>());
            assert_eq!(joined(&|it| it.time_s.clone()), bits(&whole.time_s));
            assert_eq!(joined(&|it| it.sensors[0].values.clone()), bits(&whole.sensors[0].values));
            assert_eq!(joined(&|it| it.auxiliaries[0].values.clone()), bits(&whole.auxiliaries[0].values));
            let inserted: Vec<bool> = chunks.iter().flat_map(|it| it.inserted.clone()).collect();
            assert_eq!(inserted, whole.inserted);
        }
    }
}

#[test]
fn a_stream_finds_what_is_wrong_before_anything_is_made_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = String::from("t,gyro_z,az,T,B\n");
    for row in (0..9000).chain([5]) {
        writeln!(table, "{row},1,1,1,1").unwrap();
    }
    let path = case(&folder, CASE, table.as_bytes());
    let streamed = Stream::open(CaseFile::read(&path).unwrap(), |_| Ok::<(), Error>(())).unwrap_err();
    assert_eq!(streamed, Recording::read(&path).unwrap_err());
    assert!(streamed.to_string().contains("r.csv:9002: t: row 9001: found time 5 after 8999"), "{streamed}");
}

/// The recording of a table of a gyro and its temperature under a case of 1 s steps.
fn recorded(table: &str) -> Recording {
    let directory = tempfile::tempdir().unwrap();
    let case = directory.path().join("case.toml");
    let text = "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\n\
        [[sensor]]\nid = \"x\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1, 0, 0]\n\
        [[aux]]\ncolumn = \"T\"\nquantity = \"temperature\"\nunit = \"degC\"\n";
    std::fs::write(&case, text).unwrap();
    std::fs::write(directory.path().join("r.csv"), table).unwrap();
    let mut recording = Recording::read(&case).unwrap();
    recording.case.recording.path = "r.csv".into();
    recording
}

#[test]
fn rows_left_out_and_rows_of_nan_are_one_recording() {
    let lost = |row: usize| (300..340).contains(&row) || row % 7 == 3 || row >= 950;
    let table = |nothing: Option<&str>| {
        (0..1000).fold("t,x,T\n".to_owned(), |text, row| {
            let values = format!("{}.5,2{}", row % 5, row % 3);
            match nothing.filter(|_| lost(row)) {
                Some(nothing) => text + &format!("{row}{nothing}\n"),
                None if lost(row) => text,
                None => text + &format!("{row},{values}\n"),
            }
        })
    };
    let left_out = recorded(&table(None));
    // All rows are of one length, so that values can be compared as bits.
    let bits = |recording: &Recording| {
        let series = [&recording.sensors[0].values, &recording.auxiliaries[0].values, &recording.time_s];
        series.map(|values| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>())
    };
    for nothing in [",nan,nan", ",,", ",NaN,", ",,inf"] {
        let of_nan = recorded(&table(Some(nothing)));
        assert_eq!(bits(&of_nan), bits(&left_out), "{nothing}");
        assert_eq!((of_nan.step_s, &of_nan.gaps), (left_out.step_s, &left_out.gaps), "{nothing}");
        assert_eq!(of_nan.sensors[0].quality, left_out.sensors[0].quality, "{nothing}");
        assert_eq!(of_nan.inserted, left_out.inserted, "{nothing}");
        // Values that were infinite are told of all the same.
        let said: usize = of_nan.warnings.len() - left_out.warnings.len();
        assert_eq!(said, usize::from(nothing.contains("inf")), "{:?}", of_nan.warnings);
    }
    // A row that says anything is a row.
    let half = recorded(&table(Some(",nan,20")));
    assert_eq!((half.len(), half.gaps.len()), (1000, 0));
}
