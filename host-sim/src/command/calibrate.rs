//! `schuler calibrate CASE.toml`: all coefficients from one run at changing temperature, with what was observable.
use std::path::{Path, PathBuf};

use schuler_core::thermal::CompensationBlock;
use schuler_explain::calibration::{
    Calibration, CalibrationError, Coefficient, CycleReport, Determination, Element, Experiment, Feature,
    ThermalPoint, Verdict, calibrate_watched,
};
use schuler_recording::{Error, Problem};
use serde::Serialize;

use super::Failure;
use super::fly::write_json;
use super::memory::{self, Need};
use super::session::Session;
use super::text::put;
use crate::calibration_table::recorded::{TRUTH, TrueElement, truth_beside};
use crate::output::{self, Interrupted};
use crate::plot::{Colour, Figure, Format, Layer, Panel};

/// Name of the compensation file.
const COMPENSATION: &str = "compensation.toml";
/// What runs to the right in the figure of the coefficients.
const ORDER: &str = "coefficient, in the order of the table";
/// A value further from zero than this many prior standard deviations is not plausible.
const IMPLAUSIBLE: f64 = 3.0;

/// Memory that calibrating takes for each value of the recording; 13 bytes were measured over what a program takes.
const NEED: Need = Need { row: 0, value: 25 };

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Coefficients of a whole unit from one run, and what the run cannot tell:
    schuler calibrate run_3/case.toml --out out/calibration";

/// What to calibrate.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Case file with a part [calibration].
    case: PathBuf,
    /// Directory for the compensation file, the results and the figures; without it nothing is written.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw coefficients and temperatures, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
}

/// What a calibration says.
#[derive(Debug, Serialize)]
pub(super) struct Answer {
    format: &'static str,
    case: PathBuf,
    title: String,
    coefficients: Vec<Row>,
    undetermined: Vec<Undetermined>,
    verdicts: Vec<String>,
    cycles: Vec<CycleReport>,
    /// Mean normalised innovation squared; one if the model is right.
    nis: f64,
    measurements: usize,
    /// degC.
    temperature_range: [f64; 2],
    /// degC/s.
    rate_limit: f64,
    /// Beside a simulation: root mean square of the errors in standard deviations, and the share beyond three of them.
    truth: Option<Agreement>,
    files: Vec<PathBuf>,
    warnings: Vec<String>,
}

/// One coefficient.
#[derive(Debug, Serialize)]
struct Row {
    element: String,
    /// What it goes with: constant at 35 degC, temperature for 30 K, rate for 20 K/h, gradient for 5 K/m.
    feature: String,
    value: f64,
    sigma: f64,
    prior_sigma: f64,
    unit: &'static str,
    determination: Determination,
    /// Within three prior standard deviations.
    plausible: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<f64>,
}

