//! What a case is before anything is concealed: motion, surroundings, instruments, and what their user rightly believes.
//!
//! | setting | motion told | instruments |
//! | --- | --- | --- |
//! | bench | static | tuned and fibre-optic gyros, accelerometers in changing temperature |
//! | table | recorded rate and force | three fibre-optic gyros and accelerometers on a rate table |
//! | tuned_table | recorded rate and force | three tuned gyros for large rates on a rate table, slowly moved |
//! | tumble | recorded rate and force, nothing while it turns | three tuned gyros and accelerometers in many attitudes |
//! | drive | recorded rate and force | strapdown unit in a vehicle |
//! | log | recorded velocity and attitude | Doppler log |
//! | block | unknown | five gyros on a cone |
//! | radio | unknown | Doppler log beside the velocity of an inertial system |
//! | channel | velocity error | Schuler loop with its gyro and accelerometer |
use nalgebra::{Unit as UnitVector, Vector3};
use schuler_recording::case::{
    ELECTRONICS as AT_ELECTRONICS, ExponentialCosine, Markov, Nominal, Quantity, SchulerLoop as NominalLoop,
};
use schuler_recording::unit::Unit;
use serde::{Deserialize, Serialize};

use super::draw::Draw;
use super::likelihood::{Loop, Noise};
use crate::physics::doppler::DopplerDesign;
use crate::physics::earth;
use crate::physics::environment::{EnvironmentDesign, Profile, Thermal};
use crate::physics::fog::FogDesign;
use crate::physics::gyro::GyroDesign;
use crate::physics::heat::Bar;
use crate::physics::motion::{Attitude, Motion, Site, Sway, TableStep, Vehicle, VehicleStep};
use crate::physics::pendulum::{AccelerometerDesign, Pendulum};
use crate::physics::random::Process;
use crate::physics::readout::{Conversion, ReadoutDesign};
use crate::scenario::instruments::CONE;
use crate::scenario::{
    AccelerometerEntry, Channel, DopplerEntry, ErrorSource, FogEntry, GyroEntry, LoopEntry, QuantityEntry,
    Recorded, Scenario, ThermometerEntry, Told,
};

/// Kinds of setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, PartialOrd, Ord)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// At rest.
    Bench,
    /// On a rate table.
    Table,
    /// Tuned gyros on a rate table.
    TunedTable,
    /// In many attitudes.
    Tumble,
    /// In a vehicle.
    Drive,
    /// Doppler log.
    Log,
    /// Five gyros.
    Block,
    /// Doppler log beside an inertial system.
    Radio,
    /// Schuler loop.
    Channel,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::Bench,
        Self::Table,
        Self::TunedTable,
        Self::Tumble,
        Self::Drive,
        Self::Log,
        Self::Block,
        Self::Radio,
        Self::Channel,
    ];
}

/// A setting.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Its kind.
    pub kind: Kind,
    /// What is simulated, with nothing concealed.
    pub scenario: Scenario,
    /// The true noise of each output, in SI units.
    pub noise: Vec<(String, Noise)>,
    /// The true noise of the Schuler loop.
    pub channel: Option<Loop>,
}

/// Group of a strapdown unit's sensors.
pub const UNIT: &str = "unit";
/// Group of a Doppler log's beams.
pub const LOG: &str = "log";
/// Column of the first thermometer.
pub const THERMOMETER: &str = "temperature";
/// Column of the thermometer beyond it.
pub const FAR_THERMOMETER: &str = "temperature_far";
/// Column of the electronics' thermometer.
pub const ELECTRONICS: &str = "temperature_electronics";
/// Time after which a tuned gyro's loop has settled at another angle, s.
const SETTLED_S: f64 = 2.0;
/// Angles at which a pick-off test holds the rotor, rad.
const PICKOFF_RAD: f64 = 1e-5;
/// Spin speed of tuned gyros, Hz.
const SPIN_HZ: f64 = 200.0;

impl Setting {
    /// Draws a setting with at most so many rows.
    pub fn draw(kind: Kind, most_rows: usize, seed: u64, draw: &mut Draw) -> Self {
        match kind {
            Kind::Bench => bench(most_rows, seed, draw),
            Kind::Table => table(most_rows, seed, draw),
            Kind::TunedTable => tuned_table(most_rows, seed, draw),
            Kind::Tumble => tumble(most_rows, seed, draw),
            Kind::Drive => drive(most_rows, seed, draw),
            Kind::Log => log(most_rows, seed, draw),
            Kind::Block => block(most_rows, seed, draw),
            Kind::Radio => radio(most_rows, seed, draw),
            Kind::Channel => channel(most_rows, seed, draw),
        }
    }

