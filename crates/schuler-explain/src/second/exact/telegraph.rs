//! The likeliest history of a mean that jumps on and off, over all rows.
use super::OverRows;
use crate::catalogue::{Column, Port};
use crate::jump::{Decoded, Decoder, Place, RATES};

/// Rows before and after a row by which it is seen how loud it is there.
const AROUND: usize = 16;
/// Standard deviation of the median of n squares of normal numbers, over itself, times √n.
const OF_MEDIAN: f64 = 2.33;

impl Decoded {
    /// ln of the likelihood of the history itself over that without jumps, its height at its best: as it is, and where rows count as
    /// little as those around them are loud. A burst of noise is decoded as jumps, and is as loud without them.
    pub fn gains_of_history(&self, rows: &OverRows<'_>, place: &Place) -> Option<[f64; 2]> {
        let block = rows.bench.problem.model.blocks.get(place.block)?;
        let over_rows = rows.blocks.get(place.block)?.as_ref()?;
        let mut values: Vec<f64> = self.on.iter().map(|&on| f64::from(u8::from(on))).collect();
        if rows.has_regressors(place.block) {
            // The regressors have taken the mean away.
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            for value in &mut values {
                *value -= mean;
            }
        }
        let column = Column::on(place.sensor, values);
        let whitened = over_rows.filter.whiten(&[&*block.project(&column, Port::Output)?]).swap_remove(0);
        let innovations = &over_rows.innovations;
        let sums = |levels: &[f64]| {
            let rows = whitened.iter().zip(innovations).zip(levels);
            rows.fold([0.0; 2], |[energy, score], ((shape, innovation), level)| {
                [energy + shape * shape / level, score + shape * innovation / level]
            })
        };
        let [energy, score] = sums(&vec![1.0; whitened.len()]);
        let left = |(innovation, shape): (&f64, &f64)| innovation - score / energy * shape;
        let left: Vec<f64> = innovations.iter().zip(&whitened).map(left).collect();
        let [local_energy, local_score] = sums(&local_levels(&left, block.rows()));
        (energy > 0.0 && local_energy > 0.0)
            .then(|| [(score, energy), (local_score, local_energy)].map(|(s, e)| 0.5 * s * s / e))
    }

    /// How often it goes on, and off.
    pub fn switchings(&self) -> [usize; RATES] {
        [false, true].map(|from| self.on.windows(2).filter(|pair| pair[0] == from && pair[1] != from).count())
    }
}

/// Median squares of the innovations of each channel around each row, over that of all of its rows, where they are more than it by
/// what chance makes of so few.
fn local_levels(innovations: &[f64], rows: usize) -> Vec<f64> {
    let median = |values: &[f64]| {
        let mut squares: Vec<f64> = values.iter().map(|value| value * value).collect();
        let middle = squares.len() / 2;
        *squares.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let of_channel = |channel: &[f64]| {
        let all = median(channel).max(f64::MIN_POSITIVE);
        let around = |row: usize| {
            let (from, to) = (row.saturating_sub(AROUND), (row + AROUND + 1).min(channel.len()));
            let by_chance = 1.0 + 3.0 * OF_MEDIAN / ((to - from) as f64).sqrt();
            let level = median(&channel[from..to]) / all;
            if level > by_chance { level } else { 1.0 }
        };
        (0..channel.len()).map(around).collect::<Vec<f64>>()
    };
    innovations.chunks(rows.max(1)).flat_map(of_channel).collect()
}

/// The likeliest history of a place, unless it is none of jumps; `amplitude_of` is that of a history at its best.
pub fn history(
    rows: &OverRows<'_>,
    place: &Place,
    amplitude_of: &(dyn Fn(&Decoded) -> Option<f64> + Sync),
) -> Option<Decoded> {
    let block = rows.bench.problem.model.blocks.get(place.block)?;
    let over_rows = rows.blocks.get(place.block)?.as_ref()?;
    let unit = Column::on(place.sensor, vec![1.0; block.rows()]);
    let decoder = Decoder {
        filter: &over_rows.filter,
        remainder: &over_rows.innovations,
        shape: block.project(&unit, Port::Output)?.into_owned(),
        centred: rows.has_regressors(place.block),
        weights: over_rows.filter.weight_of_states(),
        channels: block.channels,
    };
    decoder.likeliest(place.part, block.step_s(), amplitude_of)
}
