//! The case file `schuler-case/1`: one recording, what its columns mean, and what its user believes about them.
//!
//! The types hold the file as it is written, in the units of the file; [`Sensor::in_si`] is the one conversion.
//! Keys that a file may leave out have the defaults of [`Default`]. The part about calibration runs is described in
//! [`calibration`].
mod attitude;
pub mod calibration;
mod effect;
mod grade;
mod motion;
mod read;
mod simulation;
mod source;
mod write;

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

pub use attitude::{AttitudeColumns, Frames, Order};
pub use effect::UserEffect;
pub use grade::Grade;
pub use motion::{Attitude, Motion, MotionKind};
pub use simulation::{Clock, Covers, Simulation};
pub use source::{Duplicates, Source, TimeUnit};

use crate::document::Lines;
use crate::error::Error;
use crate::leniency::Leniency;
use crate::table::{self, TableReader};
use crate::unit::{Dimension, STANDARD_GRAVITY, Unit};

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-case/1";

/// A case that was read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseFile {
    /// The file.
    pub path: PathBuf,
    /// What stands in it.
    pub case: Case,
    /// What its reader should be told: ignored keys, axes that were not of unit length.
    pub warnings: Vec<String>,
    /// Line of each field.
    pub lines: Lines,
    /// How it was read, and how its table is.
    pub leniency: Leniency,
}

impl CaseFile {
    /// Path of the table: the case's, relative to the case's file.
    pub fn table_path(&self) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(&self.case.recording.path)
    }

    /// Path of the simulation's own table, if it has one: the case's, relative to the case's file.
    pub fn simulation_path(&self) -> Option<PathBuf> {
        let table = self.case.simulation.as_ref()?.table.as_ref()?;
        Some(self.path.parent().unwrap_or(Path::new("")).join(&table.path))
    }

    /// Opens the table.
    ///
    /// # Errors
    /// As [`table::open`].
    pub fn open_table(&self) -> Result<Box<dyn TableReader>, Error> {
        table::open_with(&self.table_path(), self.leniency)
    }
}

/// A case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// What the recording is, for people.
    pub title: String,
    /// Where the table is and what its time means.
    pub recording: Source,
    /// Where on the Earth; needed where its rotation or gravity enters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub site: Option<Site>,
    /// What the user's own simulator says of sensors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulation: Option<Simulation>,
    /// What the body really did, as far as the user knows.
    pub motion: Motion,
    /// Nominal model of the Schuler loop; for velocity-error cases.
    #[serde(rename = "loop", skip_serializing_if = "Option::is_none")]
    pub schuler_loop: Option<SchulerLoop>,
    /// The sensors.
    #[serde(rename = "sensor")]
    pub sensors: Vec<Sensor>,
    /// A calibration run on a table at changing temperature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<calibration::CalibrationRun>,
    /// Other recorded quantities.
    #[serde(rename = "aux", skip_serializing_if = "Vec::is_empty")]
    pub auxiliaries: Vec<Auxiliary>,
    /// Effects of the user's own.
    #[serde(rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<UserEffect>,
}

impl Case {
    /// The table of a calibration run, if it has an angle sensor.
    pub fn table(&self) -> Option<&calibration::Table> {
        self.calibration.as_ref()?.table.as_ref()
    }
}

/// What of a Schuler loop an answer names, and an auxiliary quantity may be near to.
const PARTS_OF_THE_LOOP: &[&str] = &["velocity", "accelerometer", "gyro"];

impl Case {
    /// The names in the formulas of effects, each once; which of them are columns, only the table tells.
    pub fn names_in_formulas(&self) -> Vec<&str> {
        let names = self.effects.iter().flat_map(|effect| effect.formula.names());
        let mut seen = std::collections::HashSet::new();
        names.map(|(name, ..)| name).filter(|name| seen.insert(*name)).collect()
    }

