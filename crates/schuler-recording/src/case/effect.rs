//! The part of a case about effects of the user's own, as formulas.
use std::collections::BTreeMap;

use serde::Serialize;

use super::read::optional;
use super::{Case, MotionKind, PARTS_OF_THE_LOOP, SensorKind};
use crate::document::{Field, Node, suggestion};
use crate::formula::{Formula, INPUT, TIME};

/// Most parameters with a range: a grid over more has too many points.
const MOST_FREE: usize = 3;

/// An effect that the case defines, sought as those of the catalogue are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UserEffect {
    /// The name under which it is told.
    pub id: String,
    /// What it adds to the readings, in the unit of the sensor, of columns in the units that the case states for them, else as the
    /// table has them.
    pub formula: Formula,
    /// Ids, groups and kinds of the sensors on which it acts.
    pub acts_on: Vec<String>,
    /// Unit of its amplitudes.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// Plausible magnitude of an amplitude, smallest and largest, in `unit`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plausible: Option<[f64; 2]>,
    /// Parameters in which it is not linear, with the smallest and largest value of each.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub free: BTreeMap<String, [f64; 2]>,
    /// Lines of its id and its formula in the file, for messages.
    #[serde(skip)]
    pub lines: [Option<usize>; 2],
}

impl UserEffect {
    /// Whether it acts on a sensor with this id, group and kind.
    pub fn acts_on(&self, id: &str, group: Option<&str>, kind: SensorKind) -> bool {
        let kind = kind.to_string();
        let is_it = |name: &String| *name == id || Some(name.as_str()) == group || *name == kind;
        self.acts_on.iter().any(is_it)
    }
}

/// Reads an `[[effect]]`.
pub(super) fn effect(node: &Node<'_>) -> Option<UserEffect> {
    let id = node.required("id", "the name under which it is told").and_then(|field| field.text());
    let formula =
        node.required("formula", "e.g. \"k * lag(temp_x, tau_s)\"").and_then(|field| formula(&field));
    let acts_on = node
        .required("acts_on", "ids, groups or kinds of sensors, e.g. [\"gyro_x\"]")
        .and_then(|field| field.text_list());
    let unit = optional(node, "unit", Field::any_text);
    let plausible = optional(node, "plausible", |field| range(field, 0.0));
    let free = optional(node, "free", |field| field.entries(|_, field| range(field, f64::MIN)));
    let effect = UserEffect {
        id: id?,
        formula: formula?,
        acts_on: acts_on?,
        unit: unit?.unwrap_or_default(),
        plausible: plausible?,
        free: free?.unwrap_or_default().into_iter().collect(),
        lines: ["id", "formula"].map(|key| node.line_of(key)),
    };
    agrees_with_itself(node, effect)
}

fn formula(field: &Field<'_>) -> Option<Formula> {
    let text = field.text()?;
    match Formula::parse(&text) {
        Ok(formula) => Some(formula),
        Err(mistake) => field.problem(mistake.to_string()),
    }
}

/// Two numbers, the first not below `least` and the second above the first.
fn range(field: &Field<'_>, least: f64) -> Option<[f64; 2]> {
    let [low, high] = field.numbers()?;
    if low >= least && high > low {
        return Some([low, high]);
    }
    let of = if least == 0.0 { " of magnitudes" } else { "" };
    field.problem(format!("found [{low}, {high}]; expected the smallest and the largest value{of}"))
}

fn agrees_with_itself(node: &Node<'_>, effect: UserEffect) -> Option<UserEffect> {
    if effect.acts_on.is_empty() {
        return node.problem_at("acts_on", "found none; expected at least one id, group or kind of a sensor");
    }
    if effect.free.len() > MOST_FREE {
        let found = format!("found {} parameters; expected {MOST_FREE} at most", effect.free.len());
        return node.problem_at("free", &found);
    }
    let names = effect.formula.names();
    for name in effect.free.keys() {
        let path = format!("free.{name}");
        if name == INPUT || name == TIME {
            return node
                .problem_at(&path, "found u or t, the sensor's input and the time; expected another name");
        }
        if !names.iter().any(|(used, ..)| used == name) {
            let hint = suggestion(name, names.iter().map(|(name, ..)| *name));
            let hint = hint.map(|meant| format!("; did you mean {meant}?")).unwrap_or_default();
            let message = format!("found a name that is not in the formula; expected one that is{hint}");
            return node.problem_at(&path, &message);
        }
    }
    Some(effect)
}

/// Whether effects have names of their own and act on sensors of the case.
pub(super) fn fit_the_case(node: &Node<'_>, case: &Case) -> Option<()> {
    let is_loop = case.motion.kind == MotionKind::VelocityError;
    let parts = || is_loop.then_some(PARTS_OF_THE_LOOP).into_iter().flatten().copied();
    let kinds: Vec<String> = case.sensors.iter().map(|sensor| sensor.kind.to_string()).collect();
    let places = || {
        let of_sensors =
            case.sensors.iter().flat_map(|it| [Some(it.id.as_str()), it.group.as_deref()]).flatten();
        of_sensors.chain(kinds.iter().map(String::as_str)).chain(parts())
    };
    for (index, effect) in case.effects.iter().enumerate() {
        if let Some(first) = case.effects.iter().take(index).position(|other| other.id == effect.id) {
            let found = format!("found \"{}\", the id of effect[{first}]; expected a unique id", effect.id);
            return node.problem_at(&format!("effect[{index}].id"), &found);
        }
        for (place, name) in effect.acts_on.iter().enumerate() {
            if !places().any(|known| known == name) {
                let hint = suggestion(name, places());
                let hint = hint.map(|meant| format!("; did you mean \"{meant}\"?")).unwrap_or_default();
                let found =
                    format!("found \"{name}\"; expected the id, group or kind of a sensor of the case{hint}");
                return node.problem_at(&format!("effect[{index}].acts_on[{place}]"), &found);
            }
        }
    }
    Some(())
}
