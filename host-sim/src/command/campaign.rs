//! `schuler campaign PLAN.toml`.
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use super::session::Session;
use super::{Failure, freeze};
use crate::campaign::files::Files;
use crate::campaign::maker::{self, Unmade};
use crate::campaign::plan::{Plan, PlanFile};
use crate::campaign::run::{Campaign, Ended, seed_in};
use crate::campaign::score::CaseScore;
use crate::campaign::summary::{Summary, summary};
use crate::campaign::{explainer, report, seed_of};
use crate::output;
use crate::plot::Format;

/// Name of the report and of its figure.
const REPORT: &str = "report";
/// Name of the figure.
const PICTURE: &str = "detection";

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  Sixty cases with a fresh seed, concealed, explained and scored; status 1 if a bar is missed:
    schuler campaign host-sim/plans/small.toml

  A long one that goes on where it was stopped:
    schuler campaign host-sim/plans/full.toml --out out/campaign

  Cases to look at, and another program in the place of `schuler explain`:
    schuler campaign host-sim/plans/small.toml --seed 1 --make out/cases
    schuler campaign host-sim/plans/small.toml --explainer 'my_tool {case}'";

/// What to do.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Plan file.
    #[arg(required = true)]
    plan: Option<PathBuf>,
    /// Seed instead of the plan's or a fresh one.
    #[arg(long)]
    seed: Option<u64>,
    /// Only these cases.
    #[arg(long, value_delimiter = ',')]
    only: Vec<usize>,
    /// Directory for results, seals, answers and the report; a case that has a result there is not run again.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// The same, and keep the cases with their recordings as well.
    #[arg(long, conflicts_with = "out")]
    keep: Option<PathBuf>,
    /// Write cases, seals and answers into this directory, and look for nothing.
    #[arg(long, conflicts_with_all = ["out", "keep"])]
    make: Option<PathBuf>,
    /// Another program that explains a case, by its command line; {case} stands for the case's path.
    #[arg(long, value_name = "COMMAND")]
    explainer: Option<String>,
}

/// What else is done with campaigns.
#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Keep the answers of an engine to a set of cases as data.
    Freeze(freeze::Arguments),
    /// Compare what two engines made of the same cases.
    Compare(freeze::Compared),
}

#[derive(Serialize)]
struct Made {
    format: &'static str,
    title: String,
    seed: u64,
    directory: PathBuf,
    cases: Vec<usize>,
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    title: String,
    seed: u64,
    summary: Summary,
    cases: Vec<CaseScore>,
    files: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    match (&arguments.action, &arguments.plan) {
        (Some(Action::Freeze(arguments)), _) => freeze::run(arguments, session),
        (Some(Action::Compare(arguments)), _) => freeze::compared(arguments, session),
        (None, Some(plan)) => run_plan(arguments, plan, session),
        (None, None) => Err(Failure::Other(anyhow::anyhow!("found no plan; expected a plan file"))),
    }
}

fn run_plan(arguments: &Arguments, plan: &Path, session: &Session) -> Result<(), Failure> {
    output::protect(plan);
    let file = Plan::read_with(plan, session.leniency())?;
    session.warn(&file.warnings.iter().map(|w| format!("{}: {w}", file.path.display())).collect::<Vec<_>>());
    let cases: Vec<usize> =
        if arguments.only.is_empty() { (0..file.plan.cases()).collect() } else { arguments.only.clone() };
    if let Some(unknown) = cases.iter().find(|index| **index >= file.plan.cases()) {
        let found = format!("found --only {unknown}; expected a number below {}", file.plan.cases());
        return Err(Failure::Input(schuler_recording::Error::one(
            &file.path,
            schuler_recording::Problem::of_file(found),
        )));
    }
    let asked = arguments.seed.or(file.plan.seed);
    if let Some(directory) = &arguments.make {
        return make(&file, asked, cases, directory, session);
    }
    let kept = arguments.keep.as_ref().or(arguments.out.as_ref());
    let earlier = kept.map(|directory| seed_in(directory, &file, asked)).transpose()?.flatten();
    let seed = asked.or(earlier).map_or_else(fresh_seed, Ok)?;
    let temporary = output::Scratch::new().map_err(|error| Failure::Other(error.into()))?;
    let directory = kept.map_or(temporary.path(), PathBuf::as_path);
    let explainer = match &arguments.explainer {
        Some(line) => explainer::external(line).map_err(Failure::Other)?,
        None => explainer::standard(session.program()),
    };
    eprintln!("schuler: seed {seed}");
    let campaign = Campaign { plan: &file, seed, cases: &cases, directory, keep: arguments.keep.is_some() };
    let progress = session.progress("campaign", cases.len());
    let done = AtomicUsize::new(0);
    let scores =
        campaign.run(&*explainer, &|_| progress.done(done.fetch_add(1, Ordering::Relaxed) + 1), &|| {
            progress.check()
        });
    drop(progress);
    let scores = scores.map_err(ended)?;
    let summary = summary(&scores, &file.plan.bars);
    let files = match kept {
        Some(directory) => write(&file, seed, &scores, &summary, directory)?,
        None => Vec::new(),
    };
    let missed: Vec<String> = summary.misses().iter().map(|figure| figure.name.clone()).collect();
    let answer = Answer {
        format: "schuler-campaign/1",
        title: file.plan.title.clone(),
        seed,
        summary,
        cases: scores,
        files,
    };
    session.answer(&answer, |it| {
        let head = format!("{}\nseed {}\n{}", it.title, it.seed, report::text(&it.summary));
        it.files.iter().fold(head, |text, path| text + "  " + &path.display().to_string() + "\n")
    })?;
    if missed.is_empty() {
        return Ok(());
    }
    Err(Failure::Other(anyhow::anyhow!("bars missed: {}", missed.join(", "))))
}

