//! The Kalman filter as a whitener: innovations e/√S of a record, of any signature by the same gains, and the adjoint.
//!
//! The covariance half runs once for a model and a pattern of missing rows; a gain that has settled is kept until a
//! value is missing. Columns then run through the gains, several at a time or through what was laid out for it
//! (`laid_out.rs`). The map from a column to its whitened innovations is linear, T; the covariance of the record is
//! (TᵀT)⁻¹, so that the adjoint pass gives q = TᵀT y = R⁻¹y, the scores of every unit impulse at once.
//!
//! Columns of several channels stand channel after channel. There is no limit to states or channels; of one channel and
//! few states the code is of fixed sizes.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use nalgebra::DMatrix;

use crate::whitening::course::{Course, course};
use crate::whitening::laid_out::{Gains, LaidOut, RUN_ROWS, is_of_usual_size, lay_out, whiten_rows};

/// Columns that run together where there are few, and where there are many.
const FEW: usize = 4;
const MANY: usize = 8;
/// Rows of all columns that are brought together before they run through a filter of several channels.
const TILE_ROWS: usize = 32;
/// Rows from which on a gain, or that of each, is laid out for the columns, where channels or states are many.
const LONG_RUN: usize = 16;
/// Gains after which no more are laid out: a long record with many gaps has as many as it has rows.
const MOST_LAID_OUT: usize = 1 << 17;
/// Relative change of the variances from row to row below which they have settled.
const SETTLED: f64 = 1e-12;
/// Rows after which states too small to matter are set to zero, so that arithmetic stays fast.
pub const FLUSH_ROWS: usize = 64;
/// Rows with one gain from which on, and states up to which, the steps of a row are brought together.
const SETTLED_ROWS: usize = 16;
const FEW_STATES: usize = 3;
/// What is too small to matter.
const FLUSH: f64 = 1e-140;
/// Rows without one missing from which on not all of their gains are computed: of a filter of any size, and of one of few states,
/// whose rows cost little.
const LONG_ROWS: usize = 200;
const LONG_ROWS_OF_FEW: usize = 2000;
/// Marks a missing row.
const MISSING: u32 = u32::MAX;

/// A linear-Gaussian model: x(k+1) = Φ x(k) + w, y(k) = H x(k) + v. Matrices by rows.
#[derive(Clone, Debug, Default)]
pub struct Space {
    /// Number of states.
    pub states: usize,
    /// Number of channels.
    pub channels: usize,
    /// Transition Φ.
    pub transition: Vec<f64>,
    /// Covariance of the driving noise.
    pub driven: Vec<f64>,
    /// Covariance at the start.
    pub start: Vec<f64>,
    /// H, one row a channel.
    pub seen: Vec<f64>,
    /// Covariance of the white noise.
    pub white: Vec<f64>,
    /// Rows in which the white noise has another covariance, and that.
    pub other_white: Option<(Arc<[bool]>, Vec<f64>)>,
}

impl Space {
    /// Whether the white noise of a row has the other covariance.
    pub fn is_other(&self, row: usize) -> bool {
        self.other_white.as_ref().is_some_and(|(rows, _)| rows.get(row).copied().unwrap_or_default())
    }

    /// The spread of each state, that of a `covariance` included.
    pub fn units(&self, covariance: &[f64]) -> Vec<f64> {
        let n = self.states;
        let spread = |i: usize| self.start[i * n + i].max(self.driven[i * n + i]).max(covariance[i * n + i]);
        (0..n).map(|i| if spread(i) > 0.0 { spread(i).sqrt() } else { 1.0 }).collect()
    }

    /// The same model with its states in other units.
    #[must_use]
    pub fn in_units(&self, units: &[f64]) -> Self {
        let n = self.states;
        let scaled = |matrix: &[f64], by: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            matrix.iter().enumerate().map(|(flat, value)| value * by(flat / n, flat % n)).collect()
        };
        let inverse: Vec<f64> = units.iter().map(|unit| unit.recip()).collect();
        let covariance = |i: usize, j: usize| inverse[i] * inverse[j];
        Self {
            transition: scaled(&self.transition, &|i, j| inverse[i] * units[j]),
            driven: scaled(&self.driven, &covariance),
            start: scaled(&self.start, &covariance),
            seen: scaled(&self.seen, &|_, i| units[i]),
            ..self.clone()
        }
    }
}

