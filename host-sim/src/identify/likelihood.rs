//! Restricted maximum likelihood of noise models: white, first-order Markov, exponential-cosine, random walk.
//!
//! y_k = a (+ b t_k) + Σ c_k + w_k + v_k with v white, c correlated parts (up to two with R(τ) = σ² e^(−α|τ|), one with
//! [FIL-16] R(τ) = σ² e^(−α|τ|) cos βτ in its two-noise form), w a random walk. The constants a, b are not states with a
//! made-up variance: the filter runs over the data and over their regressors with the same gains, and generalised least
//! squares on the innovations takes them out; the determinant of its normal matrix makes the likelihood that of the
//! data's contrasts (Harville, 1974), which is free of the bias that removing a mean or a line puts on σ and τ.
//! The scale of the noise is solved for in closed form. Missing values are predicted over; the mean of a block that is not
//! whole has more white noise.
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::series::Blocks;

/// First-order Markov parts that a model may have; two make a fair piece of flicker noise.
pub const MOST_MARKOV: usize = 2;
/// Most parameters of a model.
const MOST_PARAMETERS: usize = 5 + 2 * MOST_MARKOV;
/// States: the Markov parts, the cosine part and its quadrature, the walk.
const STATES: usize = MOST_MARKOV + 3;
const COSINE: usize = MOST_MARKOV;
const QUADRATURE: usize = MOST_MARKOV + 1;
const WALK: usize = MOST_MARKOV + 2;
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
const SIMPLEX_SPREAD: f64 = 1e-4;
/// Iterations of the search for each parameter.
const MOST_ITERATIONS: u64 = 150;
/// Step of the second differences of the log-likelihood, in logarithms.
const HESSIAN_STEP: f64 = 0.03;

/// Which parts a model has; white noise always.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// Number of first-order Markov parts, at most [`MOST_MARKOV`].
    pub markov: usize,
    /// Whether there is an exponential-cosine part.
    pub cosine: bool,
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

/// Values of the parameters of a model, in the unit of the series and steps of the series' spacing; 0 for parts that a
/// model lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parameters {
    /// White noise, 1 σ per value.
    pub white: f64,
    /// First-order Markov parts.
    pub markov: [Correlated; MOST_MARKOV],
    /// Exponential-cosine part.
    pub cosine: Correlated,
    /// Angle β of the exponential-cosine part per step.
    pub beta: f64,
    /// Random walk, 1 σ per step.
    pub walk: f64,
}

/// A correlated part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correlated {
    /// Standard deviation σ.
    pub sigma: f64,
    /// Decay α per step.
    pub alpha: f64,
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
    /// Standard deviations of the natural logarithms of the parameters; `None` where the likelihood has no maximum
    /// inside.
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

/// What a parameter is, for the box it is searched in.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    White,
    Sigma,
    Decay,
    Angle,
    Walk,
}

impl Parts {
    /// The parts with one more Markov part; `None` where a model has no room for it.
    pub fn with_markov(self) -> Option<Self> {
        (self.markov < MOST_MARKOV).then_some(Self { markov: self.markov + 1, ..self })
    }

    /// The parts with an exponential-cosine one.
    pub fn with_cosine(self) -> Option<Self> {
        (!self.cosine).then_some(Self { cosine: true, ..self })
    }

    /// The parts with a random walk.
    pub fn with_walk(self) -> Option<Self> {
        (!self.walk).then_some(Self { walk: true, ..self })
    }

    /// Number of parameters, the white part's included.
    pub fn parameters(self) -> usize {
        self.kinds().count()
    }

    fn kinds(self) -> impl Iterator<Item = Kind> {
        let markov = (0..self.markov.min(MOST_MARKOV)).flat_map(|_| [Kind::Sigma, Kind::Decay]);
        let cosine = [Kind::Sigma, Kind::Decay, Kind::Angle].into_iter().filter(move |_| self.cosine);
        let walk = std::iter::once(Kind::Walk).filter(move |_| self.walk);
        std::iter::once(Kind::White).chain(markov).chain(cosine).chain(walk)
    }

    /// Parameters from `values` in the order of [`kinds`](Self::kinds).
    fn spread(self, mut values: impl Iterator<Item = f64>) -> Parameters {
        let mut next = |used: bool| if used { values.next().unwrap_or_default() } else { 0.0 };
        let white = next(true);
        let mut correlated = |used| Correlated { sigma: next(used), alpha: next(used) };
        let markov = std::array::from_fn(|part| correlated(part < self.markov));
        let cosine = correlated(self.cosine);
        Parameters { white, markov, cosine, beta: next(self.cosine), walk: next(self.walk) }
    }

