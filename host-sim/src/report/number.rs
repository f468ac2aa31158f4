//! Values with their uncertainty, units and times, as people write them.

/// Sensor units, longest first: what stands before "per" in the unit of a coefficient.
const SENSOR_UNITS: [&str; 9] = ["m/s^2", "deg/h", "deg/s", "rad/s", "m/s", "ug", "mg", "g", "ppm"];
/// What the units of the format look like in print.
const PRINTED: [(&str, &str); 12] = [
    ("degC", "°C"),
    ("deg", "°"),
    ("arcsec", "″"),
    ("ug", "µg"),
    ("uT", "µT"),
    ("^2", "²"),
    ("^3", "³"),
    ("^-1", "⁻¹"),
    ("sqrt(h)", "√h"),
    ("sqrt(s)", "√s"),
    ("sqrt(Hz)", "√Hz"),
    ("*", "·"),
];
/// Decimal exponents at which a number is written without a power of ten.
const PLAIN: std::ops::RangeInclusive<i32> = -3..=4;
const MINUTE: f64 = 60.0;
const HOUR: f64 = 3600.0;
const DAY: f64 = 86400.0;

/// `value ± sigma unit`: the uncertainty with one digit, or two where it begins with 1, 2 or 3; the value down to the
/// same place.
pub(super) fn quoted(value: f64, sigma: Option<f64>, unit: &str) -> String {
    let unit = printed_unit(unit);
    let number = match sigma.filter(|sigma| sigma.is_finite() && *sigma > 0.0) {
        Some(sigma) if value.is_finite() => with_sigma(value, sigma),
        _ => plain(value, 3),
    };
    if unit.is_empty() { number } else { format!("{number} {unit}") }
}

fn with_sigma(value: f64, sigma: f64) -> String {
    let leading = sigma / 10f64.powi(exponent(sigma));
    let place = exponent(sigma) - i32::from(leading < 3.55);
    let exponent = exponent(value.abs().max(sigma));
    if PLAIN.contains(&exponent) && place >= -6 {
        let digits = (-place).max(0) as usize;
        let to_place = |number: f64| (number / 10f64.powi(place)).round() * 10f64.powi(place);
        return format!("{:.digits$} ± {:.digits$}", to_place(value), to_place(sigma));
    }
    let digits = (exponent - place).max(0) as usize;
    let scale = 10f64.powi(exponent);
    format!("({:.digits$} ± {:.digits$})·10{}", value / scale, sigma / scale, raised(exponent))
}

/// A number with so many significant digits.
pub(super) fn plain(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "unknown".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    // Rounded before it is divided into digits and exponent: 9.96 is 10 with one digit.
    let digits = digits.saturating_sub(1);
    let rounded = format!("{value:.digits$e}");
    let (mantissa, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let exponent: i32 = exponent.parse().unwrap_or_default();
    if PLAIN.contains(&exponent) {
        let digits = digits.saturating_add_signed(-exponent as isize);
        return format!("{value:.digits$}");
    }
    format!("{mantissa}·10{}", raised(exponent))
}

/// Probability below which a number says nothing to anybody.
const LEAST_PROBABILITY: f64 = 1e-9;

/// A probability.
pub(super) fn probability(p: f64) -> String {
    match p {
        p if p >= 0.01 => format!("p = {p:.2}"),
        p if p < LEAST_PROBABILITY => "p < 10⁻⁹".to_owned(),
        p => format!("p = {}", plain(p, 1)),
    }
}

/// A share in per cent.
pub(super) fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.0} %", 100.0 * share) } else { "an unknown share".to_owned() }
}

fn exponent(value: f64) -> i32 {
    value.abs().log10().floor().clamp(-300.0, 300.0) as i32
}

fn raised(exponent: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit.to_digit(10).unwrap_or_default()).unwrap_or(digit),
    };
    exponent.to_string().chars().map(digit).collect()
}

