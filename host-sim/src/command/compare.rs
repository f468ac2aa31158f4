//! `schuler compare SIM REAL`.
use std::path::PathBuf;

use schuler_recording::{Error, Problem};

use super::Failure;
use super::explain::{self, Shown};
use super::init::{case_of, seen_from, step, words, write};
use super::session::Session;
use crate::output;
use crate::proposal::{Times, look_at, of_pair, pairs};

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  A simulator's output beside a recording: writes flight.toml, then explains it:
    schuler compare sim.csv flight.csv

  Columns of other names, and the answer as a page:
    schuler compare sim.parquet flight.ulg --real-time vehicle_air_data_0.timestamp --map altitude=vehicle_air_data_0.baro_alt_meter --report flight.html

  The case alone, to be edited first:
    schuler compare sim.csv flight.csv --case flight/case.toml --only-case

Whatever the case guesses wrong is changed in the file; from then on it is schuler explain CASE.";

/// What to compare.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Table that the simulator wrote, of any format that convert reads.
    #[arg(value_name = "SIM")]
    simulation: PathBuf,
    /// Table that was recorded.
    #[arg(value_name = "REAL")]
    recording: PathBuf,
    /// Columns that belong together though their names differ; may be given several times.
    #[arg(long, value_name = "SIMULATED=RECORDED", value_parser = mapped)]
    map: Vec<(String, String)>,
    /// Time column of the simulation, where that cannot be guessed.
    #[arg(long, value_name = "COLUMN")]
    sim_time: Option<String>,
    /// Time column of the recording, where that cannot be guessed.
    #[arg(long, value_name = "COLUMN")]
    real_time: Option<String>,
    /// Step of the simulation's rows in seconds, where it has no column of time: they are taken to be evenly spaced from 0.
    #[arg(long, value_name = "SECONDS", value_parser = step, conflicts_with = "sim_time")]
    sim_step_s: Option<f64>,
    /// Step of the recording's rows in seconds, where it has no column of time: they are taken to be evenly spaced from 0.
    #[arg(long, value_name = "SECONDS", value_parser = step, conflicts_with = "real_time")]
    real_step_s: Option<f64>,
    /// Case file to write; without it one of the recording's name, in this directory.
    #[arg(long, value_name = "CASE")]
    case: Option<PathBuf>,
    /// Write the case and explain nothing.
    #[arg(long)]
    only_case: bool,
    #[command(flatten)]
    shown: Shown,
}

/// `a=b` as a pair.
fn mapped(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').map(|(a, b)| (a.trim().to_owned(), b.trim().to_owned()));
    pair.filter(|(a, b)| !a.is_empty() && !b.is_empty())
        .ok_or_else(|| "expected SIMULATED=RECORDED, names of a column of either table".to_owned())
}

/// An error of one of the tables, with the option for that table.
fn of_table(mut error: Error, table: &str) -> Error {
    for problem in &mut error.problems {
        problem.message = problem.message.replace("--step-s", &format!("--{table}-step-s"));
    }
    error
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    output::protect(&arguments.simulation);
    output::protect(&arguments.recording);
    let case = case_of(arguments.case.as_deref(), &arguments.recording)?;
    arguments.shown.check(session.leniency())?;
    let waiting = session.waiting("reading");
    let times = Times::stated(arguments.sim_time.as_deref(), arguments.sim_step_s);
    let sim = look_at(&arguments.simulation, times).map_err(|error| of_table(error, "sim"))?;
    waiting.check()?;
    let times = Times::stated(arguments.real_time.as_deref(), arguments.real_step_s);
    let real = look_at(&arguments.recording, times).map_err(|error| of_table(error, "real"))?;
    drop(waiting);
    let matched = pairs(&sim, &real, &arguments.map)
        .map_err(|message| Error::one(&arguments.simulation, Problem::new(None, "--map", message)))?;
    let tables = [&arguments.simulation, &arguments.recording].map(|table| seen_from(&case, table));
    let proposed = of_pair(&sim, &real, &matched, [&tables[0], &tables[1]]);
    let written = write(case, proposed)?;
    if arguments.only_case {
        return session.answer(&written, words);
    }
    drop((sim, real));
    let file = session.case(&written.case)?;
    explain::explain(file, &arguments.shown, Some(&written), session)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_names_are_split_at_the_first_sign() {
        assert_eq!(mapped("a = b=c"), Ok(("a".to_owned(), "b=c".to_owned())));
        assert!(mapped("a").is_err() && mapped("=b").is_err() && mapped("a=").is_err());
    }
}
