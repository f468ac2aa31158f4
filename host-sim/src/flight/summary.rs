//! What a run says: of the filter's consistency, of the noise, of the gyros, and of the truth where it is known.
use schuler_core::compensation::TermStatus;
use schuler_core::health::{self, Estimate, HealthStatus, Suspect};
use schuler_core::identification::{ChannelStatus, NoiseEstimate};
use schuler_core::isolation::{IsolationFlags, Verdict};
use schuler_core::module::{GYROS, Status, StepOutput};
use schuler_core::reading::Quality;
use schuler_core::thermal::{CompensationStatus, TemperatureRateOutput, ThermalStatus};
use serde::Serialize;

use super::outputs::{STATES, corrected};
use super::sensors::Place;
use super::truth::LoopStates;
use super::{Channel, Flown, Step};
use crate::statistics::{LagProducts, LjungBox, MeanTest, nis_mean};

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
    /// Steps whose velocity measurement was withheld from the filter.
    pub withheld: usize,
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
    /// Sums a run up. The truth, step by step, is compared from the second quarter on: the first is left to the transient.
    pub fn of(flown: &Flown, truth: Option<&[LoopStates]>) -> Self {
        let mut sums = Summing::new(&flown.channel, truth.map(|_| flown.outputs.len() / 4));
        for (row, (step, output)) in flown.iter().enumerate() {
            sums.add(step, output, truth.and_then(|truth| truth.get(row)));
        }
        sums.finish()
    }

    /// Sums the steps from one on up, and compares them with the truth.
    pub fn from(flown: &Flown, truth: Option<&[LoopStates]>, from: usize) -> Self {
        let mut sums = Summing::new(&flown.channel, truth.map(|_| 0));
        for (row, (step, output)) in flown.iter().enumerate().skip(from) {
            sums.add(step, output, truth.and_then(|truth| truth.get(row)));
        }
        sums.finish()
    }
}

/// Sums a run up while it goes on.
#[derive(Clone, Debug)]
pub struct Summing<'c> {
    channel: &'c Channel,
    /// The truth is compared from this step on.
    compared_from: Option<usize>,
    steps: usize,
    last: StepOutput,
    filter: FilterSums,
    since_retuning: Option<FilterSums>,
    retuned_at_s: Vec<f64>,
    gyros: BlockSums,
    thermometers: Vec<ThermometerSums>,
    compensation: CompensationSums,
    health: HealthSums,
    truth_from_s: Option<f64>,
    truth: [TruthSums; 4],
}

impl<'c> Summing<'c> {
    /// Of a channel; the truth, if it is known, is compared from this step on.
    pub fn new(channel: &'c Channel, compared_from: Option<usize>) -> Self {
        Self {
            channel,
            compared_from: compared_from.filter(|_| channel.has_velocity),
            steps: 0,
            last: StepOutput::default(),
            filter: FilterSums::default(),
            since_retuning: None,
            retuned_at_s: Vec::new(),
            gyros: BlockSums::default(),
            thermometers: vec![ThermometerSums::default(); channel.thermometers.len()],
            compensation: CompensationSums::of(channel),
            health: HealthSums::default(),
            truth_from_s: None,
            truth: Default::default(),
        }
    }

    /// Takes the next step, with the truth where it is known.
    pub fn add(&mut self, step: &Step, output: &StepOutput, truth: Option<&LoopStates>) {
        self.filter.add(output);
        if let Some(since) = &mut self.since_retuning {
            since.add(output);
        }
        if output.status.contains(Status::RETUNED) {
            self.since_retuning = Some(FilterSums::default());
            if self.retuned_at_s.len() < MOST_EVENTS {
                self.retuned_at_s.push(step.time_s);
            }
        }
        if let Some(ids) = &self.channel.gyros {
            self.gyros.add(step.time_s, output, ids);
        }
        for (sums, it) in self.thermometers.iter_mut().zip(&output.thermometers) {
            sums.add(step.time_s, it);
        }
        self.compensation.add(step, output);
        self.health.add(step.time_s, output);
        if self.compared_from.is_some_and(|from| self.steps >= from) {
            self.truth_from_s.get_or_insert(step.time_s);
            for (k, sums) in self.truth.iter_mut().enumerate() {
                let averaged = &output.identification.averaged;
                if let Some(truth) = truth.map(|truth| truth[k]).filter(|truth| truth.is_finite()) {
                    sums.add(f64::from(averaged.estimate[k]) - truth, f64::from(averaged.sigma[k]));
                }
            }
        }
        self.steps += 1;
        self.last = *output;
    }

