//! The case format to the letter: every key is read, every default holds, every mistake is named.
use std::path::Path;

use schuler_recording::case::{
    Attitude, ExponentialCosine, Markov, MotionKind, Nominal, Quantity, SensorKind, Site, TemperatureBias,
    TimeUnit,
};
use schuler_recording::unit::Unit;
use schuler_recording::{Case, CaseFile, Error, Leniency};

/// The format's own example, with every key that it shows.
const FULL: &str = r#"
format = "schuler-case/1"
title  = "Rate table, DTG block 3, run 17"

[recording]
path   = "recording.csv"     # relative to this file
time   = "t"
step_s = 1.0
switched_on_s = [600.0, 7200.0]

[site]
latitude_deg = 55.57
altitude_m   = 150.0

[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 30.0 }
rate = ["ref_wx", "ref_wy", "ref_wz"]
specific_force = ["ref_fx", "ref_fy", "ref_fz"]
velocity_ned = ["vn", "ve", "vd"]
attitude_rad = ["roll", "pitch", "yaw"]

[[sensor]]
id     = "gyro_x"
kind   = "dtg"
column = "gyro_x"
unit   = "deg/h"
axis   = [1.0, 0.0, 0.0]
group  = "block_3"
spin_axis = [0.0, 0.0, 1.0]
quantisation = 0.25
relative = true
grade = "navigation"

  [sensor.nominal]
  bias = 0.35
  scale_factor_ppm = 12.0
  white = 0.02
  markov = { sigma = 0.05, tau_s = 900.0 }
  exp_cos = { sigma = 0.05, alpha = 0.002, beta = 0.01 }
  random_walk = 0.5
  temperature_bias = { column = "temp_x", reference_degC = 20.0, coefficients = [0.01, 0.002] }

[[aux]]
column   = "temp_x"
quantity = "temperature"
unit     = "degC"
near     = "gyro_x"
position_m = [0.02, 0.0, 0.01]
"#;

const LEAST: &str = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
[[sensor]]
id = "v"
kind = "gnss_velocity"
column = "v"
unit = "m/s"
"#;

fn read(text: &str) -> Result<CaseFile, Error> {
    CaseFile::parse(Path::new("cases/case.toml"), text)
}

fn problem(text: &str) -> String {
    format!("{:#}", read(text).expect_err("a case with a mistake"))
}

/// `FULL` with the first occurrence of `from` replaced, and the line of the replacement.
fn changed(from: &str, to: &str) -> (String, usize) {
    let at = FULL.find(from).unwrap_or_else(|| panic!("{from} is not in the example"));
    let line = FULL[..at].matches('\n').count() + 1;
    (FULL.replacen(from, to, 1), line)
}

#[test]
fn every_key_is_read() {
    let file = read(FULL).unwrap();
    assert!(file.warnings.is_empty(), "{:?}", file.warnings);
    assert_eq!(file.table_path(), Path::new("cases/recording.csv"));
    let case = file.case;
    assert_eq!(case.title, "Rate table, DTG block 3, run 17");
    assert_eq!((case.recording.time.as_deref(), case.recording.step_s), (Some("t"), Some(1.0)));
    assert_eq!(case.site, Some(Site { latitude_deg: 55.57, longitude_deg: None, altitude_m: 150.0 }));
    assert_eq!(case.motion.kind, MotionKind::Static);
    assert_eq!(case.motion.attitude_deg, Some(Attitude { roll: 0.0, pitch: 0.0, heading: 30.0 }));
    assert_eq!(case.motion.rate.unwrap()[2], "ref_wz");
    assert_eq!(case.motion.specific_force.unwrap()[0], "ref_fx");
    assert_eq!(case.motion.velocity_ned.unwrap()[1], "ve");
    assert_eq!(case.motion.attitude_rad.unwrap()[2], "yaw");
    let sensor = &case.sensors[0];
    assert_eq!(
        (sensor.id.as_str(), sensor.kind, sensor.unit),
        ("gyro_x", SensorKind::Dtg, Unit::DegreePerHour)
    );
    assert_eq!((sensor.axis, sensor.spin_axis), (Some([1.0, 0.0, 0.0]), Some([0.0, 0.0, 1.0])));
    assert_eq!(
        (sensor.group.as_deref(), sensor.quantisation, sensor.relative),
        (Some("block_3"), 0.25, true)
    );
    let expected = Nominal {
        bias: 0.35,
        scale_factor_ppm: 12.0,
        white: 0.02,
        markov: Some(Markov { sigma: 0.05, tau_s: 900.0 }),
        exp_cos: Some(ExponentialCosine { sigma: 0.05, alpha: 0.002, beta: 0.01 }),
        random_walk: 0.5,
        temperature_bias: Some(TemperatureBias {
            column: "temp_x".into(),
            reference_deg_c: 20.0,
            coefficients: vec![0.01, 0.002],
        }),
    };
    assert_eq!(sensor.nominal, expected);
    let auxiliary = &case.auxiliaries[0];
    assert_eq!((auxiliary.quantity, auxiliary.unit.as_str()), (Quantity::Temperature, "degC"));
    assert_eq!((auxiliary.near.as_deref(), auxiliary.position_m), (Some("gyro_x"), Some([0.02, 0.0, 0.01])));
}

