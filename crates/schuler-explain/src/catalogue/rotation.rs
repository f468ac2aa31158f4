//! Errors that follow the body's motion other than the sensor's own input, or its input's past.
use nalgebra::Vector3;

use super::draft::{
    Draft, G, Plausible, RATE_SQUARED, accelerometers, at_each_place, coefficient, gyros, inertial,
    logarithmic, number, ppm, time_constant, tuned_gyros,
};
use super::form::Form;
use super::in_flight::{GyroAxis, HAS_A_MEMORY, InFlight, Part, WITHIN_A_STEP};
use super::{Effect, Nonlinear};
use crate::inputs::Series;
use crate::inputs::motion::row_of;
use crate::inputs::series::{deviation, lagged, map, product, varies};

/// Lowest frequency at which an instrument may read out its turn, Hz, and the least number of readings in a record.
const CONING_LOWEST_HZ: f64 = 0.05;
const CONING_READINGS: f64 = 20.0;
/// Part of a record, from its start, that has less than this part of the mean power where the record begins before it is turned.
const START: f64 = 0.05;
const LEAST_POWER: f64 = 0.01;
/// The other torquer's power counts apart where it is more than this part of the own.
const OTHER_POWER: f64 = 1e-3;

pub(super) const TORQUER_SELF_HEATING: Effect = Effect {
    id: "torquer_self_heating",
    formula: "k·LP_τ(ω²)",
    sentence: "is heated by the power that its rate takes",
    needs: "a burst of rate, then rest",
    separated_by: "a burst of rate and rest after it, at constant temperature: the drift dies away after the burst",
    source: "IEEE Std 813, torquer heating",
    // A tuned gyro by both its torquers; whatever closes another gyro's loop is fed for its own rate.
    in_flight: HAS_A_MEMORY,
    form: Form::Heating,
    acts_on: gyros,
    candidates: |effect, inputs| {
        let Some(tau) = time_constant(inputs, 10.0, 3600.0) else { return Vec::new() };
        at_each_place(effect, inputs, |place| {
            let power = |axis: &Vector3<f64>| Some(map(&inputs.rate_along(axis)?, |rate| rate * rate));
            let (own, other) = (power(&place.axes.input), power(&place.axes.other));
            let (Some(own), Some(other)) = (own, other) else { return Vec::new() };
            let both: Series = own.iter().zip(&other).map(|(own, other)| own + other).collect();
            let counts = tuned_gyros(place.kind) && deviation(&other) > OTHER_POWER * deviation(&own);
            let own: Series = own.into();
            let powers = [("input", own, true), ("both", both, counts)];
            (powers.into_iter())
                .filter(|(_, power, wanted)| *wanted && varies(power))
                .map(|(axis, power, _)| {
                    let time_s = inputs.time_s.clone();
                    let amplitude = coefficient(place, RATE_SQUARED, Plausible::UNKNOWN);
                    let begins = begins(&power);
                    let draft =
                        Draft::grid(place, tau.clone(), amplitude, move |tau| lagged(&time_s, &power, tau))
                            .with("axis", axis);
                    if begins { draft } else { draft.with_unknown_start(place, inputs.time_s.clone()) }
                })
                .collect()
        })
    },
};

/// Whether there is no power at first: the sensor is as warm as its surroundings then, and how warm it was is not known otherwise.
fn begins(power: &[f64]) -> bool {
    let first = (START * power.len() as f64).ceil() as usize;
    let mean = |power: &[f64]| power.iter().sum::<f64>() / power.len().max(1) as f64;
    mean(&power[..first]) < LEAST_POWER * mean(power)
}

pub(super) const POST_G_TRANSIENT: Effect = Effect {
    id: "post_g_transient",
    formula: "k·LP_τ(f)",
    sentence: "recovers slowly from high acceleration",
    needs: "a burst of acceleration",
    separated_by: "hold on a centrifuge, stop, and watch at rest",
    source: "IEEE Std 836 (centrifuge), IEEE Std 1293",
    in_flight: HAS_A_MEMORY,
    form: Form::Lag(&[Part::Input(1)]),
    acts_on: accelerometers,
    candidates: |effect, inputs| {
        let Some(tau) = time_constant(inputs, 1.0, 3600.0) else { return Vec::new() };
        at_each_place(effect, inputs, |place| {
            let Some(force) = super::input::varying(place).cloned() else { return Vec::new() };
            let time_s = inputs.time_s.clone();
            let amplitude = coefficient(place, G, Plausible::accelerometer([1.0, 100.0]));
            vec![Draft::grid(place, tau.clone(), amplitude, move |tau| lagged(&time_s, &force, tau))]
        })
    },
};

pub(super) const ANISOINERTIA: Effect = Effect {
    id: "anisoinertia",
    formula: "k·ω_i·ω_s",
    sentence: "drifts with the product of the rates about its input and spin axes",
    needs: "two rates at once",
    separated_by: "rotate about an axis at 45° between the two, both ways",
    source: "IEEE Std 813; IEEE Std 292 for the same term of single-axis gyros",
    in_flight: InFlight::Term([Part::Input(1), Part::Rate(GyroAxis::Spin)]),
    form: Form::Term,
    acts_on: tuned_gyros,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let rates = (inputs.rate_along(&place.axes.input), inputs.rate_along(&place.axes.spin));
            let (Some(along), Some(spin)) = rates else { return Vec::new() };
            let values = product(&along, &spin);
            if !varies(&values) {
                return Vec::new();
            }
            vec![Draft::linear(
                place,
                values,
                coefficient(place, RATE_SQUARED, Plausible::gyro([0.001, 0.1])),
            )]
        })
    },
};

