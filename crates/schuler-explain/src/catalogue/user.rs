//! Effects of the user's own, as the case defines them by formulas.
//!
//! A formula becomes candidates as a row of the catalogue does: one at each sensor on which it acts, with a column for each amplitude and a grid
//! over the parameters that have a range. Its numbers are those of the case: columns in their units, the result in the unit of the sensor,
//! amplitudes in the unit that the case states.
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use schuler_recording::case::UserEffect;
use schuler_recording::formula::{Formula, check::Scope};

use super::draft::{Draft, any};
use super::form::Form;
use super::formula::{Fault, Names};
use super::in_flight::HAS_NO_TERM;
use super::{Amplitude, Candidate, Column, Effect, Nonlinear, Search, Signature, Target, named};
use crate::explain::Error;
use crate::inputs::series::{bridged, map};
use crate::inputs::{Inputs, Place, Series};

/// Points of a grid over one parameter, and over each of two and of three.
const POINTS: [usize; 3] = [17, 9, 6];
/// A range that spans more than this factor is divided evenly by its logarithm.
const DECADE: f64 = 10.0;
/// How the identifiers of the catalogue's noises begin.
const NOISE: &str = "noise_";

/// The candidates of all effects that the case defines.
///
/// # Errors
/// An id of the catalogue's, a formula that has no value in some rows.
pub fn of_case(inputs: &Inputs<'_>) -> Result<Vec<Candidate>, Error> {
    let effects = inputs.recording.case.effects.iter().enumerate();
    let of_all: Result<Vec<_>, Error> =
        effects.map(|(index, effect)| of_effect(index, effect, inputs)).collect();
    Ok(of_all?.into_iter().flatten().collect())
}

fn of_effect(index: usize, user: &UserEffect, inputs: &Inputs<'_>) -> Result<Vec<Candidate>, Error> {
    let [line_of_id, line_of_formula] = user.lines;
    let problem = |line: Option<usize>, field: &str, message: String| Error::Effect {
        line,
        field: format!("effect[{index}].{field}"),
        message,
    };
    if named(&user.id).is_some() || user.id == super::UNNAMED.id || user.id.starts_with(NOISE) {
        let found = format!("found \"{}\", an effect of the catalogue; expected a name of its own", user.id);
        return Err(problem(line_of_id, "id", found));
    }
    candidates(row(user), user, inputs)
        .map_err(|fault| problem(line_of_formula, "formula", said(&fault, user, inputs)))
}

fn said(fault: &Fault, user: &UserEffect, inputs: &Inputs<'_>) -> String {
    let time_s = fault.rows.and_then(|(first, _)| inputs.recording.time_s.get(first));
    let at = time_s.map(|time_s| format!(", at {time_s} s")).unwrap_or_default();
    format!("{fault}{at}; expected a number in every row of {}", user.formula.text())
}

/// The candidates of an effect at all places on which it acts; none where what it adds is nothing.
fn candidates(
    effect: &'static Effect,
    user: &UserEffect,
    inputs: &Inputs<'_>,
) -> Result<Vec<Candidate>, Fault> {
    let columns = columns(inputs);
    let names: Vec<String> = inputs.recording.in_formulas.iter().map(|it| it.column.clone()).collect();
    let acts_on = |place: &&Place| {
        let id = inputs.recording.sensors[place.sensor].sensor.id.as_str();
        let is_it = |name: &str| user.acts_on(name, place.group.as_deref(), place.kind);
        is_it(&place.name) || is_it(id)
    };
    // Where the input is known at some of the places, it acts on those.
    let has_input = |place: &&Place| !user.formula.has_input() || place.input.is_some();
    let all: Vec<&Place> = inputs.places.iter().filter(acts_on).collect();
    let known: Vec<&Place> = all.iter().copied().filter(|place| has_input(place)).collect();
    let mut candidates = Vec::new();
    for place in if known.is_empty() { all } else { known } {
        let input = place.input.as_ref().map(|input| map(input, |value| value / place.unit.in_si()).into());
        let values = Names { time_s: inputs.time_s.clone(), columns: columns.clone(), input };
        if let Some(draft) = draft(user, place, &names, values)? {
            candidates.push(draft.of(effect, Target::Sensor(place.sensor), place.port));
        }
    }
    Ok(candidates)
}

