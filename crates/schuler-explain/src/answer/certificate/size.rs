//! How large an effect has to be so that it is found in so many of a hundred records.
use statrs::distribution::{ContinuousCDF, Normal};

use crate::catalogue::Candidate;
use crate::config::Config;
use crate::evidence::amplitude::{ln_gain, ln_plausibility};
use crate::noise::trust::ln_mean;

/// Standard deviations beyond which no effect is sought.
const MOST_SIGMAS: f64 = 1e6;
/// Halvings of an interval of standard deviations.
const HALVED: usize = 40;

/// An effect of unknown size.
pub struct Sought<'s> {
    /// What it is.
    pub candidate: &'s Candidate,
    /// Logarithm of the prior odds, less what its other parameters cost.
    pub ln_prior: f64,
    /// Number of its amplitudes that are free.
    pub free: usize,
    /// Standard deviation of the one that is bounded, whatever the others are.
    pub sigma: f64,
    /// All of them, of which that one is 1.
    pub direction: &'s [f64],
}

/// Where an effect is told, and how sure that has to be.
pub struct Threshold<'c> {
    config: &'c Config,
    /// Standard deviations by which a normal variable lies below its mean in the records in which it may be missed.
    margin: f64,
}

impl<'c> Threshold<'c> {
    /// That of a configuration.
    pub fn new(config: &'c Config) -> Self {
        // Mean 0 and standard deviation 1 are in range.
        let margin = Normal::new(0.0, 1.0).map_or(f64::INFINITY, |it| it.inverse_cdf(config.found_at));
        Self { config, margin }
    }

    /// The size of the amplitude that is bounded, in SI units; `products` are those of a shape with itself at all places where it may
    /// be, each with the information there. None where no size is told.
    ///
    /// The root of the squares of k amplitudes is nearly normal, of unit variance, about the root of k − 1 more than what they are of.
    pub fn size(&self, sought: &Sought<'_>, products: &[[f64; 2]]) -> Option<f64> {
        let least = self.least_sigmas(|sigmas| self.ln_odds(sought, products, sigmas))?;
        let squares = (least + self.margin).powi(2) - (sought.free.max(1) - 1) as f64;
        Some(squares.max(0.0).sqrt() * sought.sigma)
    }

    /// Root of the information of what is there or not, from which on it is told.
    pub fn root_of_fixed(&self, ln_prior: f64) -> f64 {
        let nats = (self.config.least_ln_odds() - ln_prior).max(0.0);
        self.margin + (self.margin.powi(2) + 2.0 * nats).sqrt()
    }

    /// The same of an effect that is proportional to the one parameter which is fitted.
    pub fn root_of_fitted(&self, ln_prior: f64) -> f64 {
        self.margin + (2.0 * (self.config.least_ln_odds() - ln_prior).max(0.0)).sqrt()
    }

    /// Logarithm of the odds of an effect that is so many standard deviations large.
    fn ln_odds(&self, sought: &Sought<'_>, products: &[[f64; 2]], sigmas: f64) -> f64 {
        let amplitude = sigmas * sought.sigma;
        let values: Vec<f64> = sought.direction.iter().map(|part| part * amplitude).collect();
        let gain = if products.is_empty() {
            ln_gain(sigmas * sigmas, sought.free, self.config)
        } else {
            let gain_at = |&[product, information]: &[f64; 2]| {
                if information > 0.0 {
                    ln_gain((amplitude * product).powi(2) / information, sought.free, self.config)
                } else {
                    f64::NEG_INFINITY
                }
            };
            ln_mean(products.iter().map(gain_at))
        };
        gain + ln_plausibility(sought.candidate.amplitudes.iter(), &values, self.config) + sought.ln_prior
    }

    /// Standard deviations from which on the odds are those at which a finding is told.
    fn least_sigmas(&self, ln_odds: impl Fn(f64) -> f64) -> Option<f64> {
        let told = self.config.least_ln_odds();
        let mut high = 1.0;
        while ln_odds(high) < told {
            high *= 2.0;
            if high > MOST_SIGMAS {
                return None;
            }
        }
        let mut low = 0.0;
        for _ in 0..HALVED {
            let middle = 0.5 * (low + high);
            *(if ln_odds(middle) < told { &mut low } else { &mut high }) = middle;
        }
        Some(high)
    }
}
