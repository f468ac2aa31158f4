//! Whether a noise that was found is the same at all times.
//!
//! What is in no catalogue, an oscillation whose frequency moves or a burst, is described best by some change of the noise. At the maximum of
//! the likelihood its derivatives by the parameters, row by row, sum to nothing; their cumulative sums wander as a Brownian bridge where the
//! parameters are the same all along, and far where they are not. `[Nyblom, J. Am. Stat. Assoc. 84, 1989, 223; Hansen, J. Policy Modeling 14,
//! 1992, 517]`
//!
//! The bridge's time is what was told of the parameters so far, as rows tell more of them where the white level is low.
use nalgebra::{DMatrix, DVector};

use super::{OverRows, less_effects};
use crate::evidence::fit::Change;
use crate::noise::Noise;
use crate::numeric::statistics::chi_squared_tail;
use crate::whitening::filter::Filter;

/// Fewest rows of which something is said.
const FEWEST_ROWS: usize = 100;

/// Difference of the logarithm of a parameter by which derivatives are taken.
const STEP: f64 = 0.05;

/// p-value of a change of the noise of a source of a block being the same at all times; `None` where nothing can be said.
pub fn constancy(over_rows: &OverRows<'_>, index: usize, change: &Change) -> Option<f64> {
    let description = over_rows.description;
    let model = over_rows.bench.problem.model;
    let (block, here) = (&model.blocks[index], over_rows.blocks[index].as_ref()?);
    let left = less_effects(model, block, &here.residual, description, &over_rows.amplitudes);
    let rows: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
    if rows.len() < FEWEST_ROWS {
        return None;
    }
    // The log-likelihood of each row, up to a constant, with a parameter moved.
    let told = |place: usize, by: f64| -> Option<Vec<f64>> {
        let mut noises: Vec<Noise> = description.noises.clone();
        let (noise, knob) = (&mut noises[change.source], change.knobs[place]);
        noise.set(knob, noise.get(knob) * by.exp());
        let filter = Filter::new(&block.space(&noises), &block.present)?;
        let innovations = filter.whiten(&[&left]).swap_remove(0);
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
    p_of_slopes(&(0..change.knobs.len()).map(slope).collect::<Option<Vec<_>>>()?)
}

/// p-value of derivatives by each of some parameters, row by row, having the same mean all along.
pub fn p_of_slopes(slopes: &[Vec<f64>]) -> Option<f64> {
    let (size, rows) = (slopes.len(), slopes.first()?.len());
    let at = |row: usize| DVector::from_fn(size, |i, _| slopes[i][row]);
    let mut total = DVector::zeros(size);
    let mut information = DMatrix::zeros(size, size);
    for own in (0..rows).map(at) {
        information += &own * own.transpose();
        total += own;
    }
    let inverse = information.cholesky()?.inverse();
    let (mut time, mut sum) = (0.0, DVector::zeros(size));
    let mut statistic = 0.0;
    for own in (0..rows).map(at) {
        let step = own.dot(&(&inverse * &own)) / size as f64;
        time += step;
        sum += own;
        let bridge = &sum - &total * time;
        statistic += step * bridge.dot(&(&inverse * &bridge));
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

    /// One parameter and three, of which all rows tell as much or those of the first half ten times as much.
    #[test]
    fn p_values_are_uniform_where_nothing_moves() {
        let mut random = Pcg64::seed_from_u64(5);
        for (size, louder) in [(1, 1.0), (3, 1.0), (1, 10.0), (3, 10.0)] {
            let mut below = [0; 2];
            for _ in 0..2000 {
                let mut drawn = || -> Vec<f64> {
                    let value = |row: usize| {
                        let normal: f64 = StandardNormal.sample(&mut random);
                        normal * if row < 200 { louder } else { 1.0 }
                    };
                    (0..400).map(value).collect()
                };
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
        let slope = |row: usize| {
            let noise: f64 = StandardNormal.sample(&mut random);
            noise + if row < 1000 { 0.3 } else { -0.3 }
        };
        assert!(p_of_slopes(&[(0..2000).map(slope).collect()]).unwrap() < 1e-6);
    }
}
