//! The flight module's outputs as figures, drawn while it flies: of bounded size, however long the flight.
use schuler_core::health::HealthStatus;
use schuler_core::isolation::Verdict;
use schuler_core::module::{Status, StepOutput};
use schuler_core::thermal::{TemperatureRateOutput, ThermalStatus};

use super::outputs::health_code;
use super::summary::{Summary, normalised_innovation, was_used};
use super::truth::LoopStates;
use super::{Channel, Flown, Step};
use crate::output;
use crate::plot::envelope::Envelope;
use crate::plot::{Colour, Figure, Layer, Panel};
use crate::statistics::LagProducts;

const ARC_SECONDS: f64 = 180.0 / std::f64::consts::PI * 3600.0;
const DEGREES_PER_HOUR: f64 = 180.0 / std::f64::consts::PI * 3600.0;
const MICRO_G: f64 = 1e6 / 9.80665;

/// Lags of the autocorrelation of the innovations.
const CORRELOGRAM_LAGS: usize = 100;

/// Factor and label of each state on a figure.
const SHOWN: [(f64, &str); 4] = [
    (1.0, "velocity error ΔV, m/s"),
    (ARC_SECONDS, "tilt δ, arc seconds"),
    (MICRO_G, "accelerometer error a, µg"),
    (DEGREES_PER_HOUR, "gyro drift ω, °/h"),
];

/// What a curve shows of a step: a value, or both edges of a band.
type Shown = Box<dyn Fn(&StepOutput, Option<&LoopStates>) -> [f64; 2]>;

/// A curve that is drawn step by step.
struct Curve {
    label: String,
    colour: Colour,
    form: Form,
    shown: Shown,
    drawn: Envelope,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Line,
    Points,
    Band,
}

/// A panel that is drawn step by step.
struct Drawing {
    y_label: String,
    curves: Vec<Curve>,
}

impl Drawing {
    fn new(y_label: impl Into<String>) -> Self {
        Self { y_label: y_label.into(), curves: Vec::new() }
    }

    fn curve(mut self, form: Form, label: &str, colour: Colour, shown: Shown) -> Self {
        let drawn = Envelope::new();
        self.curves.push(Curve { label: label.to_owned(), colour, form, shown, drawn });
        self
    }

    fn line(self, label: &str, colour: Colour, y: impl Fn(&StepOutput) -> f64 + 'static) -> Self {
        self.curve(Form::Line, label, colour, Box::new(move |o, _| [y(o); 2]))
    }

    fn points(self, label: &str, colour: Colour, y: impl Fn(&StepOutput) -> f64 + 'static) -> Self {
        self.curve(Form::Points, label, colour, Box::new(move |o, _| [y(o); 2]))
    }

    fn band(self, label: &str, colour: Colour, edges: impl Fn(&StepOutput) -> [f64; 2] + 'static) -> Self {
        self.curve(Form::Band, label, colour, Box::new(move |o, _| edges(o)))
    }

    fn add(&mut self, hours: f64, output: &StepOutput, truth: Option<&LoopStates>) {
        for curve in &mut self.curves {
            let [low, high] = (curve.shown)(output, truth);
            curve.drawn.band(hours, low, high);
        }
    }

    fn finish(self) -> Panel {
        let panel = Panel::new("time, h", &self.y_label);
        self.curves.into_iter().fold(panel, |panel, Curve { label, colour, form, drawn, .. }| {
            panel.with(match form {
                Form::Band => {
                    let (x, low, high) = drawn.into_band();
                    Layer::Band { label, x, low, high, colour }
                }
                Form::Line => {
                    let (x, y) = drawn.into_line();
                    Layer::Line { label, x, y, colour }
                }
                Form::Points => {
                    let (x, y) = drawn.into_line();
                    Layer::Points { label, x, y, colour }
                }
            })
        })
    }
}

/// The figures of a channel, drawn step by step.
pub struct Figures<'c> {
    channel: &'c Channel,
    start_s: Option<f64>,
    estimates: Vec<Drawing>,
    innovations: Vec<Drawing>,
    nis: MeanNis,
    since_retuning: LagProducts,
    retuned: bool,
    isolation: Vec<Drawing>,
    temperature: Vec<Drawing>,
    health: Vec<Drawing>,
}

