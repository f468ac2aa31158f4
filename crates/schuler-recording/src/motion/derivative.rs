//! Derivatives of what was recorded row by row, of the order that motion and noise ask for.
//!
//! Of orders it is best that leaves out no more of the motion than the noise that it lets through hides over the whole recording: what is
//! left out goes with the motion, and in N rows a part of it that is √N times smaller than the noise of a row is seen. The second order
//! takes 658 ppm of a motion of 1 Hz at 100 Hz; with noise of the attitude of 10 µrad, which no row tells it from, a minute shows them.
//! How much is left out is told by the spectrum of the motion, as far as that stands out of the noise.
use nalgebra::Vector3;
use schuler_fourier::Forward;

use super::Use;

/// Rows on either side within which a body stands that stands still, and the change within them, as a part of the largest from row to row:
/// what such a body did before, or does later, is nothing to its rate, and would be let in by as many neighbours as its motion is worth.
const STILL_ROWS: usize = 2;
const STILL: f64 = 1e-6;
/// Most neighbours on either side that a derivative is made of, and the difference by which noise is judged.
const WIDEST: usize = 16;
/// Turn of a neighbour, but the nearest, beside a steady one that is still used, rad.
pub(super) const FARTHEST_TURN: f64 = 1.0;
/// About as many rows say which order is best.
const SAMPLED_ROWS: usize = 20_000;
/// Fewest of them that can.
const FEWEST_ROWS: usize = 10;
/// Part of the mean square of what is of the instant that may be noise.
const MOST_NOISE: f64 = 0.25;
/// Fewest and most slopes that have a spectrum.
const FEWEST_OF_SPECTRUM: usize = 64;
const MOST_OF_SPECTRUM: usize = 1 << 14;
/// How far a line of the spectrum stands out of the mean of its noise, of which one bin in a million does.
const STANDS_OUT: f64 = 14.0;
/// Least part of a line in the slope over two rows by which it can be judged.
const LEAST_TAKEN: f64 = 0.1;
/// Mean square error, of that of the best order, with which a lower one is as good.
const AS_GOOD: f64 = 4.0;

/// Derivative in every row of what differs by `change(row, other)` between two rows; none where a neighbour is missing.
///
/// White noise is judged by a difference of high order, which takes least of a motion: one of 2.2 rad a step, which low differences
/// cannot tell from noise, counts for a 160th of what it is in the 32nd.
pub(super) fn derivatives(
    time_s: &[f64],
    change: impl Fn(usize, usize) -> Option<Vector3<f64>>,
    purpose: Use,
) -> Vec<Option<Vector3<f64>>> {
    let changes = |row: usize, most: usize| Changes::new(time_s, &change, row, most);
    let stride = time_s.len().div_ceil(SAMPLED_ROWS).max(1);
    let sampled: Vec<Changes> = (0..time_s.len()).step_by(stride).map(|row| changes(row, WIDEST)).collect();
    let mut orders = (2..=WIDEST).rev().find_map(|widest| Orders::new(&sampled, widest));
    if let Some(orders) = &mut orders {
        let slopes = longest_run(time_s.len(), |row| changes(row, 1).slope());
        orders.judge_by_spectrum(&slopes, time_s.len());
    }
    let reach = orders.as_ref().map_or(1, |orders| match purpose {
        Use::Instant if !orders.noisy => orders.errors.len(),
        _ => orders.best,
    });
    let as_good = |reach: usize| orders.as_ref().is_none_or(|orders| orders.is_as_good(reach));
    let weights: Vec<Vec<f64>> = (0..=reach).map(flattest).collect();
    let nothing = STILL * sampled.iter().map(Changes::nearest).fold(0.0, f64::max);
    (0..time_s.len())
        .map(|row| {
            let changes = changes(row, reach);
            if changes.reach() >= STILL_ROWS && changes.is_still(nothing) {
                return Some(changes.sum(&weights[1]));
            }
            let reach = changes.reach();
            (reach > 0 && (purpose != Use::Prediction || as_good(reach)))
                .then(|| changes.sum(&weights[reach]))
        })
        .collect()
}

/// What derivatives of several orders are worth in a recording.
struct Orders {
    /// Mean square errors of the derivatives over one, two … neighbours.
    errors: Vec<f64>,
    /// Variance of the slope over one row on either side by noise.
    noise: f64,
    /// Neighbours of the best derivative.
    best: usize,
    /// Whether noise is more than [`MOST_NOISE`] of what the widest gives.
    noisy: bool,
}

