//! What comes out each step.
use bytemuck::{Pod, Zeroable};
use schuler_core::compensation::Compensation;
use schuler_core::filter::FilterOutput;
use schuler_core::health::{self, Estimate, HealthOutput, Suspect};
use schuler_core::identification::{
    AveragedEstimate, ChannelStatus, EstimateSource, IdentificationOutput, NoiseEstimate,
};
use schuler_core::isolation::{self, IsolationOutput};
use schuler_core::module::{HEALTH_LEVELS, StepOutput};
use schuler_core::thermal::TemperatureRateOutput;

#[allow(clippy::wildcard_imports)] // All that the outputs speak in.
use crate::numbers::*;
use crate::{SCHULER_ACCELEROMETERS, SCHULER_GYROS, SCHULER_THERMOMETERS};

/// Number of states of the error filter.
pub const SCHULER_STATES: usize = 4;
/// Levels of noise that the health monitor tells apart: normal and degraded.
pub const SCHULER_HEALTH_LEVELS: usize = 2;
/// No gyro has this number.
pub const SCHULER_NO_GYRO: u8 = 255;
/// Size of an output, bytes.
pub const SCHULER_OUTPUT_SIZE: usize = 544;

const _: () = assert!(size_of::<SchulerOutput>() == SCHULER_OUTPUT_SIZE);
const _: () = assert!(SCHULER_HEALTH_LEVELS == HEALTH_LEVELS);

/// Estimates and standard deviations of the four states, in this order: velocity error, m/s; vertical error, rad; accelerometer error,
/// m/s^2; gyro drift, rad/s.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerEstimate {
    /// Estimates.
    pub estimate: [f32; SCHULER_STATES],
    /// 1-sigma.
    pub sigma: [f32; SCHULER_STATES],
}

/// Error filter with the noise parameters in use. The estimate includes what the compensation knows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerFilterOutput {
    /// The states.
    pub states: SchulerEstimate,
    /// Innovation, m/s; zero when there was no measurement.
    pub innovation: f32,
    /// Its variance, (m/s)^2.
    pub innovation_variance: f32,
    /// Innovation squared over its variance; zero when there was no measurement.
    pub nis: f32,
}

/// The noise in use for one sensor: correlation sigma^2 exp(-alpha |t|) cos(beta t).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerNoise {
    /// Standard deviation, m/s^2 for the accelerometer, rad/s for the gyro.
    pub sigma: f32,
    /// Rate of decay, 1/s.
    pub alpha: f32,
    /// Angular frequency, rad/s; zero for a first-order process.
    pub beta: f32,
    /// How well these are known.
    pub status: SchulerNoiseStatus,
    /// Zero.
    pub reserved: [u8; 3],
}

/// Noise identification.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerIdentificationOutput {
    /// The estimate to navigate by: averaged over what is not known of the noise parameters, with that in its sigma.
    pub averaged: SchulerEstimate,
    /// Accelerometer noise in use.
    pub accelerometer: SchulerNoise,
    /// Gyro noise in use.
    pub gyro: SchulerNoise,
    /// How often the filter has been retuned.
    pub retunes: u16,
    /// Where the averaged estimate comes from.
    pub averaged_source: SchulerEstimateSource,
    /// Zero.
    pub reserved: u8,
}

/// Gyro block. Gyros count from zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerIsolationOutput {
    /// Body rate from the gyros in use, rad/s; zero when gyros_used is zero: then there is none.
    pub rate: [f64; 3],
    /// 1-sigma of the rate from the noise of the gyros in use, rad/s; zero when there is none.
    pub rate_sigma: [f64; 3],
    /// Parity vector of the five gyros in standard deviations; zero unless all five could be read.
    pub parity: [f64; 2],
    /// Parity of the block without gyro j, in standard deviations; zero when another gyro could not be read.
    pub determinants: [f64; SCHULER_GYROS],
    /// The detection statistic nearest to its threshold, over the threshold; an alarm is raised beyond one.
    pub alarm_level: f64,
    /// Lead of the likeliest gyro over the next in the evidence of the alarm; zero without an alarm.
    pub margin: f64,
    /// Size of the fault of the excluded gyro, rad/s; zero while no single gyro is excluded.
    pub fault_size: f64,
    /// 1-sigma of the fault size, rad/s; zero when there is no size.
    pub fault_sigma: f64,
    /// Why, and what happened.
    pub flags: SchulerIsolationFlags,
    /// What to believe.
    pub verdict: SchulerGyroVerdict,
    /// The gyro of SCHULER_GYRO_VERDICT_FAULT; SCHULER_NO_GYRO with every other verdict.
    pub fault_gyro: u8,
    /// Gyros that the rate comes from, one bit a gyro; zero: there is no rate.
    pub gyros_used: u8,
    /// Gyros declared faulty, one bit a gyro: they stay out until they are taken back.
    pub excluded: u8,
    /// Zero.
    pub reserved: [u8; 2],
}

