//! A strapdown unit on a rate table.
use nalgebra::{Unit as UnitVector, Vector3};

use super::instruments::strapdown;
use super::surroundings::{gaps, surroundings};
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Attitude, Motion, TableStep};
use crate::scenario::Told;

/// One of the three body axes.
pub(super) fn random_axis(draw: &mut Draw) -> UnitVector<Vector3<f64>> {
    draw.pick([Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()])
}

/// Draws the setting.
pub(super) fn table(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 0.1]);
    let n = rows(3000, most_rows.min(20_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Unit on a rate table", seed, duration, step_s, draw);
    scenario.parts = 4;
    let mut steps = Vec::new();
    let mut time = 0.0;
    let unit = duration / 40.0;
    // Always about one axis and at one frequency, slow enough for the rows to resolve it.
    let cones = draw.chance(0.3);
    let cone_hz = draw.between(0.06, 0.15) / step_s;
    while time < duration {
        let duration_s = unit * draw.between(0.5, 1.5);
        let which = draw.between(0.0, 1.0);
        let step = if cones && which < 0.1 {
            let amplitude = draw.log_between(0.15, 0.8).to_radians();
            TableStep::Cone {
                axis: Vector3::z_axis(),
                amplitude,
                frequency_hz: cone_hz,
                duration_s: duration_s.max(4.0 / cone_hz),
            }
        } else if which < 0.15 {
            TableStep::Dwell { duration_s }
        } else if which < 0.4 {
            let angle = draw.pick([45.0f64, 90.0, 90.0, 180.0]).to_radians() * draw.sign();
            TableStep::Turn {
                axis: random_axis(draw),
                angle,
                duration_s: duration_s.min(60.0 * step_s.max(0.3)),
            }
        } else if which < 0.8 {
            let rate = (draw.log_between(1.0, 60.0) * draw.sign()).to_radians();
            TableStep::Spin { axis: random_axis(draw), rate, duration_s, ramp_s: 0.2 * duration_s }
        } else {
            let frequency_hz = draw.log_between(0.03, 0.1) / step_s.max(0.3);
            let amplitude = draw.between(2.0, 20.0).to_radians();
            let duration_s = duration_s.max(3.0 / frequency_hz);
            TableStep::Swing { axis: random_axis(draw), amplitude, frequency_hz, duration_s }
        };
        time += step.duration_s();
        steps.push(step);
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    let all = strapdown(&mut scenario, 3.0, 50.0, draw);
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Table, scenario, noise: all, channel: None }
}
