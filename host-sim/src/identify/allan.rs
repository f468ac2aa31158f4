//! Overlapping Allan deviation of a series with gaps, with its confidence interval.
//!
//! σ²(mΔ) = ½ ⟨(ȳ_{i+m} − ȳ_i)²⟩ over all i, with ȳ the means of m consecutive steps. Source: Riley, Handbook of
//! Frequency Stability Analysis, NIST SP 1065: (11) for the deviation, table 5 for its equivalent degrees of freedom;
//! the kind of noise they depend on from the lag-1 autocorrelation (Riley & Greenhall, 2004).
//!
//! Means of p of m steps count too. Where p of m are lost at random, the mean of those that are there has the variance
//! s² (1/p − 1/m) about the mean of all, with s² the variance within them (Cochran, Sampling Techniques, 3rd ed., theorem 2.2);
//! that is taken from each square, and each is weighted by p₁ p₂/(p₁ + p₂).
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::series::{block_means, mean};

/// A mean over m steps counts if at least this part of them is there, and two.
const LEAST_PRESENT: f64 = 0.25;
const LEAST_VALUES: f64 = 2.0;
/// Averaging times per decade.
const PER_DECADE: f64 = 10.0;
/// The longest averaging time is this part of the series.
const LONGEST: usize = 3;
/// Fewer means than this do not show the kind of noise; that of the next shorter averaging time is taken.
const LEAST_MEANS: usize = 30;
/// Probability between the bounds of the interval: that of ±1 σ.
const ONE_SIGMA: f64 = 0.682_689_492_137_085_9;

/// The Allan deviation at one averaging time, in the unit of the series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AllanPoint {
    /// Averaging factor m.
    pub factor: usize,
    /// Averaging time mΔ, s.
    pub tau_s: f64,
    /// Deviation σ(τ).
    pub deviation: f64,
    /// Lower bound of the 1-σ interval.
    pub lower: f64,
    /// Upper bound of the 1-σ interval.
    pub upper: f64,
    /// Differences averaged.
    pub terms: usize,
    /// Exponent α of the spectrum f^α at this averaging time: 2 quantisation, 0 white, −1 flicker, −2 random walk.
    pub exponent: i32,
    /// Equivalent degrees of freedom of the χ² distribution of σ².
    pub degrees_of_freedom: f64,
}

/// The overlapping Allan deviation of `values` (NaN = missing) at ten averaging times a decade and all octaves.
pub fn overlapping_allan(values: &[f64], step_s: f64) -> Vec<AllanPoint> {
    let mut exponent = 0;
    let phase = Phase::new(values);
    factors(values.len())
        .into_iter()
        .filter_map(|factor| {
            let (variance, terms) = phase.allan_variance(factor)?;
            exponent = noise_exponent(&block_means(values, factor)).unwrap_or(exponent);
            let whole = degrees_of_freedom(terms + 2 * factor, factor, exponent);
            let degrees_of_freedom = (whole * phase.part).max(1.0);
            let deviation = variance.sqrt();
            let (lower, upper) = interval(deviation, degrees_of_freedom, ONE_SIGMA);
            let tau_s = factor as f64 * step_s;
            Some(AllanPoint { factor, tau_s, deviation, lower, upper, terms, exponent, degrees_of_freedom })
        })
        .collect()
}

/// Overlapping Allan variance at each of `factors`, `None` where there is no pair of means.
pub(super) fn allan_variances(values: &[f64], factors: &[usize]) -> Vec<Option<f64>> {
    let phase = Phase::new(values);
    factors.iter().map(|&factor| Some(phase.allan_variance(factor)?.0)).collect()
}

/// Interval of `deviation` that holds the true one with `probability`, χ² with `degrees_of_freedom`.
pub(super) fn interval(deviation: f64, degrees_of_freedom: f64, probability: f64) -> (f64, f64) {
    let Ok(distribution) = ChiSquared::new(degrees_of_freedom) else { return (0.0, f64::INFINITY) };
    let bound = |probability| deviation * (degrees_of_freedom / distribution.inverse_cdf(probability)).sqrt();
    (bound(0.5 + probability / 2.0), bound(0.5 - probability / 2.0))
}

fn factors(count: usize) -> Vec<usize> {
    let longest = count / LONGEST;
    let decades = (0..).map(|k| 10_f64.powf(f64::from(k) / PER_DECADE).round() as usize);
    let octaves = (0..usize::BITS).map(|k| 1_usize << k);
    let mut factors: Vec<usize> = decades
        .take_while(|&factor| factor <= longest)
        .chain(octaves.take_while(|&factor| factor <= longest))
        .collect();
    factors.sort_unstable();
    factors.dedup();
    factors
}

/// Running sums of the deviations from the mean, of their squares, and of how many are there.
struct Phase {
    sums: Vec<f64>,
    squares: Vec<f64>,
    present: Vec<u32>,
    /// Part of the values that is there.
    part: f64,
}

impl Phase {
    fn new(values: &[f64]) -> Self {
        let mean = mean(values);
        let (mut sum, mut square, mut present) = (0.0, 0.0, 0);
        let mut phase = Self { sums: vec![0.0], squares: vec![0.0], present: vec![0], part: 1.0 };
        for value in values {
            if value.is_finite() {
                sum += value - mean;
                square += (value - mean).powi(2);
                present += 1;
            }
            phase.sums.push(sum);
            phase.squares.push(square);
            phase.present.push(present);
        }
        phase.part = f64::from(present) / values.len().max(1) as f64;
        phase
    }

