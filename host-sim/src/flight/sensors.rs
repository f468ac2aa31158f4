//! Which sensors of a case stand at which inputs of the flight module, beside the velocities.
use std::collections::BTreeMap;

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
/// Readings of a thermometer that are nearer to each other are one, degC.
const DISTINCT: f64 = 1e-6;
/// Readings that are told apart; as many within 65 degrees are no further apart than the least quantum.
const MOST_LEVELS: usize = 1 << 17;
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

/// The inertial sensors and thermometers of a channel, by their index in the recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Instruments {
    gyros: [Option<usize>; GYROS],
    accelerometers: [Option<usize>; ACCELEROMETERS],
    thermometers: [Option<usize>; THERMOMETERS],
}

impl Instruments {
    /// Those of a recording; `five` is its gyro block, if there is one, and `levels` what each auxiliary quantity has shown.
    pub(super) fn of(recording: &Recording, five: Option<&[usize; GYROS]>, levels: &[Levels]) -> Self {
        let of_kind = |is: fn(SensorKind) -> bool| {
            (recording.sensors.iter().enumerate()).filter(move |(_, series)| is(series.sensor.kind))
        };
        let mut gyros = [None; GYROS];
        if let Some(five) = five {
            gyros = five.map(Some);
        } else {
            let [x, y, z, ..] = &mut gyros;
            at_body_axes(of_kind(is_gyro), [x, y, z]);
        }
        let mut accelerometers = [None; ACCELEROMETERS];
        at_body_axes(of_kind(|kind| kind == SensorKind::Accelerometer), accelerometers.each_mut());

        // Those at a sensor first.
        let mut all: Vec<(usize, &AuxiliarySeries)> = (recording.auxiliaries.iter().enumerate())
            .filter(|(_, it)| is_thermometer(it))
            .filter(|(index, _)| levels.get(*index).is_some_and(|levels| !levels.seen.is_empty()))
            .collect();
        all.sort_by_key(|(_, it)| it.auxiliary.near.is_none());
        let mut thermometers = [None; THERMOMETERS];
        for (place, (index, _)) in thermometers.iter_mut().zip(all) {
            *place = Some(index);
        }
        Self { gyros, accelerometers, thermometers }
    }

    /// Puts the readings of a row into a step's input.
    pub(super) fn read(&self, recording: &Recording, row: usize, input: &mut StepInput) {
        let sensor = |index: Option<usize>| {
            let series = index.and_then(|index| recording.sensors.get(index));
            reading(series.map(|it| it.values.as_slice()), row)
        };
        input.gyros = self.gyros.map(sensor);
        input.accelerometers = self.accelerometers.map(sensor);
        input.thermometers = self.thermometers.map(|index| {
            let series = index.and_then(|index| recording.auxiliaries.get(index));
            single(reading(series.map(|it| it.values.as_slice()), row))
        });
    }

    /// Ids of the inertial sensors with their inputs.
    pub(super) fn corrected(&self, recording: &Recording) -> Vec<(String, Place)> {
        let named = |index: Option<usize>, place: Place| {
            let series = recording.sensors.get(index?)?;
            Some((series.sensor.id.clone(), place))
        };
        let gyros = self.gyros.iter().enumerate().filter_map(|(k, it)| named(*it, Place::Gyro(k)));
        let forces =
            self.accelerometers.iter().enumerate().filter_map(|(k, it)| named(*it, Place::Accelerometer(k)));
        gyros.chain(forces).collect()
    }

    /// Columns of the thermometers.
    pub(super) fn thermometer_columns(&self, recording: &Recording) -> Vec<String> {
        let column = |index: usize| Some(recording.auxiliaries.get(index)?.auxiliary.column.clone());
        self.thermometers.iter().flatten().filter_map(|index| column(*index)).collect()
    }

    /// Configuration of the thermometers.
    pub(super) fn thermometer_configs(
        &self,
        levels: &[Levels],
    ) -> [Option<TemperatureRateConfig<f32>>; THERMOMETERS] {
        self.thermometers.map(|index| {
            let levels = levels.get(index?)?;
            Some(TemperatureRateConfig::of_quantum(levels.quantum() as f32))
        })
    }
}

/// Whether sensors of a kind are gyros.
pub(super) fn is_gyro(kind: SensorKind) -> bool {
    matches!(kind, SensorKind::Dtg | SensorKind::Fog | SensorKind::Rlg | SensorKind::MemsGyro)
}

/// Whether an auxiliary quantity is the reading of a thermometer.
fn is_thermometer(series: &AuxiliarySeries) -> bool {
    series.auxiliary.quantity == Quantity::Temperature && series.auxiliary.unit == "degC"
}

/// Puts each sensor at the body axis that is nearest to its own; the first one there stays.
fn at_body_axes<'r>(
    sensors: impl Iterator<Item = (usize, &'r SensorSeries)>,
    places: [&mut Option<usize>; 3],
) {
    let sensors: Vec<(usize, &SensorSeries)> = sensors.collect();
    for (axis, place) in places.into_iter().enumerate() {
        let along =
            |series: &SensorSeries| series.sensor.axis.is_some_and(|of| of[axis].abs() > NEAREST_AXIS);
        *place = sensors.iter().find(|(_, series)| along(series)).map(|(index, _)| *index);
    }
}

/// The reading in a row.
pub(super) fn reading(values: Option<&[f64]>, row: usize) -> Reading<f64> {
    let value = values.and_then(|values| values.get(row)).copied().filter(|value| value.is_finite());
    value.map_or_else(Reading::missing, Reading::good)
}

/// The same in single precision.
pub(super) fn single(reading: Reading<f64>) -> Reading<f32> {
    Reading { value: reading.value as f32, age_ms: reading.age_ms, quality: reading.quality }
}

/// The distinct values that a thermometer has shown, to within 10⁻⁶ K.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Levels {
    /// By the multiple of [`DISTINCT`] that they are.
    seen: BTreeMap<i64, f64>,
}

impl Levels {
    /// Adds those of a recording to what its auxiliary quantities have shown; one that is no thermometer has none.
    pub(super) fn add(all: &mut Vec<Self>, recording: &Recording) {
        all.resize_with(recording.auxiliaries.len(), Self::default);
        for (levels, series) in
            all.iter_mut().zip(&recording.auxiliaries).filter(|(_, it)| is_thermometer(it))
        {
            levels.see(&series.values);
        }
    }

    fn see(&mut self, values: &[f64]) {
        for &value in values.iter().filter(|value| value.is_finite()) {
            if self.seen.len() == MOST_LEVELS {
                break;
            }
            self.seen.entry((value / DISTINCT).floor() as i64).or_insert(value);
        }
    }

    /// Quantisation step, degC, of which cases do not speak: the median distance of neighbouring values.
    fn quantum(&self) -> f64 {
        let next = self.seen.values().skip(1);
        let mut steps: Vec<f64> =
            self.seen.values().zip(next).map(|(low, high)| high - low).filter(|d| *d > DISTINCT).collect();
        steps.sort_unstable_by(f64::total_cmp);
        let median = steps.get(steps.len() / 2).copied().unwrap_or(LEAST_QUANTUM);
        median.clamp(LEAST_QUANTUM, GREATEST_QUANTUM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantum(values: &[f64]) -> f64 {
        let mut levels = Levels::default();
        levels.see(values);
        levels.quantum()
    }

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
