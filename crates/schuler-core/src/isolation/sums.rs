//! What raises an alarm: the single-sample test and the one-sided cumulative sums. Equation id FDI-6.
use nalgebra::{RealField, Vector2};

use super::geometry::constant;
use super::parity::{GYROS, ParitySpace};
use super::thresholds::{FAST_REFERENCE, SLOW_REFERENCE, Thresholds};
use crate::number::select;
use crate::saved::{Blank, saved};

/// Parity vectors added up, and how many.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence<T> {
    pub(super) samples: u32,
    pub(super) sum: Vector2<T>,
}

impl<T: RealField + Copy> Evidence<T> {
    pub(super) fn none() -> Self {
        Self { samples: 0, sum: Vector2::zeros() }
    }

    pub(super) fn with(&self, parity: &Vector2<T>) -> Self {
        Self { samples: self.samples.saturating_add(1), sum: self.sum + parity }
    }

    /// One or the other, number by number: with the same work.
    pub(super) fn select(condition: bool, one: &Self, other: &Self) -> Self {
        let ([x, y], [other_x, other_y]) = ([one.sum.x, one.sum.y], [other.sum.x, other.sum.y]);
        Self {
            samples: select(condition, one.samples, other.samples),
            sum: Vector2::new(select(condition, x, other_x), select(condition, y, other_y)),
        }
    }

    /// Number of samples, at least one.
    pub(super) fn count(&self) -> T {
        constant(f64::from(self.samples.max(1)))
    }
}

/// One of the four one-sided sums along a line: fast up, fast down, slow up, slow down.
#[derive(Clone, Copy, Debug)]
pub(super) struct SumKind<T> {
    sign: T,
    reference: T,
    pub(super) inverse_threshold: T,
}

impl<T: RealField + Copy> SumKind<T> {
    pub(super) fn all(thresholds: &Thresholds<T>) -> [Self; 4] {
        let (up, down) = (T::one(), -T::one());
        let (fast, slow) = (constant(FAST_REFERENCE), constant(SLOW_REFERENCE));
        let (inverse_fast, inverse_slow) = (up / thresholds.fast, up / thresholds.slow);
        [
            Self { sign: up, reference: fast, inverse_threshold: inverse_fast },
            Self { sign: down, reference: fast, inverse_threshold: inverse_fast },
            Self { sign: up, reference: slow, inverse_threshold: inverse_slow },
            Self { sign: down, reference: slow, inverse_threshold: inverse_slow },
        ]
    }

    /// One or the other, number by number.
    pub(super) fn select(condition: bool, one: &Self, other: &Self) -> Self {
        Self {
            sign: select(condition, one.sign, other.sign),
            reference: select(condition, one.reference, other.reference),
            inverse_threshold: select(condition, one.inverse_threshold, other.inverse_threshold),
        }
    }

    /// What a sample adds to the sum.
    pub(super) fn increment(&self, along: T) -> T {
        self.sign * along - self.reference
    }

    /// What a sample adds to the log-likelihood ratio of a shift by twice the reference, to which the sum is tuned,
    /// against none.
    pub(super) fn support(&self, along: T) -> T {
        (self.reference + self.reference) * self.increment(along)
    }
}

/// The single-sample test with its persistence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gate<T> {
    threshold: T,
    inverse_threshold: T,
    persistence: u32,
}

impl<T: RealField + Copy> Gate<T> {
    pub(super) fn new(threshold: T, persistence: u32) -> Self {
        Self { threshold, inverse_threshold: T::one() / threshold, persistence }
    }

    /// Whether a squared norm is beyond the threshold, and its ratio to the threshold.
    pub(super) fn judge(&self, statistic: T) -> (bool, T) {
        (statistic > self.threshold, statistic * self.inverse_threshold)
    }

    /// Factor by which a sample enters what adds up samples: an outlier counts no more than the threshold when it
    /// takes several to make an alarm.
    pub(super) fn limit(&self, statistic: T) -> T {
        let large = select(statistic > self.threshold, statistic, self.threshold);
        let scale = (self.threshold / large).sqrt();
        if self.persistence > 1 { scale } else { T::one() }
    }

