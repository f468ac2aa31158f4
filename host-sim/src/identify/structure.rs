//! The structure of a sensor's noise: white, with a first-order Markov or exponential-cosine part, with a random walk.
//!
//! Each of the six models is fitted by restricted maximum likelihood from the published read-out and from a coarse scan;
//! Schwarz's criterion chooses. The mean is taken out of the series; a straight line is, where its slope is three of its
//! standard deviations under the model chosen without it.
use schuler_core::identification::Structure as PublishedStructure;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::autocorrelation::{Centre, autocorrelation};
use super::likelihood::{
    Correlated, Fit, Parameters, Parts, Removed, best_starts, fit, standardised_innovations,
};
use super::published::{PublishedFit, published_fit};
use super::series::block_means;

/// Longer series are averaged over blocks before they are fitted.
const MOST_VALUES: usize = 20_000;
/// A line is taken out of the series if its slope is this many of its standard deviations.
const LINE_SIGMAS: f64 = 3.0;
/// Starts kept of a scan.
const STARTS: usize = 2;
/// Lags of the test for whiteness.
const WHITENESS_LAGS: usize = 40;

/// The structure of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseStructure {
    /// Steps averaged into one value before fitting.
    pub factor: usize,
    /// Spacing of the fitted values, s.
    pub spacing_s: f64,
    /// The published read-out; `None` where nothing stands out of white noise.
    pub published: Option<PublishedFit>,
    /// All models fitted, the chosen one first, the others by Schwarz's criterion.
    pub models: Vec<Fit>,
    /// Probability of innovations as correlated as those of the chosen model, had they been white (Ljung–Box).
    pub whiteness_p: f64,
}

impl NoiseStructure {
    /// The model chosen.
    pub fn chosen(&self) -> Option<&Fit> {
        self.models.first()
    }

    /// The model with white noise alone.
    pub fn white(&self) -> Option<&Fit> {
        self.models.iter().find(|fit| fit.parts == WHITE)
    }
}

const WHITE: Parts = Parts { correlated: Correlated::None, walk: false };
const WALK: Parts = Parts { correlated: Correlated::None, walk: true };

/// The structure of the noise in `values` (NaN = missing); without models where there are too few of them.
pub fn noise_structure(values: &[f64], step_s: f64) -> NoiseStructure {
    let factor = values.len().div_ceil(MOST_VALUES).max(1);
    let spacing_s = factor as f64 * step_s;
    let blocks = block_means(values, factor);
    let about = |removed| {
        let published = published_fit(values, step_s, removed);
        let models = all_models(&blocks, spacing_s, removed, published.as_ref());
        (published, models)
    };
    let (mut published, mut models) = about(Removed::Mean);
    let sloped = models.first().and_then(|best| fit(&blocks, best.parts, Removed::Line, &[best.parameters]));
    if sloped.is_some_and(|fit| fit.slope.0.abs() > LINE_SIGMAS * fit.slope.1) {
        (published, models) = about(Removed::Line);
    }
    let whiteness_p = models.first().map_or(f64::NAN, |best| whiteness(&blocks, best));
    NoiseStructure { factor, spacing_s, published, models, whiteness_p }
}

/// Every model that can be fitted, best first.
fn all_models(
    values: &[f64],
    spacing_s: f64,
    removed: Removed,
    published: Option<&PublishedFit>,
) -> Vec<Fit> {
    let read_out = published.and_then(|published| parameters_of(published, spacing_s));
    let fitted = |parts: Parts, candidates: &[Parameters]| {
        fit(values, parts, removed, &best_starts(values, parts, removed, candidates, STARTS))
    };
    let white = fit(values, WHITE, removed, &[]);
    let walk = fitted(WALK, &scan_walk());
    let mut models: Vec<Option<Fit>> = vec![white, walk.clone()];
    for (correlated, scan) in [
        (Correlated::Markov, scan_markov(values.len())),
        (Correlated::ExponentialCosine, scan_exponential_cosine(values.len())),
    ] {
        let usable = |start: &Parameters| correlated == Correlated::Markov || start.beta > 0.0;
        let mut candidates = scan;
        candidates.extend(read_out.filter(usable));
        let alone = fitted(Parts { correlated, walk: false }, &candidates);
        // Beside a walk: what was found alone with a weak walk, and what the walk leaves with a weak correlated part.
        let mut beside: Vec<Parameters> = Vec::new();
        if let Some(alone) = &alone {
            beside.extend(
                [1e-4, 1e-3, 1e-2, 1e-1]
                    .map(|ratio| Parameters { walk: ratio * alone.parameters.white, ..alone.parameters }),
            );
        }
        if let Some(walk) = &walk {
            let ratio = walk.parameters.walk / walk.parameters.white;
            beside.extend(candidates.iter().map(|start| Parameters { walk: ratio * start.white, ..*start }));
        }
        models.push(fitted(Parts { correlated, walk: true }, &beside));
        models.push(alone);
    }
    let mut models: Vec<Fit> = models.into_iter().flatten().collect();
    models.sort_by(|a, b| a.schwarz().total_cmp(&b.schwarz()));
    models
}