/// The columns in formulas, without holes; without those that have no value.
fn columns(inputs: &Inputs<'_>) -> Vec<(String, Series)> {
    let columns = inputs.recording.in_formulas.iter();
    columns.filter_map(|it| Some((it.column.clone(), bridged(&inputs.time_s, &it.values)?))).collect()
}

/// What a formula adds at a place: its values where each amplitude in turn is 1, in SI units.
struct Adds {
    formula: Formula,
    names: Names,
    free: Vec<String>,
    amplitudes: Vec<String>,
    sensor: usize,
    in_si: f64,
}

impl Adds {
    fn signature(&self, point: &[f64]) -> Result<Signature, Fault> {
        let parameters = || self.free.iter().map(String::as_str).zip(point.iter().copied());
        let column = |own: &String| {
            let amplitudes = self.amplitudes.iter().map(|name| (name.as_str(), f64::from(name == own)));
            let values: Vec<(&str, f64)> = parameters().chain(amplitudes).collect();
            let values = self.names.values(self.formula.root(), &values)?;
            Ok(Column::on(self.sensor, map(&values, |value| value * self.in_si)))
        };
        Ok(Signature { columns: self.amplitudes.iter().map(column).collect::<Result<_, _>>()? })
    }

    /// Nothing, which is what is added where the formula has no value between the points of the grid.
    fn nothing(&self) -> Signature {
        let zeros: Series = vec![0.0; self.names.time_s.len()].into();
        let columns = self.amplitudes.iter().map(|_| Column::on(self.sensor, zeros.clone())).collect();
        Signature { columns }
    }
}

/// The effect at a place, checked at every point of its grid; `columns` are the names of the columns, those that have no value among them.
fn draft(user: &UserEffect, place: &Place, columns: &[String], names: Names) -> Result<Option<Draft>, Fault> {
    let free: Vec<&str> = user.free.keys().map(String::as_str).collect();
    let scope = Scope { columns, free: &free };
    let amplitudes = (user.formula.amplitudes(&scope)).map_err(|mistake| Fault {
        at: mistake.at,
        what: mistake.message,
        rows: None,
    })?;
    let of_amplitude = |name: &&str| Amplitude {
        name: (*name).to_owned(),
        unit: user.unit.clone(),
        in_unit: 1.0,
        plausible: user.plausible,
    };
    let of_answer = amplitudes.iter().map(of_amplitude).collect();
    let adds = Adds {
        amplitudes: amplitudes.into_iter().map(str::to_owned).collect(),
        free: free.iter().map(|name| (*name).to_owned()).collect(),
        formula: user.formula.clone(),
        names,
        sensor: place.sensor,
        in_si: place.unit.in_si(),
    };
    let points = POINTS.get(user.free.len().saturating_sub(1)).copied().unwrap_or(POINTS[2]);
    let grids: Vec<Nonlinear> = (user.free.iter())
        .map(|(name, range)| Nonlinear { name: kept(name), unit: unit_of(name), grid: grid(*range, points) })
        .collect();
    let mut adds_something = false;
    for point in product(&grids) {
        let signature = adds.signature(&point)?;
        let parts = signature.columns.iter().flat_map(|column| &column.parts);
        adds_something |= parts.flat_map(|(_, values)| &**values).any(|value| *value != 0.0);
        if grids.is_empty() {
            return Ok(adds_something.then(|| Draft::new(Search::Linear(signature), of_answer)));
        }
    }
    let search = Search::Grid {
        parameters: grids,
        signature: Box::new(move |point| adds.signature(point).unwrap_or_else(|_| adds.nothing())),
        unit_amplitude: false,
    };
    Ok(adds_something.then(|| Draft::new(search, of_answer)))
}

