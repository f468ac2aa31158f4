//! What a run says: of the filter's consistency, of the noise, of the gyros, and of the truth where it is known.
use schuler_core::compensation::TermStatus;
use schuler_core::health::{self, Estimate, HealthStatus, Suspect};
use schuler_core::identification::{ChannelStatus, NoiseEstimate};
use schuler_core::isolation::{IsolationFlags, Verdict};
use schuler_core::module::{GYROS, Status, StepOutput};
use schuler_core::reading::Quality;
use schuler_core::thermal::{CompensationStatus, ThermalStatus};
use serde::Serialize;

use super::Flown;
use super::outputs::{STATES, corrected};
use super::sensors::Place;
use super::truth::LoopTruth;
use crate::statistics::{LjungBox, MeanTest, ljung_box, nis_mean};

/// Lags of the test of whiteness.
const WHITENESS_LAGS: usize = 20;
/// Events of one kind that a summary lists; more are counted.
const MOST_EVENTS: usize = 100;

/// What a run says.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The channel.
    pub channel: String,
    /// Steps flown.
    pub steps: usize,
    /// Their length, s.
    pub step_s: f64,
    /// The filter, where there was a velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filter: Option<FilterSummary>,
    /// The filter since it was last retuned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filter_since_retuning: Option<FilterSummary>,
    /// The identification, where there was a velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identification: Option<IdentificationSummary>,
    /// The gyros, where there were five.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyros: Option<BlockSummary>,
    /// The thermometers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub thermometers: Vec<ThermometerSummary>,
    /// The compensation, where a block was loaded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compensation: Option<CompensationSummary>,
    /// The health monitor, where there were a radio and an inertial velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub health: Option<HealthSummary>,
    /// Against the truth, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<TruthSummary>,
}

/// The filter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FilterSummary {
    /// Measurements that were used.
    pub used: usize,
    /// Steps without one.
    pub missing: usize,
    /// Measurements beyond the gate.
    pub gated: usize,
    /// Share of the measurements beyond the gate.
    pub gated_share: f64,
    /// Measurements not used because they were saturated or too old.
    pub refused: usize,
    /// Resets of the covariance, re-acquisitions of the velocity, jumps of the clock.
    pub upsets: usize,
    /// Mean innovation, m/s.
    pub innovation_mean: f64,
    /// Its standard deviation for a consistent filter, m/s.
    pub innovation_mean_sigma: f64,
    /// Mean of the normalised innovations squared of the measurements used; 1 for a consistent filter.
    pub nis: MeanTest,
    /// Whiteness of the normalised innovations.
    pub whiteness: LjungBox,
    /// Estimates at the end.
    pub end: Vec<StateSummary>,
}

/// One state at the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StateSummary {
    /// Its name.
    pub state: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Estimate, averaged over what is not known of the noise.
    pub estimate: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// The identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentificationSummary {
    /// Accelerometer noise in use at the end, m/s².
    pub accelerometer: NoiseSummary,
    /// Gyro noise in use at the end, rad/s.
    pub gyro: NoiseSummary,
    /// Times of the retunings, s.
    pub retuned_at_s: Vec<f64>,
}

/// Noise in use.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NoiseSummary {
    /// `exponential` or `exponential_cosine`.
    pub structure: &'static str,
    /// Standard deviation, SI.
    pub sigma: f64,
    /// Correlation time 1/α, s.
    pub tau_s: f64,
    /// Angular frequency β, rad/s.
    pub beta: f64,
    /// How well it is known.
    pub status: &'static str,
}

/// The gyros.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockSummary {
    /// Their ids.
    pub gyros: [String; GYROS],
    /// Changes of the verdict.
    pub verdicts: Vec<VerdictChange>,
    /// Alarms raised.
    pub alarms: usize,
    /// Share of the steps with a rate from all five.
    pub complete_share: f64,
    /// Gyro that is out at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub excluded: Option<String>,
    /// Size of its fault, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault_size: Option<f64>,
    /// Standard deviation of that, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault_sigma: Option<f64>,
}

/// A change of the verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerdictChange {
    /// When, s.
    pub time_s: f64,
    /// `no_fault`, `detected`, `fault` or `untrusted`.
    pub verdict: &'static str,
    /// The gyro.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro: Option<String>,
}

