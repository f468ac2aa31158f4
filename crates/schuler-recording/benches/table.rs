//! How fast tables are read: megabytes per second of CPU time.
//!
//! `cargo bench -p schuler-recording --bench table`; with the name of one it reads that alone, once, for callgrind.
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;

use cpu_time::ProcessTime;
use schuler_recording::table::open_bytes;

const ROWS: usize = 100_000;
const COLUMNS: usize = 12;
/// Rounds of which the fastest counts: others use the machine.
const ROUNDS: usize = 5;

/// Numbers with as many digits as a double holds, as the simulator writes, or as few as a converter gives.
fn table(digits: Option<usize>) -> Vec<u8> {
    let names: Vec<String> = (0..COLUMNS).map(|column| format!("sensor_{column}")).collect();
    let mut text = names.join(",");
    text.push('\n');
    let mut state = 1u64;
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let value =
                ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 10f64.powf((column / 2) as f64 - 2.0);
            let written = match (column, digits) {
                (0, _) => write!(text, "{row}"),
                (_, Some(digits)) => write!(text, ",{value:.digits$}"),
                (_, None) => write!(text, ",{value:?}"),
            };
            written.expect("a string takes everything");
        }
        text.push('\n');
    }
    text.into_bytes()
}

#[inline(never)]
fn measured_read(bytes: Vec<u8>) -> f64 {
    let start = ProcessTime::now();
    let table = open_bytes(Path::new("table.csv"), bytes).expect("the table is sound");
    let wanted: Vec<usize> = (0..COLUMNS).collect();
    black_box(table.read(&wanted).expect("the table is sound"));
    start.elapsed().as_secs_f64()
}

fn main() {
    let wanted: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let rounds = if wanted.is_empty() { ROUNDS } else { 1 };
    for (name, digits) in [("doubles", None), ("converter", Some(4))] {
        if wanted.is_empty() || wanted.iter().any(|other| other == name) {
            let bytes = table(digits);
            let best = (0..rounds).map(|_| measured_read(bytes.clone())).fold(f64::INFINITY, f64::min);
            let megabytes = bytes.len() as f64 / 1e6;
            println!(
                "{name:<12} {megabytes:.1} MB {:>8.1} MB/s {:.1} ns/cell",
                megabytes / best,
                1e9 * best / (ROWS * COLUMNS) as f64
            );
        }
    }
}
