//! What shows that an explanation holds: for each sensor the residual, its explained part and its remainder, the
//! innovations before and after with their autocorrelation and spectrum, and each effect against its cause.
//!
//! In: the arrays that come out of the filter anyway, [`CaseArrays`]; out: everything a plot needs, [`CaseEvidence`].
//! Values are in the SI unit of the sensor, NaN = missing, one value for each row of the recording.
mod autocorrelation;
mod dependence;
mod spectrum;

use rayon::prelude::*;
use schuler_recording::unit::Unit;

use crate::export::model::Model;

pub use autocorrelation::{Autocorrelation, autocorrelation};
pub use dependence::{Bin, Cause, Dependence};
pub use spectrum::{Density, Whiteness, density, whiteness};

/// What the analysis of a case hands over.
#[derive(Clone, Debug, Default)]
pub struct CaseArrays {
    /// Time of each row from the start of the recording, s.
    pub time_s: Vec<f64>,
    /// Nominal step, s.
    pub step_s: f64,
    /// Blocks that were kept from the fit, s from the start of the recording.
    pub held_out_s: Vec<[f64; 2]>,
    /// The sensors; one without a residual (a table that only drives others) is left out.
    pub sensors: Vec<SensorArrays>,
    /// What the findings add to the readings.
    pub model: Model,
}

/// What the analysis hands over of a sensor: arrays of as many values as there are rows.
#[derive(Clone, Debug)]
pub struct SensorArrays {
    /// Its name in the answer.
    pub sensor: String,
    /// The unit in which the case is written; the arrays are in its SI unit.
    pub unit: Unit,
    /// Output minus what the nominal model predicts of it.
    pub residual: Vec<f64>,
    /// Innovations over their standard deviation, noise fitted without the findings.
    pub innovation_before: Vec<f64>,
    /// The same with the findings and the noise that was fitted beside them.
    pub innovation_after: Vec<f64>,
    /// What each finding adds to this sensor.
    pub parts: Vec<Part>,
}

/// What a finding adds to a sensor.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its place among the findings of the explanation.
    pub finding: usize,
    /// What it adds to the residual.
    pub values: Vec<f64>,
    /// What it depends on; none where a plot against it says nothing (a delay, a change of the noise).
    pub cause: Option<Cause>,
}

/// Everything that plots of a case show.
#[derive(Clone, Debug, Default)]
pub struct CaseEvidence {
    /// Time of each row from the start of the recording, s.
    pub time_s: Vec<f64>,
    /// Nominal step, s.
    pub step_s: f64,
    /// Blocks that were kept from the fit, s from the start of the recording.
    pub held_out_s: Vec<[f64; 2]>,
    /// The sensors.
    pub sensors: Vec<SensorEvidence>,
}

/// Everything that plots of a sensor show.
#[derive(Clone, Debug)]
pub struct SensorEvidence {
    /// Its name in the answer.
    pub sensor: String,
    /// The unit in which to show it; the arrays are in its SI unit.
    pub unit: Unit,
    /// Output minus what the nominal model predicts of it.
    pub residual: Vec<f64>,
    /// What the findings say of it; 0 without any.
    pub explained: Vec<f64>,
    /// What is left.
    pub remainder: Vec<f64>,
    /// Standardised innovations, before and after.
    pub innovation: Compared<Vec<f64>>,
    /// Their autocorrelation.
    pub autocorrelation: Compared<Autocorrelation>,
    /// Their spectrum, 1 where they are white.
    pub whiteness: Compared<Whiteness>,
    /// Spectral density of residual and remainder.
    pub density: Compared<Density>,
    /// Root mean square of residual and remainder about their means.
    pub rms: Compared<f64>,
    /// The findings that add to it, by their places in the explanation.
    pub findings: Vec<usize>,
    /// Those that have one against their cause.
    pub dependences: Vec<Dependence>,
}

/// The same thing without the findings and with them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Compared<T> {
    /// Without.
    pub before: T,
    /// With.
    pub after: T,
}

impl<T> Compared<T> {
    fn of<S: ?Sized + Sync>(before: &S, after: &S, compute: impl Fn(&S) -> T + Sync) -> Self
    where
        T: Send,
    {
        let (before, after) = rayon::join(|| compute(before), || compute(after));
        Self { before, after }
    }
}

/// What shows that an explanation holds. Arrays shorter than the recording count as missing at their end; never
/// panics.
pub fn evidence(arrays: CaseArrays) -> CaseEvidence {
    let CaseArrays { time_s, step_s, held_out_s, sensors, .. } = arrays;
    let rows = time_s.len();
    let sensors = sensors.into_par_iter().map(|sensor| of_sensor(sensor, rows, step_s)).collect();
    CaseEvidence { time_s, step_s, held_out_s, sensors }
}

