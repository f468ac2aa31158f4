//! What the body really does: bench, rate table, vehicle.
//!
//! Body axes: x forward, y starboard, z down. Navigation axes: north, east, down. Attitude: body from navigation axes,
//! heading, pitch, roll in turn (3-2-1). Inertial rate and specific force follow from one attitude and velocity
//! history, so they agree with each other exactly: with Ω the Earth's rate, ρ the transport rate and C the rotation
//! into body axes, ω = C(Ω + ρ) + ω of the body over navigation axes, f = C(v̇ + (2Ω + ρ) × v − g). Angles rad,
//! lengths m, time s.
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::earth;

pub use table::TableStep;
pub use trajectory::Trajectory;
pub use vehicle::{Sway, Vehicle, VehicleStep};

mod ease;
mod table;
#[cfg(test)]
mod tests;
mod trajectory;
mod vehicle;

/// Where the body stands at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Geodetic latitude, rad.
    pub latitude: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
    /// By how much gravity is more than normal gravity there, m/s².
    pub gravity_anomaly: f64,
}

impl Site {
    /// Gravity at a latitude and height near the site, m/s².
    fn gravity(&self, latitude: f64, height: f64) -> f64 {
        earth::gravity(latitude, height) + self.gravity_anomaly
    }
}

/// Roll, pitch and heading, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// About x, applied last.
    pub roll: f64,
    /// About y.
    pub pitch: f64,
    /// About z (down), applied first.
    pub heading: f64,
}

impl Attitude {
    /// Rotation that takes body axes to navigation axes.
    pub fn to_navigation(self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(self.roll, self.pitch, self.heading)
    }
}

/// The body's motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Inertial rate in body axes, rad/s.
    pub rate: Vector3<f64>,
    /// Specific force in body axes, m/s².
    pub specific_force: Vector3<f64>,
    /// Rotation that takes body axes to navigation axes.
    pub attitude: UnitQuaternion<f64>,
    /// Velocity over the ground, north-east-down, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration over the ground, north-east-down, m/s².
    pub acceleration: Vector3<f64>,
    /// Latitude, rad.
    pub latitude: f64,
    /// Longitude from the start, rad.
    pub longitude: f64,
    /// Height, m.
    pub height: f64,
}

/// The motion that a scenario asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// Standing still.
    Static(Attitude),
    /// On a table at the site.
    Table {
        /// Attitude at the start.
        start: Attitude,
        /// Programme; after its end the body stands still.
        steps: Vec<TableStep>,
    },
    /// Travelling.
    Vehicle(Vehicle),
}

/// Roll, pitch and heading of an attitude, rad.
pub fn euler(attitude: &UnitQuaternion<f64>) -> Attitude {
    let (roll, pitch, heading) = Rotation3::from(*attitude).euler_angles();
    Attitude { roll, pitch, heading }
}
