//! Errors that follow the sensor's own input: scale factor and its non-linearity, misalignment, cross coupling.
use nalgebra::Vector3;
use schuler_recording::unit::Dimension;

use super::draft::{
    Draft, G_CUBED, G_SQUARED, Instrument, Plausible, RADIAN_IN_ARCSECONDS, RATE_CUBED, RATE_SQUARED,
    VELOCITY_CUBED, VELOCITY_SQUARED, accelerometers, any, arcseconds, at_each_place, coefficient,
    instruments, logarithmic, number, ppm, seen, to_the,
};
use super::form::Form;
use super::in_flight::{IS_A_FAILURE, InFlight, Part};
use super::{Column, Effect, Nonlinear, Search, Signature, Target};
use crate::inputs::series::{both_signs, map, product, varies};
use crate::inputs::{Inputs, Place, Series};

/// A dead zone is searched from one that so many readings are in to a little more than the largest input: one that nothing passes
/// looks like a scale factor of −1 otherwise.
const DEAD_ZONE_READINGS: usize = 3;
const DEAD_ZONE_BEYOND: f64 = 1.001;
/// Thresholds between which a part of the readings lies: an input that stays near some values makes a threshold that is a little
/// off them silence what passes, or pass what is silent.
const DEAD_ZONE_PARTS: usize = 40;

/// A limit is passed by so many readings at least, and by that part of them at most; and how many limits are tried for each tenfold
/// of the readings that pass.
const FEWEST_PASSED: f64 = 1.0;
const CLIPPED_PART: f64 = 0.9;
const LIMITS_PER_DECADE: f64 = 6.0;

const IEEE_1293: &str =
    "IEEE Std 1293 (model equation of accelerometers), IEEE Std 836 (centrifuge), IEEE Std 1559 (systems)";

pub(super) const SCALE_FACTOR: Effect = Effect {
    id: "scale_factor",
    formula: "k·u",
    sentence: "has another scale factor",
    needs: "input varies",
    separated_by: "rates or positions of several sizes and both signs at constant temperature",
    source: "IEEE Std 528; IEEE Std 292 and 1293 for accelerometers",
    in_flight: InFlight::Term([Part::Input(1), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut candidates = at_each_place(effect, inputs, |place| {
            (varying(place).into_iter())
                .map(|input| Draft::linear(place, input.clone(), ppm(place, [10.0, 200.0])))
                .collect()
        });
        // One factor for all sensors of an instrument that measure the same: of a clock, of the speed of sound.
        let groups = instruments(effect, inputs, |place| varying(place).is_some());
        for Instrument { target, places } in groups.iter().flat_map(Instrument::by_dimension) {
            let [first, _, ..] = places.as_slice() else { continue };
            let parts = places.iter().filter_map(|place| Some((place.sensor, place.input.clone()?)));
            let search = Search::Linear(Signature { columns: vec![Column::of(parts)] });
            candidates.push(Draft::new(search, vec![ppm(first, [10.0, 2e4])]).of(effect, target, first.port));
        }
        candidates
    },
};

pub(super) const SCALE_FACTOR_ASYMMETRY: Effect = Effect {
    id: "scale_factor_asymmetry",
    formula: "k·|u|",
    sentence: "has different scale factors for inputs of either sign",
    needs: "input of both signs",
    separated_by: "equal and opposite rates or positions",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::InputMagnitude, Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        of_input(effect, inputs, both_signs, |place, input| (map(input, f64::abs), ppm(place, [5.0, 50.0])))
    },
};

pub(super) const SCALE_FACTOR_QUADRATIC: Effect = Effect {
    id: "scale_factor_quadratic",
    formula: "k·u²",
    sentence: "has an error with the square of its input",
    needs: "amplitude of the input varies",
    separated_by: "centrifuge or rates at several sizes; vibration along the axis shows it as a constant",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::Input(2), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        of_input(effect, inputs, amplitude_varies, |place, input| {
            let plausible = Plausible::accelerometer([1.0, 20.0]);
            (map(input, |u| u * u), of_power(place, 2, plausible))
        })
    },
};

pub(super) const SCALE_FACTOR_CUBIC: Effect = Effect {
    id: "scale_factor_cubic",
    formula: "k·u³",
    sentence: "has an error with the cube of its input",
    needs: "large amplitude of the input",
    separated_by: "centrifuge or rates at several sizes and both signs",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::Input(3), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        of_input(effect, inputs, amplitude_varies, |place, input| {
            (map(input, |u| u * u * u), of_power(place, 3, Plausible::accelerometer([0.1, 10.0])))
        })
    },
};

pub(super) const SCALE_FACTOR_ODD_QUADRATIC: Effect = Effect {
    id: "scale_factor_odd_quadratic",
    formula: "k·u·|u|",
    sentence: "has an error with the square of its input that takes the input's sign",
    needs: "amplitude of the input varies, both signs",
    separated_by: "centrifuge or rates at several sizes and both signs",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::Input(1), Part::InputMagnitude]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        let has = |input: &[f64]| amplitude_varies(input) && both_signs(input);
        of_input(effect, inputs, has, |place, input| {
            let plausible = Plausible::accelerometer([1.0, 20.0]);
            (map(input, |u| u * u.abs()), of_power(place, 2, plausible))
        })
    },
};

