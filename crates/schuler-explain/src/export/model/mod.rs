//! What the findings add to the readings, as a model that a simulation can take over.
//!
//! | module | gives |
//! | --- | --- |
//! | [`given`] | the inputs of the model, by name |
//! | [`signal`] | signals: functions of the inputs, and their memories |
//! | [`resolve`] | the signals of an effect in a case |
//! | [`code`] | expressions of a signal in a programming language |
//! | [`python`], [`c`], [`rust`] | the model as a source file |
//!
//! The model of an answer is a list of terms: an amplitude times a signal, at an output. An output is a sensor, or in a Schuler loop the
//! error of its accelerometer or of its gyro. All is in SI units; temperatures are in °C. Every signal was compared with the values that
//! were fitted: where a formula would not give them, the values themselves are an input of the model.
pub mod c;
pub mod code;
pub mod given;
pub mod python;
pub mod resolve;
pub mod rust;
pub mod signal;

use serde::Serialize;

use crate::explanation::{Fit, Parameter};
use given::Input;
use signal::Signal;

/// What the key `format` of a model says.
pub const FORMAT: &str = "schuler-model/1";

/// What the findings of an explanation add to the readings.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Model {
    /// [`FORMAT`].
    pub format: &'static str,
    /// Title of the case.
    pub title: String,
    /// The inputs.
    pub inputs: Vec<Input>,
    /// What is added to.
    pub outputs: Vec<Output>,
    /// What is added.
    pub terms: Vec<Term>,
    /// Noise that was found, which is described and not added.
    pub noise: Vec<Described>,
    /// Findings that are not in the model, and why.
    pub left_out: Vec<LeftOut>,
    /// How well the readings are described without the findings and with them.
    pub fit: Fit,
}

/// An output of the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Output {
    /// Name of the sensor; in a Schuler loop `accelerometer`, `gyro` or `velocity`.
    pub sensor: String,
    /// SI unit of what is added.
    pub unit: &'static str,
    /// Unit in which the case is written.
    pub written_unit: String,
    /// That unit in SI.
    pub written_unit_in_si: f64,
    /// Where it is added.
    pub enters: &'static str,
}

/// A term: amplitude times signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Term {
    /// Place of its finding among those of the explanation.
    pub finding: usize,
    /// Identifier of the effect.
    pub effect: String,
    /// What the finding says, one sentence.
    pub sentence: String,
    /// The output that it is added to.
    pub output: String,
    /// The parameter that its amplitude is.
    pub parameter: String,
    /// Amplitude, SI units.
    pub amplitude: f64,
    /// What the amplitude multiplies.
    pub signal: Signal,
    /// Whether the signal is a table of this recording alone.
    pub is_table: bool,
}

/// A noise.
#[derive(Clone, Debug, Serialize)]
pub struct Described {
    /// Sensor.
    pub sensor: String,
    /// Identifier of the effect.
    pub effect: String,
    /// What the finding says, one sentence.
    pub sentence: String,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
}

/// What is not in the model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Sensor or group.
    pub sensor: String,
    /// Identifier of the effect.
    pub effect: String,
    /// Why.
    pub because: String,
}

impl Model {
    /// What is added to an output in every row of the recording, SI; zeros where nothing is.
    pub fn added(&self, output: &str) -> Vec<f64> {
        let values = |name: &str| self.inputs.iter().find(|input| input.name == name).map(|it| &*it.values);
        let time_s = values(TIME).unwrap_or_default();
        let mut sum = vec![0.0; time_s.len()];
        for term in self.terms.iter().filter(|term| term.output == output) {
            let signal = term.signal.values(time_s, &values).unwrap_or_default();
            sum.iter_mut().zip(signal).for_each(|(sum, value)| *sum += term.amplitude * value);
        }
        sum
    }

    /// What the user of the model should be told, one sentence each.
    pub fn cautions(&self) -> Vec<String> {
        let tables = self.terms.iter().filter(|term| term.is_table).map(|term| {
            format!(
                "{} of {} has no formula: its values are those of this recording and hold for no other",
                term.effect, term.output
            )
        });
        let noise = self.noise.iter().map(|noise| {
            format!(
                "{} of {} is noise: it is described in the model and adds nothing",
                noise.effect, noise.sensor
            )
        });
        let left_out = self
            .left_out
            .iter()
            .map(|it| format!("{} of {} is not in the model, because {}", it.effect, it.sensor, it.because));
        tables.chain(noise).chain(left_out).collect()
    }
}

/// Name of the input that every model has.
pub const TIME: &str = "time_s";
