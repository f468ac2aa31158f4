//! The noise of one source: its parts, its parameters one by one, its state-space form and its spectrum.
//!
//! Parts: white; known rounding of the output (variance step²/12); first-order Markov, R(τ) = σ² exp(−|τ|/τ_c);
//! exponential-cosine, R(τ) = σ² exp(−α|τ|) cos βτ, in its two-noise form [FIL-16]; random walk; flicker as Markov
//! parts of one level; differenced rounding of an angle. Everything in SI units of the source.
use schuler_recording::case::{ExponentialCosine, Markov, Nominal};

/// Markov parts of which flicker is made: with fewer over a long record its spectrum has steps that a Markov part fills.
pub const FLICKER_PARTS: usize = 6;

/// The noise of a source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Noise {
    /// White, 1 σ per sample.
    pub white: f64,
    /// Known step of the output; its rounding counts as white noise.
    pub rounding: f64,
    /// First-order Markov parts.
    pub markov: Vec<Markov>,
    /// Exponential-cosine parts.
    pub exp_cos: Vec<ExponentialCosine>,
    /// Random walk, 1 σ per √s.
    pub random_walk: f64,
    /// Flicker.
    pub flicker: Flicker,
    /// Rounding of the angle whose difference is the output, 1 σ of one rounding, per step.
    pub angle: f64,
    /// Another white level in part of the rows.
    pub step: Option<VarianceStep>,
}

/// Flicker noise as Markov parts of one level whose correlation times are spread over the record.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flicker {
    /// Standard deviation of each part.
    pub sigma: f64,
    /// Shortest and longest correlation time, s.
    pub tau_s: [f64; 2],
}

/// Another white level in part of the rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceStep {
    /// The rows that have it.
    pub rows: RowsOfLevel,
    /// Their part of all.
    pub part: f64,
    /// Its standard deviation over that of the others.
    pub ratio: f64,
}

/// Rows that have another white level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowsOfLevel {
    /// A row and all that come after it.
    From(usize),
    /// Those in which a quantity of [`Block::loudness`](crate::nominal::Block::loudness) is larger.
    Above {
        /// The quantity's place.
        quantity: usize,
        /// What it exceeds.
        value: f64,
    },
}

/// One parameter of a noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Knob {
    /// White level.
    White,
    /// σ of a Markov part.
    MarkovSigma(usize),
    /// τ of a Markov part.
    MarkovTau(usize),
    /// σ of an exponential-cosine part.
    CosineSigma(usize),
    /// α of an exponential-cosine part.
    CosineAlpha(usize),
    /// β of an exponential-cosine part.
    CosineBeta(usize),
    /// Random walk.
    RandomWalk,
    /// Level of flicker.
    Flicker,
    /// Rounding of an angle.
    Angle,
    /// Ratio of a change of the white level.
    StepRatio,
}

impl Knob {
    /// Name in the answer's parameters, and the power of seconds by which its unit is multiplied (unit of the sensor
    /// where `None`).
    pub fn name(self) -> (&'static str, &'static str) {
        match self {
            Self::White => ("sigma", "white"),
            Self::MarkovSigma(_) => ("sigma", "markov.sigma"),
            Self::MarkovTau(_) => ("tau_s", "markov.tau_s"),
            Self::CosineSigma(_) => ("sigma", "exp_cos.sigma"),
            Self::CosineAlpha(_) => ("alpha", "exp_cos.alpha"),
            Self::CosineBeta(_) => ("beta", "exp_cos.beta"),
            Self::RandomWalk => ("coefficient", "random_walk"),
            Self::Flicker => ("sigma", "flicker.sigma"),
            Self::Angle => ("sigma", "angle_quantisation.sigma"),
            Self::StepRatio => ("ratio", "white.ratio"),
        }
    }

    /// Whether its unit is the sensor's.
    pub fn in_sensor_unit(self) -> bool {
        !matches!(self, Self::MarkovTau(_) | Self::CosineAlpha(_) | Self::CosineBeta(_) | Self::StepRatio)
    }

    /// Unit where it is not the sensor's, or what follows the sensor's.
    pub fn unit(self) -> &'static str {
        match self {
            Self::MarkovTau(_) => "s",
            Self::CosineAlpha(_) => "1/s",
            Self::CosineBeta(_) => "rad/s",
            Self::StepRatio => "1",
            Self::RandomWalk => "/sqrt(s)",
            _ => "",
        }
    }
}

impl Noise {
    /// What a case says of a sensor.
    pub fn nominal(nominal: &Nominal, rounding: f64) -> Self {
        Self {
            white: nominal.white,
            rounding,
            markov: nominal.markov.into_iter().filter(|part| part.sigma > 0.0).collect(),
            exp_cos: nominal.exp_cos.into_iter().filter(|part| part.sigma > 0.0).collect(),
            random_walk: nominal.random_walk,
            ..Self::default()
        }
    }

