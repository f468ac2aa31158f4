//! Terms with the input.
use super::super::draw::Draw;
use super::super::setting::Kind;
use super::super::setting::LOG;
use super::super::setting::Setting;
use super::super::setting::UNIT;
use super::Cause;
use super::Concealed;
use super::Family::Input;
use super::Make;
use super::Rule;
use super::additive::pair;
use super::along;
use super::any;
use super::choose;
use super::column;
use super::constant;
use super::of_each;
use super::outputs;
use super::parasite;
use super::product;
use super::temperature_at;
use super::thermal::warm;
use super::unit_of;
use crate::physics::motion::{Motion, TableStep};
use crate::physics::parasite::Disturbance;
use crate::scenario::ClockEntry;
use crate::scenario::Scenario;
use crate::simulation::Columns;
use nalgebra::Vector3;

pub(super) fn scale_factor(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let sign = draw.sign();
    if setting.kind == Kind::Log {
        let it = Concealed::new("scale_factor", Input, LOG, 1e-3 * sign, |s, size| {
            s.dopplers.iter_mut().for_each(|d| d.design.scale_factor = size);
        });
        return Some(it.read_at("log_x").parameter("coefficient", "ppm", Rule::Sized(1e6)));
    }
    let (id, make) = any(setting, draw)?;
    let output = id.clone();
    let it = Concealed::new("scale_factor", Input, &id, 1e-4 * sign, move |s, size| match make {
        Make::Fibre => s.fogs.iter_mut().filter(|g| g.id == output).for_each(|g| g.design.scale.gain = size),
        Make::Tuned => (s.gyros.iter_mut().filter(|g| g.ids.0 == output))
            .for_each(|g| g.design.torquer[0].gain = 1.0 / (1.0 + size) - 1.0),
        Make::Doppler => {
            s.dopplers.iter_mut().filter(|d| d.id == output).for_each(|d| d.design.scale_factor = size);
        }
        _ => (s.accelerometers.iter_mut().filter(|a| a.id == output))
            .for_each(|a| a.design.torquer.gain = 1.0 / (1.0 + size) - 1.0),
    });
    let it = pair(setting, it).parameter("coefficient", "ppm", Rule::Sized(1e6));
    Some(if setting.kind == Kind::Radio { it } else { of_one_input(setting, make, it) })
}

/// Names of a gain and of what bends it.
const CURVES: [&str; 5] = [
    "scale_factor",
    "scale_factor_asymmetry",
    "scale_factor_quadratic",
    "scale_factor_odd_quadratic",
    "scale_factor_cubic",
];

/// What an output of this name's curve has too much.
fn curve_of(id: &str, effect: &'static str) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + use<> {
    of_each(column(&format!("{id}.input")), move |u| match effect {
        "scale_factor" => u,
        "scale_factor_asymmetry" => u.abs(),
        "scale_factor_quadratic" => u * u,
        "scale_factor_odd_quadratic" => u * u.abs(),
        _ => u * u * u,
    })
}

/// Other names for a term of one output: another curve; where its input hardly varies, a bias; where the others of its make have
/// hardly any, the scale factor of them all.
pub(super) fn of_one_input(setting: &Setting, make: Make, it: Concealed) -> Concealed {
    let (id, effect) = (it.output.clone(), it.effect);
    let others = CURVES.into_iter().filter(|other| *other != effect);
    let it = others.fold(it, |it, other| {
        let columns: Vec<(String, Cause)> = vec![(id.clone(), Box::new(curve_of(&id, other)))];
        it.rival(&id, other, columns)
    });
    let it = if effect == "bias_constant" {
        it
    } else {
        it.rival(&id, "bias_constant", vec![(id.clone(), Box::new(constant))])
    };
    let alike = outputs(setting).into_iter().filter(|(_, other)| *other == make);
    let columns = alike.map(|(other, _)| -> (String, Cause) {
        let cause = curve_of(&other, "scale_factor");
        (other, Box::new(cause))
    });
    it.rival(UNIT, "scale_factor", columns.collect())
}

/// Curvature of a fibre gyro's loop or of an accelerometer's torquer.
pub(super) fn curve(setting: &Setting, draw: &mut Draw, effect: &'static str) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Accelerometer))?;
    let output = id.clone();
    let it = Concealed::new(effect, Input, &id, 1e-6 * draw.sign(), move |s, size| {
        let part = s.fogs.iter_mut().find(|g| g.id == output).map(|g| (&mut g.design.scale, 1.0));
        // A torquer's curve is seen through its inverse.
        let part = part.or_else(|| {
            s.accelerometers.iter_mut().find(|a| a.id == output).map(|a| (&mut a.design.torquer, -1.0))
        });
        if let Some((part, sign)) = part {
            match effect {
                "scale_factor_asymmetry" => part.asymmetry = sign * size,
                "scale_factor_quadratic" => part.quadratic = sign * size,
                "scale_factor_odd_quadratic" => part.odd_quadratic = sign * size,
                _ => part.cubic = sign * size,
            }
        }
    });
    let si = if make == Make::Fibre { "rad/s" } else { "m/s^2" };
    let unit = match effect {
        "scale_factor_asymmetry" => "ppm".to_owned(),
        "scale_factor_quadratic" | "scale_factor_odd_quadratic" => format!("({si})^-1"),
        _ => format!("({si})^-2"),
    };
    let it = it.slope(unit, curve_of(&id, effect)).tolerating(&["bias_constant", "scale_factor"]);
    Some(of_one_input(setting, make, it))
}

