//! Explains the case given as argument and prints the answer and the time that it took.
use std::path::Path;
use std::time::Instant;

use schuler_explain::explain::{Options, explain};
use schuler_recording::Recording;

fn main() {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("expected the path of a case");
        std::process::exit(2);
    };
    let recording = match Recording::read(Path::new(&path)) {
        Ok(recording) => recording,
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(2);
        }
    };
    let start = Instant::now();
    match explain(&recording, &Options::default()) {
        Ok(explanation) => println!("{}", serde_json::to_string_pretty(&explanation).unwrap_or_default()),
        Err(error) => {
            eprintln!("{path}: {error}");
            std::process::exit(2);
        }
    }
    eprintln!("{:.2} s", start.elapsed().as_secs_f64());
}
