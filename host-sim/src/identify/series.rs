//! The error series of a sensor: its readings less what an ideal sensor would have read.
use schuler_recording::Recording;
use schuler_recording::motion::{Prediction, predict};
use schuler_recording::recording::SensorSeries;
use serde::Serialize;

/// A series of errors on the nominal step grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Nominal step, s.
    pub step_s: f64,
    /// Errors in the SI unit of the sensor; NaN = missing.
    pub values: Vec<f64>,
    /// What was taken from the readings.
    pub subtracted: Subtracted,
}

/// What was taken from the readings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Subtracted {
    /// Nothing, because the motion does not say what an ideal sensor would have read.
    Nothing {
        /// What the case lacks.
        because: String,
    },
    /// A constant: the body was at rest.
    Constant {
        /// The constant, in the SI unit of the sensor; 0 for a sensor read against an unknown constant.
        value: f64,
    },
    /// The predicted output for the recorded motion.
    Motion,
}

/// The error series of `sensor` in `recording`.
pub fn error_series(recording: &Recording, sensor: &SensorSeries) -> Series {
    let (values, subtracted) = match predict(recording, &sensor.sensor) {
        Ok(Prediction::Constant(constant)) => (
            sensor.values.iter().map(|value| value - constant).collect(),
            Subtracted::Constant { value: constant },
        ),
        Ok(Prediction::Series(motion)) => {
            let errors = sensor.values.iter().zip(motion).map(|(value, motion)| value - motion).collect();
            (errors, Subtracted::Motion)
        }
        Err(lacking) => (sensor.values.clone(), Subtracted::Nothing { because: lacking.to_string() }),
    };
    Series { step_s: recording.step_s, values, subtracted }
}

/// Mean of the values that are there, NaN if none is.
pub fn mean(values: &[f64]) -> f64 {
    about_mean(values).0
}

/// Mean of the values that are there (NaN if none is), and the values less their mean. Both by way of the first value, so
/// that a small spread about a large mean keeps its digits.
pub fn about_mean(values: &[f64]) -> (f64, Vec<f64>) {
    let present = values.iter().copied().filter(|value| value.is_finite());
    let Some(first) = present.clone().next() else { return (f64::NAN, values.to_vec()) };
    let beyond_first = present.clone().map(|value| value - first).sum::<f64>() / present.count() as f64;
    (first + beyond_first, values.iter().map(|value| value - first - beyond_first).collect())
}

/// Means of `factor` consecutive steps each, those with fewer than half of their values missing. A rest at the end
/// that does not fill a block is left out.
pub fn block_means(values: &[f64], factor: usize) -> Vec<f64> {
    Blocks::new(values, factor).values
}

/// Means of blocks of steps, and how much of each is there.
#[derive(Clone, Debug, PartialEq)]
pub struct Blocks {
    /// The means; NaN = missing.
    pub values: Vec<f64>,
    /// Steps of the block for each value in it: by this much the white part of its mean has more variance than that of a whole
    /// block. 1 where nothing is missing; of no meaning where the mean is.
    pub thinness: Vec<f64>,
}

impl Blocks {
    /// Means of `factor` consecutive steps each (NaN = missing). A block with fewer than half as many values as blocks have on
    /// average is missing. A rest at the end that does not fill a block is left out.
    pub fn new(values: &[f64], factor: usize) -> Self {
        let factor = factor.max(1);
        let present = |block: &[f64]| block.iter().filter(|value| value.is_finite()).count();
        let part = present(values) as f64 / values.len().max(1) as f64;
        let least = 0.5 * part * factor as f64;
        let (values, thinness) = values
            .chunks_exact(factor)
            .map(|block| {
                let present = present(block) as f64;
                let held = present >= least.max(f64::MIN_POSITIVE);
                (if held { mean(block) } else { f64::NAN }, factor as f64 / present.max(1.0))
            })
            .unzip();
        Self { values, thinness }
    }

    /// The offset of [`about_mean`], and the means less it.
    pub(super) fn centred(&self) -> (f64, Self) {
        let (offset, values) = about_mean(&self.values);
        (offset, Self { values, thinness: self.thinness.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_keep_the_digits_of_a_small_spread() {
        let values = [1e6 + 1e-7, f64::NAN, 1e6 - 1e-7, 1e6];
        assert!((mean(&values) - 1e6).abs() < 1e-9);
        let (_, centred) = about_mean(&values);
        assert!((centred[0] + centred[2]).abs() < 1e-20);
        assert!(mean(&[f64::NAN]).is_nan());
    }

    #[test]
    fn blocks_are_weighted_by_what_they_hold() {
        let nan = f64::NAN;
        let Blocks { values, thinness } = Blocks::new(&[1.0, 3.0, nan, 4.0, nan, nan, 9.0], 2);
        assert_eq!(&values[..2], [2.0, 4.0]);
        assert!(values[2].is_nan());
        assert_eq!((values.len(), &thinness[..2]), (3, &[1.0, 2.0][..]));
        let sparse: Vec<f64> = (0..1000).map(|row| if row % 5 == 0 { 1.0 } else { nan }).collect();
        assert!(block_means(&sparse, 10).iter().all(|mean| *mean == 1.0));
    }
}
