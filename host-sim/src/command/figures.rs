//! `schuler figures --out docs/figures`: every figure of the documentation, made anew.
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use schuler_core::health::{HealthConfig, HealthMonitor};
use schuler_core::identification::{Method, NoiseEstimate};
use schuler_core::reading::Reading;
use schuler_core::thermal::{Compensator, TemperatureRate, TemperatureRateConfig, ThermalState};
use schuler_explain::calibration::Calibration;
use schuler_recording::{Error, Recording};
use serde::Serialize;

use super::session::Session;
use super::{Failure, calibrate, compare_isolation, demo, fly, simulate};
use crate::calibration_table::scenario::CalibrationScenario;
use crate::calibration_table::{CalibrationTable, CycleRecord, Programme, TableRecord, TriadErrors};
use crate::compare_isolation::{ComparisonError, IsolationComparison, compare_isolation_watched};
use crate::flight::{self, Flown, On};
use crate::identify::{self, identify};
use crate::physics::random::Process;
use crate::plot::{Colour, Figure, Format, Layer, Panel};
use crate::scenario::ScenarioFile;
use crate::simulation::CASE;

/// The run that is calibrated.
const CALIBRATION: &str = include_str!("../../scenarios/calibration_run.toml");
/// Two gyros whose drift differs in structure.
const GYRO_NOISE: &str = include_str!("../../scenarios/gyro_noise.toml");
/// Figures of the demonstration that are kept, and under which name.
const OF_THE_DEMO: [(&str, &str); 3] = [
    ("before_and_after.png", "before_and_after.png"),
    ("velocity_error_estimates.png", "estimates.png"),
    ("velocity_error_isolation.png", "isolation_in_flight.png"),
];

/// Noise that a sensor is flown with, step by step.
type NoiseInUse = fn(&Flown) -> Vec<&NoiseEstimate>;
/// Error of a sample, by its place, from the reading and the truth.
type ErrorAt<'a> = dyn Fn(usize, &[f64; 3], &[f64; 3]) -> f64 + 'a;

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
    let temporary = crate::output::Scratch::new().map_err(|error| Failure::Other(error.into()))?;
    let mut files = Vec::new();

    let made = temporary.path().join("demo");
    demo::identification::made(&demo::Arguments::into_directory(&made), session)?;
    for (name, as_name) in OF_THE_DEMO {
        files.push(kept(&made, name, out, as_name)?);
    }
    files.extend(published_loop(&made.join(CASE), session)?.write(out, "published_loop", &[Format::Png])?);

    let made = temporary.path().join("circle");
    demo::circle::made(&demo::Arguments::into_directory(&made), session)?;
    files.push(kept(&made, "closed_circle.png", out, "closed_circle.png")?);

    let noise = temporary.path().join("noise");
    for (name, figure) in structure_and_noise(&noise, session)? {
        files.extend(figure.write(out, name, &[Format::Png])?);
    }

    let run = temporary.path().join("run");
    let (scenario, _) = CalibrationScenario::parse("calibration_run.toml".as_ref(), CALIBRATION)?;
    let (written, _) = scenario.simulated(|_| Ok(()))?.write(&run)?;
    let made = temporary.path().join("calibration");
    let (_, calibration) =
        calibrate::made(&calibrate::Arguments::into_directory(&written.case, &made), session)?;
    files.push(kept(&made, "coefficients.png", out, "calibration_coefficients.png")?);
    files.push(kept(&made, "run.png", out, "calibration_run.png")?);
    files.extend(compensation(&scenario, &calibration)?.write(out, "compensation", &[Format::Png])?);

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

