//! Case files.
use std::path::Path;

use schuler_recording::CaseFile;

/// A case file: an error, or a case that can be written and reads back to the same.
pub fn case(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let path = Path::new("case.toml");
    match CaseFile::parse(path, text) {
        Ok(file) => {
            let written = file.case.to_toml().expect("a case that was read can be written");
            let back = CaseFile::parse(path, &written).unwrap_or_else(|error| panic!("{error:#}\n{written}"));
            assert_eq!(back.case, file.case, "{written}");
        }
        Err(error) => {
            let lines = text.bytes().filter(|&byte| byte == b'\n').count() + 1;
            assert!(!error.problems.is_empty());
            assert!(
                error
                    .problems
                    .iter()
                    .all(|problem| problem.line.is_none_or(|line| (1..=lines).contains(&line)))
            );
            assert_eq!(error.to_string().lines().count(), 1, "one line: {error}");
        }
    }
}
