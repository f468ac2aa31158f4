//! Running a campaign: every case made, sealed, explained, opened, scored; cases in parallel, and none twice.
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use schuler_recording::{Error, Problem};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::explainer::Explainer;
use super::explanation::Explanation;
use super::files::Files;
use super::maker::{self, Unmade};
use super::plan::PlanFile;
use super::score::{CaseScore, Circumstances, score};
use super::seed_of;
use crate::output::{self, Interrupted};

/// Name of the file that says which campaign a directory holds.
const CAMPAIGN: &str = "campaign.json";

/// What to run.
pub struct Campaign<'c> {
    /// Plan.
    pub plan: &'c PlanFile,
    /// Seed.
    pub seed: u64,
    /// Cases.
    pub cases: &'c [usize],
    /// Where results lie; a case that has one there is not run again.
    pub directory: &'c Path,
    /// Whether recordings are kept.
    pub keep: bool,
}

/// Why a campaign ended early.
#[derive(Debug, thiserror::Error)]
pub enum Ended {
    /// The user has stopped it.
    #[error(transparent)]
    Stopped(#[from] Interrupted),
    /// A file.
    #[error(transparent)]
    File(#[from] Error),
    /// A case that cannot be made.
    #[error(transparent)]
    Impossible(Unmade),
}

impl From<Unmade> for Ended {
    fn from(unmade: Unmade) -> Self {
        match unmade {
            Unmade::Stopped(stopped) => Self::Stopped(stopped),
            other @ Unmade::Impossible(_) => Self::Impossible(other),
        }
    }
}

/// Which campaign a directory holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Identity {
    seed: u64,
    plan_sha256: String,
}

impl Identity {
    fn of(plan: &PlanFile, seed: u64) -> Self {
        let digest = Sha256::digest(plan.text.as_bytes());
        let plan_sha256 = super::seal::hexadecimal(&digest);
        Self { seed, plan_sha256 }
    }
}

/// The seed of the campaign that a directory holds, if it holds one of this plan.
///
/// # Errors
/// A directory that holds another campaign.
pub fn seed_in(directory: &Path, plan: &PlanFile, asked: Option<u64>) -> Result<Option<u64>, Error> {
    let path = directory.join(CAMPAIGN);
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(None) };
    let wrong = |message: String| Error::one(&path, Problem::of_file(message));
    let found: Identity =
        serde_json::from_str(&text).map_err(|error| wrong(format!("not a campaign: {error}")))?;
    if found != Identity::of(plan, asked.unwrap_or(found.seed)) {
        return Err(wrong(
            "found another plan or seed; expected the same, or a directory of its own".to_owned(),
        ));
    }
    Ok(Some(found.seed))
}

impl Campaign<'_> {
    /// Runs the cases that have no result yet and returns the scores of all, in their order. `done` hears of every case.
    ///
    /// # Errors
    /// The run was stopped, a file that cannot be written, a plan that asks for what cannot be. Cases that were done have their results all
    /// the same.
    pub fn run(
        &self,
        explainer: &Explainer<'_>,
        done: &(dyn Fn(&CaseScore) + Sync),
        check: &(dyn Fn() -> Result<(), Interrupted> + Sync),
    ) -> Result<Vec<CaseScore>, Ended> {
        let identity = Identity::of(self.plan, self.seed);
        let text = serde_json::to_string_pretty(&identity).unwrap_or_default();
        output::write(&self.directory.join(CAMPAIGN), text.as_bytes())?;
        let results: Vec<Result<CaseScore, Ended>> = self
            .cases
            .par_iter()
            .map(|index| {
                check()?;
                let score = match self.result(*index) {
                    Some(score) => score,
                    None => self.case(*index, explainer, check)?,
                };
                done(&score);
                Ok(score)
            })
            .collect();
        results.into_iter().collect()
    }

    fn result_path(&self, index: usize) -> PathBuf {
        self.directory.join("results").join(format!("{index:04}.json"))
    }

    /// A result of an earlier run.
    fn result(&self, index: usize) -> Option<CaseScore> {
        let text = std::fs::read_to_string(self.result_path(index)).ok()?;
        let found: CaseScore = serde_json::from_str(&text).ok()?;
        (found.index == index && found.seed == seed_of(self.seed, index)).then_some(found)
    }

    fn case(
        &self,
        index: usize,
        explainer: &Explainer<'_>,
        check: &(dyn Fn() -> Result<(), Interrupted> + Sync),
    ) -> Result<CaseScore, Ended> {
        let Some(group) = self.plan.plan.group(index) else {
            return Err(Ended::Impossible(Unmade::Impossible(format!("case {index}"))));
        };
        let made = maker::make(group, index, seed_of(self.seed, index), &|| check())?;
        let files = Files { directory: self.directory.to_owned() };
        let opened = files.write_case(&made)?;
        let start = Instant::now();
        let explained = explainer(&files.case(index));
        let time_s = start.elapsed().as_secs_f64();
        // A stop also stops the explainer, whose failure is then no result.
        check()?;
        files.write_answer(&made, &opened)?;
        let answer = files.open(index)?;
        let explanation = explained.map_err(|error| format!("{error:#}")).and_then(Explanation::read);
        let about = Circumstances {
            sensors: made.simulated.case.sensors.len(),
            time_s,
            gain: &made.gain,
            fingerprint: &opened.seal.fingerprint,
        };
        let score = score(&answer, explanation.as_ref().map_err(Clone::clone), &about);
        let text = serde_json::to_string_pretty(&score).unwrap_or_default();
        output::write(&self.result_path(index), text.as_bytes())?;
        if !self.keep {
            // What is left behind is no harm.
            let _ = std::fs::remove_dir_all(files.case_directory(index));
            let _ = std::fs::remove_file(files.gain(index));
        }
        Ok(score)
    }
}
