//! The calibration experiment as it was recorded, with what is known beforehand. SI units, radians, degC.
use serde::{Deserialize, Serialize};

use super::thermometer::Thermometry;

/// A calibration run on a one-axis table with a roughly horizontal axis, in a chamber of changing temperature [TMP-12].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Experiment {
    /// Where it took place.
    pub site: Site,
    /// What is on the table, and what the table tells.
    pub arrangement: Arrangement,
    /// Functions of temperature in which the coefficients are linear.
    pub features: FeatureSet,
    /// Noise of the sensors.
    pub noise: Noise,
    /// What is known of the coefficients beforehand.
    pub priors: Priors,
    /// What is known of the attitude at the start of a cycle.
    pub attitude: AttitudePrior,
    /// Interval between samples, s; at most 0.1, and a whole number of samples a second.
    pub sample_s: f64,
    /// Passes over the data: the first extended, the others linear about the one before. Two suffice for a complete unit,
    /// three for gyros on a table that does not repeat their mounting.
    pub passes: u8,
    /// One cycle for each instrument axis along the table's axis, in any order.
    pub cycles: Vec<Cycle>,
}

/// Where the experiment took place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Site {
    /// Geodetic latitude, rad.
    pub latitude: f64,
    /// Local gravity, m/s².
    pub gravity: f64,
}

/// What is on the table, and what the table tells.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Arrangement {
    /// Gyros and accelerometers; angles, rates and mounting of the table need not be known [TMP-12].
    CompleteUnit,
    /// Gyros alone, with the angle sensor of the table [TMP-14].
    GyroBlock {
        /// 1-σ of the table's angle sensor, rad.
        angle: f64,
        /// 1-σ of the table's wobble about each axis, which the angle sensor does not see, rad.
        wobble: f64,
        /// 1-σ of the block's mounting on the table, each cycle anew, rad.
        mounting: f64,
        /// 1-σ of the table's base (direction of its axis and its zero), rad.
        base: f64,
    },
}

/// Functions of temperature beside the constant [TMP-11].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FeatureSet {
    /// Temperature.
    Temperature,
    /// Temperature and its rate.
    TemperatureRate,
    /// Temperature, its rate and the three components of its gradient.
    TemperatureRateGradient,
}

impl FeatureSet {
    /// Number of features, the constant included: `n_p`.
    pub fn count(self) -> usize {
        match self {
            Self::Temperature => 2,
            Self::TemperatureRate => 3,
            Self::TemperatureRateGradient => 6,
        }
    }
}

/// Noise of the sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Angle random walk of the gyros, rad/√s.
    pub angle_random_walk: f64,
    /// 1-σ of the mean specific force over one second, m/s².
    pub specific_force: f64,
}

/// 1-σ of the parts of one coefficient: at the reference temperature, and for one unit of each scaled feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PriorSigma {
    /// At the reference temperature and rest.
    pub constant: f64,
    /// For 30 degC.
    pub temperature: f64,
    /// For 20 degC/h.
    pub rate: f64,
    /// For 5 degC/m, each component.
    pub gradient: f64,
}

impl PriorSigma {
    /// 1-σ at the feature of this index.
    pub fn at(&self, feature: usize) -> f64 {
        match feature {
            0 => self.constant,
            1 => self.temperature,
            2 => self.rate,
            _ => self.gradient,
        }
    }
}

/// What is known of the coefficients beforehand: zero, with these sigmas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Priors {
    /// Gyro biases, rad/s.
    pub gyro_bias: PriorSigma,
    /// Gyro scale factors and misalignments.
    pub gyro_matrix: PriorSigma,
    /// Accelerometer biases, m/s².
    pub accelerometer_bias: PriorSigma,
    /// Accelerometer scale factors and misalignments.
    pub accelerometer_matrix: PriorSigma,
}

impl Default for Priors {
    /// A tactical-grade unit [TMP-13]: 20, 10, 6 deg/h, 2000, 1000, 600 ppm, 50, 25, 15 mm/s²; gradient as rate.
    fn default() -> Self {
        let degree_per_hour = std::f64::consts::PI / 180.0 / 3600.0;
        let sigma = |constant: f64, temperature: f64, rate: f64| PriorSigma {
            constant,
            temperature,
            rate,
            gradient: rate,
        };
        let matrix = sigma(2e-3, 1e-3, 6e-4);
        Self {
            gyro_bias: sigma(20.0 * degree_per_hour, 10.0 * degree_per_hour, 6.0 * degree_per_hour),
            gyro_matrix: matrix,
            accelerometer_bias: sigma(0.05, 0.025, 0.015),
            accelerometer_matrix: matrix,
        }
    }
}

/// What is known of the attitude at the start of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudePrior {
    /// 1-σ of the levelling by the accelerometers, about the two horizontal axes, rad.
    pub level: f64,
    /// 1-σ of the stated azimuth of the table's axis, mounting included, rad.
    pub azimuth: f64,
}

impl Default for AttitudePrior {
    /// 1 degree in level, 3 degrees in azimuth.
    fn default() -> Self {
        Self { level: 1.0f64.to_radians(), azimuth: 3.0f64.to_radians() }
    }
}

/// One cycle of rotations about the table's axis, with the unit mounted in one way.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cycle {
    /// Instrument axis (0, 1, 2) that lies, roughly, along the table's axis.
    pub axis: usize,
    /// Azimuth of that instrument axis, from north to east, rad.
    pub azimuth: f64,
    /// Mean rate of the gyros over each sampling interval, rad/s; one that is not finite splits the cycle there.
    pub rate: Vec<[f64; 3]>,
    /// Mean specific force over each sampling interval, m/s²; empty without accelerometers. A value that is not finite
    /// is missing.
    pub specific_force: Vec<[f64; 3]>,
    /// Angle of the table at each whole second from the start of the cycle, rad; empty without an angle sensor. It
    /// turns the unit about its own axis `axis` in the positive sense; at zero the next instrument axis points up.
    pub table_angle: Vec<f64>,
    /// Temperatures.
    pub thermometry: Thermometry,
}

