//! Sensors at rest in changing temperature.
use nalgebra::Vector3;
use schuler_recording::unit::Unit;

use super::instruments::{accelerometer, fog, gyro, make_strapdown};
use super::noise::{noise, readout, round};
use super::surroundings::{gaps, surroundings};
use super::{Kind, Setting, UNIT, empty, rows};
use crate::campaign::draw::Draw;
use crate::physics::environment::Profile;
use crate::physics::motion::{Attitude, Motion};
use crate::physics::readout::Conversion;
use crate::scenario::Scenario;

/// Time after which a tuned gyro's loop has settled at another angle, s.
const SETTLED_S: f64 = 2.0;
/// Angles at which a pick-off test holds the rotor, rad.
const PICKOFF_RAD: f64 = 1e-5;

/// Draws the setting.
pub(super) fn bench(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 1.0, 1.0, 10.0, 0.1]);
    let least = if step_s < 1.0 { 6000 } else { 1200 };
    let n = rows(least, most_rows, draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Sensors on a bench", seed, duration, step_s, draw);
    let attitude = Attitude {
        roll: draw.between(-0.6, 0.6),
        pitch: draw.between(-0.6, 0.6),
        heading: draw.between(-3.0, 3.0),
    };
    scenario.motion = Motion::Static(attitude);
    let mut all = Vec::new();
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    // Three gyros and three accelerometers of one unit, each three alike; or sensors that have nothing to do with each other.
    let unit = draw.chance(0.3);
    let group = unit.then(|| UNIT.to_owned());
    let (gyros, accelerometers) = if unit { (3, 3) } else { (1 + draw.index(3), draw.index(3)) };
    let (gyro_noise, force_noise) = (
        |draw: &mut Draw| noise(0.02, Unit::DegreePerHour.in_si(), duration, step_s, draw),
        |draw: &mut Draw| noise(5.0, Unit::MicroG.in_si(), duration, step_s, draw),
    );
    let alike = unit.then(|| (gyro_noise(draw), force_noise(draw)));
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate().take(gyros) {
        let (it, mut nominal) = alike.as_ref().map_or_else(|| gyro_noise(draw), |it| it.0.clone());
        let relative = !unit && draw.chance(0.7);
        let offset = round(draw.between(-0.5, 0.5));
        nominal.bias = if relative { 0.0 } else { offset };
        let mut output = readout(&it, step_s);
        output.offset = offset * Unit::DegreePerHour.in_si();
        if draw.chance(0.3) {
            output.conversion = Conversion::Rounding(
                round(nominal.white * draw.log_between(0.1, 0.6)) * Unit::DegreePerHour.in_si(),
            );
        }
        let id = format!("gyro_{letter}");
        if draw.chance(0.5) {
            let mut entry = gyro(&id, axes[k], axes[(k + 2) % 3], Unit::DegreePerHour, output, nominal);
            entry.relative = relative;
            entry.group.clone_from(&group);
            scenario.gyros.push(entry);
        } else {
            let mut entry = fog(&id, axes[k], Unit::DegreePerHour, output, nominal);
            entry.relative = relative;
            entry.group.clone_from(&group);
            scenario.fogs.push(entry);
        }
        all.push((id, it));
    }
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate().take(accelerometers) {
        let (it, mut nominal) = alike.as_ref().map_or_else(|| force_noise(draw), |it| it.1.clone());
        let relative = !unit && draw.chance(0.7);
        let offset = round(draw.between(-60.0, 60.0));
        nominal.bias = if relative { 0.0 } else { offset };
        let mut output = readout(&it, step_s);
        output.offset = offset * Unit::MicroG.in_si();
        let id = format!("accelerometer_{letter}");
        let mut entry = accelerometer(&id, [axes[k], axes[(k + 1) % 3]], Unit::MicroG, output, nominal);
        entry.relative = relative;
        entry.group.clone_from(&group);
        scenario.accelerometers.push(entry);
        all.push((id, it));
    }
    surroundings(&mut scenario, Some("gyro_x"), draw);
    gaps(&mut scenario, draw);
    pickoff_test(&mut scenario, draw);
    // Quantised readings: the rounding's error is white where the noise is larger than the step's third, and known.
    for (id, it) in &mut all {
        let quantum = rounding(&scenario, id);
        it.white = it.white.hypot(quantum / 12f64.sqrt());
    }
    Setting { kind: Kind::Bench, scenario, noise: all, channel: None }
}

/// The first tuned gyro's loop is told to hold its rotor at one angle after the other; nothing is recorded while it moves there.
///
/// The rotor is one on which its gimbal's anisotropy pulls least, and the angles are so small that the Earth's rate about a spin axis
/// that is turned by them does not show.
fn pickoff_test(scenario: &mut Scenario, draw: &mut Draw) {
    let (duration, step) = (scenario.duration_s, scenario.step_s);
    let Some(gyro) = scenario.gyros.first_mut().filter(|_| draw.chance(0.5)) else { return };
    make_strapdown(gyro);
    let holds = 8 + draw.index(16);
    let row = |time_s: f64| (time_s / step).round() * step;
    let changes: Vec<f64> = (1..holds).map(|k| row(duration * f64::from(k as u32) / holds as f64)).collect();
    gyro.pickoff_command = [(); 2].map(|()| {
        let mut level = round(PICKOFF_RAD * draw.normal());
        let mut points = vec![(0.0, level)];
        for &change in &changes {
            points.push((change, level));
            level = round(PICKOFF_RAD * draw.normal());
            points.push((change + 0.5 * step, level));
        }
        Profile { points, amplitude: 0.0, period_s: 1.0 }
    });
    let settled = SETTLED_S.max(2.0 * step);
    scenario.gaps.extend(changes.iter().map(|change| (change + 0.5 * step, settled)));
    scenario.recorded.pickoff = Some(gyro.ids.0.clone());
}

/// Step of an output, SI units; zero for none.
fn rounding(scenario: &Scenario, id: &str) -> f64 {
    let dtg = scenario.gyros.iter().find(|g| g.ids.0 == id).map(|g| g.design.readout[0].conversion);
    let fog = scenario.fogs.iter().find(|g| g.id == id).map(|g| g.design.readout.conversion);
    match dtg.or(fog) {
        Some(Conversion::Rounding(step)) => step,
        _ => 0.0,
    }
}
