//! A Doppler log: the velocity over ground along one beam, at the antenna, as late as it is told.
//!
//! The antenna sits at r in the body; along its axis it sees C v + ω × r, with ω the body's rate over ground. What it tells is
//! that of some time ago, with its own scale factor and noise. SI units.
use nalgebra::{UnitQuaternion, Vector3};

use super::earth;
use super::motion::Kinematics;
use super::readout::{Readout, ReadoutDesign, Surroundings};
use super::schuler::Delay;

/// Everything about one beam or one component.
#[derive(Clone, Debug, PartialEq)]
pub struct DopplerDesign {
    /// Direction in the body.
    pub axis: Vector3<f64>,
    /// Rotation of the log in the body beside its nominal direction, as a rotation vector in body axes, rad.
    pub misalignment: Vector3<f64>,
    /// Place in the body, m.
    pub arm: Vector3<f64>,
    /// Age of what it tells, s.
    pub delay_s: f64,
    /// Relative error of the speed of sound or of the frequency.
    pub scale_factor: f64,
    /// Output, in m/s.
    pub readout: ReadoutDesign,
}

/// A beam at work.
#[derive(Clone, Debug)]
pub struct Doppler {
    design: DopplerDesign,
    direction: Vector3<f64>,
    past: Delay,
    readout: Readout,
}

/// What a beam says at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DopplerReading {
    /// Indicated velocity, m/s.
    pub velocity: f64,
    /// True velocity of the body's point along the nominal axis now, m/s.
    pub true_velocity: f64,
}

impl Doppler {
    /// The beam called `name` of the run with this seed.
    pub fn new(design: DopplerDesign, seed: u64, name: &str) -> Self {
        let turned = UnitQuaternion::from_scaled_axis(design.misalignment);
        Self {
            direction: turned * design.axis.normalize(),
            past: Delay::new(design.delay_s),
            readout: Readout::new(design.readout.clone(), seed, name),
            design,
        }
    }

    /// Lets the antenna pass an instant without a reading; instants between readings make the delay finer than a step.
    pub fn pass(&mut self, time_s: f64, motion: &Kinematics) -> f64 {
        let into_body = motion.attitude.inverse();
        let over_ground = motion.rate - into_body * earth::earth_rate_ned(motion.latitude);
        let at_antenna = into_body * motion.velocity + over_ground.cross(&self.design.arm);
        self.past.pass(time_s, self.direction.dot(&at_antenna))
    }

    /// One reading, `step_s` after the last.
    pub fn read(
        &mut self,
        time_s: f64,
        motion: &Kinematics,
        around: &Surroundings,
        step_s: f64,
    ) -> DopplerReading {
        let seen = self.pass(time_s, motion) * (1.0 + self.design.scale_factor);
        let drift = self.readout.drift(step_s);
        let body = motion.attitude.inverse() * motion.velocity;
        DopplerReading {
            velocity: self.readout.read(seen + drift, around, step_s),
            true_velocity: self.design.axis.normalize().dot(&body),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::motion::{Motion, Site, Sway, Trajectory, Vehicle, VehicleStep};

    fn design() -> DopplerDesign {
        DopplerDesign {
            axis: Vector3::x(),
            misalignment: Vector3::zeros(),
            arm: Vector3::zeros(),
            delay_s: 0.0,
            scale_factor: 0.0,
            readout: ReadoutDesign { range: f64::INFINITY, ..ReadoutDesign::default() },
        }
    }

    fn trajectory(heading_change: f64, speed_change: f64) -> Trajectory {
        let steps = vec![VehicleStep { duration_s: 100.0, speed_change, heading_change, height_change: 0.0 }];
        let vehicle = Vehicle {
            speed: 2.0,
            heading: 0.7,
            bank_share: 0.0,
            sway: Sway::default(),
            level_platform: false,
            steps,
        };
        Trajectory::new(Motion::Vehicle(vehicle), Site { latitude: 0.5, height: 0.0, gravity_anomaly: 0.0 })
    }

    #[test]
    fn a_turn_shows_the_lever_arm() {
        // At mid-turn the rate is twice its mean: starboard velocity ω r forward of the centre.
        let across = DopplerDesign { axis: Vector3::y(), arm: Vector3::new(3.0, 0.0, 0.0), ..design() };
        let mut doppler = Doppler::new(across, 1, "d");
        let motion = trajectory(2.0, 0.0).at(50.0);
        let told = doppler.read(50.0, &motion, &Surroundings::default(), 1.0);
        // The body's rate over ground, transport rate included.
        let expected = 3.0 * 2.0 * 2.0 / 100.0;
        assert!((told.velocity - expected).abs() < 1e-5 && told.true_velocity.abs() < 1e-12, "{told:?}");
    }

    #[test]
    fn what_it_tells_is_old() {
        let mut doppler =
            Doppler::new(DopplerDesign { delay_s: 1.5, scale_factor: 0.01, ..design() }, 1, "d");
        let mut trajectory = trajectory(0.0, 10.0);
        let mut speeds = Vec::new();
        for k in 0..=200 {
            let time_s = 0.5 * f64::from(k);
            let motion = trajectory.at(time_s);
            speeds.push(motion.velocity.norm());
            let told = doppler.read(time_s, &motion, &Surroundings::default(), 0.5);
            if k >= 3 {
                assert!((told.velocity - 1.01 * speeds[k as usize - 3]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_turned_log_sees_the_speed_across() {
        let turned =
            DopplerDesign { axis: Vector3::y(), misalignment: Vector3::new(0.0, 0.0, 0.01), ..design() };
        let motion = trajectory(0.0, 0.0).at(1.0);
        let told = Doppler::new(turned, 1, "d").read(1.0, &motion, &Surroundings::default(), 1.0);
        // Turned about down by 0.01, starboard points a little aft.
        assert!((told.velocity + 2.0 * 0.01f64.sin()).abs() < 1e-6, "{told:?}");
    }
}
