//! `schuler compare-isolation --tables`: the isolation paper's own numbers beside the calculated ones.
use std::path::{Path, PathBuf};

use schuler_core::config::ConfigError;
use schuler_recording::{Error, Problem};
use serde::Serialize;

use super::Failure;
use super::fly::write_json;
use super::session::Session;
use super::text::put;
use crate::compare_isolation::ComparisonError;
use crate::compare_isolation::rule::{RuleComparison, RuleRow, compare_rule, threshold};
use crate::compare_isolation::tables::{PaperTables, Table, differing};

#[derive(Debug, Serialize)]
struct Answer {
    format: &'static str,
    tables: PaperTables,
    /// Numbers of Tables 1 and 2 that differ from the printed ones in their last digit.
    differing: [usize; 2],
    comparison: RuleComparison,
    /// The threshold of the paper's rule that has the stated time between false alarms.
    threshold: f64,
    rows: Vec<RuleRow>,
    files: Vec<PathBuf>,
}

pub(super) fn run(seed: u64, out: Option<&Path>, session: &Session) -> Result<(), Failure> {
    let tables = PaperTables::try_build([0.0; 3]).map_err(|error| wrong(&error))?;
    let comparison = RuleComparison { seed, ..RuleComparison::default() };
    let progress = session.progress("detecting", comparison.faults.len());
    let rows = compare_rule(&comparison, |done| progress.at(done as usize));
    drop(progress);
    let rows = rows.map_err(|error| match error {
        ComparisonError::Interrupted(stopped) => Failure::Stopped(stopped),
        ComparisonError::Configuration(error) => wrong(&error),
    })?;
    let mut answer = Answer {
        format: "schuler-isolation-tables/1",
        differing: [
            differing(&tables.ratios, &tables.published_ratios),
            differing(&tables.determinants, &tables.published_determinants),
        ],
        threshold: threshold(comparison.false_alarm_interval),
        tables,
        comparison,
        rows,
        files: Vec::new(),
    };
    if let Some(directory) = out {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        let path = directory.join("isolation-tables.json");
        write_json(&path, &answer)?;
        answer.files.push(path);
    }
    session.answer(&answer, words)
}

fn wrong(error: &ConfigError) -> Failure {
    Error::one(Path::new("command line"), Problem::new(None, error.field, error.problem.to_string())).into()
}

fn words(answer: &Answer) -> String {
    let tables = &answer.tables;
    let mut text = String::new();
    put(&mut text, format_args!("Larin (2015): five gyros, noise 0.1, a fault of 1; calculated (printed)\n"));
    beside(
        &mut text,
        "Table 1, ratios of the sequential filter as published. Row i has its fault in gyro 6 - i.\n\
         Column r has gyro r + 1 last. The largest ratio of a row names the gyro.",
        ["i \\ r", "0", "1", "2", "3", "4"],
        [&tables.ratios, &tables.published_ratios],
    );
    told(&mut text, answer.differing[0]);
    alone(
        &mut text,
        "The same with the gain of the Kalman filter. Each row decides as the determinants do.",
        ["i \\ r", "0", "1", "2", "3", "4"],
        &tables.kalman_ratios,
    );
    beside(
        &mut text,
        "Table 2, determinants of [A y] without row j. Row i has its fault in gyro i.\n\
         The least determinant of a row names the gyro.",
        ["i \\ j", "1", "2", "3", "4", "5"],
        [&tables.determinants, &tables.published_determinants],
    );
    told(&mut text, answer.differing[1]);
    alone(
        &mut text,
        "Condition numbers of the same matrices at rest. The paper prints none. They depend on the rate of the body.\n\
         The largest of a row names the gyro.",
        ["i \\ j", "1", "2", "3", "4", "5"],
        &tables.conditions,
    );
    alone(
        &mut text,
        "Condition numbers of [A Gy]. They do not depend on the rate.",
        ["i \\ j", "1", "2", "3", "4", "5"],
        &tables.residual_conditions,
    );
    rule(&mut text, answer);
    for path in &answer.files {
        put(&mut text, format_args!("  {}", path.display()));
    }
    text
}

fn told(text: &mut String, differing: usize) {
    let same = 25 - differing;
    put(
        text,
        format_args!("{same} of 25 numbers equal the printed ones within half a unit of the last digit.\n"),
    );
}

/// A table with the printed digits in brackets.
fn beside(text: &mut String, title: &str, head: [&str; 6], tables: [&Table; 2]) {
    put(text, format_args!("{title}"));
    let [first, rest @ ..] = head;
    put(text, format_args!("{first:>6}{}", rest.map(|name| format!("{name:>22}")).concat()));
    for (row, (calculated, printed)) in tables[0].iter().zip(tables[1]).enumerate() {
        let cells =
            calculated.iter().zip(printed).map(|(a, b)| format!("{a:>11.4} {:>10}", format!("({b:.4})")));
        put(text, format_args!("{:>6}{}", row + 1, cells.collect::<String>()));
    }
}

/// A table of which the paper prints nothing.
fn alone(text: &mut String, title: &str, head: [&str; 6], table: &Table) {
    put(text, format_args!("{title}"));
    let [first, rest @ ..] = head;
    put(text, format_args!("{first:>6}{}", rest.map(|name| format!("{name:>11}")).concat()));
    for (row, values) in table.iter().enumerate() {
        put(text, format_args!("{:>6}{}", row + 1, values.map(|value| format!("{value:>11.4}")).concat()));
    }
    put(text, format_args!(""));
}

fn rule(text: &mut String, answer: &Answer) {
    let comparison = &answer.comparison;
    put(
        text,
        format_args!(
            "Rule of the paper: a fault where k_s > k_s,max = {:.2} on one sample; the largest ratio names the gyro.\n\
             Beside it the sequential detector of the flight module. Both have a false alarm in {} samples on average.\n\
             Steps in one gyro, {} runs each (seed {}); means.",
            answer.threshold, comparison.false_alarm_interval, comparison.runs, comparison.seed
        ),
    );
    put(
        text,
        format_args!(
            "{:>10}{:>18}{:>14}{:>22}{:>14}{:>14}",
            "step, σ", "rule: samples", "right gyro", "sequential: samples", "until named", "right gyro"
        ),
    );
    for row in &answer.rows {
        put(
            text,
            format_args!(
                "{:>10}{:>18.1}{:>14.3}{:>22.1}{:>14.1}{:>14.3}",
                row.fault,
                row.rule_delay,
                row.rule_right,
                row.detector_delay,
                row.isolation_delay,
                row.detector_right
            ),
        );
    }
    put(
        text,
        format_args!(
            "In flight the likelihood accumulated since the alarm decides which gyro has failed. The determinants watch the\n\
             four gyros that remain."
        ),
    );
}
