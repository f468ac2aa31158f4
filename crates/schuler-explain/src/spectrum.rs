//! The spectrum of a block's residuals from their whitened innovations, and Whittle's likelihood of noises.
//!
//! The periodogram is taken of innovations, which are nearly white, so that nothing leaks from strong frequencies into
//! weak ones, and is then turned back through the filter's settled transfer function. Averaged over bands of a few per
//! cent it makes a likelihood of a few hundred terms, whatever the length of the record.
use std::ops::RangeInclusive;

use nalgebra::{Complex, DMatrix, DVector, DVectorView};
use schuler_fourier::Forward;

use crate::noise::{Knob, Noise};
use crate::nominal::Block;
use crate::whiten::{Filter, Space};

/// Channels from which on derivatives are taken in closed form.
pub const SEVERAL_CHANNELS: usize = 2;
/// Width of a band as a part of its frequency.
const BAND: f64 = 0.04;

/// Whittle's likelihood where the noise of one source alone changes: S + δ t tᴴ has the determinant |S| (1 + δ a), and
/// by Sherman and Morrison's formula its inverse is known as well. A band costs a few operations, however many channels.
pub struct OneSource {
    step_s: f64,
    base: f64,
    bands: Vec<OneSourceBand>,
}

/// A band of [`OneSource`].
struct OneSourceBand {
    omega: f64,
    weight: f64,
    /// Present power of the source.
    power: f64,
    /// tᴴ S⁻¹ t.
    reach: f64,
    /// tᴴ S⁻¹ Ŝ S⁻¹ t with the estimated spectrum Ŝ.
    shown: f64,
}

/// First derivatives of a log-likelihood, and second ones of minus it.
pub struct Derivatives {
    /// The first.
    pub slopes: DVector<f64>,
    /// The second, of minus the log-likelihood.
    pub curvature: DMatrix<f64>,
}

impl Derivatives {
    /// Of nothing yet, by so many parameters.
    pub fn zeros(size: usize) -> Self {
        Self { slopes: DVector::zeros(size), curvature: DMatrix::zeros(size, size) }
    }

    /// Adds a band. Its log-likelihood has, with the sign turned, the derivatives `first` by the power of a parameter's source and `both` by
    /// those of two parameters.
    pub fn add(
        &mut self,
        powers: &PowerDerivatives,
        first: impl Fn(usize) -> f64,
        both: impl Fn(usize, usize) -> f64,
    ) {
        let PowerDerivatives { slopes, second } = powers;
        for i in 0..slopes.len() {
            for j in 0..=i {
                self.curvature[(i, j)] += slopes[i] * slopes[j] * both(i, j);
            }
            self.slopes[i] -= slopes[i] * first(i);
        }
        for &(i, j, second) in second {
            self.curvature[(i, j)] += first(i) * second;
        }
    }

    /// The same with both halves of the curvature; `None` where they are not finite.
    pub fn finished(mut self) -> Option<Self> {
        self.curvature.fill_upper_triangle_with_lower_triangle();
        let finite = self.slopes.iter().chain(self.curvature.iter()).all(|value| value.is_finite());
        finite.then_some(self)
    }
}

/// Noises beside those at which derivatives by the logarithms of some of their parameters are taken: differences are taken of the powers of
/// single sources.
pub struct Moved<'n> {
    noises: &'n [Noise],
    knobs: &'n [(usize, Knob)],
    step: f64,
    /// Each parameter moved up and down.
    single: Vec<[Noise; 2]>,
    /// Each two parameters of one source, moved both ways.
    crossed: Vec<(usize, usize, [Noise; 4])>,
}

/// Derivatives of the powers of sources at a frequency.
pub struct PowerDerivatives {
    /// By each parameter.
    pub slopes: Vec<f64>,
    /// By each two parameters of one source, the second not after the first.
    pub second: Vec<(usize, usize, f64)>,
}

