//! What is simply wrong in a case, and the noise of its reference: no errors of the sensors.
//!
//! Readings of a flipped sign, of another axis or in another unit differ from what is expected by something that is known whole,
//! without an amplitude; an effect of a sensor that mimics it (a scale factor of −90 %) has one. The reference is a sensor as well: its
//! noise stands in what is left of the readings with its sign turned.
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY};

use super::draft::{Draft, Instrument, any, inertial, instruments, number};
use super::form::Form;
use super::in_flight::HAS_NO_TERM;
use super::input::varying;
use super::{Candidate, Column, Effect, Nonlinear, Port, Search, Signature, Target};
use crate::inputs::series::{Series, map};
use crate::inputs::{Inputs, Place};

/// Factors by which readings in a unit that is not the stated one are off, with what was mistaken for what.
const MISTAKEN_RATES: [(f64, &str); 4] = [
    (std::f64::consts::PI / 180.0, "rad for deg (or a reference in deg for rad)"),
    (180.0 / std::f64::consts::PI, "deg for rad (or a reference in rad for deg)"),
    (1.0 / 3600.0, "deg/s for deg/h"),
    (3600.0, "deg/h for deg/s"),
];
const MISTAKEN_ACCELERATIONS: [(f64, &str); 4] = [
    (1.0 / STANDARD_GRAVITY, "g for m/s^2"),
    (STANDARD_GRAVITY, "m/s^2 for g"),
    (1e3, "mg for g"),
    (1e-3, "g for mg"),
];
const MISTAKEN_VELOCITIES: [(f64, &str); 4] = [
    (3.6, "km/h for m/s"),
    (1.0 / 3.6, "m/s for km/h"),
    (1.0 / 0.514_444, "knots for m/s"),
    (0.514_444, "m/s for knots"),
];
/// Sensors of an instrument that may have axes for each other.
const AXES: usize = 3;
/// Widths, in steps, of the mean about which a reference's noise is seen.
const SMOOTHED_STEPS: [usize; 5] = [2, 4, 8, 16, 32];

pub(super) const SIGN_FLIPPED: Effect = Effect {
    id: "sign_flipped",
    formula: "−2u",
    sentence: "reads with the other sign (body axes are forward, right, down)",
    needs: "an input",
    separated_by: "turn the sensor by hand",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Proportional,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut found: Vec<Candidate> = Vec::new();
        for instrument in of_one_kind(effect, inputs, is_moved) {
            let flipped = |place: &&Place| Some((place.sensor, map(place.input.as_ref()?, |u| -2.0 * u)));
            if instrument.places.len() > 1 {
                found.push(whole(effect, &instrument, instrument.places.iter().filter_map(flipped), None));
            }
            for place in &instrument.places {
                let alone = Instrument { target: Target::Sensor(place.sensor), places: vec![*place] };
                found.push(whole(effect, &alone, flipped(place), None));
            }
        }
        found
    },
};

pub(super) const AXES_SWAPPED: Effect = Effect {
    id: "axes_swapped",
    formula: "u_j − u_i in i, u_i − u_j in j",
    sentence: "has two axes for each other (body axes are forward, right, down)",
    needs: "input on two axes",
    separated_by: "turn the instrument by hand about one axis after the other",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut found = Vec::new();
        for instrument in of_one_kind(effect, inputs, |place| place.input.is_some()) {
            let places = &instrument.places;
            if places.len() > AXES {
                continue;
            }
            for (first, second) in (0..places.len()).flat_map(|i| (i + 1..places.len()).map(move |j| (i, j)))
            {
                let (a, b) = (places[first], places[second]);
                let (Some(of_a), Some(of_b)) = (&a.input, &b.input) else { continue };
                let difference: Vec<f64> = of_b.iter().zip(of_a.iter()).map(|(b, a)| b - a).collect();
                if difference.iter().all(|value| *value == 0.0) {
                    continue;
                }
                let turned = map(&difference, |value| -value);
                let swapped = [(a.sensor, Series::from(difference)), (b.sensor, turned.into())];
                let names = format!("{} and {}", a.name, b.name);
                // North, east, down and east, north, up differ in the sign of the third as well.
                let third = (places.len() == AXES).then(|| places[AXES - first - second]);
                if let Some((third, u)) = third.and_then(|third| Some((third, third.input.as_ref()?))) {
                    let flipped = (third.sensor, map(u, |u| -2.0 * u).into());
                    let all = swapped.iter().cloned().chain([flipped]);
                    let name = format!("{names}, {} of the other sign", third.name);
                    found.push(whole(effect, &instrument, all, Some(("axes", name))));
                }
                found.push(whole(effect, &instrument, swapped, Some(("axes", names))));
            }
        }
        found
    },
};