/// Report, figure and every score in one document.
fn write(
    file: &PlanFile,
    seed: u64,
    scores: &[CaseScore],
    summary: &Summary,
    directory: &Path,
) -> Result<Vec<PathBuf>, Failure> {
    let picture = report::picture(&file.plan.title, scores, &file.plan.bars);
    let mut files = picture.write(directory, PICTURE, &[Format::Png])?;
    let path = directory.join(format!("{REPORT}.md"));
    let text = report::markdown(&file.plan.title, seed, summary, &format!("{PICTURE}.png"));
    output::write(&path, text.as_bytes())?;
    files.push(path);
    let path = directory.join(format!("{REPORT}.json"));
    let document = serde_json::json!({ "format": "schuler-campaign/1", "title": file.plan.title, "seed": seed,
        "plan": file.plan, "summary": summary, "cases": scores });
    let text = serde_json::to_string_pretty(&document).map_err(|error| Failure::Other(error.into()))?;
    output::write(&path, text.as_bytes())?;
    files.push(path);
    Ok(files)
}

fn make(
    file: &PlanFile,
    asked: Option<u64>,
    cases: Vec<usize>,
    directory: &Path,
    session: &Session,
) -> Result<(), Failure> {
    let seed = asked.map_or_else(fresh_seed, Ok)?;
    let files = Files { directory: directory.to_owned() };
    let progress = session.progress("making cases", cases.len());
    let done = AtomicUsize::new(0);
    let results: Vec<Result<(), Failure>> = cases
        .par_iter()
        .filter_map(|index| Some((index, file.plan.group(*index)?)))
        .map(|(index, group)| {
            let made =
                maker::make(group, *index, seed_of(seed, *index), &|| progress.check()).map_err(unmade)?;
            let opened = files.write_case(&made)?;
            files.write_answer(&made, &opened)?;
            progress.done(done.fetch_add(1, Ordering::Relaxed) + 1);
            Ok(())
        })
        .collect();
    drop(progress);
    results.into_iter().collect::<Result<(), _>>()?;
    let title = file.plan.title.clone();
    let made =
        Made { format: "schuler-campaign-cases/1", title, seed, directory: directory.to_owned(), cases };
    session.answer(&made, |it| {
        format!("{}\nseed {}\n{} cases in {}\n", it.title, it.seed, it.cases.len(), it.directory.display())
    })
}

fn unmade(error: Unmade) -> Failure {
    match error {
        Unmade::Stopped(stopped) => Failure::Stopped(stopped),
        impossible @ Unmade::Impossible(_) => Failure::Other(impossible.into()),
    }
}

pub(super) fn ended(error: Ended) -> Failure {
    match error {
        Ended::Stopped(stopped) => Failure::Stopped(stopped),
        Ended::File(error) => Failure::Input(error),
        Ended::Impossible(unmade) => Failure::Other(unmade.into()),
    }
}

/// A seed from the operating system, small enough to be a number in any document.
fn fresh_seed() -> Result<u64, Failure> {
    let drawn =
        getrandom::u64().map_err(|error| Failure::Other(anyhow::anyhow!("no random seed: {error}")))?;
    Ok(drawn >> 11)
}