    /// The true noise of an output.
    pub fn noise_of(&self, id: &str) -> Noise {
        self.noise.iter().find(|(name, _)| name == id).map(|(_, noise)| noise.clone()).unwrap_or_default()
    }

    /// Whether an output is read against an unknown constant.
    pub fn relative(&self, id: &str) -> bool {
        let s = &self.scenario;
        s.gyros.iter().any(|g| g.ids.0 == id && g.relative)
            || s.fogs.iter().any(|g| g.id == id && g.relative)
            || s.accelerometers.iter().any(|g| g.id == id && g.relative)
    }

    /// The unit of an output's column.
    pub fn unit(&self, id: &str) -> Unit {
        let s = &self.scenario;
        let gyro = s.gyros.iter().find(|g| g.ids.0 == id).map(|g| g.unit);
        let fog = s.fogs.iter().find(|g| g.id == id).map(|g| g.unit);
        let accelerometer = s.accelerometers.iter().find(|g| g.id == id).map(|g| g.unit);
        gyro.or(fog).or(accelerometer).unwrap_or(Unit::MetrePerSecond)
    }
}

/// A scenario in which nothing happens.
fn empty(title: &str, seed: u64, duration_s: f64, step_s: f64, draw: &mut Draw) -> Scenario {
    let latitude = draw.between(25.0, 68.0).to_radians() * draw.sign();
    Scenario {
        title: title.to_owned(),
        seed,
        duration_s,
        step_s,
        parts: 1,
        site: Site { latitude, height: draw.between(0.0, 600.0), gravity_anomaly: 0.0 },
        motion: Motion::Static(Attitude::default()),
        believed: None,
        told: Told::Static,
        environment: EnvironmentDesign::default(),
        recorded: Recorded::default(),
        gyros: vec![],
        fogs: vec![],
        accelerometers: vec![],
        dopplers: vec![],
        schuler_loop: None,
        faults: vec![],
        parasites: vec![],
        fitted: vec![],
        clocks: vec![],
        rotation_vectors: vec![],
        gaps: vec![],
    }
}

/// A number of rows up to a limit.
fn rows(least: usize, most: usize, draw: &mut Draw) -> usize {
    draw.log_between(least.min(most) as f64, most as f64).round() as usize
}

/// Noise of an output whose unit has this SI value: white of this order per reading and often something correlated.
fn noise(white: f64, si: f64, duration_s: f64, step_s: f64, draw: &mut Draw) -> (Noise, Nominal) {
    let white = round(white * draw.log_between(0.5, 2.0));
    let mut noise = Noise { white: white * si, ..Noise::default() };
    let mut nominal = Nominal { white, ..Nominal::default() };
    let sigma = round(white * draw.log_between(0.2, 2.0));
    let tau_s = round((duration_s / draw.log_between(30.0, 300.0)).max(8.0 * step_s));
    let which = draw.between(0.0, 1.0);
    if which < 0.5 {
        noise.drift.push(Process::Markov { sigma: sigma * si, tau_s });
        nominal.markov = Some(Markov { sigma, tau_s });
    } else if which < 0.65 {
        let alpha = round(1.0 / tau_s);
        let beta = round(alpha * draw.between(2.0, 6.0));
        noise.drift.push(Process::ExponentialCosine { sigma: sigma * si, alpha, beta });
        nominal.exp_cos = Some(ExponentialCosine { sigma, alpha, beta });
    } else if which < 0.75 {
        let rate = round(white * draw.log_between(0.1, 1.0) / duration_s.sqrt());
        noise.drift.push(Process::RandomWalk { rate: rate * si });
        nominal.random_walk = rate;
    }
    (noise, nominal)
}

/// To three digits, as people write numbers into a case.
fn round(value: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let scale = 10f64.powf(2.0 - value.abs().log10().floor());
    (value * scale).round() / scale
}

/// The output of an instrument whose readings have this noise, as a case states it: the drift is that of the readings themselves.
fn readout(noise: &Noise, step_s: f64) -> ReadoutDesign {
    ReadoutDesign {
        white: noise.white * step_s.sqrt(),
        electronics_drift: noise.drift.clone(),
        range: f64::INFINITY,
        ..ReadoutDesign::default()
    }
}

