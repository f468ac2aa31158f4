//! The error filter.
use nalgebra::RealField;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use schuler_core::filter::{self as core, DiscreteModel, Gaussian, Kernel};

use crate::input::{array1, array2, misconfigured, vector, wrong};

/// First-order Markov noise, R(t) = sigma² exp(−|t|/tau_s).
///
/// Raises ValueError where it is used if either is not finite and positive, or tau_s not above a third of the step.
#[pyclass(module = "schuler", frozen, get_all, eq, from_py_object)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MarkovNoise {
    /// Standard deviation σ, in the unit of the error: m/s² for the accelerometer, rad/s for the gyro.
    sigma: f64,
    /// Correlation time τ, s.
    tau_s: f64,
}

#[pymethods]
impl MarkovNoise {
    #[new]
    fn new(sigma: f64, tau_s: f64) -> Self {
        Self { sigma, tau_s }
    }

    /// What pickle and copy make it anew from.
    fn __getnewargs__(&self) -> (f64, f64) {
        (self.sigma, self.tau_s)
    }

    fn __repr__(&self) -> String {
        format!("MarkovNoise(sigma={:?}, tau_s={:?})", self.sigma, self.tau_s)
    }
}

/// The single channel and what is believed of its noise; SI units.
///
/// Raises ValueError with the first field that cannot be flown.
#[pyclass(module = "schuler", frozen, get_all, eq, from_py_object)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilterConfig {
    /// Accelerometer error, m/s².
    accelerometer: MarkovNoise,
    /// Gyro drift, rad/s.
    gyro: MarkovNoise,
    /// White noise of a measured velocity, 1 σ, m/s.
    velocity_noise: f64,
    /// Step, s.
    step_s: f64,
    /// Radius of the Earth, m.
    radius_m: f64,
    /// Gravity, m/s².
    gravity: f64,
    /// 1 σ of the velocity error at the start, m/s.
    initial_velocity_sigma: f64,
    /// 1 σ of the error of the vertical at the start, rad.
    initial_vertical_sigma: f64,
    /// An innovation beyond this many of its standard deviations is not used.
    gate_sigma: f64,
}

#[pymethods]
impl FilterConfig {
    #[new]
    #[pyo3(signature = (*, accelerometer, gyro, velocity_noise, step_s=1.0, radius_m=6_371_000.0, gravity=9.80665,
        initial_velocity_sigma=0.1, initial_vertical_sigma=1e-4, gate_sigma=6.0))]
    #[expect(clippy::too_many_arguments, reason = "named in Python")]
    fn new(
        accelerometer: MarkovNoise,
        gyro: MarkovNoise,
        velocity_noise: f64,
        step_s: f64,
        radius_m: f64,
        gravity: f64,
        initial_velocity_sigma: f64,
        initial_vertical_sigma: f64,
        gate_sigma: f64,
    ) -> PyResult<Self> {
        let config = Self {
            accelerometer,
            gyro,
            velocity_noise,
            step_s,
            radius_m,
            gravity,
            initial_velocity_sigma,
            initial_vertical_sigma,
            gate_sigma,
        };
        config.of::<f64>().validate().map_err(misconfigured)?;
        Ok(config)
    }

    /// What pickle and copy make it anew from.
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let keywords = PyDict::new(py);
        keywords.set_item("accelerometer", self.accelerometer)?;
        keywords.set_item("gyro", self.gyro)?;
        for (name, value) in [
            ("velocity_noise", self.velocity_noise),
            ("step_s", self.step_s),
            ("radius_m", self.radius_m),
            ("gravity", self.gravity),
            ("initial_velocity_sigma", self.initial_velocity_sigma),
            ("initial_vertical_sigma", self.initial_vertical_sigma),
            ("gate_sigma", self.gate_sigma),
        ] {
            keywords.set_item(name, value)?;
        }
        Ok((PyTuple::empty(py), keywords))
    }

    fn __repr__(&self) -> String {
        format!(
            "FilterConfig(accelerometer={}, gyro={}, velocity_noise={:?}, step_s={:?}, radius_m={:?}, gravity={:?}, \
             initial_velocity_sigma={:?}, initial_vertical_sigma={:?}, gate_sigma={:?})",
            self.accelerometer.__repr__(),
            self.gyro.__repr__(),
            self.velocity_noise,
            self.step_s,
            self.radius_m,
            self.gravity,
            self.initial_velocity_sigma,
            self.initial_vertical_sigma,
            self.gate_sigma
        )
    }
}

impl FilterConfig {
    /// The same in the precision of the computation.
    pub(crate) fn of<T: RealField + Copy>(&self) -> core::FilterConfig<T> {
        let noise = |noise: MarkovNoise| core::MarkovNoise {
            sigma: nalgebra::convert(noise.sigma),
            tau_s: nalgebra::convert(noise.tau_s),
        };
        core::FilterConfig {
            radius_m: nalgebra::convert(self.radius_m),
            gravity: nalgebra::convert(self.gravity),
            step_s: nalgebra::convert(self.step_s),
            accelerometer: noise(self.accelerometer),
            gyro: noise(self.gyro),
            velocity_noise: nalgebra::convert(self.velocity_noise),
            initial_velocity_sigma: nalgebra::convert(self.initial_velocity_sigma),
            initial_vertical_sigma: nalgebra::convert(self.initial_vertical_sigma),
            gate_sigma: nalgebra::convert(self.gate_sigma),
        }
    }
}

