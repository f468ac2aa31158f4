//! The motion at work: kinematics at times that never run backwards.
use nalgebra::{UnitQuaternion, Vector3};

use super::ease::{Ease, Smooth};
use super::{Attitude, Kinematics, Motion, Site};
use crate::physics::earth;

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
    fn speed_heading_height(&mut self, time_s: f64) -> [Smooth; 3] {
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
        let before = self.speed_heading_height(self.time_s);
        let after_time = time_s.max(self.time_s);
        let step_s = after_time - self.time_s;
        let [speed, heading, height] = self.speed_heading_height(after_time);
        let velocity_of = |speed: &Smooth, heading: &Smooth, height: &Smooth| {
            let (s, c) = heading.value.sin_cos();
            Vector3::new(speed.value * c, speed.value * s, -height.rate)
        };
        let velocity = velocity_of(&speed, &heading, &height);
        // Position by Heun's rule; the motion is smooth and the step short.
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
