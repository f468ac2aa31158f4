//! Whether a noise that was found is the same at all times.
//!
//! What is in no catalogue, an oscillation whose frequency moves or a burst, is described best by some change of the noise. At the maximum of
//! the likelihood its derivatives by the parameters, row by row, sum to nothing; their cumulative sums wander as a Brownian bridge where the
//! parameters are the same all along, and far where they are not. `[Nyblom, J. Am. Stat. Assoc. 84, 1989, 223; Hansen, J. Policy Modeling 14,
//! 1992, 517]`
//!
//! The bridge's time is what was told of the parameters so far, as rows tell more of them where the white level is low.
use crate::noise_fit::{STEP, SourceKnob, left_by, logs_of, with_logs};
use crate::second::exact::constancy::p_of_slopes;
use crate::state::{Accepted, Bench};
use crate::whiten::Filter;

/// Fewest rows of which something is said.
const FEWEST_ROWS: usize = 100;

/// p-value of a change of the noise of a source of a block being the same at all times; `None` where nothing can be said.
pub fn constancy(bench: &Bench<'_>, block: usize, change: &Accepted) -> Option<f64> {
    let (block, whitened) = (&bench.case.model.blocks[block], bench.blocks[block].as_ref()?);
    let knobs: Vec<SourceKnob> = change.knobs.iter().map(|&knob| (change.source, knob)).collect();
    let left = left_by(&whitened.projected, &whitened.sums.solution().amplitudes);
    let logs = logs_of(&bench.noises, &knobs);
    let rows: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    if rows.len() < FEWEST_ROWS {
        return None;
    }
    // The log-likelihood of each row, up to a constant, with a parameter moved.
    let told = |place: usize, by: f64| -> Option<Vec<f64>> {
        let mut moved = logs.clone();
        moved[place] += by;
        let filter = Filter::new(&block.space(&with_logs(&bench.noises, &knobs, &moved)), &block.present)?;
        let innovations = filter.whiten(&[&left.data]).swap_remove(0);
        let of_row = |&row: &usize| -> Option<f64> {
            let (_, whitening) = filter.gain_and_whitening(row)?;
            let levels = (0..block.channels).map(|c| whitening[c * block.channels + c].ln()).sum::<f64>();
            let squares = innovations.chunks_exact(block.rows()).map(|channel| channel[row].powi(2));
            Some(levels - 0.5 * squares.sum::<f64>())
        };
        rows.iter().map(of_row).collect()
    };
    let slope = |place: usize| -> Option<Vec<f64>> {
        let (up, down) = (told(place, STEP)?, told(place, -STEP)?);
        Some(up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * STEP)).collect())
    };
    p_of_slopes(&(0..knobs.len()).map(slope).collect::<Option<Vec<_>>>()?)
}
