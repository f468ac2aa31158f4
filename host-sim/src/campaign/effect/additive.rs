//! Terms that are added, whatever the temperature.
use super::super::draw::Draw;
use super::super::setting::Kind;
use super::super::setting::Setting;
use super::Concealed;
use super::Family::Additive;
use super::Make;
use super::Rule;
use super::any;
use super::choose;
use super::earth::standing_unit;
use super::fault;
use super::input::of_one_input;
use super::named;
use super::parasite;
use super::readout_of;
use super::scale_of;
use super::unit_of;
use crate::physics::environment::Profile;
use crate::physics::fault::Fault;
use crate::physics::parasite::Disturbance;
use crate::scenario::QuantityEntry;
use schuler_recording::case::Quantity;

pub(super) fn bias_constant(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |id, make| match setting.kind {
        // A constant error of the loop's accelerometer is a tilt at the start.
        Kind::Channel => make == Make::Tuned,
        _ => make != Make::Velocity && !setting.relative(id),
    })?;
    let unit = unit_of(setting, &id);
    let start = 0.1 * scale_of(setting, &id) * draw.sign();
    let sensor = id.clone();
    let it = Concealed::new("bias_constant", Additive, &id, start, move |s, size| {
        if let Some(it) = readout_of(s, &sensor) {
            it.offset += size;
        }
    });
    let it = match setting.kind {
        Kind::Channel => it.same_on("accelerometer", "bias_drift_linear"),
        Kind::Bench => standing_unit(setting, it),
        Kind::Table | Kind::TunedTable | Kind::Drive => of_one_input(setting, make, it),
        _ => it,
    };
    let per = 1.0 / setting.unit(&id).in_si();
    Some(it.parameter("coefficient", unit, Rule::Sized(per)))
}

pub(super) fn onset(setting: &Setting, draw: &mut Draw) -> (f64, f64) {
    let end = setting.scenario.duration_s;
    (draw.between(0.15, 0.85) * end, end)
}

pub(super) fn bias_step(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |_, _| true)?;
    let (from, end) = onset(setting, draw);
    let name = named(setting, &id, make);
    let start = 0.1 * scale_of(setting, &id).max(1e-9) * draw.sign();
    let output = id.clone();
    let it = Concealed::new("bias_step", Additive, &name, start, move |s, size| {
        fault(s, &output, Fault::Step(size), from, f64::INFINITY);
    });
    let it = if setting.kind == Kind::Channel && make == Make::Tuned {
        it.same_on("accelerometer", "bias_drift_linear")
    } else {
        it
    };
    let per = 1.0 / setting.unit(&id).in_si();
    let unit = unit_of(setting, &id);
    let it = it.read_at(&id).during(from, end).parameter("coefficient", unit, Rule::Sized(per));
    Some(pair(setting, it).parameter("onset_s", "s", Rule::Instant(from)))
}

/// Of two sensors that are only compared with each other, either may be named.
pub(super) fn pair(setting: &Setting, it: Concealed) -> Concealed {
    if setting.kind != Kind::Radio {
        return it;
    }
    let other = if it.sensor == "ins" { "doppler" } else { "ins" };
    let effects: Vec<&'static str> =
        std::iter::once(it.effect).chain(it.same.iter().map(|(_, effect)| *effect)).collect();
    effects.into_iter().fold(it, |it, effect| it.same_on(other, effect))
}

pub(super) fn bias_drift_linear(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) = any(setting, draw)?;
    let (later, end) = onset(setting, draw);
    let from = if draw.chance(0.5) { 0.0 } else { later };
    let start = scale_of(setting, &id) / end * draw.sign();
    let output = id.clone();
    let it = Concealed::new("bias_drift_linear", Additive, &id, start, move |s, size| {
        fault(s, &output, Fault::Ramp(size), from, f64::INFINITY);
    });
    let it = match (setting.kind, make) {
        (Kind::Channel, Make::Accelerometer) if from == 0.0 => it.same_on("gyro", "bias_constant"),
        (Kind::Channel, Make::Accelerometer) => it.same_on("gyro", "bias_step"),
        _ => it,
    };
    let unit = setting.unit(&id);
    let it = it.parameter("coefficient", format!("{unit}/h"), Rule::Sized(3600.0 / unit.in_si()));
    if from > 0.0 {
        return Some(it.during(from, end).parameter("onset_s", "s", Rule::Instant(from)));
    }
    Some(it)
}

/// A box that warms from switch-on through one thermal resistance; no thermometer sits in it.
pub(super) fn bias_warmup(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let tau_s = draw.log_between((20.0 * step).max(duration / 60.0), duration / 4.0);
    let output = id.clone();
    let start = scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_warmup", Additive, &id, start, move |s, size| {
        let step = s.step_s;
        s.recorded.quantities.push(QuantityEntry {
            column: "box_power".to_owned(),
            quantity: Quantity::Other,
            unit: "1".to_owned(),
            near: None,
            profile: Profile {
                points: vec![(step, 0.0), (1.0001 * step, 1.0)],
                amplitude: 0.0,
                period_s: 1.0,
            },
            recorded: false,
        });
        let column = "box_power".to_owned();
        parasite(
            s,
            &output,
            Disturbance::Coupled { column, coefficient: -size, reference: 1.0, lag_s: tau_s },
        );
    });
    let it = it.parameter("tau_s", "s", Rule::Fixed(tau_s));
    let unit = setting.unit(&id);
    Some(it.parameter("coefficient", unit.name(), Rule::Sized((step / tau_s).exp() / unit.in_si())))
}