/// Points of a range, both ends included.
fn grid([low, high]: [f64; 2], points: usize) -> Vec<f64> {
    let part = |k: usize| k as f64 / (points - 1) as f64;
    if low > 0.0 && high > DECADE * low {
        return (0..points).map(|k| low * (high / low).powf(part(k))).collect();
    }
    (0..points).map(|k| low + (high - low) * part(k)).collect()
}

/// All combinations of the points of grids.
fn product(grids: &[Nonlinear]) -> Vec<Vec<f64>> {
    grids.iter().fold(vec![Vec::new()], |points: Vec<Vec<f64>>, parameter| {
        let with = |point: &Vec<f64>| -> Vec<Vec<f64>> {
            parameter.grid.iter().map(|&value| point.iter().copied().chain([value]).collect()).collect()
        };
        points.iter().flat_map(with).collect()
    })
}

/// The unit of a parameter, as the end of its name says it.
fn unit_of(name: &str) -> &'static str {
    const ENDINGS: [(&str, &str); 6] =
        [("_s", "s"), ("_hz", "Hz"), ("_m", "m"), ("_rad", "rad"), ("_deg", "deg"), ("_K", "K")];
    ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)).map_or("", |(_, unit)| unit)
}

/// The row of an effect. Rows are constants everywhere else and live as long as the program; so do these, one for each distinct definition.
fn row(user: &UserEffect) -> &'static Effect {
    static ROWS: Mutex<BTreeMap<(&str, &str), &Effect>> = Mutex::new(BTreeMap::new());
    let (id, formula) = (kept(&user.id), kept(user.formula.text()));
    let mut rows = ROWS.lock().unwrap_or_else(PoisonError::into_inner);
    rows.entry((id, formula)).or_insert_with(|| {
        Box::leak(Box::new(Effect {
            id,
            formula,
            sentence: kept(&format!("shows {id}, {formula}")),
            needs: "what is in its formula varies",
            separated_by: "vary the quantities in its formula one at a time",
            source: "none: the case defines it",
            in_flight: HAS_NO_TERM,
            form: Form::Values,
            acts_on: any,
            candidates: again,
        }))
    })
}

/// The candidates of a row that was made of an effect of the case.
fn again(effect: &'static Effect, inputs: &Inputs<'_>) -> Vec<Candidate> {
    let users = inputs.recording.case.effects.iter();
    let own = users.filter(|user| user.id == effect.id && user.formula.text() == effect.formula);
    own.flat_map(|user| candidates(effect, user, inputs).unwrap_or_default()).collect()
}

/// A text that lives as long as the program, one for each distinct text.
fn kept(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeMap<String, &str>> = Mutex::new(BTreeMap::new());
    let mut texts = TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    texts.entry(text.to_owned()).or_insert_with(|| Box::leak(text.to_owned().into_boxed_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_more_than_a_decade_are_divided_by_their_logarithm() {
        let points = grid([10.0, 3600.0], 17);
        assert_eq!(points.len(), 17);
        assert!((points[0] - 10.0).abs() < 1e-9 && (points[16] - 3600.0).abs() < 1e-6);
        assert!((points[1] / points[0] - points[9] / points[8]).abs() < 1e-9);
        assert_eq!(grid([-1.0, 1.0], 3), [-1.0, 0.0, 1.0]);
        assert_eq!(grid([0.0, 8.0], 9)[3], 3.0);
    }

    #[test]
    fn a_row_is_made_once_for_each_definition() {
        let user = |id: &str, formula: &str| UserEffect {
            id: id.to_owned(),
            formula: Formula::parse(formula).unwrap(),
            acts_on: Vec::new(),
            unit: String::new(),
            plausible: None,
            free: BTreeMap::new(),
            lines: [None; 2],
        };
        let first = row(&user("torsion", "k * t"));
        assert!(std::ptr::eq(first, row(&user("torsion", "k * t"))));
        assert!(!std::ptr::eq(first, row(&user("torsion", "k * t^2"))));
    }
}
