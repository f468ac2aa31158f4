//! `schuler fly CASE.toml`.
use std::fs;
use std::path::{Path, PathBuf};

use schuler_core::health::MemoryModel;
use schuler_core::identification::Method;
use schuler_core::module::{RadioUse, StepOutput};
use schuler_link::block::{self, BlockBytes, MAX_BLOCK};
use schuler_link::configuration;
use schuler_recording::{Error, Problem, Recording, file};
use serde::Serialize;

use super::Failure;
use super::session::Session;
use super::text;
use crate::emulator::TargetError;
use crate::flight::figures::Figures;
use crate::flight::mission::FlightError;
use crate::flight::{self, Channel, Flown, LoopStates, LoopTruth, On, Step, Summary, Summing, outputs};
use crate::output;
use crate::plot::Format;
use crate::simulation::TRUTH;

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
    /// Withhold the radio's velocity from the filter where the health monitor holds the radio faulty with a greater probability
    /// than this, and let it count for less below; a radio that holds its last value is looked for, too.
    #[arg(long, value_name = "PROBABILITY")]
    withhold_radio: Option<f32>,
}

/// A reading of a radio that works repeats the last one with this probability at most: one in motion, and not a coarse one.
const REPEATS: f32 = 0.05;

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
    let waiting = session.waiting("reading");
    let (recording, channels) =
        flight::plan_stream(session.case(&arguments.case)?, |_| Ok::<_, Failure>(waiting.check()?))?;
    drop(waiting);
    session.warn(&recording.head().warnings);
    let compensation = arguments.compensation.as_deref().map(read_block).transpose()?;
    if let Some(directory) = &arguments.out {
        fs::create_dir_all(directory).map_err(|error| Error::io(directory, "make the directory", &error))?;
    }

    let mut answer = Answer {
        format: "schuler-flight/1",
        case: arguments.case.clone(),
        title: recording.head().case.title.clone(),
        on: arguments.on.name(),
        channels: Vec::new(),
        files: Vec::new(),
        warnings: recording.head().warnings.clone(),
    };
    for mut channel in channels {
        channel.config.identification.method = arguments.identification.into();
        if let (Some(withhold_above), Some(health)) = (arguments.withhold_radio, &mut channel.config.health) {
            let [[_, fail], [recover, _]] = health.radio.transition;
            health.memory = Some(MemoryModel { repeat: REPEATS, fail, recover });
            channel.config.radio_use = Some(RadioUse { withhold_above, ..RadioUse::DEFAULT });
        }
        channel.compensation.clone_from(&compensation);
        output::protect(&arguments.case.with_file_name(TRUTH));
        let mut truth = LoopTruth::beside(&arguments.case, &channel.name)?;
        let directory = arguments.out.as_deref();
        let mut products =
            Products::of(&channel, recording.rows(), truth.is_some(), directory, &arguments.plot)?;
        let progress = session.progress(&format!("flying {}", channel.name), recording.rows());
        let mut done = 0;
        flight::fly(&channel, channel.stream(&recording)?, arguments.on, |step, output| {
            let truth = truth.as_mut().map(|truth| truth.at(step.time_s)).transpose()?;
            products.add(step, output, truth.as_ref())?;
            done += 1;
            Ok(progress.at(done)?)
        })
        .map_err(|error| failure(error, &arguments.case))?;
        drop(progress);
        let (summary, files) = products.finish()?;
        answer.files.extend(files);
        answer.channels.push(summary);
    }
    if let Some(directory) = &arguments.out {
        let path = directory.join("summary.json");
        write_json(&path, &answer)?;
        answer.files.push(path);
    }
    session.answer(&answer, text::flight)
}

/// What becomes of a flight while it goes on.
pub(super) struct Products<'c> {
    channel: &'c Channel,
    summing: Summing<'c>,
    figures: Option<Figures<'c>>,
    /// Where files are written, the outputs among them.
    files: Option<(&'c Path, PathBuf, outputs::Writer)>,
    formats: &'c [Format],
}

