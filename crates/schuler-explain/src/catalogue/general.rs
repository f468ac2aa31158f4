//! Functions of recorded quantities, for sensors of kind "other", of whose physics the catalogue knows nothing: powers, absolute value,
//! sign, products, rate and delay. They are variants of `bias_on_aux`, which has the quantity itself and its lag.
//!
//! A quantity of both signs is taken as it is: friction goes with the sign of a speed, a stiffness with the cube of a deflection. One that keeps
//! its sign is taken about its mean, where its powers differ from itself.
use schuler_recording::case::SensorKind;

use super::Nonlinear;
use super::draft::{Draft, ITSELF, Plausible, coefficient, logarithmic, to_the};
use super::environment::{near, of_column, per};
use crate::inputs::series::{both_signs, delayed, derivative, map, mean, product, varies};
use crate::inputs::{AuxiliaryInput, Inputs, Place, Series};

/// Quantities of which products are offered; products of more are too many to be told apart.
const MOST_FACTORS: usize = 6;
/// Longest delay, s, and delays in a decade.
const MOST_DELAY_S: f64 = 10.0;
const DELAYS_PER_DECADE: f64 = 4.0;

/// Name and unit of a function, and its values.
type Function = (&'static str, String, Vec<f64>);

/// The functions of every recorded quantity near a sensor of kind "other".
pub(super) fn functions(inputs: &Inputs<'_>, place: &Place) -> Vec<Draft> {
    if place.kind != SensorKind::Other {
        return Vec::new();
    }
    let quantities: Vec<&AuxiliaryInput> = near(inputs, place).collect();
    let is_read = |quantity: &&AuxiliaryInput| !quantity.smoothed;
    let mut drafts: Vec<Draft> = Vec::new();
    for quantity in &quantities {
        let twin = |other: &&AuxiliaryInput| other.smoothed && other.column == quantity.column;
        let has_smooth_twin = is_read(quantity) && quantities.iter().any(twin);
        for (name, unit, values) in of_one(inputs, quantity, has_smooth_twin) {
            if varies(&values) {
                let draft = linear(place, &unit, values, quantity).with("function", name);
                drafts.push(draft);
            }
        }
    }
    let read: Vec<&AuxiliaryInput> = quantities.iter().copied().filter(is_read).collect();
    drafts.extend(read.iter().filter_map(|quantity| late(inputs, place, quantity)));
    let factors = &read[..read.len().min(MOST_FACTORS)];
    for (index, first) in factors.iter().enumerate() {
        for second in &factors[index + 1..] {
            let values = product(&about(first), &about(second));
            let unit = format!("({} {})", first.unit, second.unit);
            if varies(&values) {
                let draft = linear(place, &unit, values, first).with("function", "product");
                drafts.push(draft.with("with", second.column.as_str()));
            }
        }
    }
    drafts
}

/// The functions of one quantity. What of its readings is noise makes no power or product of itself, but hides a change of sign and a rate.
fn of_one(inputs: &Inputs<'_>, quantity: &AuxiliaryInput, has_smooth_twin: bool) -> Vec<Function> {
    let unit = quantity.unit.as_str();
    let rate = || {
        let per_second = if unit.is_empty() { "1/s".to_owned() } else { format!("{unit}/s") };
        ("rate", per_second, derivative(&inputs.time_s, &quantity.values))
    };
    let signed = both_signs(&quantity.values);
    let mut functions = Vec::new();
    if signed {
        functions.push((
            "sign",
            String::new(),
            map(&quantity.values, |x| if x == 0.0 { 0.0 } else { x.signum() }),
        ));
    }
    if !has_smooth_twin {
        functions.push(rate());
    }
    if quantity.smoothed {
        return functions;
    }
    let values = about(quantity);
    let power = |power| if unit.is_empty() { String::new() } else { to_the(unit, power) };
    functions.push(("square", power(2), map(&values, |x| x * x)));
    functions.push(("cube", power(3), map(&values, |x| x * x * x)));
    if signed {
        functions.push(("abs", unit.to_owned(), map(&values, f64::abs)));
        functions.push(("odd_square", power(2), map(&values, |x| x * x.abs())));
    }
    functions
}

/// The values of a quantity of both signs; those of another about its mean.
fn about(quantity: &AuxiliaryInput) -> Series {
    if both_signs(&quantity.values) {
        return quantity.values.clone();
    }
    let middle = mean(&quantity.values);
    map(&quantity.values, |value| value - middle).into()
}

/// A function as a column; where its level is no level of the sensor, with a constant of its own.
fn linear(place: &Place, unit: &str, values: Vec<f64>, quantity: &AuxiliaryInput) -> Draft {
    let mut amplitude = coefficient(place, ITSELF, Plausible::UNKNOWN);
    amplitude.unit = per(place, unit);
    let rows = values.len();
    let draft = Draft::linear(place, values, amplitude);
    let draft = if both_signs(&quantity.values) { draft } else { draft.with_free_zero(place, rows) };
    of_column(draft, &quantity.column, quantity.smoothed)
}

/// A quantity that is seen late.
fn late(inputs: &Inputs<'_>, place: &Place, quantity: &AuxiliaryInput) -> Option<Draft> {
    let most_s = MOST_DELAY_S.min(inputs.duration_s() / 20.0);
    let grid = logarithmic(inputs.recording.step_s, most_s, DELAYS_PER_DECADE);
    if grid.len() < 2 {
        return None;
    }
    let delay = Nonlinear { name: "delay_s", unit: "s", grid };
    let mut amplitude = coefficient(place, ITSELF, Plausible::UNKNOWN);
    amplitude.unit = per(place, &quantity.unit);
    let (time_s, values) = (inputs.time_s.clone(), about(quantity));
    let first = values.first().copied().unwrap_or_default();
    let draft = Draft::grid(place, delay, amplitude, move |delay_s| {
        delayed(&time_s, &values, delay_s).into_iter().map(|value| value.unwrap_or(first)).collect()
    });
    let rows = inputs.rows();
    let draft = draft.with_free_zero(place, rows).with("function", "delay");
    Some(of_column(draft, &quantity.column, false))
}