impl Orders {
    /// Those of sampled rows, where noise is judged by `widest` neighbours; none where too few rows have so many.
    fn new(sampled: &[Changes], widest: usize) -> Option<Self> {
        let full = || sampled.iter().filter(|changes| changes.reach() >= widest);
        let count = full().count();
        if count < FEWEST_ROWS || 2 * count < sampled.iter().filter(|changes| changes.reach() > 0).count() {
            return None;
        }
        let mean = |value: &dyn Fn(&Changes) -> f64| full().map(value).sum::<f64>() / count as f64;
        let noise = mean(&|changes| changes.noise(widest));
        let best = flattest(widest);
        let of_reach = |reach: usize| {
            let weights = flattest(reach);
            let left_out: Vec<f64> = (best.iter().enumerate())
                .map(|(k, weight)| weight - weights.get(k).unwrap_or(&0.0))
                .collect();
            let motion =
                mean(&|changes| changes.sum(&left_out).norm_squared()) - noise * noise_through(&left_out);
            motion.max(0.0) + noise * noise_through(&weights)
        };
        let noisy =
            noise * noise_through(&best) > MOST_NOISE * mean(&|changes| changes.sum(&best).norm_squared());
        let errors: Vec<f64> = (1..=widest).map(of_reach).collect();
        let best = least(&errors);
        Some(Self { errors, noise, best, noisy })
    }

    /// Takes the derivative as the best whose errors of the motion, by the spectrum of `slopes` over one row on either side, are least in
    /// all of the `rows` beside its noise in one of them.
    fn judge_by_spectrum(&mut self, slopes: &[Vector3<f64>], rows: usize) {
        if slopes.len() < FEWEST_OF_SPECTRUM {
            return;
        }
        let spectrum = Spectrum::new(slopes, self.noise);
        let of_reach = |reach: usize| {
            let weights = flattest(reach);
            rows as f64 * spectrum.left_out(&weights) + self.noise * noise_through(&weights)
        };
        let errors: Vec<f64> = (1..=self.errors.len()).map(of_reach).collect();
        self.best = least(&errors);
    }

    fn is_as_good(&self, reach: usize) -> bool {
        let error = |reach: usize| self.errors.get(reach.wrapping_sub(1)).copied().unwrap_or_default();
        error(reach) <= AS_GOOD * error(self.best)
    }
}

/// Neighbours of the derivative with the least of errors over one, two … of them.
fn least(errors: &[f64]) -> usize {
    let least = errors.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
    least.map_or(1, |(index, _)| index + 1)
}

/// The values of the longest stretch of rows that have one, at most [`MOST_OF_SPECTRUM`].
fn longest_run(rows: usize, value: impl Fn(usize) -> Option<Vector3<f64>>) -> Vec<Vector3<f64>> {
    let (mut run, mut longest) = (Vec::new(), Vec::new());
    for row in 0..rows {
        match value(row) {
            Some(value) => run.push(value),
            None if run.len() > longest.len() => longest = std::mem::take(&mut run),
            None => run.clear(),
        }
        if run.len() == MOST_OF_SPECTRUM {
            return run;
        }
    }
    if run.len() > longest.len() { run } else { longest }
}

/// What of the spectrum of a rate stands out of its noise.
struct Spectrum {
    /// Frequency, rad a row, and mean square.
    lines: Vec<(f64, f64)>,
}

impl Spectrum {
    /// That of slopes over one row on either side, whose white noise has the variance `noise`.
    fn new(slopes: &[Vector3<f64>], noise: f64) -> Self {
        let rows = slopes.len() as f64;
        let mean = slopes.iter().sum::<Vector3<f64>>() / rows;
        let step = std::f64::consts::TAU / rows;
        // By Hann's window, whose squares add up to 3/8 of the rows.
        let window = |row: usize| 0.5 - 0.5 * (step * row as f64).cos();
        let forward = Forward::new(slopes.len());
        let mut powers = vec![0.0; slopes.len() / 2 + 1];
        for axis in 0..3 {
            let of_axis = |(row, slope): (usize, &Vector3<f64>)| window(row) * (slope[axis] - mean[axis]);
            for (power, bin) in
                powers.iter_mut().zip(forward.transform(slopes.iter().enumerate().map(of_axis)))
            {
                // Both signs of the frequency.
                *power += 2.0 * bin.norm_sqr() / (0.375 * rows * rows);
            }
        }
        let lines = powers.into_iter().enumerate().skip(1).filter_map(|(bin, power)| {
            let omega = step * bin as f64;
            let taken = omega.sin();
            // The slope over two rows has 2 sin² ω of the mean of its noise in a bin.
            let of_noise = 4.0 * noise * taken * taken / rows;
            let is_judged = taken > LEAST_TAKEN || omega < 1.0;
            let is_motion = is_judged && power > STANDS_OUT * of_noise;
            is_motion.then(|| (omega, (power - of_noise) * (omega / taken).powi(2)))
        });
        Self { lines: lines.collect() }
    }

