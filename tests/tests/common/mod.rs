//! What the tests on the emulated target share.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use defmt_decoder::{DecodeError, Table};
use host_sim::emulator::{Emulator, Image, TargetError, Transport, build};

pub(crate) mod flight;

/// Prints past the capture of the test harness: measured speeds and skipped tests are to be seen.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

/// Said instead of a test that needs the emulator, when the environment asks for that.
pub(crate) fn skipped(test: &str) -> bool {
    let skip = std::env::var("SCHULER_SKIP_QEMU").is_ok_and(|value| value == "1");
    if skip {
        say!("SKIPPED: {test} needs QEMU, and SCHULER_SKIP_QEMU=1 is set");
    }
    skip
}

/// The module on the emulated target; ends the test with one line where that cannot be.
pub(crate) fn start(transport: Transport) -> Emulator {
    or_explain(Emulator::start(transport))
}

/// An image of the firmware on the emulated target.
pub(crate) fn start_image(image: Image) -> Emulator {
    or_explain(build(image).and_then(|elf| Emulator::start_image(image, &elf)))
}

/// An image that has not spoken yet, under QEMU with further options.
pub(crate) fn launch(image: Image, options: &[&str]) -> Emulator {
    or_explain(build(image).and_then(|elf| Emulator::launch(image, &elf, options)))
}

fn or_explain<T>(result: Result<T, TargetError>) -> T {
    result.unwrap_or_else(|error| panic!("{error} (SCHULER_SKIP_QEMU=1 leaves the tests on the target out)"))
}

/// What the target has logged so far: level and text, a line each.
pub(crate) fn log(emulator: &Emulator) -> Vec<String> {
    decode(&emulator.log().unwrap(), emulator.image())
}

/// Waits until the log has a line: the answers of the module overtake it.
pub(crate) fn wait_for_log(emulator: &Emulator, wanted: impl Fn(&[String]) -> bool) -> Vec<String> {
    let deadline = Instant::now() + Duration::from_secs(30);
    loop {
        let log = log(emulator);
        if wanted(&log) {
            return log;
        }
        assert!(Instant::now() < deadline, "the log says only {log:?}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Decodes a log with the texts that the image holds.
pub(crate) fn decode(bytes: &[u8], image: &Path) -> Vec<String> {
    let table = Table::parse(&fs::read(image).unwrap()).unwrap().expect("the image has no defmt section");
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("", |level| level.as_str());
                lines.push(format!("{level} {}", frame.display_message()));
            }
            Err(DecodeError::UnexpectedEof) => return lines,
            Err(DecodeError::Malformed) => lines.push("MALFORMED".to_owned()),
        }
    }
}

/// A file in `golden`; empty where it is not there.
pub(crate) fn golden(name: &str) -> String {
    fs::read_to_string(golden_path(name)).unwrap_or_default()
}

/// Golden files are to be written anew.
pub(crate) fn rewrite_golden() -> bool {
    std::env::var("SCHULER_REWRITE_GOLDEN").is_ok_and(|value| value == "1")
}

/// Compares with a file in `golden`; `SCHULER_REWRITE_GOLDEN=1` writes it anew.
pub(crate) fn assert_golden(name: &str, text: &str) {
    let path = golden_path(name);
    if rewrite_golden() {
        fs::write(&path, text).unwrap();
    }
    assert_eq!(text, golden(name), "differs from {}; SCHULER_REWRITE_GOLDEN=1 rewrites it", path.display());
}

fn golden_path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden").join(name)
}
