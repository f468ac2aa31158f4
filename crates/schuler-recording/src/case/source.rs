//! The part of a case about a table: where it is, and when its rows are.
use std::path::PathBuf;

use serde::Serialize;

use super::read::{optional, positive};
use crate::document::{Field, Node};

/// What messages call the time of a table that has no column of it.
const ROWS: &str = "row";

/// Where the table is and what its time means.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Source {
    /// Path of the table, relative to the case's file.
    pub path: PathBuf,
    /// Column of time, increasing, of any origin; without it the rows are evenly spaced by `step_s` from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// Unit of the time; without it guessed from the column's name and from the stamps, which is said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// Step, s; without it that of the clock that the stamps show. Needed where there is no column of time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_s: Option<f64>,
    /// What becomes of rows that come twice or late; without it they are an error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duplicates: Option<Duplicates>,
    /// When the instruments were switched on within the recording, s as the time column, increasing; empty where they never
    /// were. Without it that is guessed from supplies that are off and from gaps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub switched_on_s: Option<Vec<f64>>,
}

impl Source {
    /// What messages call the time: its column, or that the rows are counted.
    pub fn time_name(&self) -> &str {
        self.time.as_deref().unwrap_or(ROWS)
    }

    /// What is assumed of a table without a column of time.
    pub(crate) fn assumption(&self) -> Option<String> {
        let step_s = self.step_s.filter(|_| self.time.is_none())?;
        Some(format!(
            "has no column of time: its rows are taken to be evenly spaced by the stated step of {step_s} s, from 0 s"
        ))
    }

    /// Keeps the times of switching on that are in a part of the table, from the first to the last of its time stamps.
    pub fn keep_switching_on(&mut self, stamps: [f64; 2]) {
        let [first_s, last_s] = stamps.map(|stamp| stamp * self.time_unit.unwrap_or_default().in_seconds());
        if let Some(stated_s) = &mut self.switched_on_s {
            stated_s.retain(|time_s| (first_s..=last_s).contains(time_s));
        }
    }

    /// Counts the times of switching on from this time of the table, which was cut off before it, s.
    pub fn begin_at(&mut self, start_s: f64) {
        self.switched_on_s.iter_mut().flatten().for_each(|time_s| *time_s -= start_s);
    }
}

/// Unit of a time column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeUnit {
    /// Seconds.
    #[default]
    Second,
    /// Milliseconds.
    Millisecond,
    /// Microseconds.
    Microsecond,
    /// Nanoseconds.
    Nanosecond,
}

impl TimeUnit {
    /// Every unit under its name in the case file.
    pub const NAMES: [(&'static str, TimeUnit); 4] = [
        ("s", TimeUnit::Second),
        ("ms", TimeUnit::Millisecond),
        ("us", TimeUnit::Microsecond),
        ("ns", TimeUnit::Nanosecond),
    ];

    /// Seconds that one of it is.
    pub const fn in_seconds(self) -> f64 {
        match self {
            Self::Second => 1.0,
            Self::Millisecond => 1e-3,
            Self::Microsecond => 1e-6,
            Self::Nanosecond => 1e-9,
        }
    }
}

/// What becomes of rows whose time is not after that of the row before. Rows that are earlier are left out either way; more than
/// a tenth of them are an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duplicates {
    /// Of rows with one time the first is kept.
    Drop,
    /// Rows with one time are averaged, column by column.
    Average,
}

impl Duplicates {
    /// Every remedy under its name in the case file.
    pub const NAMES: [(&'static str, Duplicates); 2] =
        [("drop", Duplicates::Drop), ("average", Duplicates::Average)];
}

/// Reads `[recording]`.
pub(super) fn source(node: &Node<'_>) -> Option<Source> {
    let path = node.required("path", "the path of the table").and_then(|field| field.text());
    let time = optional(node, "time", Field::text);
    let time_unit = optional(node, "time_unit", |field| field.one_of(&TimeUnit::NAMES));
    let step_s = optional(node, "step_s", positive);
    let has_time = rows_have_times(node);
    let duplicates = optional(node, "duplicates", |field| field.one_of(&Duplicates::NAMES));
    let switched_on_s = optional(node, "switched_on_s", increasing);
    has_time?;
    Some(Source {
        path: path?.into(),
        time: time?,
        time_unit: time_unit?,
        step_s: step_s?,
        duplicates: duplicates?,
        switched_on_s: switched_on_s?,
    })
}

/// Whether rows have times: stamps, or a step by which they are evenly spaced. Of stamps alone a unit and repeats can be stated.
pub(super) fn rows_have_times(node: &Node<'_>) -> Option<()> {
    if node.optional("time").is_some() {
        return Some(());
    }
    if node.optional("step_s").is_none() {
        let expected = "missing, as is step_s; expected the name of the time column, or step_s in seconds, by which the rows \
                        of a table without one are evenly spaced";
        return node.problem_at("time", expected);
    }
    match ["time_unit", "duplicates"].into_iter().find(|key| node.optional(key).is_some()) {
        Some(key) => {
            node.problem_at(key, "found without time; expected also time, the name of the time column")
        }
        None => Some(()),
    }
}

/// Times, each later than the one before; none is a statement, too.
fn increasing(field: &Field<'_>) -> Option<Vec<f64>> {
    let times_s = field.any_numbers()?;
    match times_s.windows(2).find(|pair| pair[1] <= pair[0]) {
        Some(pair) => {
            let found = format!("found {} after {}", pair[1], pair[0]);
            field.problem(format!("{found}; expected times in seconds, each later than the one before"))
        }
        None => Some(times_s),
    }
}
