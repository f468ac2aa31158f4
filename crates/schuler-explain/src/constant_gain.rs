//! Runs of one gain over a column, forwards and backwards, where channels or states are many.
//!
//! A gain that holds for many rows is worth being laid out for them: states stand in groups, whose numbers are computed side by side, and
//! channels in blocks of one to four, whose sums stay in registers.
use std::ops::Range;

/// States of a group.
const LANES: usize = 4;
type Group = [f64; LANES];
/// Most channels of a block.
const MOST: usize = 4;
/// Rows after which states too small to matter are set to zero, so that arithmetic stays fast; and what that is.
const FLUSH_ROWS: usize = 64;
const FLUSH: f64 = 1e-140;

/// A filter of few gains.
pub trait ConstantGain: Send + Sync {
    /// Whitened innovations of a column; 0 in rows that are missing.
    fn whiten(&self, column: &[f64]) -> Vec<f64>;

    /// Takes the derivative of half the sum of squares of whitened innovations by the state from the end of some rows to
    /// their beginning.
    fn backwards(&self, whitened: &[f64], over: Range<usize>, costate: &mut [f64]);
}

/// From Φ and H by rows, K and W by rows of each gain (W lower triangular), and the gain of each row, `None` where it is missing. One
/// state at least.
pub fn constant_gain(
    sizes: [usize; 2],
    transition: &[f64],
    seen: &[f64],
    gains: &[(Vec<f64>, Vec<f64>)],
    index: Vec<Option<u8>>,
) -> Box<dyn ConstantGain> {
    let [_, channels] = sizes;
    // As few blocks as can be, and as little of the last one empty.
    let make = match channels.div_ceil(channels.div_ceil(MOST).max(1)) {
        0 | 1 => Blocks::<1>::boxed,
        2 => Blocks::<2>::boxed,
        3 => Blocks::<3>::boxed,
        _ => Blocks::<MOST>::boxed,
    };
    make(sizes, transition, seen, gains, index)
}

/// What ties channels and states together, H or Kᵀ: for one block of channels after the other and each group of states, a group for
/// every channel of the block.
type Ties<const B: usize> = Vec<[Group; B]>;

/// One gain: Kᵀ, and the matrix W that whitens its innovations, in blocks by rows.
struct Gain<const B: usize> {
    correction: Ties<B>,
    whitening: Vec<[[f64; B]; B]>,
}

/// A filter with its channels in blocks of `B`.
struct Blocks<const B: usize> {
    states: usize,
    channels: usize,
    transition: Transition,
    turned: Transition,
    seen: Ties<B>,
    gains: Vec<Gain<B>>,
    index: Vec<Option<u8>>,
}

impl<const B: usize> Blocks<B> {
    fn boxed(
        [states, channels]: [usize; 2],
        transition: &[f64],
        seen: &[f64],
        gains: &[(Vec<f64>, Vec<f64>)],
        index: Vec<Option<u8>>,
    ) -> Box<dyn ConstantGain> {
        let (n, m) = (states, channels);
        let (groups, blocks) = (n.div_ceil(LANES), m.div_ceil(B));
        let ties = |at: &dyn Fn(usize, usize) -> f64| -> Ties<B> {
            let value = |c: usize, i: usize| if c < m && i < n { at(c, i) } else { 0.0 };
            let group = |c: usize, group: usize| std::array::from_fn(|lane| value(c, group * LANES + lane));
            let places = (0..blocks).flat_map(|block| (0..groups).map(move |group| (block, group)));
            places.map(|(block, of)| std::array::from_fn(|c| group(block * B + c, of))).collect()
        };
        let of = |(gain, whitening): &(Vec<f64>, Vec<f64>)| {
            let value = |c: usize, d: usize| if c < m && d < m { whitening[c * m + d] } else { 0.0 };
            let block = |k: usize, j: usize| {
                std::array::from_fn(|c| std::array::from_fn(|d| value(k * B + c, j * B + d)))
            };
            Gain {
                correction: ties(&|c, i| gain[i * m + c]),
                whitening: (0..blocks)
                    .flat_map(|k| (0..blocks).map(move |j| (k, j)))
                    .map(|(k, j)| block(k, j))
                    .collect(),
            }
        };
        Box::new(Self {
            states,
            channels,
            transition: Transition::new(n, |i, j| transition[i * n + j]),
            turned: Transition::new(n, |i, j| transition[j * n + i]),
            seen: ties(&|c, i| seen[c * n + i]),
            gains: gains.iter().map(of).collect(),
            index,
        })
    }

