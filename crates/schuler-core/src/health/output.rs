//! What the monitor says each step.
use bitflags::bitflags;
use nalgebra::RealField;
use serde::{Deserialize, Serialize};

use super::verdict::{HealthAlarms, Suspect, Verdict};

bitflags! {
    /// What was out of the ordinary in a step.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct HealthStatus: u8 {
        /// No usable radio reading: missing, saturated, too old or not a number.
        const RADIO_UNUSABLE = 1;
        /// No usable inertial reading.
        const INERTIAL_UNUSABLE = 1 << 1;
        /// The residual was beyond the gate of every mode and was not used.
        const OUT_OF_MODEL = 1 << 2;
        /// More than one step since the last call; the model was moved over the gap.
        const GAP = 1 << 3;
        /// No step since the last call; the readings were not used again.
        const REPEATED = 1 << 4;
        /// No usable residual for too long: started again from the priors.
        const RESTARTED = 1 << 5;
        /// The numbers were no longer sound: started again from the priors.
        const NUMERICAL_RESET = 1 << 6;
    }
}

/// A value and its 1-σ uncertainty, in the value's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate<T> {
    /// The value.
    pub value: T,
    /// Its standard deviation.
    pub sigma: T,
}

/// What the monitor says each step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "T: Serialize, [T; LEVELS]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; LEVELS]: Deserialize<'de>"
))]
pub struct HealthOutput<T, const LEVELS: usize> {
    /// What the sensors are thought to be in.
    pub verdict: Verdict,
    /// Whom the model blames for it.
    pub suspect: Suspect,
    /// Alarms that are on.
    pub alarms: HealthAlarms,
    /// What was out of the ordinary in this step.
    pub status: HealthStatus,
    /// w, posterior probability of each mode: first index jump absent, present; second index level of noise.
    pub mode_probability: [[T; LEVELS]; 2],
    /// Probability that the radio's mean is shifted.
    pub p_jump: T,
    /// Probability that the radio's noise is at a degraded level.
    pub p_noise: T,
    /// Probability that the radio holds its last value; zero where that is not looked for.
    pub p_memory: T,
    /// Probability of any of them.
    pub p_fault: T,
    /// Radio error ε + λm. With a residual it is d + ξ̂, else the prediction, m/s.
    pub radio_error: Estimate<T>,
    /// Inertial error ξ, m/s.
    pub inertial_error: Estimate<T>,
    /// Value m of the jump, weighted with its probability, m/s.
    pub jump: Estimate<T>,
    /// Inertial drift μ, m/s².
    pub inertial_drift: Estimate<T>,
    /// Correlated part ε of the radio error, m/s.
    pub correlated_error: Estimate<T>,
    /// The measured quantity: the radio reading less its error, which with a residual is the inertial reading
    /// less its own. `None` without any usable reading, m/s.
    pub corrected: Option<Estimate<T>>,
    /// Residual d = radio − inertial, m/s; zero if there was none.
    pub residual: T,
    /// d less its prediction over all modes, m/s; zero if there was no residual.
    pub innovation: T,
    /// Variance of that prediction, (m/s)².
    pub innovation_variance: T,
    /// Innovation squared over its variance. The prediction is a mixture, so its distribution is not χ². Held at
    /// 10¹² to stay finite.
    pub nis: T,
    /// Natural logarithm of the residual's predictive density, density in 1/(m/s); zero if it was not used.
    pub log_likelihood: T,
}

impl<T: RealField + Copy, const LEVELS: usize> Default for HealthOutput<T, LEVELS> {
    fn default() -> Self {
        let none = Estimate { value: T::zero(), sigma: T::zero() };
        Self {
            verdict: Verdict::default(),
            suspect: Suspect::default(),
            alarms: HealthAlarms::default(),
            status: HealthStatus::default(),
            mode_probability: [[T::zero(); LEVELS]; 2],
            p_jump: T::zero(),
            p_noise: T::zero(),
            p_memory: T::zero(),
            p_fault: T::zero(),
            radio_error: none,
            inertial_error: none,
            jump: none,
            inertial_drift: none,
            correlated_error: none,
            corrected: None,
            residual: T::zero(),
            innovation: T::zero(),
            innovation_variance: T::zero(),
            nis: T::zero(),
            log_likelihood: T::zero(),
        }
    }
}
