//! Autocorrelation of standardised innovations, with the band in which white noise would lie.
//!
//! r_j = R_j/R_0 about zero, R_j the mean over the pairs that are there. White noise lies within ±1.96/√n_j 95 % of the time (Box & Jenkins, Bartlett's formula).
use crate::numeric::statistics::{lagged_pairs, lagged_products};

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
    let (products, pairs) = (lagged_products(values, lags), lagged_pairs(values, lags));
    let variance = match (products.first(), pairs.first()) {
        (Some(sum), Some(&count)) => sum / count as f64,
        _ => f64::NAN,
    };
    let mut found = Autocorrelation::default();
    for (lag, (sum, &pairs)) in products.iter().zip(&pairs).enumerate().skip(1) {
        let (count, there) = (pairs as f64, pairs > 0);
        found.lag_s.push(lag as f64 * step_s);
        found.correlation.push(if there { sum / count / variance } else { f64::NAN });
        found.band.push(if there { TWO_SIDED_95 / count.sqrt() } else { f64::NAN });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::dependence::tests::{markov, white};

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
