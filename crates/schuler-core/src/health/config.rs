//! What the monitor is told about the two sensors before the flight, and the check of it.
use nalgebra::{RealField, convert, try_convert};
use serde::{Deserialize, Serialize};

use super::span::MAX_SPAN_STEPS;
use crate::config::{ConfigError, Problem};
use crate::saved::{Blank, saved};

/// Smallest transition probability other than zero. With the floor under the mode probabilities it keeps every
/// product of probabilities a normal number in single precision.
const MIN_TRANSITION: f64 = 1e-9;
/// Rows of probabilities may miss one by this much: what single precision loses in writing them down.
const ROW_SUM_TOLERANCE: f64 = 1e-5;
/// Standard deviations outside this range would leave the normal numbers of single precision when squared twice.
const SIGMA_RANGE: [f64; 2] = [1e-6, 1e6];
/// dt/τ outside this range makes the radio error either a constant or white: another model.
const STEP_TO_CORRELATION_TIME: [f64; 2] = [1e-6, 20.0];

/// Error of the radio sensor while it works: `ε(k) = f ε(k−1) + γ_j n`, a first-order Markov process whose
/// level of noise j moves as a Markov chain [HLT-3].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "T: Serialize, [T; LEVELS]: Serialize, [[T; LEVELS]; LEVELS]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; LEVELS]: Deserialize<'de>, [[T; LEVELS]; LEVELS]: Deserialize<'de>"
))]
pub struct RadioErrorModel<T, const LEVELS: usize> {
    /// Correlation time τ, s.
    pub tau_s: T,
    /// Standard deviation `σ_j` at each level, ascending, m/s.
    pub sigma: [T; LEVELS],
    /// The first K levels are normal, the others degraded; 1 ≤ K ≤ LEVELS.
    pub normal_levels: u8,
    /// `P_γ`: probability per step to go from level (row) to level (column).
    pub transition: [[T; LEVELS]; LEVELS],
    /// Probability of each level at the first residual.
    pub initial: [T; LEVELS],
}

/// Shift ("jump") of the radio error's mean, as rare as the chain of λ ∈ {absent, present} says [HLT-3].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JumpModel<T> {
    /// Standard deviation `γ_m` of a fresh jump's value, m/s.
    pub sigma: T,
    /// `P_λ`: probability per step to go from (row) to (column); index 0 absent, 1 present.
    pub transition: [[T; 2]; 2],
    /// Probability of absent and present at the first residual.
    pub initial: [T; 2],
    /// A shift that has lasted this long, s, is no longer put down to the radio alone: the radio's jumps end, so
    /// with every mean duration that one does not, a step of the inertial sensor grows e times likelier.
    pub attribution_limit_s: T,
}

/// Error of the inertial sensor: a random walk on a slow drift, `ξ(k) = ξ(k−1) + dt μ(k−1) + γ_ξ n` [HLT-3].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InertialErrorModel<T> {
    /// Random walk of ξ, (m/s)/√s; `γ_ξ` = this · √dt. From a fluctuation of standard deviation `σ_F` and
    /// bandwidth ΔF it is `σ_F √(2 ΔF)`.
    pub random_walk: T,
    /// Standard deviation of ξ at the first residual, m/s.
    pub initial_sigma: T,
    /// Standard deviation of the drift μ at the first residual, m/s².
    pub drift_sigma: T,
    /// Random walk of μ, (m/s²)/√s. Zero is the paper's constant drift. An inertial system whose error swings
    /// with the Schuler period needs more: held constant, μ is soon trusted too much to follow, and the lag
    /// looks like a jump.
    pub drift_random_walk: T,
    /// The sensor's specified bound on |ξ|, m/s. Beyond it the inertial sensor comes under suspicion.
    pub bound: T,
}

/// A radio that holds its last value: its readings repeat to the last digit, as those of one that works do by chance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MemoryModel<T> {
    /// Probability that a reading of a radio that works repeats the one before: about its resolution over 2.5 standard
    /// deviations of what changes from reading to reading. One that is at rest, or coarse, repeats more often: choose from the
    /// upper side.
    pub repeat: T,
    /// Probability per step to begin to hold.
    pub fail: T,
    /// Probability per step to move on.
    pub recover: T,
}

/// Probabilities at which an alarm is set and cleared.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmThresholds<T> {
    /// Set above this.
    pub set: T,
    /// Cleared below this; less than `set`.
    pub clear: T,
}

