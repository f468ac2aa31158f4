//! What is simply wrong in a case, and the noise of its reference: no errors of the sensors.
//!
//! Readings of a flipped sign, of another axis or in another unit differ from what is expected by something that is known whole,
//! without an amplitude; an effect of a sensor that mimics it (a scale factor of −90 %) has one. The reference is a sensor as well: its
//! noise stands in what is left of the readings with its sign turned.
use nalgebra::{Matrix3, Vector3};
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY};

use super::draft::{Draft, Instrument, any, inertial, instruments, number};
use super::form::Form;
use super::in_flight::HAS_NO_TERM;
use super::input::varying;
use super::{Candidate, Column, Effect, Nonlinear, Port, Search, Signature, Target};
use crate::inputs::series::{Series, map, rms};
use crate::inputs::{Inputs, Place};
use crate::numeric::statistics::median;

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
/// Factor from which on readings are in another unit rather than badly scaled, and how near two factors are the same.
const FAR: f64 = 2.0;
const NEARLY: f64 = 0.05;
/// Part of the input that the factor leaves of the readings at most.
const MOST_LEFT: f64 = 0.2;
/// Sensors of an instrument that may have axes for each other.
const AXES: usize = 3;
/// A series smoothed over so many rows on either side.
type Smooth = fn(&[f64], usize) -> Vec<f64>;
/// Fewest rows on either side through which a curve of the fourth order does not go.
const FEWEST_OF_CURVE: usize = 4;
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
            let mistaken = |instrument: &Instrument<'_>, factor: f64, name: String| {
                let off =
                    |place: &&Place| Some((place.sensor, map(place.input.as_ref()?, |u| (factor - 1.0) * u)));
                let parts = instrument.places.iter().filter_map(off);
                let mut mistaken = whole(effect, instrument, parts, Some(("mistaken", name)));
                mistaken.variant.extend(part_of_group(inputs, instrument));
                Candidate { noise_factor: factor, ..mistaken }
            };
            found.extend(factors.map(|(factor, name)| mistaken(&instrument, factor, name.to_owned())));
            // Whoever takes counts for a unit has a factor that is in no list: that of the readings themselves.
            let is_listed =
                |factor: f64| factors.iter().any(|(known, _)| (factor / known - 1.0).abs() < NEARLY);
            let of_places: Vec<Option<f64>> =
                instrument.places.iter().map(|it| factor_of(inputs, it)).collect();
            let common =
                of_places.iter().flatten().copied().reduce(|a, b| if a.abs() < b.abs() { a } else { b });
            let is_common = |factor: &Option<f64>| {
                factor.zip(common).is_some_and(|(factor, common)| (factor / common - 1.0).abs() < NEARLY)
            };
            let counts = |instrument: &Instrument<'_>, factor: f64| {
                let unit = instrument.places[0].unit.name();
                mistaken(
                    instrument,
                    factor,
                    format!("{} counts or other units for one {unit}", digits(factor)),
                )
            };
            if let Some(factor) =
                common.filter(|factor| of_places.iter().all(is_common) && !is_listed(*factor))
            {
                found.push(counts(&instrument, factor));
            } else {
                for (of, factor) in instrument.places.iter().zip(&of_places) {
                    let alone = Instrument { target: Target::Sensor(of.sensor), places: vec![*of] };
                    found.extend(factor.filter(|factor| !is_listed(*factor)).map(|it| counts(&alone, it)));
                }
            }
        }
        found
    },
};

/// The factor by which the readings are their input, where it is far from one and describes nearly all of them.
fn factor_of(inputs: &Inputs<'_>, of: &Place) -> Option<f64> {
    // At rest a constant error of a gyro is a multiple of the Earth's rate as well.
    let is_told = of.dimension() == Dimension::Acceleration || varying(of).is_some();
    let readings = &inputs.recording.sensors.get(of.sensor).filter(|_| is_told)?.values;
    let input = of.input.as_ref().filter(|_| !of.is_estimated && !of.relative)?;
    let pairs = || readings.iter().zip(input.iter()).filter(|(reading, _)| reading.is_finite());
    // Where the input is large its noise is not, and a few readings far from the others do not count.
    let least = rms(input);
    let mut ratios: Vec<f64> =
        pairs().filter(|(_, u)| u.abs() >= least && least > 0.0).map(|(reading, u)| reading / u).collect();
    let factor = median(&mut ratios);
    let mut left: Vec<f64> = pairs().map(|(reading, u)| (reading - factor * u).abs()).collect();
    let is_far = factor.is_finite() && !(1.0 / FAR..=FAR).contains(&factor.abs());
    (is_far && median(&mut left) < MOST_LEFT * factor.abs() * least).then_some(factor)
}

