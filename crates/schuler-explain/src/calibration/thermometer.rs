//! Temperature and its rate through a calibration run, from a quantised thermometer, with hindsight [TMP-13].
//!
//! The instants of level changes are found as in flight (thresholds, chatter merged), but centred in time, and a natural
//! cubic spline is drawn through them. The real-time rate must not be a regressor: its errors would bias the coefficients.
use serde::{Deserialize, Serialize};

use super::experiment::{CalibrationError, FeatureSet, invalid};
use crate::numeric::spline::{Knot, Spline};

/// Temperature at the sensors at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ThermalPoint {
    /// degC.
    pub temperature: f64,
    /// degC/s.
    pub rate: f64,
    /// degC/m, in body axes.
    pub gradient: [f64; 3],
}

/// What is known of the temperature during a cycle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Thermometry {
    /// Known at each whole second from the start of the cycle, its end included.
    Known(Vec<ThermalPoint>),
    /// Readings of a quantised thermometer, one a second; not a number where missing.
    Quantised {
        /// Quantum, degC.
        quantum: f64,
        /// Readings of a rounding converter, degC.
        readings: Vec<f64>,
        /// Second of the first reading, counted from the start of the cycle; negative when readings began before. Readings
        /// from before the start and after the end make the ends of the cycle as good as its middle.
        first_s: i64,
        /// Gradient at each whole second of the cycle, degC/m; empty without.
        gradient: Vec<[f64; 3]>,
    },
}

/// Crossings of one threshold this close, s, are one.
const CHATTER: f64 = 120.0;
/// Least distance between knots of the spline, s.
const KNOT_SPACING: f64 = 60.0;

impl Thermometry {
    pub(super) fn check(
        &self,
        field: &str,
        seconds: usize,
        features: FeatureSet,
    ) -> Result<(), CalibrationError> {
        let with_gradient = features == FeatureSet::TemperatureRateGradient;
        match self {
            Self::Known(points) => {
                if points.len() <= seconds {
                    return invalid(field, "must have one point a second, the start and the end included");
                }
                let finite = |p: &ThermalPoint| {
                    p.temperature.is_finite()
                        && p.rate.is_finite()
                        && p.gradient.iter().all(|g| g.is_finite())
                };
                if !points.iter().all(finite) {
                    return invalid(field, "holds a number that is not finite");
                }
            }
            Self::Quantised { quantum, readings, gradient, .. } => {
                if !(quantum.is_finite() && *quantum > 0.0) {
                    return invalid(&format!("{field}.quantum"), "must be a finite number above zero");
                }
                if readings.iter().filter(|y| y.is_finite()).count() < 2 {
                    return invalid(&format!("{field}.readings"), "must hold at least two readings");
                }
                if with_gradient && gradient.len() <= seconds {
                    return invalid(
                        &format!("{field}.gradient"),
                        "must have one value a second, both ends included",
                    );
                }
                if !gradient.iter().flatten().all(|g| g.is_finite()) {
                    return invalid(&format!("{field}.gradient"), "holds a number that is not finite");
                }
            }
        }
        Ok(())
    }

    /// Temperature, rate and gradient at the middle of each of `seconds` seconds.
    pub fn points(&self, seconds: usize) -> Vec<ThermalPoint> {
        let middle = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
        match self {
            Self::Known(points) => points
                .windows(2)
                .take(seconds)
                .map(|p| ThermalPoint {
                    temperature: 0.5 * (p[0].temperature + p[1].temperature),
                    rate: 0.5 * (p[0].rate + p[1].rate),
                    gradient: middle(p[0].gradient, p[1].gradient),
                })
                .collect(),
            Self::Quantised { quantum, readings, first_s, gradient } => {
                let spline = Spline::through(&updates(readings, *quantum, *first_s as f64));
                (0..seconds)
                    .map(|k| {
                        let (temperature, rate) = spline.at(k as f64 + 0.5);
                        let gradient = match gradient.get(k..k + 2) {
                            Some([a, b]) => middle(*a, *b),
                            _ => [0.0; 3],
                        };
                        ThermalPoint { temperature, rate, gradient }
                    })
                    .collect()
            }
        }
    }
}

