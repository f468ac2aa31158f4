//! Tables.
use std::path::Path;

use schuler_recording::table::{Columns, open_bytes};

/// Columns that are read: an exploding header must not be multiplied.
const WANTED: usize = 8;

/// CSV and gzipped CSV, told apart as for a file.
pub fn text(data: &[u8]) {
    check(data);
}

/// A Parquet file.
pub fn parquet(data: &[u8]) {
    check(data);
}

fn check(data: &[u8]) {
    let Ok(table) = open_bytes(Path::new("table"), data.to_vec()) else { return };
    assert!(!table.names().is_empty());
    let wanted: Vec<usize> = (0..table.names().len().min(WANTED)).collect();
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

/// Panics of the Parquet decoder are caught by the reader and are no finds: they are not to end the fuzzer.
pub fn expect_panics_of_the_decoder() {
    std::panic::set_hook(Box::new(|info| {
        if info.location().is_none_or(|place| !place.file().contains("/parquet-")) {
            eprintln!("{info}");
        }
    }));
}
