//! A calibration run as it would really happen: an inertial unit (or a block of gyros) on a one-axis table in a thermal
//! chamber, remounted between cycles. It knows the true attitude at every instant, the true temperatures from heat
//! conduction, and the true errors of the sensors, and records what the sensors, the table and the thermometer say.
//!
//! Frames: local east, north, up; table (axis 1 along the table's axis, axis 2 up at zero angle); body. SI units, rad, degC.
pub mod recorded;
pub mod scenario;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::output::Interrupted;

/// Earth's rotation, rad/s.
const EARTH_RATE: f64 = 7.292_115e-5;
/// Seconds between cycles, for remounting.
const REMOUNTING_S: usize = 300;

/// A history of the chamber and of the unit's power over the whole run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Programme {
    /// The chamber goes up and down between two temperatures with this period, s, in ramps and holds; the unit warms up.
    UpAndDown {
        /// Lowest temperature of the chamber, degC.
        low: f64,
        /// Highest temperature of the chamber, degC.
        high: f64,
        /// Period, s.
        period_s: f64,
        /// Warming of the sensors by the load of the electronics, which comes and goes, degC; without it the rate is, by the
        /// laws of conduction, a combination of the gradient and a constant.
        load: f64,
    },
    /// The sensors are kept at one temperature, degC.
    Steady(f64),
    /// The sensors are led along a straight line from a temperature, degC, at a rate, degC/s.
    Ramp(f64, f64),
    /// In each cycle the sensors go from the first temperature to the second, degC, with a time constant, s.
    Exponential(f64, f64, f64),
}

/// Error coefficients of one element: at 35 degC, per degC, per degC/s, per degC/m along each axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorCoefficients {
    /// At 35 degC and rest.
    pub constant: f64,
    /// Per degC.
    pub per_degree: f64,
    /// Per degC/s.
    pub per_rate: f64,
    /// Per degC/m.
    pub per_gradient: [f64; 3],
}

/// Errors of a triad: `output = input + bias + matrix · input`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TriadErrors {
    /// Bias of each sensor.
    pub bias: [ErrorCoefficients; 3],
    /// Sensor by sensor, input by input.
    pub matrix: [[ErrorCoefficients; 3]; 3],
}

/// The set-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationTable {
    /// Latitude, rad.
    pub latitude: f64,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Azimuth of the table's axis, from north to east, rad.
    pub azimuth: f64,
    /// Tilt of the table's axis, rad.
    pub tilt: f64,
    /// Rate of the table, rad/s, reached in ramps of 4 s.
    pub rate: f64,
    /// Duration of a rotation with its ramps, s.
    pub rotation_s: f64,
    /// Duration of a dwell, s.
    pub dwell_s: f64,
    /// Length of a cycle, s.
    pub cycle_s: usize,
    /// Samples a second.
    pub samples_per_second: usize,
    /// 1-σ of the mounting's error about each axis, anew in each cycle, rad.
    pub mounting: f64,
    /// 1-σ of the table's wobble about each axis, rad; it moves the unit.
    pub wobble: f64,
    /// 1-σ of the table's angle sensor, rad.
    pub angle_noise: f64,
    /// Angle random walk, rad/√s.
    pub angle_random_walk: f64,
    /// 1-σ of the mean specific force of one second, m/s².
    pub force_noise: f64,
    /// Gyro errors, rad/s.
    pub gyro: TriadErrors,
    /// Accelerometer errors, m/s².
    pub accelerometer: TriadErrors,
    /// What the chamber does.
    pub programme: Programme,
}

/// Temperature at the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorTemperature {
    /// degC.
    pub temperature: f64,
    /// degC/s.
    pub rate: f64,
    /// degC/m.
    pub gradient: [f64; 3],
}

/// What was recorded in one cycle, in which body axis `axis` lay along the table's axis.
#[derive(Clone, Debug, Default)]
pub struct CycleRecord {
    /// Body axis along the table's axis.
    pub axis: usize,
    /// Mean outputs of the gyros over each sample, rad/s.
    pub rate: Vec<[f64; 3]>,
    /// Mean outputs of the accelerometers over each sample, m/s².
    pub specific_force: Vec<[f64; 3]>,
    /// Angle sensor at each whole second, rad.
    pub angle: Vec<f64>,
    /// True temperature at each whole second.
    pub temperature: Vec<SensorTemperature>,
    /// Second of the whole run at which the cycle began.
    pub began_s: usize,
}

