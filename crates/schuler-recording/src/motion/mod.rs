//! What the body did, and what an ideal sensor on it would have read.
//!
//! Frames: n = north-east-down at the body, b = body axes. Attitude is 3-2-1: `C_nb = Rz(yaw) Ry(pitch) Rx(roll)`
//! turns body components into north-east-down. `[Groves, Principles of GNSS, Inertial, and Multisensor Integrated
//! Navigation Systems, 2nd ed., ch. 2 and 5]`
mod antenna;
mod derivative;
pub mod earth;
mod forms;
mod kinematics;
mod predict;
mod stamps;

use nalgebra::{Rotation3, Vector3};

pub(crate) use antenna::velocity_of_body;
pub(crate) use forms::roll_pitch_yaw;
pub use kinematics::{Use, inertial_rate, specific_force};
pub use predict::{Prediction, Unpredictable, is_resolved_over_earth, predict};
pub(crate) use stamps::last_place;

/// Rotation from body axes to north-east-down for roll, pitch and yaw in radians.
pub fn body_to_ned(roll: f64, pitch: f64, yaw: f64) -> Rotation3<f64> {
    Rotation3::from_euler_angles(roll, pitch, yaw)
}

/// Inertial rate in body axes, rad/s, of a body at rest on the Earth at `latitude` (rad) with the attitude `ned`
/// (from body axes to north-east-down).
pub fn rate_at_rest(ned: &Rotation3<f64>, latitude: f64) -> Vector3<f64> {
    ned.inverse() * earth::rotation_ned(latitude)
}

/// Specific force in body axes, m/s², of a body at rest on the Earth at `latitude` (rad) and `altitude_m`, with the
/// attitude `ned` (from body axes to north-east-down). A level body reads −g along its z axis, which points down.
pub fn specific_force_at_rest(ned: &Rotation3<f64>, latitude: f64, altitude_m: f64) -> Vector3<f64> {
    ned.inverse() * Vector3::new(0.0, 0.0, -earth::gravity(latitude, altitude_m))
}
