//! Columns run through the gains of a filter.
use std::ops::Range;

use super::{FLUSH_ROWS, Filter, MISSING, Parts};
use crate::whitening::laid_out::{Gains, RUN_ROWS, whiten_rows};

/// Rows of all columns that are brought together before they run through a filter of several channels.
const TILE_ROWS: usize = 32;
/// Rows with one gain from which on, and states up to which, the steps of a row are brought together.
const SETTLED_ROWS: usize = 16;
const FEW_STATES: usize = 3;
/// What is too small to matter.
const FLUSH: f64 = 1e-140;

/// Runs at most `L` columns of one channel through the gains.
pub(super) fn run_few<T: Rounded, const L: usize, const N: usize>(
    filter: &Filter,
    columns: &[&[f64]],
    whitened: &mut [Vec<T>],
) {
    let Some(first) = columns.first() else { return };
    let inputs: [&[f64]; L] = std::array::from_fn(|lane| *columns.get(lane).unwrap_or(first));
    let transition = Transition::<N>::new(&filter.transition);
    let n = filter.states;
    let seen: [f64; N] = std::array::from_fn(|i| filter.seen.get(i).copied().unwrap_or_default());
    let gain_of = |index: u32| &filter.gains[index as usize * (n + 1)..][..=n];
    let mut state = [[0.0; L]; N];
    let mut row = 0;
    for stretch in filter.index.chunk_by(|a, b| a == b).flat_map(|stretch| stretch.chunks(FLUSH_ROWS)) {
        let rows = row..row + stretch.len();
        row = rows.end;
        let index = stretch[0];
        if index != MISSING && N <= FEW_STATES && stretch.len() >= SETTLED_ROWS {
            let gain = gain_of(index);
            let Closed { of_state, of_input } = Closed::new(&transition, &seen, &gain[..n]);
            for row in rows {
                let input: [f64; L] = std::array::from_fn(|lane| inputs[lane][row]);
                let mut innovation = input;
                let mut next = [[0.0; L]; N];
                for i in 0..N {
                    for lane in 0..L {
                        innovation[lane] -= seen[i] * state[i][lane];
                        next[i][lane] = of_input[i] * input[lane];
                    }
                }
                for i in 0..N {
                    for j in 0..N {
                        for lane in 0..L {
                            next[i][lane] += of_state[i][j] * state[j][lane];
                        }
                    }
                }
                state = next;
                for (column, value) in whitened.iter_mut().zip(innovation) {
                    column[row] = T::rounded(gain[n] * value);
                }
            }
            flush(state.as_flattened_mut());
            continue;
        }
        for row in rows {
            if index != MISSING {
                let gain = gain_of(index);
                // Of halves that do not wait for each other.
                let mut predicted = [[0.0; L]; 2];
                for (i, (seen, state)) in seen.iter().zip(&state).enumerate() {
                    for lane in 0..L {
                        predicted[i % 2][lane] += seen * state[lane];
                    }
                }
                let innovation: [f64; L] =
                    std::array::from_fn(|lane| inputs[lane][row] - (predicted[0][lane] + predicted[1][lane]));
                for (gain, state) in gain.iter().take(n).zip(&mut state) {
                    for lane in 0..L {
                        state[lane] += gain * innovation[lane];
                    }
                }
                for (column, value) in whitened.iter_mut().zip(innovation) {
                    column[row] = T::rounded(gain[n] * value);
                }
            }
            state = transition.apply(&state);
            if row % FLUSH_ROWS == 0 {
                flush(state.as_flattened_mut());
            }
        }
    }
}

