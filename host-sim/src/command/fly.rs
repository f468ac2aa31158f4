//! `schuler fly CASE.toml`.
use std::fs;
use std::path::{Path, PathBuf};

use schuler_core::identification::Method;
use schuler_link::block::{self, BlockBytes, MAX_BLOCK};
use schuler_link::configuration;
use schuler_recording::{CaseFile, Error, Problem, Recording};
use serde::Serialize;

use super::Failure;
use super::session::Session;
use super::text;
use crate::emulator::TargetError;
use crate::flight::mission::FlightError;
use crate::flight::{self, Channel, Flown, LoopTruth, On, Summary, figures, outputs};
use crate::output;
use crate::plot::Format;

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  What the flight module makes of a recording:
    schuler fly out/flight/case.toml --plot png --out out/flown

  The same on the emulated board, over its serial line; the outputs are the same, bit by bit:
    schuler fly out/flight/case.toml --on qemu --out out/on_board

  With the sensors corrected by what `explain` or `calibrate` found:
    schuler fly out/flight/case.toml --compensation out/terms.block";

/// What to fly, and on what.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Case file.
    case: PathBuf,
    /// What the flight module runs on.
    #[arg(long, value_enum, default_value_t)]
    on: On,
    /// Directory for the module's outputs, the summary and the figures; without it nothing is written.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw estimates, innovations and isolation, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
    /// Correct the sensors by the compensation block in this file.
    #[arg(long, value_name = "BLOCK")]
    compensation: Option<PathBuf>,
    /// How the noise is identified in flight.
    #[arg(long, value_enum, default_value_t)]
    identification: Identification,
}

/// Names of the identification methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Identification {
    /// Not at all: what the case believes is flown.
    Off,
    /// The published loop, for comparison.
    Published,
    /// Maximum likelihood.
    #[default]
    Likelihood,
}

impl From<Identification> for Method {
    fn from(name: Identification) -> Self {
        match name {
            Identification::Off => Self::Off,
            Identification::Published => Self::Published,
            Identification::Likelihood => Self::Likelihood,
        }
    }
}

/// What a flight says.
#[derive(Debug, Serialize)]
pub(super) struct Answer {
    format: &'static str,
    pub(super) case: PathBuf,
    pub(super) title: String,
    pub(super) on: &'static str,
    pub(super) channels: Vec<Summary>,
    pub(super) files: Vec<PathBuf>,
    pub(super) warnings: Vec<String>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let file = CaseFile::read(&arguments.case)?;
    let lines = file.lines.clone();
    let recording = Recording::of_case(file)?;
    Session::warn(&recording.warnings);
    let channels = flight::plan(&recording).map_err(|mut problem| {
        problem.line = problem.line.or_else(|| lines.get(&problem.field));
        Error::one(&arguments.case, problem)
    })?;

    let compensation = arguments.compensation.as_deref().map(read_block).transpose()?;

    let mut answer = Answer {
        format: "schuler-flight/1",
        case: arguments.case.clone(),
        title: recording.case.title.clone(),
        on: arguments.on.name(),
        channels: Vec::new(),
        files: Vec::new(),
        warnings: recording.warnings.clone(),
    };
    for mut channel in channels {
        channel.config.identification.method = arguments.identification.into();
        channel.compensation.clone_from(&compensation);
        let truth = LoopTruth::beside(&arguments.case, &channel.name, &channel.time_s)?;
        let flown = flown(channel, arguments.on, &arguments.case, session)?;
        let summary = Summary::of(&flown, truth.as_ref());
        if let Some(directory) = &arguments.out {
            let files = write(&flown, &summary, truth.as_ref(), directory, &arguments.plot)?;
            answer.files.extend(files);
        }
        answer.channels.push(summary);
    }
    if let Some(directory) = &arguments.out {
        let path = directory.join("summary.json");
        write_json(&path, &answer)?;
        answer.files.push(path);
    }
    session.answer(&answer, text::flight)
}

/// Reads a compensation block and checks it as the module will.
fn read_block(path: &Path) -> Result<BlockBytes, Failure> {
    let bytes = fs::read(path).map_err(|error| Error::io(path, "read the compensation block", &error))?;
    let block = |problem: Problem| Failure::Input(Error::one(path, problem));
    let (content, _) = block::decode(&bytes).map_err(|error| block(Problem::of_file(error.to_string())))?;
    content.validate().map_err(|error| block(Problem::new(None, error.field, error.problem.to_string())))?;
    BlockBytes::from_slice(&bytes)
        .map_err(|_| block(Problem::of_file(format!("is longer than {MAX_BLOCK} bytes"))))
}

/// Flies a channel with a progress bar. A configuration that cannot be flown is the case's mistake.
pub(super) fn flown(channel: Channel, on: On, case: &Path, session: &Session) -> Result<Flown, Failure> {
    let progress = session.progress(&format!("flying {}", channel.name), channel.inputs.len());
    flight::fly(channel, on, |step| progress.at(step)).map_err(|error| match error {
        FlightError::Interrupted(stopped) => Failure::Stopped(stopped),
        FlightError::Target(TargetError::Configuration { field, problem }) => {
            let message = format!("follows from the case and {problem}; expected one that can be flown");
            Failure::Input(Error::one(case, Problem::new(None, field, message)))
        }
        FlightError::Target(other) => Failure::Other(other.into()),
    })
}

/// Writes outputs and figures of a channel and names what was written.
pub(super) fn write(
    flown: &Flown,
    summary: &Summary,
    truth: Option<&LoopTruth>,
    directory: &Path,
    formats: &[Format],
) -> Result<Vec<PathBuf>, Error> {
    fs::create_dir_all(directory).map_err(|error| Error::io(directory, "make the directory", &error))?;
    let path = directory.join(format!("{}_outputs.csv.gz", flown.channel.name));
    outputs::write(flown, &path)?;
    let mut files = vec![path];
    // For who has the module in his own flight software. What has flown can be flown.
    if let Ok(block) = configuration::encode(&flown.channel.config) {
        let path = directory.join(format!("{}_configuration.bin", flown.channel.name));
        fs::write(&path, &block).map_err(|error| Error::io(&path, "write the configuration", &error))?;
        files.push(path);
    }
    if !formats.is_empty() {
        for (name, figure) in figures::all(flown, summary, truth) {
            files.extend(figure.write(directory, &name, formats)?);
        }
    }
    Ok(files)
}

/// Writes a result as JSON, whole or not at all.
pub(super) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(value).map_err(|error| Failure::Other(error.into()))?;
    Ok(output::write(path, json.as_bytes())?)
}
