//! From the equations of the papers to the code that implements them and the tests that prove them.
//!
//! In: `tests/equations.txt`, the ids in brackets in the comments of the sources, and those in the names of the tests
//! (`fil_11_…`). Code for reference in `tests/src` counts as code.
//! Out: a table, and every hole: an id with code and no test, a test and no code, neither, one that is out of scope and
//! has either, or one that is not listed.
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Where the table is kept, from the project's root.
pub const TABLE: &str = "docs/equations.md";
/// The list of what must exist.
const LIST: &str = "tests/equations.txt";
/// Folders with sources.
const SOURCES: [&str; 4] = ["crates", "firmware/src", "host-sim", "tests"];
/// What begins an item.
const KINDS: [&str; 9] = ["fn", "struct", "enum", "trait", "type", "const", "static", "mod", "impl"];
/// The parts of the specification, as prefixes of ids.
const PARTS: [&str; 4] = ["FIL", "FDI", "TMP", "HLT"];

/// What an equation needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Code and a test.
    #[default]
    Code,
    /// Published numbers alone: a test suffices.
    Numbers,
    /// Out of scope, with the reason: neither code nor test.
    Outside,
}

/// One line of the list with what was found for it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Equation {
    /// Its id, e.g. `FDI-3.4`.
    pub id: String,
    /// What it is.
    pub title: String,
    /// What it needs.
    pub kind: Kind,
    /// Its numbers or sections in the paper, or a dash where the project adds it.
    pub source: String,
    /// File and item.
    pub code: BTreeSet<(PathBuf, String)>,
    /// File and name.
    pub tests: BTreeSet<(PathBuf, String)>,
}

/// The project's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every listed equation, and every hole in words.
///
/// # Errors
/// A file that cannot be read.
pub fn trace(root: &Path) -> std::io::Result<(Vec<Equation>, Vec<String>)> {
    let mut holes = Vec::new();
    let list = std::fs::read_to_string(root.join(LIST))?;
    let mut equations: Vec<Equation> = Vec::new();
    for line in list.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty()) {
        let parts: Vec<&str> = line.splitn(4, '|').map(str::trim).collect();
        let kind = match parts.get(1) {
            Some(&"code") => Some(Kind::Code),
            Some(&"numbers") => Some(Kind::Numbers),
            Some(&"outside") => Some(Kind::Outside),
            _ => None,
        };
        let (Some(kind), [id, _, source, title]) = (kind, &parts[..]) else {
            holes.push(format!("{LIST}: cannot be understood: {line}"));
            continue;
        };
        equations.push(Equation {
            id: (*id).to_owned(),
            title: (*title).to_owned(),
            kind,
            source: (*source).to_owned(),
            ..Equation::default()
        });
    }
    let place: BTreeMap<String, usize> =
        equations.iter().enumerate().map(|(k, equation)| (equation.id.clone(), k)).collect();

    for file in sources(root)? {
        let text = std::fs::read_to_string(&file)?;
        let relative = file.strip_prefix(root).unwrap_or(&file).to_owned();
        let lines: Vec<&str> = text.lines().collect();
        let tests_only = relative.iter().skip(1).any(|part| part == "tests");
        let tests_from = lines.iter().position(|line| line.trim() == "#[cfg(test)]").unwrap_or(lines.len());
        for (k, line) in lines.iter().enumerate() {
            if line.trim_start().starts_with("//") && !tests_only && k < tests_from {
                for id in bracketed(line) {
                    match place.get(&id) {
                        Some(&at) => {
                            equations[at].code.insert((relative.clone(), item_after(&lines, k)));
                        }
                        None => {
                            holes.push(format!("{}:{}: [{id}] is not in {LIST}", relative.display(), k + 1));
                        }
                    }
                }
            }
            let Some(name) = line.trim_start().strip_prefix("fn ").and_then(|rest| rest.split('(').next())
            else {
                continue;
            };
            let attributed = lines[..k].iter().rev().take(6).any(|before| before.trim() == "#[test]");
            if !(attributed && (tests_only || k > tests_from)) {
                continue;
            }
            for id in named(name, &place) {
                match id {
                    Ok(at) => {
                        equations[at].tests.insert((relative.clone(), name.to_owned()));
                    }
                    Err(id) => {
                        holes.push(format!("{}: test {name}: {id} is not in {LIST}", relative.display()));
                    }
                }
            }
        }
    }
    for equation in &equations {
        let id = &equation.id;
        let (code, tests) = (!equation.code.is_empty(), !equation.tests.is_empty());
        match (equation.kind, code, tests) {
            (Kind::Outside, true, _) => holes.push(format!("{id} is out of scope and has code")),
            (Kind::Outside, false, true) => holes.push(format!("{id} is out of scope and has a test")),
            (Kind::Code, false, false) => holes.push(format!("{id} has neither code nor test")),
            (Kind::Code, false, true) => holes.push(format!("{id} has a test and no code")),
            (Kind::Code, true, false) | (Kind::Numbers, _, false) => holes.push(format!("{id} has no test")),
            (Kind::Outside, false, false) | (_, _, true) => {}
        }
    }
    Ok((equations, holes))
}

