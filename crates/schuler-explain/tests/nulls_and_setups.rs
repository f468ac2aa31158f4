//! The engine on records whose truth is known: noises with nothing concealed, late gyros, what is simply wrong, a reference
//! that is not ideal, a level of noise that changes.
use std::f64::consts::TAU;
use std::fmt::Write;

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal, StudentT};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_recording::Recording;

const ROWS: usize = 4000;
/// Records of each noise in an ordinary run, and in a long one.
const FEW: u64 = 4;
const MANY: u64 = 200;
/// Part of the records on which something false may be told.
const FALSE_AT_MOST: f64 = 0.01;

/// A noise with nothing concealed, and what the case states of it.
struct Null {
    name: &'static str,
    stated: &'static str,
    draw: fn(&mut Pcg64) -> Vec<f64>,
}

const NULLS: [Null; 6] = [
    Null { name: "flat", stated: "white = 1.0", draw: white },
    Null { name: "a wiggle of a factor of e", stated: "white = 1.0", draw: wiggle },
    Null { name: "heavy tails", stated: "white = 1.0", draw: heavy_tails },
    Null { name: "bursts", stated: "white = 1.0", draw: bursts },
    Null { name: "1/f^1.4, not stated", stated: "", draw: power_law },
    Null {
        name: "30 % of the rows missing",
        stated: "white = 1.0\nmarkov = { sigma = 0.5, tau_s = 300.0 }",
        draw: with_gaps,
    },
];

fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

fn white(random: &mut Pcg64) -> Vec<f64> {
    (0..ROWS).map(|_| normal(random)).collect()
}

/// White noise through a filter whose gain is the root of a spectrum, as a sum of cosines with random amplitudes.
fn of_spectrum(random: &mut Pcg64, spectrum: impl Fn(f64) -> f64) -> Vec<f64> {
    let half = ROWS;
    let wave: Vec<(f64, f64, f64)> = (1..half)
        .map(|k| {
            let frequency = 0.5 * k as f64 / half as f64;
            let size = (spectrum(frequency) / half as f64).sqrt();
            (TAU * frequency, size * normal(random), size * normal(random))
        })
        .collect();
    // By a recurrence for each cosine, which a transform would do as well.
    let mut sum = vec![0.0; ROWS];
    for (omega, a, b) in wave {
        let (turn, (mut cos, mut sin)) = (omega.sin_cos(), (1.0, 0.0));
        for value in &mut sum {
            *value += a * cos + b * sin;
            (cos, sin) = (cos * turn.1 - sin * turn.0, sin * turn.1 + cos * turn.0);
        }
    }
    sum
}

fn wiggle(random: &mut Pcg64) -> Vec<f64> {
    let (phase, per_octave) = (random.random_range(0.0..TAU), random.random_range(3.0..6.0));
    of_spectrum(random, |frequency| (per_octave * frequency.ln() + phase).sin().exp())
}

fn heavy_tails(random: &mut Pcg64) -> Vec<f64> {
    let tails = StudentT::new(3.0).expect("three degrees of freedom");
    (0..ROWS).map(|_| tails.sample(random) / 3.0_f64.sqrt()).collect()
}

fn bursts(random: &mut Pcg64) -> Vec<f64> {
    let mut loud = vec![1.0; ROWS];
    for _ in 0..6 {
        let (from, rows) = (random.random_range(0..ROWS - 150), random.random_range(30..150));
        loud[from..from + rows].fill(4.0);
    }
    loud.into_iter().map(|level| level * normal(random)).collect()
}

fn power_law(random: &mut Pcg64) -> Vec<f64> {
    of_spectrum(random, |frequency| 1.0 + (0.003 / frequency).powf(1.4))
}

fn with_gaps(random: &mut Pcg64) -> Vec<f64> {
    let decay = (-1.0_f64 / 300.0).exp();
    let mut slow = 0.5 * normal(random);
    (0..ROWS)
        .map(|_| {
            let value = slow + normal(random);
            slow = decay * slow + 0.5 * (1.0 - decay * decay).sqrt() * normal(random);
            if random.random_range(0.0..1.0) < 0.3 { f64::NAN } else { value }
        })
        .collect()
}

