//! What noise that goes on between the rows does to a linear system within a step.
use nalgebra::DMatrix;

/// Part of the time of the fastest change over which a series is taken, and its terms.
const SHORT: f64 = 0.125;
const TERMS: u32 = 12;

/// The transition over a step of a system ẋ = A x + w with the `generator` A, white noise w of the spectral `density` W, and the covariance of
/// what w adds.
///
/// Over a short time h these are Σ (A h)ᵏ/k! and Σ Lₖ hᵏ⁺¹/(k + 1)!, L₀ = W and Lₖ₊₁ = A Lₖ + Lₖ Aᵀ; over twice the time Φ Φ and
/// Q + Φ Q Φᵀ. The system changes at rates of up to `fastest`, 1/s.
pub fn over_step(
    generator: &DMatrix<f64>,
    density: &DMatrix<f64>,
    fastest: f64,
    step_s: f64,
) -> [DMatrix<f64>; 2] {
    let doublings = (fastest * step_s / SHORT).log2().ceil().clamp(0.0, 60.0) as i32;
    let short_s = step_s / 2.0_f64.powi(doublings);
    let size = generator.nrows();
    let (mut transition, mut covariance) = (DMatrix::identity(size, size), DMatrix::zeros(size, size));
    let (mut power, mut added) = (transition.clone(), density * short_s);
    for term in 1..=TERMS {
        covariance += &added;
        power = generator * &power * (short_s / f64::from(term));
        transition += &power;
        added = (generator * &added + &added * generator.transpose()) * (short_s / f64::from(term + 1));
    }
    for _ in 0..doublings {
        covariance += &transition * &covariance * transition.transpose();
        transition = &transition * &transition;
    }
    [transition, covariance]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of a Markov process has its known variance (Brown and Hwang, Introduction to Random Signals, ch. 5), over steps
    /// that are short and long beside its time constant.
    #[test]
    fn an_integrated_markov_process_has_its_variance() {
        let (sigma, tau) = (0.3_f64, 40.0_f64);
        for step in [0.1_f64, 10.0, 40.0, 1000.0, 1e5] {
            let generator = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, -1.0 / tau]);
            let density = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 2.0 * sigma * sigma / tau]);
            let [transition, covariance] = over_step(&generator, &density, 1.0 / tau, step);
            let (once, twice) = (-(-step / tau).exp_m1(), -(-2.0 * step / tau).exp_m1());
            let expected = [
                (transition[(0, 1)], tau * once),
                (covariance[(1, 1)], sigma * sigma * twice),
                (covariance[(0, 1)], sigma * sigma * tau * once * once),
                (
                    covariance[(0, 0)],
                    2.0 * sigma * sigma * tau * (step - 2.0 * tau * once + 0.5 * tau * twice),
                ),
            ];
            for (found, expected) in expected {
                // The last is a small difference over a short step.
                let rounding = 1e-14 * (sigma * tau).powi(2);
                assert!(
                    (found - expected).abs() < 1e-9 * expected.abs() + rounding,
                    "{step}: {found} {expected}"
                );
            }
        }
    }
}
