//! Restricted maximum likelihood of noise models: white, first-order Markov or exponential-cosine, random walk.
//!
//! y_k = a (+ b t_k) + c_k + w_k + v_k with v white, c the correlated part (R(τ) = σ² e^(−α|τ|), or [FIL-16]
//! R(τ) = σ² e^(−α|τ|) cos βτ in its two-noise form), w a random walk. The constants a, b are not states with a made-up
//! variance: the filter runs over the data and over their regressors with the same gains, and generalised least
//! squares on the innovations takes them out; the determinant of its normal matrix makes the likelihood that of the
//! data's contrasts (Harville, 1974), which is free of the bias that removing a mean or a line puts on σ and τ.
//! The scale of the noise is solved for in closed form. Missing values are predicted over.
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

use super::series::mean;

/// Most free parameters of a model besides the scale.
const MOST_SHAPES: usize = 4;
/// Relative change of the covariance below which the filter has settled.
const SETTLED: f64 = 1e-12;
/// Logarithm beyond which a ratio of standard deviations is as good as zero or infinite.
const MOST_LOG_RATIO: f64 = 9.0;
/// Weight of leaving the box in which the model is told from simpler ones.
const OUTSIDE_WEIGHT: f64 = 100.0;
/// Square of the distance outside the box beyond which nothing is computed.
const MOST_OUTSIDE: f64 = 4.0;
/// Negative log-likelihood of what cannot be computed.
const IMPOSSIBLE: f64 = 1e30;
/// Side of the first simplex, in logarithms.
const SIMPLEX_SIDE: f64 = 0.5;
/// Spread of the simplex's log-likelihoods at which the search ends.
const SIMPLEX_SPREAD: f64 = 1e-6;
const MOST_ITERATIONS: u64 = 400;
/// Step of the second differences of the log-likelihood, in logarithms.
const HESSIAN_STEP: f64 = 0.03;

/// Which correlated part a model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correlated {
    /// None.
    None,
    /// First-order Markov.
    Markov,
    /// Exponential-cosine.
    ExponentialCosine,
}

/// Which parts a model has; white noise always.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// The correlated part.
    pub correlated: Correlated,
    /// Whether there is a random walk.
    pub walk: bool,
}

/// Which constants are taken out of the series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Removed {
    /// Its mean.
    Mean,
    /// A straight line.
    Line,
}

/// Values of the parameters of a model, in the unit of the series and steps of the series' spacing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parameters {
    /// White noise, 1 σ per value.
    pub white: f64,
    /// Correlated part, 1 σ; 0 without one.
    pub sigma: f64,
    /// Decay α per step.
    pub alpha: f64,
    /// Angle β per step; 0 for a Markov part.
    pub beta: f64,
    /// Random walk, 1 σ per step.
    pub walk: f64,
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
    /// Standard deviations of the natural logarithms of the parameters; `None` for those the model lacks and where
    /// the likelihood has no maximum inside.
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

impl Parts {
    /// Free parameters, the scale included.
    pub fn parameters(self) -> usize {
        let correlated = match self.correlated {
            Correlated::None => 0,
            Correlated::Markov => 2,
            Correlated::ExponentialCosine => 3,
        };
        1 + correlated + usize::from(self.walk)
    }

    /// Parameters from `values` of those that the parts have: white, σ, α, β, walk; 0 for the others.
    fn spread(self, mut values: impl Iterator<Item = f64>) -> Parameters {
        let mut next = |used: bool| if used { values.next().unwrap_or_default() } else { 0.0 };
        let correlated = self.correlated != Correlated::None;
        Parameters {
            white: next(true),
            sigma: next(correlated),
            alpha: next(correlated),
            beta: next(self.correlated == Correlated::ExponentialCosine),
            walk: next(self.walk),
        }
    }

    /// Parameters with a white part of 1 from the logarithms of the others.
    fn shape(self, logs: &[f64]) -> Parameters {
        self.spread(std::iter::once(1.0).chain(logs.iter().map(|log| log.exp())))
    }

    /// The inverse of [`shape`](Self::shape), for any scale.
    fn logs(self, parameters: &Parameters) -> Vec<f64> {
        let mut logs = Vec::with_capacity(MOST_SHAPES);
        if self.correlated != Correlated::None {
            logs.push((parameters.sigma / parameters.white).ln());
            logs.push(parameters.alpha.ln());
        }
        if self.correlated == Correlated::ExponentialCosine {
            logs.push(parameters.beta.ln());
        }
        if self.walk {
            logs.push((parameters.walk / parameters.white).ln());
        }
        logs
    }

