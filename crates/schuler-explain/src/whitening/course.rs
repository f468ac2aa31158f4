//! The gain of a filter over a stretch without missing rows, by a few of its rows.
//!
//! Of the predicted covariance P, M = P − Q is what comes from the rows before. A step sees it through the noise R + HQHᵀ, which is
//! there also where the instrument has no white noise, R = 0. That of s steps on, M(k+s) = D + A M(k) (1 + G M(k))⁻¹ Aᵀ, has the
//! form of that of one step, for which, with V = (R + HQHᵀ)⁻¹: G = HᵀVH, A = Φ(1 − QHᵀVH), D = Φ(Q − QHᵀVHQ)Φᵀ;
//! that of twice as many steps follows by the doubling of Anderson (1978) and Chu, Fan & Lin (2005). Slow noise keeps a gain from settling for most of a record, but the longer it has been going on the slower
//! it changes: between rows that are computed exactly it is a cubic. Their distance is doubled when cubics through every
//! second of them give those between to [`INTERPOLATED`], so that an oscillation is seen long before it is stepped over.
use std::collections::VecDeque;

use nalgebra::DMatrix;

use crate::whitening::filter::Space;

/// Error of a gain, as a part of its size, where it is interpolated at twice the distance; at the distance itself it is
/// a sixteenth.
const INTERPOLATED: f64 = 3e-6;
/// Change from one computed row to the next, as a part of its size, below which a gain has settled.
const SETTLED: f64 = 1e-9;
/// Least size of the gains of a state, as a part of what they can be at most: what is smaller may be nothing but rounding.
const LEAST_SIZE: f64 = 1e-3;
/// Computed rows by which it is decided whether their distance can be doubled.
const JUDGED: usize = 9;

/// M over a number of steps; states in units of their own spread.
struct Steps {
    states: usize,
    transition: Vec<f64>,
    information: Vec<f64>,
    driven: Vec<f64>,
}

/// Gains at rows that were computed.
struct Computed {
    row: usize,
    gain: Vec<f64>,
    /// Of each gain, what its errors are measured by.
    sizes: Vec<f64>,
    log_variance: f64,
}

/// Gains over a stretch.
pub struct Course {
    /// Gains of the rows up to the one from which on it is settled, one after the other.
    pub gains: Vec<f64>,
    /// ln det S of the same rows.
    pub log_variances: Vec<f64>,
    /// Covariance predicted for the row after the stretch.
    pub covariance: Vec<f64>,
}

/// The course of the gain over `rows` rows that are all present, from the predicted `covariance`; `measure` gives the gain
/// and ln det S for a predicted covariance. `None` where R + HQHᵀ is singular or something is not finite.
pub fn course(
    space: &Space,
    white: &[f64],
    covariance: &[f64],
    rows: usize,
    mut measure: impl FnMut(&[f64], &mut Vec<f64>) -> Option<f64>,
) -> Option<Course> {
    let units = space.units(covariance);
    let mut doubled = vec![Steps::one(&space.in_units(&units), white)?];
    let from_before: Vec<f64> = covariance.iter().zip(&space.driven).map(|(p, q)| p - q).collect();
    let start = with_units(&from_before, &units, |value, unit| value / unit);
    let predicted = |scaled: &[f64]| -> Vec<f64> {
        let from_before = with_units(scaled, &units, |value, unit| value * unit);
        from_before.iter().zip(&space.driven).map(|(m, q)| m + q).collect()
    };
    let mut scaled = start.clone();
    let mut work = Work::default();
    let mut natural = covariance.to_vec();
    let mut computed: Vec<Computed> = Vec::new();
    // The last computed rows of the present distance.
    let mut judged: VecDeque<usize> = VecDeque::new();
    let (mut row, mut power) = (0, 0);
    let mut settled = false;
    loop {
        let mut gain = Vec::new();
        let log_variance = measure(&natural, &mut gain)?;
        if !log_variance.is_finite() {
            return None;
        }
        let sizes = sizes(space, &natural, &gain);
        let here = Computed { row, gain, sizes, log_variance };
        settled = settled || computed.last().is_some_and(|last| last.is_near(&here, SETTLED));
        judged.push_back(computed.len());
        computed.push(here);
        if settled || row + 1 >= rows {
            break;
        }
        if judged.len() == JUDGED {
            let at = |place: usize| &computed[judged[place]];
            let smooth = [1, 3, 5, 7].into_iter().all(|place| {
                let first = if place == 1 { 0 } else { (place - 3).min(2) };
                let nodes = [first, first + 2, first + 4, first + 6];
                let weights = lagrange(nodes.map(|node| node as f64), place as f64);
                agrees(nodes.map(at), weights, at(place))
            });
            if smooth {
                if power + 1 == doubled.len() {
                    let next = doubled[power].doubled()?;
                    doubled.push(next);
                }
                power += 1;
                let every_second = judged.iter().copied().step_by(2).collect();
                judged = every_second;
            } else {
                judged.pop_front();
            }
        }
        doubled[power].apply(&mut scaled, &mut work)?;
        row += 1 << power;
        natural = predicted(&scaled);
    }
    // Where the stretch ends.
    if !settled && row != rows {
        // The last computed row is beyond the end; from the start by powers of two.
        let mut left = rows;
        scaled = start;
        while left > 0 {
            let power = (left.ilog2() as usize).min(doubled.len() - 1);
            doubled[power].apply(&mut scaled, &mut work)?;
            left -= 1 << power;
        }
        natural = predicted(&scaled);
    }
    let (gains, log_variances) = between(&computed, rows);
    let finite = gains.iter().all(|value| value.is_finite());
    finite.then_some(Course { gains, log_variances, covariance: natural })
}