/// Instants of level changes of `readings` (one a second from `first` on), chatter merged, at least a knot's spacing apart;
/// the readings at both ends are added where no update is near.
pub(super) fn updates(readings: &[f64], quantum: f64, first: f64) -> Vec<Knot> {
    let valid: Vec<(f64, f64)> = readings
        .iter()
        .enumerate()
        .filter(|(_, y)| y.is_finite())
        .map(|(k, y)| (first + k as f64, *y))
        .collect();
    // Median of three against single spikes, centred.
    let level = |k: usize| {
        let (a, b, c) = (valid[k.saturating_sub(1)].1, valid[k].1, valid[(k + 1).min(valid.len() - 1)].1);
        a.max(b).min(a.min(b).max(c))
    };
    let mut found: Vec<Knot> = Vec::new();
    // Of the newest update: last crossing, whether the reading is back on the side it came from.
    let (mut last, mut back) = (f64::NEG_INFINITY, false);
    for k in 1..valid.len() {
        let (from, to) = (level(k - 1), level(k));
        if from == to {
            continue;
        }
        let time = 0.5 * (valid[k - 1].0 + valid[k].0);
        let threshold = to - (to - from).signum() * 0.5 * quantum;
        match found.last_mut() {
            Some(newest) if (newest.value - threshold).abs() < 0.25 * quantum && time - last <= CHATTER => {
                // The single crossing that spends as long on the old side.
                newest.time += if back { time - last } else { 0.0 };
                back = !back;
            }
            _ => {
                found.push(Knot { time, value: threshold });
                back = false;
            }
        }
        last = time;
    }

    let mut kept: Vec<Knot> = Vec::new();
    let ends = [0, valid.len() - 1].map(|k| Knot { time: valid[k].0, value: level(k) });
    if found.first().is_none_or(|u| u.time - ends[0].time > CHATTER) {
        kept.push(ends[0]);
    }
    for update in found {
        if kept.last().is_none_or(|k| update.time - k.time >= KNOT_SPACING) {
            kept.push(update);
        }
    }
    if kept.last().is_none_or(|u| ends[1].time - u.time > CHATTER) {
        kept.push(ends[1]);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spline_follows_a_smooth_profile_and_its_rate() {
        let profile = |t: f64| 20.0 + 5.0 * (t / 300.0).sin();
        let knots: Vec<Knot> =
            (0..=40).map(|k| f64::from(k) * 47.0).map(|time| Knot { time, value: profile(time) }).collect();
        let spline = Spline::through(&knots);
        for k in 200..1600 {
            let t = f64::from(k);
            let (value, rate) = spline.at(t);
            assert!((value - profile(t)).abs() < 2e-4, "{t}: {value}");
            assert!((rate - 5.0 / 300.0 * (t / 300.0).cos()).abs() < 2e-5, "{t}: {rate}");
        }
        // Straight beyond the end.
        let (end, rate) = spline.at(1880.0);
        assert!((spline.at(1900.0).0 - end - 20.0 * rate).abs() < 1e-12);
    }

    #[test]
    fn tmp_4_updates_are_thresholds_with_chatter_merged() {
        let mut readings: Vec<f64> =
            (0..4000).map(|t| ((20.1 + 0.002 * f64::from(t)) / 0.5 + 0.5).floor() * 0.5).collect();
        // 20.25 is crossed at 75 s, 20.75 at 325 s, …; a spike, a gap, and chatter at 20.75: half of 40 s on the old side.
        readings[1000] += 5.0;
        readings[1500] = f64::NAN;
        for t in (306..346).step_by(4) {
            readings[t] = 20.5;
            readings[t + 1] = 20.5;
            readings[t + 2] = 21.0;
            readings[t + 3] = 21.0;
        }
        let found = updates(&readings, 0.5, 0.0);
        let threshold = |k: usize| 20.25 + 0.5 * k as f64;
        assert_eq!(found.len(), 17, "{found:?}");
        for (k, update) in found[..16].iter().enumerate() {
            assert_eq!(update.value, threshold(k));
            let expected = (threshold(k) - 20.1) / 0.002;
            assert!((update.time - expected).abs() <= 2.5, "{update:?}, expected {expected}");
        }
        // The end of the record is held by its reading.
        assert_eq!(found[16], Knot { time: 3999.0, value: 28.0 });
    }
}
