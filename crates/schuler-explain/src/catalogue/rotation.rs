//! Errors that follow the body's motion other than the sensor's own input, or its input's past.
use nalgebra::Vector3;

use super::draft::{
    Draft, G, Plausible, RATE_SQUARED, accelerometers, at_each_place, coefficient, gyros, inertial,
    logarithmic, number, ppm, time_constant, tuned_gyros,
};
use super::{Effect, Nonlinear};
use crate::inputs::Series;
use crate::inputs::motion::row_of;
use crate::inputs::series::{deviation, lagged, map, product, varies};

/// Lowest frequency of motion that coning and sculling are looked for at, Hz, and least number of its periods.
const CONING_LOWEST_HZ: f64 = 0.05;
const CONING_PERIODS: f64 = 20.0;
/// Highest one, in samples per period.
const CONING_SAMPLES: f64 = 4.0;
/// The other torquer's power counts apart where it is more than this part of the own.
const OTHER_POWER: f64 = 1e-3;

pub(super) const TORQUER_SELF_HEATING: Effect = Effect {
    id: "torquer_self_heating",
    formula: "k·LP_τ(ω²)",
    sentence: "is heated by its own torquer",
    needs: "a burst of rate, then rest",
    separated_by: "a burst of rate and rest after it, at constant temperature: the drift dies away after the burst",
    source: "IEEE Std 813, torquer heating",
    acts_on: tuned_gyros,
    candidates: |effect, inputs| {
        let Some(tau) = time_constant(inputs, 10.0, 3600.0) else { return Vec::new() };
        at_each_place(effect, inputs, |place| {
            let power = |axis: &Vector3<f64>| Some(map(&inputs.rate_along(axis)?, |rate| rate * rate));
            let (own, other) = (power(&place.axes.input), power(&place.axes.other));
            let (Some(own), Some(other)) = (own, other) else { return Vec::new() };
            let both: Series = own.iter().zip(&other).map(|(own, other)| own + other).collect();
            let counts = deviation(&other) > OTHER_POWER * deviation(&own);
            let own: Series = own.into();
            let powers = [("input", own, true), ("both", both, counts)];
            (powers.into_iter())
                .filter(|(_, power, wanted)| *wanted && varies(power))
                .map(|(axis, power, _)| {
                    let time_s = inputs.time_s.clone();
                    let amplitude = coefficient(place, RATE_SQUARED, Plausible::UNKNOWN);
                    Draft::grid(place, tau.clone(), amplitude, move |tau| lagged(&time_s, &power, tau))
                        .with("axis", axis)
                })
                .collect()
        })
    },
};

pub(super) const POST_G_TRANSIENT: Effect = Effect {
    id: "post_g_transient",
    formula: "k·LP_τ(f)",
    sentence: "recovers slowly from high acceleration",
    needs: "a burst of acceleration",
    separated_by: "hold on a centrifuge, stop, and watch at rest",
    source: "IEEE Std 836 (centrifuge), IEEE Std 1293",
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
    formula: "k·LP[½ (θ × ω)_i], k·LP[(θ × f)_i] on accelerometers, θ the angle faster than f",
    sentence: "rectifies coning or sculling motion",
    needs: "rates about two axes in quadrature",
    separated_by: "coning about the axis at another amplitude: the error goes with its square",
    source: "Savage, J. Guidance, Control, and Dynamics 21 (1998) 19 and 208; Titterton & Weston",
    acts_on: inertial,
    candidates: |effect, inputs| {
        let low = CONING_LOWEST_HZ.max(CONING_PERIODS / inputs.duration_s().max(1.0));
        let high = 1.0 / (CONING_SAMPLES * inputs.recording.step_s);
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
            let (time_s, axis) = (inputs.time_s.clone(), place.axes.input);
            let half = if gyros(place.kind) { 0.5 } else { 1.0 };
            let amplitude = number("coefficient", "1", 1.0, Some([0.01, 1.0]));
            vec![Draft::grid(place, parameter.clone(), amplitude, move |frequency| {
                rectified(&time_s, &rate, &shaken, &axis, frequency)
                    .into_iter()
                    .map(|value| half * value)
                    .collect()
            })]
        })
    },
};

/// `LP[(θ × x)·axis]`, where θ is the angle and x the input without what is slower than `frequency_hz`: both are
/// high-passed by a first-order lag of that corner, by which the product is then smoothed.
fn rectified(
    time_s: &[f64],
    rate: &[Series; 3],
    input: &[Series; 3],
    axis: &Vector3<f64>,
    frequency_hz: f64,
) -> Vec<f64> {
    let tau_s = 1.0 / (std::f64::consts::TAU * frequency_hz);
    // θ' = ω − θ/τ: the lag of the rate, times τ.
    let angle: [Series; 3] =
        rate.each_ref().map(|rate| map(&lagged(time_s, &centred(rate), tau_s), |value| tau_s * value).into());
    let fast: [Series; 3] = input.each_ref().map(|input| {
        lagged(time_s, input, tau_s).iter().zip(&**input).map(|(slow, input)| input - slow).collect()
    });
    let products: Vec<f64> =
        (0..time_s.len()).map(|row| axis.dot(&row_of(&angle, row).cross(&row_of(&fast, row)))).collect();
    lagged(time_s, &products, tau_s)
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = crate::inputs::series::mean(values);
    map(values, |value| value - mean)
}
