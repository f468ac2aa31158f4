//! From findings to the block by which the flight module corrects its inputs, and why the other findings stay on the ground.
//!
//! A term of the block is a coefficient times at most two powers of a temperature, its rate, a difference of two
//! thermometers, a rate, a specific force or the sensor's own input ([`schuler_core::compensation`]); what is not of
//! this form cannot be compensated in flight. Coefficients leave the units of the answer for SI here.
use nalgebra::Vector3;
use schuler_core::compensation::{Block, Factor, MAX_TERMS, Quantity, Target, Term, Validity};
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, Quantity as Recorded, Sensor};
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY, Unit};
use serde::Serialize;

use crate::catalogue::{AT_MEAN, GyroAxis, HAS_NO_TERM, InFlight, Part, named};
use crate::explanation::{Explanation, Finding, Parameter};

/// Axes within this of each other, cosine, are the same: 0.8°.
const SAME_AXIS: f64 = 0.9999;
/// Time over which the rate of a temperature is measured for the range of validity, s.
const RATE_OVER_S: f64 = 600.0;
/// Least limit of the rate of a temperature, K/s: thermometers drift a little even at rest.
const LEAST_RATE: f64 = 1.0 / 3600.0;

/// Which sensors of a case stand at which inputs of the flight module.
#[derive(Clone, Debug, Default)]
pub struct Stations {
    /// Id of the sensor and its input among the gyros.
    pub gyros: Vec<(String, u8)>,
    /// Id of the sensor and its input among the accelerometers.
    pub accelerometers: Vec<(String, u8)>,
    /// Columns of the thermometers in the order of the inputs.
    pub thermometers: Vec<String>,
}

/// What flies of an explanation.
#[derive(Clone, Debug)]
pub struct Deployment {
    /// The block; without a term where nothing can be compensated.
    pub block: Block,
    /// What becomes of each finding, in their order.
    pub findings: Vec<Deployed>,
}

/// What becomes of a finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Deployed {
    /// Sensor or group.
    pub sensor: String,
    /// Identifier of the effect.
    pub effect: String,
    /// Terms in the block.
    pub terms: usize,
    /// Why it cannot be compensated in flight.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub because: Option<String>,
    /// What to think of before it flies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caution: Option<String>,
}

/// What of the explanation flies. Never panics.
pub fn deploy(explanation: &Explanation, recording: &Recording, stations: &Stations) -> Deployment {
    let context = Context { recording, stations };
    let mut block = Block { validity: context.validity(), ..Block::default() };
    let findings = explanation
        .findings
        .iter()
        .map(|finding| {
            let before = block.terms.len();
            let because = context.terms(finding).and_then(|terms| {
                if before + terms.len() > MAX_TERMS {
                    return Err(format!("a block has at most {MAX_TERMS} terms"));
                }
                let mut with = block.clone();
                with.terms.extend(terms);
                with.validate().map_err(|error| format!("the module would refuse it: {error}"))?;
                block = with;
                Ok(())
            });
            Deployed {
                sensor: finding.sensor.clone(),
                effect: finding.effect.clone(),
                terms: block.terms.len() - before,
                caution: because.is_ok().then(|| caution(finding)).flatten(),
                because: because.err(),
            }
        })
        .collect();
    Deployment { block, findings }
}

/// What to think of before a finding flies.
fn caution(finding: &Finding) -> Option<String> {
    let mut cautions = Vec::new();
    let others: Vec<String> =
        finding.rivals().iter().map(|rival| format!("{} of {}", rival.effect, rival.sensor)).collect();
    if !others.is_empty() {
        cautions.push(format!(
            "the data cannot tell it from {}: it holds for profiles like this one only",
            others.join(", ")
        ));
    }
    if finding.parameters.iter().any(|it| it.plausible == Some(false)) {
        cautions.push("a parameter is not plausible for such a sensor".to_owned());
    }
    (!cautions.is_empty()).then(|| cautions.join("; "))
}