/// Runs at most `L` columns through the gains of a filter of any size.
pub(super) fn run_parts<T: Rounded, const L: usize>(
    filter: &Filter,
    columns: &[&[f64]],
    whitened: &mut [Vec<T>],
) {
    if columns.is_empty() {
        return;
    }
    let n = filter.states;
    let mut states = vec![[0.0; L]; n];
    let mut own = vec![vec![0.0; n]; columns.len()];
    let mut run = vec![vec![0.0; filter.channels * RUN_ROWS]; columns.len()];
    let Parts { rows: parts, runs, .. } = filter.parts();
    for (over, gains) in parts {
        let Some((gains, runs)) = gains.zip(runs.as_ref()) else {
            run_many(filter, columns, over.clone(), &mut states, whitened);
            continue;
        };
        for (lane, own) in own.iter_mut().enumerate() {
            own.iter_mut().zip(&states).for_each(|(own, states)| *own = states[lane]);
        }
        // All columns through the same gains, while these are at hand.
        for first in over.clone().step_by(RUN_ROWS) {
            let gains = match gains {
                Gains::From(of_first) => Gains::From(of_first + first - over.start),
                one @ Gains::One(_) => one,
            };
            let over = first..(first + RUN_ROWS).min(over.end);
            whiten_rows(runs.as_ref(), (gains, over), columns, &mut own, &mut run, whitened);
        }
        for (lane, own) in own.iter().enumerate() {
            states.iter_mut().zip(own).for_each(|(states, own)| states[lane] = *own);
        }
    }
}

/// Runs at most `L` columns through the gains of some rows, from and to the states before and behind them.
fn run_many<T: Rounded, const L: usize>(
    filter: &Filter,
    columns: &[&[f64]],
    over: Range<usize>,
    state: &mut [[f64; L]],
    whitened: &mut [Vec<T>],
) {
    let Some(first) = columns.first() else { return };
    let inputs: [&[f64]; L] = std::array::from_fn(|lane| *columns.get(lane).unwrap_or(first));
    let (rows, n, m) = (filter.rows(), filter.states, filter.channels);
    let stride = n * m + m * m;
    let mut before = state.to_vec();
    // Channels of a tile's rows side by side, values first, then innovations, then whitened.
    let mut tile = vec![[0.0; L]; TILE_ROWS.min(over.len()) * m];
    let mut innovation = vec![[0.0; L]; m];
    for (number, indices) in filter.index[over.clone()].chunks(TILE_ROWS).enumerate() {
        let first_row = over.start + number * TILE_ROWS;
        for c in 0..m {
            for (lane, input) in inputs.iter().enumerate() {
                let values = &input[c * rows + first_row..][..indices.len()];
                for (values_of_row, value) in tile.chunks_exact_mut(m).zip(values) {
                    values_of_row[c][lane] = *value;
                }
            }
        }
        for (values, &index) in tile.chunks_exact_mut(m).zip(indices) {
            if index == MISSING {
                values.fill([0.0; L]);
            } else {
                let (gain, whitening) = filter.gains[index as usize * stride..][..stride].split_at(n * m);
                innovation.copy_from_slice(values);
                for (c, innovation) in innovation.iter_mut().enumerate() {
                    subtract(innovation, &filter.seen[c * n..(c + 1) * n], state);
                }
                for (state, gain) in state.iter_mut().zip(gain.chunks_exact(m)) {
                    add(state, gain, &innovation);
                }
                for (c, value) in values.iter_mut().enumerate() {
                    *value = [0.0; L];
                    add(value, &whitening[c * m..=c * m + c], &innovation);
                }
            }
            before.copy_from_slice(state);
            for (state, from) in state.iter_mut().zip(&filter.transition) {
                let mut sum = [0.0; L];
                for &(j, weight) in from {
                    let before = &before[j];
                    for lane in 0..L {
                        sum[lane] += weight * before[lane];
                    }
                }
                *state = sum;
            }
        }
        for (lane, column) in whitened.iter_mut().enumerate() {
            for c in 0..m {
                let column = &mut column[c * rows + first_row..][..indices.len()];
                for (slot, values) in column.iter_mut().zip(tile.chunks_exact(m)) {
                    *slot = T::rounded(values[c][lane]);
                }
            }
        }
        flush(state.as_flattened_mut());
    }
}

