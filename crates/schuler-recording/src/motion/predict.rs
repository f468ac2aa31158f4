//! What an ideal sensor on the body would have read.
use nalgebra::{Unit, Vector3};

use super::kinematics::{Use, columns, rotation, vector};
use super::{body_to_ned, inertial_rate, rate_at_rest, specific_force, specific_force_at_rest};
use crate::case::{MotionKind, Sensor, SensorKind, Site};
use crate::recording::Recording;
use crate::unit::Dimension;

/// The output of an ideal sensor, in the SI unit of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub enum Prediction {
    /// The same in every row.
    Constant(f64),
    /// One value a row; NaN where the motion is missing.
    Series(Vec<f64>),
}

impl Prediction {
    /// The value in `row`.
    pub fn at(&self, row: usize) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Series(values) => values.get(row).copied().unwrap_or(f64::NAN),
        }
    }
}

/// What a prediction lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unpredictable {
    /// Nothing but a simulator predicts what is in a unit of free text.
    #[error("a sensor of kind \"other\" needs `predicted`")]
    Other,
    /// The motion is unknown.
    #[error("the motion is unknown")]
    Motion,
    /// The place on the Earth is not given.
    #[error("it needs [site], as the Earth's rotation or gravity enters")]
    Site,
    /// The attitude is not given.
    #[error("it needs motion.attitude_deg or motion.attitude_rad")]
    Attitude,
    /// The velocity is not given.
    #[error("it needs motion.velocity_ned")]
    Velocity,
    /// The sensor's axis is not given.
    #[error("it needs the sensor's axis")]
    Axis,
}

/// The output of `sensor` on the body of `recording`, had it no errors.
///
/// What a simulator predicts of a sensor of the recording comes before what the motion does.
///
/// A sensor that is read against an unknown constant (`relative`) is predicted as 0 where the motion makes its output
/// constant. In a velocity-error case the velocity of the inertial system is an error, whose prediction is 0.
///
/// # Errors
/// What the case would have to give for a prediction.
pub fn predict(recording: &Recording, sensor: &Sensor) -> Result<Prediction, Unpredictable> {
    if let Some(predicted) = predicted_by_simulator(recording, sensor) {
        return Ok(Prediction::Series(predicted.to_vec()));
    }
    match recording.case.motion.kind {
        _ if sensor.kind == SensorKind::Other => Err(Unpredictable::Other),
        MotionKind::VelocityError if sensor.kind == SensorKind::InsVelocity => Ok(Prediction::Constant(0.0)),
        MotionKind::Unknown | MotionKind::VelocityError => Err(Unpredictable::Motion),
        MotionKind::Static if sensor.relative => Ok(Prediction::Constant(0.0)),
        MotionKind::Static => at_rest(recording, sensor).map(Prediction::Constant),
        MotionKind::Recorded => moving(recording, sensor).map(Prediction::Series),
    }
}

/// What the user's simulator says that a sensor of the recording reads, in its SI unit.
fn predicted_by_simulator<'r>(recording: &'r Recording, sensor: &Sensor) -> Option<&'r [f64]> {
    recording.sensor(&sensor.id)?.predicted.as_deref()
}

fn at_rest(recording: &Recording, sensor: &Sensor) -> Result<f64, Unpredictable> {
    let dimension = sensor.kind.dimension();
    if dimension == Dimension::Velocity {
        return Ok(0.0);
    }
    let axis = axis_of(sensor)?;
    let attitude = recording.case.motion.attitude_deg.ok_or(Unpredictable::Attitude)?;
    let ned =
        body_to_ned(attitude.roll.to_radians(), attitude.pitch.to_radians(), attitude.heading.to_radians());
    let (latitude, altitude_m) = place(recording)?;
    let input = match dimension {
        Dimension::AngularRate => rate_at_rest(&ned, latitude),
        _ => specific_force_at_rest(&ned, latitude, altitude_m),
    };
    Ok(axis.dot(&input))
}

/// Recorded columns are taken where they are given, and derived where they are not. A body of which no velocity is recorded turns where
/// it is.
fn moving(recording: &Recording, sensor: &Sensor) -> Result<Vec<f64>, Unpredictable> {
    let motion = &recording.motion;
    let attitude = motion.attitude_rad.as_ref().ok_or(Unpredictable::Attitude);
    let velocity = motion.velocity_ned.as_ref();
    let axis = axis_of(sensor)?;
    match sensor.kind.dimension() {
        Dimension::AngularRate => {
            if let Some(rate) = &motion.rate {
                return Ok(along(&axis, rate));
            }
            let (attitude, (latitude, altitude_m)) = (attitude?, place(recording)?);
            Ok(along(
                &axis,
                &inertial_rate(&recording.time_s, attitude, velocity, latitude, altitude_m, Use::Prediction),
            ))
        }
        Dimension::Acceleration => {
            if let Some(force) = &motion.specific_force {
                return Ok(along(&axis, force));
            }
            let (attitude, (latitude, altitude_m)) = (attitude?, place(recording)?);
            Ok(along(
                &axis,
                &specific_force(&recording.time_s, attitude, velocity, latitude, altitude_m, Use::Prediction),
            ))
        }
        Dimension::Velocity => {
            let velocity = velocity.ok_or(Unpredictable::Velocity)?;
            if is_resolved_over_earth(recording, sensor) {
                return Ok(along(&axis, velocity));
            }
            let attitude = attitude?;
            let body = columns(recording.len(), |row| {
                Some(rotation(vector(attitude, row)?).inverse() * vector(velocity, row)?)
            });
            Ok(along(&axis, &body))
        }
        Dimension::Other => Err(Unpredictable::Other),
    }
}

/// Whether the axis of a sensor of a moving body is taken along north, east and down and not along those of the body: that of a velocity over
/// the Earth where no attitude is recorded.
pub fn is_resolved_over_earth(recording: &Recording, sensor: &Sensor) -> bool {
    recording.motion.attitude_rad.is_none()
        && matches!(sensor.kind, SensorKind::GnssVelocity | SensorKind::InsVelocity)
}

fn axis_of(sensor: &Sensor) -> Result<Unit<Vector3<f64>>, Unpredictable> {
    sensor.axis.map(|axis| Unit::new_normalize(Vector3::from(axis))).ok_or(Unpredictable::Axis)
}

/// Latitude, rad, and altitude, m.
fn place(recording: &Recording) -> Result<(f64, f64), Unpredictable> {
    let Site { latitude_deg, altitude_m, .. } = recording.case.site.ok_or(Unpredictable::Site)?;
    Ok((latitude_deg.to_radians(), altitude_m))
}

fn along(axis: &Vector3<f64>, [x, y, z]: &[Vec<f64>; 3]) -> Vec<f64> {
    let rows = x.iter().zip(y).zip(z);
    // A component that is missing matters only where the axis has a part along it.
    let part = |weight: f64, value: f64| if weight == 0.0 { 0.0 } else { weight * value };
    rows.map(|((&x, &y), &z)| part(axis.x, x) + part(axis.y, y) + part(axis.z, z)).collect()
}
