//! The optional part `[calibration]` of a case: a calibration run on a one-axis table at changing temperature.
//!
//! ```toml
//! [calibration]
//! features = "temperature_rate"        # temperature | temperature_rate (default) | temperature_rate_gradient
//! gravity = 9.8156                     # m/s²; without it from [site]
//! passes = 2                           # over the data; 3 for gyros on a table (the defaults)
//! level_sigma_deg = 1.0                # what is known of the attitude at the start of a cycle
//! azimuth_sigma_deg = 3.0
//! thermometer = "temperature"          # column of an [[aux]] temperature; without it the only one
//! thermometer_step_K = 0.25            # its quantum; without it the least step that it makes
//!
//!   [calibration.table]                # only with an angle sensor: gyros alone are calibrated against it
//!   column = "angle"                   # angle of the table at the row's time; positive about the turned axis
//!   unit = "deg"                       # deg (default) | rad | arcsec
//!   angle_arcsec = 5.0                 # 1 σ of the angle sensor,
//!   wobble_arcsec = 5.0                # of the table about each axis,
//!   mounting_arcsec = 60.0             # of the mounting, anew in each cycle,
//!   base_arcsec = 60.0                 # of the direction of the table's axis and of its zero
//!
//!   [calibration.prior]                # 1 σ at the reference, for 30 K, for 20 K/h, for 5 K/m (as for 20 K/h if left out)
//!   gyro_bias_deg_h = [20.0, 10.0, 6.0]
//!   gyro_matrix_ppm = [2000.0, 1000.0, 600.0]
//!   accelerometer_bias_mm_s2 = [50.0, 25.0, 15.0]
//!   accelerometer_matrix_ppm = [2000.0, 1000.0, 600.0]
//!
//!   [[calibration.cycle]]              # one for each body axis that was laid along the table's axis
//!   axis = "x"                         # x | y | z
//!   azimuth_deg = 20.0                 # of that body axis, from north to east
//!   start_s = 150.0                    # in the recording's time; rows after it up to the end are its samples
//!   end_s = 3750.0
//! ```
//!
//! The sensors are three gyros, one along each body axis, and without `[calibration.table]` three accelerometers; their
//! `nominal.white` is their noise. A gradient comes from the temperatures of [[aux]] entries with a `position_m` each, at
//! least four that are not in one plane.
use serde::{Deserialize, Serialize, Serializer};

use super::name_of;
use crate::document::{Field, Node};

/// A calibration run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationRun {
    /// Functions of temperature in the model.
    pub features: Features,
    /// Gravity, m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<f64>,
    /// Passes over the data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<u8>,
    /// 1 σ of the levelling at the start of a cycle, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level_sigma_deg: Option<f64>,
    /// 1 σ of the stated azimuth, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub azimuth_sigma_deg: Option<f64>,
    /// Column of the temperature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thermometer: Option<String>,
    /// Quantum of the thermometer, K.
    #[serde(rename = "thermometer_step_K", skip_serializing_if = "Option::is_none")]
    pub thermometer_step_k: Option<f64>,
    /// The table, where it has an angle sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table: Option<Table>,
    /// What is known of the coefficients beforehand.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior: Option<Prior>,
    /// The cycles.
    #[serde(rename = "cycle")]
    pub cycles: Vec<Cycle>,
}

/// Functions of temperature in the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Features {
    /// Temperature.
    Temperature,
    /// Temperature and its rate.
    #[default]
    TemperatureRate,
    /// Temperature, its rate and its gradient.
    TemperatureRateGradient,
}

impl Features {
    /// Every set under its name in the case file.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("temperature", Self::Temperature),
        ("temperature_rate", Self::TemperatureRate),
        ("temperature_rate_gradient", Self::TemperatureRateGradient),
    ];
}

impl Serialize for Features {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(name_of(self, &Self::NAMES))
    }
}

/// A table with an angle sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table {
    /// Column of the angle.
    pub column: String,
    /// Unit of the column.
    pub unit: AngleUnit,
    /// 1 σ of the angle sensor, arc seconds.
    pub angle_arcsec: f64,
    /// 1 σ of the wobble, arc seconds.
    pub wobble_arcsec: f64,
    /// 1 σ of the mounting, arc seconds.
    pub mounting_arcsec: f64,
    /// 1 σ of the base, arc seconds.
    pub base_arcsec: f64,
}

/// Unit of an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AngleUnit {
    /// Degrees.
    #[default]
    Degrees,
    /// Radians.
    Radians,
    /// Arc seconds.
    ArcSeconds,
}

impl AngleUnit {
    /// Every unit under its name in the case file.
    pub const NAMES: [(&'static str, Self); 3] =
        [("deg", Self::Degrees), ("rad", Self::Radians), ("arcsec", Self::ArcSeconds)];

    /// One of it in radians.
    pub fn in_si(self) -> f64 {
        match self {
            Self::Degrees => 1.0_f64.to_radians(),
            Self::Radians => 1.0,
            Self::ArcSeconds => ARC_SECOND,
        }
    }
}

impl Serialize for AngleUnit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(name_of(self, &Self::NAMES))
    }
}

/// Arc second, rad.
pub const ARC_SECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;

