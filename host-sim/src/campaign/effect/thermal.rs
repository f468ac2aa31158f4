//! Terms that temperature causes.
use super::super::draw::Draw;
use super::super::setting::ELECTRONICS;
use super::super::setting::FAR_THERMOMETER;
use super::super::setting::Kind;
use super::super::setting::Setting;
use super::super::setting::THERMOMETER;
use super::Concealed;
use super::Family::Thermal as Warm;
use super::Make;
use super::Rule;
use super::any;
use super::choose;
use super::of_each;
use super::parasite;
use super::readout_of;
use super::scale_of;
use super::temperature_at;
use crate::physics::environment::Thermal;
use crate::physics::heat::Lag;
use crate::physics::parasite::Disturbance;
use crate::scenario::Scenario;
use crate::simulation::Columns;

/// Whether temperature varies at all.
pub(super) fn warm(setting: &Setting) -> Option<()> {
    matches!(setting.scenario.environment.thermal, Thermal::Bar { .. }).then_some(())
}

pub(super) fn bias_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, make) = any(setting, draw)?;
    let output = id.clone();
    let start = 0.1 * scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_temperature", Warm, &id, start, move |s, size| match make {
        Make::Tuned => {
            if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
                it.design.reaction_torque_temperature[1] = size * it.design.calibration.norm();
            }
        }
        Make::Accelerometer => {
            if let Some(it) = s.accelerometers.iter_mut().find(|a| a.id == output) {
                it.design.hinge_torque_temperature = size * it.design.pendulum.pendulosity;
            }
        }
        _ => bridge(s, &output, size, 0.0, 0.0),
    });
    let it = it.slope(format!("{}/K", setting.unit(&id)), temperature_at(&id));
    // The loop tilts its platform until an accelerometer's error a is gone: a gyro's drift ȧ/g.
    let it = if setting.kind == Kind::Channel && make == Make::Accelerometer {
        it.same_on("gyro", "bias_temperature_rate")
    } else {
        it
    };
    Some(it.same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

pub(super) fn bridge(s: &mut Scenario, output: &str, first: f64, second: f64, third: f64) {
    parasite(s, output, Disturbance::Bridge { first, second, third, balanced: 20.0 });
}

/// Whether an output's rotor may be off tune: one that is held at other angles would show that as well.
fn may_be_detuned(setting: &Setting, id: &str) -> bool {
    setting.scenario.recorded.pickoff.as_deref() != Some(id)
}

pub(super) fn bias_temperature_sq(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, make) = choose(setting, draw, |id, make| make != Make::Velocity && may_be_detuned(setting, id))?;
    let output = id.clone();
    let start = 0.01 * scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_temperature_sq", Warm, &id, start, move |s, size| match make {
        // A pick-off whose null moves with temperature, on springs that temperature detunes.
        Make::Tuned => {
            if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
                it.design.stiffness_temperature = -2.4e-4;
                let detuning = 2.4e-4 * it.design.rotor.stiffness[0] / it.design.calibration.norm();
                it.design.pickoff_offset_temperature = [size / detuning; 2];
            }
        }
        _ => bridge(s, &output, 0.0, size, 0.0),
    });
    let square = of_each(temperature_at(&id), |t| (t - 20.0) * (t - 20.0));
    let it = it.slope(format!("{}/K^2", setting.unit(&id)), square);
    Some(it.tolerating(&["bias_constant", "bias_temperature"]))
}

pub(super) fn bias_temperature_cubic(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let output = id.clone();
    let start = 0.001 * scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_temperature_cubic", Warm, &id, start, move |s, size| {
        bridge(s, &output, 0.0, 0.0, size);
    });
    let cube = of_each(temperature_at(&id), |t| (t - 20.0).powi(3));
    let it = it.slope(format!("{}/K^3", setting.unit(&id)), cube);
    Some(it.tolerating(&["bias_constant", "bias_temperature", "bias_temperature_sq"]))
}

pub(super) fn rate_of(id: &str, step_s: f64) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    let temperature = temperature_at(id);
    move |truth| {
        let t = temperature(truth);
        (0..t.len()).map(|k| if k == 0 { 0.0 } else { (t[k] - t[k - 1]) / step_s }).collect()
    }
}

pub(super) fn gradient_driven(
    setting: &Setting,
    draw: &mut Draw,
    effect: &'static str,
    far: bool,
) -> Option<Concealed> {
    warm(setting)?;
    let (id, make) = choose(setting, draw, |_, make| {
        matches!(make, Make::Tuned | Make::Accelerometer) || (make == Make::Fibre && !far)
    })?;
    let output = id.clone();
    let scale = scale_of(setting, &id) * draw.sign();
    let start = if make == Make::Fibre { 1000.0 * scale } else { 0.1 * scale };
    let it = Concealed::new(effect, Warm, &id, start, move |s, size| match make {
        Make::Tuned => {
            // Not by pick-offs that the housing bends: a null that moves is a rate, and the gradient's rate would be most of it.
            if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
                it.design.reaction_torque_gradient[1] = size * it.design.calibration.norm();
            }
        }
        Make::Accelerometer => {
            if let Some(it) = s.accelerometers.iter_mut().find(|a| a.id == output) {
                it.design.hinge_torque_gradient = size * it.design.pendulum.pendulosity;
            }
        }
        _ => {
            if let Some(it) = s.fogs.iter_mut().find(|g| g.id == output) {
                it.design.midpoint = size;
            }
        }
    });
    Some(it)
}

