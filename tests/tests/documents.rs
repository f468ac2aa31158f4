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

/// `cargo run` in the project's folder is the command, as the documents have it, whatever other programs there are.
#[test]
fn cargo_runs_the_command() {
    let metadata = std::process::Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--locked", "--format-version", "1"])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(metadata.status.success(), "{}", String::from_utf8_lossy(&metadata.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&metadata.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("a list");
    let runs: Vec<&str> = packages.iter().filter_map(|package| package["default_run"].as_str()).collect();
    assert_eq!(runs, ["schuler"]);
}

/// What the documents promise is what Cargo refuses to go below; `tests/run` compiles with that toolchain where it is there.
#[test]
fn the_oldest_rust_is_the_one_that_the_documents_name() {
    let root = root();
    let read = |path: &str| std::fs::read_to_string(root.join(path)).expect("can be read");
    let manifest: toml::Table = read("Cargo.toml").parse().expect("TOML");
    let oldest = manifest["workspace"]["package"]["rust-version"].as_str().expect("a version").to_owned();
    for document in ["README.md", "docs/start.md"] {
        let text = read(document);
        let named: Vec<&str> = (text.match_indices("Rust 1."))
            .map(|(at, _)| {
                let version = &text[at + "Rust ".len()..];
                let end = version.find(|it: char| !it.is_ascii_digit() && it != '.').unwrap_or(version.len());
                version[..end].trim_end_matches('.')
            })
            .collect();
        assert!(
            !named.is_empty() && named.iter().all(|it| *it == oldest),
            "{document}: {named:?}, not {oldest}"
        );
    }
    for entry in
        ["crates", "."].iter().flat_map(|folder| std::fs::read_dir(root.join(folder)).expect("a folder"))
    {
        let path = entry.expect("can be read").path().join("Cargo.toml");
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        let manifest: toml::Table = text.parse().expect("TOML");
        let of_workspace = manifest["package"]["rust-version"]["workspace"].as_bool();
        assert_eq!(of_workspace, Some(true), "{}: rust-version is not the workspace's", path.display());
    }
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
