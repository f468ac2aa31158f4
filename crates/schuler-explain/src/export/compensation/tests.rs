use std::path::Path;

use schuler_recording::CaseFile;

use super::*;
use crate::explanation::{Evidence, FORMAT, Fit, Verdict};

const CASE: &str = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 55.0
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 0.0 }
[[sensor]]
id = "gx"
kind = "dtg"
column = "gx"
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
spin_axis = [0.0, 0.0, 1.0]
group = "block"
[[sensor]]
id = "ay"
kind = "accelerometer"
column = "ay"
unit = "ug"
axis = [0.0, -1.0, 0.0]
  [sensor.nominal]
  temperature_bias = { column = "ta", reference_degC = 20.0, coefficients = [0.0] }
[[aux]]
column = "tg"
quantity = "temperature"
unit = "degC"
near = "gx"
position_m = [0.0, 0.0, 0.0]
[[aux]]
column = "ta"
quantity = "temperature"
unit = "degC"
near = "ay"
position_m = [0.0, 0.1, 0.0]
"#;

fn deployed(sensor: &str, effect: &str, value: f64, unit: &str, words: &[(&str, &str)]) -> Deployment {
    let name = format!("schuler-deploy-{}-{:?}", std::process::id(), std::thread::current().id());
    let directory = std::env::temp_dir().join(name.replace(['(', ')'], ""));
    std::fs::create_dir_all(&directory).unwrap();
    std::fs::write(directory.join("r.csv"), "t,gx,ay,tg,ta\n0,0,0,20,22\n1,0,0,21,22\n2,0,0,30,23\n")
        .unwrap();
    let file = CaseFile::parse(&directory.join(Path::new("case.toml")), CASE).unwrap();
    let recording = Recording::of_case(file).unwrap();
    std::fs::remove_dir_all(&directory).unwrap();
    let number = Parameter {
        name: "coefficient".into(),
        value: Some(value),
        unit: Some(unit.into()),
        ..Parameter::default()
    };
    let word = |(name, text): &(&str, &str)| Parameter {
        name: (*name).to_owned(),
        text: Some((*text).to_owned()),
        value: None,
        unit: None,
        ..number.clone()
    };
    let finding = Finding {
        sensor: sensor.into(),
        sensors: Vec::new(),
        effect: effect.into(),
        probability: 1.0,
        class: Vec::new(),
        interval_s: [0.0, 3.0],
        parameters: std::iter::once(number.clone()).chain(words.iter().map(word)).collect(),
        evidence: Evidence { gain_nats: 50.0, p_value: 1e-9 },
        share: None,
        impact: None,
        sentence: String::new(),
    };
    let mut finding = finding;
    if words.iter().any(|(name, _)| *name == "reference") {
        let at_mean =
            Parameter { name: AT_MEAN.into(), value: Some(0.5), unit: Some("deg/h".into()), ..number };
        finding.parameters.push(at_mean);
    }
    let explanation = Explanation {
        format: FORMAT,
        verdict: Verdict::Explained,
        findings: vec![finding],
        fit: Fit::default(),
        located: Vec::new(),
        remainder: None,
        explained_share: None,
        impact: None,
        noise: Vec::new(),
        certificate: Vec::new(),
        notes: Vec::new(),
    };
    let stations = Stations {
        gyros: vec![("gx".into(), 0)],
        accelerometers: vec![("ay".into(), 1)],
        thermometers: vec!["tg".into(), "ta".into()],
    };
    deploy(&explanation, &recording, &stations)
}

fn term(deployment: &Deployment) -> Term {
    assert_eq!(deployment.findings[0].because, None);
    deployment.block.terms[0]
}

#[test]
fn the_rate_of_the_own_thermometer_becomes_a_term_in_si() {
    let found = term(&deployed("gx", "bias_temperature_rate", 2.0, "deg/h/(K/h)", &[("column", "tg")]));
    let rate = Factor::from(Quantity::TemperatureRate(0));
    let coefficient = (2.0 * Unit::DegreePerHour.in_si() * 3600.0) as f32;
    let expected = Term { target: Target::Gyro(0), coefficient, factors: [rate, Factor::default()] };
    assert_eq!(found, expected);
    // Without a column, that near the sensor.
    assert_eq!(term(&deployed("gx", "bias_temperature_rate", 2.0, "deg/h/(K/h)", &[])), expected);
}