/// Gains of every row.
pub struct Filter {
    states: usize,
    channels: usize,
    /// Φ without its zeros: for each state, the states from which it comes and their weights.
    transition: Vec<Vec<(usize, f64)>>,
    seen: Vec<f64>,
    /// For each gain K (states × channels), then W with W S Wᵀ = 1 (channels × channels).
    gains: Vec<f64>,
    index: Vec<u32>,
    /// Σ ln det S over the rows present.
    pub log_variances: f64,
    /// Number of values present.
    pub count: usize,
    /// How columns run where channels or states are many.
    parts: OnceLock<Parts>,
}

/// A record in parts: those whose gains are laid out, with their places among these, and others.
struct Parts {
    rows: Vec<(Range<usize>, Option<Gains>)>,
    runs: Option<Box<dyn LaidOut>>,
    /// Number of values that are laid out.
    values: usize,
}

/// Runs columns through a function of compile-time size where there is one channel and the states are few, through
/// another one where not.
macro_rules! run {
    ($filter:expr, $columns:expr, $whitened:expr, $kind:ty, $lanes:expr) => {
        match ($filter.channels, $filter.states) {
            (1, 0 | 1) => run_few::<$kind, $lanes, 1>($filter, $columns, $whitened),
            (1, 2) => run_few::<$kind, $lanes, 2>($filter, $columns, $whitened),
            (1, 3) => run_few::<$kind, $lanes, 3>($filter, $columns, $whitened),
            (1, 4) => run_few::<$kind, $lanes, 4>($filter, $columns, $whitened),
            (1, 5 | 6) => run_few::<$kind, $lanes, 6>($filter, $columns, $whitened),
            (1, 7 | 8) => run_few::<$kind, $lanes, 8>($filter, $columns, $whitened),
            _ => run_parts::<$kind, $lanes>($filter, $columns, $whitened),
        }
    };
}

impl Filter {
    /// The filter of `space` over rows that are `present` or not; `None` where the model is singular.
    pub fn new(space: &Space, present: &[bool]) -> Option<Self> {
        Self::with_long(space, present, [LONG_ROWS_OF_FEW, LONG_ROWS])
    }

    /// The same with the gain of every row computed.
    #[cfg(test)]
    pub fn of_every_row(space: &Space, present: &[bool]) -> Option<Self> {
        Self::with_long(space, present, [usize::MAX; 2])
    }

    fn with_long(space: &Space, present: &[bool], [of_few, of_many]: [usize; 2]) -> Option<Self> {
        if space.channels == 0 {
            return None;
        }
        match (space.channels, space.states) {
            (1, 0 | 1) => gains_of_few::<1>(space, present, of_few),
            (1, 2) => gains_of_few::<2>(space, present, of_few),
            (1, 3) => gains_of_few::<3>(space, present, of_few),
            (1, 4) => gains_of_few::<4>(space, present, of_few),
            (1, 5 | 6) => gains_of_few::<6>(space, present, of_few),
            (1, 7 | 8) => gains_of_few::<8>(space, present, of_few),
            _ => gains_of_many(space, present, of_many),
        }
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Φ and H.
    pub fn transition_and_output(&self) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = self.states;
        let mut transition = DMatrix::zeros(n, n);
        for (i, from) in self.transition.iter().enumerate() {
            for &(j, weight) in from {
                transition[(i, j)] = weight;
            }
        }
        (transition, DMatrix::from_row_slice(self.channels, n, &self.seen))
    }

    /// Number of values that its gains are.
    pub fn values(&self) -> usize {
        self.gains.len() + self.parts.get().map_or(0, |parts| parts.values)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.index.len()
    }

    /// Whitened innovations of each column; 0 in rows that are missing.
    pub fn whiten(&self, columns: &[&[f64]]) -> Vec<Vec<f64>> {
        let mut whitened = vec![vec![0.0; self.channels * self.rows()]; columns.len()];
        let (alone, together) =
            if columns.len() % FEW == 1 { columns.split_at(1) } else { columns.split_at(0) };
        let (alone_whitened, together_whitened) = whitened.split_at_mut(alone.len());
        run!(self, alone, alone_whitened, f64, 1);
        for (columns, whitened) in together.chunks(FEW).zip(together_whitened.chunks_mut(FEW)) {
            run!(self, columns, whitened, f64, FEW);
        }
        whitened
    }

    /// Whitened innovations of each column in single precision.
    pub fn whiten_single(&self, columns: &[&[f64]]) -> Vec<Vec<f32>> {
        let mut whitened = vec![vec![0.0; self.channels * self.rows()]; columns.len()];
        for (columns, whitened) in columns.chunks(MANY).zip(whitened.chunks_mut(MANY)) {
            run!(self, columns, whitened, f32, MANY);
        }
        whitened
    }

