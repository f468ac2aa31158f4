//! `schuler compare-isolation`: every way of isolating a gyro against the optimum.
use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use schuler_core::config::ConfigError;
use schuler_recording::unit::Dimension;
use schuler_recording::{Error, Problem};
use serde::Serialize;

use super::Failure;
use super::fly::write_json;
use super::isolation_tables;
use super::session::Session;
use super::text::put;
use crate::compare_isolation::{
    BLOCK_SIZES, ComparisonError, ComparisonRow, IsolationComparison, IsolationMethod,
    compare_isolation_watched, cone,
};
use crate::plot::{Colour, Figure, Format, Layer, Panel};

/// Columns of the table, characters.
const WIDTH: usize = 34;
/// Share of differing decisions below which two methods are one and the same but for rounding.
const SAME: f64 = 1e-4;

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Five gyros on the cone, every method against the optimum:
    schuler compare-isolation

  The gyros of a case, faults of three and five standard deviations:
    schuler compare-isolation --case block/case.toml --faults 3,5

  Both tables of the paper with the printed digits, and its rule of detection:
    schuler compare-isolation --tables";

/// What to compare.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Gyros, evenly spaced on the cone of half-angle 54.74 degrees; five are the paper's.
    #[arg(long, default_value_t = 5, value_parser = RangedU64ValueParser::<usize>::new().range(5..=12))]
    gyros: usize,
    /// Take axes and white noise of the gyros of this case instead of the cone.
    #[arg(long, conflicts_with = "gyros")]
    case: Option<PathBuf>,
    /// Fault sizes, in standard deviations of the gyro that fails.
    #[arg(long, value_delimiter = ',', default_value = "2,3,4,5,6,7,8,9,10")]
    faults: Vec<f64>,
    /// Trials for each fault size.
    #[arg(long, default_value_t = 200_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    trials: u64,
    /// Rate of the body, in standard deviations of the best gyro; only the condition number depends on it.
    #[arg(long, default_value_t = 0.0)]
    rate: f64,
    /// Standard deviation of a gyro in the unit in which the condition number sees it.
    #[arg(long, default_value_t = 0.1)]
    condition_unit: f64,
    /// Calculate both tables of the paper beside the printed digits, and its rule k_s,max beside the sequential detector.
    #[arg(long, conflicts_with_all = ["gyros", "case", "faults", "trials", "rate", "condition_unit", "plot"])]
    tables: bool,
    /// Seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Directory for the results and the figure; without it nothing is written.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw the shares, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
}

#[derive(Debug, Serialize)]
struct Answer {
    format: &'static str,
    comparison: IsolationComparison,
    rows: Vec<ComparisonRow>,
    /// Methods that do not serve a block of so many gyros.
    left_out: Vec<IsolationMethod>,
    files: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    if arguments.tables {
        return isolation_tables::run(arguments.seed, arguments.out.as_deref(), session);
    }
    let (axes, sigma) = match &arguments.case {
        Some(path) => block_of(path, session)?,
        None => (cone(arguments.gyros), vec![1.0; arguments.gyros]),
    };
    let comparison = IsolationComparison {
        axes,
        sigma,
        faults: arguments.faults.clone(),
        rate: arguments.rate,
        condition_unit: arguments.condition_unit,
        trials: arguments.trials,
        seed: arguments.seed,
    };
    let all = comparison.trials * comparison.faults.len() as u64;
    let progress = session.progress("comparing", all as usize);
    let rows = compare_isolation_watched(&comparison, |done| progress.stride(done as usize));
    drop(progress);
    let rows = rows.map_err(|error| match error {
        ComparisonError::Interrupted(stopped) => Failure::Stopped(stopped),
        ComparisonError::Configuration(error) => wrong(arguments, &error),
    })?;
    let left_out =
        IsolationMethod::ALL.into_iter().filter(|method| !method.serves(comparison.axes.len())).collect();
    let mut answer =
        Answer { format: "schuler-isolation-comparison/1", comparison, rows, left_out, files: Vec::new() };
    if let Some(directory) = &arguments.out {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        answer.files =
            figure(&answer.comparison, &answer.rows).write(directory, "isolation", &arguments.plot)?;
        let path = directory.join("isolation.json");
        write_json(&path, &answer)?;
        answer.files.push(path);
    }
    session.answer(&answer, words)
}

