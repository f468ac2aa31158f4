//! What can be concealed: each effect as the part of an instrument, of its surroundings or of its conversion that causes it.
//!
//! An effect has a size, in its cause's own unit, and a way to put it into a scenario. What it does to the outputs is
//! whatever the simulated physics makes of that; no formula of it stands here. Identifiers are those by which answers are
//! scored; those that begin with `outside_` are in no catalogue.
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::draw::Draw;
use super::likelihood::Noise;
use super::setting::{ELECTRONICS, FAR_THERMOMETER, Kind, LOG, Setting, UNIT};
use crate::physics::environment::{Profile, Thermal};
use crate::physics::fault::{Fault, TimedFault};
use crate::physics::heat::Lag;
use crate::physics::parasite::Disturbance;
use crate::physics::random::Process;
use crate::physics::readout::{Conversion, ReadoutDesign};
use crate::scenario::{ClockEntry, FaultEntry, ParasiteEntry, QuantityEntry, Scenario};
use crate::simulation::Columns;
use schuler_recording::case::Quantity;

/// Families by which results are reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, PartialOrd, Ord)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// A term that is added, whatever the temperature.
    Additive,
    /// A term that temperature causes.
    Thermal,
    /// A term with the input.
    Input,
    /// Structure of the noise.
    Noise,
    /// A failure.
    Failure,
    /// In no catalogue.
    Outside,
    /// Nothing is concealed.
    Nothing,
}

/// How the true value of a parameter follows.
pub enum Rule {
    /// As many times the size.
    Sized(f64),
    /// A value of its own.
    Fixed(f64),
    /// The slope of the effect's exact signal over its true cause, in SI units.
    Slope(Box<dyn Fn(&Columns) -> Vec<f64> + Send + Sync>),
}

/// A parameter: its name, its unit and how its value follows.
pub struct Parameter {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: String,
    /// Rule.
    pub rule: Rule,
}

type Inject = Box<dyn Fn(&mut Scenario, f64) + Send + Sync>;

/// How an effect changes the noise of an output.
pub struct NoiseChange {
    /// Noise with an effect of this size.
    pub with: Box<dyn Fn(&Noise, f64) -> Noise + Send + Sync>,
    /// Whether noise of the nominal structure could swallow it, so that the null model is to be fitted anew.
    pub refit: bool,
}

