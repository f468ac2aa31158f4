//! The scenario file `schuler-scenario/1`: what to simulate.
//!
//! One TOML file names the motion, the surroundings, the instruments with their physical parts, what goes wrong, and
//! what the case written beside the recording shall believe. Keys that are left out have the value of an ideal
//! instrument. Physical parts are in SI units (`_m`, `_Nm`, `_rad` …); an instrument's outputs and noise are in its
//! `unit`. Every mistake is reported with line, field and expectation. A *profile* is a table
//! `{ time_s = [..], value = [..], amplitude, period_s }`: straight lines between points, and a sine on top.
//!
//! | table | keys |
//! | --- | --- |
//! | | `format`, `title`, `seed` |
//! | `[time]` | `duration_s`, `step_s` (1), `parts` of a step for the response to motion (1) |
//! | `[site]` | `latitude_deg`, `altitude_m`, `gravity_anomaly_mGal` beside normal gravity, of which the case knows nothing |
//! | `[motion]` | `kind` = static, table, vehicle; `attitude_deg = { roll, pitch, heading }` |
//! | `[[motion.step]]` of a table | `kind` = dwell, turn (`axis`, `angle_deg`), spin (`axis`, `rate_deg_s`, `ramp_s`), swing and cone (`axis`, `amplitude_deg`, `frequency_hz`); `duration_s` |
//! | `[motion]` of a vehicle | `speed`, `heading_deg`, `bank_share`, `level_platform`, `sway = { roll_deg, pitch_deg, period_s }` |
//! | `[[motion.leg]]` | `duration_s`, `speed_change`, `heading_change_deg`, `height_change_m` |
//! | `[thermal]` | profile `ambient_degC`, `initial_degC`, `electronics_position_m`, `bar = { length_m, section_m2, conductivity, capacity, film_left, film_right, side, cells }` |
//! | `[[thermal.heater]]` | `position_m`, profile `power_W` |
//! | | profile `supply_V`, `magnetic_field_ned_T` |
//! | `[vibration]` | `direction`, `frequency_hz`, profile `rms` |
//! | `[[thermometer]]` | `column`, `near`, `position_m`, `tau_s`, `white`, `quantisation` |
//! | `[case]` | `motion` = static, recorded, navigation, unknown, velocity_error; `voltage`, `magnetic_field`, `vibration`, `specific_force`, `attitude` = true to record it; `pickoff` = id of the gyro whose pick-offs are |
//! | `[[gyro]]` | `id`, `second_id`, `input_axis`, `spin_axis`, and what follows |
//! | `[block]` | five gyros on a cone, `id` the beginning of their ids, and what follows |
//! | gyro | `group`, `unit`, `recorded`, `relative`, `position_m`, `misalignment_arcsec`, `spin_hz`, `rotor_mass_kg`, `range`, `quantisation` or `pulse`, `full_rate` |
//! | gyro `.rotor` | `polar_inertia`, `equatorial_inertia`, `gimbal_inertia`, `stiffness_anisotropy`, `stiffness_per_K`, `flexure_damping`, `gas_damping`, `lag_s` |
//! | gyro `.tuning` | `detuning_ppm` |
//! | gyro `.loop` | `bandwidth_hz`, `integral_hz`, `filter_hz`, `torquer_hz`, `phase_deg`, `network_s` = what the electronics take out per angular acceleration, along and across |
//! | gyro `.torque` | `axial_unbalance_m`, `axial_unbalance_m_per_K`, `flexure_twist_m`, `radial_compliance_m_per_N`, `axial_compliance_m_per_N`, `cross_compliance_m_per_N`, `radial_cross_compliance_m_per_N`, `axial_reaction_m`, `reaction_Nm`, `reaction_Nm_per_K`, `reaction_Nm_per_K_rise` of the magnet above the housing, `magnetic_moment_Am2` |
//! | gyro `.pickoff` | `offset_rad`, `offset_rad_per_K`, `offset_rad_per_K_per_m`, profiles `command_x_rad` and `command_y_rad`, `noise_rad_per_rtHz`, `runout_1n_rad`, `runout_2n_rad`, `vibration_2n_rad_s` |
//! | gyro `.torquer` | `scale_factor_ppm`, `asymmetry_ppm`, `quadratic_per_rad_s`, `odd_quadratic_per_rad_s`, `cubic_per_rad2_s2`, `gain_per_K`, `power_W_s2_per_rad2`, `magnet_K_per_W`, `magnet_lag_s` |
//! | `.electronics` | `offset`, `offset_per_K`, `offset_per_V` |
//! | `.noise` | `white` per √Hz, `markov`, `second_markov` = `{ sigma, tau_s }`, `exp_cos = { sigma, alpha, beta }`, `random_walk` per √s, `flicker = { instability, shortest_s, longest_s }` |
//! | `.nominal` | as in the case |
//! | `[[accelerometer]]` | `id`, `input_axis`, `pendulum_axis`, `arm_m`, `group`, `unit`, `recorded`, `relative`, `position_m`, `misalignment_arcsec`, `range`, `quantisation` or `pulse`, `full_rate` |
//! | accelerometer `.pendulum` | `pendulosity`, `inertia`, `damping`, `hinge_stiffness`, `servo_stiffness`, `integrator_gain`, `integrator_rate`, `torquer_rate`, `hinge_Nm`, `hinge_Nm_per_K`, `hinge_Nm_per_K_per_m` |
//! | accelerometer `.pickoff` | `offset_rad`, `offset_rad_per_K` |
//! | accelerometer `.torquer` | `scale_factor_ppm`, `asymmetry_ppm`, `quadratic_s2_per_m`, `odd_quadratic_s2_per_m`, `cubic_s4_per_m2`, `gain_per_K`, `power_W_s4_per_m2`, `magnet_K_per_W`, `magnet_lag_s` |
//! | `[[doppler]]` | `id`, `group`, `axis`, `arm_m`, `delay_s`, `misalignment_deg`, `scale_factor_ppm`, `range`, `quantisation`, `.noise`, `.nominal` |
//! | `[loop]` | `id`, `radius_m`, `gravity`, `velocity_error`, `tilt_rad`, `velocity_white`, `delay_s`, `channel` = north, east; `accelerometer`, `gyro` = id of an instrument, or `accelerometer_error`, `gyro_error` = a `.noise` in SI units; `nominal = { accelerometer, gyro, velocity_white }` |
//! | `[[loop.outage]]`, `[[gap]]` | `start_s`, `duration_s` |
//! | `[[disturbance]]` | `sensor`, `effect` and the keys of that effect, or `amplitude` and `signal` of an exported model: see `disturbance` |
//! | `[[fault]]` | `sensor`, `kind` = step, ramp, stuck, noise, dropout, gain; `size`, `onset_s`, `end_s` |
mod disturbance;
mod fields;
pub(crate) mod instruments;
mod setting;