pub(super) fn has_far(setting: &Setting) -> bool {
    setting.scenario.recorded.thermometers.iter().any(|t| t.column == FAR_THERMOMETER)
}

pub(super) fn bias_temperature_rate(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let far = has_far(setting);
    let it = gradient_driven(setting, draw, "bias_temperature_rate", false)?;
    let id = it.sensor.clone();
    let cause = rate_of(&id, setting.scenario.step_s);
    let it = it.slope(format!("{}/(K/h)", setting.unit(&id)), cause);
    let it = it.tolerating(&["bias_constant"]);
    let it = if setting.kind == Kind::Channel && id == "gyro" {
        it.same_on("accelerometer", "bias_temperature")
    } else {
        it
    };
    // With two thermometers the gradient that does it can be seen.
    Some(if far { it.same(&["bias_temperature_gradient"]) } else { it })
}

pub(super) fn bias_temperature_gradient(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    has_far(setting).then_some(())?;
    let it = gradient_driven(setting, draw, "bias_temperature_gradient", true)?;
    let (near, far) = (temperature_at(THERMOMETER), temperature_at(FAR_THERMOMETER));
    let place = |name: &str| {
        let thermometer = setting.scenario.recorded.thermometers.iter().find(|entry| entry.column == name)?;
        Some(thermometer.position_m)
    };
    let distance_m = place(FAR_THERMOMETER)? - place(THERMOMETER)?;
    let gradient = move |truth: &Columns| {
        far(truth).iter().zip(near(truth)).map(|(far, near)| (far - near) / distance_m).collect()
    };
    let unit = format!("{}/(K/m)", setting.unit(&it.sensor));
    let it = it.slope(unit, gradient);
    Some(it.same(&["bias_temperature_rate"]).tolerating(&["bias_constant"]))
}

pub(super) fn bias_thermal_lag(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = choose(setting, draw, |id, make| make == Make::Tuned && may_be_detuned(setting, id))?;
    let tau_s = setting.scenario.duration_s * draw.log_between(0.01, 0.08);
    let output = id.clone();
    let start = 0.1 * scale_of(setting, &id) * draw.sign();
    let step = setting.scenario.step_s;
    let it = Concealed::new("bias_thermal_lag", Warm, &id, start, move |s, size| {
        if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
            it.design.rotor_lag_s = tau_s;
            it.design.stiffness_temperature = -2.4e-4;
            let detuning = 2.4e-4 * it.design.rotor.stiffness[0] / it.design.calibration.norm();
            it.design.pickoff_offset = [size / detuning; 2];
        }
    });
    let temperature = temperature_at(&id);
    let lagged = move |truth: &Columns| {
        let t = temperature(truth);
        let mut lag = Lag::new(t.first().copied().unwrap_or_default());
        let mut before = lag.value();
        t.iter()
            .map(|now| {
                let value = lag.advance(step, tau_s, before, *now);
                before = *now;
                value
            })
            .collect()
    };
    let it = it.slope(format!("{}/K", setting.unit(&id)), lagged).parameter("tau_s", "s", Rule::Fixed(tau_s));
    Some(it.tolerating(&["bias_constant"]))
}

pub(super) fn bias_electronics_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let apart = setting.scenario.recorded.thermometers.iter().any(|t| t.column == ELECTRONICS);
    let (id, _) = apart.then(|| any(setting, draw))??;
    let output = id.clone();
    let start = 0.1 * scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_electronics_temperature", Warm, &id, start, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.offset_temperature = size;
        }
    });
    let unit = setting.unit(&id);
    let it = it.parameter("coefficient", format!("{unit}/K"), Rule::Sized(1.0 / unit.in_si()));
    Some(it.same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

pub(super) fn bias_thermal_hysteresis(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = any(setting, draw)?;
    let slip = draw.between(0.5, 2.0);
    let output = id.clone();
    let temperature = temperature_at(&id);
    let start = 0.3 * scale_of(setting, &id) * draw.sign();
    Some(
        Concealed::new("bias_thermal_hysteresis", Warm, &id, start, move |s, size| {
            parasite(s, &output, Disturbance::Joint { coefficient: size, slip });
        })
        .tolerating(&["bias_constant", "bias_temperature"])
        .needing(move |truth| both_branches(&temperature(truth), slip)),
    )
}

/// Whether a joint slips both ways: in a heating alone its strain is a function of the temperature, and no hysteresis.
fn both_branches(temperature: &[f64], slip: f64) -> bool {
    let (mut strain, mut slipped) = (0.0f64, [false; 2]);
    for pair in temperature.windows(2) {
        strain = (strain + pair[1] - pair[0]).clamp(-slip, slip);
        slipped = [slipped[0] || strain <= -slip, slipped[1] || strain >= slip];
    }
    slipped == [true, true]
}

#[cfg(test)]
mod tests {
    use super::both_branches;

    #[test]
    fn a_joint_shows_both_branches_only_when_the_temperature_turns() {
        let there = (0..50).map(|k| 20.0 + 0.2 * f64::from(k));
        let heating: Vec<f64> = there.clone().collect();
        let cycle: Vec<f64> = there.clone().chain(there.rev()).collect();
        assert!(!both_branches(&heating, 1.0));
        assert!(both_branches(&cycle, 1.0));
        assert!(!both_branches(&cycle, 6.0));
    }
}
