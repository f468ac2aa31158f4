//! `schuler explain CASE.toml`, or a table alone.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_explain::config::Config;
use schuler_explain::explain as engine;
use schuler_explain::explanation::Explanation;
use schuler_explain::export::compensation::{Deployed, Deployment, Stations, deploy};
use schuler_explain::export::model::Model;
use schuler_link::block;
use schuler_recording::{CaseFile, Error, Leniency, Problem, Recording};
use serde::Serialize;

use super::fly::write_json;
use super::init::{self, Written};
use super::memory::{self, Need};
use super::session::Session;
use super::{Failure, into};
use crate::exported;
use crate::flight;
use crate::flight::sensors::Place;
use crate::output::{self, Interrupted};
use crate::plot::Format;
use crate::proposal::{Times, look_at, of_recording};
use crate::report::Report;

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

  What is no more than as likely as not as well:
    schuler explain run_17/case.toml --probability 0.5

  How large an effect of each kind could be without having been found:
    schuler explain run_17/case.toml --certificate

  With the block by which the flight module takes the effects out:
    schuler explain run_17/case.toml --compensation run_17.block

  With what was found as a model for a simulation, for Python and for C (also .json and .rs):
    schuler explain run_17/case.toml --export model.py --export model.c

  With what was found put into the scenario of schuler simulate that did not have it:
    schuler explain run_17/case.toml --into nominal.toml --out out/run_17

  A table without a case, of which sensors and units are guessed (schuler init writes the case):
    schuler explain run_17/recording.csv

  The exit status is 0 whatever the verdict.";

/// What to explain.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Case file; or a table, of which a case is guessed.
    case: PathBuf,
    /// Step of the rows in seconds, of a table that has neither a case nor a column of time: they are taken to be evenly spaced
    /// from 0. A case states it as recording.step_s.
    #[arg(long, value_name = "SECONDS", value_parser = init::step)]
    step_s: Option<f64>,
    #[command(flatten)]
    shown: Shown,
}

/// How it is explained, and where that is shown.
#[derive(Debug, clap::Args)]
pub(super) struct Shown {
    /// List as well the largest effects that could still hide in each sensor; --json and the page have them always.
    #[arg(long)]
    certificate: bool,
    /// Write the explanation as one HTML page that needs nothing beside it.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Directory for the explanation and its figures; without it nothing is written there.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also draw what is explained, what is left and each effect against its cause, in these forms; needs --out.
    #[arg(long, value_enum, value_delimiter = ',', requires = "out")]
    plot: Vec<Format>,
    /// Posterior probability from which on a finding is told.
    #[arg(long, default_value_t = Config::default().told_at)]
    probability: f64,
    /// Write what the findings add to the readings as a model for a simulation, in the form that the ending says: json, py, c or rs;
    /// with the inputs of the model as a table beside it (FILE_inputs.csv). May be given more than once.
    #[arg(long, value_name = "FILE")]
    export: Vec<PathBuf>,
    /// Write this scenario of `schuler simulate` with blocks for what was found, as scenario.toml in the directory --out.
    #[arg(long, value_name = "SCENARIO", requires = "out")]
    into: Option<PathBuf>,
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
    exported: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    not_in_the_scenario: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    proposal: Option<&'r Written>,
}

impl Shown {
    /// Makes sure that the files can be written now, and not after the work whose result they are to hold.
    pub(super) fn check(&self, leniency: Leniency) -> Result<(), Error> {
        self.report.iter().chain(&self.compensation).try_for_each(|path| output::check(path))?;
        exported::check(&self.export)?;
        let Some(scenario) = &self.into else { return Ok(()) };
        into::check(scenario, into::out_of(scenario, self.out.as_ref())?, leniency)
    }
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let is_case = arguments.case.extension().is_none_or(|ending| ending.eq_ignore_ascii_case("toml"));
    let file = if is_case {
        if arguments.step_s.is_some() {
            let message =
                "found with a case; expected a table without one: a case states it as recording.step_s";
            return Err(Error::one(&arguments.case, Problem::new(None, "--step-s", message)).into());
        }
        session.case(&arguments.case)?
    } else {
        of_table(&arguments.case, arguments.step_s, session)?
    };
    explain(file, &arguments.shown, None, session)
}

