//! A table under a case.
use std::path::Path;

use schuler_recording::table::open_bytes;
use schuler_recording::{CaseFile, Recording};

/// The case: a sensor in a unit, a temperature, and no nominal step, which then is the table's.
const CASE: &str = r#"
format = "schuler-case/1"
[recording]
path = "table.csv"
time = "t"
[[sensor]]
id = "gyro"
kind = "fog"
column = "gyro"
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
[[aux]]
column = "temp"
quantity = "temperature"
unit = "degC"
"#;

/// A table: an error, or a grid that increases with every series on it.
pub fn recording(data: &[u8]) {
    let file = CaseFile::parse(Path::new("case.toml"), CASE).expect("the case is sound");
    let Ok(table) = open_bytes(Path::new("table.csv"), data.to_vec()) else { return };
    let Ok(recording) = Recording::of_table(file, table) else { return };
    let rows = recording.len();
    assert!(rows >= 2 && recording.step_s > 0.0);
    assert!(recording.time_s.is_sorted() && recording.time_s.iter().all(|time| time.is_finite()));
    assert_eq!(recording.inserted.len(), rows);
    let inserted = recording.inserted.iter().filter(|&&row| row).count();
    assert_eq!(recording.gaps.iter().map(|gap| gap.missing).sum::<usize>(), inserted);
    for (values, quality) in recording
        .sensors
        .iter()
        .map(|it| (&it.values, it.quality))
        .chain(recording.auxiliaries.iter().map(|it| (&it.values, it.quality)))
    {
        assert_eq!((values.len(), quality.in_gaps), (rows, inserted));
        assert_eq!(quality.present + quality.missing + quality.in_gaps, rows);
    }
}
