//! How fast a table is read: `cargo run --release -p schuler-recording --example read_speed [megabytes]`.
use std::time::Instant;

use schuler_recording::table;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let megabytes: usize = std::env::args().nth(1).map_or(Ok(200), |argument| argument.parse())?;
    let rows = megabytes * 1_000_000 / (10 * 20);
    let values: Vec<f64> = (0..rows).map(|row| (row as f64 * 0.618_033_988_749_895).sin() * 1e-3).collect();
    let names: Vec<String> = (0..10).map(|column| format!("c{column}")).collect();
    let columns: Vec<(&str, &[f64])> = names.iter().map(|name| (name.as_str(), values.as_slice())).collect();
    let wanted: Vec<usize> = (0..names.len()).collect();
    let folder = std::env::temp_dir();
    for name in ["schuler_read_speed.csv", "schuler_read_speed.csv.gz"] {
        let path = folder.join(name);
        let started = Instant::now();
        table::write(&path, &columns)?;
        let written_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let read = table::open(&path)?.read(&wanted)?;
        let read_s = started.elapsed().as_secs_f64();
        assert_eq!(read.values.last(), Some(&values));
        let bytes = std::fs::metadata(folder.join("schuler_read_speed.csv"))?.len() as f64;
        println!(
            "{name}: {:.0} MB of text, written at {:.0} MB/s, read at {:.0} MB/s",
            bytes / 1e6,
            bytes / 1e6 / written_s,
            bytes / 1e6 / read_s
        );
        if name.ends_with("gz") {
            std::fs::remove_file(folder.join("schuler_read_speed.csv"))?;
            std::fs::remove_file(path)?;
        }
    }
    Ok(())
}
