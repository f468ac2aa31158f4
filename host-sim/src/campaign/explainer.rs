//! Who looks for the effects: anything that takes a case and answers in the form `schuler-explanation/1`.
//!
//! The standard one is this command's own `explain`, run as a user runs it; another program can be given by its command line, so
//! that any tool that writes the same answer can be judged.
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use serde_json::Value;

/// Takes the path of a case and gives the answer.
pub type Explainer<'e> = dyn Fn(&Path) -> Result<Value> + Sync + 'e;

/// Where the path of the case stands in a command line.
const PLACE: &str = "{case}";
/// Exit status of an explainer that its user has stopped.
const STOPPED: i32 = 130;

/// The standard explainer: `schuler explain CASE --json --quiet` of this very program.
///
/// # Errors
/// The program does not know where it lies.
pub fn standard() -> Result<Box<Explainer<'static>>> {
    let program = std::env::current_exe().context("cannot find this program")?;
    Ok(Box::new(move |case| {
        answer_of(Command::new(&program).arg("explain").arg(case).args(["--json", "--quiet"]))
    }))
}

/// Another program, by its command line: words separated by blanks; `{case}` stands for the path, which comes last where there is none.
///
/// # Errors
/// An empty command line.
pub fn external(line: &str) -> Result<Box<Explainer<'static>>> {
    let mut words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
    if words.is_empty() {
        bail!("found an empty command line; expected a program that explains a case");
    }
    if !words.iter().any(|word| word.contains(PLACE)) {
        words.push(PLACE.to_owned());
    }
    Ok(Box::new(move |case| {
        let mut words = words.iter().map(|word| word.replace(PLACE, &case.to_string_lossy()));
        let mut command = Command::new(words.next().unwrap_or_default());
        answer_of(command.args(words))
    }))
}

fn answer_of(command: &mut Command) -> Result<Value> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output =
        command.stdin(Stdio::null()).output().with_context(|| format!("{name}: cannot be started"))?;
    if output.status.code() == Some(STOPPED) {
        bail!("{name}: stopped");
    }
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        bail!("{name}: {}: {}", output.status, said.lines().last().unwrap_or_default());
    }
    serde_json::from_slice(&output.stdout).with_context(|| format!("{name}: the answer is not JSON"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_program_is_asked_with_the_case() {
        let explainer = external("cat {case}").unwrap();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("case");
        std::fs::write(&path, "{\"verdict\": \"no_mismatch\"}").unwrap();
        assert_eq!(explainer(&path).unwrap()["verdict"], "no_mismatch");
        std::fs::write(&path, "no json").unwrap();
        assert!(format!("{:#}", explainer(&path).unwrap_err()).contains("not JSON"));
        assert!(external("false").unwrap()(&path).is_err());
        assert!(external("no-such-program-here").unwrap()(&path).is_err());
        assert!(external(" ").is_err());
    }
}