/// A bar whose temperature follows the surroundings within a share of the record.
fn bar(duration_s: f64, draw: &mut Draw) -> Bar {
    let length_m = if duration_s < 7200.0 { 0.08 } else { 0.2 };
    let capacity = 2.43e6;
    let film_left = (capacity * length_m / (duration_s * draw.log_between(0.01, 0.1))).max(15.0);
    Bar {
        length_m,
        section_m2: 6e-3,
        conductivity: 160.0,
        capacity,
        film_left,
        film_right: 0.0,
        side: 0.0,
        cells: 12,
    }
}

/// Temperature programmes, thermometers and other recorded quantities.
fn surroundings(scenario: &mut Scenario, near: Option<&str>, draw: &mut Draw) {
    let duration = scenario.duration_s;
    let bar = bar(duration, draw);
    let start = draw.between(15.0, 30.0);
    let programme = draw.between(0.0, 1.0);
    let mut power = Profile::constant(0.0);
    let ambient = if programme < 0.4 {
        let corners = 3 + draw.index(5);
        let mut points = vec![(0.0, start)];
        for k in 1..=corners {
            let level = start + draw.between(-15.0, 20.0);
            let at = duration * k as f64 / (corners + 1) as f64;
            points.push((
                at - duration * draw.between(0.0, 0.5) / (corners + 1) as f64,
                points[points.len() - 1].1,
            ));
            points.push((at, level));
        }
        points.dedup_by(|b, a| b.0 <= a.0);
        Profile { points, amplitude: 0.0, period_s: 1.0 }
    } else if programme < 0.7 {
        let period_s = duration * draw.between(0.25, 0.9);
        Profile { points: vec![(0.0, start)], amplitude: draw.between(3.0, 10.0), period_s }
    } else if programme < 0.9 {
        draw.wander(start, 4.0, duration / 24.0, duration)
    } else {
        power = Profile::constant(draw.between(4.0, 12.0) * bar.film_left * bar.section_m2);
        Profile::constant(start)
    };
    let position = draw.between(0.2, 0.5) * bar.length_m;
    let far = position + 0.4 * bar.length_m;
    let (quantisation, white, tau_s) =
        (draw.pick([0.0, 0.01, 0.0625]), draw.log_between(0.001, 0.02), draw.between(0.0, 30.0));
    let thermometer = |column: &str, near: Option<&str>, position_m: f64| ThermometerEntry {
        column: column.to_owned(),
        near: near.map(str::to_owned),
        position_m,
        tau_s: tau_s.min(0.002 * duration),
        white,
        quantisation,
    };
    scenario.recorded.thermometers.push(thermometer(THERMOMETER, near, position));
    if draw.chance(0.4) {
        scenario.recorded.thermometers.push(thermometer(FAR_THERMOMETER, None, far));
    }
    let mut heaters = vec![(position, power)];
    if draw.chance(0.3) {
        // The electronics have a life of their own: a load that is switched.
        let mut points = vec![(0.0, 2.0)];
        for k in 1..8 {
            let at = duration * f64::from(k) / 8.0;
            let level = draw.between(0.0, 1.0) * 4.0 * bar.film_left * bar.section_m2;
            points.push((at - 0.001 * duration, points[points.len() - 1].1));
            points.push((at, level));
        }
        let place = 0.95 * bar.length_m;
        heaters.push((place, Profile { points, amplitude: 0.0, period_s: 1.0 }));
        scenario.environment.electronics_position_m = Some(place);
        scenario.recorded.thermometers.push(thermometer(ELECTRONICS, Some(AT_ELECTRONICS), place));
    }
    for gyro in &mut scenario.gyros {
        gyro.position_m = position;
    }
    for fog in &mut scenario.fogs {
        fog.position_m = position;
    }
    for accelerometer in &mut scenario.accelerometers {
        accelerometer.position_m = position;
    }
    scenario.environment.thermal = Thermal::Bar { bar, initial: ambient.at(0.0), ambient, heaters };
    if draw.chance(0.5) {
        scenario.environment.voltage = draw.wander(27.0, 0.4, duration / 40.0, duration);
        scenario.recorded.voltage = true;
    }
    for (column, quantity, unit, about, spread) in [
        ("pressure", Quantity::Pressure, "Pa", 100_800.0, 300.0),
        ("load_current", Quantity::Current, "A", 2.0, 0.3),
        ("humidity", Quantity::Other, "%", 45.0, 6.0),
    ] {
        if draw.chance(0.4) {
            let every_s = duration / draw.between(15.0, 60.0);
            scenario.recorded.quantities.push(QuantityEntry {
                column: column.to_owned(),
                quantity,
                unit: unit.to_owned(),
                near: None,
                profile: draw.wander(about, spread, every_s, duration),
                recorded: true,
            });
        }
    }
}