/// The table as it is kept.
pub fn table(equations: &[Equation]) -> String {
    let mut text = "# Equations, code and tests\n\n\
        Made by `cargo run -p schuler-tests --bin equations` from the comments of the code (`[FDI-4]`), the names of the tests\n\
        (`fdi_4_…`) and [the list of what must exist](../tests/equations.txt). A test fails on a hole and when this page is out of\n\
        date.\n\n\
        | part | paper | ids |\n| --- | --- | --- |\n\
        | FIL | Chernodarov, Patrikeev, Ivanov: identification of noise models | numbers of its equations |\n\
        | FDI | Larin (2015): five gyros | the project's |\n\
        | TMP | Tarygin (2024): rate of temperature, calibration | the project's |\n\
        | HLT | Bolelov, Sbitnev: health of a radio sensor | the project's |\n\n\
        The column `in the paper` has the numbers of the equations and sections in the paper. A dash: the project adds it.\n\n\
        | id | in the paper | what it is | code | tests |\n| --- | --- | --- | --- | --- |\n"
        .to_owned();
    let outside = |equation: &&Equation| equation.kind == Kind::Outside;
    for equation in equations.iter().filter(|equation| !outside(equation)) {
        let links = |places: &BTreeSet<(PathBuf, String)>| {
            let links: Vec<String> =
                places.iter().map(|(file, name)| format!("[`{name}`](../{})", file.display())).collect();
            links.join("<br>")
        };
        // Writing into a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} |",
            equation.id,
            equation.source,
            equation.title,
            links(&equation.code),
            links(&equation.tests)
        );
    }
    text += "\n## Out of scope\n\n| id | in the paper | what it is, and why it is not here |\n| --- | --- | --- |\n";
    for equation in equations.iter().filter(outside) {
        let _ = writeln!(text, "| {} | {} | {} |", equation.id, equation.source, equation.title);
    }
    text
}

/// Every Rust file of the project, in order.
fn sources(root: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = SOURCES.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Ids in brackets in a line.
fn bracketed(line: &str) -> Vec<String> {
    line.split('[')
        .skip(1)
        .filter_map(|rest| {
            let id = rest.split(']').next()?;
            let (part, number) = id.split_once('-')?;
            let is_id = PARTS.contains(&part)
                && number.starts_with(|c: char| c.is_ascii_digit())
                && number.chars().all(|c| c.is_ascii_digit() || c == '.');
            is_id.then(|| id.to_owned())
        })
        .collect()
}

/// Ids in the name of a test: their places, or one that is not listed. Two numbers are one id where such a one is listed.
fn named(name: &str, place: &BTreeMap<String, usize>) -> Vec<Result<usize, String>> {
    let words: Vec<&str> = name.split('_').collect();
    let number = |k: usize| words.get(k).copied().filter(|w| w.parse::<u32>().is_ok());
    (0..words.len())
        .filter_map(|k| {
            let part = PARTS.iter().find(|part| part.to_lowercase() == words[k])?;
            let first = number(k + 1)?;
            let long = number(k + 2).and_then(|second| place.get(&format!("{part}-{first}.{second}")));
            let short = format!("{part}-{first}");
            Some(long.or_else(|| place.get(&short)).copied().ok_or(short))
        })
        .collect()
}

/// The item that a comment belongs to.
fn item_after(lines: &[&str], at: usize) -> String {
    if lines[at].trim_start().starts_with("//!") {
        return "module".to_owned();
    }
    let below = lines[at..]
        .iter()
        .map(|line| line.trim_start())
        .find(|line| !line.starts_with("//") && !line.starts_with('#') && !line.is_empty());
    let Some(below) = below else { return "module".to_owned() };
    let mut words = below.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
    let mut last = "";
    for word in words.by_ref() {
        // `const fn` is a function.
        if KINDS.contains(&last) && !KINDS.contains(&word) {
            return word.to_owned();
        }
        if !matches!(word, "pub" | "super" | "crate" | "in") && !KINDS.contains(&word) {
            return word.to_owned();
        }
        last = word;
    }
    "module".to_owned()
}
