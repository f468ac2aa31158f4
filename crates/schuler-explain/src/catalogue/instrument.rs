//! Errors of a whole instrument: time, bandwidth, place, and the Earth's rate that its simulation projects.
//!
//! Sensors of one group share them, and the finding is the group's; a sensor without a group has them alone.
use nalgebra::Vector3;
use schuler_recording::case::MotionKind;
use schuler_recording::motion::earth;
use schuler_recording::unit::Dimension;

use super::draft::{Draft, Instrument, any, displaced, gyros, instruments, logarithmic, number, seen};
use super::form::Form;
use super::in_flight::{HAS_NO_TERM, OF_THE_PLACE, WITHIN_A_STEP};
use super::input::varying;
use super::{Candidate, Column, Effect, Nonlinear, Port, Search, Signature, Target};
use crate::inputs::motion::{along, of_rows, row_of};
use crate::inputs::series::{delayed, delayed_closely, derivative, drifted, lagged_smooth, rms, varies};
use crate::inputs::{Inputs, Place, Series};

/// Smallest delay and lag searched, s, unless still less shows.
const LEAST_S: f64 = 1e-5;
/// The same, whatever shows: no clock is better.
const LEAST_OF_ALL_S: f64 = 1e-9;
/// Largest delay of inertial sensors, and of velocities and sensors of any kind, whose message may wait its turn on a line or under water. Radio comes up to 2 s
/// late as a rule; a search that ended there would call what comes later a lag, and then another one. Where rows are further apart, a row.
const MOST_DELAY_S: [f64; 2] = [2.0, 10.0];
/// Points in a decade of delays or lags.
const PER_DECADE: f64 = 3.0;
/// How far beyond an end of the record an input goes straight on, steps.
const STRAIGHT_ON_STEPS: f64 = 2.0;
/// Drifts of a clock, ppm: the best quartz without an oven, and three times the worst of it. Most equal steps between, and least
/// length of a record that shows one, s.
const LEAST_DRIFT_PPM: f64 = 0.1;
const MOST_DRIFT_PPM: f64 = 300.0;
const MOST_DRIFTS: f64 = 16.0;
const LEAST_OF_DRIFT_S: f64 = 30.0;
/// Largest lag, or a row: what is plausible ends at 0.6 s, but a search that ended there would call a longer one a delay.
const MOST_LAG_S: f64 = 2.0;

pub(super) const TIME_DELAY: Effect = Effect {
    id: "time_delay",
    formula: "u(t − d) − u(t)",
    sentence: "comes late",
    needs: "changing input",
    separated_by: "oscillate at several frequencies: a delay's phase grows with frequency, its gain stays",
    source: "IEEE Std 1559 (inertial systems), data latency",
    in_flight: WITHIN_A_STEP,
    form: Form::Delay,
    acts_on: any,
    candidates: |effect, inputs| {
        let longest_s = inputs.duration_s() / 20.0;
        if longest_s < 2.0 * LEAST_S {
            return Vec::new();
        }
        let grid = |place: &Place| -> Vec<f64> {
            let slow = matches!(place.dimension(), Dimension::Velocity | Dimension::Other);
            let most = MOST_DELAY_S[usize::from(slow)];
            let most = most.max(inputs.recording.step_s);
            let late = searched(inputs, place, most.min(longest_s));
            // The reference can be the late one; a gyro in a loop has none, and where sensors are each other's reference that is a delay of
            // another.
            if place.port == Port::Output && !place.is_estimated {
                late.iter().rev().map(|delay| -delay).chain(late.iter().copied()).collect()
            } else {
                late
            }
        };
        let delay = |place: &Place| Nonlinear { name: "delay_s", unit: "s", grid: grid(place) };
        // The components of a velocity are made by one instrument at one time.
        let alone = |place: &Place| place.dimension() != Dimension::Velocity;
        let mut found = whole_and_alone(effect, inputs, alone, delay, late);
        // In a loop the velocity is what comes late: an accelerometer that does makes it so, but for a constant and the loop's turn meanwhile.
        found.retain(|candidate| candidate.port != Port::Accelerometer);
        found.extend(inputs.places.iter().filter_map(|place| {
            let input = reference_in_loop(inputs, place)?;
            let of_loop = Place { input: Some(input), ..place.clone() };
            let instrument = Instrument { target: Target::Sensor(place.sensor), places: vec![&of_loop] };
            shared(effect, inputs, &instrument, delay(place), late(place))
        }));
        found
    },
};