/// The whole run.
#[derive(Clone, Debug, Default)]
pub struct TableRecord {
    /// One cycle for each axis.
    pub cycles: Vec<CycleRecord>,
    /// True temperature at each second of the whole run, remounting included.
    pub temperature: Vec<SensorTemperature>,
}

impl TableRecord {
    /// Readings of a rounding thermometer with noise, degC, at each second of the whole run.
    pub fn thermometer(&self, quantum: f64, noise: f64, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        self.temperature
            .iter()
            .map(|t| ((t.temperature + noise * normal(&mut random)) / quantum + 0.5).floor() * quantum)
            .collect()
    }
}

impl ErrorCoefficients {
    fn at(&self, t: &SensorTemperature) -> f64 {
        let [gx, gy, gz] = t.gradient;
        let [kx, ky, kz] = self.per_gradient;
        self.constant
            + self.per_degree * (t.temperature - 35.0)
            + self.per_rate * t.rate
            + (kx * gx + ky * gy + kz * gz)
    }
}

impl TriadErrors {
    /// Outputs of the sensors for true inputs at a temperature.
    pub fn output(&self, input: &Vector3<f64>, t: &SensorTemperature) -> Vector3<f64> {
        Vector3::from_fn(|i, _| {
            let cross: f64 = (0..3).map(|j| self.matrix[i][j].at(t) * input[j]).sum();
            input[i] + self.bias[i].at(t) + cross
        })
    }
}

impl CalibrationTable {
    /// One run; the same seed gives the same run.
    pub fn run(&self, seed: u64) -> TableRecord {
        // Nobody ends the work.
        self.run_watched(seed, &mut |_| Ok(())).unwrap_or_default()
    }

    /// The same; `watch` is told the seconds done and may end the work.
    ///
    /// # Errors
    /// What `watch` says.
    pub fn run_watched(
        &self,
        seed: u64,
        watch: &mut impl FnMut(usize) -> Result<(), Interrupted>,
    ) -> Result<TableRecord, Interrupted> {
        let mut random = Pcg64::seed_from_u64(seed);
        let length = 3 * (self.cycle_s + REMOUNTING_S) + 1;
        let temperature = self.programme.history(length, self.cycle_s + REMOUNTING_S);
        let cycles = (0..3)
            .map(|axis| self.cycle(axis, &temperature, &mut random, watch))
            .collect::<Result<_, _>>()?;
        Ok(TableRecord { cycles, temperature })
    }

    fn cycle(
        &self,
        axis: usize,
        temperature: &[SensorTemperature],
        random: &mut Pcg64,
        watch: &mut impl FnMut(usize) -> Result<(), Interrupted>,
    ) -> Result<CycleRecord, Interrupted> {
        let began_s = axis * (self.cycle_s + REMOUNTING_S) + REMOUNTING_S / 2;
        let samples = self.samples_per_second;
        let h = 1.0 / samples as f64;
        let temperature = &temperature[began_s..=began_s + self.cycle_s];
        let mounting = gauss3(random, self.mounting);
        let wobble: Vec<Vector3<f64>> = (0..self.cycle_s + 2).map(|_| gauss3(random, self.wobble)).collect();
        let attitude = |t: f64| self.attitude(axis, t, &mounting, &wobble);
        let earth = Vector3::new(0.0, self.latitude.cos(), self.latitude.sin()) * EARTH_RATE;
        let up = Vector3::z() * self.gravity;

        let mut record =
            CycleRecord { axis, began_s, temperature: temperature.to_vec(), ..CycleRecord::default() };
        let mut before = attitude(0.0);
        for k in 0..self.cycle_s * samples {
            let (t, second) = (k as f64 * h, k / samples);
            if k % samples == 0 {
                watch(began_s + second)?;
            }
            let after = attitude(t + h);
            let part = (t + 0.5 * h).fract();
            let now = between(&temperature[second], &temperature[second + 1], part);
            // Rotation of the body against inertial space, seen by the body.
            let turn = before.inverse() * UnitQuaternion::new(earth * h) * after;
            let white = gauss3(random, self.angle_random_walk / h.sqrt());
            record.rate.push((self.gyro.output(&(turn.scaled_axis() / h), &now) + white).into());
            let [start, middle, end] = [before, attitude(t + 0.5 * h), after].map(|q| q.inverse() * up);
            let force = (start + middle * 4.0 + end) / 6.0;
            let white = gauss3(random, self.force_noise / h.sqrt());
            record.specific_force.push((self.accelerometer.output(&force, &now) + white).into());
            before = after;
        }
        record.angle =
            (0..=self.cycle_s).map(|s| self.angle(s as f64) + self.angle_noise * normal(random)).collect();
        Ok(record)
    }

