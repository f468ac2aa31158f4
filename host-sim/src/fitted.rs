//! A term that was fitted to a recording, driven by what the simulation knows of its inputs.
//!
//! In: the signal and the amplitude of an exported model (`schuler-model/1`), and the inputs of a step by name; out: what it adds to
//! the reading of that step. Units: SI, temperatures in °C.
use nalgebra::Vector3;
use schuler_explain::export::model::given::word;
use schuler_explain::export::model::signal::{Memory, Signal};

use crate::physics::environment::Environment;
use crate::physics::heat::Lag;
use crate::physics::motion::Kinematics;
use crate::scenario::Scenario;

/// A fitted term.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedDesign {
    /// What the signal is multiplied by.
    pub amplitude: f64,
    /// The signal.
    pub signal: Signal,
}

impl FittedDesign {
    /// Why it cannot be simulated step by step; none where it can.
    pub fn refused(&self) -> Option<&'static str> {
        match self.signal.memory {
            None | Some(Memory::Lag { .. } | Memory::Branch { .. }) => None,
            Some(Memory::Delay { .. } | Memory::Bandwidth { .. }) => {
                Some("it needs rows that a simulation has not come to yet")
            }
        }
    }
}

/// A fitted term at work.
#[derive(Clone, Debug)]
pub struct Fitted {
    design: FittedDesign,
    before: Option<f64>,
    lag: Option<Lag>,
    played: Option<f64>,
}

impl Fitted {
    /// A term at its start.
    pub fn new(design: FittedDesign) -> Self {
        Self { design, before: None, lag: None, played: None }
    }

    /// What it adds to a reading; an input that the simulation does not have is zero.
    pub fn step(&mut self, step_s: f64, inputs: &[(String, f64)]) -> f64 {
        let of = |name: &str| inputs.iter().find(|(known, _)| known == name).map(|(_, value)| *value);
        let now = self.design.signal.sum_at(&of).unwrap_or_default();
        let before = self.before.replace(now).unwrap_or(now);
        let value = match self.design.signal.memory {
            Some(Memory::Lag { tau_s }) => {
                self.lag.get_or_insert(Lag::new(now)).advance(step_s, tau_s, before, now)
            }
            Some(Memory::Branch { half_width }) => {
                let played = self.played.get_or_insert(now);
                *played = played.max(now - half_width).min(now + half_width);
                (now - *played) / half_width
            }
            _ => now,
        };
        self.design.amplitude * value
    }
}

/// Vectors of the body's motion.
const VECTORS: [&str; 6] = ["rate", "force", "angular_acceleration", "velocity", "north", "down"];

/// Names of the inputs that a scenario has for fitted terms.
pub fn inputs_of(scenario: &Scenario) -> Vec<String> {
    let mut names = vec!["time_s".to_owned()];
    names.extend(VECTORS.iter().flat_map(|name| ["x", "y", "z"].map(|axis| format!("{name}_{axis}"))));
    for thermometer in &scenario.recorded.thermometers {
        let column = word(&thermometer.column);
        names.extend([format!("temperature_{column}"), format!("rate_of_{column}")]);
    }
    names.extend(recorded_of("supply_V"));
    names.extend(recorded_of("vibration_rms"));
    names.extend(scenario.recorded.quantities.iter().flat_map(|entry| recorded_of(&entry.column)));
    names
}

/// Names of a recorded quantity, as it is and smoothed.
fn recorded_of(column: &str) -> [String; 2] {
    ["recorded", "smoothed"].map(|kind| format!("{kind}_{}", word(column)))
}

/// The surroundings and the motion in a step.
pub struct Step<'s> {
    /// End of the step, s.
    pub time_s: f64,
    /// Its length, s.
    pub step_s: f64,
    /// Mean rate and specific force.
    pub mean: [Vector3<f64>; 2],
    /// Motion at its begin and end.
    pub ends: [&'s Kinematics; 2],
    /// What surrounds the instruments at its end.
    pub environment: &'s Environment,
    /// Quantities by their columns.
    pub quantities: &'s [(String, f64)],
}

/// Values of the inputs, with the temperatures of the step before, which are replaced.
pub fn inputs(scenario: &Scenario, step: &Step<'_>, before: &mut Vec<f64>) -> Vec<(String, f64)> {
    // The first row is a step after the start.
    let mut inputs = vec![("time_s".to_owned(), step.time_s - step.step_s)];
    let [from, to] = step.ends;
    let body = |vector: Vector3<f64>| to.attitude.inverse() * vector;
    let vectors = [
        step.mean[0],
        step.mean[1],
        (to.rate - from.rate) / step.step_s,
        body(to.velocity),
        body(Vector3::x()),
        body(Vector3::z()),
    ];
    for (name, vector) in VECTORS.iter().zip(vectors) {
        let axes = ["x", "y", "z"].iter().zip(vector.iter());
        inputs.extend(axes.map(|(axis, value)| (format!("{name}_{axis}"), *value)));
    }
    let thermometers = &scenario.recorded.thermometers;
    let now: Vec<f64> = thermometers.iter().map(|it| step.environment.temperature(it.position_m)).collect();
    if before.len() != now.len() {
        before.clone_from(&now);
    }
    for ((thermometer, now), before) in thermometers.iter().zip(&now).zip(&*before) {
        let column = word(&thermometer.column);
        inputs.push((format!("temperature_{column}"), *now));
        inputs.push((format!("rate_of_{column}"), (now - before) / step.step_s));
    }
    *before = now;
    let mut quantity = |column: &str, value: f64| {
        inputs.extend(recorded_of(column).map(|name| (name, value)));
    };
    quantity("supply_V", step.environment.voltage());
    quantity("vibration_rms", step.environment.vibration_rms());
    step.quantities.iter().for_each(|(column, value)| quantity(column, *value));
    inputs
}

#[cfg(test)]
mod tests {
    use schuler_explain::export::model::signal::{Factor, Function};

    use super::*;

    #[test]
    fn a_fitted_lag_is_the_lag_of_its_signal() {
        let square = Factor { function: Function::Power { exponent: 2 }, ..Factor::of("x".to_owned()) };
        let signal = Signal::product(vec![square]).through(Memory::Lag { tau_s: 10.0 });
        let mut term = Fitted::new(FittedDesign { amplitude: 3.0, signal: signal.clone() });
        let time_s: Vec<f64> = (0..50).map(f64::from).collect();
        let x: Vec<f64> = time_s.iter().map(|t| (0.1 * t).sin()).collect();
        let expected = signal.values(&time_s, &|name| (name == "x").then_some(&x[..])).unwrap();
        for (x, expected) in x.iter().zip(expected) {
            let found = term.step(1.0, &[("x".to_owned(), *x)]);
            assert!((found - 3.0 * expected).abs() < 1e-12, "{found}, not {expected}");
        }
    }
}
