//! Where cases come from: a plan with a seed, or folders of cases, each beside a folder of answers
//! or not.
use std::path::{Path, PathBuf};

use schuler_recording::{Error, Problem};

use super::super::plan::PlanFile;
use super::super::seed_of;

/// Seed of the order in which the cases of a plan are run.
const ORDER: u64 = 1_006_317;
/// How a case file begins to say what it is.
const CASE: &str = "schuler-case/";
/// Name of a case file that has a folder for itself.
const ALONE: &str = "case.toml";

/// A set of cases.
pub enum Set<'s> {
    /// Of a plan.
    Plan {
        /// The plan.
        plan: &'s PlanFile,
        /// Seed of the campaign.
        seed: u64,
    },
    /// Of folders.
    Folders(Vec<CaseFile>),
}

/// A case in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaseFile {
    /// Path below the folder, without what every case has.
    pub name: String,
    /// The file.
    pub path: PathBuf,
}

impl Set<'_> {
    /// Number of cases.
    pub fn len(&self) -> usize {
        match self {
            Self::Plan { plan, .. } => plan.plan.cases(),
            Self::Folders(cases) => cases.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Numbers from zero in an order that is always the same and follows nothing: the first of them are
/// a fair sample.
pub fn shuffled(count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|index| seed_of(ORDER, *index));
    order
}

/// Every case below the folders, in the order of their names.
///
/// # Errors
/// A folder that cannot be read, folders without cases.
pub fn cases_below(folders: &[PathBuf]) -> Result<Vec<CaseFile>, Error> {
    let mut cases = Vec::new();
    for folder in folders {
        let mut files = Vec::new();
        files_below(folder, &mut files)?;
        files.sort();
        for path in files {
            // A file that cannot be read as text is no case.
            let is_case = std::fs::read_to_string(&path).is_ok_and(|text| text.contains(CASE));
            if is_case {
                cases.push(CaseFile { name: name_of(folder, &path), path });
            }
        }
    }
    if cases.is_empty() {
        let first = folders.first().map_or(Path::new("."), PathBuf::as_path);
        return Err(Error::one(
            first,
            Problem::of_file("found no case; expected files of TOML that are cases"),
        ));
    }
    Ok(cases)
}

fn files_below(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Error> {
    let entries = std::fs::read_dir(folder).map_err(|error| Error::io(folder, "read the folder", &error))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            files_below(&path, files)?;
        } else if path.extension().is_some_and(|ending| ending == "toml") {
            files.push(path);
        }
    }
    Ok(())
}

fn name_of(folder: &Path, path: &Path) -> String {
    let below = path.strip_prefix(folder).unwrap_or(path);
    let alone = below.file_name().is_some_and(|name| name == ALONE);
    let short = if alone { below.parent().map(Path::to_owned) } else { Some(below.with_extension("")) };
    short
        .unwrap_or_default()
        .components()
        .map(|part| part.as_os_str().to_string_lossy())
        .collect::<Vec<_>>()
        .join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beginning_of_a_long_plan_is_a_sample_of_all_of_it() {
        let order = shuffled(1000);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..1000).collect::<Vec<_>>());
        // Of a hundred numbers below 1000 without order the mean has a standard deviation of 27.
        let mean = order[..100].iter().sum::<usize>() as f64 / 100.0;
        assert!((mean - 499.5).abs() < 3.0 * 27.0, "{mean}");
        assert_eq!(order, shuffled(1000));
    }

    #[test]
    fn cases_have_the_names_of_their_folders() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("b/c");
        std::fs::create_dir_all(&below).unwrap();
        std::fs::write(below.join("case.toml"), "format = \"schuler-case/1\"").unwrap();
        std::fs::write(below.join("other.toml"), "format = \"schuler-case/1\"").unwrap();
        std::fs::write(below.join("plan.toml"), "format = \"schuler-plan/1\"").unwrap();
        let cases = cases_below(&[folder.path().to_owned()]).unwrap();
        let names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        assert_eq!(names, ["b/c", "b/c/other"]);
        std::fs::remove_dir_all(&below).unwrap();
        assert!(cases_below(&[folder.path().to_owned()]).is_err());
    }
}
