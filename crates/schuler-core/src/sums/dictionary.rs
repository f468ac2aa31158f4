//! The series that the module knows, step by step.
use super::SERIES;
use super::config::{Series, SumsConfig};
use crate::saved::saved;

/// What of the step's readings is a series; what is silent stays as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Heard {
    /// Temperature, degC.
    pub temperature: Option<f32>,
    /// Its rate, K/s.
    pub rate: Option<f32>,
    /// Specific force, m/s².
    pub force: Option<f32>,
}

/// The series as of the last step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dictionary {
    /// Nominal steps since the start.
    steps: u32,
    temperature: SinceFirst,
    rate: f32,
    /// Temperature behind the two lags.
    lagging: [f32; 2],
    force: SinceFirst,
}

/// A reading less the first one, which keeps products small: what a constant adds to it is a constant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SinceFirst {
    first: Option<f32>,
    value: f32,
}

impl SinceFirst {
    const SILENT: Self = Self { first: None, value: 0.0 };

    fn hear(&mut self, reading: Option<f32>) {
        if let Some(reading) = reading.filter(|reading| reading.is_finite()) {
            self.value = reading - *self.first.get_or_insert(reading);
        }
    }
}

impl Dictionary {
    pub(super) const START: Self = Self {
        steps: 0,
        temperature: SinceFirst::SILENT,
        rate: 0.0,
        lagging: [0.0; 2],
        force: SinceFirst::SILENT,
    };

    /// One step that is `elapsed` nominal ones of `step_s` seconds after the last.
    pub(super) fn step(&mut self, config: &SumsConfig, step_s: f32, elapsed: u32, heard: &Heard) {
        self.steps = self.steps.saturating_add(elapsed);
        self.temperature.hear(heard.temperature);
        self.force.hear(heard.force);
        self.rate = heard.rate.filter(|rate| rate.is_finite()).unwrap_or(self.rate);
        let duration_s = elapsed as f32 * step_s;
        for (lagging, lag_s) in self.lagging.iter_mut().zip(config.lags_s) {
            *lagging += (self.temperature.value - *lagging) * -libm::expm1f(-duration_s / lag_s);
        }
    }

    /// All of them, in the order of [`Series::ALL`].
    pub(super) fn all(&self, step_s: f32) -> [f32; SERIES] {
        Series::ALL.map(|series| self.value(series, step_s))
    }

    /// One of them.
    pub(super) fn value(&self, series: Series, step_s: f32) -> f32 {
        let [fast, slow] = self.lagging;
        match series {
            Series::Constant => 1.0,
            Series::Time => self.steps as f32 * step_s,
            Series::Temperature => self.temperature.value,
            Series::TemperatureRate => self.rate,
            Series::FastLag => fast,
            Series::SlowLag => slow,
            Series::Force => self.force.value,
            Series::ForceSquared => self.force.value * self.force.value,
        }
    }
}

saved!([] SinceFirst { first, value });
saved!([] Dictionary { steps, temperature, rate, lagging, force });