pub(super) const ANGULAR_ACCELERATION: Effect = Effect {
    id: "angular_acceleration",
    formula: "k·ω̇_i, or k·ω̇_o across",
    sentence: "answers to angular acceleration",
    needs: "changing rate",
    separated_by: "oscillate at several frequencies: the error grows with frequency, a lag's phase turns on",
    source: "IEEE Std 813, angular-acceleration sensitivity",
    in_flight: WITHIN_A_STEP,
    form: Form::AngularAcceleration,
    acts_on: gyros,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let axes = [("input", place.axes.input), ("other", place.axes.other)];
            (axes.into_iter())
                .filter(|(name, _)| *name == "input" || tuned_gyros(place.kind))
                .filter_map(|(name, axis)| {
                    let values = inputs.angular_acceleration_along(&axis).filter(|values| varies(values))?;
                    Some(
                        Draft::linear(place, values, number("coefficient", "s", 1.0, None))
                            .with("axis", name),
                    )
                })
                .collect()
        })
    },
};

pub(super) const RATE_CROSS_AXIS: Effect = Effect {
    id: "rate_cross_axis",
    formula: "k·ω_o",
    sentence: "answers to the rate about its other input axis",
    needs: "rate about both axes",
    separated_by: "remount the gyro by 90° about its spin axis: a misalignment of the mount stays with the mount",
    source: "IEEE Std 813, cross-axis coupling of the tuned gyro's loops",
    in_flight: InFlight::Term([Part::Rate(GyroAxis::Other), Part::One]),
    form: Form::Term,
    acts_on: tuned_gyros,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let rate = inputs.rate_along(&place.axes.other).filter(|rate| varies(rate));
            (rate.into_iter()).map(|rate| Draft::linear(place, rate, ppm(place, [10.0, 1000.0]))).collect()
        })
    },
};

pub(super) const CONING_SCULLING: Effect = Effect {
    id: "coning_sculling",
    formula: "k·½ (∫ θ × ω dt)_i/T, on accelerometers k·½ (∫ θ × f + v × ω dt)_i/T, over readings every T = 1/f",
    sentence: "rectifies coning or sculling motion",
    needs: "rates about two axes in quadrature",
    separated_by: "coning about the axis at another amplitude: the error goes with its square",
    source: "Savage, J. Guidance, Control, and Dynamics 21 (1998) 19 and 208; Titterton & Weston",
    in_flight: WITHIN_A_STEP,
    form: Form::Values,
    acts_on: inertial,
    candidates: |effect, inputs| {
        let step_s = inputs.recording.step_s;
        let low = CONING_LOWEST_HZ.max(CONING_READINGS / inputs.duration_s().max(1.0));
        let high = 1.0 / step_s;
        let grid = logarithmic(low, high, 3.0);
        let turning = (inputs.motion.rate.iter().flatten()).filter(|rate| varies(rate)).count() > 1;
        if grid.len() < 2 || !turning {
            return Vec::new();
        }
        let parameter = Nonlinear { name: "frequency_hz", unit: "Hz", grid };
        at_each_place(effect, inputs, |place| {
            let Some(rate) = inputs.motion.rate.clone() else { return Vec::new() };
            let shaken = if gyros(place.kind) { Some(rate.clone()) } else { inputs.motion.force.clone() };
            let Some(shaken) = shaken.filter(|shaken| shaken.iter().any(|axis| varies(axis))) else {
                return Vec::new();
            };
            let axis = place.axes.input;
            let half = if gyros(place.kind) { 0.5 } else { 1.0 };
            let amplitude = number("coefficient", "1", 1.0, Some([0.01, 1.0]));
            vec![Draft::grid(place, parameter.clone(), amplitude, move |frequency_hz| {
                let rows = (1.0 / (frequency_hz * step_s)).round().max(1.0) as usize;
                rectified(&rate, &shaken, step_s, rows).map(|value| half * axis.dot(&value)).collect()
            })]
        })
    },
};

/// `½ (∫ θ × x + y × ω dt)/T` over the last T = `rows` · `step_s` of every row, where the turn θ and the integral y of the
/// input x begin anew with each T: what is lost where a turn is told as a rotation vector, or a velocity without the turn
/// meanwhile. A steady turn about one axis gives nothing, however fast it is.
///
/// Increments over a step are Δθ and Δy; within it both grow as the two last ones say (Savage 1998, eq. 36 and 38):
/// Σ ½ [(θ + Δθ₋₁/6) × Δy + (y + Δy₋₁/6) × Δθ].
fn rectified<'a>(
    rate: &'a [Series; 3],
    input: &'a [Series; 3],
    step_s: f64,
    rows: usize,
) -> impl Iterator<Item = Vector3<f64>> + 'a {
    let increments = move |row: usize| (row_of(rate, row) * step_s, row_of(input, row) * step_s);
    // Of one row with what came before it.
    let crossed = |(turn, gain): (Vector3<f64>, Vector3<f64>),
                   (angle, velocity): (Vector3<f64>, Vector3<f64>)| {
        0.5 * (turn.cross(&velocity) + gain.cross(&angle))
    };
    let within = move |row: usize| match row.checked_sub(1) {
        Some(before) => crossed(increments(before), increments(row)) / 6.0,
        None => Vector3::zeros(),
    };
    let (mut turn, mut gain, mut sum) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    (0..rate[0].len()).map(move |row| {
        if let Some(gone) = row.checked_sub(rows) {
            let (angle, velocity) = increments(gone);
            (turn, gain) = (turn - angle, gain - velocity);
            sum -= crossed((angle, velocity), (turn, gain)) + within(gone);
        }
        let (angle, velocity) = increments(row);
        sum += crossed((turn, gain), (angle, velocity)) + within(row);
        (turn, gain) = (turn + angle, gain + velocity);
        sum / (rows as f64 * step_s)
    })
}
