//! The flight module's outputs as figures.
use schuler_core::health::HealthStatus;
use schuler_core::isolation::Verdict;
use schuler_core::module::{Status, StepOutput};
use schuler_core::thermal::{TemperatureRateOutput, ThermalStatus};

use super::Flown;
use super::outputs::health_code;
use super::summary::{Summary, was_used};
use super::truth::LoopTruth;
use crate::plot::{Colour, Figure, Layer, Panel};

const ARC_SECONDS: f64 = 180.0 / std::f64::consts::PI * 3600.0;
const DEGREES_PER_HOUR: f64 = 180.0 / std::f64::consts::PI * 3600.0;
const MICRO_G: f64 = 1e6 / 9.80665;

/// Factor and label of each state on a figure.
const SHOWN: [(f64, &str); 4] = [
    (1.0, "velocity error ΔV, m/s"),
    (ARC_SECONDS, "tilt δ, arc seconds"),
    (MICRO_G, "accelerometer error a, µg"),
    (DEGREES_PER_HOUR, "gyro drift ω, °/h"),
];

/// Every figure of a run with the name of its file.
pub fn all(flown: &Flown, summary: &Summary, truth: Option<&LoopTruth>) -> Vec<(String, Figure)> {
    let name = &flown.channel.name;
    let mut figures = Vec::new();
    if flown.channel.has_velocity {
        figures.push((format!("{name}_estimates"), estimates(flown, summary, truth)));
        figures.push((format!("{name}_innovations"), innovations(flown, summary)));
    }
    if flown.channel.gyros.is_some() {
        figures.push((format!("{name}_isolation"), isolation(flown, summary)));
    }
    if !flown.channel.thermometers.is_empty() {
        figures.push((format!("{name}_temperature"), temperature(flown)));
    }
    if flown.channel.has_health {
        figures.push((format!("{name}_health"), health(flown)));
    }
    figures
}

/// Hours since the first step.
pub fn hours(flown: &Flown) -> Vec<f64> {
    let start = flown.channel.time_s.first().copied().unwrap_or_default();
    flown.channel.time_s.iter().map(|t| (t - start) / 3600.0).collect()
}

fn retunings(panel: Panel, summary: &Summary, start_s: f64) -> Panel {
    let times = summary.identification.as_ref().map(|it| it.retuned_at_s.as_slice()).unwrap_or_default();
    times.iter().enumerate().fold(panel, |panel, (k, t)| {
        let label = if k == 0 { "retuned" } else { "" };
        panel.with(Layer::Vertical {
            label: label.to_owned(),
            x: (t - start_s) / 3600.0,
            colour: Colour::Grey,
        })
    })
}

/// The four states with three standard deviations, and the truth.
fn estimates(flown: &Flown, summary: &Summary, truth: Option<&LoopTruth>) -> Figure {
    let x = hours(flown);
    let start_s = flown.channel.time_s.first().copied().unwrap_or_default();
    let panels = SHOWN.iter().enumerate().map(|(k, (factor, label))| {
        let panel = state_panel(&x, &flown.outputs, k, *factor, label, truth);
        retunings(panel, summary, start_s)
    });
    Figure { title: format!("{}: estimates ± 3σ", flown.channel.name), panels: panels.collect() }
}

fn state_panel(
    x: &[f64],
    outputs: &[StepOutput],
    k: usize,
    factor: f64,
    label: &str,
    truth: Option<&LoopTruth>,
) -> Panel {
    let estimate = |o: &StepOutput| f64::from(o.identification.averaged.estimate[k]) * factor;
    let sigma = |o: &StepOutput| f64::from(o.identification.averaged.sigma[k]) * factor;
    let panel = Panel::new("time, h", label)
        .band(
            "±3σ",
            x,
            outputs.iter().map(|o| estimate(o) - 3.0 * sigma(o)).collect(),
            outputs.iter().map(|o| estimate(o) + 3.0 * sigma(o)).collect(),
            Colour::Sky,
        )
        .line("estimate", x, outputs.iter().map(estimate).collect(), Colour::Blue);
    match truth {
        Some(truth) => {
            panel.line("truth", x, truth.states[k].iter().map(|v| v * factor).collect(), Colour::Red)
        }
        None => panel,
    }
}

/// Error of the tilt against three standard deviations, for a figure that compares runs.
pub fn tilt_error(flown: &Flown, truth: &LoopTruth, label: &str) -> Panel {
    let x = hours(flown);
    let sigma = |o: &StepOutput| 3.0 * f64::from(o.identification.averaged.sigma[1]) * ARC_SECONDS;
    let error = flown
        .outputs
        .iter()
        .zip(&truth.states[1])
        .map(|(o, truth)| (f64::from(o.identification.averaged.estimate[1]) - truth) * ARC_SECONDS)
        .collect();
    Panel::new("time, h", label)
        .band(
            "±3σ",
            &x,
            flown.outputs.iter().map(|o| -sigma(o)).collect(),
            flown.outputs.iter().map(sigma).collect(),
            Colour::Sky,
        )
        .line("error of the vertical", &x, error, Colour::Blue)
}

