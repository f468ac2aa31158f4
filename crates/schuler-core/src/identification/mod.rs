//! Identification of the noise of each sensor, and the retuning of the filter with what was found.
//!
//! A filter whose noise coefficients are off by ten diverges. Two ways of finding them fly: [`PublishedLoop`]
//! (level A) as the paper has it, for comparison, and [`LikelihoodIdentifier`] (level B), the default. Both rest
//! on the same formulas for an autocorrelation: [`fit_exponential`] and [`fit_exponential_cosine`].
//!
//! Source: the paper on noise identification, equations (10)–(21).
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, Problem};
use crate::filter::{ColouredNoise, positive};

mod autocorrelation;
mod bank;
mod likelihood;
mod published;
mod read_out;
mod replay;
mod simplex;
mod structure;
mod window;

use crate::saved::{saved, saved_choice};
pub use autocorrelation::SlidingAutocorrelation;
pub use bank::{ChannelNoise, FilterBank, Mixture};
pub use likelihood::{LikelihoodIdentifier, Retuned};
pub use published::PublishedLoop;
pub use replay::{ColouredChannels, Hypothesis};
pub use structure::{
    Comparison, EXPONENTIAL_FLOOR, Exponential, ExponentialCosine, Structure, choose_structure, compare,
    fit_exponential, fit_exponential_cosine, removed_mean_bias,
};

/// How the identifier works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationConfig {
    /// Which one flies.
    pub method: Method,
    /// Time from the start to the first identification, s.
    pub first_s: f32,
    /// Time between identifications, s.
    pub interval_s: f32,
    /// How far a parameter may lie from its data-sheet value, as a factor either way.
    pub limit_factor: f32,
    /// 1-σ width of the prior about the data sheet, in the natural logarithm of each parameter.
    pub prior_width: f32,
}

/// Which identification retunes the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// None: the data sheet is flown.
    Off,
    /// The published loop of correlation and retuning, for comparison. It does not converge.
    Published,
    /// The maximum of the likelihood with the published read-out.
    #[default]
    Likelihood,
}

impl Default for IdentificationConfig {
    fn default() -> Self {
        Self {
            method: Method::Likelihood,
            first_s: 9_600.0,
            interval_s: 5_400.0,
            limit_factor: 1000.0,
            prior_width: 2.3,
        }
    }
}

impl IdentificationConfig {
    /// Whether an identifier can be built from this.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("identification.first_s", self.first_s)?;
        positive("identification.interval_s", self.interval_s)?;
        positive("identification.limit_factor", self.limit_factor)?;
        positive("identification.prior_width", self.prior_width)?;
        if self.limit_factor < 1.0 {
            return Err(ConfigError::new("identification.limit_factor", Problem::OutOfRange));
        }
        Ok(())
    }
}

/// How well the noise parameters of one channel are known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ChannelStatus {
    /// Not identified yet: the data sheet is flown.
    #[default]
    DataSheet,
    /// Three times the correlation time, and a third of it, are both clearly worse.
    Determined,
    /// Only one of the two is.
    Weak,
    /// Neither is: the prior has decided.
    Indeterminate,
    /// The filter's estimate holds next to nothing of this error; its parameters were left as they were.
    Unobserved,
}

/// The noise in use for one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NoiseEstimate {
    /// Structure and parameters: σ in the sensor's unit, α in 1/s, β in rad/s (zero for a first-order process).
    pub noise: ColouredNoise<f32>,
    /// How well the parameters are known.
    pub status: ChannelStatus,
}

/// Where the averaged estimate comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum EstimateSource {
    /// The filter, with the noise parameters in use: there is no bank, or it has nothing to say (yet), or an exponential-cosine
    /// is flown.
    #[default]
    Filter,
    /// The wide bank, over everything that the data sheet allows.
    WideBank,
    /// The narrow bank around the parameters that were identified.
    NarrowBank,
}

/// The estimate averaged over what is not known of the noise parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AveragedEstimate {
    /// Mean of [ΔV, δ, a, ω]: m/s, rad, m/s², rad/s.
    pub estimate: [f32; 4],
    /// Standard deviations, the uncertainty of the noise parameters included where a bank is the source. Never zero.
    pub sigma: [f32; 4],
    /// Where both come from.
    pub source: EstimateSource,
}

impl AveragedEstimate {
    /// Every estimate is finite, every standard deviation finite and positive.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = self.estimate.iter().all(|x| x.is_finite());
        finite && self.sigma.iter().all(|&sigma| sigma.is_finite() && sigma > 0.0)
    }
}

/// What the identifier says each step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IdentificationOutput {
    /// The estimate to navigate by.
    pub averaged: AveragedEstimate,
    /// Accelerometer noise in use, m/s².
    pub accelerometer: NoiseEstimate,
    /// Gyro noise in use, rad/s.
    pub gyro: NoiseEstimate,
    /// How often the filter has been retuned.
    pub retunes: u16,
}

pub(crate) fn steps_in(duration_s: f32, step_s: f32) -> u64 {
    libm::ceilf(duration_s / step_s) as u64
}

saved!([] IdentificationConfig { method, first_s, interval_s, limit_factor, prior_width });
saved_choice!(Method { Off, Published, Likelihood });
saved_choice!(ChannelStatus { DataSheet, Determined, Weak, Indeterminate, Unobserved });
