//! The velocity error of a Schuler loop with its gyro and accelerometer.
use nalgebra::Vector3;
use schuler_recording::case::{Markov, Nominal};
use schuler_recording::unit::Unit;

use super::instruments::{accelerometer, gyro, still_loop};
use super::noise::{readout, round};
use super::surroundings::{gaps, surroundings};
use super::vehicle::platform;
use super::{Kind, Setting, empty, rows};
use crate::campaign::draw::Draw;
use crate::campaign::likelihood::{Loop, Noise};
use crate::physics::earth;
use crate::physics::random::Process;
use crate::scenario::{ErrorSource, Told};

/// Draws the setting.
pub(super) fn channel(most_rows: usize, seed: u64, draw: &mut Draw) -> Setting {
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
    let directions = [Vector3::x(), Vector3::y()];
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
