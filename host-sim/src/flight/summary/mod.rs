//! What a run says: of the filter's consistency, of the noise, of the gyros, and of the truth where it is known.
use schuler_core::module::{Status, StepOutput};
use serde::Serialize;

use super::outputs::STATES;
use super::truth::LoopStates;
use super::{Channel, Flown, Step};

use block::BlockSums;
use compensation::CompensationSums;
use filter::FilterSums;
use health::HealthSums;
use thermometer::ThermometerSums;
use truth::TruthSums;

pub use block::{BlockSummary, VerdictChange};
pub use compensation::{CompensationSummary, CorrectedSensor};
pub use filter::{FilterSummary, StateSummary, normalised_innovation, was_used};
pub use health::{HealthChange, HealthSummary, health_name};
pub use identification::{IdentificationSummary, NoiseSummary};
pub use thermometer::ThermometerSummary;
pub use truth::{TruthState, TruthSummary};

mod block;
mod compensation;
mod filter;
mod health;
mod identification;
mod thermometer;
mod truth;

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
                accelerometer: identification::noise(&end.accelerometer, channel.config.filter.accelerometer),
                gyro: identification::noise(&end.gyro, channel.config.filter.gyro),
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
                states: (STATES.iter().zip(&self.truth))
                    .map(|((state, unit), sums)| sums.finish(state, unit))
                    .collect(),
            }),
        }
    }
}
