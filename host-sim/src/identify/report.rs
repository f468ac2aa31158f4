//! What `schuler identify` says, as data: for `--json` and for plots.
//!
//! Values are in SI units; the coefficients of the Allan variance also in the units of the field.
use std::f64::consts::SQRT_2;

use schuler_core::identification::{
    Exponential, ExponentialCosine as FittedCosine, Structure as PublishedStructure,
};
use schuler_recording::unit::Unit;
use serde::Serialize;

use super::allan::AllanPoint;
use super::field_units::CoefficientNames;
use super::likelihood::{Correlated, Fit, Parameters, Removed};
use super::model_curves::autocorrelation_of;
use super::power_law::PowerLaws;
use super::published::PublishedFit;
use super::series::Subtracted;
use super::structure::NoiseStructure;
use super::trend::Trend;

/// What the key `format` says.
pub const FORMAT: &str = "schuler-identification/1";
/// Ratio of the lowest point of the Allan deviation of flicker noise to its coefficient B, √(2 ln 2/π).
const FLICKER_FLOOR: f64 = 0.664_281_770_537_2;
/// An estimate whose logarithm is less certain than this says little more than an order of magnitude.
const WEAK_LOG_SIGMA: f64 = 0.7;
/// Standard deviations of the logarithms of the published read-out's τ, α and β in units of √(1/αT), measured on
/// series without white noise; that of σ follows from the autocorrelation.
const TAU_SPREAD: f64 = 1.6;
const ALPHA_SPREAD: f64 = 1.3;
const BETA_SPREAD: f64 = 0.8;

/// The noise of every sensor of a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// [`FORMAT`].
    pub format: &'static str,
    /// Title of the case.
    pub title: String,
    /// Column of time in the table; `row` where it has none and its rows are evenly spaced.
    pub time_column: String,
    /// Nominal step, s.
    pub step_s: f64,
    /// Rows, those put in for missing steps included.
    pub rows: usize,
    /// Rows put in for missing steps.
    pub rows_in_gaps: usize,
    /// The sensors.
    pub sensors: Vec<SensorIdentification>,
    /// What the user should be told about the recording.
    pub warnings: Vec<String>,
}

/// The noise of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorIdentification {
    /// The sensor.
    pub id: String,
    /// Its column in the table.
    pub column: String,
    /// Its kind.
    pub kind: String,
    /// The SI unit of all values that name none.
    pub unit: Unit,
    /// The unit in which the case is written.
    pub written_unit: Unit,
    /// Value of one written unit in SI.
    pub written_unit_in_si: f64,
    /// Values present.
    pub present: usize,
    /// Values missing, in gaps or without them.
    pub missing: usize,
    /// Values set aside because they are far from those around them.
    pub spikes: usize,
    /// What was taken from the readings.
    pub subtracted: Subtracted,
    /// Mean and line by ordinary least squares; `None` with fewer than three values.
    pub trend: Option<Trend>,
    /// Autocorrelation about the mean.
    pub autocorrelation: AutocorrelationReport,
    /// Overlapping Allan deviation.
    pub allan: Vec<AllanReport>,
    /// Lowest point of the Allan deviation.
    pub floor: Option<Floor>,
    /// Coefficients of the five power laws.
    pub coefficients: Vec<Coefficient>,
    /// How often noise of exactly these power laws is fitted as badly as the sensor's; below 0.05 something else is
    /// in it, and the structure says more than the coefficients.
    pub power_laws_p: Option<f64>,
    /// The structure of the noise.
    pub structure: StructureReport,
}

/// Autocorrelation for lags 0, step, 2 step ….
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AutocorrelationReport {
    /// Spacing of the lags, s.
    pub step_s: f64,
    /// R_j.
    pub covariance: Vec<f64>,
    /// R_j/R_0.
    pub correlation: Vec<f64>,
    /// Pairs behind each.
    pub pairs: Vec<usize>,
    /// R_j by the chosen model, less what removing the mean takes; empty where the model has a walk or a slope, or was
    /// fitted to block means.
    pub model: Vec<f64>,
}

/// The Allan deviation at one averaging time, with what the fits say there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AllanReport {
    /// The measured point.
    #[serde(flatten)]
    pub point: AllanPoint,
    /// Deviation of the fitted power laws.
    pub power_laws: Option<f64>,
    /// Deviation of the chosen structure.
    pub structure: Option<f64>,
}

