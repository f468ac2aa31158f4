//! `schuler simulate` and `schuler calibrate` from the outside, against the truth of the simulation.
use std::path::Path;
use std::process::{Command, Output};

use schuler_core::thermal::{CompensationBlock, Compensator};
use serde_json::Value;

fn schuler(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Simulates a scenario of the project with another seed and calibrates it; the answer, and what is told in words.
fn calibrated(scenario: &str, seed: &str, directory: &Path) -> (Value, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios").join(scenario);
    let run = directory.join("run");
    let simulated =
        schuler(&["simulate", path.to_str().unwrap(), "--out", run.to_str().unwrap(), "--seed", seed]);
    assert!(simulated.status.success(), "{}", text(&simulated.stderr));
    let case = run.join("case.toml");
    let out = directory.join("calibration");
    let arguments = ["calibrate", case.to_str().unwrap()];
    let json =
        schuler(&[&arguments[..], &["--json", "--out", out.to_str().unwrap(), "--plot", "svg"]].concat());
    assert!(json.status.success(), "{}", text(&json.stderr));
    assert_eq!(text(&json.stderr), "");
    for file in ["compensation.toml", "calibration.json", "coefficients.svg", "run.svg"] {
        assert!(out.join(file).exists(), "{file}");
    }
    (serde_json::from_slice(&json.stdout).unwrap(), text(&schuler(&arguments).stdout))
}

/// Errors of the coefficients in their sigmas, from the truth beside the case.
fn errors(answer: &Value) -> Vec<f64> {
    let rows = answer["coefficients"].as_array().unwrap();
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    rows.iter().map(|row| (number(row, "value") - number(row, "truth")) / number(row, "sigma")).collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// A complete unit with a thermometer of 1/16 K: 63 coefficients within their sigmas of the simulation's truth.
#[test]
fn tmp_12_simulated_unit_is_calibrated_end_to_end() {
    let directory = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    for seed in ["1", "2", "3"] {
        let (answer, words) = calibrated("calibration_run.toml", seed, directory.path());
        let errors = errors(&answer);
        assert_eq!(errors.len(), 63);
        println!("seed {seed}: error/sigma {:.3} rms, NIS {}", rms(&errors), answer["nis"]);
        assert!(errors.iter().all(|e| e.abs() < 4.0), "{errors:?}");
        assert!((answer["nis"].as_f64().unwrap() - 1.0).abs() < 0.02);
        assert_eq!(answer["undetermined"].as_array().unwrap().len(), 0);
        assert!(words.contains("every coefficient was determined"), "{words}");
        all.extend(errors);
    }
    let beyond = all.iter().filter(|e| e.abs() > 3.0).count() as f64 / all.len() as f64;
    println!("all: error/sigma {:.3} rms, beyond 3 sigma {:.2} %", rms(&all), 100.0 * beyond);
    assert!((0.85..=1.15).contains(&rms(&all)) && beyond <= 0.015, "{} {beyond}", rms(&all));
}

/// The compensation file is the block of the flight module: it takes the errors out of outputs made with the true ones.
#[test]
fn tmp_11_compensation_file_is_what_the_flight_module_corrects_with() {
    let directory = tempfile::tempdir().unwrap();
    let (answer, _) = calibrated("calibration_run.toml", "5", directory.path());
    let file = std::fs::read_to_string(directory.path().join("calibration/compensation.toml")).unwrap();
    let block: CompensationBlock = toml::from_str(&file).unwrap();
    Compensator::try_build(&block).expect("can be flown");
    for row in answer["coefficients"].as_array().unwrap() {
        let (element, feature) = (row["element"].as_str().unwrap(), row["feature"].as_str().unwrap());
        if (element, feature) == ("gyro y bias", "rate") {
            let per_hour = f64::to_radians(1.0) / 3600.0;
            let found = f64::from(block.gyro.bias[1][2]) / per_hour;
            assert!((found / row["value"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{found}");
            return;
        }
    }
    panic!("no rate coefficient of the second gyro");
}

/// Gyros against the table's angle. The thermometer's own error is not in the sigmas: with a table this good it adds up to
/// half to them.
#[test]
fn tmp_14_simulated_gyro_block_is_calibrated_end_to_end() {
    let directory = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    for seed in ["1", "2", "3"] {
        let (answer, _) = calibrated("calibration_gyro_block.toml", seed, directory.path());
        let errors = errors(&answer);
        assert_eq!(errors.len(), 36);
        println!("seed {seed}: error/sigma {:.3} rms, NIS {}", rms(&errors), answer["nis"]);
        all.extend(errors);
    }
    assert!(rms(&all) < 1.5 && all.iter().all(|e| e.abs() < 5.0), "{} {all:?}", rms(&all));
}

/// A linear ramp: rate and constant are one function of time. The run says so for every element, and gives no more than
/// the prior knows of their difference.
#[test]
fn tmp_12_what_a_ramp_cannot_determine_is_named_with_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let (answer, words) = calibrated("calibration_ramp.toml", "1", directory.path());
    let undetermined = answer["undetermined"].as_array().unwrap();
    assert_eq!(undetermined.len(), 21);
    for element in undetermined {
        let why = element["why"].as_str().unwrap();
        assert!(
            why.contains("constant") && why.contains("rate") && why.contains("dependent in cycle 1, 2, 3"),
            "{why}"
        );
    }
    for row in answer["coefficients"].as_array().unwrap() {
        let expected = if row["feature"] == "rate" { "Undetermined" } else { "Determined" };
        assert_eq!(row["determination"], expected, "{row}");
    }
    assert!(words.contains("a linear ramp, so its effect cannot be told from a constant"), "{words}");
    let beyond = errors(&answer).iter().filter(|e| e.abs() > 3.5).count();
    assert_eq!(beyond, 0, "the sigmas hold nevertheless");
}

#[test]
fn a_case_that_is_no_calibration_run_is_refused_with_the_field() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("case.toml");
    let sensor = |kind: &str, unit: &str, id: &str, axis: &str| {
        format!(
            "[[sensor]]\nid = \"{id}\"\nkind = \"{kind}\"\ncolumn = \"v\"\nunit = \"{unit}\"\naxis = {axis}\n[sensor.nominal]\nwhite = 1.0\n"
        )
    };
    let gyros: String = [("a", "[1, 0, 0]"), ("b", "[0, 1, 0]"), ("c", "[0, 0, 1]")]
        .iter()
        .map(|(id, axis)| sensor("fog", "deg/h", id, axis))
        .collect();
    let head = "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = 0.1\n[motion]\nkind = \"unknown\"\n";
    let site = "[site]\nlatitude_deg = 50.0\n";
    let cycle = "[calibration]\n[[calibration.cycle]]\naxis = \"x\"\nazimuth_deg = 0.0\nstart_s = 0.0\nend_s = 100.0\n";
    let aux = "[[aux]]\ncolumn = \"v\"\nquantity = \"temperature\"\nunit = \"degC\"\n";
    std::fs::write(directory.path().join("r.csv"), "t,v\n0,0\n0.1,1\n0.2,0\n0.3,1\n").unwrap();
    for (case, expected) in [
        (format!("{head}{gyros}"), "calibration: missing"),
        (format!("{head}{cycle}{gyros}"), "site: missing"),
        (format!("{head}{site}[calibration]\n{gyros}"), "calibration.cycle: missing"),
        (format!("{head}{site}{cycle}{gyros}{aux}"), "sensor: found 0 accelerometers"),
        (
            format!("{}{site}{cycle}{gyros}", head.replace("step_s = 0.1", "step_s = 1.0")),
            "recording.step_s: found 1",
        ),
        (
            format!("{head}{site}{}{gyros}", cycle.replace("100.0", "-100.0")),
            "calibration.cycle[0].end_s: found -100",
        ),
        (
            format!(
                "{head}{site}{cycle}[calibration.table]\ncolumn = \"v\"\nangle_arcsec = 5.0\nwobble_arcsec = 5.0\nmounting_arcsec = 5.0\nbase_arcsec = 5.0\n{gyros}{aux}"
            ),
            "calibration.cycle[0].end_s: found 0 to 100 s; expected times within the recording",
        ),
    ] {
        std::fs::write(&path, case).unwrap();
        let refused = schuler(&["calibrate", path.to_str().unwrap()]);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "{expected}: {said}");
    }
}
