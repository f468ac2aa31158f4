//! `schuler demo`: flights of its own.
//!
//! | module | shows |
//! | --- | --- |
//! | `circle` | physics that the simulation does not have: located, named, fitted, put back, flown better |
//! | `identification` | noise that the data sheet gives wrong, identified in flight, and a gyro that fails |
pub(super) mod circle;
pub(super) mod identification;

use std::path::{Path, PathBuf};

use schuler_recording::Recording;

use super::Failure;
use super::session::Session;
use crate::flight::{self, Channel, LoopStates, LoopTruth, On};
use crate::plot::{Format, Panel};

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Physics that the simulation does not have, from the mismatch to a better flight:
    schuler demo

  The same without the emulated board:
    schuler demo --on host

  A filter that retunes itself and names the gyro that fails, on the emulated board:
    schuler demo --identification --on qemu --out out/on_board";

/// How to run the demonstration.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Show the identification of noise in flight and of a failed gyro instead.
    #[arg(long)]
    identification: bool,
    /// What the flight module runs on; without it on this machine and, where there is an emulator, on the board as well (with
    /// --identification on this machine).
    #[arg(long, value_enum)]
    on: Option<On>,
    /// Directory for everything that is made.
    #[arg(long, short, default_value = "out/demo")]
    out: PathBuf,
    /// Seed instead of the demonstration's.
    #[arg(long)]
    seed: Option<u64>,
    /// Forms of the figures.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "svg,png")]
    plot: Vec<Format>,
}

impl Arguments {
    /// Everything on this machine, into a directory, figures as pixels.
    pub(super) fn into_directory(out: &Path) -> Self {
        let plot = vec![Format::Png];
        Self { identification: false, on: Some(On::Host), out: out.to_owned(), seed: None, plot }
    }
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    if arguments.identification {
        session.answer(&identification::made(arguments, session)?, identification::words)
    } else {
        session.answer(&circle::made(arguments, session)?, circle::words)
    }
}

/// Index of the tilt among the states.
const TILT: usize = 1;

/// The channel that a simulated flight is flown with.
pub(super) fn channel_of(recording: &Recording, case: &Path) -> Result<Channel, Failure> {
    let planned = flight::plan(recording).map_err(|problem| schuler_recording::Error::one(case, problem))?;
    Ok(planned.into_iter().next().ok_or_else(|| anyhow::anyhow!("nothing to fly"))?)
}

/// What the simulation has left of the truth of a channel, at the recording's times.
pub(super) fn truth(case: &Path, channel: &str, recording: &Recording) -> Result<Vec<LoopStates>, Failure> {
    let mut truth = LoopTruth::beside(case, channel)?
        .ok_or_else(|| anyhow::anyhow!("the simulation has left no truth"))?;
    Ok(recording.time_s.iter().map(|time_s| truth.at(*time_s)).collect::<Result<_, _>>()?)
}

/// The same scale for all panels of a figure, up to `most` on either side.
fn scaled(panel: Panel, most: f64) -> Panel {
    Panel { y_range: Some((-most, most)), ..panel }
}
