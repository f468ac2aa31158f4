//! Tail probabilities, as logarithms where they underflow, and the tests on whitened records.
//!
//! | function | source |
//! | --- | --- |
//! | [`ln_chi_squared_tail`] | incomplete gamma function by its continued fraction (Press et al., Numerical Recipes, 6.2) |
//! | [`ln_rough_scan_tail`] | maximum of a process whose correlation falls linearly (Siegmund, Sequential Analysis, 1985) |
//! | [`maxima_per_place`] | maxima of a process whose correlation falls as any power (Pickands, Trans. AMS 145, 1969) |
//! | [`ln_frequency_scan_tail`] | maximum of a periodogram over all frequencies (Baluev, MNRAS 385, 2008) |
//! | [`ljung_box`] | Ljung & Box, 1978 |
use schuler_fourier::{Forward, Inverse};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::erf::erfc;
use statrs::function::gamma::ln_gamma;

/// Terms of the continued fraction.
const FRACTION_TERMS: usize = 300;
/// Where the tail is found from the continued fraction rather than from its complement.
const FAR: f64 = 20.0;
/// Least logarithm of a probability that is told from zero.
const LEAST_LOG: f64 = -1e12;

/// ln P(χ² with `freedom` degrees of freedom > `value`).
pub fn ln_chi_squared_tail(value: f64, freedom: usize) -> f64 {
    if value.is_nan() || value <= 0.0 || freedom == 0 {
        return 0.0;
    }
    let (a, x) = (0.5 * freedom as f64, 0.5 * value);
    if x < a + FAR {
        let tail = ChiSquared::new(freedom as f64).map_or(1.0, |distribution| distribution.sf(value));
        return tail.max(f64::MIN_POSITIVE).ln().min(0.0);
    }
    // Lentz's method.
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..FRACTION_TERMS {
        let an = -(i as f64) * (i as f64 - a);
        b += 2.0;
        d = an * d + b;
        d = if d.abs() < tiny { tiny } else { d }.recip();
        c = b + an / c;
        c = if c.abs() < tiny { tiny } else { c };
        let step = d * c;
        h *= step;
        if (step - 1.0).abs() < 1e-14 {
            break;
        }
    }
    (a * x.ln() - x - ln_gamma(a) + h.ln()).max(LEAST_LOG)
}

/// P(χ² with `freedom` degrees of freedom > `value`).
pub fn chi_squared_tail(value: f64, freedom: usize) -> f64 {
    ln_chi_squared_tail(value, freedom).exp()
}

/// P(|z| > `z`) of a standard normal.
pub fn two_sided(z: f64) -> f64 {
    erfc(z.abs() / std::f64::consts::SQRT_2)
}

fn normal_cdf(z: f64) -> f64 {
    0.5 * erfc(-z / std::f64::consts::SQRT_2)
}

fn normal_density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()
}

/// Siegmund's correction for steps that are not small, `ν(x)`.
fn overshoot(x: f64) -> f64 {
    if x < 1e-6 {
        return 1.0;
    }
    let half = 0.5 * x;
    (2.0 / x) * (normal_cdf(half) - 0.5) / (half * normal_cdf(half) + normal_density(half))
}

/// ln of `P(|z| > u)` times `factor`, at most 0.
fn ln_scaled(u: f64, factor: f64) -> f64 {
    (ln_chi_squared_tail(u * u, 1) + factor.max(1.0).ln()).min(0.0)
}

/// ln P(max |z| > `u`) over a chain of standard normals whose neighbours have the given correlations, where the
/// correlation falls linearly with the distance.
pub fn ln_rough_scan_tail(u: f64, correlations: impl Iterator<Item = f64>) -> f64 {
    if u < 1.0 {
        return 0.0;
    }
    // In units of the two-sided tail 2φ(u)/u.
    let clusters: f64 = correlations
        .map(|rho| {
            let beta = (1.0 - rho).clamp(0.0, 1.0);
            beta * u * u * overshoot((2.0 * beta).sqrt() * u)
        })
        .sum();
    ln_scaled(u, 1.0 + clusters)
}

