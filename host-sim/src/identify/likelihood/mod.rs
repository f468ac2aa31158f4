//! Restricted maximum likelihood of noise models: white, first-order Markov, exponential-cosine, random walk.
//!
//! y_k = a (+ b t_k) + Σ c_k + w_k + v_k with v white, c correlated parts (up to two with R(τ) = σ² e^(−α|τ|), one with
//! [FIL-16] R(τ) = σ² e^(−α|τ|) cos βτ in its two-noise form), w a random walk. The constants a, b are not states with a
//! made-up variance: the filter runs over the data and over their regressors with the same gains, and generalised least
//! squares on the innovations takes them out; the determinant of its normal matrix makes the likelihood that of the
//! data's contrasts (Harville, 1974), which is free of the bias that removing a mean or a line puts on σ and τ.
//! The scale of the noise is solved for in closed form. Missing values are predicted over; the mean of a block that is not
//! whole has more white noise.
use argmin::core::CostFunction;
use nalgebra::SVector;

use super::series::Blocks;

use filter::{Filter, STATES, observed};
use profile::{middle, profile};
use search::{IMPOSSIBLE, Problem};

pub use parts::{Correlated, MOST_MARKOV, Parameters, Parts};

mod filter;
mod parts;
mod profile;
mod search;
#[cfg(test)]
mod tests;

/// Which constants are taken out of the series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Removed {
    /// Its mean.
    Mean,
    /// A straight line.
    Line,
}

/// A fitted model.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Which parts it has.
    pub parts: Parts,
    /// What was taken out.
    pub removed: Removed,
    /// The parameters at the maximum.
    pub parameters: Parameters,
    /// Standard deviations of the natural logarithms of the parameters; `None` where the likelihood has no maximum
    /// inside.
    pub log_sigmas: Option<Parameters>,
    /// Restricted log-likelihood at the maximum.
    pub log_likelihood: f64,
    /// Mean, or the line's value at the middle of the series, with its standard deviation.
    pub level: (f64, f64),
    /// The line's slope per step with its standard deviation; 0 where only the mean was taken out.
    pub slope: (f64, f64),
    /// Number of values.
    pub count: usize,
}

impl Fit {
    /// Twice the negative log-likelihood with Schwarz's penalty: the smaller, the better.
    pub fn schwarz(&self) -> f64 {
        self.parts.parameters() as f64 * (self.count as f64).ln() - 2.0 * self.log_likelihood
    }
}

/// Fits `parts` to `blocks` from each of `starts`, and keeps the best.
///
/// `None` where there are too few values for the parameters, or the series has no spread.
pub fn fit(blocks: &Blocks, parts: Parts, removed: Removed, starts: &[Parameters]) -> Option<Fit> {
    let (offset, blocks) = blocks.centred();
    let problem = Problem::new(&blocks, parts, removed);
    if problem.count < 3 * (parts.parameters() + 2) {
        return None;
    }
    let logs = if parts.parameters() == 1 {
        Vec::new()
    } else {
        let best = starts.iter().filter_map(|start| problem.search(&parts.logs(start)));
        best.min_by(|a, b| a.1.total_cmp(&b.1))?.0
    };
    let mut shape = parts.shape(&logs);
    // Sampled, an angle beyond half a turn a step is one below it.
    shape.beta =
        std::f64::consts::PI - (std::f64::consts::PI - shape.beta.rem_euclid(std::f64::consts::TAU)).abs();
    let profile = profile(&blocks, &shape, removed)?;
    let scale = profile.scale();
    let parameters = shape.scaled(scale);
    let inverse = profile.normal.try_inverse()?;
    let constants = inverse * profile.projected;
    let sigma_of = |row: usize| scale * inverse[(row, row)].max(0.0).sqrt();
    let line = removed == Removed::Line;
    Some(Fit {
        parts,
        removed,
        parameters,
        log_sigmas: problem.log_sigmas(&parameters),
        log_likelihood: profile.log_likelihood(),
        level: (offset + constants[0], sigma_of(0)),
        slope: if line { (constants[1], sigma_of(1)) } else { (0.0, 0.0) },
        count: problem.count,
    })
}

/// The `keep` best of `candidates` as starts for [`fit`].
pub fn best_starts(
    blocks: &Blocks,
    parts: Parts,
    removed: Removed,
    candidates: &[Parameters],
    keep: usize,
) -> Vec<Parameters> {
    let (_, blocks) = blocks.centred();
    let problem = Problem::new(&blocks, parts, removed);
    let cost = |candidate: &Parameters| (&problem).cost(&parts.logs(candidate)).unwrap_or(IMPOSSIBLE);
    let mut costs: Vec<(f64, Parameters)> = candidates.iter().map(|start| (cost(start), *start)).collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    costs.into_iter().take(keep).map(|(_, candidate)| candidate).collect()
}

/// Standardised innovations of `fit` over `blocks`; NaN where a value is missing.
pub fn standardised_innovations(blocks: &Blocks, fit: &Fit) -> Vec<f64> {
    let middle = middle(blocks.values.len());
    let mut filter = Filter::new(&fit.parameters);
    let mut state = SVector::<f64, STATES>::zeros();
    (blocks.values.iter().zip(&blocks.thinness))
        .enumerate()
        .map(|(row, (value, &thinness))| {
            let gain = filter.advance(value.is_finite(), thinness);
            let residual = value - fit.level.0 - fit.slope.0 * (row as f64 - middle);
            let innovation = residual - observed(&state);
            if value.is_finite() {
                state += gain.gain * innovation;
            }
            filter.turn.apply(&mut state);
            innovation / gain.variance.sqrt()
        })
        .collect()
}