pub(super) fn scale_factor_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Accelerometer))?;
    let output = id.clone();
    let it = Concealed::new("scale_factor_temperature", Input, &id, 1e-6 * draw.sign(), move |s, size| {
        s.fogs.iter_mut().filter(|g| g.id == output).for_each(|g| g.design.scale_temperature = size);
        (s.accelerometers.iter_mut().filter(|a| a.id == output))
            .for_each(|a| a.design.torquer_temperature = -size);
    });
    let warm = of_each(temperature_at(&id), |t| t - 20.0);
    let it = it.slope("ppm/K", product(column(&format!("{id}.input")), warm));
    Some(it.tolerating(&["scale_factor"]))
}

/// The directions across an output's axis and its axis.
pub(super) fn across(setting: &Setting, id: &str) -> Option<[Vector3<f64>; 2]> {
    let s = &setting.scenario;
    let fog = s.fogs.iter().find(|g| g.id == id).map(|g| g.design.input_axis);
    let axis = fog
        .or(s.gyros.iter().find(|g| g.ids.0 == id).map(|g| g.design.input_axis))
        .or(s.accelerometers.iter().find(|a| a.id == id).map(|a| a.design.input_axis))
        .or(s.dopplers.iter().find(|d| d.id == id).map(|d| d.design.axis))?;
    Some([axis, if axis.x.abs() > 0.5 { Vector3::y() } else { Vector3::x() }])
}

pub(super) fn misalignment(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let size = 1e-5 * draw.sign();
    if setting.kind == Kind::Log {
        // The whole log is turned in its well.
        return Some(
            Concealed::new("misalignment", Input, LOG, 10.0 * size, |s, size| {
                s.dopplers.iter_mut().for_each(|d| d.design.misalignment = Vector3::z() * size);
            })
            .read_at("log_y"),
        );
    }
    if setting.kind != Kind::Tumble && draw.chance(0.3) {
        // The whole unit is turned on its mounting.
        let about = Vector3::new(draw.normal(), draw.normal(), draw.normal()).normalize();
        return Some(
            Concealed::new("misalignment", Input, UNIT, size, move |s, size| {
                s.fogs.iter_mut().for_each(|g| g.design.misalignment = about * size);
                for a in &mut s.accelerometers {
                    let d = &mut a.design;
                    d.misalignment = instrument_axes(&d.input_axis, &d.pendulum_axis) * about * size;
                }
            })
            .read_at("gyro_x"),
        );
    }
    let wanted = |make| match setting.kind {
        Kind::Tumble => make == Make::Accelerometer,
        _ => matches!(make, Make::Fibre | Make::Accelerometer),
    };
    let (id, make) = choose(setting, draw, |_, make| wanted(make))?;
    let [axis, other] = across(setting, &id)?;
    let about = axis.cross(&other);
    let output = id.clone();
    let it = Concealed::new("misalignment", Input, &id, size, move |s, size| {
        s.fogs.iter_mut().filter(|g| g.id == output).for_each(|g| g.design.misalignment = about * size);
        for a in s.accelerometers.iter_mut().filter(|a| a.id == output) {
            let d = &mut a.design;
            d.misalignment = instrument_axes(&d.input_axis, &d.pendulum_axis) * about * size;
        }
    });
    let letter = if make == Make::Accelerometer { 'f' } else { 'w' };
    let it = it.slope("rad", along(letter, other));
    Some(if make == Make::Fibre { it.same(&["rate_cross_axis"]) } else { it })
}

/// Rows: input, pendulum and hinge axis.
pub(super) fn instrument_axes(i: &Vector3<f64>, p: &Vector3<f64>) -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::from_rows(&[i.transpose(), p.transpose(), i.cross(p).transpose()])
}

pub(super) fn misalignment_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = choose(setting, draw, |_, make| make == Make::Fibre)?;
    let [axis, other] = across(setting, &id)?;
    let about = axis.cross(&other);
    let output = id.clone();
    let it = Concealed::new("misalignment_temperature", Input, &id, 1e-6 * draw.sign(), move |s, size| {
        (s.fogs.iter_mut().filter(|g| g.id == output))
            .for_each(|g| g.design.misalignment_temperature = about * size);
    });
    let warm = of_each(temperature_at(&id), |t| t - 20.0);
    Some(it.slope("rad/K", product(along('w', other), warm)).tolerating(&["misalignment", "rate_cross_axis"]))
}

