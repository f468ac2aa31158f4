//! What a description leaves of every row: the state-space filter of each block, for the few descriptions that stand.
pub mod constancy;
pub mod decoder;
pub mod telegraph;

use nalgebra::DVector;
use rayon::prelude::*;

use crate::catalogue::Port;
use crate::evidence::fit::{Bench, Description, Placed};
use crate::evidence::late::late_columns;
use crate::nominal::{Block, Model};
use crate::whitening::filter::Filter;

/// A description over all rows.
pub struct OverRows<'r> {
    /// What it is a description of.
    pub bench: &'r Bench<'r>,
    /// The description.
    pub description: &'r Description,
    /// Amplitudes of the columns of each of its effects.
    pub amplitudes: Vec<Vec<f64>>,
    /// One a block of the model; none of one that is singular.
    pub blocks: Vec<Option<BlockRows>>,
}

/// A block over all rows, channel after channel.
pub struct BlockRows {
    /// Its filter.
    pub filter: Filter,
    /// Readings less their prediction and the constants that nobody knows, in the channels' units; NaN where missing.
    pub residual: Vec<f64>,
    /// What is left beside the effects, whitened; 0 where missing.
    pub innovations: Vec<f64>,
}

impl<'r> OverRows<'r> {
    /// Runs the filters of a description over all rows.
    pub fn new(bench: &'r Bench<'r>, description: &'r Description) -> Self {
        Self::of_model(bench.problem.model, bench, description)
    }

    /// The same over the rows of another model of the same blocks, of which the description knows a part.
    pub fn of_model(model: &Model, bench: &'r Bench<'r>, description: &'r Description) -> Self {
        let amplitudes = description.amplitudes_of_effects(bench);
        let of_block = |index: usize| {
            let block = &model.blocks[index];
            let residual = without_constants(bench, description, block);
            let filter = block.filter(&description.noises)?;
            let left = less_effects(model, block, &residual, description, &amplitudes);
            let innovations = filter.whiten(&[&left]).swap_remove(0);
            Some(BlockRows { filter, residual, innovations })
        };
        let blocks = (0..model.blocks.len()).into_par_iter().map(of_block).collect();
        Self { bench, description, amplitudes, blocks }
    }
}

impl OverRows<'_> {
    /// Whether a constant or an effect is fitted in a block.
    pub fn has_regressors(&self, index: usize) -> bool {
        self.description.described(self.bench).regressors.iter().any(|regressor| regressor.reaches(index))
    }

    /// Amplitudes in the order of the model's constants and of the effects' free ones.
    pub fn amplitudes_of_model(&self) -> DVector<f64> {
        let mut all = vec![0.0; self.bench.problem.model.constants.len()];
        for (&place, amplitude) in self.bench.constant_places.iter().zip(self.description.amplitudes.iter()) {
            all[place] = *amplitude;
        }
        for (placed, own) in self.description.placed.iter().zip(&self.amplitudes) {
            all.extend(own.iter().filter(|_| !placed.term.unit_amplitude));
        }
        DVector::from_vec(all)
    }
}

/// The residuals of a block less the constants that nobody knows.
pub fn without_constants(bench: &Bench<'_>, description: &Description, block: &Block) -> Vec<f64> {
    let mut data = block.data.clone();
    for (&place, amplitude) in bench.constant_places.iter().zip(description.amplitudes.iter()) {
        if let Some(values) = block.project(&bench.problem.model.constants[place], Port::Output) {
            data.iter_mut().zip(&*values).for_each(|(data, value)| *data -= amplitude * value);
        }
    }
    data
}

/// Residuals of a block less what the effects of a description add.
pub fn less_effects(
    model: &Model,
    block: &Block,
    residual: &[f64],
    description: &Description,
    amplitudes: &[Vec<f64>],
) -> Vec<f64> {
    let mut left = residual.to_vec();
    for (placed, own) in description.placed.iter().zip(amplitudes) {
        if let Some(values) = added(model, block, placed, own) {
            left.iter_mut().zip(values).for_each(|(left, value)| *left -= value);
        }
    }
    left
}

/// What an effect adds to the channels of a block.
pub fn added(model: &Model, block: &Block, placed: &Placed, amplitudes: &[f64]) -> Option<Vec<f64>> {
    let mut sum: Option<Vec<f64>> = None;
    let columns = late_columns(model, &placed.delays, &placed.term);
    for (column, amplitude) in columns.iter().zip(amplitudes) {
        let Some(values) = block.project(column, placed.term.port) else { continue };
        let sum = sum.get_or_insert_with(|| vec![0.0; values.len()]);
        sum.iter_mut().zip(&*values).for_each(|(sum, value)| *sum += amplitude * value);
    }
    sum
}
