//! Errors that follow a temperature, its rate, its difference from place to place, or its history.
//!
//! Temperatures are smoothed posterior means ([`crate::inputs::thermometer`]), on which coefficients are not attenuated.
//! T₀ is the nominal model's reference. Where there is none, T₀ is the mean over the record, the candidate says so by a
//! variant `reference`, and what another reference would add is an amplitude of its own, `at_mean`.
use super::draft::{
    Draft, G, G_KELVIN, ITSELF, KELVIN, KELVIN_CUBED, KELVIN_PER_HOUR, KELVIN_PER_METRE, KELVIN_SQUARED,
    Plausible, amplitude, any, at_each_instrument_place, coefficient, gyros, inertial, logarithmic, number,
    time_constant, widened,
};
use super::form::Form;
use super::in_flight::{GyroAxis, HAS_A_MEMORY, InFlight, Part};
use super::{AT_MEAN, Candidate, Effect, Nonlinear};
use crate::inputs::series::{lagged, map, mean, play_branch, product, range, varies};
use crate::inputs::{Inputs, Place, Series, Thermometer};

/// Range of temperature from which on a square and a cube are offered, K. It takes 10 K to see one well; what less shows the
/// likelihood says.
const RANGE_FOR_POWERS: f64 = 2.0;
/// How far beyond the range an unknown reference of a square is searched, in ranges.
const REFERENCE_BEYOND: f64 = 0.75;
/// Points of that search.
const REFERENCE_POINTS: usize = 11;
/// References far outside, in ranges beyond the ends: from the last on a power is a straight line.
const REFERENCE_FAR: [f64; 3] = [1.5, 3.0, 6.0];
/// Turns of the temperature that hysteresis needs to show both branches, and by which parts of the range, the first that is there. One turn
/// shows them once, as a step would: what the record cannot tell apart is to be told.
const TURNS: usize = 1;
const TURN_PARTS: [f64; 3] = [0.2, 0.1, 0.05];
/// Steps of the thermometer by which it has to turn.
const TURN_COUNTS: f64 = 4.0;

const IEEE_813: &str =
    "IEEE Std 813, IEEE Std 1293 (temperature sensitivities); Tarygin 2024 for the rate and gradient terms";

pub(super) const BIAS_TEMPERATURE: Effect = Effect {
    id: "bias_temperature",
    formula: "k·(T − T₀)",
    sentence: "drifts with its temperature",
    needs: "T varies",
    separated_by: "soak at two temperatures until dT/dt is zero: only dependence on T itself is left",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::Temperature(1), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        let plausible = Plausible::inertial([0.01, 0.05], [1.0, 30.0]);
        per_thermometer(effect, inputs, |place, thermometer| {
            let (reference, known) = inputs.reference(place, thermometer);
            let values = map(&thermometer.temperature, |t| t - reference);
            let draft = Draft::linear(place, values, coefficient(place, KELVIN, plausible));
            vec![with_zero(draft, place, inputs.rows(), reference, known)]
        })
    },
};

pub(super) const BIAS_TEMPERATURE_SQ: Effect = Effect {
    id: "bias_temperature_sq",
    formula: "k·(T − T₀)²",
    sentence: "drifts with the square of its temperature",
    needs: "T varies ≥ 10 K",
    separated_by: "soak at three temperatures",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::Temperature(2), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        let plausible = Plausible { gyro: Some([1e-4, 1e-3]), ..Plausible::UNKNOWN };
        per_thermometer(effect, inputs, |place, thermometer| {
            power(inputs, place, thermometer, 2, coefficient(place, KELVIN_SQUARED, plausible))
        })
    },
};

pub(super) const BIAS_TEMPERATURE_CUBIC: Effect = Effect {
    id: "bias_temperature_cubic",
    formula: "k·(T − T₀)³",
    sentence: "drifts with the cube of its temperature",
    needs: "T varies ≥ 20 K",
    separated_by: "soak at four temperatures",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::Temperature(3), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        per_thermometer(effect, inputs, |place, thermometer| {
            power(inputs, place, thermometer, 3, coefficient(place, KELVIN_CUBED, Plausible::UNKNOWN))
        })
    },
};