use std::path::{Path, PathBuf};

use schuler_recording::case::{Nominal, Quantity};
use schuler_recording::document::{Node, Parsed, parse_with};
use schuler_recording::unit::Unit;
use schuler_recording::{Error, Leniency, file};

use crate::fitted::FittedDesign;
use crate::physics::doppler::DopplerDesign;
use crate::physics::environment::{EnvironmentDesign, Profile};
use crate::physics::fault::{Fault, TimedFault};
use crate::physics::fog::FogDesign;
use crate::physics::gyro::GyroDesign;
use crate::physics::motion::{Attitude, Motion, Site};
use crate::physics::parasite::Disturbance;
use crate::physics::pendulum::AccelerometerDesign;
use crate::physics::random::Process;

use fields::Fields;

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-scenario/1";

/// A scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// What it is, for people.
    pub title: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// Length, s.
    pub duration_s: f64,
    /// Step of the recording, s.
    pub step_s: f64,
    /// Parts into which a step is cut for the instruments' response to motion.
    pub parts: usize,
    /// Where the body stands or starts.
    pub site: Site,
    /// How it moves.
    pub motion: Motion,
    /// Site and motion as the case and the recorded reference have them, where they are other than the true ones.
    pub believed: Option<Believed>,
    /// What the case tells of the motion.
    pub told: Told,
    /// What surrounds the instruments.
    pub environment: EnvironmentDesign,
    /// What is recorded of the surroundings.
    pub recorded: Recorded,
    /// Gyros.
    pub gyros: Vec<GyroEntry>,
    /// Fibre-optic gyros.
    pub fogs: Vec<FogEntry>,
    /// Accelerometers.
    pub accelerometers: Vec<AccelerometerEntry>,
    /// Doppler beams or components.
    pub dopplers: Vec<DopplerEntry>,
    /// Schuler loop.
    pub schuler_loop: Option<LoopEntry>,
    /// Faults.
    pub faults: Vec<FaultEntry>,
    /// Disturbances.
    pub parasites: Vec<ParasiteEntry>,
    /// Terms that were fitted to a recording.
    pub fitted: Vec<FittedEntry>,
    /// Outputs that are older or slower than their time says.
    pub clocks: Vec<ClockEntry>,
    /// Fibre-optic gyros whose processor tells the turn over each step as a rotation vector, divided by the step, instead of the mean
    /// rate.
    pub rotation_vectors: Vec<String>,
    /// Rows that the recording lacks: start and length, s.
    pub gaps: Vec<(f64, f64)>,
}

