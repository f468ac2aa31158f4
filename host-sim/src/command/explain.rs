//! `schuler explain CASE.toml`.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_explain::deploy::{Deployed, Deployment, Stations, deploy};
use schuler_explain::evidence::evidence;
use schuler_explain::explain::{self, Options, explain_watched};
use schuler_explain::explanation::Explanation;
use schuler_explain::second;
use schuler_link::block;
use schuler_recording::{Error, Problem, Recording};
use serde::Serialize;

use super::Failure;
use super::fly::write_json;
use super::memory::{self, Need};
use super::session::Session;
use crate::campaign::engine::Engine;
use crate::flight;
use crate::flight::sensors::Place;
use crate::output::{self, Interrupted};
use crate::plot::Format;
use crate::report::{Recorded, Report};

/// Memory that explaining takes, most of it for signatures. Measured: 0.7 kB a row of three columns with nothing found, beside which
/// whitened blocks are kept where there are findings; 4.2 to 6.6 kB a row of twenty-two.
const NEED: Need = Need { row: 500, value: 280 };

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Which physics the simulation leaves out, in sentences:
    schuler explain run_17/case.toml

  As a page for the browser and as JSON for a program:
    schuler explain run_17/case.toml --report run_17.html
    schuler explain run_17/case.toml --json > run_17.json

  What is below the usual level as well, of which one record in five shows something by chance:
    schuler explain run_17/case.toml --level 0.2

  With the block by which the flight module takes the effects out:
    schuler explain run_17/case.toml --compensation run_17.block

  The exit status is 0 whatever the verdict.";

/// What to explain, and where to show it.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Case file.
    case: PathBuf,
    /// Write the explanation as one HTML page that needs nothing beside it.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Directory for the explanation and its figures; without it nothing is written there.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw what is explained, what is left and each effect against its cause, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
    /// Probability that anything is found in a record with nothing left out.
    #[arg(long, value_name = "PROBABILITY", default_value_t = Options::default().level)]
    level: f64,
    /// Engine; for comparisons of the one that is being made with the one in use.
    #[arg(long, value_enum, default_value_t, hide = true)]
    engine: Engine,
    /// Write the block by which the flight module compensates what was found.
    #[arg(long, value_name = "BLOCK")]
    compensation: Option<PathBuf>,
}

/// The answer, with what became of the files that were asked for.
#[derive(Serialize)]
struct Answer<'r> {
    #[serde(flatten)]
    explanation: &'r Explanation,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    compensation: Vec<Deployed>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let recording = memory::recording(session.case(&arguments.case)?, NEED, session)?;
    session.warn(&recording.warnings);
    // Now, and not after the work whose result it is to hold.
    for path in arguments.report.iter().chain(&arguments.compensation) {
        output::check(path)?;
    }
    let progress = session.phases();
    let options = Options { level: arguments.level, ..Options::default() };
    let explained = match arguments.engine {
        Engine::First => explain_watched(&recording, &options, &progress),
        Engine::Second => second::explain_watched(&recording, &second::config::Config::default(), &progress),
    };
    let (explanation, arrays) = explained.map_err(|error| match error {
        explain::Error::Cancelled => Failure::Stopped(Interrupted),
        error => Error::one(&arguments.case, Problem::of_file(error.to_string())).into(),
    })?;
    drop(progress);
    let report = Report {
        title: recording.case.title.clone(),
        recorded: Recorded::of(&recording, &arguments.case.display().to_string()),
        explanation,
        evidence: evidence(arrays),
    };
    let mut files = Vec::new();
    if let Some(directory) = &arguments.out {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        for (name, figure) in report.figures() {
            files.extend(figure.write(directory, &name, &arguments.plot)?);
        }
        let path = directory.join("explanation.json");
        write_json(&path, &report.explanation)?;
        files.push(path);
    }
    if let Some(path) = &arguments.report {
        output::write(path, report.html().as_bytes())?;
        files.push(path.clone());
    }
    let mut compensation = Vec::new();
    if let Some(path) = &arguments.compensation {
        let deployment = deployed(&report.explanation, &recording, &arguments.case)?;
        output::write(path, &block::encode(&deployment.block))?;
        compensation = deployment.findings;
        files.push(path.clone());
    }
    let answer = Answer { explanation: &report.explanation, compensation, files };
    session.answer(&answer, |answer| {
        let mut text = report.text();
        text.push_str(&words(&answer.compensation));
        if !answer.files.is_empty() {
            text.push_str("\nWritten:\n");
        }
        for path in &answer.files {
            // Writing into a string cannot fail.
            let _ = writeln!(text, "  {}", path.display());
        }
        text
    })
}

/// What flies, by the inputs that the sensors of the case have at the flight module.
fn deployed(explanation: &Explanation, recording: &Recording, case: &Path) -> Result<Deployment, Failure> {
    let channels = flight::plan(recording).map_err(|mut problem| {
        problem.message =
            format!("the case cannot be flown, so there is nothing to compensate: {}", problem.message);
        Error::one(case, problem)
    })?;
    Ok(deploy(explanation, recording, &channels.first().map(stations).unwrap_or_default()))
}

/// Which sensors stand at which inputs.
fn stations(channel: &flight::Channel) -> Stations {
    let mut stations = Stations { thermometers: channel.thermometers.clone(), ..Stations::default() };
    for (id, place) in &channel.sensors {
        match place {
            Place::Gyro(k) => stations.gyros.push((id.clone(), *k as u8)),
            Place::Accelerometer(k) => stations.accelerometers.push((id.clone(), *k as u8)),
        }
    }
    stations
}

/// What can be compensated in flight and what cannot.
fn words(compensation: &[Deployed]) -> String {
    let mut text = String::new();
    if !compensation.is_empty() {
        text.push_str("\nIn flight:\n");
    }
    for it in compensation {
        let what = match (&it.because, &it.caution) {
            (Some(because), _) => format!("cannot be compensated, because {because}"),
            (None, Some(caution)) => format!("is compensated by {}; {caution}", counted(it.terms)),
            (None, None) => format!("is compensated by {}", counted(it.terms)),
        };
        let _ = writeln!(text, "  {} of {} {what}.", it.effect, it.sensor);
    }
    text
}

fn counted(terms: usize) -> String {
    if terms == 1 { "one term".to_owned() } else { format!("{terms} terms") }
}
