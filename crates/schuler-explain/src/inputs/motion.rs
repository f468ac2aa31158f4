//! What the body did, in body axes: recorded, derived from what was recorded, or at rest.
//!
//! Frames and derivations are those of [`schuler_recording::motion`]. SI units, one value a row, holes bridged.
use nalgebra::{Rotation3, Vector3};
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, Quantity, SensorKind};
use schuler_recording::motion::{Use, body_to_ned, earth, inertial_rate, specific_force};
use schuler_recording::recording::AuxiliarySeries;
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY, Unit};

use super::place::VELOCITY;
use super::redundant::{self, axis_of};
use super::series::{Series, bridged, derivative};

/// How far the rate of a body that stands may be from the Earth's, and its specific force from gravity, as parts of them: what the case takes
/// for gravity differs by half a hundredth from pole to equator. And the part of the record in which it has to stand.
const AS_EARTH_RATE: f64 = 1e-3;
const AS_GRAVITY: f64 = 1e-2;
const LEAST_STANDING: f64 = 0.1;
/// Least part of the Earth's rate that is level: nearer to a pole nobody knows where north is.
const LEAST_LEVEL: f64 = 0.01;

/// Components x, y, z.
pub type Vectors = [Series; 3];

/// Motion of the body.
#[derive(Clone, Debug, Default)]
pub struct BodyMotion {
    /// Inertial rate, rad/s.
    pub rate: Option<Vectors>,
    /// The same at the instant of each row, where the rate is derived and may be more like a mean about it.
    pub instant_rate: Option<Vectors>,
    /// Angular acceleration, rad/s².
    pub angular_acceleration: Option<Vectors>,
    /// Specific force, m/s².
    pub force: Option<Vectors>,
    /// Velocity over the Earth, m/s; in a Schuler loop that of which the channel has an error.
    pub velocity: Option<Vectors>,
    /// Direction of north.
    pub north: Option<Vectors>,
    /// Direction of down.
    pub down: Option<Vectors>,
    /// Roll, pitch and heading without jumps, rad.
    pub attitude: Option<Vectors>,
    /// Whether it was estimated from the sensors that are to be explained.
    pub estimated: bool,
}

impl BodyMotion {
    /// What is known of the motion of a recording, whose rows are at `time_s`.
    pub fn new(recording: &Recording, time_s: &[f64]) -> Self {
        match recording.case.motion.kind {
            MotionKind::Static => Self::at_rest(recording, time_s.len()),
            MotionKind::Recorded | MotionKind::VelocityError => Self::recorded(recording, time_s),
            MotionKind::Unknown => Self::of_sensors(recording, time_s),
        }
    }

    /// Angular acceleration follows from the rate.
    fn with_angular_acceleration(mut self, time_s: &[f64]) -> Self {
        self.angular_acceleration = (self.rate.as_ref())
            .map(|rate| rate.each_ref().map(|component| derivative(time_s, component).into()));
        self
    }

    fn at_rest(recording: &Recording, rows: usize) -> Self {
        let constant =
            |vector: Vector3<f64>| [vector.x, vector.y, vector.z].map(|value| vec![value; rows].into());
        let mut motion = Self {
            velocity: Some(constant(Vector3::zeros())),
            angular_acceleration: Some(constant(Vector3::zeros())),
            ..Self::default()
        };
        let Some(attitude) = recording.case.motion.attitude_deg else { return motion };
        let [roll, pitch, heading] = [attitude.roll, attitude.pitch, attitude.heading].map(f64::to_radians);
        let ned = body_to_ned(roll, pitch, heading);
        let down = ned.inverse() * Vector3::z();
        motion.north = Some(constant(ned.inverse() * Vector3::x()));
        motion.down = Some(constant(down));
        motion.force = Some(constant(-down * gravity(recording)));
        if let Some(site) = recording.case.site {
            motion.rate = Some(constant(ned.inverse() * earth::rotation_ned(site.latitude_deg.to_radians())));
        }
        motion
    }

