//! What a mismatch means: what it does to a navigation solution, and which noise it was judged by.
use serde::Serialize;

/// What errors of a sensor do to a navigation solution that does not know of them.
///
/// They drive one level channel of an inertial system from rest: δv̇ = a − g φ, φ̇ = ε + δv / R, with the error a of an accelerometer or
/// ε of a gyro.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Impact {
    /// The sensor.
    pub sensor: String,
    /// Time from where the error begins, s: an hour, or less in a shorter recording.
    pub after_s: f64,
    /// Error of the position then, m.
    pub position_m: f64,
    /// Error of the attitude then, °.
    pub attitude_deg: f64,
}

/// The noise of a sensor: what the case states, and what was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NoiseOfSensor {
    /// The sensor.
    pub sensor: String,
    /// The unit in which it is written.
    pub unit: String,
    /// What the case states; absent where it states nothing.
    pub stated: Option<NoiseNumbers>,
    /// What describes the recording best.
    pub found: NoiseNumbers,
    /// Degrees of freedom ν of the level of each band of its spectrum; absent where the spectrum holds as far as can be told.
    pub nu: Option<f64>,
    /// Relative standard deviation to which the spectrum holds, by ν; 0 where it holds as far as can be told.
    pub holds_within: f64,
}

/// The numbers of a noise, in the unit of the sensor; those that are 0 are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NoiseNumbers {
    /// White noise, 1 σ a sample.
    #[serde(skip_serializing_if = "is_zero")]
    pub white: f64,
    /// First-order Markov parts: σ, and correlation time, s.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub markov: Vec<[f64; 2]>,
    /// Exponential-cosine parts: σ, decay, 1/s, and frequency, rad/s.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exp_cos: Vec<[f64; 3]>,
    /// Random walk, 1 σ a √s.
    #[serde(skip_serializing_if = "is_zero")]
    pub random_walk: f64,
    /// Flicker, 1 σ of each of its parts.
    #[serde(skip_serializing_if = "is_zero")]
    pub flicker: f64,
    /// Rounding of the angle whose difference is the output, 1 σ.
    #[serde(skip_serializing_if = "is_zero")]
    pub angle: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
fn is_zero(number: &f64) -> bool {
    *number == 0.0
}
