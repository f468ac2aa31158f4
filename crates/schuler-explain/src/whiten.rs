//! The Kalman filter as a whitener: innovations e/√S of a record, of any signature by the same gains, and the adjoint.
//!
//! The covariance half runs once for a model and a pattern of missing rows; a gain that has settled is kept until a
//! value is missing. Columns then run through the gains several at a time. The map from a column to its whitened
//! innovations is linear, T; the covariance of the record is (TᵀT)⁻¹, so that the adjoint pass gives
//! q = TᵀT y = R⁻¹y, the scores of every unit impulse at once.
//!
//! Columns of several channels stand channel after channel.

/// States of which a filter has room.
pub const MOST_STATES: usize = 32;
/// Channels of which a filter has room.
pub const MOST_CHANNELS: usize = 8;
/// Columns that run together where there are few, and where there are many.
const FEW: usize = 4;
const MANY: usize = 8;
/// Relative change of the covariance from row to row below which it has settled.
const SETTLED: f64 = 1e-12;
/// Rows after which states too small to matter are set to zero, so that arithmetic stays fast.
const FLUSH_ROWS: usize = 64;
/// What is too small to matter.
const FLUSH: f64 = 1e-140;
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
    /// Row from which on the white noise has another covariance.
    pub white_from: Option<(usize, Vec<f64>)>,
}

/// Gains of every row.
pub struct Filter {
    states: usize,
    channels: usize,
    padded: (usize, usize),
    transition: Vec<f64>,
    seen: Vec<f64>,
    /// For each gain K (states × channels), then W with W S Wᵀ = 1 (channels × channels), padded.
    gains: Vec<f64>,
    index: Vec<u32>,
    /// Σ ln det S over the rows present.
    pub log_variances: f64,
    /// Number of values present.
    pub count: usize,
}

/// Calls a function of compile-time sizes for the padded sizes (states, channels).
macro_rules! sized {
    ($padded:expr, $run:ident [$($other:tt),*] ( $($argument:expr),* )) => {
        match $padded {
            (1, 1) => $run::<$($other,)* 1, 1>($($argument),*),
            (2, 1) => $run::<$($other,)* 2, 1>($($argument),*),
            (3, 1) => $run::<$($other,)* 3, 1>($($argument),*),
            (4, 1) => $run::<$($other,)* 4, 1>($($argument),*),
            (8, 1) => $run::<$($other,)* 8, 1>($($argument),*),
            (_, 1) => $run::<$($other,)* 32, 1>($($argument),*),
            (6, 2) => $run::<$($other,)* 6, 2>($($argument),*),
            (_, 2) => $run::<$($other,)* 32, 2>($($argument),*),
            _ => $run::<$($other,)* 32, 8>($($argument),*),
        }
    };
}

/// Sizes, states and channels, for which there is code.
const fn padded(channels: usize, states: usize) -> (usize, usize) {
    match (channels, states) {
        (..=1, ..=1) => (1, 1),
        (..=1, 2..=4) => (states, 1),
        (..=1, ..=8) => (8, 1),
        (..=1, _) => (32, 1),
        (2, ..=6) => (6, 2),
        (2, _) => (32, 2),
        _ => (32, 8),
    }
}

impl Filter {
    /// The filter of `space` over rows that are `present` or not; `None` where the model is too large or singular.
    pub fn new(space: &Space, present: &[bool]) -> Option<Self> {
        if space.states > MOST_STATES || space.channels > MOST_CHANNELS || space.channels == 0 {
            return None;
        }
        sized!(padded(space.channels, space.states), gains[](space, present))
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
        sized!(self.padded, run[f64, 1](self, alone, alone_whitened));
        for (columns, whitened) in together.chunks(FEW).zip(together_whitened.chunks_mut(FEW)) {
            sized!(self.padded, run[f64, FEW](self, columns, whitened));
        }
        whitened
    }

    /// Whitened innovations of each column in single precision.
    pub fn whiten_single(&self, columns: &[&[f64]]) -> Vec<Vec<f32>> {
        let mut whitened = vec![vec![0.0; self.channels * self.rows()]; columns.len()];
        for (columns, whitened) in columns.chunks(MANY).zip(whitened.chunks_mut(MANY)) {
            sized!(self.padded, run[f32, MANY](self, columns, whitened));
        }
        whitened
    }

