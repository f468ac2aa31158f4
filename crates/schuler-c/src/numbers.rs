//! The numbers that stand for flags and choices. Test `header` holds those of flags to the flags of `schuler-core`; the compiler holds
//! the choices to theirs where they are translated (`output`).

/// What was out of the ordinary in a step: the sum of SCHULER_STATUS_.
pub type SchulerStatus = u32;
/// No usable velocity measurement: missing or not a number.
pub const SCHULER_STATUS_VELOCITY_MISSING: SchulerStatus = 1;
/// The velocity measurement was at the end of its range and was not used.
pub const SCHULER_STATUS_VELOCITY_SATURATED: SchulerStatus = 2;
/// The velocity measurement was too old and was not used.
pub const SCHULER_STATUS_VELOCITY_STALE: SchulerStatus = 4;
/// The innovation was beyond the gate and was not used.
pub const SCHULER_STATUS_INNOVATION_GATED: SchulerStatus = 8;
/// The covariance lost its positive diagonal and was reset.
pub const SCHULER_STATUS_COVARIANCE_RESET: SchulerStatus = 16;
/// The time of the step ran backwards or repeated; the step was taken as one nominal step without measurement.
pub const SCHULER_STATUS_CLOCK_BACKWARDS: SchulerStatus = 32;
/// Steps were missing before this one; the filter has coasted over them.
pub const SCHULER_STATUS_STEPS_MISSING: SchulerStatus = 64;
/// More steps were missing than can be bridged, or the clock has jumped: the velocity started from the
/// measurement and the identification anew.
pub const SCHULER_STATUS_CLOCK_JUMPED: SchulerStatus = 128;
/// So many innovations in a row were beyond the gate that the filter started from the measurement.
pub const SCHULER_STATUS_VELOCITY_REACQUIRED: SchulerStatus = 256;
/// The filter was retuned after this step's measurement.
pub const SCHULER_STATUS_RETUNED: SchulerStatus = 512;
/// The module has no configuration; nothing was computed.
pub const SCHULER_STATUS_NOT_CONFIGURED: SchulerStatus = 1024;
/// A compensation block was loaded before this step.
pub const SCHULER_STATUS_COMPENSATION_LOADED: SchulerStatus = 2048;
/// That block, or the one before it, acts on the velocity channel, which has therefore started anew.
pub const SCHULER_STATUS_VELOCITY_RESTARTED: SchulerStatus = 4096;
/// The velocity measurement could have been used and was not, as the radio behind it is held faulty.
pub const SCHULER_STATUS_VELOCITY_WITHHELD: SchulerStatus = 8192;

/// Why the verdict on the gyros is what it is, and what happened in this step: the sum of SCHULER_ISOLATION_.
pub type SchulerIsolationFlags = u16;
/// A reading could not be used: missing, saturated, beyond the range or not a number.
pub const SCHULER_ISOLATION_READING_UNUSABLE: SchulerIsolationFlags = 1;
/// This sample is beyond the single-sample threshold.
pub const SCHULER_ISOLATION_OUTLIER: SchulerIsolationFlags = 2;
/// This step raised an alarm.
pub const SCHULER_ISOLATION_ALARM_RAISED: SchulerIsolationFlags = 4;
/// This step found the gyro that has failed.
pub const SCHULER_ISOLATION_ISOLATED: SchulerIsolationFlags = 8;
/// Isolation was given up; the alarm stands.
pub const SCHULER_ISOLATION_GIVEN_UP: SchulerIsolationFlags = 16;
/// The remaining four gyros disagree.
pub const SCHULER_ISOLATION_SECOND_FAULT: SchulerIsolationFlags = 32;
/// A gyro is stuck.
pub const SCHULER_ISOLATION_STUCK: SchulerIsolationFlags = 64;
/// A gyro has been silent for too long.
pub const SCHULER_ISOLATION_LOST: SchulerIsolationFlags = 128;
/// Most gyros repeat their reading: a block at rest within its quantisation, or frozen data.
pub const SCHULER_ISOLATION_FROZEN: SchulerIsolationFlags = 256;
/// The rate is above the limit, or the block is frozen: nothing adds up this sample but outliers.
pub const SCHULER_ISOLATION_SUMS_SUSPENDED: SchulerIsolationFlags = 512;
/// The constant parity is being measured.
pub const SCHULER_ISOLATION_CALIBRATING: SchulerIsolationFlags = 1024;
/// The constant parity that was measured is too large to be one and was not taken.
pub const SCHULER_ISOLATION_OFFSET_REJECTED: SchulerIsolationFlags = 2048;
/// This step took gyros back into the block.
pub const SCHULER_ISOLATION_READMITTED: SchulerIsolationFlags = 4096;
/// The ground named a gyro that does not exist.
pub const SCHULER_ISOLATION_COMMAND_REJECTED: SchulerIsolationFlags = 8192;
/// This step withdrew the alarm: the samples since speak against the fault that raised it.
pub const SCHULER_ISOLATION_ALARM_WITHDRAWN: SchulerIsolationFlags = 16384;