    fn groups(&self) -> usize {
        self.states.div_ceil(LANES)
    }

    fn blocks(&self) -> usize {
        self.channels.div_ceil(B)
    }

    /// Place of a channel's value in a column; beyond its end where there is no such channel.
    fn place(&self, block: usize, channel: usize, row: usize) -> usize {
        (block * B + channel) * self.index.len() + row
    }
}

impl<const B: usize> ConstantGain for Blocks<B> {
    fn whiten(&self, column: &[f64]) -> Vec<f64> {
        let (groups, blocks) = (self.groups(), self.blocks());
        let mut whitened = vec![0.0; self.channels * self.index.len()];
        let mut state = vec![[0.0; LANES]; groups];
        let mut before = state.clone();
        let mut innovation = vec![[0.0; B]; blocks];
        for (row, index) in self.index.iter().enumerate() {
            if let Some(gain) = index.map(|index| &self.gains[usize::from(index)]) {
                for (k, (innovation, seen)) in
                    innovation.iter_mut().zip(self.seen.chunks_exact(groups)).enumerate()
                {
                    let predicted = along(seen, &state);
                    for c in 0..B {
                        let value = column.get(self.place(k, c, row)).copied().unwrap_or_default();
                        innovation[c] = value - predicted[c];
                    }
                }
                for (innovation, correction) in innovation.iter().zip(gain.correction.chunks_exact(groups)) {
                    shift(&mut state, correction, innovation);
                }
                for (k, whitening) in gain.whitening.chunks_exact(blocks).enumerate() {
                    let mut values = [0.0; B];
                    for (weights, innovation) in whitening.iter().zip(&innovation).take(k + 1) {
                        for c in 0..B {
                            for d in 0..B {
                                values[c] += weights[c][d] * innovation[d];
                            }
                        }
                    }
                    for (c, value) in values.into_iter().enumerate() {
                        if let Some(slot) = whitened.get_mut(self.place(k, c, row)) {
                            *slot = value;
                        }
                    }
                }
            }
            std::mem::swap(&mut state, &mut before);
            self.transition.apply(&before, &mut state);
            if row % FLUSH_ROWS == 0 {
                flush(&mut state);
            }
        }
        whitened
    }

    fn backwards(&self, whitened: &[f64], over: Range<usize>, costate: &mut [f64]) {
        let (groups, blocks) = (self.groups(), self.blocks());
        let mut state = vec![[0.0; LANES]; groups];
        state.as_flattened_mut()[..self.states].copy_from_slice(costate);
        let mut after = state.clone();
        let mut innovation = vec![[0.0; B]; blocks];
        for row in over.rev() {
            std::mem::swap(&mut state, &mut after);
            self.turned.apply(&after, &mut state);
            if row % FLUSH_ROWS == 0 {
                flush(&mut state);
            }
            let Some(gain) = self.index[row].map(|index| &self.gains[usize::from(index)]) else { continue };
            for (innovation, correction) in innovation.iter_mut().zip(gain.correction.chunks_exact(groups)) {
                *innovation = along(correction, &state);
            }
            for (k, whitening) in gain.whitening.chunks_exact(blocks).enumerate() {
                let values: [f64; B] =
                    std::array::from_fn(|c| whitened.get(self.place(k, c, row)).copied().unwrap_or_default());
                for (weights, innovation) in whitening.iter().zip(&mut innovation).take(k + 1) {
                    for c in 0..B {
                        for d in 0..B {
                            innovation[d] += weights[c][d] * values[c];
                        }
                    }
                }
            }
            for (innovation, seen) in innovation.iter().zip(self.seen.chunks_exact(groups)) {
                shift(&mut state, seen, &innovation.map(|value| -value));
            }
        }
        costate.copy_from_slice(&state.as_flattened()[..self.states]);
    }
}

/// A state along the ties of each channel of a block.
#[inline(always)]
fn along<const B: usize>(ties: &[[Group; B]], state: &[Group]) -> [f64; B] {
    let mut sums = [[0.0; LANES]; B];
    for (ties, state) in ties.iter().zip(state) {
        for c in 0..B {
            for lane in 0..LANES {
                sums[c][lane] += ties[c][lane] * state[lane];
            }
        }
    }
    sums.map(|[a, b, c, d]| (a + b) + (c + d))
}

