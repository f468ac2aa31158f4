//! How fast tables are read: bytes per second on one core.
//!
//! `cargo bench -p schuler-recording --bench table` prints the rates; others use the machine, so the fastest of the rounds is what
//! to read. `tests/host_speed` reads each table once with `--test`, under callgrind.
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;

use divan::Bencher;
use divan::counter::BytesCount;
use schuler_recording::table::open_bytes;

const ROWS: usize = 100_000;
const COLUMNS: usize = 12;
const ROUNDS: u32 = 10;

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
fn measured_read(bytes: Vec<u8>) {
    let table = open_bytes(Path::new("table.csv"), bytes).expect("the table is sound");
    let wanted: Vec<usize> = (0..COLUMNS).collect();
    black_box(table.read(&wanted).expect("the table is sound"));
}

fn read(bencher: Bencher<'_, '_>, digits: Option<usize>) {
    let bytes = table(digits);
    bencher
        .counter(BytesCount::of_slice(&bytes))
        .with_inputs(|| bytes.clone())
        .bench_local_values(measured_read);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn doubles(bencher: Bencher<'_, '_>) {
    read(bencher, None);
}

#[divan::bench(sample_count = ROUNDS, sample_size = 1)]
fn converter(bencher: Bencher<'_, '_>) {
    read(bencher, Some(4));
}

fn main() {
    divan::main();
}
