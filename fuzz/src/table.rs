//! Tables.
use std::path::Path;

use schuler_recording::table::{Columns, TableReader, open_bytes};

use crate::seeds;

/// Columns that are read: an exploding header must not be multiplied.
const WANTED: usize = 8;

/// Rows that are read of a Parquet file. More of them are no fault: a run of one value is as short for 2³¹ rows as for two.
const MOST_ROWS: usize = 1 << 18;

/// CSV and gzipped CSV, told apart as for a file.
pub fn text(data: &[u8]) {
    check(data);
}

/// A Parquet file.
pub fn parquet(data: &[u8]) {
    let Some((table, wanted)) = opened(data) else { return };
    let Ok(chunks) = table.chunks(&wanted) else { return };
    let mut rows = 0;
    for chunk in chunks {
        match chunk {
            Ok(columns) => {
                columns_agree(&columns, wanted.len());
                rows += columns.rows();
            }
            Err(error) => return assert!(!error.problems.is_empty()),
        }
        if rows >= MOST_ROWS {
            return;
        }
    }
}

/// A ULog file.
pub fn ulog(data: &[u8]) {
    check(data);
    topics_alone(data);
}

/// An MCAP file; or behind a byte that is not the first of one, the messages of one of its kinds, their definition before
/// them.
pub fn mcap(data: &[u8]) {
    let whole = match data.split_first() {
        Some((&kind, content)) if kind != ::mcap::MAGIC[0] => match seeds::mcap_of(kind, content) {
            Ok(whole) => whole,
            Err(_) => return,
        },
        _ => data.to_vec(),
    };
    check(&whole);
    topics_alone(&whole);
}

/// The first column of each topic is the same whatever stands beside it.
fn topics_alone(data: &[u8]) {
    let Some((table, all)) = opened(data) else { return };
    let Ok(together) = table.read(&all) else { return };
    let (again, _) = opened(data).expect("it was opened before");
    let alone = again.read(&[0]).expect("it was read before");
    assert_eq!(alone.lines, together.lines);
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(alone.values.first().map(|it| bits(it)), together.values.first().map(|it| bits(it)));
}

/// The table, which has columns, and those of them that are read; none, if it cannot be opened.
fn opened(data: &[u8]) -> Option<(Box<dyn TableReader>, Vec<usize>)> {
    let table = open_bytes(Path::new("table"), data.to_vec()).ok()?;
    assert!(!table.names().is_empty());
    let wanted = (0..table.names().len().min(WANTED)).collect();
    Some((table, wanted))
}

fn check(data: &[u8]) {
    let Some((table, wanted)) = opened(data) else { return };
    match table.read(&wanted) {
        Ok(columns) => columns_agree(&columns, wanted.len()),
        Err(error) => assert!(!error.problems.is_empty()),
    }
}

fn columns_agree(columns: &Columns, wanted: usize) {
    assert_eq!((columns.values.len(), columns.infinite.len()), (wanted, wanted));
    for (values, &infinite) in columns.values.iter().zip(&columns.infinite) {
        assert_eq!(values.len(), columns.lines.len());
        assert!(values.iter().all(|value| !value.is_infinite()));
        assert!(infinite <= values.iter().filter(|value| value.is_nan()).count());
    }
    assert!(columns.lines.is_sorted());
}

/// Panics of the decoders of others are caught by the reader and are no finds: they are not to end the fuzzer.
pub fn expect_panics_of_the_decoder() {
    std::panic::set_hook(Box::new(|info| {
        let decoders = ["/parquet-", "/mcap-", "/prost-"];
        if info.location().is_none_or(|place| !decoders.iter().any(|decoder| place.file().contains(decoder)))
        {
            eprintln!("{info}");
        }
    }));
}