/// What makes an experiment unusable.
#[derive(Clone, Debug, PartialEq, thiserror::Error, Serialize, Deserialize)]
pub enum CalibrationError {
    /// A value that cannot be used.
    #[error("{field}: {problem}")]
    Invalid {
        /// Path of the field, e.g. `cycles[2].axis`.
        field: String,
        /// What is wrong with it, and what is expected.
        problem: String,
    },
    /// Whoever watches has ended the work.
    #[error("stopped")]
    Stopped,
    /// The covariance lost its meaning.
    #[error("cycle {cycle}, second {second}: the filter failed ({problem})")]
    Numerical {
        /// Cycle, from one.
        cycle: usize,
        /// Second within the cycle.
        second: usize,
        /// What happened.
        problem: String,
    },
}

impl Experiment {
    /// Samples a second.
    pub(super) fn samples_per_second(&self) -> usize {
        (1.0 / self.sample_s).round() as usize
    }

    /// Checks everything that does not need the data worked through.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn check(&self) -> Result<(), CalibrationError> {
        positive("site.gravity", self.site.gravity)?;
        if self.site.latitude.is_nan() || self.site.latitude.abs() > 1.56 {
            return invalid(
                "site.latitude",
                "must be between -1.56 and 1.56 rad: azimuth has no meaning at a pole",
            );
        }
        if !(1e-3..=0.1).contains(&self.sample_s) {
            return invalid("sample_s", "must be between 0.001 and 0.1 s");
        }
        let samples = self.samples_per_second();
        if (self.sample_s * samples as f64 - 1.0).abs() > 1e-9 {
            return invalid("sample_s", "a second must hold a whole number of samples");
        }
        if !(2..=10).contains(&self.passes) {
            return invalid("passes", "must be between 2 and 10: one pass leaves second-order bias");
        }
        positive("noise.angle_random_walk", self.noise.angle_random_walk)?;
        self.check_priors("priors.gyro_bias", &self.priors.gyro_bias)?;
        self.check_priors("priors.gyro_matrix", &self.priors.gyro_matrix)?;
        match self.arrangement {
            Arrangement::CompleteUnit => {
                positive("noise.specific_force", self.noise.specific_force)?;
                positive("attitude.level", self.attitude.level)?;
                positive("attitude.azimuth", self.attitude.azimuth)?;
                self.check_priors("priors.accelerometer_bias", &self.priors.accelerometer_bias)?;
                self.check_priors("priors.accelerometer_matrix", &self.priors.accelerometer_matrix)?;
            }
            Arrangement::GyroBlock { angle, wobble, mounting, base } => {
                positive("arrangement.angle", angle)?;
                positive("arrangement.wobble", wobble)?;
                positive("arrangement.mounting", mounting)?;
                positive("arrangement.base", base)?;
            }
        }
        if self.cycles.is_empty() {
            return invalid("cycles", "at least one cycle is needed");
        }
        self.cycles.iter().enumerate().try_for_each(|(k, cycle)| self.check_cycle(k, cycle))
    }

    fn check_priors(&self, field: &str, prior: &PriorSigma) -> Result<(), CalibrationError> {
        (0..self.features.count()).try_for_each(|f| positive(field, prior.at(f)))
    }

    fn check_cycle(&self, k: usize, cycle: &Cycle) -> Result<(), CalibrationError> {
        let field = |name: &str| format!("cycles[{k}].{name}");
        if cycle.axis > 2 {
            return invalid(&field("axis"), "must be 0, 1 or 2");
        }
        if !cycle.azimuth.is_finite() {
            return invalid(&field("azimuth"), "is not a finite number");
        }
        let seconds = cycle.rate.len() / self.samples_per_second();
        if seconds < 60 {
            return invalid(&field("rate"), "must last at least 60 s");
        }
        let turning = [0, 1, 2].map(|axis| {
            let along = cycle.rate.iter().map(|w| w[axis]).filter(|w| w.is_finite());
            along.map(|w| w * w).sum::<f64>()
        });
        let fastest = if turning[0] > turning[1].max(turning[2]) {
            0
        } else {
            1 + usize::from(turning[2] > turning[1])
        };
        if fastest != cycle.axis {
            let problem =
                format!("is {}, but the gyros say that the table turned about axis {fastest}", cycle.axis);
            return invalid(&field("axis"), &problem);
        }
        match self.arrangement {
            Arrangement::CompleteUnit if cycle.specific_force.len() != cycle.rate.len() => {
                invalid(&field("specific_force"), "must have as many samples as rate")
            }
            Arrangement::GyroBlock { .. } if cycle.table_angle.len() <= seconds => {
                invalid(&field("table_angle"), "must have one angle a second, the start and the end included")
            }
            _ => cycle.thermometry.check(&field("thermometry"), seconds, self.features),
        }
    }
}

/// An error about one value.
pub(super) fn invalid<T>(field: &str, problem: &str) -> Result<T, CalibrationError> {
    Err(CalibrationError::Invalid { field: field.to_owned(), problem: problem.to_owned() })
}

fn positive(field: &str, value: f64) -> Result<(), CalibrationError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        invalid(field, "must be a finite number above zero")
    }
}