fn innovations(flown: &Flown, summary: &Summary) -> Figure {
    let x = hours(flown);
    let outputs = &flown.outputs;
    let spread = |o: &StepOutput| 3.0 * f64::from(o.filter.innovation_variance).sqrt();
    let used = |value: &dyn Fn(&StepOutput) -> f64| -> Vec<f64> {
        outputs.iter().map(|o| if was_used(o) { value(o) } else { f64::NAN }).collect()
    };
    let innovation = used(&|o| f64::from(o.filter.innovation));
    let above: Vec<f64> =
        outputs.iter().map(|o| if spread(o) > 0.0 { spread(o) } else { f64::NAN }).collect();
    let below = above.iter().map(|v| -v).collect();
    let limit = 1.5 * quantile(innovation.iter().chain(&above), 0.98);
    let mut first = Panel::new("time, h", "innovation, m/s")
        .band("±3√S", &x, below, above, Colour::Sky)
        .points("innovation", &x, innovation, Colour::Blue);
    if limit > 0.0 {
        // The first seconds, when the velocity is hardly known, would hide all the rest.
        first.y_range = Some((-limit, limit));
    }
    let mut panels = vec![first];
    let window = (outputs.len() / 100).clamp(10, 600);
    let nis = used(&|o| f64::from(o.filter.nis));
    let (centres, means): (Vec<f64>, Vec<f64>) = x
        .chunks(window)
        .zip(nis.chunks(window))
        .filter_map(|(x, nis)| {
            let present: Vec<f64> = nis.iter().copied().filter(|v| v.is_finite()).collect();
            let mean = present.iter().sum::<f64>() / present.len() as f64;
            x.get(x.len() / 2).map(|centre| (*centre, mean))
        })
        .unzip();
    let level = |label: &str, y: f64| Layer::Horizontal { label: label.to_owned(), y, colour: Colour::Grey };
    let spread = (2.0 / window as f64).sqrt() * 1.96;
    panels.push(
        Panel::new("time, h", &format!("mean NIS of {window} steps"))
            .line("mean NIS", &centres, means, Colour::Blue)
            .with(level("95 % of a consistent filter", 1.0 + spread))
            .with(level("", (1.0 - spread).max(0.0))),
    );
    let since = outputs.iter().rposition(|o| o.status.contains(Status::RETUNED)).map_or(0, |last| last + 1);
    panels.push(correlogram(outputs.get(since..).unwrap_or_default(), since > 0));
    let judged = summary.filter_since_retuning.as_ref().or(summary.filter.as_ref());
    let whiteness = judged.map_or(f64::NAN, |f| f.whiteness.p_value);
    let when = if since > 0 { " since the last retuning" } else { "" };
    Figure {
        title: format!("{}: innovations (whiteness{when}: p = {whiteness:.2e})", flown.channel.name),
        panels,
    }
}

/// The value below which this share of the finite magnitudes lies; zero without any.
fn quantile<'v>(values: impl Iterator<Item = &'v f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.map(|v| v.abs()).filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let index = (share * sorted.len() as f64) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied().unwrap_or_default()
}

/// Autocorrelation of the normalised innovations.
fn correlogram(outputs: &[StepOutput], retuned: bool) -> Panel {
    let values: Vec<f64> = outputs
        .iter()
        .map(|o| {
            let s = f64::from(o.filter.innovation_variance).sqrt();
            if was_used(o) { f64::from(o.filter.innovation) / s } else { f64::NAN }
        })
        .collect();
    let product = |lag: usize| {
        let pairs = values.iter().zip(values.get(lag..).unwrap_or_default());
        let (sum, n) = pairs
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .fold((0.0, 0.0f64), |(sum, n), (a, b)| (sum + a * b, n + 1.0));
        (sum / n.max(1.0), n)
    };
    let (power, n) = product(0);
    let lags = (values.len() / 4).min(100);
    let x: Vec<f64> = (1..=lags).map(|lag| lag as f64).collect();
    let r = (1..=lags).map(|lag| product(lag).0 / power).collect();
    let bound = 1.96 / n.max(1.0).sqrt();
    let level = |label: &str, y: f64| Layer::Horizontal { label: label.to_owned(), y, colour: Colour::Grey };
    let label = if retuned { "innovations since the last retuning" } else { "innovations" };
    Panel::new("lag, steps", "autocorrelation")
        .points(label, &x, r, Colour::Blue)
        .with(level("95 % of a white series", bound))
        .with(level("", -bound))
}