struct Context<'c> {
    recording: &'c Recording,
    stations: &'c Stations,
}

impl<'c> Context<'c> {
    /// The terms of a finding, or why it has none.
    fn terms(&self, finding: &Finding) -> Result<Vec<Term>, String> {
        let parts = parts(finding)?;
        let coefficient = value_of(finding, "coefficient")?.ok_or("it has no single coefficient")?;
        let divisor = match parts {
            [Part::TemperatureDifference, _] => self.distance(finding)?,
            _ => 1.0,
        };
        let mut terms = Vec::new();
        for (target, sensor) in self.targets(finding, parts)? {
            terms.push(self.term(finding, target, sensor, parts, coefficient / divisor)?);
            // What it is at the mean of a temperature whose reference is not known.
            if let Some(at_mean) = value_of(finding, AT_MEAN)? {
                let without = parts.map(|part| match part {
                    Part::Temperature(_) | Part::TemperatureDifference => Part::One,
                    other => other,
                });
                terms.push(self.term(finding, target, sensor, without, at_mean)?);
            }
        }
        Ok(terms)
    }

    fn term(
        &self,
        finding: &Finding,
        target: Target,
        sensor: Option<&Sensor>,
        parts: [Part; 2],
        value: f64,
    ) -> Result<Term, String> {
        let mut sign = 1.0;
        let mut factors = [Factor::default(); 2];
        for (factor, part) in factors.iter_mut().zip(parts) {
            let (found, turned) = self.factor(finding, sensor, part)?;
            *factor = found;
            sign *= turned;
        }
        Ok(Term { target, coefficient: (sign * value) as f32, factors })
    }

    /// The inputs that a finding disturbs, each with its sensor.
    fn targets(
        &self,
        finding: &Finding,
        parts: [Part; 2],
    ) -> Result<Vec<(Target, Option<&'c Sensor>)>, String> {
        if self.recording.case.motion.kind == MotionKind::VelocityError {
            return match finding.sensor.as_str() {
                "accelerometer" => Ok(vec![(Target::LoopAccelerometer, None)]),
                "gyro" => Ok(vec![(Target::LoopGyro, None)]),
                "velocity" => Ok(vec![(Target::Velocity, None)]),
                other => Err(format!("{other} is no part of the Schuler loop")),
            };
        }
        let of_group = |sensor: &Sensor| sensor.group.as_ref() == Some(&finding.sensor);
        let sensors: Vec<&'c Sensor> = (self.recording.sensors.iter().map(|series| &series.sensor))
            .filter(|sensor| sensor.id == finding.sensor || of_group(sensor))
            .collect();
        let whole = sensors.iter().all(|sensor| sensor.id != finding.sensor);
        if sensors.is_empty() {
            return Err(format!("{} is no sensor of the case", finding.sensor));
        }
        if whole && !matches!(parts, [Part::Input(1), Part::One]) {
            return Err("it belongs to a whole instrument, and the block corrects sensors".to_owned());
        }
        let targets: Vec<(Target, Option<&Sensor>)> =
            sensors.iter().filter_map(|sensor| Some((self.target(sensor)?, Some(*sensor)))).collect();
        if targets.is_empty() {
            return Err(format!("{} stands at no input of the flight module", finding.sensor));
        }
        Ok(targets)
    }

    fn target(&self, sensor: &Sensor) -> Option<Target> {
        let among = |places: &[(String, u8)]| places.iter().find(|(id, _)| *id == sensor.id).map(|(_, k)| *k);
        match sensor.kind.dimension() {
            Dimension::AngularRate => among(&self.stations.gyros).map(Target::Gyro),
            Dimension::Acceleration => among(&self.stations.accelerometers).map(Target::Accelerometer),
            Dimension::Velocity | Dimension::Other => None,
        }
    }