pub(super) const MISALIGNMENT: Effect = Effect {
    id: "misalignment",
    formula: "k_j·u_j, j across the axis",
    sentence: "is turned from its axis",
    needs: "rotation about all axes, or all faces up",
    separated_by: "rotate about each axis in turn, or put each face up",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::InputAcross, Part::One]),
    form: Form::Mounting,
    acts_on: any,
    candidates: |effect, inputs| {
        let mut candidates = at_each_place(effect, inputs, |place| {
            let across = place.axes.across().into_iter().filter_map(|(name, axis)| {
                place.input.as_ref()?;
                let input = inputs.input_along(place, &axis).filter(|input| varies(input))?;
                Some(Draft::linear(place, input, arcseconds(place, [5.0, 60.0])).with("axis", name))
            });
            across.collect()
        });
        for instrument in instruments(effect, inputs, |place| place.input.is_some()) {
            candidates.extend(mounting(effect, inputs, &instrument));
        }
        candidates
    },
};

pub(super) const CROSS_COUPLING: Effect = Effect {
    id: "cross_coupling",
    formula: "k·f_i·f_j",
    sentence: "has an error with the product of the forces along and across its axis",
    needs: "both forces vary",
    separated_by: "faces up at 45° about each axis",
    source: IEEE_1293,
    in_flight: InFlight::Term([Part::Input(1), Part::ForceAcross]),
    form: Form::Term,
    acts_on: accelerometers,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let Some(along) = place.input.as_ref() else { return Vec::new() };
            let across = place.axes.across().into_iter().filter_map(|(name, axis)| {
                let across = inputs.force_along(&axis)?;
                let values = product(along, &across);
                let amplitude = coefficient(place, G_SQUARED, Plausible::accelerometer([1.0, 30.0]));
                let shown = varies(along) && varies(&across) && varies(&values);
                shown.then(|| Draft::linear(place, values, amplitude).with("axis", name))
            });
            across.collect()
        })
    },
};

pub(super) const DEAD_ZONE: Effect = Effect {
    id: "dead_zone",
    formula: "0 for |u| < u₀",
    sentence: "does not answer to small inputs",
    needs: "input below the threshold",
    separated_by: "rates below and above the threshold, up and down",
    source: "IEEE Std 528, threshold and dead band",
    in_flight: IS_A_FAILURE,
    form: Form::DeadZone,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let Some(input) = varying(place).cloned() else { return Vec::new() };
            let grid = thresholds(&input);
            if grid.len() < 2 {
                return Vec::new();
            }
            let silent = move |threshold| map(&input, |u| if u.abs() < threshold { -u } else { 0.0 });
            vec![Draft::whole(place, of_input_value(place, "threshold", grid), silent)]
        })
    },
};

/// An input that is clipped at a limit on either side, at every place where it is known. Where the sensors themselves tell of the motion, what
/// one does not show is not there either.
pub(super) fn clipped_inputs(effect: &'static Effect, inputs: &Inputs<'_>) -> Vec<super::Candidate> {
    at_each_place(effect, inputs, |place| {
        let known = varying(place).filter(|_| !place.is_estimated).cloned();
        let Some(input) = known else { return Vec::new() };
        let mut grid = limits(&input);
        // Of a few readings that pass it the limit is known within their noise, which may be little beside what lies between two inputs.
        grid.extend(level_at_largest(inputs, place, &input));
        grid.sort_by(f64::total_cmp);
        if grid.len() < 2 {
            return Vec::new();
        }
        // Unlike `clamp`, for any limit.
        let clipped = move |limit: f64| map(&input, |u| u.max(-limit).min(limit) - u);
        vec![Draft::whole(place, of_input_value(place, "limit", grid), clipped)]
    })
}

/// A parameter that is a value of the input.
fn of_input_value(place: &Place, name: &'static str, grid: Vec<f64>) -> Nonlinear {
    Nonlinear { name, unit: place.unit.si().name(), grid }
}

/// What the sensor reads at its largest input, where that is less.
fn level_at_largest(inputs: &Inputs<'_>, place: &Place, input: &[f64]) -> Option<f64> {
    let readings = inputs.readings_of(place);
    let rows = (0..input.len()).filter(|&row| readings[row].is_finite() && input[row].is_finite());
    let largest = rows.max_by(|&a, &b| input[a].abs().total_cmp(&input[b].abs()))?;
    let level = readings[largest] * input[largest].signum();
    (level > 0.0 && level < input[largest].abs()).then_some(level)
}

