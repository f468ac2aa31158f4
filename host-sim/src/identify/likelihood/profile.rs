//! The restricted likelihood of given parameters, by one pass of the filter.
use nalgebra::{Matrix2, Matrix3, SVector, Vector2, Vector3};

use super::Removed;
use super::filter::{Filter, Gain, STATES, observed};
use super::parts::Parameters;
use crate::identify::series::Blocks;

/// What one pass of the filter leaves: everything the likelihood needs.
pub(super) struct Profile {
    /// Σ ln S.
    pub(super) log_variances: f64,
    /// Σ ν²/S after generalised least squares.
    pub(super) squares: f64,
    /// Normal matrix of the constants, Σ h hᵀ/S with h the innovations of the regressors.
    pub(super) normal: Matrix2<f64>,
    /// Σ h ν/S.
    pub(super) projected: Vector2<f64>,
    pub(super) count: usize,
    pub(super) constants: usize,
}

impl Profile {
    fn contrasts(&self) -> f64 {
        (self.count - self.constants) as f64
    }

    /// Standard deviation by which a model with a white part of 1 must be multiplied.
    pub(super) fn scale(&self) -> f64 {
        (self.squares / self.contrasts()).sqrt()
    }

    fn log_determinants(&self) -> f64 {
        self.log_variances + self.normal.determinant().ln()
    }

    /// Restricted log-likelihood at the best scale.
    pub(super) fn log_likelihood(&self) -> f64 {
        let scale = (self.squares / self.contrasts() * std::f64::consts::TAU).ln() + 1.0;
        -0.5 * (self.contrasts() * scale + self.log_determinants())
    }

    /// Restricted log-likelihood at the scale of the parameters.
    pub(super) fn log_likelihood_of_scale_one(&self) -> f64 {
        -0.5 * (self.contrasts() * std::f64::consts::TAU.ln() + self.log_determinants() + self.squares)
    }
}

/// Runs the filter with `parameters` over the values and the regressors of the constants.
pub(super) fn profile(blocks: &Blocks, parameters: &Parameters, removed: Removed) -> Option<Profile> {
    let middle = middle(blocks.values.len());
    let line = removed == Removed::Line;
    let constants = if line { 2 } else { 1 };
    let mut filter = Filter::new(parameters);
    // One state each for the values, the constant and the line.
    let mut states = [SVector::<f64, STATES>::zeros(); 3];
    let used = 1 + constants;
    let (mut log_variances, mut sums, mut count) = (0.0, Matrix3::<f64>::zeros(), 0);
    let (mut inverse, mut log_variance, mut was_settled) = (0.0, 0.0, false);
    for (row, (value, &thinness)) in blocks.values.iter().zip(&blocks.thinness).enumerate() {
        let present = value.is_finite();
        let Gain { gain, variance } = filter.advance(present, thinness);
        if !(was_settled && filter.settled) {
            (inverse, log_variance) = (variance.recip(), variance.ln());
        }
        was_settled = filter.settled;
        if present {
            let mut innovations = Vector3::new(*value, 1.0, (row as f64 - middle) / middle);
            for (state, innovation) in states.iter_mut().zip(innovations.iter_mut()).take(used) {
                *innovation -= observed(state);
                *state += gain * *innovation;
            }
            sums += innovations * (innovations * inverse).transpose();
            log_variances += log_variance;
            count += 1;
        }
        for state in states.iter_mut().take(used) {
            filter.turn.apply(state);
        }
    }
    let mut normal = sums.fixed_view::<2, 2>(1, 1).into_owned();
    let mut projected = sums.fixed_view::<2, 1>(1, 0).into_owned();
    if line {
        // From the line scaled to ±1 back to a slope per step.
        let unscale = Vector2::new(1.0, middle);
        normal.component_mul_assign(&(unscale * unscale.transpose()));
        projected.component_mul_assign(&unscale);
    } else {
        // A regressor that is not used is orthogonal to everything and of length one.
        normal = Matrix2::new(normal[(0, 0)], 0.0, 0.0, 1.0);
        projected[1] = 0.0;
    }
    let explained = projected.dot(&normal.cholesky()?.solve(&projected));
    let squares = sums[(0, 0)] - explained;
    (count > constants && squares > 0.0).then_some(Profile {
        log_variances,
        squares,
        normal,
        projected,
        count,
        constants,
    })
}

pub(super) fn middle(count: usize) -> f64 {
    0.5 * count.saturating_sub(1).max(1) as f64
}