/// The lowest point of the Allan deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Floor {
    /// Averaging time, s.
    pub tau_s: f64,
    /// Deviation.
    pub deviation: f64,
    /// Bounds of its 1-σ interval.
    pub lower: f64,
    /// Bounds of its 1-σ interval.
    pub upper: f64,
    /// Deviation/0.664: the bias instability, if flicker noise makes the floor.
    pub bias_instability: f64,
    /// Whether the curve rises again behind it; otherwise the floor has not been reached and this is above it.
    pub reached: bool,
}

/// One of the five power laws of the Allan variance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coefficient {
    /// Letter in IEEE Std 952.
    pub symbol: &'static str,
    /// Name.
    pub name: &'static str,
    /// In SI units.
    pub si: Quoted,
    /// In the units of the field.
    pub field: Quoted,
}

/// A coefficient in one unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quoted {
    /// Value; `None` where the term was not found.
    pub value: Option<f64>,
    /// Standard deviation of the value.
    pub standard_deviation: Option<f64>,
    /// What it is below, with 95 % probability.
    pub below: f64,
    /// Unit.
    pub unit: &'static str,
}

/// A parameter and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard deviation; `None` where the likelihood has no maximum inside.
    pub standard_deviation: Option<f64>,
    /// Whether it says no more than an order of magnitude.
    pub weak: bool,
}

/// The structure of the noise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StructureReport {
    /// Steps averaged into one value before the models were fitted.
    pub averaged_steps: usize,
    /// What was taken out of the series: its mean or a straight line.
    pub removed: &'static str,
    /// The models, the chosen one first, the others by Schwarz's criterion.
    pub models: Vec<ModelReport>,
    /// Probability of innovations as correlated as those of the chosen model, had they been white.
    pub whiteness_p: Option<f64>,
    /// The published read-out of the autocorrelation.
    pub published: Option<PublishedReport>,
    /// The chosen model as the table `[sensor.nominal]` of a case, in the unit of the case.
    pub nominal: String,
}

/// One model of the noise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelReport {
    /// Its parts in words.
    pub name: String,
    /// White noise, 1 σ per step of the recording.
    pub white: Estimate,
    /// First-order Markov parts, by correlation time.
    pub markov: Vec<MarkovReport>,
    /// Exponential-cosine part.
    pub exp_cos: Option<ExponentialCosineReport>,
    /// Random walk, 1 σ per √s.
    pub random_walk: Option<Estimate>,
    /// Mean, or the line's value at the middle of the series.
    pub level: Estimate,
    /// Slope of the line, per second.
    pub slope_per_s: Option<Estimate>,
    /// Log-likelihood gained over white noise alone, nats.
    pub gain_nats: f64,
    /// By how much Schwarz's criterion is worse than the chosen model's.
    pub schwarz: f64,
}

/// R(τ) = σ² exp(−|τ|/tau).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MarkovReport {
    /// σ.
    pub sigma: Estimate,
    /// Correlation time, s.
    pub tau_s: Estimate,
}

/// R(τ) = σ² exp(−α|τ|) cos βτ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ExponentialCosineReport {
    /// σ.
    pub sigma: Estimate,
    /// α, 1/s.
    pub alpha: Estimate,
    /// β, rad/s.
    pub beta: Estimate,
}

/// The published read-out: an autocorrelation of block means and what was read from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PublishedReport {
    /// Steps averaged into a block.
    pub averaged_steps: usize,
    /// Spacing of the lags, s.
    pub spacing_s: f64,
    /// R_j of the correlated part.
    pub covariance: Vec<f64>,
    /// R_j of the fit.
    pub fit: Vec<f64>,
    /// White part, 1 σ per step of the recording.
    pub white: f64,
    /// First-order Markov part; also given beside an exponential-cosine one, for comparison.
    pub markov: Option<MarkovReport>,
    /// Exponential-cosine part, if the data ask for it.
    pub exp_cos: Option<ExponentialCosineReport>,
}

/// The five coefficients of `laws` under their `names`.
pub(super) fn coefficients(laws: &PowerLaws, names: &[CoefficientNames; 5]) -> Vec<Coefficient> {
    let terms = names.iter().zip(&laws.squares).zip(&laws.sigmas).zip(&laws.limits);
    terms
        .map(|(((names, square), sigma), limit)| {
            let found = *square > 0.0;
            let quoted = |unit, factor: f64| Quoted {
                value: found.then(|| square.sqrt() * factor),
                standard_deviation: found.then_some(sigma * factor),
                below: limit * factor,
                unit,
            };
            Coefficient {
                symbol: names.symbol,
                name: names.name,
                si: quoted(names.si, 1.0),
                field: quoted(names.field.name, names.field.factor),
            }
        })
        .collect()
}

