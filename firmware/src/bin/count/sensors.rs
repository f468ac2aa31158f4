//! Temperature and its rate, thermal correction, and the health of a pair of sensors.
use nalgebra::{ComplexField, RealField};
use schuler_core::health::{HealthConfig, HealthMonitor, HealthOutput};
use schuler_core::reading::Reading;
use schuler_core::thermal::Scalar;
use schuler_core::thermal::compensation::{CompensationBlock, Compensator, Correction};
use schuler_core::thermal::features::ThermalState;
use schuler_core::thermal::rate::{TemperatureRate, TemperatureRateConfig, TemperatureRateOutput};

use crate::arithmetic::heading;
use crate::meter::{Meter, Random};

const SAMPLES: usize = 2000;
/// In double precision, which does not fly: enough to know what it would take.
const SAMPLES_IN_DOUBLE: usize = 200;

/// A thermometer of a sixteenth of a degree: slow and fast change, noise, gaps, nonsense, clocks set back.
pub struct Thermometer {
    step: u64,
    temperature: f64,
}

impl Thermometer {
    /// At its first reading, degC.
    pub fn at(temperature: f64) -> Self {
        Self { step: 0, temperature }
    }

    /// Time, ms, and reading of the next step.
    pub fn next<T: RealField>(&mut self, random: &mut Random) -> (u64, Reading<T>) {
        self.step += 1;
        let phase = self.step % 2000;
        self.temperature += match phase {
            0..600 => 0.01,
            600..900 => -0.08,
            _ => 0.001,
        };
        let noise = if phase > 1400 { 0.06 } else { 0.005 };
        let level = ComplexField::round((self.temperature + noise * random.normal()) * 16.0) / 16.0;
        let late = if phase > 1000 { 700_000 } else { 0 };
        let mut time_ms = self.step * 1000 + late;
        let mut reading = Reading::good(nalgebra::convert(level));
        match phase {
            700..705 => reading.value = nalgebra::convert(f64::NAN),
            1200 => reading.value = nalgebra::convert(-300.0),
            1300..1310 => time_ms = 5000,
            _ if random.once_in(50) => {
                reading = Reading { quality: schuler_core::reading::Quality::Missing, ..reading }
            }
            _ if random.once_in(100) => reading.value += nalgebra::convert(20.0),
            _ => (),
        }
        (time_ms, reading)
    }
}

/// Temperature rate and health monitor.
#[inline(never)]
pub fn count<T: Scalar + Default>(meter: &mut Meter, precision: &str) {
    let samples = if size_of::<T>() > 4 { SAMPLES_IN_DOUBLE } else { SAMPLES };
    let config = TemperatureRateConfig::of_quantum(nalgebra::convert::<f64, T>(1.0 / 16.0));
    let Ok(rate) = TemperatureRate::try_build(&config) else { return };
    meter.part(
        &heading("temperature rate", precision),
        samples,
        (rate, Thermometer::at(20.0), (0, Reading::missing()), TemperatureRateOutput::default()),
        |(_, thermometer, next, _), random| *next = thermometer.next(random),
        |(rate, _, (time_ms, reading), output)| *output = rate.step(*time_ms, reading),
    );

    let Ok(monitor) = HealthMonitor::try_build(&HealthConfig::<T, 2>::doppler_against_inertial()) else {
        return;
    };
    let pair = Pair::new();
    meter.part(
        &heading("health monitor", precision),
        samples,
        (monitor, pair, HealthOutput::default()),
        |(_, pair, _), random| pair.next(random),
        |(monitor, pair, output)| *output = monitor.step(&pair.radio, &pair.inertial, pair.elapsed),
    );
}

/// A radio speed against an inertial one, m/s: noise, jumps, grown noise, gaps, nonsense.
pub struct Pair<T> {
    step: u32,
    /// Readings of the step.
    pub radio: Reading<T>,
    pub inertial: Reading<T>,
    elapsed: u32,
}

impl<T: RealField + Copy + Default> Pair<T> {
    /// Before the first step.
    pub fn new() -> Self {
        Self { step: 0, radio: Reading::missing(), inertial: Reading::missing(), elapsed: 1 }
    }

    /// Makes the next step's readings.
    pub fn next(&mut self, random: &mut Random) {
        self.step += 1;
        let phase = self.step % 1000;
        let noise = if (400..500).contains(&phase) { 1.0 } else { 0.3 };
        let shift = match phase {
            200..260 => 1.5,
            700 => 1e4,
            710..715 => 1e30,
            720 => f64::NAN,
            _ => 0.0,
        };
        self.radio = Reading::good(nalgebra::convert(200.0 + shift + noise * random.normal()));
        self.inertial = Reading::good(nalgebra::convert(200.0));
        if random.once_in(30) {
            self.radio = Reading::missing();
        }
        self.elapsed = match phase {
            800 => 0,
            810 => 900,
            820 => 100_000,
            _ if random.once_in(50) => 7,
            _ => 1,
        };
    }
}

/// Correction of both triads at a thermal state. The signals are double, the coefficients single precision.
#[inline(never)]
pub fn count_correction(meter: &mut Meter) {
    let mut block = CompensationBlock::default();
    for (i, row) in block.gyro.matrix.iter_mut().enumerate() {
        for (j, coefficient) in row.iter_mut().enumerate() {
            coefficient[0] = 0.01 * (i as f32 - j as f32);
            coefficient[1] = 0.001;
        }
    }
    let Ok(compensator) = Compensator::try_build(&block) else { return };
    let state = ThermalState::default();
    let at = compensator.correction(&state);
    meter.part(
        "thermal correction: at a temperature, f32",
        SAMPLES,
        (compensator, state, at),
        |(_, state, _), random| *state = thermal_state(random),
        |(compensator, state, at)| *at = compensator.correction(state),
    );
    let sample = Sample { at, measured: [[0.0; 3]; 2], corrected: [[0.0; 3]; 2] };
    meter.part(
        "thermal correction: rates and forces, f64",
        SAMPLES,
        (compensator, sample),
        |(compensator, sample), random| {
            sample.at = compensator.correction(&thermal_state(random));
            sample.measured = [[0; 3]; 2].map(|triad| triad.map(|_: i32| 0.01 * random.symmetric()));
        },
        |(_, sample)| {
            let [rate, force] = sample.measured;
            sample.corrected = [sample.at.rate(rate), sample.at.specific_force(force)];
        },
    );
}

struct Sample {
    at: Correction,
    measured: [[f64; 3]; 2],
    corrected: [[f64; 3]; 2],
}

fn thermal_state(random: &mut Random) -> ThermalState {
    let mut single = |scale: f64| (!random.once_in(20)).then_some((scale * random.symmetric()) as f32);
    let (temperature, rate, gradient) = (single(120.0), single(0.03), single(30.0));
    ThermalState { temperature, rate, gradient: gradient.map(|g| [g, -g, 0.5 * g]) }
}
