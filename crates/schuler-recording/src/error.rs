//! What is wrong with a file, and where: the file, the line, the field, and what was expected there.
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

/// A file that cannot be used, with every problem found in it.
///
/// `{}` prints one line with the first problem, `{:#}` one line for each of them.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Error {
    /// The file.
    pub file: PathBuf,
    /// The problems in the order of their lines; never empty.
    pub problems: Vec<Problem>,
}

/// One problem of a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// Line in the file, from 1; `None` when the whole file is meant.
    pub line: Option<usize>,
    /// Path of the field (`sensor[2].unit`) or name of the column; empty when the whole file is meant.
    pub field: String,
    /// What was found and what was expected.
    pub message: String,
}

impl Problem {
    /// A problem of one field.
    pub fn new(line: Option<usize>, field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { line, field: field.into(), message: message.into() }
    }

    /// A problem of the whole file.
    pub fn of_file(message: impl Into<String>) -> Self {
        Self::new(None, "", message)
    }
}

impl Error {
    /// The error of `file` with the given problems, put in the order of their lines.
    pub fn new(file: impl Into<PathBuf>, mut problems: Vec<Problem>) -> Self {
        problems.sort();
        problems.dedup();
        if problems.is_empty() {
            problems.push(Problem::of_file("cannot be used"));
        }
        Self { file: file.into(), problems }
    }

    /// The error of `file` with one problem.
    pub fn one(file: impl Into<PathBuf>, problem: Problem) -> Self {
        Self::new(file, vec![problem])
    }

    /// A failure of the operating system on `file`; `doing` completes "cannot …".
    pub fn io(file: &Path, doing: &str, error: &std::io::Error) -> Self {
        Self::one(file, Problem::of_file(format!("cannot {doing}: {error}")))
    }

    fn write_problem(&self, f: &mut fmt::Formatter<'_>, problem: &Problem) -> fmt::Result {
        let one_line = |text: &str| plain(text).replace('\n', "\\n");
        write!(f, "{}", one_line(&self.file.display().to_string()))?;
        if let Some(line) = problem.line {
            write!(f, ":{line}")?;
        }
        if !problem.field.is_empty() {
            write!(f, ": {}", one_line(&problem.field))?;
        }
        write!(f, ": {}", one_line(&problem.message))
    }
}

/// The text without characters that a terminal takes for commands or that turn the direction of writing: each is written as its
/// number, `\u{1b}`. Line feeds and tabs stay.
pub fn plain(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let escaped = |plain: String, c: char| {
        if is_control(c) {
            plain + &c.escape_unicode().to_string()
        } else {
            plain + c.encode_utf8(&mut [0; 4])
        }
    };
    Cow::Owned(text.chars().fold(String::with_capacity(text.len()), escaped))
}

/// Whether a character commands a terminal or turns the direction of writing, line feeds and tabs excepted.
pub fn is_control(c: char) -> bool {
    let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() && !matches!(c, '\n' | '\t') || turns || matches!(c, '\u{2028}' | '\u{2029}')
}

impl fmt::Display for Error {
    /// Without control characters, whatever the file holds or is called.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut problems = self.problems.iter();
        if let Some(first) = problems.next() {
            self.write_problem(f, first)?;
        }
        if f.alternate() {
            for problem in problems {
                f.write_str("\n")?;
                self.write_problem(f, problem)?;
            }
        } else if problems.len() > 0 {
            write!(f, " (and {} more)", problems.len())?;
        }
        Ok(())
    }
}

/// A number as messages tell it: rounded to six significant digits, without the noise of the last bits.
///
/// ```
/// assert_eq!(schuler_recording::error::rounded(0.004000000000000036), 0.004);
/// assert_eq!(schuler_recording::error::rounded(66.0), 66.0);
/// ```
pub fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_written_as_numbers() {
        assert_eq!(plain("gyro_ä\t陀螺\n"), "gyro_ä\t陀螺\n");
        assert_eq!(
            plain("\u{1b}[31m\u{9b}\u{7}\r\u{202e}\0"),
            "\\u{1b}[31m\\u{9b}\\u{7}\\u{d}\\u{202e}\\u{0}"
        );
        let error = Error::one("\u{1b}]0;a\n.toml", Problem::new(Some(1), "\u{1b}[2J", "found \u{7}"));
        assert_eq!(error.to_string(), "\\u{1b}]0;a\\n.toml:1: \\u{1b}[2J: found \\u{7}");
    }

    #[test]
    fn one_line_names_file_line_field_and_expectation() {
        let error = Error::new(
            "a.toml",
            vec![
                Problem::new(Some(7), "site.latitude_deg", "found 91; expected -90 to 90"),
                Problem::new(Some(3), "sensor[0].unit", "missing; expected a unit"),
            ],
        );
        assert_eq!(error.to_string(), "a.toml:3: sensor[0].unit: missing; expected a unit (and 1 more)");
        assert_eq!(format!("{error:#}").lines().count(), 2);
    }
}
