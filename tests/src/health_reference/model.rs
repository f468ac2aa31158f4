//! The model's matrices by mode [HLT-3].
//!
//! State X = [ε, ξ, m, μ]. Mode r = λ·N + j, λ ∈ {0, 1} jump absent or present, j = 0 … N−1 level of noise.
use nalgebra::{Matrix4, RealField, RowVector4, Vector4, convert};
use schuler_core::health::{HealthConfig, InertialErrorModel, JumpModel, RadioErrorModel};

/// Parameters, in m, s.
#[derive(Clone, Debug)]
pub struct Model {
    /// Step, s.
    pub dt: f64,
    /// Correlation time of the radio error, s.
    pub tau: f64,
    /// Radio error's standard deviation at each level, m/s.
    pub sigma: Vec<f64>,
    /// Number of normal levels.
    pub normal_levels: usize,
    /// Standard deviation of a fresh jump, m/s.
    pub gamma_m: f64,
    /// Inertial random walk, m/s per step.
    pub gamma_xi: f64,
    /// Standard deviation of the inertial error at the first residual, m/s.
    pub sigma_xi0: f64,
    /// Standard deviation of the inertial drift, m/s².
    pub sigma_mu: f64,
    /// Residual noise variance, (m/s)².
    pub residual_variance: f64,
    /// Transition matrix of λ.
    pub jump_transition: [[f64; 2]; 2],
    /// Transition matrix of the level.
    pub level_transition: Vec<Vec<f64>>,
    /// Probabilities of λ at the first residual.
    pub jump_initial: [f64; 2],
    /// Probabilities of the level at the first residual.
    pub level_initial: Vec<f64>,
}

/// Mode given by its parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mode {
    /// Jump present.
    pub jump: bool,
    /// Level of noise, from 0.
    pub level: usize,
}

impl Model {
    /// Doppler against inertial velocity, two levels [HLT-7].
    pub fn doppler() -> Self {
        let chain = [[1.0 - 1.0 / 1800.0, 1.0 / 1800.0], [1.0 / 120.0, 1.0 - 1.0 / 120.0]];
        Self {
            dt: 1.0,
            tau: 10.0,
            sigma: vec![0.3, 0.9],
            normal_levels: 1,
            gamma_m: 0.9,
            gamma_xi: 0.005,
            sigma_xi0: 0.5,
            sigma_mu: 3e-4,
            residual_variance: 1e-4,
            jump_transition: chain,
            level_transition: chain.map(Vec::from).to_vec(),
            jump_initial: [0.99, 0.01],
            level_initial: vec![0.99, 0.01],
        }
    }

    /// Three levels [HLT-7].
    pub fn doppler_three_levels() -> Self {
        let (a, b) = (1.0 / 1800.0, 1.0 / 120.0);
        Self {
            sigma: vec![0.3, 0.9, 3.0],
            level_transition: vec![
                vec![1.0 - a, 0.8 * a, 0.2 * a],
                vec![0.8 * b, 1.0 - b, 0.2 * b],
                vec![0.8 * b, 0.2 * b, 1.0 - b],
            ],
            level_initial: vec![0.98, 0.01, 0.01],
            ..Self::doppler()
        }
    }

    /// The monitor's configuration for exactly this model; what the model does not know stays as in `base`.
    ///
    /// # Panics
    /// If the number of levels is not `LEVELS`.
    pub fn config<T: RealField + Copy, const LEVELS: usize>(
        &self,
        base: &HealthConfig<T, LEVELS>,
    ) -> HealthConfig<T, LEVELS> {
        let number = convert::<f64, T>;
        let row = |row: &[f64]| -> [T; LEVELS] {
            <[f64; LEVELS]>::try_from(row).expect("as many levels as the configuration").map(number)
        };
        assert_eq!(self.sigma.len(), LEVELS);
        HealthConfig {
            step_s: number(self.dt),
            radio: RadioErrorModel {
                tau_s: number(self.tau),
                sigma: row(&self.sigma),
                normal_levels: self.normal_levels as u8,
                transition: std::array::from_fn(|level| row(&self.level_transition[level])),
                initial: row(&self.level_initial),
            },
            jump: JumpModel {
                sigma: number(self.gamma_m),
                transition: self.jump_transition.map(|row| row.map(number)),
                initial: self.jump_initial.map(number),
                ..base.jump
            },
            inertial: InertialErrorModel {
                random_walk: number(self.gamma_xi / self.dt.sqrt()),
                initial_sigma: number(self.sigma_xi0),
                drift_sigma: number(self.sigma_mu),
                drift_random_walk: T::zero(),
                ..base.inertial
            },
            residual_sigma: number(self.residual_variance.sqrt()),
            ..*base
        }
    }

    /// Number of modes 2N.
    pub fn modes(&self) -> usize {
        2 * self.sigma.len()
    }

    /// Parts of mode r.
    pub fn mode(&self, r: usize) -> Mode {
        Mode { jump: r >= self.sigma.len(), level: r % self.sigma.len() }
    }

    /// True if the mode is a fault.
    pub fn is_fault(&self, r: usize) -> bool {
        let mode = self.mode(r);
        mode.jump || mode.level >= self.normal_levels
    }

