//! What the name and the values of a column say of it.
use schuler_recording::case::Quantity;
use schuler_recording::unit::STANDARD_GRAVITY;

/// What a column seems to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Angular rate about a body axis, 0 to 2.
    Gyro(usize),
    /// Specific force along a body axis.
    Accelerometer(usize),
    /// A quantity on which effects may depend.
    Quantity(Quantity),
    /// Anything else.
    Other,
}

/// A column as it is understood.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    /// What it holds.
    pub what: What,
    /// Its unit; none where neither name nor values say one.
    pub unit: Option<String>,
    /// Whether the unit stands in the name, and is no guess from the values.
    pub unit_is_named: bool,
}

/// Endings of names behind a `_` that are units, the longest first.
const ENDINGS: [(&str, &str); 33] = [
    ("m_per_s2", "m/s^2"),
    ("rad_per_s", "rad/s"),
    ("deg_per_s", "deg/s"),
    ("deg_per_h", "deg/h"),
    ("m_s_s", "m/s^2"),
    ("m_s2", "m/s^2"),
    ("rad_s", "rad/s"),
    ("deg_s", "deg/s"),
    ("deg_h", "deg/h"),
    ("deg_c", "degC"),
    ("m_s", "m/s"),
    ("n_m", "N m"),
    ("radps", "rad/s"),
    ("degps", "deg/s"),
    ("mps2", "m/s^2"),
    ("ms2", "m/s^2"),
    ("dps", "deg/s"),
    ("mps", "m/s"),
    ("degc", "degC"),
    ("degf", "degF"),
    ("hpa", "hPa"),
    ("kpa", "kPa"),
    ("mbar", "mbar"),
    ("pa", "Pa"),
    ("bar", "bar"),
    ("ut", "uT"),
    ("nm", "N m"),
    ("mg", "mg"),
    ("ug", "ug"),
    ("rad", "rad"),
    ("deg", "deg"),
    ("rpm", "rpm"),
    ("m", "m"),
];

/// Other ways to write the units of inertial sensors.
const SPELLINGS: [(&str, &str); 13] = [
    ("m/s2", "m/s^2"),
    ("m/s²", "m/s^2"),
    ("m/s/s", "m/s^2"),
    ("m/s**2", "m/s^2"),
    ("°/s", "deg/s"),
    ("dps", "deg/s"),
    ("°/h", "deg/h"),
    ("deg/hr", "deg/h"),
    ("rad/sec", "rad/s"),
    ("deg/sec", "deg/s"),
    ("°c", "degC"),
    ("celsius", "degC"),
    ("nm", "N m"),
];

/// A name without its unit, and the unit.
pub fn without_unit(name: &str) -> (&str, Option<String>) {
    let name = name.trim();
    for (open, close) in [('(', ')'), ('[', ']'), ('{', '}')] {
        if let Some((stem, unit)) = name.strip_suffix(close).and_then(|name| name.rsplit_once(open)) {
            return (stem.trim(), (!unit.trim().is_empty()).then(|| spelt(unit.trim())));
        }
    }
    let lower = name.to_lowercase();
    for (ending, unit) in ENDINGS {
        // A name that is nothing but a unit is a name.
        if let Some(stem) = lower.strip_suffix(ending).and_then(|stem| stem.strip_suffix('_'))
            && !stem.is_empty()
            && let Some(stem) = name.get(..stem.len())
        {
            return (stem, Some(unit.to_owned()));
        }
    }
    (name, None)
}

fn spelt(unit: &str) -> String {
    let lower = unit.to_lowercase();
    let other = SPELLINGS.iter().find(|(spelling, _)| *spelling == lower);
    other.map_or(unit, |(_, unit)| unit).to_owned()
}

