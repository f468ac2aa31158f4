//! The example in C, on this machine and on the emulated board: the bytes that it writes are those of the flight module called from
//! Rust, over a flight with everything that can go wrong, a full compensation block and a power cycle in the middle.
use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use object::{Object, ObjectSymbol};
use schuler_c::{
    SCHULER_COMMAND_NONE, SCHULER_COMMAND_READMIT_GYRO, SCHULER_QUALITY_GOOD, SCHULER_QUALITY_MISSING,
    SCHULER_QUALITY_SATURATED, SchulerInput, SchulerOutput, SchulerQuality, SchulerReading,
    SchulerReadingSingle,
};
use schuler_core::module::{Command as Ground, FlightModule, ModuleConfig, Status, StepInput};
use schuler_core::reading::{Quality, Reading};
use schuler_link::{block, configuration};

use flight::{Flight, everything, full_block};

#[path = "../../../tests/tests/common/flight.rs"]
mod flight;

const STEPS: usize = 25000;
/// Where version and content of a block begin, and how long the checksum at its end is (schuler_link::configuration).
const VERSION_AT: usize = 4;
const CONTENT_AT: usize = 8;
const CHECKSUM: usize = 4;

/// Every part on, and the noise identified so early that the filter is retuned within these steps.
fn config() -> ModuleConfig {
    let mut config = everything();
    config.identification.first_s = 1200.0;
    config.identification.interval_s = 600.0;
    config
}

fn quality(quality: Quality) -> SchulerQuality {
    match quality {
        Quality::Missing => SCHULER_QUALITY_MISSING,
        Quality::Good => SCHULER_QUALITY_GOOD,
        Quality::Saturated => SCHULER_QUALITY_SATURATED,
    }
}

fn double(reading: Reading<f64>) -> SchulerReading {
    let Reading { value, age_ms, .. } = reading;
    SchulerReading { value, age_ms, quality: quality(reading.quality), reserved: [0xee; 3] }
}

fn single(reading: Reading<f32>) -> SchulerReadingSingle {
    let Reading { value, age_ms, .. } = reading;
    SchulerReadingSingle { value, age_ms, quality: quality(reading.quality), reserved: [0xee; 3] }
}

fn input(input: &StepInput) -> SchulerInput {
    let (command, command_gyro) = match input.command {
        Ground::None => (SCHULER_COMMAND_NONE, 77),
        Ground::ReadmitGyro(gyro) => (SCHULER_COMMAND_READMIT_GYRO, gyro),
    };
    SchulerInput {
        time_ms: input.time_ms,
        gyros: input.gyros.map(double),
        accelerometers: input.accelerometers.map(double),
        velocity_error: single(input.velocity_error),
        thermometers: input.thermometers.map(single),
        radio_velocity: single(input.radio_velocity),
        inertial_velocity: single(input.inertial_velocity),
        command,
        command_gyro,
        reserved: [0xee; 2],
    }
}

/// A block with something changed in it, and the checksum that fits.
fn sealed(block: &[u8], change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut body = block[..block.len() - CHECKSUM].to_vec();
    change(&mut body);
    let checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&body);
    [body, checksum.to_le_bytes().to_vec()].concat()
}

/// Writes a number over the one that is there, once.
fn replace(block: &mut [u8], there: f32, number: f32) {
    let at: Vec<usize> =
        block.windows(4).enumerate().filter(|(_, it)| **it == there.to_le_bytes()).map(|(k, _)| k).collect();
    assert_eq!(at.len(), 1, "{there} stands at {at:?}");
    block[at[0]..at[0] + 4].copy_from_slice(&number.to_le_bytes());
}

/// A folder with the files that the example reads, and what it must write.
struct Mission {
    folder: tempfile::TempDir,
    expected: Vec<SchulerOutput>,
}

impl Mission {
    fn new() -> Self {
        let inputs: Vec<StepInput> = Flight::new(1).take(STEPS).collect();
        let mut module = Box::new(FlightModule::new());
        module.configure(&config()).unwrap();
        module.load_compensation(&full_block()).unwrap();
        // As one flight: the power cycle must not be seen in what comes out.
        let outputs: Vec<_> = inputs.iter().map(|input| module.step(input)).collect();
        let status = outputs.iter().fold(Status::empty(), |status, output| status | output.status);
        let hardly = Status::COVARIANCE_RESET | Status::NOT_CONFIGURED;
        let missed = Status::all() - status - hardly;
        assert!(missed.is_empty(), "the flight does not lead through {missed:?}");

        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
        write("configuration.bin", &configuration::encode(&config()).unwrap());
        let refused = |name: &str, config: ModuleConfig, value: f32, bad: f32| {
            let block = configuration::encode(&config).unwrap();
            write(name, &sealed(&block, |content| replace(content, value, bad)));
        };
        refused("refused_nan.bin", ModuleConfig { velocity_range: 1234.5, ..config() }, 1234.5, f32::NAN);
        let mut odd = config();
        odd.filter.gravity = 9.876_543;
        refused("refused_range.bin", odd, 9.876_543, -1.0);
        let block = configuration::encode(&config()).unwrap();
        write("newer.bin", &sealed(&block, |block| block[VERSION_AT] += 1));
        write("nonsense.bin", &sealed(&block, |block| block[CONTENT_AT..].fill(0xff)));
        let other = ModuleConfig { velocity_range: 1234.5, ..config() };
        write("other.bin", &configuration::encode(&other).unwrap());
        write("compensation.bin", &block::encode(&full_block()));
        let inputs: Vec<_> = inputs.iter().map(input).collect();
        write("inputs.bin", bytemuck::cast_slice(&inputs));
        Self { folder, expected: outputs.iter().map(SchulerOutput::from).collect() }
    }