    /// The noise of readings that are this factor times as large. The step of the output stays: it is seen in the readings themselves.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        let levels =
            [&mut scaled.white, &mut scaled.random_walk, &mut scaled.angle, &mut scaled.flicker.sigma];
        let markov = scaled.markov.iter_mut().map(|part| &mut part.sigma);
        let cosine = scaled.exp_cos.iter_mut().map(|part| &mut part.sigma);
        levels.into_iter().chain(markov).chain(cosine).for_each(|level| *level *= factor);
        scaled
    }

    /// Whether there is none at all.
    pub fn is_none(&self) -> bool {
        self.white == 0.0
            && self.rounding == 0.0
            && self.markov.is_empty()
            && self.exp_cos.is_empty()
            && self.random_walk == 0.0
            && self.angle == 0.0
            && self.flicker.sigma == 0.0
    }

    /// Variance of what is white from sample to sample.
    pub fn white_variance(&self) -> f64 {
        self.white * self.white + self.rounding * self.rounding / 12.0
    }

    /// Variance of all but a random walk, of which it grows.
    pub fn bounded_variance(&self) -> f64 {
        let markov = self.all_markov().map(|part| part.sigma);
        let sigmas = markov.chain(self.exp_cos.iter().map(|part| part.sigma));
        self.white_variance() + sigmas.map(|sigma| sigma * sigma).sum::<f64>()
    }

    /// The Markov parts, those of flicker included.
    fn all_markov(&self) -> impl Iterator<Item = Markov> + '_ {
        let Flicker { sigma, tau_s: [short, long] } = self.flicker;
        let parts = if sigma > 0.0 { FLICKER_PARTS } else { 0 };
        let ratio = if short > 0.0 { (long / short).max(1.0) } else { 1.0 };
        let flicker = (0..parts).map(move |k| {
            let tau_s = short * ratio.powf(k as f64 / (FLICKER_PARTS - 1) as f64);
            Markov { sigma, tau_s }
        });
        self.markov.iter().copied().chain(flicker)
    }

    /// Longest correlation time, s.
    pub fn correlation_time_s(&self) -> f64 {
        let markov = self.all_markov().map(|part| part.tau_s);
        markov.chain(self.exp_cos.iter().map(|part| part.alpha.recip())).fold(0.0, f64::max)
    }

    /// Value of a parameter.
    pub fn get(&self, knob: Knob) -> f64 {
        let markov =
            |index: usize| self.markov.get(index).copied().unwrap_or(Markov { sigma: 0.0, tau_s: 1.0 });
        let none = ExponentialCosine { sigma: 0.0, alpha: 1.0, beta: 1.0 };
        let cosine = |index: usize| self.exp_cos.get(index).copied().unwrap_or(none);
        match knob {
            Knob::White => self.white,
            Knob::MarkovSigma(index) => markov(index).sigma,
            Knob::MarkovTau(index) => markov(index).tau_s,
            Knob::CosineSigma(index) => cosine(index).sigma,
            Knob::CosineAlpha(index) => cosine(index).alpha,
            Knob::CosineBeta(index) => cosine(index).beta,
            Knob::RandomWalk => self.random_walk,
            Knob::Flicker => self.flicker.sigma,
            Knob::Angle => self.angle,
            Knob::StepRatio => self.step.map_or(1.0, |step| step.ratio),
        }
    }

    /// Whether a parameter means anything: a correlation time or a frequency does only where its part is there.
    pub fn has_shape(&self, knob: Knob) -> bool {
        match knob {
            Knob::MarkovTau(index) => index < self.markov.len(),
            Knob::CosineAlpha(index) | Knob::CosineBeta(index) => index < self.exp_cos.len(),
            _ => true,
        }
    }

    /// Sets a parameter; one of a part that is not there is left.
    pub fn set(&mut self, knob: Knob, value: f64) {
        let slot = match knob {
            Knob::White => Some(&mut self.white),
            Knob::MarkovSigma(index) => self.markov.get_mut(index).map(|part| &mut part.sigma),
            Knob::MarkovTau(index) => self.markov.get_mut(index).map(|part| &mut part.tau_s),
            Knob::CosineSigma(index) => self.exp_cos.get_mut(index).map(|part| &mut part.sigma),
            Knob::CosineAlpha(index) => self.exp_cos.get_mut(index).map(|part| &mut part.alpha),
            Knob::CosineBeta(index) => self.exp_cos.get_mut(index).map(|part| &mut part.beta),
            Knob::RandomWalk => Some(&mut self.random_walk),
            Knob::Flicker => Some(&mut self.flicker.sigma),
            Knob::Angle => Some(&mut self.angle),
            Knob::StepRatio => self.step.as_mut().map(|step| &mut step.ratio),
        };
        if let Some(slot) = slot {
            *slot = value;
        }
    }

    /// Takes the parts to which `knobs` belong from `other`.
    pub fn adopt(&mut self, other: &Self, knobs: &[Knob]) {
        for &knob in knobs {
            match knob {
                Knob::MarkovSigma(part) if part >= self.markov.len() => {
                    self.markov.extend(other.markov.get(part).copied());
                }
                Knob::CosineSigma(part) if part >= self.exp_cos.len() => {
                    self.exp_cos.extend(other.exp_cos.get(part).copied());
                }
                Knob::Flicker => self.flicker = other.flicker,
                Knob::StepRatio => self.step = other.step,
                _ => self.set(knob, other.get(knob)),
            }
        }
    }

    /// Every parameter that it has.
    pub fn knobs(&self) -> Vec<Knob> {
        let mut knobs = Vec::new();
        if self.white > 0.0 {
            knobs.push(Knob::White);
        }
        for index in 0..self.markov.len() {
            knobs.extend([Knob::MarkovSigma(index), Knob::MarkovTau(index)]);
        }
        for index in 0..self.exp_cos.len() {
            knobs.extend([Knob::CosineSigma(index), Knob::CosineAlpha(index), Knob::CosineBeta(index)]);
        }
        let single = [
            (self.random_walk, Knob::RandomWalk),
            (self.flicker.sigma, Knob::Flicker),
            (self.angle, Knob::Angle),
        ];
        knobs.extend(single.iter().filter(|(value, _)| *value > 0.0).map(|(_, knob)| *knob));
        knobs.extend(self.step.map(|_| Knob::StepRatio));
        knobs
    }

    /// Power spectrum at `omega` rad per step of `step_s`, in units in which white noise of σ = 1 has 1.
    pub fn spectrum(&self, omega: f64, step_s: f64) -> f64 {
        let pole = |phi: f64, omega: f64| {
            // |1 − φ e^{−iω}|² without cancellation near φ = 1, ω = 0.
            let half = (0.5 * omega).sin();
            (1.0 - phi) * (1.0 - phi) + 4.0 * phi * half * half
        };
        let markov: f64 = self
            .all_markov()
            .map(|part| {
                let decay = step_s / part.tau_s;
                part.sigma * part.sigma * -(-2.0 * decay).exp_m1() / pole((-decay).exp(), omega)
            })
            .sum();
        let cosine: f64 = (self.exp_cos.iter())
            .map(|part| {
                let (decay, beta) = (part.alpha * step_s, part.beta * step_s);
                let phi = (-decay).exp();
                let both = pole(phi, omega - beta).recip() + pole(phi, omega + beta).recip();
                0.5 * part.sigma * part.sigma * -(-2.0 * decay).exp_m1() * both
            })
            .sum();
        let difference = pole(1.0, omega).max(1e-300);
        self.white_variance()
            + self
                .step
                .map_or(0.0, |step| step.part * (step.ratio * step.ratio - 1.0) * self.white * self.white)
            + markov
            + cosine
            + self.random_walk * self.random_walk * step_s / difference
            + self.angle * self.angle * difference
    }

    /// The states of its correlated parts.
    pub fn states(&self, step_s: f64) -> States {
        let mut states = States::default();
        for part in self.all_markov() {
            let decay = step_s / part.tau_s;
            let variance = part.sigma * part.sigma;
            let driven = variance * -(-2.0 * decay).exp_m1();
            states.push_one(part.tau_s.recip(), (-decay).exp(), driven, variance);
        }
        for part in &self.exp_cos {
            let decay = (-part.alpha * step_s).exp();
            let (sin, cos) = (part.beta * step_s).sin_cos();
            let variance = part.sigma * part.sigma;
            let driven = variance * -(-2.0 * part.alpha * step_s).exp_m1();
            states.groups.push(Group {
                size: 2,
                transition: [[decay * cos, -decay * sin], [decay * sin, decay * cos]],
                driven: [driven, driven],
                start: [variance, variance],
                seen: [1.0, 0.0],
                rates: Some([part.alpha, part.beta]),
            });
        }
        if self.random_walk > 0.0 {
            states.push_one(0.0, 1.0, self.random_walk * self.random_walk * step_s, 0.0);
        }
        if self.angle > 0.0 {
            let variance = self.angle * self.angle;
            states.groups.push(Group {
                size: 2,
                transition: [[0.0, 0.0], [1.0, 0.0]],
                driven: [variance, 0.0],
                start: [variance, variance],
                seen: [1.0, -1.0],
                rates: None,
            });
        }
        states
    }

    /// The covariance matrix of the noise over all rows times a series, of one value a row: Σ and not its root, in O(N).
    ///
    /// A correlated part is x(k+1) = F x(k) + w(k), seen by h, so that Σ = A Q Aᵀ with Aᵀ one run backwards, μ(k) = Fᵀ μ(k+1) + h v(k), and A
    /// one forwards, x(k) = F x(k−1) + Q μ(k).
    pub fn covariance_times(&self, values: &[f64], step_s: f64) -> Vec<f64> {
        let white = self.white_variance();
        let mut product: Vec<f64> = values.iter().map(|value| white * value).collect();
        for group in self.states(step_s).groups {
            let [[a, b], [c, d]] = group.transition;
            let [seen, seen_second] = group.seen;
            let (mut costate, mut costates) = ([0.0; 2], vec![[0.0; 2]; values.len()]);
            for (kept, value) in costates.iter_mut().zip(values).rev() {
                let [first, second] = costate;
                costate =
                    [a * first + c * second + seen * value, b * first + d * second + seen_second * value];
                *kept = costate;
            }
            let mut state = [0.0; 2];
            for (row, (sum, costate)) in product.iter_mut().zip(&costates).enumerate() {
                let driven = if row == 0 { group.start } else { group.driven };
                let [first, second] = state;
                state = [
                    a * first + b * second + driven[0] * costate[0],
                    c * first + d * second + driven[1] * costate[1],
                ];
                *sum += seen * state[0] + seen_second * state[1];
            }
        }
        product
    }
}