pub(super) fn cross_coupling(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Accelerometer)?;
    let entry = setting.scenario.accelerometers.iter().find(|a| a.id == id)?;
    let (i, p) = (entry.design.input_axis, entry.design.pendulum_axis);
    let output = id.clone();
    let it = Concealed::new("cross_coupling", Input, &id, 1e-7, move |s, size| {
        for a in s.accelerometers.iter_mut().filter(|a| a.id == output) {
            // A loop that holds the pendulum less stiffly.
            let d = &mut a.design.pendulum;
            let stiffness = d.pendulosity / size.abs().max(1e-12);
            d.servo = (0.01 * stiffness).min(0.1);
            d.integrator = stiffness / d.servo - 1.0;
            d.integrator_rate = 400.0 / d.integrator;
        }
    });
    let it = it.slope("(m/s^2)^-1", product(along('f', i), along('f', p)));
    Some(it.curved().tolerating(&["scale_factor"]))
}

/// What accelerates a tuned gyro's rotor off its place.
pub(super) fn g_term(setting: &Setting, draw: &mut Draw, effect: &'static str) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Tuned)?;
    let entry = setting.scenario.gyros.iter().find(|g| g.ids.0 == id)?;
    let (i, s) = (entry.design.input_axis, entry.design.spin_axis);
    let o = s.cross(&i);
    let output = id.clone();
    let start = draw.sign()
        * match effect {
            "g_mass_unbalance" | "g_quadrature" | "g_spin" => 1e-10,
            "g_mass_unbalance_temperature" => 1e-11,
            _ => 1e-9,
        };
    let it = Concealed::new(effect, Input, &id, start, move |s, size| {
        let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) else { return };
        let d = &mut it.design;
        match effect {
            "g_mass_unbalance" => d.axial_unbalance = size,
            "g_quadrature" => d.flexure_twist = size,
            "g_spin" => d.axial_reaction = [0.0, size],
            "g_mass_unbalance_temperature" => d.axial_unbalance_temperature = size,
            "g2_anisoelasticity" => (d.compliance[(0, 0)], d.compliance[(1, 1)]) = (size, size),
            _ => (d.compliance[(0, 1)], d.compliance[(1, 0)]) = (size, size),
        }
    });
    let unit = if setting.kind == Kind::Channel { "rad/s".to_owned() } else { unit_of(setting, &id) };
    let warm = of_each(temperature_at(&id), |t| t - 20.0);
    let it = match effect {
        "g_mass_unbalance" => it.slope(format!("{unit}/g"), along('f', i)),
        "g_quadrature" => it.slope(format!("{unit}/g"), along('f', o)),
        "g_spin" => it.slope(format!("{unit}/g"), along('f', s)),
        "g_mass_unbalance_temperature" => {
            it.slope(format!("{unit}/g/K"), product(along('f', i), warm)).tolerating(&["g_mass_unbalance"])
        }
        "g2_anisoelasticity" => it.slope(format!("{unit}/g^2"), product(along('f', i), along('f', s))),
        _ => it.slope(format!("{unit}/g^2"), product(along('f', o), along('f', s))),
    };
    if setting.kind == Kind::Channel {
        // On a level platform only one axis feels the vehicle; which of the three the data cannot tell.
        return Some(it.same(&["g_quadrature", "g_spin"]));
    }
    Some(it)
}

pub(super) fn post_g_transient(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Accelerometer)?;
    let [direction, _] = across(setting, &id)?;
    let tau_s = setting.scenario.duration_s * draw.log_between(0.002, 0.03);
    let output = id.clone();
    let it = Concealed::new("post_g_transient", Input, &id, 1e-6 * draw.sign(), move |s, size| {
        parasite(s, &output, Disturbance::Creep { coefficient: size, tau_s, direction });
    });
    Some(
        it.parameter("coefficient", "1", Rule::Sized(1.0))
            .parameter("tau_s", "s", Rule::Fixed(tau_s))
            .tolerating(&["scale_factor"]),
    )
}