/// Everything the monitor is told before the flight. `LEVELS` levels of radio noise make 2·`LEVELS` modes.
///
/// Choose the radio's σ and 1/τ from the upper side of what is believed: a radio noisier or faster than assumed
/// raises false alarms, a quieter or slower one only delays true ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "T: Serialize, [T; LEVELS]: Serialize, [[T; LEVELS]; LEVELS]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; LEVELS]: Deserialize<'de>, [[T; LEVELS]; LEVELS]: Deserialize<'de>"
))]
pub struct HealthConfig<T, const LEVELS: usize> {
    /// Step dt, s.
    pub step_s: T,
    /// Radio error.
    pub radio: RadioErrorModel<T, LEVELS>,
    /// Shift of the radio error's mean.
    pub jump: JumpModel<T>,
    /// Inertial error.
    pub inertial: InertialErrorModel<T>,
    /// A radio that holds its last value; without, it is not looked for.
    pub memory: Option<MemoryModel<T>>,
    /// 1-σ white noise √`Rq` of the residual (quantisation, time skew), m/s. Not zero; a tenth of the radio's
    /// innovation `γ_1` is harmless, more delays the detection of grown noise.
    pub residual_sigma: T,
    /// Alarm thresholds, the same for jump, grown noise and any fault.
    pub alarm: AlarmThresholds<T>,
    /// A residual farther than this many standard deviations from the prediction of every mode is out of the
    /// model and not used. The first residual, which has the widest prediction, also moves ξ: with a gate of 10 and two levels a
    /// wild one is forgotten within two minutes, with 20 it may leave a false jump behind for more than ten. Three levels do that
    /// with every gate from 6 on, for a first residual beyond five σ of the worst level.
    pub out_of_model_sigma: T,
    /// Without a usable residual for longer than this, s, there is no verdict.
    pub unobserved_after_s: T,
    /// Without a usable residual for longer than this, s, the next one starts from the priors. At most
    /// [`MAX_SPAN_STEPS`] steps. Until then what is known of the inertial error is carried over the gap.
    pub restart_after_s: T,
    /// Readings older than this are not used, milliseconds.
    pub max_age_ms: u32,
}

impl<T: RealField + Copy> HealthConfig<T, 2> {
    /// Doppler ground speed against inertial velocity at 1 Hz, one normal and one degraded level [HLT-7], with
    /// a drift that may change.
    pub fn doppler_against_inertial() -> Self {
        let number = convert::<f64, T>;
        let chain = |fail: f64, recover: f64| {
            [[number(1.0 - fail), number(fail)], [number(recover), number(1.0 - recover)]]
        };
        let initial = [number(0.99), number(0.01)];
        Self {
            step_s: T::one(),
            radio: RadioErrorModel {
                tau_s: number(10.0),
                sigma: [number(0.3), number(0.9)],
                normal_levels: 1,
                transition: chain(1.0 / 1800.0, 1.0 / 120.0),
                initial,
            },
            jump: JumpModel {
                sigma: number(0.9),
                transition: chain(1.0 / 1800.0, 1.0 / 120.0),
                initial,
                attribution_limit_s: number(1200.0),
            },
            inertial: InertialErrorModel {
                random_walk: number(0.005),
                initial_sigma: number(0.5),
                drift_sigma: number(3e-4),
                drift_random_walk: number(1e-5),
                bound: number(2.0),
            },
            memory: None,
            residual_sigma: number(0.01),
            alarm: AlarmThresholds { set: number(0.9), clear: number(0.45) },
            out_of_model_sigma: number(10.0),
            unobserved_after_s: number(60.0),
            restart_after_s: number(600.0),
            max_age_ms: 1500,
        }
    }
}

impl<T: RealField + Copy> HealthConfig<T, 3> {
    /// The same with a third, worse level [HLT-7].
    pub fn doppler_against_inertial_three_levels() -> Self {
        let number = convert::<f64, T>;
        let base = HealthConfig::<T, 2>::doppler_against_inertial();
        let (fail, recover) = (1.0 / 1800.0, 1.0 / 120.0);
        Self {
            step_s: base.step_s,
            radio: RadioErrorModel {
                tau_s: base.radio.tau_s,
                sigma: [number(0.3), number(0.9), number(3.0)],
                normal_levels: 1,
                transition: [
                    [number(1.0 - fail), number(0.8 * fail), number(0.2 * fail)],
                    [number(0.8 * recover), number(1.0 - recover), number(0.2 * recover)],
                    [number(0.8 * recover), number(0.2 * recover), number(1.0 - recover)],
                ],
                initial: [number(0.98), number(0.01), number(0.01)],
            },
            jump: base.jump,
            inertial: base.inertial,
            memory: base.memory,
            residual_sigma: base.residual_sigma,
            alarm: base.alarm,
            out_of_model_sigma: base.out_of_model_sigma,
            unobserved_after_s: base.unobserved_after_s,
            restart_after_s: base.restart_after_s,
            max_age_ms: base.max_age_ms,
        }
    }
}

