//! The velocity of the body from that of a point beside it, such as an antenna.
use nalgebra::Vector3;

use super::earth;
use super::kinematics::{Use, columns, inertial_rate, rotation, vector};

/// Velocity north, east, down, m/s, of the body's reference point: `v − C_nb (ω_nb × r)`, where `velocity_ned` is that of the point at
/// `r` = `position_m` in body axes.
///
/// One value a row each, NaN = missing; a row has no velocity where its own or its attitude is missing, or the attitude before or after
/// it.
pub(crate) fn velocity_of_body(
    time_s: &[f64],
    attitude_rad: &[Vec<f64>; 3],
    velocity_ned: &[Vec<f64>; 3],
    position_m: [f64; 3],
) -> [Vec<f64>; 3] {
    // The turn beside the ground: on the Earth at rest less the Earth's own, wherever that is.
    let rates = inertial_rate(time_s, attitude_rad, None, 0.0, 0.0, Use::Instant);
    let arm = Vector3::from(position_m);
    columns(time_s.len(), |row| {
        let attitude = rotation(vector(attitude_rad, row)?);
        let turn = vector(&rates, row)? - attitude.inverse() * earth::rotation_ned(0.0);
        Some(vector(velocity_ned, row)? - attitude * turn.cross(&arm))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::body_to_ned;

    #[test]
    fn an_antenna_goes_round_a_body_that_stays() {
        // Sways with 5 s about two axes and turns about the third, at 50 Hz.
        let angles = |t: f64| [0.2 * (1.2 * t).sin(), 0.1 * (1.3 * t + 0.4).sin(), 0.3 * t];
        let arm = [1.5, -0.4, -2.0];
        let place = |t: f64| {
            let [roll, pitch, yaw] = angles(t);
            body_to_ned(roll, pitch, yaw) * Vector3::from(arm)
        };
        let time_s: Vec<f64> = (0..500).map(|row| f64::from(row) * 0.02).collect();
        let column = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { time_s.iter().map(|&t| of(t)).collect() };
        let attitude = [0, 1, 2].map(|axis| column(&|t| angles(t)[axis]));
        let body = [7.0, -3.0, 0.5];
        let velocity = [0, 1, 2]
            .map(|axis| column(&|t| body[axis] + (place(t + 1e-4)[axis] - place(t - 1e-4)[axis]) / 2e-4));
        let found = velocity_of_body(&time_s, &attitude, &velocity, arm);
        for (axis, found) in found.iter().enumerate() {
            assert!((velocity[axis][200] - body[axis]).abs() > 0.02, "the antenna goes otherwise");
            for row in 20..480 {
                assert!((found[row] - body[axis]).abs() < 1e-5, "axis {axis}, row {row}: {}", found[row]);
            }
        }
    }
}
