//! The Python in which others' programs check ours.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Python of a virtual environment under `target`, made from `tests/oracle/requirements.txt` the first time.
///
/// # Panics
/// Where the environment cannot be made, with what to install.
pub fn python() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| {
        let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let requirements = project.join("tests/oracle/requirements.txt");
        let wanted = fs::read_to_string(&requirements).expect("tests/oracle/requirements.txt");
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| project.join("target"), PathBuf::from);
        let environment = target.join("oracle-venv");
        let (python, stamp) = (environment.join("bin/python"), environment.join("installed.txt"));
        if fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
            return python;
        }
        let made = Command::new("python3").args(["-m", "venv", "--clear"]).arg(&environment).output();
        assert!(
            made.as_ref().is_ok_and(|output| output.status.success()),
            "cannot make a virtual environment: install Python 3.10 or newer with venv (Debian: apt-get install python3 python3-venv)"
        );
        let installed = Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--no-deps", "--requirement"])
            .arg(&requirements)
            .output()
            .expect("the environment's Python runs");
        assert!(
            installed.status.success(),
            "cannot install tests/oracle/requirements.txt from PyPI into {}: {}",
            environment.display(),
            last_line(&installed)
        );
        fs::write(&stamp, wanted).expect("the environment is writable");
        python
    })
}

/// The last thing that a program complained of.
fn last_line(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default().to_owned()
}
