//! Sensors of kind "other", with and without a simulator that predicts them, on records whose truth is known.
use std::fmt::Write;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_recording::Recording;

const ROWS: usize = 3000;
const STEP_S: f64 = 0.01;

/// A case of columns beside the time, read from files as any other.
fn recorded(case: &str, columns: &[(&str, Vec<f64>)]) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let head = format!(
        "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = {STEP_S}\n"
    );
    std::fs::write(folder.path().join("case.toml"), head + case).unwrap();
    let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
    let mut table = format!("t,{}\n", names.join(","));
    for row in 0..ROWS {
        // Writing into a string cannot fail.
        let _ = write!(table, "{}", STEP_S * row as f64);
        for (_, values) in columns {
            write!(table, ",{}", values[row]).expect("a string can be written to");
        }
        table.push('\n');
    }
    std::fs::write(folder.path().join("r.csv"), table).unwrap();
    Recording::read(&folder.path().join("case.toml")).unwrap()
}

fn times() -> impl Iterator<Item = f64> {
    (0..ROWS).map(|row| STEP_S * row as f64)
}

fn noise(seed: u64, sigma: f64) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    (0..ROWS).map(|_| sigma * Distribution::<f64>::sample(&StandardNormal, &mut random)).collect()
}

fn sum(parts: &[&[f64]]) -> Vec<f64> {
    (0..ROWS).map(|row| parts.iter().map(|part| part[row]).sum()).collect()
}

fn said(recording: &Recording) -> Explanation {
    explain(recording, &Config::default()).unwrap()
}

fn text<'f>(finding: &'f Finding, name: &str) -> Option<&'f str> {
    finding.parameters.iter().find(|it| it.name == name)?.text.as_deref()
}

/// The value of a parameter is within four standard deviations of the truth, and these are small beside it.
fn agrees(finding: &Finding, name: &str, truth: f64, unit: &str) {
    let parameter = finding.parameters.iter().find(|it| it.name == name).unwrap();
    let (value, sigma) = (parameter.value.unwrap(), parameter.sigma.unwrap());
    assert!(
        (value - truth).abs() < 4.0 * sigma && sigma < 0.1 * truth.abs(),
        "{value} ± {sigma} for {truth}"
    );
    assert_eq!(parameter.unit.as_deref(), Some(unit));
}

/// The one finding that is physics.
fn the_physics(explanation: &Explanation) -> &Finding {
    let physics: Vec<&Finding> =
        explanation.findings.iter().filter(|it| !it.effect.starts_with("noise_")).collect();
    let named: Vec<&str> = physics.iter().map(|it| it.sentence.as_str()).collect();
    assert_eq!(physics.len(), 1, "{named:?}");
    physics[0]
}

#[test]
fn friction_that_a_model_of_a_torque_lacks_is_found_with_its_sign() {
    let velocity: Vec<f64> = times().map(|t| 2.0 * (1.3 * t).sin() + 0.8 * (0.41 * t).cos()).collect();
    let model: Vec<f64> = times().map(|t| 3.0 * (0.7 * t).sin() - 2.6 * (1.3 * t).cos()).collect();
    let friction: Vec<f64> = velocity.iter().map(|v| 0.08 * v.signum()).collect();
    let torque = sum(&[&model, &friction, &noise(7, 0.03)]);
    let case = "[[sensor]]\nid = \"torque\"\nkind = \"other\"\ncolumn = \"torque\"\nunit = \"N m\"\n\
                predicted = \"model\"\n[sensor.nominal]\nwhite = 0.03\n\
                [[aux]]\ncolumn = \"velocity\"\nquantity = \"other\"\nunit = \"rad/s\"\n";
    let recording = recorded(case, &[("torque", torque), ("model", model), ("velocity", velocity)]);
    let explanation = said(&recording);
    let finding = the_physics(&explanation);
    assert_eq!((finding.effect.as_str(), text(finding, "column")), ("bias_on_aux", Some("velocity")));
    assert_eq!(text(finding, "function"), Some("sign"));
    agrees(finding, "coefficient", 0.08, "N m");
    assert!(finding.sentence.contains("follows the sign of velocity"), "{}", finding.sentence);
}

#[test]
fn a_scale_is_found_on_what_a_simulator_predicts() {
    let model: Vec<f64> = times().map(|t| 40.0 * (0.7 * t).sin() + 12.0 * (2.9 * t).cos()).collect();
    let larger: Vec<f64> = model.iter().map(|value| 1.004 * value).collect();
    let current = sum(&[&larger, &noise(11, 0.2)]);
    let case = "[[sensor]]\nid = \"i\"\nkind = \"other\"\ncolumn = \"i\"\nunit = \"A\"\npredicted = \"model\"\n\
                [sensor.nominal]\nwhite = 0.2\n";
    let recording = recorded(case, &[("i", current), ("model", model)]);
    let explanation = said(&recording);
    let finding = the_physics(&explanation);
    assert_eq!(finding.effect, "scale_factor");
    agrees(finding, "coefficient", 4000.0, "ppm");
}

#[test]
fn a_sensor_without_a_prediction_is_read_against_an_unknown_level() {
    let temperature: Vec<f64> = times().map(|t| 20.0 + 0.3 * t + 2.0 * (0.4 * t).sin()).collect();
    let drift: Vec<f64> = temperature.iter().map(|t| 101.3 + 0.02 * t).collect();
    let pressure = sum(&[&drift, &noise(5, 0.05)]);
    let case = "[[sensor]]\nid = \"p\"\nkind = \"other\"\ncolumn = \"p\"\nunit = \"kPa\"\n[sensor.nominal]\n\
                white = 0.05\n[[aux]]\ncolumn = \"temp\"\nquantity = \"temperature\"\nunit = \"degC\"\n";
    let recording = recorded(case, &[("p", pressure), ("temp", temperature)]);
    let explanation = said(&recording);
    // A square about a reference that is far away is a straight line as well, and has as much evidence.
    assert!(
        the_physics(&explanation).effect.starts_with("bias_temperature"),
        "{}",
        the_physics(&explanation).sentence
    );
    let notes = explanation.notes;
    assert!(notes.join("\n").contains("p: its level is not told"), "{notes:?}");
}

#[test]
fn nothing_is_found_where_only_noise_is_left_out() {
    let model: Vec<f64> = times().map(|t| (0.7 * t).sin()).collect();
    let velocity: Vec<f64> = times().map(|t| (1.7 * t).cos()).collect();
    let torque = sum(&[&model, &noise(3, 0.01)]);
    let case = "[[sensor]]\nid = \"torque\"\nkind = \"other\"\ncolumn = \"torque\"\nunit = \"N m\"\n\
                predicted = \"model\"\n[sensor.nominal]\nwhite = 0.01\n\
                [[aux]]\ncolumn = \"velocity\"\nquantity = \"other\"\nunit = \"rad/s\"\n";
    let recording = recorded(case, &[("torque", torque), ("model", model), ("velocity", velocity)]);
    let explanation = said(&recording);
    let named: Vec<&str> = explanation.findings.iter().map(|it| it.sentence.as_str()).collect();
    assert!(named.is_empty(), "{named:?}");
}