    /// The factor, and the sign that turns its axis into that of the sensor that measures it.
    fn factor(
        &self,
        finding: &Finding,
        sensor: Option<&Sensor>,
        part: Part,
    ) -> Result<(Factor, f64), String> {
        let of = |quantity: Quantity| Ok((Factor::from(quantity), 1.0));
        let power = |quantity, power| Ok((Factor { power, ..Factor::from(quantity) }, 1.0));
        match part {
            Part::One => of(Quantity::One),
            Part::Temperature(exponent) => {
                let (thermometer, column) = self.thermometer(finding)?;
                let reference = reference(finding, sensor, column)
                    .ok_or("the temperature at which it vanishes is not known")?;
                let quantity = Quantity::Temperature(thermometer);
                Ok((Factor { quantity, reference: reference as f32, power: exponent }, 1.0))
            }
            Part::TemperatureRate => of(Quantity::TemperatureRate(self.thermometer(finding)?.0)),
            Part::TemperatureDifference => {
                let [to, from] = columns(finding).ok_or("it does not say between which thermometers")?;
                let quantity = Quantity::TemperatureDifference(self.place(to)?, self.place(from)?);
                let reference = taken_reference(finding).unwrap_or_default();
                Ok((Factor { reference: reference as f32, ..Factor::from(quantity) }, 1.0))
            }
            Part::Input(exponent) => power(Quantity::Input, exponent),
            Part::InputMagnitude => of(Quantity::InputMagnitude),
            Part::InputAcross | Part::ForceAcross => {
                let sensor = sensor.ok_or("the loop has no axes")?;
                let dimension = match part {
                    Part::InputAcross => sensor.kind.dimension(),
                    _ => Dimension::Acceleration,
                };
                let axis = match text(finding, "axis") {
                    Some("x") => Vector3::x(),
                    Some("y") => Vector3::y(),
                    Some("z") => Vector3::z(),
                    _ => return Err("it does not say along which body axis".to_owned()),
                };
                // The catalogue's axis is at right angles to the sensor's own.
                let own = axes(sensor, GyroAxis::Input)?;
                let across = (axis - own * own.dot(&axis)).try_normalize(1e-3).unwrap_or(axis);
                self.along(dimension, across)
            }
            Part::Force(axis) => {
                self.along(Dimension::Acceleration, axes(sensor.ok_or("the loop has no axes")?, axis)?)
            }
            Part::Rate(axis) => {
                self.along(Dimension::AngularRate, axes(sensor.ok_or("the loop has no axes")?, axis)?)
            }
        }
    }

    /// The sensor at an input that measures along `axis`.
    fn along(&self, dimension: Dimension, axis: Vector3<f64>) -> Result<(Factor, f64), String> {
        let (places, name) = match dimension {
            Dimension::AngularRate => (&self.stations.gyros, "gyro"),
            _ => (&self.stations.accelerometers, "accelerometer"),
        };
        let found = places.iter().find_map(|(id, place)| {
            let own = Vector3::from(self.recording.sensor(id)?.sensor.axis?);
            let cosine = own.dot(&axis) / own.norm();
            (cosine.abs() > SAME_AXIS).then_some((*place, cosine.signum()))
        });
        let (place, sign) =
            found.ok_or_else(|| format!("no {name} measures along the axis that it needs"))?;
        let quantity = match dimension {
            Dimension::AngularRate => Quantity::Rate(place),
            _ => Quantity::SpecificForce(place),
        };
        Ok((Factor::from(quantity), sign))
    }

    /// The thermometer of a finding: that of its parameter `column`, or the one near its sensor.
    fn thermometer(&self, finding: &Finding) -> Result<(u8, &'c str), String> {
        let recorded: Vec<&'c str> = (self.recording.auxiliaries.iter())
            .map(|series| &series.auxiliary)
            .filter(|it| it.quantity == Recorded::Temperature)
            .filter(|it| match text(finding, "column") {
                Some(column) => it.column == column,
                None => it.near.as_ref() == Some(&finding.sensor),
            })
            .map(|it| it.column.as_str())
            .collect();
        match recorded[..] {
            [column] => Ok((self.place(column)?, column)),
            _ => Err("it does not say on which thermometer it depends".to_owned()),
        }
    }