/// A concealed effect whose size is open.
pub struct Concealed {
    /// Identifier.
    pub effect: &'static str,
    /// Family.
    pub family: Family,
    /// Sensor or group that has it.
    pub sensor: String,
    /// Other pairs of sensor and effect that are physically the same.
    pub same: Vec<(String, &'static str)>,
    /// Pairs that are not wrong beside it.
    pub tolerated: Vec<(String, &'static str)>,
    /// When it acts, for an effect that is local in time, s.
    pub interval_s: Option<[f64; 2]>,
    /// Output from which a slope is read.
    pub output: String,
    /// Size to begin the search with.
    pub start: f64,
    /// Whether the exact signal is proportional to the size.
    pub linear: bool,
    /// Whether what it does depends on the noise.
    pub with_noise: bool,
    /// Puts it into a scenario.
    pub inject: Inject,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// What it does to the noise.
    pub noise: Option<NoiseChange>,
}

impl Concealed {
    fn new(
        effect: &'static str,
        family: Family,
        sensor: &str,
        start: f64,
        inject: impl Fn(&mut Scenario, f64) + Send + Sync + 'static,
    ) -> Self {
        Self {
            effect,
            family,
            sensor: sensor.to_owned(),
            same: vec![],
            tolerated: vec![],
            interval_s: None,
            output: sensor.to_owned(),
            start,
            linear: true,
            with_noise: false,
            inject: Box::new(inject),
            parameters: vec![],
            noise: None,
        }
    }

    fn same(mut self, effects: &[&'static str]) -> Self {
        self.same.extend(effects.iter().map(|effect| (self.sensor.clone(), *effect)));
        self
    }

    fn same_on(mut self, sensor: &str, effect: &'static str) -> Self {
        self.same.push((sensor.to_owned(), effect));
        self
    }

    fn tolerating(mut self, effects: &[&'static str]) -> Self {
        self.tolerated.extend(effects.iter().map(|effect| (self.sensor.clone(), *effect)));
        self
    }

    fn during(mut self, from_s: f64, to_s: f64) -> Self {
        self.interval_s = Some([from_s, to_s]);
        self
    }

    fn read_at(mut self, output: &str) -> Self {
        output.clone_into(&mut self.output);
        self
    }

    fn curved(mut self) -> Self {
        self.linear = false;
        self
    }

    fn parameter(mut self, name: &'static str, unit: impl Into<String>, rule: Rule) -> Self {
        self.parameters.push(Parameter { name, unit: unit.into(), rule });
        self
    }

    fn slope(
        self,
        unit: impl Into<String>,
        cause: impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static,
    ) -> Self {
        self.parameter("coefficient", unit, Rule::Slope(Box::new(cause)))
    }

    fn noise(mut self, refit: bool, with: impl Fn(&Noise, f64) -> Noise + Send + Sync + 'static) -> Self {
        self.noise = Some(NoiseChange { with: Box::new(with), refit });
        self.linear = false;
        self
    }
}

/// An effect that can be drawn.
pub struct Entry {
    /// Identifier.
    pub effect: &'static str,
    /// Family.
    pub family: Family,
    /// Settings in which it can be seen.
    pub kinds: &'static [Kind],
    /// Draws where and how; none if this setting lacks what it needs.
    pub draw: fn(&Setting, &mut Draw) -> Option<Concealed>,
}

use Family::{Additive, Failure, Input, Noise as Structure, Outside, Thermal as Warm};
use Kind::{Bench, Block, Channel, Drive, Log, Radio, Table, Tumble};

const STILL: &[Kind] = &[Bench];
const WARM: &[Kind] = &[Bench, Block, Channel, Table, Tumble];
const TURNED: &[Kind] = &[Table, Drive];

macro_rules! entries {
    ($($effect:literal $family:ident $kinds:expr => $draw:expr;)*) => {
        /// Every effect.
        pub const EFFECTS: &[Entry] = &[$(Entry { effect: $effect, family: $family, kinds: $kinds, draw: $draw }),*];
    };
}

entries! {
    "bias_constant" Additive &[Bench, Table, Drive, Block, Channel] => bias_constant;
    "bias_step" Additive &[Bench, Table, Drive, Log, Block, Radio, Channel] => bias_step;
    "bias_drift_linear" Additive &[Bench, Block, Channel, Table] => bias_drift_linear;
    "bias_warmup" Additive &[Bench, Block, Table] => bias_warmup;
    "bias_supply_voltage" Additive &[Bench, Table, Drive] => bias_supply_voltage;
    "bias_pressure" Additive &[Bench, Block, Table] => |s, d| coupled(s, d, "bias_pressure", "pressure");
    "bias_on_aux" Additive &[Bench, Block, Table, Drive] => bias_on_aux;
    "bias_magnetic_field" Additive &[Tumble] => bias_magnetic_field;
    "bias_restart" Additive &[Bench, Block] => bias_restart;
    "periodic_line" Additive &[Bench, Block, Table, Channel] => periodic_line;
    "schuler_oscillation" Additive &[Radio] => schuler_oscillation;
    "bias_temperature" Warm WARM => bias_temperature;
    "bias_temperature_sq" Warm WARM => bias_temperature_sq;
    "bias_temperature_cubic" Warm STILL => bias_temperature_cubic;
    "bias_temperature_rate" Warm WARM => bias_temperature_rate;
    "bias_thermal_lag" Warm &[Bench, Tumble] => bias_thermal_lag;
    "bias_temperature_gradient" Warm &[Bench, Tumble] => bias_temperature_gradient;
    "bias_electronics_temperature" Warm &[Bench, Block, Table] => bias_electronics_temperature;
    "bias_thermal_hysteresis" Warm STILL => bias_thermal_hysteresis;
    "scale_factor" Input &[Table, Drive, Log, Radio] => scale_factor;
    "scale_factor_asymmetry" Input TURNED => |s, d| curve(s, d, "scale_factor_asymmetry");
    "scale_factor_quadratic" Input TURNED => |s, d| curve(s, d, "scale_factor_quadratic");
    "scale_factor_cubic" Input TURNED => |s, d| curve(s, d, "scale_factor_cubic");
    "scale_factor_temperature" Input &[Table, Tumble] => scale_factor_temperature;
    "misalignment" Input &[Table, Drive, Tumble, Log] => misalignment;
    "misalignment_temperature" Input &[Table] => misalignment_temperature;
    "cross_coupling" Input &[Table, Tumble] => cross_coupling;
    "g_mass_unbalance" Input &[Tumble, Channel] => |s, d| g_term(s, d, "g_mass_unbalance");
    "g_quadrature" Input &[Tumble] => |s, d| g_term(s, d, "g_quadrature");
    "g_spin" Input &[Tumble] => |s, d| g_term(s, d, "g_spin");
    "g2_anisoelasticity" Input &[Tumble] => |s, d| g_term(s, d, "g2_anisoelasticity");
    "g2_cross" Input &[Tumble] => |s, d| g_term(s, d, "g2_cross");
    "g_mass_unbalance_temperature" Input &[Tumble] => |s, d| g_term(s, d, "g_mass_unbalance_temperature");
    "post_g_transient" Input &[Table, Tumble, Drive] => post_g_transient;
    "vibration_rectification" Input &[Drive] => vibration_rectification;
    "time_delay" Input &[Table, Drive, Log, Radio, Channel] => time_delay;
    "bandwidth_lag" Input TURNED => bandwidth_lag;
    "lever_arm" Input &[Table, Drive, Log] => lever_arm;
    "noise_white" Structure &[Bench, Table, Drive, Log] => noise_white;
    "noise_markov" Structure &[Bench, Table, Log] => noise_markov;
    "noise_exp_cos" Structure &[Bench, Table] => noise_exp_cos;
    "noise_random_walk" Structure &[Bench, Table] => noise_random_walk;
    "noise_flicker" Structure STILL => noise_flicker;
    "noise_angle_quantisation" Structure &[Bench, Table] => noise_angle_quantisation;
    "noise_variance_step" Structure &[Bench, Table, Log] => noise_variance_step;
    "noise_outliers" Structure &[Bench, Table, Log, Radio, Channel] => noise_outliers;
    "output_stuck" Failure &[Table, Drive, Log, Block] => output_stuck;
    "output_saturated" Failure TURNED => output_saturated;
    "dead_zone" Failure &[Drive, Log] => dead_zone;
    "quantisation" Failure &[Bench, Table, Log] => quantisation;
    "intermittent_jump" Failure &[Radio, Log, Bench] => intermittent_jump;
    "outside_bilinear" Outside &[Bench, Block] => outside_bilinear;
    "outside_chirp" Outside &[Bench, Block, Table] => outside_chirp;
    "outside_popcorn" Outside &[Bench, Log] => outside_popcorn;
    "outside_telegraph" Outside &[Bench, Block] => outside_telegraph;
}

/// What an output is, for choosing among them.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Make {
    Tuned,
    Fibre,
    Accelerometer,
    Doppler,
    Velocity,
}

fn outputs(setting: &Setting) -> Vec<(String, Make)> {
    let s = &setting.scenario;
    let mut all: Vec<(String, Make)> = s.gyros.iter().map(|g| (g.ids.0.clone(), Make::Tuned)).collect();
    all.extend(s.fogs.iter().map(|g| (g.id.clone(), Make::Fibre)));
    all.extend(s.accelerometers.iter().map(|a| (a.id.clone(), Make::Accelerometer)));
    all.extend(s.dopplers.iter().map(|d| (d.id.clone(), Make::Doppler)));
    all.extend(s.schuler_loop.as_ref().map(|l| (l.id.clone(), Make::Velocity)));
    all
}

fn choose(setting: &Setting, draw: &mut Draw, fits: impl Fn(&str, Make) -> bool) -> Option<(String, Make)> {
    let fitting: Vec<_> = outputs(setting).into_iter().filter(|(id, make)| fits(id, *make)).collect();
    fitting.get(draw.index(fitting.len())).cloned()
}

/// Any output but the velocity of a loop.
fn any(setting: &Setting, draw: &mut Draw) -> Option<(String, Make)> {
    choose(setting, draw, |_, make| make != Make::Velocity)
}

/// The name by which answers call an output.
fn named(setting: &Setting, id: &str, make: Make) -> String {
    if setting.kind == Kind::Channel && make == Make::Velocity {
        "velocity".to_owned()
    } else {
        id.to_owned()
    }
}

/// The read-out of an output.
fn readout_of<'s>(scenario: &'s mut Scenario, id: &str) -> Option<&'s mut ReadoutDesign> {
    if let Some(it) = scenario.gyros.iter_mut().find(|g| g.ids.0 == id) {
        return it.design.readout.first_mut();
    }
    if let Some(it) = scenario.fogs.iter_mut().find(|g| g.id == id) {
        return Some(&mut it.design.readout);
    }
    if let Some(it) = scenario.accelerometers.iter_mut().find(|a| a.id == id) {
        return Some(&mut it.design.readout);
    }
    scenario.dopplers.iter_mut().find(|d| d.id == id).map(|it| &mut it.design.readout)
}

fn fault(scenario: &mut Scenario, sensor: &str, fault: Fault, onset_s: f64, end_s: f64) {
    let fault = TimedFault { fault, onset_s, end_s };
    scenario.faults.push(FaultEntry { sensor: sensor.to_owned(), fault });
}

fn parasite(scenario: &mut Scenario, sensor: &str, disturbance: Disturbance) {
    scenario.parasites.push(ParasiteEntry { sensor: sensor.to_owned(), disturbance });
}

/// The unit of an output in which people give its parameters.
fn unit_of(setting: &Setting, id: &str) -> String {
    setting.unit(id).name().to_owned()
}

/// Typical size of an output's noise over the record, SI units.
fn scale_of(setting: &Setting, id: &str) -> f64 {
    let noise = match (&setting.channel, id) {
        (Some(channel), "gyro") => channel.gyro.clone(),
        (Some(channel), "accelerometer") => channel.accelerometer.clone(),
        _ => setting.noise_of(id),
    };
    let drift = noise.drift.iter().map(|p| match *p {
        Process::Markov { sigma, .. } | Process::ExponentialCosine { sigma, .. } => sigma,
        Process::RandomWalk { .. } | Process::Flicker { .. } => 0.0,
    });
    noise.white.max(drift.fold(0.0, f64::max))
}

fn temperature_at(id: &str) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    let column = format!("{id}.temperature");
    move |truth| truth.get(&column).unwrap_or_default().to_vec()
}

