//! What a calibration gives: coefficients with sigmas and units, what was observable, and verdicts.
use std::fmt;

use schuler_core::thermal::compensation::BLOCK_VERSION;
use schuler_core::thermal::{CompensationBlock, FeatureMap};
use serde::{Deserialize, Serialize};

use super::observability::ThermalProgramme;

/// A function of temperature in which the coefficients are linear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Feature {
    /// One.
    Constant,
    /// (T − 35 degC)/30 degC.
    Temperature,
    /// D/(20 degC/h).
    Rate,
    /// Gradient along x/(5 degC/m).
    GradientX,
    /// Gradient along y/(5 degC/m).
    GradientY,
    /// Gradient along z/(5 degC/m).
    GradientZ,
}

impl Feature {
    /// In the order of the parameters.
    pub const ALL: [Self; 6] =
        [Self::Constant, Self::Temperature, Self::Rate, Self::GradientX, Self::GradientY, Self::GradientZ];

    /// One unit of the scaled feature: degC, degC/s, degC/m.
    pub fn scale(self) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Temperature => 30.0,
            Self::Rate => 20.0 / 3600.0,
            Self::GradientX | Self::GradientY | Self::GradientZ => 5.0,
        }
    }

    /// Reference temperature, degC.
    pub const REFERENCE_TEMPERATURE: f64 = 35.0;
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Constant => "constant",
            Self::Temperature => "temperature",
            Self::Rate => "rate",
            Self::GradientX => "gradient x",
            Self::GradientY => "gradient y",
            Self::GradientZ => "gradient z",
        })
    }
}

/// An element of a triad's error model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Element {
    /// Gyro bias of an axis.
    GyroBias(usize),
    /// Gyro matrix: sensor, input.
    GyroMatrix(usize, usize),
    /// Accelerometer bias of an axis.
    AccelerometerBias(usize),
    /// Accelerometer matrix: sensor, input.
    AccelerometerMatrix(usize, usize),
}

impl Element {
    /// Of the gyros, in the order of the parameters.
    pub(super) fn gyro() -> impl Iterator<Item = Self> {
        let matrix = (0..9).map(|k| Self::GyroMatrix(k / 3, k % 3));
        (0..3).map(Self::GyroBias).chain(matrix)
    }

    /// Of the accelerometers, in the order of the parameters.
    pub(super) fn accelerometer() -> impl Iterator<Item = Self> {
        let matrix = ACCELEROMETER_MATRIX.into_iter().map(|(i, j)| Self::AccelerometerMatrix(i, j));
        (0..3).map(Self::AccelerometerBias).chain(matrix)
    }

    /// Unit of the coefficient at each feature.
    pub fn unit(self) -> &'static str {
        match self {
            Self::GyroBias(_) => "rad/s",
            Self::AccelerometerBias(_) => "m/s^2",
            Self::GyroMatrix(..) | Self::AccelerometerMatrix(..) => "1",
        }
    }

    /// Unit of reports, and how many of it make one SI unit.
    pub fn practical_unit(self) -> (&'static str, f64) {
        match self {
            Self::GyroBias(_) => ("deg/h", 3600.0f64.to_degrees()),
            Self::AccelerometerBias(_) => ("mm/s^2", 1e3),
            Self::GyroMatrix(..) | Self::AccelerometerMatrix(..) => ("ppm", 1e6),
        }
    }
}

/// Elements of the accelerometers' lower triangular matrix, in the order of the parameters.
pub(super) const ACCELEROMETER_MATRIX: [(usize, usize); 6] = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)];

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = |k: &usize| ["x", "y", "z"].get(*k).copied().unwrap_or("?");
        match self {
            Self::GyroBias(i) => write!(f, "gyro {} bias", axis(i)),
            Self::AccelerometerBias(i) => write!(f, "accelerometer {} bias", axis(i)),
            Self::GyroMatrix(i, j) if i == j => write!(f, "gyro {} scale factor", axis(i)),
            Self::AccelerometerMatrix(i, j) if i == j => write!(f, "accelerometer {} scale factor", axis(i)),
            Self::GyroMatrix(i, j) => write!(f, "gyro {} misalignment to {}", axis(i), axis(j)),
            Self::AccelerometerMatrix(i, j) => {
                write!(f, "accelerometer {} misalignment to {}", axis(i), axis(j))
            }
        }
    }
}

/// How well something was determined by the run, beyond what was known before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Determination {
    /// The sigma fell to less than half of the prior.
    Determined,
    /// The sigma fell, but to no less than half of the prior.
    Weak,
    /// The sigma is that of the prior, to a tenth: the run says nothing.
    Undetermined,
}

impl Determination {
    /// From the ratio of posterior to prior sigma.
    pub fn of(ratio: f64) -> Self {
        if ratio < 0.5 {
            Self::Determined
        } else if ratio < 0.9 {
            Self::Weak
        } else {
            Self::Undetermined
        }
    }
}

/// One number of the calibration: an element at one feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coefficient {
    /// Element of the error model.
    pub element: Element,
    /// Feature that it goes with.
    pub feature: Feature,
    /// Value, in the element's unit for one unit of the scaled feature.
    pub value: f64,
    /// 1-σ after the run.
    pub sigma: f64,
    /// 1-σ before the run.
    pub prior_sigma: f64,
    /// How well the run determined it.
    pub determination: Determination,
}