    fn place(&self, column: &str) -> Result<u8, String> {
        let place = self.stations.thermometers.iter().position(|it| it == column);
        let place = place.and_then(|place| u8::try_from(place).ok());
        place.ok_or_else(|| format!("{column} stands at no input of the flight module"))
    }

    /// By what the coefficient is to be divided to be per kelvin.
    fn distance(&self, finding: &Finding) -> Result<f64, String> {
        let per_metre = |it: &Parameter| it.unit.as_ref().is_some_and(|unit| unit.ends_with("(K/m)"));
        if !finding.parameters.iter().any(per_metre) {
            return Ok(1.0);
        }
        let [to, from] = columns(finding).ok_or("it does not say between which thermometers")?;
        let position = |column: &str| self.recording.auxiliary(column)?.auxiliary.position_m;
        let distance =
            position(to).zip(position(from)).map(|(a, b)| (Vector3::from(a) - Vector3::from(b)).norm());
        distance
            .filter(|it| *it > 0.0)
            .ok_or_else(|| "the distance of its thermometers is not known".to_owned())
    }

    /// The ranges of temperature and of its rate in the recording.
    fn validity(&self) -> Validity {
        let steps = (RATE_OVER_S / self.recording.step_s).round().max(1.0) as usize;
        let mut range: Option<[f64; 2]> = None;
        let mut rate = LEAST_RATE;
        for column in &self.stations.thermometers {
            let Some(series) = self.recording.auxiliary(column) else { continue };
            for value in series.values.iter().filter(|value| value.is_finite()) {
                let [low, high] = range.unwrap_or([*value; 2]);
                range = Some([low.min(*value), high.max(*value)]);
            }
            let later = series.values.iter().skip(steps);
            let change = later.zip(&series.values).map(|(b, a)| (b - a).abs()).filter(|it| it.is_finite());
            rate = change.fold(rate, |most, it| most.max(it / (steps as f64 * self.recording.step_s)));
        }
        let default = Validity::default();
        Validity {
            temperature_range: range.map_or(default.temperature_range, |it| it.map(|t| t as f32)),
            rate_limit: if range.is_some() { rate as f32 } else { default.rate_limit },
        }
    }
}

/// What the terms of an effect are made of, or why it has none.
fn parts(finding: &Finding) -> Result<[Part; 2], String> {
    match named(&finding.effect).map_or(HAS_NO_TERM, |effect| effect.in_flight) {
        InFlight::Term(parts) => Ok(parts),
        InFlight::ByAxis(products) => {
            let found = products.iter().find(|(axis, _)| Some(*axis) == text(finding, "axis"));
            found.map(|(_, parts)| *parts).ok_or_else(|| "it does not say which product".to_owned())
        }
        InFlight::Never(why) => Err(why.to_owned()),
    }
}

/// A parameter in SI units; none where there is no such parameter.
fn value_of(finding: &Finding, name: &str) -> Result<Option<f64>, String> {
    let Some(parameter) = finding.parameters.iter().find(|it| it.name == name) else { return Ok(None) };
    let (Some(value), Some(unit)) = (parameter.value, parameter.unit.as_deref()) else { return Ok(None) };
    let factor = in_si(unit).ok_or_else(|| format!("the unit {unit} is not known"))?;
    Ok(Some(value * factor))
}

fn text<'f>(finding: &'f Finding, name: &str) -> Option<&'f str> {
    finding.parameters.iter().find(|it| it.name == name).and_then(|it| it.text.as_deref())
}

/// The two columns of a difference, `to - from`.
fn columns(finding: &Finding) -> Option<[&str; 2]> {
    let (to, from) = text(finding, "column")?.split_once(" - ")?;
    Some([to, from])
}

