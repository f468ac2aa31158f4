//! `[[disturbance]]`: an effect of the catalogue at an output, made by a part of the instrument where there is one, else by the term that was
//! fitted.
//!
//! Amplitudes are in SI units, temperatures in °C, times from the first row of the recording, as in an answer.
//!
//! | effect | keys | made by |
//! | --- | --- | --- |
//! | `bias_constant` | `coefficient` | offset of the electronics |
//! | `bias_step`, `bias_drift_linear` | `coefficient`, `onset_s` | fault of the output |
//! | `bias_temperature`, `_sq`, `_cubic` | `coefficient`, `reference_degC` | bridge of resistors at the instrument |
//! | `bias_supply_voltage` | `coefficient`, `reference_V` | offset of the electronics with the supply |
//! | `periodic_line` | `a`, `b`, `frequency_hz` | rotating machine |
//! | `scale_factor` | `coefficient` | gain of torquer or log |
//! | `time_delay` | `delay_s` | clock of the instrument |
//! | `bandwidth_lag` | `tau_s` | its bandwidth |
//! | every effect | `amplitude`, `signal` = a signal of `schuler-model/1` as JSON | that signal of the simulation's own quantities |
use std::f64::consts::{PI, TAU};

use schuler_explain::catalogue::{CATALOGUE, SETUP};
use schuler_explain::export::model::signal::Signal;
use schuler_recording::document::Node;

use super::{ClockEntry, ErrorSource, FaultEntry, FittedEntry, ParasiteEntry, Scenario};
use crate::fitted::{FittedDesign, inputs_of};
use crate::physics::fault::{Fault, TimedFault};
use crate::physics::parasite::Disturbance;
use crate::physics::readout::{REFERENCE_TEMPERATURE, REFERENCE_VOLTAGE, ReadoutDesign};

/// Keys of all effects.
const KEYS: [&str; 12] = [
    "amplitude",
    "signal",
    "coefficient",
    "onset_s",
    "reference_degC",
    "reference_V",
    "a",
    "b",
    "frequency_hz",
    "delay_s",
    "tau_s",
    "sensor",
];

/// A block.
pub(super) struct Block {
    sensor: String,
    effect: &'static str,
    made: Made,
}

/// What makes it.
enum Made {
    Offset(f64),
    Step {
        size: f64,
        onset_s: f64,
    },
    Ramp {
        rate: f64,
        onset_s: f64,
    },
    /// Coefficient, power and reference.
    Bridge(f64, u8, f64),
    Supply {
        coefficient: f64,
        reference: f64,
    },
    Line {
        a: f64,
        b: f64,
        frequency_hz: f64,
    },
    Gain(f64),
    Late {
        delay_s: f64,
        lag_s: f64,
    },
    Fitted(FittedDesign),
}