/// A matrix by rows, in other units.
fn with_units(matrix: &[f64], units: &[f64], by: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let n = units.len();
    matrix.iter().enumerate().map(|(flat, &value)| by(by(value, units[flat / n]), units[flat % n])).collect()
}

/// What the errors of each gain are measured by. A gain of a state and a channel in units of their standard deviations, √P and √S,
/// is at most one, and a state's largest stands for all of its gains: one of them may be zero but for rounding. Elements of the
/// whitening matrix are measured by its diagonal.
fn sizes(space: &Space, predicted: &[f64], gain: &[f64]) -> Vec<f64> {
    let (n, m) = (space.states, space.channels);
    let (gains, whitening) = gain.split_at(n * m);
    let channels: Vec<f64> = (0..m).map(|c| whitening[c * m + c].abs()).collect();
    let of_states = gains.chunks_exact(m).enumerate().flat_map(|(i, gains)| {
        let largest = gains.iter().zip(&channels).map(|(gain, unit)| gain.abs() / unit).fold(0.0, f64::max);
        let size = largest.max(LEAST_SIZE * predicted[i * n + i].max(0.0).sqrt());
        channels.iter().map(move |unit| size * unit)
    });
    of_states.chain((0..m).flat_map(|_| channels.iter().copied())).collect()
}

impl Computed {
    /// Whether no gain differs by more than a part of its size.
    fn is_near(&self, other: &Self, part: f64) -> bool {
        let sizes = self.sizes.iter().zip(&other.sizes).map(|(a, b)| a.max(*b));
        self.gain.iter().zip(&other.gain).zip(sizes).all(|((a, b), size)| (a - b).abs() <= part * size)
    }
}

/// Whether an interpolation gives a gain.
fn agrees(nodes: [&Computed; 4], weights: [f64; 4], at: &Computed) -> bool {
    at.gain.iter().zip(&at.sizes).enumerate().all(|(place, (value, size))| {
        let found: f64 = nodes.iter().zip(weights).map(|(node, weight)| node.gain[place] * weight).sum();
        let size = nodes.iter().fold(*size, |size, node| size.max(node.sizes[place]));
        (found - value).abs() <= INTERPOLATED * size
    })
}

/// Weights of the cubic through four places.
fn lagrange(places: [f64; 4], at: f64) -> [f64; 4] {
    std::array::from_fn(|i| {
        (0..4).filter(|&j| j != i).map(|j| (at - places[j]) / (places[i] - places[j])).product()
    })
}

/// Gains and ln det S of all rows up to the last one computed, or to the end of the stretch.
fn between(computed: &[Computed], rows: usize) -> (Vec<f64>, Vec<f64>) {
    let size = computed.first().map_or(0, |first| first.gain.len());
    let number = computed.last().map_or(0, |last| last.row + 1).min(rows);
    let (mut gains, mut log_variances) = (Vec::with_capacity(number * size), Vec::with_capacity(number));
    for (place, here) in computed.iter().enumerate() {
        if here.row >= number {
            break;
        }
        gains.extend_from_slice(&here.gain);
        log_variances.push(here.log_variance);
        let Some(next) = computed.get(place + 1).filter(|next| next.row > here.row + 1) else { continue };
        // Rows in between are only left out after more than four were computed.
        let first = place.saturating_sub(1).min(computed.len().saturating_sub(4));
        let [a, b, c, d] = std::array::from_fn(|index| &computed[(first + index).min(computed.len() - 1)]);
        let places = [a, b, c, d].map(|node| node.row as f64);
        let scales: [f64; 4] = std::array::from_fn(|i| {
            (0..4).filter(|&j| j != i).map(|j| places[i] - places[j]).product::<f64>().recip()
        });
        for row in here.row + 1..next.row.min(number) {
            let [pa, pb, pc, pd] = places.map(|place| row as f64 - place);
            let [wa, wb, wc, wd] = [
                pb * pc * pd * scales[0],
                pa * pc * pd * scales[1],
                pa * pb * pd * scales[2],
                pa * pb * pc * scales[3],
            ];
            let pairs = a.gain.iter().zip(&b.gain).zip(c.gain.iter().zip(&d.gain));
            gains.extend(pairs.map(|((a, b), (c, d))| wa * a + wb * b + wc * c + wd * d));
            log_variances
                .push(wa * a.log_variance + wb * b.log_variance + wc * c.log_variance + wd * d.log_variance);
        }
    }
    (gains, log_variances)
}

