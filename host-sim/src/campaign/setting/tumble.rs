//! Tuned gyros and accelerometers in many attitudes, one after the other.
use nalgebra::Vector3;
use schuler_recording::unit::Unit;

use super::instruments::{accelerometer, gyro};
use super::noise::{noise, readout};
use super::surroundings::surroundings;
use super::table::random_axis;
use super::{Kind, Setting, UNIT, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Attitude, Motion, TableStep};
use crate::scenario::Told;

/// Draws the setting.
pub(super) fn tumble(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 10.0]);
    let n = rows(3000, most_rows.min(30_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Tumble test", seed, duration, step_s, draw);
    scenario.parts = 2;
    let mut steps = Vec::new();
    let mut time = 0.0;
    let positions = 12 + draw.index(20);
    for _ in 0..positions {
        let duration_s = duration / positions as f64 - 30.0 * step_s;
        steps.push(TableStep::Dwell { duration_s });
        time += duration_s;
        let angle = draw.pick([45.0f64, 90.0, 90.0, 135.0]).to_radians() * draw.sign();
        steps.push(TableStep::Turn { axis: random_axis(draw), angle, duration_s: 28.0 * step_s });
        // Nothing is recorded while it turns and settles.
        scenario.gaps.push((time - step_s, 31.0 * step_s));
        time += 28.0 * step_s;
        steps.push(TableStep::Dwell { duration_s: 2.0 * step_s });
        time += 2.0 * step_s;
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    scenario.recorded.attitude = draw.chance(0.5);
    let group = draw.chance(0.5).then(|| UNIT.to_owned());
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut all = Vec::new();
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("gyro_{letter}");
        let (it, nominal) = noise(0.02, Unit::DegreePerHour.in_si(), duration, step_s, draw);
        let output = readout(&it, step_s);
        let mut entry = gyro(&id, axes[k], axes[(k + 1) % 3], Unit::DegreePerHour, output, nominal);
        entry.group.clone_from(&group);
        scenario.gyros.push(entry);
        all.push((id, it));
    }
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate().take(draw.index(4)) {
        let id = format!("accelerometer_{letter}");
        let (it, nominal) = noise(8.0, Unit::MicroG.in_si(), duration, step_s, draw);
        let directions = [axes[k], axes[(k + 1) % 3]];
        let mut entry = accelerometer(&id, directions, Unit::MicroG, readout(&it, step_s), nominal);
        entry.group.clone_from(&group);
        scenario.accelerometers.push(entry);
        all.push((id, it));
    }
    scenario.environment.magnetic_field = Vector3::new(1.7e-5, 1e-6, 4.8e-5);
    scenario.recorded.magnetic_field = draw.chance(0.6);
    surroundings(&mut scenario, None, draw);
    Setting { kind: Kind::Tumble, scenario, noise: all, channel: None }
}
