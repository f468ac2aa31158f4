//! What several sensors have in common: an instrument, a Schuler loop, a motion that only they tell.
use std::f64::consts::TAU;

use nalgebra::{Rotation3, Vector3};
use schuler_explain::catalogue::{Candidate, Port, Search, Target};
use schuler_explain::inputs::Inputs;
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, Quantity, SchulerLoop, SensorKind};
use schuler_recording::motion::{body_to_ned, earth};
use schuler_recording::unit::Unit;

use crate::scene::{Scene, at, candidates, column, difference, fx, fy, fz, signature, turning, wx, wy, wz};

#[test]
fn an_instrument_has_its_delay_arm_and_mounting_as_one() {
    let mut scene = turning();
    scene = scene.sensor("d2", SensorKind::Doppler, Unit::MetrePerSecond, [0.0, 1.0, 0.0]).sensor(
        "d3",
        SensorKind::Doppler,
        Unit::MetrePerSecond,
        [0.0, 0.0, 1.0],
    );
    for index in [2, 3, 4] {
        scene.0.sensors[index].sensor.group = Some("log".to_owned());
    }
    let inputs = Inputs::new(&scene.0);
    let group = |id: &str| -> Vec<Candidate> {
        (candidates(&inputs, id).into_iter())
            .filter(|candidate| matches!(&candidate.target, Target::Group { name, .. } if name == "log"))
            .collect()
    };
    let v = |t: f64| 5.0 + (0.4 * t).sin();
    let e = |t: f64| (0.3 * t).cos();
    let delay = &group("time_delay")[0];
    assert_eq!(delay.target, Target::Group { name: "log".to_owned(), sensors: vec![2, 3] }, "down is still");
    let parts = &signature(delay, &[0.5]).columns[0].parts;
    assert!(difference(&scene, &parts[0].1, |t| v(t - 0.5) - v(t), 1.0) < 1e-3);
    assert!(difference(&scene, &parts[1].1, |t| e(t - 0.5) - e(t), 1.0) < 1e-3);
    assert!(at(&inputs, "time_delay", 2, &[]).is_empty(), "a delay is the log's");
    // One gyro of a unit may be late alone.
    let mut unit = turning();
    unit.0.sensors.truncate(2);
    unit.0.sensors.iter_mut().for_each(|series| series.sensor.group = Some("unit".to_owned()));
    let late = candidates(&Inputs::new(&unit.0), "time_delay");
    assert!(late.iter().any(|candidate| candidate.target == Target::Sensor(0)));
    assert!(late.iter().any(|candidate| matches!(candidate.target, Target::Group { .. })));
    assert_eq!(group("lever_arm").len(), 1);
    assert_eq!(group("scale_factor").len(), 1);
    // ε × a for a = x: ε about z moves x towards y: reads ε v_y; about y towards −z.
    let mounting = &group("misalignment")[0];
    let about_z = mounting.amplitudes.iter().position(|amplitude| amplitude.name == "angle_z").unwrap();
    let parts = &signature(mounting, &[]).columns[about_z].parts;
    assert!(difference(&scene, &parts[0].1, e, 0.0) < 1e-12);
    assert!(difference(&scene, &parts[1].1, |t| -v(t), 0.0) < 1e-12);
    // About each axis alone as well: a mounting that is wrong about one is one number.
    for (name, about) in [("angle_x", 0), ("angle_y", 1), ("angle_z", 2)] {
        let alone: Vec<Candidate> = (group("misalignment").into_iter())
            .filter(|it| it.amplitudes.len() == 1 && it.amplitudes[0].name == name)
            .collect();
        let whole = signature(mounting, &[]);
        match (mounting.amplitudes.iter().position(|amplitude| amplitude.name == name), &alone[..]) {
            (Some(column), [alone]) => {
                let (of_one, of_all) = (&signature(alone, &[]).columns[0], &whole.columns[column]);
                assert_eq!(of_one.parts, of_all.parts, "{name}");
            }
            (None, []) => {}
            _ => panic!("{name} ({about}): {} alone", alone.len()),
        }
    }
}