impl<'c> Products<'c> {
    /// Of a channel of so many steps: always a summary; in a directory, which must be there, the outputs, and figures in these
    /// forms.
    pub(super) fn of(
        channel: &'c Channel,
        steps: usize,
        with_truth: bool,
        directory: Option<&'c Path>,
        formats: &'c [Format],
    ) -> Result<Self, Error> {
        let files = directory.map(|directory| {
            let path = directory.join(format!("{}_outputs.csv.gz", output::file_name(&channel.name)));
            outputs::Writer::of(channel, &path).map(|writer| (directory, path, writer))
        });
        Ok(Self {
            channel,
            summing: Summing::new(channel, with_truth.then_some(steps / 4)),
            figures: (!formats.is_empty()).then(|| Figures::of(channel, steps, with_truth)),
            files: files.transpose()?,
            formats,
        })
    }

    /// Takes the next step, with the truth where it is known.
    pub(super) fn add(
        &mut self,
        step: &Step,
        output: &StepOutput,
        truth: Option<&LoopStates>,
    ) -> Result<(), Error> {
        self.summing.add(step, output, truth);
        if let Some(figures) = &mut self.figures {
            figures.add(step, output, truth);
        }
        self.files.as_mut().map_or(Ok(()), |(_, _, writer)| writer.add(step, output))
    }

    /// The summary, and what was written.
    pub(super) fn finish(self) -> Result<(Summary, Vec<PathBuf>), Error> {
        let summary = self.summing.finish();
        let Some((directory, path, writer)) = self.files else { return Ok((summary, Vec::new())) };
        writer.finish()?;
        let mut files = vec![path];
        // For who has the module in his own flight software, and for the image, which takes a state. What has flown can be flown.
        let configuration = configuration::encode(&self.channel.config).map(|block| block.to_vec());
        let blocks =
            [("configuration", configuration.ok()), ("state", flight::initial_state(self.channel).ok())];
        for (what, block) in blocks {
            if let Some(block) = block {
                let path = directory.join(format!("{}_{what}.bin", output::file_name(&self.channel.name)));
                output::write(&path, &block)?;
                files.push(path);
            }
        }
        for (name, figure) in self.figures.map(|it| it.finish(&summary)).unwrap_or_default() {
            files.extend(figure.write(directory, &name, self.formats)?);
        }
        Ok((summary, files))
    }
}

/// Reads a compensation block and checks it as the module will.
fn read_block(path: &Path) -> Result<BlockBytes, Failure> {
    output::protect(path);
    let bytes = file::bytes(path, "read the compensation block")?;
    let block = |problem: Problem| Failure::Input(Error::one(path, problem));
    let (content, _) = block::decode(&bytes).map_err(|error| block(Problem::of_file(error.to_string())))?;
    content.validate().map_err(|error| block(Problem::new(None, error.field, error.problem.to_string())))?;
    BlockBytes::from_slice(&bytes)
        .map_err(|_| block(Problem::of_file(format!("is longer than {MAX_BLOCK} bytes"))))
}

/// Flies a channel over a recording in memory, with a progress bar.
pub(super) fn flown(
    channel: Channel,
    recording: &Recording,
    on: On,
    case: &Path,
    session: &Session,
) -> Result<Flown, Failure> {
    let progress = session.progress(&format!("flying {}", channel.name), recording.len());
    Flown::of(channel, recording, on, |step| progress.at(step)).map_err(|error| failure(error, case))
}

/// A configuration that cannot be flown is the case's mistake.
pub(super) fn failure(error: FlightError, case: &Path) -> Failure {
    match error {
        FlightError::Interrupted(stopped) => Failure::Stopped(stopped),
        FlightError::File(error) => Failure::Input(error),
        FlightError::Target(TargetError::Configuration { field, problem }) => {
            let message = format!("follows from the case and {problem}; expected one that can be flown");
            Failure::Input(Error::one(case, Problem::new(None, field, message)))
        }
        FlightError::Target(other) => Failure::Other(other.into()),
    }
}

/// Writes a result as JSON, whole or not at all.
pub(super) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(value).map_err(|error| Failure::Other(error.into()))?;
    Ok(output::write(path, json.as_bytes())?)
}
