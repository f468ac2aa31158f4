//! What the body really does: bench, rate table, vehicle.
//!
//! Body axes: x forward, y starboard, z down. Navigation axes: north, east, down. Attitude: body from navigation axes,
//! heading, pitch, roll in turn (3-2-1). Inertial rate and specific force follow from one attitude and velocity
//! history, so they agree with each other exactly: with Ω the Earth's rate, ρ the transport rate and C the rotation
//! into body axes, ω = C(Ω + ρ) + ω of the body over navigation axes, f = C(v̇ + (2Ω + ρ) × v − g). Angles rad,
//! lengths m, time s.
use nalgebra::{Rotation3, Unit, UnitQuaternion, Vector3};

use super::earth;

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

/// One piece of a rate table's programme.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TableStep {
    /// Stand still.
    Dwell {
        /// For so long, s.
        duration_s: f64,
    },
    /// Turn by an angle about a body axis, smoothly (the rate and its derivative start and end at zero).
    Turn {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Angle, rad.
        angle: f64,
        /// Time it takes, s.
        duration_s: f64,
    },
    /// Turn about a body axis at a constant rate, reached and left over a ramp.
    Spin {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Rate, rad/s.
        rate: f64,
        /// Time in all, s.
        duration_s: f64,
        /// Time of either ramp, s.
        ramp_s: f64,
    },
    /// Swing about a body axis: angle = amplitude · sin(2πft), faded in and out over one cycle.
    Swing {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Amplitude, rad.
        amplitude: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Time in all, s.
        duration_s: f64,
    },
    /// Move a body axis round a cone: swings about the two axes across it, a quarter of a cycle apart.
    Cone {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Half-angle of the cone, rad.
        amplitude: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Time in all, s.
        duration_s: f64,
    },
}

impl TableStep {
    /// How long the piece lasts, s.
    pub fn duration_s(&self) -> f64 {
        match *self {
            TableStep::Dwell { duration_s }
            | TableStep::Turn { duration_s, .. }
            | TableStep::Spin { duration_s, .. }
            | TableStep::Swing { duration_s, .. }
            | TableStep::Cone { duration_s, .. } => duration_s,
        }
    }

    fn axis(&self) -> Unit<Vector3<f64>> {
        match *self {
            TableStep::Dwell { .. } => Vector3::x_axis(),
            TableStep::Turn { axis, .. }
            | TableStep::Spin { axis, .. }
            | TableStep::Swing { axis, .. }
            | TableStep::Cone { axis, .. } => axis,
        }
    }

    /// Turn since the piece's start and the body's rate at a time within the piece.
    fn turn(&self, t: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let TableStep::Cone { axis, amplitude, frequency_hz, duration_s } = *self else {
            let (angle, rate) = self.angle_and_rate(t);
            return (UnitQuaternion::from_axis_angle(&self.axis(), angle), self.axis().into_inner() * rate);
        };
        let least = axis.iamin();
        let first = Unit::new_normalize(axis.cross(&Vector3::ith(least, 1.0)));
        let second = Unit::new_unchecked(axis.cross(&first));
        let (outer, outer_rate) = swing(amplitude, frequency_hz, duration_s, t, 0.0);
        let (inner, inner_rate) = swing(amplitude, frequency_hz, duration_s, t, 0.25);
        let inner = UnitQuaternion::from_axis_angle(&second, inner);
        let rate = inner.inverse() * (first.into_inner() * outer_rate) + second.into_inner() * inner_rate;
        (UnitQuaternion::from_axis_angle(&first, outer) * inner, rate)
    }

    /// Angle about the piece's axis and its rate at a time within the piece.
    fn angle_and_rate(&self, t: f64) -> (f64, f64) {
        match *self {
            TableStep::Dwell { .. } | TableStep::Cone { .. } => (0.0, 0.0),
            TableStep::Turn { angle, duration_s, .. } => {
                let ease = Ease::at(t / duration_s);
                (angle * ease.value, angle * ease.slope / duration_s)
            }
            TableStep::Spin { rate, duration_s, ramp_s, .. } => {
                // Smooth ramps: rate · ease up, hold, ease down; the angle is the integral.
                let hold_end = duration_s - ramp_s;
                let ramp_angle = 0.5 * rate * ramp_s;
                if t < ramp_s {
                    let x = t / ramp_s;
                    (rate * ramp_s * Ease::integral(x), rate * Ease::at(x).value)
                } else if t < hold_end {
                    (ramp_angle + rate * (t - ramp_s), rate)
                } else {
                    let x = (duration_s - t) / ramp_s.max(f64::MIN_POSITIVE);
                    let total = 2.0 * ramp_angle + rate * (hold_end - ramp_s);
                    (total - rate * ramp_s * Ease::integral(x), rate * Ease::at(x).value)
                }
            }
            TableStep::Swing { amplitude, frequency_hz, duration_s, .. } => {
                swing(amplitude, frequency_hz, duration_s, t, 0.0)
            }
        }
    }
}