/// A body that is turned from pose to pose shows north and down by the rate and the specific force that are recorded of it.
#[test]
fn a_body_that_stands_now_and_then_shows_the_error_of_its_heading() {
    const LATITUDE_DEG: f64 = 50.0;
    let ned = earth::rotation_ned(LATITUDE_DEG.to_radians());
    let turn_rate = Vector3::new(0.02, -0.01, 0.03);
    let turns = |row: usize| (200..260).contains(&row) || (500..560).contains(&row);
    let mut attitude = body_to_ned(0.3, 0.2, 1.0);
    let mut scene = Scene::new(MotionKind::Recorded, 900, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .site(LATITUDE_DEG);
    let (mut rate, mut force) = ([vec![], vec![], vec![]], [vec![], vec![], vec![]]);
    let mut expected = Vec::new();
    let gravity = earth::gravity(LATITUDE_DEG.to_radians(), 0.0);
    for row in 0..900 {
        let to_body = attitude.inverse();
        let turn = if turns(row) { turn_rate } else { Vector3::zeros() };
        let columns =
            [(&mut rate, to_body * ned + turn), (&mut force, to_body * Vector3::new(0.0, 0.0, -gravity))];
        for (columns, vector) in columns {
            columns.iter_mut().zip(vector.iter()).for_each(|(column, value)| column.push(*value));
        }
        expected.push(-(to_body * Vector3::new(0.0, ned.x, 0.0)).x);
        if turns(row) {
            attitude *= Rotation3::new(turn_rate);
        }
    }
    scene.0.motion.rate = Some(rate.clone());
    scene.0.motion.specific_force = Some(force.clone());
    let of_heading = |scene: &Scene| {
        let found = at(&Inputs::new(&scene.0), "earth_rate_attitude", 0, &[("angle", "heading")]);
        found.first().map(|found| column(found, &[], 0, 900))
    };
    let found = of_heading(&scene).unwrap();
    for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
        // The rate within a step is not known.
        let most = if turns(row) { 0.03 } else { 1e-9 };
        assert!((found - expected).abs() < most * ned.x, "{row}: {found:e} {expected:e}");
    }
    // One that never stands still does not.
    scene.0.motion.rate.as_mut().unwrap()[1].iter_mut().for_each(|rate| *rate += 1e-3);
    assert!(of_heading(&scene).is_none());
    scene.0.motion.rate = Some(rate);
    scene.0.motion.specific_force.as_mut().unwrap()[1].iter_mut().for_each(|force| *force += 5.0);
    assert!(of_heading(&scene).is_none());
}