/// Moves a state along the ties of each channel of a block.
#[inline(always)]
fn shift<const B: usize>(state: &mut [Group], ties: &[[Group; B]], by: &[f64; B]) {
    for (state, ties) in state.iter_mut().zip(ties) {
        for c in 0..B {
            for lane in 0..LANES {
                state[lane] += ties[c][lane] * by[c];
            }
        }
    }
}

/// Φ: its diagonal, and for each group and each state beside it from which it comes, the weights.
struct Transition {
    diagonal: Vec<Group>,
    beside: Vec<(usize, usize, Group)>,
}

impl Transition {
    fn new(states: usize, at: impl Fn(usize, usize) -> f64) -> Self {
        let groups = states.div_ceil(LANES);
        let value = |i: usize, j: usize| if i < states { at(i, j) } else { 0.0 };
        let diagonal = |group: usize| {
            std::array::from_fn(|lane| {
                let i = group * LANES + lane;
                if i < states { at(i, i) } else { 0.0 }
            })
        };
        let beside = |group: usize, j: usize| -> Group {
            std::array::from_fn(|lane| {
                let i = group * LANES + lane;
                if i == j { 0.0 } else { value(i, j) }
            })
        };
        let places = (0..groups).flat_map(|group| (0..states).map(move |j| (group, j)));
        Self {
            diagonal: (0..groups).map(diagonal).collect(),
            beside: places
                .map(|(group, j)| (group, j, beside(group, j)))
                .filter(|(_, _, weights)| weights.iter().any(|&weight| weight != 0.0))
                .collect(),
        }
    }

    fn apply(&self, state: &[Group], next: &mut [Group]) {
        for ((next, state), diagonal) in next.iter_mut().zip(state).zip(&self.diagonal) {
            for lane in 0..LANES {
                next[lane] = diagonal[lane] * state[lane];
            }
        }
        let state = state.as_flattened();
        for &(group, j, weights) in &self.beside {
            let (next, value) = (&mut next[group], state[j]);
            for lane in 0..LANES {
                next[lane] += weights[lane] * value;
            }
        }
    }
}

/// Sets what is too small to matter to zero.
fn flush(state: &mut [Group]) {
    state.as_flattened_mut().iter_mut().filter(|value| value.abs() < FLUSH).for_each(|value| *value = 0.0);
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::constant_gain;
    use crate::whiten::{Filter, Space};

    /// Any number of channels and states, two gains and missing rows: as the filter of one gain after the other.
    #[test]
    fn blocks_run_as_rows_of_the_filter() {
        let mut random = Pcg64::seed_from_u64(11);
        let mut drawn = |count: usize, size: f64| -> Vec<f64> {
            (0..count).map(|_| size * (random.random::<f64>() - 0.5)).collect()
        };
        let rows = 200;
        let index: Vec<Option<u8>> =
            (0..rows).map(|row| (row % 17 != 3).then_some(u8::from(row > 90))).collect();
        for (n, m) in [(1, 1), (9, 1), (5, 2), (8, 3), (10, 4), (7, 5), (3, 6), (11, 9)] {
            let mut transition = drawn(n * n, 0.3 / n as f64);
            for i in 0..n {
                transition[i * n + i] = 0.9;
                transition[i * n + (i + 1) % n] = 0.0;
            }
            let space =
                Space { states: n, channels: m, transition, seen: drawn(m * n, 1.0), ..Space::default() };
            let mut gain = || {
                let mut whitening = drawn(m * m, 1.0);
                (0..m).for_each(|c| whitening[c * m + c + 1..(c + 1) * m].fill(0.0));
                (drawn(n * m, 0.2), whitening)
            };
            let gains = [gain(), gain()];
            let runs = constant_gain([n, m], &space.transition, &space.seen, &gains, index.clone());
            let filter = Filter::of_gains(&space, &gains, &index, 0.0);
            let column = drawn(m * rows, 1.0);
            let whitened = filter.whiten(&[&column]).swap_remove(0);
            assert_same(&runs.whiten(&column), &whitened);
            let [mut found, mut expected] = [drawn(n, 1.0), Vec::new()];
            expected.clone_from(&found);
            runs.backwards(&whitened, 20..190, &mut found);
            filter.backwards(&whitened, 20..190, &mut expected, |_, _| ());
            assert_same(&found, &expected);
        }
    }

    fn assert_same(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12 * (1.0 + b.abs())));
    }
}