/// Stretches that are missing.
fn gaps(scenario: &mut Scenario, draw: &mut Draw) {
    if draw.chance(0.25) {
        for _ in 0..=draw.index(3) {
            let length = scenario.duration_s * draw.log_between(0.002, 0.03);
            scenario.gaps.push((draw.between(0.05, 0.9) * scenario.duration_s, length));
        }
    }
}

fn gyro(
    id: &str,
    x: Vector3<f64>,
    z: Vector3<f64>,
    unit: Unit,
    design: ReadoutDesign,
    nominal: Nominal,
) -> GyroEntry {
    let mut entry = GyroEntry {
        ids: (id.to_owned(), None),
        group: None,
        unit,
        design: GyroDesign::ideal(SPIN_HZ),
        position_m: 0.0,
        pickoff_command: [Profile::constant(0.0), Profile::constant(0.0)],
        nominal,
        relative: false,
        recorded: true,
    };
    entry.design.input_axis = x;
    entry.design.spin_axis = z;
    entry.design.readout = [design.clone(), design];
    entry
}

/// Gives a tuned gyro the rotor and the network of one for large rates.
fn make_strapdown(entry: &mut GyroEntry) {
    let d = &entry.design;
    entry.design = GyroDesign {
        readout: d.readout.clone(),
        input_axis: d.input_axis,
        spin_axis: d.spin_axis,
        ..GyroDesign::strapdown(SPIN_HZ)
    };
}

fn fog(id: &str, axis: Vector3<f64>, unit: Unit, design: ReadoutDesign, nominal: Nominal) -> FogEntry {
    let design = FogDesign { readout: design, ..FogDesign::ideal(axis) };
    FogEntry { id: id.to_owned(), group: None, unit, design, position_m: 0.0, nominal, relative: false }
}

fn accelerometer(
    id: &str,
    (i, p): (Vector3<f64>, Vector3<f64>),
    unit: Unit,
    design: ReadoutDesign,
    nominal: Nominal,
) -> AccelerometerEntry {
    let mut entry = AccelerometerEntry {
        id: id.to_owned(),
        group: None,
        unit,
        design: AccelerometerDesign {
            input_axis: i,
            pendulum_axis: p,
            readout: design,
            ..AccelerometerDesign::ideal()
        },
        position_m: 0.0,
        nominal,
        relative: false,
        recorded: true,
    };
    // A light pendulum in a stiff loop: what its user knows of it is true.
    entry.design.pendulum = Pendulum {
        inertia: 1e-12,
        hinge: 1e-9,
        servo: 1e3,
        integrator: 2e4,
        integrator_rate: 0.02,
        ..entry.design.pendulum
    };
    entry
}

fn bench(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
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
        let mut entry = accelerometer(&id, (axes[k], axes[(k + 1) % 3]), Unit::MicroG, output, nominal);
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

/// Three fibre-optic gyros and three accelerometers of one unit.
fn strapdown(
    scenario: &mut Scenario,
    gyro_white: f64,
    force_white: f64,
    draw: &mut Draw,
) -> Vec<(String, Noise)> {
    let (duration, step) = (scenario.duration_s, scenario.step_s);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut all = Vec::new();
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("gyro_{letter}");
        let (it, nominal) = noise(gyro_white, Unit::DegreePerHour.in_si(), duration, step, draw);
        let mut entry = fog(&id, axes[k], Unit::DegreePerHour, readout(&it, step), nominal);
        entry.group = Some(UNIT.to_owned());
        scenario.fogs.push(entry);
        all.push((id, it));
    }
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("accelerometer_{letter}");
        let (it, nominal) = noise(force_white, Unit::MicroG.in_si(), duration, step, draw);
        let unit = (axes[k], axes[(k + 1) % 3]);
        let mut entry = accelerometer(&id, unit, Unit::MicroG, readout(&it, step), nominal);
        entry.group = Some(UNIT.to_owned());
        scenario.accelerometers.push(entry);
        all.push((id, it));
    }
    all
}

fn axis(draw: &mut Draw) -> UnitVector<Vector3<f64>> {
    draw.pick([Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()])
}

