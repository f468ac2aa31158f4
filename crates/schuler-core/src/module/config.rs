//! What the module is told before the flight.
use serde::{Deserialize, Serialize};

use super::trust::RadioUse;
use super::{HEALTH_LEVELS, THERMOMETERS};
use crate::config::{ConfigError, Problem};
use crate::filter::{FilterConfig, MarkovNoise, positive};
use crate::health::HealthConfig;
use crate::identification::IdentificationConfig;
use crate::isolation::{FaultIsolation, IsolationConfig};
use crate::saved::{Saved, Visitor, saved};
use crate::thermal::TemperatureRateConfig;

/// Everything that the module can be told before the flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModuleConfig {
    /// Error filter.
    pub filter: FilterConfig<f32>,
    /// Noise identification.
    pub identification: IdentificationConfig,
    /// Gyro block.
    pub isolation: IsolationConfig,
    /// Thermometers; one without configuration is off.
    pub thermometers: [Option<TemperatureRateConfig<f32>>; THERMOMETERS],
    /// Health monitor; off without configuration.
    pub health: Option<HealthConfig<f32, HEALTH_LEVELS>>,
    /// What the health monitor's verdict does to the filter's measurement; without, or without a monitor, nothing.
    pub radio_use: Option<RadioUse>,
    /// Readings older than this are not used, milliseconds. The health monitor has its own limit.
    pub max_age_ms: u32,
    /// Velocity errors beyond this are saturated or nonsense and are not used, m/s.
    pub velocity_range: f32,
}

impl Default for ModuleConfig {
    fn default() -> Self {
        Self {
            filter: FilterConfig {
                radius_m: 6_371_000.0,
                gravity: 9.80665,
                step_s: 1.0,
                accelerometer: MarkovNoise { sigma: 9.80665e-4, tau_s: 60.0 },
                gyro: MarkovNoise { sigma: 4.84814e-7, tau_s: 1800.0 },
                velocity_noise: 0.1,
                initial_velocity_sigma: 0.1,
                initial_vertical_sigma: 1e-4,
                gate_sigma: 6.0,
            },
            identification: IdentificationConfig::default(),
            isolation: IsolationConfig::CONE,
            thermometers: [None; THERMOMETERS],
            health: None,
            radio_use: None,
            max_age_ms: 1500,
            velocity_range: 1000.0,
        }
    }
}

impl ModuleConfig {
    /// Tells one configuration from another.
    pub(super) fn fingerprint(mut self) -> u32 {
        let Self {
            filter,
            identification,
            isolation,
            thermometers,
            health,
            radio_use,
            max_age_ms,
            velocity_range,
        } = &mut self;
        let mut sum = Visitor::sum();
        filter.visit(&mut sum);
        identification.visit(&mut sum);
        isolation.visit(&mut sum);
        thermometers.visit(&mut sum);
        health.visit(&mut sum);
        radio_use.visit(&mut sum);
        max_age_ms.visit(&mut sum);
        velocity_range.visit(&mut sum);
        sum.checksum().value()
    }

    /// Whether a module can be built from this.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    #[inline(never)] // What it needs of the stack is free again when the module is built.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.filter.validate()?;
        self.identification.validate()?;
        FaultIsolation::try_build(&self.isolation)?;
        for thermometer in self.thermometers.iter().flatten() {
            thermometer.validate()?;
        }
        if let Some(health) = &self.health {
            health.validate()?;
            // There is one step for all parts.
            if health.step_s != self.filter.step_s {
                return Err(ConfigError::new("health.step_s", Problem::OutOfRange));
            }
        }
        if let Some(radio_use) = &self.radio_use {
            radio_use.validate()?;
        }
        positive("velocity_range", self.velocity_range)
    }
}

/// What a step needs of the configuration beside the parts that were built from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepConfig {
    pub(super) filter: FilterConfig<f32>,
    pub(super) identification: IdentificationConfig,
    /// The health monitor listens.
    pub(super) monitored: bool,
    /// What its verdict does, if anything.
    pub(super) radio_use: Option<RadioUse>,
    pub(super) max_age_ms: u32,
    pub(super) velocity_range: f32,
}

impl From<&ModuleConfig> for StepConfig {
    fn from(config: &ModuleConfig) -> Self {
        Self {
            filter: config.filter,
            identification: config.identification,
            monitored: config.health.is_some(),
            radio_use: config.radio_use.filter(|_| config.health.is_some()),
            max_age_ms: config.max_age_ms,
            velocity_range: config.velocity_range,
        }
    }
}

saved!([] StepConfig { filter, identification, monitored, radio_use, max_age_ms, velocity_range });
