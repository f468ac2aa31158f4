//! The places at which an effect can act: the sensors of a recording, or the parts of a Schuler loop.
use nalgebra::Vector3;
use schuler_recording::Recording;
use schuler_recording::case::{Grade, MotionKind, SensorKind};
use schuler_recording::unit::{Dimension, Unit};

use super::grade::grades;
use super::motion::{BodyMotion, along};
use super::redundant::axis_of;
use super::series::{Series, bridged};
use crate::catalogue::Port;

/// The name of a Schuler loop's output.
pub const VELOCITY: &str = "velocity";

/// A place at which an effect can act.
#[derive(Clone, Debug)]
pub struct Place {
    /// The sensor, by its place in the recording.
    pub sensor: usize,
    /// Where the effect enters.
    pub port: Port,
    /// Its name in the answer: the sensor's id; in a Schuler loop `accelerometer`, `gyro` or `velocity`.
    pub name: String,
    /// What it is.
    pub kind: SensorKind,
    /// The unit that answers are written in.
    pub unit: Unit,
    /// The instrument it is part of.
    pub group: Option<String>,
    /// Whether it is read against an unknown constant.
    pub relative: bool,
    /// How good it is, as its case states or as its kind and its noise let guess; none of velocities and of sensors of other kinds.
    pub grade: Option<Grade>,
    /// Whether its errors are those of micromechanical sensors.
    pub micromechanical: bool,
    /// Its axes in body axes.
    pub axes: Axes,
    /// Its true input along its axis, SI unit of the port: what the user's simulator says that it reads, else that of the motion; none where
    /// neither is known.
    pub input: Option<Series>,
    /// Whether its input was estimated from the sensors that are to be explained.
    pub is_estimated: bool,
}

/// Axes of a sensor in body axes, of unit length, at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Input axis i.
    pub input: Vector3<f64>,
    /// The other input axis, o = s × i.
    pub other: Vector3<f64>,
    /// Spin axis s of a dynamically tuned gyro; for other sensors, and where it is not given, the body axis
    /// farthest from the input axis, made to be at right angles to it.
    pub spin: Vector3<f64>,
}

impl Axes {
    /// The axes of a sensor with the given input and spin axis.
    pub fn new(input: Vector3<f64>, spin: Option<Vector3<f64>>) -> Self {
        let input = input.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let across =
            |direction: Vector3<f64>| (direction - input * input.dot(&direction)).try_normalize(1e-3);
        let farthest = [Vector3::z(), Vector3::y(), Vector3::x()]
            .into_iter()
            .min_by(|a, b| a.dot(&input).abs().total_cmp(&b.dot(&input).abs()))
            .and_then(across);
        let spin = spin.and_then(across).or(farthest).unwrap_or_else(Vector3::z);
        Self { input, other: spin.cross(&input), spin }
    }

    /// The two body axes least along the input axis, by name, made to be at right angles to it: the axes j of
    /// misalignment and cross coupling.
    pub fn across(&self) -> Vec<(&'static str, Vector3<f64>)> {
        let mut body = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())];
        body.sort_by(|a, b| a.1.dot(&self.input).abs().total_cmp(&b.1.dot(&self.input).abs()));
        let mut across: Vec<_> = (body.into_iter().take(2))
            .filter_map(|(name, axis)| {
                Some((name, (axis - self.input * self.input.dot(&axis)).try_normalize(1e-3)?))
            })
            .collect();
        across.sort_by_key(|&(name, _)| name);
        across
    }
}

impl Place {
    /// What it measures.
    pub const fn dimension(&self) -> Dimension {
        self.unit.dimension()
    }
}

/// The places of a recording.
pub fn places(recording: &Recording, motion: &BodyMotion, time_s: &[f64]) -> Vec<Place> {
    let micromechanical = recording.sensors.iter().any(|series| series.sensor.kind == SensorKind::MemsGyro)
        && !(recording.sensors.iter())
            .any(|series| matches!(series.sensor.kind, SensorKind::Dtg | SensorKind::Fog | SensorKind::Rlg));
    let mut places = Vec::new();
    for ((index, series), grade) in recording.sensors.iter().enumerate().zip(grades(recording)) {
        let sensor = &series.sensor;
        let axes = Axes::new(axis_of(sensor), sensor.spin_axis.map(Vector3::from));
        let place = |port, name: &str, kind: SensorKind, unit: Unit, axes: Axes| Place {
            sensor: index,
            port,
            name: name.to_owned(),
            kind,
            unit,
            group: sensor.group.clone(),
            relative: sensor.relative,
            grade,
            micromechanical: match sensor.grade {
                Some(Grade::Mems) => true,
                Some(Grade::Navigation) => false,
                _ => kind == SensorKind::MemsGyro || (micromechanical && kind == SensorKind::Accelerometer),
            },
            axes,
            input: vectors_of(motion, unit.dimension()).map(|vectors| along(&axes.input, vectors).into()),
            is_estimated: motion.estimated,
        };
        let velocity_error = recording.case.motion.kind == MotionKind::VelocityError;
        if velocity_error && sensor.kind == SensorKind::InsVelocity {
            let (metre, radian) = (Unit::MetrePerSecondSquared, Unit::RadianPerSecond);
            places.push(place(Port::Accelerometer, "accelerometer", SensorKind::Accelerometer, metre, axes));
            // The velocity grows where the platform is tilted about the axis across it: that is the gyro's.
            let across = Axes::new(axes.other, Some(axes.spin));
            places.push(place(Port::Gyro, "gyro", SensorKind::Dtg, radian, across));
            places.push(place(Port::Output, VELOCITY, sensor.kind, series.written_unit, axes));
        } else if velocity_error {
            // A loop explains its own velocity; other sensors have nothing to be compared with.
        } else {
            let mut place = place(Port::Output, &sensor.id, sensor.kind, series.written_unit, axes);
            if sensor.axis.is_none() && !motion.estimated {
                place.input = None;
            }
            if let Some(predicted) = &series.predicted {
                (place.input, place.is_estimated) = (bridged(time_s, predicted), false);
            }
            places.push(place);
        }
    }
    places
}

/// The motion that a sensor of the given dimension measures.
pub fn vectors_of(motion: &BodyMotion, dimension: Dimension) -> Option<&super::motion::Vectors> {
    match dimension {
        Dimension::AngularRate => motion.rate.as_ref(),
        Dimension::Acceleration => motion.force.as_ref(),
        Dimension::Velocity => motion.velocity.as_ref(),
        Dimension::Other => None,
    }
}
