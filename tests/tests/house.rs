//! The laws of the house, on the tree as it is: files and functions that can be read at once, and names that the field knows.
//!
//! What does not keep a law yet stands in `tests/house.toml` with how far it is off. The numbers there may fall and not rise,
//! and an entry that is no longer needed is a failure too.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schuler_tests::equations::root;
use syn::visit::{self, Visit};

/// Lines that a source file may have.
const MOST_LINES: usize = 600;
/// Parameters that a function may have beside its receiver.
const MOST_PARAMETERS: usize = 6;
/// What is still off, by file, function or crate.
const OPEN: &str = "tests/house.toml";
/// Folders with sources.
const SOURCES: [&str; 5] = ["crates", "firmware", "fuzz", "host-sim", "tests"];

/// Terms that stand in no name: the words of a private language. A name is looked at word by word.
const PRIVATE_NAMES: [&str; 17] = [
    "told beside",
    "shown",
    "of the motion",
    "place",
    "loudness",
    "instead",
    "laid out",
    "course",
    "steady",
    "within step",
    "watch",
    "price",
    "draft",
    "worth",
    "walk",
    "way",
    "joined",
];
/// Names of the field that contain one of them.
const NAMES_OF_THE_FIELD: [&str; 3] = ["random walk", "rate walk", "steady state"];
/// Those of the terms that have no other meaning in a sentence.
const PRIVATE_PHRASES: [&str; 7] =
    ["told beside", "is of the motion", "are of the motion", "loudness", "laid out", "within step", "price"];
/// Words from which on a name is a sentence: that of a test.
const A_SENTENCE: usize = 6;

/// A source file with what the laws are about.
struct Source {
    /// From the project's root.
    path: String,
    text: String,
    found: Found,
}

/// What a file declares.
#[derive(Default)]
struct Found {
    /// Functions with more parameters than may be, with their number.
    wide: Vec<(String, usize)>,
    /// Functions with a tuple pattern as a parameter.
    patterns: Vec<String>,
    /// Every name that is given here.
    names: Vec<String>,
}

impl Found {
    fn function(&mut self, signature: &syn::Signature) {
        let name = signature.ident.to_string();
        let parameters = || {
            signature.inputs.iter().filter_map(|input| match input {
                syn::FnArg::Typed(typed) => Some(typed.pat.as_ref()),
                syn::FnArg::Receiver(_) => None,
            })
        };
        if parameters().count() > MOST_PARAMETERS {
            self.wide.push((name.clone(), parameters().count()));
        }
        if parameters().any(is_tuple) {
            self.patterns.push(name.clone());
        }
    }
}

/// Whether a pattern takes a tuple apart.
fn is_tuple(pattern: &syn::Pat) -> bool {
    match pattern {
        syn::Pat::Tuple(_) | syn::Pat::TupleStruct(_) => true,
        syn::Pat::Reference(reference) => is_tuple(&reference.pat),
        syn::Pat::Paren(inner) => is_tuple(&inner.pat),
        _ => false,
    }
}

impl<'ast> Visit<'ast> for Found {
    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        self.function(signature);
        self.names.push(signature.ident.to_string());
        visit::visit_signature(self, signature);
    }

    fn visit_field(&mut self, field: &'ast syn::Field) {
        self.names.extend(field.ident.iter().map(ToString::to_string));
        visit::visit_field(self, field);
    }

    fn visit_pat_ident(&mut self, pattern: &'ast syn::PatIdent) {
        self.names.push(pattern.ident.to_string());
        visit::visit_pat_ident(self, pattern);
    }

    fn visit_variant(&mut self, variant: &'ast syn::Variant) {
        self.names.push(variant.ident.to_string());
        visit::visit_variant(self, variant);
    }

    fn visit_item(&mut self, item: &'ast syn::Item) {
        let name = match item {
            syn::Item::Const(item) => Some(&item.ident),
            syn::Item::Enum(item) => Some(&item.ident),
            syn::Item::Mod(item) => Some(&item.ident),
            syn::Item::Static(item) => Some(&item.ident),
            syn::Item::Struct(item) => Some(&item.ident),
            syn::Item::Trait(item) => Some(&item.ident),
            syn::Item::Type(item) => Some(&item.ident),
            _ => None,
        };
        self.names.extend(name.map(ToString::to_string));
        visit::visit_item(self, item);
    }
}

