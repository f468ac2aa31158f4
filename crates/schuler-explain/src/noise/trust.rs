//! How far the level of a spectrum is believed in a band.
//!
//! Real noise is never quite of the form that is fitted to it. The level of a band is that of the form times λ, with λ of an
//! inverse gamma distribution of ν/2 and ν/2, which is integrated out: the coefficients of a band are then of a
//! multivariate Student distribution of ν degrees of freedom.
use std::f64::consts::PI;

use statrs::function::gamma::ln_gamma;

/// Log-likelihood of `count` coefficients of `width` channels whose covariance has the logarithm of the determinant
/// `ln_determinant` and whose squares, in its metric, add up to `quadratic`.
pub fn log_likelihood(count: f64, width: f64, ln_determinant: f64, quadratic: f64, nu: f64) -> f64 {
    let values = count * width;
    let constant = if nu.is_infinite() {
        -0.5 * values * (2.0 * PI).ln()
    } else {
        ln_gamma(0.5 * (nu + values)) - ln_gamma(0.5 * nu) - 0.5 * values * (nu * PI).ln()
    };
    constant + of_level(count, width, ln_determinant, quadratic, nu)
}

/// The part of it that depends on the covariance.
pub fn of_level(count: f64, width: f64, ln_determinant: f64, quadratic: f64, nu: f64) -> f64 {
    let of_squares =
        if nu.is_infinite() { quadratic } else { (nu + count * width) * (quadratic / nu).ln_1p() };
    -0.5 * (count * ln_determinant + of_squares)
}

/// What the inverse of the covariance is multiplied by where the squares are as large as they are.
pub fn weight(count: f64, width: f64, quadratic: f64, nu: f64) -> f64 {
    if nu.is_infinite() { 1.0 } else { (nu + count * width) / (nu + quadratic) }
}

/// Mean of numbers that are given by their logarithms.
pub fn ln_mean(logarithms: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = logarithms.clone().count().max(1) as f64;
    ln_sum(logarithms) - count.ln()
}

/// Sum of numbers that are given by their logarithms; −∞ of none.
pub fn ln_sum(logarithms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logarithms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() {
        most + logarithms.map(|value| (value - most).exp()).sum::<f64>().ln()
    } else {
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_trust_is_the_limit_of_much() {
        let of = |nu| log_likelihood(7.0, 2.0, 0.3, 15.0, nu);
        assert!((of(1e9) - of(f64::INFINITY)).abs() < 1e-4);
        assert!((weight(7.0, 2.0, 15.0, 1e9) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_weight_is_the_derivative_by_the_squares() {
        let (nu, step) = (4.0, 1e-5);
        let of = |quadratic| log_likelihood(7.0, 2.0, 0.3, quadratic, nu);
        let slope = (of(15.0 + step) - of(15.0 - step)) / (2.0 * step);
        assert!((slope + 0.5 * weight(7.0, 2.0, 15.0, nu)).abs() < 1e-8);
    }
}
