//! Runs of one gain over a column, forwards and backwards, where channels or states are many.
//!
//! A gain that holds for many rows is worth being laid out for them: of each product four results are summed side by side and stay in
//! registers.
use std::ops::Range;

/// Results that are summed side by side.
const LANES: usize = 4;
/// Rows after which states too small to matter are set to zero, so that arithmetic stays fast; and what that is.
const FLUSH_ROWS: usize = 64;
const FLUSH: f64 = 1e-140;

/// A matrix whose rows stand in groups of [`LANES`], and the groups column after column.
struct Packed {
    columns: usize,
    values: Vec<[f64; LANES]>,
}

impl Packed {
    fn new(rows: usize, columns: usize, at: impl Fn(usize, usize) -> f64) -> Self {
        let value = |i: usize, j: usize| if i < rows { at(i, j) } else { 0.0 };
        let groups = (0..rows).step_by(LANES);
        let values = groups
            .flat_map(|first| (0..columns).map(move |j| (first, j)))
            .map(|(first, j)| std::array::from_fn(|lane| value(first + lane, j)))
            .collect();
        Self { columns, values }
    }

    /// Adds weight · A x to a sum.
    fn add(&self, weight: f64, x: &[f64], sum: &mut [[f64; LANES]]) {
        for (sum, group) in sum.iter_mut().zip(self.values.chunks_exact(self.columns)) {
            // Halves do not wait for each other.
            let (first, second) = group.split_at(self.columns / 2);
            let (x_first, x_second) = x.split_at(self.columns / 2);
            let of = |group: &[[f64; LANES]], x: &[f64]| {
                let mut own = [0.0; LANES];
                for (column, x) in group.iter().zip(x) {
                    for lane in 0..LANES {
                        own[lane] += column[lane] * x;
                    }
                }
                own
            };
            let (first, second) = (of(first, x_first), of(second, x_second));
            for lane in 0..LANES {
                sum[lane] += weight * (first[lane] + second[lane]);
            }
        }
    }
}

/// One gain K, with the matrix W that whitens its innovations, and both turned.
struct Gain {
    correction: Packed,
    whitening: Packed,
    correction_turned: Packed,
    whitening_turned: Packed,
}

/// A filter of few gains.
pub struct ConstantGain {
    states: usize,
    channels: usize,
    /// What is not zero of Φ.
    transition: Vec<(usize, usize, f64)>,
    seen: Packed,
    seen_turned: Packed,
    gains: Vec<Gain>,
    /// The gain of each row; `None` where it is missing.
    index: Vec<Option<u8>>,
}

impl ConstantGain {
    /// From Φ and H by rows, K and W by rows of each gain, and the gain of each row, `None` where it is missing.
    pub fn new(
        [states, channels]: [usize; 2],
        transition: &[f64],
        seen: &[f64],
        gains: &[(Vec<f64>, Vec<f64>)],
        index: Vec<Option<u8>>,
    ) -> Self {
        let (n, m) = (states, channels);
        let places = (0..n).flat_map(|i| (0..n).map(move |j| (i, j, transition[i * n + j])));
        let of = |(gain, whitening): &(Vec<f64>, Vec<f64>)| Gain {
            correction: Packed::new(n, m, |i, c| gain[i * m + c]),
            whitening: Packed::new(m, m, |c, d| whitening[c * m + d]),
            correction_turned: Packed::new(m, n, |c, i| gain[i * m + c]),
            whitening_turned: Packed::new(m, m, |c, d| whitening[d * m + c]),
        };
        Self {
            states,
            channels,
            transition: places.filter(|(_, _, weight)| *weight != 0.0).collect(),
            seen: Packed::new(m, n, |c, i| seen[c * n + i]),
            seen_turned: Packed::new(n, m, |i, c| seen[c * n + i]),
            gains: gains.iter().map(of).collect(),
            index,
        }
    }

    /// Whitened innovations of a column; 0 in rows that are missing.
    pub fn whiten(&self, column: &[f64]) -> Vec<f64> {
        let (rows, n, m) = (self.index.len(), self.states, self.channels);
        let mut whitened = vec![0.0; m * rows];
        let mut state = vec![[0.0; LANES]; n.div_ceil(LANES)];
        let mut before = state.clone();
        let mut innovation = vec![[0.0; LANES]; m.div_ceil(LANES)];
        let mut result = innovation.clone();
        for (row, index) in self.index.iter().enumerate() {
            if let Some(gain) = index.map(|index| &self.gains[usize::from(index)]) {
                for (c, value) in innovation.as_flattened_mut()[..m].iter_mut().enumerate() {
                    *value = column[c * rows + row];
                }
                self.seen.add(-1.0, &state.as_flattened()[..n], &mut innovation);
                let innovation = &innovation.as_flattened()[..m];
                gain.correction.add(1.0, innovation, &mut state);
                result.fill([0.0; LANES]);
                gain.whitening.add(1.0, innovation, &mut result);
                for (c, value) in result.as_flattened()[..m].iter().enumerate() {
                    whitened[c * rows + row] = *value;
                }
            }
            std::mem::swap(&mut state, &mut before);
            state.fill([0.0; LANES]);
            let (next, before) = (state.as_flattened_mut(), before.as_flattened());
            for &(i, j, weight) in &self.transition {
                next[i] += weight * before[j];
            }
            if row % FLUSH_ROWS == 0 {
                flush(next);
            }
        }
        whitened
    }

    /// Takes the derivative of half the sum of squares of whitened innovations by the state from the end of some rows to
    /// their beginning.
    pub fn backwards(&self, whitened: &[f64], over: Range<usize>, costate: &mut [f64]) {
        let (rows, n, m) = (self.index.len(), self.states, self.channels);
        let mut state = vec![[0.0; LANES]; n.div_ceil(LANES)];
        state.as_flattened_mut()[..n].copy_from_slice(costate);
        let mut after = state.clone();
        let mut innovation = vec![[0.0; LANES]; m.div_ceil(LANES)];
        let mut result = vec![0.0; m];
        for row in over.rev() {
            std::mem::swap(&mut state, &mut after);
            state.fill([0.0; LANES]);
            let (turned, after) = (state.as_flattened_mut(), after.as_flattened());
            for &(i, j, weight) in &self.transition {
                turned[j] += weight * after[i];
            }
            if row % FLUSH_ROWS == 0 {
                flush(turned);
            }
            if let Some(gain) = self.index[row].map(|index| &self.gains[usize::from(index)]) {
                for (c, value) in result.iter_mut().enumerate() {
                    *value = whitened[c * rows + row];
                }
                innovation.fill([0.0; LANES]);
                gain.whitening_turned.add(1.0, &result, &mut innovation);
                gain.correction_turned.add(1.0, &state.as_flattened()[..n], &mut innovation);
                self.seen_turned.add(-1.0, &innovation.as_flattened()[..m], &mut state);
            }
        }
        costate.copy_from_slice(&state.as_flattened()[..n]);
    }
}

/// Sets what is too small to matter to zero.
fn flush(values: &mut [f64]) {
    values.iter_mut().filter(|value| value.abs() < FLUSH).for_each(|value| *value = 0.0);
}