/// The temperature at which an effect vanishes: fitted, or that of the nominal model, or the mean that was taken.
fn reference(finding: &Finding, sensor: Option<&Sensor>, column: &str) -> Option<f64> {
    let fitted = finding.parameters.iter().find(|it| it.name == "reference_degC").and_then(|it| it.value);
    let nominal = || {
        let dependence = sensor?.nominal.temperature_bias.as_ref()?;
        (dependence.column == column).then_some(dependence.reference_deg_c)
    };
    fitted.or_else(|| taken_reference(finding)).or_else(nominal)
}

/// The number of the variant `reference`.
fn taken_reference(finding: &Finding) -> Option<f64> {
    text(finding, "reference")?.split_whitespace().next()?.parse().ok()
}

/// An axis of a sensor in body axes.
fn axes(sensor: &Sensor, axis: GyroAxis) -> Result<Vector3<f64>, String> {
    let unknown = || format!("the axes of {} are not known", sensor.id);
    let input = sensor.axis.and_then(|it| Vector3::from(it).try_normalize(1e-9)).ok_or_else(unknown)?;
    if matches!(axis, GyroAxis::Input) {
        return Ok(input);
    }
    let given = Vector3::from(sensor.spin_axis.ok_or_else(unknown)?);
    let spin = (given - input * input.dot(&given)).try_normalize(1e-3).ok_or_else(unknown)?;
    Ok(if matches!(axis, GyroAxis::Spin) { spin } else { spin.cross(&input) })
}

/// A unit of the answer in SI: `deg/h/(K/h)`, `ug/g^2`, `ppm/K` ….
fn in_si(unit: &str) -> Option<f64> {
    const G: f64 = STANDARD_GRAVITY;
    let own = [("ppm", 1e-6), ("arcsec", std::f64::consts::PI / 648_000.0)];
    let of_sensors = Unit::NAMES.iter().map(|(name, unit)| (*name, unit.in_si()));
    let (rest, factor) = own
        .into_iter()
        .chain(of_sensors)
        .filter_map(|(name, factor)| Some((unit.strip_prefix(name)?, factor)))
        .filter(|(rest, _)| rest.is_empty() || rest.starts_with('/'))
        .min_by_key(|(rest, _)| rest.len())?;
    let per = match rest.strip_prefix('/').unwrap_or("") {
        "" | "K" | "K^2" | "K^3" | "(K/m)" | "(rad/s)^2" | "(rad/s)^3" | "(m/s)" | "(m/s)^2" => 1.0,
        "(K/h)" => 1.0 / 3600.0,
        "(K/min)" => 1.0 / 60.0,
        "g" | "g/K" => G,
        "g^2" => G * G,
        "g^3" => G * G * G,
        _ => return None,
    };
    Some(factor / per)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use schuler_recording::CaseFile;

    use super::*;
    use crate::explanation::{Evidence, FORMAT, Fit, Verdict};

    const CASE: &str = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 55.0
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 0.0 }
[[sensor]]
id = "gx"
kind = "dtg"
column = "gx"
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
spin_axis = [0.0, 0.0, 1.0]
group = "block"
[[sensor]]
id = "ay"
kind = "accelerometer"
column = "ay"
unit = "ug"
axis = [0.0, -1.0, 0.0]
  [sensor.nominal]
  temperature_bias = { column = "ta", reference_degC = 20.0, coefficients = [0.0] }
