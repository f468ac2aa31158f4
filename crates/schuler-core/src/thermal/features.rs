//! The functions of temperature in which every sensor coefficient is linear [TMP-11]:
//! `φ = [1, (T − T_ref)/T_s, D/D_s, (g_x, g_y, g_z)/G_s]`, `c(t) = c·φ(t)`.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use super::rate::{TemperatureRateOutput, ThermalStatus};
use crate::config::{ConfigError, Problem};
use crate::number::select;
use crate::saved::saved;

/// Number of features: constant, temperature, rate, three components of the gradient.
pub const FEATURES: usize = 6;
/// How far the laws are extrapolated: in temperature as a part of the range, in rate and gradient as a multiple of the limits.
const TEMPERATURE_MARGIN: f32 = 0.25;
const LIMIT_MARGIN: f32 = 1.5;

/// The value of one coefficient at each feature, in the coefficient's unit.
pub type Coefficient = [f32; FEATURES];

/// What is known of the temperature at the sensors. What is missing counts as its reference and raises a flag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ThermalState {
    /// Temperature, degC.
    pub temperature: Option<f32>,
    /// Rate, degC/s.
    pub rate: Option<f32>,
    /// Spatial gradient in body axes, degC/m.
    pub gradient: Option<[f32; 3]>,
}

impl From<&TemperatureRateOutput<f32>> for ThermalState {
    /// Takes the rate only once the estimator has settled.
    fn from(output: &TemperatureRateOutput<f32>) -> Self {
        let known = !output.status.contains(ThermalStatus::NO_READING);
        let settled = known && !output.status.contains(ThermalStatus::SETTLING);
        Self {
            temperature: Some(output.temperature).filter(|_| known),
            rate: Some(output.rate).filter(|_| settled),
            gradient: None,
        }
    }
}

/// Scales of the features, and the range in which the coefficients were determined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureMap {
    /// `T_ref`, degC.
    pub reference_temperature: f32,
    /// `T_s`, degC.
    pub temperature_scale: f32,
    /// `D_s`, degC/s.
    pub rate_scale: f32,
    /// `G_s`, degC/m.
    pub gradient_scale: f32,
    /// Lowest and highest temperature of the calibration, degC.
    pub temperature_range: [f32; 2],
    /// Largest magnitude of the rate in the calibration, degC/s.
    pub rate_limit: f32,
    /// Largest magnitude of a component of the gradient in the calibration, degC/m.
    pub gradient_limit: f32,
}

impl Default for FeatureMap {
    fn default() -> Self {
        Self {
            reference_temperature: 35.0,
            temperature_scale: 30.0,
            rate_scale: 20.0 / 3600.0,
            gradient_scale: 5.0,
            temperature_range: [-60.0, 85.0],
            rate_limit: 60.0 / 3600.0,
            gradient_limit: 20.0,
        }
    }
}

bitflags! {
    /// What limited a compensation.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct CompensationStatus: u8 {
        /// The temperature is not known: taken as the reference.
        const NO_TEMPERATURE = 1;
        /// The rate is not known or not settled: taken as zero.
        const NO_RATE = 1 << 1;
        /// The gradient is not known: taken as zero.
        const NO_GRADIENT = 1 << 2;
        /// Outside the range of the calibration: the linear laws are extrapolated, by a quarter of the range of
        /// temperature and half of the limits of rate and gradient at most.
        const OUT_OF_RANGE = 1 << 3;
    }
}