/// What one step says.
struct Row {
    estimate: [f64; 4],
    sigma: [f64; 4],
    innovation: f64,
    innovation_variance: f64,
    nis: f64,
    log_likelihood: f64,
    gated: bool,
    reacquired: bool,
    reset: bool,
}

/// What one step of the filter says.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct FilterStep {
    /// Estimate of ΔV (m/s), δ (rad), a (m/s²), ω (rad/s); shape (4,).
    estimate: Py<PyArray1<f64>>,
    /// Their standard deviations; shape (4,).
    sigma: Py<PyArray1<f64>>,
    /// Innovation ν = z − H x̂⁻, m/s; NaN where there was no measurement.
    innovation: f64,
    /// Its variance S, (m/s)².
    innovation_variance: f64,
    /// ν²/S; NaN where there was no measurement.
    nis: f64,
    /// −½(ln S + ν²/S), without −½ ln 2π; NaN where there was no measurement.
    log_likelihood: f64,
    /// The measurement was beyond the gate and was not used.
    gated: bool,
    /// So many in a row were beyond the gate that the filter started from the measurement.
    reacquired: bool,
    /// The covariance had lost its positive diagonal and was set back.
    reset: bool,
}

/// What the filter says of a whole series.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct FilterRun {
    /// Estimates of ΔV (m/s), δ (rad), a (m/s²), ω (rad/s); shape (n, 4).
    estimate: Py<PyArray2<f64>>,
    /// Their standard deviations; shape (n, 4).
    sigma: Py<PyArray2<f64>>,
    /// Innovation ν = z − H x̂⁻, m/s, shape (n,); NaN where there was no measurement.
    innovation: Py<PyArray1<f64>>,
    /// Its variance S, (m/s)²; shape (n,).
    innovation_variance: Py<PyArray1<f64>>,
    /// ν²/S, shape (n,); NaN where there was no measurement.
    nis: Py<PyArray1<f64>>,
    /// −½(ln S + ν²/S), without −½ ln 2π, shape (n,); NaN where there was no measurement.
    log_likelihood: Py<PyArray1<f64>>,
    /// The measurement was beyond the gate and was not used; shape (n,).
    gated: Py<PyArray1<bool>>,
    /// So many in a row were beyond the gate that the filter started from the measurement; shape (n,).
    reacquired: Py<PyArray1<bool>>,
    /// The covariance had lost its positive diagonal and was set back; shape (n,).
    reset: Py<PyArray1<bool>>,
}

/// A filter with its model, which the filter itself keeps to itself.
#[derive(Clone)]
struct Modelled<T: RealField + Copy> {
    filter: core::ErrorFilter<T>,
    model: DiscreteModel<T>,
}

impl<T: RealField + Copy + Into<f64>> Modelled<T> {
    fn new(config: &FilterConfig, third_order: bool) -> PyResult<Self> {
        let config = config.of::<T>();
        config.validate().map_err(misconfigured)?;
        let model = if third_order {
            DiscreteModel::third_order(&config)
        } else {
            config.model(&config.accelerometer, &config.gyro, config.step_s)
        };
        Ok(Self { filter: core::ErrorFilter::with_model(&config, model, config.prior()), model })
    }

    /// A measurement that is not finite is missing.
    fn step(&mut self, measured: f64) -> Row {
        let measurement = Some(measured).filter(|value| value.is_finite()).map(nalgebra::convert::<f64, T>);
        let step = self.filter.step(measurement);
        let output = self.filter.output(&step);
        let measured = |value: T| if measurement.is_some() { value.into() } else { f64::NAN };
        Row {
            estimate: output.estimate.map(Into::into),
            sigma: output.sigma.map(Into::into),
            innovation: measured(output.innovation),
            innovation_variance: output.innovation_variance.into(),
            nis: measured(output.nis),
            log_likelihood: measured(step.innovation.log_likelihood()),
            gated: step.gated,
            reacquired: step.reacquired,
            reset: step.reset,
        }
    }

    fn mean(&self) -> [f64; 4] {
        self.filter.state().mean().map(Into::into)
    }

    fn covariance(&self) -> [[f64; 4]; 4] {
        let Gaussian { covariance, .. } = self.filter.state();
        symmetric(covariance.map(Into::into))
    }

    fn transition(&self) -> [[f64; 4]; 4] {
        let model = &self.model;
        let [accelerometer, gyro] = model.decay.map(Into::into);
        let rows = [model.velocity, model.vertical].map(|row| row.map(Into::into));
        [rows[0], rows[1], [0.0, 0.0, accelerometer, 0.0], [0.0, 0.0, 0.0, gyro]]
    }

