//! A thermometer: range, rate and readings that were not used.
use schuler_core::thermal::{TemperatureRateOutput, ThermalStatus};
use serde::Serialize;

/// A thermometer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThermometerSummary {
    /// Its column.
    pub column: String,
    /// Quantum that was flown, degC.
    pub quantum: f64,
    /// Share of the steps whose reading was used.
    pub used_share: f64,
    /// Share of the steps whose rate came from the filter of all readings, for the noise spans levels.
    pub dither_share: f64,
    /// Times it started anew.
    pub restarts: usize,
    /// Time from which the rate is settled, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_s: Option<f64>,
    /// Least and greatest temperature, degC.
    pub temperature: [f64; 2],
    /// Least and greatest settled rate, degC/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<[f64; 2]>,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ThermometerSums {
    rejected: usize,
    dither: usize,
    restarts: usize,
    settled_s: Option<f64>,
    temperature: Option<[f64; 2]>,
    rate: Option<[f64; 2]>,
}

impl ThermometerSums {
    pub(super) fn add(&mut self, time_s: f64, output: &TemperatureRateOutput<f32>) {
        let is = |flag: ThermalStatus| usize::from(output.status.contains(flag));
        self.rejected += is(ThermalStatus::REJECTED);
        self.dither += is(ThermalStatus::DITHER);
        self.restarts += is(ThermalStatus::RESTARTED);
        let widen = |ends: &mut Option<[f64; 2]>, value: f32| {
            let value = f64::from(value);
            let [low, high] = ends.unwrap_or([value; 2]);
            *ends = Some([low.min(value), high.max(value)]);
        };
        if !output.status.contains(ThermalStatus::NO_READING) {
            widen(&mut self.temperature, output.temperature);
            if !output.status.contains(ThermalStatus::SETTLING) {
                widen(&mut self.rate, output.rate);
                self.settled_s.get_or_insert(time_s);
            }
        }
    }

    pub(super) fn finish(self, column: &str, quantum: f64, steps: usize) -> ThermometerSummary {
        let share = |count: usize| count as f64 / steps.max(1) as f64;
        ThermometerSummary {
            column: column.to_owned(),
            quantum,
            used_share: 1.0 - share(self.rejected),
            dither_share: share(self.dither),
            restarts: self.restarts,
            settled_s: self.settled_s,
            temperature: self.temperature.unwrap_or([f64::NAN; 2]),
            rate: self.rate,
        }
    }
}