/// `deg/h/(K/h)` as `°/h per K/h`.
pub(super) fn printed_unit(unit: &str) -> String {
    if unit == "1" {
        return String::new();
    }
    let split = SENSOR_UNITS.iter().find_map(|of_sensor| {
        let per = unit.strip_prefix(of_sensor)?.strip_prefix('/')?;
        // °/h/√h is one unit, and so is what another sensor unit begins.
        let whole = per.starts_with("sqrt(") || SENSOR_UNITS.contains(&unit);
        (!whole).then_some((*of_sensor, per))
    });
    let print = |text: &str| PRINTED.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to));
    match split {
        Some((of_sensor, per)) => {
            let inner = per.strip_prefix('(').and_then(|p| p.strip_suffix(')')).unwrap_or(per);
            format!("{} per {}", print(of_sensor), print(inner))
        }
        None => print(unit),
    }
}

/// A time or a length of time, to the two largest of its units.
pub(super) fn duration(seconds: f64) -> String {
    let two = |large: f64, large_name: &str, small: f64, small_name: &str| {
        let all = (seconds / small).round();
        let ratio = large / small;
        let (whole, rest) = ((all / ratio).floor(), all % ratio);
        if rest == 0.0 {
            format!("{whole:.0} {large_name}")
        } else {
            format!("{whole:.0} {large_name} {rest:.0} {small_name}")
        }
    };
    match seconds {
        s if !s.is_finite() => "unknown".to_owned(),
        s if s >= 2.0 * DAY => two(DAY, "d", HOUR, "h"),
        s if s >= HOUR => two(HOUR, "h", MINUTE, "min"),
        s if s >= 2.0 * MINUTE => two(MINUTE, "min", 1.0, "s"),
        s => format!("{} s", plain(s, 3)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_digits_that_its_uncertainty_allows() {
        assert_eq!(quoted(1.9012, Some(0.0401), "deg/h/(K/h)"), "1.90 ± 0.04 °/h per K/h");
        assert_eq!(quoted(1.9012, Some(0.0213), ""), "1.901 ± 0.021");
        assert_eq!(quoted(0.0019, Some(0.00004), "deg/h"), "0.00190 ± 0.00004 °/h");
        assert_eq!(quoted(1.9e-6, Some(4e-8), "rad/s"), "(1.90 ± 0.04)·10⁻⁶ rad/s");
        assert_eq!(quoted(-12345.0, Some(678.0), "s"), "-12300 ± 700 s");
        assert_eq!(quoted(0.02, Some(3.0), "m"), "0.0 ± 3.0 m");
        assert_eq!(quoted(300.0, None, "s"), "300 s");
        assert_eq!(quoted(f64::NAN, Some(1.0), ""), "unknown");
        assert_eq!(quoted(7.0, Some(f64::NAN), "ppm"), "7.00 ppm");
    }

    #[test]
    fn units_are_printed_as_they_are_spoken() {
        assert_eq!(printed_unit("ug/K"), "µg per K");
        assert_eq!(printed_unit("m/s^2"), "m/s²");
        assert_eq!(printed_unit("deg/h/g"), "°/h per g");
        assert_eq!(printed_unit("g"), "g");
        assert_eq!(printed_unit("degC"), "°C");
        assert_eq!(printed_unit("deg/h/sqrt(h)"), "°/h/√h");
        assert_eq!(printed_unit("m/s"), "m/s");
        assert_eq!(printed_unit("ppm/K"), "ppm per K");
    }

    #[test]
    fn times_have_two_units() {
        assert_eq!(duration(11_520.0), "3 h 12 min");
        assert_eq!(duration(86_400.0), "24 h");
        assert_eq!(duration(3599.7), "60 min");
        assert_eq!(duration(90.5), "90.5 s");
        assert_eq!(duration(200_000.0), "2 d 8 h");
        assert_eq!(duration(0.0), "0 s");
    }

    #[test]
    fn very_small_numbers_have_a_power_of_ten() {
        assert_eq!(plain(3.0e-12, 2), "3.0·10⁻¹²");
        assert_eq!(probability(0.2), "p = 0.20");
        assert_eq!(probability(0.0), "p < 10⁻⁹");
        assert_eq!(probability(3e-5), "p = 3·10⁻⁵");
        assert_eq!(probability(9.96e-7), "p = 1·10⁻⁶");
    }
}