/// A thermometer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThermometerSummary {
    /// Its column.
    pub column: String,
    /// Quantum that was flown, degC.
    pub quantum: f64,
    /// Share of the steps whose reading was used.
    pub used_share: f64,
    /// Share of the steps whose rate came from the filter of all readings, for the noise spans levels.
    pub dither_share: f64,
    /// Times it started anew.
    pub restarts: usize,
    /// Time from which the rate is settled, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_s: Option<f64>,
    /// Least and greatest temperature, degC.
    pub temperature: [f64; 2],
    /// Least and greatest settled rate, degC/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<[f64; 2]>,
}

/// The compensation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompensationSummary {
    /// Checksum of the block.
    pub checksum: String,
    /// Steps in which something that it needs was not known.
    pub inputs_missing: usize,
    /// Steps outside the range for which it holds.
    pub out_of_range: usize,
    /// Steps in which a correction was held at its limit.
    pub limited: usize,
    /// Sensor by sensor.
    pub sensors: Vec<CorrectedSensor>,
    /// Root mean square of what was taken off the velocity error as error of its measurement, m/s.
    pub velocity: f64,
    /// Root mean square of the known errors in the Schuler loop: accelerometer, m/s², and gyro, rad/s.
    pub loop_errors: [f64; 2],
}

/// What was taken off a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CorrectedSensor {
    /// The sensor.
    pub sensor: String,
    /// `rad/s` or `m/s^2`.
    pub unit: &'static str,
    /// Mean correction.
    pub mean: f64,
    /// Standard deviation of the corrections.
    pub deviation: f64,
}

/// The health monitor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HealthSummary {
    /// Changes of the verdict.
    pub verdicts: Vec<HealthChange>,
    /// Share of the steps with each verdict, where there is one.
    pub shares: Vec<(&'static str, f64)>,
    /// Steps with both readings.
    pub residuals: usize,
    /// Residuals beyond every mode.
    pub out_of_model: usize,
    /// Starts from the priors after a gap that is too long.
    pub restarts: usize,
    /// Error of the radio at the end and its standard deviation, m/s.
    pub radio_error: [f64; 2],
    /// Error of the inertial velocity at the end and its standard deviation, m/s.
    pub inertial_error: [f64; 2],
}

/// A change of the health monitor's verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HealthChange {
    /// When, s.
    pub time_s: f64,
    /// As in the table of verdicts.
    pub verdict: &'static str,
    /// `neither`, `radio`, `inertial` or `either`.
    pub suspect: &'static str,
}

/// Against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthSummary {
    /// From this time on, s.
    pub from_s: f64,
    /// State by state, of the averaged estimate.
    pub states: Vec<TruthState>,
}

/// One state against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TruthState {
    /// Its name.
    pub state: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Root mean square of the error.
    pub rmse: f64,
    /// Share of the errors beyond three standard deviations.
    pub beyond_three_sigma: f64,
    /// Mean of (error/σ)².
    pub nees: f64,
}

impl Summary {
    /// Sums a run up. The truth is compared from the second quarter on: the first is left to the transient.
    pub fn of(flown: &Flown, truth: Option<&LoopTruth>) -> Self {
        let whole = Self::between(flown, None, 0);
        let compared = truth.filter(|_| flown.channel.has_velocity);
        Self { truth: compared.map(|truth| against(flown, truth, flown.outputs.len() / 4)), ..whole }
    }

    /// Sums the filter's steps from one on up, and compares them with the truth.
    pub fn between(flown: &Flown, truth: Option<&LoopTruth>, from: usize) -> Self {
        let channel = &flown.channel;
        let has_velocity = channel.has_velocity;
        let outputs = flown.outputs.get(from..).unwrap_or_default();
        Self {
            channel: channel.name.clone(),
            steps: outputs.len(),
            step_s: f64::from(channel.config.filter.step_s),
            filter: has_velocity.then(|| filter(outputs)),
            filter_since_retuning: outputs
                .iter()
                .rposition(|o| o.status.contains(Status::RETUNED))
                .and_then(|last| outputs.get(last + 1..))
                .filter(|since| has_velocity && !since.is_empty())
                .map(filter),
            identification: if has_velocity { identification(flown) } else { None },
            gyros: channel.gyros.as_ref().map(|ids| block(flown, ids)),
            thermometers: (channel.thermometers.iter().enumerate())
                .map(|(index, column)| thermometer(flown, index, column))
                .collect(),
            compensation: channel.compensation.as_deref().map(|bytes| compensation(flown, bytes)),
            health: channel.has_health.then(|| health(flown)),
            truth: truth.filter(|_| has_velocity).map(|truth| against(flown, truth, from)),
        }
    }
}

