//! Files that are whole or not there at all, and runs that can be stopped.
//!
//! Every file that is written is opened by [`Draft::of`], which knows the inputs of the run ([`protect`]) and refuses to replace
//! one. Every name of a file that is made of what stands in a case comes from [`file_name`].
mod draft;
mod inputs;
mod name;

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use schuler_recording::{Case, Error, Problem, table};

pub use draft::{Draft, Scratch, abandon, check};
pub use inputs::protect;
pub use name::file_name;

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
        file.write_all(bytes).and_then(|()| synced(&file)).map_err(|error| unwritable(path, &error))
    })
}

/// Waits until the bytes of a file are where a loss of power does not reach them; FIFOs and terminals have no such place.
fn synced(file: &File) -> std::io::Result<()> {
    if file.metadata()?.is_file() { file.sync_all() } else { Ok(()) }
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
    fn an_input_is_never_replaced_under_any_of_its_names() {
        let directory = tempfile::tempdir().unwrap();
        let input = directory.path().join("input.csv");
        std::fs::write(&input, "t\n1\n").unwrap();
        std::fs::create_dir(directory.path().join("d")).unwrap();
        protect(&input);
        let hard = directory.path().join("hard.csv");
        std::fs::hard_link(&input, &hard).unwrap();
        let roundabout = directory.path().join("d/../input.csv");
        for path in [&input, &hard, &roundabout] {
            let said = write(path, b"new").unwrap_err().to_string();
            assert!(said.contains("this run reads it"), "{said}");
        }
        #[cfg(unix)]
        {
            let soft = directory.path().join("soft.csv");
            std::os::unix::fs::symlink(&input, &soft).unwrap();
            assert!(write(&soft, b"new").is_err());
        }
        assert_eq!(std::fs::read(&input).unwrap(), b"t\n1\n");
        // A file of the same name elsewhere is another one.
        write(&directory.path().join("d/input.csv"), b"new").unwrap();
    }

    #[test]
    #[cfg(unix)]
    fn links_are_followed_and_modes_kept() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let mode = |name: &str| std::fs::metadata(at(name)).unwrap().permissions().mode() & 0o7777;
        std::fs::write(at("file"), "old").unwrap();
        std::fs::set_permissions(at("file"), PermissionsExt::from_mode(0o640)).unwrap();
        symlink(at("file"), at("link")).unwrap();
        write(&at("link"), b"new").unwrap();
        assert_eq!(std::fs::read(at("file")).unwrap(), b"new");
        assert!(std::fs::symlink_metadata(at("link")).unwrap().is_symlink());
        assert_eq!(mode("file"), 0o640);
        // A new file is as open as one that any other program makes.
        std::fs::write(at("usual"), "").unwrap();
        write(&at("fresh"), b"").unwrap();
        assert_eq!(mode("fresh"), mode("usual"));
        std::fs::set_permissions(at("file"), PermissionsExt::from_mode(0o440)).unwrap();
        assert!(write(&at("file"), b"newer").unwrap_err().to_string().contains("write-protected"));
        symlink(at("nowhere"), at("dangling")).unwrap();
        assert!(write(&at("dangling"), b"").is_err() && write(directory.path(), b"").is_err());
        assert_eq!(std::fs::read(at("file")).unwrap(), b"new");
    }

    #[test]
    #[cfg(unix)]
    fn devices_stay_what_they_are() {
        use std::os::unix::fs::FileTypeExt;
        write(Path::new("/dev/null"), b"gone").unwrap();
        assert!(std::fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }

    #[test]
    fn a_file_where_none_can_be_is_named() {
        let error = write(Path::new("/proc/none/x.json"), b"").unwrap_err().to_string();
        assert!(error.starts_with("/proc/none"), "{error}");
    }
}
