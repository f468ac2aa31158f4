//! A long flight with everything that can go wrong in it, for comparing two targets. Not a physical simulation to judge
//! the estimation by: it only has to lead the module through all of its branches.
use num_traits::Float;
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_core::compensation::{Block, Calibration, Factor, Quantity, Target, Term, Validity};
use schuler_core::health::{HealthConfig, MemoryModel};
use schuler_core::isolation::IsolationConfig;
use schuler_core::module::{ACCELEROMETERS, Command, GYROS, ModuleConfig, RadioUse, StepInput, THERMOMETERS};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::{CompensationBlock, TemperatureRateConfig};

/// Radius of the Earth, m, and gravity, m/s².
const RADIUS: f64 = 6_371_000.0;
const GRAVITY: f64 = 9.80665;
/// Rate of the Earth, rad/s.
const EARTH_RATE: f64 = 7.292_115e-5;

/// Inputs of the flight, one a step, for good.
#[derive(Clone)]
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
    /// Markov error of the radio velocity, m/s.
    radio_error: f64,
    /// Steps that the present disturbance lasts.
    remaining: u32,
    disturbance: Disturbance,
    /// How often each disturbance has begun.
    pub(crate) begun: [u32; KINDS],
}

const KINDS: usize = 18;

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
    AccelerometerLost(usize),
    ThermometerLost(usize),
    ThermometerWild(usize),
    RadioLost,
    RadioWild,
    RadioJump(f64),
    RadioNoise,
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
            radio_error: 0.0,
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
            self.remaining = self.random.random_range(50..350);
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
            10 => (Disturbance::AccelerometerLost(self.random.random_range(0..ACCELEROMETERS)), 60),
            11 => (Disturbance::ThermometerLost(self.random.random_range(0..THERMOMETERS)), 900),
            12 => (Disturbance::ThermometerWild(self.random.random_range(0..THERMOMETERS)), 20),
            13 => (Disturbance::RadioLost, 900),
            14 => (Disturbance::RadioWild, 10),
            15 => (Disturbance::RadioJump(self.random.random_range(-5.0..5.0)), 300),
            16 => (Disturbance::RadioNoise, 300),
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
            Disturbance::VelocityNotFinite => Reading { value: self.nonsense(), ..good },
            Disturbance::VelocityWild => Reading { value: value + 50.0, ..good },
            _ => good,
        }
    }

    /// A value that no converter gives.
    fn nonsense<T: Float>(&mut self) -> T {
        let values = [
            T::nan(),
            -T::nan(),
            T::infinity(),
            T::neg_infinity(),
            T::max_value(),
            T::min_positive_value() / T::from(8.0).unwrap(),
        ];
        values[self.random.random_range(0..values.len())]
    }

    fn accelerometer_readings(&mut self) -> [Reading<f64>; ACCELEROMETERS] {
        let sway = 0.05 * (self.step as f64 / 7.0).sin();
        let mut readings = [GRAVITY * sway, -GRAVITY * sway / 2.0, -GRAVITY]
            .map(|force| Reading::good(force + 1e-4 * self.normal()));
        match self.disturbance {
            Disturbance::AccelerometerLost(k) => {
                readings[k] = match self.random.random_range(0..3) {
                    0 => Reading::missing(),
                    1 => Reading { quality: Quality::Saturated, ..readings[k] },
                    _ => Reading::good(self.nonsense()),
                }
            }
            Disturbance::AllMissing => readings = [Reading::missing(); ACCELEROMETERS],
            _ => (),
        }
        readings
    }

    /// Ramps of temperature, each thermometer behind the one before, in quanta of 1/16 degC.
    fn thermometer_readings(&mut self) -> [Reading<f32>; THERMOMETERS] {
        let hours = self.step as f64 / 3600.0;
        let mut readings: [Reading<f32>; THERMOMETERS] = std::array::from_fn(|k| {
            let temperature = 30.0 + 25.0 * ((hours - 0.2 * k as f64) * 0.7).sin();
            let age_ms = if k == 3 { 400 } else { 0 };
            let value = (temperature * 16.0).round() as f32 / 16.0;
            Reading { value, age_ms, quality: Quality::Good }
        });
        match self.disturbance {
            Disturbance::ThermometerLost(k) => readings[k] = Reading::missing(),
            Disturbance::ThermometerWild(k) => {
                let value = if self.random.random_bool(0.5) { self.nonsense() } else { -273.15 };
                readings[k] =
                    Reading { value, age_ms: self.random.random_range(0..4000), quality: Quality::Good };
            }
            Disturbance::AllMissing => readings = [Reading::missing(); THERMOMETERS],
            _ => (),
        }
        readings
    }

    /// Radio and inertial velocity, m/s.
    fn velocities(&mut self) -> [Reading<f32>; 2] {
        let speed = 100.0 + 20.0 * (self.step as f64 / 500.0).sin();
        self.radio_error += -self.radio_error / 10.0 + 0.13 * self.normal();
        let noise = if self.disturbance == Disturbance::RadioNoise { 2.0 } else { 0.0 };
        let jump = if let Disturbance::RadioJump(size) = self.disturbance { size } else { 0.0 };
        let radio = speed + self.radio_error + jump + noise * self.normal();
        let inertial = speed + self.velocity;
        let mut readings = [radio, inertial].map(|velocity| Reading::good(velocity as f32));
        match self.disturbance {
            Disturbance::RadioLost => readings[0].quality = Quality::Saturated,
            Disturbance::RadioWild => {
                let which = self.random.random_range(0..2);
                let wild = [1e4, -1e30][self.random.random_range(0..2)];
                readings[which].value = if self.random.random_bool(0.5) { self.nonsense() } else { wild };
            }
            Disturbance::VelocityStale => readings[1].age_ms = 100_000,
            Disturbance::AllMissing => readings = [Reading::missing(); 2],
            _ => (),
        }
        readings
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
        let [radio_velocity, inertial_velocity] = self.velocities();
        Some(StepInput {
            time_ms: self.time_ms,
            velocity_error: self.velocity_reading(),
            gyros: self.gyro_readings(),
            accelerometers: self.accelerometer_readings(),
            thermometers: self.thermometer_readings(),
            radio_velocity,
            inertial_velocity,
            command,
        })
    }
}