/// Angle and rate of a swing that is faded in and out over one cycle; `phase` in cycles.
fn swing(amplitude: f64, frequency_hz: f64, duration_s: f64, t: f64, phase: f64) -> (f64, f64) {
    let w = std::f64::consts::TAU * frequency_hz;
    let cycle = 1.0 / frequency_hz;
    let (envelope, slope) = if t < cycle {
        let e = Ease::at(t / cycle);
        (e.value, e.slope / cycle)
    } else if t > duration_s - cycle {
        let e = Ease::at((duration_s - t) / cycle);
        (e.value, -e.slope / cycle)
    } else {
        (1.0, 0.0)
    };
    let (s, c) = (w * t + std::f64::consts::TAU * phase).sin_cos();
    (amplitude * envelope * s, amplitude * (slope * s + envelope * w * c))
}

/// One piece of a vehicle's run: speed, heading and vertical speed change smoothly over its duration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleStep {
    /// Time, s.
    pub duration_s: f64,
    /// Change of speed, m/s.
    pub speed_change: f64,
    /// Change of heading, rad.
    pub heading_change: f64,
    /// Change of height, m.
    pub height_change: f64,
}

/// A periodic angular motion on top of the vehicle's: waves, engine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sway {
    /// Amplitude of roll, rad.
    pub roll: f64,
    /// Amplitude of pitch, rad.
    pub pitch: f64,
    /// Period of roll, s; that of pitch is 0.7 of it.
    pub period_s: f64,
}

/// A vehicle's run.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Speed at the start, m/s.
    pub speed: f64,
    /// Heading at the start, rad.
    pub heading: f64,
    /// Share of the bank of a coordinated turn: 1 aircraft, 0 ship.
    pub bank_share: f64,
    /// Waves.
    pub sway: Sway,
    /// The sensors stand on a platform held level and north whatever the vehicle does.
    pub level_platform: bool,
    /// Its pieces; after the last it goes on straight.
    pub steps: Vec<VehicleStep>,
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

/// The motion at work: gives the kinematics at times that never run backwards.
#[derive(Clone, Debug)]
pub struct Trajectory {
    motion: Motion,
    site: Site,
    /// Piece in progress, its start, and the state at its start.
    piece: usize,
    piece_start_s: f64,
    attitude: UnitQuaternion<f64>,
    speed: f64,
    heading: f64,
    height: f64,
    /// Position, integrated up to `time_s`.
    time_s: f64,
    latitude: f64,
    longitude: f64,
}

/// Longest step of the integration of position, s.
const POSITION_STEP_S: f64 = 1.0;

impl Trajectory {
    /// The motion from its start at time zero.
    pub fn new(motion: Motion, site: Site) -> Self {
        let attitude = match &motion {
            Motion::Static(attitude) | Motion::Table { start: attitude, .. } => attitude.to_navigation(),
            Motion::Vehicle(_) => UnitQuaternion::identity(),
        };
        let (speed, heading) = match &motion {
            Motion::Vehicle(v) => (v.speed, v.heading),
            _ => (0.0, 0.0),
        };
        Self {
            motion,
            site,
            piece: 0,
            piece_start_s: 0.0,
            attitude,
            speed,
            heading,
            height: site.height,
            time_s: 0.0,
            latitude: site.latitude,
            longitude: 0.0,
        }
    }

    /// The kinematics at a time not before the last one asked for, s.
    pub fn at(&mut self, time_s: f64) -> Kinematics {
        match &self.motion {
            Motion::Static(_) => self.standing(self.attitude, Vector3::zeros()),
            Motion::Table { .. } => self.on_table(time_s),
            Motion::Vehicle(_) => {
                while self.time_s + POSITION_STEP_S < time_s {
                    self.travel(self.time_s + POSITION_STEP_S);
                }
                self.travel(time_s)
            }
        }
    }

