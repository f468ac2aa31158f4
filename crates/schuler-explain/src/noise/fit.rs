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

    /// Gradient and information of the logarithms of the free parameters, where the noises are those `at`.
    ///
    /// A source at place p adds its spectrum times v_p v_pᵀ to the covariance C of the channels, so that with A = Vᵀ C⁻¹ V and
    /// B = Vᵀ C⁻¹ R C⁻¹ V a change of the spectrum by δ changes the likelihood by ½ δ (ω B_pp − K A_pp), and two by the information
    /// ½ K A_pq² δ δ′.
    fn derivatives(&self, at: &At, free: &Free) -> (DVector<f64>, DMatrix<f64>) {
        let sums = self.sums;
        let raised: Vec<Vec<f64>> =
            (free.knobs.iter()).map(|&knob| self.spectrum(&raised(&at.noises, knob))).collect();
        let (size, width) = (free.knobs.len(), sums.width() as f64);
        let (mut gradient, mut information) = (DVector::zeros(size), DMatrix::zeros(size, size));
        for (band, reach) in at.reaches.iter().enumerate() {
            let (base, count) = (sums.base[band], sums.layout.count[band]);
            let believed = if self.nu.is_infinite() { 1.0 } else { self.nu / (self.nu + count * width) };
            let weight = trust::weight(count, width, reach.quadratic, self.nu);
            let change = |i: usize| (raised[i][band] - at.spectra[free.of[i]][band]) / (base * DIFFERENCE);
            let changes: Vec<f64> = (0..size).map(change).collect();
            for i in 0..size {
                let own = free.of[i];
                gradient[i] +=
                    0.5 * changes[i] * (weight * reach.shown[(own, own)] - count * reach.between[(own, own)]);
                for j in 0..=i {
                    let both = reach.between[(own, free.of[j])];
                    information[(i, j)] += 0.5 * count * believed * changes[i] * changes[j] * both * both;
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        (gradient, information)
    }

    /// A noise's spectrum by band.
    fn spectrum(&self, noise: &Noise) -> Vec<f64> {
        let step_s = self.block.step_s();
        self.sums.layout.omega.iter().map(|&omega| noise.spectrum(omega, step_s)).collect()
    }

    /// How the sources at some places reach each band.
    fn reaches(&self, noises: &[Noise], places: &[usize]) -> Option<Vec<Reach>> {
        let (sums, block) = (self.sums, self.block);
        if sums.width() == 1 {
            let levels = levels(block, sums, noises)?;
            let of_band = |(band, level): (usize, f64)| {
                let quadratic = self.power[band][(0, 0)].max(0.0) / level;
                let through = |&index: &usize| {
                    let vector = sums.vectors.get(index).filter(|_| block.is_redundant());
                    vector.map_or_else(|| sums.through[index][band], |vector| vector[0] * vector[0])
                };
                let roots = DVector::from_iterator(
                    places.len(),
                    places.iter().map(|it| (through(it) / level).sqrt()),
                );
                let between = &roots * roots.transpose();
                Reach { ln_determinant: level.ln(), quadratic, shown: &between * quadratic, between }
            };
            return Some(levels.into_iter().enumerate().map(of_band).collect());
        }
        let covariances = Covariances::new(block, sums, noises)?;
        let quadratics = covariances.quadratics(self.power);
        let vectors: Vec<DVector<f64>> = places.iter().map(|&index| sums.vectors[index].clone()).collect();
        let vectors = DMatrix::from_columns(&vectors);
        let of_band = |(band, quadratic): (usize, f64)| {
            let whitened = &covariances.inverse[band] * &vectors;
            Reach {
                ln_determinant: covariances.ln_determinant[band],
                quadratic,
                between: vectors.tr_mul(&whitened),
                shown: whitened.tr_mul(&(&self.power[band] * &whitened)),
            }
        };
        Some(quadratics.into_iter().enumerate().map(of_band).collect())
    }

    /// Noises with how their free sources reach the bands.
    fn at(&self, noises: Vec<Noise>, free: &Free) -> Option<At> {
        let places: Vec<usize> = (free.sources.iter())
            .map(|&source| self.block.sources.iter().position(|&own| own == source))
            .collect::<Option<_>>()?;
        let reaches = self.reaches(&noises, &places)?;
        let spectra = free.sources.iter().map(|&source| self.spectrum(&noises[source])).collect();
        Some(At { log_likelihood: self.log_likelihood_of(&reaches), noises, spectra, reaches })
    }

    /// The same at other noises of the free sources.
    fn moved(&self, from: &At, noises: Vec<Noise>, free: &Free) -> Option<At> {
        let spectra: Vec<Vec<f64>> =
            free.sources.iter().map(|&source| self.spectrum(&noises[source])).collect();
        let is_one = self.sums.width() == 1;
        let of_band = |(band, reach): (usize, &Reach)| {
            let base = self.sums.base[band];
            let change = |index: usize| (spectra[index][band] - from.spectra[index][band]) / base;
            let changes = DVector::from_fn(spectra.len(), |index, _| change(index));
            if is_one { reach.moved_in_one(&changes) } else { reach.moved(&changes) }
        };
        let reaches: Vec<Reach> = from.reaches.iter().enumerate().map(of_band).collect::<Option<_>>()?;
        Some(At { log_likelihood: self.log_likelihood_of(&reaches), noises, spectra, reaches })
    }

    fn log_likelihood_of(&self, reaches: &[Reach]) -> f64 {
        let width = self.sums.width() as f64;
        let of = |(reach, &count): (&Reach, &f64)| {
            trust::of_level(count, width, reach.ln_determinant, reach.quadratic, self.nu)
        };
        reaches.iter().zip(&self.sums.layout.count).map(of).sum()
    }

    /// What any other spectrum of each source would gain at most, those of the others as they are, nats.
    ///
    /// A change δ of the spectrum of the source at place p multiplies the determinant of a band's covariance by 1/u = 1 + δ A_pp and
    /// takes (1 − u) B_pp/A_pp from its squares; what is gained is largest at the u where its derivative is zero.
    pub fn largest_gains(&self, noises: &[Noise]) -> Option<Vec<f64>> {
        let width = self.sums.width() as f64;
        let places: Vec<usize> = (0..self.block.sources.len()).collect();
        let mut gains = vec![0.0; places.len()];
        for (reach, &count) in self.reaches(noises, &places)?.iter().zip(&self.sums.layout.count) {
            let here = trust::of_level(count, width, 0.0, reach.quadratic, self.nu);
            for (index, gain) in gains.iter_mut().enumerate() {
                let shown = reach.shown[(index, index)] / reach.between[(index, index)];
                let left = (reach.quadratic - shown).max(0.0);
                let part = if self.nu.is_infinite() {
                    count / shown
                } else {
                    count * (self.nu + left) / ((self.nu + count * (width - 1.0)) * shown)
                };
                if part > 0.0 && part.is_finite() {
                    let squares = left + part * shown;
                    *gain += trust::of_level(count, width, -part.ln(), squares, self.nu) - here;
                }
            }
        }
        Some(gains)
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
        let sources = Free::new(free);
        let mut at = self.at(best, &sources)?;
        let mut information = DMatrix::zeros(free.len(), free.len());
        for _ in 0..STEPS {
            let (gradient, of_step) = self.derivatives(&at, &sources);
            information = of_step;
            let mut damped = information.clone();
            (0..free.len()).for_each(|i| damped[(i, i)] += DAMPING * damped[(i, i)] + 1e-9);
            let step = damped.cholesky()?.solve(&gradient);
            let mut scale = (LARGEST_STEP / step.amax().max(1e-12)).min(1.0);
            let mut gained = 0.0;
            for _ in 0..6 {
                let mut there = at.noises.clone();
                for ((&(source, knob), [low, high]), step) in free.iter().zip(&limits).zip(step.iter()) {
                    let value = (there[source].get(knob) * (scale * step).exp()).clamp(*low, *high);
                    there[source].set(knob, value);
                }
                let moved = self.moved(&at, there, &sources);
                if let Some(moved) = moved.filter(|moved| moved.log_likelihood > at.log_likelihood) {
                    gained = moved.log_likelihood - at.log_likelihood;
                    at = moved;
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
        Some(Fitted { noises: at.noises, log_likelihood: at.log_likelihood, sigmas, ln_cost })
    }

    /// Root mean square of the residual before it was whitened, as far as its spectrum by bands tells.
    pub fn spread(&self) -> f64 {
        let count: f64 = self.sums.layout.count.iter().sum();
        let power = self.power.iter().zip(&self.sums.base).map(|(power, base)| base * power.trace());
        (power.sum::<f64>() / (count * self.sums.width() as f64)).sqrt()
    }
}

/// The parameters that are free.
struct Free {
    knobs: Vec<SourceKnob>,
    /// Their sources, each once.
    sources: Vec<usize>,
    /// The place of each parameter's source among these.
    of: Vec<usize>,
}

impl Free {
    fn new(knobs: &[SourceKnob]) -> Self {
        let mut sources: Vec<usize> = knobs.iter().map(|(source, _)| *source).collect();
        sources.sort_unstable();
        sources.dedup();
        let of = knobs.iter().map(|(source, _)| sources.partition_point(|it| it < source)).collect();
        Self { knobs: knobs.to_vec(), sources, of }
    }
}

/// Noises with what follows from them.
struct At {
    noises: Vec<Noise>,
    /// Spectra of the free sources by band.
    spectra: Vec<Vec<f64>>,
    reaches: Vec<Reach>,
    log_likelihood: f64,
}

/// How sources reach the coefficients of a band.
struct Reach {
    /// Logarithm of the determinant of their covariance C.
    ln_determinant: f64,
    /// Their squares in its metric.
    quadratic: f64,
    /// A = Vᵀ C⁻¹ V.
    between: DMatrix<f64>,
    /// B = Vᵀ C⁻¹ R C⁻¹ V.
    shown: DMatrix<f64>,
}

impl Reach {
    /// Where the spectra of the sources change by D: with G = (I + A D)⁻¹ the determinant is divided by that of G, the squares lose
    /// tr(D G B), A becomes G A and B becomes G B Gᵀ (Woodbury). None where the covariance is singular.
    fn moved(&self, changes: &DVector<f64>) -> Option<Self> {
        let diagonal = DMatrix::from_diagonal(changes);
        let size = changes.len();
        let root = (DMatrix::identity(size, size) + &self.between * &diagonal).lu();
        let determinant = root.determinant();
        if determinant <= 0.0 {
            return None;
        }
        let inverse = root.try_inverse()?;
        let seen = &inverse * &self.shown;
        Some(Self {
            ln_determinant: self.ln_determinant + determinant.ln(),
            quadratic: (self.quadratic - (&diagonal * &seen).trace()).max(0.0),
            between: &inverse * &self.between,
            shown: seen * inverse.transpose(),
        })
    }

    /// The same of a single channel, whose variance is multiplied by 1 + Σ A_pp δ_p.
    fn moved_in_one(&self, changes: &DVector<f64>) -> Option<Self> {
        let factor = 1.0 + self.between.diagonal().dot(changes);
        (factor > 0.0).then(|| Self {
            ln_determinant: self.ln_determinant + factor.ln(),
            quadratic: self.quadratic / factor,
            between: &self.between / factor,
            shown: &self.shown / (factor * factor),
        })
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