/// A gyro at rest beside a coarse thermometer and a supply.
fn at_rest(null: &Null, seed: u64) -> Explanation {
    let mut random = Pcg64::seed_from_u64(seed);
    let readings = (null.draw)(&mut random);
    let mut table = String::from("t,gyro,temperature,supply\n");
    let (mut walk, swing) = (0.0, random.random_range(0.3..2.0));
    for (row, reading) in readings.iter().enumerate() {
        walk += 0.003 * normal(&mut random);
        let phase = TAU * swing * row as f64 / ROWS as f64;
        let temperature = 20.0 + walk + 3.0 * phase.sin() + 0.02 * normal(&mut random);
        let coarse = (temperature / 0.0625).round() * 0.0625;
        let supply = 5.0 + 0.05 * (TAU * row as f64 / 700.0).sin() + 0.002 * normal(&mut random);
        let reading = if reading.is_nan() { String::new() } else { format!("{reading:.6}") };
        writeln!(table, "{row},{reading},{coarse},{supply:.5}").expect("a string can be written to");
    }
    let case = format!(
        r#"
            format = "schuler-case/1"
            title  = "{}"
            recording = {{ path = "recording.csv", time = "t", step_s = 1.0 }}
            motion = {{ kind = "static", attitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 90.0 }} }}
            site = {{ latitude_deg = 0.0, altitude_m = 0.0 }}
            [[sensor]]
            id     = "gyro"
            kind   = "dtg"
            column = "gyro"
            unit   = "deg/h"
            axis   = [0.0, 0.0, 1.0]
            [sensor.nominal]
            bias = 0.0
            {}
            [[aux]]
            column = "temperature"
            quantity = "temperature"
            unit = "degC"
            [[aux]]
            column = "supply"
            quantity = "voltage"
            unit = "V"
        "#,
        null.name, null.stated
    );
    explained(&table, &case)
}

fn explained(table: &str, case: &str) -> Explanation {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("case.toml");
    std::fs::write(folder.path().join("recording.csv"), table).expect("the table is written");
    std::fs::write(&path, case).expect("the case is written");
    let recording = Recording::read(&path).expect("the recording is read");
    explain(&recording, &Config { hold_out: false, ..Config::default() }).expect("an explanation")
}

/// What of an explanation says more than that the noise is another.
fn physics(explanation: &Explanation) -> Vec<&Finding> {
    explanation.findings.iter().filter(|finding| !finding.effect.starts_with("noise_")).collect()
}

fn nothing_is_told(records: u64) {
    let mut told = Vec::new();
    for (null, of_null) in NULLS.iter().zip(0..) {
        for number in 0..records {
            let explanation = at_rest(null, 1000 * of_null + number);
            if let Some(finding) = physics(&explanation).first() {
                told.push(format!("{} {number}: {}", null.name, finding.sentence));
            }
        }
    }
    let all = (NULLS.len() as u64 * records) as f64;
    println!("{} of {all} records with something false: {told:#?}", told.len());
    assert!(told.len() as f64 <= (FALSE_AT_MOST * all).max(1.0), "{told:#?}");
}

#[test]
fn no_physics_is_told_of_noise() {
    nothing_is_told(FEW);
}

#[test]
#[ignore = "1200 records take minutes: part `long` of tests/run"]
fn no_physics_is_told_of_much_noise() {
    nothing_is_told(MANY);
}

/// Three gyros of one instrument that turn, beside their true rates.
struct Turning {
    /// What a gyro reads at a row, from the rates of all axes as functions of time.
    reads: fn(usize, f64) -> f64,
    /// The reference's rate of an axis at a row.
    reference: fn(usize, u32) -> f64,
    /// Standard deviation of a gyro's noise at a row.
    white: fn(u32) -> f64,
    /// The row of which a row shows the readings.
    shown: fn(u32) -> u32,
}

const STEP_S: f64 = 0.01;
const WHITE: f64 = 0.002;

/// Rate of an axis, rad/s.
fn rate(axis: usize, time_s: f64) -> f64 {
    let tones = [(0.31, 0.9), (0.83, 0.5), (1.7, 0.2)];
    let of_tone = |(frequency_hz, size): (f64, f64)| {
        let phase = axis as f64 * 1.3 + size;
        size * (TAU * frequency_hz * (1.0 + 0.1 * axis as f64) * time_s + phase).sin()
    };
    tones.into_iter().map(of_tone).sum()
}