impl<'n> Moved<'n> {
    /// By steps of the logarithms of `knobs`, each of a source.
    pub fn new(noises: &'n [Noise], knobs: &'n [(usize, Knob)], step: f64) -> Self {
        let moved = |moves: &[(usize, f64)]| {
            let source = moves.first().map_or(0, |&(place, _)| knobs[place].0);
            let mut noise = noises[source].clone();
            for &(place, by) in moves {
                let knob = knobs[place].1;
                noise.set(knob, noise.get(knob) * by.exp());
            }
            noise
        };
        let single = (0..knobs.len()).map(|i| [step, -step].map(|by| moved(&[(i, by)]))).collect();
        let pairs = (0..knobs.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let crossed = pairs
            .filter(|&(i, j)| knobs[i].0 == knobs[j].0)
            .map(|(i, j)| {
                let signs = [(step, step), (-step, -step), (step, -step), (-step, step)];
                (i, j, signs.map(|(by_i, by_j)| moved(&[(i, by_i), (j, by_j)])))
            })
            .collect();
        Self { noises, knobs, step, single, crossed }
    }

    /// At `omega` rad per step of `step_s`.
    pub fn at(&self, omega: f64, step_s: f64) -> PowerDerivatives {
        let power = |noise: &Noise| noise.spectrum(omega, step_s);
        let (step, squared) = (self.step, self.step * self.step);
        let powers: Vec<[f64; 2]> =
            self.single.iter().map(|both| [0, 1].map(|side| power(&both[side]))).collect();
        let slopes = powers.iter().map(|[up, down]| (up - down) / (2.0 * step)).collect();
        let own = powers.iter().enumerate().map(|(i, [up, down])| {
            (i, i, (up + down - 2.0 * power(&self.noises[self.knobs[i].0])) / squared)
        });
        let crossed = self.crossed.iter().map(|(i, j, noises)| {
            let [up, down, one, other] = [0, 1, 2, 3].map(|corner| power(&noises[corner]));
            (*i, *j, (up + down - one - other) / (4.0 * squared))
        });
        PowerDerivatives { slopes, second: own.chain(crossed).collect() }
    }
}

/// Spectrum in bands.
pub struct Spectrum {
    bands: Vec<Band>,
}

struct Band {
    /// Middle, rad a step.
    omega: f64,
    /// Number of independent frequencies.
    weight: f64,
    /// Estimate of the channels' spectrum.
    estimate: DMatrix<Complex<f64>>,
    /// Power of the whitened innovations over what it should be.
    pub excess: f64,
    /// How each source enters.
    transfer: Vec<Vec<Complex<f64>>>,
}

/// Transforms of series of so many rows, which zeros fill up to a power of two.
pub fn transforms<'v>(rows: usize, series: impl Iterator<Item = &'v [f64]>) -> Vec<Vec<Complex<f64>>> {
    let forward = Forward::new(rows.next_power_of_two());
    series.map(|values| forward.transform(values.iter().copied())).collect()
}

/// Bins of the bands of a transform of real numbers, from one on up to the highest frequency: at least so many, and so many that a band is
/// as wide as this part of its frequency.
pub fn bands(
    length: usize,
    from: usize,
    least: usize,
    width: f64,
) -> impl Iterator<Item = RangeInclusive<usize>> {
    let half = length / 2;
    let mut first = from;
    std::iter::from_fn(move || {
        let bins = least.max(1 + (width * first as f64) as usize);
        let last = (first + bins - 1).min(half.saturating_sub(1));
        let band = first..=last;
        first = last + 1;
        (!band.is_empty()).then_some(band)
    })
}

impl Spectrum {
    /// The spectrum of `block` from its `whitened` innovations under `noises`.
    pub fn new(block: &Block, filter: &Filter, noises: &[Noise], whitened: &[f64]) -> Self {
        let (rows, channels) = (block.rows(), block.channels);
        let length = rows.next_power_of_two();
        let transforms = transforms(rows, whitened.chunks_exact(rows.max(1)).take(channels));
        let present = block.count().max(1) as f64;
        let independent = rows as f64 / length as f64;
        let space = block.space(noises);
        let half = length / 2;
        let mut bands = Vec::new();
        for bins in self::bands(length, 1, 1, BAND) {
            let (first, last) = bins.into_inner();
            let number = (last - first + 1) as f64;
            let omega = std::f64::consts::PI * 0.5 * (first + last) as f64 / half as f64;
            let power = DMatrix::from_fn(channels, channels, |c, d| {
                let sum: Complex<f64> =
                    (first..=last).map(|bin| transforms[c][bin] * transforms[d][bin].conj()).sum();
                sum / (number * present)
            });
            let excess = power.trace().re / channels as f64;
            if let Some(back) = unwhitening(&space, filter, omega) {
                let estimate = &back * power * back.adjoint();
                let transfer =
                    (0..block.sources.len()).map(|place| block.noise_transfer(place, omega)).collect();
                bands.push(Band { omega, weight: number * independent, estimate, excess, transfer });
            }
        }
        Self { bands }
    }

