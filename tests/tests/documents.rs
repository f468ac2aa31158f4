//! The table of equations is whole and up to date, and every relative link of the documents leads somewhere.
use std::path::{Path, PathBuf};

use schuler_tests::equations::{TABLE, root, table, trace};

#[test]
fn every_equation_has_code_and_test() {
    let root = root();
    let (equations, holes) = trace(&root).expect("the sources can be read");
    for equation in &equations {
        println!(
            "{:8} code {:2} tests {:2}  {}",
            equation.id,
            equation.code.len(),
            equation.tests.len(),
            equation.title
        );
    }
    assert!(holes.is_empty(), "{}", holes.join("\n"));
    let kept = std::fs::read_to_string(root.join(TABLE)).expect("the table is there");
    assert!(kept == table(&equations), "{TABLE} is out of date: cargo run -p schuler-tests --bin equations");
}

#[test]
fn every_relative_link_exists() {
    let root = root();
    let mut documents = vec![root.join("README.md")];
    for entry in std::fs::read_dir(root.join("docs")).expect("there are documents") {
        let path = entry.expect("can be read").path();
        if path.extension().is_some_and(|extension| extension == "md") {
            documents.push(path);
        }
    }
    let mut broken = Vec::new();
    let mut links = 0;
    for document in &documents {
        let text = std::fs::read_to_string(document).expect("can be read");
        let folder = document.parent().unwrap_or(Path::new(""));
        // Markdown's `](target)`, without code blocks.
        let prose: Vec<&str> = text.split("```").step_by(2).collect();
        for target in prose.concat().split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path: PathBuf = folder.join(target.split('#').next().unwrap_or_default());
            if target.contains("://") || target.starts_with('#') {
                continue;
            }
            links += 1;
            if !path.exists() {
                broken.push(format!("{}: {target}", document.display()));
            }
        }
    }
    println!("{links} links in {} documents", documents.len());
    assert!(links > 20 && broken.is_empty(), "{}", broken.join("\n"));
}
