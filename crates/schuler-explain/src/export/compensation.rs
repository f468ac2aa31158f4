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
mod tests;
