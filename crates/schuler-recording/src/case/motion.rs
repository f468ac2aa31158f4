//! The part of a case about what the body did.
use serde::Serialize;

use super::AttitudeColumns;
use crate::unit::Unit;

/// What the body did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Motion {
    /// How much of it is known.
    pub kind: MotionKind,
    /// Attitude of a body at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude_deg: Option<Attitude>,
    /// Columns of the body's inertial rate in body axes, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<[String; 3]>,
    /// Unit of the rate where it is not rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_unit: Option<Unit>,
    /// Columns of the specific force in body axes, m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specific_force: Option<[String; 3]>,
    /// Unit of the specific force where it is not m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specific_force_unit: Option<Unit>,
    /// Columns of the velocity north, east, down, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_ned: Option<[String; 3]>,
    /// Where the point sits in body axes, m, of which the velocity is, such as an antenna; without it the body's reference point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_at_m: Option<[f64; 3]>,
    /// Columns of roll, pitch and yaw (body from NED, 3-2-1), rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude_rad: Option<[String; 3]>,
    /// Columns of the attitude in another form.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude: Option<AttitudeColumns>,
}

impl Motion {
    /// The columns that it names.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        let Self { rate, specific_force, velocity_ned, attitude_rad, attitude, .. } = self;
        let other = attitude.iter().flat_map(|it| &it.columns);
        let triples = [rate, specific_force, velocity_ned, attitude_rad].into_iter().flatten().flatten();
        triples.chain(other).map(String::as_str)
    }
}

/// How much of the body's motion is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionKind {
    /// At rest on the Earth, at a known attitude.
    Static,
    /// Recorded in columns of the table.
    Recorded,
    /// Not at all; sensors with redundant axes are checked against each other.
    #[default]
    Unknown,
    /// One sensor records the velocity error of a Schuler loop.
    VelocityError,
}

impl MotionKind {
    /// Every kind under its name in the case file.
    pub const NAMES: [(&'static str, MotionKind); 4] = [
        ("static", MotionKind::Static),
        ("recorded", MotionKind::Recorded),
        ("unknown", MotionKind::Unknown),
        ("velocity_error", MotionKind::VelocityError),
    ];
}

/// Attitude of the body from north-east-down, 3-2-1, degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Attitude {
    /// Roll.
    pub roll: f64,
    /// Pitch.
    pub pitch: f64,
    /// Heading.
    pub heading: f64,
}