/// The block's statistics over time.
fn isolation(flown: &Flown, summary: &Summary) -> Figure {
    let x = hours(flown);
    let start_s = flown.channel.time_s.first().copied().unwrap_or_default();
    let outputs = &flown.outputs;
    let parity = |k: usize| {
        outputs
            .iter()
            .map(|o| if o.isolation.parity == [0.0; 2] { f64::NAN } else { o.isolation.parity[k] })
            .collect()
    };
    let marked = |panel: Panel| {
        let changes = summary.gyros.as_ref().map(|it| it.verdicts.as_slice()).unwrap_or_default();
        let faults = changes.iter().filter(|change| change.verdict == "fault").take(8);
        faults.fold(panel, |panel, change| {
            let gyro = change.gyro.as_deref().unwrap_or_default();
            panel.with(Layer::Vertical {
                label: format!("fault of {gyro} isolated"),
                x: (change.time_s - start_s) / 3600.0,
                colour: Colour::Red,
            })
        })
    };
    let panels = vec![
        marked(Panel::new("time, h", "parity, σ").points("first", &x, parity(0), Colour::Blue).points(
            "second",
            &x,
            parity(1),
            Colour::Orange,
        )),
        marked(
            Panel::new("time, h", "statistic / threshold")
                .line(
                    "alarm level",
                    &x,
                    outputs.iter().map(|o| o.isolation.alarm_level).collect(),
                    Colour::Blue,
                )
                .with(Layer::Horizontal { label: "alarm".to_owned(), y: 1.0, colour: Colour::Grey }),
        ),
        (0..3).fold(Panel::new("time, h", "body rate, °/h"), |panel, k| {
            let rate = outputs
                .iter()
                .map(|o| {
                    let valid = o.isolation.verdict != Verdict::BlockUntrusted;
                    if valid { o.isolation.rate[k] * DEGREES_PER_HOUR } else { f64::NAN }
                })
                .collect();
            panel.line(["x", "y", "z"][k], &x, rate, Colour::nth(k))
        }),
    ];
    Figure { title: format!("{}: five gyros", flown.channel.name), panels }
}

/// Temperatures and their rates.
fn temperature(flown: &Flown) -> Figure {
    let x = hours(flown);
    let known = |k: usize, of: &dyn Fn(&TemperatureRateOutput<f32>) -> f32, unknown: ThermalStatus| {
        let value = |o: &StepOutput| {
            let it = o.thermometers.get(k).filter(|it| !it.status.intersects(unknown));
            it.map_or(f64::NAN, |it| f64::from(of(it)))
        };
        flown.outputs.iter().map(value).collect::<Vec<f64>>()
    };
    let mut first = Panel::new("time, h", "temperature, °C");
    let mut second = Panel::new("time, h", "rate, °C/h");
    for (k, column) in flown.channel.thermometers.iter().enumerate() {
        let unsettled = ThermalStatus::NO_READING | ThermalStatus::SETTLING;
        let temperature = known(k, &|it| it.temperature, ThermalStatus::NO_READING);
        let rate = known(k, &|it| it.rate * 3600.0, unsettled);
        first = first.line(column, &x, temperature, Colour::nth(k));
        second = second.line(column, &x, rate, Colour::nth(k));
    }
    Figure { title: format!("{}: thermometers", flown.channel.name), panels: vec![first, second] }
}

/// The residual, the probabilities of a fault, and the verdict.
fn health(flown: &Flown) -> Figure {
    let x = hours(flown);
    let outputs = &flown.outputs;
    let line = |of: &dyn Fn(&StepOutput) -> f64| -> Vec<f64> { outputs.iter().map(of).collect() };
    let unusable = HealthStatus::RADIO_UNUSABLE | HealthStatus::INERTIAL_UNUSABLE;
    let residual = line(&|o| {
        if o.health.status.intersects(unusable) { f64::NAN } else { f64::from(o.health.residual) }
    });
    let panels = vec![
        Panel::new("time, h", "radio − inertial, m/s")
            .points("residual", &x, residual, Colour::Sky)
            .line("radio error", &x, line(&|o| f64::from(o.health.radio_error.value)), Colour::Blue)
            .line("inertial error", &x, line(&|o| f64::from(o.health.inertial_error.value)), Colour::Orange),
        Panel::new("time, h", "probability")
            .line("mean shifted", &x, line(&|o| f64::from(o.health.p_jump)), Colour::Red)
            .line("noise grown", &x, line(&|o| f64::from(o.health.p_noise)), Colour::Purple)
            .line("either", &x, line(&|o| f64::from(o.health.p_fault)), Colour::Black),
        // The axis has numbers; the label says what they are.
        Panel::new("time, h", "verdict (1 nominal, 2 shifted, 3 noisy, 4 both, 5 either, 6 inertial, 7 out)")
            .line("verdict", &x, line(&|o| health_code(o.health.verdict)), Colour::Black),
    ];
    Figure { title: format!("{}: radio against inertial velocity", flown.channel.name), panels }
}
