//! What a run reads, which nothing that it writes may replace.
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use schuler_recording::{Error, Problem};

/// A process has one set of inputs, as it has one set of arguments.
static INPUTS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Notes that this run reads the file at `path`. Files that are not there are no inputs.
pub fn protect(path: &Path) {
    if let Ok(path) = path.canonicalize() {
        INPUTS.lock().unwrap_or_else(PoisonError::into_inner).insert(path);
    }
}

/// Makes sure that writing to `path` leaves every input as it is.
///
/// # Errors
/// `path` is an input of this run, under this name, by a link, or as another name of the same file.
pub(super) fn check(path: &Path) -> Result<(), Error> {
    let Ok(canonical) = path.canonicalize() else { return Ok(()) };
    let inputs = INPUTS.lock().unwrap_or_else(PoisonError::into_inner);
    if inputs.iter().any(|input| *input == canonical || same_file(input, &canonical)) {
        let message = "would be replaced, but this run reads it; expected another file or directory";
        return Err(Error::one(path, Problem::of_file(message)));
    }
    Ok(())
}

/// Whether two names are those of one file, as hard links are. The file behind an input is looked up now: the system gives the
/// number of a file that is gone to another one.
#[cfg(unix)]
fn same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| fs::metadata(path).ok().map(|it| (it.dev(), it.ino()));
    identity(a).is_some() && identity(a) == identity(b)
}

#[cfg(not(unix))]
fn same_file(_: &Path, _: &Path) -> bool {
    false
}
