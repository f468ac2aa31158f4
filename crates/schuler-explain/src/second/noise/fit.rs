//! Parameters of noise by Fisher scoring on band sums.
//!
//! The log-likelihood of a band changes with a parameter θ by ½ (ω R/S − K) ∂ln S/∂θ, of which the expected second derivative
//! is some ½ K ν/(ν + K) (∂ln S/∂θ)². Parameters are logarithms. Steps that do not gain are halved.
use nalgebra::{DMatrix, DVector};

use super::parts::{bounds, ln_range};
use super::trust;
use super::weights::{Covariances, levels};
use crate::noise::{Knob, Noise};
use crate::nominal::Block;
use crate::second::bands::sums::Sums;
use crate::second::config::Config;

/// Difference of a logarithm by which derivatives are taken.
const DIFFERENCE: f64 = 1e-3;
/// Largest step of a logarithm.
const LARGEST_STEP: f64 = 1.5;
/// Steps at most.
const STEPS: usize = 20;
/// Damping of the information, as a part of its diagonal.
const DAMPING: f64 = 1e-3;

/// A parameter of a source.
pub type SourceKnob = (usize, Knob);

/// What a block is fitted to.
pub struct Observed<'o> {
    /// The block.
    pub block: &'o Block,
    /// Its sums.
    pub sums: &'o Sums,
    /// Products of the residual channels by band.
    pub power: &'o [DMatrix<f64>],
    /// Degrees of freedom of the bands' levels.
    pub nu: f64,
}

/// Fitted parameters.
pub struct Fitted {
    /// The noises.
    pub noises: Vec<Noise>,
    /// Their log-likelihood.
    pub log_likelihood: f64,
    /// Standard deviations of the logarithms of the free parameters.
    pub sigmas: Vec<f64>,
}

