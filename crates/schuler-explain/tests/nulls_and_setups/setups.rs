//! What is simply wrong in a case, and readings that are repeated.
use std::f64::consts::TAU;
use std::fmt::Write;

use rand::SeedableRng;
use rand_pcg::Pcg64;
use schuler_explain::explanation::Explanation;

use crate::turning::{STEP_S, Turning, WHITE, rate};
use crate::{delay_of, explained, normal, only, physics};

#[test]
fn what_is_simply_wrong_is_named_before_any_effect() {
    type Reads = fn(usize, f64) -> f64;
    let all: [(&str, &str, Reads); 7] = [
        ("gz", "sign_flipped", |axis, time_s| if axis == 2 { -rate(2, time_s) } else { rate(axis, time_s) }),
        ("imu", "sign_flipped", |axis, time_s| -rate(axis, time_s)),
        ("imu", "axes_swapped", |axis, time_s| rate([1, 0, 2][axis], time_s)),
        ("imu", "unit_mistaken", |axis, time_s| rate(axis, time_s).to_degrees()),
        // Counts, of all and of one; a factor of no list.
        ("imu", "unit_mistaken", |axis, time_s| 16.4 * rate(axis, time_s).to_degrees()),
        (
            "gy",
            "unit_mistaken",
            |axis, time_s| if axis == 1 { 131.0 * rate(1, time_s) } else { rate(axis, time_s) },
        ),
        ("imu", "unit_mistaken", |axis, time_s| 0.02 * rate(axis, time_s)),
    ];
    for (sensor, effect, reads) in all {
        let explanation = Turning { reads, ..Turning::default() }.explained(0.0);
        assert_eq!(only(&explanation), (sensor, effect));
    }
}

/// Three accelerometers at rest whose specific force, m/s², is said to be that of a level body: [0, 0, −g].
fn at_rest(force: [f64; 3]) -> Explanation {
    let mut random = Pcg64::seed_from_u64(3);
    let mut table = String::from("t,ax,ay,az\n");
    for row in 0..2000_u32 {
        let [x, y, z] = force.map(|force| force + 0.02 * normal(&mut random));
        writeln!(table, "{:.2},{x:.5},{y:.5},{z:.5}", STEP_S * f64::from(row))
            .expect("a string can be written to");
    }
    let sensor = |id: &str, axis: &str| {
        format!(
            "[[sensor]]\nid = \"{id}\"\nkind = \"accelerometer\"\ncolumn = \"{id}\"\nunit = \"m/s^2\"\ngroup = \"imu\"\n\
             grade = \"mems\"\naxis = {axis}\n[sensor.nominal]\nwhite = 0.02\n"
        )
    };
    let case = format!(
        "format = \"schuler-case/1\"\ntitle = \"At rest\"\n\
         recording = {{ path = \"recording.csv\", time = \"t\", step_s = {STEP_S} }}\n\
         site = {{ latitude_deg = 47.0, altitude_m = 400.0 }}\n\
         motion = {{ kind = \"static\", attitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 0.0 }} }}\n{}{}{}",
        sensor("ax", "[1.0, 0.0, 0.0]"),
        sensor("ay", "[0.0, 1.0, 0.0]"),
        sensor("az", "[0.0, 0.0, 1.0]")
    );
    explained(&table, &case)
}

#[test]
fn what_is_simply_wrong_at_rest_is_named_before_any_effect() {
    let g = 9.8071;
    // z up; without gravity; in g; counts of 4096 in one g.
    for (force, sensors, effect) in [
        ([0.0, 0.0, g], ["az", "imu"], "sign_flipped"),
        ([0.0, 0.0, 0.0], ["az", "imu"], "gravity_removed"),
        ([0.0, 0.0, -1.0], ["az", "imu"], "unit_mistaken"),
        ([0.0, 0.0, -4096.0], ["az", "imu"], "unit_mistaken"),
    ] {
        let explanation = at_rest(force);
        let told: Vec<(&str, &str)> =
            physics(&explanation).iter().map(|it| (it.sensor.as_str(), it.effect.as_str())).collect();
        let [(sensor, found)] = told.as_slice() else { panic!("{effect}: {told:?}") };
        assert!(sensors.contains(sensor) && *found == effect, "{effect}: {told:?}");
    }
}

