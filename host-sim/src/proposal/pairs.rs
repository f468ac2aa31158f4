//! Columns of a simulation that belong to columns of a recording.
use schuler_recording::document::suggestion;

use super::column::{Guess, What, key};
use super::look::{Column, Look};

/// Beginnings and ends of names that say only which of the two tables it is.
const SIDES: [&str; 14] = [
    "simulated",
    "predicted",
    "measured",
    "reference",
    "desired",
    "recorded",
    "model",
    "truth",
    "real",
    "meas",
    "pred",
    "true",
    "sim",
    "ref",
];

/// A column of the recording and that of the simulation.
#[derive(Clone, Debug)]
pub struct Pair<'l> {
    /// Of the recording.
    pub real: &'l Column,
    /// Of the simulation.
    pub simulated: &'l Column,
    /// What both are: the recording's name counts, the simulation's where that says nothing.
    pub guess: Guess,
    /// Unit of the simulation, where it is another.
    pub simulated_unit: Option<String>,
}

/// What belongs together.
#[derive(Clone, Debug)]
pub struct Pairs<'l> {
    /// The pairs, in the order of the recording.
    pub pairs: Vec<Pair<'l>>,
    /// Columns of the recording without a simulated one.
    pub only_real: Vec<&'l Column>,
    /// Columns of the simulation without a recorded one.
    pub only_simulated: Vec<&'l Column>,
}

/// Matches the columns of `sim` with those of `real`: as `map` says, pairs of a name in the simulation and one in the recording, else by their
/// names without units and without what says which table it is.
///
/// # Errors
/// A name in `map` that is in neither table; no pair at all.
pub fn pairs<'l>(sim: &'l Look, real: &'l Look, map: &[(String, String)]) -> Result<Pairs<'l>, String> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    for (simulated, recorded) in map {
        found.push((place(sim, simulated)?, place(real, recorded)?));
    }
    for (at, column) in real.columns.iter().enumerate() {
        let free = |it: &usize| found.iter().all(|(simulated, _)| simulated != it);
        if found.iter().any(|&(_, recorded)| recorded == at) {
            continue;
        }
        let same = |name: fn(&str) -> String| {
            (0..sim.columns.len()).filter(free).find(|&it| name(&sim.columns[it].name) == name(&column.name))
        };
        if let Some(simulated) = same(key).or_else(|| same(without_side)) {
            found.push((simulated, at));
        }
    }
    if found.is_empty() {
        return Err(nothing(sim, real));
    }
    found.sort_by_key(|&(_, recorded)| recorded);
    let only = |look: &'l Look, taken: &dyn Fn(usize) -> bool| -> Vec<&'l Column> {
        look.columns.iter().enumerate().filter(|(at, _)| !taken(*at)).map(|(_, column)| column).collect()
    };
    Ok(Pairs {
        pairs: found.iter().map(|&(s, r)| pair(&sim.columns[s], &real.columns[r])).collect(),
        only_real: only(real, &|at| found.iter().any(|&(_, recorded)| recorded == at)),
        only_simulated: only(sim, &|at| found.iter().any(|&(simulated, _)| simulated == at)),
    })
}

fn pair<'l>(simulated: &'l Column, real: &'l Column) -> Pair<'l> {
    let (own, other) = (&real.guess, &simulated.guess);
    let inertial = |what: What| matches!(what, What::Gyro(_) | What::Accelerometer(_));
    let what = if inertial(own.what) || !inertial(other.what) { own.what } else { other.what };
    let named = |guess: &Guess| guess.unit.clone().filter(|_| guess.unit_is_named);
    let unit = named(own).or_else(|| own.unit.clone()).or_else(|| named(other));
    let unit_is_named = own.unit_is_named || (own.unit.is_none() && other.unit_is_named);
    // Of sensors with a kind of their own units are converted.
    let simulated_unit = other.unit.clone().filter(|other| inertial(what) && Some(other) != unit.as_ref());
    Pair { real, simulated, guess: Guess { what, unit, unit_is_named }, simulated_unit }
}