#[test]
fn a_reference_is_the_nominal_one_or_the_one_that_was_taken() {
    let nominal = term(&deployed("ay", "bias_temperature_sq", 1.0, "ug/K^2", &[("column", "ta")]));
    assert_eq!((nominal.factors[0].reference, nominal.factors[0].power), (20.0, 2));
    let taken = [("column", "tg"), ("reference", "23.67 degC, the mean")];
    let taken = deployed("gx", "bias_temperature", 1.0, "deg/h/K", &taken);
    assert_eq!(term(&taken).factors[0].reference, 23.67);
    // What it adds at that reference is a constant beside it.
    let constant = taken.block.terms[1];
    assert_eq!((taken.findings[0].terms, constant.factors), (2, [Factor::default(); 2]));
    assert_eq!(constant.coefficient, (0.5 * Unit::DegreePerHour.in_si()) as f32);
    let unknown = deployed("gx", "bias_temperature", 1.0, "deg/h/K", &[("column", "tg")]);
    assert!(unknown.findings[0].because.as_ref().unwrap().contains("vanishes"));
}

#[test]
fn axes_are_turned_into_those_of_the_sensors_that_measure_them() {
    // o = s × i = z × x = y, along which the accelerometer stands backwards.
    let found = term(&deployed("gx", "g_quadrature", 3.0, "deg/h/g", &[]));
    assert_eq!(found.factors[0].quantity, Quantity::SpecificForce(1));
    let expected = -3.0 * Unit::DegreePerHour.in_si() / STANDARD_GRAVITY;
    assert!((f64::from(found.coefficient) / expected - 1.0).abs() < 1e-6);
    let nobody = deployed("gx", "g_spin", 3.0, "deg/h/g", &[]);
    assert!(nobody.findings[0].because.as_ref().unwrap().contains("no accelerometer"));
}

#[test]
fn a_gradient_over_a_distance_becomes_a_difference() {
    let found =
        term(&deployed("gx", "bias_temperature_gradient", 5.0, "deg/h/(K/m)", &[("column", "ta - tg")]));
    assert_eq!(found.factors[0].quantity, Quantity::TemperatureDifference(1, 0));
    let expected = 5.0 * Unit::DegreePerHour.in_si() / 0.1;
    assert!((f64::from(found.coefficient) / expected - 1.0).abs() < 1e-6);
    // About the mean of the difference, with what it is there beside it.
    let about = [("column", "ta - tg"), ("reference", "0.25 K, the mean")];
    let about = deployed("gx", "bias_temperature_gradient", 5.0, "deg/h/(K/m)", &about);
    assert_eq!(term(&about).factors[0].reference, 0.25);
    let constant = about.block.terms[1];
    assert_eq!(
        (constant.factors, constant.coefficient),
        ([Factor::default(); 2], (0.5 * Unit::DegreePerHour.in_si()) as f32)
    );
}

#[test]
fn what_cannot_fly_says_why_and_the_validity_is_that_of_the_recording() {
    for (sensor, effect, expected) in [
        ("gx", "bias_step", "next flight"),
        ("gx", "noise_markov", "identifies"),
        ("block", "lever_arm", "motion"),
        ("block", "misalignment", "whole instrument"),
        ("nobody", "bias_constant", "no sensor"),
    ] {
        let found = deployed(sensor, effect, 1.0, "deg/h", &[]);
        let because = found.findings[0].because.clone().unwrap();
        assert!(because.contains(expected), "{effect}: {because}");
        assert!(found.block.terms.is_empty());
    }
    // A scale factor of 30 % is refused by the module.
    let wild = deployed("gx", "scale_factor", 3e5, "ppm", &[]);
    assert!(wild.findings[0].because.as_ref().unwrap().contains("refuse"));
    assert_eq!(wild.block.validity.temperature_range, [20.0, 30.0]);
    assert!(wild.block.validate().is_ok());
}

#[test]
fn units_of_the_answer_become_si() {
    let degree_per_hour = Unit::DegreePerHour.in_si();
    for (unit, expected) in [
        ("deg/h", degree_per_hour),
        ("deg/h/K", degree_per_hour),
        ("deg/h/(K/h)", degree_per_hour * 3600.0),
        ("deg/h/g", degree_per_hour / STANDARD_GRAVITY),
        ("deg/h/g/K", degree_per_hour / STANDARD_GRAVITY),
        ("ug/g^2", 1e-6 / STANDARD_GRAVITY),
        ("m/s^2", 1.0),
        ("m/s", 1.0),
        ("g", STANDARD_GRAVITY),
        ("ppm/K", 1e-6),
        ("arcsec", std::f64::consts::PI / 648_000.0),
    ] {
        let found = in_si(unit).unwrap();
        assert!((found / expected - 1.0).abs() < 1e-12, "{unit}: {found} {expected}");
    }
    assert_eq!(in_si("furlong"), None);
    assert_eq!(in_si("deg/h/V"), None);
}
