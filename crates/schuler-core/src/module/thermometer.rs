//! One thermometer: temperature, rate, and how long it has been silent.
use crate::config::ConfigError;
use crate::reading::Reading;
use crate::saved::saved;
use crate::thermal::{
    TemperatureRate, TemperatureRateConfig, TemperatureRateOutput, ThermalState, ThermalStatus,
};

/// After a silence as long as that after which the estimator starts anew the rate is not known any more, ms. The
/// temperature is held: nothing better is there.
const RATE_MEMORY_MS: u64 = 300_000;
/// Quantum of a thermometer that is off, degC.
const NO_QUANTUM: f32 = 1.0;

/// One thermometer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thermometer {
    on: bool,
    estimator: TemperatureRate<f32>,
    /// When its last reading was used, on the monotonic clock.
    heard_ms: u64,
}

impl Thermometer {
    /// A thermometer; off without configuration.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub(super) fn try_build(config: Option<&TemperatureRateConfig<f32>>) -> Result<Self, ConfigError> {
        let off = TemperatureRateConfig::of_quantum(NO_QUANTUM);
        let estimator = TemperatureRate::try_build(config.unwrap_or(&off))?;
        Ok(Self { on: config.is_some(), estimator, heard_ms: 0 })
    }

    /// One step at a time of the monotonic clock; what is known of the temperature for the compensation. Not in line: once is
    /// enough in flash.
    #[inline(never)]
    pub(super) fn step(
        &mut self,
        monotonic_ms: u64,
        reading: &Reading<f32>,
    ) -> (TemperatureRateOutput<f32>, ThermalState) {
        let reading = if self.on { *reading } else { Reading::missing() };
        let output = self.estimator.step(monotonic_ms, &reading);
        let heard = !output.status.contains(ThermalStatus::REJECTED);
        self.heard_ms = if heard { monotonic_ms } else { self.heard_ms };
        let recent = monotonic_ms.saturating_sub(self.heard_ms) <= RATE_MEMORY_MS;
        let known = ThermalState::from(&output);
        (output, ThermalState { rate: known.rate.filter(|_| recent), ..known })
    }
}

saved!([] Thermometer { estimator, heard_ms, on });
