//! The Kalman filter as a whitener: innovations e/√S of a record, of any signature by the same gains, and the adjoint.
//!
//! The covariance half runs once for a model and a pattern of missing rows; a gain that has settled is kept until a
//! value is missing. Columns then run through the gains, several at a time or through what was laid out for it
//! (`laid_out.rs`). The map from a column to its whitened innovations is linear, T; the covariance of the record is
//! (TᵀT)⁻¹, so that the adjoint pass gives q = TᵀT y = R⁻¹y, the scores of every unit impulse at once.
//!
//! Columns of several channels stand channel after channel. There is no limit to states or channels; of one channel and
//! few states the code is of fixed sizes.
mod gains;
mod runs;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use nalgebra::DMatrix;

use self::gains::{dot, gains_of_few, gains_of_many, nonzero};
pub use self::runs::{Rounded, flush};
use self::runs::{over_missing, run_few, run_parts};
use crate::whitening::laid_out::{Gains, LaidOut, is_of_usual_size, lay_out};

/// Columns that run together where there are few, and where there are many.
const FEW: usize = 4;
const MANY: usize = 8;
/// Rows from which on a gain, or that of each, is laid out for the columns, where channels or states are many.
const LONG_RUN: usize = 16;
/// Gains after which no more are laid out: a long record with many gaps has as many as it has rows.
const MOST_LAID_OUT: usize = 1 << 17;
/// Rows after which states too small to matter are set to zero, so that arithmetic stays fast.
pub const FLUSH_ROWS: usize = 64;
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