pub(super) const BIAS_TEMPERATURE_RATE: Effect = Effect {
    id: "bias_temperature_rate",
    formula: "k·Ṫ",
    sentence: "drifts with the rate of its temperature",
    needs: "Ṫ varies, apart from T",
    separated_by: "a temperature profile that passes one temperature at two rates, up and down: a daily cycle, or ramps of both signs",
    source: "Tarygin 2024; Shupe 1980 for fibre-optic gyros",
    in_flight: InFlight::Term([Part::TemperatureRate, Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        // 0.01–0.5 °/h per K/min.
        let plausible = Plausible { gyro: Some([0.01 / 60.0, 0.5 / 60.0]), ..Plausible::UNKNOWN };
        per_thermometer(effect, inputs, |place, thermometer| {
            if !thermometer.rate_shows() {
                return Vec::new();
            }
            let values = thermometer.rate.to_vec();
            vec![Draft::linear(place, values, coefficient(place, KELVIN_PER_HOUR, plausible))]
        })
    },
};

pub(super) const BIAS_THERMAL_LAG: Effect = Effect {
    id: "bias_thermal_lag",
    formula: "k·(T_lag − T₀), τ Ṫ_lag = T − T_lag",
    sentence: "drifts with a temperature that follows the thermometer late",
    needs: "T varies about as fast as τ",
    separated_by: "a step of temperature, held for several τ: the lag shows as an exponential after the step",
    source: IEEE_813,
    in_flight: HAS_A_MEMORY,
    form: Form::Lag(&[Part::Temperature(1)]),
    acts_on: any,
    candidates: |effect, inputs| {
        let Some(tau) = time_constant(inputs, 60.0, 6.0 * 3600.0) else { return Vec::new() };
        let plausible = Plausible::inertial([0.01, 0.05], [1.0, 30.0]);
        per_thermometer(effect, inputs, |place, thermometer| {
            let (reference, known) = inputs.reference(place, thermometer);
            let (time_s, temperature) = (inputs.time_s.clone(), thermometer.temperature.clone());
            let amplitude = coefficient(place, KELVIN, plausible);
            let draft = Draft::grid(place, tau.clone(), amplitude, move |tau| {
                map(&lagged(&time_s, &temperature, tau), |t| t - reference)
            });
            vec![with_zero(draft, place, inputs.rows(), reference, known)]
        })
    },
};

pub(super) const BIAS_TEMPERATURE_GRADIENT: Effect = Effect {
    id: "bias_temperature_gradient",
    formula: "k·∇T",
    sentence: "drifts with a difference of temperature across it",
    needs: "two thermometers",
    separated_by: "heat one side and soak the whole at the same mean temperature",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::TemperatureDifference, Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_instrument_place(effect, inputs, |place| {
            let gradients = inputs.gradients_at(place).into_iter();
            let drafts = gradients.flat_map(|gradient| {
                // The magnitude is known per K; over a distance it is that times the distance.
                let over = gradient.distance_m.unwrap_or(1.0);
                let plausible = Plausible { gyro: Some([0.01 * over, 0.5 * over]), ..Plausible::UNKNOWN };
                let per = if gradient.distance_m.is_some() { KELVIN_PER_METRE } else { KELVIN };
                let [from, to] = &gradient.columns;
                let of = |values: Vec<f64>| {
                    Draft::linear(place, values, coefficient(place, per, plausible))
                        .with("column", format!("{to} - {from}"))
                };
                // What an instrument heats itself, or an offset of one thermometer, is a difference that the other does not show: then
                // its zero is as little known as the reference of a temperature.
                let mean = mean(&gradient.values);
                let about_mean = of(map(&gradient.values, |value| value - mean))
                    .with_free_zero(place, inputs.rows())
                    .with("reference", format!("{:.4} K, the mean", mean * over));
                [of(gradient.values.to_vec()), about_mean]
            });
            drafts.collect()
        })
    },
};