impl<T: RealField + Copy, const LEVELS: usize> HealthConfig<T, LEVELS> {
    /// A duration in whole steps.
    pub(super) fn steps(&self, seconds: T) -> u32 {
        let steps = seconds / self.step_s * convert(1.0 + 1e-6);
        try_convert::<T, f64>(steps).map_or(0, |steps| steps as u32)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("health.step_s", self.step_s)?;

        let radio = &self.radio;
        positive("health.radio.tau_s", radio.tau_s)?;
        within("health.radio.tau_s", self.step_s / radio.tau_s, STEP_TO_CORRELATION_TIME)?;
        for sigma in &radio.sigma {
            sigma_in_range("health.radio.sigma", *sigma)?;
        }
        let ascending = radio.sigma.iter().zip(radio.sigma.iter().skip(1)).all(|(low, high)| low < high);
        require("health.radio.sigma", ascending)?;
        let normal = usize::from(radio.normal_levels);
        require("health.radio.normal_levels", normal >= 1 && normal <= LEVELS)?;
        chain("health.radio.transition", &radio.transition)?;
        distribution("health.radio.initial", &radio.initial)?;

        let jump = &self.jump;
        sigma_in_range("health.jump.sigma", jump.sigma)?;
        chain("health.jump.transition", &jump.transition)?;
        distribution("health.jump.initial", &jump.initial)?;
        positive("health.jump.attribution_limit_s", jump.attribution_limit_s)?;

        let inertial = &self.inertial;
        not_negative("health.inertial.random_walk", inertial.random_walk)?;
        sigma_in_range("health.inertial.initial_sigma", inertial.initial_sigma)?;
        not_negative("health.inertial.drift_sigma", inertial.drift_sigma)?;
        not_negative("health.inertial.drift_random_walk", inertial.drift_random_walk)?;
        positive("health.inertial.bound", inertial.bound)?;

        if let Some(memory) = &self.memory {
            probability("health.memory.repeat", memory.repeat)?;
            probability("health.memory.fail", memory.fail)?;
            probability("health.memory.recover", memory.recover)?;
        }

        sigma_in_range("health.residual_sigma", self.residual_sigma)?;
        finite("health.alarm.set", self.alarm.set)?;
        require("health.alarm.set", self.alarm.set < T::one())?;
        positive("health.alarm.clear", self.alarm.clear)?;
        require("health.alarm.clear", self.alarm.clear < self.alarm.set)?;
        positive("health.out_of_model_sigma", self.out_of_model_sigma)?;
        within("health.out_of_model_sigma", self.out_of_model_sigma, [5.0, 1e6])?;
        positive("health.unobserved_after_s", self.unobserved_after_s)?;
        positive("health.restart_after_s", self.restart_after_s)?;
        let steps = self.restart_after_s / self.step_s;
        within("health.restart_after_s", steps, [1.0, f64::from(MAX_SPAN_STEPS) * (1.0 + 1e-6)])
    }
}

fn require(field: &'static str, holds: bool) -> Result<(), ConfigError> {
    if holds { Ok(()) } else { Err(ConfigError::new(field, Problem::OutOfRange)) }
}

/// Neither impossible nor certain.
fn probability<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    within(field, value, [MIN_TRANSITION, 1.0 - 1e-6])
}

fn finite<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    if value.is_finite() { Ok(()) } else { Err(ConfigError::new(field, Problem::NotFinite)) }
}

fn positive<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    finite(field, value)?;
    if value > T::zero() { Ok(()) } else { Err(ConfigError::new(field, Problem::NotPositive)) }
}

/// Zero, or a magnitude whose square is a normal number.
fn not_negative<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    finite(field, value)?;
    require(field, value == T::zero() || (value >= convert(1e-12) && value <= convert(SIGMA_RANGE[1])))
}

fn within<T: RealField + Copy>(field: &'static str, value: T, range: [f64; 2]) -> Result<(), ConfigError> {
    finite(field, value)?;
    require(field, value >= convert(range[0]) && value <= convert(range[1]))
}

fn sigma_in_range<T: RealField + Copy>(field: &'static str, value: T) -> Result<(), ConfigError> {
    positive(field, value)?;
    within(field, value, SIGMA_RANGE)
}

fn distribution<T: RealField + Copy>(field: &'static str, row: &[T]) -> Result<(), ConfigError> {
    let mut sum = T::zero();
    for &probability in row {
        finite(field, probability)?;
        require(field, probability == T::zero() || probability >= convert(MIN_TRANSITION))?;
        sum += probability;
    }
    require(field, (sum - T::one()).abs() <= convert(ROW_SUM_TOLERANCE))
}

/// A transition matrix in which every state can stay, so that every mode always has a path that leads to it.
fn chain<T: RealField + Copy, const SIZE: usize>(
    field: &'static str,
    transition: &[[T; SIZE]; SIZE],
) -> Result<(), ConfigError> {
    for (state, row) in transition.iter().enumerate() {
        distribution(field, row)?;
        require(field, row.get(state).is_some_and(|stay| *stay > T::zero()))?;
    }
    Ok(())
}

saved!([T: Blank, const LEVELS: usize] RadioErrorModel<T, LEVELS> { tau_s, sigma, normal_levels, transition, initial });
saved!([T: Blank] JumpModel<T> { sigma, transition, initial, attribution_limit_s });
saved!([T: Blank] InertialErrorModel<T> { random_walk, initial_sigma, drift_sigma, drift_random_walk, bound });
saved!([T: Blank] MemoryModel<T> { repeat, fail, recover });
saved!([T: Blank] AlarmThresholds<T> { set, clear });
saved!([T: Blank, const LEVELS: usize] HealthConfig<T, LEVELS> {
    step_s,
    radio,
    jump,
    inertial,
    memory,
    residual_sigma,
    alarm,
    out_of_model_sigma,
    unobserved_after_s,
    restart_after_s,
    max_age_ms,
});
