//! What a run's innovations say of its filter: mean, chi-square consistency, whiteness.
use std::collections::VecDeque;

use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// A mean of independent numbers and what chance allows it to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MeanTest {
    /// The mean.
    pub mean: f64,
    /// Interval in which it lies in 95 of 100 runs of a consistent filter.
    pub interval: [f64; 2],
    /// How many numbers.
    pub count: usize,
}

/// Mean of so many normalised innovations squared, of which this is the sum, with its 95 % interval: χ² with as many degrees
/// of freedom as there are, over their number.
pub fn nis_mean(sum: f64, count: usize) -> MeanTest {
    if count == 0 {
        return MeanTest { mean: f64::NAN, interval: [f64::NAN; 2], count };
    }
    let interval = ChiSquared::new(count as f64)
        .map_or([f64::NAN; 2], |chi| [0.025, 0.975].map(|p| chi.inverse_cdf(p) / count as f64));
    MeanTest { mean: sum / count as f64, interval, count }
}

/// Ljung and Box's test of whiteness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LjungBox {
    /// The statistic Q.
    pub statistic: f64,
    /// Lags that it sums.
    pub lags: usize,
    /// Probability that a white series has a larger one; NaN for too short a series.
    pub p_value: f64,
}

/// Tests a series for whiteness over this many lags, as [`LagProducts::ljung_box`].
pub fn ljung_box(series: &[f64], lags: usize) -> LjungBox {
    let mut products = LagProducts::new(lags);
    for &value in series {
        products.add(value);
    }
    products.ljung_box()
}

/// Products of a series with itself at each lag, summed as its values come; one that is not finite is missing, and products
/// are formed over what is there.
#[derive(Clone, Debug, PartialEq)]
pub struct LagProducts {
    /// The last values, the newest first.
    recent: VecDeque<f64>,
    /// From lag zero on.
    lags: Vec<LagSums>,
}

/// Sums over the pairs at a lag.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct LagSums {
    products: f64,
    /// Of both values of each pair.
    values: f64,
    pairs: f64,
}

impl LagProducts {
    /// For lags up to this one.
    pub fn new(lags: usize) -> Self {
        Self { recent: VecDeque::with_capacity(lags + 1), lags: vec![LagSums::default(); lags + 1] }
    }

    /// Takes the next value.
    pub fn add(&mut self, value: f64) {
        if self.recent.len() == self.lags.len() {
            self.recent.pop_back();
        }
        self.recent.push_front(value);
        if value.is_finite() {
            let pairs = self.lags.iter_mut().zip(&self.recent).filter(|(_, before)| before.is_finite());
            for (sums, before) in pairs {
                sums.products += value * before;
                sums.values += value + before;
                sums.pairs += 1.0;
            }
        }
    }

    /// Mean product at a lag, about zero; NaN without a pair.
    pub fn mean(&self, lag: usize) -> f64 {
        self.lags.get(lag).map_or(f64::NAN, |sums| sums.products / sums.pairs)
    }

    /// How many values there were.
    pub fn count(&self) -> f64 {
        self.lags.first().map_or(0.0, |sums| sums.pairs)
    }

    /// Tests for whiteness: Q = n(n + 2) Σ r_k²/(n_k), with r_k about the mean and n_k the number of products at lag k.
    pub fn ljung_box(&self) -> LjungBox {
        let lags = self.lags.len() - 1;
        let n = self.count();
        if n < 3.0 * lags.max(1) as f64 {
            return LjungBox { statistic: f64::NAN, lags, p_value: f64::NAN };
        }
        let mean = self.lags[0].values / (2.0 * n);
        // Σ(a − m)(b − m) of a lag.
        let about_mean = |sums: &LagSums| sums.products - mean * sums.values + sums.pairs * mean * mean;
        let power = about_mean(&self.lags[0]);
        let statistic = (self.lags.iter().skip(1).filter(|sums| sums.pairs > 0.0))
            .map(|sums| {
                // For a gapless series this is r_k² n/(n − k)·…, the usual form.
                let r = about_mean(sums) / power;
                r * r * n * (n + 2.0) / sums.pairs
            })
            .sum();
        let p_value = ChiSquared::new(lags as f64).map_or(f64::NAN, |chi| chi.sf(statistic));
        LjungBox { statistic, lags, p_value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::random::Stream;

    #[test]
    fn nis_interval_covers_95_of_100_runs() {
        let mut stream = Stream::new(1, "nis");
        let covered = (0..2000)
            .filter(|_| {
                let nis: Vec<f64> = (0..50).map(|_| stream.normal().powi(2)).collect();
                let test = nis_mean(nis.iter().sum(), nis.len());
                (test.interval[0]..test.interval[1]).contains(&test.mean)
            })
            .count();
        assert!((1860..1940).contains(&covered), "{covered}");
        // Table: χ²(100) at 2.5 % and 97.5 %.
        let test = nis_mean(100.0, 100);
        assert!((test.interval[0] - 0.742_219).abs() < 1e-5 && (test.interval[1] - 1.295_612).abs() < 1e-5);
    }

    #[test]
    fn ljung_box_rejects_a_white_series_as_often_as_it_says_and_a_coloured_one_always() {
        let mut stream = Stream::new(2, "white");
        let rejected = (0..1000)
            .filter(|run| {
                let mut x: Vec<f64> = (0..400).map(|_| stream.normal()).collect();
                if run % 2 == 0 {
                    x[100..130].fill(f64::NAN);
                }
                ljung_box(&x, 20).p_value < 0.05
            })
            .count();
        assert!((30..80).contains(&rejected), "{rejected}");
        let mut x = vec![0.0; 400];
        for k in 1..400 {
            x[k] = 0.5 * x[k - 1] + stream.normal();
        }
        assert!(ljung_box(&x, 20).p_value < 1e-6);
        assert!(ljung_box(&x[..10], 20).p_value.is_nan());
    }

    #[test]
    fn ljung_box_agrees_with_a_published_formula_by_hand() {
        // n = 4, one lag: r₁ = Σ(x_t − m)(x_{t+1} − m)/Σ(x_t − m)², Q = n(n + 2) r₁²/(n − 1).
        let x = [1.0, 2.0, 4.0, 3.0];
        let (m, n) = (2.5, 4.0);
        let r = ((1.0 - m) * (2.0 - m) + (2.0 - m) * (4.0 - m) + (4.0 - m) * (3.0 - m)) / 5.0;
        let expected = n * (n + 2.0) * r * r / (n - 1.0);
        assert!((ljung_box(&x, 1).statistic - expected).abs() < 1e-12);
    }
}
