//! `schuler init RECORDING`, and where a proposed case is written.
use std::path::{Path, PathBuf};

use schuler_recording::{Error, Problem};
use serde::Serialize;

use super::Failure;
use super::session::Session;
use crate::output;
use crate::proposal::{Proposed, Times, look_at, of_recording};

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  A case of a log, as run_17.toml, to go on editing:
    schuler init logs/run_17.csv

  Of a flight log, whose rows are those of one topic:
    schuler init flight.ulg --time sensor_gyro_0.timestamp --case flight/case.toml

  Of a table without a column of time, sampled at 610.35 Hz:
    schuler init oscillator.csv --step-s 0.0016384";

/// What to propose a case for.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Table: CSV, .csv.gz, Parquet, MCAP, PX4 ULog.
    recording: PathBuf,
    /// Column of the time, where that cannot be guessed.
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,
    /// Step of the rows in seconds, of a table without a column of time: they are taken to be evenly spaced from 0.
    #[arg(long, value_name = "SECONDS", value_parser = step, conflicts_with = "time")]
    step_s: Option<f64>,
    /// Case file to write; without it one of the recording's name, in this directory.
    #[arg(long, value_name = "CASE")]
    case: Option<PathBuf>,
}

/// A case that was written.
#[derive(Serialize)]
pub(super) struct Written {
    format: &'static str,
    /// The file.
    pub(super) case: PathBuf,
    /// What was found and guessed.
    pub(super) said: Vec<String>,
}

/// A step in seconds.
pub(super) fn step(text: &str) -> Result<f64, String> {
    let step_s = text.trim().parse().ok().filter(|step_s: &f64| step_s.is_finite() && *step_s > 0.0);
    step_s.ok_or_else(|| "expected seconds, more than 0".to_owned())
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    output::protect(&arguments.recording);
    let case = case_of(arguments.case.as_deref(), &arguments.recording)?;
    let waiting = session.waiting("reading");
    let times = Times::stated(arguments.time.as_deref(), arguments.step_s);
    let look = look_at(&arguments.recording, times)?;
    drop(waiting);
    let proposed = of_recording(&look, &seen_from(&case, &arguments.recording));
    let written = write(case, proposed)?;
    session.answer(&written, |written| {
        let next = format!("\nTo go on: edit it, then schuler explain {}\n", written.case.display());
        words(written) + &next
    })
}

/// Where a case is written: where it was asked for, or under the recording's name in this directory; never over one that is there.
pub(super) fn case_of(asked: Option<&Path>, recording: &Path) -> Result<PathBuf, Error> {
    let path = asked.map_or_else(
        || {
            let name = recording.file_name().unwrap_or_default().to_string_lossy();
            let name = name.strip_suffix(".gz").unwrap_or(&name);
            Path::new(name).with_extension("toml")
        },
        Path::to_owned,
    );
    if path.exists() {
        let message = "is there already, and may have been edited; expected a new file: name one with --case";
        return Err(Error::one(path, Problem::of_file(message)));
    }
    output::check(&path)?;
    Ok(path)
}

/// The path of a table as a case at `case` has it: relative to the case where the table is below it.
pub(super) fn seen_from(case: &Path, table: &Path) -> PathBuf {
    let directory = case.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let whole = table.canonicalize().unwrap_or_else(|_| table.to_owned());
    // A directory that is not there yet has no canonical name.
    let below = directory.canonicalize().ok();
    let relative = below.and_then(|directory| whole.strip_prefix(directory).ok().map(Path::to_owned));
    relative.unwrap_or(whole)
}

/// Writes a proposed case.
pub(super) fn write(case: PathBuf, proposed: Proposed) -> Result<Written, Error> {
    output::write(&case, proposed.text.as_bytes())?;
    Ok(Written { format: "schuler-proposal/1", case, said: proposed.said })
}

/// What was found and guessed, a line each, and where the case is.
pub(super) fn words(written: &Written) -> String {
    let said = written.said.iter().map(String::as_str).collect::<Vec<_>>().join("\n");
    format!("{said}\n\nCase written: {}\n", written.case.display())
}
