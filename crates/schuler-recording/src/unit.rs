//! The units in which a case file may be written, and their conversion to SI.
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use serde::{Serialize, Serializer};

/// Standard gravity, m/s²: what one g of a data sheet means.
pub const STANDARD_GRAVITY: f64 = 9.80665;

/// What a sensor measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Angular rate, SI unit rad/s.
    AngularRate,
    /// Specific force, SI unit m/s².
    Acceleration,
    /// Velocity, SI unit m/s.
    Velocity,
    /// Anything else, in whatever unit it is written: pressure, torque, position.
    Other,
}

/// Unit of a sensor's column and of its nominal values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// rad/s
    RadianPerSecond,
    /// °/s
    DegreePerSecond,
    /// °/h
    DegreePerHour,
    /// m/s²
    MetrePerSecondSquared,
    /// Standard gravity.
    G,
    /// 10⁻³ g
    MilliG,
    /// 10⁻⁶ g
    MicroG,
    /// m/s
    MetrePerSecond,
    /// A unit in free text, which is not converted; made by [`Unit::free`].
    Free(&'static str),
}

/// Unit of what has none.
pub const ONE: Unit = Unit::Free("1");

impl Unit {
    /// A unit in free text, as it is written but for blanks at its ends; an empty one is [`ONE`].
    ///
    /// Each text is kept once as long as the program runs, so that a unit stays a word that is copied.
    ///
    /// ```
    /// use schuler_recording::unit::Unit;
    ///
    /// assert_eq!(Unit::free(" N m ").name(), "N m");
    /// assert_eq!(Unit::free("N m").in_si(), 1.0);
    /// assert_eq!(Unit::free("").name(), "1");
    /// ```
    pub fn free(text: &str) -> Self {
        static KEPT: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
        let text = text.trim();
        if text.is_empty() {
            return ONE;
        }
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = kept.get(text) {
            return Self::Free(known);
        }
        let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
        kept.insert(text);
        Self::Free(text)
    }

    /// Every unit that is converted under its name in the case file.
    pub const NAMES: [(&'static str, Unit); 8] = [
        ("rad/s", Unit::RadianPerSecond),
        ("deg/s", Unit::DegreePerSecond),
        ("deg/h", Unit::DegreePerHour),
        ("m/s^2", Unit::MetrePerSecondSquared),
        ("g", Unit::G),
        ("mg", Unit::MilliG),
        ("ug", Unit::MicroG),
        ("m/s", Unit::MetrePerSecond),
    ];

    /// What is measured in this unit.
    pub const fn dimension(self) -> Dimension {
        match self {
            Self::RadianPerSecond | Self::DegreePerSecond | Self::DegreePerHour => Dimension::AngularRate,
            Self::MetrePerSecondSquared | Self::G | Self::MilliG | Self::MicroG => Dimension::Acceleration,
            Self::MetrePerSecond => Dimension::Velocity,
            Self::Free(_) => Dimension::Other,
        }
    }

    /// Value of one of this unit in the SI unit of its dimension; 1 for free text.
    pub const fn in_si(self) -> f64 {
        match self {
            Self::RadianPerSecond | Self::MetrePerSecondSquared | Self::MetrePerSecond | Self::Free(_) => 1.0,
            Self::DegreePerSecond => PI / 180.0,
            Self::DegreePerHour => PI / 180.0 / 3600.0,
            Self::G => STANDARD_GRAVITY,
            Self::MilliG => STANDARD_GRAVITY / 1e3,
            Self::MicroG => STANDARD_GRAVITY / 1e6,
        }
    }

    /// The SI unit of the same dimension; free text as it is.
    #[must_use]
    pub const fn si(self) -> Unit {
        match self {
            Self::Free(_) => self,
            _ => self.dimension().si_unit(),
        }
    }

    /// Name in the case file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::RadianPerSecond => "rad/s",
            Self::DegreePerSecond => "deg/s",
            Self::DegreePerHour => "deg/h",
            Self::MetrePerSecondSquared => "m/s^2",
            Self::G => "g",
            Self::MilliG => "mg",
            Self::MicroG => "ug",
            Self::MetrePerSecond => "m/s",
            Self::Free(text) => text,
        }
    }
}

