//! What can be concealed: each effect as the part of an instrument, of its surroundings or of its conversion that causes it.
//!
//! An effect has a size, in its cause's own unit, and a way to put it into a scenario. What it does to the outputs is
//! whatever the simulated physics makes of that; no formula of it stands here. Identifiers are those by which answers are
//! scored; those that begin with `outside_` are in no catalogue.
mod additive;
mod earth;
mod failure;
mod input;
mod noise;
mod outside;
mod thermal;
mod tuned;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::draw::Draw;
use super::likelihood::Noise;
use super::setting::{Kind, Setting};
use crate::physics::fault::{Fault, TimedFault};
use crate::physics::parasite::Disturbance;
use crate::physics::random::Process;
use crate::physics::readout::ReadoutDesign;
use crate::scenario::{FaultEntry, ParasiteEntry, Scenario};
use crate::simulation::Columns;

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
    /// An instant of the simulation, s; the answer counts it from the first row.
    Instant(f64),
    /// The slope of the effect's exact signal over its true cause, in SI units.
    Slope(Cause),
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

/// A true cause, from the truth of a run.
pub type Cause = Box<dyn Fn(&Columns) -> Vec<f64> + Send + Sync>;
/// Whether an effect shows at all in what a run's truth went through.
type Shows = Box<dyn Fn(&Columns) -> bool + Send + Sync>;
/// The noise with an effect of a size.
type NoiseOf = Box<dyn Fn(&Noise, f64) -> Noise + Send + Sync>;
/// How an effect of a size is put into a scenario.
type Inject = Box<dyn Fn(&mut Scenario, f64) + Send + Sync>;

/// How an effect changes the noise of an output.
pub struct NoiseChange {
    /// Noise with an effect of this size.
    pub with: NoiseOf,
    /// Whether noise of the nominal structure could swallow it, so that the null model is to be fitted anew.
    pub refit: bool,
}

/// Another name for an effect: as good as its own where the noise does not tell them apart.
pub struct Rival {
    /// Sensor or group.
    pub sensor: String,
    /// Identifier.
    pub effect: &'static str,
    /// Outputs and what it does to each, but for one common coefficient.
    pub columns: Vec<(String, Cause)>,
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
    /// Pairs that may be.
    pub rivals: Vec<Rival>,
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
    /// Whether it is there or not and has no size.
    pub fixed: bool,
    /// Whether what it does depends on the noise.
    pub with_noise: bool,
    /// Puts it into a scenario.
    pub inject: Inject,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// What it does to the noise.
    pub noise: Option<NoiseChange>,
    /// What it needs of the run.
    pub shows: Shows,
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
            rivals: vec![],
            tolerated: vec![],
            interval_s: None,
            output: sensor.to_owned(),
            start,
            linear: true,
            fixed: false,
            with_noise: false,
            inject: Box::new(inject),
            parameters: vec![],
            noise: None,
            shows: Box::new(|_| true),
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