/// Site and motion as their user believes them to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Believed {
    /// Where the body stands or starts.
    pub site: Site,
    /// How it moves.
    pub motion: Motion,
}

/// What the case tells of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// At rest, at the true attitude.
    Static,
    /// Rate and specific force in columns; see also [`Recorded::attitude`].
    Recorded,
    /// Velocity and attitude in columns.
    Navigation,
    /// Nothing.
    Unknown,
    /// The velocity error of the Schuler loop.
    VelocityError,
}

/// What is recorded of the surroundings.
#[derive(Clone, Debug, Default, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent switches")]
pub struct Recorded {
    /// Thermometers.
    pub thermometers: Vec<ThermometerEntry>,
    /// Other quantities that reach the electronics.
    pub quantities: Vec<QuantityEntry>,
    /// Whether the supply voltage is.
    pub voltage: bool,
    /// Whether the magnetic field in body axes is.
    pub magnetic_field: bool,
    /// Whether the vibration is.
    pub vibration: bool,
    /// Whether the specific force in body axes is, in a velocity-error case.
    pub specific_force: bool,
    /// Whether the attitude is, beside rate and specific force.
    pub attitude: bool,
    /// Id of the gyro whose pick-off angles are.
    pub pickoff: Option<String>,
}

/// A thermometer.
#[derive(Clone, Debug, PartialEq)]
pub struct ThermometerEntry {
    /// Its column.
    pub column: String,
    /// The sensor it sits at.
    pub near: Option<String>,
    /// Where it sits along the bar, m.
    pub position_m: f64,
    /// Its time constant, s.
    pub tau_s: f64,
    /// Noise per reading, K.
    pub white: f64,
    /// Step, K.
    pub quantisation: f64,
}

/// A gyro and what the case says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct GyroEntry {
    /// Id of its outputs about x and, if it is recorded, about y.
    pub ids: (String, Option<String>),
    /// Instrument it is part of.
    pub group: Option<String>,
    /// Unit of its columns.
    pub unit: Unit,
    /// Its parts.
    pub design: GyroDesign,
    /// Where it sits along the bar, m.
    pub position_m: f64,
    /// Angles of the pick-offs x and y at which its loop is told to hold the rotor, rad.
    pub pickoff_command: [Profile; 2],
    /// What the case believes, in `unit`.
    pub nominal: Nominal,
    /// Whether its columns are read against an unknown constant.
    pub relative: bool,
    /// Whether it has columns in the recording at all; one that has none may still drive the Schuler loop.
    pub recorded: bool,
}

