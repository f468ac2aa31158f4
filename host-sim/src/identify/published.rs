//! The published read-out of a noise structure: an autocorrelation [FIL-11], fitted by
//! [`schuler_core::identification`] [FIL-13] [FIL-15] [FIL-19] [FIL-21].
//!
//! The formulas want a series whose correlated part stands out. White noise does not: it is a spike at lag 0 and, where
//! it dominates, noise on every lag. The series is therefore averaged over blocks, doubled in length until neighbours
//! are clearly correlated; what is left of the white part is taken off lag 0 by extending the correlation at the first
//! lags back to it. What the removed mean or line took from every lag is put back.
use schuler_core::identification::{Structure, choose_structure, removed_mean_bias};

use super::autocorrelation::{Centre, autocorrelation};
use super::likelihood::Removed;
use super::series::{block_means, mean};
use super::trend::trend;

/// Blocks are long enough when neighbours are correlated more than this.
const ENOUGH_CORRELATION: f64 = 0.6;
/// Where no block is, those are taken whose correlation is most significant, if it is by this many σ at least.
const LEAST_SIGNIFICANCE: f64 = 5.0;
/// Fewest blocks.
const LEAST_BLOCKS: usize = 100;
/// Longest lag as a part of the record, and in blocks.
const LONGEST_LAG: usize = 4;
const MOST_LAGS: usize = 1000;
/// The correlation is extended back to lag 0 over the first lags above this part of lag 1.
const EXTENDED_ABOVE: f64 = 0.5;
/// With as many lags its curvature is, too.
const LAGS_FOR_CURVATURE: usize = 8;

/// An autocorrelation and what was read from it.
#[derive(Clone, Debug, PartialEq)]
pub struct PublishedFit {
    /// Steps averaged into a block.
    pub factor: usize,
    /// Length of a block, s.
    pub spacing_s: f64,
    /// Length of the series, s.
    pub duration_s: f64,
    /// R_0 … R_J of the correlated part: without the white part at lag 0, the removed constants put back.
    pub correlation: Vec<f64>,
    /// Variance of the white part of a block.
    pub white_variance: f64,
    /// The structure and its parameters, in SI units.
    pub structure: Structure<f64>,
}

/// The published read-out of `values` (NaN = missing); `None` where nothing stands out of white noise.
pub fn published_fit(values: &[f64], step_s: f64, removed: Removed) -> Option<PublishedFit> {
    let values = without(values, removed);
    let (factor, blocks) = blocks_that_stand_out(&values)?;
    let spacing_s = factor as f64 * step_s;
    let duration_s = blocks.len() as f64 * spacing_s;
    let lags = (blocks.len() / LONGEST_LAG).min(MOST_LAGS);
    let mut correlation = autocorrelation(&blocks, lags, Centre::Zero).values;
    let variance = correlation.first().copied()?;
    let coloured = extended_to_zero(&correlation)?.min(variance);
    *correlation.first_mut()? = coloured;
    let structure = choose_structure(&correlation, spacing_s, duration_s);
    let constants = match removed {
        Removed::Mean => 1.0,
        Removed::Line => 2.0,
    };
    // Each removed constant takes the spectrum at zero frequency over T, 2R₀τ/T for the exponential.
    let bias = constants * removed_mean_bias(coloured, time_of_correlation(&structure)?, duration_s);
    for value in &mut correlation {
        *value += bias;
    }
    let structure = choose_structure(&correlation, spacing_s, duration_s);
    let within = coloured * within_block(&structure, factor, spacing_s);
    let white_variance = (variance - within).max(0.0);
    Some(PublishedFit { factor, spacing_s, duration_s, correlation, white_variance, structure })
}

/// Variance of the block means of a correlated part over its correlation extended to lag 0: averaging takes more at lag 0,
/// (x − 1 + e⁻ˣ), than at the others, (cosh x − 1), with x = α times the length of a block.
fn within_block(structure: &Structure<f64>, factor: usize, spacing_s: f64) -> f64 {
    let alpha = match structure {
        Structure::None => 0.0,
        Structure::Exponential(fit) => fit.alpha,
        Structure::ExponentialCosine(fit, ..) => fit.alpha,
    };
    let x = alpha * spacing_s;
    // Below, the two differ by less than the digits that are left of them.
    if factor > 1 && x > 1e-4 { (x - 1.0 + (-x).exp()) / (x.cosh() - 1.0) } else { 1.0 }
}

/// The integral of the correlation from lag 0, s.
fn time_of_correlation(structure: &Structure<f64>) -> Option<f64> {
    match structure {
        Structure::None => None,
        Structure::Exponential(fit) => Some(1.0 / fit.alpha),
        Structure::ExponentialCosine(fit, ..) => {
            Some(fit.alpha / (fit.alpha * fit.alpha + fit.beta * fit.beta))
        }
    }
}

fn without(values: &[f64], removed: Removed) -> Vec<f64> {
    let times: Vec<f64> = (0..values.len()).map(|time| time as f64).collect();
    let line = trend(&times, values).filter(|_| removed == Removed::Line);
    let constants = line.map_or((mean(values), 0.0), |line| (line.intercept, line.slope_per_s));
    values.iter().zip(times).map(|(value, time)| value - constants.0 - constants.1 * time).collect()
}