/// Axes and white noise, rad/s, of the gyros of a case.
fn block_of(path: &std::path::Path, session: &Session) -> Result<(Vec<[f64; 3]>, Vec<f64>), Failure> {
    let file = session.case(path)?;
    let gyros: Vec<_> =
        file.case.sensors.iter().filter(|s| s.kind.dimension() == Dimension::AngularRate).collect();
    if !BLOCK_SIZES.contains(&gyros.len()) {
        let message =
            format!("found {} gyros; expected {} to {}", gyros.len(), BLOCK_SIZES.start(), BLOCK_SIZES.end());
        return Err(Error::one(path, Problem::new(None, "sensor", message)).into());
    }
    if let Some(silent) = gyros.iter().find(|s| s.nominal.white <= 0.0) {
        let message =
            format!("found no white noise of \"{}\"; expected one to compare faults with", silent.id);
        return Err(Error::one(path, Problem::new(None, "sensor.nominal.white", message)).into());
    }
    let axes = gyros.iter().map(|s| s.axis.unwrap_or_default()).collect();
    Ok((axes, gyros.iter().map(|s| s.nominal.white * s.unit.in_si()).collect()))
}

/// What the comparison does not take is the user's mistake.
fn wrong(arguments: &Arguments, error: &ConfigError) -> Failure {
    let path = arguments.case.clone().unwrap_or_else(|| "command line".into());
    Error::one(&path, Problem::new(None, error.field, error.problem.to_string())).into()
}

/// Share of right names, and what the methods that decide otherwise lose against the optimum.
pub(super) fn figure(comparison: &IsolationComparison, rows: &[ComparisonRow]) -> Figure {
    const FAULT: &str = "fault, standard deviations of the gyro";
    let mut shares = Panel::new(FAULT, "right gyro named, share");
    // Room for the legend.
    shares.y_range = Some((0.0, 1.3));
    let mut losses = Panel::new(FAULT, "share over that of the optimum");
    losses = losses.with(Layer::Horizontal { label: String::new(), y: 1.0, colour: Colour::Grey });
    let (mut same, mut others) = (0, 0);
    for method in IsolationMethod::ALL {
        let of_method: Vec<&ComparisonRow> = rows.iter().filter(|row| row.method == method).collect();
        let faults: Vec<f64> = of_method.iter().map(|row| row.fault).collect();
        let share: Vec<f64> = of_method.iter().map(|row| row.probability).collect();
        if method == IsolationMethod::Likelihood {
            shares = shares.line(method.name(), &faults, share, Colour::Black);
        } else if of_method.iter().all(|row| row.differing < SAME) {
            same += usize::from(!of_method.is_empty());
        } else {
            let colour = Colour::nth(others);
            others += 1;
            shares = shares.line(method.name(), &faults, share, colour);
            let (low, high) = of_method
                .iter()
                .map(|row| (row.ratio - 2.0 * row.ratio_error, row.ratio + 2.0 * row.ratio_error))
                .unzip();
            losses = losses.band("", &faults, low, high, colour);
            let ratio = of_method.iter().map(|row| row.ratio).collect();
            losses = losses.line("", &faults, ratio, colour);
        }
    }
    Figure {
        title: format!(
            "Isolation among {} gyros, {} trials a point; {same} more methods decide as the optimum does",
            comparison.axes.len(),
            comparison.trials
        ),
        panels: vec![shares, losses],
    }
}

fn words(answer: &Answer) -> String {
    let comparison = &answer.comparison;
    let mut text = String::new();
    put(
        &mut text,
        format_args!(
            "Right gyro named among {}, share of {} trials a fault size (seed {}); in brackets over the optimum",
            comparison.axes.len(),
            comparison.trials,
            comparison.seed
        ),
    );
    let line = |head: &str, cells: Vec<String>| format!("{head:WIDTH$}{}", cells.concat());
    let faults = comparison.faults.iter().map(|fault| format!("{fault:>17}")).collect();
    put(&mut text, format_args!("{}", line("fault, standard deviations", faults)));
    for method in IsolationMethod::ALL {
        let rows = answer.rows.iter().filter(|row| row.method == method);
        let cells: Vec<String> =
            rows.map(|row| format!("  {:.4} ({:.4})", row.probability, row.ratio)).collect();
        if !cells.is_empty() {
            put(&mut text, format_args!("{}", line(method.name(), cells)));
        }
    }
    let error = answer.rows.iter().map(|row| row.standard_error).fold(0.0, f64::max);
    put(&mut text, format_args!("One standard error is at most {error:.4}."));
    if !answer.left_out.is_empty() {
        let names: Vec<&str> = answer.left_out.iter().map(|method| method.name()).collect();
        put(&mut text, format_args!("Only for five gyros: {}.", names.join("; ")));
    }
    for path in &answer.files {
        put(&mut text, format_args!("  {}", path.display()));
    }
    text
}