/// Φ of few states: its diagonal, and what is not zero beside it. Most states are first-order processes.
#[derive(Clone)]
pub(super) struct Transition<const N: usize> {
    pub diagonal: [f64; N],
    pub beside: Vec<(usize, usize, f64)>,
}

impl<const N: usize> Transition<N> {
    /// From what is not zero, by rows.
    pub fn new(rows: &[Vec<(usize, f64)>]) -> Self {
        let mut transition = Self { diagonal: [0.0; N], beside: Vec::new() };
        for (i, row) in rows.iter().enumerate().take(N) {
            for &(j, weight) in row {
                if i == j {
                    transition.diagonal[i] = weight;
                } else {
                    transition.beside.push((i, j, weight));
                }
            }
        }
        transition
    }

    /// Φ x.
    pub fn apply<const L: usize>(&self, state: &[[f64; L]; N]) -> [[f64; L]; N] {
        let mut next: [[f64; L]; N] = std::array::from_fn(|i| state[i].map(|value| self.diagonal[i] * value));
        for &(i, j, weight) in &self.beside {
            for lane in 0..L {
                next[i][lane] += weight * state[j][lane];
            }
        }
        next
    }
}

/// A step with a gain, x ← (Φ − Φ K H) x + Φ K y, in which a row waits for the one before in a single product and sum.
struct Closed<const N: usize> {
    /// Φ − Φ K H.
    of_state: Square<N>,
    /// Φ K.
    of_input: [f64; N],
}

impl<const N: usize> Closed<N> {
    fn new(transition: &Transition<N>, seen: &[f64; N], gain: &[f64]) -> Self {
        let gain = std::array::from_fn(|i| [gain.get(i).copied().unwrap_or_default()]);
        let of_input = transition.apply(&gain).map(|[value]| value);
        let mut of_state = of_input.map(|driven| seen.map(|seen| -driven * seen));
        for (i, row) in of_state.iter_mut().enumerate() {
            row[i] += transition.diagonal[i];
        }
        for &(i, j, weight) in &transition.beside {
            of_state[i][j] += weight;
        }
        Self { of_state, of_input }
    }
}

/// `sum` + Σ weight · value.
fn add<const L: usize>(sum: &mut [f64; L], weights: &[f64], values: &[[f64; L]]) {
    for (weight, value) in weights.iter().zip(values) {
        for lane in 0..L {
            sum[lane] += weight * value[lane];
        }
    }
}

/// `sum` − Σ weight · value.
fn subtract<const L: usize>(sum: &mut [f64; L], weights: &[f64], values: &[[f64; L]]) {
    for (weight, value) in weights.iter().zip(values) {
        for lane in 0..L {
            sum[lane] -= weight * value[lane];
        }
    }
}

/// Sets what is too small to matter to zero.
pub fn flush(values: &mut [f64]) {
    values.iter_mut().filter(|value| value.abs() < FLUSH).for_each(|value| *value = 0.0);
}

/// Takes a state over rows by a step of each.
pub(super) fn over_missing(rows: usize, state: &mut [f64], step: impl Fn(&[f64], &mut [f64])) {
    let mut next = vec![0.0; state.len()];
    for row in 0..rows {
        step(state, &mut next);
        state.copy_from_slice(&next);
        if row % FLUSH_ROWS == 0 {
            flush(state);
        }
    }
}

/// Numbers that whitened innovations are kept in.
pub trait Rounded {
    /// The number, rounded.
    fn rounded(value: f64) -> Self;
}

impl Rounded for f64 {
    fn rounded(value: f64) -> Self {
        value
    }
}

impl Rounded for f32 {
    fn rounded(value: f64) -> Self {
        value as f32
    }
}

pub(super) type Square<const N: usize> = [[f64; N]; N];

pub(super) fn square<const N: usize>(flat: &[f64], size: usize) -> Square<N> {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if i < size && j < size { flat.get(i * size + j).copied().unwrap_or_default() } else { 0.0 }
        })
    })
}
