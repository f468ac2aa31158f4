//! Energies of the whitened responses to a shape that begins at any row, all of them from one pass backwards.
//!
//! A shape that begins at a row is the output w·cᵀs of a small model, s ← F s, that stands at s₀ there: s is a ramp and its slope, a step
//! being a ramp without slope from 1 on, and in a Schuler loop the two states of the loop come before these. With the filter's state x, which is 0
//! there, the energy of what is whitened from a row on is a square of (x, s) whose parts follow from those of the row after,
//! Ψ = Φ(1 − KH):
//!
//! | over | of x and x, X | of x and s, Y | of s and s, Z |
//! | --- | --- | --- | --- |
//! | a row | GᵀG + ΨᵀXΨ | (ΨᵀXb − Gᵀd) cᵀ + ΨᵀYF | (dᵀd + bᵀXb) c cᵀ + c bᵀYF + (c bᵀYF)ᵀ + FᵀZF |
//! | a missing row | ΦᵀXΦ | ΦᵀYF | FᵀZF |
//!
//! with G = WH, d = Ww, b = ΦKw: s₀ᵀZs₀ is the energy. Nothing in it is approximate: neither missing rows, nor the gains of a
//! filter that has not settled, nor a change of the white level.
use nalgebra::{DMatrix, DVector};

use crate::whitening::filter::Filter;

/// Most states of the model of a shape: two of a loop, a ramp and its slope.
pub const MOST: usize = 4;
/// Change of X from row to row, relative to its diagonal, below which it has settled.
const SETTLED: f64 = 1e-14;

type Square = [[f64; MOST]; MOST];

/// Number of shapes: a step and a ramp.
pub const SHAPES: usize = 2;

/// A step and a ramp that begin at a row.
#[derive(Clone, Debug)]
pub struct Shapes {
    /// w: what they add to each channel.
    pub weights: Vec<f64>,
    /// F; of fewer states the others are 0.
    pub transition: Square,
    /// c.
    pub seen: [f64; MOST],
    /// s₀ of the step and of the ramp.
    pub starts: [[f64; MOST]; SHAPES],
}

/// What a gain makes of a row: Ψ, and, where it is present, G and for each shape b and d.
struct Gained {
    closed: DMatrix<f64>,
    seen: Option<DMatrix<f64>>,
    of_shapes: Vec<(DVector<f64>, DVector<f64>)>,
}

impl Gained {
    fn new(
        filter: &Filter,
        [transition, output]: [&DMatrix<f64>; 2],
        gains: Option<(&[f64], &[f64])>,
        shapes: &[Shapes],
    ) -> Self {
        let Some((gain, whitening)) = gains else {
            return Self { closed: transition.clone(), seen: None, of_shapes: Vec::new() };
        };
        let (n, m) = (filter.states(), filter.channels());
        let gain = transition * DMatrix::from_row_slice(n, m, gain);
        let whitening = DMatrix::from_row_slice(m, m, whitening);
        let of = |shape: &Shapes| {
            let weights = DVector::from_column_slice(&shape.weights);
            (&gain * &weights, &whitening * &weights)
        };
        Self {
            closed: transition - &gain * output,
            seen: Some(&whitening * output),
            of_shapes: shapes.iter().map(of).collect(),
        }
    }
}

/// What the pass has come to of a shape: Y (a row for each state of the filter) and Z.
#[derive(Clone)]
struct Sums {
    mixed: Vec<[f64; MOST]>,
    own: Square,
}