fn place(look: &Look, name: &str) -> Result<usize, String> {
    if let Some(place) = look.columns.iter().position(|column| column.name == name) {
        return Ok(place);
    }
    let names = || look.columns.iter().map(|column| column.name.as_str());
    let meant =
        suggestion(name, names()).map(|meant| format!("; did you mean \"{meant}\"?")).unwrap_or_default();
    let names = names().collect::<Vec<_>>().join(", ");
    Err(format!("found \"{name}\"; expected a column of {}: {names}{meant}", look.path.display()))
}

/// The key of a name without what says which table it is.
fn without_side(name: &str) -> String {
    let mut key = key(name);
    for side in SIDES {
        let rest = key.strip_prefix(side).or_else(|| key.strip_suffix(side)).filter(|rest| !rest.is_empty());
        if let Some(rest) = rest {
            key = rest.to_owned();
        }
    }
    key
}

fn nothing(sim: &Look, real: &Look) -> String {
    let names = |look: &Look| look.columns.iter().map(|it| it.name.as_str()).collect::<Vec<_>>().join(", ");
    let example = sim.columns.first().zip(real.columns.first());
    let example = example.map(|(s, r)| format!(", e.g. --map {}={}", s.name, r.name)).unwrap_or_default();
    format!(
        "no column of the simulation is called as one of the recording: {} has {}; {} has {}; say which belong \
         together with --map SIMULATED=RECORDED{example}",
        sim.path.display(),
        names(sim),
        real.path.display(),
        names(real)
    )
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use schuler_recording::case::TimeUnit;

    use super::super::column::guess;
    use super::*;

    fn look(names: &[&str]) -> Look {
        let column = |name: &&str| Column {
            name: (*name).to_owned(),
            guess: guess(name, &[0.1, 0.2]),
            values: vec![0.1, 0.2],
        };
        Look {
            path: PathBuf::from("x.csv"),
            time: Some("t".to_owned()),
            time_unit: TimeUnit::Second,
            why_unit: None,
            span_s: [0.0, 1.0],
            step_s: 1.0,
            rows: 2,
            columns: names.iter().map(column).collect(),
            left_out: Vec::new(),
            repeats: false,
        }
    }

    fn named(pairs: &Pairs<'_>) -> Vec<(String, String)> {
        pairs.pairs.iter().map(|it| (it.simulated.name.clone(), it.real.name.clone())).collect()
    }

    #[test]
    fn columns_meet_by_name_unit_and_side_apart() {
        let sim = look(&["Gyro_X [rad/s]", "sim_torque", "altitude", "wind"]);
        let real = look(&["gyro_x (deg/s)", "torque_measured", "baro_height", "T"]);
        let map = [("altitude".to_owned(), "baro_height".to_owned())];
        let pairs = pairs(&sim, &real, &map).unwrap();
        let expected = [
            ("Gyro_X [rad/s]", "gyro_x (deg/s)"),
            ("sim_torque", "torque_measured"),
            ("altitude", "baro_height"),
        ];
        let expected = expected.map(|(s, r)| (s.to_owned(), r.to_owned()));
        assert_eq!(named(&pairs), expected);
        assert_eq!(pairs.pairs[0].simulated_unit.as_deref(), Some("rad/s"));
        assert_eq!((pairs.only_real[0].name.as_str(), pairs.only_simulated[0].name.as_str()), ("T", "wind"));
    }

    #[test]
    fn what_cannot_be_matched_is_said() {
        let (sim, real) = (look(&["y"]), look(&["altitude"]));
        let said = pairs(&sim, &real, &[]).unwrap_err();
        assert!(said.contains("--map y=altitude"), "{said}");
        let map = [("y".to_owned(), "altitud".to_owned())];
        let said = pairs(&sim, &real, &map).unwrap_err();
        assert!(said.contains("did you mean \"altitude\""), "{said}");
    }
}
