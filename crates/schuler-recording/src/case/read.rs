//! Reading a case file: the letter of `schuler-case/1`, and what is wrong where a file departs from it.
use std::path::Path;

use super::{
    Attitude, Auxiliary, Case, CaseFile, ELECTRONICS, ExponentialCosine, FORMAT, Grade, Markov, Motion,
    MotionKind, Nominal, PARTS_OF_THE_LOOP, Quantity, SchulerLoop, Sensor, SensorKind, Site, TemperatureBias,
};
use crate::document::{Field, Node, Parsed, parse_with, suggestion};
use crate::error::Error;
use crate::file;
use crate::leniency::Leniency;
use crate::unit::{Dimension, Unit};

/// How far the length of an axis may be from 1 before it is worth a word.
const UNIT_LENGTH_TOLERANCE: f64 = 1e-3;
/// What is said of a sensor that needs an axis.
const NO_AXIS: &str = "missing; expected the sensitive axis in body axes, e.g. [1.0, 0.0, 0.0]";
/// How far rounding may take the length of an axis that was normalised from 1.
const ROUNDED_LENGTH: f64 = 4.0 * f64::EPSILON;

impl CaseFile {
    /// Reads the case at `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the file, by line and field.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, Leniency::Strict)
    }

    /// Reads the case at `path`, and later its table, as strictly or leniently as asked.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_with(path: &Path, leniency: Leniency) -> Result<Self, Error> {
        Self::parse_with(path, &file::text(path, "read the case")?, leniency)
    }

    /// Reads a case from `text`, the content of the file `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the text, by line and field.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        Self::parse_with(path, text, Leniency::Strict)
    }

    /// Reads a case from `text` as strictly or leniently as asked.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_with(path: &Path, text: &str, leniency: Leniency) -> Result<Self, Error> {
        let text = text.trim_start_matches('\u{feff}');
        let Parsed { value: case, warnings, lines } = parse_with(path, text, leniency, case)?;
        Ok(Self { path: path.to_owned(), case, warnings, lines, leniency })
    }
}

/// Every part is read before any is required, so that all problems are found at once.
fn case(node: &Node<'_>) -> Option<Case> {
    let format = node.required("format", &format!("\"{FORMAT}\"")).and_then(|field| format_is_known(&field));
    let title = optional(node, "title", Field::any_text);
    let recording = node
        .required("recording", "a table [recording]")
        .and_then(|field| field.table(super::source::source));
    let site = optional(node, "site", |field| field.table(site));
    let simulation = optional(node, "simulation", |field| field.table(super::simulation::simulation));
    let motion = optional(node, "motion", |field| field.table(motion));
    let schuler_loop = optional(node, "loop", |field| field.table(schuler_loop));
    let calibration = optional(node, "calibration", |field| field.table(super::calibration::calibration));
    let sensors = node.tables("sensor", sensor);
    let auxiliaries = node.tables("aux", auxiliary);
    let effects = node.tables("effect", super::effect::effect);
    format?;
    let case = Case {
        title: title?.unwrap_or_default(),
        recording: recording?,
        site: site?,
        simulation: simulation?,
        motion: motion?.unwrap_or_default(),
        schuler_loop: schuler_loop?,
        sensors: sensors?,
        calibration: calibration?,
        auxiliaries: auxiliaries?,
        effects: effects?,
    };
    agrees_with_itself(node, case)
}

/// What no single field can show.
fn agrees_with_itself(node: &Node<'_>, case: Case) -> Option<Case> {
    if case.sensors.is_empty() {
        return node.problem_at("sensor", "missing; expected at least one [[sensor]]");
    }
    for (index, sensor) in case.sensors.iter().enumerate() {
        if let Some(first) = case.sensors.iter().take(index).position(|other| other.id == sensor.id) {
            let found = format!("found \"{}\", the id of sensor[{first}]; expected a unique id", sensor.id);
            return node.problem_at(&format!("sensor[{index}].id"), &found);
        }
    }
    let places: Vec<&str> = case
        .sensors
        .iter()
        .flat_map(|sensor| [Some(sensor.id.as_str()), sensor.group.as_deref()])
        .flatten()
        .chain(
            if case.motion.kind == MotionKind::VelocityError { PARTS_OF_THE_LOOP } else { &[] }
                .iter()
                .copied(),
        )
        .collect();
    for (index, auxiliary) in case.auxiliaries.iter().enumerate() {
        if auxiliary.quantity == Quantity::Temperature && auxiliary.is_guessed_at_electronics() {
            let said = "taken by its name for a temperature of the electronics; state near = \"electronics\", or the \
                        id or group of a sensor";
            node.warn_at(&format!("aux[{index}].column"), said);
        }
        let known = |near: &str| places.contains(&near) || near == ELECTRONICS;
        let Some(near) = auxiliary.near.as_deref().filter(|near| !known(near)) else { continue };
        let path = format!("aux[{index}].near");
        let found = format!("found \"{near}\"; expected the id or group of a sensor, or \"{ELECTRONICS}\"");
        match suggestion(near, places.iter().copied()) {
            Some(meant) => return node.problem_at(&path, &format!("{found}; did you mean \"{meant}\"?")),
            None => node.warn_at(&path, &found),
        }
    }
    simulation_is_used(node, &case)?;
    super::effect::fit_the_case(node, &case)?;
    if case.motion.kind == MotionKind::VelocityError {
        let velocities = case.sensors.iter().filter(|sensor| sensor.kind == SensorKind::InsVelocity).count();
        if velocities != 1 {
            let found = format!(
                "found \"velocity_error\" with {velocities} sensors of kind \"ins_velocity\"; expected one of them"
            );
            return node.problem_at("motion.kind", &found);
        }
        if case.schuler_loop.is_none() {
            return node.problem_at(
                "loop",
                "missing; expected a table [loop], as motion.kind is \"velocity_error\"",
            );
        }
    }
    Some(case)
}

