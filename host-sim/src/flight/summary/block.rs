//! The block of five gyros: verdicts and the fault that is excluded.
use schuler_core::isolation::{IsolationFlags, Verdict};
use schuler_core::module::{GYROS, StepOutput};
use serde::Serialize;

use super::MOST_EVENTS;

/// The gyros.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockSummary {
    /// Their ids.
    pub gyros: [String; GYROS],
    /// Changes of the verdict.
    pub verdicts: Vec<VerdictChange>,
    /// Alarms raised.
    pub alarms: usize,
    /// Share of the steps with a rate from all five.
    pub complete_share: f64,
    /// Gyro that is out at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub excluded: Option<String>,
    /// Size of its fault, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault_size: Option<f64>,
    /// Standard deviation of that, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault_sigma: Option<f64>,
}

/// A change of the verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerdictChange {
    /// When, s.
    pub time_s: f64,
    /// `no_fault`, `detected`, `fault` or `untrusted`.
    pub verdict: &'static str,
    /// The gyro.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro: Option<String>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct BlockSums {
    before: Verdict,
    verdicts: Vec<VerdictChange>,
    alarms: usize,
    complete: usize,
}

impl BlockSums {
    pub(super) fn add(&mut self, time_s: f64, output: &StepOutput, ids: &[String; GYROS]) {
        let isolation = &output.isolation;
        if isolation.verdict != self.before && self.verdicts.len() < MOST_EVENTS {
            let (verdict, gyro) = match isolation.verdict {
                Verdict::NoFault => ("no_fault", None),
                Verdict::DetectedNotIsolated => ("detected", None),
                Verdict::Fault(gyro) => ("fault", ids.get(usize::from(gyro)).cloned()),
                Verdict::BlockUntrusted => ("untrusted", None),
            };
            self.verdicts.push(VerdictChange { time_s, verdict, gyro });
        }
        self.before = isolation.verdict;
        self.alarms += usize::from(isolation.flags.contains(IsolationFlags::ALARM_RAISED));
        self.complete += usize::from(isolation.gyros_used.count_ones() == 5);
    }

    pub(super) fn finish(self, ids: &[String; GYROS], last: &StepOutput, steps: usize) -> BlockSummary {
        let last = &last.isolation;
        let excluded = match last.verdict {
            Verdict::Fault(gyro) => ids.get(usize::from(gyro)).cloned(),
            _ => None,
        };
        let sized = excluded.is_some() && last.fault_sigma > 0.0;
        BlockSummary {
            gyros: ids.clone(),
            verdicts: self.verdicts,
            alarms: self.alarms,
            complete_share: self.complete as f64 / steps.max(1) as f64,
            excluded,
            fault_size: sized.then_some(last.fault_size),
            fault_sigma: sized.then_some(last.fault_sigma),
        }
    }
}