/// The lowest of `points`.
pub(super) fn floor(points: &[AllanPoint]) -> Option<Floor> {
    let lowest = points.iter().min_by(|a, b| a.deviation.total_cmp(&b.deviation))?;
    let reached = points.iter().any(|point| point.factor > lowest.factor && point.lower > lowest.deviation);
    Some(Floor {
        tau_s: lowest.tau_s,
        deviation: lowest.deviation,
        lower: lowest.lower,
        upper: lowest.upper,
        bias_instability: lowest.deviation / FLICKER_FLOOR,
        reached,
    })
}

/// The structure of a sensor recorded in steps of `step_s`, whose case is written in `written_unit`.
pub(super) fn structure_report(
    structure: &NoiseStructure,
    step_s: f64,
    written_unit: Unit,
) -> StructureReport {
    let white = structure.white().map_or(f64::NAN, |fit| fit.log_likelihood);
    let best = structure.chosen().map_or(f64::NAN, Fit::schwarz);
    let model = |fit: &Fit| {
        let scales = Scales::new(structure, step_s);
        scales.model(fit, fit.log_likelihood - white, fit.schwarz() - best)
    };
    let line = structure.chosen().is_some_and(|fit| fit.removed == Removed::Line);
    let models: Vec<ModelReport> = structure.models.iter().map(model).collect();
    StructureReport {
        averaged_steps: structure.factor,
        removed: if line { "line" } else { "mean" },
        whiteness_p: Some(structure.whiteness_p).filter(|p| p.is_finite()),
        published: structure.published.as_ref().map(|fit| published_report(fit, step_s)),
        nominal: models.first().map(|model| model.nominal(written_unit)).unwrap_or_default(),
        models,
    }
}

/// From steps of the fitted values to seconds and steps of the recording.
struct Scales {
    factor: f64,
    spacing_s: f64,
}

impl Scales {
    fn new(structure: &NoiseStructure, step_s: f64) -> Self {
        let factor = structure.factor as f64;
        Self { factor, spacing_s: factor * step_s }
    }

    fn model(&self, fit: &Fit, gain_nats: f64, schwarz: f64) -> ModelReport {
        let (values, logs) = (&fit.parameters, fit.log_sigmas.as_ref());
        let estimate = |pick: fn(&Parameters) -> f64, convert: &dyn Fn(f64) -> f64| {
            let (value, log_sigma) = (convert(pick(values)), logs.map(pick));
            Estimate {
                value,
                standard_deviation: log_sigma.map(|log_sigma| value * log_sigma),
                weak: log_sigma.is_none_or(|log_sigma| log_sigma > WEAK_LOG_SIGMA),
            }
        };
        let known = |(value, sigma): (f64, f64), scale: f64| Estimate {
            value: value * scale,
            standard_deviation: Some(sigma * scale),
            weak: false,
        };
        let tau = |alpha: f64| self.spacing_s / alpha;
        let rate = |value: f64| value / self.spacing_s;
        let first = MarkovReport {
            sigma: estimate(|p| p.markov[0].sigma, &|sigma| sigma),
            tau_s: estimate(|p| p.markov[0].alpha, &tau),
        };
        let second = MarkovReport {
            sigma: estimate(|p| p.markov[1].sigma, &|sigma| sigma),
            tau_s: estimate(|p| p.markov[1].alpha, &tau),
        };
        let mut markov: Vec<MarkovReport> = [first, second].into_iter().take(fit.parts.markov).collect();
        markov.sort_by(|a, b| a.tau_s.value.total_cmp(&b.tau_s.value));
        let exp_cos = fit.parts.cosine.then(|| ExponentialCosineReport {
            sigma: estimate(|p| p.cosine.sigma, &|sigma| sigma),
            alpha: estimate(|p| p.cosine.alpha, &rate),
            beta: estimate(|p| p.beta, &rate),
        });
        let mut name = vec!["white"];
        name.extend(markov.iter().map(|_| "markov"));
        name.extend(exp_cos.iter().map(|_| "exp_cos"));
        name.extend(fit.parts.walk.then_some("random_walk"));
        ModelReport {
            name: name.join(" + "),
            white: estimate(|p| p.white, &|white| white * self.factor.sqrt()),
            markov,
            exp_cos,
            random_walk: fit.parts.walk.then(|| estimate(|p| p.walk, &|walk| walk / self.spacing_s.sqrt())),
            level: known(fit.level, 1.0),
            slope_per_s: (fit.removed == Removed::Line).then(|| known(fit.slope, 1.0 / self.spacing_s)),
            gain_nats,
            schwarz,
        }
    }
}

