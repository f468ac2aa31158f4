//! What the isolation says each step.
use bitflags::bitflags;
use serde::{Deserialize, Serialize};

use super::parity::GYROS;

/// What to believe of the block in this sample. Gyros count from zero, as in the input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// Nothing speaks against any gyro.
    #[default]
    NoFault,
    /// One gyro or more has failed; which one cannot be said (yet).
    DetectedNotIsolated,
    /// This gyro has failed, or could not be read; the rate is that of the other four.
    Fault(u8),
    /// Two gyros or more have failed or could not be read: there is no rate.
    BlockUntrusted,
}

bitflags! {
    /// Why the verdict is what it is, and what happened in this step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct IsolationFlags: u16 {
        /// A reading could not be used: missing, saturated, beyond the range or not a number.
        const READING_UNUSABLE = 1;
        /// This sample is beyond the single-sample threshold.
        const OUTLIER = 1 << 1;
        /// This step raised an alarm.
        const ALARM_RAISED = 1 << 2;
        /// This step found the gyro that has failed.
        const ISOLATED = 1 << 3;
        /// Isolation was given up; the alarm stands.
        const GIVEN_UP = 1 << 4;
        /// The remaining four gyros disagree.
        const SECOND_FAULT = 1 << 5;
        /// A gyro is stuck.
        const STUCK = 1 << 6;
        /// A gyro has been silent for too long.
        const LOST = 1 << 7;
        /// Most gyros repeat their reading: a block at rest within its quantisation, or frozen data.
        const FROZEN = 1 << 8;
        /// The rate is above the limit, or the block is frozen: nothing adds up this sample but outliers.
        const SUMS_SUSPENDED = 1 << 9;
        /// The constant parity is being measured.
        const CALIBRATING = 1 << 10;
        /// The constant parity that was measured is too large to be one and was not taken.
        const OFFSET_REJECTED = 1 << 11;
        /// This step took gyros back into the block.
        const READMITTED = 1 << 12;
        /// The ground named a gyro that does not exist.
        const COMMAND_REJECTED = 1 << 13;
        /// This step withdrew the alarm: the samples since speak against the fault that raised it.
        const ALARM_WITHDRAWN = 1 << 14;
    }
}

/// What the isolation says each step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IsolationOutput {
    /// What to believe.
    pub verdict: Verdict,
    /// Why, and what happened.
    pub flags: IsolationFlags,
    /// Gyros that the rate comes from, one bit a gyro; zero: there is no rate.
    pub gyros_used: u8,
    /// Gyros declared faulty, one bit a gyro: they stay out until they are taken back.
    pub excluded: u8,
    /// Body rate from the gyros in use, rad/s; zero when there is none.
    pub rate: [f64; 3],
    /// 1-σ of the rate from the noise of the gyros in use, rad/s; zero when there is none.
    pub rate_sigma: [f64; 3],
    /// Parity vector z of the five gyros in standard deviations; zero unless all five could be read.
    pub parity: [f64; 2],
    /// Normalised determinants: the parity of the block without gyro j, in standard deviations; zero when
    /// another gyro could not be read.
    pub determinants: [f64; GYROS],
    /// The detection statistic nearest to its threshold, over the threshold; an alarm is raised beyond one.
    pub alarm_level: f64,
    /// Lead of the likeliest gyro over the next in the evidence of the alarm; zero without an alarm.
    pub margin: f64,
    /// Size of the fault of the excluded gyro, rad/s: mean since the alarm, over no more than the last thousand
    /// samples; zero while no single gyro is excluded.
    pub fault_size: f64,
    /// 1-σ of the fault size, rad/s; zero when there is no size.
    pub fault_sigma: f64,
}
