//! Isolation by the sequential least-squares (Kalman) filter with cyclic permutation of the gyros.
//!
//! Source: Larin (2015), §3, equations (3.4)–(3.6). Equation ids FDI-3.3, FDI-3.4.
//!
//! Each gyro in turn is processed last. Its normalised innovation squared against the sum of those before it says
//! how much better the block agrees without it. With the gain of the Kalman filter the decision is that of the
//! determinants and of the likelihood test; the paper's own table comes from a recursion that updates the
//! covariance before it forms the gain, which is kept to reproduce it and depends on the order of the gyros.
//!
//! In: measurements divided by their σ. Out: dimensionless ratios; the largest names the gyro.
use nalgebra::{Matrix3, RealField, SVector, Vector3};

use super::geometry::{BlockGeometry, constant};
use super::orthogonal::columns;

/// Largest ratio that is given; the block then agrees without the gyro as well as numbers can tell.
const MAX_RATIO: f64 = 1e12;
/// Least volume of the three axes that start the filter.
const MIN_START_VOLUME: f64 = 0.1;

/// How the filter forms its gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recursion {
    /// Kalman filter: gain from the covariance before the measurement. `[FDI-3.3]`
    Kalman,
    /// As in the published example: gain and innovation variance from the covariance after it. `[FDI-3.4]`
    CovarianceFirst,
}

/// Normalised innovations squared of one order of processing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InnovationStatistics<T> {
    /// Of the gyro that came last: q with the Kalman recursion.
    pub last: T,
    /// Of the one before.
    pub previous: T,
    /// Of all after the three that start the filter: T with the Kalman recursion.
    pub total: T,
}

impl<T: RealField + Copy> InnovationStatistics<T> {
    /// F = q/(T − q), without a division by nothing. For five gyros it is the ratio of the last two.
    pub fn ratio(&self) -> T {
        bounded_ratio(self.last, self.total - self.last)
    }

    /// The ratio of the last two, as published.
    pub fn last_ratio(&self) -> T {
        bounded_ratio(self.last, self.previous)
    }
}

/// The filter for a block of n gyros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequentialFilter<T, const N: usize> {
    /// Whitened axes.
    axes: [Vector3<T>; N],
    recursion: Recursion,
    /// For each candidate: by how many places the cyclic order of the others is turned, so that the first three
    /// span space.
    turns: [usize; N],
}

impl<T: RealField + Copy, const N: usize> SequentialFilter<T, N> {
    /// A filter over the whitened axes. The published recursion depends on the order and keeps the cyclic one; the
    /// other does not, and starts with three axes that are far from one plane.
    pub fn new(geometry: &BlockGeometry<T, N>, recursion: Recursion) -> Self {
        let mut filter = Self { axes: *geometry.axes(), recursion, turns: [0; N] };
        let mut turns = [0; N];
        for (candidate, turn) in turns.iter_mut().enumerate() {
            *turn = match recursion {
                Recursion::Kalman => filter.regular_start(candidate),
                Recursion::CovarianceFirst => 0,
            };
        }
        filter.turns = turns;
        filter
    }

    /// Ratios F of all gyros. The largest names the gyro. `[FDI-3.3]`
    pub fn ratios(&self, whitened: &SVector<T, N>) -> SVector<T, N> {
        SVector::from_fn(|candidate, _| self.statistics(candidate, whitened).ratio())
    }

    /// Processes all gyros with `candidate` last. `[FDI-3.3]` `[FDI-3.4]`
    pub fn statistics(&self, candidate: usize, whitened: &SVector<T, N>) -> InnovationStatistics<T> {
        let turn = self.turns.get(candidate).copied().unwrap_or(0);
        let mut rows = order::<N>(candidate, turn).map(|gyro| (self.axis(gyro), element(whitened, gyro)));
        let mut next = || rows.next().unwrap_or_else(|| (Vector3::zeros(), T::zero()));
        let start = [next(), next(), next()];
        let axes: Matrix3<T> = columns(start.map(|(axis, _)| axis)).transpose();
        let inverse = axes.try_inverse().unwrap_or_else(Matrix3::zeros);
        let mut estimate = inverse * Vector3::from(start.map(|(_, measured)| measured));
        let mut covariance = inverse * inverse.transpose();

        let mut statistics = InnovationStatistics { last: T::zero(), previous: T::zero(), total: T::zero() };
        for (axis, measured) in rows {
            let innovation = measured - axis.dot(&estimate);
            let projected = covariance * axis;
            let variance = T::one() + axis.dot(&projected);
            let updated = covariance - projected * projected.transpose() / variance;
            let (gain, variance) = match self.recursion {
                Recursion::Kalman => (projected / variance, variance),
                Recursion::CovarianceFirst => {
                    let projected = updated * axis;
                    let variance = T::one() + axis.dot(&projected);
                    (projected / variance, variance)
                }
            };
            estimate += gain * innovation;
            covariance = updated;
            statistics.previous = statistics.last;
            statistics.last = innovation * innovation / variance;
            statistics.total += statistics.last;
        }
        statistics
    }

    /// The first turn whose three leading axes are not near one plane, else the best of all.
    fn regular_start(&self, candidate: usize) -> usize {
        let mut best = (0, T::zero());
        for turn in 0..N.saturating_sub(1) {
            let mut axes = order::<N>(candidate, turn).map(|gyro| {
                let axis = self.axis(gyro);
                axis / axis.norm()
            });
            let mut next = || axes.next().unwrap_or_else(Vector3::zeros);
            let (a, b, c) = (next(), next(), next());
            let volume = a.dot(&b.cross(&c)).abs().min(constant(MIN_START_VOLUME));
            best = if volume > best.1 { (turn, volume) } else { best };
        }
        best.0
    }

    fn axis(&self, gyro: usize) -> Vector3<T> {
        self.axes.get(gyro).copied().unwrap_or_else(Vector3::zeros)
    }
}

/// The other gyros from the one after the candidate onwards, turned by some places; the candidate last.
fn order<const N: usize>(candidate: usize, turn: usize) -> impl Iterator<Item = usize> {
    let others = N.saturating_sub(1);
    let step = move |place: usize| (candidate + 1 + place) % N;
    (0..others).cycle().skip(turn).take(others).map(step).chain([candidate])
}

fn element<T: RealField + Copy, const N: usize>(vector: &SVector<T, N>, index: usize) -> T {
    vector.get(index).copied().unwrap_or_else(T::zero)
}

fn bounded_ratio<T: RealField + Copy>(above: T, below: T) -> T {
    let limit = constant::<T>(MAX_RATIO);
    let least = above / limit;
    if below > least {
        above / below
    } else if above > T::zero() {
        limit
    } else {
        T::zero()
    }
}
