//! Late instruments, and single late sensors of one, are told with their delay.
use crate::turning::{Turning, rate};
use crate::{delay_of, only, physics};

/// Delays, s, from much less than a row to as long as radios have.
const LATE_S: [f64; 14] =
    [0.0001, 0.0005, 0.002, 0.005, 0.013, 0.03, 0.05, 0.08, 0.12, 0.15, 0.2, 0.45, 1.0, 2.0];
/// Delays below which a lag is the same function of this motion.
const LIKE_A_LAG_S: f64 = 0.003;
/// Standard deviations within which a delay is right.
const WITHIN: f64 = 3.0;

/// Compares what is told of gyros late by so much with that.
fn assert_told(sensor: &str, late_s: f64, of_gyros: [f64; 3]) {
    let explanation = Turning::default().explained_late(of_gyros);
    if late_s < LIKE_A_LAG_S {
        let told = physics(&explanation);
        let [finding] = told.as_slice() else { panic!("{late_s} s: {told:#?}") };
        assert!(finding.sensor == sensor && finding.may_be("time_delay"), "{late_s} s: {finding:#?}");
        let time = finding.parameters.iter().find(|it| ["delay_s", "tau_s"].contains(&it.name.as_str()));
        let (value, sigma) = time.and_then(|time| time.value.zip(time.sigma)).expect("a delay or a lag");
        assert!((value - late_s).abs() < WITHIN * sigma, "{late_s} s: {value} ± {sigma}");
        return;
    }
    assert_eq!(only(&explanation), (sensor, "time_delay"), "{late_s} s");
    let (value, sigma) = delay_of(&explanation);
    assert!((value - late_s).abs() < WITHIN * sigma, "{late_s} s: {value} ± {sigma}");
    // A fortieth of the shortest period: no deviation so large that anything would be right.
    assert!(sigma < 0.01, "{late_s} s: {value} ± {sigma}");
}

#[test]
fn a_late_instrument_is_told_with_its_delay() {
    for late_s in LATE_S {
        assert_told("imu", late_s, [late_s; 3]);
    }
}

/// The instrument's clock loses or gains so much of the reference's.
#[test]
fn a_clock_that_drifts_is_told_with_its_drift() {
    let slow = Turning { reads: |axis, time_s| rate(axis, time_s * (1.0 - 40e-6)), ..Turning::default() };
    let fast = Turning { reads: |axis, time_s| rate(axis, time_s * (1.0 + 150e-6)), ..Turning::default() };
    for (drift, turning) in [(40.0, slow), (-150.0, fast)] {
        let explanation = turning.explained(0.0);
        assert_eq!(only(&explanation), ("imu", "clock_drift"), "{drift} ppm");
        let parameters = &explanation.findings[0].parameters;
        let told = parameters.iter().find(|it| it.name == "drift").expect("a drift");
        let (value, sigma) = (told.value.expect("a value"), told.sigma.expect("a sigma"));
        assert!((value - drift).abs() < WITHIN * sigma && sigma < 5.0, "{drift} ppm: {value} ± {sigma}");
    }
}

#[test]
fn a_late_sensor_of_an_instrument_is_told_with_its_delay() {
    for late_s in LATE_S {
        assert_told("gy", late_s, [0.0, late_s, 0.0]);
    }
}