    fn recorded(recording: &Recording, time_s: &[f64]) -> Self {
        let series = &recording.motion;
        let filled =
            |columns: &Option<[Vec<f64>; 3]>| columns.as_ref().and_then(|columns| fill(time_s, columns));
        let mut motion =
            Self { rate: filled(&series.rate), force: filled(&series.specific_force), ..Self::default() };
        let attitude = (series.attitude_rad.as_ref()).and_then(|columns| fill(time_s, &unwrapped(columns)));
        let velocity_ned = filled(&series.velocity_ned);
        let Some(attitude) = attitude else {
            if recording.case.motion.kind == MotionKind::VelocityError {
                // A channel of an inertial system lies level and points along its axis.
                motion.velocity = velocity_ned.or_else(|| speed_along_channel(recording, time_s));
            } else {
                if let Some([north, down]) = levelled(recording, time_s, &motion) {
                    (motion.north, motion.down) = (Some(north), Some(down));
                }
                // Of sensors that are resolved over the Earth: no others are predicted.
                motion.velocity = velocity_ned;
            }
            return motion.with_angular_acceleration(time_s);
        };
        let rotations: Vec<Rotation3<f64>> = (0..time_s.len())
            .map(|row| body_to_ned(attitude[0][row], attitude[1][row], attitude[2][row]))
            .collect();
        let in_body = |vector: &dyn Fn(usize) -> Vector3<f64>| {
            of_rows(time_s.len(), |row| rotations[row].inverse() * vector(row))
        };
        motion.north = Some(in_body(&|_| Vector3::x()));
        motion.down = Some(in_body(&|_| Vector3::z()));
        motion.velocity =
            (velocity_ned.as_ref()).map(|[n, e, d]| in_body(&|row| Vector3::new(n[row], e[row], d[row])));
        let columns = |vectors: &Vectors| vectors.each_ref().map(|component| component.to_vec());
        if let Some(site) = recording.case.site {
            let (latitude, altitude) = (site.latitude_deg.to_radians(), site.altitude_m);
            let velocity = velocity_ned.as_ref().map(columns);
            let attitude = columns(&attitude);
            if motion.rate.is_none() {
                let rate = |purpose| {
                    let rate =
                        inertial_rate(time_s, &attitude, velocity.as_ref(), latitude, altitude, purpose);
                    fill(time_s, &rate)
                };
                (motion.rate, motion.instant_rate) = (rate(Use::Input), rate(Use::Instant));
            }
            if motion.force.is_none() {
                let force =
                    specific_force(time_s, &attitude, velocity.as_ref(), latitude, altitude, Use::Input);
                motion.force = fill(time_s, &force);
            }
        } else if motion.force.is_none() {
            motion.force = Some(in_body(&|_| Vector3::new(0.0, 0.0, -STANDARD_GRAVITY)));
        }
        motion.attitude = Some(attitude);
        motion.with_angular_acceleration(time_s)
    }

    fn of_sensors(recording: &Recording, time_s: &[f64]) -> Self {
        let dimensions = [Dimension::AngularRate, Dimension::Acceleration, Dimension::Velocity];
        let is_checked = |series| dimensions.iter().any(|&it| redundant::is_checked(series, it));
        if !recording.sensors.iter().any(is_checked) {
            return Self { estimated: true, ..Self::default() };
        }
        let told = redundant::noise_told(recording);
        let estimate = |dimension| {
            let columns = redundant::estimate(recording, time_s, dimension, &told)?;
            fill(time_s, &columns)
        };
        Self {
            rate: estimate(Dimension::AngularRate),
            force: estimate(Dimension::Acceleration),
            velocity: estimate(Dimension::Velocity),
            estimated: true,
            ..Self::default()
        }
        .with_angular_acceleration(time_s)
    }
}

