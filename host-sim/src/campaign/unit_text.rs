//! Units written as text, `deg/h/(K/h)`, `ug/g^2`, `(m/s^2)^-1`: their SI factor and dimension.
//!
//! Answers and explanations may give a parameter in any unit of its dimension; they are compared in SI units. An angle has no
//! dimension, ppm is a number, and a symbol that is not known here is a unit of its own.
use std::collections::BTreeMap;

/// Largest power that a unit may have; beyond, the text is no unit.
const MOST_POWER: i32 = 12;

/// A unit: its SI factor and the powers of its base symbols.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitText {
    /// SI units in one of it.
    pub factor: f64,
    /// Powers of its base symbols; none that is zero.
    pub powers: BTreeMap<String, i32>,
}

/// SI factor of a unit's text; none where it is no unit.
pub fn si_factor(text: &str) -> Option<f64> {
    parse(text).map(|unit| unit.factor)
}

/// Reads a unit.
pub fn parse(text: &str) -> Option<UnitText> {
    let mut rest = text.trim();
    if rest.is_empty() {
        return Some(UnitText { factor: 1.0, powers: BTreeMap::new() });
    }
    let unit = product(&mut rest)?;
    rest.trim().is_empty().then_some(unit)
}

fn product(rest: &mut &str) -> Option<UnitText> {
    let mut unit = power(rest)?;
    loop {
        let trimmed = rest.trim_start();
        let (sign, skip) = match trimmed.chars().next() {
            Some('/') => (-1, 1),
            Some('*') => (1, 1),
            Some('·') => (1, '·'.len_utf8()),
            // 'N m': a blank multiplies.
            Some(c) if c != ')' && trimmed.len() < rest.len() => (1, 0),
            _ => return Some(unit),
        };
        *rest = &trimmed[skip..];
        let next = power(rest)?;
        unit = combine(unit, &next, sign)?;
    }
}

fn power(rest: &mut &str) -> Option<UnitText> {
    let base = atom(rest)?;
    let trimmed = rest.trim_start();
    let exponent = if let Some(after) = trimmed.strip_prefix('^') {
        let end =
            after.char_indices().skip(1).find(|(_, c)| !c.is_ascii_digit()).map_or(after.len(), |(i, _)| i);
        let value = after.get(..end)?.parse().ok()?;
        *rest = &after[end..];
        value
    } else if let Some(after) = trimmed.strip_prefix('²') {
        *rest = after;
        2
    } else if let Some(after) = trimmed.strip_prefix('³') {
        *rest = after;
        3
    } else {
        return Some(base);
    };
    combine(UnitText { factor: 1.0, powers: BTreeMap::new() }, &base, exponent)
}

fn atom(rest: &mut &str) -> Option<UnitText> {
    let trimmed = rest.trim_start();
    if let Some(inner) = trimmed.strip_prefix('(') {
        *rest = inner;
        let unit = product(rest)?;
        *rest = rest.trim_start().strip_prefix(')')?;
        return Some(unit);
    }
    let end = trimmed
        .char_indices()
        .find(|(_, c)| matches!(c, '/' | '*' | '·' | '^' | '(' | ')' | ' ' | '²' | '³'))
        .map_or(trimmed.len(), |(i, _)| i);
    let (name, after) = trimmed.split_at(end);
    if name.is_empty() {
        return None;
    }
    *rest = after;
    Some(symbol(name))
}