/// An accelerometer and what the case says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct AccelerometerEntry {
    /// Its id.
    pub id: String,
    /// Instrument it is part of.
    pub group: Option<String>,
    /// Unit of its column.
    pub unit: Unit,
    /// Its parts.
    pub design: AccelerometerDesign,
    /// Where it sits along the bar, m.
    pub position_m: f64,
    /// What the case believes, in `unit`.
    pub nominal: Nominal,
    /// Whether its column is read against an unknown constant.
    pub relative: bool,
    /// Whether it has a column in the recording at all.
    pub recorded: bool,
}

/// A Doppler beam or component and what the case says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct DopplerEntry {
    /// Its id.
    pub id: String,
    /// Instrument it is part of.
    pub group: Option<String>,
    /// Its parts.
    pub design: DopplerDesign,
    /// What the case believes, in m/s.
    pub nominal: Nominal,
}

/// A fibre-optic gyro and what the case says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FogEntry {
    /// Its id.
    pub id: String,
    /// Instrument it is part of.
    pub group: Option<String>,
    /// Unit of its column.
    pub unit: Unit,
    /// Its parts.
    pub design: FogDesign,
    /// Where it sits along the bar, m.
    pub position_m: f64,
    /// What the case believes, in `unit`.
    pub nominal: Nominal,
    /// Whether its column is read against an unknown constant.
    pub relative: bool,
}

/// A disturbance and the output that it reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct ParasiteEntry {
    /// Id of the output.
    pub sensor: String,
    /// What disturbs, in SI units.
    pub disturbance: Disturbance,
}

/// A fitted term and the output that it reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedEntry {
    /// Id of the output.
    pub sensor: String,
    /// The term, in SI units.
    pub design: FittedDesign,
}

/// Outputs whose instruments feel the motion late.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockEntry {
    /// Ids of the outputs.
    pub sensors: Vec<String>,
    /// Age of what they tell, s.
    pub delay_s: f64,
    /// Time constant of a first-order lag, s.
    pub lag_s: f64,
}

/// A quantity of the surroundings beside those that have a place of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantityEntry {
    /// Its column.
    pub column: String,
    /// What it is.
    pub quantity: Quantity,
    /// Its unit.
    pub unit: String,
    /// The sensor it sits at.
    pub near: Option<String>,
    /// Its values.
    pub profile: Profile,
    /// Whether it is recorded.
    pub recorded: bool,
}

/// Where a sensor error of the Schuler loop comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum ErrorSource {
    /// A simulated instrument: output minus truth minus nominal bias. The id of its output.
    Instrument(String),
    /// Random drift and a white part (per √Hz), SI units.
    Process {
        /// Drift.
        drift: Vec<Process>,
        /// White noise density.
        white: f64,
    },
}

/// A Schuler loop.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopEntry {
    /// Id of the recorded velocity error.
    pub id: String,
    /// Radius of the Earth, m.
    pub radius_m: f64,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Velocity error at the start, m/s.
    pub velocity_error: f64,
    /// Tilt at the start, rad.
    pub tilt: f64,
    /// Where the accelerometer's error comes from.
    pub accelerometer: ErrorSource,
    /// Where the gyro's drift comes from.
    pub gyro: ErrorSource,
    /// Noise of the reference velocity per reading, m/s.
    pub velocity_white: f64,
    /// Delay of the reference velocity, s.
    pub delay_s: f64,
    /// Times without reference velocity: start and length, s.
    pub outages: Vec<(f64, f64)>,
    /// Whether the recording has the system's velocity itself instead of its difference to the reference.
    pub absolute: bool,
    /// Which component of the vehicle's velocity the channel carries.
    pub channel: Channel,
    /// What the case believes.
    pub nominal: schuler_recording::case::SchulerLoop,
}

/// A channel of a level platform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// North.
    North,
    /// East.
    East,
}

/// A fault and the output that has it.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultEntry {
    /// Id of the output.
    pub sensor: String,
    /// What goes wrong and when, in SI units.
    pub fault: TimedFault,
}