/// A gyro whose scale is off, two that share a line, and noise that grows: told alike whichever the case lists first.
#[test]
fn findings_do_not_depend_on_the_order_of_the_sensors() {
    let reads = |axis: usize, time_s: f64| {
        let line = if axis == 2 { 0.0 } else { 0.0008 * (TAU * 7.3 * time_s).sin() };
        rate(axis, time_s) * if axis == 1 { 1.004 } else { 1.0 } + line
    };
    let told = |order: [usize; 3]| {
        let explanation = Turning { reads, order, ..Turning::default() }.explained(0.0);
        let mut told: Vec<(String, String, Vec<f64>)> = (explanation.findings.into_iter())
            .map(|it| {
                let mut sensors: Vec<&str> = it.sensor.split(", ").collect();
                sensors.sort_unstable();
                let mut values: Vec<f64> = it.parameters.iter().filter_map(|it| it.value).collect();
                values.sort_by(f64::total_cmp);
                (sensors.join(", "), it.effect, values)
            })
            .collect();
        told.sort_by(|a, b| (&a.0, &a.1).cmp(&(&b.0, &b.1)));
        told
    };
    let first = told([0, 1, 2]);
    assert!(first.len() >= 2, "{first:#?}");
    for order in [[2, 0, 1], [1, 2, 0], [2, 1, 0]] {
        let other = told(order);
        assert_eq!(first.len(), other.len(), "{order:?}: {first:#?} {other:#?}");
        for (one, other) in first.iter().zip(&other) {
            assert_eq!((&one.0, &one.1), (&other.0, &other.1), "{order:?}");
            assert!(
                one.2.iter().zip(&other.2).all(|(a, b)| (a - b).abs() <= 1e-3 * a.abs()),
                "{one:?} {other:?}"
            );
        }
    }
}

#[test]
fn noise_in_a_mistaken_unit_is_no_other_noise() {
    let reads = |axis: usize, time_s: f64| rate(axis, time_s).to_degrees();
    let explanation = Turning { reads, white: |_| WHITE.to_degrees(), ..Turning::default() }.explained(0.0);
    let told: Vec<&str> = explanation.findings.iter().map(|it| it.effect.as_str()).collect();
    assert_eq!(told, ["unit_mistaken"]);
}

#[test]
fn a_late_instrument_in_another_unit_is_both() {
    let reads = |axis: usize, time_s: f64| rate(axis, time_s).to_degrees();
    let explanation = Turning { reads, white: |_| WHITE.to_degrees(), ..Turning::default() }.explained(0.04);
    let mut told: Vec<&str> = physics(&explanation).iter().map(|it| it.effect.as_str()).collect();
    told.sort_unstable();
    assert_eq!(told, ["time_delay", "unit_mistaken"]);
    let (value, sigma) = delay_of(&explanation);
    assert!((value - 0.04).abs() < 4.0 * sigma, "{value} ± {sigma}");
}

#[test]
fn readings_that_are_repeated_again_and_again_are_stuck() {
    // Eleven rows every two seconds and a half.
    let shown = |row: u32| if row % 250 < 11 { row - row % 250 } else { row };
    let explanation = Turning { shown, ..Turning::default() }.explained(0.0);
    let told: Vec<&str> = explanation.findings.iter().map(|it| it.effect.as_str()).collect();
    assert_eq!(told, ["output_stuck"; 3]);
    for finding in &explanation.findings {
        let count = finding.parameters.iter().find(|it| it.name == "count").and_then(|it| it.value);
        assert_eq!(count, Some(24.0));
    }
}

#[test]
fn a_change_of_the_white_level_is_told_with_its_time() {
    let white = |row: u32| if row < 2500 { WHITE } else { 1.3 * WHITE };
    let explanation = Turning { white, ..Turning::default() }.explained(0.0);
    assert!(physics(&explanation).is_empty(), "{:#?}", explanation.findings);
    let told: Vec<&str> = explanation.findings.iter().map(|it| it.effect.as_str()).collect();
    assert_eq!(told, ["noise_variance_step"; 3]);
    for finding in &explanation.findings {
        let value = |name: &str| {
            finding.parameters.iter().find(|it| it.name == name).and_then(|it| it.value).expect("a value")
        };
        assert!((value("onset_s") - 25.0).abs() < 1.5, "{finding:#?}");
        assert!((value("ratio") - 1.3).abs() < 0.06, "{finding:#?}");
    }
}
