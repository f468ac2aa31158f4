//! What every command shares: where results, progress and warnings go, and whether the user wants to stop.
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use schuler_explain::watch::{Phase, Watch};
use schuler_recording::error::{is_control, plain};
use schuler_recording::{CaseFile, Leniency};
use serde::Serialize;

use super::Failure;
use crate::output::{self, Interrupt, Interrupted};

/// How often a bar is redrawn, Hz.
const REDRAWS: u8 = 10;
/// Steps between looks at the clock and at the user's wishes.
const STRIDE: usize = 256;
/// Parts of a phase that a bar shows.
const PARTS: u64 = 1000;
/// Exit status of a process that its user has stopped.
const STOPPED: i32 = 130;
/// How long a stopped run may take to end by itself.
const GRACE: std::time::Duration = std::time::Duration::from_millis(600);

/// A run of the command.
#[derive(Debug)]
pub(super) struct Session {
    program: PathBuf,
    json: bool,
    quiet: bool,
    leniency: Leniency,
    /// What was read leniently, which the answer begins with.
    told: Mutex<Vec<String>>,
    interrupt: Interrupt,
}

/// An answer behind what it does not rest on.
#[derive(Serialize)]
struct Led<'a, T> {
    left_out: &'a [String],
    #[serde(flatten)]
    answer: &'a T,
}

impl Session {
    /// A run of the command at `program`, with the options that every command has. It listens to Ctrl-C and to requests to end from now on: they stop the work at its next step, or, where that takes long,
    /// the process.
    pub(super) fn new(program: PathBuf, json: bool, quiet: bool, lenient: bool) -> Self {
        let interrupt = Interrupt::default();
        let heard = interrupt.clone();
        // Without a handler Ctrl-C ends the process at once, which leaves drafts behind but no half-written file.
        let _ = ctrlc::set_handler(move || {
            // A thread of its own runs this, so that waiting here keeps no work from ending.
            heard.request();
            std::thread::sleep(GRACE);
            eprintln!("schuler: {Interrupted}");
            output::abandon(STOPPED);
        });
        let leniency = if lenient { Leniency::Lenient } else { Leniency::Strict };
        Self { program, json, quiet, leniency, told: Mutex::default(), interrupt }
    }

    /// Reads a case. From now on nothing is written over it nor over its table.
    pub(super) fn case(&self, path: &Path) -> Result<CaseFile, Failure> {
        output::protect(path);
        let file = CaseFile::read_with(path, self.leniency)?;
        output::protect(&file.table_path());
        if let Some(table) = file.simulation_path() {
            output::protect(&table);
        }
        Ok(file)
    }

    /// Where this command lies, for who runs it again.
    pub(super) fn program(&self) -> PathBuf {
        self.program.clone()
    }

    /// How what departs from its format is read.
    pub(super) fn leniency(&self) -> Leniency {
        self.leniency
    }

    /// A progress bar on standard error; not there with `--quiet` or where standard error is no terminal.
    pub(super) fn progress(&self, label: &str, length: usize) -> Progress<'_> {
        let template = "{msg:<24} [{bar:40}] {percent:>3} %  {elapsed_precise} / {duration_precise}";
        self.bar(label, length as u64, template)
    }

    /// The same for work in phases, of which it is not known how often they come round: the bar is that of the phase.
    pub(super) fn phases(&self) -> Progress<'_> {
        self.bar("", PARTS, "{msg:<24} [{bar:40}] {elapsed_precise}")
    }

    /// A sign on standard error that work of unknown length goes on, until it is dropped.
    pub(super) fn waiting(&self, label: &str) -> Progress<'_> {
        let progress = self.bar(label, 0, "{msg:<24} {spinner}  {elapsed_precise}");
        progress.bar.enable_steady_tick(std::time::Duration::from_millis(1000 / u64::from(REDRAWS)));
        progress
    }

    fn bar(&self, label: &str, length: u64, template: &str) -> Progress<'_> {
        let target = if self.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(REDRAWS)
        };
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(length), target).with_style(style);
        bar.set_message(plain(label).replace('\n', " "));
        Progress { bar, interrupt: &self.interrupt }
    }

    /// Warns, one line each, on standard error. Where input is read leniently, the answer begins with the same.
    pub(super) fn warn(&self, warnings: &[String]) {
        for warning in warnings {
            eprintln!("schuler: warning: {}", plain(warning));
        }
        if self.leniency.is_lenient() {
            self.told.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(warnings);
        }
    }

    /// Prints a result: as JSON, or what `text` makes of it.
    pub(super) fn answer<T: Serialize>(
        &self,
        result: &T,
        text: impl FnOnce(&T) -> String,
    ) -> Result<(), Failure> {
        let told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        let printed = if self.json {
            let json = if told.is_empty() {
                serde_json::to_string_pretty(result)
            } else {
                serde_json::to_string_pretty(&Led { left_out: &told, answer: result })
            };
            plain_json(&json.map_err(|error| Failure::Other(error.into()))?) + "\n"
        } else {
            let head = told.iter().map(|line| format!("Not read: {line}\n"));
            plain(&(head.collect::<String>() + &text(result))).into_owned()
        };
        print(printed.as_bytes())
    }
}

/// A JSON document in which control characters stand as their numbers. They are within strings, where JSON has a way for that.
fn plain_json(json: &str) -> String {
    json.chars().fold(String::with_capacity(json.len()), |mut text, c| {
        if is_control(c) {
            // Writing into a string cannot fail.
            let _ = write!(text, "\\u{:04x}", u32::from(c));
        } else {
            text.push(c);
        }
        text
    })
}

/// Writes to standard output.
pub(super) fn print(printed: &[u8]) -> Result<(), Failure> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(printed) {
        // Whoever reads has had enough.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::Other(error.into())),
        _ => Ok(()),
    }
}

/// A progress bar that also knows whether the user wants to stop.
pub(super) struct Progress<'s> {
    bar: ProgressBar,
    interrupt: &'s Interrupt,
}

impl Progress<'_> {
    /// Notes the steps done, where they are few and long.
    pub(super) fn done(&self, steps: usize) {
        self.bar.set_position(steps as u64);
    }

    /// An error once the user wants to stop.
    pub(super) fn check(&self) -> Result<(), Interrupted> {
        self.interrupt.check()
    }

    /// Notes the steps done, where they come in bundles.
    pub(super) fn stride(&self, steps: usize) -> Result<(), Interrupted> {
        self.bar.set_position(steps as u64);
        self.interrupt.check()
    }

    /// Notes the steps done of as many as there turn out to be.
    pub(super) fn of(&self, steps: usize, all: usize) -> Result<(), Interrupted> {
        self.bar.set_length(all as u64);
        self.stride(steps)
    }

    /// Notes the steps done.
    pub(super) fn at(&self, step: usize) -> Result<(), Interrupted> {
        if step.is_multiple_of(STRIDE) {
            self.bar.set_position(step as u64);
            return self.interrupt.check();
        }
        Ok(())
    }
}

impl Watch for Progress<'_> {
    fn is_cancelled(&self) -> bool {
        self.interrupt.check().is_err()
    }

    fn progress(&self, phase: Phase, part: f64) {
        self.bar.set_message(phase.to_string());
        self.bar.set_position((part * PARTS as f64) as u64);
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