    /// Tᵀ of whitened innovations: with those of a record, q = R⁻¹y. 0 in rows that are missing.
    pub fn adjoint(&self, whitened: &[f64]) -> Vec<f64> {
        let (rows, (n, m)) = (self.rows(), self.padded);
        let stride = n * m + m * m;
        let mut scores = vec![0.0; self.channels * rows];
        let mut costate = vec![0.0; n];
        let mut turned = vec![0.0; n];
        let mut innovation = vec![0.0; m];
        for (row, &index) in self.index.iter().enumerate().rev() {
            for (i, value) in turned.iter_mut().enumerate().take(self.states) {
                *value = (0..self.states).map(|j| self.transition[j * n + i] * costate[j]).sum();
            }
            costate.copy_from_slice(&turned);
            if index != MISSING {
                let gain = &self.gains[index as usize * stride..][..stride];
                for c in 0..self.channels {
                    let through: f64 = (0..self.states).map(|i| gain[i * m + c] * turned[i]).sum();
                    let white: f64 =
                        (c..self.channels).map(|d| gain[n * m + d * m + c] * whitened[d * rows + row]).sum();
                    innovation[c] = through + white;
                    scores[c * rows + row] = innovation[c];
                }
                for i in 0..self.states {
                    costate[i] -=
                        (0..self.channels).map(|c| self.seen[c * n + i] * innovation[c]).sum::<f64>();
                }
            }
            if row % FLUSH_ROWS == 0 {
                costate.iter_mut().filter(|value| value.abs() < FLUSH).for_each(|value| *value = 0.0);
            }
        }
        scores
    }

    /// The whitening matrix W of a row, by rows; `None` where the row is missing.
    pub fn whitening(&self, row: usize) -> Option<Vec<f64>> {
        let index = self.index.get(row).copied().filter(|&index| index != MISSING)?;
        let (n, m) = self.padded;
        let whitening = self.gains.get(index as usize * (n * m + m * m) + n * m..)?;
        let channels = self.channels;
        Some((0..channels * channels).map(|flat| whitening[flat / channels * m + flat % channels]).collect())
    }

    /// The gain and the whitening matrix that it settles at, by rows: K (states × channels), W (channels × channels).
    pub fn settled(&self) -> (Vec<f64>, Vec<f64>) {
        let (n, m) = self.padded;
        let stride = n * m + m * m;
        let last = self.gains.len().saturating_sub(stride);
        let gain = self.gains.get(last..).unwrap_or_default();
        let at = |index: usize| gain.get(index).copied().unwrap_or_default();
        let (states, channels) = (self.states, self.channels);
        let k = (0..states * channels).map(|flat| at(flat / channels * m + flat % channels)).collect();
        let w =
            (0..channels * channels).map(|flat| at(n * m + flat / channels * m + flat % channels)).collect();
        (k, w)
    }

    /// The filter of the settled gain for `rows` rows, none missing: for responses that do not depend on when.
    #[must_use]
    pub fn settled_filter(&self, rows: usize) -> Self {
        let (n, m) = self.padded;
        let stride = n * m + m * m;
        let last = self.gains.len().saturating_sub(stride);
        Self {
            states: self.states,
            channels: self.channels,
            padded: self.padded,
            transition: self.transition.clone(),
            seen: self.seen.clone(),
            gains: self.gains.get(last..).unwrap_or_default().to_vec(),
            index: vec![0; rows],
            log_variances: 0.0,
            count: rows * self.channels,
        }
    }
}