    fn standing(&self, attitude: UnitQuaternion<f64>, body_rate: Vector3<f64>) -> Kinematics {
        let gravity = Vector3::new(0.0, 0.0, self.site.gravity(self.site.latitude, self.site.height));
        Kinematics {
            rate: attitude.inverse() * earth::earth_rate_ned(self.site.latitude) + body_rate,
            specific_force: attitude.inverse() * -gravity,
            attitude,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            latitude: self.site.latitude,
            longitude: 0.0,
            height: self.site.height,
        }
    }

    fn on_table(&mut self, time_s: f64) -> Kinematics {
        let Motion::Table { steps, .. } = &self.motion else {
            return self.standing(self.attitude, Vector3::zeros());
        };
        while let Some(step) = steps.get(self.piece)
            && time_s >= self.piece_start_s + step.duration_s()
        {
            self.attitude *= step.turn(step.duration_s()).0;
            self.piece_start_s += step.duration_s();
            self.piece += 1;
        }
        match steps.get(self.piece) {
            None => self.standing(self.attitude, Vector3::zeros()),
            Some(step) => {
                let (turned, rate) = step.turn(time_s - self.piece_start_s);
                self.standing(self.attitude * turned, rate)
            }
        }
    }

    /// Speed, heading and height with two derivatives each, at a time.
    fn course(&mut self, time_s: f64) -> [Smooth; 3] {
        let Motion::Vehicle(vehicle) = &self.motion else { return [Smooth::default(); 3] };
        while let Some(step) = vehicle.steps.get(self.piece)
            && time_s >= self.piece_start_s + step.duration_s
        {
            self.speed += step.speed_change;
            self.heading += step.heading_change;
            self.height += step.height_change;
            self.piece_start_s += step.duration_s;
            self.piece += 1;
        }
        let now = |start: f64, change: f64, duration_s: f64, t: f64| {
            let ease = Ease::at(t / duration_s);
            Smooth {
                value: start + change * ease.value,
                rate: change * ease.slope / duration_s,
                acceleration: change * ease.curvature / (duration_s * duration_s),
            }
        };
        let held = |value: f64| Smooth { value, ..Smooth::default() };
        match vehicle.steps.get(self.piece) {
            None => [held(self.speed), held(self.heading), held(self.height)],
            Some(step) => {
                let t = time_s - self.piece_start_s;
                [
                    now(self.speed, step.speed_change, step.duration_s, t),
                    now(self.heading, step.heading_change, step.duration_s, t),
                    now(self.height, step.height_change, step.duration_s, t),
                ]
            }
        }
    }

    fn travel(&mut self, time_s: f64) -> Kinematics {
        let before = self.course(self.time_s);
        let after_time = time_s.max(self.time_s);
        let step_s = after_time - self.time_s;
        let [speed, heading, height] = self.course(after_time);
        let velocity_of = |speed: &Smooth, heading: &Smooth, height: &Smooth| {
            let (s, c) = heading.value.sin_cos();
            Vector3::new(speed.value * c, speed.value * s, -height.rate)
        };
        let velocity = velocity_of(&speed, &heading, &height);
        // Position by Heun's rule; the course is smooth and the step short.
        let slope = |latitude: f64, height: f64, v: &Vector3<f64>| {
            let (meridian, prime_vertical) = earth::radii(latitude);
            (v.x / (meridian + height), v.y / ((prime_vertical + height) * latitude.cos().max(1e-9)))
        };
        let first = slope(self.latitude, before[2].value, &velocity_of(&before[0], &before[1], &before[2]));
        let guess = self.latitude + step_s * first.0;
        let second = slope(guess, height.value, &velocity);
        self.latitude += 0.5 * step_s * (first.0 + second.0);
        self.longitude += 0.5 * step_s * (first.1 + second.1);
        self.time_s = after_time;

        let (s, c) = heading.value.sin_cos();
        let acceleration = Vector3::new(
            speed.rate * c - speed.value * heading.rate * s,
            speed.rate * s + speed.value * heading.rate * c,
            -height.acceleration,
        );
        let (attitude, body_rate) = self.vehicle_attitude(after_time, &speed, &heading);
        let earth_rate = earth::earth_rate_ned(self.latitude);
        let transport = earth::transport_rate_ned(self.latitude, height.value, &velocity);
        let gravity = Vector3::new(0.0, 0.0, self.site.gravity(self.latitude, height.value));
        let into_body = attitude.inverse();
        Kinematics {
            rate: into_body * (earth_rate + transport) + body_rate,
            specific_force: into_body
                * (acceleration + (earth_rate * 2.0 + transport).cross(&velocity) - gravity),
            attitude,
            velocity,
            acceleration,
            latitude: self.latitude,
            longitude: self.longitude,
            height: height.value,
        }
    }

