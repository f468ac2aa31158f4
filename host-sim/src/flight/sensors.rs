//! Which sensors of a case stand at which inputs of the flight module, beside the velocities.
use schuler_core::module::{ACCELEROMETERS, GYROS, StepInput, THERMOMETERS};
use schuler_core::reading::Reading;
use schuler_core::thermal::TemperatureRateConfig;
use schuler_recording::Recording;
use schuler_recording::case::{Quantity, SensorKind};
use schuler_recording::recording::{AuxiliarySeries, SensorSeries};

/// Least quantum of a thermometer that is worth speaking of, degC.
const LEAST_QUANTUM: f64 = 1e-3;
/// Greatest quantum that can be flown, degC.
const GREATEST_QUANTUM: f64 = 10.0;
/// A sensor stands at a body axis when it is nearer to it than to any other: cosine of 54.7 degrees.
const NEAREST_AXIS: f64 = 0.578;

/// A sensor and its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Gyro of this index.
    Gyro(usize),
    /// Accelerometer of this index.
    Accelerometer(usize),
}

/// The inertial sensors and thermometers of a channel.
#[derive(Clone, Debug, Default)]
pub(super) struct Instruments<'r> {
    pub(super) gyros: [Option<&'r SensorSeries>; GYROS],
    pub(super) accelerometers: [Option<&'r SensorSeries>; ACCELEROMETERS],
    pub(super) thermometers: [Option<&'r AuxiliarySeries>; THERMOMETERS],
}

impl<'r> Instruments<'r> {
    /// Those of a recording; `five` is its gyro block, if there is one.
    pub(super) fn of(recording: &'r Recording, five: Option<&[&'r SensorSeries; GYROS]>) -> Self {
        let is_gyro = |series: &&SensorSeries| {
            use SensorKind::{Dtg, Fog, MemsGyro, Rlg};
            matches!(series.sensor.kind, Dtg | Fog | Rlg | MemsGyro)
        };
        let is_accelerometer = |series: &&SensorSeries| series.sensor.kind == SensorKind::Accelerometer;
        let mut gyros = [None; GYROS];
        if let Some(five) = five {
            gyros = five.map(Some);
        } else {
            let [x, y, z, ..] = &mut gyros;
            at_body_axes(recording.sensors.iter().filter(is_gyro), [x, y, z]);
        }
        let mut accelerometers = [None; ACCELEROMETERS];
        at_body_axes(recording.sensors.iter().filter(is_accelerometer), accelerometers.each_mut());

        // Those at a sensor first.
        let mut all: Vec<&AuxiliarySeries> = recording
            .auxiliaries
            .iter()
            .filter(|it| it.auxiliary.quantity == Quantity::Temperature && it.auxiliary.unit == "degC")
            .filter(|it| it.values.iter().any(|value| value.is_finite()))
            .collect();
        all.sort_by_key(|it| it.auxiliary.near.is_none());
        let mut thermometers = [None; THERMOMETERS];
        for (place, series) in thermometers.iter_mut().zip(all) {
            *place = Some(series);
        }
        Self { gyros, accelerometers, thermometers }
    }

    /// Puts the readings of a row into a step's input.
    pub(super) fn read(&self, row: usize, input: &mut StepInput) {
        input.gyros = self.gyros.map(|series| reading(series.map(|it| it.values.as_slice()), row));
        input.accelerometers =
            self.accelerometers.map(|series| reading(series.map(|it| it.values.as_slice()), row));
        input.thermometers = self.thermometers.map(|series| {
            let reading = reading(series.map(|it| it.values.as_slice()), row);
            Reading { value: reading.value as f32, age_ms: reading.age_ms, quality: reading.quality }
        });
    }

    /// Ids of the inertial sensors with their inputs.
    pub(super) fn corrected(&self) -> Vec<(String, Place)> {
        let named = |series: Option<&SensorSeries>, place: Place| {
            series.map(|series| (series.sensor.id.clone(), place))
        };
        let gyros = self.gyros.iter().enumerate().filter_map(|(k, it)| named(*it, Place::Gyro(k)));
        let forces =
            self.accelerometers.iter().enumerate().filter_map(|(k, it)| named(*it, Place::Accelerometer(k)));
        gyros.chain(forces).collect()
    }

    /// Columns of the thermometers.
    pub(super) fn thermometer_columns(&self) -> Vec<String> {
        self.thermometers.iter().flatten().map(|series| series.auxiliary.column.clone()).collect()
    }

    /// Configuration of the thermometers.
    pub(super) fn thermometer_configs(&self) -> [Option<TemperatureRateConfig<f32>>; THERMOMETERS] {
        self.thermometers
            .map(|series| series.map(|it| TemperatureRateConfig::of_quantum(quantum(&it.values) as f32)))
    }
}

/// Puts each sensor at the body axis that is nearest to its own; the first one there stays.
fn at_body_axes<'r>(
    sensors: impl Iterator<Item = &'r SensorSeries>,
    places: [&mut Option<&'r SensorSeries>; 3],
) {
    let sensors: Vec<&SensorSeries> = sensors.collect();
    for (axis, place) in places.into_iter().enumerate() {
        let along =
            |series: &SensorSeries| series.sensor.axis.is_some_and(|of| of[axis].abs() > NEAREST_AXIS);
        *place = sensors.iter().copied().find(|series| along(series));
    }
}

/// The reading in a row.
pub(super) fn reading(values: Option<&[f64]>, row: usize) -> Reading<f64> {
    let value = values.and_then(|values| values.get(row)).copied().filter(|value| value.is_finite());
    value.map_or_else(Reading::missing, Reading::good)
}

/// Quantisation step of a thermometer, degC, of which cases do not speak: the median distance of neighbouring values.
fn quantum(values: &[f64]) -> f64 {
    let mut levels: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    levels.sort_unstable_by(f64::total_cmp);
    let mut steps: Vec<f64> = levels.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 1e-6).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let median = steps.get(steps.len() / 2).copied().unwrap_or(LEAST_QUANTUM);
    median.clamp(LEAST_QUANTUM, GREATEST_QUANTUM)
}

#[cfg(test)]
mod tests {
    use super::quantum;

    #[test]
    fn a_quantum_is_found_with_missing_levels_and_rounded_print() {
        let level = |k: f64| (k * 0.0625 * 100.0).round() / 100.0;
        let readings: Vec<f64> = (0..4000).map(|k| level((f64::from(k) / 100.0).floor())).collect();
        assert!((quantum(&readings) - 0.0625).abs() < 0.008, "{}", quantum(&readings));
        assert_eq!(quantum(&[20.0, f64::NAN, 20.25, 20.25, 21.0, 20.5]), 0.25);
        assert_eq!(quantum(&[20.0; 5]), 1e-3);
        let fine: Vec<f64> = (0..4000).map(|k| 20.0 + (f64::from(k) * 0.7).sin()).collect();
        assert_eq!(quantum(&fine), 1e-3);
    }
}
