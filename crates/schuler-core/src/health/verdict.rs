//! From probabilities to alarms, and from alarms to a verdict and a suspect [HLT-5], [HLT-6].
//!
//! One difference of two sensors cannot say everything about both. What it can and cannot tell apart:
//!
//! | truth | verdict | why |
//! | --- | --- | --- |
//! | radio jump | shifted mean, radio | |
//! | step of the inertial sensor | shifted mean, radio | the same residual; the model gives steps to the radio |
//! | … that never ends | shifted mean, either | the radio's jumps end; persistence is evidence against it |
//! | radio noise grown | grown noise, radio | |
//! | inertial noise grown to the radio's size | grown noise, radio | the same residual |
//! | inertial drift beyond its specification | inertial divergence, inertial | only the inertial error is slow in the model |
//! | radio error slower than about 0.01 m/s² | inertial divergence or nothing | absorbed by ξ |
//! | constant offset present from the start | nothing below the prior's width | jump and ξ(0) are the same residual |
//! | either far out of its range | out of model, either | no mode of either explains it |
use bitflags::bitflags;
use nalgebra::RealField;
use serde::{Deserialize, Serialize};

use super::config::AlarmThresholds;
use crate::saved::saved_flags;

bitflags! {
    /// Alarms that are on. Each is set and cleared with hysteresis.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct HealthAlarms: u8 {
        /// The mean of the radio's error has shifted.
        const JUMP = 1;
        /// The radio's noise has grown to a degraded level.
        const NOISE = 1 << 1;
        /// Any of jump, noise and memory, even where it is open which.
        const FAULT = 1 << 2;
        /// The inertial error is beyond its specified bound.
        const INERTIAL = 1 << 3;
        /// The radio holds its last value.
        const MEMORY = 1 << 4;
    }
}

impl HealthAlarms {
    /// Turns `alarm` on if `set`, off if `clear`, leaves it otherwise.
    pub(super) fn switch(&mut self, alarm: Self, set: bool, clear: bool) {
        self.set(alarm, set || (self.contains(alarm) && !clear));
    }

    /// The same by a probability's thresholds.
    pub(super) fn follow<T: RealField + Copy>(&mut self, alarm: Self, p: T, thresholds: &AlarmThresholds<T>) {
        self.switch(alarm, p > thresholds.set, p < thresholds.clear);
    }
}

/// State of the two sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// No residual yet, or none for longer than can be bridged.
    #[default]
    Unobserved,
    /// Nothing found.
    Nominal,
    /// The mean of the radio's error has shifted.
    ShiftedMean,
    /// The radio's noise has grown.
    GrownNoise,
    /// Both.
    ShiftedMeanAndGrownNoise,
    /// One of them, still open which.
    UndecidedFault,
    /// The slow part of the difference is beyond what the inertial sensor is specified for.
    InertialDivergence,
    /// Several residuals in a row that no mode explains.
    OutOfModel,
    /// The radio holds its last value.
    HeldReading,
}

/// Whom the model blames. See the table of the module for what it cannot tell apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Suspect {
    /// Nobody.
    #[default]
    Neither,
    /// The radio sensor.
    Radio,
    /// The inertial sensor.
    Inertial,
    /// One of them, and these data cannot tell which.
    Either,
}

/// What the verdict is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Findings {
    pub(super) alarms: HealthAlarms,
    pub(super) observed: bool,
    pub(super) out_of_model: bool,
    /// A jump has lasted longer than the radio's jumps do.
    pub(super) persistent_jump: bool,
}

impl Findings {
    pub(super) fn verdict(self) -> (Verdict, Suspect) {
        let on = |alarm| self.alarms.contains(alarm);
        let radio = match (on(HealthAlarms::JUMP), on(HealthAlarms::NOISE), on(HealthAlarms::FAULT)) {
            (true, true, _) => Some(Verdict::ShiftedMeanAndGrownNoise),
            (true, false, _) => Some(Verdict::ShiftedMean),
            (false, true, _) => Some(Verdict::GrownNoise),
            (false, false, true) => Some(Verdict::UndecidedFault),
            (false, false, false) => None,
        };
        let inertial = on(HealthAlarms::INERTIAL);
        match (self.out_of_model, self.observed, radio) {
            _ if on(HealthAlarms::MEMORY) => (Verdict::HeldReading, Suspect::Radio),
            (true, _, _) => (Verdict::OutOfModel, Suspect::Either),
            (false, false, _) => (Verdict::Unobserved, Suspect::Neither),
            (false, true, Some(verdict)) if inertial || self.persistent_jump => (verdict, Suspect::Either),
            (false, true, Some(verdict)) => (verdict, Suspect::Radio),
            (false, true, None) if inertial => (Verdict::InertialDivergence, Suspect::Inertial),
            (false, true, None) => (Verdict::Nominal, Suspect::Neither),
        }
    }
}

saved_flags!(HealthAlarms);
