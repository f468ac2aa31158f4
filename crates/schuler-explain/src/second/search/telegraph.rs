//! A mean that jumps on and off (a random telegraph), which has a likelihood of its own over all rows.
use std::sync::Arc;

use crate::jump::jumps;
use crate::second::evidence::fit::{Bench, Description, Placed};
use crate::second::evidence::regressor::regressors;
use crate::state::{self, Case};

/// The descriptions that have a telegraph beside what is described, fitted. The evidence is that of the telegraph's marginal likelihood
/// over all histories: one history that is given would gain more.
pub fn with_telegraph(bench: &Bench<'_>, description: &Description) -> Vec<Description> {
    let problem = bench.problem;
    let case = Case::new(problem.model, &problem.candidates, problem.time_s(), problem.watch);
    let terms: Vec<_> = description.placed.iter().map(|placed| placed.term.clone()).collect();
    let rows = state::Bench::new(&case, &terms, &description.noises);
    let with = |found: crate::search::Proposal| {
        let (term, evidence) = (found.term, found.evidence);
        let candidate = term.candidate;
        let whitened = regressors(problem.model, &bench.sums, &term.columns, term.port);
        let touched: Vec<usize> = whitened.iter().flat_map(|it| &it.parts).map(|part| part.block).collect();
        let mut more = description.clone();
        more.placed.push(Placed { term, regressors: Arc::new(whitened), ln_spread: 0.0 });
        let mut fitted = bench.fitted(&more, &touched)?;
        let ln_evidence = description.ln_evidence + evidence + problem.ln_prior[candidate];
        if let Some(placed) = fitted.placed.last_mut() {
            placed.ln_spread = (ln_evidence - fitted.ln_evidence).min(0.0);
            fitted.ln_evidence += placed.ln_spread;
        }
        Some(fitted)
    };
    jumps(&rows, &|_| true).into_iter().filter_map(with).collect()
}
