//! Information of a step or a ramp that begins at a row of a block: under full trust at every row, and by band at some rows.
//!
//! It depends on what the record is whitened by and on nothing that is described, so that a block's sums keep it.
use super::onset_energy::{SHAPES, Shapes, onset_energies};
use super::scan::interpolated;
use super::sums::Sums;
use crate::catalogue::{Column, OnsetShape, Port};
use crate::config::Config;
use crate::nominal::Block;

/// Information of a shape by the row at which it begins.
pub struct Onsets {
    /// Rows at which it may begin.
    pub rows: Vec<usize>,
    /// Information of all bands together, of each of those rows.
    whole: Vec<f64>,
    /// The same by band, of some of them.
    by_band: Vec<(usize, Vec<f64>)>,
}

impl Onsets {
    /// That of a shape at a port of a sensor of a block; none where it does not reach the channels.
    pub fn new(
        sums: &Sums,
        block: &Block,
        sensor: usize,
        port: Port,
        shape: OnsetShape,
        config: &Config,
    ) -> Option<Self> {
        let rows = rows(block, config.least_segment);
        let shapes = Shapes { weights: vec![1.0], ..block.begins(sensor, port)? };
        let mut energies: [Vec<f64>; SHAPES] = onset_energies(&sums.filter, &[shapes]).pop()?;
        let at_every_row = std::mem::take(&mut energies[usize::from(shape == OnsetShape::Ramp)]);
        let whole = rows.iter().map(|&row| at_every_row[row]).collect();
        let by_band = |at: usize| {
            let value = |row: usize| match shape {
                OnsetShape::Step => f64::from(u8::from(row >= at)),
                OnsetShape::Ramp => row.saturating_sub(at) as f64,
            };
            let values: Vec<f64> = (0..block.rows()).map(value).collect();
            // The channels of a redundant block are of the sensors themselves.
            let bands = if block.is_redundant() {
                sums.energy_of(&values)
            } else {
                sums.energy_of(&block.project(&Column::on(sensor, values), port)?)
            };
            Some((at, bands?))
        };
        let by_band = knots(&rows, config.onset_knots).into_iter().filter_map(by_band).collect();
        Some(Self { rows, whole, by_band })
    }

    /// The information at every row where bands count as `weights` say: that of all bands, times what the weights make of it at some
    /// rows and between them.
    pub fn weighted(&self, weights: &[f64]) -> Vec<f64> {
        let ratio = |(row, bands): &(usize, Vec<f64>)| {
            let whole: f64 = bands.iter().sum();
            let weighted: f64 = bands.iter().zip(weights).map(|(band, weight)| band * weight).sum();
            (whole > 0.0).then(|| (*row, weighted / whole))
        };
        let ratios: Vec<(usize, f64)> = self.by_band.iter().filter_map(ratio).collect();
        self.rows.iter().zip(&self.whole).map(|(&row, whole)| whole * interpolated(&ratios, row)).collect()
    }
}

/// Rows where a shape may begin: with enough of those present on either side.
fn rows(block: &Block, least: usize) -> Vec<usize> {
    let present: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    let last = present.len().saturating_sub(least);
    present.get(least..last.max(least)).map(<[usize]>::to_vec).unwrap_or_default()
}

/// Rows among `rows`, closer to each other near the ends.
fn knots(rows: &[usize], count: usize) -> Vec<usize> {
    let last = rows.len().saturating_sub(1) as f64;
    let at = |k: usize| {
        let part = (k as f64 + 0.5) / count as f64;
        let depth = 0.5 * (1.0 - (std::f64::consts::PI * part).cos());
        rows.get((depth * last).round() as usize).copied()
    };
    let mut knots: Vec<usize> = (0..count).filter_map(at).collect();
    knots.dedup();
    knots
}
