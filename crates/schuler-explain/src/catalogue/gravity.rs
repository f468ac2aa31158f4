//! Errors of the gravity that a simulation assumes: an anomaly, and the tide of the solid Earth.
use super::draft::{Draft, ITSELF, Plausible, accelerometers, amplitude, at_each_place, instruments, number};
use super::form::Form;
use super::in_flight::OF_THE_PLACE;
use super::{Column, Effect, Port, Search, Signature};
use crate::catalogue::tide::upward_pull;
use crate::inputs::motion::along;
use crate::inputs::series::{map, varies};
use crate::inputs::{Inputs, Series};

/// An accelerometer that is level to this part of gravity does not show an anomaly.
const LEAST_VERTICAL: f64 = 0.05;
/// Least length of a record that shows the tide, s.
const TIDE_S: f64 = 6.0 * 3600.0;
/// Length that tells the two lines of a tidal band apart, s.
const BAND_S: f64 = 10.0 * 86_400.0;
/// Times between these are seconds of Unix time: 1985 to 2100.
const UNIX_TIME_S: [f64; 2] = [4.7e8, 4.1e9];
/// Principal lines of the tide by name, degrees per hour. [Melchior, The Tides of the Planet Earth]
const LINES: [(&str, f64); 4] = [("K1", 15.041_069), ("M2", 28.984_104), ("O1", 13.943_036), ("S2", 30.0)];

type Phase = fn(f64) -> f64;

pub(super) const GRAVITY_ANOMALY: Effect = Effect {
    id: "gravity_anomaly",
    formula: "−δg·(down)_i",
    sentence: "feels another gravity than its simulation assumes",
    needs: "accelerometers with a part along the vertical",
    separated_by: "turn the axis upside down: an error of gravity changes sign with it, a bias does not",
    source: "Groves, 2nd ed., ch. 2 (gravity models and their errors)",
    in_flight: OF_THE_PLACE,
    form: Form::Gravity,
    acts_on: accelerometers,
    candidates: |effect, inputs| {
        let Some(down) = &inputs.motion.down else { return Vec::new() };
        let mut candidates = Vec::new();
        for instrument in instruments(effect, inputs, |place| place.input.is_some()) {
            let parts: Vec<(usize, Vec<f64>)> = (instrument.places.iter())
                .map(|place| (place, map(&along(&place.axes.input, down), |part| -part)))
                .filter(|(place, values)| !place.relative || varies(values))
                .map(|(place, values)| (place.sensor, values))
                .collect();
            let shown = parts.iter().any(|(_, values)| values.iter().any(|part| part.abs() > LEAST_VERTICAL));
            if shown {
                let signature = Signature { columns: vec![Column::of(parts)] };
                let draft = Draft::new(
                    Search::Linear(signature),
                    vec![number("coefficient", "mGal", 1e5, Some([10.0, 200.0]))],
                );
                candidates.push(draft.of(effect, instrument.target, Port::Output));
            }
        }
        candidates
    },
};

pub(super) const EARTH_TIDE: Effect = Effect {
    id: "earth_tide",
    formula: "k·(pull of Moon and Sun)_i; without UTC and longitude its lines a cos ωt + b sin ωt",
    sentence: "feels the tide of the solid Earth",
    needs: "days",
    separated_by: "a record of two weeks: the tide's lines are not at whole days, those of temperature are",
    source: "Longman, J. Geophysical Research 64 (1959) 2351",
    in_flight: OF_THE_PLACE,
    form: Form::Values,
    acts_on: accelerometers,
    candidates: |effect, inputs| {
        if inputs.duration_s() < TIDE_S {
            return Vec::new();
        }
        let Some(down) = &inputs.motion.down else { return Vec::new() };
        let pull = pull(inputs);
        at_each_place(effect, inputs, |place| {
            let vertical = along(&place.axes.input, down);
            if place.input.is_none() || vertical.iter().all(|part| part.abs() < LEAST_VERTICAL) {
                return Vec::new();
            }
            // What pulls up makes the specific force, which points up, smaller.
            let along_axis = |pull: &[f64]| -> Vec<f64> {
                pull.iter().zip(&vertical).map(|(pull, vertical)| pull * vertical).collect()
            };
            if let Some(pull) = &pull {
                let factor = number("coefficient", "1", 1.0, Some([1.0, 1.3]));
                return vec![Draft::linear(place, along_axis(pull), factor)];
            }
            let lines = if inputs.duration_s() < BAND_S { 2 } else { LINES.len() };
            let columns = LINES.iter().take(lines).flat_map(|&(name, degrees_per_hour)| {
                let rate = degrees_per_hour.to_radians() / 3600.0;
                let waves: [(&str, Phase); 2] = [("a", f64::cos), ("b", f64::sin)];
                let along_axis = &along_axis;
                waves.map(|(part, phase)| {
                    let wave = map(&inputs.time_s, |t| phase(rate * t));
                    let plausible = Plausible::accelerometer([0.005, 0.2]);
                    (along_axis(&wave), amplitude(place, &format!("{part}_{name}"), ITSELF, plausible))
                })
            });
            vec![Draft::columns(place, columns.collect())]
        })
    },
};

/// Upward pull of Moon and Sun on a rigid Earth, m/s², where time is Unix time and the site has a longitude.
fn pull(inputs: &Inputs<'_>) -> Option<Series> {
    let site = inputs.recording.case.site?;
    let longitude = site.longitude_deg?.to_radians();
    let times_s = &inputs.recording.time_s;
    let [first, last] = [*times_s.first()?, *times_s.last()?];
    if first < UNIX_TIME_S[0] || last > UNIX_TIME_S[1] {
        return None;
    }
    let latitude = site.latitude_deg.to_radians();
    Some(times_s.iter().map(|&utc_s| upward_pull(utc_s, latitude, longitude, site.altitude_m)).collect())
}
