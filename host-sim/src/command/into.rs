//! `schuler explain CASE.toml --into SCENARIO.toml --out DIR`: the scenario of `schuler simulate` with what was found.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_explain::export::model::signal::{Factor, Function, Memory, Signal};
use schuler_explain::export::model::{Model, Term};
use schuler_recording::{Error, Leniency, Problem, file};

use super::Failure;
use crate::output;
use crate::scenario::{ErrorSource, ScenarioFile};

/// Name of the scenario with what was found.
pub(super) const SCENARIO: &str = "scenario.toml";

/// What a scenario has taken of a model.
pub(super) struct Taken {
    /// The scenario that was written.
    pub(super) path: PathBuf,
    /// What it has not taken, one sentence each.
    pub(super) left_out: Vec<String>,
}

/// Makes sure that the scenario can be read, and the one with what was found be written.
pub(super) fn check(scenario: &Path, out: &Path, leniency: Leniency) -> Result<(), Error> {
    output::protect(scenario);
    output::check(&out.join(SCENARIO))?;
    ScenarioFile::parse_with(scenario, &file::text(scenario, "read the scenario")?, leniency).map(|_| ())
}

/// Writes a scenario with blocks for what a model adds.
pub(super) fn write(
    model: &Model,
    scenario: &Path,
    out: &Path,
    leniency: Leniency,
) -> Result<Taken, Failure> {
    let mut text = file::text(scenario, "read the scenario")?;
    if !text.ends_with('\n') {
        text.push('\n');
    }
    let mut left_out = Vec::new();
    let mut waves: Option<&Term> = None;
    for (place, term) in model.terms.iter().enumerate() {
        if term.is_table {
            left_out.push(format!(
                "{} of {} has no formula, and its values are those of this recording",
                term.effect, term.output
            ));
            continue;
        }
        // Cosine and sine of a line are one machine.
        let is_sine = |next: &&Term| {
            next.finding == term.finding && next.output == term.output && next.parameter == "b"
        };
        if term.effect == "periodic_line"
            && term.parameter == "a"
            && model.terms.get(place + 1).as_ref().is_some_and(is_sine)
        {
            waves = Some(term);
            continue;
        }
        let sensor = sensor_of(&text, scenario, &term.output, leniency);
        let cosine = waves.take();
        let own = own(term, cosine).map(|keys| vec![block(&sensor, &term.effect, &keys)]);
        let fitted = cosine
            .into_iter()
            .chain([term])
            .map(|term| fitted(&sensor, term))
            .collect::<Result<Vec<_>, _>>()?;
        let mut refused = String::new();
        let taken = own.into_iter().chain([fitted]).find_map(|blocks| {
            let with = text.clone() + &commented(term) + &blocks.concat();
            match ScenarioFile::parse_with(scenario, &with, leniency) {
                Ok(_) => Some(with),
                Err(error) => {
                    refused =
                        error.problems.first().map_or_else(String::new, |problem| problem.message.clone());
                    None
                }
            }
        });
        match taken {
            Some(with) => text = with,
            None => {
                left_out.push(format!("{} of {} cannot be simulated: {refused}", term.effect, term.output));
            }
        }
    }
    let others = model
        .noise
        .iter()
        .map(|it| format!("{} of {} is noise: set it in the scenario\'s .noise", it.effect, it.sensor));
    left_out.extend(others);
    left_out
        .extend(model.left_out.iter().map(|it| format!("{} of {}: {}", it.effect, it.sensor, it.because)));
    let path = out.join(SCENARIO);
    output::write(&path, text.as_bytes())?;
    Ok(Taken { path, left_out })
}

/// The output of a scenario that an output of a model is: the velocity of a loop and the instruments that drive it have ids of their own.
fn sensor_of(text: &str, path: &Path, output: &str, leniency: Leniency) -> String {
    let parsed = ScenarioFile::parse_with(path, text, leniency).ok();
    let of_loop = parsed.and_then(|it| it.scenario.schuler_loop).and_then(|entry| {
        let instrument = |source| match source {
            ErrorSource::Instrument(id) => Some(id),
            ErrorSource::Process { .. } => None,
        };
        match output {
            "velocity" => Some(entry.id),
            "accelerometer" => instrument(entry.accelerometer),
            "gyro" => instrument(entry.gyro),
            _ => None,
        }
    });
    of_loop.unwrap_or_else(|| output.to_owned())
}

