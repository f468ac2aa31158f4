//! References that are not ideal: held, smoothed, of another unit, noisy, set anew.
use std::f64::consts::TAU;
use std::fmt::Write;

use rand::SeedableRng;
use rand_pcg::Pcg64;
use schuler_explain::explanation::Explanation;

use crate::turning::{STEP_S, Turning, WHITE, true_rate};
use crate::{delay_of, explained, normal, only, physics};

#[test]
fn a_reference_that_is_held_shows_the_delay_of_the_sensors() {
    let reference = |axis: usize, row: u32| true_rate(axis, row / 5 * 5);
    let explanation = Turning { reference, ..Turning::default() }.explained(0.027);
    assert_eq!(only(&explanation), ("imu", "time_delay"));
    let (value, sigma) = delay_of(&explanation);
    assert!((value - 0.027).abs() < 4.0 * sigma, "{value} ± {sigma}");
    assert!(explanation.notes.iter().any(|note| note.contains("held")), "{:?}", explanation.notes);
}

#[test]
fn a_smoothed_reference_is_no_scale_factor() {
    // The mean of a row with those two rows before and after it loses sin² ωT of a tone.
    let reference = |axis: usize, row: u32| {
        (true_rate(axis, row.saturating_sub(2)) + 2.0 * true_rate(axis, row) + true_rate(axis, row + 2)) / 4.0
    };
    let explanation = Turning { reference, ..Turning::default() }.explained(0.0);
    let told = physics(&explanation);
    assert!(!told.is_empty() && told.iter().all(|it| it.effect == "reference_noise"), "{told:#?}");
}

/// A gyro along an axis of a body that turns about it, beside an attitude.
struct BesideAttitude {
    /// Standard deviation of the recorded angles, rad.
    noise: f64,
    /// What the recorded angle is more than the true one at a time.
    off: fn(f64) -> f64,
}

impl BesideAttitude {
    fn explained(&self) -> Explanation {
        let tones = [(0.31, 0.5), (1.0, 0.05), (1.7, 0.02)];
        let mut random = Pcg64::seed_from_u64(11);
        let mut table = String::from("t,gz,roll,pitch,yaw\n");
        for row in 0..6000_u32 {
            let time_s = STEP_S * f64::from(row);
            let phase = |frequency_hz: f64| TAU * frequency_hz * time_s;
            let yaw: f64 = tones.iter().map(|(frequency_hz, size)| size * phase(*frequency_hz).sin()).sum();
            let of_tone =
                |(frequency_hz, size): &(f64, f64)| size * TAU * frequency_hz * phase(*frequency_hz).cos();
            let rate: f64 = tones.iter().map(of_tone).sum();
            let reading = rate + WHITE * normal(&mut random);
            let recorded = yaw + (self.off)(time_s) + self.noise * normal(&mut random);
            writeln!(table, "{time_s:.2},{reading:.7},0,0,{recorded:.9}")
                .expect("a string can be written to");
        }
        let case = format!(
            "format = \"schuler-case/1\"\ntitle = \"Beside an attitude\"\n\
             recording = {{ path = \"recording.csv\", time = \"t\", step_s = {STEP_S} }}\n\
             site = {{ latitude_deg = 0.0, altitude_m = 0.0 }}\n\
             motion = {{ kind = \"recorded\", attitude_rad = [\"roll\", \"pitch\", \"yaw\"] }}\n\
             [[sensor]]\nid = \"gz\"\nkind = \"mems_gyro\"\ncolumn = \"gz\"\nunit = \"rad/s\"\naxis = [0.0, 0.0, 1.0]\n\
             [sensor.nominal]\nwhite = {WHITE}\n"
        );
        explained(&table, &case)
    }
}

#[test]
fn noise_of_a_reference_is_no_physics_of_the_gyro() {
    for noise in [0.0, 3e-6, 1e-5, 3e-5] {
        let explanation = BesideAttitude { noise, off: |_| 0.0 }.explained();
        let told = physics(&explanation);
        assert!(told.iter().all(|it| it.effect == "reference_noise"), "{noise} rad: {told:#?}");
        if noise == 0.0 {
            assert!(explanation.findings.is_empty(), "{noise} rad: {:#?}", explanation.findings);
        }
    }
}