    /// Runs a program in the folder and compares what it has written.
    fn fly(&self, program: &mut Command) {
        let outputs = self.folder.path().join("outputs.bin");
        let _ = fs::remove_file(&outputs);
        let said = run(program.current_dir(self.folder.path()));
        assert!(said.contains(&format!("schuler {}: {STEPS} steps", env!("CARGO_PKG_VERSION"))), "{said}");
        let bytes = fs::read(outputs).unwrap();
        assert_eq!(bytes.len(), size_of_val(&*self.expected));
        for (found, expected) in bytes.chunks(size_of::<SchulerOutput>()).zip(&self.expected) {
            assert!(
                found == bytemuck::bytes_of(expected),
                "step {} differs\nRust {expected:?}\nC    {:?}",
                expected.step,
                bytemuck::pod_read_unaligned::<SchulerOutput>(found)
            );
        }
    }
}

/// Runs a program to its good end; what it has said.
fn run(program: &mut Command) -> String {
    let output = program.output().unwrap_or_else(|error| panic!("{program:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{program:?} ends with {}:\n{said}{}",
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    said
}

/// Builds the example; `None`, said aloud, where the compiler for it is not there.
fn make(test: &str, compiler: impl AsRef<OsStr>, program: &str) -> Option<PathBuf> {
    if Command::new(&compiler)
        .arg("--version")
        .output()
        .is_err_and(|error| error.kind() == ErrorKind::NotFound)
    {
        eprintln!("SKIPPED: {test} needs {} (tests/run installs it)", compiler.as_ref().display());
        return None;
    }
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/flight");
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let mut make = Command::new("make");
    make.current_dir(example).arg(format!("TARGET_DIR={}", target.display()));
    make.arg(format!("BUILD={}", env!("CARGO_TARGET_TMPDIR")));
    // Flags for this build have no place in that one.
    for flags in
        ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTC_WRAPPER", "RUSTC_WORKSPACE_WRAPPER", "MAKEFLAGS"]
    {
        make.env_remove(flags);
    }
    let built = Path::new(env!("CARGO_TARGET_TMPDIR")).join(program);
    run(make.arg(&built));
    Some(built)
}

#[test]
fn the_example_gives_the_same_bytes_here() {
    if let Some(program) = make("the_example_gives_the_same_bytes_here", "cc", "flight") {
        Mission::new().fly(&mut Command::new(program));
    }
}

#[test]
fn the_example_gives_the_same_bytes_on_the_target() {
    const NAME: &str = "the_example_gives_the_same_bytes_on_the_target";
    if std::env::var("SCHULER_SKIP_QEMU").is_ok_and(|value| value == "1") {
        eprintln!("SKIPPED: {NAME} needs QEMU, and SCHULER_SKIP_QEMU=1 is set");
        return;
    }
    let Some(program) = make(NAME, "arm-none-eabi-gcc", "flight.elf") else { return };
    cannot_panic(&program);
    let mut qemu = Command::new("qemu-system-arm");
    qemu.args(["-M", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none", "-semihosting"]);
    Mission::new().fly(qemu.arg("-kernel").arg(program));
}

/// As for the flashed image: not one panic is left of Rust's.
fn cannot_panic(program: &Path) {
    let bytes = fs::read(program).unwrap();
    let elf = object::File::parse(&*bytes).unwrap();
    let names: Vec<&str> = elf.symbols().filter_map(|symbol| symbol.name().ok()).collect();
    assert!(names.iter().any(|name| name.contains("schuler_core")), "the program has no symbols to look at");
    let parts = ["panicking", "rust_begin_unwind", "unwrap_failed", "expect_failed"];
    let panics: Vec<&&str> =
        names.iter().filter(|name| parts.iter().any(|part| name.contains(part))).collect();
    assert!(panics.is_empty(), "the program can panic: {panics:#?}");
}
