//! Noise of a series: autocorrelation, the published fits, Allan deviation; noise of every sensor of a recording.
use host_sim::identify as host;
use host_sim::identify::autocorrelation::Centre;
use host_sim::output::Interrupted;
use numpy::PyArray1;
use pyo3::prelude::*;
use schuler_core::identification as core;
use schuler_core::identification::EXPONENTIAL_FLOOR;
use schuler_explain::watch::Watch;
use schuler_recording::{Error, Problem};

use crate::answer::python_of;
use crate::case::{Given, unusable};
use crate::input::{array1, vector, wrong};
use crate::watched::watched;

/// An autocorrelation.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct Autocorrelation {
    /// R_j, in the square of the unit of the series, NaN for a lag without a pair; shape (lags,).
    covariance: Py<PyArray1<f64>>,
    /// Pairs of values behind each; shape (lags,).
    pairs: Py<PyArray1<u64>>,
}

/// The autocorrelation R_j = (1/n_j) Σ x_i x_(i−j) of a series, any unit, shape (n,), NaN = missing, for lags 0 to
/// last_lag; n_j are the pairs in which both are there. remove_mean: about the sample mean instead of zero.
#[pyfunction]
#[pyo3(signature = (values, last_lag, *, remove_mean=false))]
pub(crate) fn autocorrelation(
    py: Python<'_>,
    values: &Bound<'_, PyAny>,
    last_lag: usize,
    remove_mean: bool,
) -> PyResult<Autocorrelation> {
    let values = finite_or_missing(vector("values", values)?);
    let centre = if remove_mean { Centre::Mean } else { Centre::Zero };
    let found = py.detach(|| host::autocorrelation::autocorrelation(&values, last_lag, centre));
    Ok(Autocorrelation {
        covariance: array1(py, found.values),
        pairs: array1(py, found.pairs.into_iter().map(|pairs| pairs as u64).collect()),
    })
}

/// R(t) = variance exp(−alpha|t|).
#[pyclass(module = "schuler", frozen, get_all)]
#[derive(Clone, Copy)]
pub(crate) struct Exponential {
    /// R₀, in the square of the unit of the series.
    variance: f64,
    /// α, 1/s; the correlation time is its inverse.
    alpha: f64,
    /// Lags used.
    lags: u32,
}

#[pymethods]
impl Exponential {
    fn __repr__(&self) -> String {
        format!("Exponential(variance={:?}, alpha={:?}, lags={})", self.variance, self.alpha, self.lags)
    }
}

impl From<core::Exponential<f64>> for Exponential {
    fn from(fit: core::Exponential<f64>) -> Self {
        Self { variance: fit.variance, alpha: fit.alpha, lags: fit.lags }
    }
}

/// R(t) = variance exp(−alpha|t|) cos(beta t).
#[pyclass(module = "schuler", frozen, get_all)]
#[derive(Clone, Copy)]
pub(crate) struct ExponentialCosine {
    /// R₀, in the square of the unit of the series.
    variance: f64,
    /// α, 1/s.
    alpha: f64,
    /// β, rad/s.
    beta: f64,
    /// Time of the first zero crossing, s.
    crossing_s: f64,
    /// First lag at or below zero.
    crossing_lag: u32,
    /// Lags used for α.
    lags: u32,
}

#[pymethods]
impl ExponentialCosine {
    fn __repr__(&self) -> String {
        let Self { variance, alpha, beta, crossing_s, crossing_lag, lags } = self;
        format!(
            "ExponentialCosine(variance={variance:?}, alpha={alpha:?}, beta={beta:?}, crossing_s={crossing_s:?}, \
             crossing_lag={crossing_lag}, lags={lags})"
        )
    }
}

impl From<core::ExponentialCosine<f64>> for ExponentialCosine {
    fn from(fit: core::ExponentialCosine<f64>) -> Self {
        let core::ExponentialCosine { variance, alpha, beta, crossing_s, crossing_lag, lags } = fit;
        Self { variance, alpha, beta, crossing_s, crossing_lag, lags }
    }
}

/// Which of the two structures an autocorrelation shows.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct NoiseStructure {
    /// "none", "exponential" or "exponential_cosine".
    kind: &'static str,
    /// The exponential fit, unless the kind is "none".
    exponential: Option<Exponential>,
    /// The exponential-cosine fit where that is the kind.
    exponential_cosine: Option<ExponentialCosine>,
    /// Mean squared misfit F₁ of the exponential where the other is the kind.
    exponential_misfit: Option<f64>,
    /// Mean squared misfit F₂ of the exponential-cosine.
    exponential_cosine_misfit: Option<f64>,
    /// Depth of the dip below zero, in units of √(τ/T).
    depth: Option<f64>,
}

#[pymethods]
impl NoiseStructure {
    fn __repr__(&self) -> String {
        format!("NoiseStructure(kind={:?})", self.kind)
    }
}

// The default stands as a number for Python's signature.
const _: () = assert!(EXPONENTIAL_FLOOR == 0.5, "the default of fit_exponential");

/// The exponential fit [FIL-15] of an autocorrelation, shape (lags,), whose lags are spacing_s seconds apart, over the
/// first run of correlations above floor; None where nothing decays.
#[pyfunction]
#[pyo3(signature = (covariance, spacing_s, *, floor=0.5))]
pub(crate) fn fit_exponential(
    covariance: &Bound<'_, PyAny>,
    spacing_s: f64,
    floor: f64,
) -> PyResult<Option<Exponential>> {
    let covariance = vector("covariance", covariance)?;
    check_positive("spacing_s", spacing_s)?;
    if !(0.0..1.0).contains(&floor) {
        return Err(wrong(format!("floor: found {floor}; expected a correlation from 0 to below 1")));
    }
    Ok(core::fit_exponential(&covariance, spacing_s, floor).map(Into::into))
}

