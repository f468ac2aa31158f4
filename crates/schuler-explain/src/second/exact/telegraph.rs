//! The likeliest history of a mean that jumps on and off, over all rows.
use rayon::prelude::*;
use schuler_recording::case::Markov;

use super::OverRows;
use crate::catalogue::{Column, Port};
use crate::jump::{Decoded, Decoder, FOLLOWED, ITERATIONS, RATES, Telegraph, comes_and_goes, rates, starts};

impl Decoded {
    /// Whether it is on, 1 or 0, by row.
    pub fn values(&self) -> Vec<f64> {
        self.on.iter().map(|&on| f64::from(u8::from(on))).collect()
    }

    /// ln of the likelihood of the history itself over that without jumps, its height at its best.
    pub fn gain_of_history(&self, rows: &OverRows<'_>, index: usize, sensor: usize) -> Option<f64> {
        let block = rows.bench.problem.model.blocks.get(index)?;
        let over_rows = rows.blocks.get(index)?.as_ref()?;
        let mut values = self.values();
        if rows.has_regressors(index) {
            // The regressors have taken the mean away.
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            for value in &mut values {
                *value -= mean;
            }
        }
        let column = Column::on(sensor, values);
        let whitened = over_rows.filter.whiten(&[&*block.project(&column, Port::Output)?]).swap_remove(0);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (energy, score) = (dot(&whitened, &whitened), dot(&whitened, &over_rows.innovations));
        (energy > 0.0).then(|| 0.5 * score * score / energy)
    }

    /// How often it goes on, and off.
    pub fn switchings(&self) -> [usize; RATES] {
        [false, true].map(|from| self.on.windows(2).filter(|pair| pair[0] == from && pair[1] != from).count())
    }
}

/// The likeliest history of the mean of a sensor of a block, unless it is none of jumps, from the autocorrelation of a Markov `part` on;
/// `amplitude_of` is that of a history at its best.
pub fn history(
    rows: &OverRows<'_>,
    (index, sensor): (usize, usize),
    part: Markov,
    amplitude_of: &(dyn Fn(&Decoded) -> Option<f64> + Sync),
) -> Option<Decoded> {
    let block = rows.bench.problem.model.blocks.get(index)?;
    let over_rows = rows.blocks.get(index)?.as_ref()?;
    let unit = Column::on(sensor, vec![1.0; block.rows()]);
    let decoder = Decoder {
        filter: &over_rows.filter,
        remainder: &over_rows.innovations,
        shape: block.project(&unit, Port::Output)?.into_owned(),
        centred: rows.has_regressors(index),
        weights: over_rows.filter.weight_of_states(),
        channels: block.channels,
    };
    let starts = starts(part, block.step_s()).into_par_iter();
    let mut found: Vec<Decoded> = starts.filter_map(|start| decoder.decode(start)).collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found.truncate(FOLLOWED);
    found.par_iter_mut().for_each(|decoded| {
        for _ in 0..ITERATIONS {
            let Some(amplitude) = amplitude_of(decoded) else { break };
            let [on, off] = rates(&decoded.on);
            let Some(next) = decoder.decode(Telegraph { amplitude, on, off }) else { break };
            if next.gain <= decoded.gain {
                break;
            }
            *decoded = next;
        }
    });
    let best = found.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    comes_and_goes(&best.on).then_some(best)
}