/// Temperature and its rate at one thermometer; zero before its first reading.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerThermometerOutput {
    /// Temperature, degrees Celsius.
    pub temperature: f32,
    /// Rate of the temperature, degrees Celsius per second.
    pub rate: f32,
    /// 1-sigma of the temperature, degrees Celsius; nominal.
    pub temperature_sigma: f32,
    /// 1-sigma of the rate, degrees Celsius per second; nominal, pessimistic in slow change, optimistic after a step of heat.
    pub rate_sigma: f32,
    /// What was out of the ordinary.
    pub status: SchulerThermalStatus,
    /// Zero.
    pub reserved: [u8; 3],
}

/// Corrected inputs.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerCompensationOutput {
    /// Corrected rates of the gyros, rad/s; zero where there is no reading that can be used.
    pub gyros: [f64; SCHULER_GYROS],
    /// Corrected specific forces, m/s^2; zero where there is no reading that can be used.
    pub accelerometers: [f64; SCHULER_ACCELEROMETERS],
    /// What was taken off the velocity error as error of its measurement, m/s.
    pub velocity: f32,
    /// Known error of the accelerometer within the Schuler loop, m/s^2.
    pub loop_accelerometer: f32,
    /// Known error of the gyro within the Schuler loop, rad/s.
    pub loop_gyro: f32,
    /// One where a block is loaded; without, the corrected values are those that came in.
    pub loaded: u8,
    /// What limited the calibration of a complete unit; zero without one.
    pub calibration: SchulerCalibrationStatus,
    /// What limited the terms.
    pub terms: SchulerTermStatus,
    /// Zero.
    pub reserved: u8,
}

/// A value and its 1-sigma, both in the value's unit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerValue {
    /// The value.
    pub value: f32,
    /// Its standard deviation.
    pub sigma: f32,
}

/// Radio sensor against inertial sensor. Without a health configuration it runs on missing readings.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerHealthOutput {
    /// Posterior probability of each mode: first index jump absent, present; second index level of noise.
    pub mode_probability: [[f32; SCHULER_HEALTH_LEVELS]; 2],
    /// Probability that the radio's mean is shifted.
    pub p_jump: f32,
    /// Probability that the radio's noise is at a degraded level.
    pub p_noise: f32,
    /// Probability that the radio holds its last value.
    pub p_memory: f32,
    /// Probability of any of them.
    pub p_fault: f32,
    /// Radio error, m/s; without a residual its prediction.
    pub radio_error: SchulerValue,
    /// Inertial error, m/s.
    pub inertial_error: SchulerValue,
    /// Jump of the radio's mean, weighted with its probability, m/s.
    pub jump: SchulerValue,
    /// Inertial drift, m/s^2.
    pub inertial_drift: SchulerValue,
    /// Correlated part of the radio error, m/s.
    pub correlated_error: SchulerValue,
    /// The measured velocity, corrected, m/s; zero unless corrected_valid.
    pub corrected: SchulerValue,
    /// Radio less inertial reading, m/s; zero if there was none.
    pub residual: f32,
    /// Residual less its prediction over all modes, m/s; zero if there was no residual.
    pub innovation: f32,
    /// Variance of that prediction, (m/s)^2.
    pub innovation_variance: f32,
    /// Innovation squared over its variance, held at 1e12. The prediction is a mixture: this is not chi-squared.
    pub nis: f32,
    /// Natural logarithm of the residual's predictive density, density in 1/(m/s); zero if it was not used.
    pub log_likelihood: f32,
    /// What the sensors are thought to be in.
    pub verdict: SchulerHealthVerdict,
    /// Whom the model blames for it.
    pub suspect: SchulerSuspect,
    /// Alarms that are on.
    pub alarms: SchulerHealthAlarms,
    /// What was out of the ordinary in this step.
    pub status: SchulerHealthStatus,
    /// One where there was a usable reading to correct, zero where not.
    pub corrected_valid: u8,
    /// Zero.
    pub reserved: [u8; 3],
}

