//! Which series are looked at, and where they enter.
use serde::{Deserialize, Serialize};

use super::SERIES;
use crate::config::{ConfigError, Problem};
use crate::filter::positive;
use crate::module::{ACCELEROMETERS, THERMOMETERS};
use crate::saved::{saved, saved_choice};

/// A series that the module knows. Temperature and specific force count from their first reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Series {
    /// One.
    #[default]
    Constant,
    /// Time since the start of the sums, s.
    Time,
    /// Temperature, K.
    Temperature,
    /// Its rate, K/s.
    TemperatureRate,
    /// Temperature behind a first-order lag with the first constant, K.
    FastLag,
    /// The same with the second constant, K.
    SlowLag,
    /// Specific force, m/s².
    Force,
    /// Its square, (m/s²)².
    ForceSquared,
}

impl Series {
    /// All of them, in the order of the parity channels' dictionary.
    pub const ALL: [Self; SERIES] = [
        Self::Constant,
        Self::Time,
        Self::Temperature,
        Self::TemperatureRate,
        Self::FastLag,
        Self::SlowLag,
        Self::Force,
        Self::ForceSquared,
    ];
}

/// Where an error enters the velocity channel. The coefficient of a series counts in σ of the noise that the configuration
/// states there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Port {
    /// The gyro, in σ of its drift.
    #[default]
    Gyro,
    /// The accelerometer, in σ of its error.
    Accelerometer,
    /// The velocity measurement, in its σ.
    Velocity,
}

/// A possible cause of what the velocity channel shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Regressor {
    /// What the error follows.
    pub series: Series,
    /// Whose error it is.
    pub port: Port,
}

/// The sums' dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SumsConfig {
    /// Thermometer of the temperature.
    pub thermometer: u8,
    /// Accelerometer of the specific force.
    pub accelerometer: u8,
    /// Constants of the two lags of the temperature, s.
    pub lags_s: [f32; 2],
    /// What the velocity channel is compared with. The parity channels are compared with [`Series::ALL`].
    pub velocity: [Regressor; SERIES],
}

impl Default for SumsConfig {
    fn default() -> Self {
        let gyro = |series| Regressor { series, port: Port::Gyro };
        let accelerometer = |series| Regressor { series, port: Port::Accelerometer };
        Self {
            thermometer: 0,
            accelerometer: 0,
            lags_s: [300.0, 1800.0],
            velocity: [
                gyro(Series::Constant),
                gyro(Series::Time),
                gyro(Series::Temperature),
                gyro(Series::TemperatureRate),
                gyro(Series::SlowLag),
                accelerometer(Series::Temperature),
                accelerometer(Series::TemperatureRate),
                accelerometer(Series::Force),
            ],
        }
    }
}

impl SumsConfig {
    /// All zeros, before there is any.
    pub(super) const IDLE: Self = Self {
        thermometer: 0,
        accelerometer: 0,
        lags_s: [0.0; 2],
        velocity: [Regressor { series: Series::Constant, port: Port::Gyro }; SERIES],
    };

    /// Whether the sums can be built from this.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let below = |field, index: u8, count| {
            if usize::from(index) < count {
                Ok(())
            } else {
                Err(ConfigError::new(field, Problem::OutOfRange))
            }
        };
        below("sums.thermometer", self.thermometer, THERMOMETERS)?;
        below("sums.accelerometer", self.accelerometer, ACCELEROMETERS)?;
        self.lags_s.iter().try_for_each(|&lag_s| positive("sums.lags_s", lag_s))
    }
}

saved_choice!(Series { Constant, Time, Temperature, TemperatureRate, FastLag, SlowLag, Force, ForceSquared });
saved_choice!(Port { Gyro, Accelerometer, Velocity });
saved!([] Regressor { series, port });
saved!([] SumsConfig {
    thermometer < THERMOMETERS,
    accelerometer < ACCELEROMETERS,
    lags_s,
    velocity,
});