    /// How far `logs` lie outside the box in which the parts are told from each other: decays between a tenth of
    /// the record's inverse and three a step, a cosine of at most half a turn a step.
    fn outside(self, logs: &[f64], count: usize) -> f64 {
        let longest = (10.0 * count as f64).ln();
        let beyond = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        let mut logs = logs.iter().copied();
        let mut next = || logs.next().unwrap_or_default();
        let mut outside = 0.0;
        if self.correlated != Correlated::None {
            outside += beyond(next(), -MOST_LOG_RATIO, MOST_LOG_RATIO).powi(2);
            outside += beyond(next(), -longest, 3.0_f64.ln()).powi(2);
        }
        if self.correlated == Correlated::ExponentialCosine {
            outside += beyond(next(), -longest, std::f64::consts::PI.ln()).powi(2);
        }
        if self.walk {
            outside += beyond(next(), -MOST_LOG_RATIO - 0.5 * longest, MOST_LOG_RATIO).powi(2);
        }
        outside
    }
}

impl Fit {
    /// Twice the negative log-likelihood with Schwarz's penalty: the smaller, the better.
    pub fn schwarz(&self) -> f64 {
        self.parts.parameters() as f64 * (self.count as f64).ln() - 2.0 * self.log_likelihood
    }
}

/// Fits `parts` to `values` (NaN = missing) from each of `starts`, and keeps the best.
///
/// `None` where there are too few values for the parameters, or the series has no spread.
pub fn fit(values: &[f64], parts: Parts, removed: Removed, starts: &[Parameters]) -> Option<Fit> {
    let count = values.iter().filter(|value| value.is_finite()).count();
    if count < 3 * (parts.parameters() + 2) {
        return None;
    }
    // About the mean: a small spread on a large level would drown in the sums of squares.
    let offset = mean(values);
    let values: Vec<f64> = values.iter().map(|value| value - offset).collect();
    let problem = Problem { values: &values, parts, removed, count };
    let logs = if parts.parameters() == 1 {
        Vec::new()
    } else {
        let best = starts.iter().filter_map(|start| problem.search(&parts.logs(start)));
        best.min_by(|a, b| a.1.total_cmp(&b.1))?.0
    };
    let shape = parts.shape(&logs);
    let profile = profile(&values, &shape, removed)?;
    let scale = profile.scale();
    let parameters =
        Parameters { white: scale, sigma: scale * shape.sigma, walk: scale * shape.walk, ..shape };
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
        count,
    })
}

/// The `keep` best of `candidates` as starts for [`fit`].
pub fn best_starts(
    values: &[f64],
    parts: Parts,
    removed: Removed,
    candidates: &[Parameters],
    keep: usize,
) -> Vec<Parameters> {
    let count = values.iter().filter(|value| value.is_finite()).count();
    let offset = mean(values);
    let values: Vec<f64> = values.iter().map(|value| value - offset).collect();
    let problem = Problem { values: &values, parts, removed, count };
    let mut costs: Vec<(f64, Parameters)> = candidates
        .iter()
        .map(|candidate| ((&problem).cost(&parts.logs(candidate)).unwrap_or(IMPOSSIBLE), *candidate))
        .collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    costs.into_iter().take(keep).map(|(_, candidate)| candidate).collect()
}

/// Standardised innovations of `fit` over `values`; NaN where a value is missing.
pub fn standardised_innovations(values: &[f64], fit: &Fit) -> Vec<f64> {
    let middle = middle(values.len());
    let mut filter = Filter::new(&fit.parameters);
    let mut state = Vector3::zeros();
    values
        .iter()
        .enumerate()
        .map(|(row, value)| {
            let gain = filter.advance(value.is_finite());
            let residual = value - fit.level.0 - fit.slope.0 * (row as f64 - middle);
            let innovation = residual - state[0] - state[2];
            if value.is_finite() {
                state += gain.gain * innovation;
            }
            state = filter.transition * state;
            innovation / gain.variance.sqrt()
        })
        .collect()
}

/// A likelihood to maximise over the logarithms of a model's shape.
struct Problem<'v> {
    values: &'v [f64],
    parts: Parts,
    removed: Removed,
    count: usize,
}

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, logs: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let outside = self.parts.outside(logs, self.count);
        // Far outside the exponentials overflow; there the penalty alone leads back.
        let inside = outside < MOST_OUTSIDE;
        let profile = inside.then(|| profile(self.values, &self.parts.shape(logs), self.removed)).flatten();
        let log_likelihood = profile.map_or(-IMPOSSIBLE, |profile| profile.log_likelihood());
        let log_likelihood = if log_likelihood.is_finite() { log_likelihood } else { -IMPOSSIBLE };
        Ok(OUTSIDE_WEIGHT * outside - log_likelihood)
    }
}