fn column(name: &str) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    let name = name.to_owned();
    move |truth| truth.get(&name).unwrap_or_default().to_vec()
}

fn product(
    a: impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static,
    b: impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static,
) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    move |truth| a(truth).iter().zip(b(truth)).map(|(x, y)| x * y).collect()
}

fn of_each(
    cause: impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static,
    map: impl Fn(f64) -> f64 + Send + Sync + 'static,
) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    move |truth| cause(truth).into_iter().map(&map).collect()
}

/// Component of the true rate (`w`) or specific force (`f`) along a direction in the body.
fn along(letter: char, direction: Vector3<f64>) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    move |truth| {
        let part = |axis: char| truth.get(&format!("{letter}{axis}")).unwrap_or_default();
        let rows = part('x').iter().zip(part('y')).zip(part('z'));
        rows.map(|((x, y), z)| direction.dot(&Vector3::new(*x, *y, *z))).collect()
    }
}

// ---------------------------------------------------------------- additive

fn bias_constant(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
        Kind::Bench if make == Make::Accelerometer => it.same(&["gravity_anomaly"]),
        Kind::Bench => it.same(&["earth_rate_attitude"]),
        _ => it,
    };
    let per = 1.0 / setting.unit(&id).in_si();
    Some(it.parameter("coefficient", unit, Rule::Sized(per)))
}

