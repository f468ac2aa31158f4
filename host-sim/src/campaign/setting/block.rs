//! Five gyros on a cone in a motion that nobody records.
use nalgebra::Vector3;
use schuler_recording::unit::Unit;

use super::instruments::fog;
use super::noise::{noise, readout};
use super::surroundings::{gaps, surroundings};
use super::vehicle::legs;
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Motion, Sway, Vehicle};
use crate::scenario::Told;
use crate::scenario::instruments::CONE;

/// Draws the setting.
pub(super) fn block(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 0.1]);
    let n = rows(3000, most_rows, draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Block of five gyros", seed, duration, step_s, draw);
    scenario.parts = 2;
    let (speed, steps) = legs(duration, duration / 20.0, 2.0, 20.0, 0.3, draw);
    scenario.motion = Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-3.0, 3.0),
        bank_share: 0.0,
        sway: Sway { roll: 0.01, pitch: 0.01, period_s: 20.0 * step_s },
        level_platform: false,
        steps,
    });
    scenario.told = Told::Unknown;
    let (it, nominal) = noise(0.05, Unit::DegreePerHour.in_si(), duration, step_s, draw);
    let mut all = Vec::new();
    for (k, axis) in CONE.iter().enumerate() {
        let id = format!("gyro_{}", k + 1);
        scenario.fogs.push(fog(
            &id,
            Vector3::from(*axis),
            Unit::DegreePerHour,
            readout(&it, step_s),
            nominal.clone(),
        ));
        all.push((id, it.clone()));
    }
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Block, scenario, noise: all, channel: None }
}