/// What the module gives back. No number is ever NaN or infinite; where there is no value, there is zero, and flags say so. There is no
/// padding: the bytes are defined to the last one, and the same inputs give the same bytes on every little-endian machine.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SchulerOutput {
    /// Steps since configuration, this one included; a restored state counts on.
    pub step: u64,
    /// Time of the step, as it came in, milliseconds.
    pub time_ms: u64,
    /// Gyro block.
    pub isolation: SchulerIsolationOutput,
    /// Corrected gyros and accelerometers.
    pub compensation: SchulerCompensationOutput,
    /// Error filter.
    pub filter: SchulerFilterOutput,
    /// Noise identification.
    pub identification: SchulerIdentificationOutput,
    /// Temperature and its rate at each thermometer.
    pub thermometers: [SchulerThermometerOutput; SCHULER_THERMOMETERS],
    /// Radio sensor against inertial sensor.
    pub health: SchulerHealthOutput,
    /// What was out of the ordinary.
    pub status: SchulerStatus,
}

impl From<&StepOutput> for SchulerOutput {
    fn from(output: &StepOutput) -> Self {
        Self {
            step: output.step,
            time_ms: output.time_ms,
            isolation: (&output.isolation).into(),
            compensation: (&output.compensation).into(),
            filter: (&output.filter).into(),
            identification: (&output.identification).into(),
            thermometers: output.thermometers.map(Into::into),
            health: (&output.health).into(),
            status: output.status.bits(),
        }
    }
}

impl From<&FilterOutput<f32>> for SchulerFilterOutput {
    fn from(output: &FilterOutput<f32>) -> Self {
        Self {
            states: SchulerEstimate { estimate: output.estimate, sigma: output.sigma },
            innovation: output.innovation,
            innovation_variance: output.innovation_variance,
            nis: output.nis,
        }
    }
}

impl From<&AveragedEstimate> for SchulerEstimate {
    fn from(averaged: &AveragedEstimate) -> Self {
        Self { estimate: averaged.estimate, sigma: averaged.sigma }
    }
}

impl From<&NoiseEstimate> for SchulerNoise {
    fn from(estimate: &NoiseEstimate) -> Self {
        let status = match estimate.status {
            ChannelStatus::DataSheet => SCHULER_NOISE_DATA_SHEET,
            ChannelStatus::Determined => SCHULER_NOISE_DETERMINED,
            ChannelStatus::Weak => SCHULER_NOISE_WEAK,
            ChannelStatus::Indeterminate => SCHULER_NOISE_INDETERMINATE,
            ChannelStatus::Unobserved => SCHULER_NOISE_UNOBSERVED,
        };
        let noise = &estimate.noise;
        Self { sigma: noise.sigma, alpha: noise.alpha, beta: noise.beta, status, reserved: [0; 3] }
    }
}

impl From<&IdentificationOutput> for SchulerIdentificationOutput {
    fn from(output: &IdentificationOutput) -> Self {
        Self {
            averaged: (&output.averaged).into(),
            accelerometer: (&output.accelerometer).into(),
            gyro: (&output.gyro).into(),
            retunes: output.retunes,
            averaged_source: match output.averaged.source {
                EstimateSource::Filter => SCHULER_SOURCE_FILTER,
                EstimateSource::WideBank => SCHULER_SOURCE_WIDE_BANK,
                EstimateSource::NarrowBank => SCHULER_SOURCE_NARROW_BANK,
            },
            reserved: 0,
        }
    }
}

