//! A Doppler log in a vehicle whose motion is known.
use nalgebra::Vector3;

use super::instruments::doppler;
use super::noise::{readout, velocity_noise};
use super::surroundings::gaps;
use super::vehicle::legs;
use super::{Kind, LOG, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::motion::{Motion, Sway, Vehicle};
use crate::scenario::Told;

/// Draws the setting.
pub(super) fn log(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 0.2]);
    let n = rows(1500, most_rows.min(20_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Doppler log", seed, duration, step_s, draw);
    scenario.parts = 5;
    let (speed, steps) = legs(duration, 60.0 * step_s.max(0.5), 0.5, 3.0, 1.0, draw);
    scenario.motion = Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-3.0, 3.0),
        bank_share: 0.0,
        sway: Sway {
            roll: draw.between(0.01, 0.06),
            pitch: draw.between(0.01, 0.04),
            period_s: draw.between(9.0, 20.0) * step_s.max(0.5),
        },
        level_platform: false,
        steps,
    });
    scenario.told = Told::Navigation;
    let mut all = Vec::new();
    for (letter, axis) in [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())] {
        let id = format!("log_{letter}");
        let (it, nominal) = velocity_noise(0.02, duration, step_s, draw);
        scenario.dopplers.push(doppler(&id, axis, readout(&it, step_s), nominal, Some(LOG)));
        all.push((id, it));
    }
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Log, scenario, noise: all, channel: None }
}