/// The demonstration's flight, retuned by the published loop and by maximum likelihood.
fn published_loop(case: &Path, session: &Session) -> Result<Figure, Failure> {
    let recording = Recording::read(case)?;
    let channel = demo::channel_of(&recording, case)?;
    let truth = demo::truth(case, &channel.name, &recording)?;
    let fly = |method: Method| {
        let mut channel = channel.clone();
        channel.config.identification.method = method;
        fly::flown(channel, &recording, On::Host, case, session)
    };
    let flights = [
        ("published loop", fly(Method::Published)?, Colour::Red),
        ("maximum likelihood", fly(Method::Likelihood)?, Colour::Blue),
    ];
    // Of the simulated errors over the whole flight; both are without mean.
    let rms = |values: &[f64]| {
        let known: Vec<f64> = values.iter().filter(|v| v.is_finite()).map(|v| v * v).collect();
        (known.iter().sum::<f64>() / known.len() as f64).sqrt()
    };
    let [accelerometer, gyro] = [2, 3].map(|k| truth.iter().map(|states| states[k]).collect::<Vec<f64>>());
    let sensors: [(&str, f64, NoiseInUse); 2] = [
        ("accelerometer", rms(&accelerometer), |f| {
            f.outputs.iter().map(|o| &o.identification.accelerometer).collect()
        }),
        ("gyro", rms(&gyro), |f| f.outputs.iter().map(|o| &o.identification.gyro).collect()),
    ];
    let mut panels = Vec::new();
    for (sensor, simulated, in_use) in sensors {
        let mut panel = Panel::new("time, h", &format!("log₁₀ σ/truth, {sensor}")).with(Layer::Horizontal {
            label: "rms of the simulated error".to_owned(),
            y: 0.0,
            colour: Colour::Grey,
        });
        for (label, flown, colour) in &flights {
            let ratio =
                in_use(flown).iter().map(|n| (f64::from(n.noise.sigma) / simulated).log10()).collect();
            panel = panel.line(label, &flight::figures::hours(flown), ratio, *colour);
        }
        panels.push(panel);
    }
    for (label, flown, _) in &flights {
        let panel = flight::figures::tilt_error(flown, &truth, &format!("{label}, arc seconds"));
        panels.push(Panel { y_range: Some((-100.0, 100.0)), ..panel });
    }
    Ok(Figure {
        title: "Noise in use and error of the vertical: the published loop beside maximum likelihood"
            .to_owned(),
        panels,
    })
}