pub(super) fn vibration_rectification(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let recorded = setting.scenario.recorded.vibration;
    let (id, _) = recorded.then(|| choose(setting, draw, |_, make| make == Make::Accelerometer))??;
    let output = id.clone();
    let it = Concealed::new("vibration_rectification", Input, &id, 1e-6, move |s, size| {
        for a in s.accelerometers.iter_mut().filter(|a| a.id == output) {
            // A loop that is too slow to hold the pendulum against the vibration.
            let d = &mut a.design.pendulum;
            let held = d.servo * d.integrator;
            d.servo = d.pendulosity / size.abs().max(1e-12);
            d.integrator = (held / d.servo).min(1e7);
            d.integrator_rate = (400.0 / d.integrator).min(0.02);
        }
    });
    let rms = setting.scenario.environment.vibration_rms.clone();
    let cause = move |truth: &Columns| {
        truth.get("t").unwrap_or_default().iter().map(|t| rms.at(*t).powi(2)).collect()
    };
    Some(it.curved().slope("(m/s^2)^-1", cause).same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

pub(super) fn late(s: &mut Scenario, sensors: &[String], delay_s: f64, lag_s: f64) {
    s.clocks.push(ClockEntry { sensors: sensors.to_vec(), delay_s, lag_s });
}

#[expect(clippy::unnecessary_wraps, reason = "every entry's draw has one form")]
pub(super) fn time_delay(setting: &Setting, _draw: &mut Draw) -> Option<Concealed> {
    let start = 0.02 * setting.scenario.step_s;
    let it = match setting.kind {
        Kind::Log => Concealed::new("time_delay", Input, LOG, start, |s, size| {
            s.dopplers.iter_mut().for_each(|d| d.design.delay_s = size.abs());
        })
        .read_at("log_x"),
        Kind::Radio => pair(
            setting,
            Concealed::new("time_delay", Input, "doppler", start, |s, size| {
                s.dopplers.iter_mut().for_each(|d| d.design.delay_s = size.abs());
            }),
        ),
        Kind::Channel => Concealed::new("time_delay", Input, "velocity", start, |s, size| {
            if let Some(it) = &mut s.schuler_loop {
                it.delay_s = size.abs();
            }
        })
        .read_at("velocity_error"),
        _ => {
            let all: Vec<String> = outputs(setting).into_iter().map(|(id, _)| id).collect();
            Concealed::new("time_delay", Input, UNIT, start, move |s, size| late(s, &all, size.abs(), 0.0))
                .read_at("gyro_x")
        }
    };
    Some(it.curved().parameter("delay_s", "s", Rule::Sized(1.0)))
}

pub(super) fn bandwidth_lag(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Fibre)?;
    let output = vec![id.clone()];
    let start = 0.02 * setting.scenario.step_s;
    let it =
        Concealed::new("bandwidth_lag", Input, &id, start, move |s, size| late(s, &output, 0.0, size.abs()));
    Some(it.curved().parameter("tau_s", "s", Rule::Sized(1.0)))
}

#[expect(clippy::unnecessary_wraps, reason = "every entry's draw has one form")]
pub(super) fn lever_arm(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let direction = Vector3::new(draw.normal(), draw.normal(), draw.normal()).normalize();
    let it = if setting.kind == Kind::Log {
        Concealed::new("lever_arm", Input, LOG, 0.1, move |s, size| {
            s.dopplers.iter_mut().for_each(|d| d.design.arm = direction * size);
        })
        .read_at("log_y")
    } else {
        Concealed::new("lever_arm", Input, UNIT, 0.1, move |s, size| {
            s.accelerometers.iter_mut().for_each(|a| a.design.arm = direction * size);
        })
        .read_at("accelerometer_x")
    };
    Some(
        it.parameter("arm_x_m", "m", Rule::Sized(direction.x))
            .parameter("arm_y_m", "m", Rule::Sized(direction.y))
            .parameter("arm_z_m", "m", Rule::Sized(direction.z)),
    )
}

/// The unit's processor tells the turn of each step as a rotation vector; the simulation of it says mean rates.
pub(super) fn coning_sculling(setting: &Setting, _draw: &mut Draw) -> Option<Concealed> {
    let Motion::Table { steps, .. } = &setting.scenario.motion else { return None };
    // In long steps any turn that is not about one axis would show, the Earth's beside the table's.
    (setting.scenario.step_s < 0.5).then_some(())?;
    let mut start = 0.0;
    let mut cones = Vec::new();
    for step in steps {
        let end = start + step.duration_s();
        if matches!(step, TableStep::Cone { .. }) {
            cones.push((start, end));
        }
        start = end;
    }
    let mut it = Concealed::new("coning_sculling", Input, "gyro_z", 1.0, |s, _| {
        s.rotation_vectors = s.fogs.iter().map(|fog| fog.id.clone()).collect();
    });
    it.fixed = true;
    // Where the cones are as wide as each other, the mean is shifted or it is not.
    let shifted = move |truth: &Columns| {
        let inside = |t: f64| cones.iter().any(|(from, to)| t > *from && t <= *to);
        truth.get("t").unwrap_or_default().iter().map(|t| f64::from(u8::from(inside(*t)))).collect()
    };
    Some(it.rival("gyro_z", "intermittent_jump", vec![("gyro_z".to_owned(), Box::new(shifted))]))
}
