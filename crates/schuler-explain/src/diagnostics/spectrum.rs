//! Spectra of series with holes, averaged over bands of equal width on a logarithmic scale.
//!
//! One periodogram of the whole record, so that no low frequency is lost, then the mean over each band: where m
//! frequencies fall into it, white noise gives χ² with 2m degrees of freedom. Holes are zeros, and the power is that of
//! what is there; for white noise this is exact.
use schuler_fourier::Forward;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::mean;

/// Bands in a decade.
const PER_DECADE: f64 = 20.0;
/// Fewer values than this have no spectrum.
const LEAST: usize = 8;
/// Probability below and above the band that holds white noise 95 % of the time.
const TAIL: f64 = 0.025;

/// Spectrum of standardised innovations: 1 where they are white with variance one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Whiteness {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// Power over that of white noise of variance one.
    pub power: Vec<f64>,
    /// Lower bound of what holds white noise 95 % of the time.
    pub low: Vec<f64>,
    /// Upper bound.
    pub high: Vec<f64>,
}

impl Whiteness {
    /// The share of bands outside of the bounds; 0.05 is expected of white noise, NaN without any band.
    pub fn outside(&self) -> f64 {
        let bounds = self.low.iter().zip(&self.high);
        let outside = self.power.iter().zip(bounds).filter(|(p, (l, h))| !(*l..=*h).contains(p)).count();
        outside as f64 / self.power.len() as f64
    }
}

/// One-sided spectral density.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Density {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// Square root of the density, unit of the series per √Hz.
    pub amplitude: Vec<f64>,
}

/// The spectrum of standardised innovations (NaN = missing). Never panics.
pub fn whiteness(values: &[f64], step_s: f64) -> Whiteness {
    let mut found = Whiteness::default();
    for band in bands(values, step_s, 0.0, |_| 1.0) {
        let freedom = 2.0 * band.count as f64;
        let Ok(distribution) = ChiSquared::new(freedom) else { continue };
        found.frequency_hz.push(band.frequency_hz);
        found.power.push(band.power);
        found.low.push(distribution.inverse_cdf(TAIL) / freedom);
        found.high.push(distribution.inverse_cdf(1.0 - TAIL) / freedom);
    }
    found
}

/// The spectral density of `values` (NaN = missing) about their mean, with Hann's window against leakage. Never panics.
pub fn density(values: &[f64], step_s: f64) -> Density {
    let hann = |part: f64| (std::f64::consts::PI * part).sin().powi(2);
    let mut found = Density::default();
    for band in bands(values, step_s, mean(values), hann) {
        found.frequency_hz.push(band.frequency_hz);
        found.amplitude.push((2.0 * step_s * band.power).sqrt());
    }
    found
}

/// Mean of the periodogram over some neighbouring frequencies.
struct Band {
    frequency_hz: f64,
    /// Two-sided, per sample: the variance for white noise.
    power: f64,
    count: usize,
}

/// `window` takes the place in the record, 0 … 1.
fn bands(values: &[f64], step_s: f64, mean: f64, window: impl Fn(f64) -> f64) -> Vec<Band> {
    let length = values.len();
    if super::present(values).count() < LEAST {
        return Vec::new();
    }
    let mut weight = 0.0;
    let windowed = values.iter().enumerate().map(|(k, value)| {
        if !value.is_finite() {
            return 0.0;
        }
        let factor = window((k as f64 + 0.5) / length as f64);
        weight += factor * factor;
        factor * (value - mean)
    });
    let spectrum = Forward::new(length).transform(windowed);
    let resolution = 1.0 / (length as f64 * step_s);
    // Without the mean, and without the highest frequency of an even length, which has one degree of freedom.
    let powers: Vec<(usize, f64)> = (spectrum.iter().enumerate().skip(1))
        .take_while(|(k, _)| 2 * k < length)
        .map(|(k, bin)| (k, bin.norm_sqr() / weight))
        .collect();
    let band_of = |k: usize| ((k as f64).log10() * PER_DECADE).floor() as usize;
    powers
        .chunk_by(|(a, _), (b, _)| band_of(*a) == band_of(*b))
        .map(|chunk| {
            let count = chunk.len();
            let mean = |of: &dyn Fn(&(usize, f64)) -> f64| chunk.iter().map(of).sum::<f64>() / count as f64;
            Band { frequency_hz: mean(&|(k, _)| *k as f64) * resolution, power: mean(&|(_, p)| *p), count }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::dependence::tests::{markov, white};

    #[test]
    fn white_noise_is_flat_within_its_bounds_also_with_holes() {
        let (mut outside, mut level, mut bands) = (0.0, 0.0, 0.0);
        for seed in 0..20 {
            let mut values = white(20_000, seed);
            values[5000..7000].fill(f64::NAN);
            let found = whiteness(&values, 1.0);
            outside += found.outside() / 20.0;
            level += found.power.last().unwrap() / 20.0;
            bands = found.power.len() as f64;
        }
        assert!((outside - 0.05).abs() < 3.0 * (0.05 * 0.95 / (20.0 * bands)).sqrt(), "{outside}");
        assert!((level - 1.0).abs() < 0.02, "{level}");
        assert!(whiteness(&markov(20_000, 50.0, 1), 1.0).outside() > 0.5);
    }

    #[test]
    fn the_density_is_that_of_the_closed_form() {
        // S(f) = 4 σ² τ / (1 + (2π f τ)²), one-sided; σ = 1. The mean of 30 runs is within 3 σ = 3/√(30 m) of it, where
        // m is the least number of independent frequencies in a band, 3 here.
        let (tau_s, runs) = (200.0, 30);
        let all: Vec<Density> = (0..runs).map(|seed| density(&markov(100_000, tau_s, seed), 1.0)).collect();
        for (band, frequency) in all[0].frequency_hz.iter().enumerate() {
            if (4e-4..0.02).contains(frequency) {
                let power = all.iter().map(|found| found.amplitude[band].powi(2)).sum::<f64>() / runs as f64;
                let expected = 4.0 * tau_s / (1.0 + (std::f64::consts::TAU * frequency * tau_s).powi(2));
                assert!((power / expected - 1.0).abs() < 0.32, "{frequency}: {power} {expected}");
            }
        }
    }

    #[test]
    fn a_line_holds_its_power() {
        let (step_s, frequency, amplitude) = (0.5, 0.05, 3.0);
        let values: Vec<f64> = (0..20_000)
            .map(|k| amplitude * (std::f64::consts::TAU * frequency * k as f64 * step_s).sin())
            .collect();
        let found = density(&values, step_s);
        let widths = found.frequency_hz.windows(2).map(|f| f[1] - f[0]);
        let power: f64 = widths.zip(&found.amplitude).map(|(width, a)| a * a * width).sum();
        assert!((power / (amplitude * amplitude / 2.0) - 1.0).abs() < 0.15, "{power}");
    }
}
