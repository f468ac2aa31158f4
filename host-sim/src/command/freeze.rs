//! `schuler campaign freeze` and `schuler campaign compare`.
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};

use super::Failure;
use super::campaign::ended;
use super::session::Session;
use crate::campaign::engine::Engine;
use crate::campaign::explainer;
use crate::campaign::freeze::compare::compare;
use crate::campaign::freeze::record::{self, Header, Record};
use crate::campaign::freeze::run::Freeze;
use crate::campaign::freeze::set::{Set, cases_below};
use crate::campaign::freeze::table;
use crate::campaign::plan::Plan;

/// What the help of freezing teaches.
const EXAMPLES: &str = "\
Examples:
  Answers to sixty concealed cases, and to a long plan as far as one gets; both go on where they were stopped:
    schuler campaign freeze --plan host-sim/plans/small.toml --seed 1 --out records/second/small-1.jsonl
    schuler campaign freeze --plan host-sim/plans/full.toml --seed 1 --most 200 --out records/second/full-1.jsonl

  Answers to cases of others, with what they say is concealed, or without:
    schuler campaign freeze --cases theirs/cases --truth theirs/answers --out records/second/theirs.jsonl
    schuler campaign freeze --cases recordings --set real --out records/second/real.jsonl";

/// What the help of comparing teaches.
const COMPARING: &str = "\
Examples:
  Two engines over the cases that both were given:
    schuler campaign compare records/first records/second";

/// What to freeze.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Plan whose cases are made.
    #[arg(long, conflicts_with_all = ["cases", "truth"], requires = "seed", required_unless_present = "cases")]
    plan: Option<PathBuf>,
    /// Seed of the plan's cases.
    #[arg(long)]
    seed: Option<u64>,
    /// Folder of cases; may be given more than once.
    #[arg(long)]
    cases: Vec<PathBuf>,
    /// Folder of what is concealed in them, NAME.json as tests/independent writes it.
    #[arg(long, requires = "cases")]
    truth: Option<PathBuf>,
    /// Name of the set, by which records are compared; without it that of the plan or of the first
    /// folder.
    #[arg(long)]
    set: Option<String>,
    /// Most cases that are run now.
    #[arg(long, default_value_t = usize::MAX, hide_default_value = true)]
    most: usize,
    /// Processor time after which a case is ended, s.
    #[arg(long, default_value_t = 600.0)]
    limit_s: f64,
    /// Commit of this program; without it what git says of the working directory.
    #[arg(long)]
    commit: Option<String>,
    /// Record, a file of JSON lines; one that is there goes on.
    #[arg(long, short)]
    out: PathBuf,
}

/// What to compare.
#[derive(Debug, clap::Args)]
#[command(after_help = COMPARING)]
pub(super) struct Compared {
    /// Record, or folder of records.
    a: PathBuf,
    /// Record, or folder of records.
    b: PathBuf,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    if let Some(plan) = &arguments.plan {
        crate::output::protect(plan);
    }
    let plan = arguments.plan.as_deref().map(Plan::read).transpose()?;
    let set = match (&plan, arguments.seed) {
        (Some(plan), Some(seed)) => Set::Plan { plan, seed },
        _ => Set::Folders(cases_below(&arguments.cases)?),
    };
    let place = arguments.plan.as_deref().or(arguments.cases.first().map(PathBuf::as_path));
    let stem = place.and_then(Path::file_stem).map(|name| name.to_string_lossy().into_owned());
    let header = Header {
        format: record::FORMAT.to_owned(),
        set: arguments.set.clone().or(stem).unwrap_or_default(),
        engine: Engine::default(),
        seed: plan.as_ref().and(arguments.seed),
        plan_sha256: plan.as_ref().map(|plan| format!("{:x}", Sha256::digest(plan.text.as_bytes()))),
        date: today(),
        commit: arguments.commit.clone().unwrap_or_else(commit),
        machine: machine(),
        limit_s: arguments.limit_s,
        cases: set.len(),
    };
    let header = continued(&arguments.out, header)?;
    let explainer = explainer::limited(session.program(), arguments.limit_s);
    let freeze = Freeze {
        set: &set,
        truth: arguments.truth.as_deref(),
        header,
        out: &arguments.out,
        most: arguments.most,
    };
    let progress = session.progress("freezing", set.len());
    let record = freeze.run(&*explainer, &|rows| progress.done(rows), &|| progress.check());
    drop(progress);
    let record = record.map_err(ended)?;
    session.answer(&record.header, |it| {
        format!("{} of {} cases of {} in {}\n", record.rows.len(), it.cases, it.set, arguments.out.display())
    })
}

pub(super) fn compared(arguments: &Compared, session: &Session) -> Result<(), Failure> {
    let comparison = compare(&Record::read_all(&arguments.a)?, &Record::read_all(&arguments.b)?);
    session.answer(&comparison, table::text)
}

/// The header of the record that goes on, which must be one of the same run.
fn continued(out: &Path, header: Header) -> Result<Header, Failure> {
    if !out.exists() {
        return Ok(header);
    }
    let there = Record::read(out)?.header;
    let of = |it: &Header| (it.set.clone(), it.engine, it.seed, it.plan_sha256.clone(), it.commit.clone());
    if of(&there) == of(&header) {
        return Ok(Header { cases: header.cases, ..there });
    }
    let found =
        "found a record of another set, engine, seed, plan or commit; expected the same, or another file";
    let problem = schuler_recording::Problem::of_file(found);
    Err(Failure::Input(schuler_recording::Error::one(out, problem)))
}

/// What git says of the working directory.
fn commit() -> String {
    let said = Command::new("git").args(["describe", "--always", "--dirty", "--exclude", "*"]).output();
    let text = said.ok().filter(|said| said.status.success()).map(|said| said.stdout).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).trim().to_owned();
    if text.is_empty() { "unknown".to_owned() } else { text }
}

/// The processor as Linux names it, and its cores.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or(std::env::consts::ARCH, |(_, name)| name.trim());
    format!("{name}, {cores} cores")
}

fn today() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs());
    date(since / 86_400)
}

/// The day in the Gregorian calendar so many days after 1 January 1970.
fn date(days: u64) -> String {
    // Years begin in March, so that the day that comes and goes is the last; 719 468 days before
    // 1970 one of 400 years begins.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, turn) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    format!("{:04}-{month:02}-{day:02}", era * 400 + year + turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_have_their_dates() {
        // date -u -d @$((86400 * N)) +%F
        for (days, text) in [
            (0, "1970-01-01"),
            (11_016, "2000-02-29"),
            (11_017, "2000-03-01"),
            (20_819, "2027-01-01"),
            (47_540, "2100-02-28"),
            (47_541, "2100-03-01"),
        ] {
            assert_eq!(date(days), text);
        }
    }
}