impl Problem<'_> {
    /// The best logarithms found from `start`, with their cost.
    fn search(&self, start: &[f64]) -> Option<(Vec<f64>, f64)> {
        let mut simplex = vec![start.to_vec(); start.len() + 1];
        for (axis, corner) in simplex.iter_mut().skip(1).enumerate() {
            corner[axis] += SIMPLEX_SIDE;
        }
        let solver = NelderMead::new(simplex).with_sd_tolerance(SIMPLEX_SPREAD).ok()?;
        let result =
            Executor::new(self, solver).configure(|state| state.max_iters(MOST_ITERATIONS)).run().ok()?;
        Some((result.state.best_param?, result.state.best_cost))
    }

    /// Standard deviations of the logarithms from the curvature of the likelihood in all of them, the scale included.
    fn log_sigmas(&self, at: &Parameters) -> Option<Parameters> {
        let log_likelihood = |logs: &[f64]| {
            let factors = self.parts.spread(logs.iter().map(|log| log.exp()));
            let moved = Parameters {
                white: at.white * factors.white,
                sigma: at.sigma * factors.sigma,
                alpha: at.alpha * factors.alpha,
                beta: at.beta * factors.beta,
                walk: at.walk * factors.walk,
            };
            profile(self.values, &moved, self.removed).map(|profile| profile.log_likelihood_of_scale_one())
        };
        let size = self.parts.parameters();
        let moved = |first: usize, first_step: f64, second: usize, second_step: f64| {
            let mut steps = vec![0.0; size];
            steps[first] += first_step;
            steps[second] += second_step;
            log_likelihood(&steps)
        };
        let mut information = SMatrix::<f64, { MOST_SHAPES + 1 }, { MOST_SHAPES + 1 }>::identity();
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

/// What one pass of the filter leaves: everything the likelihood needs.
struct Profile {
    /// Σ ln S.
    log_variances: f64,
    /// Σ ν²/S after generalised least squares.
    squares: f64,
    /// Normal matrix of the constants, Σ h hᵀ/S with h the innovations of the regressors.
    normal: Matrix2<f64>,
    /// Σ h ν/S.
    projected: Vector2<f64>,
    count: usize,
    constants: usize,
}

impl Profile {
    fn contrasts(&self) -> f64 {
        (self.count - self.constants) as f64
    }

    /// Standard deviation by which a model with a white part of 1 must be multiplied.
    fn scale(&self) -> f64 {
        (self.squares / self.contrasts()).sqrt()
    }

    fn log_determinants(&self) -> f64 {
        self.log_variances + self.normal.determinant().ln()
    }

    /// Restricted log-likelihood at the best scale.
    fn log_likelihood(&self) -> f64 {
        let scale = (self.squares / self.contrasts() * std::f64::consts::TAU).ln() + 1.0;
        -0.5 * (self.contrasts() * scale + self.log_determinants())
    }

    /// Restricted log-likelihood at the scale of the parameters.
    fn log_likelihood_of_scale_one(&self) -> f64 {
        -0.5 * (self.contrasts() * std::f64::consts::TAU.ln() + self.log_determinants() + self.squares)
    }
}

/// Runs the filter with `parameters` over the values and the regressors of the constants.
fn profile(values: &[f64], parameters: &Parameters, removed: Removed) -> Option<Profile> {
    let middle = middle(values.len());
    let line = removed == Removed::Line;
    let mut filter = Filter::new(parameters);
    let transition = filter.transition;
    // One column each for the values, the constant and the line.
    let mut states = Matrix3::<f64>::zeros();
    let (mut log_variances, mut sums, mut count) = (0.0, Matrix3::<f64>::zeros(), 0);
    for (row, value) in values.iter().enumerate() {
        let present = value.is_finite();
        let Gain { gain, variance } = filter.advance(present);
        if present {
            let inputs = Vector3::new(*value, 1.0, if line { (row as f64 - middle) / middle } else { 0.0 });
            let innovations = inputs - (states.row(0) + states.row(2)).transpose();
            states += gain * innovations.transpose();
            let weighted = innovations / variance;
            sums += weighted * innovations.transpose();
            log_variances += variance.ln();
            count += 1;
        }
        states = transition * states;
    }
    let constants = if line { 2 } else { 1 };
    // A regressor that is not used is orthogonal to everything and of length one.
    let mut normal = sums.fixed_view::<2, 2>(1, 1).into_owned();
    let mut projected = sums.fixed_view::<2, 1>(1, 0).into_owned();
    if line {
        // Back from the scaled line to a slope per step.
        let unscale = Vector2::new(1.0, middle);
        normal.component_mul_assign(&(unscale * unscale.transpose()));
        projected.component_mul_assign(&unscale);
    } else {
        normal[(1, 1)] = 1.0;
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

fn middle(count: usize) -> f64 {
    0.5 * count.saturating_sub(1).max(1) as f64
}

/// Gain and innovation variance of one step.
#[derive(Clone, Copy)]
struct Gain {
    gain: Vector3<f64>,
    variance: f64,
}

/// The covariance half of the Kalman filter with the states (correlated part, its quadrature, random walk). It does not
/// depend on the data; once it has settled it is not computed again until a value is missing.
struct Filter {
    transition: Matrix3<f64>,
    noise: Matrix3<f64>,
    white: f64,
    covariance: Matrix3<f64>,
    last: Gain,
    settled: bool,
}

impl Filter {
    fn new(parameters: &Parameters) -> Self {
        let Parameters { white, sigma, alpha, beta, walk } = *parameters;
        let decay = (-alpha).exp();
        let (sin, cos) = beta.sin_cos();
        let driven = sigma * sigma * (1.0 - decay * decay);
        Self {
            transition: Matrix3::new(
                decay * cos,
                -decay * sin,
                0.0, //
                decay * sin,
                decay * cos,
                0.0, //
                0.0,
                0.0,
                1.0,
            ),
            noise: Matrix3::from_diagonal(&Vector3::new(driven, driven, walk * walk)),
            white: white * white,
            // The walk starts at zero: where it starts is the level's.
            covariance: Matrix3::from_diagonal(&Vector3::new(sigma * sigma, sigma * sigma, 0.0)),
            last: Gain { gain: Vector3::zeros(), variance: 0.0 },
            settled: false,
        }
    }

    /// Gain and innovation variance of this step, and on to the next.
    fn advance(&mut self, present: bool) -> Gain {
        if self.settled && present {
            return self.last;
        }
        let observed = self.covariance.column(0) + self.covariance.column(2);
        let variance = observed[0] + observed[2] + self.white;
        let gain = Gain { gain: observed / variance, variance };
        let updated =
            if present { self.covariance - observed * gain.gain.transpose() } else { self.covariance };
        let next = self.transition * updated * self.transition.transpose() + self.noise;
        let change = (next - self.covariance).amax();
        self.settled = present && change <= SETTLED * next.amax();
        self.covariance = 0.5 * (next + next.transpose());
        self.last = gain;
        gain
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::SVector;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    const MARKOV: Parts = Parts { correlated: Correlated::Markov, walk: false };

    fn simulate(parameters: &Parameters, count: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let filter = Filter::new(parameters);
        let mut state = Vector3::new(parameters.sigma * normal(), parameters.sigma * normal(), 0.0);
        (0..count)
            .map(|_| {
                let value = state[0] + state[2] + parameters.white * normal();
                let driven = Vector3::new(normal(), normal(), normal());
                state = filter.transition * state + filter.noise.map(f64::sqrt) * driven;
                value
            })
            .collect()
    }

    /// The likelihood by its definition: contrasts of the data, their covariance matrix, its determinant and inverse.
    fn directly(values: &[f64], parameters: &Parameters) -> f64 {
        const N: usize = 8;
        const CONTRASTS: usize = N - 1;
        let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| {
            let lag = i.abs_diff(j) as f64;
            let correlated =
                parameters.sigma.powi(2) * (-parameters.alpha * lag).exp() * (parameters.beta * lag).cos();
            let walk = parameters.walk.powi(2) * i.min(j) as f64;
            correlated + walk + if i == j { parameters.white.powi(2) } else { 0.0 }
        });
        // Rows of an orthonormal basis of the contrasts: differences of each value from the mean of those before.
        let contrasts = SMatrix::<f64, CONTRASTS, N>::from_fn(|i, j| {
            let k = (i + 1) as f64;
            let size = (k * (k + 1.0)).sqrt();
            if j <= i {
                1.0 / size
            } else if j == i + 1 {
                -k / size
            } else {
                0.0
            }
        });
        let contrasted = contrasts * SVector::<f64, N>::from_iterator(values.iter().copied());
        let covariance = contrasts * covariance * contrasts.transpose();
        let cholesky = covariance.cholesky().unwrap();
        let log_determinant: f64 = 2.0 * cholesky.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let squares = contrasted.dot(&cholesky.solve(&contrasted));
        -0.5 * (CONTRASTS as f64 * std::f64::consts::TAU.ln() + log_determinant + squares)
    }

    #[test]
    fn fil_16_the_filter_gives_the_restricted_likelihood_of_the_covariance_matrix() {
        let values = [0.3, -1.2, 0.8, 2.5, 1.9, -0.4, 0.0, 1.1];
        for parameters in [
            Parameters { white: 0.7, ..Parameters::default() },
            Parameters { white: 0.7, sigma: 1.3, alpha: 0.2, ..Parameters::default() },
            Parameters { white: 0.2, sigma: 1.3, alpha: 0.2, beta: 0.9, walk: 0.4 },
        ] {
            let found = profile(&values, &parameters, Removed::Mean).unwrap().log_likelihood_of_scale_one();
            // Harville's likelihood differs from that of orthonormal contrasts by ½ ln det(XᵀX).
            let expected = directly(&values, &parameters) - 0.5 * 8.0_f64.ln();
            assert!((found - expected).abs() < 1e-10, "{found} {expected}");
        }
    }

    #[test]
    fn a_missing_value_is_as_if_it_had_not_been_recorded() {
        let mut values =
            simulate(&Parameters { white: 1.0, sigma: 2.0, alpha: 0.1, ..Parameters::default() }, 500, 1);
        let parameters = Parameters { white: 1.0, sigma: 2.0, alpha: 0.1, ..Parameters::default() };
        values[400] = f64::NAN;
        let with_gap = profile(&values, &parameters, Removed::Mean).unwrap();
        assert_eq!(with_gap.count, 499);
        // Without settling, to the same bits as far as rounding allows.
        let mut filter = Filter::new(&parameters);
        for value in &values {
            filter.settled = false;
            filter.advance(value.is_finite());
        }
        assert!(filter.covariance.iter().all(|entry| entry.is_finite()));
    }

    #[test]
    fn known_parameters_lie_within_their_standard_deviations() {
        let truth = Parameters { white: 1.0, sigma: 0.5, alpha: 1.0 / 60.0, ..Parameters::default() };
        let cases = 40;
        let mut scores = [0.0; 3];
        let mut outside = 0;
        for seed in 0..cases {
            let values = simulate(&truth, 8000, seed);
            let start = Parameters { white: 1.0, sigma: 1.0, alpha: 0.1, ..truth };
            let fit = fit(&values, MARKOV, Removed::Mean, &[start]).unwrap();
            let sigmas = fit.log_sigmas.unwrap();
            let score = [
                (fit.parameters.white / truth.white).ln() / sigmas.white,
                (fit.parameters.sigma / truth.sigma).ln() / sigmas.sigma,
                (fit.parameters.alpha / truth.alpha).ln() / sigmas.alpha,
            ];
            for (sum, score) in scores.iter_mut().zip(score) {
                *sum += score * score / f64::from(cases as u32);
                outside += u32::from(score.abs() > 3.0);
            }
        }
        println!(
            "mean squares of the standardised errors of white, sigma, alpha: {scores:?}, {outside} beyond 3"
        );
        assert!(scores.iter().all(|square| (0.5..1.8).contains(square)), "{scores:?}");
        assert!(outside <= 2);
    }

    #[test]
    fn the_level_and_slope_are_as_uncertain_as_the_noise_makes_them() {
        let truth = Parameters { white: 1.0, sigma: 1.0, alpha: 1.0 / 40.0, ..Parameters::default() };
        let cases = 60;
        let (mut level, mut slope) = (0.0, 0.0);
        for seed in 0..cases {
            let values: Vec<f64> = simulate(&truth, 3000, 100 + seed)
                .into_iter()
                .enumerate()
                .map(|(row, value)| value + 5.0 + 1e-3 * (row as f64 - 1499.5))
                .collect();
            let fit = fit(&values, MARKOV, Removed::Line, &[truth]).unwrap();
            level += ((fit.level.0 - 5.0) / fit.level.1).powi(2) / cases as f64;
            slope += ((fit.slope.0 - 1e-3) / fit.slope.1).powi(2) / cases as f64;
        }
        assert!((0.6..1.6).contains(&level) && (0.6..1.6).contains(&slope), "{level} {slope}");
    }

    #[test]
    fn series_without_spread_or_values_are_not_fitted() {
        let start = Parameters { white: 1.0, sigma: 1.0, alpha: 0.1, ..Parameters::default() };
        assert!(fit(&[1.0; 100], MARKOV, Removed::Mean, &[start]).is_none());
        assert!(fit(&[f64::NAN; 100], MARKOV, Removed::Line, &[start]).is_none());
        assert!(fit(&[], MARKOV, Removed::Mean, &[start]).is_none());
    }
}