impl<'c> Figures<'c> {
    /// Of a channel of so many steps, and of the truth, if it is known.
    pub fn of(channel: &'c Channel, steps: usize, with_truth: bool) -> Self {
        let drawn = |is_there: bool, panels: fn(&Channel) -> Vec<Drawing>| {
            if is_there { panels(channel) } else { Vec::new() }
        };
        Self {
            channel,
            start_s: None,
            estimates: if channel.has_velocity { estimates(with_truth) } else { Vec::new() },
            innovations: drawn(channel.has_velocity, |_| vec![innovations()]),
            nis: MeanNis::over((steps / 100).clamp(10, 600)),
            since_retuning: LagProducts::new(CORRELOGRAM_LAGS),
            retuned: false,
            isolation: drawn(channel.gyros.is_some(), |_| isolation()),
            temperature: drawn(!channel.thermometers.is_empty(), temperature),
            health: drawn(channel.has_health, |_| health()),
        }
    }

    /// Takes the next step, with the truth where it is known.
    pub fn add(&mut self, step: &Step, output: &StepOutput, truth: Option<&LoopStates>) {
        let hours = (step.time_s - *self.start_s.get_or_insert(step.time_s)) / 3600.0;
        let all = [
            &mut self.estimates,
            &mut self.innovations,
            &mut self.isolation,
            &mut self.temperature,
            &mut self.health,
        ];
        for drawing in all.into_iter().flatten() {
            drawing.add(hours, output, truth);
        }
        self.nis.add(hours, if was_used(output) { f64::from(output.filter.nis) } else { f64::NAN });
        self.since_retuning.add(normalised_innovation(output));
        if output.status.contains(Status::RETUNED) {
            self.since_retuning = LagProducts::new(CORRELOGRAM_LAGS);
            self.retuned = true;
        }
    }

    /// The figures with the names of their files.
    pub fn finish(self, summary: &Summary) -> Vec<(String, Figure)> {
        let name = &self.channel.name;
        let file_name = output::file_name(name);
        let start_s = self.start_s.unwrap_or_default();
        let mut figures = Vec::new();
        let mut put = |kind: &str, title: String, panels: Vec<Panel>| {
            if !panels.is_empty() {
                figures.push((
                    format!("{file_name}_{kind}"),
                    Figure { title: format!("{name}: {title}"), panels },
                ));
            }
        };
        let finished = |drawings: Vec<Drawing>| drawings.into_iter().map(Drawing::finish);

        let estimates = finished(self.estimates).map(|panel| retunings(panel, summary, start_s));
        put("estimates", "estimates ± 3σ".to_owned(), estimates.collect());

        let mut innovations: Vec<Panel> = finished(self.innovations).map(without_transient).collect();
        if !innovations.is_empty() {
            innovations.push(self.nis.finish());
            innovations.push(correlogram(&self.since_retuning, self.retuned));
        }
        let judged = summary.filter_since_retuning.as_ref().or(summary.filter.as_ref());
        let whiteness = judged.map_or(f64::NAN, |f| f.whiteness.p_value);
        let when = if self.retuned { " since the last retuning" } else { "" };
        put("innovations", format!("innovations (whiteness{when}: p = {whiteness:.2e})"), innovations);

        let mut isolation: Vec<Panel> = finished(self.isolation).collect();
        if let [parity, alarm, ..] = &mut isolation[..] {
            alarm.layers.push(level("alarm", 1.0));
            for panel in [parity, alarm] {
                panel.layers.extend(faults(summary, start_s));
            }
        }
        put("isolation", "five gyros".to_owned(), isolation);
        put("temperature", "thermometers".to_owned(), finished(self.temperature).collect());
        put("health", "radio against inertial velocity".to_owned(), finished(self.health).collect());
        figures
    }
}

/// Hours since the first step.
pub fn hours(flown: &Flown) -> Vec<f64> {
    let start_s = flown.steps.first().map_or(0.0, |step| step.time_s);
    flown.steps.iter().map(|step| (step.time_s - start_s) / 3600.0).collect()
}