/// Every Rust file of the project.
fn sources(root: &Path) -> Vec<Source> {
    let mut folders: Vec<PathBuf> = SOURCES.iter().map(|folder| root.join(folder)).collect();
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder of sources") {
            let path = entry.expect("can be read").path();
            if path.is_dir() && !path.ends_with("target") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = std::fs::read_to_string(&path).expect("a source file");
                let mut declared = Found::default();
                let parsed = syn::parse_file(&text);
                declared.visit_file(&parsed.unwrap_or_else(|error| panic!("{}: {error}", path.display())));
                found.push(Source { path: from_root(root, &path), text, found: declared });
            }
        }
    }
    assert!(found.len() > 100, "{} sources", found.len());
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn from_root(root: &Path, path: &Path) -> String {
    path.strip_prefix(root).expect("below the root").to_string_lossy().replace('\\', "/")
}

/// The crate, or the folder, that a file belongs to.
fn crate_of(path: &str) -> String {
    let parts = if path.starts_with("crates/") { 2 } else { 1 };
    path.split('/').take(parts).collect::<Vec<_>>().join("/")
}

/// Pages of the documentation, with their paths from the root. What is made of the code is not written by anyone.
fn pages(root: &Path) -> Vec<(String, String)> {
    let mut pages = vec![root.join("README.md"), root.join("CONTRIBUTING.md")];
    for entry in std::fs::read_dir(root.join("docs")).expect("there are documents") {
        pages.push(entry.expect("can be read").path());
    }
    pages.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    pages.sort();
    pages
        .into_iter()
        .filter(|path| !path.ends_with("equations.md"))
        .map(|path| (from_root(root, &path), std::fs::read_to_string(&path).expect("a page")))
        .collect()
}