[[aux]]
column = "tg"
quantity = "temperature"
unit = "degC"
near = "gx"
position_m = [0.0, 0.0, 0.0]
[[aux]]
column = "ta"
quantity = "temperature"
unit = "degC"
near = "ay"
position_m = [0.0, 0.1, 0.0]
"#;

    fn deployed(sensor: &str, effect: &str, value: f64, unit: &str, words: &[(&str, &str)]) -> Deployment {
        let name = format!("schuler-deploy-{}-{:?}", std::process::id(), std::thread::current().id());
        let directory = std::env::temp_dir().join(name.replace(['(', ')'], ""));
        std::fs::create_dir_all(&directory).unwrap();
        std::fs::write(directory.join("r.csv"), "t,gx,ay,tg,ta\n0,0,0,20,22\n1,0,0,21,22\n2,0,0,30,23\n")
            .unwrap();
        let file = CaseFile::parse(&directory.join(Path::new("case.toml")), CASE).unwrap();
        let recording = Recording::of_case(file).unwrap();
        std::fs::remove_dir_all(&directory).unwrap();
        let number = Parameter {
            name: "coefficient".into(),
            value: Some(value),
            unit: Some(unit.into()),
            ..Parameter::default()
        };
        let word = |(name, text): &(&str, &str)| Parameter {
            name: (*name).to_owned(),
            text: Some((*text).to_owned()),
            value: None,
            unit: None,
            ..number.clone()
        };
        let finding = Finding {
            sensor: sensor.into(),
            effect: effect.into(),
            probability: 1.0,
            class: Vec::new(),
            interval_s: [0.0, 3.0],
            parameters: std::iter::once(number.clone()).chain(words.iter().map(word)).collect(),
            evidence: Evidence { gain_nats: 50.0, p_value: 1e-9 },
            sentence: String::new(),
        };
        let mut finding = finding;
        if words.iter().any(|(name, _)| *name == "reference") {
            let at_mean =
                Parameter { name: AT_MEAN.into(), value: Some(0.5), unit: Some("deg/h".into()), ..number };
            finding.parameters.push(at_mean);
        }
        let explanation = Explanation {
            format: FORMAT,
            verdict: Verdict::Explained,
            findings: vec![finding],
            fit: Fit::default(),
            located: Vec::new(),
            remainder: None,
            notes: Vec::new(),
        };
        let stations = Stations {
            gyros: vec![("gx".into(), 0)],
            accelerometers: vec![("ay".into(), 1)],
            thermometers: vec!["tg".into(), "ta".into()],
        };
        deploy(&explanation, &recording, &stations)
    }

    fn term(deployment: &Deployment) -> Term {
        assert_eq!(deployment.findings[0].because, None);
        deployment.block.terms[0]
    }

    #[test]
    fn the_rate_of_the_own_thermometer_becomes_a_term_in_si() {
        let found = term(&deployed("gx", "bias_temperature_rate", 2.0, "deg/h/(K/h)", &[("column", "tg")]));
        let rate = Factor::from(Quantity::TemperatureRate(0));
        let coefficient = (2.0 * Unit::DegreePerHour.in_si() * 3600.0) as f32;
        let expected = Term { target: Target::Gyro(0), coefficient, factors: [rate, Factor::default()] };
        assert_eq!(found, expected);
        // Without a column, that near the sensor.
        assert_eq!(term(&deployed("gx", "bias_temperature_rate", 2.0, "deg/h/(K/h)", &[])), expected);
    }

    #[test]
    fn a_reference_is_the_nominal_one_or_the_one_that_was_taken() {
        let nominal = term(&deployed("ay", "bias_temperature_sq", 1.0, "ug/K^2", &[("column", "ta")]));
        assert_eq!((nominal.factors[0].reference, nominal.factors[0].power), (20.0, 2));
        let taken = [("column", "tg"), ("reference", "23.67 degC, the mean")];
        let taken = deployed("gx", "bias_temperature", 1.0, "deg/h/K", &taken);
        assert_eq!(term(&taken).factors[0].reference, 23.67);
        // What it adds at that reference is a constant beside it.
        let constant = taken.block.terms[1];
        assert_eq!((taken.findings[0].terms, constant.factors), (2, [Factor::default(); 2]));
        assert_eq!(constant.coefficient, (0.5 * Unit::DegreePerHour.in_si()) as f32);
        let unknown = deployed("gx", "bias_temperature", 1.0, "deg/h/K", &[("column", "tg")]);
        assert!(unknown.findings[0].because.as_ref().unwrap().contains("vanishes"));
    }

    #[test]
    fn axes_are_turned_into_those_of_the_sensors_that_measure_them() {
        // o = s × i = z × x = y, along which the accelerometer stands backwards.
        let found = term(&deployed("gx", "g_quadrature", 3.0, "deg/h/g", &[]));
        assert_eq!(found.factors[0].quantity, Quantity::SpecificForce(1));
        let expected = -3.0 * Unit::DegreePerHour.in_si() / STANDARD_GRAVITY;
        assert!((f64::from(found.coefficient) / expected - 1.0).abs() < 1e-6);
        let nobody = deployed("gx", "g_spin", 3.0, "deg/h/g", &[]);
        assert!(nobody.findings[0].because.as_ref().unwrap().contains("no accelerometer"));
    }

    #[test]
    fn a_gradient_over_a_distance_becomes_a_difference() {
        let found =
            term(&deployed("gx", "bias_temperature_gradient", 5.0, "deg/h/(K/m)", &[("column", "ta - tg")]));
        assert_eq!(found.factors[0].quantity, Quantity::TemperatureDifference(1, 0));
        let expected = 5.0 * Unit::DegreePerHour.in_si() / 0.1;
        assert!((f64::from(found.coefficient) / expected - 1.0).abs() < 1e-6);
        // About the mean of the difference, with what it is there beside it.
        let about = [("column", "ta - tg"), ("reference", "0.25 K, the mean")];
        let about = deployed("gx", "bias_temperature_gradient", 5.0, "deg/h/(K/m)", &about);
        assert_eq!(term(&about).factors[0].reference, 0.25);
        let constant = about.block.terms[1];
        assert_eq!(
            (constant.factors, constant.coefficient),
            ([Factor::default(); 2], (0.5 * Unit::DegreePerHour.in_si()) as f32)
        );
    }

    #[test]
    fn what_cannot_fly_says_why_and_the_validity_is_that_of_the_recording() {
        for (sensor, effect, expected) in [
            ("gx", "bias_step", "next flight"),
            ("gx", "noise_markov", "identifies"),
            ("block", "lever_arm", "motion"),
            ("block", "misalignment", "whole instrument"),
            ("nobody", "bias_constant", "no sensor"),
        ] {
            let found = deployed(sensor, effect, 1.0, "deg/h", &[]);
            let because = found.findings[0].because.clone().unwrap();
            assert!(because.contains(expected), "{effect}: {because}");
            assert!(found.block.terms.is_empty());
        }
        // A scale factor of 30 % is refused by the module.
        let wild = deployed("gx", "scale_factor", 3e5, "ppm", &[]);
        assert!(wild.findings[0].because.as_ref().unwrap().contains("refuse"));
        assert_eq!(wild.block.validity.temperature_range, [20.0, 30.0]);
        assert!(wild.block.validate().is_ok());
    }

    #[test]
    fn units_of_the_answer_become_si() {
        let degree_per_hour = Unit::DegreePerHour.in_si();
        for (unit, expected) in [
            ("deg/h", degree_per_hour),
            ("deg/h/K", degree_per_hour),
            ("deg/h/(K/h)", degree_per_hour * 3600.0),
            ("deg/h/g", degree_per_hour / STANDARD_GRAVITY),
            ("deg/h/g/K", degree_per_hour / STANDARD_GRAVITY),
            ("ug/g^2", 1e-6 / STANDARD_GRAVITY),
            ("m/s^2", 1.0),
            ("m/s", 1.0),
            ("g", STANDARD_GRAVITY),
            ("ppm/K", 1e-6),
            ("arcsec", std::f64::consts::PI / 648_000.0),
        ] {
            let found = in_si(unit).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-12, "{unit}: {found} {expected}");
        }
        assert_eq!(in_si("furlong"), None);
        assert_eq!(in_si("deg/h/V"), None);
    }
}
