//! The flight module's outputs as a table: one row a step, SI units.
use std::path::Path;

use schuler_core::health;
use schuler_core::isolation::Verdict;
use schuler_core::module::StepOutput;
use schuler_recording::{Error, table};

use super::Flown;
use super::sensors::Place;
use crate::output;

/// Names of the filter's states with their units.
pub const STATES: [(&str, &str); 4] =
    [("velocity_error", "m/s"), ("tilt", "rad"), ("accelerometer_error", "m/s^2"), ("gyro_drift", "rad/s")];

/// A verdict as a number: 0 no fault, 1 to 5 this gyro, 6 detected and not isolated, 7 block untrusted.
pub fn verdict_code(verdict: Verdict) -> f64 {
    match verdict {
        Verdict::NoFault => 0.0,
        Verdict::Fault(gyro) => f64::from(gyro) + 1.0,
        Verdict::DetectedNotIsolated => 6.0,
        Verdict::BlockUntrusted => 7.0,
    }
}

/// A verdict of the health monitor as a number: 0 unobserved, 1 nominal, 2 shifted mean, 3 grown noise, 4 both, 5 one of the two,
/// 6 inertial divergence, 7 out of the model.
pub fn health_code(verdict: health::Verdict) -> f64 {
    match verdict {
        health::Verdict::Unobserved => 0.0,
        health::Verdict::Nominal => 1.0,
        health::Verdict::ShiftedMean => 2.0,
        health::Verdict::GrownNoise => 3.0,
        health::Verdict::ShiftedMeanAndGrownNoise => 4.0,
        health::Verdict::UndecidedFault => 5.0,
        health::Verdict::InertialDivergence => 6.0,
        health::Verdict::OutOfModel => 7.0,
    }
}

/// What the compensation makes of the sensor at an input: rad/s or m/s².
pub fn corrected(output: &StepOutput, place: Place) -> f64 {
    let it = &output.compensation;
    match place {
        Place::Gyro(k) => it.gyros.get(k),
        Place::Accelerometer(k) => it.accelerometers.get(k),
    }
    .copied()
    .unwrap_or(f64::NAN)
}

/// Writes the outputs of a channel, whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn write(flown: &Flown, path: &Path) -> Result<(), Error> {
    let columns = columns(flown);
    let named: Vec<(&str, &[f64])> =
        columns.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    output::atomically(path, |temporary| table::write(temporary, &named))
}

fn columns(flown: &Flown) -> Vec<(String, Vec<f64>)> {
    let outputs = &flown.outputs;
    let mut all = vec![("t".to_owned(), flown.channel.time_s.clone())];
    let mut put = |name: String, value: &dyn Fn(&StepOutput) -> f64| {
        all.push((name, outputs.iter().map(value).collect()));
    };
    put("status".to_owned(), &|o| f64::from(o.status.bits()));
    if flown.channel.has_velocity {
        for (k, (state, _)) in STATES.iter().enumerate() {
            put((*state).to_owned(), &|o| f64::from(o.filter.estimate[k]));
            put(format!("{state}.sigma"), &|o| f64::from(o.filter.sigma[k]));
            put(format!("{state}.averaged"), &|o| f64::from(o.identification.averaged.estimate[k]));
            put(format!("{state}.averaged_sigma"), &|o| f64::from(o.identification.averaged.sigma[k]));
        }
        put("innovation".to_owned(), &|o| f64::from(o.filter.innovation));
        put("innovation_variance".to_owned(), &|o| f64::from(o.filter.innovation_variance));
        put("nis".to_owned(), &|o| f64::from(o.filter.nis));
        put("retunes".to_owned(), &|o| f64::from(o.identification.retunes));
        for (name, noise) in [("accelerometer", 0), ("gyro", 1)] {
            let of = move |o: &StepOutput| {
                let estimate =
                    if noise == 0 { &o.identification.accelerometer } else { &o.identification.gyro };
                estimate.noise
            };
            put(format!("{name}.sigma"), &|o| f64::from(of(o).sigma));
            put(format!("{name}.alpha"), &|o| f64::from(of(o).alpha));
            put(format!("{name}.beta"), &|o| f64::from(of(o).beta));
        }
    }
    if flown.channel.gyros.is_some() {
        put("verdict".to_owned(), &|o| verdict_code(o.isolation.verdict));
        put("alarm_level".to_owned(), &|o| o.isolation.alarm_level);
        put("margin".to_owned(), &|o| o.isolation.margin);
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            put(format!("rate_{axis}"), &|o| o.isolation.rate[k]);
        }
        for k in 0..2 {
            put(format!("parity_{}", k + 1), &|o| o.isolation.parity[k]);
        }
        for k in 0..5 {
            put(format!("determinant_{}", k + 1), &|o| o.isolation.determinants[k]);
        }
        put("fault_size".to_owned(), &|o| o.isolation.fault_size);
        put("fault_size.sigma".to_owned(), &|o| o.isolation.fault_sigma);
    }
    for (k, column) in flown.channel.thermometers.iter().enumerate() {
        let of = |o: &StepOutput| o.thermometers.get(k).copied().unwrap_or_default();
        put(format!("{column}.temperature"), &|o| f64::from(of(o).temperature));
        put(format!("{column}.temperature.sigma"), &|o| f64::from(of(o).temperature_sigma));
        put(format!("{column}.rate"), &|o| f64::from(of(o).rate));
        put(format!("{column}.rate.sigma"), &|o| f64::from(of(o).rate_sigma));
        put(format!("{column}.status"), &|o| f64::from(of(o).status.bits()));
    }
    if flown.channel.compensation.is_some() {
        put("compensation.calibration".to_owned(), &|o| f64::from(o.compensation.calibration.bits()));
        put("compensation.terms".to_owned(), &|o| f64::from(o.compensation.terms.bits()));
        put("compensation.velocity".to_owned(), &|o| f64::from(o.compensation.velocity));
        put("compensation.accelerometer".to_owned(), &|o| f64::from(o.compensation.loop_errors[0]));
        put("compensation.gyro".to_owned(), &|o| f64::from(o.compensation.loop_errors[1]));
        for (id, place) in &flown.channel.sensors {
            put(format!("{id}.corrected"), &|o| corrected(o, *place));
        }
    }
    if flown.channel.has_health {
        put("health.verdict".to_owned(), &|o| health_code(o.health.verdict));
        put("health.suspect".to_owned(), &|o| f64::from(o.health.suspect as u8));
        put("health.status".to_owned(), &|o| f64::from(o.health.status.bits()));
        put("health.p_jump".to_owned(), &|o| f64::from(o.health.p_jump));
        put("health.p_noise".to_owned(), &|o| f64::from(o.health.p_noise));
        put("health.p_fault".to_owned(), &|o| f64::from(o.health.p_fault));
        for (mode, name) in ["nominal", "noise", "jump", "jump_and_noise"].iter().enumerate() {
            put(format!("health.mode.{name}"), &|o| {
                f64::from(o.health.mode_probability.as_flattened().get(mode).copied().unwrap_or(f32::NAN))
            });
        }
        put("health.residual".to_owned(), &|o| f64::from(o.health.residual));
        for name in ["radio_error", "inertial_error", "jump"] {
            let of = |o: &StepOutput| match name {
                "radio_error" => o.health.radio_error,
                "inertial_error" => o.health.inertial_error,
                _ => o.health.jump,
            };
            put(format!("health.{name}"), &|o| f64::from(of(o).value));
            put(format!("health.{name}.sigma"), &|o| f64::from(of(o).sigma));
        }
    }
    all
}