fn onset(setting: &Setting, draw: &mut Draw) -> (f64, f64) {
    let end = setting.scenario.duration_s;
    (draw.between(0.15, 0.85) * end, end)
}

fn bias_step(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
    Some(pair(setting, it).parameter("onset_s", "s", Rule::Fixed(from)))
}

/// Of two sensors that are only compared with each other, either may be named.
fn pair(setting: &Setting, it: Concealed) -> Concealed {
    if setting.kind != Kind::Radio {
        return it;
    }
    let other = if it.sensor == "ins" { "doppler" } else { "ins" };
    let effects: Vec<&'static str> =
        std::iter::once(it.effect).chain(it.same.iter().map(|(_, effect)| *effect)).collect();
    effects.into_iter().fold(it, |it, effect| it.same_on(other, effect))
}

fn bias_drift_linear(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
        return Some(it.during(from, end).parameter("onset_s", "s", Rule::Fixed(from)));
    }
    Some(it)
}

/// A box that warms from switch-on through one thermal resistance; no thermometer sits in it.
fn bias_warmup(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn bias_supply_voltage(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn coupled(setting: &Setting, draw: &mut Draw, effect: &'static str, column: &str) -> Option<Concealed> {
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

fn bias_on_aux(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let column = draw.pick(["load_current", "humidity"]);
    coupled(setting, draw, "bias_on_aux", column)
}

fn bias_magnetic_field(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn bias_restart(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn periodic_line(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn schuler_oscillation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

// ---------------------------------------------------------------- thermal

/// Whether temperature varies at all.
fn warm(setting: &Setting) -> Option<()> {
    matches!(setting.scenario.environment.thermal, Thermal::Bar { .. }).then_some(())
}

fn bias_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
    Some(it.same(&["bias_on_aux"]).tolerating(&["bias_constant"]))
}

fn bridge(s: &mut Scenario, output: &str, first: f64, second: f64, third: f64) {
    parasite(s, output, Disturbance::Bridge { first, second, third, balanced: 20.0 });
}

fn bias_temperature_sq(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, make) = any(setting, draw)?;
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

fn bias_temperature_cubic(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn rate_of(id: &str, step_s: f64) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + 'static {
    let temperature = temperature_at(id);
    move |truth| {
        let t = temperature(truth);
        (0..t.len()).map(|k| if k == 0 { 0.0 } else { (t[k] - t[k - 1]) / step_s }).collect()
    }
}

fn gradient_driven(setting: &Setting, draw: &mut Draw, effect: &'static str, far: bool) -> Option<Concealed> {
    warm(setting)?;
    let (id, make) = choose(setting, draw, |_, make| {
        matches!(make, Make::Tuned | Make::Accelerometer) || (make == Make::Fibre && !far)
    })?;
    let output = id.clone();
    let scale = scale_of(setting, &id) * draw.sign();
    let start = if make == Make::Fibre { 1000.0 * scale } else { 0.1 * scale };
    let it = Concealed::new(effect, Warm, &id, start, move |s, size| match make {
        Make::Tuned => {
            if let Some(it) = s.gyros.iter_mut().find(|g| g.ids.0 == output) {
                // Pick-offs that the housing bends, on springs a little off tune.
                it.design.rotor.stiffness = it.design.rotor.stiffness.map(|k| k * (1.0 + 4e-4));
                let detuning = 4e-4 * it.design.rotor.stiffness[0] / it.design.calibration.norm();
                it.design.pickoff_offset_gradient = [size / detuning; 2];
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

fn has_far(setting: &Setting) -> bool {
    setting.scenario.recorded.thermometers.iter().any(|t| t.column == FAR_THERMOMETER)
}

fn bias_temperature_rate(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let far = has_far(setting);
    let it = gradient_driven(setting, draw, "bias_temperature_rate", false)?;
    let id = it.sensor.clone();
    let cause = rate_of(&id, setting.scenario.step_s);
    let it = it.slope(format!("{}/(K/h)", setting.unit(&id)), cause);
    let it = it.tolerating(&["bias_constant"]);
    // With two thermometers the gradient that does it can be seen.
    Some(if far { it.same(&["bias_temperature_gradient"]) } else { it })
}

fn bias_temperature_gradient(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    has_far(setting).then_some(())?;
    let it = gradient_driven(setting, draw, "bias_temperature_gradient", true)?;
    Some(it.same(&["bias_temperature_rate"]).tolerating(&["bias_constant"]))
}

fn bias_thermal_lag(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = choose(setting, draw, |_, make| make == Make::Tuned)?;
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

fn bias_electronics_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn bias_thermal_hysteresis(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    warm(setting)?;
    let (id, _) = any(setting, draw)?;
    let slip = draw.between(0.5, 2.0);
    let output = id.clone();
    let start = 0.3 * scale_of(setting, &id) * draw.sign();
    Some(
        Concealed::new("bias_thermal_hysteresis", Warm, &id, start, move |s, size| {
            parasite(s, &output, Disturbance::Joint { coefficient: size, slip });
        })
        .tolerating(&["bias_constant", "bias_temperature"]),
    )
}

// ---------------------------------------------------------------- with the input

fn scale_factor(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
        Make::Doppler => {
            s.dopplers.iter_mut().filter(|d| d.id == output).for_each(|d| d.design.scale_factor = size);
        }
        _ => (s.accelerometers.iter_mut().filter(|a| a.id == output))
            .for_each(|a| a.design.torquer.gain = 1.0 / (1.0 + size) - 1.0),
    });
    Some(pair(setting, it).parameter("coefficient", "ppm", Rule::Sized(1e6)))
}

/// Curvature of a fibre gyro's loop or of an accelerometer's torquer.
fn curve(setting: &Setting, draw: &mut Draw, effect: &'static str) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Accelerometer))?;
    let output = id.clone();
    let power = match effect {
        "scale_factor_asymmetry" => 1,
        "scale_factor_quadratic" => 2,
        _ => 3,
    };
    let it = Concealed::new(effect, Input, &id, 1e-6 * draw.sign(), move |s, size| {
        let part = s.fogs.iter_mut().find(|g| g.id == output).map(|g| (&mut g.design.scale, 1.0));
        // A torquer's curve is seen through its inverse.
        let part = part.or_else(|| {
            s.accelerometers.iter_mut().find(|a| a.id == output).map(|a| (&mut a.design.torquer, -1.0))
        });
        if let Some((part, sign)) = part {
            match power {
                1 => part.asymmetry = sign * size,
                2 => part.quadratic = sign * size,
                _ => part.cubic = sign * size,
            }
        }
    });
    let si = if make == Make::Fibre { "rad/s" } else { "m/s^2" };
    let unit = match power {
        1 => "ppm".to_owned(),
        2 => format!("({si})^-1"),
        _ => format!("({si})^-2"),
    };
    let cause = of_each(column(&format!("{id}.input")), move |u| match power {
        1 => u.abs(),
        2 => u * u,
        _ => u * u * u,
    });
    Some(it.slope(unit, cause).tolerating(&["bias_constant", "scale_factor"]))
}

fn scale_factor_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
fn across(setting: &Setting, id: &str) -> Option<[Vector3<f64>; 2]> {
    let s = &setting.scenario;
    let fog = s.fogs.iter().find(|g| g.id == id).map(|g| g.design.input_axis);
    let axis = fog
        .or(s.gyros.iter().find(|g| g.ids.0 == id).map(|g| g.design.input_axis))
        .or(s.accelerometers.iter().find(|a| a.id == id).map(|a| a.design.input_axis))
        .or(s.dopplers.iter().find(|d| d.id == id).map(|d| d.design.axis))?;
    Some([axis, if axis.x.abs() > 0.5 { Vector3::y() } else { Vector3::x() }])
}

fn misalignment(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
fn instrument_axes(i: &Vector3<f64>, p: &Vector3<f64>) -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::from_rows(&[i.transpose(), p.transpose(), i.cross(p).transpose()])
}

fn misalignment_temperature(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn cross_coupling(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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
fn g_term(setting: &Setting, draw: &mut Draw, effect: &'static str) -> Option<Concealed> {
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

fn post_g_transient(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn vibration_rectification(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

fn late(s: &mut Scenario, sensors: &[String], delay_s: f64, lag_s: f64) {
    s.clocks.push(ClockEntry { sensors: sensors.to_vec(), delay_s, lag_s });
}

fn time_delay(setting: &Setting, _draw: &mut Draw) -> Option<Concealed> {
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

fn bandwidth_lag(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| make == Make::Fibre)?;
    let output = vec![id.clone()];
    let start = 0.02 * setting.scenario.step_s;
    let it =
        Concealed::new("bandwidth_lag", Input, &id, start, move |s, size| late(s, &output, 0.0, size.abs()));
    Some(it.curved().parameter("tau_s", "s", Rule::Sized(1.0)))
}

fn lever_arm(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
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

// ---------------------------------------------------------------- noise

fn noise_white(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let output = id.clone();
    let it = Concealed::new("noise_white", Structure, &id, 0.05, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.white *= 1.0 + size.abs();
        }
    });
    Some(it.noise(false, |noise, size| Noise { white: noise.white * (1.0 + size.abs()), ..noise.clone() }))
}

/// A drift more.
fn drifting(
    setting: &Setting,
    draw: &mut Draw,
    effect: &'static str,
    process: impl Fn(f64) -> Process + Send + Sync + Clone + 'static,
) -> Option<Concealed> {
    // Where the noise of the nominal model is white, nothing can swallow the drift.
    let (id, _) =
        choose(setting, draw, |id, make| make != Make::Velocity && setting.noise_of(id).drift.len() <= 1)?;
    let output = id.clone();
    let start = 0.3 * setting.noise_of(&id).white;
    let more = process.clone();
    let it = Concealed::new(effect, Structure, &id, start, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.drift.push(more(size.abs()));
        }
    });
    Some(it.noise(true, move |noise, size| {
        let mut noise = noise.clone();
        noise.drift.push(process(size.abs()));
        noise
    }))
}

fn noise_markov(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let tau_s = draw.log_between(5.0 * step, duration / 20.0);
    let it = drifting(setting, draw, "noise_markov", move |sigma| Process::Markov { sigma, tau_s })?;
    let per = 1.0 / setting.unit(&it.sensor).in_si();
    let unit = unit_of(setting, &it.sensor);
    Some(it.parameter("tau_s", "s", Rule::Fixed(tau_s)).parameter("sigma", unit, Rule::Sized(per)))
}

fn noise_exp_cos(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let beta = std::f64::consts::TAU / draw.log_between(15.0 * step, duration / 25.0);
    let alpha = beta / draw.log_between(3.0, 15.0);
    let it = drifting(setting, draw, "noise_exp_cos", move |sigma| Process::ExponentialCosine {
        sigma,
        alpha,
        beta,
    })?;
    let per = 1.0 / setting.unit(&it.sensor).in_si();
    let unit = unit_of(setting, &it.sensor);
    Some(
        it.parameter("alpha", "1/s", Rule::Fixed(alpha))
            .parameter("beta", "rad/s", Rule::Fixed(beta))
            .parameter("sigma", unit, Rule::Sized(per)),
    )
}

fn noise_random_walk(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let duration = setting.scenario.duration_s;
    drifting(setting, draw, "noise_random_walk", move |size| Process::RandomWalk {
        rate: size / (0.1 * duration).sqrt(),
    })
}

fn noise_flicker(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (shortest_s, longest_s) = (4.0 * setting.scenario.step_s, setting.scenario.duration_s);
    drifting(setting, draw, "noise_flicker", move |instability| Process::Flicker {
        instability,
        shortest_s,
        longest_s,
    })
}

fn noise_angle_quantisation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let rounded = |id: &str| {
        let s = &setting.scenario;
        s.gyros.iter().any(|g| g.ids.0 == id && g.design.readout[0].conversion != Conversion::Exact)
            || s.fogs.iter().any(|g| g.id == id && g.design.readout.conversion != Conversion::Exact)
    };
    let (id, _) = choose(setting, draw, |id, make| make != Make::Velocity && !rounded(id))?;
    let step = setting.scenario.step_s;
    let output = id.clone();
    let it = Concealed::new(
        "noise_angle_quantisation",
        Structure,
        &id,
        setting.noise_of(&id).white * step,
        move |s, size| {
            if let Some(it) = readout_of(s, &output) {
                it.conversion = Conversion::Pulses(size.abs());
            }
        },
    );
    Some(it.noise(false, move |noise, size| Noise {
        left_over: size.abs() / step / 12f64.sqrt(),
        ..noise.clone()
    }))
}

fn noise_variance_step(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (from, end) = onset(setting, draw);
    let output = id.clone();
    let it = Concealed::new(
        "noise_variance_step",
        Structure,
        &id,
        0.4 * setting.noise_of(&id).white,
        move |s, size| {
            fault(s, &output, Fault::Noise(size.abs()), from, f64::INFINITY);
        },
    );
    let it = it.during(from, end).parameter("onset_s", "s", Rule::Fixed(from));
    Some(it.noise(false, move |noise, size| Noise { more_white: Some((from, size.abs())), ..noise.clone() }))
}

fn noise_outliers(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) =
        choose(setting, draw, |_, make| make != Make::Velocity || setting.kind == Kind::Channel)?;
    if setting.kind == Kind::Channel && make != Make::Velocity {
        return None;
    }
    let every_s = setting.scenario.duration_s / draw.log_between(4.0, 40.0);
    let output = id.clone();
    let name = named(setting, &id, make);
    let size = setting.noise_of(&id).white * draw.between(5.0, 12.0);
    let it = Concealed::new("noise_outliers", Structure, &name, size, move |s, size| {
        parasite(s, &output, Disturbance::Bursts { size, every_s, decay_s: 0.0 });
    });
    Some(pair(setting, it.read_at(&id)))
}

// ---------------------------------------------------------------- failures

fn output_stuck(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (from, end) = onset(setting, draw);
    let output = id.clone();
    let mut it = Concealed::new("output_stuck", Failure, &id, 1.0, move |s, _| {
        fault(s, &output, Fault::Stuck, from, f64::INFINITY);
    });
    it.with_noise = true;
    it.linear = false;
    Some(it.during(from, end).parameter("onset_s", "s", Rule::Fixed(from)))
}

fn output_saturated(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Accelerometer))?;
    let most = if make == Make::Fibre { 1.0 } else { 11.0 };
    let output = id.clone();
    let mut it = Concealed::new("output_saturated", Failure, &id, 0.1, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.range = most * (-size.abs()).exp();
        }
    });
    it.with_noise = true;
    Some(it.curved())
}

fn dead_zone(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Doppler))?;
    let output = id.clone();
    let it = Concealed::new("dead_zone", Failure, &id, scale_of(setting, &id), move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.threshold = size.abs();
        }
    });
    Some(it.curved())
}

fn quantisation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let output = id.clone();
    let step = setting.noise_of(&id).white * draw.log_between(1.0, 4.0);
    let it = Concealed::new("quantisation", Failure, &id, step, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.conversion = Conversion::Rounding(size.abs());
        }
    });
    Some(
        it.noise(false, |noise, size| Noise {
            white: noise.white.hypot(size / 12f64.sqrt()),
            ..noise.clone()
        }),
    )
}

