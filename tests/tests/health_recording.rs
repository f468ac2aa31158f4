//! The health monitor on a real Doppler log against a real inertial system (underwater vehicle, six legs). The
//! radio's noise is identified on the other legs, with no knowledge of the one that is flown; the faults are
//! added to it.
use std::io::Write;
use std::path::PathBuf;

use schuler_core::health::{HealthAlarms, HealthConfig};
use schuler_explain::radio_identification::{InertialSpecification, identify_radio_noise};
use schuler_tests::health_reference::monitored::Monitored;

const LEGS: usize = 6;
const STEP_S: f64 = 1.0025;
/// Where a fault is added, steps.
const FAULT: std::ops::Range<usize> = 200..300;
const RESIDUAL_SIGMA: f64 = 0.002;
/// A fibre-optic inertial system that is aided between the legs.
const INERTIAL: InertialSpecification =
    InertialSpecification { random_walk: 5e-4, initial_sigma: 0.1, drift_sigma: 1e-5 };

/// Residuals of all legs: forward Doppler velocity minus inertial velocity along the same axis, m/s.
fn legs() -> Option<Vec<Vec<f64>>> {
    let root = std::env::var_os("SCHULER_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let folder = root.join("auv_doppler_ins");
    if !folder.is_dir() {
        // Past the test harness, which would swallow it.
        let _ =
            writeln!(std::io::stderr(), "\nSKIPPED: no recordings at {}; set SCHULER_DATA", folder.display());
        return None;
    }
    let leg = |number: usize| {
        let mut reader = csv::Reader::from_path(folder.join(format!("leg{number:02}.csv"))).expect("a leg");
        let names = ["vn_mps", "ve_mps", "vd_mps", "pitch_rad", "yaw_rad", "dvl_x_mps"];
        let headers = reader.headers().expect("a header").clone();
        let columns =
            names.map(|name| headers.iter().position(|header| header == name).expect("a known column"));
        reader
            .records()
            .map(|row| {
                let row = row.expect("a row");
                let [north, east, down, pitch, yaw, doppler] =
                    columns.map(|column| row[column].parse::<f64>().expect("a number"));
                doppler - (pitch.cos() * (yaw.cos() * north + yaw.sin() * east) - pitch.sin() * down)
            })
            .collect()
    };
    Some((1..=LEGS).map(leg).collect())
}

/// Configuration for one leg from all the others, and the σ it assumes, m/s.
fn config_without(legs: &[Vec<f64>], left_out: usize) -> (HealthConfig<f32, 2>, f64) {
    let mut others = Vec::new();
    for (_, leg) in legs.iter().enumerate().filter(|(index, _)| *index != left_out) {
        others.extend_from_slice(leg);
        others.push(f64::NAN);
    }
    let noise = identify_radio_noise(&others, STEP_S, RESIDUAL_SIGMA, &INERTIAL).expect("a fit");
    let (sigma, tau_s) = noise.upper_side(2.0);
    let mut config = HealthConfig::<f32, 2>::doppler_against_inertial();
    config.step_s = STEP_S as f32;
    config.radio.tau_s = tau_s as f32;
    config.radio.sigma = [sigma as f32, 3.0 * sigma as f32];
    config.jump.sigma = 3.0 * sigma as f32;
    config.inertial.random_walk = INERTIAL.random_walk as f32;
    config.inertial.initial_sigma = INERTIAL.initial_sigma as f32;
    config.inertial.drift_sigma = INERTIAL.drift_sigma as f32;
    config.inertial.drift_random_walk = 0.0;
    config.residual_sigma = RESIDUAL_SIGMA as f32;
    (config, sigma)
}

/// Steps in alarm over the leg and in the fault, and the delay from the fault's begin.
fn fly(
    config: &HealthConfig<f32, 2>,
    residuals: impl Iterator<Item = f64>,
    alarm: HealthAlarms,
) -> [usize; 3] {
    let mut monitored = Monitored::with(config);
    let on: Vec<bool> = residuals.map(|d| monitored.feed(Some(d), 1).alarms.contains(alarm)).collect();
    let inside = &on[FAULT];
    let count = |on: &[bool]| on.iter().filter(|on| **on).count();
    [count(&on), count(inside), inside.iter().position(|on| *on).unwrap_or(usize::MAX)]
}

#[test]
fn hlt_11_real_doppler_log() {
    let Some(legs) = legs() else { return };
    let mut false_alarms = 0;
    for (index, leg) in legs.iter().enumerate() {
        let (config, sigma) = config_without(&legs, index);
        let jump = |size: f64| {
            let faulty =
                leg.iter().enumerate().map(|(k, d)| if FAULT.contains(&k) { d + size * sigma } else { *d });
            fly(&config, faulty, HealthAlarms::JUMP)
        };
        let [in_alarm, ..] = jump(0.0);
        let [in_noise, ..] = fly(&config, leg.iter().copied(), HealthAlarms::NOISE);
        false_alarms += in_alarm;
        println!(
            "leg {}: σ {sigma:.3} m/s, τ {:.1} s; as recorded {in_alarm} s in jump alarm, {in_noise} s in noise alarm",
            index + 1,
            config.radio.tau_s
        );
        for size in [5.0, -5.0, 10.0, -10.0] {
            let [_, held, delay] = jump(size);
            println!("  jump of {size} σ: found after {delay} s, held {held} of {} s", FAULT.len());
            assert!(delay <= 15 && held >= 80, "leg {}, {size} σ", index + 1);
        }
    }
    let seconds: usize = legs.iter().map(Vec::len).sum();
    assert!(false_alarms * 50 <= seconds, "{false_alarms} s of {seconds} s in false jump alarm");
}
