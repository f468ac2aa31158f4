//! `schuler campaign PLAN.toml`.
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use super::Failure;
use super::session::Session;
use crate::campaign::files::Files;
use crate::campaign::maker::{self, Unmade};
use crate::campaign::plan::Plan;
use crate::campaign::seed_of;

/// What to do.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Plan file.
    plan: PathBuf,
    /// Seed instead of the plan's or a fresh one.
    #[arg(long)]
    seed: Option<u64>,
    /// Only these cases.
    #[arg(long, value_delimiter = ',')]
    only: Vec<usize>,
    /// Write cases, seals and answers into this directory, and look for nothing.
    #[arg(long)]
    make: Option<PathBuf>,
}

#[derive(Serialize)]
struct Made {
    format: &'static str,
    title: String,
    seed: u64,
    directory: PathBuf,
    cases: Vec<usize>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let file = Plan::read(&arguments.plan)?;
    Session::warn(&file.warnings.iter().map(|w| format!("{}: {w}", file.path.display())).collect::<Vec<_>>());
    let seed = match arguments.seed.or(file.plan.seed) {
        Some(seed) => seed,
        None => fresh_seed()?,
    };
    let cases: Vec<usize> =
        if arguments.only.is_empty() { (0..file.plan.cases()).collect() } else { arguments.only.clone() };
    if let Some(directory) = &arguments.make {
        let files = Files { directory: directory.clone() };
        let progress = session.progress("making cases", cases.len());
        let done = AtomicUsize::new(0);
        let results: Vec<Result<(), Failure>> = cases
            .par_iter()
            .map(|index| {
                let Some(group) = file.plan.group(*index) else {
                    return Err(Failure::Other(anyhow::anyhow!("--only {index}: the plan has no such case")));
                };
                let made = maker::make(group, *index, seed_of(seed, *index), &|| progress.check())
                    .map_err(unmade)?;
                let opened = files.write_case(&made)?;
                files.write_answer(&made, &opened)?;
                progress.done(done.fetch_add(1, Ordering::Relaxed) + 1);
                Ok(())
            })
            .collect();
        drop(progress);
        results.into_iter().collect::<Result<(), _>>()?;
        let made = Made {
            format: "schuler-campaign-cases/1",
            title: file.plan.title.clone(),
            seed,
            directory: directory.clone(),
            cases,
        };
        return session.answer(&made, |it| {
            format!(
                "{}\nseed {}\n{} cases in {}\n",
                it.title,
                it.seed,
                it.cases.len(),
                it.directory.display()
            )
        });
    }
    Err(Failure::Other(anyhow::anyhow!("nothing explains yet")))
}

fn unmade(error: Unmade) -> Failure {
    match error {
        Unmade::Stopped(stopped) => Failure::Stopped(stopped),
        impossible @ Unmade::Impossible(_) => Failure::Other(impossible.into()),
    }
}

/// A seed from the operating system, small enough to be a number in any document.
fn fresh_seed() -> Result<u64, Failure> {
    let drawn =
        getrandom::u64().map_err(|error| Failure::Other(anyhow::anyhow!("no random seed: {error}")))?;
    Ok(drawn >> 11)
}
