//! Terms of tuned gyros that large rates show, and one that a moved rotor shows.
use nalgebra::{Complex, Vector3};

use super::super::draw::Draw;
use super::super::setting::Setting;
use super::{Concealed, Family, Make, Rule, along, choose, column, product, unit_of};
use crate::physics::environment::Profile;
use crate::physics::gyro::GyroDesign;
use crate::physics::heat::Lag;
use crate::scenario::Scenario;
use crate::simulation::Columns;

/// Heating of a torquer's magnet: power per square of the rate, W/(rad/s)², and rise per power, K/W.
const TORQUER_POWER: f64 = 8.0;
const MAGNET_RESISTANCE: f64 = 5.0;

/// A tuned gyro, its other input axis and its spin axis.
fn tuned(setting: &Setting, draw: &mut Draw) -> Option<(String, Vector3<f64>, Vector3<f64>)> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Tuned)?;
    let design = &setting.scenario.gyros.iter().find(|g| g.ids.0 == id)?.design;
    Some((id, design.spin_axis.cross(&design.input_axis), design.spin_axis))
}

/// An effect that is a change of the gyro's design.
fn changed(
    effect: &'static str,
    family: Family,
    id: &str,
    start: f64,
    change: impl Fn(&mut GyroDesign, f64) + Send + Sync + 'static,
) -> Concealed {
    let gyro = id.to_owned();
    Concealed::new(effect, family, id, start, move |s: &mut Scenario, size| {
        s.gyros.iter_mut().filter(|g| g.ids.0 == gyro).for_each(|g| change(&mut g.design, size));
    })
}

/// The magnet's stray field pulls at the rotor the more, the warmer the coils have made it.
pub(super) fn torquer_self_heating(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, other, _) = tuned(setting, draw)?;
    let tau_s = draw.log_between(40.0, 600.0);
    let it = changed("torquer_self_heating", Family::Input, &id, 1e-9 * draw.sign(), move |d, size| {
        d.torquer_power = TORQUER_POWER;
        d.magnet_resistance = MAGNET_RESISTANCE;
        d.magnet_lag_s = tau_s;
        d.reaction_torque_rise[1] = size * d.calibration.norm();
    });
    let step_s = setting.scenario.step_s;
    let (own, across) = (column(&format!("{id}.input")), along('w', other));
    let heated = move |truth: &Columns| {
        let (mut lag, mut before) = (Lag::new(0.0), 0.0);
        let powers = own(truth).into_iter().zip(across(truth)).map(|(x, y)| x * x + y * y);
        powers
            .map(|power| {
                let value = lag.advance(step_s, tau_s, before, power);
                before = power;
                value
            })
            .collect()
    };
    let it = it.slope(format!("{}/(rad/s)^2", unit_of(setting, &id)), heated);
    Some(
        it.parameter("tau_s", "s", Rule::Fixed(tau_s))
            .tolerating(&["bias_constant", "scale_factor_quadratic"]),
    )
}

/// A rotor of another equatorial inertia than its polar one asks for; tuned and calibrated as every other.
pub(super) fn anisoinertia(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _, spin) = tuned(setting, draw)?;
    let it = changed("anisoinertia", Family::Input, &id, 1e-3 * draw.sign(), |d, size| {
        d.rotor.rotor_equatorial *= 1.0 + size;
        d.trim();
    });
    let cause = product(column(&format!("{id}.input")), along('w', spin));
    Some(it.slope(format!("{}/(rad/s)^2", unit_of(setting, &id)), cause))
}

/// A network that is set for another rotor.
pub(super) fn angular_acceleration(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, other, _) = tuned(setting, draw)?;
    let it = changed("angular_acceleration", Family::Input, &id, 1e-5 * draw.sign(), |d, size| {
        d.network += Complex::new(0.0, size);
    });
    let step_s = setting.scenario.step_s;
    let rate = along('w', other);
    let cause = move |truth: &Columns| {
        let rate = rate(truth);
        let at = |k: usize| rate.get(k).copied().unwrap_or_default();
        let last = rate.len().saturating_sub(1);
        (0..rate.len())
            .map(|k| {
                let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
                (at(b) - at(a)) / ((b - a).max(1) as f64 * step_s)
            })
            .collect()
    };
    Some(it.slope("s", cause))
}

/// Torquer coils that are turned about the spin axis.
pub(super) fn rate_cross_axis(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, other, _) = tuned(setting, draw)?;
    let it = changed("rate_cross_axis", Family::Input, &id, 1e-5 * draw.sign(), |d, size| {
        d.rebalance.phase = size;
        d.calibration *= Complex::from_polar(1.0, size);
    });
    // The case turned about the spin axis does the same.
    Some(it.slope("ppm", along('w', other)).same(&["misalignment"]))
}

/// A rotor a little off tune, or flexures that damp, while the rotor is held at other angles.
pub(super) fn bias_pickoff_offset(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let id = setting.scenario.recorded.pickoff.clone()?;
    let [x, y] = setting.scenario.gyros.iter().find(|g| g.ids.0 == id)?.pickoff_command.clone();
    let (it, command) = if draw.chance(0.7) {
        let sign = draw.sign();
        let it = changed("bias_pickoff_offset", Family::Additive, &id, 1e-6 * sign, |d, size| {
            d.rotor.stiffness = d.rotor.stiffness.map(|k| k * (1.0 + size));
        });
        (it, y)
    } else {
        let it = changed("bias_pickoff_offset", Family::Additive, &id, 1e-10, |d, size| {
            d.rotor.flexure_damping = [size; 2];
        });
        (it, x)
    };
    let it = it.slope(format!("{}/mrad", unit_of(setting, &id)), held_at(command));
    Some(it.tolerating(&["bias_constant"]))
}

fn held_at(command: Profile) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    move |truth| truth.get("t").unwrap_or_default().iter().map(|t| command.at(*t)).collect()
}