/// What was out of the ordinary at a thermometer: the sum of SCHULER_THERMAL_.
pub type SchulerThermalStatus = u8;
/// No reading could be used yet; the outputs are zero.
pub const SCHULER_THERMAL_NO_READING: SchulerThermalStatus = 1;
/// Entries of the start (rate zero at power-on) are still in use: the rate is not to be trusted.
pub const SCHULER_THERMAL_SETTLING: SchulerThermalStatus = 2;
/// This step's reading was missing, not a temperature, or not newer than the last; the outputs are the last ones.
pub const SCHULER_THERMAL_REJECTED: SchulerThermalStatus = 4;
/// The estimator started anew, after a gap or a clock set back.
pub const SCHULER_THERMAL_RESTARTED: SchulerThermalStatus = 8;
/// The noise of the readings makes their level jump to and fro most of the time, where the fit of level changes
/// loses: the outputs come from a constant-rate Kalman filter of all readings instead.
pub const SCHULER_THERMAL_DITHER: SchulerThermalStatus = 16;

/// What limited the calibration of a complete unit: the sum of SCHULER_CALIBRATION_.
pub type SchulerCalibrationStatus = u8;
/// The temperature is not known: taken as the reference.
pub const SCHULER_CALIBRATION_NO_TEMPERATURE: SchulerCalibrationStatus = 1;
/// The rate is not known or not settled: taken as zero.
pub const SCHULER_CALIBRATION_NO_RATE: SchulerCalibrationStatus = 2;
/// The gradient is not known: taken as zero.
pub const SCHULER_CALIBRATION_NO_GRADIENT: SchulerCalibrationStatus = 4;
/// Outside the range of the calibration: the linear laws are extrapolated, by a quarter of the range of
/// temperature and half of the limits of rate and gradient at most.
pub const SCHULER_CALIBRATION_OUT_OF_RANGE: SchulerCalibrationStatus = 8;

/// What limited the terms of the compensation: the sum of SCHULER_TERMS_.
pub type SchulerTermStatus = u8;
/// What a term is proportional to is not known: the term counted as zero.
pub const SCHULER_TERMS_INPUT_MISSING: SchulerTermStatus = 1;
/// A temperature or a rate is outside the validity, and was held.
pub const SCHULER_TERMS_OUT_OF_RANGE: SchulerTermStatus = 2;
/// A correction was beyond its limit and was held there, or was not a number and was left out.
pub const SCHULER_TERMS_LIMITED: SchulerTermStatus = 4;

/// Alarms of the health monitor that are on: the sum of SCHULER_ALARM_. Each is set and cleared with hysteresis.
pub type SchulerHealthAlarms = u8;
/// The mean of the radio's error has shifted.
pub const SCHULER_ALARM_JUMP: SchulerHealthAlarms = 1;
/// The radio's noise has grown to a degraded level.
pub const SCHULER_ALARM_NOISE: SchulerHealthAlarms = 2;
/// Any of jump, noise and memory, even where it is open which.
pub const SCHULER_ALARM_FAULT: SchulerHealthAlarms = 4;
/// The inertial error is beyond its specified bound.
pub const SCHULER_ALARM_INERTIAL: SchulerHealthAlarms = 8;
/// The radio holds its last value.
pub const SCHULER_ALARM_MEMORY: SchulerHealthAlarms = 16;

/// What was out of the ordinary in a step of the health monitor: the sum of SCHULER_HEALTH_STATUS_.
pub type SchulerHealthStatus = u8;
/// No usable radio reading: missing, saturated, too old or not a number.
pub const SCHULER_HEALTH_STATUS_RADIO_UNUSABLE: SchulerHealthStatus = 1;
/// No usable inertial reading.
pub const SCHULER_HEALTH_STATUS_INERTIAL_UNUSABLE: SchulerHealthStatus = 2;
/// The residual was beyond the gate of every mode and was not used.
pub const SCHULER_HEALTH_STATUS_OUT_OF_MODEL: SchulerHealthStatus = 4;
/// More than one step since the last call; the model was moved over the gap.
pub const SCHULER_HEALTH_STATUS_GAP: SchulerHealthStatus = 8;
/// No step since the last call; the readings were not used again.
pub const SCHULER_HEALTH_STATUS_REPEATED: SchulerHealthStatus = 16;
/// No usable residual for too long: started again from the priors.
pub const SCHULER_HEALTH_STATUS_RESTARTED: SchulerHealthStatus = 32;
/// The numbers were no longer sound: started again from the priors.
pub const SCHULER_HEALTH_STATUS_NUMERICAL_RESET: SchulerHealthStatus = 64;

