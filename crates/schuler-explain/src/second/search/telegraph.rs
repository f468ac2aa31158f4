//! A mean that jumps on and off (a random telegraph), which has a likelihood of its own over all rows.
use std::sync::Arc;

use crate::jump::jumps;
use crate::second::evidence::fit::{Bench, Description, Placed};
use crate::second::evidence::regressor::regressors;
use crate::state::{self, Case};

/// The descriptions that have a telegraph beside what is described, fitted.
pub fn with_telegraph(bench: &Bench<'_>, description: &Description) -> Vec<Description> {
    let problem = bench.problem;
    let case = Case::new(problem.model, &problem.candidates, problem.time_s(), problem.watch);
    let terms: Vec<_> = description.placed.iter().map(|placed| placed.term.clone()).collect();
    let rows = state::Bench::new(&case, &terms, &description.noises);
    let with = |found: crate::search::Proposal| {
        // A history that is given gains more than all histories together; it costs the difference under whatever noise.
        let ln_spread = (found.evidence - found.gain).min(0.0);
        let term = found.term;
        let whitened = regressors(problem.model, &bench.sums, &term.columns, term.port);
        let touched: Vec<usize> = whitened.iter().flat_map(|it| &it.parts).map(|part| part.block).collect();
        let mut more = description.clone();
        more.placed.push(Placed { term, regressors: Arc::new(whitened), ln_spread });
        bench.fitted(&more, &touched)
    };
    jumps(&rows, &|_| true).into_iter().filter_map(with).collect()
}
