//! Residuals and their truth, drawn from the model [HLT-3].
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::model::{Mode, Model};

/// One step of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Mode in force.
    pub mode: Mode,
    /// Correlated radio error ε, m/s.
    pub eps: f64,
    /// Inertial error ξ, m/s.
    pub xi: f64,
    /// Jump m, m/s; zero without one.
    pub jump: f64,
    /// Residual d, m/s.
    pub d: f64,
}

/// Draws recordings from a model.
#[derive(Clone, Debug)]
pub struct Generator {
    model: Model,
    random: Pcg64,
}

impl Generator {
    /// Everything that is drawn follows from `seed`.
    pub fn new(model: &Model, seed: u64) -> Self {
        Self { model: model.clone(), random: Pcg64::seed_from_u64(seed) }
    }

    /// `steps` residuals with modes drawn from the chains.
    pub fn natural(&mut self, steps: usize) -> Vec<Sample> {
        let model = self.model.clone();
        let mut mode =
            Mode { jump: self.pick(&model.jump_initial) == 1, level: self.pick(&model.level_initial) };
        let modes: Vec<_> = (0..steps)
            .map(|k| {
                if k > 0 {
                    mode = Mode {
                        jump: self.pick(&model.jump_transition[usize::from(mode.jump)]) == 1,
                        level: self.pick(&model.level_transition[mode.level]),
                    };
                }
                mode
            })
            .collect();
        self.errors(&modes, None)
    }

    /// Residuals under given modes; every jump has the value `jump`, or one drawn from the model.
    pub fn scripted(&mut self, modes: &[Mode], jump: Option<f64>) -> Vec<Sample> {
        self.errors(modes, jump)
    }

    /// A standard normal number.
    pub fn normal(&mut self) -> f64 {
        self.random.sample(StandardNormal)
    }

    /// A number between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        self.random.random()
    }

    fn pick(&mut self, probabilities: &[f64]) -> usize {
        let mut left = self.uniform();
        for (index, p) in probabilities.iter().enumerate() {
            left -= p;
            if left < 0.0 {
                return index;
            }
        }
        probabilities.len() - 1
    }

    fn errors(&mut self, modes: &[Mode], value: Option<f64>) -> Vec<Sample> {
        let model = self.model.clone();
        let Some(first) = modes.first() else { return Vec::new() };
        let mut eps = model.sigma[first.level] * self.normal();
        let mut xi = model.sigma_xi0 * self.normal();
        let mu = model.sigma_mu * self.normal();
        let mut m = 0.0;
        let mut before = false;
        let mut samples = Vec::with_capacity(modes.len());
        for (k, &mode) in modes.iter().enumerate() {
            if k > 0 {
                eps = model.f() * eps + model.gamma(mode.level) * self.normal();
                xi += model.dt * mu + model.gamma_xi * self.normal();
            }
            m = match (mode.jump, before) {
                (false, _) => 0.0,
                (true, true) => m,
                (true, false) => value.unwrap_or_else(|| model.gamma_m * self.normal()),
            };
            before = mode.jump;
            let d = eps + m - xi + model.residual_variance.sqrt() * self.normal();
            samples.push(Sample { mode, eps, xi, jump: m, d });
        }
        samples
    }
}