    /// The inverse of [`spread`](Self::spread).
    fn values(self, parameters: &Parameters) -> impl Iterator<Item = f64> {
        let Parameters { white, markov, cosine, beta, walk } = *parameters;
        let markov = markov.into_iter().take(self.markov).flat_map(|part| [part.sigma, part.alpha]);
        let cosine = [cosine.sigma, cosine.alpha, beta].into_iter().filter(move |_| self.cosine);
        let walk = std::iter::once(walk).filter(move |_| self.walk);
        std::iter::once(white).chain(markov).chain(cosine).chain(walk)
    }

    /// Parameters with a white part of 1 from the logarithms of the others.
    fn shape(self, logs: &[f64]) -> Parameters {
        self.spread(std::iter::once(1.0).chain(logs.iter().map(|log| log.exp())))
    }

    /// The inverse of [`shape`](Self::shape), for any scale.
    fn logs(self, parameters: &Parameters) -> Vec<f64> {
        let relative = |(kind, value): (Kind, f64)| match kind {
            Kind::Sigma | Kind::Walk => value / parameters.white,
            Kind::White | Kind::Decay | Kind::Angle => value,
        };
        self.kinds().zip(self.values(parameters)).map(|found| relative(found).ln()).skip(1).collect()
    }

    /// Square of the distance of `logs` from the box in which the parts are told from each other: decays between a
    /// tenth of the record's inverse and three a step, a cosine of at most half a turn a step.
    fn outside(self, logs: &[f64], count: usize) -> f64 {
        let longest = (10.0 * count as f64).ln();
        let beyond = |(kind, &log): (Kind, &f64)| {
            let (low, high) = match kind {
                Kind::White | Kind::Sigma => (-MOST_LOG_RATIO, MOST_LOG_RATIO),
                Kind::Decay => (-longest, 3.0_f64.ln()),
                Kind::Angle => (-longest, std::f64::consts::PI.ln()),
                Kind::Walk => (-MOST_LOG_RATIO - 0.5 * longest, MOST_LOG_RATIO),
            };
            (low - log).max(log - high).max(0.0).powi(2)
        };
        self.kinds().skip(1).zip(logs).map(beyond).sum()
    }
}

impl Parameters {
    /// Each value combined with that of `other`.
    fn combined(&self, other: &Self, combine: impl Fn(f64, f64) -> f64) -> Self {
        let part = |a: Correlated, b: Correlated| Correlated {
            sigma: combine(a.sigma, b.sigma),
            alpha: combine(a.alpha, b.alpha),
        };
        Self {
            white: combine(self.white, other.white),
            markov: std::array::from_fn(|index| part(self.markov[index], other.markov[index])),
            cosine: part(self.cosine, other.cosine),
            beta: combine(self.beta, other.beta),
            walk: combine(self.walk, other.walk),
        }
    }

    /// The same noise `scale` times as large.
    fn scaled(&self, scale: f64) -> Self {
        let part = |part: Correlated| Correlated { sigma: scale * part.sigma, ..part };
        Self {
            white: scale * self.white,
            markov: self.markov.map(part),
            cosine: part(self.cosine),
            walk: scale * self.walk,
            ..*self
        }
    }
}

impl Fit {
    /// Twice the negative log-likelihood with Schwarz's penalty: the smaller, the better.
    pub fn schwarz(&self) -> f64 {
        self.parts.parameters() as f64 * (self.count as f64).ln() - 2.0 * self.log_likelihood
    }
}

/// Fits `parts` to `blocks` from each of `starts`, and keeps the best.
///
/// `None` where there are too few values for the parameters, or the series has no spread.
pub fn fit(blocks: &Blocks, parts: Parts, removed: Removed, starts: &[Parameters]) -> Option<Fit> {
    let (offset, blocks) = blocks.centred();
    let problem = Problem::new(&blocks, parts, removed);
    if problem.count < 3 * (parts.parameters() + 2) {
        return None;
    }
    let logs = if parts.parameters() == 1 {
        Vec::new()
    } else {
        let best = starts.iter().filter_map(|start| problem.search(&parts.logs(start)));
        best.min_by(|a, b| a.1.total_cmp(&b.1))?.0
    };
    let mut shape = parts.shape(&logs);
    // Sampled, an angle beyond half a turn a step is one below it.
    shape.beta =
        std::f64::consts::PI - (std::f64::consts::PI - shape.beta.rem_euclid(std::f64::consts::TAU)).abs();
    let profile = profile(&blocks, &shape, removed)?;
    let scale = profile.scale();
    let parameters = shape.scaled(scale);
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
        count: problem.count,
    })
}