fn table(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 0.1]);
    let n = rows(3000, most_rows.min(20_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Unit on a rate table", seed, duration, step_s, draw);
    scenario.parts = 4;
    let mut steps = Vec::new();
    let mut time = 0.0;
    let unit = duration / 40.0;
    // Always about one axis and at one frequency, slow enough for the rows to resolve it.
    let cones = draw.chance(0.3);
    let cone_hz = draw.between(0.06, 0.15) / step_s;
    while time < duration {
        let duration_s = unit * draw.between(0.5, 1.5);
        let which = draw.between(0.0, 1.0);
        let step = if cones && which < 0.1 {
            let amplitude = draw.log_between(0.15, 0.8).to_radians();
            TableStep::Cone {
                axis: Vector3::z_axis(),
                amplitude,
                frequency_hz: cone_hz,
                duration_s: duration_s.max(4.0 / cone_hz),
            }
        } else if which < 0.15 {
            TableStep::Dwell { duration_s }
        } else if which < 0.4 {
            let angle = draw.pick([45.0f64, 90.0, 90.0, 180.0]).to_radians() * draw.sign();
            TableStep::Turn { axis: axis(draw), angle, duration_s: duration_s.min(60.0 * step_s.max(0.3)) }
        } else if which < 0.8 {
            let rate = (draw.log_between(1.0, 60.0) * draw.sign()).to_radians();
            TableStep::Spin { axis: axis(draw), rate, duration_s, ramp_s: 0.2 * duration_s }
        } else {
            let frequency_hz = draw.log_between(0.03, 0.1) / step_s.max(0.3);
            let amplitude = draw.between(2.0, 20.0).to_radians();
            let duration_s = duration_s.max(3.0 / frequency_hz);
            TableStep::Swing { axis: axis(draw), amplitude, frequency_hz, duration_s }
        };
        time += step.duration_s();
        steps.push(step);
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    let all = strapdown(&mut scenario, 3.0, 50.0, draw);
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Table, scenario, noise: all, channel: None }
}

/// Three tuned gyros for large rates: rates about one axis and about two, ramps and swings slow enough for their loops.
fn tuned_table(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = 1.0;
    let n = rows(4000, most_rows.min(8000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Tuned gyros on a rate table", seed, duration, step_s, draw);
    scenario.parts = 2;
    let mut steps = Vec::new();
    let mut time = 0.0;
    while time < duration {
        let duration_s = draw.between(200.0, 400.0);
        let which = draw.between(0.0, 1.0);
        let axis = if draw.chance(0.5) {
            axis(draw)
        } else {
            UnitVector::new_normalize(Vector3::new(draw.normal(), draw.normal(), draw.normal()))
        };
        let step = if which < 0.25 {
            TableStep::Dwell { duration_s }
        } else if which < 0.7 {
            let rate = (draw.log_between(2.0, 20.0) * draw.sign()).to_radians();
            TableStep::Spin { axis, rate, duration_s, ramp_s: 0.3 * duration_s }
        } else {
            let frequency_hz = 3.0 / duration_s;
            let amplitude = draw.between(10.0, 30.0).to_radians();
            TableStep::Swing { axis, amplitude, frequency_hz, duration_s }
        };
        time += step.duration_s();
        steps.push(step);
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut all = Vec::new();
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("gyro_{letter}");
        let (it, nominal) = noise(1.0, Unit::DegreePerHour.in_si(), duration, step_s, draw);
        let output = readout(&it, step_s);
        let mut entry = gyro(&id, axes[k], axes[(k + 1) % 3], Unit::DegreePerHour, output, nominal);
        make_strapdown(&mut entry);
        scenario.gyros.push(entry);
        all.push((id, it));
    }
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::TunedTable, scenario, noise: all, channel: None }
}

fn tumble(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 10.0]);
    let n = rows(3000, most_rows.min(30_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Tumble test", seed, duration, step_s, draw);
    scenario.parts = 2;
    let mut steps = Vec::new();
    let mut time = 0.0;
    let positions = 12 + draw.index(20);
    for _ in 0..positions {
        let duration_s = duration / positions as f64 - 30.0 * step_s;
        steps.push(TableStep::Dwell { duration_s });
        time += duration_s;
        let angle = draw.pick([45.0f64, 90.0, 90.0, 135.0]).to_radians() * draw.sign();
        steps.push(TableStep::Turn { axis: axis(draw), angle, duration_s: 28.0 * step_s });
        // Nothing is recorded while it turns and settles.
        scenario.gaps.push((time - step_s, 31.0 * step_s));
        time += 28.0 * step_s;
        steps.push(TableStep::Dwell { duration_s: 2.0 * step_s });
        time += 2.0 * step_s;
    }
    scenario.motion = Motion::Table { start: Attitude::default(), steps };
    scenario.told = Told::Recorded;
    scenario.recorded.attitude = draw.chance(0.5);
    let group = draw.chance(0.5).then(|| UNIT.to_owned());
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut all = Vec::new();
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let id = format!("gyro_{letter}");
        let (it, nominal) = noise(0.02, Unit::DegreePerHour.in_si(), duration, step_s, draw);
        let output = readout(&it, step_s);
        let mut entry = gyro(&id, axes[k], axes[(k + 1) % 3], Unit::DegreePerHour, output, nominal);
        entry.group.clone_from(&group);
        scenario.gyros.push(entry);
        all.push((id, it));
    }
    for (k, letter) in ["x", "y", "z"].into_iter().enumerate().take(draw.index(4)) {
        let id = format!("accelerometer_{letter}");
        let (it, nominal) = noise(8.0, Unit::MicroG.in_si(), duration, step_s, draw);
        let directions = (axes[k], axes[(k + 1) % 3]);
        let mut entry = accelerometer(&id, directions, Unit::MicroG, readout(&it, step_s), nominal);
        entry.group.clone_from(&group);
        scenario.accelerometers.push(entry);
        all.push((id, it));
    }
    scenario.environment.magnetic_field = Vector3::new(1.7e-5, 1e-6, 4.8e-5);
    scenario.recorded.magnetic_field = draw.chance(0.6);
    surroundings(&mut scenario, None, draw);
    Setting { kind: Kind::Tumble, scenario, noise: all, channel: None }
}

/// Legs of a vehicle over a duration; speeds stay between two values, headings are free or, on a platform's course, nearly
/// straight.
fn legs(
    duration_s: f64,
    unit_s: f64,
    slowest: f64,
    fastest: f64,
    turns: f64,
    draw: &mut Draw,
) -> (f64, Vec<VehicleStep>) {
    let start = draw.between(slowest, fastest);
    let mut speed = start;
    let mut steps = Vec::new();
    let mut time = 0.0;
    while time < duration_s {
        let leg_s = unit_s * draw.between(0.4, 1.6);
        let mut leg =
            VehicleStep { duration_s: leg_s, speed_change: 0.0, heading_change: 0.0, height_change: 0.0 };
        let which = draw.between(0.0, 1.0);
        if which < 0.4 {
            let wanted = draw.between(slowest, fastest);
            leg.speed_change = wanted - speed;
            speed = wanted;
        } else if which < 0.8 {
            leg.heading_change = turns * draw.between(-1.5, 1.5);
        }
        time += leg_s;
        steps.push(leg);
    }
    (start, steps)
}

fn drive(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([0.1, 0.1, 0.02, 1.0]);
    let n = rows(6000, most_rows.min(36_000), draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Strapdown unit in a vehicle", seed, duration, step_s, draw);
    scenario.parts = 4;
    let (speed, steps) = legs(duration, (duration / 40.0).max(20.0 * step_s), 3.0, 30.0, 1.0, draw);
    scenario.motion = Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-3.0, 3.0),
        bank_share: 0.3,
        sway: Sway {
            roll: draw.between(0.002, 0.02),
            pitch: draw.between(0.002, 0.02),
            period_s: step_s.max(0.1) * draw.between(14.0, 40.0),
        },
        level_platform: false,
        steps,
    });
    scenario.told = Told::Recorded;
    let all = strapdown(&mut scenario, 20.0, 200.0, draw);
    surroundings(&mut scenario, None, draw);
    if draw.chance(0.6) {
        scenario.environment.vibration_direction = Vector3::new(draw.normal(), draw.normal(), draw.normal());
        scenario.environment.vibration_hz = draw.between(20.0, 60.0);
        let mut rms = draw.wander(1.5, 0.7, duration / 30.0, duration);
        rms.points.iter_mut().for_each(|(_, v)| *v = v.max(0.05));
        scenario.environment.vibration_rms = rms;
        scenario.recorded.vibration = true;
    }
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Drive, scenario, noise: all, channel: None }
}