/// The limits of an input that are tried: each is passed by more readings than the next, by a few first and by most at last.
fn limits(input: &[f64]) -> Vec<f64> {
    let mut magnitudes = map(input, f64::abs);
    magnitudes.retain(|magnitude| magnitude.is_finite());
    magnitudes.sort_by(f64::total_cmp);
    let number = magnitudes.len();
    let passed = logarithmic(FEWEST_PASSED, CLIPPED_PART * number as f64, LIMITS_PER_DECADE);
    let limit = |passed: &f64| magnitudes.get(number.saturating_sub(1 + *passed as usize)).copied();
    let mut grid: Vec<f64> = passed.iter().rev().filter_map(limit).filter(|&limit| limit > 0.0).collect();
    grid.dedup_by(|next, last| *next <= 1.0005 * *last);
    grid
}

/// The thresholds of a dead zone that are tried: even in their logarithm, and even in the readings between them.
fn thresholds(input: &[f64]) -> Vec<f64> {
    let mut magnitudes = map(input, f64::abs);
    magnitudes.retain(|magnitude| magnitude.is_finite());
    magnitudes.sort_by(f64::total_cmp);
    let at = |place: usize| {
        magnitudes.get(place.min(magnitudes.len().saturating_sub(1))).copied().unwrap_or_default()
    };
    let high = at(magnitudes.len());
    // The least that a grid can start from where the input is often 0.
    let mut grid = logarithmic(at(DEAD_ZONE_READINGS).max(1e-4 * high), DEAD_ZONE_BEYOND * high, 8.0);
    let Some(&low) = grid.first() else { return grid };
    grid.extend((1..DEAD_ZONE_PARTS).map(|part| at(part * magnitudes.len() / DEAD_ZONE_PARTS)));
    grid.retain(|&threshold| threshold >= low);
    grid.sort_by(f64::total_cmp);
    grid.dedup_by(|next, last| *next <= 1.005 * *last);
    grid
}

/// The input of a place, if it varies.
pub(super) fn varying(place: &Place) -> Option<&Series> {
    place.input.as_ref().filter(|input| varies(input))
}

/// One column at each place whose input varies as `has` says.
fn of_input(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    has: impl Fn(&[f64]) -> bool,
    column: impl Fn(&Place, &[f64]) -> (Vec<f64>, super::Amplitude),
) -> Vec<super::Candidate> {
    at_each_place(effect, inputs, |place| {
        (varying(place).filter(|input| has(input)).into_iter())
            .map(|input| {
                let (values, amplitude) = column(place, input);
                Draft::linear(place, values, amplitude)
            })
            .collect()
    })
}

fn amplitude_varies(input: &[f64]) -> bool {
    varies(&map(input, f64::abs))
}

/// The coefficient of the square or the cube of a place's input.
fn of_power(place: &Place, power: usize, plausible: Plausible) -> super::Amplitude {
    let [rate, force, velocity] = if power == 2 {
        [RATE_SQUARED, G_SQUARED, VELOCITY_SQUARED]
    } else {
        [RATE_CUBED, G_CUBED, VELOCITY_CUBED]
    };
    match place.kind.dimension() {
        Dimension::AngularRate => coefficient(place, rate, plausible),
        Dimension::Acceleration => coefficient(place, force, plausible),
        Dimension::Velocity => coefficient(place, velocity, plausible),
        Dimension::Other => {
            let unit = place.unit.name();
            number("coefficient", &format!("{unit}/{}", to_the(unit, power)), 1.0, None)
        }
    }
}

/// A small rotation ε of a whole instrument: each axis a becomes a + ε × a, so its sensor reads ε·(a × u) more. Offered
/// about all three body axes at once and about each alone: most mountings are wrong about one, and three amplitudes
/// where one suffices lose to a single sensor's.
fn mounting(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    instrument: &Instrument<'_>,
) -> Vec<super::Candidate> {
    let (Target::Group { .. }, Some(first)) = (&instrument.target, instrument.places.first()) else {
        return Vec::new();
    };
    let parallel =
        (instrument.places.iter()).all(|place| place.axes.input.cross(&first.axes.input).norm() < 1e-3);
    if parallel {
        return Vec::new();
    }
    let columns = [("angle_x", Vector3::x()), ("angle_y", Vector3::y()), ("angle_z", Vector3::z())];
    let columns = columns.map(|(name, about)| {
        let parts = instrument.places.iter().filter_map(|place| {
            // ε·(a × u) = (ε × a)·u.
            Some((place.sensor, inputs.input_along(place, &about.cross(&place.axes.input))?))
        });
        let plausible = Some([5.0, if first.micromechanical { 6e4 } else { 3600.0 }]);
        (Column::of(parts), number(name, "arcsec", RADIAN_IN_ARCSECONDS, plausible))
    });
    let shown = |column: &Column| column.parts.iter().any(|(_, values)| varies(values));
    if !columns.iter().any(|(column, _)| shown(column)) {
        return Vec::new();
    }
    let draft = |columns: Vec<(Column, super::Amplitude)>| {
        let (signature, amplitudes) = seen(columns);
        Draft::new(Search::Linear(signature), amplitudes).of(effect, instrument.target.clone(), first.port)
    };
    let alone = columns.iter().filter(|(column, _)| shown(column)).map(|column| draft(vec![column.clone()]));
    std::iter::once(draft(columns.to_vec())).chain(alone).collect()
}