/// What to believe of the gyro block: one of SCHULER_GYRO_VERDICT_.
pub type SchulerGyroVerdict = u8;
/// Nothing speaks against any gyro.
pub const SCHULER_GYRO_VERDICT_NO_FAULT: SchulerGyroVerdict = 0;
/// One gyro or more has failed; which one cannot be said (yet).
pub const SCHULER_GYRO_VERDICT_DETECTED_NOT_ISOLATED: SchulerGyroVerdict = 1;
/// The gyro fault_gyro has failed, or could not be read; the rate is that of the other four.
pub const SCHULER_GYRO_VERDICT_FAULT: SchulerGyroVerdict = 2;
/// Two gyros or more have failed or could not be read: there is no rate.
pub const SCHULER_GYRO_VERDICT_BLOCK_UNTRUSTED: SchulerGyroVerdict = 3;

/// State of the radio and the inertial sensor: one of SCHULER_HEALTH_VERDICT_.
pub type SchulerHealthVerdict = u8;
/// No residual yet, or none for longer than can be bridged.
pub const SCHULER_HEALTH_VERDICT_UNOBSERVED: SchulerHealthVerdict = 0;
/// Nothing found.
pub const SCHULER_HEALTH_VERDICT_NOMINAL: SchulerHealthVerdict = 1;
/// The mean of the radio's error has shifted.
pub const SCHULER_HEALTH_VERDICT_SHIFTED_MEAN: SchulerHealthVerdict = 2;
/// The radio's noise has grown.
pub const SCHULER_HEALTH_VERDICT_GROWN_NOISE: SchulerHealthVerdict = 3;
/// Both.
pub const SCHULER_HEALTH_VERDICT_SHIFTED_MEAN_AND_GROWN_NOISE: SchulerHealthVerdict = 4;
/// One of them, still open which.
pub const SCHULER_HEALTH_VERDICT_UNDECIDED_FAULT: SchulerHealthVerdict = 5;
/// The slow part of the difference is beyond what the inertial sensor is specified for.
pub const SCHULER_HEALTH_VERDICT_INERTIAL_DIVERGENCE: SchulerHealthVerdict = 6;
/// Several residuals in a row that no mode explains.
pub const SCHULER_HEALTH_VERDICT_OUT_OF_MODEL: SchulerHealthVerdict = 7;
/// The radio holds its last value.
pub const SCHULER_HEALTH_VERDICT_HELD_READING: SchulerHealthVerdict = 8;

/// Whom the health monitor blames: one of SCHULER_SUSPECT_.
pub type SchulerSuspect = u8;
/// Nobody.
pub const SCHULER_SUSPECT_NEITHER: SchulerSuspect = 0;
/// The radio sensor.
pub const SCHULER_SUSPECT_RADIO: SchulerSuspect = 1;
/// The inertial sensor.
pub const SCHULER_SUSPECT_INERTIAL: SchulerSuspect = 2;
/// One of them, and these data cannot tell which.
pub const SCHULER_SUSPECT_EITHER: SchulerSuspect = 3;

/// How well the noise parameters of a sensor are known: one of SCHULER_NOISE_.
pub type SchulerNoiseStatus = u8;
/// Not identified yet: the data sheet is flown.
pub const SCHULER_NOISE_DATA_SHEET: SchulerNoiseStatus = 0;
/// Three times the correlation time, and a third of it, are both clearly worse.
pub const SCHULER_NOISE_DETERMINED: SchulerNoiseStatus = 1;
/// Only one of the two is.
pub const SCHULER_NOISE_WEAK: SchulerNoiseStatus = 2;
/// Neither is: the prior has decided.
pub const SCHULER_NOISE_INDETERMINATE: SchulerNoiseStatus = 3;
/// The filter's estimate holds next to nothing of this error; its parameters were left as they were.
pub const SCHULER_NOISE_UNOBSERVED: SchulerNoiseStatus = 4;

/// Where the averaged estimate comes from: one of SCHULER_SOURCE_.
pub type SchulerEstimateSource = u8;
/// The filter, with the noise parameters in use: no bank has anything to say.
pub const SCHULER_SOURCE_FILTER: SchulerEstimateSource = 0;
/// The wide bank, over everything that the data sheet allows.
pub const SCHULER_SOURCE_WIDE_BANK: SchulerEstimateSource = 1;
/// The narrow bank around the parameters that were identified.
pub const SCHULER_SOURCE_NARROW_BANK: SchulerEstimateSource = 2;