fn velocity_noise(white: f64, duration_s: f64, step_s: f64, draw: &mut Draw) -> (Noise, Nominal) {
    noise(white, 1.0, duration_s, step_s, draw)
}

fn log(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
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

fn doppler(
    id: &str,
    axis: Vector3<f64>,
    design: ReadoutDesign,
    nominal: Nominal,
    group: Option<&str>,
) -> DopplerEntry {
    let design = DopplerDesign {
        axis,
        misalignment: Vector3::zeros(),
        arm: Vector3::zeros(),
        delay_s: 0.0,
        scale_factor: 0.0,
        readout: design,
    };
    DopplerEntry { id: id.to_owned(), group: group.map(str::to_owned), design, nominal }
}

fn block(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = draw.pick([1.0, 1.0, 0.1]);
    let n = rows(3000, most_rows, draw);
    let duration = n as f64 * step_s;
    let mut scenario = empty("Block of five gyros", seed, duration, step_s, draw);
    scenario.parts = 2;
    let (speed, steps) = legs(duration, duration / 20.0, 2.0, 20.0, 0.3, draw);
    scenario.motion = Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-3.0, 3.0),
        bank_share: 0.0,
        sway: Sway { roll: 0.01, pitch: 0.01, period_s: 20.0 * step_s },
        level_platform: false,
        steps,
    });
    scenario.told = Told::Unknown;
    let (it, nominal) = noise(0.05, Unit::DegreePerHour.in_si(), duration, step_s, draw);
    let mut all = Vec::new();
    for (k, axis) in CONE.iter().enumerate() {
        let id = format!("gyro_{}", k + 1);
        scenario.fogs.push(fog(
            &id,
            Vector3::from(*axis),
            Unit::DegreePerHour,
            readout(&it, step_s),
            nominal.clone(),
        ));
        all.push((id, it.clone()));
    }
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    Setting { kind: Kind::Block, scenario, noise: all, channel: None }
}