/// 1 σ of the parts of the coefficients: at the reference, for 30 K, for 20 K/h and for 5 K/m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Gyro biases, deg/h.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro_bias_deg_h: Option<[f64; 4]>,
    /// Gyro scale factors and misalignments, 10⁻⁶.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro_matrix_ppm: Option<[f64; 4]>,
    /// Accelerometer biases, mm/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_bias_mm_s2: Option<[f64; 4]>,
    /// Accelerometer scale factors and misalignments, 10⁻⁶.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_matrix_ppm: Option<[f64; 4]>,
}

/// A cycle of rotations with one mounting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cycle {
    /// Body axis along the table's axis.
    pub axis: BodyAxis,
    /// Azimuth of that axis, from north to east, degrees.
    pub azimuth_deg: f64,
    /// Start in the recording's time, s.
    pub start_s: f64,
    /// End in the recording's time, s.
    pub end_s: f64,
}

/// A body axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BodyAxis(pub usize);

impl BodyAxis {
    /// Every axis under its name in the case file.
    pub const NAMES: [(&'static str, Self); 3] = [("x", Self(0)), ("y", Self(1)), ("z", Self(2))];
}

impl Serialize for BodyAxis {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(name_of(self, &Self::NAMES))
    }
}

/// The same as [`super::read::optional`], for numbers above zero.
#[allow(clippy::option_option)]
fn above_zero(node: &Node<'_>, key: &'static str) -> Option<Option<f64>> {
    super::read::optional(node, key, super::read::positive)
}

pub(super) fn calibration(node: &Node<'_>) -> Option<CalibrationRun> {
    use super::read::optional;
    let features = optional(node, "features", |field| field.one_of(&Features::NAMES));
    let gravity = above_zero(node, "gravity");
    let passes = optional(node, "passes", |field| {
        field.number_where("a whole number from 2 to 10", |n| (2.0..=10.0).contains(&n) && n.fract() == 0.0)
    });
    let level_sigma_deg = above_zero(node, "level_sigma_deg");
    let azimuth_sigma_deg = above_zero(node, "azimuth_sigma_deg");
    let thermometer = optional(node, "thermometer", Field::text);
    let thermometer_step_k = above_zero(node, "thermometer_step_K");
    let table = optional(node, "table", |field| field.table(table));
    let prior = optional(node, "prior", |field| field.table(prior));
    let cycles = node.tables("cycle", cycle)?;
    if cycles.is_empty() {
        return node.problem_at("cycle", "missing; expected at least one [[calibration.cycle]]");
    }
    Some(CalibrationRun {
        features: features?.unwrap_or_default(),
        gravity: gravity?,
        passes: passes?.map(|n| n as u8),
        level_sigma_deg: level_sigma_deg?,
        azimuth_sigma_deg: azimuth_sigma_deg?,
        thermometer: thermometer?,
        thermometer_step_k: thermometer_step_k?,
        table: table?,
        prior: prior?,
        cycles,
    })
}

fn table(node: &Node<'_>) -> Option<Table> {
    let column = node.required("column", "the column of the table's angle").and_then(|field| field.text());
    let unit = super::read::optional(node, "unit", |field| field.one_of(&AngleUnit::NAMES));
    let sigma = |key| {
        let expected = "a standard deviation in arc seconds, greater than zero";
        node.required(key, expected).and_then(|field| super::read::positive(&field))
    };
    let (angle, wobble) = (sigma("angle_arcsec"), sigma("wobble_arcsec"));
    let (mounting, base) = (sigma("mounting_arcsec"), sigma("base_arcsec"));
    Some(Table {
        column: column?,
        unit: unit?.unwrap_or_default(),
        angle_arcsec: angle?,
        wobble_arcsec: wobble?,
        mounting_arcsec: mounting?,
        base_arcsec: base?,
    })
}

fn prior(node: &Node<'_>) -> Option<Prior> {
    let sigmas = |key| {
        super::read::optional(node, key, |field| {
            let list = field.number_list()?;
            match *list.as_slice() {
                [constant, temperature, rate] => Some([constant, temperature, rate, rate]),
                [constant, temperature, rate, gradient] => Some([constant, temperature, rate, gradient]),
                _ => field.wrong("three or four standard deviations"),
            }
            .filter(|s| s.iter().all(|s| *s > 0.0))
            .or_else(|| field.wrong("standard deviations greater than zero"))
        })
    };
    Some(Prior {
        gyro_bias_deg_h: sigmas("gyro_bias_deg_h")?,
        gyro_matrix_ppm: sigmas("gyro_matrix_ppm")?,
        accelerometer_bias_mm_s2: sigmas("accelerometer_bias_mm_s2")?,
        accelerometer_matrix_ppm: sigmas("accelerometer_matrix_ppm")?,
    })
}

fn cycle(node: &Node<'_>) -> Option<Cycle> {
    let axis = node.required("axis", "x, y or z").and_then(|field| field.one_of(&BodyAxis::NAMES));
    let seconds =
        |key| node.required(key, "seconds in the recording's time").and_then(|field| field.number());
    let azimuth = node.required("azimuth_deg", "degrees from north to east").and_then(|field| field.number());
    let (start_s, end_s) = (seconds("start_s"), seconds("end_s"));
    let cycle = Cycle { axis: axis?, azimuth_deg: azimuth?, start_s: start_s?, end_s: end_s? };
    if cycle.end_s <= cycle.start_s {
        return node.problem_at(
            "end_s",
            &format!("found {}; expected a time after start_s = {}", cycle.end_s, cycle.start_s),
        );
    }
    Some(cycle)
}