/// A scenario that was read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioFile {
    /// The file.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// What stands in it.
    pub scenario: Scenario,
    /// What its reader should be told.
    pub warnings: Vec<String>,
}

impl ScenarioFile {
    /// Reads the scenario at `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the file, by line and field.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::parse(path, &file::text(path, "read the scenario")?)
    }

    /// Reads a scenario from `text`, the content of the file `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the text, by line and field.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        Self::parse_with(path, text, Leniency::Strict)
    }

    /// Reads a scenario from `text` as strictly or leniently as asked.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_with(path: &Path, text: &str, leniency: Leniency) -> Result<Self, Error> {
        let Parsed { value: scenario, warnings, .. } = parse_with(path, text, leniency, read)?;
        Ok(Self { path: path.to_owned(), text: text.to_owned(), scenario, warnings })
    }
}

fn read(node: &Node<'_>) -> Option<Scenario> {
    let fields = Fields(node);
    let format = node.required("format", &format!("\"{FORMAT}\"")).and_then(|field| {
        let text = field.text()?;
        if text == FORMAT { Some(()) } else { field.wrong(&format!("\"{FORMAT}\"")) }
    });
    let title = fields.text("title").unwrap_or_default();
    let seed = fields.whole("seed", 1) as u64;
    let time = node.required("time", "a table [time]").and_then(|field| field.table(setting::time));
    let site = fields.table("site", setting::site).unwrap_or(Site {
        latitude: 0.0,
        height: 0.0,
        gravity_anomaly: 0.0,
    });
    let motion = fields.table("motion", setting::motion).unwrap_or(Motion::Static(Attitude::default()));
    let environment = setting::environment(node);
    let thermometers = node.tables("thermometer", setting::thermometer);
    let gyros = node.tables("gyro", instruments::gyro);
    let block = node.optional("block").map(|field| field.table(instruments::block));
    let accelerometers = node.tables("accelerometer", instruments::accelerometer);
    let dopplers = node.tables("doppler", instruments::doppler);
    let schuler_loop = fields.section("loop", setting::schuler_loop);
    let gaps = node.tables("gap", setting::interval);
    let faults = node.tables("fault", raw_fault);
    let blocks = node.tables("disturbance", disturbance::block);
    let (told, mut recorded) = fields.section("case", setting::case).unwrap_or_default();
    recorded.thermometers = thermometers?;
    format?;
    let (duration_s, step_s, parts) = time?;
    let mut gyros = gyros?;
    if let Some(block) = block {
        gyros.extend(block?);
    }
    let (accelerometers, dopplers, gaps, faults) = (accelerometers?, dopplers?, gaps?, faults?);
    let blocks = blocks?;

    let told = told.unwrap_or(match (&schuler_loop, &motion) {
        (Some(_), _) => Told::VelocityError,
        (None, Motion::Static(_)) => Told::Static,
        (None, _) => Told::Recorded,
    });
    let outputs = outputs(&gyros, &accelerometers, &dopplers, schuler_loop.as_ref());
    for (index, (id, _)) in outputs.iter().enumerate() {
        if outputs.iter().take(index).any(|(other, _)| other == id) {
            return node.problem_at("gyro", &format!("found two outputs \"{id}\"; expected unique ids"));
        }
    }
    if outputs.is_empty() {
        return node.problem_at(
            "gyro",
            "missing; expected [[gyro]], [[accelerometer]], [[doppler]], [block] or [loop]",
        );
    }
    if told == Told::VelocityError && schuler_loop.is_none() {
        return node.problem_at("loop", "missing; expected [loop], as case.motion is \"velocity_error\"");
    }
    if told == Told::Static && !matches!(motion, Motion::Static(_)) {
        return node
            .problem_at("case.motion", "found \"static\"; expected recorded or unknown, as the body moves");
    }
    let known = |id: &str| outputs.iter().find(|(other, _)| other == id);
    let faults = resolved(faults, &outputs, node)?;
    if let Some(entry) = &schuler_loop {
        for (key, source) in [("accelerometer", &entry.accelerometer), ("gyro", &entry.gyro)] {
            if let ErrorSource::Instrument(id) = source
                && known(id).is_none()
            {
                let found = format!("found \"{id}\"; expected the id of an output");
                return node.problem_at(&format!("loop.{key}"), &found);
            }
        }
    }
    let mut scenario = Scenario {
        title,
        seed,
        duration_s,
        step_s,
        parts,
        site,
        motion,
        believed: None,
        told,
        environment,
        recorded,
        gyros,
        fogs: Vec::new(),
        accelerometers,
        dopplers,
        schuler_loop,
        faults,
        parasites: Vec::new(),
        fitted: Vec::new(),
        clocks: Vec::new(),
        rotation_vectors: Vec::new(),
        gaps,
    };
    disturbance::place(&mut scenario, blocks, node)?;
    Some(scenario)
}