fn level(label: &str, y: f64) -> Layer {
    Layer::Horizontal { label: label.to_owned(), y, colour: Colour::Grey }
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
fn estimates(with_truth: bool) -> Vec<Drawing> {
    let panel = |(k, (factor, label)): (usize, (f64, &str))| {
        let estimate = move |o: &StepOutput| f64::from(o.identification.averaged.estimate[k]) * factor;
        let sigma = move |o: &StepOutput| f64::from(o.identification.averaged.sigma[k]) * factor;
        let drawing = Drawing::new(label)
            .band("±3σ", Colour::Sky, move |o| [-3.0, 3.0].map(|n| estimate(o) + n * sigma(o)))
            .line("estimate", Colour::Blue, estimate);
        if with_truth {
            let truth = move |_: &StepOutput, truth: Option<&LoopStates>| {
                [truth.map_or(f64::NAN, |truth| truth[k] * factor); 2]
            };
            drawing.curve(Form::Line, "truth", Colour::Red, Box::new(truth))
        } else {
            drawing
        }
    };
    SHOWN.into_iter().enumerate().map(panel).collect()
}

/// Error of the tilt against three standard deviations, for a figure that compares runs.
pub fn tilt_error(flown: &Flown, truth: &[LoopStates], label: &str) -> Panel {
    let x = hours(flown);
    let sigma = |o: &StepOutput| 3.0 * f64::from(o.identification.averaged.sigma[1]) * ARC_SECONDS;
    let error = (flown.outputs.iter().zip(truth))
        .map(|(o, truth)| (f64::from(o.identification.averaged.estimate[1]) - truth[1]) * ARC_SECONDS)
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

/// The innovations with their standard deviation.
fn innovations() -> Drawing {
    let spread = |o: &StepOutput| {
        let spread = 3.0 * f64::from(o.filter.innovation_variance).sqrt();
        if spread > 0.0 { [-spread, spread] } else { [f64::NAN; 2] }
    };
    let innovation = |o: &StepOutput| if was_used(o) { f64::from(o.filter.innovation) } else { f64::NAN };
    Drawing::new("innovation, m/s").band("±3√S", Colour::Sky, spread).points(
        "innovation",
        Colour::Blue,
        innovation,
    )
}

/// With limits that the first seconds, when the velocity is hardly known, do not set: they would hide all the rest.
fn without_transient(mut panel: Panel) -> Panel {
    let values = panel.layers.iter().flat_map(|layer| match layer {
        Layer::Band { high, .. } => high.as_slice(),
        Layer::Points { y, .. } => y.as_slice(),
        _ => &[],
    });
    let limit = 1.5 * quantile(values, 0.98);
    panel.y_range = (limit > 0.0).then_some((-limit, limit));
    panel
}

/// The value below which this share of the finite magnitudes lies; zero without any.
fn quantile<'v>(values: impl Iterator<Item = &'v f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.map(|v| v.abs()).filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let index = (share * sorted.len() as f64) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied().unwrap_or_default()
}

/// Means of the normalised innovations squared over windows of steps.
struct MeanNis {
    window: usize,
    steps: usize,
    /// Time in the middle of the window, h.
    centre: f64,
    sum: f64,
    used: f64,
    drawn: Envelope,
}

impl MeanNis {
    fn over(window: usize) -> Self {
        Self { window, steps: 0, centre: 0.0, sum: 0.0, used: 0.0, drawn: Envelope::new() }
    }

    fn add(&mut self, hours: f64, nis: f64) {
        if self.steps <= self.window / 2 {
            self.centre = hours;
        }
        if nis.is_finite() {
            self.sum += nis;
            self.used += 1.0;
        }
        self.steps += 1;
        if self.steps == self.window {
            self.draw();
        }
    }

    fn draw(&mut self) {
        self.drawn.line(self.centre, self.sum / self.used);
        (self.steps, self.sum, self.used) = (0, 0.0, 0.0);
    }

    fn finish(mut self) -> Panel {
        if self.steps > 0 {
            self.draw();
        }
        let (x, means) = self.drawn.into_line();
        let spread = (2.0 / self.window as f64).sqrt() * 1.96;
        Panel::new("time, h", &format!("mean NIS of {} steps", self.window))
            .line("mean NIS", &x, means, Colour::Blue)
            .with(level("95 % of a consistent filter", 1.0 + spread))
            .with(level("", (1.0 - spread).max(0.0)))
    }
}

/// Autocorrelation of the normalised innovations.
fn correlogram(innovations: &LagProducts, retuned: bool) -> Panel {
    let n = innovations.count();
    let lags = (n as usize / 4).min(CORRELOGRAM_LAGS);
    let x: Vec<f64> = (1..=lags).map(|lag| lag as f64).collect();
    let r = (1..=lags).map(|lag| innovations.mean(lag) / innovations.mean(0)).collect();
    let bound = 1.96 / n.max(1.0).sqrt();
    let label = if retuned { "innovations since the last retuning" } else { "innovations" };
    Panel::new("lag, steps", "autocorrelation")
        .points(label, &x, r, Colour::Blue)
        .with(level("95 % of a white series", bound))
        .with(level("", -bound))
}

/// The block's statistics over time.
fn isolation() -> Vec<Drawing> {
    let parity = |k: usize| {
        move |o: &StepOutput| {
            if o.isolation.parity == [0.0; 2] { f64::NAN } else { o.isolation.parity[k] }
        }
    };
    let rate = |k: usize| {
        move |o: &StepOutput| {
            let valid = o.isolation.verdict != Verdict::BlockUntrusted;
            if valid { o.isolation.rate[k] * DEGREES_PER_HOUR } else { f64::NAN }
        }
    };
    vec![
        Drawing::new("parity, σ").points("first", Colour::Blue, parity(0)).points(
            "second",
            Colour::Orange,
            parity(1),
        ),
        Drawing::new("statistic / threshold").line("alarm level", Colour::Blue, |o| o.isolation.alarm_level),
        (0..3).fold(Drawing::new("body rate, °/h"), |drawing, k| {
            drawing.line(["x", "y", "z"][k], Colour::nth(k), rate(k))
        }),
    ]
}

/// When faults were isolated.
fn faults(summary: &Summary, start_s: f64) -> impl Iterator<Item = Layer> {
    let changes = summary.gyros.as_ref().map(|it| it.verdicts.as_slice()).unwrap_or_default();
    changes.iter().filter(|change| change.verdict == "fault").take(8).map(move |change| Layer::Vertical {
        label: format!("fault of {} isolated", change.gyro.as_deref().unwrap_or_default()),
        x: (change.time_s - start_s) / 3600.0,
        colour: Colour::Red,
    })
}

/// Temperatures and their rates.
fn temperature(channel: &Channel) -> Vec<Drawing> {
    type Of = fn(&TemperatureRateOutput<f32>) -> f32;
    let known = |k: usize, of: Of, unknown: ThermalStatus| {
        move |o: &StepOutput| {
            let it = o.thermometers.get(k).filter(|it| !it.status.intersects(unknown));
            it.map_or(f64::NAN, |it| f64::from(of(it)))
        }
    };
    let all = |label: &str, of: Of, unknown: ThermalStatus| {
        let columns = channel.thermometers.iter().enumerate();
        columns.fold(Drawing::new(label), |drawing, (k, column)| {
            drawing.line(column, Colour::nth(k), known(k, of, unknown))
        })
    };
    let unsettled = ThermalStatus::NO_READING | ThermalStatus::SETTLING;
    vec![
        all("temperature, °C", |it| it.temperature, ThermalStatus::NO_READING),
        all("rate, °C/h", |it| it.rate * 3600.0, unsettled),
    ]
}

/// The residual, the probabilities of a fault, and the verdict.
fn health() -> Vec<Drawing> {
    let unusable = HealthStatus::RADIO_UNUSABLE | HealthStatus::INERTIAL_UNUSABLE;
    let residual = move |o: &StepOutput| {
        if o.health.status.intersects(unusable) { f64::NAN } else { f64::from(o.health.residual) }
    };
    vec![
        Drawing::new("radio − inertial, m/s")
            .points("residual", Colour::Sky, residual)
            .line("radio error", Colour::Blue, |o| f64::from(o.health.radio_error.value))
            .line("inertial error", Colour::Orange, |o| f64::from(o.health.inertial_error.value)),
        Drawing::new("probability")
            .line("mean shifted", Colour::Red, |o| f64::from(o.health.p_jump))
            .line("noise grown", Colour::Purple, |o| f64::from(o.health.p_noise))
            .line("either", Colour::Black, |o| f64::from(o.health.p_fault)),
        // The axis has numbers; the label says what they are.
        Drawing::new("verdict (1 nominal, 2 shifted, 3 noisy, 4 both, 5 either, 6 inertial, 7 out)").line(
            "verdict",
            Colour::Black,
            |o| health_code(o.health.verdict),
        ),
    ]
}
