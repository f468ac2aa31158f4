//! Builds the firmware's images.
use std::env;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use schuler_link::message::{Board, Identity, Start, Transport};

use super::TargetError;

/// Triple of the Cortex-M4F.
const TRIPLE: &str = "thumbv7em-none-eabihf";

/// An image of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// The emulated board on its serial line.
    Serial,
    /// The emulated board on semihosting.
    Semihosting,
    /// What is flashed, on an emulated STM32F405.
    Flashed,
    /// Provokes faults; does not speak the protocol.
    Provoke,
    /// Computes in double precision; speaks bytes of its own.
    Double,
    /// Counts instructions and stack; speaks text, and needs an emulator that counts.
    Count,
}

impl Image {
    /// QEMU's name of the machine.
    pub(super) fn machine(self) -> &'static str {
        match self {
            Image::Flashed => "netduinoplus2",
            _ => "mps2-an386",
        }
    }

    /// What its banner will say.
    pub(super) fn identity(self) -> Identity {
        let board = if self == Image::Flashed { Board::Stm32f405 } else { Board::Mps2An386 };
        let transport = if self.has_semihosting() { Transport::Semihosting } else { Transport::Uart };
        Identity { board, transport, start: Start::PowerOn, boots: 0 }
    }

    /// It speaks through the emulator, not through the serial line.
    pub(super) fn has_semihosting(self) -> bool {
        matches!(self, Image::Semihosting | Image::Double | Image::Count)
    }

    fn features(self) -> &'static str {
        match self {
            Image::Serial => "mps2-an386",
            Image::Semihosting => "mps2-an386,semihosting",
            Image::Flashed => "stm32f405",
            Image::Provoke => "mps2-an386,provoke",
            Image::Double => "mps2-an386,double",
            Image::Count => "mps2-an386,count",
        }
    }

    fn binary(self) -> &'static str {
        match self {
            Image::Provoke => "provoke",
            Image::Double => "double",
            Image::Count => "count",
            _ => "firmware",
        }
    }

    fn file_name(self) -> &'static str {
        match self {
            Image::Serial => "mps2-an386.elf",
            Image::Semihosting => "mps2-an386-semihosting.elf",
            Image::Flashed => "stm32f405.elf",
            Image::Provoke => "provoke.elf",
            Image::Double => "double.elf",
            Image::Count => "count.elf",
        }
    }
}

/// Builds an image from the sources that this program was built from, and returns its path. What is up to date is not
/// built again; calls from several processes wait for each other.
///
/// # Errors
/// The sources or the compiler are not there, or the build fails.
pub fn build(image: Image) -> Result<PathBuf, TargetError> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."));
    if !root.join("firmware/Cargo.toml").is_file() {
        return Err(failed(format!("its sources are not in {} any more", root.display())));
    }
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |path| root.join(path));
    let images = target.join("firmware");
    fs::create_dir_all(&images).map_err(failed)?;
    let lock = File::create(images.join(".lock")).map_err(failed)?;
    lock.lock().map_err(failed)?;

    add_target(root)?;
    let built = cargo_build(root, &target, image)?;
    let copy = images.join(image.file_name());
    // All images have the same name where cargo puts them; the copy appears at once, as another process may be reading it.
    let part = images.join(format!("{}.part", image.file_name()));
    fs::copy(&built, &part).and_then(|_| fs::rename(&part, &copy)).map_err(failed)?;
    Ok(copy)
}

/// Adds the compiler's libraries for the target where they are missing.
fn add_target(root: &Path) -> Result<(), TargetError> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc)
        .current_dir(root)
        .args(["--print", "target-libdir", "--target", TRIPLE])
        .output()
        .map_err(|error| missing("rustc", "https://rustup.rs", error))?;
    if Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir() {
        return Ok(());
    }
    let status = Command::new("rustup")
        .current_dir(root)
        .args(["target", "add", TRIPLE])
        .stdout(Stdio::null())
        .status()
        .map_err(|error| {
            missing("rustup", "https://rustup.rs, or add the Rust target by other means", error)
        })?;
    if status.success() {
        Ok(())
    } else {
        Err(failed(format!("the Rust target is missing: rustup target add {TRIPLE}")))
    }
}

/// Builds, and returns the path of the executable.
fn cargo_build(root: &Path, target: &Path, image: Image) -> Result<PathBuf, TargetError> {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.current_dir(root);
    command.args(["build", "--package", "firmware", "--profile", "flight", "--target", TRIPLE]);
    command.args(["--features", image.features(), "--bin", image.binary()]);
    command.args(["--message-format", "json-render-diagnostics"]).arg("--target-dir").arg(target);
    if image == Image::Count {
        // The parts that it counts by themselves are compiled with it, where otherwise they are with the core.
        command.args(["--config", "profile.flight.package.firmware.opt-level=2"]);
    }
    // Flags for the host's build (coverage, sanitizers) have no place on the target.
    for flags in [
        "RUSTFLAGS",
        "CARGO_ENCODED_RUSTFLAGS",
        "CARGO_BUILD_RUSTFLAGS",
        "RUSTC_WRAPPER",
        "RUSTC_WORKSPACE_WRAPPER",
        // Incremental builds cut the crates into units, and the image is another.
        "CARGO_INCREMENTAL",
    ] {
        command.env_remove(flags);
    }
    let output = command.output().map_err(|error| missing("cargo", "https://rustup.rs", error))?;
    if !output.status.success() {
        return Err(failed(String::from_utf8_lossy(&output.stderr)));
    }
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter(|message| message["target"]["name"] == image.binary())
        .find_map(|message| message["executable"].as_str().map(PathBuf::from))
        .ok_or_else(|| failed("cargo names no executable"))
}

fn missing(program: &str, advice: &'static str, error: io::Error) -> TargetError {
    match error.kind() {
        io::ErrorKind::NotFound => TargetError::MissingTool { program: program.to_owned(), advice },
        _ => failed(error),
    }
}

#[allow(clippy::needless_pass_by_value)] // Errors are handed over.
fn failed(what: impl ToString) -> TargetError {
    TargetError::Build(what.to_string())
}