pub(super) const BIAS_THERMAL_HYSTERESIS: Effect = Effect {
    id: "bias_thermal_hysteresis",
    formula: "k·(branch, −1 to 1, of a play operator on T)",
    sentence: "depends on whether it was heated or cooled last",
    needs: "several heating and cooling cycles",
    separated_by: "stop half-way on a heating and on a cooling ramp and soak: hysteresis stays, dependence on dT/dt goes",
    source: "IEEE Std 1293, thermal hysteresis; Krasnosel'skii & Pokrovskii for the play operator",
    in_flight: HAS_A_MEMORY,
    form: Form::Branch,
    acts_on: any,
    candidates: |effect, inputs| {
        per_thermometer(effect, inputs, |place, thermometer| {
            let span = range(&thermometer.temperature);
            let turns_back = |part: &f64| {
                let by = part * span;
                by > TURN_COUNTS * thermometer.quantisation && turns(&thermometer.temperature, by) >= TURNS
            };
            let Some(part) = TURN_PARTS.into_iter().find(turns_back) else { return Vec::new() };
            let least = (0.01 * span).max(thermometer.quantisation);
            // Wider, it would hardly turn with the temperature.
            let grid = logarithmic(least, 2.0 * part * span, 5.0);
            if grid.len() < 2 {
                return Vec::new();
            }
            let temperature = thermometer.temperature.clone();
            let parameter = Nonlinear { name: "width", unit: "K", grid };
            let amplitude = coefficient(place, ITSELF, Plausible::UNKNOWN);
            vec![Draft::grid(place, parameter, amplitude, move |width| play_branch(&temperature, width))]
        })
    },
};

pub(super) const BIAS_ELECTRONICS_TEMPERATURE: Effect = Effect {
    id: "bias_electronics_temperature",
    formula: "k·(T_el − T₀)",
    sentence: "drifts with the temperature of its electronics",
    needs: "a thermometer at the electronics, heated apart",
    separated_by: "heat the electronics alone",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::Temperature(1), Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_instrument_place(effect, inputs, |place| {
            let thermometers = inputs.electronics_at(place).into_iter();
            let drafts = thermometers.filter(|thermometer| thermometer.varies()).map(|thermometer| {
                let plausible = Plausible { gyro: Some([0.001, 0.1]), ..Plausible::UNKNOWN };
                let reference = crate::inputs::series::mean(&thermometer.temperature);
                let values = map(&thermometer.temperature, |t| t - reference);
                let draft = Draft::linear(place, values, coefficient(place, KELVIN, plausible));
                with_zero(draft.with("column", &thermometer.column), place, inputs.rows(), reference, false)
            });
            drafts.collect()
        })
    },
};

pub(super) const SCALE_FACTOR_TEMPERATURE: Effect = Effect {
    id: "scale_factor_temperature",
    formula: "k·u·(T − T₀)",
    sentence: "has a scale factor that changes with its temperature",
    needs: "input and T vary",
    separated_by: "the same rates or positions at two temperatures",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::Input(1), Part::Temperature(1)]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        per_thermometer(effect, inputs, |place, thermometer| {
            let Some(input) = place.input.as_ref().filter(|input| varies(input)) else { return Vec::new() };
            let amplitude = number("coefficient", "ppm/K", 1e6, Some(widened(place, [1.0, 500.0])));
            let at_mean = number(AT_MEAN, "ppm", 1e6, None);
            vec![times_temperature(inputs, place, thermometer, input, [amplitude, at_mean])]
        })
    },
};

pub(super) const MISALIGNMENT_TEMPERATURE: Effect = Effect {
    id: "misalignment_temperature",
    formula: "k_j·u_j·(T − T₀)",
    sentence: "turns its axis with its temperature",
    needs: "input across the axis and T vary",
    separated_by: "the same rotation across the axis at two temperatures",
    source: IEEE_813,
    in_flight: InFlight::Term([Part::InputAcross, Part::Temperature(1)]),
    form: Form::Term,
    acts_on: inertial,
    candidates: |effect, inputs| {
        per_thermometer(effect, inputs, |place, thermometer| {
            let across = place.axes.across().into_iter().filter_map(|(name, axis)| {
                let input = inputs.input_along(place, &axis).filter(|input| varies(input))?;
                let unit = super::draft::RADIAN_IN_ARCSECONDS;
                let amplitude = number("coefficient", "arcsec/K", unit, Some(widened(place, [0.1, 2.0])));
                let at_mean = number(AT_MEAN, "arcsec", unit, None);
                let amplitudes = [amplitude, at_mean];
                Some(times_temperature(inputs, place, thermometer, &input, amplitudes).with("axis", name))
            });
            across.collect()
        })
    },
};

