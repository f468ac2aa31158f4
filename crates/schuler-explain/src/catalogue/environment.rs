//! Errors that follow a recorded quantity of the surroundings: supply, field, pressure, vibration, pick-off, any other.
use nalgebra::Vector3;
use schuler_recording::case::{Quantity, SensorKind};

use super::draft::{
    Draft, G_SQUARED, GAUSS, ITSELF, KILOPASCAL, MILLIRADIAN, Per, Plausible, VOLT, any, at_each_place,
    coefficient, gyros, inertial, time_constant, tuned_gyros,
};
use super::form::Form;
use super::in_flight::IS_NOT_TOLD;
use super::{Amplitude, Candidate, Effect, Port, general};
use crate::inputs::motion::of_rows;
use crate::inputs::series::{lagged, map, mean, product, varies};
use crate::inputs::{AuxiliaryInput, Inputs, Place, Series};

/// Field of the Earth's centred dipole at the equator, T. `[IGRF-13, first degree, 2020]`
pub(crate) const EQUATORIAL_FIELD: f64 = 2.98e-5;

pub(super) const BIAS_SUPPLY_VOLTAGE: Effect = Effect {
    id: "bias_supply_voltage",
    formula: "k·(V − V₀)",
    sentence: "drifts with its supply voltage",
    needs: "voltage recorded and not constant",
    separated_by: "step the supply at constant temperature",
    source: "IEEE Std 813, IEEE Std 1293 (power supply sensitivity)",
    in_flight: IS_NOT_TOLD,
    form: Form::Recorded,
    acts_on: any,
    candidates: |effect, inputs| {
        of_quantity(effect, inputs, &[Quantity::Voltage], |place| {
            coefficient(place, VOLT, Plausible::gyro([0.01, 0.1]))
        })
    },
};

pub(super) const BIAS_PRESSURE: Effect = Effect {
    id: "bias_pressure",
    formula: "k·(p − p₀)",
    sentence: "drifts with the air pressure",
    needs: "pressure recorded and not constant",
    separated_by: "change the pressure in a chamber at constant temperature",
    source: "IEEE Std 1293 (environmental sensitivities)",
    in_flight: IS_NOT_TOLD,
    form: Form::Recorded,
    acts_on: any,
    candidates: |effect, inputs| {
        of_quantity(effect, inputs, &[Quantity::Pressure], |place| {
            coefficient(place, KILOPASCAL, Plausible::UNKNOWN)
        })
    },
};

pub(super) const BIAS_MAGNETIC_FIELD: Effect = Effect {
    id: "bias_magnetic_field",
    formula: "k·B_j",
    sentence: "drifts with the magnetic field",
    needs: "field recorded or attitude known, and not constant",
    separated_by: "a coil at constant attitude",
    source: "IEEE Std 813, IEEE Std 952 (magnetic sensitivity)",
    in_flight: IS_NOT_TOLD,
    form: Form::MagneticField,
    acts_on: inertial,
    candidates: |effect, inputs| {
        const FIELDS: [Quantity; 3] =
            [Quantity::MagneticFieldX, Quantity::MagneticFieldY, Quantity::MagneticFieldZ];
        let amplitude = |place: &Place| coefficient(place, GAUSS, Plausible::gyro([0.005, 0.05]));
        let recorded = inputs.auxiliaries.iter().any(|auxiliary| FIELDS.contains(&auxiliary.quantity));
        if recorded {
            let mut candidates = of_quantity(effect, inputs, &FIELDS, amplitude);
            for candidate in &mut candidates {
                let column = candidate.variant.iter().find(|(name, _)| *name == "column");
                let axis = column
                    .and_then(|(_, column)| {
                        inputs.auxiliaries.iter().find(|auxiliary| auxiliary.column == *column)
                    })
                    .and_then(|auxiliary| FIELDS.iter().position(|&field| field == auxiliary.quantity));
                if let Some(name) = axis.and_then(|axis| ["x", "y", "z"].get(axis)) {
                    candidate.variant.push(("axis", (*name).to_owned()));
                }
            }
            return candidates;
        }
        let Some(field) = dipole_field(inputs) else { return Vec::new() };
        at_each_place(effect, inputs, |place| {
            if !gyros(place.kind) {
                return Vec::new();
            }
            (["x", "y", "z"].iter().zip(&field))
                .filter(|(_, values)| varies(values))
                .map(|(name, values)| {
                    Draft::linear(place, values.to_vec(), amplitude(place)).with("axis", *name)
                })
                .collect()
        })
    },
};

