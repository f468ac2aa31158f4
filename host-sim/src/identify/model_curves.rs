//! What a fitted model says the autocorrelation and the Allan variance are, to be drawn over the measured ones.
use realfft::num_complex::Complex;

use super::likelihood::{Fit, Parameters};

/// Autocorrelation of the stationary parts of `parameters` at `lag` steps: the white part at lag 0 alone.
pub fn autocorrelation_of(parameters: &Parameters, lag: usize) -> f64 {
    let steps = lag as f64;
    let correlated =
        parameters.sigma.powi(2) * (-parameters.alpha * steps).exp() * (parameters.beta * steps).cos();
    correlated + if lag == 0 { parameters.white.powi(2) } else { 0.0 }
}

/// Allan variance of `fit` for means over `factor` values, its slope included.
///
/// Closed sums over the samples, with z = e^(−α + iβ): Var Σ₁ = m R₀ + 2 Re Σ (m − j) σ² zʲ and
/// Cov(Σ₁, Σ₂) = Re σ² z ((1 − zᵐ)/(1 − z))².
pub fn allan_variance_of(fit: &Fit, factor: usize) -> f64 {
    let Parameters { white, sigma, alpha, beta, walk } = fit.parameters;
    let m = factor as f64;
    let correlated = if sigma > 0.0 {
        let one = Complex::new(1.0, 0.0);
        let z = Complex::new(-alpha, beta).exp();
        let (step, whole) = (one - z, one - Complex::new(-alpha * m, beta * m).exp());
        let within = z * (step * m - whole) / (step * step);
        let across = z * (whole / step).powu(2);
        sigma * sigma * (m + 2.0 * within.re - across.re) / (m * m)
    } else {
        0.0
    };
    let walked = walk * walk * (2.0 * m * m + 1.0) / (6.0 * m);
    let ramp = fit.slope.0 * m;
    white * white / m + correlated + walked + ramp * ramp / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::likelihood::{Correlated, Parts, Removed};

    #[test]
    fn the_allan_variance_is_that_of_the_autocorrelation() {
        let parameters = Parameters { white: 0.5, sigma: 1.5, alpha: 0.03, beta: 0.1, walk: 0.0 };
        let fit = Fit {
            parts: Parts { correlated: Correlated::ExponentialCosine, walk: false },
            removed: Removed::Mean,
            parameters,
            log_sigmas: None,
            log_likelihood: 0.0,
            level: (0.0, 0.0),
            slope: (0.0, 0.0),
            count: 0,
        };
        for factor in [1, 2, 7, 40] {
            // ½ E (mean of the later − mean of the earlier)², by all pairs of samples.
            let weight = |i: usize| if i < factor { -1.0 } else { 1.0 };
            let mut expected = 0.0;
            for i in 0..2 * factor {
                for j in 0..2 * factor {
                    expected += weight(i) * weight(j) * autocorrelation_of(&parameters, i.abs_diff(j));
                }
            }
            expected /= 2.0 * (factor * factor) as f64;
            let found = allan_variance_of(&fit, factor);
            assert!((found / expected - 1.0).abs() < 1e-10, "{factor}: {found} {expected}");
        }
    }

    #[test]
    fn a_walk_and_a_ramp_have_their_allan_variances() {
        let parameters = Parameters { walk: 0.3, ..Parameters::default() };
        let fit = Fit {
            parts: Parts { correlated: Correlated::None, walk: true },
            removed: Removed::Line,
            parameters,
            log_sigmas: None,
            log_likelihood: 0.0,
            level: (0.0, 0.0),
            slope: (0.2, 0.0),
            count: 0,
        };
        // m = 1: half the variance of one step, and half the square of one ramp step.
        assert!((allan_variance_of(&fit, 1) - 0.5 * (0.09 + 0.04)).abs() < 1e-15);
    }
}
