//! The prior of amplitudes: a Cauchy distribution in the metric of their information (Zellner and Siow 1980).
use std::f64::consts::PI;

use statrs::function::gamma::ln_gamma;

use crate::catalogue::Amplitude;
use crate::config::Config;

/// Logarithm of the prior density of `count` amplitudes whose squares in the metric of their information are `squares`, less half
/// the logarithm of the determinant of that information.
pub fn ln_prior(squares: f64, count: usize, config: &Config) -> f64 {
    let (count, unit) = (count as f64, config.unit_information);
    let power = 0.5 * (count + 1.0);
    ln_gamma(power) - power * PI.ln() - 0.5 * count * unit.ln() - power * (squares / unit).ln_1p()
}

/// What a signature of `count` amplitudes with `squares` gains, its amplitudes integrated out.
pub fn ln_gain(squares: f64, count: usize, config: &Config) -> f64 {
    0.5 * squares + ln_prior(squares, count, config) + 0.5 * count as f64 * (2.0 * PI).ln()
}

/// What amplitudes outside of their plausible ranges cost: by the tail of a Cauchy distribution over decades, so that it
/// is nats and never a veto.
pub fn ln_plausibility<'a>(
    amplitudes: impl Iterator<Item = &'a Amplitude>,
    values: &[f64],
    config: &Config,
) -> f64 {
    let of = |(amplitude, value): (&Amplitude, &f64)| {
        let Some([least, most]) = amplitude.plausible else { return 0.0 };
        let size = (value * amplitude.in_unit).abs();
        let decades = if size > most {
            (size / most).log10()
        } else if size < least {
            (least / size.max(f64::MIN_POSITIVE)).log10()
        } else {
            0.0
        };
        -(config.implausible_per_decade * decades).powi(2).ln_1p()
    };
    amplitudes.zip(values).map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By quadrature over one amplitude of unit information.
    #[test]
    fn the_gain_is_the_integral_over_the_prior() {
        let config = Config::default();
        let score = 6.0_f64;
        let prior = |x: f64| (ln_prior(x * x, 1, &config)).exp();
        let step = 1e-3;
        let integral: f64 = (-40_000..40_000)
            .map(|k| f64::from(k) * step)
            .map(|x| prior(x) * (score * x - 0.5 * x * x).exp() * step)
            .sum();
        assert!((integral.ln() - ln_gain(score * score, 1, &config)).abs() < 0.05);
        let whole: f64 = (-4_000_000..4_000_000).map(|k| prior(f64::from(k) * 0.01) * 0.01).sum();
        assert!((whole - 1.0).abs() < 0.01, "{whole}");
    }
}