    /// Variance and number of differences behind it.
    fn allan_variance(&self, factor: usize) -> Option<(f64, usize)> {
        let (mut squares, mut weights, mut terms) = (0.0, 0.0, 0_usize);
        let complete = self.part == 1.0;
        let least = if factor == 1 { 1.0 } else { LEAST_VALUES.max(LEAST_PRESENT * factor as f64) };
        for first in 0..self.sums.len().saturating_sub(2 * factor) {
            if complete {
                let [a, b, c] = [first, first + factor, first + 2 * factor].map(|at| self.sums[at]);
                let difference = (c - b) / factor as f64 - (b - a) / factor as f64;
                squares += difference * difference;
                weights += 1.0;
                terms += 1;
                continue;
            }
            let (early, late) = (self.cluster(first, factor), self.cluster(first + factor, factor));
            if early.count < least || late.count < least {
                continue;
            }
            let weight = 2.0 * early.count * late.count / (early.count + late.count) / factor as f64;
            let difference = late.mean - early.mean;
            squares += weight * (difference * difference - early.excess(factor) - late.excess(factor));
            weights += weight;
            terms += 1;
        }
        let variance = squares / (2.0 * weights);
        // What is taken for lost values may be all that there is.
        (terms > 0 && variance >= 0.0).then_some((variance, terms))
    }

    /// What is there of the steps `first` to `first + factor`.
    fn cluster(&self, first: usize, factor: usize) -> Cluster {
        let count = f64::from(self.present[first + factor] - self.present[first]);
        let mean = (self.sums[first + factor] - self.sums[first]) / count;
        let square = self.squares[first + factor] - self.squares[first];
        Cluster { count, mean, variance: (square - count * mean * mean) / (count - 1.0) }
    }
}

/// The values of a mean over m steps.
struct Cluster {
    count: f64,
    mean: f64,
    variance: f64,
}

impl Cluster {
    /// By how much the square of its mean is larger than that of all `factor` steps, of which the others are lost.
    fn excess(&self, factor: usize) -> f64 {
        let lost = self.count.recip() - (factor as f64).recip();
        if lost > 0.0 { self.variance.max(0.0) * lost } else { 0.0 }
    }
}

/// Exponent of the spectrum of a series from its lag-1 autocorrelation r₁, a line taken out: while ρ = r₁/(1 + r₁) ≥ ¼
/// it is differenced, at most twice; then α = −2(ρ + d), rounded. `None` for fewer than 30 values.
fn noise_exponent(means: &[f64]) -> Option<i32> {
    if present(means.iter().copied()).count() < LEAST_MEANS {
        return None;
    }
    let mut series = without_line(means);
    for differenced in 0..=2 {
        let mean = mean(&series);
        let centred: Vec<f64> = series.iter().map(|value| value - mean).collect();
        let products: f64 = present(centred.iter().zip(centred.iter().skip(1)).map(|(a, b)| a * b)).sum();
        let squares: f64 = present(centred.iter().map(|a| a * a)).sum();
        let ratio = products / squares;
        let rho = ratio / (1.0 + ratio);
        if rho < 0.25 || differenced == 2 {
            return Some((-(2.0 * rho).round() as i32 - 2 * differenced).clamp(-2, 2));
        }
        series = series.iter().zip(series.iter().skip(1)).map(|(a, b)| b - a).collect();
    }
    None
}

fn present(values: impl Iterator<Item = f64>) -> impl Iterator<Item = f64> {
    values.filter(|value| value.is_finite())
}

/// The series without its least-squares line.
fn without_line(values: &[f64]) -> Vec<f64> {
    let times: Vec<f64> = (0..values.len()).map(|time| time as f64).collect();
    let Some(line) = super::trend::trend(&times, values) else { return values.to_vec() };
    values.iter().zip(times).map(|(value, time)| value - line.intercept - line.slope_per_s * time).collect()
}

/// Equivalent degrees of freedom of the overlapping Allan variance of noise with spectrum f^`exponent`, from `count`
/// values of phase at averaging factor m = `factor`. `[NIST SP 1065, table 5; the printed flicker term for m = 1 lacks
/// the square that its source has: Howe, Allan & Barnes, 1981]`
fn degrees_of_freedom(count: usize, factor: usize, exponent: i32) -> f64 {
    let (n, m) = (count as f64, factor as f64);
    let degrees = match exponent {
        2 => (n + 1.0) * (n - 2.0 * m) / (2.0 * (n - m)),
        1 => {
            let (a, b) = ((n - 1.0) / (2.0 * m), (2.0 * m + 1.0) * (n - 1.0) / 4.0);
            (a.ln() * b.ln()).max(0.0).sqrt().exp()
        }
        0 => (1.5 * (n - 1.0) / m - 2.0 * (n - 2.0) / n) * (4.0 * m * m) / (4.0 * m * m + 5.0),
        -1 if factor == 1 => 2.0 * (n - 2.0) * (n - 2.0) / (2.3 * n - 4.9),
        -1 => 5.0 * n * n / (4.0 * m * (n + 3.0 * m)),
        _ => {
            let squares = (n - 1.0) * (n - 1.0) - 3.0 * m * (n - 1.0) + 4.0 * m * m;
            (n - 2.0) / m * squares / ((n - 3.0) * (n - 3.0))
        }
    };
    degrees.max(1.0)
}
