//! What is to be explained: the recording against its nominal model, and everything that may have been left out.
use std::collections::HashMap;

use rayon::prelude::*;

use crate::catalogue::{CATALOGUE, Candidate, Effect, Port, Search, Target, share_equal_series};
use crate::description::sensors_of;
use crate::inputs::Inputs;
use crate::nominal::Model;
use crate::second::config::Config;

/// A case to be explained.
pub struct Problem<'p> {
    /// Recorded and derived quantities.
    pub inputs: &'p Inputs<'p>,
    /// Channels and the noise that is believed.
    pub model: &'p Model,
    /// What may have been left out.
    pub candidates: Vec<Candidate>,
    /// Logarithm of the prior odds of each candidate against its absence.
    pub ln_prior: Vec<f64>,
    /// What decides.
    pub config: &'p Config,
}

impl<'p> Problem<'p> {
    /// The problem of a model with the candidates of the catalogue.
    pub fn new(inputs: &'p Inputs<'p>, model: &'p Model, config: &'p Config) -> Self {
        let of_effect = |effect: &'static Effect| {
            let mut candidates = (effect.candidates)(effect, inputs);
            share_equal_series(&mut candidates);
            candidates.retain(|candidate| is_searched(model, candidate));
            candidates
        };
        let candidates: Vec<Candidate> = CATALOGUE.par_iter().flat_map_iter(of_effect).collect();
        let ln_prior = ln_prior(&candidates, config);
        Self { inputs, model, candidates, ln_prior, config }
    }

    /// Time of each row from the first, s.
    pub fn time_s(&self) -> &[f64] {
        &self.inputs.time_s
    }
}

/// Whether a candidate reaches anything that is compared. Shapes that are sought at every time or frequency, and noises, are of one
/// sensor.
fn is_searched(model: &Model, candidate: &Candidate) -> bool {
    let is_group = matches!(candidate.target, Target::Group { .. });
    let has_shape = match &candidate.search {
        Search::Linear(signature) => !signature.columns.is_empty(),
        Search::Grid { parameters, .. } => parameters.iter().all(|parameter| !parameter.grid.is_empty()),
        Search::Onset(_) | Search::Frequency | Search::Noise(_) => !is_group,
        Search::Readings(_) => false,
    };
    has_shape && sensors_of(candidate).iter().any(|&sensor| model.source_of(sensor, candidate.port).is_some())
}

/// As many effects as a record is expected to have, shared among all pairs of a place and an effect, and of each among its variants.
fn ln_prior(candidates: &[Candidate], config: &Config) -> Vec<f64> {
    let pair = |candidate: &Candidate| {
        let port = match candidate.port {
            Port::Output => 0,
            Port::Accelerometer => 1,
            Port::Gyro => 2,
        };
        (candidate.effect.id, sensors_of(candidate), port)
    };
    let mut variants: HashMap<_, f64> = HashMap::new();
    for candidate in candidates {
        *variants.entry(pair(candidate)).or_default() += 1.0;
    }
    let pairs = variants.len().max(1) as f64;
    let of = |candidate: &Candidate| (config.expected_effects / (pairs * variants[&pair(candidate)])).ln();
    candidates.iter().map(of).collect()
}
