//! The parts of a model, and its parameters as a search sees them.
/// First-order Markov parts that a model may have; two make a fair piece of flicker noise.
pub const MOST_MARKOV: usize = 2;
/// Most parameters of a model.
pub(super) const MOST_PARAMETERS: usize = 5 + 2 * MOST_MARKOV;
/// Logarithm beyond which a ratio of standard deviations is as good as zero or infinite.
const MOST_LOG_RATIO: f64 = 9.0;

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
    pub(super) fn spread(self, mut values: impl Iterator<Item = f64>) -> Parameters {
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
    pub(super) fn shape(self, logs: &[f64]) -> Parameters {
        self.spread(std::iter::once(1.0).chain(logs.iter().map(|log| log.exp())))
    }

    /// The inverse of [`shape`](Self::shape), for any scale.
    pub(super) fn logs(self, parameters: &Parameters) -> Vec<f64> {
        let relative = |(kind, value): (Kind, f64)| match kind {
            Kind::Sigma | Kind::Walk => value / parameters.white,
            Kind::White | Kind::Decay | Kind::Angle => value,
        };
        self.kinds().zip(self.values(parameters)).map(|found| relative(found).ln()).skip(1).collect()
    }

    /// Square of the distance of `logs` from the box in which the parts are told from each other: decays between a
    /// tenth of the record's inverse and three a step, a cosine of at most half a turn a step.
    pub(super) fn outside(self, logs: &[f64], count: usize) -> f64 {
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
    pub(super) fn combined(&self, other: &Self, combine: impl Fn(f64, f64) -> f64) -> Self {
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
    pub(super) fn scaled(&self, scale: f64) -> Self {
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