pub(super) const CLOCK_DRIFT: Effect = Effect {
    id: "clock_drift",
    formula: "u(t − ε·t) − u(t), t from the first row",
    sentence: "has a clock that goes slower than that of its reference, or faster where the drift is below zero",
    needs: "changing input, half a minute of it",
    separated_by: "record twice as long: what a clock is off by doubles, a delay stays",
    source: "IEEE Std 1139 (frequency stability), normalised offset of a frequency",
    in_flight: HAS_NO_TERM,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        if inputs.duration_s() < LEAST_OF_DRIFT_S || inputs.is_loop() || inputs.motion.estimated {
            return Vec::new();
        }
        let parameter = |of: &Place| Nonlinear { name: "drift", unit: "ppm", grid: drifts(inputs, of) };
        let signature = |time_s: &[f64], input: &[f64], drift: f64| -> Vec<f64> {
            let lost = 1e-6 * drift;
            let start_s = time_s.first().copied().unwrap_or_default();
            let beyond = |time: f64| straight_on(time_s, input, lost * (time - start_s))(time);
            (drifted(time_s, input, lost).into_iter().zip(time_s).zip(input))
                .map(|((then, &time), now)| then.unwrap_or_else(|| beyond(time)) - now)
                .collect()
        };
        whole_and_alone(effect, inputs, |_| false, parameter, |_| signature)
    },
};

/// Drifts of a clock that are searched, ppm: from what moves readings at the end of the record by what their white noise hides over
/// the whole of it, some in a decade, and from half a radian of the motion on so far apart.
fn drifts(inputs: &Inputs<'_>, of: &Place) -> Vec<f64> {
    let (duration_s, rows) = (inputs.duration_s(), inputs.rows() as f64);
    let slope = of.input.as_ref().map_or(0.0, |input| rms(&derivative(&inputs.time_s, input)));
    let size = of.input.as_ref().map_or(0.0, |input| rms(input));
    let white = inputs.recording.sensors.get(of.sensor).map_or(0.0, |it| it.sensor.nominal.white);
    let ppm = |seconds: f64| 1e6 * seconds / duration_s;
    let apart = ppm(0.5 * size / slope).clamp(MOST_DRIFT_PPM / MOST_DRIFTS, MOST_DRIFT_PPM);
    let least = ppm(white / rows.sqrt() / slope).max(LEAST_DRIFT_PPM);
    let mut drifts = logarithmic(least, apart, PER_DECADE);
    let further = (2..).map(|step| apart * f64::from(step)).take_while(|drift| *drift <= MOST_DRIFT_PPM);
    drifts.extend(further);
    drifts.iter().rev().map(|drift| -drift).chain(drifts.iter().copied()).collect()
}

/// What the reference adds to the difference of velocities that a Schuler loop explains: its velocity with a minus, from
/// the specific force, up to a constant. A reference that comes late by d makes the difference larger by the change of
/// velocity over d.
fn reference_in_loop(inputs: &Inputs<'_>, place: &Place) -> Option<Series> {
    let in_loop = inputs.recording.case.motion.kind == MotionKind::VelocityError;
    if !in_loop || place.port != Port::Output || place.input.is_some() {
        return None;
    }
    let force = along(&place.axes.input, inputs.motion.force.as_ref()?);
    let mut velocity = 0.0;
    let steps = inputs.time_s.windows(2).zip(force.windows(2));
    let changes = steps.map(|(time_s, force)| 0.5 * (force[0] + force[1]) * (time_s[1] - time_s[0]));
    let reference: Vec<f64> = std::iter::once(0.0)
        .chain(changes.map(|change| {
            velocity -= change;
            velocity
        }))
        .collect();
    varies(&reference).then(|| reference.into())
}