/// Separate maxima above `u` a place of a chain of standard normals, in units of the tail at one place; `forgotten` holds 1 − ρ at
/// the distances 1, 2, 4 ….
///
/// With 1 − ρ = c n^α the maxima above a high `u` are H_α u^(2/α) c^(1/α) a place, so that what counts is the distance at which
/// 1 − ρ is 1/u², and the power α about it. H_α, Pickands's constant, is 1 for a random walk's α = 1 and π^(−½) for a smooth
/// process's α = 2.
pub fn maxima_per_place(u: f64, forgotten: &[f64]) -> f64 {
    let reached = u.powi(-2);
    let at = forgotten.iter().position(|&part| part >= reached);
    // The pair of distances about it, or the last one.
    let before =
        at.unwrap_or(forgotten.len()).max(1).min(forgotten.len().saturating_sub(1)).saturating_sub(1);
    let (Some(&near), far) = (forgotten.get(before), forgotten.get(before + 1)) else { return 0.0 };
    // The distance, as the place counts its doublings.
    let doublings = (before as f64).exp2();
    if near <= 0.0 {
        return far.filter(|&&far| far >= reached).map_or(0.0, |_| 0.5 / doublings);
    }
    let power = far.map_or(1.0, |far| (far / near).log2()).clamp(1.0, 2.0);
    let distance = doublings * (reached / near).powf(power.recip());
    // Between its places a random walk rises above them, a smooth process does not.
    let missed = overshoot((2.0 / distance).sqrt()).powf(2.0 - power);
    std::f64::consts::PI.powf(0.5 * (1.0 - power)) * missed / distance
}

/// ln P(max |z| > `u`) over a chain of standard normals with so many separate maxima, in units of the tail at one place.
pub fn ln_scan_tail(u: f64, maxima: f64) -> f64 {
    if u < 1.0 { 0.0 } else { ln_scaled(u, 1.0 + maxima) }
}

/// ln P(max gain > `gain`) of a sinusoid over all frequencies of a record of `count` values, where the gain in
/// log-likelihood at one frequency exceeds G with probability exp(−G).
pub fn ln_frequency_scan_tail(gain: f64, count: usize) -> f64 {
    let bandwidth = 0.5 * count as f64 * (std::f64::consts::PI / 3.0).sqrt();
    (bandwidth.max(1.0).ln() - gain + 0.5 * gain.max(1.0).ln()).min(0.0)
}

/// Σ x_i x_{i−j} over the pairs in which both values are there (NaN = missing), for lags j = 0 … `lags`; by the fast
/// Fourier transform, with a rounding of 10⁻¹⁵ of the first.
pub fn lagged_products(values: &[f64], lags: usize) -> Vec<f64> {
    let length = (values.len() + lags + 1).next_power_of_two();
    let there = values.iter().map(|&value| if value.is_finite() { value } else { 0.0 });
    let spectrum = Forward::new(length).transform(there);
    let powers = spectrum.iter().map(|bin| (bin.norm_sqr() / length as f64).into());
    let mut products = Inverse::new(length).transform(powers);
    products.truncate(lags + 1);
    products
}

/// The number of pairs behind each of [`lagged_products`].
pub fn lagged_pairs(values: &[f64], lags: usize) -> Vec<usize> {
    if values.iter().all(|value| value.is_finite()) {
        return (0..=lags).map(|lag| values.len().saturating_sub(lag)).collect();
    }
    let mask: Vec<f64> = values.iter().map(|value| f64::from(u8::from(value.is_finite()))).collect();
    lagged_products(&mask, lags).into_iter().map(|pairs| pairs.round() as usize).collect()
}