    fn rival(mut self, sensor: &str, effect: &'static str, columns: Vec<(String, Cause)>) -> Self {
        self.rivals.push(Rival { sensor: sensor.to_owned(), effect, columns });
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

    fn needing(mut self, shows: impl Fn(&Columns) -> bool + Send + Sync + 'static) -> Self {
        self.shows = Box::new(shows);
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
use Kind::{Bench, Block, Channel, Drive, Log, Radio, Table, Tumble, TunedTable};

const STILL: &[Kind] = &[Bench];
const WARM: &[Kind] = &[Bench, Block, Channel, Table, Tumble];
const TURNED: &[Kind] = &[Table, Drive];
const STANDING: &[Kind] = &[Bench, Tumble];
const FAST: &[Kind] = &[TunedTable];

macro_rules! entries {
    ($($effect:literal $family:ident $kinds:expr => $draw:expr;)*) => {
        /// Every effect.
        pub const EFFECTS: &[Entry] = &[$(Entry { effect: $effect, family: $family, kinds: $kinds, draw: $draw }),*];
    };
}

entries! {
    "bias_constant" Additive &[Bench, Table, TunedTable, Drive, Block, Channel] => additive::bias_constant;
    "bias_step" Additive &[Bench, Table, TunedTable, Drive, Log, Block, Radio, Channel] => additive::bias_step;
    "bias_drift_linear" Additive &[Bench, Block, Channel, Table] => additive::bias_drift_linear;
    "bias_warmup" Additive &[Bench, Block, Table] => additive::bias_warmup;
    "bias_supply_voltage" Additive &[Bench, Table, Drive] => additive::bias_supply_voltage;
    "bias_pressure" Additive &[Bench, Block, Table] => |s, d| additive::coupled(s, d, "bias_pressure", "pressure");
    "bias_on_aux" Additive &[Bench, Block, Table, Drive] => additive::bias_on_aux;
    "bias_magnetic_field" Additive &[Tumble] => additive::bias_magnetic_field;
    "bias_pickoff_offset" Additive STILL => tuned::bias_pickoff_offset;
    "bias_restart" Additive &[Bench, Block] => additive::bias_restart;
    "periodic_line" Additive &[Bench, Block, Table, Channel] => additive::periodic_line;
    "schuler_oscillation" Additive &[Radio] => additive::schuler_oscillation;
    "bias_temperature" Warm WARM => thermal::bias_temperature;
    "bias_temperature_sq" Warm WARM => thermal::bias_temperature_sq;
    "bias_temperature_cubic" Warm STILL => thermal::bias_temperature_cubic;
    "bias_temperature_rate" Warm WARM => thermal::bias_temperature_rate;
    "bias_thermal_lag" Warm &[Bench, Tumble] => thermal::bias_thermal_lag;
    "bias_temperature_gradient" Warm &[Bench, Tumble] => thermal::bias_temperature_gradient;
    "bias_electronics_temperature" Warm &[Bench, Block, Table] => thermal::bias_electronics_temperature;
    "bias_thermal_hysteresis" Warm STILL => thermal::bias_thermal_hysteresis;
    "scale_factor" Input &[Table, TunedTable, Drive, Log, Radio] => input::scale_factor;
    "scale_factor_asymmetry" Input TURNED => |s, d| input::curve(s, d, "scale_factor_asymmetry");
    "scale_factor_quadratic" Input TURNED => |s, d| input::curve(s, d, "scale_factor_quadratic");
    "scale_factor_odd_quadratic" Input TURNED => |s, d| input::curve(s, d, "scale_factor_odd_quadratic");
    "scale_factor_cubic" Input TURNED => |s, d| input::curve(s, d, "scale_factor_cubic");
    "scale_factor_temperature" Input &[Table, Tumble] => input::scale_factor_temperature;
    "misalignment" Input &[Table, Drive, Tumble, Log] => input::misalignment;
    "misalignment_temperature" Input &[Table] => input::misalignment_temperature;
    "cross_coupling" Input &[Table, Tumble] => input::cross_coupling;
    "g_mass_unbalance" Input &[Tumble, Channel] => |s, d| input::g_term(s, d, "g_mass_unbalance");
    "g_quadrature" Input &[Tumble] => |s, d| input::g_term(s, d, "g_quadrature");
    "g_spin" Input &[Tumble] => |s, d| input::g_term(s, d, "g_spin");
    "g2_anisoelasticity" Input &[Tumble] => |s, d| input::g_term(s, d, "g2_anisoelasticity");
    "g2_cross" Input &[Tumble] => |s, d| input::g_term(s, d, "g2_cross");
    "g_mass_unbalance_temperature" Input &[Tumble] => |s, d| input::g_term(s, d, "g_mass_unbalance_temperature");
    "torquer_self_heating" Input FAST => tuned::torquer_self_heating;
    "anisoinertia" Input FAST => tuned::anisoinertia;
    "angular_acceleration" Input FAST => tuned::angular_acceleration;
    "rate_cross_axis" Input FAST => tuned::rate_cross_axis;
    "coning_sculling" Input &[Table] => input::coning_sculling;
    "post_g_transient" Input &[Table, Tumble, Drive] => input::post_g_transient;
    "vibration_rectification" Input &[Drive] => input::vibration_rectification;
    "time_delay" Input &[Table, Drive, Log, Radio, Channel] => input::time_delay;
    "bandwidth_lag" Input TURNED => input::bandwidth_lag;
    "lever_arm" Input &[Table, Drive, Log] => input::lever_arm;
    "earth_rate_attitude" Input STANDING => earth::earth_rate_attitude;
    "gravity_anomaly" Input STANDING => earth::gravity_anomaly;
    "noise_white" Structure &[Bench, Table, Drive, Log] => noise::noise_white;
    "noise_markov" Structure &[Bench, Table, Log] => noise::noise_markov;
    "noise_exp_cos" Structure &[Bench, Table] => noise::noise_exp_cos;
    "noise_random_walk" Structure &[Bench, Table] => noise::noise_random_walk;
    "noise_flicker" Structure STILL => noise::noise_flicker;
    "noise_angle_quantisation" Structure &[Bench, Table] => noise::noise_angle_quantisation;
    "noise_variance_step" Structure &[Bench, Table, Log] => noise::noise_variance_step;
    "noise_outliers" Structure &[Bench, Table, Log, Radio, Channel] => noise::noise_outliers;
    "output_stuck" Failure &[Table, Drive, Log, Block] => failure::output_stuck;
    "output_saturated" Failure TURNED => failure::output_saturated;
    "dead_zone" Failure &[Drive, Log] => failure::dead_zone;
    "quantisation" Failure &[Bench, Table, Log] => failure::quantisation;
    "intermittent_jump" Failure &[Radio, Log, Bench] => failure::intermittent_jump;
    "outside_bilinear" Outside &[Bench, Block] => outside::outside_bilinear;
    "outside_chirp" Outside &[Bench, Block, Table] => outside::outside_chirp;
    "outside_popcorn" Outside &[Bench, Log] => outside::outside_popcorn;
    "outside_telegraph" Outside &[Bench, Block] => outside::outside_telegraph;
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

fn column(name: &str) -> impl Fn(&Columns) -> Vec<f64> + Send + Sync + use<> {
    let name = name.to_owned();
    move |truth| truth.get(&name).unwrap_or_default().to_vec()
}

/// The same at all times.
fn constant(truth: &Columns) -> Vec<f64> {
    vec![1.0; truth.get("t").unwrap_or_default().len()]
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
