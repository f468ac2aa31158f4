//! The compensation block: what it took from each sensor.
use schuler_core::compensation::TermStatus;
use schuler_core::module::StepOutput;
use schuler_core::reading::Quality;
use schuler_core::thermal::CompensationStatus;
use serde::Serialize;

use crate::flight::outputs::corrected;
use crate::flight::sensors::Place;
use crate::flight::{Channel, Step};

/// The compensation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompensationSummary {
    /// Checksum of the block.
    pub checksum: String,
    /// Steps in which something that it needs was not known.
    pub inputs_missing: usize,
    /// Steps outside the range for which it holds.
    pub out_of_range: usize,
    /// Steps in which a correction was held at its limit.
    pub limited: usize,
    /// Sensor by sensor.
    pub sensors: Vec<CorrectedSensor>,
    /// Root mean square of what was taken off the velocity error as error of its measurement, m/s.
    pub velocity: f64,
    /// Root mean square of the known errors in the Schuler loop: accelerometer, m/s², and gyro, rad/s.
    pub loop_errors: [f64; 2],
}

/// What was taken off a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CorrectedSensor {
    /// The sensor.
    pub sensor: String,
    /// `rad/s` or `m/s^2`.
    pub unit: &'static str,
    /// Mean correction.
    pub mean: f64,
    /// Standard deviation of the corrections.
    pub deviation: f64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct CompensationSums {
    inputs_missing: usize,
    out_of_range: usize,
    limited: usize,
    sensors: Vec<(String, Place, Moments)>,
    velocity: f64,
    loop_errors: [f64; 2],
}

impl CompensationSums {
    pub(super) fn of(channel: &Channel) -> Self {
        let sensors = channel.sensors.iter().map(|(id, place)| (id.clone(), *place, Moments::default()));
        Self { sensors: sensors.collect(), ..Self::default() }
    }

    pub(super) fn add(&mut self, step: &Step, output: &StepOutput) {
        let it = &output.compensation;
        let is = |terms: TermStatus, calibration: CompensationStatus| {
            usize::from(it.terms.intersects(terms) || it.calibration.intersects(calibration))
        };
        let unknown = CompensationStatus::NO_TEMPERATURE | CompensationStatus::NO_RATE;
        self.inputs_missing += is(TermStatus::INPUT_MISSING, unknown);
        self.out_of_range += is(TermStatus::OUT_OF_RANGE, CompensationStatus::OUT_OF_RANGE);
        self.limited += is(TermStatus::LIMITED, CompensationStatus::empty());
        for (_, place, taken) in &mut self.sensors {
            let reading = match place {
                Place::Gyro(k) => step.input.gyros.get(*k),
                Place::Accelerometer(k) => step.input.accelerometers.get(*k),
            };
            if let Some(reading) = reading.filter(|reading| reading.quality == Quality::Good) {
                taken.add(reading.value - corrected(output, *place));
            }
        }
        self.velocity += f64::from(it.velocity).powi(2);
        for (sum, error) in self.loop_errors.iter_mut().zip(it.loop_errors) {
            *sum += f64::from(error).powi(2);
        }
    }

    pub(super) fn finish(self, bytes: &[u8], steps: usize) -> CompensationSummary {
        let rms = |sum: f64| (sum / steps.max(1) as f64).sqrt();
        let sensors = self.sensors.into_iter().map(|(sensor, place, taken)| CorrectedSensor {
            sensor,
            unit: if matches!(place, Place::Gyro(_)) { "rad/s" } else { "m/s^2" },
            mean: taken.mean,
            deviation: (taken.squares / taken.count.max(1.0)).sqrt(),
        });
        let checksum = bytes.last_chunk().map_or(0, |last| u32::from_le_bytes(*last));
        CompensationSummary {
            checksum: format!("{checksum:08x}"),
            inputs_missing: self.inputs_missing,
            out_of_range: self.out_of_range,
            limited: self.limited,
            sensors: sensors.collect(),
            velocity: rms(self.velocity),
            loop_errors: self.loop_errors.map(rms),
        }
    }
}

/// Mean and spread of numbers as they come (Welford, Technometrics 4, 1962).
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    /// Sum of the squares about the mean.
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
    }
}