/// p-value of the Ljung–Box test over `lags` lags on standardised innovations (NaN = missing).
pub fn ljung_box(innovations: &[f64], lags: usize) -> f64 {
    let count = innovations.iter().filter(|value| value.is_finite()).count() as f64;
    if count < 4.0 * lags as f64 {
        return 1.0;
    }
    let covariance = lagged_products(innovations, lags);
    let variance = covariance.first().copied().unwrap_or_default();
    if variance <= 0.0 {
        return 1.0;
    }
    // A lag over a hole has fewer pairs; each pair counts with weight one.
    let statistic: f64 =
        covariance.iter().skip(1).map(|c| (c / variance).powi(2)).sum::<f64>() * (count + 2.0);
    chi_squared_tail(statistic, lags)
}

/// The middle value, of an even number the mean of both; the order is lost.
pub fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if middle == 0 {
        return values.first().copied().unwrap_or_default();
    }
    let odd = values.len() % 2 == 1;
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if odd { *upper } else { 0.5 * (*upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_tails_continue_the_near_ones() {
        // Published: P(χ²_1 > 10.8276) = 0.001, P(χ²_3 > 16.266) = 0.001.
        assert!((chi_squared_tail(10.8276, 1) - 1e-3).abs() < 1e-7);
        assert!((chi_squared_tail(16.2662, 3) - 1e-3).abs() < 1e-7);
        for freedom in [1, 2, 3, 7] {
            let (a, edge) = (0.5 * freedom as f64, 2.0 * (0.5 * freedom as f64 + FAR));
            let (below, above) =
                (ln_chi_squared_tail(edge - 1e-9, freedom), ln_chi_squared_tail(edge + 1e-9, freedom));
            assert!((below - above).abs() < 1e-6, "{freedom} {a}: {below} {above}");
        }
        // χ²_2 is exponential.
        assert!((ln_chi_squared_tail(5000.0, 2) + 2500.0).abs() < 1e-9);
        assert!((two_sided(1.959_963_984_540_054) - 0.05).abs() < 1e-9);
    }

    #[test]
    fn scans_over_independent_places_are_bonferroni() {
        let u = 4.0;
        let all = ln_rough_scan_tail(u, std::iter::repeat_n(0.0, 99)).exp();
        assert!((all / (100.0 * two_sided(u)) - 1.0).abs() < 0.1, "{all}");
        let maxima = 99.0 * maxima_per_place(u, &[1.0, 1.0, 1.0]);
        let all = ln_scan_tail(u, maxima).exp();
        assert!((all / (100.0 * two_sided(u)) - 1.0).abs() < 0.1, "{all}");
        assert!(
            (ln_rough_scan_tail(u, std::iter::repeat_n(1.0, 99)).exp() / two_sided(u) - 1.0).abs() < 1e-9
        );
    }

    /// A random walk's and a smooth chain's maxima are those of the formulas for them alone.
    #[test]
    fn maxima_depend_on_how_correlations_fall() {
        let u = 4.5;
        let chain = |power: f64| -> Vec<f64> {
            (0..12).map(|lag| 1e-4 * 2.0_f64.powf(power * f64::from(lag))).collect()
        };
        let rough = 1000.0 * maxima_per_place(u, &chain(1.0));
        let expected =
            ln_rough_scan_tail(u, std::iter::repeat_n(1.0 - 1e-4, 1000)).exp() / two_sided(u) - 1.0;
        assert!((rough / expected - 1.0).abs() < 0.05, "{rough} {expected}");
        // Rice: a smooth process with 1 − ρ = ½ λ t² crosses u upwards √λ φ(u)/√(2π) times a unit of t, in each direction.
        let smooth = maxima_per_place(u, &chain(2.0));
        let expected =
            (2e-4_f64).sqrt() * normal_density(u) / std::f64::consts::TAU.sqrt() / (0.5 * two_sided(u));
        assert!((smooth / expected - 1.0).abs() < 0.1, "{smooth} {expected}");
    }
}