/// Faults in SI units, each of a known output.
fn resolved(faults: Vec<RawFault>, outputs: &[(String, f64)], node: &Node<'_>) -> Option<Vec<FaultEntry>> {
    let resolved = |(index, fault): (usize, RawFault)| {
        let Some((_, factor)) = outputs.iter().find(|(id, _)| *id == fault.sensor) else {
            let found = format!("found \"{}\"; expected the id of an output", fault.sensor);
            return node.problem_at(&format!("fault[{index}].sensor"), &found);
        };
        Some(FaultEntry { sensor: fault.sensor, fault: in_si(fault.timed, *factor) })
    };
    faults.into_iter().enumerate().map(resolved).collect()
}

/// Ids of all outputs, with the SI value of one of their unit.
fn outputs(
    gyros: &[GyroEntry],
    accelerometers: &[AccelerometerEntry],
    dopplers: &[DopplerEntry],
    schuler_loop: Option<&LoopEntry>,
) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for gyro in gyros {
        let factor = gyro.unit.in_si();
        all.push((gyro.ids.0.clone(), factor));
        all.extend(gyro.ids.1.clone().map(|id| (id, factor)));
    }
    all.extend(accelerometers.iter().map(|a| (a.id.clone(), a.unit.in_si())));
    all.extend(dopplers.iter().map(|d| (d.id.clone(), 1.0)));
    all.extend(schuler_loop.map(|entry| (entry.id.clone(), 1.0)));
    all
}

struct RawFault {
    sensor: String,
    timed: TimedFault,
}

fn raw_fault(node: &Node<'_>) -> Option<RawFault> {
    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Step,
        Ramp,
        Stuck,
        Noise,
        Dropout,
        Gain,
    }
    let fields = Fields(node);
    let sensor = node.required("sensor", "the id of an output").and_then(|field| field.text());
    let kind = node.required("kind", "step, ramp, stuck, noise, dropout or gain").and_then(|field| {
        field.one_of(&[
            ("step", Kind::Step),
            ("ramp", Kind::Ramp),
            ("stuck", Kind::Stuck),
            ("noise", Kind::Noise),
            ("dropout", Kind::Dropout),
            ("gain", Kind::Gain),
        ])
    });
    let onset_s = fields.not_negative("onset_s", 0.0);
    let end_s = fields.number("end_s", f64::INFINITY);
    let size = match kind {
        Some(Kind::Stuck) => 0.0,
        Some(Kind::Dropout) => fields.share("size", 1.0),
        _ => node
            .required("size", "the size of the fault in the output's unit (per second for a ramp)")
            .and_then(|field| field.number())
            .unwrap_or_default(),
    };
    let fault = match kind? {
        Kind::Step => Fault::Step(size),
        Kind::Ramp => Fault::Ramp(size),
        Kind::Stuck => Fault::Stuck,
        Kind::Noise => Fault::Noise(size),
        Kind::Dropout => Fault::Dropout(size),
        Kind::Gain => Fault::Gain(size),
    };
    Some(RawFault { sensor: sensor?, timed: TimedFault { fault, onset_s, end_s } })
}