/// Which sensors of a group an instrument is, where it is not all of them.
fn part_of_group(inputs: &Inputs<'_>, instrument: &Instrument<'_>) -> Option<(&'static str, String)> {
    let Target::Group { name, sensors } = &instrument.target else { return None };
    let is_other = |it: &Place| it.group.as_ref() == Some(name) && !sensors.contains(&it.sensor);
    let names: Vec<&str> = instrument.places.iter().map(|it| it.name.as_str()).collect();
    inputs.places.iter().any(is_other).then(|| ("sensors", names.join(", ")))
}

/// A number to four digits.
fn digits(value: f64) -> String {
    let size = value.abs();
    let decimals = (3.0 - size.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{size:.decimals$}")
}

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
            // Of noise, which stands about a curve, and of what a mean smooths away of the motion itself.
            for (smooth, least) in [(fourth_order as Smooth, FEWEST_OF_CURVE), (smoothed as Smooth, 1)] {
                let steps = SMOOTHED_STEPS.iter().filter(|&&steps| steps >= least);
                let grid: Vec<f64> = steps.map(|&steps| steps as f64 * step_s).collect();
                let parameter = Nonlinear { name: "smoothed_s", unit: "s", grid };
                let input = input.clone();
                let about_mean = move |smoothed_s: f64| {
                    let mean = smooth(&input, ((smoothed_s / step_s).round() as usize).max(least));
                    mean.iter().zip(input.iter()).map(|(mean, u)| mean - u).collect()
                };
                let draft = Draft::grid(place, parameter, part(), about_mean);
                found.push(draft.of(effect, Target::Sensor(place.sensor), place.port));
            }
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

/// Curves of the fourth order fitted to `steps` rows before and after each row, which leave a motion as it is where it is slow beside them
/// (Savitzky and Golay 1964); the values themselves where there are fewer.
fn fourth_order(values: &[f64], steps: usize) -> Vec<f64> {
    let points = || (0..=2 * steps).map(|row| (row as f64 - steps as f64) / steps.max(1) as f64);
    let powers = |at: f64| Vector3::new(1.0, at.powi(2), at.powi(4));
    let moments: Matrix3<f64> = points().map(|at| powers(at) * powers(at).transpose()).sum();
    let Some(inverse) = moments.try_inverse() else { return values.to_vec() };
    let of_middle = inverse * Vector3::x();
    let weights: Vec<f64> = points().map(|at| of_middle.dot(&powers(at))).collect();
    let mut curve = values.to_vec();
    for (value, around) in curve.iter_mut().skip(steps).zip(values.windows(weights.len())) {
        *value = weights.iter().zip(around).map(|(weight, value)| weight * value).sum();
    }
    curve
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
    fn a_curve_of_the_fourth_order_goes_through_a_slow_motion_and_not_through_noise() {
        let slow: Vec<f64> = (0..200).map(|row| (0.1 * f64::from(row)).sin()).collect();
        let off = |steps: usize, values: &[f64]| {
            let of_rows = fourth_order(values, steps).into_iter().zip(values).map(|(a, b)| (a - b).abs());
            of_rows.collect::<Vec<f64>>()[steps..200 - steps].iter().fold(0.0_f64, |most, it| it.max(most))
        };
        assert!(off(4, &slow) < 1e-6 && off(8, &slow) < 1e-4, "{} {}", off(4, &slow), off(8, &slow));
        let alternating: Vec<f64> = (0..200).map(|row| if row % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(off(8, &alternating) > 0.8);
    }

    #[test]
    fn the_mean_of_a_line_is_the_line() {
        let line: Vec<f64> = (0..20).map(f64::from).collect();
        let mean = smoothed(&line, 3);
        assert!((3..17).all(|row| (mean[row] - line[row]).abs() < 1e-12));
    }
}
