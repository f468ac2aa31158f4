//! Rates and forces against the attitude, velocity and position that they integrate to.
use nalgebra::Unit;

use super::*;

#[test]
fn an_anomaly_of_gravity_is_felt_and_nothing_else_is() {
    let at =
        |site| Trajectory::new(Motion::Static(Attitude { pitch: 0.3, ..Attitude::default() }), site).at(0.0);
    let (normal, other) = (at(SITE), at(Site { gravity_anomaly: 1e-3, ..SITE }));
    let felt = other.attitude * (other.specific_force - normal.specific_force);
    assert!((felt - Vector3::new(0.0, 0.0, -1e-3)).norm() < 1e-14);
    assert_eq!(other.rate, normal.rate);
}

const SITE: Site = Site { latitude: 0.97, height: 150.0, gravity_anomaly: 0.0 };

#[test]
fn a_static_body_feels_gravity_and_the_earth() {
    let attitude = Attitude { roll: 0.3, pitch: -0.2, heading: 1.1 };
    let k = Trajectory::new(Motion::Static(attitude), SITE).at(100.0);
    assert!((k.specific_force.norm() - earth::gravity(SITE.latitude, SITE.height)).abs() < 1e-12);
    assert!((k.rate.norm() - earth::EARTH_RATE).abs() < 1e-15);
    // Level, heading east: x sees none of the horizontal rate, y sees it reversed.
    let east = Attitude { heading: std::f64::consts::FRAC_PI_2, ..Attitude::default() };
    let k = Trajectory::new(Motion::Static(east), SITE).at(0.0);
    assert!(k.rate.x.abs() < 1e-18 && (k.rate.y + earth::EARTH_RATE * SITE.latitude.cos()).abs() < 1e-18);
    assert!((k.specific_force.z + earth::gravity(SITE.latitude, SITE.height)).abs() < 1e-12);
    // Nose up: x, forward, feels the support's push.
    let up = Attitude { pitch: 0.1, ..Attitude::default() };
    assert!(Trajectory::new(Motion::Static(up), SITE).at(0.0).specific_force.x > 0.9);
}

/// Integrates the rate minus the Earth's into an attitude and the specific force into a velocity, and compares.
fn check_consistency(motion: Motion, duration_s: f64, steps: usize) {
    let mut trajectory = Trajectory::new(motion, SITE);
    let h = duration_s / steps as f64;
    let start = trajectory.at(0.0);
    let (mut attitude, mut velocity) = (start.attitude, start.velocity);
    for k in 0..steps {
        let t = k as f64 * h;
        let middle = trajectory.at(t + 0.5 * h);
        let transport = earth::transport_rate_ned(middle.latitude, middle.height, &middle.velocity);
        let navigation = earth::earth_rate_ned(middle.latitude) + transport;
        let body = middle.rate - middle.attitude.inverse() * navigation;
        let gravity = Vector3::new(0.0, 0.0, earth::gravity(middle.latitude, middle.height));
        let coriolis = (earth::earth_rate_ned(middle.latitude) * 2.0 + transport).cross(&middle.velocity);
        let mid_attitude = attitude * UnitQuaternion::from_scaled_axis(body * (0.5 * h));
        velocity += (mid_attitude * middle.specific_force - coriolis + gravity) * h;
        attitude *= UnitQuaternion::from_scaled_axis(body * h);
    }
    let end = trajectory.at(duration_s);
    assert!(attitude.angle_to(&end.attitude) < 2e-6, "{}", attitude.angle_to(&end.attitude));
    assert!((velocity - end.velocity).norm() < 2e-4, "{velocity} {}", end.velocity);
}

#[test]
fn a_vehicle_s_rate_and_force_integrate_to_its_attitude_and_velocity() {
    let vehicle = Vehicle {
        speed: 60.0,
        heading: 0.4,
        bank_share: 1.0,
        sway: Sway { roll: 0.05, pitch: 0.03, period_s: 8.0 },
        level_platform: false,
        steps: vec![
            VehicleStep { duration_s: 20.0, speed_change: 15.0, heading_change: 0.0, height_change: 40.0 },
            VehicleStep { duration_s: 30.0, speed_change: 0.0, heading_change: 2.0, height_change: 0.0 },
            VehicleStep { duration_s: 20.0, speed_change: -30.0, heading_change: -1.0, height_change: -9.0 },
        ],
    };
    check_consistency(Motion::Vehicle(vehicle.clone()), 80.0, 40_000);
    check_consistency(Motion::Vehicle(Vehicle { level_platform: true, ..vehicle }), 80.0, 40_000);
}

#[test]
fn a_table_s_rate_integrates_to_its_attitude() {
    let axis = |x: f64, y: f64, z: f64| Unit::new_normalize(Vector3::new(x, y, z));
    let steps = vec![
        TableStep::Dwell { duration_s: 5.0 },
        TableStep::Turn { axis: axis(1.0, 0.0, 0.0), angle: 1.2, duration_s: 6.0 },
        TableStep::Spin { axis: axis(0.0, 1.0, 1.0), rate: -0.7, duration_s: 20.0, ramp_s: 3.0 },
        TableStep::Cone { axis: axis(1.0, 0.0, 1.0), amplitude: 0.1, frequency_hz: 0.5, duration_s: 8.0 },
        TableStep::Swing { axis: axis(0.0, 0.0, 1.0), amplitude: 0.1, frequency_hz: 0.5, duration_s: 12.0 },
    ];
    let start = Attitude { roll: 0.1, pitch: 0.2, heading: 0.3 };
    check_consistency(Motion::Table { start, steps }, 58.0, 29_000);
}

#[test]
fn a_spin_turns_by_rate_times_effective_time() {
    let step = TableStep::Spin { axis: Vector3::z_axis(), rate: 0.5, duration_s: 30.0, ramp_s: 4.0 };
    let (angle, rate) = step.angle_and_rate(30.0);
    assert!((angle - 0.5 * 26.0).abs() < 1e-12 && rate.abs() < 1e-12);
    let (_, rate) = step.angle_and_rate(15.0);
    assert_eq!(rate, 0.5);
}

#[test]
fn going_east_moves_the_longitude() {
    let vehicle = Vehicle {
        speed: 100.0,
        heading: std::f64::consts::FRAC_PI_2,
        bank_share: 0.0,
        sway: Sway::default(),
        level_platform: true,
        steps: vec![],
    };
    let k = Trajectory::new(Motion::Vehicle(vehicle), SITE).at(3600.0);
    let (_, prime_vertical) = earth::radii(SITE.latitude);
    let expected = 100.0 * 3600.0 / ((prime_vertical + SITE.height) * SITE.latitude.cos());
    assert!((k.longitude - expected).abs() < 1e-9 && (k.latitude - SITE.latitude).abs() < 1e-12);
}