/// Energies of the whitened responses to a step and to a ramp that begin at a row, by row, of each place where they enter.
pub fn onset_energies(filter: &Filter, shapes: &[Shapes]) -> Vec<[Vec<f64>; SHAPES]> {
    let (rows, n) = (filter.rows(), filter.states());
    let (transition, output) = filter.transition_and_output();
    let mut energies = vec![[(); SHAPES].map(|()| vec![0.0; rows]); shapes.len()];
    let mut sums = vec![Sums { mixed: vec![[0.0; MOST]; n], own: Square::default() }; shapes.len()];
    let mut states = DMatrix::<f64>::zeros(n, n);
    let mut settled = false;
    // Gains of the row after, and for each shape ΨᵀXb − Gᵀd and dᵀd + bᵀXb with them.
    let mut last = None;
    let mut gained = Gained::new(filter, [&transition, &output], None, shapes);
    let mut added: Vec<(DVector<f64>, f64)> = Vec::new();
    for row in (0..rows).rev() {
        let gains = filter.gain_and_whitening(row);
        if last != Some(gains) {
            gained = Gained::new(filter, [&transition, &output], gains, shapes);
            (last, settled) = (Some(gains), false);
        }
        if !settled {
            let turned = gained.closed.tr_mul(&states);
            let of = |(along, whitened): &(DVector<f64>, DVector<f64>)| {
                let seen =
                    gained.seen.as_ref().map_or_else(|| DVector::zeros(n), |seen| seen.tr_mul(whitened));
                (&turned * along - seen, whitened.norm_squared() + along.dot(&(&states * along)))
            };
            added = gained.of_shapes.iter().map(of).collect();
            let mut next = turned * &gained.closed;
            if let Some(seen) = &gained.seen {
                next += seen.tr_mul(seen);
            }
            settled = has_settled(&states, &next);
            states = next;
        }
        for (number, (sums, shape)) in sums.iter_mut().zip(shapes).enumerate() {
            // YF, which c bᵀYF and ΨᵀYF share.
            let moved: Vec<[f64; MOST]> =
                sums.mixed.iter().map(|row| times(row, &shape.transition)).collect();
            sums.own = framed(&sums.own, &shape.transition);
            for (i, mixed) in sums.mixed.iter_mut().enumerate() {
                *mixed = [0.0; MOST];
                for (moved, closed) in moved.iter().zip(gained.closed.column(i).iter()) {
                    for q in 0..MOST {
                        mixed[q] += closed * moved[q];
                    }
                }
            }
            if let (Some((mixed, own)), Some((along, _))) = (added.get(number), gained.of_shapes.get(number))
            {
                let mut through = [0.0; MOST];
                for (moved, along) in moved.iter().zip(along.iter()) {
                    for q in 0..MOST {
                        through[q] += along * moved[q];
                    }
                }
                for (sums, added) in sums.mixed.iter_mut().zip(mixed.iter()) {
                    for q in 0..MOST {
                        sums[q] += added * shape.seen[q];
                    }
                }
                for p in 0..MOST {
                    for q in 0..MOST {
                        sums.own[p][q] += own * shape.seen[p] * shape.seen[q]
                            + shape.seen[p] * through[q]
                            + through[p] * shape.seen[q];
                    }
                }
            }
            for (energies, start) in energies[number].iter_mut().zip(&shape.starts) {
                let energy = times(start, &sums.own);
                energies[row] = (0..MOST).map(|q| energy[q] * start[q]).sum();
            }
        }
    }
    energies
}

/// Whether a matrix of states in units of their own has changed no more.
fn has_settled(before: &DMatrix<f64>, now: &DMatrix<f64>) -> bool {
    let n = now.nrows();
    let same = |i: usize, j: usize| {
        (now[(i, j)] - before[(i, j)]).abs() <= SETTLED * (now[(i, i)] * now[(j, j)]).sqrt()
    };
    (0..n).all(|j| (0..n).all(|i| same(i, j)))
}

fn times(row: &[f64; MOST], matrix: &Square) -> [f64; MOST] {
    let mut product = [0.0; MOST];
    for (value, weights) in row.iter().zip(matrix) {
        for q in 0..MOST {
            product[q] += value * weights[q];
        }
    }
    product
}

/// FᵀZF.
fn framed(own: &Square, transition: &Square) -> Square {
    let right: Square = std::array::from_fn(|p| times(&own[p], transition));
    let mut framed = Square::default();
    for (weights, right) in transition.iter().zip(&right) {
        for p in 0..MOST {
            for q in 0..MOST {
                framed[p][q] += weights[p] * right[q];
            }
        }
    }
    framed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::whitening::course::tests::{noises, space_of};
    use crate::whitening::filter::Space;

    /// Noises of all kinds and white noise alone, outages and a change of the white level: at every row as the response that is whitened.
    #[test]
    fn energies_are_those_of_the_whitened_responses() {
        let rows = 600;
        let present: Vec<bool> = (0..rows)
            .map(|row| row > 3 && row < 580 && row % 17 != 0 && !(200..290).contains(&row))
            .collect();
        let shapes = Shapes {
            weights: vec![0.7],
            transition: [[0.0; MOST], [0.0; MOST], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]],
            seen: [0.0, 0.0, 1.0, 0.0],
            starts: [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        };
        let white = Space { channels: 1, white: vec![0.04], ..Space::default() };
        for space in noises().iter().map(space_of).chain([white]) {
            for changes_at in [None, Some(40), Some(250), Some(500)] {
                let since = |from: usize| (0..rows).map(|row| row >= from).collect();
                let other_white = changes_at.map(|row| (since(row), vec![4.0 * space.white[0]]));
                let filter = Filter::new(&Space { other_white, ..space.clone() }, &present).unwrap();
                let [step, ramp] = onset_energies(&filter, std::slice::from_ref(&shapes)).swap_remove(0);
                for onset in (0..rows).step_by(7).chain([199, 200, 289, 290, 579, 599]) {
                    let since = |row: usize| row.checked_sub(onset).map(|since| since as f64);
                    let a_step: Vec<f64> = (0..rows).map(|row| since(row).map_or(0.0, |_| 0.7)).collect();
                    let a_ramp: Vec<f64> = (0..rows).map(|row| 0.7 * since(row).unwrap_or(0.0)).collect();
                    for (column, found) in [(&a_step, step[onset]), (&a_ramp, ramp[onset])] {
                        let whitened = filter.whiten(&[column]).swap_remove(0);
                        let expected: f64 = whitened.iter().map(|value| value * value).sum();
                        assert!(
                            (found - expected).abs() <= 1e-9 * expected,
                            "{changes_at:?}, {onset}: {found} {expected}"
                        );
                    }
                }
            }
        }
    }
}