/// Runs at most `L` columns through the gains.
fn run<T: Rounded, const L: usize, const N: usize, const M: usize>(
    filter: &Filter,
    columns: &[&[f64]],
    whitened: &mut [Vec<T>],
) {
    let Some(first) = columns.first() else { return };
    let inputs: [&[f64]; L] = std::array::from_fn(|lane| *columns.get(lane).unwrap_or(first));
    let (rows, channels) = (filter.rows(), if M == 1 { 1 } else { filter.channels.min(M) });
    let stride = N * M + M * M;
    let transition: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| filter.transition[i * N + j]));
    let seen: [[f64; N]; M] = std::array::from_fn(|c| std::array::from_fn(|j| filter.seen[c * N + j]));
    let used = if N <= 4 { N } else { filter.states.min(N) };
    let mut state = [[0.0; L]; N];
    for (row, &index) in filter.index.iter().enumerate() {
        if index != MISSING {
            let at = index as usize * stride;
            let gain = &filter.gains[at..at + stride];
            let mut innovation = [[0.0; L]; M];
            for c in 0..channels {
                for lane in 0..L {
                    innovation[c][lane] = inputs[lane][c * rows + row];
                }
                for i in 0..used {
                    let weight = seen[c][i];
                    for lane in 0..L {
                        innovation[c][lane] -= weight * state[i][lane];
                    }
                }
            }
            for c in 0..channels {
                for i in 0..used {
                    let weight = gain[i * M + c];
                    for lane in 0..L {
                        state[i][lane] += weight * innovation[c][lane];
                    }
                }
                let mut white = [0.0; L];
                for d in 0..=c {
                    let weight = gain[N * M + c * M + d];
                    for lane in 0..L {
                        white[lane] += weight * innovation[d][lane];
                    }
                }
                for (column, value) in whitened.iter_mut().zip(white) {
                    column[c * rows + row] = T::rounded(value);
                }
            }
        }
        let before = state;
        for i in 0..used {
            let mut sum = [0.0; L];
            for j in 0..used {
                let weight = transition[i][j];
                for lane in 0..L {
                    sum[lane] += weight * before[j][lane];
                }
            }
            state[i] = sum;
        }
        if row % FLUSH_ROWS == 0 {
            for value in state.iter_mut().flatten() {
                if value.abs() < FLUSH {
                    *value = 0.0;
                }
            }
        }
    }
}

