//! The search for the maximum of the likelihood, and its curvature there.
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use nalgebra::SMatrix;

use super::Removed;
use super::parts::{MOST_PARAMETERS, Parameters, Parts};
use super::profile::profile;
use crate::identify::series::Blocks;

/// Weight of leaving the box in which the model is told from simpler ones.
const OUTSIDE_WEIGHT: f64 = 100.0;
/// Square of the distance outside the box beyond which nothing is computed.
const MOST_OUTSIDE: f64 = 4.0;
/// Negative log-likelihood of what cannot be computed.
pub(super) const IMPOSSIBLE: f64 = 1e30;
/// Side of the first simplex, in logarithms.
const SIMPLEX_SIDE: f64 = 0.5;
/// Spread of the simplex's log-likelihoods at which the search ends.
const SIMPLEX_SPREAD: f64 = 1e-4;
/// Iterations of the search for each parameter.
const MOST_ITERATIONS: u64 = 150;
/// Step of the second differences of the log-likelihood, in logarithms.
const HESSIAN_STEP: f64 = 0.03;

/// A likelihood to maximise over the logarithms of a model's shape.
pub(super) struct Problem<'v> {
    pub(super) blocks: &'v Blocks,
    pub(super) parts: Parts,
    pub(super) removed: Removed,
    pub(super) count: usize,
}

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, logs: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let outside = self.parts.outside(logs, self.count);
        // Far outside the exponentials overflow; there the penalty alone leads back.
        let inside = outside < MOST_OUTSIDE;
        let profile = inside.then(|| profile(self.blocks, &self.parts.shape(logs), self.removed)).flatten();
        let log_likelihood = profile.map_or(-IMPOSSIBLE, |profile| profile.log_likelihood());
        let log_likelihood = if log_likelihood.is_finite() { log_likelihood } else { -IMPOSSIBLE };
        Ok(OUTSIDE_WEIGHT * outside - log_likelihood)
    }
}

impl<'v> Problem<'v> {
    pub(super) fn new(blocks: &'v Blocks, parts: Parts, removed: Removed) -> Self {
        let count = blocks.values.iter().filter(|value| value.is_finite()).count();
        Self { blocks, parts, removed, count }
    }

    /// The best logarithms found from `start`, with their cost.
    pub(super) fn search(&self, start: &[f64]) -> Option<(Vec<f64>, f64)> {
        // A part of no size has no logarithm to start from.
        if !start.iter().all(|log| log.is_finite()) {
            return None;
        }
        let mut simplex = vec![start.to_vec(); start.len() + 1];
        for (axis, corner) in simplex.iter_mut().skip(1).enumerate() {
            corner[axis] += SIMPLEX_SIDE;
        }
        let solver = NelderMead::new(simplex).with_sd_tolerance(SIMPLEX_SPREAD).ok()?;
        let iterations = MOST_ITERATIONS * start.len() as u64;
        let result = Executor::new(self, solver).configure(|state| state.max_iters(iterations)).run().ok()?;
        Some((result.state.best_param?, result.state.best_cost))
    }

    /// Standard deviations of the logarithms from the curvature of the likelihood in all of them, the scale included.
    pub(super) fn log_sigmas(&self, at: &Parameters) -> Option<Parameters> {
        let log_likelihood = |logs: &[f64]| {
            let factors = self.parts.spread(logs.iter().map(|log| log.exp()));
            let moved = at.combined(&factors, |value, factor| value * factor);
            profile(self.blocks, &moved, self.removed).map(|profile| profile.log_likelihood_of_scale_one())
        };
        let size = self.parts.parameters();
        let moved = |first: usize, first_step: f64, second: usize, second_step: f64| {
            let mut steps = vec![0.0; size];
            steps[first] += first_step;
            steps[second] += second_step;
            log_likelihood(&steps)
        };
        let mut information = SMatrix::<f64, MOST_PARAMETERS, MOST_PARAMETERS>::identity();
        let h = HESSIAN_STEP;
        for row in 0..size {
            for column in 0..=row {
                let plus = moved(row, h, column, h)? + moved(row, -h, column, -h)?;
                let minus = moved(row, h, column, -h)? + moved(row, -h, column, h)?;
                let curvature = -(plus - minus) / (4.0 * h * h);
                information[(row, column)] = curvature;
                information[(column, row)] = curvature;
            }
        }
        let covariance = information.cholesky()?.inverse();
        Some(self.parts.spread((0..size).map(|row| covariance[(row, row)].sqrt())))
    }
}
