//! Instructions and stack of every part of the step on the emulated Cortex-M4F: exact against a golden file, and against
//! bars.
//!
//! `SCHULER_REWRITE_GOLDEN=1 cargo test -p schuler-tests firmware_counts::` takes the counts anew. They hold for one
//! compiler; with another the bars are still checked, and the test says that the golden file was not.
use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

use host_sim::emulator::Image;

use crate::common;

/// The counts take a minute on a machine that has nothing else to do.
const PATIENCE: Duration = Duration::from_mins(10);

const GOLDEN: &str = "instruction_counts.txt";

/// One part.
struct Row {
    name: String,
    least: u32,
    median: u32,
    most: u32,
    /// Bytes.
    stack: u32,
}

impl Row {
    /// `name|least|median|most|stack`.
    fn parse(line: &str) -> Option<Self> {
        let mut fields = line.split('|');
        let name = fields.next()?.to_owned();
        let mut number = || fields.next()?.parse().ok();
        Some(Self { name, least: number()?, median: number()?, most: number()?, stack: number()? })
    }

    /// (most − least)/median.
    fn variation(&self) -> f64 {
        f64::from(self.most - self.least) / f64::from(self.median.max(1))
    }
}

/// 0.2 % of a second at 168 MHz: what the whole step may take.
const SHARE_OF_A_SECOND: u32 = 168_000_000 / 500;

/// By how much a part may vary with its data, %: in single precision, and where there is double precision in it.
const VARIATION_BARS: [f64; 2] = [1.0, 5.0];

/// What a part may take at most, a bar; and a variation that it has not had, %: a guard against steps whose work depends on
/// their data, and no bar. Where [`VARIATION_BARS`] are missed the test says so, and `docs/flight-budget.md` says why.
const LIMITS: [(&str, u32, f64); 24] = [
    ("add, f64", 102, 0.0),
    ("multiply, f64", 91, 0.0),
    ("divide, f64", 162, 0.0),
    ("compare, f64", 53, 0.0),
    ("filter kernel, f32", 400, 1.0),
    ("filter step, f32", 400, 1.0),
    ("filter output, f32", 400, 1.0),
    ("coloured filter step, f32", 1600, 1.0),
    ("filter kernel, f64", 18_000, 1.0),
    ("filter step, f64", 18_000, 1.0),
    ("five determinants, f32", 142, 1.0),
    ("parity, f32", 142, 1.0),
    ("five determinants, f64", 15_000, 1.0),
    ("isolation step, f64", 31_000, 2.0),
    ("temperature rate, f32", 12_000, 1.0),
    ("health monitor, f32", 18_000, 1.0),
    ("thermal correction: at a temperature, f32", 1000, 1.0),
    ("thermal correction: rates and forces, f64", 4200, 1.0),
    ("configuration", 600_000, 1.0),
    ("module step, no identification", SHARE_OF_A_SECOND, 1.0),
    ("module step, published loop", SHARE_OF_A_SECOND, 3.0),
    ("module step", SHARE_OF_A_SECOND, 3.0),
    ("module step, clocks that jump", SHARE_OF_A_SECOND, 3.0),
    // Among the frames is one configuration, which takes the most.
    ("main loop: a frame with a step, its answer", 600_000, 100.0),
];

#[test]
fn the_instructions_of_every_part_are_as_they_were() {
    if common::skipped("the_instructions_of_every_part_are_as_they_were") {
        return;
    }
    let rows = count();
    let compiler = compiler();
    let table = table(&rows, &compiler);
    say!("{table}");

    let row =
        |name: &str| rows.iter().find(|row| row.name == name).unwrap_or_else(|| panic!("no count of {name}"));
    for (name, most, guard) in LIMITS {
        let row = row(name);
        assert!(row.most <= most, "{name} takes {} instructions, more than {most}", row.most);
        let percent = 100.0 * row.variation();
        assert!(percent <= guard, "{name} varies by {percent:.1} %, more than it did ({guard} %)");
        let [single, double] = VARIATION_BARS;
        let bar = if name.ends_with("f32") { single } else { double };
        if percent > bar {
            say!("BAR MISSED: {name} varies by {percent:.1} %, the bar is {bar} %");
        }
    }
    // Against what others make of the same filter.
    for precision in ["f32", "f64"] {
        let ours = row(&format!("filter kernel, {precision}"));
        for other in ["minikalman", "Joseph form by nalgebra"] {
            let other = row(&format!("{other}, {precision}"));
            assert!(
                2 * ours.median < other.median,
                "{}: {} against {}",
                other.name,
                ours.median,
                other.median
            );
        }
    }

    let golden = common::golden(GOLDEN);
    let taken_with = golden.lines().find_map(|line| line.strip_prefix("# rustc ")).unwrap_or_default();
    let rewrite = common::rewrite_golden();
    if !rewrite && taken_with != compiler {
        say!(
            "NOT COMPARED: {GOLDEN} was taken with rustc {taken_with}, this is rustc {compiler}. Only the bars were checked. \
             SCHULER_REWRITE_GOLDEN=1 takes the counts anew."
        );
        return;
    }
    common::assert_golden(GOLDEN, &table);
}

/// Builds the image and runs it.
fn count() -> Vec<Row> {
    let mut emulator = common::launch(Image::Count, &["-icount", "shift=10,sleep=off"]);
    let deadline = Instant::now() + PATIENCE;
    let mut text = String::new();
    while !text.ends_with("end\n") {
        match emulator.next_bytes(deadline.saturating_duration_since(Instant::now())).unwrap() {
            Some(bytes) => text.push_str(&String::from_utf8(bytes).unwrap()),
            None => panic!("the emulator has counted no further than {text}"),
        }
    }
    let lines = text.lines().filter(|line| *line != "end");
    lines.map(|line| Row::parse(line).unwrap_or_else(|| panic!("not a count: {line}"))).collect()
}

/// Version of the compiler, as `rustc --version` has it.
fn compiler() -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("--version").output().expect("rustc runs");
    let text = String::from_utf8(output.stdout).unwrap();
    text.trim().trim_start_matches("rustc ").to_owned()
}

fn table(rows: &[Row], compiler: &str) -> String {
    let mut text = format!(
        "# rustc {compiler}\n# Instructions on the emulated Cortex-M4F over inputs with faults, gaps and nonsense; stack in bytes,\n\
         # without the frame of the one that calls.\n"
    );
    let _ = writeln!(
        text,
        "{:<46}{:>9}{:>9}{:>9}{:>9}{:>7}",
        "# part", "least", "median", "most", "varies", "stack"
    );
    for row in rows {
        let Row { name, least, median, most, stack } = row;
        let percent = 100.0 * row.variation();
        let _ = writeln!(text, "{name:<46}{least:>9}{median:>9}{most:>9}{percent:>7.1} %{stack:>7}");
    }
    text
}
