//! Who looks for the effects: anything that takes a case and answers in the form `schuler-explanation/2`.
//!
//! The standard one is this command's own `explain`, run as a user runs it; another program can be given by its command line, so
//! that any tool that writes the same answer can be judged.
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use super::processor;

/// Takes the path of a case and gives the answer.
pub type Explainer<'e> = dyn Fn(&Path) -> Result<Value> + Sync + 'e;

/// Where the path of the case stands in a command line.
const PLACE: &str = "{case}";
/// Exit status of an explainer that its user has stopped.
const STOPPED: i32 = 130;
/// How often an explainer with a limit is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// The standard explainer: `schuler explain CASE --json --quiet` of the command at `program`.
pub fn standard(program: PathBuf) -> Box<Explainer<'static>> {
    Box::new(move |case| {
        answer_of(Command::new(&program).arg("explain").arg(case).args(["--json", "--quiet"]))
    })
}

/// The same, ended where a case takes more than so many seconds of the processor.
pub fn limited(program: PathBuf, limit_s: f64) -> Box<Explainer<'static>> {
    Box::new(move |case| {
        let mut command = Command::new(&program);
        command.args(["explain", "--json", "--quiet"]).arg(case);
        answer_within(&mut command, limit_s)
    })
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

/// The same, of a program that is ended at a limit of processor time. It writes to files, so that a
/// long answer does not make it wait.
fn answer_within(command: &mut Command, limit_s: f64) -> Result<Value> {
    let (mut said, mut complained) = (tempfile::tempfile()?, tempfile::tempfile()?);
    command.stdin(Stdio::null()).stdout(said.try_clone()?).stderr(complained.try_clone()?);
    let status = wait_within(command, limit_s)?;
    if status.code() == Some(STOPPED) {
        bail!("stopped");
    }
    if !status.success() {
        complained.rewind()?;
        let mut text = Vec::new();
        complained.read_to_end(&mut text)?;
        bail!("{status}: {}", String::from_utf8_lossy(&text).lines().last().unwrap_or_default());
    }
    said.rewind()?;
    serde_json::from_reader(std::io::BufReader::new(said)).context("the answer is not JSON")
}

fn wait_within(command: &mut Command, limit_s: f64) -> Result<ExitStatus> {
    let start = Instant::now();
    let mut child = command.spawn().context("cannot be started")?;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        let taken_s = processor::running(child.id()).unwrap_or_else(|| start.elapsed().as_secs_f64());
        if taken_s > limit_s {
            child.kill()?;
            child.wait()?;
            bail!("ended after {limit_s} s of the processor");
        }
        std::thread::sleep(LOOK);
    }
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

    #[test]
    fn a_program_without_end_is_ended() {
        let mut busy = Command::new("sh");
        busy.args(["-c", "while :; do :; done"]);
        let error = answer_within(&mut busy, 0.2).unwrap_err();
        assert!(format!("{error:#}").contains("ended after 0.2 s"), "{error:#}");
        let mut answering = Command::new("echo");
        assert_eq!(answer_within(answering.arg("{\"a\": 1}"), 10.0).unwrap()["a"], 1);
    }
}