pub(super) fn bias_supply_voltage(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = setting.scenario.recorded.voltage.then(|| any(setting, draw))??;
    let output = id.clone();
    let start = scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("bias_supply_voltage", Additive, &id, start, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.offset_voltage = size;
        }
    });
    let unit = setting.unit(&id);
    let it = it.parameter("coefficient", format!("{unit}/V"), Rule::Sized(1.0 / unit.in_si()));
    Some(it.same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

pub(super) fn coupled(
    setting: &Setting,
    draw: &mut Draw,
    effect: &'static str,
    column: &str,
) -> Option<Concealed> {
    let entry = setting.scenario.recorded.quantities.iter().find(|q| q.column == column)?;
    let reference = entry.profile.points.first().map_or(0.0, |p| p.1);
    let spread = entry.profile.points.iter().map(|p| (p.1 - reference).abs()).fold(1e-9, f64::max);
    let (id, _) = any(setting, draw)?;
    let unit = setting.unit(&id);
    let output = id.clone();
    let start = 0.3 * scale_of(setting, &id) / spread * draw.sign();
    let (column, per) = (column.to_owned(), entry.unit.clone());
    let it = Concealed::new(effect, Additive, &id, start, move |s, size| {
        let column = column.clone();
        parasite(s, &output, Disturbance::Coupled { column, coefficient: size, reference, lag_s: 0.0 });
    });
    let it = it.parameter("coefficient", format!("{unit}/{per}"), Rule::Sized(1.0 / unit.in_si()));
    Some(it.same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

pub(super) fn bias_on_aux(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let column = draw.pick(["load_current", "humidity"]);
    coupled(setting, draw, "bias_on_aux", column)
}

pub(super) fn bias_magnetic_field(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let recorded = setting.scenario.recorded.magnetic_field;
    let (id, _) = recorded.then(|| choose(setting, draw, |_, make| make == Make::Tuned))??;
    let output = id.clone();
    Some(
        Concealed::new("bias_magnetic_field", Additive, &id, 1e-5 * draw.sign(), move |s, size| {
            if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
                it.design.magnetic_moment = size;
            }
        })
        .same(&["bias_on_aux"]),
    )
}

pub(super) fn bias_restart(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let runs = 3 + draw.index(3);
    let scale = scale_of(setting, &id);
    let mut times = vec![(0.0, 0.0)];
    let mut off = Vec::new();
    for k in 1..runs {
        let at = duration * (k as f64 + draw.between(-0.2, 0.2)) / runs as f64;
        let length = duration * draw.log_between(0.002, 0.02);
        off.push((at, length));
        times.push((at + length, draw.normal()));
    }
    let output = id.clone();
    let first = off.first().map_or(0.0, |(at, length)| at + length);
    let it = Concealed::new("bias_restart", Additive, &id, 0.3 * scale, move |s, size| {
        let values = times.iter().map(|(at, value)| (*at, size * value)).collect();
        parasite(s, &output, Disturbance::Switched(values));
        s.gaps.extend(off.iter().copied());
    });
    Some(it.same(&["bias_step"]).during(first, duration))
}

pub(super) fn periodic_line(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let f = draw.log_between(6.0 / duration, if setting.kind == Kind::Channel { 0.01 } else { 0.4 / step });
    let phase = draw.between(0.0, std::f64::consts::TAU);
    let output = id.clone();
    let it = Concealed::new("periodic_line", Additive, &id, 0.1 * scale_of(setting, &id), move |s, size| {
        let machine =
            Disturbance::Machine { amplitude: size, start_hz: f, end_hz: f, over_s: s.duration_s, phase };
        parasite(s, &output, machine);
    });
    let it = if setting.kind == Kind::Channel {
        // A line in either sensor is a line of another phase in the other.
        let other = if id == "gyro" { "accelerometer" } else { "gyro" };
        it.same_on(other, "periodic_line").same_on("velocity", "periodic_line")
    } else {
        it
    };
    Some(it.parameter("frequency_hz", "Hz", Rule::Fixed(f)))
}

pub(super) fn schuler_oscillation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    if setting.scenario.duration_s < 6000.0 {
        return None;
    }
    let it = Concealed::new("schuler_oscillation", Additive, "ins", 1e-5 * draw.sign(), |s, size| {
        if let Some(it) = &mut s.schuler_loop {
            it.tilt = size;
        }
    });
    Some(pair(setting, it.same(&["periodic_line"])))
}