/// Blocks of the smallest factor at which the correlation of neighbours stands out, and that factor.
fn blocks_that_stand_out(values: &[f64]) -> Option<(usize, Vec<f64>)> {
    let mut best: Option<(f64, usize, Vec<f64>)> = None;
    let mut factor = 1;
    while values.len() / factor >= LEAST_BLOCKS {
        let blocks = block_means(values, factor);
        let neighbours = autocorrelation(&blocks, 1, Centre::Zero);
        let &[variance, covariance] = neighbours.values.as_slice() else { break };
        let correlation = covariance / variance;
        let significance = correlation * (neighbours.pairs.last().copied().unwrap_or_default() as f64).sqrt();
        if significance > LEAST_SIGNIFICANCE && correlation > ENOUGH_CORRELATION {
            return Some((factor, blocks));
        }
        if significance > best.as_ref().map_or(LEAST_SIGNIFICANCE, |best| best.0) {
            best = Some((significance, factor, blocks));
        }
        factor *= 2;
    }
    best.map(|(_, factor, blocks)| (factor, blocks))
}

/// R at lag 0 from a line (or parabola, where there are lags enough) through the logarithms of the first lags.
fn extended_to_zero(correlation: &[f64]) -> Option<f64> {
    let (&variance, lagged) = correlation.split_first()?;
    let first = lagged.first().copied().filter(|&first| first > 0.0)?;
    let logs: Vec<f64> =
        lagged.iter().take_while(|&&value| value > EXTENDED_ABOVE * first).map(|value| value.ln()).collect();
    if logs.len() < 2 {
        return Some(variance);
    }
    let times: Vec<f64> = (1..=logs.len()).map(|lag| lag as f64).collect();
    let degree = if logs.len() >= LAGS_FOR_CURVATURE { 2 } else { 1 };
    Some(at_zero(&times, &logs, degree)?.exp())
}

/// Value at zero of the least-squares polynomial of the first or second degree.
fn at_zero(times: &[f64], values: &[f64], degree: usize) -> Option<f64> {
    let (mut normal, mut target) = (nalgebra::Matrix3::<f64>::zeros(), nalgebra::Vector3::<f64>::zeros());
    let longest = times.last().copied()?;
    for (time, value) in times.iter().zip(values) {
        let time = time / longest;
        let row = nalgebra::Vector3::new(1.0, time, if degree > 1 { time * time } else { 0.0 });
        normal += row * row.transpose();
        target += row * *value;
    }
    if degree == 1 {
        normal[(2, 2)] = 1.0;
    }
    Some(normal.cholesky()?.solve(&target)[0])
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;
    use schuler_core::identification::Exponential;

    use super::*;

    /// A first-order process of σ = 1 in steps of 1 s, under white noise.
    fn simulate(tau_s: f64, white: f64, count: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let decay = (-1.0 / tau_s).exp();
        let mut state = normal();
        (0..count)
            .map(|_| {
                state = decay * state + (1.0 - decay * decay).sqrt() * normal();
                state + white * normal()
            })
            .collect()
    }

    /// The read-outs of many series: each has found an exponential.
    fn read_outs(
        tau_s: f64,
        white: f64,
        count: usize,
        removed: Removed,
    ) -> Vec<(PublishedFit, Exponential<f64>)> {
        (0..60)
            .map(|seed| {
                let found = published_fit(&simulate(tau_s, white, count, seed), 1.0, removed).unwrap();
                let exponential = match found.structure {
                    Structure::Exponential(fit) | Structure::ExponentialCosine(_, fit, _) => fit,
                    Structure::None => panic!("nothing found in seed {seed}"),
                };
                (found, exponential)
            })
            .collect()
    }

    fn mean_and_spread(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
        let count = values.clone().count() as f64;
        let mean = values.clone().sum::<f64>() / count;
        (mean, (values.map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt())
    }

    #[test]
    fn fil_15_the_read_out_is_unbiased_and_as_uncertain_as_its_source_says() {
        // T/τ = 100, nothing white: the spread of ln τ is 0.16, and the removed mean or line is put back.
        for removed in [Removed::Mean, Removed::Line] {
            let found = read_outs(60.0, 0.0, 6000, removed);
            let (tau, spread) = mean_and_spread(found.iter().map(|(_, fit)| (1.0 / fit.alpha / 60.0).ln()));
            let (variance, _) = mean_and_spread(found.iter().map(|(_, fit)| fit.variance));
            println!("{removed:?}: mean of ln tau {tau}, spread {spread}, variance {variance}");
            assert!(tau.abs() < 0.06 && (0.12..0.22).contains(&spread), "{tau} {spread}");
            assert!((variance - 1.0).abs() < 0.06, "{variance}");
        }
    }

    #[test]
    fn fil_15_white_noise_is_told_from_the_correlated_part() {
        // Four fifths of the variance are white, and neighbours hardly correlated.
        let found = read_outs(60.0, 2.0, 20_000, Removed::Mean);
        let (tau, _) = mean_and_spread(found.iter().map(|(_, fit)| (1.0 / fit.alpha / 60.0).ln()));
        let (variance, _) = mean_and_spread(found.iter().map(|(_, fit)| fit.variance));
        let per_step = |fit: &PublishedFit| fit.white_variance * fit.factor as f64;
        let (white, _) = mean_and_spread(found.iter().map(|(found, _)| per_step(found)));
        println!("mean of ln tau {tau}, variance {variance}, white variance per step {white}");
        assert!(found.iter().all(|(found, _)| found.factor > 1));
        assert!(tau.abs() < 0.15 && (variance - 1.0).abs() < 0.1 && (white - 4.0).abs() < 0.6);
    }

    #[test]
    fn nothing_is_read_out_of_white_noise() {
        let white = |seed| simulate(1e-9, 1.0, 5000, seed);
        let found = (0..50).filter(|&seed| published_fit(&white(seed), 1.0, Removed::Mean).is_some()).count();
        assert_eq!(found, 0);
    }
}