    /// Whether so many outliers in a row make an alarm.
    pub(super) fn persisted(&self, run: u32) -> bool {
        run >= self.persistence
    }
}

/// A one-sided sum with the evidence gathered since it last stood at zero.
#[derive(Clone, Copy, Debug)]
struct OneSidedSum<T> {
    level: T,
    evidence: Evidence<T>,
}

impl<T: RealField + Copy> OneSidedSum<T> {
    fn zero() -> Self {
        Self { level: T::zero(), evidence: Evidence::none() }
    }

    fn select(condition: bool, one: &Self, other: &Self) -> Self {
        Self {
            level: select(condition, one.level, other.level),
            evidence: Evidence::select(condition, &one.evidence, &other.evidence),
        }
    }
}

/// All detectors of the five-gyro parity: one sample, and four sums along each of five lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch<T> {
    kinds: [SumKind<T>; 4],
    gate: Gate<T>,
    sums: [[OneSidedSum<T>; 4]; GYROS],
    /// Samples in a row beyond the single-sample threshold.
    run: Evidence<T>,
}

/// What the detectors say of one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting<T> {
    /// This sample is beyond the single-sample threshold.
    pub(super) outlier: bool,
    /// The parity as it enters sums.
    pub(super) limited: Vector2<T>,
    /// The largest statistic over its threshold.
    pub(super) level: T,
    /// Evidence of the statistic that is furthest beyond its threshold, if one is.
    pub(super) alarm: Option<Evidence<T>>,
}

impl<T: RealField + Copy> Watch<T> {
    pub(super) fn new(thresholds: &Thresholds<T>, persistence: u32) -> Self {
        Self {
            kinds: SumKind::all(thresholds),
            gate: Gate::new(thresholds.single, persistence),
            sums: [[OneSidedSum::zero(); 4]; GYROS],
            run: Evidence::none(),
        }
    }

    pub(super) fn reset(&mut self) {
        self.sums = [[OneSidedSum::zero(); 4]; GYROS];
        self.run = Evidence::none();
    }

    /// One sample. `usable`: it counts at all; `add_up`: it enters the sums too. `[FDI-6]`
    pub(super) fn step(
        &mut self,
        space: &ParitySpace<T>,
        parity: &Vector2<T>,
        usable: bool,
        add_up: bool,
    ) -> Sighting<T> {
        let statistic = parity.norm_squared();
        let (beyond, ratio) = self.gate.judge(statistic);
        let outlier = beyond && usable;
        let limited = parity * self.gate.limit(statistic);
        let run = Evidence::select(outlier, &self.run.with(&limited), &Evidence::none());
        self.run = Evidence::select(usable, &run, &self.run);

        let mut level = if usable { ratio } else { T::zero() };
        let single = if outlier && self.gate.persisted(self.run.samples) { ratio } else { T::zero() };
        let mut largest = (single, self.run);
        for (direction, sums) in space.directions().iter().zip(&mut self.sums) {
            let along = direction.dot(&limited);
            for (kind, sum) in self.kinds.iter().zip(sums) {
                let next = sum.level + kind.increment(along);
                let grown = OneSidedSum { level: next, evidence: sum.evidence.with(&limited) };
                let next = OneSidedSum::select(next > T::zero(), &grown, &OneSidedSum::zero());
                *sum = OneSidedSum::select(usable & add_up, &next, sum);
                let ratio = sum.level * kind.inverse_threshold;
                level = select(ratio > level, ratio, level);
                let leads = ratio > largest.0;
                let evidence = Evidence::select(leads, &sum.evidence, &largest.1);
                largest = (select(leads, ratio, largest.0), evidence);
            }
        }
        let alarm = (usable && largest.0 > T::one()).then_some(largest.1);
        Sighting { outlier, limited, level, alarm }
    }
}

saved!([T: Blank] Evidence<T> { samples, sum });
saved!([T: Blank] SumKind<T> { sign, reference, inverse_threshold });
saved!([T: Blank] OneSidedSum<T> { level, evidence });
saved!([T: Blank] Gate<T> { threshold, inverse_threshold, persistence });
saved!([T: Blank] Watch<T> { sums, run, kinds, gate });