#[test]
fn nominal_values_are_converted_with_their_sensor() {
    let sensor = read(FULL).unwrap().case.sensors[0].in_si();
    let deg_h = std::f64::consts::PI / 648_000.0;
    let near = |a: f64, b: f64| assert!((a - b).abs() <= 1e-15 * b.abs(), "{a} {b}");
    assert_eq!(sensor.unit, Unit::RadianPerSecond);
    near(sensor.quantisation, 0.25 * deg_h);
    near(sensor.nominal.bias, 0.35 * deg_h);
    near(sensor.nominal.white, 0.02 * deg_h);
    near(sensor.nominal.random_walk, 0.5 * deg_h);
    near(sensor.nominal.scale_factor_ppm, 12.0);
    let (markov, exp_cos) = (sensor.nominal.markov.unwrap(), sensor.nominal.exp_cos.unwrap());
    near(markov.sigma, 0.05 * deg_h);
    near(markov.tau_s, 900.0);
    near(exp_cos.sigma, 0.05 * deg_h);
    near(exp_cos.alpha, 0.002);
    near(exp_cos.beta, 0.01);
    near(sensor.nominal.temperature_bias.unwrap().coefficients[1], 0.002 * deg_h);
}

#[test]
fn optional_keys_have_defaults() {
    let case = read(LEAST).unwrap().case;
    assert_eq!(case.title, "");
    assert_eq!((case.site, case.recording.step_s), (None, None));
    assert_eq!(case.motion.kind, MotionKind::Unknown);
    let sensor = &case.sensors[0];
    assert_eq!((sensor.quantisation, sensor.relative), (0.0, false));
    assert_eq!(sensor.nominal, Nominal::default());
    assert!(case.auxiliaries.is_empty());
}

#[test]
fn the_loop_is_read_and_required_for_velocity_errors() {
    let text = LEAST.replace("gnss_velocity", "ins_velocity");
    let with_motion = text.replace("[[sensor]]", "[motion]\nkind = \"velocity_error\"\n[[sensor]]");
    assert!(problem(&with_motion).contains("loop: missing"), "{}", problem(&with_motion));
    let looped = with_motion.replace(
        "[[sensor]]",
        "[loop]\nradius_m = 6378e3\ngravity = 9.81\naccelerometer = { sigma = 1e-3, tau_s = 60 }\n\
         gyro = { sigma = 5e-7, tau_s = 1800 }\nvelocity_white = 0.1\n[[sensor]]",
    );
    let schuler_loop = read(&looped).unwrap().case.schuler_loop.unwrap();
    assert_eq!(
        (schuler_loop.radius_m, schuler_loop.gravity, schuler_loop.velocity_white),
        (6378e3, 9.81, 0.1)
    );
    assert_eq!(schuler_loop.accelerometer, Some(Markov { sigma: 1e-3, tau_s: 60.0 }));
    assert_eq!(schuler_loop.gyro, Some(Markov { sigma: 5e-7, tau_s: 1800.0 }));
    let heated = format!(
        "{looped}\n[[aux]]\ncolumn = \"T\"\nquantity = \"temperature\"\nunit = \"degC\"\nnear = \"gyro\"\n"
    );
    assert!(read(&heated).unwrap().warnings.is_empty(), "a thermometer at the loop's gyro");
    let wrong_sensor = looped.replace("ins_velocity", "gnss_velocity");
    assert!(problem(&wrong_sensor).contains("motion.kind"), "{}", problem(&wrong_sensor));
}

#[test]
fn a_part_of_a_recording_keeps_its_times_of_switching_on() {
    let mut source = read(FULL).unwrap().case.recording;
    assert_eq!(source.switched_on_s, Some(vec![600.0, 7200.0]));
    source.time_unit = Some(TimeUnit::Millisecond);
    source.keep_switching_on([600e3, 7199e3]);
    assert_eq!(source.switched_on_s, Some(vec![600.0]));
}