    /// The columns of the table that the case names, each once; the time first, where there is one; without those of
    /// [formulas](Self::names_in_formulas). Where the simulation has a table of its own,
    /// neither the predictions, which are in that, nor the motion, of which only reading it tells in which it is.
    pub fn columns(&self) -> Vec<&str> {
        let mut columns: Vec<&str> = self.recording.time.iter().map(String::as_str).collect();
        columns.extend(self.sensors.iter().map(|sensor| sensor.column.as_str()));
        let own_table = self.simulation.as_ref().is_some_and(|simulation| simulation.table.is_some());
        if !own_table {
            columns.extend(self.sensors.iter().filter_map(|sensor| sensor.predicted.as_deref()));
        }
        columns.extend(self.auxiliaries.iter().map(|auxiliary| auxiliary.column.as_str()));
        let dependences = self.sensors.iter().filter_map(|sensor| sensor.nominal.temperature_bias.as_ref());
        columns.extend(dependences.map(|dependence| dependence.column.as_str()));
        columns.extend(self.motion.columns().filter(|_| !own_table));
        columns.extend(self.table().map(|table| table.column.as_str()));
        let mut seen = std::collections::HashSet::new();
        columns.retain(|column| seen.insert(*column));
        columns
    }
}

/// A place on the Earth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Site {
    /// Geodetic latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive; only tides need it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longitude_deg: Option<f64>,
    /// Height above the ellipsoid, m.
    pub altitude_m: f64,
}

/// A sensor and what the simulation believes about it, in its own unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensor {
    /// The name that answers use.
    pub id: String,
    /// What it is.
    pub kind: SensorKind,
    /// Its column.
    pub column: String,
    /// Value of one of the column's numbers in `unit`, as of counts; without it 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Column of what the user's simulator says that it reads: of the simulation's table, or of the
    /// recording's where that has none of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted: Option<String>,
    /// Unit of the prediction where it is another one of the same dimension.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_unit: Option<Unit>,
    /// Unit of the column and of the nominal values.
    pub unit: Unit,
    /// Sensitive axis in body axes, of unit length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// The instrument it is part of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Spin axis of a dynamically tuned gyro in body axes, of unit length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spin_axis: Option<[f64; 3]>,
    /// Step of the output, in `unit`; 0 if not known.
    pub quantisation: f64,
    /// Whether it is read against an unknown constant.
    pub relative: bool,
    /// How good it is; without it guessed from its kind and its noise where magnitudes are judged, and said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grade: Option<Grade>,
    /// What the simulation believes.
    pub nominal: Nominal,
}

/// What a sensor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorKind {
    /// Dynamically tuned gyro.
    Dtg,
    /// Fibre-optic gyro.
    Fog,
    /// Ring-laser gyro.
    Rlg,
    /// Micromechanical gyro.
    MemsGyro,
    /// Accelerometer.
    Accelerometer,
    /// Doppler log or radar.
    Doppler,
    /// Velocity of an inertial system.
    InsVelocity,
    /// Velocity of a satellite receiver.
    GnssVelocity,
    /// Anything else, in a unit of free text: pressure, torque, current, position.
    Other,
}

impl SensorKind {
    /// Every kind under its name in the case file.
    pub const NAMES: [(&'static str, SensorKind); 9] = [
        ("dtg", SensorKind::Dtg),
        ("fog", SensorKind::Fog),
        ("rlg", SensorKind::Rlg),
        ("mems_gyro", SensorKind::MemsGyro),
        ("accelerometer", SensorKind::Accelerometer),
        ("doppler", SensorKind::Doppler),
        ("ins_velocity", SensorKind::InsVelocity),
        ("gnss_velocity", SensorKind::GnssVelocity),
        ("other", SensorKind::Other),
    ];

    /// What it measures.
    pub const fn dimension(self) -> Dimension {
        match self {
            Self::Dtg | Self::Fog | Self::Rlg | Self::MemsGyro => Dimension::AngularRate,
            Self::Accelerometer => Dimension::Acceleration,
            Self::Doppler | Self::InsVelocity | Self::GnssVelocity => Dimension::Velocity,
            Self::Other => Dimension::Other,
        }
    }
}

/// What the simulation believes about a sensor, in the sensor's unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Nominal {
    /// Constant error.
    pub bias: f64,
    /// Scale-factor error, 10⁻⁶.
    pub scale_factor_ppm: f64,
    /// White noise, 1 σ per sample.
    pub white: f64,
    /// First-order Markov noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markov: Option<Markov>,
    /// Exponential-cosine noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exp_cos: Option<ExponentialCosine>,
    /// Random walk, 1 σ per √s.
    pub random_walk: f64,
    /// Dependence of the bias on a recorded temperature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_bias: Option<TemperatureBias>,
}

