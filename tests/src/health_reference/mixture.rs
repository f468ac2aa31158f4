//! The exact posterior as a mixture of Gaussians, one for each path of modes [HLT-4]. Unbounded it is the exact
//! recursion by enumeration; bounded, components are kept by optimal resampling (Fearnhead & Clifford 2003),
//! which leaves every weight unbiased: the Rao-Blackwellised reference.
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::model::{Filter, Gaussian, Model, Posterior, Transitions};

/// The mixture.
#[derive(Clone, Debug)]
pub struct Mixture {
    model: Model,
    transitions: Transitions,
    limit: usize,
    random: Pcg64,
    components: Vec<Component>,
    /// Logarithm of the likelihood of all residuals so far.
    pub log_likelihood: f64,
}

#[derive(Clone, Copy, Debug)]
struct Component {
    weight: f64,
    mode: usize,
    state: Gaussian,
}

impl Mixture {
    /// The exact recursion: 2N times as many components at every step.
    pub fn exact(model: &Model) -> Self {
        Self::bounded(model, usize::MAX, 0)
    }

    /// At most `limit` components.
    pub fn bounded(model: &Model, limit: usize, seed: u64) -> Self {
        Self {
            model: model.clone(),
            transitions: Transitions::new(model),
            limit,
            random: Pcg64::seed_from_u64(seed),
            components: Vec::new(),
            log_likelihood: 0.0,
        }
    }

    fn resample(&mut self) {
        if self.components.len() <= self.limit {
            return;
        }
        let mut sorted: Vec<f64> = self.components.iter().map(|component| component.weight).collect();
        sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        // Threshold c with Σ min(w/c, 1) = limit: the heaviest `kept` stay, the rest share limit − kept places.
        let mut rest: f64 = sorted.iter().sum();
        let mut kept = 0;
        while kept < self.limit && sorted[kept] * (self.limit - kept) as f64 >= rest {
            rest -= sorted[kept];
            kept += 1;
        }
        let places = self.limit - kept;
        let heaviest_dropped = sorted[kept];
        let threshold = if places == 0 { f64::INFINITY } else { rest / places as f64 };
        let mut survivors = Vec::with_capacity(self.limit);
        let mut until_next = self.random.random::<f64>() * threshold;
        for component in &self.components {
            if component.weight > heaviest_dropped {
                survivors.push(*component);
            } else {
                until_next -= component.weight;
                if until_next < 0.0 {
                    until_next += threshold;
                    survivors.push(Component { weight: threshold, ..*component });
                }
            }
        }
        self.components = survivors;
    }
}

impl Filter for Mixture {
    fn step(&mut self, d: Option<f64>) -> Posterior {
        let model = &self.model;
        let modes = model.modes();
        let predicted: Vec<Component> = if self.components.is_empty() {
            (0..modes)
                .map(|mode| Component {
                    weight: model.initial(mode),
                    mode,
                    state: Gaussian { mean: nalgebra::zero(), covariance: model.initial_covariance(mode) },
                })
                .collect()
        } else {
            self.components
                .iter()
                .flat_map(|from| {
                    self.transitions.path[from.mode].iter().enumerate().map(|(mode, transition)| Component {
                        weight: from.weight * transition.probability,
                        mode,
                        state: from.state.predicted(transition),
                    })
                })
                .collect()
        };
        self.components = match d {
            None => predicted,
            Some(d) => predicted
                .into_iter()
                .map(|component| {
                    let (state, density) = component.state.updated(model, component.mode, d);
                    Component { weight: component.weight * density, state, ..component }
                })
                .collect(),
        };
        let total: f64 = self.components.iter().map(|component| component.weight).sum();
        self.log_likelihood += total.ln();
        for component in &mut self.components {
            component.weight /= total;
        }
        let mut weights = vec![0.0; modes];
        for component in &self.components {
            weights[component.mode] += component.weight;
        }
        let parts: Vec<_> =
            self.components.iter().map(|component| (component.weight, component.state)).collect();
        let posterior = Posterior { modes: weights, state: Gaussian::merged(&parts) };
        self.resample();
        posterior
    }
}