/// Of two instruments that are each other's reference the one comes early where the other comes late; beside a known motion an instrument
/// comes early where the reference is late.
#[test]
fn instruments_that_check_each_other_come_late_and_never_early() {
    let of = |scene: Scene| scene.sensor("d", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    let mut scene = of(Scene::new(MotionKind::Unknown, 401, 1.0));
    scene = scene.sensor("ins", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    for series in &mut scene.0.sensors {
        series.values = (0..401).map(|row| (0.05 * f64::from(row)).sin()).collect();
    }
    let still: fn(f64) -> f64 = |_| 0.0;
    let mut known = of(Scene::new(MotionKind::Recorded, 401, 1.0));
    known.0.motion.attitude_rad = Some(known.columns([still, still, still]));
    known.0.motion.velocity_ned = Some(known.columns([|t| (0.05 * t).sin(), still, still]));
    for (scene, sensors, comes_early) in [(scene, 2, false), (known, 1, true)] {
        let inputs = Inputs::new(&scene.0);
        for sensor in 0..sensors {
            let found = at(&inputs, "time_delay", sensor, &[]);
            let Search::Grid { parameters, .. } = &found[0].search else { panic!("no grid") };
            assert_eq!(parameters[0].grid.iter().any(|delay| *delay < 0.0), comes_early, "{sensor}");
        }
    }
}

#[test]
fn a_schuler_loop_has_accelerometer_gyro_and_velocity() {
    let mut scene = Scene::new(MotionKind::VelocityError, 7201, 1.0)
        .sensor("dv", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, |t| 25.0 + 5.0 * (t / 1500.0).sin())
        .aux("Tg", Quantity::Temperature, "degC", Some("gyro"), |t| 25.0 + 5.0 * (t / 1500.0).cos());
    scene.0.case.schuler_loop = Some(SchulerLoop::default());
    scene.0.motion.specific_force = Some(scene.columns([fx, fy, fz]));
    scene.0.motion.velocity_ned =
        Some(scene.columns([|t| 100.0 + 10.0 * (0.01 * t).sin(), |_| 0.0, |_| 0.0]));
    let inputs = Inputs::new(&scene.0);
    let names: Vec<&str> = inputs.places.iter().map(|place| place.name.as_str()).collect();
    assert_eq!(names, ["accelerometer", "gyro", "velocity"]);
    let ports = |id: &str| -> Vec<Port> { candidates(&inputs, id).iter().map(|found| found.port).collect() };
    assert_eq!(ports("bias_constant"), [Port::Accelerometer, Port::Gyro, Port::Output]);
    assert_eq!(ports("bias_temperature"), [Port::Accelerometer, Port::Gyro]);
    assert_eq!(ports("g_mass_unbalance"), [Port::Gyro]);
    assert_eq!(ports("scale_factor"), [Port::Accelerometer, Port::Output]);
    assert_eq!(ports("scale_factor_quadratic"), [Port::Accelerometer, Port::Output]);
    assert!(ports("time_delay").contains(&Port::Output));
    let mut grouped = Recording::clone(&scene.0);
    grouped.sensors[0].sensor.group = Some("channel".to_owned());
    let delays = candidates(&Inputs::new(&grouped), "time_delay");
    assert!(
        delays.iter().any(|found| found.port == Port::Output),
        "its group takes nothing from the loop's velocity"
    );
    assert_eq!(ports("noise_outliers"), [Port::Output]);
    let by_column: Vec<_> = (candidates(&inputs, "bias_temperature").iter())
        .map(|found| found.variant.iter().find(|(name, _)| *name == "column").unwrap().1.clone())
        .collect();
    assert_eq!(by_column, ["T", "Tg"], "a thermometer near the gyro is the gyro's");
    // A speed beside it is the velocity of which the channel has an error, if no velocity is there.
    let mut scene =
        Scene(scene.0.clone()).aux("speed", Quantity::Speed, "m/s", None, |t| 20.0 + 2.0 * (0.01 * t).cos());
    let of_velocity = |scene: &Scene| {
        let found = candidates(&Inputs::new(&scene.0), "scale_factor");
        let own = found.iter().find(|found| found.port == Port::Output);
        own.map(|own| column(own, &[], 0, 7201)[100])
    };
    assert!((of_velocity(&scene).unwrap() - (100.0 + 10.0 * 1.0_f64.sin())).abs() < 1e-9);
    scene.0.motion.velocity_ned = None;
    assert!((of_velocity(&scene).unwrap() - (20.0 + 2.0 * 1.0_f64.cos())).abs() < 1e-9);
    scene.0.auxiliaries.pop();
    assert!(of_velocity(&scene).is_none());
    assert_eq!(candidates(&inputs, "bias_temperature")[0].amplitudes[0].unit, "m/s^2/K");
}

#[test]
fn redundant_sensors_tell_the_motion_that_no_one_knows() {
    // A radio beside an inertial velocity: the better one leads.
    let mut scene = Scene::new(MotionKind::Unknown, 1000, 1.0)
        .sensor("ins", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .last(|sensor| sensor.nominal.white = 0.01)
        .sensor("radio", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    let truth = |t: f64| 50.0 + 5.0 * (0.05 * t).sin();
    let noise = |t: f64, of: f64| 12.0_f64.sqrt() * (((t * of).sin() * 43_758.545_3).fract().abs() - 0.5);
    scene.0.sensors[0].values = scene.sample(|t| truth(t) + 0.01 * noise(t, 12.9898));
    scene.0.sensors[1].values = scene.sample(|t| truth(t) + 3.0 + noise(t, 78.233));
    scene.0.sensors[1].values[500] = f64::NAN;
    let inputs = Inputs::new(&scene.0);
    let values = column(&at(&inputs, "scale_factor", 1, &[])[0], &[], 0, 1000);
    // Smoothed, within the noise of the better one: in the mean square, and three of it in any row.
    let expected = |t: f64| truth(t) + 3.0 / 10_001.0;
    let squares = scene.0.elapsed_s().zip(&values).map(|(t, found)| (found - expected(t)).powi(2));
    assert!((squares.sum::<f64>() / 1000.0).sqrt() < 0.01);
    assert!(difference(&scene, &values, expected, 0.0) < 0.03 / 55.0);

    // Five gyros on a cone: the estimate is the rate, though one of them is absent for a while.
    let mut scene = Scene::new(MotionKind::Unknown, 1000, 1.0);
    let axes: Vec<[f64; 3]> = (0..5)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 5.0).sin_cos();
            [0.8 * cos, 0.8 * sin, 0.6]
        })
        .collect();
    for (index, axis) in axes.iter().enumerate() {
        scene = scene.sensor(&format!("g{index}"), SensorKind::Dtg, Unit::DegreePerHour, *axis);
        let [x, y, z] = *axis;
        // Nothing to smooth.
        scene.0.sensors[index].sensor.nominal.white = 0.0;
        scene.0.sensors[index].values = scene.sample(|t| x * wx(t) + y * wy(t) + z * wz(t));
    }
    scene.0.sensors[2].values[100..300].fill(f64::NAN);
    let inputs = Inputs::new(&scene.0);
    let rate = inputs.motion.rate.as_ref().unwrap();
    assert!(difference(&scene, &rate[0], wx, 0.0) < 1e-9);
    assert!(difference(&scene, &rate[2], wz, 0.0) < 1e-9);
    assert_eq!(candidates(&inputs, "scale_factor").len(), 5);
    assert!(!inputs.conditions().is_empty());
}