/// North and down of a body that stands now and then, of which rate and specific force are recorded: standing it has gravity and the Earth's
/// rate, and between that its rate turns both. `None` where it stands too seldom, or the site is not given.
fn levelled(recording: &Recording, time_s: &[f64], motion: &BodyMotion) -> Option<[Vectors; 2]> {
    let (rate, force) = (motion.rate.as_ref()?, motion.force.as_ref()?);
    let latitude = recording.case.site?.latitude_deg.to_radians();
    let gravity = gravity(recording);
    let stands = |row: usize| {
        let (rate, force) = (row_of(rate, row) / earth::ROTATION_RATE, row_of(force, row) / gravity);
        let down = -force.normalize();
        let is_gravity = (force.norm() - 1.0).abs() < AS_GRAVITY;
        let is_earth_rate = |part: f64, of_earth: f64| (part - of_earth).abs() < AS_EARTH_RATE;
        (is_gravity && is_earth_rate(rate.norm(), 1.0) && is_earth_rate(rate.dot(&down), -latitude.sin()))
            .then_some((rate, down))
    };
    let standing = |&row: &usize| stands(row).is_some();
    let first = (0..time_s.len()).find(standing)?;
    if ((first..time_s.len()).filter(standing).count() as f64) < LEAST_STANDING * time_s.len() as f64 {
        return None;
    }
    let mut seen = vec![(Vector3::zeros(), Vector3::zeros()); time_s.len()];
    // From where it stands first, to either side.
    let turned = |(earth_rate, down): (Vector3<f64>, Vector3<f64>), from: usize, to: usize| {
        let mean = 0.5 * (row_of(rate, from) + row_of(rate, to));
        let turn = Rotation3::new(mean * (time_s[from] - time_s[to]));
        stands(to).unwrap_or((turn * earth_rate, turn * down))
    };
    seen[first] = stands(first)?;
    for row in first + 1..time_s.len() {
        seen[row] = turned(seen[row - 1], row - 1, row);
    }
    for row in (0..first).rev() {
        seen[row] = turned(seen[row + 1], row + 1, row);
    }
    let north = |(earth_rate, down): &(Vector3<f64>, Vector3<f64>)| {
        (earth_rate - down * earth_rate.dot(down)).try_normalize(LEAST_LEVEL)
    };
    let north: Vec<Vector3<f64>> = seen.iter().map(north).collect::<Option<_>>()?;
    Some([of_rows(time_s.len(), |row| north[row]), of_rows(time_s.len(), |row| seen[row].1)])
}

/// The velocity along the axis of an inertial channel, which a speed that is recorded beside its error is.
fn speed_along_channel(recording: &Recording, time_s: &[f64]) -> Option<Vectors> {
    let channel = recording.sensors.iter().find(|series| series.sensor.kind == SensorKind::InsVelocity)?;
    let is_its = |series: &&AuxiliarySeries| {
        let near = series.auxiliary.near.as_deref();
        series.auxiliary.quantity == Quantity::Speed
            && series.auxiliary.unit == Unit::MetrePerSecond.name()
            && near.is_none_or(|near| near == channel.sensor.id || near == VELOCITY)
    };
    let speed = recording.auxiliaries.iter().find(is_its)?;
    let speed = bridged(time_s, &speed.values)?;
    let axis = axis_of(&channel.sensor);
    Some(of_rows(time_s.len(), |row| axis * speed[row]))
}

/// Gravity at the site, m/s²; standard gravity without one.
pub fn gravity(recording: &Recording) -> f64 {
    recording
        .case
        .site
        .map_or(STANDARD_GRAVITY, |site| earth::gravity(site.latitude_deg.to_radians(), site.altitude_m))
}

/// Component of a vector along a direction.
pub fn along(direction: &Vector3<f64>, [x, y, z]: &Vectors) -> Vec<f64> {
    let rows = x.iter().zip(&**y).zip(&**z);
    rows.map(|((x, y), z)| direction.x * x + direction.y * y + direction.z * z).collect()
}

/// The vectors of `rows` rows.
pub fn of_rows(rows: usize, vector: impl Fn(usize) -> Vector3<f64>) -> Vectors {
    let mut columns = [(); 3].map(|()| Vec::with_capacity(rows));
    for row in 0..rows {
        for (column, value) in columns.iter_mut().zip(vector(row).iter()) {
            column.push(*value);
        }
    }
    columns.map(Into::into)
}

/// The vector in a row.
pub fn row_of([x, y, z]: &Vectors, row: usize) -> Vector3<f64> {
    Vector3::new(x[row], y[row], z[row])
}

fn fill(time_s: &[f64], [x, y, z]: &[Vec<f64>; 3]) -> Option<Vectors> {
    Some([bridged(time_s, x)?, bridged(time_s, y)?, bridged(time_s, z)?])
}

/// Angles without jumps of a whole turn, so that they can be bridged in a straight line.
fn unwrapped(angles: &[Vec<f64>; 3]) -> [Vec<f64>; 3] {
    angles.each_ref().map(|angles| {
        let mut last: Option<f64> = None;
        let turn = 2.0 * std::f64::consts::PI;
        angles
            .iter()
            .map(|&angle| {
                if !angle.is_finite() {
                    return f64::NAN;
                }
                let near = last.map_or(angle, |last| angle - turn * ((angle - last) / turn).round());
                last = Some(near);
                near
            })
            .collect()
    })
}
