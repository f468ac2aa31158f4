//! What the search has computed of parts of descriptions: what is the same in a block promises the same there, whatever is described
//! elsewhere.
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, PoisonError};

use super::noises::Promised;
use crate::evidence::fit::{Bench, Description};

/// What is known.
#[derive(Default)]
pub struct Known {
    noises: Mutex<HashMap<u64, Noises>>,
    gains: Mutex<HashMap<(u64, usize), f64>>,
}

/// The changes of noise of a block.
#[derive(Clone)]
struct Noises {
    /// What each had to gain at least, nats.
    least_gain: f64,
    promised: Arc<Vec<Promised>>,
}

impl Known {
    /// The changes of noise that a block promises, all of those at least that gain so much.
    pub fn noises(
        &self,
        bench: &Bench<'_>,
        description: &Description,
        block: usize,
        least_gain: f64,
        compute: impl FnOnce() -> Arc<Vec<Promised>>,
    ) -> Arc<Vec<Promised>> {
        let key = state_of(bench, description, &[block]);
        let known = self.noises.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        if let Some(known) = known.filter(|known| known.least_gain <= least_gain) {
            return known.promised;
        }
        let promised = compute();
        let mut noises = self.noises.lock().unwrap_or_else(PoisonError::into_inner);
        noises.insert(key, Noises { least_gain, promised: Arc::clone(&promised) });
        promised
    }

    /// Whether a candidate was seen beside the same in these blocks to lose more than is worth a look.
    pub fn is_hopeless(
        &self,
        bench: &Bench<'_>,
        description: &Description,
        blocks: &[usize],
        candidate: usize,
    ) -> bool {
        self.loses(bench, (state_of(bench, description, blocks), candidate))
    }

    fn loses(&self, bench: &Bench<'_>, key: (u64, usize)) -> bool {
        let known = self.gains.lock().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        known.is_some_and(|gain| gain < bench.problem.config.least_promised)
    }

    /// A description with a candidate more, unless it was seen beside the same in these blocks to lose more than is worth a look.
    pub fn if_worth(
        &self,
        bench: &Bench<'_>,
        description: &Description,
        blocks: &[usize],
        candidate: usize,
        fit: impl FnOnce() -> Option<Description>,
    ) -> Option<Description> {
        let key = (state_of(bench, description, blocks), candidate);
        if self.loses(bench, key) {
            return None;
        }
        let fitted = fit();
        let gain = fitted.as_ref().map_or(f64::NEG_INFINITY, |it| it.ln_evidence - description.ln_evidence);
        let mut gains = self.gains.lock().unwrap_or_else(PoisonError::into_inner);
        // A line or a step has many places.
        let best = gains.entry(key).or_insert(f64::NEG_INFINITY);
        *best = best.max(gain);
        fitted
    }
}

/// A number by which what is described in some blocks is known.
fn state_of(bench: &Bench<'_>, description: &Description, blocks: &[usize]) -> u64 {
    let mut hasher = DefaultHasher::new();
    blocks.hash(&mut hasher);
    for placed in &description.placed {
        if placed.regressors.iter().any(|regressor| blocks.iter().any(|&block| regressor.reaches(block))) {
            placed.term.candidate.hash(&mut hasher);
            placed.term.nonlinear.iter().for_each(|value| value.to_bits().hash(&mut hasher));
        }
    }
    for &block in blocks {
        for &source in &bench.problem.model.blocks[block].sources {
            // Noises are numbers, which have no hash of their own.
            format!("{:?}", description.noises[source]).hash(&mut hasher);
        }
        description.blocks[block].as_ref().map(|fit| fit.nu.to_bits()).hash(&mut hasher);
        description.free_in(bench.problem, block).len().hash(&mut hasher);
    }
    hasher.finish()
}