pub(super) const UNIT_MISTAKEN: Effect = Effect {
    id: "unit_mistaken",
    formula: "(c − 1)·u",
    sentence: "reads in another unit than stated",
    needs: "an input",
    separated_by: "the data sheet",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Proportional,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut found = Vec::new();
        for instrument in of_one_kind(effect, inputs, is_moved) {
            let factors = match instrument.places[0].dimension() {
                Dimension::AngularRate => MISTAKEN_RATES,
                Dimension::Acceleration => MISTAKEN_ACCELERATIONS,
                Dimension::Velocity => MISTAKEN_VELOCITIES,
                // Of a unit in free text nobody knows what it is mistaken for.
                Dimension::Other => continue,
            };
            for (factor, name) in factors {
                let off =
                    |place: &&Place| Some((place.sensor, map(place.input.as_ref()?, |u| (factor - 1.0) * u)));
                let parts = instrument.places.iter().filter_map(off);
                let mistaken = whole(effect, &instrument, parts, Some(("mistaken", name.to_owned())));
                found.push(Candidate { noise_factor: factor, ..mistaken });
            }
        }
        found
    },
};

pub(super) const GRAVITY_REMOVED: Effect = Effect {
    id: "gravity_removed",
    formula: "−u at rest",
    sentence: "reads without gravity, which was taken out of it",
    needs: "accelerometers at rest",
    separated_by: "tilt the instrument",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Proportional,
    acts_on: inertial,
    candidates: |effect, inputs| {
        if inputs.recording.case.motion.kind != MotionKind::Static {
            return Vec::new();
        }
        let has = |place: &Place| is_moved(place) && place.kind == SensorKind::Accelerometer;
        let of = |instrument: Instrument<'_>| {
            let none = |place: &&Place| Some((place.sensor, map(place.input.as_ref()?, |u| -u)));
            whole(effect, &instrument, instrument.places.iter().filter_map(none), None)
        };
        of_one_kind(effect, inputs, has).into_iter().map(of).collect()
    },
};

pub(super) const REFERENCE_NOISE: Effect = Effect {
    id: "reference_noise",
    formula: "−k·(u − ū), ū the mean of u over some steps",
    sentence: "differs from its reference at high frequencies: by noise in the reference where the part is above zero, by what \
               the reference smooths away where it is below",
    needs: "a recorded motion",
    separated_by: "a reference of less noise, or one that is smoothed",
    source: "Fuller, Measurement Error Models (1987)",
    in_flight: HAS_NO_TERM,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut found = Vec::new();
        for place in inputs.places.iter().filter(|place| is_recorded(inputs, place)) {
            let Some(input) = place.input.clone() else { continue };
            let step_s = inputs.recording.step_s;
            let grid: Vec<f64> = SMOOTHED_STEPS.iter().map(|&steps| steps as f64 * step_s).collect();
            let parameter = Nonlinear { name: "smoothed_s", unit: "s", grid };
            let about_mean = move |smoothed_s: f64| {
                let mean = smoothed(&input, (smoothed_s / step_s).round().max(1.0) as usize);
                mean.iter().zip(input.iter()).map(|(mean, u)| mean - u).collect()
            };
            let draft = Draft::grid(place, parameter, part(), about_mean);
            found.push(draft.of(effect, Target::Sensor(place.sensor), place.port));
        }
        found
    },
};

/// Whether a place has an input that is not zero all the time.
fn is_moved(place: &Place) -> bool {
    place.input.as_ref().is_some_and(|input| input.iter().any(|u| u.abs() > 0.0))
}

/// Whether the input of a place was recorded by something that is a sensor itself.
fn is_recorded(inputs: &Inputs<'_>, place: &Place) -> bool {
    let is_recorded = inputs.recording.case.motion.kind == MotionKind::Recorded;
    is_recorded && !inputs.motion.estimated && place.port == Port::Output && varying(place).is_some()
}

/// Instruments, each with its sensors of one dimension.
fn of_one_kind<'i>(
    effect: &'static Effect,
    inputs: &'i Inputs<'_>,
    has: impl Fn(&Place) -> bool,
) -> Vec<Instrument<'i>> {
    if inputs.is_loop() || inputs.motion.estimated {
        return Vec::new();
    }
    instruments(effect, inputs, has).iter().flat_map(Instrument::by_dimension).collect()
}

/// How much of a signature is there.
fn part() -> super::Amplitude {
    number("part", "1", 1.0, None)
}

/// A candidate that is there as it is or not at all.
fn whole<S: Into<Series>>(
    effect: &'static Effect,
    instrument: &Instrument<'_>,
    parts: impl IntoIterator<Item = (usize, S)>,
    variant: Option<(&'static str, String)>,
) -> Candidate {
    let parts = parts.into_iter().map(|(sensor, values)| (sensor, values.into()));
    let column = Column::of(parts.collect::<Vec<(usize, Series)>>());
    let signature = move |_: &[f64]| Signature { columns: vec![column.clone()] };
    let search =
        Search::Grid { parameters: Vec::new(), signature: Box::new(signature), unit_amplitude: true };
    Candidate {
        effect,
        target: instrument.target.clone(),
        port: Port::Output,
        variant: variant.into_iter().collect(),
        search,
        amplitudes: vec![part()],
        noise_factor: 1.0,
    }
}

/// Means over `steps` before and after each row.
fn smoothed(values: &[f64], steps: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + if value.is_finite() { *value } else { 0.0 });
    }
    let mean = |row: usize| {
        let (from, to) = (row.saturating_sub(steps), (row + steps + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..values.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_a_line_is_the_line() {
        let line: Vec<f64> = (0..20).map(f64::from).collect();
        let mean = smoothed(&line, 3);
        assert!((3..17).all(|row| (mean[row] - line[row]).abs() < 1e-12));
    }
}