fn true_rate(axis: usize, row: u32) -> f64 {
    rate(axis, STEP_S * f64::from(row))
}

impl Default for Turning {
    fn default() -> Self {
        Self { reads: rate, reference: true_rate, white: |_| WHITE, shown: |row| row }
    }
}

impl Turning {
    fn explained(&self, late_s: f64) -> Explanation {
        let mut random = Pcg64::seed_from_u64(7);
        let mut table = String::from("t,gx,gy,gz,wx,wy,wz\n");
        let mut of_row = |row: u32| {
            let time_s = STEP_S * f64::from(row) - late_s;
            [0, 1, 2].map(|axis| (self.reads)(axis, time_s) + (self.white)(row) * normal(&mut random))
        };
        let readings: Vec<[f64; 3]> = (0..6000).map(&mut of_row).collect();
        for row in 0..6000_u32 {
            write!(table, "{:.2}", STEP_S * f64::from(row)).expect("a string can be written to");
            for reading in readings[(self.shown)(row) as usize] {
                write!(table, ",{reading:.7}").expect("a string can be written to");
            }
            let [x, y, z] = [0, 1, 2].map(|axis| (self.reference)(axis, row));
            writeln!(table, ",{x:.9},{y:.9},{z:.9}").expect("a string can be written to");
        }
        let sensor = |id: &str, axis: &str| {
            format!(
                "[[sensor]]\nid = \"{id}\"\nkind = \"mems_gyro\"\ncolumn = \"{id}\"\nunit = \"rad/s\"\ngroup = \"imu\"\n\
                 axis = {axis}\n[sensor.nominal]\nwhite = {WHITE}\n"
            )
        };
        let case = format!(
            "format = \"schuler-case/1\"\ntitle = \"Turning\"\n\
             recording = {{ path = \"recording.csv\", time = \"t\", step_s = {STEP_S} }}\n\
             site = {{ latitude_deg = 47.0, altitude_m = 400.0 }}\n\
             motion = {{ kind = \"recorded\", rate = [\"wx\", \"wy\", \"wz\"] }}\n{}{}{}",
            sensor("gx", "[1.0, 0.0, 0.0]"),
            sensor("gy", "[0.0, 1.0, 0.0]"),
            sensor("gz", "[0.0, 0.0, 1.0]")
        );
        explained(&table, &case)
    }
}

/// The one finding that is physics or a fault of the case.
fn only(explanation: &Explanation) -> (&str, &str) {
    match physics(explanation).as_slice() {
        [finding] => (&finding.sensor, &finding.effect),
        told => panic!("{told:#?}"),
    }
}

fn delay_of(explanation: &Explanation) -> (f64, f64) {
    let delays = explanation.findings.iter().flat_map(|finding| &finding.parameters);
    let delay = delays.into_iter().find(|it| it.name == "delay_s").expect("a delay");
    (delay.value.expect("a value"), delay.sigma.expect("a sigma"))
}

#[test]
fn a_late_instrument_is_told_with_its_delay() {
    // A delay of much less than a row is the same function of this motion as a lag.
    for late_s in [0.008, 0.04, 0.08, 0.12, 0.2] {
        let explanation = Turning::default().explained(late_s);
        assert_eq!(only(&explanation), ("imu", "time_delay"), "{late_s}");
        let (value, sigma) = delay_of(&explanation);
        println!("{late_s} s late: {value} ± {sigma}");
        assert!((value - late_s).abs() < 4.0 * sigma, "{late_s} s late: {value} ± {sigma}");
    }
}

#[test]
fn what_is_simply_wrong_is_named_before_any_effect() {
    type Reads = fn(usize, f64) -> f64;
    let all: [(&str, &str, Reads); 4] = [
        ("gz", "sign_flipped", |axis, time_s| if axis == 2 { -rate(2, time_s) } else { rate(axis, time_s) }),
        ("imu", "sign_flipped", |axis, time_s| -rate(axis, time_s)),
        ("imu", "axes_swapped", |axis, time_s| rate([1, 0, 2][axis], time_s)),
        ("imu", "unit_mistaken", |axis, time_s| rate(axis, time_s).to_degrees()),
    ];
    for (sensor, effect, reads) in all {
        let explanation = Turning { reads, ..Turning::default() }.explained(0.0);
        assert_eq!(only(&explanation), (sensor, effect));
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