/// States of one or two that belong together.
#[derive(Clone, Debug, Default)]
pub struct States {
    /// The groups.
    pub groups: Vec<Group>,
}

/// One or two states: transition, variances of the driving noise and at the start, and what of them is seen.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// 1 or 2.
    pub size: usize,
    /// Transition over a step.
    pub transition: [[f64; 2]; 2],
    /// Variance of the driving noise.
    pub driven: [f64; 2],
    /// Variance at the start.
    pub start: [f64; 2],
    /// Weight in the output.
    pub seen: [f64; 2],
    /// Rate of decay and angular frequency, 1/s, of what goes on between the rows.
    pub rates: Option<[f64; 2]>,
}

impl Group {
    /// Spectral density of the driving noise of either state, of what goes on between the rows.
    pub fn density(&self, step_s: f64) -> Option<f64> {
        let [decay, _] = self.rates?;
        let lasts_s = if decay > 0.0 { -(-2.0 * decay * step_s).exp_m1() / (2.0 * decay) } else { step_s };
        Some(self.driven[0] / lasts_s)
    }
}

impl States {
    fn push_one(&mut self, decay: f64, transition: f64, driven: f64, start: f64) {
        self.groups.push(Group {
            size: 1,
            transition: [[transition, 0.0], [0.0, 0.0]],
            driven: [driven, 0.0],
            start: [start, 0.0],
            seen: [1.0, 0.0],
            rates: Some([decay, 0.0]),
        });
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.groups.iter().map(|group| group.size).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use schuler_recording::case::{ExponentialCosine, Markov};

    use super::{Flicker, Noise};

    /// Against the autocovariance of each kind of noise.
    #[test]
    fn the_covariance_times_a_series_is_the_sum_over_all_rows() {
        let step_s = 0.5;
        let (markov, cosine) =
            (Markov { sigma: 2.0, tau_s: 3.0 }, ExponentialCosine { sigma: 1.5, alpha: 0.2, beta: 1.1 });
        let noise = Noise {
            white: 0.7,
            markov: vec![markov],
            exp_cos: vec![cosine],
            random_walk: 0.3,
            angle: 0.4,
            flicker: Flicker { sigma: 0.0, tau_s: [1.0, 2.0] },
            ..Noise::default()
        };
        let covariance = |i: usize, j: usize| {
            let lag = i.abs_diff(j);
            let lag_s = lag as f64 * step_s;
            let white = if lag == 0 { 0.49 } else { 0.0 };
            let differenced = [2.0 * 0.16, -0.16].get(lag).copied().unwrap_or_default();
            white
                + differenced
                + 4.0 * (-lag_s / 3.0).exp()
                + 2.25 * (-0.2 * lag_s).exp() * (1.1 * lag_s).cos()
                + 0.09 * step_s * i.min(j) as f64
        };
        let values: Vec<f64> = (0..40).map(|row| f64::from((row * 37 % 11) - 5)).collect();
        let product = noise.covariance_times(&values, step_s);
        for (i, product) in product.iter().enumerate() {
            let sum: f64 = values.iter().enumerate().map(|(j, value)| covariance(i, j) * value).sum();
            assert!((product - sum).abs() < 1e-9 * (1.0 + sum.abs()), "row {i}: {product} and {sum}");
        }
    }
}
