//! `schuler identify CASE.toml`.
use std::path::PathBuf;

use schuler_recording::Error;

use super::Failure;
use super::fly::write_json;
use super::memory::{self, Need};
use super::session::Session;
use crate::identify::{Options, figures, identify_watched};
use crate::plot::Format;

/// Memory that identifying takes for each value of the recording; 36 and 68 bytes were measured.
const NEED: Need = Need { row: 0, value: 70 };

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Noise structure and parameters of each sensor, with Allan deviation and autocorrelation:
    schuler identify out/flight/case.toml

  With figures, and lags up to an hour at 1 Hz:
    schuler identify out/flight/case.toml --lags 3600 --plot svg,png --out out/noise";

/// What to identify.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Case file.
    case: PathBuf,
    /// Longest lag of the reported autocorrelation, in steps.
    #[arg(long, default_value_t = Options::default().longest_lag)]
    lags: usize,
    /// Directory for the results and the figures; without it nothing is written.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw Allan deviation and autocorrelation of each sensor, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let recording = memory::recording(session.case(&arguments.case)?, NEED, session)?;
    session.warn(&recording.warnings);
    let progress = session.progress("identifying", recording.sensors.len());
    let options = Options { longest_lag: arguments.lags };
    let found = identify_watched(&recording, options, |finished| progress.stride(finished))?;
    drop(progress);
    if let Some(directory) = &arguments.out {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        for (name, figure) in figures::all(&found) {
            figure.write(directory, &name, &arguments.plot)?;
        }
        write_json(&directory.join("identification.json"), &found)?;
    }
    session.answer(&found, ToString::to_string)
}
