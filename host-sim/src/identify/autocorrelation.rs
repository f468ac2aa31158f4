//! Autocorrelation of a series with gaps, for all lags at once.
//!
//! R_j = (1/n_j) Σ (x_i − m)(x_{i−j} − m) over the n_j pairs in which both values are there [FIL-11]: the unbiased
//! estimator, 1/(N − j) where nothing is missing.
use schuler_explain::numeric::statistics::{lagged_pairs, lagged_products};

use super::series::about_mean;

/// R_0 … R_J in the square of the unit of the series.
#[derive(Clone, Debug, PartialEq)]
pub struct Autocorrelation {
    /// R_j.
    pub values: Vec<f64>,
    /// Pairs n_j behind each.
    pub pairs: Vec<usize>,
}

/// What is taken for the mean m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Centre {
    /// Zero: the series has no offset.
    Zero,
    /// The sample mean.
    Mean,
}

/// The autocorrelation of `values` (NaN = missing) for lags 0 … `last_lag`, fewer if the series is shorter.
///
/// A lag without a pair has R_j = NaN.
pub fn autocorrelation(values: &[f64], last_lag: usize, centre: Centre) -> Autocorrelation {
    let lags = (last_lag + 1).min(values.len());
    if lags == 0 {
        return Autocorrelation { values: Vec::new(), pairs: Vec::new() };
    }
    let centred = match centre {
        Centre::Zero => values.to_vec(),
        Centre::Mean => about_mean(values).1,
    };
    let (sums, pairs) = (lagged_products(&centred, lags - 1), lagged_pairs(values, lags - 1));
    let mean_product = |(sum, &pairs): (f64, &usize)| if pairs > 0 { sum / pairs as f64 } else { f64::NAN };
    Autocorrelation { values: sums.into_iter().zip(&pairs).map(mean_product).collect(), pairs }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::series::mean;

    fn directly(values: &[f64], lag: usize, offset: f64) -> (f64, usize) {
        let products: Vec<f64> = values
            .iter()
            .skip(lag)
            .zip(values)
            .map(|(a, b)| (a - offset) * (b - offset))
            .filter(|product| product.is_finite())
            .collect();
        (products.iter().sum::<f64>() / products.len() as f64, products.len())
    }

    #[test]
    fn fil_11_equals_the_direct_sum_over_the_pairs_that_are_there() {
        let mut values: Vec<f64> =
            (0..1000).map(|i| (f64::from(i) * 0.37).sin() + 5.0 + f64::from(i % 7)).collect();
        for missing in [0, 17, 18, 19, 500, 999] {
            values[missing] = f64::NAN;
        }
        for (centre, offset) in [(Centre::Zero, 0.0), (Centre::Mean, mean(&values))] {
            let found = autocorrelation(&values, 400, centre);
            assert_eq!(found.values.len(), 401);
            for lag in 0..=400 {
                let (expected, pairs) = directly(&values, lag, offset);
                assert_eq!(found.pairs[lag], pairs);
                assert!((found.values[lag] - expected).abs() < 1e-13 * found.values[0], "lag {lag}");
            }
        }
    }

    #[test]
    fn short_series_have_fewer_lags() {
        assert_eq!(autocorrelation(&[1.0, 2.0], 10, Centre::Zero).values.len(), 2);
        assert!(autocorrelation(&[], 10, Centre::Mean).values.is_empty());
        assert!(autocorrelation(&[f64::NAN], 10, Centre::Mean).values[0].is_nan());
    }
}
