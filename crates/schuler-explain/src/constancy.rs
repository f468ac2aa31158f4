//! Whether a noise that was found is the same at all times.
//!
//! What is in no catalogue, an oscillation whose frequency moves or a burst, is described best by some change of the noise. At the maximum of
//! the likelihood its derivatives by the parameters, row by row, sum to nothing; their cumulative sums wander as a Brownian bridge where the
//! parameters are the same all along, and far where they are not. `[Nyblom, J. Am. Stat. Assoc. 84, 1989, 223; Hansen, J. Policy Modeling 14,
//! 1992, 517]`
use nalgebra::{DMatrix, DVector};

use crate::noise_fit::{SourceKnob, left_by, logs_of, with_logs};
use crate::state::{Accepted, Bench};
use crate::statistics::chi_squared_tail;
use crate::whiten::Filter;

/// Step of the derivatives, in logarithms.
const STEP: f64 = 0.05;
/// Rows with which nothing is said.
const FEW_ROWS: usize = 100;

/// p-value of a change of noise being the same at all times; `None` where nothing can be said.
pub fn constancy(bench: &Bench<'_>, change: &Accepted) -> Option<f64> {
    let model = bench.case.model;
    let index = model.blocks.iter().position(|block| block.sources.contains(&change.source))?;
    let (block, whitened) = (&model.blocks[index], bench.blocks[index].as_ref()?);
    let knobs: Vec<SourceKnob> = change.knobs.iter().map(|&knob| (change.source, knob)).collect();
    let left = left_by(&whitened.projected, &whitened.sums.solution().amplitudes);
    let logs = logs_of(&bench.noises, &knobs);
    let rows: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    if rows.len() < FEW_ROWS {
        return None;
    }
    // Half the square of the innovations of each row, with a parameter moved.
    let squares = |place: usize, by: f64| -> Option<Vec<f64>> {
        let mut moved = logs.clone();
        moved[place] += by;
        let filter = Filter::new(&block.space(&with_logs(&bench.noises, &knobs, &moved)), &block.present)?;
        let innovations = filter.whiten(&[&left.data]).swap_remove(0);
        let square = |row: usize| -> f64 {
            innovations.chunks_exact(block.rows()).map(|channel| 0.5 * channel[row].powi(2)).sum()
        };
        Some(rows.iter().map(|&row| square(row)).collect())
    };
    let slope = |place: usize| -> Option<Vec<f64>> {
        let (up, down) = (squares(place, STEP)?, squares(place, -STEP)?);
        Some(up.iter().zip(&down).map(|(up, down)| (down - up) / (2.0 * STEP)).collect())
    };
    p_of_slopes(&(0..knobs.len()).map(slope).collect::<Option<Vec<_>>>()?)
}

/// p-value of derivatives by each of some parameters, row by row, with the same mean all along.
fn p_of_slopes(slopes: &[Vec<f64>]) -> Option<f64> {
    let (size, rows) = (slopes.len(), slopes.first()?.len());
    let means: Vec<f64> = slopes.iter().map(|slopes| slopes.iter().sum::<f64>() / rows as f64).collect();
    let at = |row: usize| DVector::from_fn(size, |i, _| slopes[i][row] - means[i]);
    let variance = (0..rows).fold(DMatrix::zeros(size, size), |sum, row| sum + at(row) * at(row).transpose());
    let inverse = variance.cholesky()?.inverse();
    let mut sum = DVector::zeros(size);
    let mut statistic = 0.0;
    for row in 0..rows {
        sum += at(row);
        statistic += sum.dot(&(&inverse * &sum)) / rows as f64;
    }
    // The limit is Σ χ²(size) / (πk)², its tail that of the first times Π (1 − 1/k²)^(−size/2), from the second on.
    let tail = chi_squared_tail(std::f64::consts::PI.powi(2) * statistic, size);
    Some((2.0_f64.powf(0.5 * size as f64) * tail).min(1.0))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::p_of_slopes;

    /// Quantiles that Hansen (1992, table 1) and the Cramér–von Mises statistic have, by draws.
    #[test]
    fn p_values_are_uniform_where_nothing_moves() {
        let mut random = Pcg64::seed_from_u64(5);
        for size in [1, 3] {
            let mut below = [0; 2];
            for _ in 0..2000 {
                let mut drawn =
                    || -> Vec<f64> { (0..200).map(|_| StandardNormal.sample(&mut random)).collect() };
                let slopes: Vec<Vec<f64>> = (0..size).map(|_| drawn()).collect();
                let p = p_of_slopes(&slopes).unwrap();
                below[0] += usize::from(p < 0.05);
                below[1] += usize::from(p < 0.01);
            }
            // 100 ± 10 and 20 ± 4.5.
            assert!((60..150).contains(&below[0]) && (6..40).contains(&below[1]), "{size}: {below:?}");
        }
    }

    #[test]
    fn what_changes_sign_half_way_is_seen() {
        let mut random = Pcg64::seed_from_u64(6);
        let slopes: Vec<f64> = (0..2000)
            .map(|row| if row < 1000 { 0.3 } else { -0.3 } + { let n: f64 = StandardNormal.sample(&mut random); n })
            .collect();
        assert!(p_of_slopes(&[slopes]).unwrap() < 1e-6);
    }
}
