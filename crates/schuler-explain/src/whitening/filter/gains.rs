//! Gains by the propagation of the covariance, row by row until they settle.
use std::sync::OnceLock;

use super::runs::{Square, Transition, square};
use super::{Filter, MISSING, Space};
use crate::whitening::course::{Course, course};

/// Relative change of the variances from row to row below which they have settled.
const SETTLED: f64 = 1e-12;

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

pub(super) fn gains_of_few<const N: usize>(
    space: &Space,
    present: &[bool],
    long_rows: usize,
) -> Option<Filter> {
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

pub(super) fn gains_of_many(space: &Space, present: &[bool], long_rows: usize) -> Option<Filter> {
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

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
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
pub(super) fn nonzero(space: &Space) -> Vec<Vec<(usize, f64)>> {
    let n = space.states;
    let of_row = |i: usize| {
        let row = space.transition[i * n..(i + 1) * n].iter().copied().enumerate();
        row.filter(|(_, weight)| *weight != 0.0).collect()
    };
    (0..n).map(of_row).collect()
}
