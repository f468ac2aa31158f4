//! Noise parameters from the replayed estimates by the published formulas, with the variance put right.
//!
//! A tuned filter's estimate has the autocorrelation of the error itself in *shape*, but its variance is short
//! by the filter's own: E[x̂_{k+j} x̂_k] = e^(−jΔ/τ)(σ² − P). Hence σ̂² = R₀ + P̄ [FIL-13], and without that the
//! loop of identification and retuning collapses.

use super::structure::{
    EXPONENTIAL_FLOOR, Exponential, ExponentialCosine, fit_exponential, fit_exponential_cosine,
};
use crate::filter::Kernel;
use crate::saved::saved;

/// Lags of the autocorrelation, the zeroth included.
pub const LAGS: usize = 256;
/// Lags that one replay collects.
pub const LAGS_PER_PASS: usize = 8;
/// Replays that it takes to collect all.
pub const PASSES: usize = LAGS / LAGS_PER_PASS;

/// Sums for one channel.
#[derive(Clone, Copy, Debug)]
struct Channel {
    /// The newest `LAGS` estimates, by index modulo `LAGS`.
    newest: [f32; LAGS],
    products: [f32; LAGS],
    variance: f32,
}

/// Autocorrelation of the estimates of both channels, collected over [`PASSES`] replays.
#[derive(Clone, Copy, Debug)]
pub struct ReadOut {
    channels: [Channel; 2],
    /// Any number below [`PASSES`], and never looked at beyond that.
    pass: u32,
    first: u32,
    count: u32,
}

/// What the read-out of one channel says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelReadOut {
    /// First-order fit; the variance is that of the estimate, R₀.
    pub exponential: Option<Exponential<f32>>,
    /// Exponential-cosine fit, where the correlation crosses zero.
    ///
    /// The strict choice between the two ([`super::choose_structure`]) is for a directly measured series: the
    /// filter shapes its estimate after the model that it believes in, and a swing that the likelihood sees
    /// clearly is seldom seen there. So the fit only proposes, and the likelihood decides.
    pub cosine: Option<ExponentialCosine<f32>>,
    /// Mean filter variance P̄ over the stretch.
    pub filter_variance: f32,
}

impl ReadOut {
    /// Nothing collected.
    pub const fn new() -> Self {
        let channel = Channel { newest: [0.0; LAGS], products: [0.0; LAGS], variance: 0.0 };
        Self { channels: [channel; 2], pass: 0, first: 0, count: 0 }
    }

    /// Forgets everything.
    #[inline]
    pub fn clear(&mut self) {
        for channel in &mut self.channels {
            channel.newest.fill(0.0);
            channel.products.fill(0.0);
            channel.variance = 0.0;
        }
        (self.pass, self.first, self.count) = (0, 0, 0);
    }

    /// Begins pass number `pass` over estimates from sample `first` on (the filter's start is left out).
    pub fn begin_pass(&mut self, pass: usize, first: u32) {
        self.pass = pass as u32;
        self.first = first;
        self.count = 0;
        let lags = pass * LAGS_PER_PASS..(pass + 1) * LAGS_PER_PASS;
        for channel in &mut self.channels {
            channel.newest.fill(0.0);
            channel.variance = 0.0;
            for product in channel.products.iter_mut().take(lags.end).skip(lags.start) {
                *product = 0.0;
            }
        }
    }

    /// Takes the state after sample `index`, if it `counts`.
    #[inline]
    pub fn take(&mut self, index: u32, state: &impl Kernel<f32>, counts: bool) {
        let counts = counts && index >= self.first;
        let weight = if counts { 1.0 } else { 0.0 };
        self.count = self.count.wrapping_add(u32::from(counts));
        let start = (self.pass as usize % PASSES) * LAGS_PER_PASS;
        let (mean, variances) = (state.mean(), state.variances());
        let estimates = [(mean[2], variances[2]), (mean[3], variances[3])];
        for (channel, (estimate, variance)) in self.channels.iter_mut().zip(estimates) {
            let at = index as usize;
            let estimate = weight * estimate;
            channel.newest[at & (LAGS - 1)] = estimate;
            channel.variance += weight * variance;
            for lag in start..start + LAGS_PER_PASS {
                let earlier = channel.newest[at.wrapping_sub(lag) & (LAGS - 1)];
                channel.products[lag & (LAGS - 1)] += estimate * earlier;
            }
        }
    }

    /// Fits one channel (0 accelerometer, 1 gyro) to what all passes have collected.
    pub fn fit(&self, channel: usize, spacing_s: f32) -> ChannelReadOut {
        let count = self.count.max(LAGS as u32 + 1);
        let sums = &self.channels[channel & 1];
        let mut autocorrelation = sums.products;
        for (lag, r) in (0u32..).zip(&mut autocorrelation) {
            *r /= (count - lag) as f32;
        }
        ChannelReadOut {
            exponential: fit_exponential(&autocorrelation, spacing_s, EXPONENTIAL_FLOOR as f32),
            cosine: fit_exponential_cosine(&autocorrelation, spacing_s),
            filter_variance: sums.variance / count as f32,
        }
    }
}

saved!([] Channel { newest, products, variance });
saved!([] ReadOut { channels, pass, first, count });
