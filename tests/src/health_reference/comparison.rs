//! Filters that one would use otherwise: the nominal Kalman filter, which knows no faults; the first-order
//! generalised pseudo-Bayes filter (GPB1), which merges all modes after each residual; the interacting
//! multiple-model filter (IMM), which merges before it. [HLT-8]
use super::model::{Filter, Gaussian, Model, Posterior, Transitions};

/// Kalman filter of the fault-free mode.
#[derive(Clone, Debug)]
pub struct NominalKalman {
    model: Model,
    transitions: Transitions,
    state: Option<Gaussian>,
}

/// GPB1.
#[derive(Clone, Debug)]
pub struct Gpb1 {
    model: Model,
    transitions: Transitions,
    state: Option<(Vec<f64>, Gaussian)>,
}

/// IMM.
#[derive(Clone, Debug)]
pub struct Imm {
    model: Model,
    transitions: Transitions,
    state: Option<Vec<(f64, Gaussian)>>,
}

impl NominalKalman {
    /// Not started.
    pub fn new(model: &Model) -> Self {
        Self { model: model.clone(), transitions: Transitions::new(model), state: None }
    }
}

impl Gpb1 {
    /// Not started.
    pub fn new(model: &Model) -> Self {
        Self { model: model.clone(), transitions: Transitions::new(model), state: None }
    }
}

impl Imm {
    /// Not started.
    pub fn new(model: &Model) -> Self {
        Self { model: model.clone(), transitions: Transitions::new(model), state: None }
    }
}

fn prior(model: &Model, r: usize) -> Gaussian {
    Gaussian { mean: nalgebra::zero(), covariance: model.initial_covariance(r) }
}

fn given(state: Gaussian, model: &Model, r: usize, d: Option<f64>) -> (Gaussian, f64) {
    d.map_or((state, 1.0), |d| state.updated(model, r, d))
}

fn normalised(mut parts: Vec<(f64, Gaussian)>) -> Vec<(f64, Gaussian)> {
    let total: f64 = parts.iter().map(|(weight, _)| weight).sum();
    for (weight, _) in &mut parts {
        *weight = (*weight / total).max(1e-9);
    }
    parts
}

fn posterior(parts: &[(f64, Gaussian)]) -> Posterior {
    let total: f64 = parts.iter().map(|(weight, _)| weight).sum();
    let modes = parts.iter().map(|(weight, _)| weight / total).collect();
    Posterior { modes, state: Gaussian::merged(parts) }
}

impl Filter for NominalKalman {
    fn step(&mut self, d: Option<f64>) -> Posterior {
        let predicted =
            self.state.map_or(prior(&self.model, 0), |state| state.predicted(&self.transitions.path[0][0]));
        let (state, _) = given(predicted, &self.model, 0, d);
        self.state = Some(state);
        let modes = (0..self.model.modes()).map(|r| f64::from(u8::from(r == 0))).collect();
        Posterior { modes, state }
    }
}

impl Filter for Gpb1 {
    fn step(&mut self, d: Option<f64>) -> Posterior {
        let model = &self.model;
        let modes = 0..model.modes();
        let parts: Vec<(f64, Gaussian)> = match &self.state {
            None => modes
                .map(|r| {
                    let (state, density) = given(prior(model, r), model, r, d);
                    (model.initial(r) * density, state)
                })
                .collect(),
            // One Gaussian has forgotten which modes it came from, so the noise of a fresh jump enters with the
            // share of the fault-free past.
            Some((weights, state)) => modes
                .map(|r| {
                    let paths: Vec<_> = weights
                        .iter()
                        .enumerate()
                        .map(|(i, weight)| {
                            let transition = &self.transitions.path[i][r];
                            (weight * transition.probability, state.predicted(transition))
                        })
                        .collect();
                    let arriving: f64 = paths.iter().map(|(weight, _)| weight).sum();
                    let (state, density) = given(Gaussian::merged(&paths), model, r, d);
                    (arriving * density, state)
                })
                .collect(),
        };
        let posterior = posterior(&normalised(parts));
        self.state = Some((posterior.modes.clone(), posterior.state));
        posterior
    }
}

impl Filter for Imm {
    fn step(&mut self, d: Option<f64>) -> Posterior {
        let model = &self.model;
        let modes = 0..model.modes();
        let parts = match &self.state {
            None => modes
                .map(|r| {
                    let (state, density) = given(prior(model, r), model, r, d);
                    (model.initial(r) * density, state)
                })
                .collect(),
            Some(before) => modes
                .map(|r| {
                    let paths: Vec<_> = before
                        .iter()
                        .enumerate()
                        .map(|(i, (weight, state))| {
                            let transition = &self.transitions.path[i][r];
                            (weight * transition.probability, state.predicted(transition))
                        })
                        .collect();
                    let arriving: f64 = paths.iter().map(|(weight, _)| weight).sum();
                    let (state, density) = given(Gaussian::merged(&paths), model, r, d);
                    (arriving * density, state)
                })
                .collect(),
        };
        let parts = normalised(parts);
        let posterior = posterior(&parts);
        self.state = Some(parts);
        posterior
    }
}
