//! The likeliest history of a mean that jumps on and off, over all rows.
use super::OverRows;
use crate::catalogue::{Column, Port};
use crate::jump::{Decoded, Decoder, Place, RATES};

impl Decoded {
    /// ln of the likelihood of the history itself over that without jumps, its height at its best.
    pub fn gain_of_history(&self, rows: &OverRows<'_>, place: &Place) -> Option<f64> {
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
        (energy > 0.0).then(|| 0.5 * score * score / energy)
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
