//! How long the whole catalogue takes on 24 h at 1 Hz of six sensors, and that it grows with the length and no faster.
//!
//!     cargo bench -p schuler-explain --bench whole_catalogue [-- DAYS… | gyros N RATE_HZ MINUTES]      (default 1 2 4 8)
//!
//! Three gyros and three accelerometers on a slowly turning body, with two thermometers, voltage, current, pressure, magnetic
//! field and vibration recorded: nearly every row of the catalogue has a candidate. Hidden are none, the first, or all of: a
//! dependence of one gyro on the rate of its temperature, a scale factor of one accelerometer, a dependence of another gyro on
//! the voltage. `gyros`: N redundant gyros in unknown motion, with a dependence of the first on its temperature.
//!
//! The table is written and read before the clocks run. CPU seconds are of all threads, and do not depend on what else the
//! machine does as much as seconds do; they and the peak of memory are the operating system's (Linux).
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
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

/// Writes the case with so many effects hidden and its table; returns the path of the case.
fn write(days: usize, hidden: usize) -> PathBuf {
    let rows = days * DAY_S;
    let with = |place: usize, coefficient: f64| if hidden > place { coefficient } else { 0.0 };
    let mut random = Pcg64::seed_from_u64(7);
    let time: Vec<f64> = (0..rows).map(|row| row as f64).collect();
    let of_time = |value: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|&t| value(t)).collect() };
    let swing = |amplitude: f64, period_s: f64, t: f64| amplitude * (TAU * t / period_s).sin();
    let temperature = of_time(&|t| {
        30.0 + swing(5.0, 24.0 * HOUR_S, t) + swing(1.0, 1.7 * HOUR_S, t) + swing(0.5, 0.6 * HOUR_S, t)
    });
    let last = rows - 1;
    let temperature_rate: Vec<f64> = (0..rows)
        .map(|row| HOUR_S * (temperature[(row + 1).min(last)] - temperature[row.min(last - 1)]))
        .collect();
    let voltage = markov(&mut random, rows, 900.0);
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
        let of_rate = if axis == 0 { with(0, 0.02) } else { 0.0 };
        let of_voltage = if axis == 1 { with(2, 0.02) } else { 0.0 };
        let colour = markov(&mut random, rows, 600.0);
        let gyro = (0..rows).map(|row| {
            let hidden = of_rate * temperature_rate[row];
            let hidden = hidden + of_voltage * voltage[row];
            rate[row] + DEGREE_PER_HOUR * (hidden + 0.05 * colour[row] + 0.02 * normal(&mut random))
        });
        let gyro: Vec<f64> = gyro.collect();
        let scale = if axis == 2 { with(1, 1e-4) } else { 0.0 };
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
    auxiliary("voltage", "voltage", "V", voltage);
    for (name, quantity, unit, tau_s) in [
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
    save(&format!("{days}_days"), &case, &columns)
}

/// Writes a case of redundant gyros in unknown motion.
fn write_gyros(number: usize, rate_hz: f64, minutes: f64) -> PathBuf {
    let rows = (60.0 * minutes * rate_hz) as usize;
    let step_s = 1.0 / rate_hz;
    let mut random = Pcg64::seed_from_u64(11);
    let time: Vec<f64> = (0..rows).map(|row| row as f64 * step_s).collect();
    let length_s = 60.0 * minutes;
    let temperature: Vec<f64> = time
        .iter()
        .map(|t| 30.0 + 3.0 * (TAU * t / length_s).sin() + (TAU * t / length_s * 2.7).cos())
        .collect();
    let motion = [0.3, 0.5, 0.7].map(|part| -> Vec<f64> {
        time.iter().map(|t| 0.01 * (TAU * t * (1.0 + part) / (0.2 * length_s)).sin()).collect()
    });
    let mut case = format!(
        "format = \"schuler-case/1\"\ntitle = \"{number} gyros\"\n[recording]\npath = \"{number}_gyros.csv\"\ntime = \"t\"\n\
         step_s = {step_s:?}\n[motion]\nkind = \"unknown\"\n"
    );
    let mut columns = vec![("t".to_owned(), time)];
    for index in 0..number {
        // Spread over the sphere.
        let height = 1.0 - (2 * index + 1) as f64 / number as f64;
        let (sin, cos) = (2.4 * index as f64).sin_cos();
        let along = (1.0 - height * height).sqrt();
        let axis = [along * cos, along * sin, height];
        let hidden = if index == 0 { 0.05 } else { 0.0 };
        let colour = markov(&mut random, rows, 100.0 * rate_hz);
        let values: Vec<f64> = (0..rows)
            .map(|row| {
                let rate: f64 = axis.iter().zip(&motion).map(|(a, w)| a * w[row]).sum();
                let own = hidden * (temperature[row] - 30.0) + 0.05 * colour[row];
                rate + DEGREE_PER_HOUR * (own + 0.2 * normal(&mut random))
            })
            .collect();
        let [x, y, z] = axis;
        let _ = write!(
            case,
            "[[sensor]]\nid = \"gyro_{index}\"\nkind = \"fog\"\ncolumn = \"gyro_{index}\"\nunit = \"rad/s\"\n\
             axis = [{x:?}, {y:?}, {z:?}]\n[sensor.nominal]\nwhite = {:e}\nmarkov = {{ sigma = {:e}, tau_s = 100.0 }}\n",
            0.2 * DEGREE_PER_HOUR,
            0.05 * DEGREE_PER_HOUR
        );
        columns.push((format!("gyro_{index}"), values));
    }
    case.push_str("[[aux]]\ncolumn = \"temperature\"\nquantity = \"temperature\"\nunit = \"degC\"\n");
    columns.push(("temperature".to_owned(), temperature));
    save(&format!("{number}_gyros"), &case, &columns)
}

