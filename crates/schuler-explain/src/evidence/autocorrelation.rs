//! Autocorrelation of standardised innovations, with the band in which white noise would lie.
//!
//! r_j = R_j/R_0 about zero, R_j the mean over the pairs that are there; by the fast Fourier transform of the series and
//! of the mask of what is there. White noise lies within ±1.96/√n_j 95 % of the time (Box & Jenkins, Bartlett's formula).
use realfft::RealFftPlanner;

/// Two-sided 95 % of the normal distribution.
const TWO_SIDED_95: f64 = 1.959_963_984_540_054;
/// The longest lag is this part of the recording,
const LONGEST_PART: usize = 10;
/// but at most this many steps: what innovations still have in common, they have over short lags.
const LONGEST: usize = 600;

/// Autocorrelation for lags from one step on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Autocorrelation {
    /// Lags, s.
    pub lag_s: Vec<f64>,
    /// r_j; NaN without a pair.
    pub correlation: Vec<f64>,
    /// Half width of the band that holds white noise 95 % of the time.
    pub band: Vec<f64>,
}

impl Autocorrelation {
    /// The share of lags outside of the band; 0.05 is expected of white noise, NaN without any lag.
    pub fn outside(&self) -> f64 {
        let known = self.correlation.iter().zip(&self.band).filter(|(r, _)| r.is_finite());
        let (outside, all) =
            known.fold((0.0, 0.0), |(o, n), (r, b)| (o + f64::from(u8::from(r.abs() > *b)), n + 1.0));
        outside / all
    }
}

/// Lags to be shown of a recording of so many rows.
pub(super) fn lags(rows: usize) -> usize {
    (rows / LONGEST_PART).min(LONGEST)
}

/// The autocorrelation of `values` (NaN = missing) for lags of 1 … `lags` steps. Never panics.
pub fn autocorrelation(values: &[f64], step_s: f64, lags: usize) -> Autocorrelation {
    let lags = lags.min(values.len().saturating_sub(1));
    if lags == 0 {
        return Autocorrelation::default();
    }
    let or_zero = |value: &f64| if value.is_finite() { *value } else { 0.0 };
    let products = lagged_products(values.iter().map(or_zero), values.len(), lags);
    let mask = values.iter().map(|value| f64::from(u8::from(value.is_finite())));
    let pairs = lagged_products(mask, values.len(), lags);
    let variance = match (products.first(), pairs.first()) {
        (Some(sum), Some(count)) => sum / count,
        _ => f64::NAN,
    };
    let mut found = Autocorrelation::default();
    for (lag, (sum, count)) in products.iter().zip(&pairs).enumerate().skip(1) {
        let count = count.round();
        let there = count >= 1.0;
        found.lag_s.push(lag as f64 * step_s);
        found.correlation.push(if there { sum / count / variance } else { f64::NAN });
        found.band.push(if there { TWO_SIDED_95 / count.sqrt() } else { f64::NAN });
    }
    found
}

/// Σ x_i x_{i−j} for j = 0 … `lags`.
fn lagged_products(values: impl Iterator<Item = f64>, count: usize, lags: usize) -> Vec<f64> {
    let length = (count + lags + 1).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let mut signal = forward.make_input_vec();
    for (slot, value) in signal.iter_mut().zip(values) {
        *slot = value;
    }
    let mut spectrum = forward.make_output_vec();
    // The transforms fail only for buffers of another length than they have made themselves.
    if forward.process(&mut signal, &mut spectrum).is_err() {
        return Vec::new();
    }
    for bin in &mut spectrum {
        *bin = bin.norm_sqr().into();
    }
    if inverse.process(&mut spectrum, &mut signal).is_err() {
        return Vec::new();
    }
    signal.iter().take(lags + 1).map(|sum| sum / length as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::dependence::tests::{markov, white};

    #[test]
    fn it_is_the_sum_over_the_pairs_that_are_there() {
        let mut values = white(200, 3);
        values[20..50].fill(f64::NAN);
        let found = autocorrelation(&values, 0.5, 40);
        let mean_product = |lag: usize| {
            let pairs: Vec<f64> =
                (lag..200).map(|k| values[k] * values[k - lag]).filter(|p| p.is_finite()).collect();
            (pairs.iter().sum::<f64>() / pairs.len() as f64, pairs.len())
        };
        for lag in 1..=40 {
            let (expected, pairs) = mean_product(lag);
            assert!((found.correlation[lag - 1] - expected / mean_product(0).0).abs() < 1e-12);
            assert!((found.band[lag - 1] - 1.959_963_984_540_054 / (pairs as f64).sqrt()).abs() < 1e-12);
        }
        assert_eq!(found.lag_s[1], 1.0);
    }

    #[test]
    fn white_noise_lies_in_the_band_and_coloured_noise_does_not() {
        let white = autocorrelation(&white(50_000, 4), 1.0, 2000).outside();
        assert!((0.03..0.07).contains(&white), "{white}");
        let coloured = autocorrelation(&markov(50_000, 100.0, 4), 1.0, 300);
        assert!(coloured.outside() > 0.5);
        // exp(−50/100)
        assert!((coloured.correlation[49] - 0.607).abs() < 0.05, "{}", coloured.correlation[49]);
    }
}