/// The `keep` best of `candidates` as starts for [`fit`].
pub fn best_starts(
    blocks: &Blocks,
    parts: Parts,
    removed: Removed,
    candidates: &[Parameters],
    keep: usize,
) -> Vec<Parameters> {
    let (_, blocks) = blocks.centred();
    let problem = Problem::new(&blocks, parts, removed);
    let cost = |candidate: &Parameters| (&problem).cost(&parts.logs(candidate)).unwrap_or(IMPOSSIBLE);
    let mut costs: Vec<(f64, Parameters)> = candidates.iter().map(|start| (cost(start), *start)).collect();
    costs.sort_by(|a, b| a.0.total_cmp(&b.0));
    costs.into_iter().take(keep).map(|(_, candidate)| candidate).collect()
}

/// Standardised innovations of `fit` over `blocks`; NaN where a value is missing.
pub fn standardised_innovations(blocks: &Blocks, fit: &Fit) -> Vec<f64> {
    let middle = middle(blocks.values.len());
    let mut filter = Filter::new(&fit.parameters);
    let mut state = SVector::<f64, STATES>::zeros();
    (blocks.values.iter().zip(&blocks.thinness))
        .enumerate()
        .map(|(row, (value, &thinness))| {
            let gain = filter.advance(value.is_finite(), thinness);
            let residual = value - fit.level.0 - fit.slope.0 * (row as f64 - middle);
            let innovation = residual - observed(&state);
            if value.is_finite() {
                state += gain.gain * innovation;
            }
            filter.turn.apply(&mut state);
            innovation / gain.variance.sqrt()
        })
        .collect()
}

/// A likelihood to maximise over the logarithms of a model's shape.
struct Problem<'v> {
    blocks: &'v Blocks,
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
        let profile = inside.then(|| profile(self.blocks, &self.parts.shape(logs), self.removed)).flatten();
        let log_likelihood = profile.map_or(-IMPOSSIBLE, |profile| profile.log_likelihood());
        let log_likelihood = if log_likelihood.is_finite() { log_likelihood } else { -IMPOSSIBLE };
        Ok(OUTSIDE_WEIGHT * outside - log_likelihood)
    }
}

impl<'v> Problem<'v> {
    fn new(blocks: &'v Blocks, parts: Parts, removed: Removed) -> Self {
        let count = blocks.values.iter().filter(|value| value.is_finite()).count();
        Self { blocks, parts, removed, count }
    }

