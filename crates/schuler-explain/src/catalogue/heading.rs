//! A heading of the reference that is off by a constant.
use schuler_recording::case::MotionKind;
use schuler_recording::unit::Dimension;

use super::draft::{Draft, instruments, number, velocities};
use super::form::Form;
use super::in_flight::HAS_NO_TERM;
use super::{Column, Effect, Nonlinear, Port, Search, Signature};
use crate::inputs::Place;
use crate::inputs::motion::row_of;
use crate::inputs::series::Series;

/// Angles that are searched, degrees: less is how an instrument is mounted.
const LEAST_DEG: i32 = 5;
const APART_DEG: usize = 10;
const MOST_DEG: i32 = 185;

pub(super) const HEADING_OFF: Effect = Effect {
    id: "heading_off",
    formula: "C(ψ − α)ᵀv − C(ψ)ᵀv",
    sentence: "sees another heading than its reference, by a constant: that of the reference is off, or the instrument is turned by as much",
    needs: "a velocity beside a recorded attitude",
    separated_by: "compare the heading with the course made good along a straight line",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Values,
    acts_on: velocities,
    candidates: |effect, inputs| {
        let is_recorded = inputs.recording.case.motion.kind == MotionKind::Recorded;
        let (Some(velocity), Some(down)) = (&inputs.motion.velocity, &inputs.motion.down) else {
            return Vec::new();
        };
        if !is_recorded || inputs.motion.estimated {
            return Vec::new();
        }
        let is_moved = |it: &Place| it.dimension() == Dimension::Velocity && it.input.is_some();
        let found = instruments(effect, inputs, is_moved).into_iter().map(|instrument| {
            let axes: Vec<_> = instrument.places.iter().map(|it| (it.sensor, it.axes.input)).collect();
            let (velocity, down) = (velocity.clone(), down.clone());
            // Of one instrument the velocity turns about the vertical.
            let signature = move |parameters: &[f64]| {
                let angle = parameters.first().copied().unwrap_or_default().to_radians();
                let (sin, cos) = angle.sin_cos();
                let turned = |row: usize| {
                    let (v, d) = (row_of(&velocity, row), row_of(&down, row));
                    d.cross(&v) * sin + (v - d * d.dot(&v)) * (cos - 1.0)
                };
                let off: Vec<_> = (0..velocity[0].len()).map(turned).collect();
                let parts = axes.iter().map(|(sensor, axis)| {
                    let along: Vec<f64> = off.iter().map(|off| axis.dot(off)).collect();
                    (*sensor, Series::from(along))
                });
                Signature { columns: vec![Column::of(parts)] }
            };
            let angles = (LEAST_DEG..MOST_DEG).step_by(APART_DEG).map(f64::from);
            let grid = angles.clone().rev().map(|angle| -angle).chain(angles).collect();
            let parameters = vec![Nonlinear { name: "heading", unit: "deg", grid }];
            let search = Search::Grid { parameters, signature: Box::new(signature), unit_amplitude: true };
            let candidate = Draft::new(search, vec![number("part", "1", 1.0, None)]);
            candidate.of(effect, instrument.target, Port::Output)
        });
        found.collect()
    },
};