/// The words of a name: `told_beside`, `ToldBeside` and `TOLD_BESIDE` have the same two.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_lower = false;
    for letter in name.chars() {
        if letter == '_' || (letter.is_uppercase() && was_lower) {
            words.push(String::new());
        }
        was_lower = letter.is_lowercase() || letter.is_ascii_digit();
        if let Some(word) = words.last_mut().filter(|_| letter != '_') {
            word.extend(letter.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Whether a phrase stands in a row of words.
fn holds(words: &str, phrase: &str) -> bool {
    format!(" {words} ").contains(&format!(" {phrase} "))
}

/// The private term in a name, if there is one.
fn private_term(name: &str) -> Option<&'static str> {
    let words = words(name);
    let mut words = if words.len() < A_SENTENCE { words.join(" ") } else { String::new() };
    for known in NAMES_OF_THE_FIELD {
        words = words.replace(known, "");
    }
    PRIVATE_NAMES.into_iter().find(|term| holds(&words, term))
}

/// The private phrases in a text, in any case of letters and however it is broken into lines.
fn private_phrases(text: &str) -> Vec<&'static str> {
    let plain: String = text.chars().map(|c| if c.is_alphanumeric() { c } else { ' ' }).collect();
    let plain = plain.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ");
    let count = |phrase: &str| format!(" {plain} ").matches(&format!(" {phrase} ")).count();
    PRIVATE_PHRASES.into_iter().flat_map(|phrase| std::iter::repeat_n(phrase, count(phrase))).collect()
}

/// The comments of a source file, without their slashes. What stands in a text of the program is no comment.
fn comments(text: &str) -> String {
    text.lines()
        .filter_map(|line| {
            let line = line.trim_start();
            let comment = line.strip_prefix("//").or_else(|| line.split_once(" // ").map(|(_, it)| it))?;
            Some(comment.trim_start_matches(['/', '!']).to_owned() + "\n")
        })
        .collect()
}

/// Holds what is found, by file, function or crate, against the table of that name in [`OPEN`].
fn hold(law: &str, found: &BTreeMap<String, usize>, what: &str) {
    let text = std::fs::read_to_string(root().join(OPEN)).expect("the list of what is open");
    let open: toml::Table = text.parse().expect("TOML");
    let open: BTreeMap<String, usize> =
        open.get(law).cloned().map(|table| table.try_into().expect("numbers")).unwrap_or_default();
    let mut wrong = Vec::new();
    for (where_found, number) in found {
        match open.get(where_found) {
            None => wrong.push(format!("{where_found}: {number} {what}")),
            Some(most) if number > most => {
                wrong.push(format!("{where_found}: {number} {what}, {most} before"));
            }
            Some(most) if number < most => {
                println!("{where_found}: {number} {what}, {OPEN} still allows {most}");
            }
            Some(_) => {}
        }
    }
    let kept = open.keys().filter(|name| !found.contains_key(*name));
    wrong.extend(kept.map(|name| format!("{name}: keeps the law now; take it out of [{law}] in {OPEN}")));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_file_is_longer_than_can_be_read() {
    let found = sources(&root())
        .into_iter()
        .map(|source| (source.path, source.text.lines().count()))
        .filter(|(_, lines)| *lines > MOST_LINES)
        .collect();
    hold("lines", &found, "lines");
}

#[test]
fn no_function_has_more_than_six_parameters() {
    let found = sources(&root())
        .iter()
        .flat_map(|source| {
            source.found.wide.iter().map(|(name, count)| (format!("{} {name}", source.path), *count))
        })
        .collect();
    hold("parameters", &found, "parameters");
}

#[test]
fn no_parameter_is_a_tuple_pattern() {
    let found = sources(&root())
        .iter()
        .flat_map(|source| source.found.patterns.iter().map(|name| (format!("{} {name}", source.path), 1)))
        .collect();
    hold("patterns", &found, "tuple pattern");
}

#[test]
fn names_are_those_of_the_field() {
    let mut found = BTreeMap::new();
    for source in sources(&root()) {
        for (name, term) in source.found.names.iter().filter_map(|name| Some((name, private_term(name)?))) {
            println!("{}: {name} ({term})", source.path);
            *found.entry(crate_of(&source.path)).or_insert(0) += 1;
        }
    }
    hold("names", &found, "names with a private term");
}

#[test]
fn comments_and_pages_are_without_private_phrases() {
    let root = root();
    let mut found = BTreeMap::new();
    let texts = sources(&root).into_iter().map(|source| (source.path, comments(&source.text)));
    for (path, text) in texts.chain(pages(&root)) {
        // The list of them stands in this file.
        let phrases = if path.ends_with("tests/house.rs") { Vec::new() } else { private_phrases(&text) };
        for phrase in phrases {
            println!("{path}: {phrase}");
            *found.entry(crate_of(&path)).or_insert(0) += 1;
        }
    }
    hold("phrases", &found, "private phrases");
}

/// The laws find what breaks them.
#[test]
fn each_law_can_be_broken() {
    let mut found = Found::default();
    let file =
        "fn f(a: u8, b: u8, c: u8, d: u8, e: u8, (g, h): (u8, u8), [i, j]: [u8; 2]) { let told_beside = 1; }
        struct WithinStep { random_walk: f64 }";
    found.visit_file(&syn::parse_file(file).expect("Rust"));
    assert_eq!(found.wide, [("f".to_owned(), 7)]);
    assert_eq!(found.patterns, ["f"]);
    let private: Vec<&str> = found.names.iter().filter_map(|name| private_term(name)).collect();
    assert_eq!(private, ["told beside", "within step"]);
    let text = "/// It is laid\n/// out. \n let x = 1; // The price.\n let y = \"laid out\";\n";
    assert_eq!(private_phrases(&comments(text)), ["laid out", "price"]);
}