pub(super) const G_MASS_UNBALANCE_TEMPERATURE: Effect = Effect {
    id: "g_mass_unbalance_temperature",
    formula: "k·f_i·(T − T₀)",
    sentence: "has a mass unbalance that changes with its temperature",
    needs: "tumble at two temperatures",
    separated_by: "the same tumble at a second temperature",
    source: "IEEE Std 813, mass unbalance; Hayakawa & Nibe for the tuned rotor",
    in_flight: InFlight::Term([Part::Force(GyroAxis::Input), Part::Temperature(1)]),
    form: Form::Term,
    acts_on: gyros,
    candidates: |effect, inputs| {
        per_thermometer(effect, inputs, |place, thermometer| {
            let force = inputs.force_along(&place.axes.input).filter(|force| varies(force));
            let Some(force) = force else { return Vec::new() };
            let plausible = Plausible::gyro([0.001, 0.05]);
            let at_mean = amplitude(place, AT_MEAN, G, Plausible::UNKNOWN);
            let amplitudes = [coefficient(place, G_KELVIN, plausible), at_mean];
            vec![times_temperature(inputs, place, thermometer, &force, amplitudes)]
        })
    },
};

/// The candidates of every place with each of its thermometers that varies.
fn per_thermometer(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    drafts: impl Fn(&Place, &Thermometer) -> Vec<Draft>,
) -> Vec<Candidate> {
    at_each_instrument_place(effect, inputs, |place| {
        (inputs.thermometers_at(place).into_iter())
            .filter(|thermometer| thermometer.varies())
            .flat_map(|thermometer| {
                (drafts(place, thermometer).into_iter())
                    .map(|draft| draft.with("column", &thermometer.column))
                    .collect::<Vec<_>>()
            })
            .collect()
    })
}

/// `factor·(T − T₀)`, whose amplitudes are the coefficient and, where T₀ is not known, the multiple of the factor at the mean of T.
fn times_temperature(
    inputs: &Inputs<'_>,
    place: &Place,
    thermometer: &Thermometer,
    factor: &[f64],
    [coefficient, at_mean]: [super::Amplitude; 2],
) -> Draft {
    let (reference, known) = inputs.reference(place, thermometer);
    let difference = map(&thermometer.temperature, |t| t - reference);
    let draft = Draft::linear(place, product(factor, &difference), coefficient);
    if known {
        return draft;
    }
    about_mean(draft.with_free_reference(place, factor.to_vec(), at_mean), reference)
}

/// `(T − T₀)ⁿ` of a temperature that has range enough; a reference that is not known is searched, as another one is another function of T.
fn power(
    inputs: &Inputs<'_>,
    place: &Place,
    thermometer: &Thermometer,
    exponent: i32,
    amplitude: super::Amplitude,
) -> Vec<Draft> {
    if range(&thermometer.temperature) < RANGE_FOR_POWERS {
        return Vec::new();
    }
    let (reference, known) = inputs.reference(place, thermometer);
    let temperature: Series = thermometer.temperature.clone();
    if known {
        return vec![Draft::linear(place, map(&temperature, |t| (t - reference).powi(exponent)), amplitude)];
    }
    let [least, most] = crate::inputs::series::extremes(&temperature);
    let beyond = REFERENCE_BEYOND * (most - least);
    let step = (most - least + 2.0 * beyond) / (REFERENCE_POINTS - 1) as f64;
    let far = REFERENCE_FAR.map(|ranges| ranges * (most - least));
    let near = (0..REFERENCE_POINTS).map(|k| least - beyond + step * k as f64);
    let (below, above) = (far.iter().rev().map(|by| least - by), far.iter().map(|by| most + by));
    let grid = below.chain(near).chain(above).collect();
    let parameter = Nonlinear { name: "reference_degC", unit: "degC", grid };
    vec![Draft::grid(place, parameter, amplitude, move |reference| {
        map(&temperature, |t| (t - reference).powi(exponent))
    })]
}

fn with_zero(draft: Draft, place: &Place, rows: usize, reference: f64, known: bool) -> Draft {
    if known { draft } else { about_mean(draft.with_free_zero(place, rows), reference) }
}

fn about_mean(draft: Draft, reference: f64) -> Draft {
    draft.with("reference", format!("{reference:.2} degC, the mean"))
}

/// How often a series turns by at least `by`.
fn turns(values: &[f64], by: f64) -> usize {
    let branch = play_branch(values, 0.5 * by);
    let mut last = 0.0;
    let mut turns = 0;
    for side in branch.into_iter().filter(|side| side.abs() > 0.999) {
        if side * last < 0.0 {
            turns += 1;
        }
        last = side;
    }
    turns
}
