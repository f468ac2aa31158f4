//! What a fitted model says the autocorrelation and the Allan variance are, to be drawn over the measured ones.
use schuler_fourier::Complex;

use super::likelihood::{Correlated, Fit, Parameters};

/// Autocorrelation of the stationary parts of `parameters` at `lag` steps: the white part at lag 0 alone.
pub fn autocorrelation_of(parameters: &Parameters, lag: usize) -> f64 {
    let steps = lag as f64;
    let part = |(part, beta): (Correlated, f64)| {
        part.sigma.powi(2) * (-part.alpha * steps).exp() * (beta * steps).cos()
    };
    let white = if lag == 0 { parameters.white.powi(2) } else { 0.0 };
    white + correlated_parts(parameters).map(part).sum::<f64>()
}

/// Allan variance of `fit` for means over `factor` values, its slope included.
pub fn allan_variance_of(fit: &Fit, factor: usize) -> f64 {
    let Parameters { white, walk, .. } = fit.parameters;
    let m = factor as f64;
    let correlated: f64 =
        correlated_parts(&fit.parameters).map(|(part, beta)| allan_variance_of_part(part, beta, m)).sum();
    let walked = walk * walk * (2.0 * m * m + 1.0) / (6.0 * m);
    let ramp = fit.slope.0 * m;
    white * white / m + correlated + walked + ramp * ramp / 2.0
}

/// Closed sums over the samples, with z = e^(−α + iβ): Var Σ₁ = m R₀ + 2 Re Σ (m − j) σ² zʲ and
/// Cov(Σ₁, Σ₂) = Re σ² z ((1 − zᵐ)/(1 − z))².
fn allan_variance_of_part(part: Correlated, beta: f64, m: f64) -> f64 {
    let rate = Complex::new(-part.alpha, beta);
    let one = Complex::new(1.0, 0.0);
    let z = rate.exp();
    let (step, whole) = (one - z, one - (rate * m).exp());
    let within = z * (step * m - whole) / (step * step);
    let across = z * (whole / step).powu(2);
    part.sigma * part.sigma * (m + 2.0 * within.re - across.re) / (m * m)
}

/// The correlated parts that are there, each with its β.
fn correlated_parts(parameters: &Parameters) -> impl Iterator<Item = (Correlated, f64)> {
    let markov = parameters.markov.into_iter().map(|part| (part, 0.0));
    markov.chain([(parameters.cosine, parameters.beta)]).filter(|(part, _)| part.sigma > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::likelihood::{Parts, Removed};

    #[test]
    fn the_allan_variance_is_that_of_the_autocorrelation() {
        let cosine = Correlated { sigma: 1.5, alpha: 0.03 };
        let markov = [Correlated { sigma: 0.7, alpha: 0.2 }, Correlated::default()];
        let parameters = Parameters { white: 0.5, markov, cosine, beta: 0.1, walk: 0.0 };
        let fit = Fit {
            parts: Parts { markov: 1, cosine: true, walk: false },
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
            parts: Parts { walk: true, ..Parts::default() },
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
