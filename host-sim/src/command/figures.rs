//! `schuler figures --out docs/figures`: every figure of the documentation, made anew.
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use schuler_core::health::{HealthConfig, HealthMonitor};
use schuler_core::reading::Reading;
use schuler_core::thermal::{TemperatureRate, TemperatureRateConfig};
use schuler_recording::Error;
use serde::Serialize;

use super::session::Session;
use super::{Failure, calibrate, compare_isolation, demo};
use crate::calibration_table::scenario::CalibrationScenario;
use crate::compare_isolation::{ComparisonError, IsolationComparison, compare_isolation_watched};
use crate::plot::{Colour, Figure, Format, Panel};

/// The run that is calibrated.
const CALIBRATION: &str = include_str!("../../scenarios/calibration_run.toml");
/// Figures of the demonstration that are kept, and under which name.
const OF_THE_DEMO: [(&str, &str); 3] = [
    ("before_and_after.png", "before_and_after.png"),
    ("velocity_error_estimates.png", "estimates.png"),
    ("velocity_error_isolation.png", "isolation_in_flight.png"),
];

/// Where to.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Directory for the figures.
    #[arg(long, short, default_value = "docs/figures")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    files: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let out = &arguments.out;
    let temporary = tempfile::tempdir().map_err(|error| Failure::Other(error.into()))?;
    let mut files = Vec::new();

    let made = temporary.path().join("demo");
    demo::made(&demo::Arguments::into_directory(&made), session)?;
    for (name, as_name) in OF_THE_DEMO {
        files.push(kept(&made, name, out, as_name)?);
    }

    let run = temporary.path().join("run");
    let (scenario, _) = CalibrationScenario::parse("calibration_run.toml".as_ref(), CALIBRATION)?;
    let (written, _) = scenario.simulated(|_| Ok(()))?.write(&run)?;
    let made = temporary.path().join("calibration");
    calibrate::made(&calibrate::Arguments::into_directory(&written.case, &made), session)?;
    files.push(kept(&made, "coefficients.png", out, "calibration_coefficients.png")?);
    files.push(kept(&made, "run.png", out, "calibration_run.png")?);

    let comparison = IsolationComparison::default();
    let all = comparison.trials * comparison.faults.len() as u64;
    let progress = session.progress("comparing", all as usize);
    let rows = compare_isolation_watched(&comparison, |done| progress.stride(done as usize));
    drop(progress);
    let rows = rows.map_err(|error| match error {
        ComparisonError::Interrupted(stopped) => Failure::Stopped(stopped),
        ComparisonError::Configuration(error) => Failure::Other(anyhow::anyhow!("{error}")),
    })?;
    for (name, figure) in [
        ("isolation_comparison", compare_isolation::figure(&comparison, &rows)),
        ("temperature_rate", temperature_rate(&scenario)?),
        ("health_monitor", health_monitor()?),
    ] {
        files.extend(figure.write(out, name, &[Format::Png])?);
    }
    session.answer(&Answer { format: "schuler-figures/1", files }, |answer| {
        answer.files.iter().fold(String::new(), |text, path| text + &path.display().to_string() + "\n")
    })
}

/// Copies a figure to where it is kept.
fn kept(from: &Path, name: &str, to: &Path, as_name: &str) -> Result<PathBuf, Failure> {
    let source = from.join(name);
    let bytes = std::fs::read(&source).map_err(|error| Error::io(&source, "read the figure", &error))?;
    let path = to.join(as_name);
    crate::output::write(&path, &bytes)?;
    Ok(path)
}