fn save(name: &str, case: &str, columns: &[(String, Vec<f64>)]) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let borrowed: Vec<(&str, &[f64])> =
        columns.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    table::write(&folder.join(format!("{name}.csv")), &borrowed).expect("the table is writable");
    let path = folder.join(format!("{name}.toml"));
    fs::write(&path, case).expect("the case is writable");
    path
}

/// CPU seconds of all threads, and the peak of memory, MB.
fn used() -> (f64, f64) {
    /// Clock ticks a second of Linux's process statistics.
    const TICKS: f64 = 100.0;
    let statistics = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = statistics.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after_name.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum();
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = peak.and_then(|peak| peak.trim().split(' ').next()?.parse::<f64>().ok());
    (ticks / TICKS, kilobytes.unwrap_or(f64::NAN) / 1e3)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let numbers: Vec<f64> = arguments.iter().filter_map(|argument| argument.parse().ok()).collect();
    println!("case          hidden       rows  seconds  CPU s  against the first  peak MB  findings");
    if arguments.first().is_some_and(|argument| argument == "gyros") {
        let at = |place: usize, usual: f64| numbers.get(place).copied().unwrap_or(usual);
        let number = at(0, 24.0) as usize;
        let path = write_gyros(number, at(1, 10.0), at(2, 60.0));
        measure(&format!("{number} gyros"), 1, &path, None);
        return;
    }
    let lengths: Vec<usize> = if numbers.is_empty() {
        vec![1, 2, 4, 8]
    } else {
        numbers.iter().map(|&days| days as usize).collect()
    };
    for hidden in [0, 1, 3] {
        let mut first: Option<(usize, f64)> = None;
        for &days in &lengths {
            let (days_first, seconds_first) = first.unwrap_or((days, f64::NAN));
            // What the CPU time would be if it grew as the length.
            let expected = seconds_first * days as f64 / days_first as f64;
            let name = format!("{days} days");
            let seconds = measure(&name, hidden, &write(days, hidden), Some(expected));
            first = first.or(Some((days, seconds)));
        }
    }
}

/// Explains a case and prints how long it took; returns the CPU seconds.
fn measure(name: &str, hidden: usize, case: &Path, expected: Option<f64>) -> f64 {
    let recording = Recording::read(case).expect("the case is readable");
    let (start, before) = (Instant::now(), used());
    let explanation = explain(&recording, &Config::default()).expect("the case can be explained");
    let seconds = start.elapsed().as_secs_f64();
    let after = used();
    let growth = expected.map_or(f64::NAN, |expected| (after.0 - before.0) / expected);
    println!(
        "{name:12}  {hidden:6}  {:9}  {seconds:7.2}  {:5.2}  {growth:17.2}  {:7.0}  {}",
        recording.len(),
        after.0 - before.0,
        after.1,
        explanation
            .findings
            .iter()
            .map(|f| format!("{} {}", f.sensor, f.effect))
            .collect::<Vec<_>>()
            .join("; ")
    );
    after.0 - before.0
}
