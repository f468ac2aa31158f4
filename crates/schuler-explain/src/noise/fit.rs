//! Parameters of noise by Fisher scoring on band sums.
//!
//! The log-likelihood of a band changes with a parameter θ by ½ (ω R/S − K) ∂ln S/∂θ, of which the expected second derivative
//! is some ½ K ν/(ν + K) (∂ln S/∂θ)². Parameters are logarithms. Steps that do not gain are halved.
use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use super::parts::{bounds, ln_range};
use super::trust;
use super::weights::{Covariances, levels};
use crate::bands::sums::Sums;
use crate::noise::{Knob, Noise};
use crate::nominal::Block;

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
    /// Range of ln σ of a part before the record is seen ([`Config::noise_level_range`](crate::config::Config)).
    pub noise_level_range: f64,
}

/// Fitted parameters.
pub struct Fitted {
    /// The noises.
    pub noises: Vec<Noise>,
    /// Their log-likelihood.
    pub log_likelihood: f64,
    /// Standard deviations of the logarithms of the free parameters, by the record and their range.
    pub sigmas: Vec<f64>,
    /// What the evidence loses by their being free, nats.
    pub ln_cost: f64,
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

    /// Gradient and information of the logarithms of the free parameters.
    ///
    /// A source at place p adds its spectrum times v_p v_pᵀ to the covariance C of the channels, so that with A = Vᵀ C⁻¹ V and
    /// B = Vᵀ C⁻¹ R C⁻¹ V a change of the spectrum by δ changes the likelihood by ½ δ (ω B_pp − K A_pp), and two by the information
    /// ½ K A_pq² δ δ′.
    fn derivatives(&self, noises: &[Noise], free: &[SourceKnob]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (sums, block) = (self.sums, self.block);
        let reaches = self.reaches(noises)?;
        let place_of = |source: usize| block.sources.iter().position(|&own| own == source);
        let places: Vec<usize> = free.iter().map(|&(source, _)| place_of(source)).collect::<Option<_>>()?;
        let raised: Vec<Noise> = free.iter().map(|&knob| raised(noises, knob)).collect();
        let (size, width) = (free.len(), sums.width() as f64);
        let (mut gradient, mut information) = (DVector::zeros(size), DMatrix::zeros(size, size));
        for (band, reach) in reaches.iter().enumerate() {
            let (omega, base, count) = (sums.layout.omega[band], sums.base[band], sums.layout.count[band]);
            let believed = if self.nu.is_infinite() { 1.0 } else { self.nu / (self.nu + count * width) };
            let weight = trust::weight(count, width, reach.quadratic, self.nu);
            let change = |i: usize| {
                let here = noises[free[i].0].spectrum(omega, block.step_s());
                (raised[i].spectrum(omega, block.step_s()) - here) / (base * DIFFERENCE)
            };
            let changes: Vec<f64> = (0..size).map(change).collect();
            for i in 0..size {
                let own = places[i];
                gradient[i] += 0.5 * changes[i] * (weight * reach.shown[own] - count * reach.of(own, own));
                for j in 0..=i {
                    let both = reach.of(own, places[j]);
                    information[(i, j)] += 0.5 * count * believed * changes[i] * changes[j] * both * both;
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        Some((gradient, information))
    }

    /// How the sources reach each band.
    fn reaches(&self, noises: &[Noise]) -> Option<Vec<Reach>> {
        let (sums, block) = (self.sums, self.block);
        if sums.width() == 1 {
            let levels = levels(block, sums, noises)?;
            let of_band = |(band, level): (usize, f64)| {
                let quadratic = self.power[band][(0, 0)].max(0.0) / level;
                let through = |place: usize| {
                    let vector = sums.vectors.get(place).filter(|_| block.is_redundant());
                    vector.map_or_else(|| sums.through[place][band], |vector| vector[0] * vector[0])
                };
                let roots: Vec<f64> =
                    (0..block.sources.len()).map(|place| (through(place) / level).sqrt()).collect();
                let between = DMatrix::from_fn(roots.len(), roots.len(), |i, j| roots[i] * roots[j]);
                let shown = roots.iter().map(|root| root * root * quadratic).collect();
                Reach { quadratic, between, shown }
            };
            return Some(levels.into_iter().enumerate().map(of_band).collect());
        }
        let covariances = Covariances::new(block, sums, noises)?;
        let quadratics = covariances.quadratics(self.power);
        let vectors = DMatrix::from_columns(&sums.vectors);
        let of_band = |((inverse, quadratic), power): ((&DMatrix<f64>, f64), &DMatrix<f64>)| {
            let whitened = inverse * &vectors;
            let seen = power * &whitened;
            let shown = whitened.column_iter().zip(seen.column_iter()).map(|(a, b)| a.dot(&b)).collect();
            Reach { quadratic, between: vectors.tr_mul(&whitened), shown }
        };
        Some(covariances.inverse.iter().zip(quadratics).zip(self.power).map(of_band).collect())
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
        let ranges: Vec<f64> = free
            .iter()
            .map(|&(_, knob)| {
                ln_range(knob, self.block.step_s(), duration_s, self.noise_level_range) / (2.0 * PI).sqrt()
            })
            .collect();
        let (sigmas, ln_cost) = left_of(&information, &ranges)?;
        Some(Fitted { noises: best, log_likelihood: reached, sigmas, ln_cost })
    }

    /// Root mean square of the residual before it was whitened, as far as its spectrum by bands tells.
    pub fn spread(&self) -> f64 {
        let count: f64 = self.sums.layout.count.iter().sum();
        let power = self.power.iter().zip(&self.sums.base).map(|(power, base)| base * power.trace());
        (power.sum::<f64>() / (count * self.sums.width() as f64)).sqrt()
    }
}

/// How the sources of a block reach the coefficients of a band.
struct Reach {
    /// Squares of the coefficients in the metric of their covariance.
    quadratic: f64,
    /// Vᵀ C⁻¹ V.
    between: DMatrix<f64>,
    /// Diagonal of Vᵀ C⁻¹ R C⁻¹ V.
    shown: Vec<f64>,
}

impl Reach {
    fn of(&self, one: usize, other: usize) -> f64 {
        self.between[(one, other)]
    }
}

/// A noise with the logarithm of a parameter a little larger.
fn raised(noises: &[Noise], (source, knob): SourceKnob) -> Noise {
    let mut noise = noises[source].clone();
    noise.set(knob, noise.get(knob) * DIFFERENCE.exp());
    noise
}

/// Standard deviations that parameters are left with where a normal prior of the deviations `prior` meets `information`, and the
/// logarithm of the part of the prior's volume that is left. Parameters of which only a combination is known are free along the
/// rest of their range, and cost what that combination does.
pub fn left_of(information: &DMatrix<f64>, prior: &[f64]) -> Option<(Vec<f64>, f64)> {
    let in_units = DMatrix::from_fn(prior.len(), prior.len(), |i, j| {
        f64::from(u8::from(i == j)) + prior[i] * information[(i, j)] * prior[j]
    });
    let root = in_units.cholesky()?;
    let ln_part = -root.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>();
    let covariance = root.inverse();
    let sigmas = prior.iter().enumerate().map(|(i, prior)| prior * covariance[(i, i)].sqrt()).collect();
    Some((sigmas, ln_part))
}
