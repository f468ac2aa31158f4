//! The temperature rate on logs of real thermometers, quantised artificially, against a smooth reference made offline.
use schuler_core::reading::Reading;
use schuler_core::thermal::{TemperatureRate, TemperatureRateConfig, TemperatureRateOutput, ThermalStatus};
use schuler_tests::temperature_rate::competitors::Method;
use schuler_tests::temperature_rate::logs::{smooth_rate, temperatures};

fn fly(readings: &[f64], quantum: f64) -> Vec<TemperatureRateOutput<f32>> {
    let config = TemperatureRateConfig::of_quantum(quantum as f32);
    let mut estimator = TemperatureRate::try_build(&config).expect("valid");
    let steps = readings.iter().enumerate();
    steps.map(|(t, y)| estimator.step(1000 * t as u64, &Reading::good(*y as f32))).collect()
}

/// Root mean square, degC/h, where the reference is known and the start is over.
fn error(rates: &[f64], reference: &[f64]) -> f64 {
    let both = rates.iter().zip(reference).skip(600).filter(|(_, r)| r.is_finite());
    let squares: Vec<f64> = both.map(|(a, b)| (a - b).powi(2)).collect();
    3600.0 * (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The least error of each alternative over its whole grid: tuned on the very log.
fn alternatives(readings: &[f64], quantum: f64, reference: &[f64]) -> Vec<(&'static str, f64)> {
    Method::grids()
        .into_iter()
        .map(|(name, grid)| {
            let errors = grid.iter().map(|m| error(&m.rates(readings, quantum), reference));
            (name, errors.fold(f64::INFINITY, f64::min))
        })
        .collect()
}

/// A log, the number of its samples that make a second, and the quanta with the largest allowed ratio of our error to that
/// of the simple difference with the lag that is best on this very log.
///
/// The time bases of the logs are unknown; these make the courses slow enough for the method. No bar is specified for
/// real logs. Where the noise spans levels (small quanta, native readings) the filter of all readings must keep up with
/// the tuned difference. With coarse quanta the temperature crosses a threshold every half hour, the truth is a drift of
/// about 1 degC/h within one level, and nothing beats a slow filter: there the error may not exceed half as much again.
struct Case {
    log: &'static str,
    samples_per_second: usize,
    native_quantum: f64,
    ratio_native: f64,
    ratios: [(f64, f64); 3],
}

const CASES: [Case; 2] = [
    Case {
        log: "accelerometer_thermal_ramp/icm42652_raw.csv.gz",
        samples_per_second: 4,
        native_quantum: 0.0605,
        ratio_native: 1.1,
        ratios: [(0.0625, 1.1), (0.25, 1.5), (0.5, 1.5)],
    },
    Case {
        log: "mems_hot_cold/hot.csv.gz",
        samples_per_second: 1,
        native_quantum: 1.0 / 512.0,
        ratio_native: 1.1,
        ratios: [(0.0625, 1.1), (0.125, 1.1), (0.25, 1.5)],
    },
];

#[test]
fn tmp_9_rate_on_real_logs() {
    for case in CASES {
        let Some(log) = temperatures(case.log) else { continue };
        let seconds = log.chunks(case.samples_per_second);
        let means: Vec<f64> = seconds.map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
        let reference = smooth_rate(&means, 150);
        let native: Vec<f64> = log.iter().step_by(case.samples_per_second).copied().collect();
        let quantised = case.ratios.map(|(quantum, ratio)| {
            let round = |t: &f64| (t / quantum + 0.5).floor() * quantum;
            (format!("q = {quantum}"), quantum, means.iter().map(round).collect(), ratio)
        });
        println!(
            "{}: {} s, rms rate {:.2} degC/h",
            case.log,
            means.len(),
            error(&vec![0.0; means.len()], &reference)
        );
        for (name, quantum, readings, bar) in quantised.into_iter().chain([(
            "native".to_owned(),
            case.native_quantum,
            native,
            case.ratio_native,
        )]) {
            let outputs = fly(&readings, quantum);
            let rates: Vec<f64> = outputs.iter().map(|o| f64::from(o.rate)).collect();
            assert!(rates.iter().all(|r| r.is_finite()));
            let dither = outputs.iter().filter(|o| o.status.contains(ThermalStatus::DITHER)).count();
            let own = error(&rates, &reference);
            let others = alternatives(&readings, quantum, &reference);
            let share = 100 * dither / outputs.len();
            println!("    {name}: {own:.3} degC/h, dither {share} %, tuned on this log {others:.3?}");
            let ratio = own / others[0].1;
            assert!(ratio < bar, "{}, {name}: {ratio} of the simple difference, at most {bar}", case.log);
        }
    }
}

/// A thermometer at rest, after a jump of its first reading: the rate is that of the drift, which is below 0.5 degC/h.
#[test]
fn tmp_9_rate_of_a_real_thermometer_at_rest() {
    let Some(log) = temperatures("mems_hot_cold/cold.csv.gz") else { return };
    let reference = smooth_rate(&log, 150);
    let rates: Vec<f64> = fly(&log, 1.0 / 512.0).iter().map(|o| f64::from(o.rate)).collect();
    let own = error(&rates, &reference);
    println!("at rest: {own:.3} degC/h");
    assert!(own < 0.3, "{own} degC/h");
}