/// Numbers that whitened innovations are kept in.
trait Rounded {
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

/// The covariance half of the filter.
fn gains<const N: usize, const M: usize>(space: &Space, present: &[bool]) -> Option<Filter> {
    let (n, m) = (space.states.min(N), space.channels.min(M));
    let transition: Square<N> = square(&space.transition, n);
    let driven: Square<N> = square(&space.driven, n);
    let seen: [[f64; N]; M] = std::array::from_fn(|c| {
        std::array::from_fn(|i| {
            if c < m && i < n { space.seen.get(c * n + i).copied().unwrap_or_default() } else { 0.0 }
        })
    });
    let white_before: Square<M> = square(&space.white, m);
    let after = space.white_from.as_ref().map(|(row, white)| (*row, square::<M>(white, m)));
    let mut white = white_before;
    let mut covariance: Square<N> = square(&space.start, n);
    let mut filter = Filter {
        states: n,
        channels: m,
        padded: padded(space.channels, space.states),
        transition: transition.iter().flatten().copied().collect(),
        seen: seen.iter().flatten().copied().collect(),
        gains: Vec::new(),
        index: Vec::with_capacity(present.len()),
        log_variances: 0.0,
        count: 0,
    };
    debug_assert_eq!(filter.padded, (N, M));
    let mut last = MISSING;
    let mut settled = false;
    let mut log_variance = 0.0;
    for (row, &present) in present.iter().enumerate() {
        if let Some((from, changed)) = &after
            && row == *from
        {
            white = *changed;
            settled = false;
        }
        if !present {
            settled = false;
            filter.index.push(MISSING);
            covariance = propagated(&covariance, &transition, &driven, n);
            continue;
        }
        if !settled {
            let (gain, whitening, updated) = update(&covariance, &seen, &white, n, m)?;
            let next = propagated(&updated, &transition, &driven, n);
            let change = (0..n)
                .flat_map(|i| (0..n).map(move |j| (i, j)))
                .map(|(i, j)| {
                    let size = (next[i][i] * next[j][j]).abs().sqrt();
                    if size > 0.0 { (next[i][j] - covariance[i][j]).abs() / size } else { 0.0 }
                })
                .fold(0.0, f64::max);
            settled = change < SETTLED;
            covariance = next;
            log_variance = -2.0 * (0..m).map(|c| whitening[c][c].ln()).sum::<f64>();
            if !log_variance.is_finite() {
                return None;
            }
            last = (filter.gains.len() / (N * M + M * M)) as u32;
            filter.gains.extend(gain.iter().flatten());
            filter.gains.extend(whitening.iter().flatten());
        }
        filter.index.push(last);
        filter.log_variances += log_variance;
        filter.count += m;
    }
    if filter.gains.is_empty() {
        filter.gains.resize(N * M + M * M, 0.0);
    }
    Some(filter)
}

fn propagated<const N: usize>(p: &Square<N>, phi: &Square<N>, driven: &Square<N>, n: usize) -> Square<N> {
    let mut half = [[0.0; N]; N];
    for i in 0..n {
        for j in 0..n {
            let weight = phi[i][j];
            if weight != 0.0 {
                for k in 0..n {
                    half[i][k] += weight * p[j][k];
                }
            }
        }
    }
    let mut next = *driven;
    for i in 0..n {
        for j in 0..=i {
            let mut sum = next[i][j];
            for k in 0..n {
                sum += half[i][k] * phi[j][k];
            }
            next[i][j] = sum;
            next[j][i] = sum;
        }
    }
    next
}

/// Gain, whitening matrix and covariance after the measurement.
fn update<const N: usize, const M: usize>(
    p: &Square<N>,
    h: &[[f64; N]; M],
    white: &Square<M>,
    n: usize,
    m: usize,
) -> Option<([[f64; M]; N], Square<M>, Square<N>)> {
    let mut crossed = [[0.0; M]; N];
    for i in 0..n {
        for c in 0..m {
            crossed[i][c] = (0..n).map(|j| p[i][j] * h[c][j]).sum();
        }
    }
    let mut root = [[0.0; M]; M];
    for c in 0..m {
        for d in 0..=c {
            let mut sum = white[c][d] + (0..n).map(|i| h[c][i] * crossed[i][d]).sum::<f64>();
            for e in 0..d {
                sum -= root[c][e] * root[d][e];
            }
            if c == d {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                root[c][c] = sum.sqrt();
            } else {
                root[c][d] = sum / root[d][d];
            }
        }
    }
    let mut whitening = [[0.0; M]; M];
    for c in 0..m {
        whitening[c][c] = root[c][c].recip();
        for d in 0..c {
            let sum: f64 = (d..c).map(|e| root[c][e] * whitening[e][d]).sum();
            whitening[c][d] = -sum * whitening[c][c];
        }
    }
    // K = P Hᵀ Wᵀ W; with B = P Hᵀ Wᵀ the covariance is P − B Bᵀ.
    let mut scaled = [[0.0; M]; N];
    for i in 0..n {
        for c in 0..m {
            scaled[i][c] = (0..=c).map(|d| crossed[i][d] * whitening[c][d]).sum();
        }
    }
    let mut gain = [[0.0; M]; N];
    let mut updated = *p;
    for i in 0..n {
        for c in 0..m {
            gain[i][c] = (c..m).map(|d| scaled[i][d] * whitening[d][c]).sum();
        }
        for j in 0..n {
            updated[i][j] -= (0..m).map(|c| scaled[i][c] * scaled[j][c]).sum::<f64>();
        }
    }
    Some((gain, whitening, updated))
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
            white_from: Some((17, vec![0.9, 0.1, 0.1, 0.2])),
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
                    let white = match &space.white_from {
                        Some((from, white)) if i >= *from => white,
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

    #[test]
    fn a_settled_gain_changes_nothing() {
        let space = Space { white_from: None, ..space() };
        let filter = Filter::new(&space, &[true; 3000]).unwrap();
        assert!(filter.gains.len() / (6 * 2 + 4) < 300);
        let exact = Filter { index: filter.index.clone(), ..filter.settled_filter(3000) };
        let (k, w) = filter.settled();
        let (k_again, w_again) = filter.settled_filter(10).settled();
        assert_eq!((k, w), (k_again, w_again));
        assert_eq!(exact.rows(), 3000);
    }
}