    /// Body to local.
    fn attitude(
        &self,
        axis: usize,
        t: f64,
        mounting: &Vector3<f64>,
        wobble: &[Vector3<f64>],
    ) -> UnitQuaternion<f64> {
        // Table axes in the local frame.
        let along = Vector3::new(self.azimuth.sin(), self.azimuth.cos(), 0.0);
        let level = Rotation3::from_basis_unchecked(&[along, Vector3::z(), along.cross(&Vector3::z())]);
        let base = UnitQuaternion::from_rotation_matrix(&level)
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.tilt);
        let second = t as usize;
        let part = t - second as f64;
        let shake = wobble[second] * (1.0 - part) + wobble[second + 1] * part;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.angle(t));
        // Body axes on the turntable: axis `axis` along its axis, the others in cyclic order.
        let mut columns = [Vector3::zeros(); 3];
        for (k, unit) in [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().enumerate() {
            columns[(axis + k) % 3] = unit;
        }
        let place = UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&columns));
        base * turn * UnitQuaternion::new(shake) * place * UnitQuaternion::new(*mounting)
    }

    /// Angle of the table: rotations to and fro with dwells between, rad.
    fn angle(&self, t: f64) -> f64 {
        const RAMP_S: f64 = 4.0;
        let half = self.rotation_s + self.dwell_s;
        let (turned, phase) = (((t / half) as usize) % 2, t % half);
        // Angle gone through in a rotation after `s` seconds.
        let gone = |s: f64| {
            let s = s.clamp(0.0, self.rotation_s);
            let (rise, fall) = (s.min(RAMP_S), (s - (self.rotation_s - RAMP_S)).max(0.0));
            let steady = s - rise - fall;
            self.rate * (rise * rise / (2.0 * RAMP_S) + steady + fall - fall * fall / (2.0 * RAMP_S))
        };
        if turned == 0 { gone(phase) } else { gone(self.rotation_s) - gone(phase) }
    }
}

impl Programme {
    fn history(&self, length: usize, cycle: usize) -> Vec<SensorTemperature> {
        let plain = |temperature: f64, rate: f64| SensorTemperature { temperature, rate, gradient: [0.0; 3] };
        match *self {
            Self::Steady(t) => vec![plain(t, 0.0); length],
            Self::Ramp(from, rate) => (0..length).map(|t| plain(from + rate * t as f64, rate)).collect(),
            Self::Exponential(from, to, tau) => (0..length)
                .map(|t| {
                    let rest = (from - to) * (-((t % cycle) as f64) / tau).exp();
                    plain(to + rest, -rest / tau)
                })
                .collect(),
            Self::UpAndDown { low, high, period_s, load } => {
                let chamber = |t: f64| {
                    // Up for 35 % of the period, hold 15 %, down 35 %, hold 15 %; a rest of ten minutes first.
                    let phase = (((t - 600.0).max(0.0)) / period_s).fract();
                    let up = (phase / 0.35).clamp(0.0, 1.0) - ((phase - 0.5) / 0.35).clamp(0.0, 1.0);
                    low + (high - low) * up
                };
                conduct(length, load, chamber)
            }
        }
    }
}

