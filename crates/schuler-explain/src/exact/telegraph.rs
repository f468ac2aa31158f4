//! The likeliest history of a mean that jumps on and off, over all rows.
use std::sync::Arc;

use schuler_recording::case::Markov;

use super::OverRows;
use super::decoder::{Decoded, Decoder, RATES, stays};
use crate::catalogue::{Column, Port};
use crate::description::Term;
use crate::inputs::series::Series;
use crate::numeric::statistics::median;

/// Rows before and after a switching by which it is seen how loud it is there.
const AROUND: usize = 16;
/// Standard deviation of the median of n squares of normal numbers, over itself, times √n.
const OF_MEDIAN: f64 = 2.33;

/// Where jumps are sought.
pub struct Place {
    /// The candidate.
    pub candidate: usize,
    /// The sensor.
    pub sensor: usize,
    /// The block that it is in.
    pub block: usize,
    /// A further Markov part.
    pub part: Markov,
    /// What that gains.
    pub gain: f64,
}

/// The places that are looked at. A sensor of a redundant set is seen in the others, which have their turn when it is described.
pub fn best_of_blocks(mut places: Vec<Place>) -> Vec<Place> {
    places.sort_by(|a, b| a.block.cmp(&b.block).then(b.gain.total_cmp(&a.gain)));
    places.dedup_by_key(|place| place.block);
    places
}

impl Place {
    /// The term of a history.
    pub fn term(&self, on: &[bool]) -> Term {
        Term {
            candidate: self.candidate,
            nonlinear: Vec::new(),
            columns: Arc::new(vec![Column::on(
                self.sensor,
                on.iter().map(|&on| f64::from(u8::from(on))).collect::<Series>(),
            )]),
            port: Port::Output,
            unit_amplitude: false,
            of_the_motion: false,
            delay_s: None,
        }
    }
}

/// How long a term stays on and off on average, s: mean and standard deviation, of stays that are distributed exponentially.
pub fn mean_stays(term: &Term, step_s: f64) -> [(&'static str, f64, f64); RATES] {
    let column = term.columns.first().and_then(|column| column.parts.first());
    let on: Vec<bool> = column.iter().flat_map(|(_, values)| &**values).map(|&value| value > 0.5).collect();
    [("on_s", true), ("off_s", false)].map(|(name, state)| {
        let number = (stays(&on, state).count() as f64).max(1.0);
        let mean_s = stays(&on, state).sum::<usize>() as f64 * step_s / number;
        (name, mean_s, mean_s / number.sqrt())
    })
}

impl Decoded {
    /// ln of the likelihood of the history itself over that without jumps, its height at its best: as it is, and
    /// divided by how much louder it is around the switchings than elsewhere. A burst of noise is decoded as jumps, and stays loud
    /// beside them.
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
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (energy, score) = (dot(&whitened, &whitened), dot(&whitened, &over_rows.innovations));
        if energy <= 0.0 {
            return None;
        }
        let left = |(innovation, shape): (&f64, &f64)| innovation - score / energy * shape;
        let left: Vec<f64> = over_rows.innovations.iter().zip(&whitened).map(left).collect();
        let gain = 0.5 * score * score / energy;
        Some([gain, gain / self.level_around(&left)])
    }

    /// Median square of innovations around the switchings over that of all rows, where it is more by what chance does not make;
    /// otherwise 1.
    fn level_around(&self, innovations: &[f64]) -> f64 {
        let rows = self.on.len();
        let mut is_around = vec![false; rows];
        for row in (1..rows).filter(|&row| self.on[row] != self.on[row - 1]) {
            is_around[row.saturating_sub(AROUND)..(row + AROUND).min(rows)].fill(true);
        }
        let squares = |all: bool| -> Vec<f64> {
            let rows = innovations.iter().enumerate().filter(|(place, _)| all || is_around[place % rows]);
            rows.map(|(_, value)| value * value).collect()
        };
        let (mut around, mut all) = (squares(false), squares(true));
        let by_chance = 1.0 + 3.0 * OF_MEDIAN / (around.len().max(1) as f64).sqrt();
        let level = median(&mut around) / median(&mut all);
        if level > by_chance { level } else { 1.0 }
    }

    /// How often it goes on, and off.
    pub fn switchings(&self) -> [usize; RATES] {
        [false, true].map(|from| self.on.windows(2).filter(|pair| pair[0] == from && pair[1] != from).count())
    }
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
