//! The `schuler` command.
//!
//! | module | does |
//! | --- | --- |
//! | `simulate` | a scenario → recording, case and truth |
//! | `fly` | a case → through the flight module |
//! | `identify` | a case → noise of each sensor |
//! | `explain` | a case → what its simulation leaves out |
//! | `into` | what was found → a scenario |
//! | `compare` | a simulator's output and a recording → a case, explained |
//! | `init` | a table → a case to go on editing |
//! | `campaign` | many cases with concealed effects, scored |
//! | `campaign freeze`, `campaign compare` | answers of an engine as data, and two engines compared |
//! | `convert` | a table, or a case with its table → another format |
//! | `calibrate` | a calibration run → coefficients, what was observable, compensation file |
//! | `compare-isolation` | every way of isolating a gyro against the optimum |
//! | `figures` | the figures of the documentation |
//! | `demo` | all of it at once, on flights of its own |
//! | `completions` | what a shell needs to complete these |
//! | `man` | manual pages |
//!
//! Results go to standard output, as text or with `--json` as one JSON document; progress and warnings go to standard
//! error. Exit status: 0 done, 2 bad input (one line: file, line, field, what was expected), 130 stopped, 1 anything else.
mod calibrate;
mod campaign;
mod compare;
mod compare_isolation;
mod completions;
mod convert;
mod demo;
mod explain;
mod figures;
mod fly;
mod freeze;
mod identify;
mod init;
mod into;
mod isolation_tables;
mod man;
mod memory;
mod session;
mod simulate;
mod text;

use std::env;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::output::Interrupted;
use session::Session;

/// Where results go, what the exit status says, and how to begin.
const CONVENTIONS: &str = "\
Results go to standard output; progress, warnings and errors to standard error. A file is written whole or not at all.

Exit status:
  0    done
  1    anything that is none of the others; a bar that a campaign missed
  2    bad input: one line with file, line, field and what was expected
  130  stopped by Ctrl-C

Examples:
  What a simulation left out, put back, and the next flight flown better, with a picture in out/demo:
    schuler demo

  Why a recording does not look like its simulation:
    schuler explain run_17/case.toml --report run_17.html

  Completion of all this in bash:
    schuler completions bash > ~/.local/share/bash-completion/completions/schuler";

/// Flight module, simulator and analysis for inertial sensors.
#[derive(Debug, Parser)]
#[command(name = "schuler", version, propagate_version = true, max_term_width = 110, after_help = CONVENTIONS)]
struct Arguments {
    /// Print results as one JSON document.
    #[arg(long, global = true)]
    json: bool,
    /// Show no progress.
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Leave out what cannot be understood (unknown keys, rows that are none, cells that are no numbers) instead of refusing it;
    /// the answer begins with what was left out.
    #[arg(long, global = true)]
    lenient: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a recording from a scenario.
    Simulate(simulate::Arguments),
    /// Run the flight module over a recording.
    Fly(fly::Arguments),
    /// Find structure and parameters of each sensor's noise.
    Identify(identify::Arguments),
    /// Find where a recording differs from its simulation, and which physics was left out.
    Explain(explain::Arguments),
    /// Compare a simulator's output with a recording: write the case, then explain it.
    Compare(compare::Arguments),
    /// Propose a case for a recording.
    Init(init::Arguments),
    /// Write a table, or a case with its table, in another format.
    Convert(convert::Arguments),
    /// Conceal effects in many cases, look for them, and score what was found.
    Campaign(Box<campaign::Arguments>),
    /// Find all thermal coefficients from one run at changing temperature, and what it cannot tell.
    Calibrate(calibrate::Arguments),
    /// Compare every way of isolating a gyro with the optimum, by Monte Carlo.
    CompareIsolation(compare_isolation::Arguments),
    /// Make the figures of the documentation anew.
    #[command(hide = true)]
    Figures(figures::Arguments),
    /// Show the whole way on a simulated flight: what the simulation left out, put back, and the next flight flown better.
    Demo(demo::Arguments),
    /// Print what a shell needs to complete commands and options.
    Completions(completions::Arguments),
    /// Write manual pages.
    Man(man::Arguments),
}

/// Why a command did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Bad input.
    #[error("{0}")]
    Input(#[from] schuler_recording::Error),
    /// The user has stopped it.
    #[error(transparent)]
    Stopped(#[from] Interrupted),
    /// Anything else.
    #[error("{0:#}")]
    Other(#[from] anyhow::Error),
}

impl Failure {
    fn status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Stopped(_) => 130,
            Self::Other(_) => 1,
        }
    }
}

/// Runs the command of this process's arguments.
pub fn main() -> ExitCode {
    let program = env::current_exe().unwrap_or_else(|_| PathBuf::from("schuler"));
    ExitCode::from(run(program, env::args_os()))
}

/// Runs the command that lies at `program` with these arguments, of which the first is its name, and gives its exit status. Help and mistakes
/// in the arguments end the process.
pub fn run(program: PathBuf, arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = Arguments::parse_from(arguments);
    let session = Session::new(program, arguments.json, arguments.quiet, arguments.lenient);
    let done = match &arguments.command {
        Command::Simulate(arguments) => simulate::run(arguments, &session),
        Command::Fly(arguments) => fly::run(arguments, &session),
        Command::Identify(arguments) => identify::run(arguments, &session),
        Command::Explain(arguments) => explain::run(arguments, &session),
        Command::Compare(arguments) => compare::run(arguments, &session),
        Command::Init(arguments) => init::run(arguments, &session),
        Command::Convert(arguments) => convert::run(arguments, &session),
        Command::Campaign(arguments) => campaign::run(arguments, &session),
        Command::Calibrate(arguments) => calibrate::run(arguments, &session),
        Command::CompareIsolation(arguments) => compare_isolation::run(arguments, &session),
        Command::Figures(arguments) => figures::run(arguments, &session),
        Command::Demo(arguments) => demo::run(arguments, &session),
        Command::Completions(arguments) => completions::run(arguments, &mut Arguments::command()),
        Command::Man(arguments) => man::run(arguments, &session, Arguments::command()),
    };
    match done {
        Ok(()) => 0,
        Err(failure) => {
            eprintln!("schuler: {}", schuler_recording::error::plain(&failure.to_string()));
            failure.status()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn every_example_in_the_help_is_one_that_the_command_takes() {
        let mut all = Arguments::command();
        all.build();
        let visible = all.get_subcommands().filter(|it| !it.is_hide_set() && it.get_name() != "help");
        for command in visible.chain([&all]) {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines: Vec<&str> =
                help.lines().map(str::trim).filter(|it| it.starts_with("schuler ")).collect();
            assert!(!lines.is_empty(), "{}: no examples", command.get_name());
            for line in lines {
                let typed = line.split(" > ").next().unwrap_or_default();
                let quoted = typed.replace("'my_tool {case}'", "my_tool");
                if let Err(error) = Arguments::try_parse_from(quoted.split_whitespace()) {
                    panic!("{line}: {error}");
                }
            }
        }
    }
}