fn still_loop(id: &str, velocity_white: f64) -> LoopEntry {
    let nothing = || ErrorSource::Process { drift: vec![], white: 0.0 };
    LoopEntry {
        id: id.to_owned(),
        radius_m: earth::MEAN_RADIUS,
        gravity: earth::STANDARD_GRAVITY,
        velocity_error: 0.0,
        tilt: 0.0,
        accelerometer: nothing(),
        gyro: nothing(),
        velocity_white,
        delay_s: 0.0,
        outages: vec![],
        absolute: false,
        channel: Channel::North,
        nominal: NominalLoop {
            radius_m: earth::MEAN_RADIUS,
            gravity: earth::STANDARD_GRAVITY,
            accelerometer: None,
            gyro: None,
            velocity_white,
        },
    }
}

/// A vehicle on a northerly course whose platform stays level.
fn platform(duration_s: f64, unit_s: f64, fastest: f64, draw: &mut Draw) -> Motion {
    let (speed, steps) = legs(duration_s, unit_s, 0.1 * fastest, fastest, 0.2, draw);
    Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-0.5, 0.5),
        bank_share: 0.0,
        sway: Sway::default(),
        level_platform: true,
        steps,
    })
}

fn radio(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
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

fn channel(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
    let step_s = 1.0;
    let n = rows(5000, most_rows.clamp(5001, 43_200), draw);
    let duration = n as f64;
    let mut scenario = empty("Velocity error of a Schuler loop", seed, duration, step_s, draw);
    scenario.motion = platform(duration, duration / 40.0, 200.0, draw);
    scenario.told = Told::VelocityError;
    let a = Markov {
        sigma: round(draw.log_between(5.0, 50.0) * Unit::MicroG.in_si()),
        tau_s: round(draw.log_between(60.0, 600.0)),
    };
    let w = Markov {
        sigma: round(draw.log_between(0.003, 0.03) * Unit::DegreePerHour.in_si()),
        tau_s: round(draw.log_between(600.0, 3600.0)),
    };
    let white = round(draw.log_between(0.02, 0.1));
    let markov = |m: &Markov| Noise {
        drift: vec![Process::Markov { sigma: m.sigma, tau_s: m.tau_s }],
        ..Noise::default()
    };
    let mut entry = still_loop("velocity_error", white);
    entry.tilt = draw.normal() * 2e-5;
    entry.velocity_error = draw.normal() * 0.05;
    entry.accelerometer = ErrorSource::Instrument("accelerometer".to_owned());
    entry.gyro = ErrorSource::Instrument("gyro".to_owned());
    entry.nominal.accelerometer = Some(a);
    entry.nominal.gyro = Some(w);
    scenario.schuler_loop = Some(entry);
    // The north channel's tilt is about east; its gyro's drift adds to it.
    let mut it = gyro(
        "gyro",
        Vector3::y(),
        Vector3::z(),
        Unit::RadianPerSecond,
        readout(&markov(&w), step_s),
        Nominal::default(),
    );
    it.recorded = false;
    scenario.gyros.push(it);
    let directions = (Vector3::x(), Vector3::y());
    let mut it = accelerometer(
        "accelerometer",
        directions,
        Unit::MetrePerSecondSquared,
        readout(&markov(&a), step_s),
        Nominal::default(),
    );
    it.recorded = false;
    scenario.accelerometers.push(it);
    scenario.recorded.specific_force = true;
    surroundings(&mut scenario, None, draw);
    gaps(&mut scenario, draw);
    let channel = Loop {
        radius_m: earth::MEAN_RADIUS,
        gravity: earth::STANDARD_GRAVITY,
        accelerometer: markov(&a),
        gyro: markov(&w),
        velocity_white: white,
        spikes: None,
    };
    let all = vec![("velocity_error".to_owned(), Noise { white, ..Noise::default() })];
    Setting { kind: Kind::Channel, scenario, noise: all, channel: Some(channel) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::likelihood::Model;
    use crate::campaign::oracle;
    use crate::physics::readout::{Readout, Surroundings};
    use crate::simulation;

    /// Twice what a free level of the white noise gains over the stated one, nearly: χ² with one degree of freedom.
    fn of_free_white(time_s: &[f64], series: &[f64], model: impl Fn(f64) -> Model) -> f64 {
        let step: f64 = 0.01;
        let [less, stated, more] =
            [-step, 0.0, step].map(|by| model(by.exp()).log_likelihood(time_s, series));
        let slope = (more - less) / (2.0 * step);
        let curvature = (2.0 * stated - more - less) / (step * step);
        slope * slope / curvature
    }

    /// What a case states as noise is the noise of the readings, whatever the instrument: 1e-4 is χ² > 15.
    #[test]
    fn readings_have_the_noise_that_the_case_states() {
        for kind in Kind::ALL {
            for seed in 1..=3 {
                let setting = Setting::draw(kind, 6000, seed, &mut Draw::new(seed, "setting"));
                let rows = simulation::steps(&setting.scenario);
                let time: Vec<f64> = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
                let run = |scenario: &Scenario| {
                    oracle::outputs(&setting, &simulation::run(scenario, |_| Ok(())).unwrap(), rows)
                };
                let with = run(&oracle::exact(&setting.scenario));
                let noise = oracle::difference(&with, &run(&oracle::silent(&setting.scenario)));
                let views = |factor: f64| {
                    oracle::views(&setting, |id| {
                        let it = setting.noise_of(id);
                        Noise { white: factor * it.white, ..it }
                    })
                };
                for (k, view) in views(1.0).iter().enumerate() {
                    let series = view.of(&noise, rows);
                    let found = of_free_white(&time, &series, |factor| views(factor)[k].model.clone());
                    assert!(found < 15.0, "{kind:?} {seed} {:?}: {found}", view.weights);
                }
            }
        }
    }

    /// The same where the white noise is small beside what the drift moves from reading to reading.
    #[test]
    fn a_fast_drift_leaves_the_white_noise_as_stated() {
        let step_s = 0.5;
        for process in [
            Process::Markov { sigma: 1.0, tau_s: 2.5 },
            Process::ExponentialCosine { sigma: 1.0, alpha: 0.1, beta: 0.8 },
            Process::RandomWalk { rate: 0.5 },
            Process::Flicker { instability: 2.0, shortest_s: 2.0, longest_s: 2000.0 },
        ] {
            let noise = Noise { white: 0.1, drift: vec![process], ..Noise::default() };
            let mut output = Readout::new(readout(&noise, step_s), 1, "x");
            let series: Vec<f64> =
                (0..20_000).map(|_| output.read(0.0, &Surroundings::default(), step_s)).collect();
            let time: Vec<f64> = (1..=series.len()).map(|k| k as f64 * step_s).collect();
            let of = |factor: f64| Noise { white: factor * noise.white, ..noise.clone() }.model(step_s);
            let found = of_free_white(&time, &series, of);
            assert!(found < 15.0, "{process:?}: {found}");
        }
    }
}