    fn process_noise(&self) -> [[f64; 4]; 4] {
        symmetric(self.model.noise.map(Into::into))
    }
}

/// The matrix whose upper triangle this is, row by row.
fn symmetric(triangle: [f64; 10]) -> [[f64; 4]; 4] {
    let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = triangle;
    [[vv, vd, va, vw], [vd, dd, da, dw], [va, da, aa, aw], [vw, dw, aw, ww]]
}

#[expect(clippy::large_enum_variant, reason = "there is one, on Python's heap")]
#[derive(Clone)]
enum Inner {
    Double(Modelled<f64>),
    Single(Modelled<f32>),
}

/// Calls a method of either.
macro_rules! either {
    ($inner:expr, $it:ident => $call:expr) => {
        match $inner {
            Inner::Double($it) => $call,
            Inner::Single($it) => $call,
        }
    };
}

/// The error filter of the flight module: velocity error, error of the vertical, accelerometer error and gyro drift from
/// measured velocity errors.
///
/// precision: "double", or "single" as it flies. discretisation: "exact", or "third_order" as the golden numbers have
/// it. An object is for one thread at a time: a second one gets a RuntimeError. A copy goes on by itself from where the filter was.
#[pyclass(module = "schuler")]
#[derive(Clone)]
pub(crate) struct ErrorFilter {
    inner: Inner,
}

#[pymethods]
impl ErrorFilter {
    #[new]
    #[pyo3(signature = (config, *, precision="double", discretisation="exact"))]
    fn new(config: &Bound<'_, FilterConfig>, precision: &str, discretisation: &str) -> PyResult<Self> {
        let third_order = match discretisation {
            "exact" => false,
            "third_order" => true,
            other => {
                let expected = "expected \"exact\" or \"third_order\"";
                return Err(wrong(format!("discretisation: found {other:?}; {expected}")));
            }
        };
        let inner = match precision {
            "double" => Inner::Double(Modelled::new(config.get(), third_order)?),
            "single" => Inner::Single(Modelled::new(config.get(), third_order)?),
            other => {
                return Err(wrong(format!("precision: found {other:?}; expected \"double\" or \"single\"")));
            }
        };
        Ok(Self { inner })
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    /// Predict one step, then correct by a measured velocity error, m/s; None, NaN or an infinity is none.
    #[pyo3(signature = (velocity_error=None))]
    fn step(&mut self, py: Python<'_>, velocity_error: Option<f64>) -> FilterStep {
        let row = either!(&mut self.inner, it => it.step(velocity_error.unwrap_or(f64::NAN)));
        FilterStep {
            estimate: array1(py, row.estimate.to_vec()),
            sigma: array1(py, row.sigma.to_vec()),
            innovation: row.innovation,
            innovation_variance: row.innovation_variance,
            nis: row.nis,
            log_likelihood: row.log_likelihood,
            gated: row.gated,
            reacquired: row.reacquired,
            reset: row.reset,
        }
    }

    /// Take as many steps as there are values; the state goes on from where it was.
    ///
    /// velocity_error: m/s, shape (n,); NaN, an infinity or a masked value is no measurement.
    fn run(&mut self, py: Python<'_>, velocity_error: &Bound<'_, PyAny>) -> PyResult<FilterRun> {
        let measured = vector("velocity_error", velocity_error)?;
        let inner = &mut self.inner;
        let rows: Vec<Row> = py.detach(
            || either!(inner, it => measured.into_iter().map(|velocity| it.step(velocity)).collect()),
        );
        Ok(FilterRun {
            estimate: array2(py, rows.iter().map(|row| row.estimate).collect())?,
            sigma: array2(py, rows.iter().map(|row| row.sigma).collect())?,
            innovation: array1(py, rows.iter().map(|row| row.innovation).collect()),
            innovation_variance: array1(py, rows.iter().map(|row| row.innovation_variance).collect()),
            nis: array1(py, rows.iter().map(|row| row.nis).collect()),
            log_likelihood: array1(py, rows.iter().map(|row| row.log_likelihood).collect()),
            gated: array1(py, rows.iter().map(|row| row.gated).collect()),
            reacquired: array1(py, rows.iter().map(|row| row.reacquired).collect()),
            reset: array1(py, rows.iter().map(|row| row.reset).collect()),
        })
    }

    /// The present estimate of ΔV (m/s), δ (rad), a (m/s²), ω (rad/s); shape (4,).
    #[getter]
    fn mean(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        array1(py, either!(&self.inner, it => it.mean()).to_vec())
    }

    /// The present covariance P of these; shape (4, 4).
    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        array2(py, either!(&self.inner, it => it.covariance()).to_vec())
    }

    /// The transition matrix Φ of one step; shape (4, 4).
    #[getter]
    fn transition(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        array2(py, either!(&self.inner, it => it.transition()).to_vec())
    }

    /// The process noise Q of one step; shape (4, 4).
    #[getter]
    fn process_noise(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        array2(py, either!(&self.inner, it => it.process_noise()).to_vec())
    }
}