/// Room to work in.
#[derive(Default)]
struct Work {
    left: Vec<f64>,
    right: Vec<f64>,
}

impl Steps {
    /// One step: a measurement and the transition after it.
    fn one(space: &Space, white: &[f64]) -> Option<Self> {
        let (n, m) = (space.states, space.channels);
        let seen = DMatrix::from_row_slice(m, n, &space.seen);
        let driven = DMatrix::from_row_slice(n, n, &space.driven);
        let transition = DMatrix::from_row_slice(n, n, &space.transition);
        let crossed = &driven * seen.transpose();
        let noise = DMatrix::from_row_slice(m, m, white) + &seen * &crossed;
        // Its inverse only where it is far from singular.
        let root = noise.clone().cholesky()?;
        let singular = (0..m).any(|c| root.l_dirty()[(c, c)].powi(2) < 1e-9 * noise[(c, c)]);
        if singular {
            return None;
        }
        // QHᵀVH and QHᵀVHQ.
        let weighted = &crossed * root.solve(&seen);
        let known = &crossed * root.solve(&crossed.transpose());
        let left = &transition * (DMatrix::identity(n, n) - weighted);
        Some(Self {
            states: n,
            information: by_rows(&halves(&(seen.transpose() * root.solve(&seen)))),
            driven: by_rows(&halves(&(&transition * (driven - known) * transition.transpose()))),
            transition: by_rows(&left),
        })
    }

    /// Twice as many steps.
    fn doubled(&self) -> Option<Self> {
        let n = self.states;
        let matrix = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
        let (a, g, q) = (matrix(&self.transition), matrix(&self.information), matrix(&self.driven));
        let unit = DMatrix::identity(n, n);
        // (1 + Q G)⁻¹, and with A, of which the transpose is Aᵀ (1 + G Q)⁻¹.
        let inverse = (unit + &q * &g).try_inverse()?;
        let through = &inverse * &a;
        let driven = &q + &a * (inverse * &q) * a.transpose();
        let information = &g + through.transpose() * &g * &a;
        Some(Self {
            states: n,
            transition: by_rows(&(&a * through)),
            information: by_rows(&halves(&information)),
            driven: by_rows(&halves(&driven)),
        })
    }

    /// M becomes what it is after the steps. `None` where something is singular.
    fn apply(&self, covariance: &mut [f64], work: &mut Work) -> Option<()> {
        let n = self.states;
        // (1 + M G) X = M.
        let Work { left, right } = work;
        product(covariance, &self.information, n, left);
        for i in 0..n {
            left[i * n + i] += 1.0;
        }
        eliminate(left, covariance, n)?;
        // A X Aᵀ + D.
        product(&self.transition, covariance, n, right);
        for i in 0..n {
            for j in 0..=i {
                let (row, other) = (&right[i * n..][..n], &self.transition[j * n..][..n]);
                let sum: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                covariance[i * n + j] = self.driven[i * n + j] + sum;
            }
        }
        for i in 0..n {
            for j in 0..i {
                covariance[j * n + i] = covariance[i * n + j];
            }
        }
        Some(())
    }
}

/// The symmetric part.
pub fn halves(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    0.5 * (matrix + matrix.transpose())
}

fn by_rows(matrix: &DMatrix<f64>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}

/// `out` = a b.
fn product(a: &[f64], b: &[f64], n: usize, out: &mut Vec<f64>) {
    out.clear();
    out.resize(n * n, 0.0);
    for (row, weights) in out.chunks_exact_mut(n).zip(a.chunks_exact(n)) {
        for (weight, values) in weights.iter().zip(b.chunks_exact(n)) {
            if *weight != 0.0 {
                row.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
        }
    }
}

/// Solves a x = b in place by Gauss's elimination with pivots from the column.
fn eliminate(a: &mut [f64], b: &mut [f64], n: usize) -> Option<()> {
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs()))?;
        if pivot != k {
            for j in 0..n {
                a.swap(k * n + j, pivot * n + j);
                b.swap(k * n + j, pivot * n + j);
            }
        }
        let own = a[k * n + k];
        if own == 0.0 || !own.is_finite() {
            return None;
        }
        let inverse = own.recip();
        for i in k + 1..n {
            let factor = a[i * n + k] * inverse;
            if factor != 0.0 {
                for j in k + 1..n {
                    a[i * n + j] -= factor * a[k * n + j];
                }
                for j in 0..n {
                    b[i * n + j] -= factor * b[k * n + j];
                }
            }
        }
    }
    for k in (0..n).rev() {
        let inverse = a[k * n + k].recip();
        for j in 0..n {
            let known: f64 = (k + 1..n).map(|i| a[k * n + i] * b[i * n + j]).sum();
            b[k * n + j] = (b[k * n + j] - known) * inverse;
        }
    }
    Some(())
}

