//! What is to be explained: the recording against its nominal model, and everything that may have been left out.
pub mod prepared;

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use self::prepared::{Prepared, is_spoilt};
use crate::catalogue::{
    CATALOGUE, Candidate, Effect, Port, SETUP, Search, Target, UNNAMED, of_case, share_equal_series,
};
use crate::config::Config;
use crate::description::sensors_of;
use crate::explain::Error;
use crate::inputs::Inputs;
use crate::nominal::Model;
use crate::watch::Watch;

/// A case to be explained.
pub struct Problem<'p> {
    /// Recorded and derived quantities.
    pub inputs: &'p Inputs<'p>,
    /// Channels and the noise that is believed.
    pub model: &'p Model,
    /// What may have been left out.
    pub candidates: Arc<[Candidate]>,
    /// Logarithm of the prior odds of each candidate against its absence.
    pub ln_prior: Arc<[f64]>,
    /// What decides.
    pub config: &'p Config,
    /// Who watches.
    pub watch: &'p dyn Watch,
}

impl<'p> Problem<'p> {
    /// The problem of a model with given candidates.
    pub fn new(
        inputs: &'p Inputs<'p>,
        model: &'p Model,
        candidates: Vec<Candidate>,
        config: &'p Config,
        watch: &'p dyn Watch,
    ) -> Self {
        let ln_prior = ln_prior(&candidates, config).into();
        Self { inputs, model, candidates: candidates.into(), ln_prior, config, watch }
    }

    /// The same of a model with fewer rows.
    pub fn of_model<'q>(&self, model: &'q Model) -> Problem<'q>
    where
        'p: 'q,
    {
        let (candidates, ln_prior) = (Arc::clone(&self.candidates), Arc::clone(&self.ln_prior));
        Problem { inputs: self.inputs, model, candidates, ln_prior, config: self.config, watch: self.watch }
    }

    /// Time of each row from the first, s.
    pub fn time_s(&self) -> &[f64] {
        &self.inputs.time_s
    }
}

/// What the whole catalogue gives in a case, what the case defines itself, and what may be wrong in it.
///
/// # Errors
/// An effect of the case's own that cannot be sought.
pub fn catalogued(inputs: &Inputs<'_>) -> Result<Vec<Candidate>, Error> {
    let mut own = of_case(inputs)?;
    share_equal_series(&mut own);
    let of_effect = |effect: &'static Effect| {
        let mut candidates = (effect.candidates)(effect, inputs);
        share_equal_series(&mut candidates);
        candidates
    };
    let others = SETUP.iter().copied().chain([UNNAMED]);
    let all: Vec<&'static Effect> = CATALOGUE.iter().chain(others).collect();
    let mut candidates: Vec<Candidate> = all.into_par_iter().flat_map_iter(of_effect).collect();
    candidates.append(&mut own);
    Ok(candidates)
}

/// Those candidates that reach anything which is compared.
pub fn searchable(mut candidates: Vec<Candidate>, prepared: &Prepared) -> Vec<Candidate> {
    let (model, faults) = (&prepared.model, prepared.faults.found.as_slice());
    candidates.retain(|candidate| is_searched(model, candidate) && !is_spoilt(candidate, faults, model));
    candidates
}

/// The model without the rows of which a late instrument may read what was before the record, or an early one what comes after: the
/// signature of a delay is not known there.
pub fn within_delays(model: &Model, candidates: &[Candidate]) -> Model {
    let mut longest_s = vec![0.0_f64; model.blocks.len()];
    for candidate in candidates.iter().filter(|candidate| candidate.effect.is_a_delay()) {
        let Search::Grid { parameters, .. } = &candidate.search else { continue };
        let delays = parameters.iter().flat_map(|parameter| &parameter.grid);
        let most = delays.fold(0.0_f64, |most, delay| most.max(delay.abs()));
        for block in sensors_of(candidate).into_iter().filter_map(|sensor| model.block_of(sensor)) {
            longest_s[block] = longest_s[block].max(most);
        }
    }
    if longest_s.iter().all(|longest| *longest == 0.0) {
        return model.clone();
    }
    let end_s = model.time_s.last().copied().unwrap_or_default();
    model.without_rows(|block, row| {
        let index = block.sensors.first().and_then(|&sensor| model.block_of(sensor));
        let margin_s = index.map_or(0.0, |index| longest_s[index]);
        let time_s = model.time_s.get(row).copied().unwrap_or_default();
        margin_s > 0.0 && !(margin_s..=end_s - margin_s).contains(&time_s)
    })
}

/// Whether a candidate reaches anything that is compared. Noises are of one sensor.
fn is_searched(model: &Model, candidate: &Candidate) -> bool {
    let is_group = matches!(candidate.target, Target::Group { .. });
    let has_shape = match &candidate.search {
        Search::Linear(signature) => !signature.columns.is_empty(),
        Search::Grid { parameters, .. } => parameters.iter().all(|parameter| !parameter.grid.is_empty()),
        Search::Onset(_) | Search::Frequency => are_apart(model, candidate),
        Search::Noise(_) => !is_group,
        Search::Readings(_) => candidate.is_jump(),
    };
    has_shape && sensors_of(candidate).iter().any(|&sensor| model.source_of(sensor, candidate.port).is_some())
}

/// Whether no two of a candidate's sensors are compared with each other: what is in common to those is in the motion.
fn are_apart(model: &Model, candidate: &Candidate) -> bool {
    let mut blocks: Vec<Option<usize>> =
        sensors_of(candidate).into_iter().map(|sensor| model.block_of(sensor)).collect();
    let sensors = blocks.len();
    blocks.sort_unstable();
    blocks.dedup();
    blocks.len() == sensors && (sensors == 1 || !blocks.contains(&None))
}

/// As many effects as a record is expected to have, shared among all pairs of a place and an effect, and of each among its variants. What
/// several sensors have in common is as probable as that of one of them; what it costs that others have it stands beside it.
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
    for candidate in candidates.iter().filter(|it| !it.is_in_common()) {
        *variants.entry(pair(candidate)).or_default() += 1.0;
    }
    let pairs = variants.len().max(1) as f64;
    let of = |candidate: &Candidate| {
        let variants = variants.get(&pair(candidate)).copied().unwrap_or(1.0);
        (config.expected_effects / (pairs * variants)).ln()
    };
    candidates.iter().map(of).collect()
}
