//! A strapdown unit in a vehicle.
use nalgebra::Vector3;

use super::instruments::strapdown;
use super::surroundings::{gaps, surroundings};
use super::vehicle::legs;
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Motion, Sway, Vehicle};
use crate::scenario::Told;

/// Draws the setting.
pub(super) fn drive(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([0.1, 0.1, 0.02, 1.0]);
    let n = rows(6000, most_rows.min(36_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Strapdown unit in a vehicle", seed, duration, step_s, draw);
    scenario.parts = 4;
    let (speed, steps) = legs(duration, (duration / 40.0).max(20.0 * step_s), 3.0, 30.0, 1.0, draw);
    scenario.motion = Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-3.0, 3.0),
        bank_share: 0.3,
        sway: Sway {
            roll: draw.between(0.002, 0.02),
            pitch: draw.between(0.002, 0.02),
            period_s: step_s.max(0.1) * draw.between(14.0, 40.0),
        },
        level_platform: false,
        steps,
    });
    scenario.told = Told::Recorded;
    let all = strapdown(&mut scenario, 20.0, 200.0, draw);
    surroundings(&mut scenario, None, draw);
    if draw.chance(0.6) {
        scenario.environment.vibration_direction = Vector3::new(draw.normal(), draw.normal(), draw.normal());
        scenario.environment.vibration_hz = draw.between(20.0, 60.0);
        let mut rms = draw.wander(1.5, 0.7, duration / 30.0, duration);
        rms.points.iter_mut().for_each(|(_, v)| *v = v.max(0.05));
        scenario.environment.vibration_rms = rms;
        scenario.recorded.vibration = true;
    }
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Drive, scenario, noise: all, channel: None }
}
