//! Detection of a second fault among the four gyros that are left. Equation id FDI-9.
//!
//! Four gyros have one parity: it tells of a fault, not whose it is.
//!
//! In: the normalised determinant without the excluded gyro, in standard deviations. Out: alarm.
use nalgebra::RealField;

use super::detector::{Alarm, DetectorConfig};
use super::geometry::constant;
use super::sums::{Gate, SumKind};
use super::thresholds::Thresholds;
use crate::number::select;
use crate::saved::{Blank, saved};

/// What one sample of the four gyros did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement<T> {
    /// This sample is beyond the single-sample threshold, whether or not it was usable.
    pub outlier: bool,
    /// This sample raised the alarm.
    pub raised: bool,
    /// Where the alarm stands: quiet, standing or withdrawn.
    pub alarm: Alarm,
    /// The largest statistic over its threshold.
    pub level: T,
}

/// Detector for the four gyros that are left.
#[derive(Clone, Copy, Debug)]
pub struct FourGyroDetector<T> {
    kinds: [SumKind<T>; 4],
    gate: Gate<T>,
    margin: T,
    sums: [T; 4],
    /// Samples in a row beyond the single-sample threshold.
    run: u32,
    alarm: Alarm,
    /// The kind of sum that raised the alarm.
    cause: SumKind<T>,
    /// Log-likelihood ratio of the shift to which that sum is tuned against none, over the samples since.
    support: T,
}

impl<T: RealField + Copy> FourGyroDetector<T> {
    /// A detector that has seen nothing.
    pub fn new(config: &DetectorConfig<T>) -> Self {
        let thresholds = Thresholds::four(config.false_alarm_interval, config.persistence);
        let kinds = SumKind::all(&thresholds);
        let [cause, ..] = kinds;
        Self {
            kinds,
            gate: Gate::new(thresholds.single, config.persistence),
            margin: config.margin,
            sums: [T::zero(); 4],
            run: 0,
            alarm: Alarm::Quiet,
            cause,
            support: T::zero(),
        }
    }

    /// Forgets all evidence.
    pub fn reset(&mut self) {
        self.sums = [T::zero(); 4];
        self.run = 0;
        self.alarm = Alarm::Quiet;
        self.support = T::zero();
    }

    /// Where the alarm stands.
    pub fn alarm(&self) -> Alarm {
        self.alarm
    }

    /// One sample. `usable`: it enters the state; `sums`: whatever adds up samples takes it. `[FDI-9]`
    pub fn step(&mut self, parity: T, usable: bool, sums: bool) -> Disagreement<T> {
        let statistic = parity * parity;
        let (outlier, ratio) = self.gate.judge(statistic);
        let parity = parity * self.gate.limit(statistic);
        let run = if outlier { self.run.saturating_add(1) } else { 0 };
        self.run = if usable { run } else { self.run };

        let mut level = ratio;
        let mut beyond = outlier && self.gate.persisted(self.run);
        // The sum nearest to its threshold is the cause; it has the sign of an outlier that is alone.
        let mut cause = (T::zero(), self.cause);
        for (kind, sum) in self.kinds.iter().zip(&mut self.sums) {
            let next = *sum + kind.increment(parity);
            let next = select(next > T::zero(), next, T::zero());
            *sum = select(usable & sums, next, *sum);
            let ratio = *sum * kind.inverse_threshold;
            beyond |= ratio > T::one();
            level = select(ratio > level, ratio, level);
            let leads = ratio > cause.0;
            cause = (select(leads, ratio, cause.0), SumKind::select(leads, kind, &cause.1));
        }

        let standing = self.alarm == Alarm::Standing;
        let raised = usable && beyond && !standing;
        let joins = usable && standing && (sums || outlier);
        self.support += select(joins, self.cause.support(parity), T::zero());
        let refuted = standing && self.support < -self.margin * constant::<T>(0.5);
        if raised {
            self.cause = cause.1;
            self.support = T::zero();
        }
        self.alarm = match (raised, refuted) {
            (true, _) => Alarm::Standing,
            (false, true) => Alarm::Withdrawn,
            (false, false) if standing => Alarm::Standing,
            (false, false) => Alarm::Quiet,
        };
        if self.alarm == Alarm::Withdrawn {
            self.sums = [T::zero(); 4];
            self.run = 0;
        }
        Disagreement { outlier, raised, alarm: self.alarm, level }
    }
}

saved!([T: Blank] FourGyroDetector<T> {
    sums,
    run,
    alarm,
    cause,
    support,
    kinds,
    gate,
    margin,
});
