//! The identification against statsmodels, allantools and scipy, to 1e-9, on drawn and on real recordings.
//!
//! `tests/oracle/check_identify.py` does the comparing, in a virtual environment under `target` that is made from
//! `tests/oracle/requirements.txt` the first time.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::identify::report::Identification;
use host_sim::identify::{Options, identify};
use schuler_recording::{Recording, table};
use schuler_tests::golden_records::MinimalStandard;
use schuler_tests::python::python;

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn scratch() -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR"))
}

/// Identifies the case and has the oracle check the answer.
fn check(name: &str, case: &Path) -> Identification {
    let recording = Recording::read(case).unwrap_or_else(|error| panic!("{error:#}"));
    let identification = identify(&recording, Options::default());
    let answer = scratch().join(format!("{name}.json"));
    fs::write(&answer, serde_json::to_string(&identification).expect("an answer is JSON")).expect("writable");
    let table = case.parent().unwrap_or(Path::new("")).join(&recording.case.recording.path);
    let output = Command::new(python())
        .arg(project().join("tests/oracle/check_identify.py"))
        .args([&answer, &table])
        .output()
        .expect("the environment's Python runs");
    println!("{name}\n{}", String::from_utf8_lossy(&output.stdout));
    let said =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{name}:\n{said}");
    identification
}

/// A case beside a table with a gyro (white, Markov and walk), an accelerometer (exponential-cosine and slope) on a large
/// mean, and a gyro of white noise alone; every `missing`-th row is left out of the table, and of the second sensor every
/// tenth value.
fn drawn(name: &str, rows: usize, missing: Option<usize>) -> PathBuf {
    let mut random = MinimalStandard::new(20_261_121);
    let mut columns: [Vec<f64>; 4] = [const { Vec::new() }; 4];
    let (mut markov, mut walk, mut cosine, mut sine) =
        (random.normal(), 0.0, random.normal(), random.normal());
    let (decay, angle) = ((-1.0_f64 / 40.0).exp(), std::f64::consts::TAU / 60.0);
    let driven = (1.0 - decay * decay).sqrt();
    for row in 0..rows {
        let t = 0.5 * row as f64;
        markov = decay * markov + driven * random.normal();
        walk += 0.01 * random.normal();
        let turned = (angle.cos() * cosine - angle.sin() * sine, angle.sin() * cosine + angle.cos() * sine);
        (cosine, sine) =
            (decay * turned.0 + driven * random.normal(), decay * turned.1 + driven * random.normal());
        let values = [
            t,
            0.4 * markov + walk + 1.0 * random.normal(),
            -1000.0 + 0.01 * t + cosine + 0.5 * random.normal(),
            random.normal(),
        ];
        if missing.is_none_or(|missing| row % missing != missing - 1) {
            for (column, value) in columns.iter_mut().zip(values) {
                column.push(value);
            }
        }
    }
    if missing.is_some() {
        for value in columns[2].iter_mut().step_by(10) {
            *value = f64::NAN;
        }
    }
    let [t, first, second, third] = &columns;
    let folder = scratch();
    table::write(
        &folder.join(format!("{name}.csv.gz")),
        &[("t", t), ("first", first), ("second", second), ("third", third)],
    )
    .expect("writable");
    let sensor = |id: &str, kind: &str, unit: &str| {
        format!(
            "[[sensor]]\nid = \"{id}\"\nkind = \"{kind}\"\ncolumn = \"{id}\"\nunit = \"{unit}\"\naxis = [0.0, 0.0, 1.0]\n"
        )
    };
    let case = format!(
        "format = \"schuler-case/1\"\ntitle = \"{name}\"\n\
         [recording]\npath = \"{name}.csv.gz\"\ntime = \"t\"\nstep_s = 0.5\n\
         [site]\nlatitude_deg = 55.0\n\
         [motion]\nkind = \"static\"\nattitude_deg = {{ roll = 1.0, pitch = 2.0, heading = 3.0 }}\n{}{}{}",
        sensor("first", "fog", "deg/h"),
        sensor("second", "accelerometer", "mg"),
        sensor("third", "mems_gyro", "deg/s"),
    );
    let path = folder.join(format!("{name}.toml"));
    fs::write(&path, case).expect("writable");
    path
}

#[test]
fn fil_11_drawn_recordings_agree_with_the_oracle() {
    let identification = check("drawn", &drawn("drawn", 2400, None));
    let [first, second, third] = identification.sensors.as_slice() else { panic!("three sensors") };
    assert_ne!(first.structure.models[0].name, "white");
    assert!(second.structure.models[0].exp_cos.is_some(), "{}", second.structure.models[0].name);
    assert_eq!(second.structure.removed, "line");
    assert_eq!(third.structure.models[0].name, "white");
}

#[test]
fn fil_11_recordings_with_gaps_agree_with_the_oracle() {
    let identification = check("gaps", &drawn("gaps", 2400, Some(37)));
    assert_eq!(identification.rows, 2400);
    assert_eq!(identification.rows_in_gaps, 64);
}

#[test]
fn fil_11_long_recordings_agree_with_the_oracle() {
    let identification = check("long", &drawn("long", 50_000, None));
    assert_eq!(identification.sensors[0].structure.averaged_steps, 3);
}

#[test]
fn fil_11_real_recordings_agree_with_the_oracle() {
    let root =
        std::env::var_os("SCHULER_DATA").map_or_else(|| project().join("../shared/data"), PathBuf::from);
    let cases = [
        "mems_static/run1.toml",
        "mems_static/run2.toml",
        "mems_static/run3.toml",
        "quartz_gravimeter/segment_22h.toml",
        "quartz_gravimeter/segment_62h.toml",
    ];
    for case in cases {
        let path = root.join(case);
        if path.exists() {
            let name = case.replace('/', "_").replace(".toml", "");
            println!("{}", check(&name, &path));
        } else {
            eprintln!("SKIPPED: no real recording at {} (set SCHULER_DATA)", path.display());
        }
    }
}
