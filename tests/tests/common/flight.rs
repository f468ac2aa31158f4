//! A long flight with everything that can go wrong in it, for comparing two targets. Not a physical simulation to judge
//! the estimation by: it only has to lead the module through all of its branches.
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_core::isolation::IsolationConfig;
use schuler_core::module::{Command, GYROS, StepInput};
use schuler_core::reading::{Quality, Reading};

/// Radius of the Earth, m, and gravity, m/s².
const RADIUS: f64 = 6_371_000.0;
const GRAVITY: f64 = 9.80665;
/// Rate of the Earth, rad/s.
const EARTH_RATE: f64 = 7.292_115e-5;

/// Inputs of the flight, one a step, for good.
pub(crate) struct Flight {
    random: Pcg64,
    step: u64,
    time_ms: u64,
    /// Velocity error, m/s; vertical error, rad.
    velocity: f64,
    vertical: f64,
    /// Markov errors: accelerometer, m/s²; gyro, rad/s.
    accelerometer: f64,
    gyro: f64,
    /// Steps that the present disturbance lasts.
    remaining: u32,
    disturbance: Disturbance,
    /// How often each disturbance has begun.
    pub(crate) begun: [u32; KINDS],
}

const KINDS: usize = 11;

#[derive(Clone, Copy, PartialEq)]
enum Disturbance {
    None,
    VelocityMissing,
    VelocitySaturated,
    VelocityStale,
    VelocityNotFinite,
    VelocityWild,
    GyroMissing(usize),
    GyroSaturated(usize),
    GyroFailed(usize, f64),
    AllMissing,
    Clock,
}

impl Flight {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            random: Pcg64::seed_from_u64(seed),
            step: 0,
            time_ms: 0,
            velocity: 0.3,
            vertical: 1e-4,
            accelerometer: 0.0,
            gyro: 0.0,
            remaining: 2000,
            disturbance: Disturbance::None,
            begun: [0; KINDS],
        }
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    /// Schuler loop with Markov errors, whose noise changes every few hours so that there is something to retune.
    fn propagate(&mut self) {
        let calm = (self.step / 14_400).is_multiple_of(2);
        let (sigma_a, tau_a) = if calm { (9.8e-4, 60.0) } else { (3e-3, 200.0) };
        let (sigma_w, tau_w) = if calm { (4.8e-7, 1800.0) } else { (1.5e-6, 600.0) };
        self.accelerometer += -self.accelerometer / tau_a + sigma_a * (2.0f64 / tau_a).sqrt() * self.normal();
        self.gyro += -self.gyro / tau_w + sigma_w * (2.0f64 / tau_w).sqrt() * self.normal();
        self.velocity += -GRAVITY * self.vertical + self.accelerometer;
        self.vertical += self.velocity / RADIUS + self.gyro;
    }

    fn disturb(&mut self) {
        self.remaining = self.remaining.saturating_sub(1);
        if self.remaining > 0 {
            return;
        }
        if self.disturbance != Disturbance::None {
            self.disturbance = Disturbance::None;
            self.remaining = self.random.random_range(50..600);
            return;
        }
        let gyro = self.random.random_range(0..GYROS);
        let kind = self.random.random_range(1..KINDS);
        let (disturbance, longest) = match kind {
            1 => (Disturbance::VelocityMissing, 120),
            2 => (Disturbance::VelocitySaturated, 30),
            3 => (Disturbance::VelocityStale, 30),
            4 => (Disturbance::VelocityNotFinite, 5),
            5 => (Disturbance::VelocityWild, 20),
            6 => (Disturbance::GyroMissing(gyro), 100),
            7 => (Disturbance::GyroSaturated(gyro), 50),
            8 => (Disturbance::GyroFailed(gyro, 10f64.powf(self.random.random_range(-6.5..-3.0))), 900),
            9 => (Disturbance::AllMissing, 60),
            _ => (Disturbance::Clock, 2),
        };
        self.begun[kind] += 1;
        self.disturbance = disturbance;
        self.remaining = self.random.random_range(1..=longest);
    }

    fn advance_clock(&mut self) {
        let jump = self.disturbance == Disturbance::Clock;
        self.time_ms = if jump {
            match self.random.random_range(0..5) {
                0 => self.time_ms,
                1 => self.time_ms.saturating_sub(self.random.random_range(1..100_000)),
                2 => self.time_ms + self.random.random_range(1..900),
                3 => self.time_ms + self.random.random_range(1100..20_000),
                _ => self.time_ms + self.random.random_range(100_000..10_000_000),
            }
        } else {
            self.time_ms + 1000 + u64::from(self.random.random_bool(0.05))
        };
    }

    fn velocity_reading(&mut self) -> Reading<f32> {
        let value = (self.velocity + 0.1 * self.normal()) as f32;
        let age_ms = self.random.random_range(0..200);
        let good = Reading { value, age_ms, quality: Quality::Good };
        match self.disturbance {
            Disturbance::VelocityMissing | Disturbance::AllMissing => Reading::missing(),
            Disturbance::VelocitySaturated => Reading { value: 20.0, quality: Quality::Saturated, ..good },
            Disturbance::VelocityStale => Reading { age_ms: 1000 + self.random.next_u32() % 100_000, ..good },
            Disturbance::VelocityNotFinite => {
                let values = [
                    f32::NAN,
                    -f32::NAN,
                    f32::INFINITY,
                    f32::NEG_INFINITY,
                    f32::MAX,
                    f32::MIN_POSITIVE / 8.0,
                ];
                Reading { value: values[self.random.random_range(0..values.len())], ..good }
            }
            Disturbance::VelocityWild => Reading { value: value + 50.0, ..good },
            _ => good,
        }
    }

    fn gyro_readings(&mut self) -> [Reading<f64>; GYROS] {
        let t = self.step as f64;
        let turn = if self.step % 3600 < 300 { 0.02 } else { 0.0 };
        let rate = [EARTH_RATE * (t / 900.0).cos(), -EARTH_RATE * (t / 700.0).sin(), EARTH_RATE + turn];
        let axes = IsolationConfig::CONE.axes;
        let mut readings = axes.map(|axis| {
            let projected: f64 = axis.iter().zip(&rate).map(|(a, w)| a * w).sum();
            Reading::good(projected + 1e-7 * self.normal())
        });
        match self.disturbance {
            Disturbance::GyroMissing(k) => readings[k] = Reading::missing(),
            Disturbance::GyroSaturated(k) => {
                readings[k] = Reading { value: 1.0, age_ms: 0, quality: Quality::Saturated }
            }
            Disturbance::GyroFailed(k, bias) => readings[k].value += bias,
            Disturbance::AllMissing => readings = [Reading::missing(); GYROS],
            Disturbance::VelocityNotFinite => readings[0].value = f64::NAN,
            _ => (),
        }
        readings
    }
}

impl Iterator for Flight {
    type Item = StepInput;

    fn next(&mut self) -> Option<StepInput> {
        self.step += 1;
        self.propagate();
        self.disturb();
        self.advance_clock();
        let command = match self.random.random_range(0..1000) {
            0 => Command::ReadmitGyro(self.random.random_range(0..GYROS as u8)),
            1 => Command::ReadmitGyro(u8::MAX),
            _ => Command::None,
        };
        Some(StepInput {
            time_ms: self.time_ms,
            velocity_error: self.velocity_reading(),
            gyros: self.gyro_readings(),
            command,
        })
    }
}