impl Observed<'_> {
    /// Log-likelihood of noises, but for what does not depend on them.
    pub fn log_likelihood(&self, noises: &[Noise]) -> f64 {
        let (width, counts) = (self.sums.width() as f64, &self.sums.layout.count);
        if self.sums.width() == 1 {
            let Some(levels) = levels(self.block, self.sums, noises) else { return f64::NEG_INFINITY };
            let bands = levels.iter().zip(counts).zip(self.power);
            let of = |((level, count), power): ((&f64, &f64), &DMatrix<f64>)| {
                trust::of_level(*count, 1.0, level.ln(), power[(0, 0)].max(0.0) / level, self.nu)
            };
            return bands.map(of).sum();
        }
        let Some(it) = Covariances::new(self.block, self.sums, noises) else { return f64::NEG_INFINITY };
        let bands = it.quadratics(self.power).into_iter().zip(&it.ln_determinant).zip(counts);
        let of = |((quadratic, determinant), count): ((f64, &f64), &f64)| {
            trust::of_level(*count, width, *determinant, quadratic, self.nu)
        };
        bands.map(of).sum()
    }

    /// The derivatives of one channel.
    fn derivatives_of_one(
        &self,
        noises: &[Noise],
        free: &[SourceKnob],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let here = levels(self.block, self.sums, noises)?;
        let moved = |&knob: &SourceKnob| levels(self.block, self.sums, &raised(noises, knob));
        let moved: Vec<Vec<f64>> = free.iter().map(moved).collect::<Option<_>>()?;
        let size = free.len();
        let (mut gradient, mut information) = (DVector::zeros(size), DMatrix::zeros(size, size));
        for (band, (level, count)) in here.iter().zip(&self.sums.layout.count).enumerate() {
            let quadratic = self.power[band][(0, 0)].max(0.0) / level;
            let excess = trust::weight(*count, 1.0, quadratic, self.nu) * quadratic - count;
            let believed = if self.nu.is_infinite() { *count } else { count * self.nu / (self.nu + count) };
            for i in 0..size {
                let change = (moved[i][band] / level).ln() / DIFFERENCE;
                gradient[i] += 0.5 * excess * change;
                for j in 0..=i {
                    let other = (moved[j][band] / level).ln() / DIFFERENCE;
                    information[(i, j)] += 0.5 * believed * change * other;
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        Some((gradient, information))
    }

    /// Gradient and information of the logarithms of the free parameters.
    fn derivatives(&self, noises: &[Noise], free: &[SourceKnob]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        if self.sums.width() == 1 {
            return self.derivatives_of_one(noises, free);
        }
        let here = Covariances::new(self.block, self.sums, noises)?;
        let moved = |&knob: &SourceKnob| Covariances::new(self.block, self.sums, &raised(noises, knob));
        let moved: Vec<Covariances> = free.iter().map(moved).collect::<Option<_>>()?;
        let (size, width) = (free.len(), self.sums.width() as f64);
        let (mut gradient, mut information) = (DVector::zeros(size), DMatrix::zeros(size, size));
        for (band, quadratic) in here.quadratics(self.power).into_iter().enumerate() {
            let count = self.sums.layout.count[band];
            let believed = if self.nu.is_infinite() { 1.0 } else { self.nu / (self.nu + count * width) };
            let weight = trust::weight(count, width, quadratic, self.nu);
            let covariance = here.inverse[band].clone().try_inverse()?;
            // C ∂C⁻¹/∂θ.
            let changes: Vec<DMatrix<f64>> = (moved.iter())
                .map(|moved| &covariance * (&moved.inverse[band] - &here.inverse[band]) / DIFFERENCE)
                .collect();
            for i in 0..size {
                let change = &moved[i].inverse[band] - &here.inverse[band];
                let of_quadratic = change.dot(&self.power[band]) / DIFFERENCE;
                let of_determinant = (moved[i].ln_determinant[band] - here.ln_determinant[band]) / DIFFERENCE;
                gradient[i] -= 0.5 * (weight * of_quadratic + count * of_determinant);
                for j in 0..=i {
                    let both = changes[i].dot(&changes[j].transpose());
                    information[(i, j)] += 0.5 * count * believed * both;
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        Some((gradient, information))
    }

    /// The best noises with the parameters `free` at their best, from `noises` on; none where they are singular.
    pub fn fit(&self, noises: &[Noise], free: &[SourceKnob], tolerance: f64) -> Option<Fitted> {
        let duration_s = self.sums.rows() as f64 * self.block.step_s();
        let spread = self.spread();
        let limits: Vec<[f64; 2]> =
            free.iter().map(|&(_, knob)| bounds(knob, spread, self.block.step_s(), duration_s)).collect();
        let mut best = noises.to_vec();
        for (&(source, knob), [low, high]) in free.iter().zip(&limits) {
            let value = best[source].get(knob).clamp(*low, *high);
            best[source].set(knob, value);
        }
        let mut reached = self.log_likelihood(&best);
        let mut information = DMatrix::zeros(free.len(), free.len());
        for _ in 0..STEPS {
            let (gradient, of_step) = self.derivatives(&best, free)?;
            information = of_step;
            let mut damped = information.clone();
            (0..free.len()).for_each(|i| damped[(i, i)] += DAMPING * damped[(i, i)] + 1e-9);
            let step = damped.cholesky()?.solve(&gradient);
            let mut scale = (LARGEST_STEP / step.amax().max(1e-12)).min(1.0);
            let mut gained = 0.0;
            for _ in 0..6 {
                let mut there = best.clone();
                for ((&(source, knob), [low, high]), step) in free.iter().zip(&limits).zip(step.iter()) {
                    let value = (there[source].get(knob) * (scale * step).exp()).clamp(*low, *high);
                    there[source].set(knob, value);
                }
                let log_likelihood = self.log_likelihood(&there);
                if log_likelihood > reached {
                    gained = log_likelihood - reached;
                    (best, reached) = (there, log_likelihood);
                    break;
                }
                scale *= 0.3;
            }
            if gained < tolerance {
                break;
            }
        }
        let inverse = information.clone().try_inverse();
        let sigma = |i: usize| inverse.as_ref().map_or(f64::INFINITY, |it| it[(i, i)].max(0.0).sqrt());
        let sigmas = (0..free.len()).map(sigma).collect();
        Some(Fitted { noises: best, log_likelihood: reached, sigmas })
    }

    /// Root mean square of the residual before it was whitened, as far as its spectrum by bands tells.
    pub fn spread(&self) -> f64 {
        let count: f64 = self.sums.layout.count.iter().sum();
        let power = self.power.iter().zip(&self.sums.base).map(|(power, base)| base * power.trace());
        (power.sum::<f64>() / (count * self.sums.width() as f64)).sqrt()
    }
}

/// The noises with the logarithm of a parameter a little larger.
fn raised(noises: &[Noise], (source, knob): SourceKnob) -> Vec<Noise> {
    let mut noises = noises.to_vec();
    let value = noises[source].get(knob);
    noises[source].set(knob, value * DIFFERENCE.exp());
    noises
}

/// What the evidence loses by the parameters that are free: the logarithm of the part of their range that they are left with.
pub fn occam(fitted: &[f64], free: &[SourceKnob], block: &Block, rows: usize, config: &Config) -> f64 {
    let duration_s = rows as f64 * block.step_s();
    let of = |(sigma, &(_, knob)): (&f64, &SourceKnob)| {
        let range = ln_range(knob, block.step_s(), duration_s, config.noise_level_range);
        ((2.0 * std::f64::consts::PI).sqrt() * sigma / range).ln().min(0.0)
    };
    fitted.iter().zip(free).map(of).sum()
}