/// The letters and digits of a name without its unit, in small letters: what two tables may have in common.
pub fn key(name: &str) -> String {
    without_unit(name).0.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// What a column holds, by its name and its values.
pub fn guess(name: &str, values: &[f64]) -> Guess {
    let (stem, unit) = without_unit(name);
    let what = what(stem);
    let unit_is_named = unit.is_some();
    let fits = |unit: &String| match what {
        What::Gyro(_) => ["rad/s", "deg/s", "deg/h"].contains(&unit.as_str()),
        What::Accelerometer(_) => ["m/s^2", "g", "mg", "ug"].contains(&unit.as_str()),
        What::Quantity(_) | What::Other => true,
    };
    match unit {
        // What is in another unit is no rate and no force.
        Some(unit) if !fits(&unit) => Guess { what: What::Other, unit: Some(unit), unit_is_named },
        Some(unit) => Guess { what, unit: Some(unit), unit_is_named },
        None => Guess { what, unit: unit_by_values(what, values).map(str::to_owned), unit_is_named },
    }
}

fn what(stem: &str) -> What {
    let own = stem.rsplit(['.', '/']).next().unwrap_or(stem);
    let letters: String = stem.chars().filter(|c| c.is_alphabetic()).flat_map(char::to_lowercase).collect();
    let axis = letters.chars().last().and_then(|last| "xyz".find(last));
    let before = letters.strip_suffix(['x', 'y', 'z']).unwrap_or(&letters);
    let has = |parts: &[&str]| parts.iter().any(|part| letters.contains(part));
    if let Some(axis) = axis {
        if has(&["mag"]) || before == "b" {
            let fields = [Quantity::MagneticFieldX, Quantity::MagneticFieldY, Quantity::MagneticFieldZ];
            return What::Quantity(fields[axis]);
        }
        if has(&["gyr", "angularvel", "angularrate", "omega", "angvel"])
            || ["w", "g", "rate"].contains(&before)
        {
            return What::Gyro(axis);
        }
        if has(&["acc", "specificforce", "force"]) || ["a", "f"].contains(&before) {
            return What::Accelerometer(axis);
        }
    }
    let words: Vec<String> = own
        .split(|c: char| !c.is_alphabetic())
        .map(str::to_lowercase)
        .filter(|word| !word.is_empty())
        .collect();
    let is = |names: &[&str]| words.iter().any(|word| names.contains(&word.as_str()));
    if has(&["temp", "therm"]) || own == "T" {
        What::Quantity(Quantity::Temperature)
    } else if has(&["volt", "vbat", "battery"]) {
        What::Quantity(Quantity::Voltage)
    } else if has(&["current"]) {
        What::Quantity(Quantity::Current)
    } else if has(&["press", "baro"]) || own == "P" {
        What::Quantity(Quantity::Pressure)
    } else if is(&["speed", "airspeed", "groundspeed"]) {
        What::Quantity(Quantity::Speed)
    } else {
        What::Other
    }
}

/// The unit that values of this size have as a rule.
fn unit_by_values(what: What, values: &[f64]) -> Option<&'static str> {
    let mut sizes: Vec<f64> =
        values.iter().map(|value| value.abs()).filter(|size| size.is_finite()).collect();
    sizes.sort_by(f64::total_cmp);
    let largest = sizes.get(sizes.len().saturating_sub(1) * 99 / 100).copied()?;
    let median = sizes.get(sizes.len() / 2).copied()?;
    match what {
        // 17 rad/s is the end of the usual range of 1000 °/s.
        What::Gyro(_) => Some(if largest > 18.0 { "deg/s" } else { "rad/s" }),
        What::Accelerometer(_) if largest > 20.0 * STANDARD_GRAVITY => Some("mg"),
        What::Accelerometer(_) if largest > 4.0 => Some("m/s^2"),
        What::Accelerometer(_) if median > 0.5 => Some("g"),
        What::Accelerometer(_) => Some("m/s^2"),
        What::Quantity(Quantity::Temperature) => Some(if median > 200.0 { "K" } else { "degC" }),
        What::Quantity(Quantity::Voltage) => Some("V"),
        What::Quantity(Quantity::Current) => Some("A"),
        What::Quantity(Quantity::Pressure) => Some(match median {
            2e4.. => "Pa",
            200.0.. => "hPa",
            20.0.. => "kPa",
            _ => "bar",
        }),
        What::Quantity(Quantity::MagneticFieldX | Quantity::MagneticFieldY | Quantity::MagneticFieldZ) => {
            Some(match largest {
                100.0.. => "mG",
                5.0.. => "uT",
                0.01.. => "G",
                _ => "T",
            })
        }
        What::Quantity(Quantity::Speed) => Some("m/s"),
        What::Quantity(Quantity::VibrationRms | Quantity::Other) | What::Other => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_understood_with_their_units() {
        for (name, what, unit) in [
            ("gyro_x (deg/s)", What::Gyro(0), "deg/s"),
            ("wz", What::Gyro(2), "rad/s"),
            ("angular_velocity.y", What::Gyro(1), "rad/s"),
            ("acc_y_m_s2", What::Accelerometer(1), "m/s^2"),
            ("Ax", What::Accelerometer(0), "m/s^2"),
            ("Accelerometer Z [m/s²]", What::Accelerometer(2), "m/s^2"),
            ("mag_x [uT]", What::Quantity(Quantity::MagneticFieldX), "uT"),
            ("T", What::Quantity(Quantity::Temperature), "degC"),
            ("temp_gyro", What::Quantity(Quantity::Temperature), "degC"),
            ("torque_Nm", What::Other, "N m"),
            ("acc_x_rad", What::Other, "rad"),
        ] {
            let guess = guess(name, &[0.1, 5.0, 5.1]);
            assert_eq!((guess.what, guess.unit.as_deref()), (what, Some(unit)), "{name}");
        }
        assert_eq!(guess("position", &[1.0]).unit, None);
        assert_eq!(guess("pressure", &[1013.0]).unit.as_deref(), Some("hPa"));
        assert!(!guess("pressure", &[1013.0]).unit_is_named);
    }

    #[test]
    fn keys_of_two_tables_meet() {
        assert_eq!(key("Gyro X [deg/s]"), key("gyro_x"));
        assert_eq!(key("gyroX_rad_s"), key("GYRO.X"));
        assert_ne!(key("gyro_x"), key("gyro_y"));
        assert_eq!(without_unit("m").0, "m");
    }
}