fn intermittent_jump(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let (on_s, off_s) = (duration / draw.log_between(60.0, 300.0), duration / draw.between(8.0, 20.0));
    let output = id.clone();
    let shift = scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("intermittent_jump", Failure, &id, shift, move |s, size| {
        parasite(s, &output, Disturbance::Telegraph { shift: size, on_s, off_s });
    });
    Some(pair(setting, it))
}

// ---------------------------------------------------------------- in no catalogue

fn outside_bilinear(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let quantities = &setting.scenario.recorded.quantities;
    let [a, b] = [quantities.first()?, quantities.get(1)?];
    let middle =
        |q: &QuantityEntry| q.profile.points.iter().map(|p| p.1).sum::<f64>() / q.profile.points.len() as f64;
    let spread =
        |q: &QuantityEntry| q.profile.points.iter().map(|p| (p.1 - middle(q)).abs()).fold(1e-9, f64::max);
    let (columns, references) = ([a.column.clone(), b.column.clone()], [middle(a), middle(b)]);
    let (id, _) = any(setting, draw)?;
    let start = scale_of(setting, &id) / spread(a) / spread(b) * draw.sign();
    let output = id.clone();
    Some(Concealed::new("outside_bilinear", Outside, &id, start, move |s, size| {
        parasite(s, &output, Disturbance::Mixed { columns: columns.clone(), coefficient: size, references });
    }))
}

fn outside_chirp(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let f = draw.log_between(20.0 / duration, 0.2 / step);
    let phase = draw.between(0.0, std::f64::consts::TAU);
    let output = id.clone();
    Some(Concealed::new("outside_chirp", Outside, &id, 0.2 * scale_of(setting, &id), move |s, size| {
        let machine =
            Disturbance::Machine { amplitude: size, start_hz: 0.3 * f, end_hz: f, over_s: duration, phase };
        parasite(s, &output, machine);
    }))
}

fn outside_popcorn(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let (every_s, decay_s) = (duration / draw.between(10.0, 40.0), duration / draw.between(150.0, 600.0));
    let output = id.clone();
    Some(Concealed::new("outside_popcorn", Outside, &id, scale_of(setting, &id), move |s, size| {
        parasite(s, &output, Disturbance::Bursts { size, every_s, decay_s });
    }))
}

fn outside_telegraph(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let output = id.clone();
    Some(Concealed::new(
        "outside_telegraph",
        Outside,
        &id,
        scale_of(setting, &id) * draw.sign(),
        move |s, size| {
            parasite(
                s,
                &output,
                Disturbance::Telegraph { shift: size, on_s: duration / 12.0, off_s: duration / 12.0 },
            );
        },
    ))
}