/// Whether the step's measurement was used.
pub fn was_used(output: &StepOutput) -> bool {
    let unused = Status::VELOCITY_MISSING
        | Status::VELOCITY_SATURATED
        | Status::VELOCITY_STALE
        | Status::INNOVATION_GATED
        | Status::CLOCK_BACKWARDS
        | Status::VELOCITY_REACQUIRED
        | Status::CLOCK_JUMPED;
    !output.status.intersects(unused) && output.filter.innovation_variance > 0.0
}

fn filter(outputs: &[StepOutput]) -> FilterSummary {
    let count = |flags: Status| outputs.iter().filter(|o| o.status.intersects(flags)).count();
    let used: Vec<&StepOutput> = outputs.iter().filter(|o| was_used(o)).collect();
    let n = used.len().max(1) as f64;
    let variance: f64 = used.iter().map(|o| f64::from(o.filter.innovation_variance)).sum();
    let nis: Vec<f64> = used.iter().map(|o| f64::from(o.filter.nis)).collect();
    let normalised: Vec<f64> = outputs
        .iter()
        .map(|o| {
            if was_used(o) {
                f64::from(o.filter.innovation) / f64::from(o.filter.innovation_variance).sqrt()
            } else {
                f64::NAN
            }
        })
        .collect();
    let gated = count(Status::INNOVATION_GATED);
    let end = outputs.last().map(|o| o.identification.averaged).unwrap_or_default();
    FilterSummary {
        used: used.len(),
        missing: count(Status::VELOCITY_MISSING),
        gated,
        gated_share: gated as f64 / (used.len() + gated).max(1) as f64,
        refused: count(Status::VELOCITY_SATURATED | Status::VELOCITY_STALE),
        upsets: count(Status::COVARIANCE_RESET | Status::VELOCITY_REACQUIRED | Status::CLOCK_JUMPED),
        innovation_mean: used.iter().map(|o| f64::from(o.filter.innovation)).sum::<f64>() / n,
        innovation_mean_sigma: variance.sqrt() / n,
        nis: nis_mean(&nis),
        whiteness: ljung_box(&normalised, WHITENESS_LAGS),
        end: STATES
            .iter()
            .enumerate()
            .map(|(k, (state, unit))| StateSummary {
                state,
                unit,
                estimate: f64::from(end.estimate[k]),
                sigma: f64::from(end.sigma[k]),
            })
            .collect(),
    }
}

fn identification(flown: &Flown) -> Option<IdentificationSummary> {
    let last = flown.outputs.last()?.identification;
    Some(IdentificationSummary {
        accelerometer: noise(&last.accelerometer),
        gyro: noise(&last.gyro),
        retuned_at_s: events(flown, |o| o.status.contains(Status::RETUNED)),
    })
}

fn noise(estimate: &NoiseEstimate) -> NoiseSummary {
    let noise = &estimate.noise;
    NoiseSummary {
        structure: if noise.beta > 0.0 { "exponential_cosine" } else { "exponential" },
        sigma: f64::from(noise.sigma),
        tau_s: 1.0 / f64::from(noise.alpha),
        beta: f64::from(noise.beta),
        status: match estimate.status {
            ChannelStatus::DataSheet => "data_sheet",
            ChannelStatus::Determined => "determined",
            ChannelStatus::Weak => "weak",
            ChannelStatus::Indeterminate => "indeterminate",
            ChannelStatus::Unobserved => "unobserved",
        },
    }
}

/// Times of the steps for which something is so.
fn events(flown: &Flown, is: impl Fn(&StepOutput) -> bool) -> Vec<f64> {
    flown
        .channel
        .time_s
        .iter()
        .zip(&flown.outputs)
        .filter(|(_, o)| is(o))
        .map(|(t, _)| *t)
        .take(MOST_EVENTS)
        .collect()
}

