//! What a signature adds to the channels of the blocks.
use std::borrow::Cow;

use crate::bands::sums::{SeriesId, Sums};
use crate::catalogue::{Column, Port};
use crate::nominal::{Block, Model};

/// A series that enters the channels of a block at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// The block.
    pub block: usize,
    /// The place of the sensor among those of a redundant block; 0 elsewhere.
    pub place: usize,
    /// The series.
    pub series: SeriesId,
}

/// A column of a signature, whitened: what one amplitude multiplies.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Regressor {
    /// Its parts.
    pub parts: Vec<Part>,
}

impl Regressor {
    /// Whether it adds anything to a block.
    pub fn reaches(&self, block: usize) -> bool {
        self.parts.iter().any(|part| part.block == block)
    }
}

/// The regressors of columns that enter at a port.
pub fn regressors(model: &Model, sums: &[Option<Sums>], columns: &[Column], port: Port) -> Vec<Regressor> {
    let mut regressors = vec![Regressor::default(); columns.len()];
    for (index, (block, sums)) in model.blocks.iter().zip(sums).enumerate() {
        let Some(sums) = sums else { continue };
        let mut entering: Vec<(usize, usize, Cow<'_, [f64]>)> = Vec::new();
        for (number, column) in columns.iter().enumerate() {
            let series = entering_at(block, column, port);
            entering.extend(series.into_iter().map(|(place, values)| (number, place, values)));
        }
        let values: Vec<&[f64]> = entering.iter().map(|(.., values)| &**values).collect();
        let ids = sums.insert(&values);
        for ((number, place, _), series) in entering.iter().zip(ids) {
            let part = series.map(|series| Part { block: index, place: *place, series });
            regressors[*number].parts.extend(part);
        }
    }
    regressors
}

/// The series of a column that enter a block, with the places where they do.
fn entering_at<'c>(block: &Block, column: &'c Column, port: Port) -> Vec<(usize, Cow<'c, [f64]>)> {
    if !block.is_redundant() {
        return block.project(column, port).map(|values| (0, values)).into_iter().collect();
    }
    let place = |sensor: usize| block.sensors.iter().position(|&own| own == sensor);
    (column.parts.iter())
        .filter(|_| port == Port::Output)
        .filter_map(|(sensor, values)| Some((place(*sensor)?, finite(values))))
        .collect()
}

/// The values, 0 where they are not known.
fn finite(values: &[f64]) -> Cow<'_, [f64]> {
    if values.iter().all(|value| value.is_finite()) {
        Cow::Borrowed(values)
    } else {
        values.iter().map(|value| if value.is_finite() { *value } else { 0.0 }).collect()
    }
}