    /// Mean square of what a derivative with weights leaves out.
    fn left_out(&self, weights: &[f64]) -> f64 {
        let of_line = |&(omega, square): &(f64, f64)| {
            let taken = |(weight, k): (&f64, i32)| weight * (omega * f64::from(k)).sin() / f64::from(k);
            let taken: f64 = weights.iter().zip(1..).map(taken).sum();
            square * (taken / omega - 1.0).powi(2)
        };
        self.lines.iter().map(of_line).sum()
    }
}

/// Weights of slopes over 1 … `reach` rows on either side in the derivative whose error is of the highest order, 2 `reach`:
/// 2 (−1)^(k+1) (N!)² / ((N − k)! (N + k)!) (Fornberg, Math. Comp. 51, 1988).
fn flattest(reach: usize) -> Vec<f64> {
    let mut weight = -2.0;
    (1..=reach)
        .map(|k| {
            weight *= -((reach + 1 - k) as f64) / (reach + k) as f64;
            weight
        })
        .collect()
}

/// Variance that combined slopes have by white noise, relative to that of the slope over one row on either side.
fn noise_through(weights: &[f64]) -> f64 {
    weights.iter().zip(1..).map(|(weight, k)| (weight / f64::from(k)).powi(2)).sum()
}

/// What the rows on either side of a row differ from it by.
struct Changes {
    /// Before and after, nearest first, and the time between the two, s; as far as both are there.
    pairs: Vec<([Vector3<f64>; 2], f64)>,
}

impl Changes {
    fn new(
        time_s: &[f64],
        change: &impl Fn(usize, usize) -> Option<Vector3<f64>>,
        row: usize,
        most: usize,
    ) -> Self {
        let pair = |k: usize| {
            let (before, after) = (row.checked_sub(k)?, row + k);
            Some(([change(row, before)?, change(row, after)?], time_s.get(after)? - time_s.get(before)?))
        };
        Self { pairs: (1..=most).map_while(pair).collect() }
    }

    fn reach(&self) -> usize {
        self.pairs.len()
    }

    /// The slope over the nearest rows.
    fn slope(&self) -> Option<Vector3<f64>> {
        self.pairs.first().map(|([before, after], span_s)| (after - before) / *span_s)
    }

    /// The larger of the changes to the nearest rows.
    fn nearest(&self) -> f64 {
        self.pairs.first().map_or(0.0, |([before, after], _)| before.norm().max(after.norm()))
    }

    /// Whether none of the nearest rows differs by more than `nothing`.
    fn is_still(&self, nothing: f64) -> bool {
        let near = self.pairs.iter().take(STILL_ROWS).flat_map(|(changes, _)| changes);
        near.into_iter().all(|change| change.norm() <= nothing)
    }

    /// Sum of the slopes with weights.
    fn sum(&self, weights: &[f64]) -> Vector3<f64> {
        let slopes = self.pairs.iter().map(|([before, after], span_s)| (after - before) / *span_s);
        slopes.zip(weights).map(|(slope, weight)| slope * *weight).sum()
    }

    /// Variance of the slope over one row on either side, if the difference of the order 2 `reach` is white noise.
    fn noise(&self, reach: usize) -> f64 {
        // The weights of a row k away are (−1)^k C(2N, N + k), the sum of the squares of all is C(4N, 2N).
        let (mut binomial, mut squares) = (1.0, 1.0);
        for k in 1..=2 * reach {
            squares *= (2 * reach + k) as f64 / k as f64;
        }
        for k in 1..=reach {
            binomial *= (reach + k) as f64 / k as f64;
        }
        let mut difference = Vector3::zeros();
        for (k, ([before, after], _)) in self.pairs.iter().take(reach).enumerate() {
            binomial *= -((reach - k) as f64) / (reach + k + 1) as f64;
            difference += (before + after) * binomial;
        }
        let span_s = self.pairs.first().map_or(1.0, |(_, span_s)| *span_s);
        2.0 * difference.norm_squared() / squares / span_s.powi(2)
    }
}
