//! Terms of the Earth as it is against the Earth that a simulation assumes.
use nalgebra::Vector3;

use super::super::draw::Draw;
use super::super::setting::{Kind, Setting, UNIT};
use super::{Cause, Concealed, Family, Rule, along, constant};
use crate::physics::motion::{Attitude, Motion};
use crate::scenario::{Believed, Scenario};
use crate::simulation::Columns;

/// What stands in the scenario stays what its user believes, whatever is changed afterwards.
fn believed(s: &mut Scenario) {
    if s.believed.is_none() {
        s.believed = Some(Believed { site: s.site, motion: s.motion.clone() });
    }
}

/// Whether the gyros and accelerometers belong to one unit.
fn is_unit(setting: &Setting) -> bool {
    let s = &setting.scenario;
    let gyros = s.gyros.iter().map(|g| &g.group).chain(s.fogs.iter().map(|g| &g.group));
    gyros.chain(s.accelerometers.iter().map(|a| &a.group)).all(Option::is_some)
}

/// Ids and input axes of the gyros.
fn gyros(setting: &Setting) -> Vec<(String, Vector3<f64>)> {
    let s = &setting.scenario;
    let tuned = s.gyros.iter().map(|g| (g.ids.0.clone(), g.design.input_axis));
    tuned.chain(s.fogs.iter().map(|g| (g.id.clone(), g.design.input_axis))).collect()
}

/// Ids and input axes of the accelerometers.
fn accelerometers(setting: &Setting) -> Vec<(String, Vector3<f64>)> {
    setting.scenario.accelerometers.iter().map(|a| (a.id.clone(), a.design.input_axis)).collect()
}

/// Component along a body axis of a direction in north-east-down axes.
fn component(direction: Vector3<f64>, axis: Vector3<f64>) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync {
    move |truth| {
        let angle = |name| truth.get(name).unwrap_or_default();
        let rows = angle("roll").iter().zip(angle("pitch")).zip(angle("heading"));
        rows.map(|((&roll, &pitch), &heading)| {
            let attitude = Attitude { roll, pitch, heading }.to_navigation();
            (attitude * axis).dot(&direction)
        })
        .collect()
    }
}

/// What a wrong heading and a wrong latitude change in the Earth's rate: directions in north-east-down axes.
fn directions(setting: &Setting) -> [Vector3<f64>; 2] {
    let (sine, cosine) = setting.scenario.site.latitude.sin_cos();
    [Vector3::y(), Vector3::new(sine, 0.0, cosine)]
}

/// A bias of one of the sensors of a unit that stands still is what these make of it, where the others hardly feel them.
pub(super) fn standing_unit(setting: &Setting, it: Concealed) -> Concealed {
    let columns = |sensors: &[(String, Vector3<f64>)], direction: Vector3<f64>| -> Vec<(String, Cause)> {
        let of = |axis: &Vector3<f64>| -> Cause { Box::new(component(direction, *axis)) };
        sensors.iter().map(|(id, axis)| (id.clone(), of(axis))).collect()
    };
    let forces = accelerometers(setting);
    if forces.iter().any(|(id, _)| *id == it.sensor) {
        return if is_unit(setting) {
            it.rival(UNIT, "gravity_anomaly", columns(&forces, Vector3::z()))
        } else {
            it.same(&["gravity_anomaly"])
        };
    }
    if !is_unit(setting) {
        return it.same(&["earth_rate_attitude"]);
    }
    let gyros = gyros(setting);
    directions(setting)
        .into_iter()
        .fold(it, |it, direction| it.rival(UNIT, "earth_rate_attitude", columns(&gyros, direction)))
}

/// The unit stands, or turns from a start, at another heading or latitude than told.
pub(super) fn earth_rate_attitude(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let s = &setting.scenario;
    let known = setting.kind == Kind::Bench || s.recorded.attitude;
    (known && is_unit(setting)).then_some(())?;
    let start = 1e-4 * draw.sign();
    // Another latitude is another gravity too, which accelerometers would feel.
    let it = if s.accelerometers.is_empty() && draw.chance(0.5) {
        Concealed::new("earth_rate_attitude", Family::Input, UNIT, start, |s, size| {
            believed(s);
            s.site.latitude += size;
        })
        .parameter("latitude_deg", "deg", Rule::Sized(1f64.to_degrees()))
    } else {
        Concealed::new("earth_rate_attitude", Family::Input, UNIT, start, |s, size| {
            believed(s);
            if let Motion::Static(attitude) | Motion::Table { start: attitude, .. } = &mut s.motion {
                attitude.heading += size;
            }
        })
        .parameter("heading_deg", "deg", Rule::Sized(1f64.to_degrees()))
    };
    let it = gyros(setting).into_iter().fold(it, |it, (id, _)| {
        let columns: Vec<(String, Cause)> = vec![(id.clone(), Box::new(constant))];
        it.rival(&id, "bias_constant", columns)
    });
    Some(it.read_at("gyro_x"))
}

/// Gravity that is not the normal gravity of the model.
pub(super) fn gravity_anomaly(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let forces = accelerometers(setting);
    let shown: Vec<_> = forces.iter().filter(|(id, _)| !setting.relative(id)).collect();
    let turned = setting.kind == Kind::Tumble;
    (!turned || setting.scenario.recorded.attitude).then_some(())?;
    let sensor = match shown.as_slice() {
        [] => return None,
        _ if is_unit(setting) => UNIT,
        [(id, _)] if !turned || forces.len() == 1 => id,
        _ => return None,
    };
    let it = Concealed::new("gravity_anomaly", Family::Input, sensor, 1e-5 * draw.sign(), |s, size| {
        believed(s);
        s.site.gravity_anomaly += size;
    });
    let it = it.parameter("coefficient", "mGal", Rule::Sized(1e5)).read_at(&shown[0].0);
    // At rest the specific force is gravity alone, and a larger one is a larger scale factor.
    let name = if turned { "scale_factor" } else { "bias_constant" };
    let it = if turned || sensor != UNIT { it.same(&[name]) } else { it };
    Some(shown.iter().fold(it, |it, (id, axis)| {
        let cause: Cause = if turned { Box::new(along('f', *axis)) } else { Box::new(constant) };
        it.rival(id, name, vec![(id.clone(), cause)])
    }))
}