pub(super) const BIAS_PICKOFF_OFFSET: Effect = Effect {
    id: "bias_pickoff_offset",
    formula: "k·(pick-off angle)",
    sentence: "drifts with its pick-off angle",
    needs: "pick-off recorded and not constant",
    separated_by: "offset the pick-off electrically at rest",
    source: "IEEE Std 813; Hayakawa & Nibe (residual spring and damping of the tuned rotor)",
    in_flight: IS_NOT_TOLD,
    form: Form::Recorded,
    acts_on: tuned_gyros,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let pickoffs = near(inputs, place).filter(|auxiliary| is_pickoff(auxiliary));
            pickoffs
                .map(|auxiliary| {
                    let per = if auxiliary.unit == "rad" { MILLIRADIAN } else { ITSELF };
                    let mut amplitude = coefficient(place, per, Plausible::UNKNOWN);
                    name_unit(&mut amplitude, place, auxiliary, per);
                    centred(place, auxiliary, amplitude)
                })
                .collect()
        })
    },
};

pub(super) const VIBRATION_RECTIFICATION: Effect = Effect {
    id: "vibration_rectification",
    formula: "k·(vibration rms)²",
    sentence: "rectifies vibration",
    needs: "vibration recorded and not constant",
    separated_by: "shake at several levels along each axis",
    source: "IEEE Std 1293, vibration rectification; Honeywell, accelerometer glossary",
    in_flight: IS_NOT_TOLD,
    form: Form::RecordedSquare,
    acts_on: inertial,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            (near(inputs, place).filter(|auxiliary| auxiliary.quantity == Quantity::VibrationRms))
                .map(|auxiliary| {
                    let plausible = Plausible::inertial([0.01, 0.5], [1.0, 100.0]);
                    let values = product(&auxiliary.values, &auxiliary.values);
                    let amplitude = coefficient(place, G_SQUARED, plausible);
                    of_column(Draft::linear(place, values, amplitude), &auxiliary.column, auxiliary.smoothed)
                })
                .collect()
        })
    },
};

pub(super) const BIAS_ON_AUX: Effect = Effect {
    id: "bias_on_aux",
    formula: "k·(any other recorded quantity), at once or after a lag τ; on a sensor of kind other k·f of recorded quantities",
    sentence: "follows another recorded quantity",
    needs: "that quantity varies",
    separated_by: "vary that quantity alone",
    source: "none: a dependence found in the data, for a person to explain",
    in_flight: IS_NOT_TOLD,
    form: Form::Recorded,
    acts_on: any,
    candidates: |effect, inputs| {
        let lag = time_constant(inputs, 10.0, 3600.0);
        at_each_place(effect, inputs, |place| {
            let others = near(inputs, place).filter(|auxiliary| is_other(place, auxiliary));
            let mut quantities: Vec<(&str, &str, Series, bool)> = others
                .map(|it| (it.column.as_str(), it.unit.as_str(), it.values.clone(), it.smoothed))
                .collect();
            let thermometers = inputs.other_thermometers(place).into_iter();
            quantities.extend(
                (thermometers.filter(|it| it.varies()))
                    .map(|it| (it.column.as_str(), "K", it.temperature.clone(), false)),
            );
            let mut drafts = Vec::new();
            for (column, unit, values, smoothed) in quantities {
                let mut amplitude = coefficient(place, ITSELF, Plausible::UNKNOWN);
                amplitude.unit = per(place, unit);
                let middle = mean(&values);
                let at_once = map(&values, |value| value - middle);
                let rows = inputs.rows();
                let at_once = Draft::linear(place, at_once, amplitude.clone()).with_free_zero(place, rows);
                drafts.push(of_column(at_once, column, smoothed));
                // A lag makes readings smooth by itself.
                if let Some(tau) = lag.clone().filter(|_| !smoothed) {
                    let time_s = inputs.time_s.clone();
                    let late = Draft::grid(place, tau, amplitude, move |tau| {
                        map(&lagged(&time_s, &values, tau), |value| value - middle)
                    });
                    drafts.push(of_column(late.with_free_zero(place, rows), column, smoothed));
                }
            }
            drafts.extend(general::functions(inputs, place));
            drafts
        })
    },
};

