//! An engine over a set of cases, one after the other, so that the processor time of each is its
//! own.
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::super::explainer::Explainer;
use super::super::explanation::Explanation;
use super::super::maker::{self, Unmade};
use super::super::run::Ended;
use super::super::score::{Circumstances, score};
use super::super::{processor, seed_of};
use super::record::{Header, Record, Row};
use super::set::{CaseFile, Set, shuffled};
use super::truth::Theirs;
use crate::output::Interrupted;
use crate::simulation::CASE;

/// What to run.
pub struct Freeze<'f> {
    /// Cases.
    pub set: &'f Set<'f>,
    /// Folder of answers to the cases of folders: `NAME.json`.
    pub truth: Option<&'f Path>,
    /// What the record says of the run.
    pub header: Header,
    /// The record; it is written anew after each case.
    pub out: &'f Path,
    /// Most cases that are run now.
    pub most: usize,
}

impl Freeze<'_> {
    /// Runs the cases that the record does not have yet, and returns it. `done` hears how many rows
    /// it has.
    ///
    /// # Errors
    /// The run was stopped, a file that cannot be read or written, a case that cannot be made. The
    /// cases that were done are in the record.
    pub fn run(
        &self,
        explainer: &Explainer<'_>,
        done: &dyn Fn(usize),
        check: &(dyn Fn() -> Result<(), Interrupted> + Sync),
    ) -> Result<Record, Ended> {
        let mut record = Record { header: self.header.clone(), rows: vec![] };
        if self.out.exists() {
            record.rows = Record::read(self.out)?.rows;
        }
        let mut left = self.most;
        for index in self.order() {
            let name = self.name(index);
            if left == 0 {
                break;
            }
            if record.rows.iter().any(|row| row.case == name) {
                continue;
            }
            check()?;
            let row = self.row(index, &name, explainer, check)?;
            check()?;
            record.rows.push(row);
            record.write(self.out)?;
            done(record.rows.len());
            left -= 1;
        }
        Ok(record)
    }

    fn order(&self) -> Vec<usize> {
        match self.set {
            Set::Plan { .. } => shuffled(self.set.len()),
            Set::Folders(cases) => (0..cases.len()).collect(),
        }
    }

    fn name(&self, index: usize) -> String {
        match self.set {
            Set::Plan { .. } => format!("{index:04}"),
            Set::Folders(cases) => cases[index].name.clone(),
        }
    }

    fn row(
        &self,
        index: usize,
        name: &str,
        explainer: &Explainer<'_>,
        check: &(dyn Fn() -> Result<(), Interrupted> + Sync),
    ) -> Result<Row, Ended> {
        match self.set {
            Set::Plan { plan, seed } => {
                let impossible = || Ended::Impossible(Unmade::Impossible(format!("case {index}")));
                let group = plan.plan.group(index).ok_or_else(impossible)?;
                let made = maker::make(group, index, seed_of(*seed, index), check)?;
                let folder = tempfile::tempdir().map_err(|error| {
                    schuler_recording::Error::io(self.out, "make a folder for a case beside", &error)
                })?;
                made.simulated.write_public(folder.path())?;
                let (explained, processor_s) = explained(explainer, &folder.path().join(CASE));
                let about = Circumstances {
                    sensors: made.simulated.case.sensors.len(),
                    time_s: processor_s,
                    gain: &made.gain,
                    fingerprint: "",
                };
                let score = score(&made.answer, explained.as_ref().map_err(Clone::clone), &about);
                Ok(Row::of(name, explained.as_ref().map_err(Clone::clone), processor_s)
                    .judged(&made.answer, &score))
            }
            Set::Folders(cases) => Ok(self.row_of_file(&cases[index], explainer)?),
        }
    }

    fn row_of_file(
        &self,
        case: &CaseFile,
        explainer: &Explainer<'_>,
    ) -> Result<Row, schuler_recording::Error> {
        let (explained, processor_s) = explained(explainer, &case.path);
        let row = Row::of(&case.name, explained.as_ref().map_err(Clone::clone), processor_s);
        let Some(folder) = self.truth else { return Ok(row) };
        let path: PathBuf = folder.join(format!("{}.json", case.name));
        let answer = Theirs::read(&path)?.answer(explained.as_ref().ok());
        let about = Circumstances { sensors: 1, time_s: processor_s, gain: &[], fingerprint: "" };
        let score = score(&answer, explained.as_ref().map_err(Clone::clone), &about);
        Ok(row.judged(&answer, &score))
    }
}

/// The answer, and the processor time of the programs that were waited for.
fn explained(explainer: &Explainer<'_>, case: &Path) -> (Result<Explanation, String>, f64) {
    let (start, before) = (Instant::now(), processor::waited_for());
    let answer = explainer(case);
    let elapsed_s = start.elapsed().as_secs_f64();
    let processor_s = processor::waited_for().zip(before).map_or(elapsed_s, |(after, before)| after - before);
    // A record says nothing of where the case lay.
    let place = case.parent().unwrap_or(Path::new("")).to_string_lossy().into_owned();
    let failure = |error: anyhow::Error| format!("{error:#}").replace(&format!("{place}/"), "");
    (answer.map_err(failure).and_then(Explanation::read), processor_s)
}