fn block(flown: &Flown, ids: &[String; GYROS]) -> BlockSummary {
    let outputs = &flown.outputs;
    let mut verdicts = Vec::new();
    let mut before = Verdict::NoFault;
    for (time_s, output) in flown.channel.time_s.iter().zip(outputs) {
        let verdict = output.isolation.verdict;
        if verdict != before && verdicts.len() < MOST_EVENTS {
            let (name, gyro) = match verdict {
                Verdict::NoFault => ("no_fault", None),
                Verdict::DetectedNotIsolated => ("detected", None),
                Verdict::Fault(gyro) => ("fault", ids.get(usize::from(gyro)).cloned()),
                Verdict::BlockUntrusted => ("untrusted", None),
            };
            verdicts.push(VerdictChange { time_s: *time_s, verdict: name, gyro });
        }
        before = verdict;
    }
    let last = outputs.last().map(|o| o.isolation).unwrap_or_default();
    let excluded = match last.verdict {
        Verdict::Fault(gyro) => ids.get(usize::from(gyro)).cloned(),
        _ => None,
    };
    let sized = excluded.is_some() && last.fault_sigma > 0.0;
    BlockSummary {
        gyros: ids.clone(),
        verdicts,
        alarms: outputs.iter().filter(|o| o.isolation.flags.contains(IsolationFlags::ALARM_RAISED)).count(),
        complete_share: outputs.iter().filter(|o| o.isolation.gyros_used.count_ones() == 5).count() as f64
            / outputs.len().max(1) as f64,
        excluded,
        fault_size: sized.then_some(last.fault_size),
        fault_sigma: sized.then_some(last.fault_sigma),
    }
}

fn thermometer(flown: &Flown, index: usize, column: &str) -> ThermometerSummary {
    let outputs: Vec<_> = flown.outputs.iter().filter_map(|o| o.thermometers.get(index)).collect();
    let is = |flag: ThermalStatus| outputs.iter().filter(|o| o.status.contains(flag)).count();
    let share = |count: usize| count as f64 / outputs.len().max(1) as f64;
    let settled =
        |status: ThermalStatus| !status.intersects(ThermalStatus::NO_READING | ThermalStatus::SETTLING);
    let extremes = |values: &mut dyn Iterator<Item = f64>| {
        values.fold(None, |ends: Option<[f64; 2]>, value| {
            let [low, high] = ends.unwrap_or([value; 2]);
            Some([low.min(value), high.max(value)])
        })
    };
    let mut temperatures = outputs
        .iter()
        .filter(|o| !o.status.contains(ThermalStatus::NO_READING))
        .map(|o| f64::from(o.temperature));
    let mut rates = outputs.iter().filter(|o| settled(o.status)).map(|o| f64::from(o.rate));
    let config = flown.channel.config.thermometers.get(index).copied().flatten();
    ThermometerSummary {
        column: column.to_owned(),
        quantum: config.map_or(f64::NAN, |it| f64::from(it.quantum)),
        used_share: 1.0 - share(is(ThermalStatus::REJECTED)),
        dither_share: share(is(ThermalStatus::DITHER)),
        restarts: is(ThermalStatus::RESTARTED),
        settled_s: (flown.channel.time_s.iter().zip(&outputs))
            .find(|(_, o)| settled(o.status))
            .map(|(t, _)| *t),
        temperature: extremes(&mut temperatures).unwrap_or([f64::NAN; 2]),
        rate: extremes(&mut rates),
    }
}

fn compensation(flown: &Flown, bytes: &[u8]) -> CompensationSummary {
    let outputs = &flown.outputs;
    let is = |terms: TermStatus, calibration: CompensationStatus| {
        outputs
            .iter()
            .map(|o| &o.compensation)
            .filter(|it| it.terms.intersects(terms) || it.calibration.intersects(calibration))
            .count()
    };
    let rms = |of: &dyn Fn(&StepOutput) -> f32| {
        let sum: f64 = outputs.iter().map(|o| f64::from(of(o)).powi(2)).sum();
        (sum / outputs.len().max(1) as f64).sqrt()
    };
    let sensors = flown.channel.sensors.iter().map(|(id, place)| {
        let taken: Vec<f64> = (flown.channel.inputs.iter().zip(outputs))
            .filter_map(|(input, output)| {
                let reading = match place {
                    Place::Gyro(k) => input.gyros.get(*k)?,
                    Place::Accelerometer(k) => input.accelerometers.get(*k)?,
                };
                (reading.quality == Quality::Good).then(|| reading.value - corrected(output, *place))
            })
            .collect();
        let n = taken.len().max(1) as f64;
        let mean = taken.iter().sum::<f64>() / n;
        CorrectedSensor {
            sensor: id.clone(),
            unit: if matches!(place, Place::Gyro(_)) { "rad/s" } else { "m/s^2" },
            mean,
            deviation: (taken.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n).sqrt(),
        }
    });
    let checksum = bytes.last_chunk().map_or(0, |last| u32::from_le_bytes(*last));
    let unknown = CompensationStatus::NO_TEMPERATURE | CompensationStatus::NO_RATE;
    CompensationSummary {
        checksum: format!("{checksum:08x}"),
        inputs_missing: is(TermStatus::INPUT_MISSING, unknown),
        out_of_range: is(TermStatus::OUT_OF_RANGE, CompensationStatus::OUT_OF_RANGE),
        limited: is(TermStatus::LIMITED, CompensationStatus::empty()),
        sensors: sensors.collect(),
        velocity: rms(&|o| o.compensation.velocity),
        loop_errors: [rms(&|o| o.compensation.loop_errors[0]), rms(&|o| o.compensation.loop_errors[1])],
    }
}

