//! Instruments as a setting puts them into its scenario.
use nalgebra::Vector3;
use schuler_recording::case::{Nominal, SchulerLoop as NominalLoop};
use schuler_recording::unit::Unit;

use super::UNIT;
use super::noise::{noise, readout};
use crate::campaign::draw::Draw;
use crate::campaign::likelihood::Noise;
use crate::physics::doppler::DopplerDesign;
use crate::physics::earth;
use crate::physics::environment::Profile;
use crate::physics::fog::FogDesign;
use crate::physics::gyro::GyroDesign;
use crate::physics::pendulum::{AccelerometerDesign, Pendulum};
use crate::physics::readout::ReadoutDesign;
use crate::scenario::{
    AccelerometerEntry, Channel, DopplerEntry, ErrorSource, FogEntry, GyroEntry, LoopEntry, Scenario,
};

/// Spin speed of tuned gyros, Hz.
const SPIN_HZ: f64 = 200.0;

/// A tuned gyro with its input axis x and its spin axis z.
pub(super) fn gyro(
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
pub(super) fn make_strapdown(entry: &mut GyroEntry) {
    let d = &entry.design;
    entry.design = GyroDesign {
        readout: d.readout.clone(),
        input_axis: d.input_axis,
        spin_axis: d.spin_axis,
        ..GyroDesign::strapdown(SPIN_HZ)
    };
}

/// A fibre-optic gyro.
pub(super) fn fog(
    id: &str,
    axis: Vector3<f64>,
    unit: Unit,
    design: ReadoutDesign,
    nominal: Nominal,
) -> FogEntry {
    let design = FogDesign { readout: design, ..FogDesign::ideal(axis) };
    FogEntry { id: id.to_owned(), group: None, unit, design, position_m: 0.0, nominal, relative: false }
}

/// An accelerometer with its input axis and its pendulum axis.
pub(super) fn accelerometer(
    id: &str,
    [input_axis, pendulum_axis]: [Vector3<f64>; 2],
    unit: Unit,
    design: ReadoutDesign,
    nominal: Nominal,
) -> AccelerometerEntry {
    let mut entry = AccelerometerEntry {
        id: id.to_owned(),
        group: None,
        unit,
        design: AccelerometerDesign {
            input_axis,
            pendulum_axis,
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

/// Three fibre-optic gyros and three accelerometers of one unit.
pub(super) fn strapdown(
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
        let directions = [axes[k], axes[(k + 1) % 3]];
        let mut entry = accelerometer(&id, directions, Unit::MicroG, readout(&it, step), nominal);
        entry.group = Some(UNIT.to_owned());
        scenario.accelerometers.push(entry);
        all.push((id, it));
    }
    all
}

/// A beam of a Doppler log, or its only one.
pub(super) fn doppler(
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

/// A Schuler loop at rest whose instruments have no errors.
pub(super) fn still_loop(id: &str, velocity_white: f64) -> LoopEntry {
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