/// The default configuration with every part on.
pub(crate) fn everything() -> ModuleConfig {
    let memory = Some(MemoryModel { repeat: 0.05, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 });
    ModuleConfig {
        thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); THERMOMETERS],
        health: Some(HealthConfig { memory, ..HealthConfig::doppler_against_inertial() }),
        radio_use: Some(RadioUse::DEFAULT),
        ..ModuleConfig::default()
    }
}

/// A block with a calibration and a term of every kind and on every target.
pub(crate) fn full_block() -> Block {
    let mut coefficients = CompensationBlock::default();
    coefficients.features.temperature_range = [10.0, 50.0];
    for triad in [&mut coefficients.gyro, &mut coefficients.accelerometer] {
        triad.bias = [[1e-6, 2e-7, -1e-7, 0.0, 0.0, 0.0]; 3];
        triad.matrix[0][0] = [1e-4, 2e-5, 0.0, 0.0, 0.0, 0.0];
        triad.matrix[2][1] = [-3e-4, 0.0, 1e-5, 0.0, 0.0, 0.0];
    }
    let factor = |quantity: Quantity, reference: f32, power: u8| Factor { quantity, reference, power };
    let one = Factor::default();
    let mut terms = Vec::new();
    let channel = [(Target::Velocity, 1e-4), (Target::LoopAccelerometer, 1e-6), (Target::LoopGyro, 1e-9)];
    let gyros = (0..GYROS as u8).map(|gyro| (Target::Gyro(gyro), 1e-8));
    let accelerometers = (0..ACCELEROMETERS as u8).map(|k| (Target::Accelerometer(k), 1e-5));
    for (target, unit) in channel.into_iter().chain(gyros).chain(accelerometers) {
        let k = terms.len() as u8 % THERMOMETERS as u8;
        let mut term =
            |coefficient: f32, factors: [Factor; 2]| terms.push(Term { target, coefficient, factors });
        let temperature = factor(Quantity::Temperature(k), 30.0, 1);
        term(unit, [one, one]);
        term(unit / 10.0, [temperature, one]);
        if !matches!(target, Target::LoopAccelerometer | Target::LoopGyro) {
            term(1e-4, [Quantity::Input.into(), one]);
            term(1e-5, [Quantity::InputMagnitude.into(), temperature]);
        }
        if !matches!(target, Target::Accelerometer(_)) {
            term(unit / 100.0, [factor(Quantity::Temperature(k), 30.0, 2), one]);
            term(unit * 100.0, [factor(Quantity::TemperatureRate(k), 0.0, 1), one]);
            term(unit / 10.0, [factor(Quantity::TemperatureDifference(k, (k + 1) % 4), 0.0, 1), one]);
            term(unit, [factor(Quantity::SpecificForce(k % 3), 0.0, 1), temperature]);
            term(unit, [factor(Quantity::Rate(k), 0.0, 1), factor(Quantity::SpecificForce(2), 0.0, 1)]);
        }
    }
    // Every place is taken.
    assert_eq!(terms.len(), schuler_core::compensation::MAX_TERMS);
    Block {
        calibration: Some(Calibration { thermometer: 2, coefficients }),
        validity: Validity { temperature_range: [8.0, 52.0], rate_limit: 0.004 },
        terms: terms.into_iter().collect(),
        ..Block::default()
    }
}