/// The recorded quantities that vary and sit at the place, at its group, or nowhere in particular.
pub(super) fn near<'i>(inputs: &'i Inputs<'_>, place: &'i Place) -> impl Iterator<Item = &'i AuxiliaryInput> {
    let id = inputs.recording.sensors[place.sensor].sensor.id.as_str();
    let is_name = move |near: &str| near == id || near == place.name || place.group.as_deref() == Some(near);
    let is_sensors = move |near: &str| {
        (inputs.recording.sensors.iter())
            .any(|series| series.sensor.id == near || series.sensor.group.as_deref() == Some(near))
    };
    // What a sensor reads is no cause of it.
    let own = inputs.recording.sensors[place.sensor].sensor.column.as_str();
    inputs.auxiliaries.iter().filter(move |auxiliary| {
        auxiliary.column != own
            && auxiliary.varies
            && auxiliary.near.as_deref().is_none_or(|near| is_name(near) || !is_sensors(near))
    })
}

fn is_pickoff(auxiliary: &AuxiliaryInput) -> bool {
    auxiliary.quantity == Quantity::Other
        && (auxiliary.unit == "rad" || auxiliary.column.to_lowercase().contains("pick"))
}

/// Whether no other row of the catalogue knows what to do with a quantity at this place.
fn is_other(place: &Place, auxiliary: &AuxiliaryInput) -> bool {
    match auxiliary.quantity {
        Quantity::Current | Quantity::Speed => true,
        Quantity::Other => !(place.kind == SensorKind::Dtg && is_pickoff(auxiliary)),
        Quantity::Temperature | Quantity::Voltage | Quantity::Pressure => false,
        Quantity::MagneticFieldX
        | Quantity::MagneticFieldY
        | Quantity::MagneticFieldZ
        | Quantity::VibrationRms => !inertial(place.kind),
    }
}

/// `k·(x − x₀)` with every recorded quantity x of the given kinds, x₀ its mean.
fn of_quantity(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    quantities: &[Quantity],
    amplitude: impl Fn(&Place) -> Amplitude,
) -> Vec<Candidate> {
    at_each_place(effect, inputs, |place| {
        if inputs.is_loop() && place.port == Port::Output {
            return Vec::new();
        }
        (near(inputs, place).filter(|auxiliary| quantities.contains(&auxiliary.quantity)))
            .map(|auxiliary| centred(place, auxiliary, amplitude(place)))
            .collect()
    })
}

fn centred(place: &Place, auxiliary: &AuxiliaryInput, amplitude: Amplitude) -> Draft {
    let middle = mean(&auxiliary.values);
    let values = map(&auxiliary.values, |value| value - middle);
    let draft = Draft::linear(place, values, amplitude).with_free_zero(place, auxiliary.values.len());
    of_column(draft, &auxiliary.column, auxiliary.smoothed)
}

/// A dependence on a recorded column, as it is read or smoothed.
pub(super) fn of_column(draft: Draft, column: &str, smoothed: bool) -> Draft {
    let draft = draft.with("column", column);
    if smoothed { draft.with("readings", "smoothed") } else { draft }
}

/// Unit of a coefficient on a quantity whose unit is not one of the catalogue's.
pub(super) fn per(place: &Place, unit: &str) -> String {
    let name = place.unit.name();
    match unit {
        "" => name.to_owned(),
        unit if unit.contains('/') => format!("{name}/({unit})"),
        unit => format!("{name}/{unit}"),
    }
}

fn name_unit(amplitude: &mut Amplitude, place: &Place, auxiliary: &AuxiliaryInput, known: Per) {
    if known.0.is_empty() {
        amplitude.unit = per(place, &auxiliary.unit);
    }
}

/// The field of a dipole along the Earth's axis, in body axes: north B₀ cos φ, down 2 B₀ sin φ. Declination, and what
/// the vehicle adds, are not in it.
fn dipole_field(inputs: &Inputs<'_>) -> Option<[Series; 3]> {
    let latitude = inputs.recording.case.site?.latitude_deg.to_radians();
    let (north, down) = (inputs.motion.north.as_ref()?, inputs.motion.down.as_ref()?);
    let field = of_rows(inputs.rows(), |row| -> Vector3<f64> {
        EQUATORIAL_FIELD
            * (crate::inputs::motion::row_of(north, row) * latitude.cos()
                + crate::inputs::motion::row_of(down, row) * (2.0 * latitude.sin()))
    });
    Some(field)
}