/// An element of which a combination of parts was not determined, and why.
#[derive(Debug, Serialize)]
struct Undetermined {
    element: String,
    determination: Determination,
    why: String,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Agreement {
    rms_of_error_over_sigma: f64,
    beyond_three_sigma: f64,
}

impl Arguments {
    /// A case, everything into a directory, figures as pixels.
    pub(super) fn into_directory(case: &Path, out: &Path) -> Self {
        Self { case: case.to_owned(), out: Some(out.to_owned()), plot: vec![Format::Png] }
    }
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let (answer, found) = made(arguments, session)?;
    session.answer(&answer, |answer| words(answer, &found))
}

/// Calibrates and writes what is asked for.
pub(super) fn made(arguments: &Arguments, session: &Session) -> Result<(Answer, Calibration), Failure> {
    let file = session.case(&arguments.case)?;
    let lines = file.lines.clone();
    let at_fault = |mut problem: Problem| {
        problem.line = problem.line.or_else(|| lines.get(&problem.field));
        Failure::from(Error::one(&arguments.case, problem))
    };
    let recording = memory::recording(file, NEED, session)?;
    session.warn(&recording.warnings);
    let experiment = Experiment::of_recording(&recording).map_err(at_fault)?;
    output::protect(&arguments.case.with_file_name(TRUTH));
    let truth = truth_beside(&arguments.case)?;
    let progress = session.progress("calibrating", 1);
    let found =
        calibrate_watched(&experiment, &|done, all| progress.of(done, all).is_ok()).map_err(|error| {
            match error {
                CalibrationError::Stopped => Failure::Stopped(Interrupted),
                CalibrationError::Invalid { field, problem } => {
                    let field = field.replacen("cycles[", "cycle[", 1);
                    at_fault(Problem::new(None, format!("calibration.{field}"), problem))
                }
                numerical @ CalibrationError::Numerical { .. } => Failure::Other(numerical.into()),
            }
        })?;
    drop(progress);

    let rows: Vec<Row> = found.coefficients.iter().map(|c| row(c, truth.as_deref())).collect();
    let mut answer = Answer {
        format: "schuler-calibration/1",
        case: arguments.case.clone(),
        title: recording.case.title.clone(),
        truth: agreement(&rows),
        coefficients: rows,
        undetermined: undetermined(&found),
        verdicts: found.verdicts.iter().map(ToString::to_string).collect(),
        cycles: found.cycles.clone(),
        nis: found.nis,
        measurements: found.measurements,
        temperature_range: found.temperature_range,
        rate_limit: found.rate_limit,
        files: Vec::new(),
        warnings: recording.warnings.clone(),
    };
    if let Some(directory) = &arguments.out {
        let path = directory.join(COMPENSATION);
        let text = compensation_file(&found.compensation_block(), &answer.title)?;
        output::write(&path, text.as_bytes())?;
        answer.files.push(path);
        for (name, figure) in
            [("coefficients", coefficients(&answer.coefficients)), ("run", course(&found, &experiment))]
        {
            answer.files.extend(figure.write(directory, name, &arguments.plot)?);
        }
        let path = directory.join("calibration.json");
        write_json(&path, &answer)?;
        answer.files.push(path);
    }
    Ok((answer, found))
}

/// The block that the flight module corrects with, as a file.
fn compensation_file(block: &CompensationBlock, title: &str) -> Result<String, Failure> {
    let text = toml::to_string(block).map_err(|error| Failure::Other(error.into()))?;
    let title = title.replace(['\n', '\r'], " ");
    Ok(format!(
        "# Thermal compensation found by `schuler calibrate`: {title}\n\
         # Coefficients in rad/s, m/s^2 and 1, of: one, (T - reference)/scale, rate/scale, gradient/scale (x, y, z).\n{text}"
    ))
}

fn row(c: &Coefficient, truth: Option<&[TrueElement]>) -> Row {
    let (unit, factor) = c.element.practical_unit();
    let feature = Feature::ALL.iter().position(|f| *f == c.feature).unwrap_or_default();
    let name = key(c.element);
    let truth = truth.and_then(|all| all.iter().find(|(element, _)| *element == name));
    Row {
        element: c.element.to_string(),
        feature: c.feature.to_string(),
        value: c.value * factor,
        sigma: c.sigma * factor,
        prior_sigma: c.prior_sigma * factor,
        unit,
        determination: c.determination,
        plausible: c.value.abs() <= IMPLAUSIBLE * c.prior_sigma,
        truth: truth.map(|(_, parts)| parts[feature] * c.feature.scale() * factor),
    }
}

/// The element's name in the truth of a simulation.
fn key(element: Element) -> String {
    let axis = |k: usize| ["x", "y", "z"].get(k).copied().unwrap_or("?");
    match element {
        Element::GyroBias(i) => format!("gyro_bias_{}", axis(i)),
        Element::GyroMatrix(i, j) => format!("gyro_matrix_{}{}", axis(i), axis(j)),
        Element::AccelerometerBias(i) => format!("accelerometer_bias_{}", axis(i)),
        Element::AccelerometerMatrix(i, j) => format!("accelerometer_matrix_{}{}", axis(i), axis(j)),
    }
}

fn agreement(rows: &[Row]) -> Option<Agreement> {
    let errors: Vec<f64> = rows.iter().filter_map(|row| Some((row.value - row.truth?) / row.sigma)).collect();
    let count = errors.len() as f64;
    (!errors.is_empty()).then(|| Agreement {
        rms_of_error_over_sigma: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        beyond_three_sigma: errors.iter().filter(|e| e.abs() > 3.0).count() as f64 / count,
    })
}

fn undetermined(found: &Calibration) -> Vec<Undetermined> {
    let not = found.elements.iter().filter(|e| e.determination != Determination::Determined);
    not.map(|e| Undetermined {
        element: e.element.to_string(),
        determination: e.determination,
        why: e.words.clone(),
    })
    .collect()
}

/// Every coefficient with three standard deviations, and its truth.
fn coefficients(rows: &[Row]) -> Figure {
    let kinds = [
        ("gyro bias, deg/h", "gyro", "deg/h"),
        ("gyro matrix, ppm", "gyro", "ppm"),
        ("accelerometer bias, mm/s²", "accelerometer", "mm/s^2"),
        ("accelerometer matrix, ppm", "accelerometer", "ppm"),
    ];
    let panels = kinds.into_iter().filter_map(|(label, sensor, unit)| {
        let of_kind: Vec<&Row> =
            rows.iter().filter(|row| row.element.starts_with(sensor) && row.unit == unit).collect();
        if of_kind.is_empty() {
            return None;
        }
        let places: Vec<f64> = (1..=of_kind.len()).map(|k| k as f64).collect();
        let (mut x, mut bars) = (Vec::new(), Vec::new());
        for (place, row) in places.iter().zip(&of_kind) {
            x.extend([*place, *place, f64::NAN]);
            bars.extend([row.value - 3.0 * row.sigma, row.value + 3.0 * row.sigma, f64::NAN]);
        }
        let truth: Vec<f64> = of_kind.iter().map(|row| row.truth.unwrap_or(f64::NAN)).collect();
        let mut panel = Panel::new(ORDER, label).line("±3σ", &x, bars, Colour::Blue).points(
            "found",
            &places,
            of_kind.iter().map(|row| row.value).collect(),
            Colour::Blue,
        );
        if truth.iter().any(|t| t.is_finite()) {
            panel = panel.points("truth of the simulation", &places, truth, Colour::Red);
        }
        Some(panel)
    });
    let mut panels: Vec<Panel> = panels.collect();
    let places: Vec<f64> = (1..=rows.len()).map(|k| k as f64).collect();
    let kept = rows.iter().map(|row| 100.0 * row.sigma / row.prior_sigma).collect();
    panels.push(Panel::new(ORDER, "share of the prior sigma left, %").line("", &places, kept, Colour::Blue));
    if rows.iter().any(|row| row.truth.is_some()) {
        let error = |row: &Row| row.truth.map_or(f64::NAN, |truth| (row.value - truth) / row.sigma);
        let mut panel = Panel::new(ORDER, "error, standard deviations");
        for y in [-3.0, 3.0] {
            panel = panel.with(Layer::Horizontal { label: String::new(), y, colour: Colour::Grey });
        }
        panels.push(panel.line("", &places, rows.iter().map(error).collect(), Colour::Red));
    }
    Figure { title: "Coefficients found by the calibration".to_owned(), panels }
}

/// What the temperature did in every cycle, and the gyros' biases with it.
fn course(found: &Calibration, experiment: &Experiment) -> Figure {
    let mut temperature = Panel::new("time within the cycles, h", "temperature, °C");
    let mut rate = Panel::new("time within the cycles, h", "its rate, °C/h");
    let mut bias = Panel::new("time within the cycles, h", "gyro bias found, °/h");
    let mut started = 0.0;
    for (k, cycle) in experiment.cycles.iter().enumerate() {
        let seconds = (cycle.rate.len() as f64 * experiment.sample_s).round();
        let points = cycle.thermometry.points(seconds as usize);
        let x: Vec<f64> = (0..points.len()).map(|s| (started + s as f64) / 3600.0).collect();
        temperature = temperature.line("", &x, points.iter().map(|p| p.temperature).collect(), Colour::Blue);
        rate = rate.line("", &x, points.iter().map(|p| p.rate * 3600.0).collect(), Colour::Blue);
        for axis in 0..3 {
            let values = points.iter().map(|p| bias_at(found, axis, p)).collect();
            let label = if k == 0 { ["x", "y", "z"][axis] } else { "" };
            bias = bias.line(label, &x, values, Colour::nth(axis));
        }
        started += seconds;
        if k + 1 < experiment.cycles.len() {
            let remounted = Layer::Vertical {
                label: if k == 0 { "mounted anew".to_owned() } else { String::new() },
                x: started / 3600.0,
                colour: Colour::Grey,
            };
            temperature = temperature.with(remounted);
        }
    }
    Figure { title: "Calibration run".to_owned(), panels: vec![temperature, rate, bias] }
}

/// Bias of a gyro at a temperature, deg/h.
fn bias_at(found: &Calibration, axis: usize, p: &ThermalPoint) -> f64 {
    let [gx, gy, gz] = p.gradient;
    let raw = [1.0, p.temperature - Feature::REFERENCE_TEMPERATURE, p.rate, gx, gy, gz];
    let element = Element::GyroBias(axis);
    let parts = Feature::ALL.into_iter().zip(raw).filter_map(|(feature, value)| {
        Some(found.coefficient(element, feature)?.value * value / feature.scale())
    });
    parts.sum::<f64>() * element.practical_unit().1
}

fn words(answer: &Answer, found: &Calibration) -> String {
    let mut text = String::new();
    let title =
        if answer.title.is_empty() { answer.case.display().to_string() } else { answer.title.clone() };
    put(&mut text, format_args!("{title}"));
    let [low, high] = answer.temperature_range;
    put(
        &mut text,
        format_args!(
            "{} cycles, {} measurements, {low:.1} to {high:.1} degC, rate up to {:.1} degC/h; NIS {:.3} (1 is right)",
            answer.cycles.len(),
            answer.measurements,
            answer.rate_limit * 3600.0,
            answer.nis
        ),
    );
    let features: Vec<&str> = answer
        .coefficients
        .iter()
        .map(|row| row.feature.as_str())
        .take(answer.coefficients.len() / found.elements.len().max(1))
        .collect();
    let heads: Vec<String> = features.iter().map(|feature| format!("{:>26}", scaled(feature))).collect();
    put(&mut text, format_args!("{:39}{}", "coefficient ± 1 sigma", heads.concat()));
    for rows in answer.coefficients.chunks(features.len().max(1)) {
        let cells: Vec<String> = rows.iter().map(cell).collect();
        let name = rows.first().map_or(String::new(), |row| format!("{}, {}", row.element, row.unit));
        put(&mut text, format_args!("{name:39}{}", cells.concat()));
    }
    put(
        &mut text,
        format_args!(
            "~ weak: the run left more than half of the prior sigma; ? not determined; ! not plausible"
        ),
    );
    let all_sound = found.verdicts.iter().all(|verdict| matches!(verdict, Verdict::Sound));
    put(&mut text, format_args!("{}", if all_sound { "Verdict:" } else { "What to think of it:" }));
    for verdict in &found.verdicts {
        if !matches!(verdict, Verdict::ElementUndetermined { .. }) {
            put(&mut text, format_args!("  {verdict}"));
        }
    }
    for (determination, what) in
        [(Determination::Undetermined, "not determined"), (Determination::Weak, "weakly determined")]
    {
        // Elements with one and the same reason are told together.
        let of_kind = || answer.undetermined.iter().filter(|e| e.determination == determination);
        let mut told: Vec<&str> = Vec::new();
        for one in of_kind() {
            if !told.contains(&one.why.as_str()) {
                told.push(&one.why);
                let together: Vec<&str> =
                    of_kind().filter(|e| e.why == one.why).map(|e| e.element.as_str()).collect();
                let why = one.why.trim_start_matches("its ");
                put(&mut text, format_args!("  {what}: {}: the {why}", together.join(", ")));
            }
        }
    }
    if let Some(truth) = answer.truth {
        put(
            &mut text,
            format_args!(
                "Against the simulation's truth: error/sigma {:.2} rms, beyond 3 sigma {:.1} %",
                truth.rms_of_error_over_sigma,
                100.0 * truth.beyond_three_sigma
            ),
        );
    }
    for path in &answer.files {
        put(&mut text, format_args!("  {}", path.display()));
    }
    text
}

/// A coefficient with its sigma, and a mark.
fn cell(row: &Row) -> String {
    let mark = match (row.plausible, row.determination) {
        (false, _) => '!',
        (true, Determination::Determined) => ' ',
        (true, Determination::Weak) => '~',
        (true, Determination::Undetermined) => '?',
    };
    format!("{:>13.4} ± {:<9.4}{mark}", row.value, row.sigma)
}

/// A feature with what one unit of it is.
fn scaled(feature: &str) -> String {
    match feature {
        "constant" => "at 35 degC".to_owned(),
        "temperature" => "for 30 K".to_owned(),
        "rate" => "for 20 K/h".to_owned(),
        other => format!("{other}, for 5 K/m"),
    }
}
