//! What is in memory of a table that is larger than it: chunks when it is copied, the columns asked for when it is read.
use std::alloc::System;
use std::path::Path;

use cap::Cap;
use schuler_recording::Error;
use schuler_recording::table::{self, Format, TableWriter};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

/// What may be in memory beside what is there before.
const MOST: usize = 20 << 20;
const COLUMNS: usize = 10;
const ROWS: usize = 320_000;
/// Rows written at a time.
const CHUNK: usize = 1000;

fn value(row: usize, column: usize) -> f64 {
    match column {
        0 => row as f64 * 0.01,
        _ => ((row * COLUMNS + column) as f64 * 0.618_033_988_749_895).fract() - 0.5,
    }
}

/// Runs with an allocation that exceeds `most` failing, which ends the process.
fn within<T>(most: usize, run: impl FnOnce() -> T) -> T {
    let before = MEMORY.allocated();
    MEMORY.set_limit(before + most).unwrap();
    let done = run();
    MEMORY.set_limit(usize::MAX).unwrap();
    done
}

fn write(path: &Path, format: Format) {
    let names: Vec<String> = (0..COLUMNS).map(|column| format!("c{column}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut writer = TableWriter::create(path, format, &names, &[]).unwrap();
    for first in (0..ROWS).step_by(CHUNK) {
        let columns: Vec<Vec<f64>> = (0..COLUMNS)
            .map(|column| (first..first + CHUNK).map(|row| value(row, column)).collect())
            .collect();
        writer.write(&columns.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
    }
    writer.finish().unwrap();
}

/// As MCAP with messages in JSON, in chunks of a few hundred kilobytes.
fn write_mcap(path: &Path) {
    let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut writer = mcap::Writer::new(file).unwrap();
    let channel = writer.add_channel(0, "t", "json", &std::collections::BTreeMap::new()).unwrap();
    for row in 0..ROWS {
        let fields: Vec<String> =
            (0..COLUMNS).map(|column| format!("\"c{column}\":{:?}", value(row, column))).collect();
        let log_time = 10_000_000 * row as u64;
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: 0,
            log_time,
            publish_time: log_time,
        };
        writer.write_to_known_channel(&header, format!("{{{}}}", fields.join(",")).as_bytes()).unwrap();
    }
    writer.finish().unwrap();
}

/// As ULog, beside a topic of one message in ten rows.
fn write_ulog(path: &Path) {
    use std::io::Write;
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut message = |kind: u8, content: &[u8]| {
        file.write_all(&u16::try_from(content.len()).unwrap().to_le_bytes()).unwrap();
        file.write_all(&[kind]).unwrap();
        file.write_all(content).unwrap();
    };
    message(b'U', b"");
    message(b'F', b"t:uint64_t timestamp;double[9] c;");
    message(b'F', b"slow:uint64_t timestamp;float x;");
    message(b'A', b"\0\x01\0t");
    message(b'A', b"\0\x02\0slow");
    for row in 0..ROWS {
        let time_us = (10_000 * row as u64).to_le_bytes();
        let mut data = [&1_u16.to_le_bytes()[..], &time_us].concat();
        data.extend((1..COLUMNS).flat_map(|column| value(row, column).to_le_bytes()));
        message(b'D', &data);
        if row % 10 == 0 {
            message(b'D', &[&2_u16.to_le_bytes()[..], &time_us, &(row as f32).to_le_bytes()].concat());
        }
    }
    drop(file);
    // The first message, of no content, stands for the header.
    let mut bytes = std::fs::read(path).unwrap();
    bytes.splice(..3, *b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0");
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn tables_larger_than_memory_are_copied_and_columns_read() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    within(MOST, || write(&at("a.csv"), Format::Csv));
    let bytes = std::fs::metadata(at("a.csv")).unwrap().len() as usize;
    assert!(bytes > 3 * MOST - (4 << 20), "{bytes} bytes of text");
    write_mcap(&at("a.mcap"));
    write_ulog(&at("a.ulg"));

    for (from, to) in [
        ("a.csv", "b.parquet"),
        ("b.parquet", "c.csv.gz"),
        ("c.csv.gz", "d.csv"),
        ("a.mcap", "e.parquet"),
        ("a.ulg", "f.csv.gz"),
    ] {
        let table = table::open(&at(from)).unwrap();
        let wanted: Vec<usize> =
            (0..table.names().len()).filter(|&index| !table.names()[index].contains('@')).collect();
        let format = Format::of(&at(to)).unwrap();
        let copied = within(MOST, || {
            let file = std::fs::File::create(at(to)).unwrap();
            table::copy(table, &wanted, table::Span::default(), (file, &at(to)), format, |_| {
                Ok::<(), Error>(())
            })
            .unwrap()
        });
        assert_eq!(copied.rows, ROWS as u64, "{from}");
    }
    assert!(
        std::fs::read(at("a.csv")).unwrap() == std::fs::read(at("d.csv")).unwrap(),
        "the text has changed"
    );

    // Two of ten columns: 8 bytes a value, and as many for the lines; twice that at most as vectors grow.
    let kept = 2 * 3 * 8 * ROWS;
    for from in ["a.csv", "c.csv.gz", "b.parquet"] {
        let columns = within(kept + (4 << 20), || table::open(&at(from)).unwrap().read(&[0, 7]).unwrap());
        assert!(columns.values[1].iter().enumerate().all(|(row, &read)| read == value(row, 7)), "{from}");
    }
}
