//! Everything in a case on which an effect may depend, on the recording's grid, without holes.
use std::borrow::Cow;

use schuler_recording::Recording;

/// The recorded and derived quantities of a case.
pub struct Inputs<'r> {
    /// The recording.
    pub recording: &'r Recording,
    /// Time from the first row, s, by the grid.
    pub time_s: Vec<f64>,
}

/// A quantity under which record and simulation may differ: temperature, its rate, specific force, attitude ….
#[derive(Clone, Debug)]
pub struct Condition<'i> {
    /// What it is, to stand in a sentence: "temperature temp_x", "specific force along z".
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its values, one a row, without holes.
    pub values: Cow<'i, [f64]>,
}

impl<'r> Inputs<'r> {
    /// The inputs of a case.
    pub fn of(recording: &'r Recording) -> Self {
        Self { recording, time_s: recording.elapsed_s().collect() }
    }

    /// The quantities by which the search for the place of a mismatch sorts the record.
    pub fn conditions(&self) -> Vec<Condition<'_>> {
        Vec::new()
    }
}