impl FeatureMap {
    /// # Errors
    /// The first field that cannot be flown.
    pub fn check(&self) -> Result<(), ConfigError> {
        let [low, high] = self.temperature_range;
        let values = [
            ("thermal.features.reference_temperature", self.reference_temperature),
            ("thermal.features.temperature_scale", self.temperature_scale),
            ("thermal.features.rate_scale", self.rate_scale),
            ("thermal.features.gradient_scale", self.gradient_scale),
            ("thermal.features.temperature_range", low),
            ("thermal.features.temperature_range", high),
            ("thermal.features.rate_limit", self.rate_limit),
            ("thermal.features.gradient_limit", self.gradient_limit),
        ];
        for (field, value) in values {
            if !value.is_finite() {
                return Err(ConfigError::new(field, Problem::NotFinite));
            }
        }
        for (field, value) in [values[1], values[2], values[3]] {
            if value <= 0.0 {
                return Err(ConfigError::new(field, Problem::NotPositive));
            }
        }
        if low > high || low < -100.0 || high > 200.0 {
            return Err(ConfigError::new("thermal.features.temperature_range", Problem::OutOfRange));
        }
        for (field, value) in [values[6], values[7]] {
            if value < 0.0 {
                return Err(ConfigError::new(field, Problem::OutOfRange));
            }
        }
        Ok(())
    }

    /// φ at a thermal state. Never panics.
    pub fn features(&self, state: &ThermalState) -> (Coefficient, CompensationStatus) {
        let mut status = CompensationStatus::empty();
        let finite = |v: &f32| v.is_finite();
        let temperature = state.temperature.filter(finite);
        let temperature_known = temperature.is_some();
        let rate = state.rate.filter(finite);
        let gradient = state.gradient.filter(|g| g.iter().all(finite));
        status.set(CompensationStatus::NO_TEMPERATURE, !temperature_known);
        status.set(CompensationStatus::NO_RATE, rate.is_none());
        status.set(CompensationStatus::NO_GRADIENT, gradient.is_none());

        // Flagged beyond the range of the calibration, kept within the range of the check.
        let mut outside = false;
        let mut within = |known: bool, value: f32, [low, high]: [f32; 2], [least, most]: [f32; 2]| {
            outside |= known & ((value < low) | (value > high));
            value.max(least).min(most)
        };
        let [low, high] = self.temperature_range;
        let margin = TEMPERATURE_MARGIN * (high - low);
        // Where the temperature is not known the range does not matter: the reference may lie outside it.
        let held = within(
            temperature_known,
            temperature.unwrap_or_default(),
            self.temperature_range,
            [low - margin, high + margin],
        );
        let t = select(temperature_known, held, self.reference_temperature);
        let symmetric = |limit: f32| ([-limit, limit], [-limit * LIMIT_MARGIN, limit * LIMIT_MARGIN]);
        let (calibrated, checked) = symmetric(self.rate_limit);
        let d = within(true, rate.unwrap_or_default(), calibrated, checked);
        let (calibrated, checked) = symmetric(self.gradient_limit);
        let g = gradient.unwrap_or_default().map(|g| within(true, g, calibrated, checked));
        status.set(CompensationStatus::OUT_OF_RANGE, outside);
        let [gx, gy, gz] = g.map(|g| g / self.gradient_scale);
        let phi =
            [1.0, (t - self.reference_temperature) / self.temperature_scale, d / self.rate_scale, gx, gy, gz];
        (phi, status)
    }

    /// Largest magnitude of each feature that is ever used.
    pub(super) fn limits(&self) -> Coefficient {
        let [low, high] = self.temperature_range;
        let reach = (high - self.reference_temperature).max(self.reference_temperature - low);
        let t = reach + TEMPERATURE_MARGIN * (high - low);
        let d = LIMIT_MARGIN * self.rate_limit;
        let g = LIMIT_MARGIN * self.gradient_limit / self.gradient_scale;
        [1.0, t / self.temperature_scale, d / self.rate_scale, g, g, g]
    }
}

/// The coefficient's value at φ.
pub(super) fn at(coefficient: &Coefficient, phi: &Coefficient) -> f32 {
    // Written out: this is most of a correction, and the image does not unroll loops as long as this.
    let ([a, b, c, d, e, f], [p, q, r, s, t, u]) = (coefficient, phi);
    0.0 + a * p + b * q + c * r + d * s + e * t + f * u
}

saved!([] FeatureMap {
    reference_temperature,
    temperature_scale,
    rate_scale,
    gradient_scale,
    temperature_range,
    rate_limit,
    gradient_limit,
});
