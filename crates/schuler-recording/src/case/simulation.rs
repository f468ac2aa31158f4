//! The part of a case about the user's own simulator: where its output is, and what its clock has to do with the recording's.
use std::path::PathBuf;

use serde::Serialize;

use super::read::{optional, positive};
use super::source::{Source, TimeUnit, rows_have_times};
use crate::document::{Field, Node};

/// Output of the user's simulator, which takes the place of the nominal prediction.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Simulation {
    /// A table of its own; none where its columns are in the recording's table.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub table: Option<Source>,
    /// What its clock is against the recording's.
    pub clock: Clock,
    /// How much of the recording it is there for.
    pub covers: Covers,
}

/// What the simulator's clock is against the recording's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// Its times are the recording's.
    #[default]
    Same,
    /// It begins at another time and may run at another rate; both are fitted.
    Unknown,
}

impl Clock {
    /// Every clock under its name in the case file.
    pub const NAMES: [(&'static str, Clock); 2] = [("same", Clock::Same), ("unknown", Clock::Unknown)];
}

/// How much of the recording a simulation is there for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Covers {
    /// All of it: one that ends early is an error.
    #[default]
    All,
    /// A part: what is recorded before and after it is left out.
    Part,
}

impl Covers {
    /// Every choice under its name in the case file.
    pub const NAMES: [(&'static str, Covers); 2] = [("all", Covers::All), ("part", Covers::Part)];
}

/// Reads `[simulation]`.
pub(super) fn simulation(node: &Node<'_>) -> Option<Simulation> {
    let path = optional(node, "path", Field::text);
    let time = optional(node, "time", Field::text);
    let time_unit = optional(node, "time_unit", |field| field.one_of(&TimeUnit::NAMES));
    let step_s = optional(node, "step_s", positive);
    let clock = optional(node, "clock", |field| field.one_of(&Clock::NAMES));
    let covers = optional(node, "covers", |field| field.one_of(&Covers::NAMES));
    let table = match path? {
        Some(path) => {
            rows_have_times(node)?;
            Some(Source {
                path: PathBuf::from(path),
                time: time?,
                time_unit: time_unit?,
                step_s: step_s?,
                ..Source::default()
            })
        }
        None if time?.is_some() => {
            return node.problem_at("path", "missing; expected the path of its table, as time is given");
        }
        None => None,
    };
    let clock = clock?.unwrap_or_default();
    if clock == Clock::Unknown && table.is_none() {
        return node.problem_at(
            "clock",
            "found \"unknown\" without a table; expected also path and time, as columns of one table have one clock",
        );
    }
    Some(Simulation { table, clock, covers: covers?.unwrap_or_default() })
}