/// A simulation and what it predicts belong together, and a sensor whose motion is known needs its axis all the same.
fn simulation_is_used(node: &Node<'_>, case: &Case) -> Option<()> {
    let predicted = |sensor: &Sensor| sensor.predicted.is_some();
    if case.simulation.is_some() && !case.sensors.iter().any(predicted) {
        let found =
            "found no sensor with `predicted`; expected a [[sensor]] that names the simulator's column";
        return node.problem_at("simulation", found);
    }
    if case.motion.kind == MotionKind::VelocityError
        && let Some(index) = case.sensors.iter().position(predicted)
    {
        let found = "found in a case whose motion.kind is \"velocity_error\"; expected another kind, as the loop predicts";
        return node.problem_at(&format!("sensor[{index}].predicted"), found);
    }
    let lacks_axis = |sensor: &Sensor| {
        sensor.axis.is_none()
            && matches!(sensor.kind.dimension(), Dimension::AngularRate | Dimension::Acceleration)
    };
    if case.motion.kind != MotionKind::Unknown
        && let Some(index) = case.sensors.iter().position(lacks_axis)
    {
        return node.problem_at(&format!("sensor[{index}].axis"), NO_AXIS);
    }
    Some(())
}

fn format_is_known(field: &Field<'_>) -> Option<()> {
    let format = field.text()?;
    if format == FORMAT { Some(()) } else { field.wrong(&format!("\"{FORMAT}\"")) }
}

fn site(node: &Node<'_>) -> Option<Site> {
    let latitude = "degrees, -90 to 90";
    let latitude_deg = node
        .required("latitude_deg", latitude)
        .and_then(|field| field.number_where(latitude, |degrees| degrees.abs() <= 90.0));
    let longitude_deg = optional(node, "longitude_deg", |field| {
        field.number_where("degrees, -180 to 360", |degrees| (-180.0..=360.0).contains(&degrees))
    });
    let altitude_m = optional(node, "altitude_m", |field| {
        field.number_where("metres, -12000 to 1e6", |metres| (-12e3..=1e6).contains(&metres))
    });
    Some(Site {
        latitude_deg: latitude_deg?,
        longitude_deg: longitude_deg?,
        altitude_m: altitude_m?.unwrap_or_default(),
    })
}

fn motion(node: &Node<'_>) -> Option<Motion> {
    let kind = node
        .required("kind", "static, recorded, unknown or velocity_error")
        .and_then(|field| field.one_of(&MotionKind::NAMES));
    let attitude_deg = optional(node, "attitude_deg", |field| field.table(attitude));
    let rate = optional(node, "rate", Field::texts);
    let specific_force = optional(node, "specific_force", Field::texts);
    let velocity_ned = optional(node, "velocity_ned", Field::texts);
    let attitude_rad = optional(node, "attitude_rad", Field::texts);
    let attitude = optional(node, "attitude", |field| field.table(super::attitude::attitude));
    let velocity_at_m = optional(node, "velocity_at_m", Field::numbers);
    let rate_unit = optional(node, "rate_unit", |field| unit_of_dimension(field, Dimension::AngularRate));
    let specific_force_unit =
        optional(node, "specific_force_unit", |field| unit_of_dimension(field, Dimension::Acceleration));
    let motion = Motion {
        kind: kind?,
        attitude_deg: attitude_deg?,
        rate: rate?,
        rate_unit: rate_unit?,
        specific_force: specific_force?,
        specific_force_unit: specific_force_unit?,
        velocity_ned: velocity_ned?,
        velocity_at_m: velocity_at_m?,
        attitude_rad: attitude_rad?,
        attitude: attitude?,
    };
    if motion.attitude.is_some() && motion.attitude_rad.is_some() {
        return node.problem_at("attitude", "found beside attitude_rad; expected one of them");
    }
    let has_attitude = motion.attitude.is_some() || motion.attitude_rad.is_some();
    if motion.velocity_at_m.is_some() && !(has_attitude && motion.velocity_ned.is_some()) {
        return node.problem_at("velocity_at_m", "found without an attitude or a velocity; expected both");
    }
    if motion.kind == MotionKind::Recorded && motion.columns().next().is_none() {
        let found = "found \"recorded\" without columns";
        let expected = "expected also rate, specific_force, velocity_ned, attitude_rad or attitude";
        return node.problem_at("kind", &format!("{found}; {expected}"));
    }
    Some(motion)
}