/// First-order Markov noise, `R(τ) = σ² exp(−|τ|/tau)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Markov {
    /// Standard deviation σ, in the sensor's unit.
    pub sigma: f64,
    /// Correlation time, s.
    pub tau_s: f64,
}

/// Exponential-cosine noise, `R(τ) = σ² exp(−α|τ|) cos βτ`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ExponentialCosine {
    /// Standard deviation σ, in the sensor's unit.
    pub sigma: f64,
    /// Decay α, 1/s.
    pub alpha: f64,
    /// Angular frequency β, rad/s.
    pub beta: f64,
}

/// Bias as a polynomial of a recorded temperature.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TemperatureBias {
    /// Column of the temperature.
    pub column: String,
    /// Temperature at which it vanishes, °C.
    #[serde(rename = "reference_degC")]
    pub reference_deg_c: f64,
    /// Coefficients of (T − reference), (T − reference)² …, in the sensor's unit per K, K² ….
    pub coefficients: Vec<f64>,
}

/// A recorded quantity on which an effect may depend.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Auxiliary {
    /// Its column.
    pub column: String,
    /// What it is.
    pub quantity: Quantity,
    /// Its unit.
    pub unit: String,
    /// Value of one of the column's numbers in `unit`, as of counts; without it 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Value in `unit` where the column says 0; without it 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// The sensor or group it sits at, or [`ELECTRONICS`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<String>,
    /// Where it sits in body axes, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
}

/// What `near` says of a thermometer that is at the electronics and at no sensor.
pub const ELECTRONICS: &str = "electronics";
/// Words of a column's name from which it is guessed that a thermometer is at the electronics.
const WORDS_FOR_ELECTRONICS: [&str; 6] = ["electronics", "electronic", "elec", "el", "board", "pcb"];

impl Auxiliary {
    /// Whether it is at the electronics: stated by `near`, or, where nothing is stated, guessed from a whole word of the
    /// column's name.
    pub fn at_electronics(&self) -> bool {
        at_electronics(&self.column, self.near.as_deref())
    }

    /// Whether [`at_electronics`](Self::at_electronics) is a guess.
    pub fn is_guessed_at_electronics(&self) -> bool {
        self.near.is_none() && self.at_electronics()
    }
}

/// [`Auxiliary::at_electronics`] of a column that is near something.
pub fn at_electronics(column: &str, near: Option<&str>) -> bool {
    match near {
        Some(near) => near == ELECTRONICS,
        None => words(column).any(|word| WORDS_FOR_ELECTRONICS.contains(&word.as_str())),
    }
}

/// The words of a name, which letters are, between other characters and before capitals: `boardTemp` has two.
fn words(name: &str) -> impl Iterator<Item = String> {
    let mut words = vec![String::new()];
    let mut before = None;
    for c in name.chars() {
        if !c.is_alphabetic() || c.is_uppercase() && before.is_some_and(char::is_lowercase) {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| c.is_alphabetic()) {
            word.extend(c.to_lowercase());
        }
        before = Some(c);
    }
    words.into_iter().filter(|word| !word.is_empty())
}

/// What an auxiliary column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Temperature.
    Temperature,
    /// Supply voltage.
    Voltage,
    /// Current.
    Current,
    /// Air pressure.
    Pressure,
    /// Magnetic field along the body's x axis.
    MagneticFieldX,
    /// Magnetic field along the body's y axis.
    MagneticFieldY,
    /// Magnetic field along the body's z axis.
    MagneticFieldZ,
    /// Root mean square of vibration.
    VibrationRms,
    /// Speed.
    Speed,
    /// Anything else.
    Other,
}