/// Temperature and rate from a coarse thermometer in a chamber that goes up and down, against the truth.
fn temperature_rate(scenario: &CalibrationScenario) -> Result<Figure, Failure> {
    const QUANTUM: f64 = 0.25;
    const DIFFERENCE_S: usize = 300;
    let record = scenario.table.run(scenario.seed);
    let readings = record.thermometer(QUANTUM, 0.0, 1);
    let mut estimator = TemperatureRate::<f32>::try_build(&TemperatureRateConfig::of_quantum(QUANTUM as f32))
        .map_err(|error| Failure::Other(anyhow::anyhow!("{error}")))?;
    let (mut rate, mut low, mut high) = (Vec::new(), Vec::new(), Vec::new());
    for (second, reading) in readings.iter().enumerate() {
        let output = estimator.step(1000 * second as u64, &Reading::good(*reading as f32));
        let (value, sigma) = (f64::from(output.rate) * 3600.0, f64::from(output.rate_sigma) * 3600.0);
        rate.push(value);
        low.push(value - 3.0 * sigma);
        high.push(value + 3.0 * sigma);
    }
    let hours: Vec<f64> = (0..readings.len()).map(|second| second as f64 / 3600.0).collect();
    let truth: Vec<f64> = record.temperature.iter().map(|t| t.rate * 3600.0).collect();
    let difference: Vec<f64> = (0..readings.len())
        .map(|second| {
            let before = second.checked_sub(DIFFERENCE_S).and_then(|k| readings.get(k));
            before.map_or(f64::NAN, |b| (readings[second] - b) / DIFFERENCE_S as f64 * 3600.0)
        })
        .collect();
    let mut rates = Panel::new("time, h", "rate, °C/h")
        .line("difference over 5 min", &hours, difference, Colour::Sky)
        .band("estimate ±3σ", &hours, low, high, Colour::Orange)
        .line("estimate", &hours, rate, Colour::Red)
        .line("truth", &hours, truth, Colour::Black);
    rates.y_range = Some((-120.0, 160.0));
    Ok(Figure {
        title: "Temperature rate in real time from a thermometer with steps of 0.25 °C".to_owned(),
        panels: vec![Panel::new("time, h", "reading, °C").line("", &hours, readings, Colour::Blue), rates],
    })
}

/// A radio sensor against an inertial one: a shift of three standard deviations, later noise grown to three times.
fn health_monitor() -> Result<Figure, Failure> {
    const SECONDS: usize = 1800;
    let (jump, noise) = (600..720, 1200..1320);
    let config = HealthConfig::<f64, 2>::doppler_against_inertial();
    let mut monitor =
        HealthMonitor::try_build(&config).map_err(|error| Failure::Other(anyhow::anyhow!("{error}")))?;
    let mut random = Pcg64::seed_from_u64(7);
    let mut normal = || -> f64 { random.sample(StandardNormal) };
    let decay = (-config.step_s / config.radio.tau_s).exp();
    let (mut radio, mut inertial) = (0.3 * normal(), 0.0);
    let (mut residual, mut shifted, mut grown, mut error, mut true_error) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for second in 0..SECONDS {
        let sigma = config.radio.sigma[usize::from(noise.contains(&second))];
        radio = decay * radio + sigma * (1.0 - decay * decay).sqrt() * normal();
        inertial += config.inertial.random_walk * normal();
        let told = radio + if jump.contains(&second) { 0.9 } else { 0.0 };
        let output = monitor.step(&Reading::good(told), &Reading::good(inertial), 1);
        residual.push(output.residual);
        shifted.push(output.p_jump);
        grown.push(output.p_noise);
        error.push(output.radio_error.value);
        true_error.push(told);
    }
    let minutes: Vec<f64> = (0..SECONDS).map(|second| second as f64 / 60.0).collect();
    Ok(Figure {
        title: "Health of a radio sensor: shift of 3σ at 10 min, noise × 3 at 20 min, two minutes each"
            .to_owned(),
        panels: vec![
            Panel::new("time, min", "radio minus inertial, m/s").line("", &minutes, residual, Colour::Blue),
            Panel::new("time, min", "probability")
                .line("mean has shifted", &minutes, shifted, Colour::Red)
                .line("noise has grown", &minutes, grown, Colour::Orange),
            Panel::new("time, min", "error of the radio sensor, m/s")
                .line("truth", &minutes, true_error, Colour::Grey)
                .line("estimate", &minutes, error, Colour::Blue),
        ],
    })
}