/// Heat conduction in the unit: the sensor block in the middle, three walls along the axes, each against the
/// chamber; electronics that warm the block, and a supply behind each wall that switches on its own schedule.
fn conduct(length: usize, load: f64, chamber: impl Fn(f64) -> f64) -> Vec<SensorTemperature> {
    /// Time constants of the block to its walls and of each wall to the chamber, s.
    const BLOCK_S: f64 = 1500.0;
    const WALLS_S: [f64; 3] = [420.0, 600.0, 840.0];
    /// Period of each supply, s, and its warming of the wall, degC.
    const SUPPLY_S: [f64; 3] = [1100.0, 1700.0, 2500.0];
    const SUPPLY: [f64; 3] = [7.0, 6.0, 8.0];
    /// Period of the load, s.
    const LOAD_S: f64 = 1450.0;
    /// Size of the block, m, and the part of the drop from wall to block that falls within it.
    const SIZE: f64 = 0.1;
    const WITHIN: f64 = 0.1;
    let rates = |t: f64, state: [f64; 4]| -> [f64; 4] {
        let [block, walls @ ..] = state;
        let electronics =
            6.0 * (1.0 - (-t / 900.0).exp()) + load * (std::f64::consts::TAU * t / LOAD_S).sin();
        let mean = walls.iter().sum::<f64>() / 3.0;
        let wall = |k: usize| {
            let supply = SUPPLY[k] * (1.0 + (std::f64::consts::TAU * t / SUPPLY_S[k]).sin());
            (chamber(t) + supply - walls[k]) / WALLS_S[k]
        };
        [(mean + electronics - block) / BLOCK_S, wall(0), wall(1), wall(2)]
    };
    let along = |state: [f64; 4], rate: [f64; 4], h: f64| [0, 1, 2, 3].map(|k| state[k] + rate[k] * h);
    let start = chamber(0.0);
    let mut state = [start; 4];
    (0..length)
        .map(|second| {
            let t = second as f64;
            let k1 = rates(t, state);
            let k2 = rates(t + 0.5, along(state, k1, 0.5));
            let k3 = rates(t + 0.5, along(state, k2, 0.5));
            let k4 = rates(t + 1.0, along(state, k3, 1.0));
            let [block, x, y, z] = state;
            let point = SensorTemperature {
                temperature: block,
                rate: k1[0],
                gradient: [x, y, z].map(|wall| (wall - block) * WITHIN / SIZE),
            };
            state = [0, 1, 2, 3].map(|k| state[k] + (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k]) / 6.0);
            point
        })
        .collect()
}

fn between(a: &SensorTemperature, b: &SensorTemperature, part: f64) -> SensorTemperature {
    let mix = |a: f64, b: f64| a + (b - a) * part;
    SensorTemperature {
        temperature: mix(a.temperature, b.temperature),
        rate: mix(a.rate, b.rate),
        gradient: [0, 1, 2].map(|k| mix(a.gradient[k], b.gradient[k])),
    }
}

fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

fn gauss3(random: &mut Pcg64, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * normal(random))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> CalibrationTable {
        CalibrationTable {
            latitude: 0.97,
            gravity: 9.81,
            azimuth: 0.4,
            tilt: 0.0,
            rate: 12.0f64.to_radians(),
            rotation_s: 64.0,
            dwell_s: 20.0,
            cycle_s: 200,
            samples_per_second: 20,
            mounting: 0.0,
            wobble: 0.0,
            angle_noise: 0.0,
            angle_random_walk: 0.0,
            force_noise: 0.0,
            gyro: TriadErrors::default(),
            accelerometer: TriadErrors::default(),
            programme: Programme::Steady(20.0),
        }
    }

    #[test]
    fn faultless_sensors_measure_rotation_earth_rate_and_gravity() {
        let table = table();
        let record = table.run(1);
        for cycle in &record.cycles {
            let along = cycle.rate.iter().map(|w| w[cycle.axis]);
            // Rotating at 30 s; at rest at 75 s: only Earth rate, along the axis U cos(lat) cos(azimuth).
            let rotating = along.clone().nth(600).expect("long enough");
            let resting = along.clone().nth(1500).expect("long enough");
            let earth = EARTH_RATE * table.latitude.cos() * table.azimuth.cos();
            assert!((rotating - table.rate - earth).abs() < 1e-9, "{rotating}");
            assert!((resting - earth).abs() < 1e-9, "{resting}");
            let whole = Vector3::from(cycle.rate[1500]).norm();
            assert!((whole - EARTH_RATE).abs() < 1e-9, "{whole}");
            for force in &cycle.specific_force {
                assert!(force[cycle.axis].abs() < 1e-9);
                // The mean over a sample of a vector that turns by 0.6 degrees is shorter by 5 millionths.
                assert!((Vector3::from(*force).norm() - 9.81).abs() < 1e-4);
            }
            // The integral of the rate is the angle.
            let turned: f64 = along.take(40 * 20).sum::<f64>() / 20.0 - earth * 40.0;
            assert!((turned - cycle.angle[40]).abs() < 1e-6, "{turned}");
        }
    }

    #[test]
    fn temperature_rate_is_the_derivative_of_the_temperature() {
        let programme = Programme::UpAndDown { low: 0.0, high: 50.0, period_s: 3000.0, load: 3.0 };
        let history = programme.history(8000, 3600);
        for t in 1..7999 {
            let slope = 0.5 * (history[t + 1].temperature - history[t - 1].temperature);
            assert!((slope - history[t].rate).abs() < 2e-5, "{t}: {slope} {}", history[t].rate);
        }
    }
}
