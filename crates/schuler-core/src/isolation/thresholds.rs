//! Decision thresholds for a stated mean time between false alarms.
//!
//! Sources: chi-square and normal tails for one sample; Siegmund's (1985) run length of a one-sided cumulative sum,
//! with the number of sums that are as good as independent found by simulation. Equation ids FDI-6, FDI-9. Valid
//! for white Gaussian parity noise.
//!
//! Each of the three detectors of a set (single sample, fast sums, slow sums) gets a third of the false alarms. When
//! one sample beyond its threshold is not yet an alarm, the single-sample detector gives none and the sums share.
//!
//! In: mean number of samples between false alarms. Out: thresholds of normalised statistics.
use nalgebra::RealField;

use super::geometry::constant;

/// Reference value `k_a` of the fast sums, in standard deviations.
pub const FAST_REFERENCE: f64 = 0.5;
/// Reference value `k_b` of the slow sums, in standard deviations.
pub const SLOW_REFERENCE: f64 = 0.1;
/// Range of the mean time between false alarms over which the thresholds were checked, samples.
pub const FALSE_ALARM_INTERVAL: core::ops::RangeInclusive<f64> = 1e4..=1e7;

/// Overshoot of a random walk with unit normal steps over its boundary (Siegmund 1985): 2 · 0.583.
const OVERSHOOT: f64 = 1.166;
/// Detectors in a set.
const DETECTORS: f64 = 3.0;
/// Detectors that share the false alarms when the single-sample detector wants more than one sample.
const SUM_DETECTORS: f64 = 2.0;
/// Opposite one-sided sums that watch a scalar parity: they are never both far from zero.
const SIDES: f64 = 2.0;
/// The ten coupled sums along five lines give alarms as often as this many independent ones.
const INDEPENDENT_SUMS: f64 = 8.5;

/// Thresholds of one set of detectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds<T> {
    /// c: of the squared norm of one sample's parity.
    pub single: T,
    /// `h_a`: of the sums with reference [`FAST_REFERENCE`].
    pub fast: T,
    /// `h_b`: of the sums with reference [`SLOW_REFERENCE`].
    pub slow: T,
}

impl<T: RealField + Copy> Thresholds<T> {
    /// For five gyros: two-dimensional parity watched along five lines. `[FDI-6]`
    ///
    /// `persistence`: samples in a row beyond the single-sample threshold that make an alarm.
    pub fn five(false_alarm_interval: T, persistence: u32) -> Self {
        let one_sided = false_alarm_interval * share(persistence) * constant(INDEPENDENT_SUMS);
        let single = false_alarm_interval * constant(DETECTORS);
        Self {
            // P(χ²₂ > c) = e^(−c/2).
            single: constant::<T>(2.0) * single.ln(),
            fast: siegmund(one_sided, constant(FAST_REFERENCE)),
            slow: siegmund(one_sided, constant(SLOW_REFERENCE)),
        }
    }

    /// For four gyros: scalar parity, watched to both sides. `[FDI-9]`
    pub fn four(false_alarm_interval: T, persistence: u32) -> Self {
        let one_sided = false_alarm_interval * share(persistence) * constant(SIDES);
        Self {
            single: two_sided_normal_square(false_alarm_interval * constant(DETECTORS)),
            fast: siegmund(one_sided, constant(FAST_REFERENCE)),
            slow: siegmund(one_sided, constant(SLOW_REFERENCE)),
        }
    }
}

/// How many detectors share the false alarms.
fn share<T: RealField>(persistence: u32) -> T {
    constant(if persistence > 1 { SUM_DETECTORS } else { DETECTORS })
}

/// Threshold h of a one-sided sum with reference k whose mean run length is ARL, from
/// ARL = (e^x − 1 − x)/(2k²), x = 2k(h + 1.166), by the contraction x ← ln(1 + 2k²·ARL + x).
fn siegmund<T: RealField + Copy>(run_length: T, reference: T) -> T {
    let two_k = reference + reference;
    let target = T::one() + two_k * reference * run_length;
    let mut x = target.ln();
    for _ in 0..8 {
        x = (target + x).ln();
    }
    x / two_k - constant(OVERSHOOT)
}

/// The square of the two-sided normal quantile that is exceeded once in `interval` samples, from the asymptotic
/// expansion of the normal tail, P(|r| > x) = √(2/π) e^(−x²/2)/x · (1 − x⁻² + 3x⁻⁴ − 15x⁻⁶), x > 3.8; relative
/// error of the probability below one per cent.
fn two_sided_normal_square<T: RealField + Copy>(interval: T) -> T {
    let one = T::one();
    let scale = interval * constant(0.797_884_560_802_865_4);
    let mut square = constant::<T>(20.0);
    for _ in 0..16 {
        let inverse = one / square;
        let series = one - inverse * (one - inverse * (constant::<T>(3.0) - inverse * constant::<T>(15.0)));
        square = constant::<T>(2.0) * (scale * series / square.sqrt()).ln();
    }
    square
}