pub(super) const BANDWIDTH_LAG: Effect = Effect {
    id: "bandwidth_lag",
    formula: "LP_τ(u) − u",
    sentence: "has less bandwidth than its simulation",
    needs: "changing input",
    separated_by: "oscillate at several frequencies: a lag loses gain as its phase grows, a delay does not",
    source: "IEEE Std 528, frequency response",
    in_flight: WITHIN_A_STEP,
    form: Form::Bandwidth,
    acts_on: any,
    candidates: |effect, inputs| {
        let most = MOST_LAG_S.max(inputs.recording.step_s);
        let parameter =
            |place: &Place| Nonlinear { name: "tau_s", unit: "s", grid: searched(inputs, place, most) };
        let signature = |time_s: &[f64], input: &[f64], tau_s: f64| -> Vec<f64> {
            lagged_smooth(time_s, input, tau_s).iter().zip(input).map(|(lagged, now)| lagged - now).collect()
        };
        whole_and_alone(effect, inputs, |_| true, parameter, |_| signature)
    },
};

pub(super) const LEVER_ARM: Effect = Effect {
    id: "lever_arm",
    formula: "ω̇ × r + ω × (ω × r) on accelerometers, ω × r on velocities",
    sentence: "sits elsewhere than its simulation says",
    needs: "rotation, about two axes for all three components",
    separated_by: "rotate about two axes in turn at the same place",
    source: "Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., ch. 2 and 5",
    in_flight: WITHIN_A_STEP,
    form: Form::LeverArm,
    acts_on: displaced,
    candidates: |effect, inputs| {
        let (Some(rate), Some(acceleration)) = (&inputs.motion.rate, &inputs.motion.angular_acceleration)
        else {
            return Vec::new();
        };
        if !rate.iter().any(|axis| varies(axis)) {
            return Vec::new();
        }
        let over_earth = rate_over_earth(inputs, inputs.motion.instant_rate.as_ref().unwrap_or(rate));
        let displacement = |place: &Place, arm: &Vector3<f64>| -> Vec<f64> {
            let reading = |row: usize| {
                if place.dimension() == Dimension::Velocity {
                    return row_of(&over_earth, row).cross(arm);
                }
                let rate = row_of(rate, row);
                row_of(acceleration, row).cross(arm) + rate.cross(&rate.cross(arm))
            };
            (0..inputs.rows()).map(|row| place.axes.input.dot(&reading(row))).collect()
        };
        let mut candidates = Vec::new();
        for instrument in
            instruments(effect, inputs, |place| place.input.is_some() && place.port == Port::Output)
        {
            let arms = [("arm_x_m", Vector3::x()), ("arm_y_m", Vector3::y()), ("arm_z_m", Vector3::z())];
            let columns = arms.map(|(name, arm)| {
                let parts = instrument.places.iter().map(|place| (place.sensor, displacement(place, &arm)));
                (Column::of(parts), number(name, "m", 1.0, Some([0.01, 20.0])))
            });
            let moves =
                columns.iter().any(|(column, _)| column.parts.iter().any(|(_, values)| varies(values)));
            if moves {
                let (signature, amplitudes) = seen(columns.to_vec());
                let draft = Draft::new(Search::Linear(signature), amplitudes);
                candidates.push(draft.of(effect, instrument.target, Port::Output));
            }
        }
        candidates
    },
};