    /// Whittle's log-likelihood of `noises`, up to a constant.
    pub fn log_likelihood(&self, block: &Block, noises: &[Noise]) -> f64 {
        let step_s = block.step_s();
        let mut sum = 0.0;
        for band in &self.bands {
            if block.channels == 1 {
                let model: f64 = (block.sources.iter().zip(&band.transfer))
                    .map(|(&source, transfer)| {
                        transfer[0].norm_sqr() * noises[source].spectrum(band.omega, step_s)
                    })
                    .sum();
                sum -= band.weight * (model.ln() + band.estimate[(0, 0)].re / model);
            } else if block.channels == 2 {
                let (mut a, mut d, mut b) = (0.0, 0.0, Complex::from(0.0));
                for (&source, transfer) in block.sources.iter().zip(&band.transfer) {
                    let power = noises[source].spectrum(band.omega, step_s);
                    a += power * transfer[0].norm_sqr();
                    d += power * transfer[1].norm_sqr();
                    b += transfer[0] * transfer[1].conj() * power;
                }
                let determinant = a * d - b.norm_sqr();
                let e = &band.estimate;
                let trace = d * e[(0, 0)].re + a * e[(1, 1)].re - 2.0 * (b * e[(1, 0)]).re;
                sum -= band.weight * (determinant.ln() + trace / determinant);
            } else {
                let model = self.model(block, band, noises);
                let Some(cholesky) = model.cholesky() else { return f64::NEG_INFINITY };
                let log_determinant: f64 =
                    cholesky.l_dirty().diagonal().iter().map(|d| 2.0 * d.re.ln()).sum();
                sum -= band.weight * (log_determinant + cholesky.solve(&band.estimate).trace().re);
            }
        }
        if sum.is_finite() { sum } else { f64::NEG_INFINITY }
    }

    /// Derivatives of Whittle's log-likelihood by the logarithms of `knobs`, each of a source, at `noises`.
    ///
    /// With M = Σ Pₛ tₛtₛᴴ, A = tₛᴴM⁻¹tᵣ and B = tₛᴴM⁻¹ŜM⁻¹tᵣ between the sources s and r of two parameters a band has
    /// ∂ᵢ(ln det M + tr M⁻¹Ŝ) = ∂ᵢP (A − B) with s = r, and
    /// ∂ᵢ∂ⱼ(ln det M + tr M⁻¹Ŝ) = ∂ᵢP ∂ⱼP (2 Re AB* − |A|²) + ∂ᵢ∂ⱼP (A − B), the last for parameters of one source: no matrix is
    /// inverted for each pair of parameters. `None` where the noises are singular.
    pub fn derivatives(
        &self,
        block: &Block,
        noises: &[Noise],
        knobs: &[(usize, Knob)],
        step: f64,
    ) -> Option<Derivatives> {
        let moved = Moved::new(noises, knobs, step);
        let places: Vec<usize> = (knobs.iter())
            .map(|(source, _)| block.sources.iter().position(|own| own == source))
            .collect::<Option<_>>()?;
        let step_s = block.step_s();
        let mut derivatives = Derivatives::zeros(knobs.len());
        for band in &self.bands {
            let enters = DMatrix::from_fn(block.channels, places.len(), |c, i| band.transfer[places[i]][c]);
            let solved = self.model(block, band, noises).cholesky()?.solve(&enters);
            let reach = enters.ad_mul(&solved);
            let shown = solved.ad_mul(&(&band.estimate * &solved));
            let first = |i: usize| band.weight * (reach[(i, i)].re - shown[(i, i)].re);
            let both = |i: usize, j: usize| {
                let (a, b) = (reach[(i, j)], shown[(i, j)]);
                band.weight * (2.0 * (a * b.conj()).re - a.norm_sqr())
            };
            derivatives.add(&moved.at(band.omega, step_s), first, both);
        }
        derivatives.finished()
    }

