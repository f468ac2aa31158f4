//! The velocity channel of the flight module: the error filter with the identification that retunes it.
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use schuler_core::identification::{ChannelStatus, IdentificationConfig, Method, NoiseEstimate};
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput, StepOutput};
use schuler_core::reading::Reading;

use crate::filter::FilterConfig;
use crate::input::{array1, array2, misconfigured, vector, wrong};

/// What the adaptive filter says of a whole series.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct AdaptiveRun {
    /// The main filter's estimates of ΔV (m/s), δ (rad), a (m/s²), ω (rad/s); shape (n, 4).
    estimate: Py<PyArray2<f32>>,
    /// Their standard deviations; shape (n, 4).
    sigma: Py<PyArray2<f32>>,
    /// The estimates to navigate by, averaged over what is not known of the noise; shape (n, 4).
    averaged: Py<PyArray2<f32>>,
    /// Their standard deviations, the uncertainty of the noise included; shape (n, 4).
    averaged_sigma: Py<PyArray2<f32>>,
    /// Innovation, m/s, shape (n,); NaN where there was no measurement.
    innovation: Py<PyArray1<f32>>,
    /// Its variance, (m/s)²; shape (n,).
    innovation_variance: Py<PyArray1<f32>>,
    /// Accelerometer noise in use: σ (m/s²), α (1/s), β (rad/s, 0 for first order); shape (n, 3).
    accelerometer_noise: Py<PyArray2<f32>>,
    /// Gyro noise in use: σ (rad/s), α (1/s), β (rad/s); shape (n, 3).
    gyro_noise: Py<PyArray2<f32>>,
    /// How well the accelerometer's parameters are known: numbers of ChannelStatus; shape (n,).
    accelerometer_status: Py<PyArray1<u8>>,
    /// The same of the gyro; shape (n,).
    gyro_status: Py<PyArray1<u8>>,
    /// The measurement was beyond the gate and was not used; shape (n,).
    gated: Py<PyArray1<bool>>,
    /// The filter was retuned after this step; shape (n,).
    retuned: Py<PyArray1<bool>>,
}

/// The velocity channel of the flight module, in its own single precision: the error filter, and the identification that
/// finds out how noisy the sensors are and retunes it.
///
/// config: what the data sheet says. method: "likelihood", "published" (for comparison; it does not converge) or "off".
/// first_s, interval_s: time to the first identification and between identifications, s. limit_factor: how far a
/// parameter may lie from the data sheet, as a factor. prior_width: 1 σ of ln(parameter) about the data sheet.
/// velocity_range: velocity errors beyond it are not used, m/s.
#[pyclass(module = "schuler")]
pub(crate) struct AdaptiveFilter {
    module: Box<FlightModule>,
    step_ms: f64,
    steps: u64,
}

#[pymethods]
impl AdaptiveFilter {
    #[new]
    #[pyo3(signature = (config, *, method="likelihood", first_s=9600.0, interval_s=5400.0, limit_factor=1000.0,
        prior_width=2.3, velocity_range=1000.0))]
    fn new(
        config: &Bound<'_, FilterConfig>,
        method: &str,
        first_s: f32,
        interval_s: f32,
        limit_factor: f32,
        prior_width: f32,
        velocity_range: f32,
    ) -> PyResult<Self> {
        let method = match method {
            "likelihood" => Method::Likelihood,
            "published" => Method::Published,
            "off" => Method::Off,
            other => {
                let expected = "expected \"likelihood\", \"published\" or \"off\"";
                return Err(wrong(format!("method: found {other:?}; {expected}")));
            }
        };
        let filter = config.get().of::<f32>();
        let identification = IdentificationConfig { method, first_s, interval_s, limit_factor, prior_width };
        let config = ModuleConfig { filter, identification, velocity_range, ..ModuleConfig::default() };
        let mut module = Box::new(FlightModule::new());
        module.configure(&config).map_err(misconfigured)?;
        Ok(Self { module, step_ms: f64::from(filter.step_s) * 1000.0, steps: 0 })
    }

    /// Take as many steps as there are values; the state goes on from where it was.
    ///
    /// velocity_error: m/s, shape (n,); NaN, an infinity or a masked value is no measurement.
    fn run(&mut self, py: Python<'_>, velocity_error: &Bound<'_, PyAny>) -> PyResult<AdaptiveRun> {
        let measured = vector("velocity_error", velocity_error)?;
        let outputs: Vec<StepOutput> =
            py.detach(|| measured.into_iter().map(|velocity| self.step(velocity as f32)).collect());
        let channel = |noise: fn(&StepOutput) -> NoiseEstimate| {
            let rows = outputs.iter().map(noise);
            array2(py, rows.map(|it| [it.noise.sigma, it.noise.alpha, it.noise.beta]).collect())
        };
        let status = |noise: fn(&StepOutput) -> NoiseEstimate| {
            array1(py, outputs.iter().map(|output| code(noise(output).status)).collect())
        };
        let has =
            |flag: Status| array1(py, outputs.iter().map(|output| output.status.contains(flag)).collect());
        let (accelerometer, gyro) = (
            (|output| output.identification.accelerometer) as fn(&StepOutput) -> NoiseEstimate,
            (|output| output.identification.gyro) as fn(&StepOutput) -> NoiseEstimate,
        );
        let missing = |value: f32, output: &StepOutput| {
            if output.status.intersects(UNMEASURED) { f32::NAN } else { value }
        };
        Ok(AdaptiveRun {
            estimate: array2(py, outputs.iter().map(|it| it.filter.estimate).collect())?,
            sigma: array2(py, outputs.iter().map(|it| it.filter.sigma).collect())?,
            averaged: array2(py, outputs.iter().map(|it| it.identification.averaged.estimate).collect())?,
            averaged_sigma: array2(py, outputs.iter().map(|it| it.identification.averaged.sigma).collect())?,
            innovation: array1(py, outputs.iter().map(|it| missing(it.filter.innovation, it)).collect()),
            innovation_variance: array1(py, outputs.iter().map(|it| it.filter.innovation_variance).collect()),
            accelerometer_noise: channel(accelerometer)?,
            gyro_noise: channel(gyro)?,
            accelerometer_status: status(accelerometer),
            gyro_status: status(gyro),
            gated: has(Status::INNOVATION_GATED),
            retuned: has(Status::RETUNED),
        })
    }
}

/// There was no measurement that could be used.
const UNMEASURED: Status = Status::VELOCITY_MISSING.union(Status::VELOCITY_SATURATED);

impl AdaptiveFilter {
    fn step(&mut self, velocity: f32) -> StepOutput {
        self.steps += 1;
        let time_ms = (self.steps as f64 * self.step_ms).round() as u64;
        // A value that is not finite counts as missing in the module.
        self.module.step(&StepInput {
            time_ms,
            velocity_error: Reading::good(velocity),
            ..StepInput::default()
        })
    }
}

/// The numbers of `schuler.ChannelStatus`.
fn code(status: ChannelStatus) -> u8 {
    match status {
        ChannelStatus::DataSheet => 0,
        ChannelStatus::Determined => 1,
        ChannelStatus::Weak => 2,
        ChannelStatus::Indeterminate => 3,
        ChannelStatus::Unobserved => 4,
    }
}
