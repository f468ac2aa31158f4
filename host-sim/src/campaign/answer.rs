//! What was concealed: the answer `schuler-answer/1` that is sealed before anybody looks for it.
use serde::{Deserialize, Serialize};

use super::effect::Family;
use super::setting::Kind;

/// What the key `format` says.
pub const FORMAT: &str = "schuler-answer/1";

/// The answer of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Format.
    pub format: String,
    /// Seed of the case.
    pub seed: u64,
    /// Number of the case in its plan.
    pub index: usize,
    /// Name of the group of cases in its plan.
    pub name: String,
    /// Family by which it is reported.
    pub family: Family,
    /// Setting.
    pub setting: Kind,
    /// Rows of the complete record.
    pub rows: usize,
    /// Step, s.
    pub step_s: f64,
    /// The effects; none in a case in which nothing is concealed.
    pub effects: Vec<Effect>,
    /// Findings that are neither asked for nor wrong: what the user's figures are a little off in, and what an effect's own
    /// formula leaves over.
    pub tolerated: Vec<Pair>,
    /// Gain of taking out everything that was concealed, nats, as it happened.
    pub gain_nats: f64,
}

/// A sensor, or a group or part of the loop, and an effect.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pair {
    /// Sensor or group.
    pub sensor: String,
    /// Identifier of the effect; `*` for any.
    pub effect: String,
}

/// A concealed effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Sensor or group that has it.
    pub sensor: String,
    /// Identifier.
    pub effect: String,
    /// Family.
    pub family: Family,
    /// Pairs that are physically the same.
    pub same: Vec<Pair>,
    /// When it acts, if it is local in time, s from the beginning.
    pub interval_s: Option<[f64; 2]>,
    /// When the oracle, which knows its shape and the true noise, finds it to begin, s from the beginning: where its likelihood with
    /// a free size (of a change of noise the true one) and a free onset is largest.
    #[serde(default)]
    pub oracle_onset_s: Option<f64>,
    /// Its true parameters.
    pub parameters: Vec<Parameter>,
    /// Gain of taking it out under the true noise, nats, as it happened.
    pub gain_nats: f64,
    /// The same on average over the noise.
    pub expected_gain_nats: f64,
    /// Part of the average gain that the effect times its coefficient cannot have, nats: how far the physics is from the formula.
    pub form_error_nats: f64,
    /// Longest correlation time of the noise around it, s.
    pub correlation_time_s: f64,
}

/// A true parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

impl Effect {
    /// Whether a pair names this effect or what is physically the same.
    pub fn is(&self, sensor: &str, effect: &str) -> bool {
        (self.sensor == sensor && self.effect == effect)
            || self.same.iter().any(|pair| pair.sensor == sensor && pair.effect == effect)
    }
}

impl Pair {
    /// A pair.
    pub fn new(sensor: &str, effect: &str) -> Self {
        Self { sensor: sensor.to_owned(), effect: effect.to_owned() }
    }
}
