//! Writes the table of equations, code and tests; says what is missing.
use std::process::ExitCode;

use schuler_tests::equations::{TABLE, root, table, trace};

fn main() -> ExitCode {
    let root = root();
    let written = trace(&root).and_then(|(equations, holes)| {
        std::fs::write(root.join(TABLE), table(&equations)).map(|()| (equations.len(), holes))
    });
    match written {
        Ok((count, holes)) => {
            for hole in &holes {
                eprintln!("{hole}");
            }
            println!("{TABLE}: {count} equations, {} holes", holes.len());
            if holes.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Err(error) => {
            eprintln!("equations: {error}");
            ExitCode::FAILURE
        }
    }
}