impl From<&IsolationOutput> for SchulerIsolationOutput {
    fn from(output: &IsolationOutput) -> Self {
        let (verdict, fault_gyro) = match output.verdict {
            isolation::Verdict::NoFault => (SCHULER_GYRO_VERDICT_NO_FAULT, SCHULER_NO_GYRO),
            isolation::Verdict::DetectedNotIsolated => {
                (SCHULER_GYRO_VERDICT_DETECTED_NOT_ISOLATED, SCHULER_NO_GYRO)
            }
            isolation::Verdict::Fault(gyro) => (SCHULER_GYRO_VERDICT_FAULT, gyro),
            isolation::Verdict::BlockUntrusted => (SCHULER_GYRO_VERDICT_BLOCK_UNTRUSTED, SCHULER_NO_GYRO),
        };
        Self {
            rate: output.rate,
            rate_sigma: output.rate_sigma,
            parity: output.parity,
            determinants: output.determinants,
            alarm_level: output.alarm_level,
            margin: output.margin,
            fault_size: output.fault_size,
            fault_sigma: output.fault_sigma,
            flags: output.flags.bits(),
            verdict,
            fault_gyro,
            gyros_used: output.gyros_used,
            excluded: output.excluded,
            reserved: [0; 2],
        }
    }
}

impl From<TemperatureRateOutput<f32>> for SchulerThermometerOutput {
    fn from(output: TemperatureRateOutput<f32>) -> Self {
        Self {
            temperature: output.temperature,
            rate: output.rate,
            temperature_sigma: output.temperature_sigma,
            rate_sigma: output.rate_sigma,
            status: output.status.bits(),
            reserved: [0; 3],
        }
    }
}

impl From<&Compensation> for SchulerCompensationOutput {
    fn from(output: &Compensation) -> Self {
        let [loop_accelerometer, loop_gyro] = output.loop_errors;
        Self {
            gyros: output.gyros,
            accelerometers: output.accelerometers,
            velocity: output.velocity,
            loop_accelerometer,
            loop_gyro,
            loaded: u8::from(output.loaded),
            calibration: output.calibration.bits(),
            terms: output.terms.bits(),
            reserved: 0,
        }
    }
}

impl From<Estimate<f32>> for SchulerValue {
    fn from(estimate: Estimate<f32>) -> Self {
        Self { value: estimate.value, sigma: estimate.sigma }
    }
}

impl From<&HealthOutput<f32, HEALTH_LEVELS>> for SchulerHealthOutput {
    fn from(output: &HealthOutput<f32, HEALTH_LEVELS>) -> Self {
        Self {
            mode_probability: output.mode_probability,
            p_jump: output.p_jump,
            p_noise: output.p_noise,
            p_memory: output.p_memory,
            p_fault: output.p_fault,
            radio_error: output.radio_error.into(),
            inertial_error: output.inertial_error.into(),
            jump: output.jump.into(),
            inertial_drift: output.inertial_drift.into(),
            correlated_error: output.correlated_error.into(),
            corrected: output.corrected.map(Into::into).unwrap_or_default(),
            residual: output.residual,
            innovation: output.innovation,
            innovation_variance: output.innovation_variance,
            nis: output.nis,
            log_likelihood: output.log_likelihood,
            verdict: match output.verdict {
                health::Verdict::Unobserved => SCHULER_HEALTH_VERDICT_UNOBSERVED,
                health::Verdict::Nominal => SCHULER_HEALTH_VERDICT_NOMINAL,
                health::Verdict::ShiftedMean => SCHULER_HEALTH_VERDICT_SHIFTED_MEAN,
                health::Verdict::GrownNoise => SCHULER_HEALTH_VERDICT_GROWN_NOISE,
                health::Verdict::ShiftedMeanAndGrownNoise => {
                    SCHULER_HEALTH_VERDICT_SHIFTED_MEAN_AND_GROWN_NOISE
                }
                health::Verdict::UndecidedFault => SCHULER_HEALTH_VERDICT_UNDECIDED_FAULT,
                health::Verdict::InertialDivergence => SCHULER_HEALTH_VERDICT_INERTIAL_DIVERGENCE,
                health::Verdict::OutOfModel => SCHULER_HEALTH_VERDICT_OUT_OF_MODEL,
                health::Verdict::HeldReading => SCHULER_HEALTH_VERDICT_HELD_READING,
            },
            suspect: match output.suspect {
                Suspect::Neither => SCHULER_SUSPECT_NEITHER,
                Suspect::Radio => SCHULER_SUSPECT_RADIO,
                Suspect::Inertial => SCHULER_SUSPECT_INERTIAL,
                Suspect::Either => SCHULER_SUSPECT_EITHER,
            },
            alarms: output.alarms.bits(),
            status: output.status.bits(),
            corrected_valid: u8::from(output.corrected.is_some()),
            reserved: [0; 3],
        }
    }
}