impl Dimension {
    /// The SI unit; of what is in free text none is known, and it is [`ONE`].
    pub const fn si_unit(self) -> Unit {
        match self {
            Self::AngularRate => Unit::RadianPerSecond,
            Self::Acceleration => Unit::MetrePerSecondSquared,
            Self::Velocity => Unit::MetrePerSecond,
            Self::Other => ONE,
        }
    }

    /// The units that measure it and are converted.
    pub fn units(self) -> impl Iterator<Item = Unit> {
        Unit::NAMES.into_iter().map(|(_, unit)| unit).filter(move |unit| unit.dimension() == self)
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for Unit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// A unit of an auxiliary quantity: SI name, factor and offset, value in SI = factor · value + offset.
///
/// Temperature in °C and a difference in K stay as they are, and so does every unit that is not known here.
#[derive(Clone, Debug, PartialEq)]
pub struct AuxConversion {
    /// Name of the unit after the conversion.
    pub unit: String,
    /// Factor.
    pub factor: f64,
    /// Offset, in the unit after the conversion.
    pub offset: f64,
}

impl AuxConversion {
    /// The conversion of the auxiliary unit `name`: as it is written, else in any case and by its other names.
    pub fn of(name: &str) -> Self {
        let name = name.trim();
        let (unit, factor, offset) =
            known(name).or_else(|| known(other_name(name)?)).unwrap_or((name, 1.0, 0.0));
        Self { unit: unit.to_owned(), factor, offset }
    }

    /// `value` after the conversion.
    pub fn apply(&self, value: f64) -> f64 {
        self.factor * value + self.offset
    }

    /// Whether values stay as they are, to the bit.
    pub fn is_identity(&self) -> bool {
        self.factor == 1.0 && self.offset == 0.0
    }
}

/// SI unit, factor and offset of a unit as its symbol is written: G is gauss, g gravity.
fn known(name: &str) -> Option<(&'static str, f64, f64)> {
    Some(match name {
        "degC" => ("degC", 1.0, 0.0),
        "degF" => ("degC", 5.0 / 9.0, -160.0 / 9.0),
        "K" => ("K", 1.0, 0.0),
        "mK" => ("K", 1e-3, 0.0),
        "V" => ("V", 1.0, 0.0),
        "mV" => ("V", 1e-3, 0.0),
        "A" => ("A", 1.0, 0.0),
        "mA" => ("A", 1e-3, 0.0),
        "Pa" => ("Pa", 1.0, 0.0),
        "hPa" | "mbar" => ("Pa", 1e2, 0.0),
        "kPa" => ("Pa", 1e3, 0.0),
        "bar" => ("Pa", 1e5, 0.0),
        "psi" => ("Pa", 6_894.757_293_168_361, 0.0),
        "T" => ("T", 1.0, 0.0),
        "G" => ("T", 1e-4, 0.0),
        "mG" => ("T", 1e-7, 0.0),
        "mT" => ("T", 1e-3, 0.0),
        "uT" => ("T", 1e-6, 0.0),
        "nT" => ("T", 1e-9, 0.0),
        "rad" => ("rad", 1.0, 0.0),
        "deg" => ("rad", PI / 180.0, 0.0),
        "mrad" => ("rad", 1e-3, 0.0),
        "arcsec" => ("rad", PI / 648_000.0, 0.0),
        "rad/s" => ("rad/s", 1.0, 0.0),
        "deg/s" => ("rad/s", PI / 180.0, 0.0),
        "deg/h" => ("rad/s", PI / 648_000.0, 0.0),
        "m/s^2" => ("m/s^2", 1.0, 0.0),
        "g" => ("m/s^2", STANDARD_GRAVITY, 0.0),
        "mg" => ("m/s^2", STANDARD_GRAVITY / 1e3, 0.0),
        "ug" => ("m/s^2", STANDARD_GRAVITY / 1e6, 0.0),
        "m/s" => ("m/s", 1.0, 0.0),
        "km/h" => ("m/s", 1.0 / 3.6, 0.0),
        "knot" => ("m/s", 1852.0 / 3600.0, 0.0),
        "m" => ("m", 1.0, 0.0),
        "mm" => ("m", 1e-3, 0.0),
        "cm" => ("m", 1e-2, 0.0),
        _ => return None,
    })
}

/// The symbol of a unit that is written otherwise, in capitals or small letters.
fn other_name(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().replace(['_', ' '], "").as_str() {
        "c" | "degc" | "°c" | "℃" | "celsius" | "centigrade" | "degreescelsius" => "degC",
        "f" | "degf" | "°f" | "℉" | "fahrenheit" | "degreesfahrenheit" => "degF",
        "k" | "kelvin" => "K",
        "v" | "volt" | "volts" => "V",
        "mv" | "millivolt" | "millivolts" => "mV",
        "a" | "amp" | "amps" | "ampere" => "A",
        "ma" | "milliamp" | "milliampere" => "mA",
        "pa" | "pascal" => "Pa",
        "hpa" | "mbar" | "millibar" => "hPa",
        "kpa" => "kPa",
        "bar" => "bar",
        "psi" => "psi",
        "tesla" => "T",
        "gauss" => "G",
        "milligauss" => "mG",
        "ut" | "µt" | "μt" | "microtesla" => "uT",
        "nt" | "nanotesla" => "nT",
        "radian" | "radians" => "rad",
        "deg" | "°" | "degree" | "degrees" => "deg",
        "rad/s" => "rad/s",
        "deg/s" | "°/s" | "dps" => "deg/s",
        "deg/h" | "°/h" | "deg/hr" | "dph" => "deg/h",
        "m/s^2" | "m/s2" | "m/s²" | "m/s/s" => "m/s^2",
        "m/s" => "m/s",
        "km/h" | "kmh" | "kph" => "km/h",
        "knot" | "knots" | "kn" | "kt" | "kts" => "knot",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_are_the_names() {
        for (name, unit) in Unit::NAMES {
            assert_eq!(unit.name(), name);
            assert_eq!(unit.si().in_si(), 1.0);
        }
        assert_eq!(Dimension::Acceleration.units().count(), 4);
    }

    #[test]
    fn conversions_agree_with_published_values() {
        assert!((Unit::DegreePerHour.in_si() - 4.848_136_811_095_36e-6).abs() < 1e-19);
        assert!((Unit::MicroG.in_si() - 9.80665e-6).abs() < 1e-20);
        assert!((AuxConversion::of("degF").apply(212.0) - 100.0).abs() < 1e-12);
        assert!((AuxConversion::of("G").apply(0.5) - 50e-6).abs() < 1e-18);
        assert!(AuxConversion::of("degC").is_identity());
        assert_eq!(AuxConversion::of("smoot").unit, "smoot");
        for name in ["degF", "F", "f", "DEGF", "fahrenheit", "Fahrenheit", "°F", "deg F"] {
            assert!((AuxConversion::of(name).apply(32.0)).abs() < 1e-12, "{name}");
            assert_eq!(AuxConversion::of(name).unit, "degC", "{name}");
        }
        for (name, unit) in
            [("C", "degC"), ("Celsius", "degC"), ("VOLT", "V"), ("MBAR", "Pa"), ("G", "T"), ("g", "m/s^2")]
        {
            assert_eq!(AuxConversion::of(name).unit, unit, "{name}");
        }
    }
}