    /// The filter of several gains K and matrices W, by rows; `index` tells which a row has, `None` where it is missing.
    pub fn of_gains(
        space: &Space,
        gains: &[(Vec<f64>, Vec<f64>)],
        index: &[Option<u8>],
        log_variances: f64,
    ) -> Self {
        Self {
            states: space.states,
            channels: space.channels,
            transition: nonzero(space),
            seen: space.seen.clone(),
            gains: gains.iter().flat_map(|(gain, whitening)| gain.iter().chain(whitening)).copied().collect(),
            index: index.iter().map(|index| index.map_or(MISSING, u32::from)).collect(),
            log_variances,
            count: index.iter().flatten().count() * space.channels,
            parts: OnceLock::new(),
        }
    }

    /// Tᵀ of whitened innovations: with those of a record, q = R⁻¹y. 0 in rows that are missing.
    ///
    /// Runs backwards with the derivative of half their sum of squares by the state.
    pub fn adjoint(&self, whitened: &[f64]) -> Vec<f64> {
        let (rows, n, m) = (self.rows(), self.states, self.channels);
        let stride = n * m + m * m;
        let mut scores = vec![0.0; m * rows];
        let [mut costate, mut turned] = [0, 1].map(|_| vec![0.0; n]);
        let mut innovation = vec![0.0; m];
        for row in (0..rows).rev() {
            self.turn(&costate, &mut turned);
            costate.copy_from_slice(&turned);
            let index = self.index[row];
            if index != MISSING {
                let (gain, whitening) = self.gains[index as usize * stride..][..stride].split_at(n * m);
                innovation.fill(0.0);
                for (gain, turned) in gain.chunks_exact(m).zip(&turned) {
                    innovation.iter_mut().zip(gain).for_each(|(sum, gain)| *sum += gain * turned);
                }
                for (d, weights) in whitening.chunks_exact(m).enumerate() {
                    let value = whitened[d * rows + row];
                    innovation.iter_mut().zip(weights).take(d + 1).for_each(|(sum, w)| *sum += w * value);
                }
                for (c, innovation) in innovation.iter().enumerate() {
                    scores[c * rows + row] = *innovation;
                    let seen = &self.seen[c * n..(c + 1) * n];
                    costate.iter_mut().zip(seen).for_each(|(value, seen)| *value -= seen * innovation);
                }
            }
            if row % FLUSH_ROWS == 0 {
                flush(&mut costate);
            }
        }
        scores
    }

    /// What a state predicts for the channels.
    pub fn predict(&self, state: &[f64], channels: &mut [f64]) {
        for (channel, seen) in channels.iter_mut().zip(self.seen.chunks_exact(self.states.max(1))) {
            *channel = dot(seen, state);
        }
    }

    /// The gain K (states × channels) and the whitening matrix W (channels × channels) of a row, by rows; `None` where
    /// it is missing.
    pub fn gain_and_whitening(&self, row: usize) -> Option<(&[f64], &[f64])> {
        let index = self.index.get(row).copied().filter(|&index| index != MISSING)?;
        let (n, m) = (self.states, self.channels);
        Some(self.gains.get(index as usize * (n * m + m * m)..)?.get(..n * m + m * m)?.split_at(n * m))
    }

    /// Its parts.
    fn parts(&self) -> &Parts {
        self.parts.get_or_init(|| {
            let mut rows: Vec<(Range<usize>, Option<Gains>)> = Vec::new();
            let mut laid_out = Vec::new();
            let usual = self.states > 0 && is_of_usual_size(self);
            let mut row = 0;
            while let Some(&first) = self.index.get(row) {
                let behind = &self.index[row..];
                let same = behind.iter().take_while(|&&index| index == first).count();
                let each =
                    behind.iter().zip(first..MISSING).take_while(|(index, next)| **index == *next).count();
                let over = row..row + same.max(each);
                row = over.end;
                let place = laid_out.len();
                let (gains, of_rows) = if same > 1 {
                    (Gains::One(place), over.start..over.start + 1)
                } else {
                    (Gains::From(place), over.clone())
                };
                let is_laid_out = usual
                    && first != MISSING
                    && over.len() >= LONG_RUN
                    && place + of_rows.len() <= MOST_LAID_OUT;
                let gains = is_laid_out.then_some((gains, of_rows));
                match (gains, rows.last_mut()) {
                    (Some((gains, of_rows)), _) => {
                        laid_out.extend(of_rows.filter_map(|row| self.gain_and_whitening(row)));
                        rows.push((over, Some(gains)));
                    }
                    (None, Some((last, None))) => last.end = over.end,
                    (None, _) => rows.push((over, None)),
                }
            }
            let values = laid_out.iter().map(|(gain, whitening)| gain.len() + whitening.len()).sum();
            let runs = (!laid_out.is_empty()).then(|| lay_out(self, &laid_out));
            Parts { rows, runs, values }
        })
    }

