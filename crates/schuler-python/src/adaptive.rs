//! The velocity channel of the flight module: the error filter with the identification that retunes it.
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use schuler_core::health::{self, HealthConfig, MemoryModel};
use schuler_core::identification::{ChannelStatus, IdentificationConfig, Method, NoiseEstimate};
use schuler_core::module::{FlightModule, ModuleConfig, RadioUse, Status, StepInput, StepOutput};
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
    /// Where they come from: 0 the filter, 1 the wide bank, 2 the narrow bank; shape (n,).
    averaged_source: Py<PyArray1<u8>>,
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
    /// What the health monitor holds the radio for: numbers of HealthVerdict; shape (n,), 0 while it is off.
    health_verdict: Py<PyArray1<u8>>,
    /// Probability that the radio is faulty; shape (n,).
    p_fault: Py<PyArray1<f32>>,
    /// The measurement could have been used and was not, as the radio is held faulty; shape (n,).
    withheld: Py<PyArray1<bool>>,
}

/// The velocity channel of the flight module, in its own single precision: the error filter, and the identification that
/// finds out how noisy the sensors are and retunes it.
///
/// config: what the data sheet says. method: "likelihood", "published" (for comparison; it does not converge) or "off".
/// first_s, interval_s: time to the first identification and between identifications, s. limit_factor: how far a
/// parameter may lie from the data sheet, as a factor. prior_width: 1 σ of ln(parameter) about the data sheet.
/// velocity_range: velocity errors beyond it are not used, m/s.
#[pyclass(module = "schuler")]
#[derive(Clone)]
pub(crate) struct AdaptiveFilter {
    module: Box<FlightModule>,
    config: ModuleConfig,
    step_ms: f64,
    steps: u64,
}

#[pymethods]
impl AdaptiveFilter {
    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

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
        Ok(Self { module, config, step_ms: f64::from(filter.step_s) * 1000.0, steps: 0 })
    }

    /// Turn the health monitor on, with a Doppler radio's defaults, and start anew.
    ///
    /// withhold_above: probability of a fault above which the radio's measurement is withheld from the filter; below it
    /// counts for one less that probability. None: the monitor is told and used by nothing. at_most_s: after so long
    /// without pause it is used all the same, s. repeat: probability that a reading of a radio that works repeats the
    /// one before. The velocities are arguments of run.
    #[pyo3(signature = (*, withhold_above=0.5, at_most_s=1200.0, repeat=0.05))]
    fn watch_radio(&mut self, withhold_above: Option<f32>, at_most_s: f32, repeat: f32) -> PyResult<()> {
        let mut health = HealthConfig::doppler_against_inertial();
        let [[_, fail], [recover, _]] = health.radio.transition;
        health.step_s = self.config.filter.step_s;
        health.memory = Some(MemoryModel { repeat, fail, recover });
        let radio_use = withhold_above.map(|withhold_above| RadioUse { withhold_above, at_most_s });
        let config = ModuleConfig { health: Some(health), radio_use, ..self.config };
        let mut module = Box::new(FlightModule::new());
        module.configure(&config).map_err(misconfigured)?;
        (self.module, self.config, self.steps) = (module, config, 0);
        Ok(())
    }

    /// Take as many steps as there are values; the state goes on from where it was.
    ///
    /// velocity_error: m/s, shape (n,); NaN, an infinity or a masked value is no measurement. radio_velocity,
    /// inertial_velocity: what the health monitor compares, m/s, shape (n,); both or neither.
    #[pyo3(signature = (velocity_error, radio_velocity=None, inertial_velocity=None))]
    fn run(
        &mut self,
        py: Python<'_>,
        velocity_error: &Bound<'_, PyAny>,
        radio_velocity: Option<&Bound<'_, PyAny>>,
        inertial_velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<AdaptiveRun> {
        let measured = vector("velocity_error", velocity_error)?;
        let radio = self.beside("radio_velocity", radio_velocity, measured.len())?;
        let inertial = self.beside("inertial_velocity", inertial_velocity, measured.len())?;
        let rows = measured.into_iter().zip(radio.into_iter().zip(inertial));
        let outputs: Vec<StepOutput> = py.detach(|| {
            rows.map(|(velocity, (radio, inertial))| self.step(velocity, radio, inertial)).collect()
        });
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
            averaged_source: array1(
                py,
                outputs.iter().map(|it| it.identification.averaged.source as u8).collect(),
            ),
            innovation: array1(py, outputs.iter().map(|it| missing(it.filter.innovation, it)).collect()),
            innovation_variance: array1(py, outputs.iter().map(|it| it.filter.innovation_variance).collect()),
            accelerometer_noise: channel(accelerometer)?,
            gyro_noise: channel(gyro)?,
            accelerometer_status: status(accelerometer),
            gyro_status: status(gyro),
            gated: has(Status::INNOVATION_GATED),
            retuned: has(Status::RETUNED),
            health_verdict: array1(py, outputs.iter().map(|it| verdict(it.health.verdict)).collect()),
            p_fault: array1(py, outputs.iter().map(|it| it.health.p_fault).collect()),
            withheld: has(Status::VELOCITY_WITHHELD),
        })
    }
}

/// There was no measurement that could be used.
const UNMEASURED: Status = Status::VELOCITY_MISSING.union(Status::VELOCITY_SATURATED);

impl AdaptiveFilter {
    /// A velocity for the health monitor as long as the measurements; missing readings where there is none.
    fn beside(&self, name: &str, values: Option<&Bound<'_, PyAny>>, length: usize) -> PyResult<Vec<f64>> {
        let Some(values) = values else { return Ok(vec![f64::NAN; length]) };
        if self.config.health.is_none() {
            return Err(wrong(format!(
                "{name}: the health monitor is off; expected a call of watch_radio before"
            )));
        }
        let values = vector(name, values)?;
        if values.len() == length {
            return Ok(values);
        }
        Err(wrong(format!("{name}: found {} values; expected {length}, as in velocity_error", values.len())))
    }

    fn step(&mut self, velocity: f64, radio: f64, inertial: f64) -> StepOutput {
        self.steps += 1;
        let time_ms = (self.steps as f64 * self.step_ms).round() as u64;
        // A value that is not finite counts as missing in the module.
        self.module.step(&StepInput {
            time_ms,
            velocity_error: Reading::good(velocity as f32),
            radio_velocity: Reading::good(radio as f32),
            inertial_velocity: Reading::good(inertial as f32),
            ..StepInput::default()
        })
    }
}

/// The numbers of `schuler.HealthVerdict`.
fn verdict(verdict: health::Verdict) -> u8 {
    match verdict {
        health::Verdict::Unobserved => 0,
        health::Verdict::Nominal => 1,
        health::Verdict::ShiftedMean => 2,
        health::Verdict::GrownNoise => 3,
        health::Verdict::ShiftedMeanAndGrownNoise => 4,
        health::Verdict::UndecidedFault => 5,
        health::Verdict::InertialDivergence => 6,
        health::Verdict::OutOfModel => 7,
        health::Verdict::HeldReading => 8,
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