    /// Attitude and the body's rate relative to navigation axes, in body axes.
    fn vehicle_attitude(
        &self,
        time_s: f64,
        speed: &Smooth,
        heading: &Smooth,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let Motion::Vehicle(vehicle) = &self.motion else {
            return (UnitQuaternion::identity(), Vector3::zeros());
        };
        if vehicle.level_platform {
            return (UnitQuaternion::identity(), Vector3::zeros());
        }
        // Bank of a coordinated turn: tan φ = V ψ̇/g.
        let g = earth::STANDARD_GRAVITY;
        let tangent = speed.value * heading.rate / g;
        let tangent_rate = (speed.rate * heading.rate + speed.value * heading.acceleration) / g;
        let mut roll = vehicle.bank_share * tangent.atan();
        let mut roll_rate = vehicle.bank_share * tangent_rate / (1.0 + tangent * tangent);
        let (mut pitch, mut pitch_rate) = (0.0, 0.0);
        let sway = &vehicle.sway;
        if sway.period_s > 0.0 {
            let w = std::f64::consts::TAU / sway.period_s;
            roll += sway.roll * (w * time_s).sin();
            roll_rate += sway.roll * w * (w * time_s).cos();
            let w = w / 0.7;
            pitch += sway.pitch * (w * time_s).sin();
            pitch_rate += sway.pitch * w * (w * time_s).cos();
        }
        let attitude = Attitude { roll, pitch, heading: heading.value }.to_navigation();
        let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
        let body_rate = Vector3::new(
            roll_rate - heading.rate * sp,
            pitch_rate * cr + heading.rate * cp * sr,
            heading.rate * cp * cr - pitch_rate * sr,
        );
        (attitude, body_rate)
    }
}

/// A value with two derivatives.
#[derive(Clone, Copy, Debug, Default)]
struct Smooth {
    value: f64,
    rate: f64,
    acceleration: f64,
}

/// A change from 0 to 1 over [0, 1] whose slope and curvature vanish at both ends: x − sin(2πx)/2π.
#[derive(Clone, Copy, Debug)]
struct Ease {
    value: f64,
    slope: f64,
    curvature: f64,
}

impl Ease {
    fn at(x: f64) -> Self {
        use std::f64::consts::TAU;
        let x = x.clamp(0.0, 1.0);
        let (s, c) = (TAU * x).sin_cos();
        Self { value: x - s / TAU, slope: 1.0 - c, curvature: TAU * s }
    }

    /// ∫₀ˣ value.
    fn integral(x: f64) -> f64 {
        use std::f64::consts::TAU;
        0.5 * x * x + ((TAU * x).cos() - 1.0) / (TAU * TAU)
    }
}

/// Roll, pitch and heading of an attitude, rad.
pub fn euler(attitude: &UnitQuaternion<f64>) -> Attitude {
    let (roll, pitch, heading) = Rotation3::from(*attitude).euler_angles();
    Attitude { roll, pitch, heading }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_anomaly_of_gravity_is_felt_and_nothing_else_is() {
        let at = |site| {
            Trajectory::new(Motion::Static(Attitude { pitch: 0.3, ..Attitude::default() }), site).at(0.0)
        };
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
                VehicleStep {
                    duration_s: 20.0,
                    speed_change: 15.0,
                    heading_change: 0.0,
                    height_change: 40.0,
                },
                VehicleStep { duration_s: 30.0, speed_change: 0.0, heading_change: 2.0, height_change: 0.0 },
                VehicleStep {
                    duration_s: 20.0,
                    speed_change: -30.0,
                    heading_change: -1.0,
                    height_change: -9.0,
                },
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
            TableStep::Swing {
                axis: axis(0.0, 0.0, 1.0),
                amplitude: 0.1,
                frequency_hz: 0.5,
                duration_s: 12.0,
            },
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
}