    /// f, autocorrelation of the radio error over a step.
    pub fn f(&self) -> f64 {
        (-self.dt / self.tau).exp()
    }

    /// `γ_j`, radio error's noise per step at a level, m/s.
    pub fn gamma(&self, level: usize) -> f64 {
        self.sigma[level] * (1.0 - self.f() * self.f()).sqrt()
    }

    /// Π(i, r).
    pub fn transition(&self, i: usize, r: usize) -> f64 {
        let (from, to) = (self.mode(i), self.mode(r));
        self.jump_transition[usize::from(from.jump)][usize::from(to.jump)]
            * self.level_transition[from.level][to.level]
    }

    /// Probability of mode r at the first residual.
    pub fn initial(&self, r: usize) -> f64 {
        let mode = self.mode(r);
        self.jump_initial[usize::from(mode.jump)] * self.level_initial[mode.level]
    }

    /// F of the transition i → r.
    pub fn matrix(&self, i: usize, r: usize) -> Matrix4<f64> {
        let kept = self.mode(i).jump && self.mode(r).jump;
        let mut matrix = Matrix4::from_diagonal(&Vector4::new(self.f(), 1.0, f64::from(u8::from(kept)), 1.0));
        matrix[(1, 3)] = self.dt;
        matrix
    }

    /// G Gᵀ of the transition i → r.
    pub fn noise(&self, i: usize, r: usize) -> Matrix4<f64> {
        let (from, to) = (self.mode(i), self.mode(r));
        let fresh = if to.jump && !from.jump { self.gamma_m } else { 0.0 };
        let g = Vector4::new(self.gamma(to.level), self.gamma_xi, fresh, 0.0);
        Matrix4::from_diagonal(&g.component_mul(&g))
    }

    /// `H_r`.
    pub fn observation(&self, r: usize) -> RowVector4<f64> {
        RowVector4::new(1.0, -1.0, f64::from(u8::from(self.mode(r).jump)), 0.0)
    }

    /// Covariance of X in mode r at the first residual; the mean is zero.
    pub fn initial_covariance(&self, r: usize) -> Matrix4<f64> {
        let mode = self.mode(r);
        let jump = if mode.jump { self.gamma_m } else { 0.0 };
        let sigma = Vector4::new(self.sigma[mode.level], self.sigma_xi0, jump, self.sigma_mu);
        Matrix4::from_diagonal(&sigma.component_mul(&sigma))
    }
}

/// Every transition's matrices, computed once.
#[derive(Clone, Debug)]
pub struct Transitions {
    /// `path[i][r]`.
    pub path: Vec<Vec<Transition>>,
}

/// One transition i → r.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// Π(i, r).
    pub probability: f64,
    /// F.
    pub matrix: Matrix4<f64>,
    /// G Gᵀ.
    pub noise: Matrix4<f64>,
}

impl Transitions {
    /// Of a model.
    pub fn new(model: &Model) -> Self {
        let transition = |i, r| Transition {
            probability: model.transition(i, r),
            matrix: model.matrix(i, r),
            noise: model.noise(i, r),
        };
        let modes = 0..model.modes();
        Self { path: modes.clone().map(|i| modes.clone().map(|r| transition(i, r)).collect()).collect() }
    }
}

/// A Gaussian of X.
#[derive(Clone, Copy, Debug)]
pub struct Gaussian {
    /// Mean.
    pub mean: Vector4<f64>,
    /// Covariance.
    pub covariance: Matrix4<f64>,
}

impl Gaussian {
    /// Moved over a transition.
    #[must_use]
    pub fn predicted(&self, transition: &Transition) -> Self {
        let f = &transition.matrix;
        Self { mean: f * self.mean, covariance: f * self.covariance * f.transpose() + transition.noise }
    }

    /// Given the residual d in mode r, and the density of d.
    #[must_use]
    pub fn updated(&self, model: &Model, r: usize, d: f64) -> (Self, f64) {
        let h = model.observation(r);
        let cross = self.covariance * h.transpose();
        let s = (h * cross).x + model.residual_variance;
        let v = d - (h * self.mean).x;
        let gain = cross / s;
        let covariance = self.covariance - gain * cross.transpose();
        let density = (-0.5 * v * v / s).exp() / (std::f64::consts::TAU * s).sqrt();
        (
            Self { mean: self.mean + gain * v, covariance: (covariance + covariance.transpose()) * 0.5 },
            density,
        )
    }

    /// First two moments of a mixture; weights of any sum.
    #[must_use]
    pub fn merged(components: &[(f64, Self)]) -> Self {
        let total: f64 = components.iter().map(|(weight, _)| weight).sum();
        let mean = components.iter().map(|(weight, part)| part.mean * (weight / total)).sum::<Vector4<f64>>();
        let covariance = components
            .iter()
            .map(|(weight, part)| {
                let spread = part.mean - mean;
                (part.covariance + spread * spread.transpose()) * (weight / total)
            })
            .sum();
        Self { mean, covariance }
    }
}

/// What a filter knows after a residual.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// Probability of each mode.
    pub modes: Vec<f64>,
    /// X over all modes.
    pub state: Gaussian,
}

/// A filter of residuals.
pub trait Filter {
    /// Takes in the next residual, or its absence.
    fn step(&mut self, d: Option<f64>) -> Posterior;
}
