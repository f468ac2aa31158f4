//! The Kalman filter of a model: gains and transition, which do not depend on the data.
use nalgebra::{SMatrix, SVector};

use super::parts::{Correlated, MOST_MARKOV, Parameters};

/// States: the Markov parts, the cosine part and its quadrature, the walk.
pub(super) const STATES: usize = MOST_MARKOV + 3;
const COSINE: usize = MOST_MARKOV;
const QUADRATURE: usize = MOST_MARKOV + 1;
const WALK: usize = MOST_MARKOV + 2;
/// Relative change of the covariance below which the filter has settled.
const SETTLED: f64 = 1e-12;

/// Gain and innovation variance of one step.
#[derive(Clone, Copy)]
pub(super) struct Gain {
    pub(super) gain: SVector<f64, STATES>,
    pub(super) variance: f64,
}

/// What of a state is seen: the Markov parts, the cosine part without its quadrature, the walk.
pub(super) fn observed(state: &SVector<f64, STATES>) -> f64 {
    state.sum() - state[QUADRATURE]
}

/// The transition of the states from one step to the next.
#[derive(Clone, Copy)]
pub(super) struct Turn {
    decays: [f64; MOST_MARKOV],
    cosine: f64,
    sine: f64,
}

impl Turn {
    pub(super) fn apply(&self, state: &mut SVector<f64, STATES>) {
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
pub(super) struct Filter {
    pub(super) turn: Turn,
    /// Variances of the noise that drives the states.
    pub(super) noise: SVector<f64, STATES>,
    pub(super) white: f64,
    pub(super) covariance: SMatrix<f64, STATES, STATES>,
    pub(super) last: Gain,
    pub(super) settled: bool,
}

impl Filter {
    pub(super) fn new(parameters: &Parameters) -> Self {
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
    pub(super) fn advance(&mut self, present: bool, thinness: f64) -> Gain {
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
