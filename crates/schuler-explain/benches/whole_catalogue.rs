//! How long the whole catalogue takes on 24 h at 1 Hz of six sensors, and that it grows with the length and no faster.
//!
//!     cargo bench -p schuler-explain --bench whole_catalogue [-- DAYS…]      (default 1 2 4 8)
//!
//! Three gyros and three accelerometers on a slowly turning body, with two thermometers, voltage, current, pressure, magnetic
//! field and vibration recorded: nearly every row of the catalogue has a candidate. Hidden are a dependence of one gyro on
//! the rate of its temperature and a scale factor of one accelerometer. The table is written and read before the clock runs.
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::explain::{Options, explain};
use schuler_recording::{Recording, table};

const DAY_S: usize = 86_400;
const HOUR_S: f64 = 3600.0;
const DEGREE_PER_HOUR: f64 = TAU / 360.0 / HOUR_S;
const GRAVITY: f64 = 9.81;

fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

/// First-order Markov noise of unit deviation.
fn markov(random: &mut Pcg64, rows: usize, tau_s: f64) -> Vec<f64> {
    let keep = (-1.0 / tau_s).exp();
    let mut state = normal(random);
    (0..rows)
        .map(|_| {
            state = keep * state + (1.0 - keep * keep).sqrt() * normal(random);
            state
        })
        .collect()
}

/// Writes the case and its table; returns the path of the case.
fn write(days: usize) -> PathBuf {
    let rows = days * DAY_S;
    let mut random = Pcg64::seed_from_u64(7);
    let time: Vec<f64> = (0..rows).map(|row| row as f64).collect();
    let of_time = |value: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|&t| value(t)).collect() };
    let swing = |amplitude: f64, period_s: f64, t: f64| amplitude * (TAU * t / period_s).sin();
    let temperature = of_time(&|t| {
        30.0 + swing(5.0, 24.0 * HOUR_S, t) + swing(1.0, 1.7 * HOUR_S, t) + swing(0.5, 0.6 * HOUR_S, t)
    });
    let temperature_rate: Vec<f64> =
        temperature.windows(2).map(|pair| HOUR_S * (pair[1] - pair[0])).collect();
    let mut columns: Vec<(String, Vec<f64>)> = vec![("t".to_owned(), time.clone())];
    let mut case = format!(
        "format = \"schuler-case/1\"\ntitle = \"{days} days\"\n[recording]\npath = \"{days}_days.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
         [site]\nlatitude_deg = 55.0\n[motion]\nkind = \"recorded\"\nrate = [\"wx\", \"wy\", \"wz\"]\n\
         specific_force = [\"fx\", \"fy\", \"fz\"]\n"
    );
    for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let (period_s, tilt) = (1800.0 * (axis + 2) as f64, 0.3 * (axis + 1) as f64);
        let rate = of_time(&|t| swing(1e-3, period_s, t));
        let force = of_time(&|t| swing(tilt * GRAVITY / 2.0, period_s, t + 300.0));
        let of_rate = if axis == 0 { 0.02 } else { 0.0 };
        let colour = markov(&mut random, rows, 600.0);
        let gyro = (0..rows).map(|row| {
            let hidden = of_rate * temperature_rate.get(row).copied().unwrap_or_default();
            rate[row] + DEGREE_PER_HOUR * (hidden + 0.05 * colour[row] + 0.02 * normal(&mut random))
        });
        let gyro: Vec<f64> = gyro.collect();
        let scale = if axis == 2 { 1e-4 } else { 0.0 };
        let colour = markov(&mut random, rows, 300.0);
        let accelerometer =
            (0..rows).map(|row| (1.0 + scale) * force[row] + 5e-5 * colour[row] + 1e-4 * normal(&mut random));
        let accelerometer: Vec<f64> = accelerometer.collect();
        let unit_axis: Vec<&str> = (0..3).map(|other| if other == axis { "1.0" } else { "0.0" }).collect();
        let unit_axis = unit_axis.join(", ");
        for (id, kind, unit, white, sigma, tau_s) in [
            ("gyro", "fog", "rad/s", 0.02 * DEGREE_PER_HOUR, 0.05 * DEGREE_PER_HOUR, 600.0),
            ("accelerometer", "accelerometer", "m/s^2", 1e-4, 5e-5, 300.0),
        ] {
            let _ = write!(
                case,
                "[[sensor]]\nid = \"{id}_{letter}\"\nkind = \"{kind}\"\ncolumn = \"{id}_{letter}\"\nunit = \"{unit}\"\n\
                 axis = [{unit_axis}]\ngroup = \"unit\"\n[sensor.nominal]\nwhite = {white:e}\n\
                 markov = {{ sigma = {sigma:e}, tau_s = {tau_s:?} }}\n"
            );
        }
        columns.extend([
            (format!("w{letter}"), rate),
            (format!("f{letter}"), force),
            (format!("gyro_{letter}"), gyro),
            (format!("accelerometer_{letter}"), accelerometer),
        ]);
    }
    let mut auxiliary = |name: &str, quantity: &str, unit: &str, values: Vec<f64>| {
        let _ = write!(case, "[[aux]]\ncolumn = \"{name}\"\nquantity = \"{quantity}\"\nunit = \"{unit}\"\n");
        columns.push((name.to_owned(), values));
    };
    auxiliary("temperature", "temperature", "degC", temperature);
    let second = of_time(&|t| 35.0 + swing(4.0, 24.0 * HOUR_S, t + HOUR_S) + swing(1.0, 1.1 * HOUR_S, t));
    auxiliary("temperature_2", "temperature", "degC", second);
    for (name, quantity, unit, tau_s) in [
        ("voltage", "voltage", "V", 900.0),
        ("current", "current", "A", 1200.0),
        ("pressure", "pressure", "Pa", 7200.0),
        ("field_x", "magnetic_field_x", "T", 1800.0),
        ("field_y", "magnetic_field_y", "T", 1800.0),
        ("field_z", "magnetic_field_z", "T", 1800.0),
        ("vibration", "vibration_rms", "m/s^2", 600.0),
    ] {
        let values = markov(&mut random, rows, tau_s);
        auxiliary(name, quantity, unit, values);
    }
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let borrowed: Vec<(&str, &[f64])> =
        columns.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    table::write(&folder.join(format!("{days}_days.csv")), &borrowed).expect("the table is writable");
    let path = folder.join(format!("{days}_days.toml"));
    fs::write(&path, case).expect("the case is writable");
    path
}

fn main() {
    let given: Vec<usize> = std::env::args().skip(1).filter_map(|argument| argument.parse().ok()).collect();
    let lengths = if given.is_empty() { vec![1, 2, 4, 8] } else { given };
    let mut first: Option<(usize, f64)> = None;
    println!("days       rows  seconds  s/day  against the first  findings");
    for days in lengths {
        let recording = Recording::read(&write(days)).expect("the case is readable");
        let start = Instant::now();
        let explanation = explain(&recording, &Options::default()).expect("the case can be explained");
        let seconds = start.elapsed().as_secs_f64();
        let (days_first, seconds_first) = *first.get_or_insert((days, seconds));
        // 1 where the time grows as the length.
        let growth = seconds / seconds_first * days_first as f64 / days as f64;
        println!(
            "{days:4}  {:9}  {seconds:7.2}  {:5.2}  {growth:17.2}  {}",
            recording.len(),
            seconds / days as f64,
            explanation
                .findings
                .iter()
                .map(|f| format!("{} {}", f.sensor, f.effect))
                .collect::<Vec<_>>()
                .join("; ")
        );
    }
}
