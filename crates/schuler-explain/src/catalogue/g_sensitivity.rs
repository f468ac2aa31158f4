//! Drift of a gyro with specific force and its products: mass unbalance, quadrature, anisoelasticity.
//!
//! i = input axis, s = spin axis, o = s × i ([`crate::inputs::Axes`]). Of any gyro: an optical one has no mass to be unbalanced, but a coil or a
//! path that the force strains.
use super::draft::{Draft, G, G_SQUARED, Plausible, at_each_place, coefficient, gyros};
use super::form::Form;
use super::in_flight::{GyroAxis, InFlight, Part};
use super::{Candidate, Effect};
use crate::inputs::series::{product, varies};
use crate::inputs::{Axes, Inputs};
use nalgebra::Vector3;

const IEEE_813: &str = "IEEE Std 813 (model equation of the dynamically tuned gyro); Hayakawa & Nibe";
const TUMBLE: &str = "a tumble: the axis up, down and level in eight positions at constant temperature";
const LIU_FAN: &str = "Liu & Fan 1983 (g² terms of the tuned gyro); IEEE Std 813";
const TUMBLE_45: &str =
    "positions at 45° between the axes: products differ there from what the forces alone give";

/// A row on one component of the specific force.
macro_rules! on_force {
    ($name:ident, $id:literal, $formula:literal, $sentence:literal, $axis:expr, $of:expr, $plausible:expr) => {
        pub(super) const $name: Effect = Effect {
            id: $id,
            formula: $formula,
            sentence: $sentence,
            needs: "attitude or acceleration varies",
            separated_by: TUMBLE,
            source: IEEE_813,
            in_flight: InFlight::Term([Part::Force($of), Part::One]),
            form: Form::Term,
            acts_on: gyros,
            candidates: |effect, inputs| on_force(effect, inputs, $axis, Plausible::gyro($plausible)),
        };
    };
}

on_force!(
    G_MASS_UNBALANCE,
    "g_mass_unbalance",
    "k·f_i",
    "drifts with the specific force along its input axis",
    |axes| axes.input,
    GyroAxis::Input,
    [0.05, 5.0]
);
on_force!(
    G_QUADRATURE,
    "g_quadrature",
    "k·f_o",
    "drifts with the specific force along its other input axis",
    |axes| axes.other,
    GyroAxis::Other,
    [0.02, 0.5]
);
on_force!(
    G_SPIN,
    "g_spin",
    "k·f_s",
    "drifts with the specific force along its spin axis",
    |axes| axes.spin,
    GyroAxis::Spin,
    [0.01, 0.2]
);

pub(super) const G2_ANISOELASTICITY: Effect = Effect {
    id: "g2_anisoelasticity",
    formula: "k·f_i·f_s",
    sentence: "drifts with the product of the specific forces along its input and spin axes",
    needs: "the product varies apart from the forces",
    separated_by: TUMBLE_45,
    source: LIU_FAN,
    in_flight: InFlight::Term([Part::Force(GyroAxis::Input), Part::Force(GyroAxis::Spin)]),
    form: Form::Term,
    acts_on: gyros,
    candidates: |effect, inputs| {
        on_product(effect, inputs, &[(None, |axes| axes.input, |axes| axes.spin)], [0.01, 0.1])
    },
};

pub(super) const G2_CROSS: Effect = Effect {
    id: "g2_cross",
    formula: "k·f_i·f_o or k·f_o·f_s",
    sentence: "drifts with a product of specific forces across its input axis",
    needs: "the product varies apart from the forces: attitudes at 45°",
    separated_by: TUMBLE_45,
    source: LIU_FAN,
    in_flight: InFlight::ByAxis(&[
        ("input-other", [Part::Force(GyroAxis::Input), Part::Force(GyroAxis::Other)]),
        ("other-spin", [Part::Force(GyroAxis::Other), Part::Force(GyroAxis::Spin)]),
    ]),
    form: Form::Term,
    acts_on: gyros,
    candidates: |effect, inputs| {
        let products: [Product; 2] = [
            (Some("input-other"), |axes| axes.input, |axes| axes.other),
            (Some("other-spin"), |axes| axes.other, |axes| axes.spin),
        ];
        on_product(effect, inputs, &products, [0.001, 0.05])
    },
};

type Axis = fn(&Axes) -> Vector3<f64>;
/// Name of a product of forces along two axes.
type Product = (Option<&'static str>, Axis, Axis);

fn on_force(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    axis: Axis,
    plausible: Plausible,
) -> Vec<Candidate> {
    at_each_place(effect, inputs, |place| {
        let force = inputs.force_along(&axis(&place.axes)).filter(|force| varies(force));
        (force.into_iter())
            .map(|force| Draft::linear(place, force, coefficient(place, G, plausible)))
            .collect()
    })
}

fn on_product(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    products: &[Product],
    plausible: [f64; 2],
) -> Vec<Candidate> {
    at_each_place(effect, inputs, |place| {
        let drafts = products.iter().filter_map(|(name, left, right)| {
            let left = inputs.force_along(&left(&place.axes))?;
            let right = inputs.force_along(&right(&place.axes))?;
            let values = product(&left, &right);
            if !varies(&values) {
                return None;
            }
            let draft =
                Draft::linear(place, values, coefficient(place, G_SQUARED, Plausible::gyro(plausible)));
            Some(match name {
                Some(name) => draft.with("axis", *name),
                None => draft,
            })
        });
        drafts.collect()
    })
}
