//! Files that are whole or not there at all, and runs that can be stopped.
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use schuler_recording::{Case, Error, Problem, table};
use tempfile::NamedTempFile;

/// The user has stopped the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped; nothing was written that is not whole")]
pub struct Interrupted;

/// Whether the user wants to stop.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Notes that the user wants to stop.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// An error once the user wants to stop.
    ///
    /// # Errors
    /// The user wants to stop.
    pub fn check(&self) -> Result<(), Interrupted> {
        if self.0.load(Ordering::Relaxed) { Err(Interrupted) } else { Ok(()) }
    }
}

/// A file that is being written beside the one that it is to be, with the same ending. It takes that one's place when it is
/// kept; until then that one stays as it was, and a draft that is dropped is gone.
#[derive(Debug)]
pub struct Draft {
    temporary: NamedTempFile,
    path: PathBuf,
}

impl Draft {
    /// Begins the file that is to be at `path`.
    ///
    /// # Errors
    /// When no file can be made beside it.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let directory = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let temporary = tempfile::Builder::new()
            .prefix(".")
            .suffix(&format!(".{name}"))
            .tempfile_in(directory)
            .map_err(|error| unwritable(path, &error))?;
        Ok(Self { temporary, path: path.to_owned() })
    }

    /// The open file, to write to.
    ///
    /// # Errors
    /// When the system has no handle left.
    pub fn file(&self) -> Result<File, Error> {
        self.temporary.as_file().try_clone().map_err(|error| unwritable(&self.path, &error))
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// When it cannot be put there.
    pub fn keep(self) -> Result<(), Error> {
        let Self { temporary, path } = self;
        readable_by_all(temporary.path()).map_err(|error| unwritable(&path, &error))?;
        temporary.persist(&path).map(drop).map_err(|error| unwritable(&path, &error.error))
    }
}

/// Lets `write` write the file that is to be at `path`, and puts it there when that is done. Whatever happens before, what is
/// at `path` stays as it was.
///
/// # Errors
/// As `write`, or when the file cannot be made or put in place.
pub fn atomically<T, E: From<Error>>(path: &Path, write: impl FnOnce(File) -> Result<T, E>) -> Result<T, E> {
    let draft = Draft::of(path)?;
    let written = write(draft.file()?)?;
    draft.keep()?;
    Ok(written)
}

/// Writes bytes to `path`, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    make_directory_of(path)?;
    atomically(path, |mut file| {
        file.write_all(bytes).and_then(|()| file.sync_all()).map_err(|error| unwritable(path, &error))
    })
}

/// Writes columns under their names as a table in the format that the name of `path` says, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_table(path: &Path, columns: &[(&str, &[f64])]) -> Result<(), Error> {
    atomically(path, |file| table::write_to(file, path, columns))
}

/// Writes a case, whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn write_case(path: &Path, case: &Case) -> Result<(), Error> {
    let text = case
        .to_toml()
        .map_err(|error| Error::one(path, Problem::of_file(format!("cannot write the case: {error}"))))?;
    write(path, text.as_bytes())
}

fn unwritable(path: &Path, error: &std::io::Error) -> Error {
    Error::io(path, "write the file", error)
}

/// Makes the directory that `path` is in, if it is not there.
///
/// # Errors
/// When it cannot be made.
pub fn make_directory_of(path: &Path) -> Result<(), Error> {
    let Some(directory) = path.parent().filter(|p| !p.as_os_str().is_empty()) else { return Ok(()) };
    std::fs::create_dir_all(directory).map_err(|error| Error::io(directory, "make the directory", &error))
}

/// Temporary files are for their owner alone; results are not.
#[cfg(unix)]
fn readable_by_all(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn readable_by_all(_path: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("result.csv");
        write(&path, b"old").unwrap();
        let failed = atomically(&path, |mut file| {
            file.write_all(b"half").unwrap();
            Err::<(), _>(Error::one(&path, Problem::of_file("broken")))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_file_where_none_can_be_is_named() {
        let error = write(Path::new("/proc/none/x.json"), b"").unwrap_err().to_string();
        assert!(error.starts_with("/proc/none"), "{error}");
    }
}
