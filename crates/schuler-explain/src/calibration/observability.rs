//! What a run can determine, and what it cannot and why [TMP-12].
//!
//! The coefficients are observable if and only if the features are linearly independent functions of time in every
//! cycle. The measure is the smallest singular value of the scaled features `φ(t)/√N` over the cycle; the singular
//! vector that belongs to it names the functions that cannot be told apart.
use std::fmt::Write;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::result::Feature;

/// Smallest singular value that suffices, with features scaled as in flight.
pub const SUFFICIENT: f64 = 0.08;

/// Independence of the features in one cycle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ThermalProgramme {
    /// Singular values of the scaled features, largest first.
    pub singular_values: Vec<f64>,
    /// Weights of the combination of scaled features that varies least.
    pub weakest: Vec<(Feature, f64)>,
    /// Whether the smallest singular value suffices.
    pub sufficient: bool,
    /// What the temperature did, where it does not suffice.
    pub words: String,
}

impl ThermalProgramme {
    /// Of the scaled features, one row a second.
    pub(super) fn of(rows: &[Vec<f64>]) -> Self {
        let (n, np) = (rows.len(), rows.first().map_or(0, Vec::len));
        let normal = rows.iter().fold(DMatrix::zeros(np, np), |sum, row| {
            let row = DVector::from_column_slice(row);
            sum + &row * row.transpose() / n as f64
        });
        let eigen = normal.symmetric_eigen();
        let mut order: Vec<usize> = (0..np).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let singular_values: Vec<f64> = order.iter().map(|k| eigen.eigenvalues[*k].max(0.0).sqrt()).collect();
        let vector = eigen.eigenvectors.column(order.last().copied().unwrap_or(0));
        let weakest: Vec<(Feature, f64)> = Feature::ALL.into_iter().zip(vector.iter().copied()).collect();
        let sufficient = singular_values.last().is_some_and(|s| *s >= SUFFICIENT);
        let words = if sufficient { String::new() } else { describe(rows, &weakest) };
        Self { singular_values, weakest, sufficient, words }
    }

    /// The smallest singular value.
    pub fn smallest(&self) -> f64 {
        self.singular_values.last().copied().unwrap_or(0.0)
    }
}

/// What the temperature did.
fn describe(rows: &[Vec<f64>], weakest: &[(Feature, f64)]) -> String {
    let column = |f: usize| rows.iter().map(move |r| r[f]);
    let n = rows.len() as f64;
    let spread = |f: usize| {
        let mean = column(f).sum::<f64>() / n;
        (column(f).map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    if spread(1) < SUFFICIENT {
        return format!(
            "the temperature stayed within {:.1} degC (rms), so nothing that depends on it can be told from a constant",
            spread(1) * Feature::Temperature.scale()
        );
    }
    if rows[0].len() > 2 {
        let rate_scale = Feature::Rate.scale() * 3600.0;
        if spread(2) < SUFFICIENT {
            return format!(
                "the rate stayed within {:.1} degC/h (rms) of {:.1} degC/h, a steady temperature or a linear ramp, so its \
                 effect cannot be told from a constant",
                spread(2) * rate_scale,
                column(2).sum::<f64>() / n * rate_scale
            );
        }
        // Regression of the rate on the temperature.
        let (mean_t, mean_d) = (column(1).sum::<f64>() / n, column(2).sum::<f64>() / n);
        let cross = column(1).zip(column(2)).map(|(t, d)| (t - mean_t) * (d - mean_d)).sum::<f64>() / n;
        let slope = cross / spread(1).powi(2);
        let rest = (spread(2).powi(2) - slope * cross).max(0.0).sqrt();
        if rest < 2.0 * SUFFICIENT {
            let tau = Feature::Temperature.scale() / Feature::Rate.scale() / -slope;
            let history = if tau > 0.0 {
                format!("a single exponential of time constant {tau:.0} s")
            } else {
                "a growing exponential".to_owned()
            };
            return format!(
                "the rate followed the temperature to within {:.1} degC/h (rms), {history}, so the effects of temperature, \
                 rate and constant cannot be told apart",
                rest * rate_scale
            );
        }
    }
    format!("these functions of time are dependent: {} = 0", combination(weakest))
}

/// A combination of features in words, the large terms only.
pub(super) fn combination(weights: &[(Feature, f64)]) -> String {
    let largest = weights.iter().fold(0.0f64, |m, w| m.max(w.1.abs()));
    let sign = weights.iter().find(|w| w.1.abs() > 0.1 * largest).map_or(1.0, |w| w.1.signum());
    let mut words = String::new();
    for (feature, weight) in weights.iter().filter(|w| w.1.abs() > 0.1 * largest) {
        let weight = sign * weight;
        let joint = match (words.is_empty(), weight < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        // Writing to a string does not fail.
        let _ = write!(words, "{joint}{:.2} {feature}", weight.abs());
    }
    words
}

/// How much a run has said about the parts of one coefficient.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Worst {
    /// Largest ratio of posterior to prior sigma over all combinations of the parts.
    pub(super) ratio: f64,
    /// The combination that has it, in units of the prior sigmas.
    pub(super) combination: Vec<(Feature, f64)>,
}

/// The worst determined combination of the parts of a coefficient with this posterior covariance and prior sigmas.
pub(super) fn worst(covariance: &DMatrix<f64>, prior: &[f64]) -> Worst {
    let np = prior.len();
    let ratio = DMatrix::from_fn(np, np, |i, j| covariance[(i, j)] / (prior[i] * prior[j]));
    let eigen = ratio.symmetric_eigen();
    let worst = eigen.eigenvalues.imax();
    Worst {
        ratio: eigen.eigenvalues[worst].max(0.0).sqrt(),
        combination: Feature::ALL.into_iter().zip(eigen.eigenvectors.column(worst).iter().copied()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(history: impl Fn(f64) -> (f64, f64)) -> Vec<Vec<f64>> {
        (0..3600)
            .map(|t| {
                let (temperature, rate) = history(f64::from(t));
                vec![1.0, (temperature - 35.0) / 30.0, rate * 3600.0 / 20.0]
            })
            .collect()
    }

    #[test]
    fn tmp_12_forbidden_programmes_are_named() {
        let steady = ThermalProgramme::of(&rows(|_| (20.0, 0.0)));
        assert!(
            steady.smallest() < 1e-6 && steady.words.contains("temperature stayed within 0.0"),
            "{steady:?}"
        );
        let ramp = ThermalProgramme::of(&rows(|t| (20.0 + 25.0 / 3600.0 * t, 25.0 / 3600.0)));
        assert!(ramp.smallest() < 1e-6 && ramp.words.contains("of 25.0 degC/h"), "{ramp:?}");
        let single = |t: f64| (60.0 - 40.0 * (-t / 1500.0).exp(), 40.0 / 1500.0 * (-t / 1500.0).exp());
        let exponential = ThermalProgramme::of(&rows(single));
        assert!(exponential.smallest() < 1e-6, "{exponential:?}");
        assert!(
            exponential.words.contains("single exponential of time constant 1500 s"),
            "{}",
            exponential.words
        );
        let wave = |t: f64| {
            let w = std::f64::consts::TAU / 3600.0;
            (35.0 + 12.0 * (w * t).sin(), 12.0 * w * (w * t).cos())
        };
        let good = ThermalProgramme::of(&rows(wave));
        assert!(good.sufficient && good.words.is_empty() && good.smallest() > 0.2, "{good:?}");
    }
}