    /// What the run says.
    pub fn finish(self) -> Summary {
        let Self { channel, steps, last, .. } = self;
        let has_velocity = channel.has_velocity;
        let end = &last.identification;
        let since_retuning = self.since_retuning.filter(|since| since.steps > 0);
        Summary {
            channel: channel.name.clone(),
            steps,
            step_s: f64::from(channel.config.filter.step_s),
            filter: has_velocity.then(|| self.filter.finish(&last)),
            filter_since_retuning: since_retuning.filter(|_| has_velocity).map(|it| it.finish(&last)),
            identification: (has_velocity && steps > 0).then(|| IdentificationSummary {
                accelerometer: noise(&end.accelerometer),
                gyro: noise(&end.gyro),
                retuned_at_s: self.retuned_at_s,
            }),
            gyros: channel.gyros.as_ref().map(|ids| self.gyros.finish(ids, &last, steps)),
            thermometers: (self.thermometers.into_iter().zip(&channel.thermometers).enumerate())
                .map(|(index, (sums, column))| {
                    let config = channel.config.thermometers.get(index).copied().flatten();
                    let quantum = config.map_or(f64::NAN, |it| f64::from(it.quantum));
                    sums.finish(column, quantum, steps)
                })
                .collect(),
            compensation: channel.compensation.as_deref().map(|bytes| self.compensation.finish(bytes, steps)),
            health: channel.has_health.then(|| self.health.finish(&last, steps)),
            truth: self.compared_from.map(|_| TruthSummary {
                from_s: self.truth_from_s.unwrap_or_default(),
                states: (STATES.iter().zip(&self.truth)).map(|(state, sums)| sums.finish(*state)).collect(),
            }),
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

/// The normalised innovation of a step; NaN where the measurement was not used.
pub fn normalised_innovation(output: &StepOutput) -> f64 {
    if was_used(output) {
        f64::from(output.filter.innovation) / f64::from(output.filter.innovation_variance).sqrt()
    } else {
        f64::NAN
    }
}

#[derive(Clone, Debug)]
struct FilterSums {
    steps: usize,
    used: usize,
    missing: usize,
    gated: usize,
    refused: usize,
    upsets: usize,
    innovation: f64,
    variance: f64,
    nis: f64,
    normalised: LagProducts,
}

impl Default for FilterSums {
    fn default() -> Self {
        Self {
            steps: 0,
            used: 0,
            missing: 0,
            gated: 0,
            refused: 0,
            upsets: 0,
            innovation: 0.0,
            variance: 0.0,
            nis: 0.0,
            normalised: LagProducts::new(WHITENESS_LAGS),
        }
    }
}

impl FilterSums {
    fn add(&mut self, output: &StepOutput) {
        let is = |flags: Status| usize::from(output.status.intersects(flags));
        self.steps += 1;
        self.missing += is(Status::VELOCITY_MISSING);
        self.gated += is(Status::INNOVATION_GATED);
        self.refused += is(Status::VELOCITY_SATURATED | Status::VELOCITY_STALE);
        self.upsets += is(Status::COVARIANCE_RESET | Status::VELOCITY_REACQUIRED | Status::CLOCK_JUMPED);
        if was_used(output) {
            self.used += 1;
            self.innovation += f64::from(output.filter.innovation);
            self.variance += f64::from(output.filter.innovation_variance);
            self.nis += f64::from(output.filter.nis);
        }
        self.normalised.add(normalised_innovation(output));
    }

    fn finish(&self, last: &StepOutput) -> FilterSummary {
        let n = self.used.max(1) as f64;
        let end = &last.identification.averaged;
        FilterSummary {
            used: self.used,
            missing: self.missing,
            gated: self.gated,
            gated_share: self.gated as f64 / (self.used + self.gated).max(1) as f64,
            refused: self.refused,
            upsets: self.upsets,
            innovation_mean: self.innovation / n,
            innovation_mean_sigma: self.variance.sqrt() / n,
            nis: nis_mean(self.nis, self.used),
            whiteness: self.normalised.ljung_box(),
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

#[derive(Clone, Debug, Default)]
struct BlockSums {
    before: Verdict,
    verdicts: Vec<VerdictChange>,
    alarms: usize,
    complete: usize,
}

impl BlockSums {
    fn add(&mut self, time_s: f64, output: &StepOutput, ids: &[String; GYROS]) {
        let isolation = &output.isolation;
        if isolation.verdict != self.before && self.verdicts.len() < MOST_EVENTS {
            let (verdict, gyro) = match isolation.verdict {
                Verdict::NoFault => ("no_fault", None),
                Verdict::DetectedNotIsolated => ("detected", None),
                Verdict::Fault(gyro) => ("fault", ids.get(usize::from(gyro)).cloned()),
                Verdict::BlockUntrusted => ("untrusted", None),
            };
            self.verdicts.push(VerdictChange { time_s, verdict, gyro });
        }
        self.before = isolation.verdict;
        self.alarms += usize::from(isolation.flags.contains(IsolationFlags::ALARM_RAISED));
        self.complete += usize::from(isolation.gyros_used.count_ones() == 5);
    }

    fn finish(self, ids: &[String; GYROS], last: &StepOutput, steps: usize) -> BlockSummary {
        let last = &last.isolation;
        let excluded = match last.verdict {
            Verdict::Fault(gyro) => ids.get(usize::from(gyro)).cloned(),
            _ => None,
        };
        let sized = excluded.is_some() && last.fault_sigma > 0.0;
        BlockSummary {
            gyros: ids.clone(),
            verdicts: self.verdicts,
            alarms: self.alarms,
            complete_share: self.complete as f64 / steps.max(1) as f64,
            excluded,
            fault_size: sized.then_some(last.fault_size),
            fault_sigma: sized.then_some(last.fault_sigma),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct ThermometerSums {
    rejected: usize,
    dither: usize,
    restarts: usize,
    settled_s: Option<f64>,
    temperature: Option<[f64; 2]>,
    rate: Option<[f64; 2]>,
}

impl ThermometerSums {
    fn add(&mut self, time_s: f64, output: &TemperatureRateOutput<f32>) {
        let is = |flag: ThermalStatus| usize::from(output.status.contains(flag));
        self.rejected += is(ThermalStatus::REJECTED);
        self.dither += is(ThermalStatus::DITHER);
        self.restarts += is(ThermalStatus::RESTARTED);
        let widen = |ends: &mut Option<[f64; 2]>, value: f32| {
            let value = f64::from(value);
            let [low, high] = ends.unwrap_or([value; 2]);
            *ends = Some([low.min(value), high.max(value)]);
        };
        if !output.status.contains(ThermalStatus::NO_READING) {
            widen(&mut self.temperature, output.temperature);
            if !output.status.contains(ThermalStatus::SETTLING) {
                widen(&mut self.rate, output.rate);
                self.settled_s.get_or_insert(time_s);
            }
        }
    }

    fn finish(self, column: &str, quantum: f64, steps: usize) -> ThermometerSummary {
        let share = |count: usize| count as f64 / steps.max(1) as f64;
        ThermometerSummary {
            column: column.to_owned(),
            quantum,
            used_share: 1.0 - share(self.rejected),
            dither_share: share(self.dither),
            restarts: self.restarts,
            settled_s: self.settled_s,
            temperature: self.temperature.unwrap_or([f64::NAN; 2]),
            rate: self.rate,
        }
    }
}

#[derive(Clone, Debug, Default)]
struct CompensationSums {
    inputs_missing: usize,
    out_of_range: usize,
    limited: usize,
    sensors: Vec<(String, Place, Moments)>,
    velocity: f64,
    loop_errors: [f64; 2],
}

/// Mean and spread of numbers as they come (Welford, Technometrics 4, 1962).
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    /// Sum of the squares about the mean.
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
    }
}

impl CompensationSums {
    fn of(channel: &Channel) -> Self {
        let sensors = channel.sensors.iter().map(|(id, place)| (id.clone(), *place, Moments::default()));
        Self { sensors: sensors.collect(), ..Self::default() }
    }

    fn add(&mut self, step: &Step, output: &StepOutput) {
        let it = &output.compensation;
        let is = |terms: TermStatus, calibration: CompensationStatus| {
            usize::from(it.terms.intersects(terms) || it.calibration.intersects(calibration))
        };
        let unknown = CompensationStatus::NO_TEMPERATURE | CompensationStatus::NO_RATE;
        self.inputs_missing += is(TermStatus::INPUT_MISSING, unknown);
        self.out_of_range += is(TermStatus::OUT_OF_RANGE, CompensationStatus::OUT_OF_RANGE);
        self.limited += is(TermStatus::LIMITED, CompensationStatus::empty());
        for (_, place, taken) in &mut self.sensors {
            let reading = match place {
                Place::Gyro(k) => step.input.gyros.get(*k),
                Place::Accelerometer(k) => step.input.accelerometers.get(*k),
            };
            if let Some(reading) = reading.filter(|reading| reading.quality == Quality::Good) {
                taken.add(reading.value - corrected(output, *place));
            }
        }
        self.velocity += f64::from(it.velocity).powi(2);
        for (sum, error) in self.loop_errors.iter_mut().zip(it.loop_errors) {
            *sum += f64::from(error).powi(2);
        }
    }

    fn finish(self, bytes: &[u8], steps: usize) -> CompensationSummary {
        let rms = |sum: f64| (sum / steps.max(1) as f64).sqrt();
        let sensors = self.sensors.into_iter().map(|(sensor, place, taken)| CorrectedSensor {
            sensor,
            unit: if matches!(place, Place::Gyro(_)) { "rad/s" } else { "m/s^2" },
            mean: taken.mean,
            deviation: (taken.squares / taken.count.max(1.0)).sqrt(),
        });
        let checksum = bytes.last_chunk().map_or(0, |last| u32::from_le_bytes(*last));
        CompensationSummary {
            checksum: format!("{checksum:08x}"),
            inputs_missing: self.inputs_missing,
            out_of_range: self.out_of_range,
            limited: self.limited,
            sensors: sensors.collect(),
            velocity: rms(self.velocity),
            loop_errors: self.loop_errors.map(rms),
        }
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
        health::Verdict::HeldReading => "held_reading",
    }
}

#[derive(Clone, Debug, Default)]
struct HealthSums {
    before: Option<(&'static str, &'static str)>,
    verdicts: Vec<HealthChange>,
    /// Steps with each verdict, in the order in which they came.
    steps: Vec<(&'static str, usize)>,
    residuals: usize,
    out_of_model: usize,
    restarts: usize,
    withheld: usize,
}

impl HealthSums {
    fn add(&mut self, time_s: f64, step: &StepOutput) {
        let output = &step.health;
        self.withheld += usize::from(step.status.contains(Status::VELOCITY_WITHHELD));
        let is = |flag: HealthStatus| usize::from(output.status.contains(flag));
        let verdict = health_name(output.verdict);
        let suspect = match output.suspect {
            Suspect::Neither => "neither",
            Suspect::Radio => "radio",
            Suspect::Inertial => "inertial",
            Suspect::Either => "either",
        };
        if self.before != Some((verdict, suspect)) && self.verdicts.len() < MOST_EVENTS {
            self.verdicts.push(HealthChange { time_s, verdict, suspect });
        }
        self.before = Some((verdict, suspect));
        match self.steps.iter_mut().find(|(name, _)| *name == verdict) {
            Some((_, steps)) => *steps += 1,
            None => self.steps.push((verdict, 1)),
        }
        let unusable = HealthStatus::RADIO_UNUSABLE | HealthStatus::INERTIAL_UNUSABLE;
        self.residuals += usize::from(!output.status.intersects(unusable));
        self.out_of_model += is(HealthStatus::OUT_OF_MODEL);
        self.restarts += is(HealthStatus::RESTARTED);
    }

    fn finish(self, last: &StepOutput, steps: usize) -> HealthSummary {
        let estimate = |it: Estimate<f32>| [f64::from(it.value), f64::from(it.sigma)];
        HealthSummary {
            verdicts: self.verdicts,
            shares: self.steps.into_iter().map(|(name, of)| (name, of as f64 / steps as f64)).collect(),
            residuals: self.residuals,
            out_of_model: self.out_of_model,
            restarts: self.restarts,
            withheld: self.withheld,
            radio_error: estimate(last.health.radio_error),
            inertial_error: estimate(last.health.inertial_error),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct TruthSums {
    count: usize,
    squares: f64,
    beyond: usize,
    nees: f64,
}

impl TruthSums {
    fn add(&mut self, error: f64, sigma: f64) {
        self.count += 1;
        self.squares += error * error;
        self.beyond += usize::from(error.abs() > 3.0 * sigma);
        self.nees += (error / sigma).powi(2);
    }

    fn finish(&self, (state, unit): (&'static str, &'static str)) -> TruthState {
        let n = self.count.max(1) as f64;
        TruthState {
            state,
            unit,
            rmse: (self.squares / n).sqrt(),
            beyond_three_sigma: self.beyond as f64 / n,
            nees: self.nees / n,
        }
    }
}