fn attitude(node: &Node<'_>) -> Option<Attitude> {
    let angle = |key| node.required(key, "degrees").and_then(|field| field.number());
    let (roll, pitch, heading) = (angle("roll"), angle("pitch"), angle("heading"));
    Some(Attitude { roll: roll?, pitch: pitch?, heading: heading? })
}

fn sensor(node: &Node<'_>) -> Option<Sensor> {
    let id = node.required("id", "the name that answers use").and_then(|field| field.text());
    let kind = node
        .required("kind", "the kind of sensor, e.g. \"mems_gyro\"")
        .and_then(|field| field.one_of(&SensorKind::NAMES));
    let column = node.required("column", "the name of the sensor's column").and_then(|field| field.text());
    let scale = optional(node, "scale", not_zero);
    let predicted = optional(node, "predicted", Field::text);
    let unit = node
        .required("unit", "the unit of the column, e.g. \"deg/h\"")
        .and_then(|field| unit_of(&field, kind));
    let predicted_unit = optional(node, "predicted_unit", |field| unit_of(field, kind));
    let axis = optional(node, "axis", direction);
    let group = optional(node, "group", Field::text);
    let spin_axis = optional(node, "spin_axis", direction);
    let quantisation = optional(node, "quantisation", not_negative);
    let relative = optional(node, "relative", Field::boolean);
    let grade = optional(node, "grade", |field| field.one_of(&Grade::NAMES));
    let nominal = optional(node, "nominal", |field| field.table(nominal));
    let sensor = Sensor {
        id: id?,
        kind: kind?,
        column: column?,
        scale: scale?,
        predicted: predicted?,
        predicted_unit: predicted_unit?,
        unit: unit?,
        axis: axis?,
        group: group?,
        spin_axis: spin_axis?,
        quantisation: quantisation?.unwrap_or_default(),
        relative: relative?.unwrap_or_default(),
        grade: grade?,
        nominal: nominal?.unwrap_or_default(),
    };
    let needs_axis =
        !matches!(sensor.kind, SensorKind::InsVelocity | SensorKind::GnssVelocity | SensorKind::Other);
    if needs_axis && sensor.predicted.is_none() && sensor.axis.is_none() {
        return node.problem_at("axis", NO_AXIS);
    }
    Some(sensor)
}

fn unit_of_dimension(field: &Field<'_>, dimension: Dimension) -> Option<Unit> {
    let unit = field.one_of(&Unit::NAMES)?;
    if unit.dimension() == dimension {
        return Some(unit);
    }
    let units: Vec<&str> = dimension.units().map(Unit::name).collect();
    field.wrong(&format!("one of {}", units.join(", ")))
}

fn unit_of(field: &Field<'_>, kind: Option<SensorKind>) -> Option<Unit> {
    if kind == Some(SensorKind::Other) {
        return field.any_text().map(|text| Unit::free(&text));
    }
    let unit = field.one_of(&Unit::NAMES)?;
    let Some(kind) = kind else { return Some(unit) };
    if unit.dimension() == kind.dimension() {
        return Some(unit);
    }
    let units: Vec<&str> = kind.dimension().units().map(Unit::name).collect();
    field.wrong(&format!("a unit of a sensor of kind \"{kind}\": {}", units.join(", ")))
}

/// A direction, made to have unit length.
fn direction(field: &Field<'_>) -> Option<[f64; 3]> {
    let components = field.numbers::<3>()?;
    let largest = components.iter().fold(0.0_f64, |largest, component| largest.max(component.abs()));
    // Scaled first, so that no finite components overflow or vanish when squared.
    let scaled = components.map(|component| component / largest);
    let length = scaled.iter().map(|component| component * component).sum::<f64>().sqrt();
    if !length.is_finite() {
        return field.problem("found a direction of length zero; expected a vector that is not zero");
    }
    if (length * largest - 1.0).abs() > UNIT_LENGTH_TOLERANCE {
        field.warn("not of unit length, normalised");
    }
    // What has been normalised stays as it is, whatever its length was rounded to.
    let normalised = (length * largest - 1.0).abs() <= ROUNDED_LENGTH;
    if normalised { Some(components) } else { Some(scaled.map(|component| component / length)) }
}

