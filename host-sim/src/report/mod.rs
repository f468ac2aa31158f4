//! An explanation as people read it: sentences for the terminal, figures, and one HTML page that needs no network.
//!
//! | module | makes |
//! | --- | --- |
//! | `number` | values with their uncertainty, units, times |
//! | `words` | the sentences |
//! | `told` | the paragraph above all, noise, and what could still hide |
//! | `page` | the page |
//! | `lead` | its first screen |
//! | `folded` | what is folded below |
//! | `charts` | what the page's plots show, thinned |
//! | `thin` | long series with the same outline and few points |
//! | `figures` | the same as figures in files |
mod charts;
mod figures;
mod folded;
mod lead;
mod number;
mod page;
mod thin;
mod told;
mod words;

use std::path::Path;

use schuler_explain::config::Config;
use schuler_explain::diagnostics::{CaseEvidence, evidence};
use schuler_explain::explain as engine;
use schuler_explain::explanation::Explanation;
use schuler_explain::export::model::Model;
use schuler_explain::watch::Watch;
use schuler_recording::Recording;

use crate::plot::Figure;

/// An explanation with what shows that it holds.
#[derive(Clone, Debug)]
pub struct Report {
    /// Title of the case.
    pub title: String,
    /// What was explained.
    pub recorded: Recorded,
    /// The answer.
    pub explanation: Explanation,
    /// What shows that it holds.
    pub evidence: CaseEvidence,
}

/// What was explained.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// The case file.
    pub case: String,
    /// Rows, those put in for missing steps included.
    pub rows: usize,
    /// Rows put in for missing steps.
    pub rows_in_gaps: usize,
    /// Nominal step, s.
    pub step_s: f64,
    /// From the first row to the end of the last, s.
    pub length_s: f64,
    /// Names of the sensors.
    pub sensors: Vec<String>,
}

impl Recorded {
    /// Of a recording that was read from the case file `case`.
    pub fn of(recording: &Recording, case: &str) -> Self {
        let last_s = recording.elapsed_s().last().unwrap_or_default();
        Self {
            case: case.to_owned(),
            rows: recording.len(),
            rows_in_gaps: recording.inserted.iter().filter(|inserted| **inserted).count(),
            step_s: recording.step_s,
            length_s: last_s + recording.step_s,
            sensors: recording.sensors.iter().map(|series| series.sensor.id.clone()).collect(),
        }
    }
}

impl Report {
    /// Explains a recording of the case file `case`; with the model of what was found.
    ///
    /// # Errors
    /// A recording that cannot be explained, or the work was ended.
    pub fn explained(
        recording: &Recording,
        case: &Path,
        config: &Config,
        progress: &dyn Watch,
    ) -> Result<(Self, Model), engine::Error> {
        let (explanation, mut arrays) = engine::explain_watched(recording, config, progress)?;
        let model = std::mem::take(&mut arrays.model);
        let report = Self {
            title: recording.case.title.clone(),
            recorded: Recorded::of(recording, &case.display().to_string()),
            explanation,
            evidence: evidence(arrays),
        };
        Ok((report, model))
    }

    /// The summary for the terminal.
    pub fn text(&self) -> String {
        words::text(self)
    }

    /// What was found, a sentence each.
    pub fn sentences(&self) -> Vec<String> {
        let findings = self.explanation.findings.iter();
        findings.map(|finding| words::finding(finding, self.recorded.length_s)).collect()
    }

    /// The largest effects that could still hide, for the terminal.
    pub fn certificate(&self) -> String {
        words::certificate(self)
    }

    /// One HTML page that needs nothing beside it.
    pub fn html(&self) -> String {
        page::html(self)
    }

    /// Figures with the names of their files.
    pub fn figures(&self) -> Vec<(String, Figure)> {
        figures::all(self)
    }
}
