//! Tuned gyros for large rates on a rate table that moves slowly.
use nalgebra::{Unit as UnitVector, Vector3};
use schuler_recording::unit::Unit;

use super::instruments::{gyro, make_strapdown};
use super::noise::{noise, readout};
use super::surroundings::{gaps, surroundings};
use super::table::random_axis;
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Attitude, Motion, TableStep};
use crate::scenario::Told;

/// Three tuned gyros for large rates: rates about one axis and about two, ramps and swings slow enough for their loops.
pub(super) fn tuned_table(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = 1.0;
    let n = rows(4000, most_rows.min(8000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Tuned gyros on a rate table", seed, duration, step_s, draw);
    scenario.parts = 2;
    let mut steps = Vec::new();
    let mut time = 0.0;
    while time < duration {
        let duration_s = draw.between(200.0, 400.0);
        let which = draw.between(0.0, 1.0);
        let axis = if draw.chance(0.5) {
            random_axis(draw)
        } else {
            UnitVector::new_normalize(Vector3::new(draw.normal(), draw.normal(), draw.normal()))
        };
        let step = if which < 0.25 {
            TableStep::Dwell { duration_s }
        } else if which < 0.7 {
            let rate = (draw.log_between(2.0, 20.0) * draw.sign()).to_radians();
            TableStep::Spin { axis, rate, duration_s, ramp_s: 0.3 * duration_s }
        } else {
            let frequency_hz = 3.0 / duration_s;
            let amplitude = draw.between(10.0, 30.0).to_radians();
            TableStep::Swing { axis, amplitude, frequency_hz, duration_s }
        };
        time += step.duration_s();
        steps.push(step);
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut all = Vec::new();
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("gyro_{letter}");
        let (it, nominal) = noise(1.0, Unit::DegreePerHour.in_si(), duration, step_s, draw);
        let output = readout(&it, step_s);
        let mut entry = gyro(&id, axes[k], axes[(k + 1) % 3], Unit::DegreePerHour, output, nominal);
        make_strapdown(&mut entry);
        scenario.gyros.push(entry);
        all.push((id, it));
    }
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::TunedTable, scenario, noise: all, channel: None }
}