fn nominal(node: &Node<'_>) -> Option<Nominal> {
    let bias = optional(node, "bias", Field::number);
    let scale_factor_ppm = optional(node, "scale_factor_ppm", Field::number);
    let white = optional(node, "white", not_negative);
    let markov_ = optional(node, "markov", |field| field.table(markov));
    let exp_cos = optional(node, "exp_cos", |field| field.table(exponential_cosine));
    let random_walk = optional(node, "random_walk", not_negative);
    let temperature_bias = optional(node, "temperature_bias", |field| field.table(temperature_bias));
    Some(Nominal {
        bias: bias?.unwrap_or_default(),
        scale_factor_ppm: scale_factor_ppm?.unwrap_or_default(),
        white: white?.unwrap_or_default(),
        markov: markov_?,
        exp_cos: exp_cos?,
        random_walk: random_walk?.unwrap_or_default(),
        temperature_bias: temperature_bias?,
    })
}

fn markov(node: &Node<'_>) -> Option<Markov> {
    let sigma = node.required("sigma", "a standard deviation").and_then(|field| not_negative(&field));
    let tau_s = node.required("tau_s", "a correlation time in seconds").and_then(|field| positive(&field));
    Some(Markov { sigma: sigma?, tau_s: tau_s? })
}

fn exponential_cosine(node: &Node<'_>) -> Option<ExponentialCosine> {
    let sigma = node.required("sigma", "a standard deviation").and_then(|field| not_negative(&field));
    let alpha = node.required("alpha", "a decay in 1/s").and_then(|field| positive(&field));
    let beta = node.required("beta", "an angular frequency in rad/s").and_then(|field| not_negative(&field));
    Some(ExponentialCosine { sigma: sigma?, alpha: alpha?, beta: beta? })
}

fn temperature_bias(node: &Node<'_>) -> Option<TemperatureBias> {
    let column = node.required("column", "the name of a temperature column").and_then(|field| field.text());
    let reference = node.required("reference_degC", "a temperature in degC").and_then(|field| field.number());
    let coefficients =
        node.required("coefficients", "an array of numbers").and_then(|field| field.number_list());
    Some(TemperatureBias { column: column?, reference_deg_c: reference?, coefficients: coefficients? })
}

fn auxiliary(node: &Node<'_>) -> Option<Auxiliary> {
    let column = node.required("column", "the name of a column").and_then(|field| field.text());
    let quantity = node
        .required("quantity", "what the column holds, e.g. \"temperature\"")
        .and_then(|field| field.one_of(&Quantity::NAMES));
    let unit = optional(node, "unit", Field::any_text);
    let scale = optional(node, "scale", not_zero);
    let offset = optional(node, "offset", Field::number);
    let near = optional(node, "near", Field::text);
    let position_m = optional(node, "position_m", Field::numbers);
    Some(Auxiliary {
        column: column?,
        quantity: quantity?,
        unit: unit?.unwrap_or_default(),
        scale: scale?,
        offset: offset?,
        near: near?,
        position_m: position_m?,
    })
}

fn schuler_loop(node: &Node<'_>) -> Option<SchulerLoop> {
    let nominal = SchulerLoop::default();
    let radius_m = optional(node, "radius_m", positive);
    let gravity = optional(node, "gravity", positive);
    let accelerometer = optional(node, "accelerometer", |field| field.table(markov));
    let gyro = optional(node, "gyro", |field| field.table(markov));
    let velocity_white = optional(node, "velocity_white", not_negative);
    Some(SchulerLoop {
        radius_m: radius_m?.unwrap_or(nominal.radius_m),
        gravity: gravity?.unwrap_or(nominal.gravity),
        accelerometer: accelerometer?,
        gyro: gyro?,
        velocity_white: velocity_white?.unwrap_or(nominal.velocity_white),
    })
}

/// `Some(None)` where the key is absent, `None` where it is there but wrong (which has been reported).
#[allow(clippy::option_option)]
pub(super) fn optional<'d, T>(
    node: &Node<'d>,
    key: &'static str,
    read: impl FnOnce(&Field<'d>) -> Option<T>,
) -> Option<Option<T>> {
    match node.optional(key) {
        None => Some(None),
        Some(field) => read(&field).map(Some),
    }
}

pub(super) fn positive(field: &Field<'_>) -> Option<f64> {
    field.number_where("a number greater than zero", |number| number > 0.0)
}

fn not_zero(field: &Field<'_>) -> Option<f64> {
    field.number_where("a number other than zero", |number| number != 0.0)
}

fn not_negative(field: &Field<'_>) -> Option<f64> {
    field.number_where("a number not less than zero", |number| number >= 0.0)
}