    /// The best logarithms found from `start`, with their cost.
    fn search(&self, start: &[f64]) -> Option<(Vec<f64>, f64)> {
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
    fn log_sigmas(&self, at: &Parameters) -> Option<Parameters> {
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
fn profile(blocks: &Blocks, parameters: &Parameters, removed: Removed) -> Option<Profile> {
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

fn middle(count: usize) -> f64 {
    0.5 * count.saturating_sub(1).max(1) as f64
}

/// Gain and innovation variance of one step.
#[derive(Clone, Copy)]
struct Gain {
    gain: SVector<f64, STATES>,
    variance: f64,
}

/// What of a state is seen: the Markov parts, the cosine part without its quadrature, the walk.
fn observed(state: &SVector<f64, STATES>) -> f64 {
    state.sum() - state[QUADRATURE]
}

/// The transition of the states from one step to the next.
#[derive(Clone, Copy)]
struct Turn {
    decays: [f64; MOST_MARKOV],
    cosine: f64,
    sine: f64,
}

impl Turn {
    fn apply(&self, state: &mut SVector<f64, STATES>) {
        for (value, decay) in state.iter_mut().zip(self.decays) {
            *value *= decay;
        }
        let (cosine, quadrature) = (state[COSINE], state[QUADRATURE]);
        state[COSINE] = self.cosine * cosine - self.sine * quadrature;
        state[QUADRATURE] = self.sine * cosine + self.cosine * quadrature;
    }

    fn apply_to_covariance(&self, covariance: SMatrix<f64, STATES, STATES>) -> SMatrix<f64, STATES, STATES> {
        let columns = |mut matrix: SMatrix<f64, STATES, STATES>| {
            for mut column in matrix.column_iter_mut() {
                let mut turned = column.clone_owned();
                self.apply(&mut turned);
                column.copy_from(&turned);
            }
            matrix
        };
        columns(columns(covariance).transpose())
    }
}

/// The covariance half of the Kalman filter. It does not depend on the data; once it has settled it is not computed
/// again until a value is missing.
struct Filter {
    turn: Turn,
    /// Variances of the noise that drives the states.
    noise: SVector<f64, STATES>,
    white: f64,
    covariance: SMatrix<f64, STATES, STATES>,
    last: Gain,
    settled: bool,
}

impl Filter {
    fn new(parameters: &Parameters) -> Self {
        let Parameters { white, markov, cosine, beta, walk } = *parameters;
        let decay = |part: Correlated| (-part.alpha).exp();
        // The walk starts at zero: where it starts is the level's.
        let mut stationary = SVector::<f64, STATES>::zeros();
        let mut noise = SVector::<f64, STATES>::zeros();
        let parts = markov.into_iter().chain([cosine, cosine]);
        for ((variance, driven), part) in stationary.iter_mut().zip(noise.iter_mut()).zip(parts) {
            *variance = part.sigma * part.sigma;
            *driven = *variance * (1.0 - decay(part) * decay(part));
        }
        noise[WALK] = walk * walk;
        let (sin, cos) = beta.sin_cos();
        Self {
            turn: Turn { decays: markov.map(decay), cosine: decay(cosine) * cos, sine: decay(cosine) * sin },
            noise,
            white: white * white,
            covariance: SMatrix::from_diagonal(&stationary),
            last: Gain { gain: SVector::zeros(), variance: 0.0 },
            settled: false,
        }
    }

    /// Gain and innovation variance of this step, whose white part has `thinness` times the variance of a whole block's, and on to
    /// the next.
    fn advance(&mut self, present: bool, thinness: f64) -> Gain {
        let whole = present && thinness == 1.0;
        if self.settled && whole {
            return self.last;
        }
        let seen = self.covariance.column_sum() - self.covariance.column(QUADRATURE);
        let variance = observed(&seen) + self.white * thinness;
        let gain = Gain { gain: seen / variance, variance };
        let updated = if present { self.covariance - seen * gain.gain.transpose() } else { self.covariance };
        let mut next = self.turn.apply_to_covariance(updated);
        for (state, noise) in self.noise.iter().enumerate() {
            next[(state, state)] += noise;
        }
        let change = (next - self.covariance).amax();
        self.settled = whole && change <= SETTLED * next.amax();
        self.covariance = 0.5 * (next + next.transpose());
        self.last = gain;
        gain
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    fn whole(values: &[f64]) -> Blocks {
        Blocks::new(values, 1)
    }

    const MARKOV: Parts = Parts { markov: 1, cosine: false, walk: false };

    fn markov(white: f64, sigma: f64, alpha: f64) -> Parameters {
        let part = Correlated { sigma, alpha };
        Parameters { white, markov: [part, Correlated::default()], ..Parameters::default() }
    }

    fn simulate(parameters: &Parameters, count: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let filter = Filter::new(parameters);
        let mut state = filter.covariance.diagonal().map(|variance| variance.sqrt() * normal());
        (0..count)
            .map(|_| {
                let value = observed(&state) + parameters.white * normal();
                filter.turn.apply(&mut state);
                state += filter.noise.map(|variance| variance.sqrt() * normal());
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
            let part = |part: Correlated, beta: f64| {
                part.sigma.powi(2) * (-part.alpha * lag).exp() * (beta * lag).cos()
            };
            let markov: f64 = parameters.markov.into_iter().map(|markov| part(markov, 0.0)).sum();
            let correlated = markov + part(parameters.cosine, parameters.beta);
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
        let first = Correlated { sigma: 1.3, alpha: 0.2 };
        let second = Correlated { sigma: 0.6, alpha: 0.01 };
        for parameters in [
            markov(0.7, 0.0, 0.0),
            markov(0.7, 1.3, 0.2),
            Parameters { cosine: first, beta: 0.9, walk: 0.4, ..markov(0.2, 0.0, 0.0) },
            Parameters { markov: [first, second], cosine: first, beta: 0.3, ..markov(0.2, 0.0, 0.0) },
        ] {
            let found =
                profile(&whole(&values), &parameters, Removed::Mean).unwrap().log_likelihood_of_scale_one();
            // Harville's likelihood differs from that of orthonormal contrasts by ½ ln det(XᵀX).
            let expected = directly(&values, &parameters) - 0.5 * 8.0_f64.ln();
            assert!((found - expected).abs() < 1e-10, "{found} {expected}");
        }
    }

    #[test]
    fn a_filter_that_has_settled_computes_what_one_that_has_not_would() {
        let parameters =
            Parameters { cosine: Correlated { sigma: 0.5, alpha: 0.02 }, beta: 0.4, ..markov(1.0, 2.0, 0.1) };
        let (mut settling, mut always) = (Filter::new(&parameters), Filter::new(&parameters));
        let mut settled = 0;
        for row in 0..3000 {
            let present = row % 1000 != 999;
            settled += usize::from(settling.settled);
            always.settled = false;
            let (found, expected) = (settling.advance(present, 1.0), always.advance(present, 1.0));
            assert!((found.variance / expected.variance - 1.0).abs() < 1e-9, "row {row}");
            assert!((found.gain - expected.gain).amax() < 1e-9, "row {row}");
        }
        assert!(settled > 1000, "{settled}");
    }

    #[test]
    fn known_parameters_lie_within_their_standard_deviations() {
        let truth = markov(1.0, 0.5, 1.0 / 60.0);
        let cases = 40;
        let mut scores = [0.0; 3];
        let mut outside = 0;
        for seed in 0..cases {
            let values = simulate(&truth, 8000, seed);
            let fit = fit(&whole(&values), MARKOV, Removed::Mean, &[markov(1.0, 1.0, 0.1)]).unwrap();
            let sigmas = fit.log_sigmas.unwrap();
            let score = [
                fit.parameters.white.ln() / sigmas.white,
                (fit.parameters.markov[0].sigma / 0.5).ln() / sigmas.markov[0].sigma,
                (fit.parameters.markov[0].alpha * 60.0).ln() / sigmas.markov[0].alpha,
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
        let truth = markov(1.0, 1.0, 1.0 / 40.0);
        let cases = 60;
        let (mut level, mut slope) = (0.0, 0.0);
        for seed in 0..cases {
            let values: Vec<f64> = simulate(&truth, 3000, 100 + seed)
                .into_iter()
                .enumerate()
                .map(|(row, value)| value + 5.0 + 1e-3 * (row as f64 - 1499.5))
                .collect();
            let fit = fit(&whole(&values), MARKOV, Removed::Line, &[truth]).unwrap();
            level += ((fit.level.0 - 5.0) / fit.level.1).powi(2) / cases as f64;
            slope += ((fit.slope.0 - 1e-3) / fit.slope.1).powi(2) / cases as f64;
        }
        assert!((0.6..1.6).contains(&level) && (0.6..1.6).contains(&slope), "{level} {slope}");
    }

    /// Means of ten steps of white noise of which half are lost are as white as those of which none is.
    #[test]
    fn blocks_with_lost_rows_have_the_white_noise_of_whole_ones() {
        let values = simulate(&markov(1.0, 0.0, 0.0), 40_000, 7);
        let lost: Vec<f64> = values
            .iter()
            .enumerate()
            .map(|(row, &value)| if row * 7 % 16 < 8 { f64::NAN } else { value })
            .collect();
        let uneven: Vec<f64> = lost
            .iter()
            .enumerate()
            .map(|(row, &value)| if row / 500 % 2 == 0 { values[row] } else { value })
            .collect();
        for series in [&values, &lost, &uneven] {
            let fit = fit(&Blocks::new(series, 10), Parts::default(), Removed::Mean, &[]).unwrap();
            let sigma = fit.log_sigmas.unwrap().white;
            let off = (fit.parameters.white * 10_f64.sqrt()).ln();
            assert!(off.abs() < 3.5 * sigma, "{off} {sigma}");
        }
    }

    #[test]
    fn series_without_spread_or_values_are_not_fitted() {
        let start = markov(1.0, 1.0, 0.1);
        assert!(fit(&whole(&[1.0; 100]), MARKOV, Removed::Mean, &[start]).is_none());
        assert!(fit(&whole(&[f64::NAN; 100]), MARKOV, Removed::Line, &[start]).is_none());
        assert!(fit(&whole(&[]), MARKOV, Removed::Mean, &[start]).is_none());
    }
}