fn in_si(timed: TimedFault, factor: f64) -> TimedFault {
    let fault = match timed.fault {
        Fault::Step(size) => Fault::Step(size * factor),
        Fault::Ramp(rate) => Fault::Ramp(rate * factor),
        Fault::Noise(sigma) => Fault::Noise(sigma * factor),
        other => other,
    };
    TimedFault { fault, ..timed }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario(text: &str) -> Result<Scenario, Error> {
        ScenarioFile::parse(Path::new("s.toml"), text).map(|file| file.scenario)
    }

    const SMALL: &str = r#"
format = "schuler-scenario/1"
[time]
duration_s = 60.0
[[gyro]]
id = "g"
unit = "deg/h"
"#;

    #[test]
    fn a_small_scenario_has_the_defaults_of_ideal_instruments() {
        let it = scenario(SMALL).unwrap();
        assert_eq!((it.step_s, it.parts, it.seed), (1.0, 1, 1));
        assert_eq!(it.told, Told::Static);
        let design = &it.gyros[0].design;
        let ideal = GyroDesign::ideal(100.0);
        // Tuned anew, so equal but for rounding.
        assert!((design.rotor.stiffness[0] / ideal.rotor.stiffness[0] - 1.0).abs() < 1e-12);
        assert_eq!(design.readout, ideal.readout);
        assert_eq!(design.pickoff_offset, ideal.pickoff_offset);
    }

    #[test]
    fn mistakes_name_line_field_and_expectation() {
        let wrong = |from: &str, to: &str| scenario(&SMALL.replace(from, to)).unwrap_err().to_string();
        assert_eq!(
            wrong("duration_s = 60.0", "duration_s = -1"),
            "s.toml:4: time.duration_s: found -1; expected a number greater than zero"
        );
        assert_eq!(
            wrong("unit = \"deg/h\"", "unit = \"g\""),
            "s.toml:7: gyro[0].unit: found \"g\"; expected a unit of angular rate: rad/s, deg/s, deg/h"
        );
        assert_eq!(
            wrong("unit = \"deg/h\"", "unnit = \"deg/h\""),
            "s.toml:7: gyro[0].unnit: unknown key; did you mean `unit`?"
        );
        assert_eq!(
            wrong("id = \"g\"", "id = \"g\"\nsecond_id = \"g\""),
            "s.toml:5: gyro: found two outputs \"g\"; expected unique ids"
        );
        let fault = format!("{SMALL}[[fault]]\nsensor = \"h\"\nkind = \"stuck\"\n");
        assert_eq!(
            scenario(&fault).unwrap_err().to_string(),
            "s.toml:9: fault[0].sensor: found \"h\"; expected the id of an output"
        );
        let unstable = format!("{SMALL}[gyro.loop]\nfilter_hz = 5000.0\n");
        let error = scenario(&unstable).unwrap_err().to_string();
        assert!(error.starts_with("s.toml:8: gyro[0].loop: the rebalance loop is unstable"), "{error}");
    }

    #[test]
    fn faults_are_converted_to_si() {
        let it =
            scenario(&format!("{SMALL}[[fault]]\nsensor = \"g\"\nkind = \"step\"\nsize = 3600.0\n")).unwrap();
        let Fault::Step(size) = it.faults[0].fault.fault else { panic!("{:?}", it.faults) };
        assert!((size - 1f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn a_block_is_five_gyros_of_one_design() {
        let text = SMALL.replace("[[gyro]]\nid = \"g\"", "[block]\nid = \"b\"");
        let it = scenario(&text).unwrap();
        let ids: Vec<_> = it.gyros.iter().map(|g| g.ids.0.as_str()).collect();
        assert_eq!(ids, ["b_1", "b_2", "b_3", "b_4", "b_5"]);
        assert!((it.gyros[1].design.input_axis.y + 0.77653).abs() < 2e-5);
        assert!(it.gyros.iter().all(|g| g.design.input_axis.dot(&g.design.spin_axis).abs() < 1e-12));
    }
}
