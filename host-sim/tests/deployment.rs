//! From a recording to a better flight: `schuler explain` finds what the simulation leaves out and writes the compensation
//! block; another flight, with other noise and another temperature, is flown with it, on this machine and on the
//! emulated target.
//!
//! The Schuler loop is integrated here by Runge and Kutta's formula from its two equations; its gyro drifts with its
//! temperature, of which the case says nothing. (With the rate of the temperature it could not be told from an accelerometer
//! that drifts with the temperature itself: a tilt by a/g is the integral of a drift.)
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::flight::{self, Flown, On, Summary};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use schuler_core::identification::Method;
use schuler_link::block::{self, BlockBytes};
use schuler_recording::Recording;
use serde_json::Value;

const RADIUS: f64 = 6_371_000.0;
const GRAVITY: f64 = 9.80665;
const DEGREE_PER_HOUR: f64 = TAU / 360.0 / 3600.0;
/// The concealed coefficient: 0.2 °/h per K.
const COEFFICIENT: f64 = 0.2 * DEGREE_PER_HOUR;
/// Where it vanishes, °C.
const REFERENCE: f64 = 25.0;
const WHITE: f64 = 0.05;
const GYRO: (f64, f64) = (0.01 * DEGREE_PER_HOUR, 1800.0);
const ACCELEROMETER: (f64, f64) = (5e-5, 600.0);

const CASE: &str = r#"
format = "schuler-case/1"
title = "velocity error of an inertial system against a log"
[recording]
path = "recording.csv"
time = "t"
step_s = 1.0
[motion]
kind = "velocity_error"
[loop]
radius_m = 6371000.0
gravity = 9.80665
accelerometer = { sigma = 5e-5, tau_s = 600.0 }
gyro = { sigma = 4.84813681e-8, tau_s = 1800.0 }
velocity_white = 0.05
[[sensor]]
id = "v"
kind = "ins_velocity"
column = "v"
unit = "m/s"
[[aux]]
column = "temperature"
quantity = "temperature"
unit = "degC"
"#;

/// A recording of so many seconds; the temperature swings with the periods, s, and amplitudes, K.
fn recorded(directory: &Path, seconds: usize, swings: &[(f64, f64)], seed: u64) -> PathBuf {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
    let temperature =
        |t: f64| REFERENCE + swings.iter().map(|(period, k)| k * (TAU * t / period).sin()).sum::<f64>();
    let markov = |state: f64, (sigma, tau): (f64, f64), noise: f64| {
        let transition = f64::exp(-1.0 / tau);
        transition * state + sigma * (1.0 - transition * transition).sqrt() * noise
    };
    let mut table = String::from("t,v,temperature\n");
    let (mut v, mut tilt) = (0.0, 0.0);
    let (mut a, mut drift) = (ACCELEROMETER.0 * draw(), GYRO.0 * draw());
    for k in 0..seconds {
        let t = k as f64;
        writeln!(table, "{t},{},{:.3}", v + WHITE * draw(), temperature(t)).unwrap();
        let slope = |time: f64, v: f64, tilt: f64| {
            (-GRAVITY * tilt + a, v / RADIUS + drift + COEFFICIENT * (temperature(time) - REFERENCE))
        };
        let (k1, l1) = slope(t, v, tilt);
        let (k2, l2) = slope(t + 0.5, v + 0.5 * k1, tilt + 0.5 * l1);
        let (k3, l3) = slope(t + 0.5, v + 0.5 * k2, tilt + 0.5 * l2);
        let (k4, l4) = slope(t + 1.0, v + k3, tilt + l3);
        v += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
        tilt += (l1 + 2.0 * l2 + 2.0 * l3 + l4) / 6.0;
        a = markov(a, ACCELEROMETER, draw());
        drift = markov(drift, GYRO, draw());
    }
    std::fs::create_dir_all(directory).unwrap();
    std::fs::write(directory.join("recording.csv"), table).unwrap();
    let case = directory.join("case.toml");
    std::fs::write(&case, CASE).unwrap();
    case
}

fn schuler(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn flown(case: &Path, block: Option<&BlockBytes>, on: On) -> Flown {
    let recording = Recording::read(case).unwrap();
    let mut channel = flight::plan(&recording).unwrap().remove(0);
    channel.config.identification.method = Method::Off;
    channel.compensation = block.cloned();
    Flown::of(channel, &recording, on, |_| Ok(())).unwrap()
}

/// Mean NIS and root mean square of the innovation, m/s, after the first half hour.
fn error(flown: &Flown) -> (f64, f64) {
    let filter = Summary::from(flown, None, 1800).filter.unwrap();
    let innovations = flown.outputs.iter().skip(1800).map(|it| f64::from(it.filter.innovation).powi(2));
    let count = (flown.outputs.len() - 1800) as f64;
    (filter.nis.mean, (innovations.sum::<f64>() / count).sqrt())
}

#[test]
fn what_was_explained_makes_another_flight_better_on_both_machines_by_the_same_bits() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let case = recorded(&path("bench"), 6 * 3600, &[(7000.0, 3.0), (2900.0, 1.0)], 1);
    let (block_path, report) = (path("block"), path("report.html"));
    let explained = schuler(&[
        "explain",
        case.to_str().unwrap(),
        "--json",
        "--compensation",
        block_path.to_str().unwrap(),
        "--report",
        report.to_str().unwrap(),
    ]);
    let finding = &explained["findings"][0];
    assert_eq!(finding["sensor"], "gyro", "{explained:#}");
    assert_eq!(finding["effect"], "bias_temperature", "{explained:#}");
    // Its reference is not known: a constant stands beside it.
    assert_eq!(explained["compensation"][0]["terms"], 2, "{explained:#}");
    assert!(std::fs::read_to_string(&report).unwrap().contains("Residual over time"));

    let bytes = std::fs::read(&block_path).unwrap();
    let (content, _) = block::decode(&bytes).unwrap();
    let coefficient = f64::from(content.terms[0].coefficient);
    assert!((coefficient / COEFFICIENT - 1.0).abs() < 0.1, "{coefficient:e} for {COEFFICIENT:e}");

    let block = BlockBytes::from_slice(&bytes).unwrap();
    let other = recorded(&path("flight"), 3 * 3600, &[(5200.0, 2.5), (3600.0, 1.0)], 2);
    let without = flown(&other, None, On::Host);
    let with = flown(&other, Some(&block), On::Host);
    let ((nis_without, rms_without), (nis_with, rms_with)) = (error(&without), error(&with));
    println!("NIS {nis_without:.3} -> {nis_with:.3}; innovation {rms_without:.4} -> {rms_with:.4} m/s");
    assert!(nis_without > 1.5, "{nis_without}");
    assert!((0.9..1.1).contains(&nis_with), "{nis_with}");
    assert!(rms_with < 0.9 * rms_without);

    if std::env::var("SCHULER_SKIP_QEMU").is_ok_and(|value| value == "1") {
        let said = "SKIPPED: the replay on the emulated target needs QEMU, and SCHULER_SKIP_QEMU=1 is set";
        writeln!(std::io::stderr(), "{said}").unwrap();
        return;
    }
    let emulated = flown(&other, Some(&block), On::Qemu);
    for (step, (host, target)) in with.outputs.iter().zip(&emulated.outputs).enumerate() {
        assert_eq!(format!("{host:?}"), format!("{target:?}"), "step {step}");
    }
    assert_eq!(with.outputs.len(), emulated.outputs.len());
}