    /// A state a step later.
    pub fn propagate(&self, state: &[f64], next: &mut [f64]) {
        for (next, from) in next.iter_mut().zip(&self.transition) {
            *next = from.iter().map(|&(j, weight)| weight * state[j]).sum();
        }
    }

    /// A state over rows that are missing.
    pub fn coast(&self, rows: usize, state: &mut [f64]) {
        over_missing(rows, state, |state, next| self.propagate(state, next));
    }

    /// Φᵀ of a costate.
    fn turn(&self, costate: &[f64], turned: &mut [f64]) {
        turned.fill(0.0);
        for (costate, from) in costate.iter().zip(&self.transition) {
            for &(j, weight) in from {
                turned[j] += weight * costate;
            }
        }
    }

    /// How much each state weighs in the whitened innovations of the settled filter.
    pub fn weight_of_states(&self) -> Vec<f64> {
        let (_, whitening) = self.settled();
        let (n, m) = (self.states, self.channels);
        let seen = |c: usize, i: usize| self.seen[c * n + i].abs() * whitening[c * m + c].abs();
        (0..n).map(|i| (0..m).map(|c| seen(c, i)).sum()).collect()
    }

    /// The gain and the whitening matrix that it settles at, by rows: K (states × channels), W (channels × channels).
    pub fn settled(&self) -> (Vec<f64>, Vec<f64>) {
        let (n, m) = (self.states, self.channels);
        let (gain, whitening) = self.last_gain().split_at(n * m);
        (gain.to_vec(), whitening.to_vec())
    }

    fn last_gain(&self) -> &[f64] {
        let stride = self.states * self.channels + self.channels * self.channels;
        &self.gains[self.gains.len() - stride..]
    }
}