impl ModelReport {
    /// The model as a nominal model of a case written in `unit`: its keys, one a line. A case has room for one Markov
    /// part and one exponential-cosine part; a second Markov part is written as the latter with β = 0 where that is
    /// free, and as a comment where it is not.
    fn nominal(&self, unit: Unit) -> String {
        let written = |estimate: Estimate| rounded(estimate.value / unit.in_si());
        let mut keys = vec![format!("white = {:?}", written(self.white))];
        for (index, MarkovReport { sigma, tau_s }) in self.markov.iter().enumerate() {
            let (sigma, tau_s) = (written(*sigma), rounded(tau_s.value));
            let alpha = rounded(1.0 / tau_s);
            keys.push(match (index, self.exp_cos) {
                (0, _) => format!("markov = {{ sigma = {sigma:?}, tau_s = {tau_s:?} }}"),
                (_, None) => format!("exp_cos = {{ sigma = {sigma:?}, alpha = {alpha:?}, beta = 0.0 }}"),
                (_, Some(_)) => format!("# and a second markov = {{ sigma = {sigma:?}, tau_s = {tau_s:?} }}"),
            });
        }
        if let Some(ExponentialCosineReport { sigma, alpha, beta }) = self.exp_cos {
            let (sigma, alpha, beta) = (written(sigma), rounded(alpha.value), rounded(beta.value));
            keys.push(format!("exp_cos = {{ sigma = {sigma:?}, alpha = {alpha:?}, beta = {beta:?} }}"));
        }
        if let Some(walk) = self.random_walk {
            keys.push(format!("random_walk = {:?}", written(walk)));
        }
        keys.join("\n")
    }
}

/// Four significant digits: no noise parameter is known better.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

fn published_report(read_out: &PublishedFit, step_s: f64) -> PublishedReport {
    let PublishedFit { factor, spacing_s, duration_s, .. } = *read_out;
    let estimate = |value: f64, log_sigma: f64| Estimate {
        value,
        standard_deviation: Some(value * log_sigma),
        weak: log_sigma > WEAK_LOG_SIGMA,
    };
    let markov = |fit: &Exponential<f64>| {
        let spread = (1.0 / (fit.alpha * duration_s)).sqrt();
        MarkovReport {
            sigma: estimate(fit.variance.sqrt(), spread / SQRT_2),
            tau_s: estimate(1.0 / fit.alpha, TAU_SPREAD * spread),
        }
    };
    let cosine = |fit: &FittedCosine<f64>| {
        let spread = (1.0 / (fit.alpha * duration_s)).sqrt();
        // ∫ρ² dt over all lags = ½ (1/α + α/(α² + β²)); twice that over T is the relative variance of R₀.
        let squared = 0.5 * (1.0 / fit.alpha + fit.alpha / (fit.alpha * fit.alpha + fit.beta * fit.beta));
        ExponentialCosineReport {
            sigma: estimate(fit.variance.sqrt(), 0.5 * (2.0 * squared / duration_s).sqrt()),
            alpha: estimate(fit.alpha, ALPHA_SPREAD * spread),
            beta: estimate(fit.beta, BETA_SPREAD * spread),
        }
    };
    let (markov, exp_cos) = match &read_out.structure {
        PublishedStructure::None => (None, None),
        PublishedStructure::Exponential(fit) => (Some(markov(fit)), None),
        PublishedStructure::ExponentialCosine(fit, exponential, _) => {
            (Some(markov(exponential)), Some(cosine(fit)))
        }
    };
    let (sigma, alpha, beta) = match (&markov, &exp_cos) {
        (_, Some(fit)) => (fit.sigma.value, fit.alpha.value, fit.beta.value),
        (Some(fit), None) => (fit.sigma.value, 1.0 / fit.tau_s.value, 0.0),
        (None, None) => (0.0, 0.0, 0.0),
    };
    let cosine = Correlated { sigma, alpha: alpha * spacing_s };
    let fitted = Parameters { cosine, beta: beta * spacing_s, ..Parameters::default() };
    PublishedReport {
        averaged_steps: factor,
        spacing_s,
        covariance: read_out.correlation.clone(),
        fit: (0..read_out.correlation.len()).map(|lag| autocorrelation_of(&fitted, lag)).collect(),
        white: (read_out.white_variance.max(0.0) * spacing_s / step_s).sqrt(),
        markov,
        exp_cos,
    }
}