/// What `identify` finds of two gyros, one with exponential drift, the other with an exponential-cosine one:
/// autocorrelations, with what was simulated, and Allan deviations.
fn structure_and_noise(directory: &Path, session: &Session) -> Result<[(&'static str, Figure); 2], Failure> {
    let scenario = ScenarioFile::parse("gyro_noise.toml".as_ref(), GYRO_NOISE)?.scenario;
    let written = simulate::simulated(&scenario, session)?.write(directory)?;
    let recording = Recording::read(&written.case)?;
    let found = identify(&recording, identify::Options { longest_lag: 360 });
    let (mut structure, mut noise) = (Vec::new(), Vec::new());
    for ((sensor, gyro), (_, figure)) in
        found.sensors.iter().zip(&scenario.gyros).zip(identify::figures::all(&found))
    {
        let [mut allan, mut autocorrelation] = <[Panel; 2]>::try_from(figure.panels)
            .map_err(|_| anyhow::anyhow!("the identification has other figures"))?;
        let simulated = &gyro.design.readout[0];
        let lags: Vec<f64> =
            (1..sensor.autocorrelation.correlation.len()).map(|k| k as f64 * scenario.step_s).collect();
        let total = |variance: f64| variance + simulated.white * simulated.white / scenario.step_s;
        let truth = lags.iter().map(|lag| match simulated.drift.first() {
            Some(Process::Markov { sigma, tau_s }) => {
                sigma * sigma / total(sigma * sigma) * (-lag / tau_s).exp()
            }
            Some(Process::ExponentialCosine { sigma, alpha, beta }) => {
                sigma * sigma / total(sigma * sigma) * (-alpha * lag).exp() * (beta * lag).cos()
            }
            _ => f64::NAN,
        });
        autocorrelation = autocorrelation.line("simulated", &lags, truth.collect(), Colour::Red);
        let name = sensor.id.replace('_', "-");
        let chosen = sensor.structure.models.first().map_or("nothing", |model| model.name.as_str());
        autocorrelation.y_label = format!("autocorrelation, {name}");
        autocorrelation.x_label = format!("lag, s; chosen: {chosen}");
        allan.y_label = format!("log₁₀ of Allan dev., °/h: {name}");
        structure.push(autocorrelation);
        noise.push(allan);
    }
    let figure = |title: &str, panels| Figure { title: title.to_owned(), panels };
    Ok([
        ("structure", figure("Structure of the drift of two gyros over 40 h", structure)),
        ("noise", figure("Allan deviation of two gyros over 40 h", noise)),
    ])
}

/// Errors of a gyro and an accelerometer on a second run, in another course of temperature, as measured and after
/// compensation with the block of the calibration and a thermometer in real time.
fn compensation(scenario: &CalibrationScenario, calibration: &Calibration) -> Result<Figure, Failure> {
    const SEED: u64 = 77;
    const PROGRAMME: Programme = Programme::UpAndDown { low: 15.0, high: 50.0, period_s: 9000.0, load: 3.0 };
    /// The axis that is shown.
    const AXIS: usize = 0;
    let refused = |error| Failure::Other(anyhow::anyhow!("{error}"));
    let table = CalibrationTable { programme: PROGRAMME, ..scenario.drawn() };
    let record = table.run(SEED);
    // The same run by sensors without fault or noise: what there was to be measured.
    let faultless = CalibrationTable {
        gyro: TriadErrors::default(),
        accelerometer: TriadErrors::default(),
        angle_random_walk: 0.0,
        force_noise: 0.0,
        ..table
    };
    let truth = faultless.run(SEED);

    let compensator = Compensator::try_build(&calibration.compensation_block()).map_err(refused)?;
    let config = TemperatureRateConfig::of_quantum(scenario.step_k as f32);
    let mut thermometer = TemperatureRate::<f32>::try_build(&config).map_err(refused)?;
    let readings = record.thermometer(scenario.step_k, scenario.white_k, SEED);
    let corrections: Vec<_> = readings
        .iter()
        .enumerate()
        .map(|(second, reading)| {
            let output = thermometer.step(1000 * second as u64, &Reading::good(*reading as f32));
            compensator.correction(&ThermalState::from(&output))
        })
        .collect();

    // A rotation there and back, with both dwells: within it the rates cancel out, and the noise is small.
    let period_s = (2.0 * (table.rotation_s + table.dwell_s)) as usize;
    let mean_of = |of: fn(&CycleRecord) -> &Vec<[f64; 3]>,
                   corrected: &dyn Fn(usize, [f64; 3]) -> [f64; 3]|
     -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (mut hours, mut before, mut after) = (Vec::new(), Vec::new(), Vec::new());
        let samples = table.samples_per_second;
        for (cycle, true_cycle) in record.cycles.iter().zip(&truth.cycles) {
            let pairs: Vec<_> = of(cycle).iter().zip(of(true_cycle)).enumerate().collect();
            for (k, period) in pairs.chunks_exact(period_s * samples).enumerate() {
                let mean = |error: &ErrorAt<'_>| {
                    period.iter().map(|(i, (m, t))| error(*i, m, t)).sum::<f64>() / period.len() as f64
                };
                hours.push((cycle.began_s as f64 + (k as f64 + 0.5) * period_s as f64) / 3600.0);
                before.push(mean(&|_, measured, truth| measured[AXIS] - truth[AXIS]));
                after.push(mean(&|i, measured, truth| {
                    corrected(cycle.began_s + i / samples, *measured)[AXIS] - truth[AXIS]
                }));
            }
            for values in [&mut hours, &mut before, &mut after] {
                values.push(f64::NAN);
            }
        }
        (hours, before, after)
    };
    let gyro = mean_of(|cycle| &cycle.rate, &|second, m| corrections[second].rate(m));
    let accelerometer =
        mean_of(|cycle| &cycle.specific_force, &|second, m| corrections[second].specific_force(m));

    let mut panels = vec![temperature_panel(&record, &readings)];
    let root = (period_s as f64).sqrt();
    let shown = [
        ("gyro error, °/h", gyro, 3600.0_f64.to_degrees(), table.angle_random_walk),
        ("accelerometer error, mm/s²", accelerometer, 1000.0, table.force_noise),
    ];
    for (label, (hours, before, after), factor, white) in shown {
        let scaled = |values: &[f64]| values.iter().map(|v| v * factor).collect::<Vec<f64>>();
        panels.push(
            Panel::new("time, h", label).line("as measured", &hours, scaled(&before), Colour::Orange).line(
                "compensated",
                &hours,
                scaled(&after),
                Colour::Blue,
            ),
        );
        let noise = vec![3.0 * white / root * factor; hours.len()];
        panels.push(
            Panel::new("time, h", label)
                .band(
                    "noise of the mean, ±3σ",
                    &hours,
                    noise.iter().map(|v| -v).collect(),
                    noise,
                    Colour::Sky,
                )
                .line("compensated", &hours, scaled(&after), Colour::Blue),
        );
    }
    Ok(Figure {
        title: format!(
            "Compensation on another run than the calibrated one (x axis, means over {period_s} s)"
        ),
        panels,
    })
}

fn temperature_panel(record: &TableRecord, readings: &[f64]) -> Panel {
    let hours: Vec<f64> = (0..readings.len()).map(|second| second as f64 / 3600.0).collect();
    let truth = record.temperature.iter().map(|t| t.temperature).collect();
    Panel::new("time, h", "temperature, °C").line("thermometer", &hours, readings.to_vec(), Colour::Sky).line(
        "truth",
        &hours,
        truth,
        Colour::Black,
    )
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