pub(super) const EARTH_RATE_ATTITUDE: Effect = Effect {
    id: "earth_rate_attitude",
    formula: "−δψ·Ω cos φ·(east)_i, or −δφ·Ω·(sin φ north + cos φ down)_i",
    sentence: "feels the Earth's rate at another heading or latitude than its simulation",
    needs: "rotation, or three axes; known attitude",
    separated_by: "turn to other headings: an error of heading goes round with it, a bias stays",
    source: "gyrocompassing; Groves, 2nd ed., ch. 5",
    in_flight: OF_THE_PLACE,
    form: Form::EarthRate,
    acts_on: gyros,
    candidates: |effect, inputs| {
        let (Some(north), Some(down), Some(site)) =
            (&inputs.motion.north, &inputs.motion.down, inputs.recording.case.site)
        else {
            return Vec::new();
        };
        let (sin, cos) = site.latitude_deg.to_radians().sin_cos();
        let omega = earth::ROTATION_RATE;
        let heading = of_rows(inputs.rows(), |row| {
            let (north, down) = (row_of(north, row), row_of(down, row));
            -omega * cos * down.cross(&north)
        });
        let latitude =
            of_rows(inputs.rows(), |row| -omega * (sin * row_of(north, row) + cos * row_of(down, row)));
        let mut candidates = Vec::new();
        for instrument in instruments(effect, inputs, |place| place.input.is_some()) {
            for (name, vectors) in [("heading_deg", &heading), ("latitude_deg", &latitude)] {
                let along = |place: &&Place| crate::inputs::motion::along(&place.axes.input, vectors);
                let parts: Vec<(usize, Vec<f64>)> =
                    instrument.places.iter().map(|place| (place.sensor, along(place))).collect();
                let turns = parts.iter().any(|(_, values)| varies(values));
                let shown = instrument.places.iter().filter(|place| !place.relative).count() > 2;
                if turns || shown {
                    let amplitude = number(name, "deg", 180.0 / std::f64::consts::PI, Some([0.01, 1.0]));
                    let signature = Signature { columns: vec![Column::of(parts)] };
                    let draft = Draft::new(Search::Linear(signature), vec![amplitude]);
                    let target = instrument.target.clone();
                    candidates.push(draft.with("angle", name.trim_end_matches("_deg")).of(
                        effect,
                        target,
                        Port::Output,
                    ));
                }
            }
        }
        candidates
    },
};

/// Delays or lags that are searched, up to `most`: from what moves readings by what their white noise hides over the whole record, if
/// that is less than usual; a precise sensor shows microseconds in a fast motion. So little goes as the change of the input, and
/// one in a decade leads to the others.
fn searched(inputs: &Inputs<'_>, place: &Place, most: f64) -> Vec<f64> {
    let shown = || {
        let nominal = &inputs.recording.sensors.get(place.sensor)?.sensor.nominal;
        let slope = rms(&derivative(&inputs.time_s, place.input.as_ref()?));
        let hidden = nominal.white / (inputs.rows() as f64).sqrt();
        (hidden > 0.0 && slope > 0.0).then_some(hidden / slope)
    };
    let least = shown().unwrap_or(LEAST_S).max(LEAST_OF_ALL_S);
    let mut searched = logarithmic(least, LEAST_S, 1.0);
    searched.pop();
    searched.extend(logarithmic(LEAST_S, most, PER_DECADE));
    searched
}

/// The candidates of every instrument for a signature of its sensors' own inputs with one parameter and no amplitude, and those of each
/// sensor of a group that can have a lag or a delay of its own, `alone`.
fn whole_and_alone<S: Fn(&[f64], &[f64], f64) -> Vec<f64> + Copy + Send + Sync + 'static>(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    alone: impl Fn(&Place) -> bool,
    parameter: impl Fn(&Place) -> Nonlinear,
    signature: impl Fn(&Place) -> S,
) -> Vec<Candidate> {
    let instruments = instruments(effect, inputs, |place| varying(place).is_some());
    let several = instruments.iter().filter(|instrument| instrument.places.len() > 1);
    let alone = several
        .flat_map(|instrument| &instrument.places)
        .filter(|place| alone(place))
        .map(|&place| Instrument { target: Target::Sensor(place.sensor), places: vec![place] });
    let alone: Vec<Instrument<'_>> = alone.collect();
    (instruments.iter().chain(&alone))
        .filter_map(|instrument| {
            let first = instrument.places.first()?;
            shared(effect, inputs, instrument, parameter(first), signature(first))
        })
        .collect()
}

