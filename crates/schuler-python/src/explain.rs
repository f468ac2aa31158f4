//! `explain`, and what an explanation can do.
use std::path::PathBuf;

use host_sim::exported;
use host_sim::plot::{DrawError, Figure};
use host_sim::report::Report;
use numpy::PyArray1;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::export::model::Model;
use schuler_recording::Recording;

use crate::answer::python_of;
use crate::case::{Given, unusable};
use crate::input::{array1, wrong};
use crate::watched::watched;

/// A column by its name.
type Column = (String, Py<PyArray1<f64>>);

/// An explanation with what shows that it holds.
#[pyclass(frozen, module = "schuler._schuler")]
pub(crate) struct Explained {
    report: Report,
    model: Model,
    time: (String, Vec<f64>),
    simulated: Vec<(String, Vec<f64>)>,
}

#[pymethods]
impl Explained {
    /// The document of `schuler explain --json`.
    fn document(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        python_of(py, &self.report.explanation)
    }

    /// What the command prints.
    fn text(&self) -> String {
        self.report.text()
    }

    /// The page of `schuler explain --report`.
    fn html(&self) -> String {
        self.report.html()
    }

    /// Figures as SVG, by name.
    fn figures(&self) -> PyResult<Vec<(String, String)>> {
        let svg =
            |(name, figure): (String, Figure)| Ok((name, figure.to_svg().map_err(|error| undrawn(&error))?));
        self.report.figures().into_iter().map(svg).collect()
    }

    /// A figure as PNG.
    fn png(&self, name: &str) -> PyResult<Vec<u8>> {
        let mut figures = self.report.figures().into_iter();
        let (_, figure) =
            figures.find(|(known, _)| known == name).ok_or_else(|| wrong(format!("name: found {name:?}")))?;
        figure.to_png().map_err(|error| undrawn(&error))
    }

    /// Write what was found as a model: .json, .py, .c or .rs; gives the files.
    fn export(&self, py: Python<'_>, path: PathBuf) -> PyResult<Vec<PathBuf>> {
        py.detach(|| {
            let paths = [path];
            exported::check(&paths).and_then(|()| exported::write(&self.model, &paths))
        })
        .map_err(|error| unusable(&error))
    }

    /// What the user of the model should be told.
    fn cautions(&self) -> Vec<String> {
        self.model.cautions()
    }

    /// Time and, by sensor, the simulation with what was found, at the recorded rows, in the units of the case.
    fn simulated(&self, py: Python<'_>) -> (Column, Vec<Column>) {
        let column = |(name, values): &(String, Vec<f64>)| (name.clone(), array1(py, values.clone()));
        (column(&self.time), self.simulated.iter().map(column).collect())
    }
}

fn undrawn(error: &DrawError) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// Explain why a recording does not look like its simulation.
///
/// case: path of a case file, or a dictionary of what would stand there. recording: path of a table instead of the case's,
/// or a dictionary of arrays of shape (n,) by column, in the units that the case says; NaN is missing. simulation: the same for the table
/// of the case's simulation. probability: posterior
/// probability from which on a finding is told, 0 to 1. hold_out: whether the description is judged on blocks held out. progress: called with the
/// phase and the part of it that is done, 0 to 1; what it raises ends the work.
///
/// Raises ValueError with file, line, field and expectation, KeyboardInterrupt within a moment of Ctrl-C.
#[pyfunction]
#[pyo3(signature = (case, recording=None, simulation=None, *, probability=0.95, hold_out=true, progress=None))]
pub(crate) fn explain(
    case: &Bound<'_, PyAny>,
    recording: Option<&Bound<'_, PyAny>>,
    simulation: Option<&Bound<'_, PyAny>>,
    probability: f64,
    hold_out: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Explained> {
    let given = Given::new(case, recording)?.beside(simulation)?;
    let (path, options) = (given.path(), Config { told_at: probability, hold_out, ..Config::default() });
    watched(case.py(), progress, |watch| {
        let recording = given.read()?;
        let (report, model) = Report::explained(&recording, &path, &options, watch)
            .map_err(|error| schuler_recording::Error::one(&path, error.problem()))?;
        let simulated = simulated(&recording, &report, &model);
        let time_s = recorded(&recording, &recording.time_s);
        let time = (recording.case.recording.time_name().to_owned(), time_s);
        Ok(Explained { report, model, time, simulated })
    })?
    .map_err(|error| unusable(&error))
}

/// By the column of each sensor that is simulated: what the simulation says of it with what was found.
fn simulated(recording: &Recording, report: &Report, model: &Model) -> Vec<(String, Vec<f64>)> {
    let of_sensor = |series: &schuler_recording::recording::SensorSeries| {
        let id = &series.sensor.id;
        let evidence = report.evidence.sensors.iter().find(|it| it.sensor == *id);
        let nominal = match (&series.predicted, evidence) {
            (Some(predicted), _) => predicted.clone(),
            (None, Some(evidence)) => series
                .values
                .iter()
                .zip(&evidence.residual)
                .map(|(value, residual)| value - residual)
                .collect(),
            // Sensors that only check each other are not simulated.
            (None, None) => return None,
        };
        let is_output = model.outputs.iter().any(|output| output.sensor == *id);
        let added = if is_output {
            model.added(id)
        } else {
            // What enters a loop is seen through the loop.
            evidence.map(|it| it.explained.clone()).unwrap_or_default()
        };
        let added = added.into_iter().chain(std::iter::repeat(0.0));
        let in_unit = |(nominal, added): (f64, f64)| (nominal + added) / series.written_unit.in_si();
        let whole: Vec<f64> = nominal.into_iter().zip(added).map(in_unit).collect();
        Some((series.sensor.column.clone(), recorded(recording, &whole)))
    };
    recording.sensors.iter().filter_map(of_sensor).collect()
}

/// The values of the rows that were recorded.
fn recorded(recording: &Recording, values: &[f64]) -> Vec<f64> {
    let rows = values.iter().zip(&recording.inserted);
    rows.filter(|(_, inserted)| !**inserted).map(|(value, _)| *value).collect()
}