fn of_sensor(arrays: SensorArrays, rows: usize, step_s: f64) -> SensorEvidence {
    let SensorArrays { sensor, unit, residual, innovation_before, innovation_after, mut parts } = arrays;
    let of_all_rows = |mut values: Vec<f64>| {
        values.resize(rows, f64::NAN);
        values
    };
    let residual = of_all_rows(residual);
    let mut explained = vec![0.0; rows];
    for part in &mut parts {
        part.values.resize(rows, f64::NAN);
        for (sum, value) in explained.iter_mut().zip(&part.values) {
            *sum += value;
        }
    }
    let remainder: Vec<f64> = residual.iter().zip(&explained).map(|(r, e)| r - e).collect();
    let innovation =
        Compared { before: of_all_rows(innovation_before), after: of_all_rows(innovation_after) };
    let lags = autocorrelation::lags(rows);
    let findings = parts.iter().map(|part| part.finding).collect();
    let repeats = dependence::repeats(&remainder);
    let dependences =
        parts.into_iter().filter_map(|part| Dependence::of(part, &remainder, repeats)).collect();
    SensorEvidence {
        sensor,
        unit,
        autocorrelation: Compared::of(&innovation.before[..], &innovation.after[..], |values| {
            autocorrelation(values, step_s, lags)
        }),
        whiteness: Compared::of(&innovation.before[..], &innovation.after[..], |values| {
            whiteness(values, step_s)
        }),
        density: Compared::of(&residual[..], &remainder[..], |values| density(values, step_s)),
        rms: Compared::of(&residual[..], &remainder[..], spread),
        findings,
        dependences,
        residual,
        explained,
        remainder,
        innovation,
    }
}

/// Root mean square about the mean of what is there; NaN if nothing is.
fn spread(values: &[f64]) -> f64 {
    let mean = mean(values);
    let (sum, count) = present(values).fold((0.0, 0.0), |(s, n), v| (s + (v - mean).powi(2), n + 1.0));
    f64::sqrt(sum / count)
}

/// Mean of what is there; NaN if nothing is.
fn mean(values: &[f64]) -> f64 {
    let (sum, count) = present(values).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

fn present(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    values.iter().copied().filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::dependence::tests::{markov, white};

    #[test]
    fn explained_and_remainder_add_up_to_the_residual_and_short_arrays_are_missing_at_their_end() {
        let rows = 1000;
        let cause: Vec<f64> = (0..rows).map(|k| (k as f64 / 100.0).sin()).collect();
        let part: Vec<f64> = cause.iter().map(|x| 3.0 * x).collect();
        let noise = markov(rows, 20.0, 5);
        let residual: Vec<f64> = part.iter().zip(&noise).map(|(p, n)| p + n).collect();
        let found = evidence(CaseArrays {
            time_s: (0..rows).map(|k| k as f64).collect(),
            step_s: 1.0,
            held_out_s: vec![[800.0, 1000.0]],
            sensors: vec![SensorArrays {
                sensor: "gyro_x".into(),
                unit: Unit::DegreePerHour,
                residual,
                innovation_before: white(rows, 1),
                innovation_after: white(rows - 10, 2),
                parts: vec![Part {
                    finding: 0,
                    values: part,
                    cause: Some(Cause { name: "x".into(), unit: "K".into(), values: cause }),
                }],
            }],
            ..CaseArrays::default()
        });
        let sensor = &found.sensors[0];
        let worst = (0..rows).map(|k| (sensor.remainder[k] - noise[k]).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-12, "{worst}");
        assert!((sensor.rms.after - spread(&noise)).abs() < 1e-12);
        assert!(sensor.rms.before > 2.0 * sensor.rms.after);
        assert!(sensor.innovation.after[rows - 1].is_nan());
        assert_eq!(sensor.dependences.len(), 1);
    }

    #[test]
    fn nothing_recorded_is_no_reason_to_panic() {
        let nothing = SensorArrays {
            sensor: String::new(),
            unit: Unit::MetrePerSecond,
            residual: Vec::new(),
            innovation_before: Vec::new(),
            innovation_after: Vec::new(),
            parts: Vec::new(),
        };
        for rows in [0, 1, 2, 50] {
            let time_s = (0..rows).map(f64::from).collect();
            let arrays =
                CaseArrays { time_s, step_s: 1.0, sensors: vec![nothing.clone()], ..CaseArrays::default() };
            assert!(evidence(arrays).sensors[0].rms.before.is_nan());
        }
    }
}
