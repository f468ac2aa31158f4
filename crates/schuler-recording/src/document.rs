//! A TOML document read field by field.
//!
//! A deserialiser stops at the first mistake and knows neither the line of a missing key nor what a misspelt one
//! was meant to be. Here the reader asks a [`Node`] for the keys it knows; every mistake is collected with line,
//! path and expectation. What nobody asked for is a problem, too, with a suggestion where it is near to a known key; read
//! leniently ([`Leniency`]), it is ignored with a warning.
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Error, Problem};
use crate::leniency::Leniency;

/// How alike two words must be (Damerau–Levenshtein, 1 = equal) for one to be called a misspelling of the other.
const ALIKE: f64 = 0.7;
/// How alike a word and the beginning of it count as.
const ALIKE_BEGINNING: f64 = 0.9;

/// What a document held, with what its reader should be told.
#[derive(Clone, Debug, PartialEq)]
pub struct Parsed<T> {
    /// What was read.
    pub value: T,
    /// What the user should be told, keys that were ignored among it, one line each.
    pub warnings: Vec<String>,
    /// Line of every field that was asked for.
    pub lines: Lines,
}

/// Line of each field of a document, by path (`sensor[2].unit`).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lines(BTreeMap<String, usize>);

impl Lines {
    /// Line of the field at `path`, from 1; a field that is not there has none.
    pub fn get(&self, path: &str) -> Option<usize> {
        self.0.get(path).copied()
    }
}