/// Keys of a block that a part of the instrument makes; none where no such part is known.
fn own(term: &Term, cosine: Option<&Term>) -> Option<Vec<(&'static str, f64)>> {
    let coefficient = ("coefficient", term.amplitude);
    let memory = term.signal.memory;
    match (term.effect.as_str(), memory, factors(&term.signal)?) {
        ("bias_step" | "bias_drift_linear", None, [factor]) => {
            Some(vec![coefficient, ("onset_s", factor.reference)])
        }
        ("bias_temperature" | "bias_temperature_sq" | "bias_temperature_cubic", None, [factor]) => {
            Some(vec![coefficient, ("reference_degC", factor.reference)])
        }
        ("bias_supply_voltage", None, [factor]) => Some(vec![coefficient, ("reference_V", factor.reference)]),
        ("periodic_line", None, [Factor { function: Function::Sine { frequency_hz }, .. }]) => {
            Some(vec![("a", cosine?.amplitude), ("b", term.amplitude), ("frequency_hz", *frequency_hz)])
        }
        (_, None, []) | ("scale_factor", None, [_]) => Some(vec![coefficient]),
        ("time_delay", Some(Memory::Delay { delay_s, .. }), [_]) => Some(vec![("delay_s", delay_s)]),
        ("bandwidth_lag", Some(Memory::Bandwidth { tau_s }), [_]) => Some(vec![("tau_s", tau_s)]),
        _ => None,
    }
}

/// The factors of a signal that is one product with the coefficient 1.
fn factors(signal: &Signal) -> Option<&[Factor]> {
    match &signal.sum[..] {
        [product] if product.coefficient == 1.0 => Some(&product.factors),
        _ => None,
    }
}

/// What a term is, as a comment above its block.
fn commented(term: &Term) -> String {
    let plain: String = term.sentence.chars().filter(|it| !it.is_control()).collect();
    format!("\n# {plain}\n")
}

fn block(sensor: &str, effect: &str, keys: &[(&str, f64)]) -> String {
    // What multiplies nothing is a constant, whatever it was found beside.
    let is_constant = matches!(keys, [("coefficient", _)]) && effect != "scale_factor";
    let effect = if is_constant { "bias_constant" } else { effect };
    let mut text = format!("[[disturbance]]\nsensor = {}\neffect = \"{effect}\"\n", quoted(sensor));
    for (key, value) in keys {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{key} = {value:?}");
    }
    text
}

/// A block with the signal itself.
fn fitted(sensor: &str, term: &Term) -> Result<String, Failure> {
    let signal = serde_json::to_string(&term.signal).map_err(anyhow::Error::from)?;
    let (sensor, effect, signal) = (quoted(sensor), &term.effect, quoted(&signal));
    let amplitude = term.amplitude;
    Ok(format!(
        "[[disturbance]]\nsensor = {sensor}\neffect = \"{effect}\"\namplitude = {amplitude:?}\nsignal = {signal}\n"
    ))
}

/// A text as a string of TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// What became of it, in words.
pub(super) fn words(left_out: &[String]) -> String {
    let mut text = String::new();
    if !left_out.is_empty() {
        text.push_str("\nNot in the scenario:\n");
    }
    for it in left_out {
        let _ = writeln!(text, "  {it}.");
    }
    text
}

/// A scenario needs a directory to be written to.
pub(super) fn out_of<'o>(scenario: &Path, out: Option<&'o PathBuf>) -> Result<&'o PathBuf, Error> {
    out.ok_or_else(|| {
        Error::one(
            scenario,
            Problem::of_file("needs --out: the directory for the scenario with what was found"),
        )
    })
}