fn symbol(name: &str) -> UnitText {
    const DEGREE: f64 = std::f64::consts::PI / 180.0;
    const G: f64 = 9.80665;
    let (factor, powers): (f64, &[(&str, i32)]) = match name {
        "1" | "rad" => (1.0, &[]),
        "mrad" => (1e-3, &[]),
        "urad" | "ppm" => (1e-6, &[]),
        "deg" | "°" => (DEGREE, &[]),
        "arcmin" => (DEGREE / 60.0, &[]),
        "arcsec" | "″" => (DEGREE / 3600.0, &[]),
        "m" => (1.0, &[("m", 1)]),
        "km" => (1e3, &[("m", 1)]),
        "cm" => (1e-2, &[("m", 1)]),
        "mm" => (1e-3, &[("m", 1)]),
        "s" => (1.0, &[("s", 1)]),
        "ms" => (1e-3, &[("s", 1)]),
        "us" => (1e-6, &[("s", 1)]),
        "min" => (60.0, &[("s", 1)]),
        "h" => (3600.0, &[("s", 1)]),
        "d" => (86_400.0, &[("s", 1)]),
        "Hz" => (1.0, &[("s", -1)]),
        "mHz" => (1e-3, &[("s", -1)]),
        "g" => (G, &[("m", 1), ("s", -2)]),
        "mg" => (G * 1e-3, &[("m", 1), ("s", -2)]),
        "ug" | "µg" => (G * 1e-6, &[("m", 1), ("s", -2)]),
        "Gal" => (1e-2, &[("m", 1), ("s", -2)]),
        "mGal" => (1e-5, &[("m", 1), ("s", -2)]),
        "K" | "degC" | "°C" => (1.0, &[("K", 1)]),
        "mK" => (1e-3, &[("K", 1)]),
        "V" => (1.0, &[("V", 1)]),
        "mV" => (1e-3, &[("V", 1)]),
        "A" => (1.0, &[("A", 1)]),
        "mA" => (1e-3, &[("A", 1)]),
        "Pa" => (1.0, &[("Pa", 1)]),
        "hPa" | "mbar" => (1e2, &[("Pa", 1)]),
        "kPa" => (1e3, &[("Pa", 1)]),
        "T" => (1.0, &[("T", 1)]),
        "uT" => (1e-6, &[("T", 1)]),
        "nT" => (1e-9, &[("T", 1)]),
        "G" => (1e-4, &[("T", 1)]),
        other => return UnitText { factor: 1.0, powers: BTreeMap::from([(other.to_owned(), 1)]) },
    };
    UnitText { factor, powers: powers.iter().map(|(name, power)| ((*name).to_owned(), *power)).collect() }
}

fn combine(mut a: UnitText, b: &UnitText, exponent: i32) -> Option<UnitText> {
    a.factor *= b.factor.powi(exponent);
    for (name, power) in &b.powers {
        let sum = a.powers.entry(name.clone()).or_insert(0);
        *sum = sum.checked_add(power.checked_mul(exponent)?)?;
        if sum.abs() > MOST_POWER {
            return None;
        }
    }
    a.powers.retain(|_, power| *power != 0);
    Some(a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_their_si_factors() {
        let degree = std::f64::consts::PI / 180.0;
        for (text, factor) in [
            ("", 1.0),
            ("1", 1.0),
            ("deg/h", degree / 3600.0),
            ("deg/h/(K/h)", degree),
            ("deg/h per K".split(" per").next().unwrap_or(""), degree / 3600.0),
            ("ug/g^2", 1e-6 / 9.80665),
            ("(m/s^2)^-1", 1.0),
            ("ppm/K", 1e-6),
            ("arcsec/K", degree / 3600.0),
            ("deg/h/g/K", degree / 3600.0 / 9.80665),
            ("deg/(h·K)", degree / 3600.0),
            ("m/s²", 1.0),
            ("mHz", 1e-3),
        ] {
            let found = si_factor(text).unwrap();
            assert!((found / factor - 1.0).abs() < 1e-14, "{text}: {found} {factor}");
        }
    }

    #[test]
    fn units_of_one_dimension_are_known_as_such() {
        let powers = |text: &str| parse(text).unwrap().powers;
        assert_eq!(powers("deg/h/(K/h)"), powers("rad/K"));
        assert_eq!(powers("ug"), powers("m/s^2"));
        assert_eq!(powers("(m/s^2)^-1"), powers("ug/g^2"));
        assert_ne!(powers("deg/h/K"), powers("deg/h"));
        assert_eq!(powers("deg/h/%"), powers("rad/s/%"));
    }

    #[test]
    fn what_is_no_unit_is_refused() {
        for text in ["deg//h", "(m/s", "m^", "m^999999999999", "/h", "m)"] {
            assert!(parse(text).is_none(), "{text}");
        }
    }
}