#[test]
fn a_heading_that_is_set_anew_is_no_physics_of_the_gyro() {
    let explanation =
        BesideAttitude { noise: 0.0, off: |time_s| if time_s < 25.3 { 0.0 } else { 0.02 } }.explained();
    let told = physics(&explanation);
    assert!(told.is_empty(), "{told:#?}");
    let said = "the reference's attitude is set anew at 25.300 s";
    assert!(explanation.notes.iter().any(|note| note.contains(said)), "{:?}", explanation.notes);
}

#[test]
fn a_heading_that_is_off_by_a_constant_is_none_of_the_rate() {
    let explanation = BesideAttitude { noise: 0.0, off: |_| 0.4 }.explained();
    assert!(explanation.findings.is_empty(), "{:#?}", explanation.findings);
}

/// A velocity log beside an attitude whose heading is off by so much, rad.
fn beside_heading(off: f64) -> Explanation {
    let mut random = Pcg64::seed_from_u64(5);
    let mut table = String::from("t,forward,right,down,vn,ve,vd,roll,pitch,yaw\n");
    for row in 0..1500_u32 {
        let time_s = 0.5 * f64::from(row);
        let heading = 0.8 * (0.02 * time_s).sin() + 0.5 * (0.11 * time_s).sin() + 0.01 * time_s;
        let (sin, cos) = heading.sin_cos();
        let body =
            [1.5 + 0.6 * (0.05 * time_s).sin(), 0.1 * (0.3 * time_s).sin(), 0.05 * (0.2 * time_s).sin()];
        let [forward, right, down] = body.map(|velocity| velocity + 0.005 * normal(&mut random));
        let (north, east) = (body[0] * cos - body[1] * sin, body[0] * sin + body[1] * cos);
        let told = heading + off;
        writeln!(
            table,
            "{time_s},{forward:.6},{right:.6},{down:.6},{north:.9},{east:.9},{:.9},0,0,{told:.9}",
            body[2]
        )
        .expect("a string can be written to");
    }
    let sensor = |id: &str, axis: &str| {
        format!(
            "[[sensor]]\nid = \"{id}\"\nkind = \"doppler\"\ncolumn = \"{id}\"\nunit = \"m/s\"\ngroup = \"log\"\n\
             axis = {axis}\n[sensor.nominal]\nwhite = 0.005\n"
        )
    };
    let case = format!(
        "format = \"schuler-case/1\"\ntitle = \"Beside a heading\"\n\
         recording = {{ path = \"recording.csv\", time = \"t\", step_s = 0.5 }}\n\
         site = {{ latitude_deg = 50.0, altitude_m = 0.0 }}\n\
         motion = {{ kind = \"recorded\", attitude_rad = [\"roll\", \"pitch\", \"yaw\"], \
         velocity_ned = [\"vn\", \"ve\", \"vd\"] }}\n{}{}{}",
        sensor("forward", "[1.0, 0.0, 0.0]"),
        sensor("right", "[0.0, 1.0, 0.0]"),
        sensor("down", "[0.0, 0.0, 1.0]")
    );
    explained(&table, &case)
}

#[test]
fn a_heading_that_is_off_is_told_with_its_angle() {
    for off_deg in [-90.0_f64, 12.0, 35.0, 90.0, 175.0] {
        let explanation = beside_heading(off_deg.to_radians());
        assert_eq!(only(&explanation), ("log", "heading_off"), "{off_deg}°");
        let parameters = &explanation.findings[0].parameters;
        let heading = parameters.iter().find(|it| it.name == "heading").expect("an angle");
        let (value, sigma) = (heading.value.expect("a value"), heading.sigma.expect("a sigma"));
        assert!((value - off_deg).abs() < 3.0 * sigma && sigma < 0.1, "{off_deg}°: {value} ± {sigma}");
    }
}

#[test]
fn a_reference_in_degrees_said_radians_is_named() {
    let reference = |axis: usize, row: u32| true_rate(axis, row).to_degrees();
    let explanation = Turning { reference, ..Turning::default() }.explained(0.0);
    assert_eq!(only(&explanation), ("imu", "unit_mistaken"));
    let words = explanation.findings.iter().flat_map(|it| &it.parameters).filter_map(|it| it.text.as_ref());
    assert!(
        words.clone().any(|word| word.contains("reference in deg for rad")),
        "{:?}",
        words.collect::<Vec<_>>()
    );
}
