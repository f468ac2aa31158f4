//! How much work a search may do, so that it ends whatever a record holds.
//!
//! A round of the search fits the noise again beside each item and each of the best proposals, so that a round costs more with every
//! item that was found, and in a redundant set, whose noises are all fitted together, with every noise parameter as well. Work is
//! counted in values that run through a filter, times one and the states of the filter. It is counted before it is done, and as if nothing
//! were remembered from before: what is remembered depends on which thread came first, what is found must not. What is not within
//! the budget is not begun.
use crate::description::{Term, places};
use crate::nominal::Model;
use crate::state::{Case, State};

/// Work that any search may do; a core does some 10⁷ of it a second.
const LEAST: f64 = 1.5e9;
/// Work for each value of the record, so that a long one may have as many rounds as a short one.
const FOR_A_VALUE: f64 = 1.5e4;
/// Fits of a round beside those of the items: the proposals and changes of noise that are judged with all noises fitted.
const FITS_OF_A_ROUND: usize = 20;

/// Work that may still be done.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    left: f64,
    /// Whether something was not done for want of it.
    pub exceeded: bool,
}

impl Budget {
    /// That of a search in a record.
    pub fn new(model: &Model) -> Self {
        let values: usize = model.blocks.iter().map(|block| block.channels * block.rows()).sum();
        Self { left: LEAST + FOR_A_VALUE * values as f64, exceeded: false }
    }

    /// An equal share of what is left.
    #[must_use]
    pub fn shared_among(&self, number: usize) -> Self {
        Self { left: self.left / number.max(1) as f64, exceeded: false }
    }

    /// Sets a part of it aside for what comes later.
    #[must_use]
    pub fn set_aside(&mut self, part: f64) -> Self {
        let aside = part * self.left;
        self.left -= aside;
        Self { left: aside, exceeded: false }
    }

    /// This and what another leaves.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self { left: self.left + other.left, exceeded: self.exceeded || other.exceeded }
    }

    /// Takes some work off, unless it is more than what is left.
    pub fn affords(&mut self, work: f64) -> bool {
        let affords = work <= self.left;
        if affords {
            self.left -= work;
        }
        self.exceeded |= !affords;
        affords
    }
}

/// Work of a round in which the given blocks are to be described anew, from a description.
pub fn of_round(case: &Case<'_>, state: &State, blocks: &[usize]) -> f64 {
    let of_block = |&block: &usize| {
        let (fit, items) = of_fit(case, state, block);
        fit * (items + FITS_OF_A_ROUND) as f64
    };
    blocks.iter().map(of_block).sum()
}

/// Work of seeking all ways to describe an item, in the given blocks.
pub fn of_item(case: &Case<'_>, state: &State, blocks: &[usize]) -> f64 {
    blocks.iter().map(|&block| of_fit(case, state, block).0 * FITS_OF_A_ROUND as f64).sum()
}

/// Work of fitting the noises of a block: data and regressors, and two runs for each parameter; and the number of its items.
fn of_fit(case: &Case<'_>, state: &State, index: usize) -> (f64, usize) {
    let model = case.model;
    let block = &model.blocks[index];
    let of_source = |source: &usize| state.noises[*source].states(model.step_s).len();
    let states: usize = block.sources.iter().map(of_source).sum();
    let values = (block.rows() * block.channels) as f64;
    let runs = 1 + places(model, index, &state.terms).len() + 2 * state.free_in(model, index).len();
    let reaches = |term: &&Term| term.columns.iter().any(|column| block.is_reached(column, term.port));
    let changes = state.changes.iter().filter(|change| block.sources.contains(&change.source)).count();
    let items = state.terms.iter().filter(reaches).count() + changes;
    (values * (1 + states) as f64 * runs as f64, items)
}

#[cfg(test)]
mod tests {
    use super::Budget;

    #[test]
    fn what_is_not_within_the_budget_is_not_begun() {
        let mut budget = Budget { left: 10.0, exceeded: false };
        assert!(budget.affords(6.0) && !budget.exceeded);
        let mut share = budget.shared_among(2);
        assert!(share.affords(2.0) && !share.affords(0.5) && share.exceeded);
        assert!(!budget.affords(5.0) && budget.exceeded);
        // What is less still fits in.
        assert!(budget.affords(4.0));
        let mut budget = Budget { left: 10.0, exceeded: false };
        let aside = budget.set_aside(0.25);
        assert!(budget.affords(7.5) && !budget.affords(0.1));
        assert!(budget.with(aside).affords(2.5));
    }
}
