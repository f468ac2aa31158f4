//! The one way in which a file is opened for reading, and how much of one is read as a whole.
use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::path::Path;

use crate::error::{Error, Problem};

/// Bytes of the longest file that is read as a whole: a case, a scenario, a plan, a block. The longest case of ten thousand
/// sensors has a third of them.
pub const LONGEST_DOCUMENT: u64 = 1 << 24;

/// Opens a file that has an end and can be read twice; `doing` completes "cannot …".
///
/// # Errors
/// A file that cannot be opened, or what is no regular file: a directory, a device, a FIFO, a socket. Opening some of these
/// would wait for ever, reading others would not end.
pub fn open(path: &Path, doing: &str) -> Result<File, Error> {
    let failed = |error: io::Error| Error::io(path, doing, &error);
    let kind = fs::metadata(path).map_err(failed)?.file_type();
    if !kind.is_file() {
        let message = format!("cannot {doing}: found {}; expected a regular file", described(kind));
        return Err(Error::one(path, Problem::of_file(message)));
    }
    File::open(path).map_err(failed)
}

/// All bytes of a file of at most [`LONGEST_DOCUMENT`].
///
/// # Errors
/// As [`open`], or a longer file.
pub fn bytes(path: &Path, doing: &str) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    open(path, doing)?
        .take(LONGEST_DOCUMENT + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| Error::io(path, doing, &error))?;
    if bytes.len() as u64 > LONGEST_DOCUMENT {
        let message =
            format!("cannot {doing}: found more than {} MB; expected less", LONGEST_DOCUMENT / 1_000_000);
        return Err(Error::one(path, Problem::of_file(message)));
    }
    Ok(bytes)
}

/// The text of a file, without a byte order mark.
///
/// # Errors
/// As [`bytes()`], or a byte that is not UTF-8, by its line.
pub fn text(path: &Path, doing: &str) -> Result<String, Error> {
    String::from_utf8(bytes(path, doing)?)
        .map(|text| text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
        .map_err(|error| {
            let valid = error.utf8_error().valid_up_to();
            let line = 1 + error.as_bytes().iter().take(valid).filter(|&&byte| byte == b'\n').count();
            let message = "found a byte that is not UTF-8; expected text";
            Error::one(path, Problem::new(Some(line), "", message))
        })
}

fn described(kind: FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return "a FIFO";
        }
        if kind.is_socket() {
            return "a socket";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
    }
    if kind.is_dir() { "a directory" } else { "something else" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_end_or_is_too_long_is_refused_at_once() {
        let directory = tempfile::tempdir().unwrap();
        let refused = |path: &Path| bytes(path, "read the case").unwrap_err().to_string();
        assert!(refused(directory.path()).contains("cannot read the case: found a directory"));
        #[cfg(unix)]
        {
            assert!(refused(Path::new("/dev/zero")).contains("found a device"));
            let pipe = directory.path().join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            assert!(refused(&pipe).contains("found a FIFO"));
        }
        // A file with a hole takes no place.
        let long = directory.path().join("long");
        File::create(&long).unwrap().set_len(LONGEST_DOCUMENT + 1).unwrap();
        assert!(refused(&long).contains("more than 16 MB"), "{}", refused(&long));
    }

    #[test]
    fn text_that_is_none_is_named_by_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        fs::write(&path, b"\xef\xbb\xbfa = 1\nb = \xff\n").unwrap();
        assert_eq!(text(&path, "read").unwrap_err().problems[0].line, Some(2));
        fs::write(&path, b"\xef\xbb\xbfa = 1\n").unwrap();
        assert_eq!(text(&path, "read").unwrap(), "a = 1\n");
    }
}
