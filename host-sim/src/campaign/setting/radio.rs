//! A Doppler log beside the velocity of an inertial system.
use nalgebra::Vector3;

use super::instruments::{doppler, still_loop};
use super::noise::{readout, round, velocity_noise};
use super::surroundings::gaps;
use super::vehicle::platform;
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::campaign::likelihood::Noise;
use crate::scenario::Told;

/// Draws the setting.
pub(super) fn radio(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = 1.0;
    let n = rows(1500, most_rows.min(30_000), draw);
    let duration = n as f64;
    let mut scenario = empty("Doppler log beside an inertial system", seed, duration, step_s, draw);
    scenario.parts = 5;
    scenario.motion = platform(duration, 90.0, 15.0, draw);
    scenario.told = Told::Unknown;
    let white = round(draw.log_between(0.01, 0.03));
    let mut ins = still_loop("ins", white);
    ins.absolute = true;
    scenario.schuler_loop = Some(ins);
    let (it, nominal) = velocity_noise(0.1, duration, step_s, draw);
    scenario.dopplers.push(doppler("doppler", Vector3::x(), readout(&it, step_s), nominal, None));
    gaps(&mut scenario, draw);
    let all = vec![("doppler".to_owned(), it), ("ins".to_owned(), Noise { white, ..Noise::default() })];
    Setting { kind: Kind::Radio, scenario, noise: all, channel: None }
}