impl Quantity {
    /// Every quantity under its name in the case file.
    pub const NAMES: [(&'static str, Quantity); 10] = [
        ("temperature", Quantity::Temperature),
        ("voltage", Quantity::Voltage),
        ("current", Quantity::Current),
        ("pressure", Quantity::Pressure),
        ("magnetic_field_x", Quantity::MagneticFieldX),
        ("magnetic_field_y", Quantity::MagneticFieldY),
        ("magnetic_field_z", Quantity::MagneticFieldZ),
        ("vibration_rms", Quantity::VibrationRms),
        ("speed", Quantity::Speed),
        ("other", Quantity::Other),
    ];
}

/// Nominal model of a Schuler loop, in SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SchulerLoop {
    /// Radius of the Earth, m.
    pub radius_m: f64,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Accelerometer error, m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer: Option<Markov>,
    /// Gyro drift, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro: Option<Markov>,
    /// White noise of the velocity difference, m/s, 1 σ per sample.
    pub velocity_white: f64,
}

impl Default for SchulerLoop {
    fn default() -> Self {
        Self {
            radius_m: 6_371_000.0,
            gravity: STANDARD_GRAVITY,
            accelerometer: None,
            gyro: None,
            velocity_white: 0.0,
        }
    }
}

impl Sensor {
    /// A sensor in the column of its name, of which the case states no more: no axis, its `nominal` in `unit`. Panics: never.
    ///
    /// ```
    /// use schuler_recording::case::{Nominal, Sensor, SensorKind};
    /// use schuler_recording::unit::Unit;
    ///
    /// let nominal = Nominal { white: 0.1, ..Nominal::default() };
    /// let along_x = Sensor {
    ///     axis: Some([1.0, 0.0, 0.0]),
    ///     ..Sensor::new("gyro_x", SensorKind::Fog, Unit::DegreePerHour, nominal)
    /// };
    /// assert_eq!(along_x.column, "gyro_x");
    /// ```
    pub fn new(id: &str, kind: SensorKind, unit: Unit, nominal: Nominal) -> Self {
        Self {
            id: id.to_owned(),
            kind,
            column: id.to_owned(),
            scale: None,
            predicted: None,
            predicted_unit: None,
            unit,
            axis: None,
            group: None,
            spin_axis: None,
            quantisation: 0.0,
            relative: false,
            grade: None,
            nominal,
        }
    }

    /// The same sensor with every value in the SI unit of its dimension.
    #[must_use]
    pub fn in_si(&self) -> Self {
        let factor = self.unit.in_si();
        let nominal = &self.nominal;
        Self {
            unit: self.unit.si(),
            quantisation: self.quantisation * factor,
            nominal: Nominal {
                bias: nominal.bias * factor,
                scale_factor_ppm: nominal.scale_factor_ppm,
                white: nominal.white * factor,
                markov: nominal.markov.map(|markov| Markov { sigma: markov.sigma * factor, ..markov }),
                exp_cos: nominal
                    .exp_cos
                    .map(|noise| ExponentialCosine { sigma: noise.sigma * factor, ..noise }),
                random_walk: nominal.random_walk * factor,
                temperature_bias: nominal.temperature_bias.clone().map(|mut dependence| {
                    dependence.coefficients.iter_mut().for_each(|coefficient| *coefficient *= factor);
                    dependence
                }),
            },
            ..self.clone()
        }
    }
}

/// The name of `value` in `names`.
fn name_of<T: PartialEq>(value: &T, names: &[(&'static str, T)]) -> &'static str {
    names.iter().find(|(_, named)| named == value).map_or("", |&(name, _)| name)
}

macro_rules! named_in_the_file {
    ($($type:ty),*) => {$(
        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(name_of(self, &Self::NAMES))
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(name_of(self, &Self::NAMES))
            }
        }
    )*};
}

named_in_the_file!(
    TimeUnit, Duplicates, MotionKind, SensorKind, Grade, Quantity, Clock, Covers, Order, Frames
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_guess_of_whole_words_where_nothing_is_stated() {
        for column in ["T_board", "temperature_electronics", "boardTemp", "pcb", "t.el.1", "ELEC_T", "board2"]
        {
            assert!(at_electronics(column, None), "{column}");
            assert!(!at_electronics(column, Some("gyro_x")), "{column}");
        }
        for column in [
            "temperature_starboard",
            "elevation",
            "accel_temp",
            "T_select",
            "delta",
            "keyboard",
            "outboard_T",
            "",
        ] {
            assert!(!at_electronics(column, None), "{column}");
            assert!(at_electronics(column, Some("electronics")), "{column}");
        }
    }
}