/// Runs at most `L` columns of one channel through the gains.
fn run_few<T: Rounded, const L: usize, const N: usize>(
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
fn run_parts<T: Rounded, const L: usize>(filter: &Filter, columns: &[&[f64]], whitened: &mut [Vec<T>]) {
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
struct Transition<const N: usize> {
    diagonal: [f64; N],
    beside: Vec<(usize, usize, f64)>,
}

impl<const N: usize> Transition<N> {
    /// From what is not zero, by rows.
    fn new(rows: &[Vec<(usize, f64)>]) -> Self {
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
    fn apply<const L: usize>(&self, state: &[[f64; L]; N]) -> [[f64; L]; N] {
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
fn over_missing(rows: usize, state: &mut [f64], step: impl Fn(&[f64], &mut [f64])) {
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

type Square<const N: usize> = [[f64; N]; N];

fn square<const N: usize>(flat: &[f64], size: usize) -> Square<N> {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if i < size && j < size { flat.get(i * size + j).copied().unwrap_or_default() } else { 0.0 }
        })
    })
}

/// The covariance half of a filter.
trait Covariance {
    /// Takes a measurement in; adds K and W to `gains` and gives ln det S. `None` where S is singular.
    fn measure(&mut self, other: bool, gains: &mut Vec<f64>) -> Option<f64>;
    /// Goes on by a step.
    fn propagate(&mut self);
    /// Whether the variances have not changed over the last measurement and step.
    fn has_settled(&self) -> bool;
    /// The predicted covariance, by rows.
    fn predicted(&self) -> Vec<f64>;
    /// Goes on from a predicted covariance.
    fn set(&mut self, predicted: &[f64]);
}

/// The gains of every row.
fn gains(
    space: &Space,
    present: &[bool],
    long_rows: usize,
    mut covariance: impl Covariance,
) -> Option<Filter> {
    let (n, m) = (space.states, space.channels);
    let mut filter = Filter {
        states: n,
        channels: m,
        transition: nonzero(space),
        seen: space.seen.clone(),
        gains: Vec::new(),
        index: Vec::with_capacity(present.len()),
        log_variances: 0.0,
        count: 0,
        parts: OnceLock::new(),
    };
    let size = n * m + m * m;
    let mut last = MISSING;
    let mut settled = false;
    let mut other = false;
    let mut log_variance = 0.0;
    let mut row = 0;
    while let Some(&is_present) = present.get(row) {
        if space.is_other(row) != other {
            other = !other;
            settled = false;
        }
        if !is_present {
            settled = false;
            filter.index.push(MISSING);
            covariance.propagate();
            row += 1;
            continue;
        }
        if !settled && n > 0 {
            let goes_on = |&at: &usize| present[at] && space.is_other(at) == other;
            let rows = (row..present.len()).take_while(goes_on).count();
            let white = space.other_white.as_ref().filter(|_| other).map_or(&space.white, |(_, white)| white);
            let start = covariance.predicted();
            let found = (rows >= long_rows)
                .then(|| {
                    course(space, white, &start, rows, |predicted, gain| {
                        covariance.set(predicted);
                        covariance.measure(other, gain)
                    })
                })
                .flatten();
            if let Some(Course { gains, log_variances, covariance: predicted }) = found {
                let first = filter.gains.len() / size;
                let number = gains.len() / size;
                filter.gains.extend(gains);
                filter.index.extend((0..rows).map(|at| (first + at.min(number - 1)) as u32));
                filter.log_variances += log_variances.iter().sum::<f64>();
                let left = (rows - number) as f64;
                filter.log_variances += left * log_variances.last().copied().unwrap_or_default();
                filter.count += rows * m;
                covariance.set(&predicted);
                row += rows;
                continue;
            }
            covariance.set(&start);
        }
        if !settled {
            last = (filter.gains.len() / size) as u32;
            log_variance = covariance.measure(other, &mut filter.gains)?;
            if !log_variance.is_finite() {
                return None;
            }
            covariance.propagate();
            settled = covariance.has_settled();
        }
        filter.index.push(last);
        filter.log_variances += log_variance;
        filter.count += m;
        row += 1;
    }
    if filter.gains.is_empty() {
        filter.gains.resize(n * m + m * m, 0.0);
    }
    Some(filter)
}

/// One channel and few states.
#[derive(Clone)]
struct Few<const N: usize> {
    transition: Transition<N>,
    driven: Square<N>,
    seen: [f64; N],
    /// Its variance, and the other one.
    white: [f64; 2],
    states: usize,
    covariance: Square<N>,
    /// Variances before the last measurement.
    before: [f64; N],
}

fn gains_of_few<const N: usize>(space: &Space, present: &[bool], long_rows: usize) -> Option<Filter> {
    let n = space.states.min(N);
    let white = space.white.first().copied()?;
    let few = Few::<N> {
        transition: Transition::new(&nonzero(space)),
        driven: square(&space.driven, n),
        seen: std::array::from_fn(
            |i| if i < n { space.seen.get(i).copied().unwrap_or_default() } else { 0.0 },
        ),
        white: [
            white,
            space.other_white.as_ref().and_then(|(_, white)| white.first().copied()).unwrap_or(white),
        ],
        states: n,
        covariance: square(&space.start, n),
        before: [0.0; N],
    };
    gains(space, present, long_rows, few)
}

impl<const N: usize> Covariance for Few<N> {
    fn measure(&mut self, other: bool, gains: &mut Vec<f64>) -> Option<f64> {
        self.before = std::array::from_fn(|i| self.covariance[i][i]);
        let mut scaled =
            self.covariance.map(|row| row.iter().zip(&self.seen).map(|(p, h)| p * h).sum::<f64>());
        let own: f64 = self.seen.iter().zip(&scaled).map(|(h, ph)| h * ph).sum();
        let variance = self.white[usize::from(other)] + own;
        if variance.is_nan() || variance <= 0.0 {
            return None;
        }
        // K = P Hᵀ Wᵀ W; with B = P Hᵀ Wᵀ the covariance is P − B Bᵀ.
        let whitening = variance.sqrt().recip();
        for value in &mut scaled {
            *value *= whitening;
        }
        gains.extend(scaled.iter().take(self.states).map(|value| value * whitening));
        gains.push(whitening);
        for i in 0..N {
            for j in 0..N {
                self.covariance[i][j] -= scaled[i] * scaled[j];
            }
        }
        Some(-2.0 * whitening.ln())
    }

    fn propagate(&mut self) {
        let p = &self.covariance;
        // Φ P.
        let half = self.transition.apply(p);
        let mut next = self.driven;
        for (next, half) in next.iter_mut().zip(&half) {
            for j in 0..N {
                next[j] += half[j] * self.transition.diagonal[j];
            }
            for &(i, j, weight) in &self.transition.beside {
                next[i] += half[j] * weight;
            }
        }
        for i in 0..N {
            for j in 0..i {
                next[j][i] = next[i][j];
            }
        }
        self.covariance = next;
    }

    fn has_settled(&self) -> bool {
        let now = |i: usize| self.covariance[i][i];
        self.before.iter().enumerate().all(|(i, before)| unchanged(*before, now(i)))
    }

    fn predicted(&self) -> Vec<f64> {
        let own = |i: usize| &self.covariance[i][..self.states];
        (0..self.states).flat_map(own).copied().collect()
    }

    fn set(&mut self, predicted: &[f64]) {
        self.covariance = square(predicted, self.states);
    }
}

/// Whether a variance is the same but for rounding.
fn unchanged(before: f64, now: f64) -> bool {
    now == before || (now - before).abs() < SETTLED * now.abs()
}

/// Any number of channels and states. Matrices stand by rows; of the transition only what is not zero.
struct Many<'s> {
    space: &'s Space,
    transition: Vec<Vec<(usize, f64)>>,
    covariance: Vec<f64>,
    /// Variances before the last measurement.
    before: Vec<f64>,
    /// Φ P.
    half: Vec<f64>,
    /// P Hᵀ and P Hᵀ Wᵀ, channel after channel.
    crossed: Vec<f64>,
    scaled: Vec<f64>,
    root: Vec<f64>,
}

fn gains_of_many(space: &Space, present: &[bool], long_rows: usize) -> Option<Filter> {
    let (n, m) = (space.states, space.channels);
    let many = Many {
        space,
        transition: nonzero(space),
        covariance: space.start.clone(),
        before: vec![0.0; n],
        half: vec![0.0; n * n],
        crossed: vec![0.0; n * m],
        scaled: vec![0.0; n * m],
        root: vec![0.0; m * m],
    };
    gains(space, present, long_rows, many)
}

/// `sum` + weight · values.
fn add_scaled(sum: &mut [f64], weight: f64, values: &[f64]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Covariance for Many<'_> {
    fn measure(&mut self, other: bool, gains: &mut Vec<f64>) -> Option<f64> {
        let (n, m) = (self.space.states, self.space.channels);
        let seen = &self.space.seen;
        let another = self.space.other_white.as_ref().filter(|_| other);
        let white = another.map_or(&self.space.white, |(_, white)| white);
        for (i, before) in self.before.iter_mut().enumerate() {
            *before = self.covariance[i * n + i];
        }
        self.crossed.fill(0.0);
        if n > 0 {
            for (crossed, seen) in self.crossed.chunks_exact_mut(n).zip(seen.chunks_exact(n)) {
                for (seen, row) in seen.iter().zip(self.covariance.chunks_exact(n)) {
                    if *seen != 0.0 {
                        add_scaled(crossed, *seen, row);
                    }
                }
            }
        }
        // S = L Lᵀ.
        let mut log_variance = 0.0;
        for c in 0..m {
            for d in 0..=c {
                let (own, other) = (&self.root[c * m..c * m + d], &self.root[d * m..d * m + d]);
                let projected = dot(&seen[c * n..(c + 1) * n], &self.crossed[d * n..(d + 1) * n]);
                let left = white[c * m + d] + projected - dot(own, other);
                if c > d {
                    self.root[c * m + d] = left / self.root[d * m + d];
                } else if left > 0.0 {
                    self.root[c * m + c] = left.sqrt();
                    log_variance += left.ln();
                } else {
                    return None;
                }
            }
        }
        let first = gains.len();
        gains.resize(first + n * m + m * m, 0.0);
        let (gain, whitening) = gains[first..].split_at_mut(n * m);
        // W = L⁻¹; B = P Hᵀ Wᵀ solves B Lᵀ = P Hᵀ.
        for c in 0..m {
            let own = self.root[c * m + c].recip();
            whitening[c * m + c] = own;
            for d in 0..c {
                let sum: f64 = (d..c).map(|e| self.root[c * m + e] * whitening[e * m + d]).sum();
                whitening[c * m + d] = -sum * own;
            }
        }
        // K = B W; the covariance is P − B Bᵀ.
        self.scaled.fill(0.0);
        if n > 0 {
            for (c, scaled) in self.scaled.chunks_exact_mut(n).enumerate() {
                for (d, crossed) in self.crossed.chunks_exact(n).enumerate().take(c + 1) {
                    add_scaled(scaled, whitening[c * m + d], crossed);
                }
                for (i, scaled) in scaled.iter().enumerate() {
                    add_scaled(&mut gain[i * m..=i * m + c], *scaled, &whitening[c * m..=c * m + c]);
                }
                for (row, weight) in self.covariance.chunks_exact_mut(n).zip(scaled.iter()) {
                    add_scaled(row, -weight, scaled);
                }
            }
        }
        Some(log_variance)
    }

    fn propagate(&mut self) {
        let n = self.space.states;
        if n == 0 {
            return;
        }
        self.half.fill(0.0);
        for (half, from) in self.half.chunks_exact_mut(n).zip(&self.transition) {
            for &(j, weight) in from {
                add_scaled(half, weight, &self.covariance[j * n..(j + 1) * n]);
            }
        }
        self.covariance.copy_from_slice(&self.space.driven);
        for i in 0..n {
            for (j, from) in self.transition.iter().enumerate().take(i + 1) {
                let sum: f64 = from.iter().map(|&(k, weight)| self.half[i * n + k] * weight).sum();
                let value = self.covariance[i * n + j] + sum;
                self.covariance[i * n + j] = value;
                self.covariance[j * n + i] = value;
            }
        }
    }

    fn has_settled(&self) -> bool {
        let n = self.space.states;
        let now = |i: usize| self.covariance[i * n + i];
        self.before.iter().enumerate().all(|(i, before)| unchanged(*before, now(i)))
    }

    fn predicted(&self) -> Vec<f64> {
        self.covariance.clone()
    }

    fn set(&mut self, predicted: &[f64]) {
        self.covariance.copy_from_slice(predicted);
    }
}

/// What is not zero of the transition, by rows.
fn nonzero(space: &Space) -> Vec<Vec<(usize, f64)>> {
    let n = space.states;
    let of_row = |i: usize| {
        let row = space.transition[i * n..(i + 1) * n].iter().copied().enumerate();
        row.filter(|(_, weight)| *weight != 0.0).collect()
    };
    (0..n).map(of_row).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    /// Markov and exponential-cosine states seen through two channels, with a change of the white level.
    fn space() -> Space {
        let (c, s) = (0.9 * 0.3_f64.cos(), 0.9 * 0.3_f64.sin());
        Space {
            states: 3,
            channels: 2,
            transition: vec![0.95, 0.0, 0.0, 0.0, c, -s, 0.0, s, c],
            driven: vec![0.0975, 0.0, 0.0, 0.0, 0.19, 0.0, 0.0, 0.0, 0.19],
            start: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            seen: vec![1.0, 1.0, 0.0, -0.4, 0.8, 0.0],
            white: vec![0.3, 0.1, 0.1, 0.2],
            other_white: Some(((0..200).map(|row| row >= 17).collect(), vec![0.9, 0.1, 0.1, 0.2])),
        }
    }

    /// Covariance of the rows present, rows by channels, from the model's definition.
    fn dense(space: &Space, present: &[bool]) -> DMatrix<f64> {
        let n = space.states;
        let phi = DMatrix::from_row_slice(n, n, &space.transition);
        let q = DMatrix::from_row_slice(n, n, &space.driven);
        let h = DMatrix::from_row_slice(space.channels, n, &space.seen);
        let mut variances = vec![DMatrix::from_row_slice(n, n, &space.start)];
        for row in 1..present.len() {
            variances.push(&phi * &variances[row - 1] * phi.transpose() + &q);
        }
        let rows: Vec<usize> = (0..present.len()).filter(|&row| present[row]).collect();
        let m = space.channels;
        let mut full = DMatrix::zeros(m * rows.len(), m * rows.len());
        for (a, &i) in rows.iter().enumerate() {
            let mut cross = variances[i].clone();
            for (b, &j) in rows.iter().enumerate().skip(a) {
                if j > i {
                    let from = if b == a + 1 { i } else { rows[b - 1] };
                    for _ in from..j {
                        cross = &phi * cross;
                    }
                }
                let mut part = &h * &cross * h.transpose();
                if i == j {
                    let white = match &space.other_white {
                        Some((rows, white)) if rows[i] => white,
                        _ => &space.white,
                    };
                    part += DMatrix::from_row_slice(m, m, white);
                }
                full.view_mut((m * b, m * a), (m, m)).copy_from(&part);
                full.view_mut((m * a, m * b), (m, m)).copy_from(&part.transpose());
            }
        }
        full
    }

    #[test]
    fn innovations_are_those_of_the_dense_covariance() {
        let space = space();
        let mut random = Pcg64::seed_from_u64(7);
        let rows = 60;
        let present: Vec<bool> = (0..rows).map(|row| !(20..29).contains(&row) && row % 11 != 3).collect();
        let filter = Filter::new(&space, &present).unwrap();
        let columns: Vec<Vec<f64>> = (0..3)
            .map(|_| {
                let value =
                    |flat: usize| if present[flat % rows] { random.random::<f64>() - 0.5 } else { f64::NAN };
                (0..2 * rows).map(value).collect()
            })
            .collect();
        let views: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let whitened = filter.whiten(&views);
        let covariance = dense(&space, &present);
        let stacked = |column: &[f64]| {
            let used =
                (0..rows).filter(|&row| present[row]).flat_map(|row| [column[row], column[rows + row]]);
            DVector::from_iterator(filter.count, used)
        };
        let cholesky = covariance.clone().cholesky().unwrap();
        let log_determinant = 2.0 * cholesky.l().diagonal().map(f64::ln).sum();
        assert!((filter.log_variances - log_determinant).abs() < 1e-9);
        for (a, whitened_a) in columns.iter().zip(&whitened) {
            for (b, whitened_b) in columns.iter().zip(&whitened) {
                let expected = stacked(a).dot(&cholesky.solve(&stacked(b)));
                let found: f64 = whitened_a.iter().zip(whitened_b).map(|(x, y)| x * y).sum();
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
        }
        // Adjoint: R⁻¹y itself.
        let scores = filter.adjoint(&whitened[0]);
        let expected = cholesky.solve(&stacked(&columns[0]));
        assert!((stacked(&scores) - expected).amax() < 1e-9);
        assert_eq!(scores[20], 0.0);
    }

    /// Adjoint of one channel and few states, most rows with a gain that has settled.
    #[test]
    fn the_adjoint_of_a_settled_gain_is_that_of_the_dense_covariance() {
        const ROWS: usize = 400;
        let mut random = Pcg64::seed_from_u64(8);
        let present: Vec<bool> = (0..ROWS).map(|row| !(150..160).contains(&row) && row != 300).collect();
        let of_present = |column: &[f64]| {
            let values = column.iter().zip(&present).filter(|(_, present)| **present);
            DVector::from_vec(values.map(|(value, _)| *value).collect::<Vec<f64>>())
        };
        for states in 1..=4 {
            let mut space = Space {
                states,
                channels: 1,
                transition: vec![0.0; states * states],
                driven: vec![0.0; states * states],
                start: vec![0.0; states * states],
                seen: vec![1.0; states],
                white: vec![0.5],
                other_white: None,
            };
            for i in 0..states {
                let kept = 0.8 - 0.1 * i as f64;
                space.transition[i * (states + 1)] = kept;
                space.driven[i * (states + 1)] = 1.0 - kept * kept;
                space.start[i * (states + 1)] = 1.0;
            }
            if states > 1 {
                (space.transition[1], space.transition[states]) = (0.2, -0.2);
            }
            let filter = Filter::new(&space, &present).unwrap();
            assert!(filter.gains.len() < ROWS / 2 * (states + 1), "most rows have the same gain");
            let data: Vec<f64> = (0..ROWS).map(|_| random.random::<f64>() - 0.5).collect();
            let found = filter.adjoint(&filter.whiten(&[&data]).swap_remove(0));
            let expected = dense(&space, &present).cholesky().unwrap().solve(&of_present(&data));
            assert!((of_present(&found) - expected).amax() < 1e-9, "{states}");
        }
    }

    /// A gain that no longer changes is kept once, and whitens as those that are computed row after row.
    #[test]
    fn a_settled_gain_changes_nothing() {
        let space = Space { other_white: None, ..space() };
        let settling = Filter::new(&space, &[true; 3000]).unwrap();
        assert!(settling.gains.len() / (3 * 2 + 4) < 300);
        let every = Filter::of_every_row(&space, &[true; 3000]).unwrap();
        assert!((settling.log_variances - every.log_variances).abs() < 1e-9 * every.log_variances.abs());
        let mut random = Pcg64::seed_from_u64(5);
        let data: Vec<f64> = (0..2 * 3000).map(|_| random.random::<f64>() - 0.5).collect();
        let whitened =
            [settling, every].map(|filter| DVector::from_vec(filter.whiten(&[&data]).swap_remove(0)));
        assert!((&whitened[0] - &whitened[1]).amax() < 1e-9);
    }
}