/// The exponential-cosine fit [FIL-21] of an autocorrelation, shape (lags,), whose lags are spacing_s seconds apart;
/// None where it never crosses zero.
#[pyfunction]
pub(crate) fn fit_exponential_cosine(
    covariance: &Bound<'_, PyAny>,
    spacing_s: f64,
) -> PyResult<Option<ExponentialCosine>> {
    let covariance = vector("covariance", covariance)?;
    check_positive("spacing_s", spacing_s)?;
    Ok(core::fit_exponential_cosine(&covariance, spacing_s).map(Into::into))
}

/// The structure [FIL-18] that an autocorrelation, shape (lags,), of a record of duration_s seconds shows.
#[pyfunction]
pub(crate) fn choose_structure(
    covariance: &Bound<'_, PyAny>,
    spacing_s: f64,
    duration_s: f64,
) -> PyResult<NoiseStructure> {
    let covariance = vector("covariance", covariance)?;
    check_positive("spacing_s", spacing_s)?;
    check_positive("duration_s", duration_s)?;
    let none = NoiseStructure {
        kind: "none",
        exponential: None,
        exponential_cosine: None,
        exponential_misfit: None,
        exponential_cosine_misfit: None,
        depth: None,
    };
    Ok(match core::choose_structure(&covariance, spacing_s, duration_s) {
        core::Structure::None => none,
        core::Structure::Exponential(fit) => {
            NoiseStructure { kind: "exponential", exponential: Some(fit.into()), ..none }
        }
        core::Structure::ExponentialCosine(cosine, exponential, comparison) => NoiseStructure {
            kind: "exponential_cosine",
            exponential: Some(exponential.into()),
            exponential_cosine: Some(cosine.into()),
            exponential_misfit: Some(comparison.exponential),
            exponential_cosine_misfit: Some(comparison.exponential_cosine),
            depth: Some(comparison.depth),
        },
    })
}

/// The overlapping Allan deviation.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct AllanDeviation {
    /// Averaging times, s; shape (m,).
    tau_s: Py<PyArray1<f64>>,
    /// Deviations, in the unit of the series; shape (m,).
    deviation: Py<PyArray1<f64>>,
    /// Lower bounds of the 1-σ intervals; shape (m,).
    lower: Py<PyArray1<f64>>,
    /// Upper bounds; shape (m,).
    upper: Py<PyArray1<f64>>,
    /// Differences averaged; shape (m,).
    terms: Py<PyArray1<u64>>,
}

/// The overlapping Allan deviation of a series, any unit, shape (n,), NaN = missing, with a value every step_s seconds, at
/// ten averaging times a decade and all octaves.
#[pyfunction]
pub(crate) fn allan_deviation(
    py: Python<'_>,
    values: &Bound<'_, PyAny>,
    step_s: f64,
) -> PyResult<AllanDeviation> {
    let values = finite_or_missing(vector("values", values)?);
    check_positive("step_s", step_s)?;
    let points = py.detach(|| host::allan::overlapping_allan(&values, step_s));
    Ok(AllanDeviation {
        tau_s: array1(py, points.iter().map(|it| it.tau_s).collect()),
        deviation: array1(py, points.iter().map(|it| it.deviation).collect()),
        lower: array1(py, points.iter().map(|it| it.lower).collect()),
        upper: array1(py, points.iter().map(|it| it.upper).collect()),
        terms: array1(py, points.iter().map(|it| it.terms as u64).collect()),
    })
}

/// The noise of each sensor of a recording: the document of `schuler identify --json`.
///
/// case: path of a case file, or a dictionary of what would stand there. recording: path of a table instead of the case's,
/// or a dictionary of arrays of shape (n,) by column, in the units that the case says. longest_lag: steps.
///
/// Raises ValueError with file, line, field and expectation, KeyboardInterrupt within seconds of Ctrl-C.
#[pyfunction]
#[pyo3(signature = (case, recording=None, *, longest_lag=1000))]
pub(crate) fn identify(
    py: Python<'_>,
    case: &Bound<'_, PyAny>,
    recording: Option<&Bound<'_, PyAny>>,
    longest_lag: usize,
) -> PyResult<Py<PyAny>> {
    let given = Given::new(case, recording)?;
    let path = given.path();
    let found = watched(py, None, |watch| {
        let recording = given.read()?;
        host::identify_watched(&recording, host::Options { longest_lag }, |_| {
            if watch.is_cancelled() { Err(Interrupted) } else { Ok(()) }
        })
        .map_err(|stopped| Error::one(&path, Problem::of_file(stopped.to_string())))
    })?;
    let found = found.map_err(|error| unusable(&error))?;
    python_of(py, &found)
}

/// Infinite values are missing, as they are in recordings.
fn finite_or_missing(mut values: Vec<f64>) -> Vec<f64> {
    for value in values.iter_mut().filter(|value| value.is_infinite()) {
        *value = f64::NAN;
    }
    values
}

fn check_positive(name: &str, value: f64) -> PyResult<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(wrong(format!("{name}: found {value}; expected a finite number greater than zero")))
    }
}