/// Reads `text`, the content of `file`, with `read`, which returns `None` only after a problem was reported.
///
/// # Errors
/// Everything that is wrong with the document: syntax, missing, unknown or misspelt keys, types, values.
pub fn parse<T>(
    file: &Path,
    text: &str,
    read: impl FnOnce(&Node<'_>) -> Option<T>,
) -> Result<Parsed<T>, Error> {
    parse_with(file, text, Leniency::Strict, read)
}

/// Reads `text` as [`parse`], or leniently: unknown keys are ignored, with a warning each.
///
/// # Errors
/// As [`parse`].
pub fn parse_with<T>(
    file: &Path,
    text: &str,
    leniency: Leniency,
    read: impl FnOnce(&Node<'_>) -> Option<T>,
) -> Result<Parsed<T>, Error> {
    let sink = Sink { line_starts: line_starts(text), leniency, ..Sink::default() };
    let (document, syntax) = DeTable::parse_recoverable(text);
    if !syntax.is_empty() {
        let problems = syntax.iter().map(|error| {
            let line = error.span().map(|span| sink.line(&span));
            Problem::new(line, "", format!("not TOML: {}", one_line(error.message())))
        });
        return Err(Error::new(file, problems.collect()));
    }
    let value = Node::root(document.get_ref(), &sink).read(read);
    let Sink { problems, warnings, lines, .. } = sink;
    match (value, problems.into_inner()) {
        (Some(value), problems) if problems.is_empty() => {
            Ok(Parsed { value, warnings: warnings.into_inner(), lines: Lines(lines.into_inner()) })
        }
        (_, problems) => Err(Error::new(file, problems)),
    }
}

/// Where everything that is said about a document is collected.
#[derive(Default)]
struct Sink {
    line_starts: Vec<usize>,
    leniency: Leniency,
    problems: RefCell<Vec<Problem>>,
    warnings: RefCell<Vec<String>>,
    lines: RefCell<BTreeMap<String, usize>>,
}

impl Sink {
    fn line(&self, span: &Range<usize>) -> usize {
        self.line_starts.partition_point(|&start| start <= span.start)
    }

    fn problem(&self, line: usize, path: &str, message: String) {
        self.problems.borrow_mut().push(Problem::new(Some(line), path, message));
    }

    fn warn(&self, line: usize, path: &str, message: &str) {
        self.warnings.borrow_mut().push(format!("line {line}: {path}: {message}"));
    }
}

/// A table of the document.
pub struct Node<'d> {
    table: &'d DeTable<'d>,
    line: usize,
    path: String,
    sink: &'d Sink,
    /// Every key that was asked for, with the expectation it would have had to meet if it was required and missing.
    asked: RefCell<Vec<(&'static str, Option<String>)>>,
}

impl<'d> Node<'d> {
    fn root(table: &'d DeTable<'d>, sink: &'d Sink) -> Self {
        Self { table, line: 1, path: String::new(), sink, asked: RefCell::default() }
    }

    fn read<T>(self, read: impl FnOnce(&Node<'_>) -> Option<T>) -> Option<T> {
        let value = read(&self);
        self.finish();
        value
    }

    /// Path of this table in the document; empty for the document itself.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The field `key`, if it is there.
    pub fn optional(&self, key: &'static str) -> Option<Field<'d>> {
        self.ask(key, None)
    }

    /// The field `key`; a problem is reported if it is missing. `expected` completes "expected …".
    pub fn required(&self, key: &'static str, expected: &str) -> Option<Field<'d>> {
        self.ask(key, Some(expected))
    }

    /// Every table of the array of tables `key`; none if it is not there.
    pub fn tables<T>(&self, key: &'static str, read: impl Fn(&Node<'_>) -> Option<T>) -> Option<Vec<T>> {
        let Some(field) = self.optional(key) else { return Some(Vec::new()) };
        let expected = format!("an array of tables, [[{key}]]");
        let DeValue::Array(items) = field.value else { return field.wrong(&expected) };
        let values: Vec<Option<T>> = items
            .iter()
            .enumerate()
            .map(|(index, item)| field.child(&format!("[{index}]"), item).table_or(&expected, &read))
            .collect();
        values.into_iter().collect()
    }

    /// Reports a problem of the field at `path` below this table, which need not be there.
    pub fn problem_at<T>(&self, path: &str, message: &str) -> Option<T> {
        let path = self.path_of(path);
        let line = self.line_at(&path);
        self.sink.problem(line, &path, message.to_owned());
        None
    }

    /// Warns about the field at `path` below this table, which is used all the same.
    pub fn warn_at(&self, path: &str, message: &str) {
        let path = self.path_of(path);
        let line = self.line_at(&path);
        self.sink.warn(line, &path, message);
    }

    /// Line of the key, if it is there and was asked for.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        self.sink.lines.borrow().get(&self.path_of(key)).copied()
    }

    fn line_at(&self, path: &str) -> usize {
        self.sink.lines.borrow().get(path).copied().unwrap_or(self.line)
    }

    fn ask(&self, key: &'static str, required: Option<&str>) -> Option<Field<'d>> {
        let found = self.table.get_key_value(key);
        let missing = if found.is_none() { required.map(str::to_owned) } else { None };
        self.asked.borrow_mut().push((key, missing));
        let (key, value) = found?;
        let path = self.path_of(key.get_ref());
        let line = self.sink.line(&key.span());
        self.sink.lines.borrow_mut().insert(path.clone(), line);
        Some(Field { value: value.get_ref(), line, path, sink: self.sink })
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Reports what is missing and what nobody asked for.
    fn finish(self) {
        let asked = self.asked.borrow();
        let known = || asked.iter().map(|&(key, _)| key);
        let mut explained = Vec::new();
        for key in self.table.keys() {
            let name = key.get_ref().as_ref();
            if known().any(|known| known == name) {
                continue;
            }
            let path = self.path_of(name);
            let line = self.sink.line(&key.span());
            let absent = known().filter(|&known| !self.table.contains_key(known));
            let meant = suggestion(name, absent);
            let hint = meant.map(|meant| format!("; did you mean `{meant}`?")).unwrap_or_default();
            if self.sink.leniency.is_lenient() {
                self.sink.warn(line, &path, &format!("unknown key, ignored{hint}"));
            } else if meant.is_some() {
                explained.extend(meant);
                self.sink.problem(line, &path, format!("unknown key{hint}"));
            } else {
                let known = known().collect::<Vec<_>>().join(", ");
                self.sink.problem(line, &path, format!("unknown key; expected one of {known}"));
            }
        }
        for (key, missing) in asked.iter() {
            if let Some(expected) = missing.as_ref().filter(|_| !explained.contains(key)) {
                self.sink.problem(self.line, &self.path_of(key), format!("missing; expected {expected}"));
            }
        }
    }
}

/// A field of the document.
pub struct Field<'d> {
    value: &'d DeValue<'d>,
    line: usize,
    path: String,
    sink: &'d Sink,
}

impl<'d> Field<'d> {
    /// A finite number.
    pub fn number(&self) -> Option<f64> {
        self.number_where("a finite number", |_| true)
    }

    /// A finite number for which `valid` holds; `expected` completes "expected …".
    pub fn number_where(&self, expected: &str, valid: impl Fn(f64) -> bool) -> Option<f64> {
        let number = match self.value {
            DeValue::Float(number) => number.as_str().parse().ok(),
            DeValue::Integer(number) => {
                i64::from_str_radix(number.as_str(), number.radix()).ok().map(|n| n as f64)
            }
            _ => None,
        };
        match number.filter(|&number: &f64| number.is_finite() && valid(number)) {
            Some(number) => Some(number),
            None => self.wrong(expected),
        }
    }

    /// A string that is not empty.
    pub fn text(&self) -> Option<String> {
        match self.value {
            DeValue::String(text) if !text.trim().is_empty() => Some(text.as_ref().to_owned()),
            _ => self.wrong("a string that is not empty"),
        }
    }

    /// A string, empty or not.
    pub fn any_text(&self) -> Option<String> {
        match self.value {
            DeValue::String(text) => Some(text.as_ref().to_owned()),
            _ => self.wrong("a string"),
        }
    }

    /// true or false.
    pub fn boolean(&self) -> Option<bool> {
        match self.value {
            DeValue::Boolean(value) => Some(*value),
            _ => self.wrong("true or false"),
        }
    }

    /// One of `names`, which are given with what they stand for.
    pub fn one_of<T: Copy>(&self, names: &[(&str, T)]) -> Option<T> {
        let all = || names.iter().map(|&(name, _)| name);
        let expected = format!("one of {}", all().collect::<Vec<_>>().join(", "));
        let DeValue::String(text) = self.value else { return self.wrong(&expected) };
        let found = names.iter().find(|(name, _)| name == text);
        if found.is_none() {
            let hint = suggestion(text, all())
                .map(|meant| format!("; did you mean \"{meant}\"?"))
                .unwrap_or_default();
            return self.problem(format!("found {:?}; expected {expected}{hint}", text.as_ref()));
        }
        found.map(|&(_, value)| value)
    }

    /// An array of exactly `N` finite numbers.
    pub fn numbers<const N: usize>(&self) -> Option<[f64; N]> {
        let expected = format!("an array of {N} finite numbers");
        let numbers = self.items(&expected, Field::number)?;
        numbers.try_into().ok().or_else(|| self.wrong(&expected))
    }

    /// An array of finite numbers, at least one.
    pub fn number_list(&self) -> Option<Vec<f64>> {
        let expected = "an array of at least one finite number";
        let list = self.items(expected, Field::number)?;
        if list.is_empty() { self.wrong(expected) } else { Some(list) }
    }

    /// An array of finite numbers, none or more.
    pub fn any_numbers(&self) -> Option<Vec<f64>> {
        self.items("an array of finite numbers", Field::number)
    }

    /// An array of exactly `N` strings.
    pub fn texts<const N: usize>(&self) -> Option<[String; N]> {
        let expected = format!("an array of {N} strings");
        let texts = self.items(&expected, Field::text)?;
        texts.try_into().ok().or_else(|| self.wrong(&expected))
    }

    /// An array of strings.
    pub fn text_list(&self) -> Option<Vec<String>> {
        self.items("an array of strings", Field::text)
    }

    /// A table, read with `read`.
    pub fn table<T>(&self, read: impl FnOnce(&Node<'_>) -> Option<T>) -> Option<T> {
        self.table_or("a table", read)
    }

    /// The fields of a table of any keys, each read with `read`, which is given its key.
    pub fn entries<T>(&self, read: impl Fn(&str, &Field<'d>) -> Option<T>) -> Option<Vec<(String, T)>> {
        let DeValue::Table(table) = self.value else { return self.wrong("a table") };
        let entry = |(key, item): (&Spanned<_>, &'d Spanned<DeValue<'d>>)| {
            let name: &str = AsRef::<str>::as_ref(key.get_ref());
            Some((name.to_owned(), read(name, &self.child(&format!(".{name}"), item))?))
        };
        let entries: Vec<Option<_>> = table.iter().map(entry).collect();
        entries.into_iter().collect()
    }

    /// Reports that this field is not what was expected; `expected` completes "expected …".
    pub fn wrong<T>(&self, expected: &str) -> Option<T> {
        self.problem(format!("found {}; expected {expected}", described(self.value)))
    }

    /// Reports a problem of this field.
    pub fn problem<T>(&self, message: impl Into<String>) -> Option<T> {
        self.sink.problem(self.line, &self.path, message.into());
        None
    }

    /// Warns about this field, which is used all the same.
    pub fn warn(&self, message: &str) {
        self.sink.warn(self.line, &self.path, message);
    }

    fn items<T>(&self, expected: &str, read: impl Fn(&Field<'d>) -> Option<T>) -> Option<Vec<T>> {
        let DeValue::Array(items) = self.value else { return self.wrong(expected) };
        items.iter().enumerate().map(|(index, item)| read(&self.child(&format!("[{index}]"), item))).collect()
    }

    fn table_or<T>(&self, expected: &str, read: impl FnOnce(&Node<'_>) -> Option<T>) -> Option<T> {
        let DeValue::Table(table) = self.value else { return self.wrong(expected) };
        let node = Node {
            table,
            line: self.line,
            path: self.path.clone(),
            sink: self.sink,
            asked: RefCell::default(),
        };
        node.read(read)
    }

    fn child(&self, suffix: &str, item: &'d Spanned<DeValue<'d>>) -> Field<'d> {
        let line = self.sink.line(&item.span());
        let path = format!("{}{suffix}", self.path);
        self.sink.lines.borrow_mut().insert(path.clone(), line);
        Field { value: item.get_ref(), line, path, sink: self.sink }
    }
}

/// The candidate that `word` is a misspelling or a part of, if there is one.
pub fn suggestion<'c>(word: &str, candidates: impl Iterator<Item = &'c str>) -> Option<&'c str> {
    let word = word.to_lowercase();
    candidates
        .map(|candidate| {
            let lower = candidate.to_lowercase();
            let likeness = strsim::normalized_damerau_levenshtein(&word, &lower);
            let part =
                word.len() >= 3 && (lower.starts_with(&word) || word.starts_with(&lower) && lower.len() >= 3);
            (if part { likeness.max(ALIKE_BEGINNING) } else { likeness }, candidate)
        })
        .filter(|&(likeness, _)| likeness >= ALIKE)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("{:?}", text.as_ref()),
        DeValue::Integer(number) => number.to_string(),
        DeValue::Float(number) => number.to_string(),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(value) => value.to_string(),
        DeValue::Array(items) => format!("an array of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn line_starts(text: &str) -> Vec<usize> {
    std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect()
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Parsed<(f64, Option<f64>)>, Error> {
        read_with(text, Leniency::Strict)
    }

    fn read_with(text: &str, leniency: Leniency) -> Result<Parsed<(f64, Option<f64>)>, Error> {
        parse_with(Path::new("d.toml"), text, leniency, |node| {
            let step = node.required("step_s", "seconds")?.number_where("a positive number", |n| n > 0.0);
            let noise = node.optional("noise").map(|field| {
                field.table(|node| node.optional("sigma").and_then(|field| field.number()).or(Some(0.0)))
            });
            Some((step?, noise.flatten()))
        })
    }

    #[test]
    fn a_sound_document_is_read_with_its_lines() {
        let parsed = read("# comment\nstep_s = 2\n[noise]\nsigma = 0.5\n").unwrap();
        assert_eq!(parsed.value, (2.0, Some(0.5)));
        assert_eq!(parsed.lines.get("noise.sigma"), Some(4));
        assert!(parsed.warnings.is_empty());
    }

    #[test]
    fn a_misspelt_key_is_a_problem_with_a_suggestion_and_hides_the_missing_key() {
        let error = read("stepp_s = 1.0\n").unwrap_err();
        assert_eq!(error.to_string(), "d.toml:1: stepp_s: unknown key; did you mean `step_s`?");
    }

    #[test]
    fn an_unknown_key_is_a_problem_unless_read_leniently() {
        let text = "step_s = 1.0\nauthor = \"me\"\n[noise]\nsigam = 2.0\n[noise.more]\n";
        let error = format!("{:#}", read(text).unwrap_err());
        let said: Vec<&str> = error.lines().collect();
        assert_eq!(said[0], "d.toml:2: author: unknown key; expected one of step_s, noise");
        assert_eq!(said[1], "d.toml:4: noise.sigam: unknown key; did you mean `sigma`?");
        assert!(said[2].starts_with("d.toml:5: noise.more: unknown key"), "{error}");
        let parsed = read_with(text, Leniency::Lenient).unwrap();
        assert_eq!(parsed.value, (1.0, Some(0.0)));
        assert_eq!(
            parsed.warnings,
            [
                "line 5: noise.more: unknown key, ignored",
                "line 4: noise.sigam: unknown key, ignored; did you mean `sigma`?",
                "line 2: author: unknown key, ignored",
            ]
        );
    }

    #[test]
    fn missing_and_wrong_values_name_their_line() {
        assert_eq!(read("").unwrap_err().to_string(), "d.toml:1: step_s: missing; expected seconds");
        let error = read("step_s = \"1\"\n[noise]\nsigma = nan\n").unwrap_err();
        let lines = format!("{error:#}");
        assert!(lines.contains("d.toml:1: step_s: found \"1\"; expected a positive number"), "{lines}");
        assert!(lines.contains("d.toml:3: noise.sigma: found nan; expected a finite number"), "{lines}");
    }

    #[test]
    fn syntax_errors_have_a_line() {
        let error = read("step_s = 1.0\nx = = 2\n").unwrap_err();
        assert_eq!(error.problems[0].line, Some(2), "{error}");
    }

    #[test]
    fn suggestions_are_near_or_parts() {
        let keys = ["latitude_deg", "altitude_m", "quantisation"];
        assert_eq!(suggestion("quantization", keys.into_iter()), Some("quantisation"));
        assert_eq!(suggestion("latitude", keys.into_iter()), Some("latitude_deg"));
        assert_eq!(suggestion("notes", keys.into_iter()), None);
    }
}
