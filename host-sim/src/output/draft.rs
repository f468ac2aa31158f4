//! The one way in which a file is opened for writing.
use std::collections::BTreeSet;
use std::fs::{self, File, Metadata, OpenOptions, Permissions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use schuler_recording::{Error, Problem};
use tempfile::{NamedTempFile, TempDir, TempPath};

use super::{inputs, unwritable};

/// Drafts and scratch directories that are there now, which a process that ends early takes with it.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes what is not finished and ends the process. No draft is begun or put in place from here on.
pub fn abandon(status: i32) -> ! {
    // The lock is held until the process is gone.
    let unfinished = unfinished();
    for path in unfinished.iter() {
        // There is nobody left to tell that something could not be removed.
        let _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    }
    std::process::exit(status)
}

/// A directory for the run alone, which is gone after it.
#[derive(Debug)]
pub struct Scratch(TempDir);

impl Scratch {
    /// Makes the directory.
    ///
    /// # Errors
    /// When the system has no place for it.
    pub fn new() -> io::Result<Self> {
        let mut unfinished = unfinished();
        let directory = tempfile::tempdir()?;
        unfinished.insert(directory.path().to_owned());
        Ok(Self(directory))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        unfinished().remove(self.0.path());
    }
}

/// A file that is being written beside the one that it is to be. It takes that one's place when it is kept; until then that
/// one stays as it was, and a draft that is dropped is gone. Devices and FIFOs are written to as they are.
#[derive(Debug)]
pub struct Draft {
    path: PathBuf,
    file: File,
    /// Where it is until it is kept, and the file whose place it takes; none for devices and FIFOs.
    beside: Option<(Registered, PathBuf)>,
}

impl Draft {
    /// Begins the file that is to be at `path`. A link is followed: what it points to is written.
    ///
    /// # Errors
    /// `path` is an input of this run, write-protected, a directory, a link to nothing or a FIFO that nobody reads, or no file
    /// can be made beside it.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let failed = |error: io::Error| unwritable(path, &error);
        let Target { place, there } = target(path)?;
        if let Some(there) = there.as_ref().filter(|there| !there.is_file()) {
            return Ok(Self { path: path.to_owned(), file: special(path, there)?, beside: None });
        }
        let directory = place.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut unfinished = unfinished();
        let temporary = new_file(directory).map_err(failed)?;
        let (file, temporary) = temporary.into_parts();
        unfinished.insert(temporary.to_path_buf());
        drop(unfinished);
        let beside = Registered(Some(temporary));
        if let Some(there) = there {
            let _ = keep_owner(&file, &there);
            file.set_permissions(there.permissions()).map_err(failed)?;
        }
        Ok(Self { path: path.to_owned(), file, beside: Some((beside, place)) })
    }

    /// The open file, to write to.
    ///
    /// # Errors
    /// When the system has no handle left.
    pub fn file(&self) -> Result<File, Error> {
        self.file.try_clone().map_err(|error| unwritable(&self.path, &error))
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// When it cannot be put there, or what is there has become an input.
    pub fn keep(self) -> Result<(), Error> {
        let Self { path, beside, .. } = self;
        let Some((mut temporary, place)) = beside else { return Ok(()) };
        inputs::check(&path)?;
        temporary.persist(&place).map_err(|error| unwritable(&path, &error))
    }
}

/// A temporary file that [`abandon`] knows of.
#[derive(Debug)]
struct Registered(Option<TempPath>);

impl Registered {
    fn persist(&mut self, place: &Path) -> io::Result<()> {
        let Some(temporary) = self.0.take() else { return Ok(()) };
        let mut unfinished = unfinished();
        unfinished.remove(&*temporary);
        temporary.persist(place).map_err(|error| error.error)
    }
}

impl Drop for Registered {
    fn drop(&mut self) {
        if let Some(temporary) = self.0.take() {
            let mut unfinished = unfinished();
            unfinished.remove(&*temporary);
            drop(temporary);
        }
    }
}

/// Where a file is to be, links followed, and what is there now.
struct Target {
    place: PathBuf,
    there: Option<Metadata>,
}

/// Looks at what is at `path`.
fn target(path: &Path) -> Result<Target, Error> {
    let refuse = |message: &str| Err(Error::one(path, Problem::of_file(message)));
    if path.file_name().is_none() {
        return refuse("has no name of a file; expected one to write");
    }
    inputs::check(path)?;
    let there = match fs::metadata(path) {
        Ok(there) => there,
        Err(_) if fs::symlink_metadata(path).is_ok() => {
            return refuse("is a link to a file that is not there; expected a file");
        }
        Err(_) => return Ok(Target { place: path.to_owned(), there: None }),
    };
    if there.is_dir() {
        return refuse("is a directory; expected a file to write");
    }
    if there.permissions().readonly() {
        return refuse("is write-protected; expected another file");
    }
    let place = if there.is_file() {
        // Whether the user may write to it, which putting another file in its place would not ask.
        OpenOptions::new().write(true).open(path).map_err(|error| unwritable(path, &error))?;
        path.canonicalize().map_err(|error| unwritable(path, &error))?
    } else {
        path.to_owned()
    };
    Ok(Target { place, there: Some(there) })
}

/// Makes sure that a file can be written at `path` without harm, before work begins whose result it is to hold.
///
/// # Errors
/// As [`Draft::of`], except for what only writing can tell.
pub fn check(path: &Path) -> Result<(), Error> {
    target(path).map(drop)
}

/// A new file with the permissions that the user's mask leaves of those of any file.
#[cfg(unix)]
fn new_file(directory: &Path) -> io::Result<NamedTempFile> {
    use std::os::unix::fs::PermissionsExt;
    let permissions = Permissions::from_mode(0o666);
    tempfile::Builder::new().prefix(".").suffix(".part").permissions(permissions).tempfile_in(directory)
}

#[cfg(not(unix))]
fn new_file(directory: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new().prefix(".").suffix(".part").tempfile_in(directory)
}

/// Leaves a file to its owner where the user may do so.
#[cfg(unix)]
fn keep_owner(file: &File, there: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, fchown};
    fchown(file, Some(there.uid()), Some(there.gid()))
}

#[cfg(not(unix))]
fn keep_owner(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Opens a device or a FIFO.
#[cfg(unix)]
fn special(path: &Path, there: &Metadata) -> Result<File, Error> {
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
    let failed = |error: io::Error| unwritable(path, &error);
    if there.file_type().is_fifo() {
        // Opening a FIFO waits for a reader, perhaps for ever; this way of opening does not.
        let read = OpenOptions::new().write(true).custom_flags(libc::O_NONBLOCK).open(path);
        if read.as_ref().is_err_and(|error| error.raw_os_error() == Some(libc::ENXIO)) {
            let message = "is a FIFO that nobody reads; expected one with a reader, or a file";
            return Err(Error::one(path, Problem::of_file(message)));
        }
        // It is kept until the other is open, so that the reader does not see an end between them.
        let waiting = read.map_err(failed)?;
        let file = OpenOptions::new().write(true).open(path).map_err(failed);
        drop(waiting);
        return file;
    }
    OpenOptions::new().write(true).open(path).map_err(failed)
}

#[cfg(not(unix))]
fn special(path: &Path, _: &Metadata) -> Result<File, Error> {
    OpenOptions::new().write(true).open(path).map_err(|error| unwritable(path, &error))
}
