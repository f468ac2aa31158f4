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

/// Number of one-sided sums along a line.
const KINDS: usize = 4;

/// One of the four one-sided sums along a line: fast up, fast down, slow up, slow down.
#[derive(Clone, Copy, Debug)]
pub(super) struct SumKind<T> {
    sign: T,
    reference: T,
    pub(super) inverse_threshold: T,
}

impl<T: RealField + Copy> SumKind<T> {
    pub(super) fn all(thresholds: &Thresholds<T>) -> [Self; KINDS] {
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

/// A quantity for each kind of sum along each line.
type PerSum<T> = [[T; KINDS]; GYROS];

/// All one-sided sums, with the evidence gathered since each last stood at zero. Numbers of one kind stand side by side, and each
/// kind is worked on by itself: so a host works on several sums at once, and the target on one after another.
#[derive(Clone, Copy, Debug)]
struct OneSidedSums<T> {
    level: PerSum<T>,
    samples: PerSum<u32>,
    x: PerSum<T>,
    y: PerSum<T>,
    /// All of it counts as zero: so a restart takes no work of its own.
    forgotten: bool,
}

impl<T: RealField + Copy> OneSidedSums<T> {
    fn zero() -> Self {
        let zero = [[T::zero(); KINDS]; GYROS];
        Self { level: zero, samples: [[0; KINDS]; GYROS], x: zero, y: zero, forgotten: false }
    }

    /// Takes a sample where it is to be `added`. `along`: its part along each line.
    fn add_if(&mut self, added: bool, kinds: &[SumKind<T>; KINDS], along: &[T; GYROS], parity: &Vector2<T>) {
        let (zero, kept) = (T::zero(), !self.forgotten);
        self.forgotten = false;
        let mut grows = [[false; KINDS]; GYROS];
        for ((levels, grows), along) in self.level.iter_mut().zip(&mut grows).zip(along) {
            for ((level, grows), kind) in levels.iter_mut().zip(grows).zip(kinds) {
                let before = select(kept, *level, zero);
                let grown = before + kind.increment(*along);
                *grows = grown > zero;
                *level = select(added, select(*grows, grown, zero), before);
            }
        }
        let grows = grows.as_flattened();
        for (sums, term) in [(&mut self.x, parity.x), (&mut self.y, parity.y)] {
            for (sum, grows) in sums.as_flattened_mut().iter_mut().zip(grows) {
                let before = select(kept, *sum, zero);
                *sum = select(added, select(*grows, before + term, zero), before);
            }
        }
        for (samples, grows) in self.samples.as_flattened_mut().iter_mut().zip(grows) {
            let before = select(kept, *samples, 0);
            *samples = select(added, select(*grows, before.saturating_add(1), 0), before);
        }
    }

    /// The highest level in relation to its threshold, and what it is made of.
    fn highest(&self, kinds: &[SumKind<T>; KINDS]) -> (T, Evidence<T>) {
        let (mut highest, mut of) = (T::zero(), 0);
        for (line, levels) in self.level.iter().enumerate() {
            for (kind, level) in levels.iter().enumerate() {
                let ratio = *level * kinds[kind].inverse_threshold;
                of = select(ratio > highest, line * KINDS + kind, of);
                highest = select(ratio > highest, ratio, highest);
            }
        }
        let [x, y] =
            [&self.x, &self.y].map(|sums| sums.as_flattened().get(of).copied().unwrap_or_else(T::zero));
        let samples = self.samples.as_flattened().get(of).copied().unwrap_or_default();
        (highest, Evidence { samples, sum: Vector2::new(x, y) })
    }
}

/// All detectors of the five-gyro parity: one sample, and four sums along each of five lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch<T> {
    kinds: [SumKind<T>; KINDS],
    gate: Gate<T>,
    sums: OneSidedSums<T>,
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
            sums: OneSidedSums::zero(),
            run: Evidence::none(),
        }
    }

    pub(super) fn reset(&mut self) {
        self.sums.forgotten = true;
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

        let along = space.directions().map(|direction| direction.dot(&limited));
        self.sums.add_if(usable & add_up, &self.kinds, &along, &limited);
        let (highest, evidence) = self.sums.highest(&self.kinds);

        let level = if usable { ratio } else { T::zero() };
        let level = select(highest > level, highest, level);
        let single = if outlier && self.gate.persisted(self.run.samples) { ratio } else { T::zero() };
        let leads = highest > single;
        let largest = (select(leads, highest, single), Evidence::select(leads, &evidence, &self.run));
        let alarm = (usable && largest.0 > T::one()).then_some(largest.1);
        Sighting { outlier, limited, level, alarm }
    }
}

saved!([T: Blank] Evidence<T> { samples, sum });
saved!([T: Blank] SumKind<T> { sign, reference, inverse_threshold });
saved!([T: Blank] OneSidedSums<T> { level, samples, x, y, forgotten });
saved!([T: Blank] Gate<T> { threshold, inverse_threshold, persistence });
saved!([T: Blank] Watch<T> { sums, run, kinds, gate });