/// What the run says about the parts of one element together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ElementReport {
    /// Element of the error model.
    pub element: Element,
    /// Largest ratio of posterior to prior sigma over all combinations of its parts.
    pub worst_ratio: f64,
    /// The combination that has it, in units of the prior sigmas.
    pub worst_combination: Vec<(Feature, f64)>,
    /// Verdict on that combination.
    pub determination: Determination,
    /// Why, where it is not determined.
    pub words: String,
}

/// What one cycle contributed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CycleReport {
    /// Instrument axis along the table's axis.
    pub axis: usize,
    /// Seconds used.
    pub seconds: usize,
    /// Seconds without a measurement, or with gyros missing.
    pub missing: usize,
    /// Mean normalised innovation squared; one if the model is right.
    pub nis: f64,
    /// Independence of the features.
    pub programme: ThermalProgramme,
}

/// A judgement of the run as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Verdict {
    /// Every coefficient was determined and the innovations are as the model says.
    Sound,
    /// The innovations are too large (or too small): an effect is missing from the model, or the noise is wrong.
    ModelDoesNotFit {
        /// Mean normalised innovation squared.
        nis: f64,
    },
    /// Another pass would still move a coefficient by this many sigmas.
    NotConverged {
        /// Largest move of the last pass, sigmas.
        shift: f64,
    },
    /// In this cycle the features are dependent functions of time.
    ProgrammeTooPoor {
        /// Cycle, from one.
        cycle: usize,
        /// Smallest singular value.
        smallest: f64,
        /// What the temperature did.
        words: String,
    },
    /// No cycle turned the unit about this axis.
    AxisNotTurned {
        /// Instrument axis.
        axis: usize,
    },
    /// A combination of the parts of this element was not determined.
    ElementUndetermined {
        /// Element of the error model.
        element: Element,
        /// Which combination, and why.
        words: String,
    },
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sound => {
                f.write_str("every coefficient was determined, and the innovations are as the model says")
            }
            Self::ModelDoesNotFit { nis } => write!(
                f,
                "the normalised innovation squared is {nis:.3} instead of 1: an effect is missing from the model, or the \
                 stated noise is wrong"
            ),
            Self::NotConverged { shift } => {
                write!(f, "the last pass still moved a coefficient by {shift:.1} sigma: ask for another pass")
            }
            Self::ProgrammeTooPoor { cycle, smallest, words } => {
                write!(
                    f,
                    "cycle {cycle}: {words} (smallest singular value {smallest:.3}, at least 0.08 is needed)"
                )
            }
            Self::AxisNotTurned { axis } => {
                let axis = ["x", "y", "z"].get(*axis).copied().unwrap_or("?");
                write!(f, "no cycle turned the unit about its {axis} axis")
            }
            Self::ElementUndetermined { element, words } => write!(f, "{element}: {words}"),
        }
    }
}

/// The result of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Every coefficient at every feature.
    pub coefficients: Vec<Coefficient>,
    /// Every element, with its worst determined combination.
    pub elements: Vec<ElementReport>,
    /// Every cycle.
    pub cycles: Vec<CycleReport>,
    /// Mean normalised innovation squared of the last pass.
    pub nis: f64,
    /// Scalar measurements used in a pass.
    pub measurements: usize,
    /// Largest move of a coefficient in the last pass, in its sigmas.
    pub last_shift: f64,
    /// Lowest and highest temperature of the run, degC.
    pub temperature_range: [f64; 2],
    /// Largest magnitude of the rate, degC/s.
    pub rate_limit: f64,
    /// Largest magnitude of a component of the gradient, degC/m.
    pub gradient_limit: f64,
    /// What to think of it.
    pub verdicts: Vec<Verdict>,
}

impl Calibration {
    /// The coefficient of an element at a feature, if it was in the model.
    pub fn coefficient(&self, element: Element, feature: Feature) -> Option<&Coefficient> {
        self.coefficients.iter().find(|c| c.element == element && c.feature == feature)
    }

    /// The block that the navigation computer flies with; its range is that of the run.
    pub fn compensation_block(&self) -> CompensationBlock {
        let mut block = CompensationBlock {
            version: BLOCK_VERSION,
            features: FeatureMap {
                reference_temperature: Feature::REFERENCE_TEMPERATURE as f32,
                temperature_scale: Feature::Temperature.scale() as f32,
                rate_scale: Feature::Rate.scale() as f32,
                gradient_scale: Feature::GradientX.scale() as f32,
                temperature_range: self.temperature_range.map(|t| t as f32),
                rate_limit: self.rate_limit as f32,
                gradient_limit: self.gradient_limit as f32,
            },
            ..CompensationBlock::default()
        };
        for c in &self.coefficients {
            let target = match c.element {
                Element::GyroBias(i) => &mut block.gyro.bias[i],
                Element::GyroMatrix(i, j) => &mut block.gyro.matrix[i][j],
                Element::AccelerometerBias(i) => &mut block.accelerometer.bias[i],
                Element::AccelerometerMatrix(i, j) => &mut block.accelerometer.matrix[i][j],
            };
            target[c.feature as usize] = c.value as f32;
        }
        block
    }
}