#[cfg(test)]
pub mod tests {
    use crate::noise::{Flicker, Noise};
    use crate::whitening::filter::Filter;
    use schuler_recording::case::{ExponentialCosine, Markov};

    use super::*;

    pub fn space_of(noise: &Noise) -> Space {
        let groups = noise.states(1.0).groups;
        let n = groups.iter().map(|group| group.size).sum();
        let mut space = Space {
            states: n,
            channels: 1,
            transition: vec![0.0; n * n],
            driven: vec![0.0; n * n],
            start: vec![0.0; n * n],
            seen: vec![0.0; n],
            white: vec![noise.white_variance()],
            other_white: None,
        };
        let mut at = 0;
        for group in groups {
            for i in 0..group.size {
                for j in 0..group.size {
                    space.transition[(at + i) * n + at + j] = group.transition[i][j];
                }
                space.driven[(at + i) * n + at + i] = group.driven[i];
                space.start[(at + i) * n + at + i] = group.start[i];
                space.seen[at + i] = group.seen[i];
            }
            at += group.size;
        }
        space
    }

    /// Noises that settle at once, slowly and never, with an oscillation, in units far from 1.
    pub fn noises() -> [Noise; 12] {
        let markov = |sigma: f64, tau_s: f64| Markov { sigma, tau_s };
        let white = Noise { white: 1e-7, ..Noise::default() };
        [
            Noise { markov: vec![markov(3e-9, 2e4)], ..white.clone() },
            Noise { markov: vec![markov(2e-7, 30.0), markov(1e-8, 3e3)], ..white.clone() },
            Noise { random_walk: 1e-11, ..white.clone() },
            Noise { markov: vec![markov(3e-8, 900.0)], ..white.clone() },
            Noise { markov: vec![markov(2e-7, 30.0)], ..white.clone() },
            Noise { flicker: Flicker { sigma: 1e-8, tau_s: [2.0, 3e4] }, ..white.clone() },
            Noise { angle: 3e-7, ..white.clone() },
            Noise {
                exp_cos: vec![ExponentialCosine { sigma: 5e-8, alpha: 1e-4, beta: 0.02 }],
                markov: vec![markov(1e-8, 1e3)],
                ..white
            },
            // Without white noise.
            Noise { markov: vec![markov(2e-7, 30.0), markov(1e-8, 3e3)], ..Noise::default() },
            Noise { flicker: Flicker { sigma: 1e-8, tau_s: [2.0, 3e4] }, ..Noise::default() },
            Noise {
                exp_cos: vec![ExponentialCosine { sigma: 5e-8, alpha: 1e-4, beta: 0.02 }],
                ..Noise::default()
            },
            Noise {
                exp_cos: vec![
                    ExponentialCosine { sigma: 1.0, alpha: 2e-3, beta: 7e-3 },
                    ExponentialCosine { sigma: 0.3, alpha: 1e-5, beta: 3e-4 },
                ],
                markov: vec![markov(0.3, 111.0)],
                ..Noise::default()
            },
        ]
    }

    #[test]
    fn interpolated_gains_are_those_of_every_row() {
        let rows = 30_000;
        let column: Vec<f64> = (0..rows).map(|row| 1e-7 * (row as f64 * 0.37).sin() + 1e-8).collect();
        for noise in noises() {
            let space = space_of(&noise);
            let present = vec![true; rows];
            let fast = Filter::new(&space, &present).unwrap();
            let slow = Filter::of_every_row(&space, &present).unwrap();
            let allowed = 1e-5;
            assert!((fast.log_variances - slow.log_variances).abs() < allowed, "{noise:?}");
            let (a, b) = (fast.whiten(&[&column]), slow.whiten(&[&column]));
            let sum = |whitened: &[f64]| whitened.iter().map(|e| e * e).sum::<f64>();
            let (a, b) = (sum(&a[0]), sum(&b[0]));
            assert!((a - b).abs() < 1e-8 * b, "{noise:?}: {a} {b}");
        }
    }
}