/// The case that a table is guessed to be, which is said.
fn of_table(table: &Path, step_s: Option<f64>, session: &Session) -> Result<CaseFile, Failure> {
    output::protect(table);
    let waiting = session.waiting("reading");
    let look = look_at(table, Times::stated(None, step_s))?;
    drop(waiting);
    let name = table.file_name().map(PathBuf::from).unwrap_or_default();
    let proposed = of_recording(&look, &name);
    let guessed = format!(
        "{}: no case was given, so this is guessed; schuler init writes it as a case to go on with",
        table.display()
    );
    session.warn(&[guessed]);
    session.warn(&proposed.said);
    // Beside the table, to which its path is relative.
    Ok(CaseFile::parse_with(&table.with_extension("toml"), &proposed.text, session.leniency())?)
}

/// Explains a case, which may have just been written.
pub(super) fn explain(
    file: CaseFile,
    shown: &Shown,
    proposal: Option<&Written>,
    session: &Session,
) -> Result<(), Failure> {
    let case = file.path.clone();
    let recording = memory::recording(file, NEED, session)?;
    session.warn(&recording.warnings);
    shown.check(session.leniency())?;
    let config = Config { told_at: shown.probability, ..Config::default() };
    let (report, model) = explained(&recording, &case, &config, session)?;
    let mut files = figures(&report, shown)?;
    if let Some(path) = &shown.report {
        output::write(path, report.html().as_bytes())?;
        files.push(path.clone());
    }
    let mut compensation = Vec::new();
    if let Some(path) = &shown.compensation {
        let deployment = deployed(&report.explanation, &recording, &case)?;
        output::write(path, &block::encode(&deployment.block))?;
        compensation = deployment.findings;
        files.push(path.clone());
    }
    files.extend(exported::write(&model, &shown.export)?);
    let mut not_in_the_scenario = Vec::new();
    if let Some(scenario) = &shown.into {
        let out = into::out_of(scenario, shown.out.as_ref())?;
        let taken = into::write(&model, scenario, out, session.leniency())?;
        files.push(taken.path);
        not_in_the_scenario = taken.left_out;
    }
    let exported = if shown.export.is_empty() { Vec::new() } else { model.cautions() };
    let answer = Answer {
        explanation: &report.explanation,
        compensation,
        exported,
        not_in_the_scenario,
        files,
        proposal,
    };
    session.answer(&answer, |answer| {
        let mut text = answer.proposal.map(|written| init::words(written) + "\n").unwrap_or_default();
        text.push_str(&report.text());
        if shown.certificate {
            text.push_str(&report.certificate());
        }
        text.push_str(&words(&answer.compensation));
        text.push_str(&exported::words(&answer.exported));
        text.push_str(&into::words(&answer.not_in_the_scenario));
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

/// Explains a recording, with a progress bar; with the model of what was found.
pub(super) fn explained(
    recording: &Recording,
    case: &Path,
    config: &Config,
    session: &Session,
) -> Result<(Report, Model), Failure> {
    Report::explained(recording, case, config, &session.phases()).map_err(|error| match error {
        engine::Error::Cancelled => Failure::Stopped(Interrupted),
        error => Error::one(case, error.problem()).into(),
    })
}

/// Writes the explanation and its figures into the directory that was asked for.
fn figures(report: &Report, shown: &Shown) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    let Some(directory) = &shown.out else { return Ok(files) };
    std::fs::create_dir_all(directory).map_err(|error| Error::io(directory, "make the directory", &error))?;
    for (name, figure) in report.figures() {
        files.extend(figure.write(directory, &name, &shown.plot)?);
    }
    let path = directory.join("explanation.json");
    write_json(&path, &report.explanation)?;
    files.push(path);
    Ok(files)
}

/// What flies, by the inputs that the sensors of the case have at the flight module.
pub(super) fn deployed(
    explanation: &Explanation,
    recording: &Recording,
    case: &Path,
) -> Result<Deployment, Failure> {
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