/// Reads a block.
pub(super) fn block(node: &Node<'_>) -> Option<Block> {
    let sensor = node.required("sensor", "the id of an output").and_then(|field| field.text());
    let names: Vec<(&str, &'static str)> =
        CATALOGUE.iter().chain(SETUP.iter().copied()).map(|effect| (effect.id, effect.id)).collect();
    let effect = node.required("effect", "an effect of the catalogue").and_then(|field| field.one_of(&names));
    let Some(effect) = effect else {
        // What is wrong is the effect, and not the keys that it would have.
        for key in KEYS {
            node.optional(key);
        }
        return None;
    };
    let made = if node.optional("signal").is_some() { fitted(node) } else { own(node, effect) };
    Some(Block { sensor: sensor?, effect, made: made? })
}

fn fitted(node: &Node<'_>) -> Option<Made> {
    let amplitude = number(node, "amplitude", "the amplitude, SI units");
    let field = node.optional("signal")?;
    let text = field.text()?;
    let signal: Signal = match serde_json::from_str(&text) {
        Ok(signal) => signal,
        Err(error) => return field.problem(format!("{error}; expected a signal of schuler-model/1 as JSON")),
    };
    let design = FittedDesign { amplitude: amplitude?, signal };
    match design.refused() {
        Some(because) => field.problem(format!("found a memory that cannot be simulated: {because}")),
        None => Some(Made::Fitted(design)),
    }
}

fn own(node: &Node<'_>, effect: &str) -> Option<Made> {
    let coefficient = || number(node, "coefficient", "the coefficient, SI units");
    let from_start = |key: &'static str| node.optional(key).map_or(Some(0.0), |field| field.number());
    match effect {
        "bias_constant" => Some(Made::Offset(coefficient()?)),
        "bias_step" => {
            let (size, onset_s) =
                (coefficient(), number(node, "onset_s", "when it begins, s from the first row"));
            Some(Made::Step { size: size?, onset_s: onset_s? })
        }
        "bias_drift_linear" => {
            let (rate, onset_s) = (coefficient(), from_start("onset_s"));
            Some(Made::Ramp { rate: rate?, onset_s: onset_s? })
        }
        "bias_temperature" | "bias_temperature_sq" | "bias_temperature_cubic" => {
            let power = match effect {
                "bias_temperature" => 1,
                "bias_temperature_sq" => 2,
                _ => 3,
            };
            let reference = node.optional("reference_degC");
            let reference = reference.map_or(Some(REFERENCE_TEMPERATURE), |field| field.number());
            Some(Made::Bridge(coefficient()?, power, reference?))
        }
        "bias_supply_voltage" => {
            let reference = node.optional("reference_V");
            let reference = reference.map_or(Some(REFERENCE_VOLTAGE), |field| field.number());
            Some(Made::Supply { coefficient: coefficient()?, reference: reference? })
        }
        "periodic_line" => {
            let (a, b) = (from_start("a"), from_start("b"));
            let frequency = node.required("frequency_hz", "a number greater than zero");
            let frequency =
                frequency.and_then(|it| it.number_where("a number greater than zero", |n| n > 0.0));
            Some(Made::Line { a: a?, b: b?, frequency_hz: frequency? })
        }
        "scale_factor" => Some(Made::Gain(coefficient()?)),
        "time_delay" => Some(Made::Late { delay_s: not_negative(node, "delay_s")?, lag_s: 0.0 }),
        "bandwidth_lag" => Some(Made::Late { delay_s: 0.0, lag_s: not_negative(node, "tau_s")? }),
        _ => {
            let expected = "a signal of schuler-model/1 as JSON, because no part of an instrument makes this effect here";
            node.required("signal", expected).and(None)
        }
    }
}

fn number(node: &Node<'_>, key: &'static str, expected: &str) -> Option<f64> {
    node.required(key, expected).and_then(|field| field.number())
}

fn not_negative(node: &Node<'_>, key: &'static str) -> Option<f64> {
    let expected = "a number not less than zero";
    node.required(key, expected).and_then(|field| field.number_where(expected, |n| n >= 0.0))
}

/// Puts blocks into a scenario.
pub(super) fn place(scenario: &mut Scenario, blocks: Vec<Block>, node: &Node<'_>) -> Option<()> {
    let known = reached(scenario);
    for (index, Block { sensor, effect, made }) in blocks.into_iter().enumerate() {
        if !known.contains(&sensor) {
            let found = format!("found \"{sensor}\"; expected one of {}", known.join(", "));
            return node.problem_at(&format!("disturbance[{index}].sensor"), &found);
        }
        if let Made::Fitted(FittedDesign { signal, .. }) = &made {
            let inputs = inputs_of(scenario);
            if let Some(missing) = signal.inputs().find(|name| !inputs.iter().any(|known| known == name)) {
                let found = format!("found the input {missing}; expected one of {}", inputs.join(", "));
                return node.problem_at(&format!("disturbance[{index}].signal"), &found);
            }
        }
        if !placed(scenario, &sensor, made) {
            let found = format!(
                "found \"{sensor}\", which has no part that makes {effect}; expected another output, or the keys amplitude and signal"
            );
            return node.problem_at(&format!("disturbance[{index}].sensor"), &found);
        }
    }
    Some(())
}

/// Ids of the outputs, and the errors that drive a loop.
fn reached(scenario: &Scenario) -> Vec<String> {
    let schuler_loop = scenario.schuler_loop.as_ref();
    let outputs = super::outputs(&scenario.gyros, &scenario.accelerometers, &scenario.dopplers, schuler_loop);
    let of_loop = ["accelerometer", "gyro"].into_iter().filter(|name| scenario.drives_loop(name));
    outputs.into_iter().map(|(id, _)| id).chain(of_loop.map(str::to_owned)).collect()
}

impl Scenario {
    /// Whether a name is that of an error that drives the Schuler loop, and of no instrument.
    pub(crate) fn drives_loop(&self, name: &str) -> bool {
        let Some(entry) = &self.schuler_loop else { return false };
        let source = match name {
            "accelerometer" => &entry.accelerometer,
            "gyro" => &entry.gyro,
            _ => return false,
        };
        let is_instrument = self.accelerometers.iter().any(|it| it.id == name)
            || self.gyros.iter().any(|it| it.ids.0 == name || it.ids.1.as_deref() == Some(name));
        matches!(source, ErrorSource::Process { .. }) && !is_instrument
    }
}

/// Puts one into a scenario; whether there is a part for it.
fn placed(scenario: &mut Scenario, sensor: &str, made: Made) -> bool {
    let step_s = scenario.step_s;
    let sensor_name = sensor.to_owned();
    // The first row is a step after the start.
    let fault = |fault: Fault, onset_s: f64| {
        let fault = TimedFault { fault, onset_s: onset_s + step_s, end_s: f64::INFINITY };
        FaultEntry { sensor: sensor.to_owned(), fault }
    };
    let is_of_loop = scenario.drives_loop(sensor);
    // What is in the electronics or the clock of a gyro of two axes is in both.
    let has_two = |ids: &(String, Option<String>)| {
        ids.1.is_some() && (ids.0 == sensor || ids.1.as_deref() == Some(sensor))
    };
    let has_two_axes = scenario.gyros.iter().any(|gyro| has_two(&gyro.ids));
    match made {
        Made::Bridge(..) | Made::Line { .. } | Made::Late { .. } if has_two_axes => return false,
        Made::Offset(offset) => {
            // The sources of a loop's errors have no electronics of their own.
            let Some(readout) = readout_of(scenario, sensor) else {
                let disturbance = Disturbance::Switched(vec![(0.0, offset)]);
                scenario.parasites.push(ParasiteEntry { sensor: sensor_name, disturbance });
                return true;
            };
            readout.offset += offset;
        }
        Made::Step { size, onset_s } if is_of_loop => {
            let disturbance = Disturbance::Switched(vec![(onset_s + step_s, size)]);
            scenario.parasites.push(ParasiteEntry { sensor: sensor_name, disturbance });
        }
        Made::Ramp { .. } | Made::Gain(_) | Made::Late { .. } if is_of_loop => return false,
        Made::Step { size, onset_s } => scenario.faults.push(fault(Fault::Step(size), onset_s)),
        Made::Ramp { rate, onset_s } => scenario.faults.push(fault(Fault::Ramp(rate), onset_s)),
        Made::Bridge(coefficient, power, balanced) => {
            let part = |of: u8| if of == power { coefficient } else { 0.0 };
            let (first, second, third) = (part(1), part(2), part(3));
            let disturbance = Disturbance::Bridge { first, second, third, balanced };
            scenario.parasites.push(ParasiteEntry { sensor: sensor_name, disturbance });
        }
        Made::Supply { coefficient, reference } => {
            let Some(readout) = readout_of(scenario, sensor) else { return false };
            readout.offset_voltage += coefficient;
            readout.offset += coefficient * (REFERENCE_VOLTAGE - reference);
        }
        Made::Line { a, b, frequency_hz } => {
            let disturbance = machine([a, b], frequency_hz, step_s, scenario.duration_s);
            scenario.parasites.push(ParasiteEntry { sensor: sensor_name, disturbance });
        }
        Made::Gain(gain) => return with_gain(scenario, sensor, gain),
        Made::Late { delay_s, lag_s } => {
            if let Some(doppler) = scenario.dopplers.iter_mut().find(|it| it.id == sensor) {
                doppler.design.delay_s += delay_s;
                return lag_s == 0.0;
            }
            if let Some(of_loop) = scenario.schuler_loop.as_mut().filter(|it| it.id == sensor) {
                of_loop.delay_s += delay_s;
                return lag_s == 0.0;
            }
            match scenario.clocks.iter_mut().find(|clock| clock.sensors == [sensor]) {
                Some(clock) => (clock.delay_s, clock.lag_s) = (clock.delay_s + delay_s, clock.lag_s + lag_s),
                None => scenario.clocks.push(ClockEntry { sensors: vec![sensor_name], delay_s, lag_s }),
            }
        }
        Made::Fitted(design) => scenario.fitted.push(FittedEntry { sensor: sensor_name, design }),
    }
    true
}

/// A machine whose line in the readings is a cos 2πft + b sin 2πft, t from the first row. A reading is the mean over its step, in which a line
/// is smaller and half a step later.
fn machine([a, b]: [f64; 2], frequency_hz: f64, step_s: f64, over_s: f64) -> Disturbance {
    let within = PI * frequency_hz * step_s;
    let mean = (2.0 * within.cos() + 4.0) / 6.0;
    Disturbance::Machine {
        amplitude: a.hypot(b) / mean,
        start_hz: frequency_hz,
        end_hz: frequency_hz,
        over_s,
        phase: a.atan2(b) + within - TAU * frequency_hz * step_s,
    }
}

fn with_gain(scenario: &mut Scenario, sensor: &str, gain: f64) -> bool {
    // A torquer's gain is seen through its inverse.
    let through = |own: f64| (1.0 + own) / (1.0 + gain) - 1.0;
    if let Some(it) = scenario.gyros.iter_mut().find(|it| it.ids.0 == sensor) {
        it.design.torquer[0].gain = through(it.design.torquer[0].gain);
    } else if let Some(it) = scenario.gyros.iter_mut().find(|it| it.ids.1.as_deref() == Some(sensor)) {
        it.design.torquer[1].gain = through(it.design.torquer[1].gain);
    } else if let Some(it) = scenario.accelerometers.iter_mut().find(|it| it.id == sensor) {
        it.design.torquer.gain = through(it.design.torquer.gain);
    } else if let Some(it) = scenario.dopplers.iter_mut().find(|it| it.id == sensor) {
        it.design.scale_factor += gain;
    } else {
        return false;
    }
    true
}

/// The read-out of an output.
fn readout_of<'s>(scenario: &'s mut Scenario, sensor: &str) -> Option<&'s mut ReadoutDesign> {
    for gyro in &mut scenario.gyros {
        let axis =
            [Some(gyro.ids.0.as_str()), gyro.ids.1.as_deref()].iter().position(|id| *id == Some(sensor));
        if let Some(axis) = axis {
            return gyro.design.readout.get_mut(axis);
        }
    }
    if let Some(it) = scenario.accelerometers.iter_mut().find(|it| it.id == sensor) {
        return Some(&mut it.design.readout);
    }
    scenario.dopplers.iter_mut().find(|it| it.id == sensor).map(|it| &mut it.design.readout)
}