    /// The likelihood as it changes with the noise of `source` alone; `None` where the present noises are singular.
    pub fn one_source(&self, block: &Block, noises: &[Noise], source: usize) -> Option<OneSource> {
        let place = block.sources.iter().position(|&own| own == source)?;
        let step_s = block.step_s();
        let bands = (self.bands.iter())
            .map(|band| {
                let transfer = &band.transfer[place];
                let (reach, shown) = if block.channels == 1 {
                    let model = self.model(block, band, noises)[(0, 0)].re;
                    let reach = transfer[0].norm_sqr() / model;
                    (reach, reach * band.estimate[(0, 0)].re / model)
                } else {
                    let enters = DVector::from_column_slice(transfer);
                    let solved = self.model(block, band, noises).cholesky()?.solve(&enters);
                    (enters.dotc(&solved).re, solved.dotc(&(&band.estimate * &solved)).re)
                };
                let power = noises[source].spectrum(band.omega, step_s);
                Some(OneSourceBand { omega: band.omega, weight: band.weight, power, reach, shown })
            })
            .collect::<Option<_>>()?;
        Some(OneSource { step_s, base: self.log_likelihood(block, noises), bands })
    }

    #[expect(clippy::unused_self)]
    fn model(&self, block: &Block, band: &Band, noises: &[Noise]) -> DMatrix<Complex<f64>> {
        let mut model = DMatrix::zeros(block.channels, block.channels);
        for (&source, transfer) in block.sources.iter().zip(&band.transfer) {
            let enters = DVectorView::from_slice(transfer, block.channels);
            let power = Complex::from(noises[source].spectrum(band.omega, block.step_s()));
            model.gerc(power, &enters, &enters, Complex::from(1.0));
        }
        model
    }

    /// Frequencies, rad a step, of the `number` bands whose whitened power stands out most.
    pub fn peaks(&self, number: usize) -> Vec<f64> {
        let mut found: Vec<(f64, f64)> = (self.bands.iter())
            .map(|band| {
                let excess = band.excess;
                (band.weight * (excess - 1.0 - excess.max(1e-12).ln()) * (excess - 1.0).signum(), band.omega)
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut peaks: Vec<f64> = Vec::new();
        for (_, omega) in found {
            if peaks.len() < number && peaks.iter().all(|peak| (peak / omega).ln().abs() > 0.3) {
                peaks.push(omega);
            }
        }
        peaks
    }

    /// Bands: middle, rad a step, independent frequencies, whitened power over what it should be.
    pub fn excess(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        self.bands.iter().map(|band| (band.omega, band.weight, band.excess))
    }
}

impl OneSource {
    /// Whittle's log-likelihood with this noise of the source.
    pub fn log_likelihood(&self, noise: &Noise) -> f64 {
        let mut sum = self.base;
        for band in &self.bands {
            let change = noise.spectrum(band.omega, self.step_s) - band.power;
            let grown = 1.0 + change * band.reach;
            if grown <= 0.0 {
                return f64::NEG_INFINITY;
            }
            sum -= band.weight * (grown.ln() - change * band.shown / grown);
        }
        if sum.is_finite() { sum } else { f64::NEG_INFINITY }
    }
}

/// The transfer function from whitened innovations to the channels: (1 + H (z − Φ)⁻¹ Φ K) W⁻¹.
fn unwhitening(space: &Space, filter: &Filter, omega: f64) -> Option<DMatrix<Complex<f64>>> {
    let (n, m) = (space.states, space.channels);
    let (gain, whitening) = filter.settled();
    let complex = |rows: usize, columns: usize, values: &[f64]| {
        DMatrix::from_row_iterator(rows, columns, values.iter().map(|&value| Complex::from(value)))
    };
    let inverse = complex(m, m, &whitening).try_inverse()?;
    if n == 0 {
        return Some(inverse);
    }
    let transition = complex(n, n, &space.transition);
    let z = DMatrix::from_diagonal_element(n, n, Complex::from_polar(1.0, omega));
    let resolvent = (z - &transition).lu().solve(&(&transition * complex(n, m, &gain)))?;
    let unit = DMatrix::from_diagonal_element(m, m, Complex::from(1.0));
    Some((unit + complex(m, n, &space.seen) * resolvent) * inverse)
}