#[test]
fn written_cases_read_back_the_same() {
    for text in [FULL, LEAST] {
        let case: Case = read(text).unwrap().case;
        let written = case.to_toml().unwrap();
        let read_back = read(&written).unwrap_or_else(|error| panic!("{error:#}\n{written}"));
        assert_eq!(read_back.case, case, "{written}");
        assert!(read_back.warnings.is_empty());
    }
}

#[test]
fn mistakes_are_named_by_line_field_and_expectation() {
    let cases = [
        ("schuler-case/1", "schuler-case/2", "format: found \"schuler-case/2\"; expected \"schuler-case/1\""),
        (
            "latitude_deg = 55.57",
            "latitude = 55.57",
            "site.latitude: unknown key; did you mean `latitude_deg`?",
        ),
        (
            "latitude_deg = 55.57",
            "latitude_deg = 91",
            "site.latitude_deg: found 91; expected degrees, -90 to 90",
        ),
        ("step_s = 1.0", "step_s = 0", "recording.step_s: found 0; expected a number greater than zero"),
        ("kind = \"static\"", "kind = \"sttic\"", "did you mean \"static\"?"),
        ("kind   = \"dtg\"", "kind = \"dgt\"", "sensor[0].kind: found \"dgt\"; expected one of dtg, fog"),
        (
            "unit   = \"deg/h\"",
            "unit = \"mg\"",
            "expected a unit of a sensor of kind \"dtg\": rad/s, deg/s, deg/h",
        ),
        ("axis   = [1.0, 0.0, 0.0]", "axis = [0, 0, 0]", "sensor[0].axis: found a direction of length zero"),
        (
            "axis   = [1.0, 0.0, 0.0]",
            "axis = [1, 0]",
            "sensor[0].axis: found an array of 2; expected an array of 3",
        ),
        ("quantisation = 0.25", "quantization = 0.25", "unknown key; did you mean `quantisation`?"),
        ("white = 0.02", "white = -0.02", "sensor[0].nominal.white: found -0.02; expected a number not less"),
        ("white = 0.02", "white = inf", "sensor[0].nominal.white: found inf"),
        ("tau_s = 900.0", "tau = 900.0", "sensor[0].nominal.markov.tau: unknown key; did you mean `tau_s`?"),
        (
            "near     = \"gyro_x\"",
            "near = \"gyr_x\"",
            "aux[0].near: found \"gyr_x\"; expected the id or group",
        ),
        ("quantity = \"temperature\"", "quantity = \"temp\"", "did you mean \"temperature\"?"),
        (
            "relative = true",
            "relative = \"yes\"",
            "sensor[0].relative: found \"yes\"; expected true or false",
        ),
        (
            "grade = \"navigation\"",
            "grade = \"tactial\"",
            "sensor[0].grade: found \"tactial\"; expected one of navigation, tactical, mems; did you mean \"tactical\"?",
        ),
        ("title  = \"Rate", "title = Rate", "not TOML"),
    ];
    for (from, to, expected) in cases {
        let (text, line) = changed(from, to);
        let message = problem(&text);
        let at = format!("cases/case.toml:{line}: ");
        assert!(message.lines().any(|said| said.starts_with(&at) && said.contains(expected)), "{message}");
    }
}

#[test]
fn all_mistakes_are_reported_at_once() {
    let text = FULL.replace("white = 0.02", "white = -1").replace("tau_s = 900.0", "tau_s = 0");
    let error = read(&text).unwrap_err();
    assert_eq!(error.problems.len(), 2, "{error:#}");
    assert!(error.to_string().ends_with("(and 1 more)"), "{error}");
}

#[test]
fn unknown_keys_are_mistakes_unless_read_leniently_and_long_axes_are_warnings() {
    let text = FULL
        .replace("[site]", "[weather]\nwind = 3\n[site]")
        .replace("axis   = [1.0, 0.0, 0.0]", "axis = [0, 3, 4]");
    let said = problem(&text);
    assert!(said.contains("weather: unknown key; expected one of format, title, recording"), "{said}");
    let file = CaseFile::parse_with("case.toml".as_ref(), &text, Leniency::Lenient).unwrap();
    assert_eq!(file.case.sensors[0].axis, Some([0.0, 0.6, 0.8]));
    assert_eq!(file.warnings.len(), 2, "{:?}", file.warnings);
}

#[test]
fn two_sensors_with_one_id_are_a_mistake() {
    let sensor = LEAST.split_once("[[sensor]]").unwrap().1;
    let message = problem(&format!("{LEAST}[[sensor]]{sensor}"));
    assert!(message.contains("case.toml:12: sensor[1].id: found \"v\", the id of sensor[0]"), "{message}");
}
