//! Covariances of the channels of a block by band, and what a band counts.
use nalgebra::DMatrix;

use super::trust;
use crate::bands::sums::Sums;
use crate::noise::Noise;
use crate::nominal::Block;

/// Covariances of the channels by band, in units of the spectrum that the record was whitened by.
#[derive(Clone)]
pub struct Covariances {
    /// Inverse by band.
    pub inverse: Vec<DMatrix<f64>>,
    /// Logarithm of the determinant by band.
    pub ln_determinant: Vec<f64>,
}

impl Covariances {
    /// Under the noises of all sources; none where a band has no noise.
    pub fn new(block: &Block, sums: &Sums, noises: &[Noise]) -> Option<Self> {
        if sums.width() == 1 {
            let levels = levels(block, sums, noises)?;
            return Some(Self {
                inverse: levels.iter().map(|level| DMatrix::from_element(1, 1, level.recip())).collect(),
                ln_determinant: levels.iter().map(|level| level.ln()).collect(),
            });
        }
        let bands = sums.layout.bands();
        let mut of = Self { inverse: Vec::with_capacity(bands), ln_determinant: Vec::with_capacity(bands) };
        for (&omega, base) in sums.layout.omega.iter().zip(&sums.base) {
            let mut covariance = DMatrix::zeros(sums.width(), sums.width());
            for (vector, &source) in sums.vectors.iter().zip(&block.sources) {
                let level = noises[source].spectrum(omega, block.step_s()) / base;
                covariance.ger(level, vector, vector, 1.0);
            }
            let root = covariance.cholesky()?;
            of.ln_determinant
                .push(2.0 * root.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>());
            of.inverse.push(root.inverse());
        }
        Some(of)
    }

    /// Squares of the coefficients by band in the metric of the covariances, of which `power` are the products.
    pub fn quadratics(&self, power: &[DMatrix<f64>]) -> Vec<f64> {
        let of = |(inverse, power): (&DMatrix<f64>, &DMatrix<f64>)| inverse.dot(power).max(0.0);
        self.inverse.iter().zip(power).map(of).collect()
    }

    /// Log-likelihood of coefficients of which `power` are the products.
    pub fn log_likelihood(&self, sums: &Sums, power: &[DMatrix<f64>], nu: f64) -> f64 {
        let width = sums.width() as f64;
        let bands = self.quadratics(power).into_iter().zip(&self.ln_determinant).zip(&sums.layout.count);
        bands
            .map(|((quadratic, ln_determinant), count)| {
                trust::log_likelihood(*count, width, *ln_determinant, quadratic, nu)
            })
            .sum()
    }

    /// What each band counts where coefficients have the products `power`.
    pub fn weights(&self, sums: &Sums, power: &[DMatrix<f64>], nu: f64) -> Weights {
        let width = sums.width() as f64;
        let bands = self.quadratics(power).into_iter().zip(&sums.layout.count).zip(&self.inverse);
        let of_channels: Vec<DMatrix<f64>> = bands
            .map(|((quadratic, count), inverse)| inverse * trust::weight(*count, width, quadratic, nu))
            .collect();
        Weights::new(sums, of_channels)
    }

    /// The same where the levels are believed.
    pub fn full_weights(&self, sums: &Sums) -> Weights {
        Weights::new(sums, self.inverse.clone())
    }
}

/// Variances of the one channel of a block by band, in units of the spectrum that the record was whitened by; none where a band
/// has no noise.
pub fn levels(block: &Block, sums: &Sums, noises: &[Noise]) -> Option<Vec<f64>> {
    let of_band = |(band, (&omega, base)): (usize, (&f64, &f64))| {
        let of = |(place, &source): (usize, &usize)| {
            let through = if block.is_redundant() {
                sums.vectors[place][0] * sums.vectors[place][0]
            } else {
                sums.through[place][band]
            };
            through * noises[source].spectrum(omega, block.step_s())
        };
        let level = block.sources.iter().enumerate().map(of).sum::<f64>() / base;
        (level > 0.0 && level.is_finite()).then_some(level)
    };
    sums.layout.omega.iter().zip(&sums.base).enumerate().map(of_band).collect()
}

/// What the bands count.
#[derive(Clone)]
pub struct Weights {
    /// Weight matrix of the channels by band.
    pub of_channels: Vec<DMatrix<f64>>,
    /// Vᵀ W V by band, of the places of sensors.
    pub of_places: Vec<DMatrix<f64>>,
    /// Vᵀ W by band.
    pub of_place_and_channel: Vec<DMatrix<f64>>,
}

impl Weights {
    fn new(sums: &Sums, of_channels: Vec<DMatrix<f64>>) -> Self {
        let vectors = DMatrix::from_columns(&sums.vectors);
        let of_place_and_channel: Vec<DMatrix<f64>> =
            of_channels.iter().map(|weight| vectors.tr_mul(weight)).collect();
        let of_places = of_place_and_channel.iter().map(|weight| weight * &vectors).collect();
        Self { of_channels, of_places, of_place_and_channel }
    }
}