fn shared(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    instrument: &Instrument<'_>,
    parameter: Nonlinear,
    signature: impl Fn(&[f64], &[f64], f64) -> Vec<f64> + Copy + Send + Sync + 'static,
) -> Option<Candidate> {
    let port = instrument.places.first()?.port;
    let time_s = inputs.time_s.clone();
    let series: Vec<(usize, Series)> =
        (instrument.places.iter()).filter_map(|place| Some((place.sensor, place.input.clone()?))).collect();
    let of = move |parameters: &[f64]| {
        let value = parameters.first().copied().unwrap_or_default();
        let parts = series.iter().map(|(sensor, input)| (*sensor, signature(&time_s, input, value)));
        Signature { columns: vec![Column::of(parts)] }
    };
    let search = Search::Grid { parameters: vec![parameter], signature: Box::new(of), unit_amplitude: true };
    let draft = Draft::new(search, vec![number("part", "1", 1.0, None)]);
    Some(draft.of(effect, instrument.target.clone(), port))
}

/// What a delay does to the input of a place. A velocity sways within a few steps and does not jump, as the rate of a table does: with four
/// rows the sway in the middle between two is too small, and what it lacks looks like a scale factor.
fn late(place: &Place) -> impl Fn(&[f64], &[f64], f64) -> Vec<f64> + Copy + Send + Sync + use<> {
    let closely = place.dimension() == Dimension::Velocity;
    move |time_s, input, delay_s| {
        let late = if closely { delayed_closely } else { delayed }(time_s, input, delay_s);
        let beyond = straight_on(time_s, input, delay_s);
        (late.into_iter().zip(time_s).zip(input))
            .map(|((late, &time), now)| late.unwrap_or_else(|| beyond(time)) - now)
            .collect()
    }
}

/// The input straight on from the end of the record at which t − d lies beyond it, by a step's slope and no further than
/// [`STRAIGHT_ON_STEPS`]: there to say that nothing is late would leave the whole of what the delay does as an error at
/// the edge, which drifts and steps then explain.
pub(crate) fn straight_on(time_s: &[f64], input: &[f64], delay_s: f64) -> impl Fn(f64) -> f64 {
    let end = if delay_s < 0.0 { time_s.len().saturating_sub(2) } else { 0 };
    let at = |values: &[f64], row: usize| values.get(row).copied().unwrap_or_default();
    let (from, value) = (at(time_s, end), at(input, end));
    let step_s = at(time_s, end + 1) - from;
    let slope = if step_s > 0.0 { (at(input, end + 1) - value) / step_s } else { 0.0 };
    let (most, last) = (STRAIGHT_ON_STEPS * step_s, if delay_s < 0.0 { step_s } else { 0.0 });
    move |time| value + slope * (time - delay_s - from).clamp(last - most, last + most)
}

/// The body's rate over the Earth: less the Earth's own where the attitude is known.
pub(crate) fn rate_over_earth(inputs: &Inputs<'_>, rate: &[Series; 3]) -> [Series; 3] {
    let motion = &inputs.motion;
    let (Some(north), Some(down), Some(site)) = (&motion.north, &motion.down, inputs.recording.case.site)
    else {
        return rate.clone();
    };
    let earth = earth::rotation_ned(site.latitude_deg.to_radians());
    of_rows(inputs.rows(), |row| {
        row_of(rate, row) - row_of(north, row) * earth.x - row_of(down, row) * earth.z
    })
}
