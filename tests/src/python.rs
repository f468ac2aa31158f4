//! The Python in which others' programs check ours, and in which our package is tried.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The project.
pub fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Python of a virtual environment under `target`, made from `tests/oracle/requirements.txt` the first time.
///
/// # Panics
/// Where the environment cannot be made, with what to install.
pub fn python() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| environment("oracle-venv", "tests/oracle/requirements.txt"))
}

/// Python of the virtual environment `name` under `target`, made from the project's file `requirements` the first time.
///
/// # Panics
/// Where the environment cannot be made, with what to install.
pub fn environment(name: &str, requirements: &str) -> PathBuf {
    let wanted = fs::read_to_string(project().join(requirements))
        .unwrap_or_else(|error| panic!("{requirements}: {error}"));
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| project().join("target"), PathBuf::from);
    let environment = target.join(name);
    let (python, stamp) = (environment.join("bin/python"), environment.join("installed.txt"));
    if fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
        return python;
    }
    let made = Command::new("python3").args(["-m", "venv", "--clear"]).arg(&environment).output();
    assert!(
        made.as_ref().is_ok_and(|output| output.status.success()),
        "cannot make a virtual environment: install Python 3.11 or newer with venv (Debian: apt-get install python3 python3-venv)"
    );
    install(&python, requirements).unwrap_or_else(|error| panic!("{error}"));
    fs::write(&stamp, wanted).expect("the environment is writable");
    python
}

/// Installs the project's file `requirements` into the environment of `python`.
///
/// # Errors
/// What pip complained of last.
///
/// # Panics
/// Where `python` cannot be run.
pub fn install(python: &Path, requirements: &str) -> Result<(), String> {
    let installed = Command::new(python)
        .args(["-m", "pip", "install", "--quiet", "--no-deps", "--requirement"])
        .arg(project().join(requirements))
        .output()
        .expect("the environment's Python runs");
    if installed.status.success() {
        Ok(())
    } else {
        Err(format!("cannot install {requirements} from PyPI: {}", last_line(&installed)))
    }
}

/// The last thing that a program complained of.
fn last_line(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default().to_owned()
}