/// Name of a verdict of the health monitor.
pub fn health_name(verdict: health::Verdict) -> &'static str {
    match verdict {
        health::Verdict::Unobserved => "unobserved",
        health::Verdict::Nominal => "nominal",
        health::Verdict::ShiftedMean => "shifted_mean",
        health::Verdict::GrownNoise => "grown_noise",
        health::Verdict::ShiftedMeanAndGrownNoise => "shifted_mean_and_grown_noise",
        health::Verdict::UndecidedFault => "undecided_fault",
        health::Verdict::InertialDivergence => "inertial_divergence",
        health::Verdict::OutOfModel => "out_of_model",
    }
}

fn health(flown: &Flown) -> HealthSummary {
    let outputs: Vec<_> = flown.outputs.iter().map(|o| &o.health).collect();
    let is = |flag: HealthStatus| outputs.iter().filter(|o| o.status.contains(flag)).count();
    let unusable = HealthStatus::RADIO_UNUSABLE | HealthStatus::INERTIAL_UNUSABLE;
    let mut verdicts: Vec<HealthChange> = Vec::new();
    let mut shares: Vec<(&'static str, f64)> = Vec::new();
    let mut before = None;
    for (time_s, output) in flown.channel.time_s.iter().zip(&outputs) {
        let verdict = health_name(output.verdict);
        let suspect = match output.suspect {
            Suspect::Neither => "neither",
            Suspect::Radio => "radio",
            Suspect::Inertial => "inertial",
            Suspect::Either => "either",
        };
        if before != Some((verdict, suspect)) && verdicts.len() < MOST_EVENTS {
            verdicts.push(HealthChange { time_s: *time_s, verdict, suspect });
        }
        before = Some((verdict, suspect));
        let share = 1.0 / outputs.len() as f64;
        match shares.iter_mut().find(|(name, _)| *name == verdict) {
            Some((_, sum)) => *sum += share,
            None => shares.push((verdict, share)),
        }
    }
    let last = outputs.last().map(|o| **o).unwrap_or_default();
    let estimate = |it: Estimate<f32>| [f64::from(it.value), f64::from(it.sigma)];
    HealthSummary {
        verdicts,
        shares,
        residuals: outputs.iter().filter(|o| !o.status.intersects(unusable)).count(),
        out_of_model: is(HealthStatus::OUT_OF_MODEL),
        restarts: is(HealthStatus::RESTARTED),
        radio_error: estimate(last.radio_error),
        inertial_error: estimate(last.inertial_error),
    }
}

fn against(flown: &Flown, truth: &LoopTruth, from: usize) -> TruthSummary {
    let outputs = &flown.outputs;
    let states = STATES.iter().zip(&truth.states).enumerate().map(|(k, ((state, unit), truth))| {
        let errors: Vec<(f64, f64)> = outputs
            .iter()
            .zip(truth)
            .skip(from)
            .filter(|(_, truth)| truth.is_finite())
            .map(|(o, truth)| {
                let averaged = &o.identification.averaged;
                (f64::from(averaged.estimate[k]) - truth, f64::from(averaged.sigma[k]))
            })
            .collect();
        let n = errors.len().max(1) as f64;
        TruthState {
            state,
            unit,
            rmse: (errors.iter().map(|(e, _)| e * e).sum::<f64>() / n).sqrt(),
            beyond_three_sigma: errors.iter().filter(|(e, s)| e.abs() > 3.0 * s).count() as f64 / n,
            nees: errors.iter().map(|(e, s)| (e / s).powi(2)).sum::<f64>() / n,
        }
    });
    TruthSummary {
        from_s: flown.channel.time_s.get(from).copied().unwrap_or_default(),
        states: states.collect(),
    }
}
