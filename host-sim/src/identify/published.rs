//! The published read-out of a noise structure: an autocorrelation, fitted by [`schuler_core::identification`].
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
    let white_variance = variance - coloured;
    Some(PublishedFit { factor, spacing_s, duration_s, correlation, white_variance, structure })
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