/// Starts relative to a white part of 1, in steps: logarithms one factor of four apart.
fn powers(count: i32, base: f64) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |power| base.powi(power))
}

fn decays(count: usize) -> Vec<f64> {
    powers(16, 4.0).map(|steps| 0.5 / steps).take_while(|alpha| *alpha > 3.0 / count as f64).collect()
}

fn scan_walk() -> Vec<Parameters> {
    powers(8, 0.25).map(|walk| Parameters { white: 1.0, walk, ..Parameters::default() }).collect()
}

fn scan_markov(count: usize) -> Vec<Parameters> {
    let ratios = powers(6, 4.0).map(|ratio| 0.03 * ratio);
    decays(count)
        .into_iter()
        .flat_map(|alpha| {
            ratios.clone().map(move |sigma| Parameters { white: 1.0, sigma, alpha, ..Parameters::default() })
        })
        .collect()
}

fn scan_exponential_cosine(count: usize) -> Vec<Parameters> {
    let ratios = powers(5, 4.0).map(|ratio| 0.06 * ratio);
    decays(count)
        .into_iter()
        .flat_map(|alpha| [0.7, 2.0, 6.0, 18.0].map(|turns| (alpha, turns * alpha)))
        .filter(|(_, beta)| *beta < std::f64::consts::PI)
        .flat_map(|(alpha, beta)| {
            ratios.clone().map(move |sigma| Parameters { white: 1.0, sigma, alpha, beta, walk: 0.0 })
        })
        .collect()
}

/// The published read-out as a start, in steps of the fitted values.
fn parameters_of(published: &PublishedFit, spacing_s: f64) -> Option<Parameters> {
    let (variance, alpha, beta) = match &published.structure {
        PublishedStructure::None => return None,
        PublishedStructure::Exponential(fit) => (fit.variance, fit.alpha, 0.0),
        PublishedStructure::ExponentialCosine(fit, ..) => (fit.variance, fit.alpha, fit.beta),
    };
    // The white part of a block, brought to the spacing of the fitted values; a little where none was found.
    let white = (published.white_variance * published.spacing_s / spacing_s).sqrt();
    let sigma = variance.sqrt();
    Some(Parameters {
        white: white.max(0.01 * sigma),
        sigma,
        alpha: alpha * spacing_s,
        beta: beta * spacing_s,
        walk: 0.0,
    })
}

/// p-value of the Ljung–Box statistic of the standardised innovations.
fn whiteness(values: &[f64], fit: &Fit) -> f64 {
    let innovations = standardised_innovations(values, fit);
    let lags = WHITENESS_LAGS.min(innovations.len() / 5);
    let found = autocorrelation(&innovations, lags, Centre::Zero);
    let Some((&variance, lagged)) = found.values.split_first() else { return f64::NAN };
    let count = fit.count as f64;
    let statistic: f64 = lagged
        .iter()
        .zip(found.pairs.iter().skip(1))
        .map(|(covariance, &pairs)| (covariance / variance).powi(2) * pairs as f64)
        .sum::<f64>()
        * (count + 2.0)
        / count;
    let degrees = lagged.len().saturating_sub(fit.parts.parameters() - 1);
    ChiSquared::new(degrees as f64).map_or(f64::NAN, |distribution| distribution.sf(statistic))
}
