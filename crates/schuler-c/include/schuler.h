// The flight module, for flight software in C. Example: crates/schuler-c/examples/flight/main.c.
//
// A module lives in memory of the caller, best a static; the library has no heap and no globals, never blocks and never
// panics. Once a second: fill a SchulerInput, call schuler_step, use the SchulerOutput. Configuration and compensation
// come as blocks of bytes that the ground has made and sealed.
//
// Every function checks its pointers for null and alignment, and the module for having been initialised. A pointer that
// passes must point to memory of its type or length that the program may use, and that nothing else uses during the
// call. Calls on different modules may run at the same time; calls on one module must not, interrupts included.


#ifndef SCHULER_H
#define SCHULER_H

/* Made from the sources of schuler-c by its test `header`: do not edit. */

#include <stddef.h>
#include <stdint.h>

// Version of this interface: functions, structures, and what their bytes mean. Hand it to schuler_init.
#define SCHULER_INTERFACE_VERSION 2

// Number of gyros in the block.
#define SCHULER_GYROS 5

// Number of accelerometers.
#define SCHULER_ACCELEROMETERS 3

// Number of thermometers.
#define SCHULER_THERMOMETERS 4

// Size of an input, bytes.
#define SCHULER_INPUT_SIZE 224

// Size of a module, bytes: enough on machines of 32 and of 64 bits.
#define SCHULER_MODULE_SIZE 47872

// Number of states of the error filter.
#define SCHULER_STATES 4

// Levels of noise that the health monitor tells apart: normal and degraded.
#define SCHULER_HEALTH_LEVELS 2

// No gyro has this number.
#define SCHULER_NO_GYRO 255

// Size of an output, bytes.
#define SCHULER_OUTPUT_SIZE 544

// What a call answers. After anything but SCHULER_RESULT_OK the module is as it was before the call, unless said otherwise there.
enum SchulerResult
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Done.
    SCHULER_RESULT_OK = 0,
    // A pointer is null.
    SCHULER_RESULT_NULL_POINTER = 1,
    // A pointer does not have the alignment of its type.
    SCHULER_RESULT_MISALIGNED = 2,
    // The memory for the module is smaller than this library needs: it was compiled with the header of another version.
    SCHULER_RESULT_SIZE = 3,
    // The caller was compiled with the header of another version.
    SCHULER_RESULT_INTERFACE_VERSION = 4,
    // schuler_init has not been called on this memory, or something has written over it.
    SCHULER_RESULT_NOT_INITIALISED = 5,
    // The module has no configuration.
    SCHULER_RESULT_NOT_CONFIGURED = 6,
    // The bytes are not a block or state of the expected kind, or are cut short, or have something behind them.
    SCHULER_RESULT_FORM = 7,
    // The bytes do not fit their checksum.
    SCHULER_RESULT_CHECKSUM = 8,
    // The bytes are of another version than this library.
    SCHULER_RESULT_VERSION = 9,
    // The bytes fit their checksum, but say something that cannot be.
    SCHULER_RESULT_CONTENT = 10,
    // A value cannot be flown; schuler_refusal says which and why.
    SCHULER_RESULT_REFUSED = 11,
    // The state is that of a module with another configuration.
    SCHULER_RESULT_OTHER_CONFIGURATION = 12,
    // There is less room than is needed.
    SCHULER_RESULT_ROOM = 13,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum SchulerResult SchulerResult;
#else
typedef uint32_t SchulerResult;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// The memory of a module; give it a static. What is in it is the library's business alone. It must not be copied or moved in use;
// schuler_save and schuler_restore carry a state over.
typedef struct {
    // Of the library.
    uint64_t private_words[5984];
} SchulerModule;

// What the interface electronics say of a reading: one of SCHULER_QUALITY_. Any other number counts as missing.
typedef uint8_t SchulerQuality;

// One reading in double precision. A value that is not a number counts as missing.
typedef struct {
    // The value, in the unit of the channel; looked at only where the quality is good.
    double value;
    // Age of the value at the instant of the step, milliseconds. Readings older than the configuration allows are not used.
    uint32_t age_ms;
    // What the interface electronics say of the value.
    SchulerQuality quality;
    // Not looked at.
    uint8_t reserved[3];
} SchulerReading;

// One reading in single precision. A value that is not a number counts as missing.
typedef struct {
    // The value, in the unit of the channel; looked at only where the quality is good.
    float value;
    // Age of the value at the instant of the step, milliseconds. Readings older than the configuration allows are not used.
    uint32_t age_ms;
    // What the interface electronics say of the value.
    SchulerQuality quality;
    // Not looked at.
    uint8_t reserved[3];
} SchulerReadingSingle;

// A command from the ground: one of SCHULER_COMMAND_. Any other number counts as none.
typedef uint8_t SchulerCommand;

// What the navigation computer hands over once a second. All zeros are an input without readings at time zero. Whatever the bytes,
// the module stays usable.
typedef struct {
    // Time of the step since power-on, milliseconds. The module has no other clock: a gap is a gap in these times.
    uint64_t time_ms;
    // Rates of the gyros along their input axes, rad/s.
    SchulerReading gyros[SCHULER_GYROS];
    // Specific forces along the accelerometers' input axes, m/s^2. Only the compensation looks at them.
    SchulerReading accelerometers[SCHULER_ACCELEROMETERS];
    // Inertial velocity minus reference velocity in the channel, m/s.
    SchulerReadingSingle velocity_error;
    // Temperatures, degrees Celsius.
    SchulerReadingSingle thermometers[SCHULER_THERMOMETERS];
    // Velocity that a radio sensor (Doppler, satellite) measures, m/s; for the health monitor.
    SchulerReadingSingle radio_velocity;
    // Velocity along the same axis from an inertial sensor, m/s; for the health monitor. Of both only the difference counts.
    SchulerReadingSingle inertial_velocity;
    // A command from the ground, carried out in the step that brings it.
    SchulerCommand command;
    // The gyro that the command is about, counted from zero.
    uint8_t command_gyro;
    // Not looked at.
    uint8_t reserved[2];
} SchulerInput;

// Why the verdict on the gyros is what it is, and what happened in this step: the sum of SCHULER_ISOLATION_.
typedef uint16_t SchulerIsolationFlags;

// What to believe of the gyro block: one of SCHULER_GYRO_VERDICT_.
typedef uint8_t SchulerGyroVerdict;

// Gyro block. Gyros count from zero.
typedef struct {
    // Body rate from the gyros in use, rad/s; zero when gyros_used is zero: then there is none.
    double rate[3];
    // 1-sigma of the rate from the noise of the gyros in use, rad/s; zero when there is none.
    double rate_sigma[3];
    // Parity vector of the five gyros in standard deviations; zero unless all five could be read.
    double parity[2];
    // Parity of the block without gyro j, in standard deviations; zero when another gyro could not be read.
    double determinants[SCHULER_GYROS];
    // The detection statistic nearest to its threshold, over the threshold; an alarm is raised beyond one.
    double alarm_level;
    // Lead of the likeliest gyro over the next in the evidence of the alarm; zero without an alarm.
    double margin;
    // Size of the fault of the excluded gyro, rad/s; zero while no single gyro is excluded.
    double fault_size;
    // 1-sigma of the fault size, rad/s; zero when there is no size.
    double fault_sigma;
    // Why, and what happened.
    SchulerIsolationFlags flags;
    // What to believe.
    SchulerGyroVerdict verdict;
    // The gyro of SCHULER_GYRO_VERDICT_FAULT; SCHULER_NO_GYRO with every other verdict.
    uint8_t fault_gyro;
    // Gyros that the rate comes from, one bit a gyro; zero: there is no rate.
    uint8_t gyros_used;
    // Gyros declared faulty, one bit a gyro: they stay out until they are taken back.
    uint8_t excluded;
    // Zero.
    uint8_t reserved[2];
} SchulerIsolationOutput;

// What limited the calibration of a complete unit: the sum of SCHULER_CALIBRATION_.
typedef uint8_t SchulerCalibrationStatus;

// What limited the terms of the compensation: the sum of SCHULER_TERMS_.
typedef uint8_t SchulerTermStatus;

// Corrected inputs.
typedef struct {
    // Corrected rates of the gyros, rad/s; zero where there is no reading that can be used.
    double gyros[SCHULER_GYROS];
    // Corrected specific forces, m/s^2; zero where there is no reading that can be used.
    double accelerometers[SCHULER_ACCELEROMETERS];
    // What was taken off the velocity error as error of its measurement, m/s.
    float velocity;
    // Known error of the accelerometer within the Schuler loop, m/s^2.
    float loop_accelerometer;
    // Known error of the gyro within the Schuler loop, rad/s.
    float loop_gyro;
    // One where a block is loaded; without, the corrected values are those that came in.
    uint8_t loaded;
    // What limited the calibration of a complete unit; zero without one.
    SchulerCalibrationStatus calibration;
    // What limited the terms.
    SchulerTermStatus terms;
    // Zero.
    uint8_t reserved;
} SchulerCompensationOutput;

// Estimates and standard deviations of the four states, in this order: velocity error, m/s; vertical error, rad; accelerometer error,
// m/s^2; gyro drift, rad/s.
typedef struct {
    // Estimates.
    float estimate[SCHULER_STATES];
    // 1-sigma.
    float sigma[SCHULER_STATES];
} SchulerEstimate;

// Error filter with the noise parameters in use. The estimate includes what the compensation knows.
typedef struct {
    // The states.
    SchulerEstimate states;
    // Innovation, m/s; zero when there was no measurement.
    float innovation;
    // Its variance, (m/s)^2.
    float innovation_variance;
    // Innovation squared over its variance; zero when there was no measurement.
    float nis;
} SchulerFilterOutput;

// How well the noise parameters of a sensor are known: one of SCHULER_NOISE_.
typedef uint8_t SchulerNoiseStatus;

// The noise in use for one sensor: correlation sigma^2 exp(-alpha |t|) cos(beta t).
typedef struct {
    // Standard deviation, m/s^2 for the accelerometer, rad/s for the gyro.
    float sigma;
    // Rate of decay, 1/s.
    float alpha;
    // Angular frequency, rad/s; zero for a first-order process.
    float beta;
    // How well these are known.
    SchulerNoiseStatus status;
    // Zero.
    uint8_t reserved[3];
} SchulerNoise;

// Where the averaged estimate comes from: one of SCHULER_SOURCE_.
typedef uint8_t SchulerEstimateSource;

// Noise identification.
typedef struct {
    // The estimate to navigate by: averaged over what is not known of the noise parameters, with that in its sigma.
    SchulerEstimate averaged;
    // Accelerometer noise in use.
    SchulerNoise accelerometer;
    // Gyro noise in use.
    SchulerNoise gyro;
    // How often the filter has been retuned.
    uint16_t retunes;
    // Where the averaged estimate comes from.
    SchulerEstimateSource averaged_source;
    // Zero.
    uint8_t reserved;
} SchulerIdentificationOutput;

// What was out of the ordinary at a thermometer: the sum of SCHULER_THERMAL_.
typedef uint8_t SchulerThermalStatus;

// Temperature and its rate at one thermometer; zero before its first reading.
typedef struct {
    // Temperature, degrees Celsius.
    float temperature;
    // Rate of the temperature, degrees Celsius per second.
    float rate;
    // 1-sigma of the temperature, degrees Celsius; nominal.
    float temperature_sigma;
    // 1-sigma of the rate, degrees Celsius per second; nominal, pessimistic in slow change, optimistic after a step of heat.
    float rate_sigma;
    // What was out of the ordinary.
    SchulerThermalStatus status;
    // Zero.
    uint8_t reserved[3];
} SchulerThermometerOutput;

// A value and its 1-sigma, both in the value's unit.
typedef struct {
    // The value.
    float value;
    // Its standard deviation.
    float sigma;
} SchulerValue;

// State of the radio and the inertial sensor: one of SCHULER_HEALTH_VERDICT_.
typedef uint8_t SchulerHealthVerdict;

// Whom the health monitor blames: one of SCHULER_SUSPECT_.
typedef uint8_t SchulerSuspect;

// Alarms of the health monitor that are on: the sum of SCHULER_ALARM_. Each is set and cleared with hysteresis.
typedef uint8_t SchulerHealthAlarms;

// What was out of the ordinary in a step of the health monitor: the sum of SCHULER_HEALTH_STATUS_.
typedef uint8_t SchulerHealthStatus;

// Radio sensor against inertial sensor. Without a health configuration it runs on missing readings.
typedef struct {
    // Posterior probability of each mode: first index jump absent, present; second index level of noise.
    float mode_probability[2][SCHULER_HEALTH_LEVELS];
    // Probability that the radio's mean is shifted.
    float p_jump;
    // Probability that the radio's noise is at a degraded level.
    float p_noise;
    // Probability that the radio holds its last value.
    float p_memory;
    // Probability of any of them.
    float p_fault;
    // Radio error, m/s; without a residual its prediction.
    SchulerValue radio_error;
    // Inertial error, m/s.
    SchulerValue inertial_error;
    // Jump of the radio's mean, weighted with its probability, m/s.
    SchulerValue jump;
    // Inertial drift, m/s^2.
    SchulerValue inertial_drift;
    // Correlated part of the radio error, m/s.
    SchulerValue correlated_error;
    // The measured velocity, corrected, m/s; zero unless corrected_valid.
    SchulerValue corrected;
    // Radio less inertial reading, m/s; zero if there was none.
    float residual;
    // Residual less its prediction over all modes, m/s; zero if there was no residual.
    float innovation;
    // Variance of that prediction, (m/s)^2.
    float innovation_variance;
    // Innovation squared over its variance, held at 1e12. The prediction is a mixture: this is not chi-squared.
    float nis;
    // Natural logarithm of the residual's predictive density, density in 1/(m/s); zero if it was not used.
    float log_likelihood;
    // What the sensors are thought to be in.
    SchulerHealthVerdict verdict;
    // Whom the model blames for it.
    SchulerSuspect suspect;
    // Alarms that are on.
    SchulerHealthAlarms alarms;
    // What was out of the ordinary in this step.
    SchulerHealthStatus status;
    // One where there was a usable reading to correct, zero where not.
    uint8_t corrected_valid;
    // Zero.
    uint8_t reserved[3];
} SchulerHealthOutput;

// What was out of the ordinary in a step: the sum of SCHULER_STATUS_.
typedef uint32_t SchulerStatus;

// What the module gives back. No number is ever NaN or infinite; where there is no value, there is zero, and flags say so. There is no
// padding: the bytes are defined to the last one, and the same inputs give the same bytes on every little-endian machine.
typedef struct {
    // Steps since configuration, this one included; a restored state counts on.
    uint64_t step;
    // Time of the step, as it came in, milliseconds.
    uint64_t time_ms;
    // Gyro block.
    SchulerIsolationOutput isolation;
    // Corrected gyros and accelerometers.
    SchulerCompensationOutput compensation;
    // Error filter.
    SchulerFilterOutput filter;
    // Noise identification.
    SchulerIdentificationOutput identification;
    // Temperature and its rate at each thermometer.
    SchulerThermometerOutput thermometers[SCHULER_THERMOMETERS];
    // Radio sensor against inertial sensor.
    SchulerHealthOutput health;
    // What was out of the ordinary.
    SchulerStatus status;
} SchulerOutput;

// No value this step. The quality of an input of zeros.
#define SCHULER_QUALITY_MISSING 0

// Converted and within range.
#define SCHULER_QUALITY_GOOD 1

// At the end of the converter's range: the true value is at least this large.
#define SCHULER_QUALITY_SATURATED 2

// Nothing.
#define SCHULER_COMMAND_NONE 0

// Take the gyro command_gyro, counted from zero, back into the block. A number that no gyro has is refused in the output, by
// SCHULER_ISOLATION_COMMAND_REJECTED.
#define SCHULER_COMMAND_READMIT_GYRO 1

// No usable velocity measurement: missing or not a number.
#define SCHULER_STATUS_VELOCITY_MISSING 1

// The velocity measurement was at the end of its range and was not used.
#define SCHULER_STATUS_VELOCITY_SATURATED 2

// The velocity measurement was too old and was not used.
#define SCHULER_STATUS_VELOCITY_STALE 4

// The innovation was beyond the gate and was not used.
#define SCHULER_STATUS_INNOVATION_GATED 8

// The covariance lost its positive diagonal and was reset.
#define SCHULER_STATUS_COVARIANCE_RESET 16

// The time of the step ran backwards or repeated; the step was taken as one nominal step without measurement.
#define SCHULER_STATUS_CLOCK_BACKWARDS 32

// Steps were missing before this one; the filter has coasted over them.
#define SCHULER_STATUS_STEPS_MISSING 64

// More steps were missing than can be bridged, or the clock has jumped: the velocity started from the
// measurement and the identification anew.
#define SCHULER_STATUS_CLOCK_JUMPED 128

// So many innovations in a row were beyond the gate that the filter started from the measurement.
#define SCHULER_STATUS_VELOCITY_REACQUIRED 256

// The filter was retuned after this step's measurement.
#define SCHULER_STATUS_RETUNED 512

// The module has no configuration; nothing was computed.
#define SCHULER_STATUS_NOT_CONFIGURED 1024

// A compensation block was loaded before this step.
#define SCHULER_STATUS_COMPENSATION_LOADED 2048

// That block, or the one before it, acts on the velocity channel, which has therefore started anew.
#define SCHULER_STATUS_VELOCITY_RESTARTED 4096

// The velocity measurement could have been used and was not, as the radio behind it is held faulty.
#define SCHULER_STATUS_VELOCITY_WITHHELD 8192

// A reading could not be used: missing, saturated, beyond the range or not a number.
#define SCHULER_ISOLATION_READING_UNUSABLE 1

// This sample is beyond the single-sample threshold.
#define SCHULER_ISOLATION_OUTLIER 2

// This step raised an alarm.
#define SCHULER_ISOLATION_ALARM_RAISED 4

// This step found the gyro that has failed.
#define SCHULER_ISOLATION_ISOLATED 8

// Isolation was given up; the alarm stands.
#define SCHULER_ISOLATION_GIVEN_UP 16

// The remaining four gyros disagree.
#define SCHULER_ISOLATION_SECOND_FAULT 32

// A gyro is stuck.
#define SCHULER_ISOLATION_STUCK 64

// A gyro has been silent for too long.
#define SCHULER_ISOLATION_LOST 128

// Most gyros repeat their reading: a block at rest within its quantisation, or frozen data.
#define SCHULER_ISOLATION_FROZEN 256

// The rate is above the limit, or the block is frozen: nothing adds up this sample but outliers.
#define SCHULER_ISOLATION_SUMS_SUSPENDED 512

// The constant parity is being measured.
#define SCHULER_ISOLATION_CALIBRATING 1024

// The constant parity that was measured is too large to be one and was not taken.
#define SCHULER_ISOLATION_OFFSET_REJECTED 2048

// This step took gyros back into the block.
#define SCHULER_ISOLATION_READMITTED 4096

// The ground named a gyro that does not exist.
#define SCHULER_ISOLATION_COMMAND_REJECTED 8192

// This step withdrew the alarm: the samples since speak against the fault that raised it.
#define SCHULER_ISOLATION_ALARM_WITHDRAWN 16384

// No reading could be used yet; the outputs are zero.
#define SCHULER_THERMAL_NO_READING 1

// Entries of the start (rate zero at power-on) are still in use: the rate is not to be trusted.
#define SCHULER_THERMAL_SETTLING 2

// This step's reading was missing, not a temperature, or not newer than the last; the outputs are the last ones.
#define SCHULER_THERMAL_REJECTED 4

// The estimator started anew, after a gap or a clock set back.
#define SCHULER_THERMAL_RESTARTED 8

// The noise of the readings makes their level jump to and fro most of the time, where the fit of level changes
// loses: the outputs come from a constant-rate Kalman filter of all readings instead.
#define SCHULER_THERMAL_DITHER 16

// The temperature is not known: taken as the reference.
#define SCHULER_CALIBRATION_NO_TEMPERATURE 1

// The rate is not known or not settled: taken as zero.
#define SCHULER_CALIBRATION_NO_RATE 2

// The gradient is not known: taken as zero.
#define SCHULER_CALIBRATION_NO_GRADIENT 4

// Outside the range of the calibration: the linear laws are extrapolated, by a quarter of the range of
// temperature and half of the limits of rate and gradient at most.
#define SCHULER_CALIBRATION_OUT_OF_RANGE 8

// What a term is proportional to is not known: the term counted as zero.
#define SCHULER_TERMS_INPUT_MISSING 1

// A temperature or a rate is outside the validity, and was held.
#define SCHULER_TERMS_OUT_OF_RANGE 2

// A correction was beyond its limit and was held there, or was not a number and was left out.
#define SCHULER_TERMS_LIMITED 4

// The mean of the radio's error has shifted.
#define SCHULER_ALARM_JUMP 1

// The radio's noise has grown to a degraded level.
#define SCHULER_ALARM_NOISE 2

// Any of jump, noise and memory, even where it is open which.
#define SCHULER_ALARM_FAULT 4

// The inertial error is beyond its specified bound.
#define SCHULER_ALARM_INERTIAL 8

// The radio holds its last value.
#define SCHULER_ALARM_MEMORY 16

// No usable radio reading: missing, saturated, too old or not a number.
#define SCHULER_HEALTH_STATUS_RADIO_UNUSABLE 1

// No usable inertial reading.
#define SCHULER_HEALTH_STATUS_INERTIAL_UNUSABLE 2

// The residual was beyond the gate of every mode and was not used.
#define SCHULER_HEALTH_STATUS_OUT_OF_MODEL 4

// More than one step since the last call; the model was moved over the gap.
#define SCHULER_HEALTH_STATUS_GAP 8

// No step since the last call; the readings were not used again.
#define SCHULER_HEALTH_STATUS_REPEATED 16

// No usable residual for too long: started again from the priors.
#define SCHULER_HEALTH_STATUS_RESTARTED 32

// The numbers were no longer sound: started again from the priors.
#define SCHULER_HEALTH_STATUS_NUMERICAL_RESET 64

// Nothing speaks against any gyro.
#define SCHULER_GYRO_VERDICT_NO_FAULT 0

// One gyro or more has failed; which one cannot be said (yet).
#define SCHULER_GYRO_VERDICT_DETECTED_NOT_ISOLATED 1

// The gyro fault_gyro has failed, or could not be read; the rate is that of the other four.
#define SCHULER_GYRO_VERDICT_FAULT 2

// Two gyros or more have failed or could not be read: there is no rate.
#define SCHULER_GYRO_VERDICT_BLOCK_UNTRUSTED 3

// No residual yet, or none for longer than can be bridged.
#define SCHULER_HEALTH_VERDICT_UNOBSERVED 0

// Nothing found.
#define SCHULER_HEALTH_VERDICT_NOMINAL 1

// The mean of the radio's error has shifted.
#define SCHULER_HEALTH_VERDICT_SHIFTED_MEAN 2

// The radio's noise has grown.
#define SCHULER_HEALTH_VERDICT_GROWN_NOISE 3

// Both.
#define SCHULER_HEALTH_VERDICT_SHIFTED_MEAN_AND_GROWN_NOISE 4

// One of them, still open which.
#define SCHULER_HEALTH_VERDICT_UNDECIDED_FAULT 5

// The slow part of the difference is beyond what the inertial sensor is specified for.
#define SCHULER_HEALTH_VERDICT_INERTIAL_DIVERGENCE 6

// Several residuals in a row that no mode explains.
#define SCHULER_HEALTH_VERDICT_OUT_OF_MODEL 7

// The radio holds its last value.
#define SCHULER_HEALTH_VERDICT_HELD_READING 8

// Nobody.
#define SCHULER_SUSPECT_NEITHER 0

// The radio sensor.
#define SCHULER_SUSPECT_RADIO 1

// The inertial sensor.
#define SCHULER_SUSPECT_INERTIAL 2

// One of them, and these data cannot tell which.
#define SCHULER_SUSPECT_EITHER 3

// Not identified yet: the data sheet is flown.
#define SCHULER_NOISE_DATA_SHEET 0

// Three times the correlation time, and a third of it, are both clearly worse.
#define SCHULER_NOISE_DETERMINED 1

// Only one of the two is.
#define SCHULER_NOISE_WEAK 2

// Neither is: the prior has decided.
#define SCHULER_NOISE_INDETERMINATE 3

// The filter's estimate holds next to nothing of this error; its parameters were left as they were.
#define SCHULER_NOISE_UNOBSERVED 4

// The filter, with the noise parameters in use: no bank has anything to say.
#define SCHULER_SOURCE_FILTER 0

// The wide bank, over everything that the data sheet allows.
#define SCHULER_SOURCE_WIDE_BANK 1

// The narrow bank around the parameters that were identified.
#define SCHULER_SOURCE_NARROW_BANK 2

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Makes a module that waits for its configuration. To be called once on the memory of each module, before everything else, and again to
// start afresh. The memory may hold anything.
//
// size: sizeof(SchulerModule). interface_version: SCHULER_INTERFACE_VERSION. Both are checked against the library.
//
// # Safety
// `module` is null or points to memory of this size.
SchulerResult schuler_init(SchulerModule *module,
                           size_t size,
                           uint32_t interface_version);

// Starts the module anew from a configuration, the block that the ground has made. A refused configuration changes nothing.
//
// SCHULER_RESULT_FORM, _CHECKSUM, _VERSION, _CONTENT: what is wrong with the block. SCHULER_RESULT_REFUSED: a value.
//
// # Safety
// `module` comes from `schuler_init`; `block` is null or has `length` bytes.
SchulerResult schuler_configure(SchulerModule *module,
                                const uint8_t *block,
                                size_t length);

// Corrects the inputs by a compensation block from the next step on. Best before the first step: a block that acts on the velocity
// channel starts the error filter anew. A refused block changes nothing.
//
// Results as of schuler_configure, and SCHULER_RESULT_NOT_CONFIGURED.
//
// # Safety
// As `schuler_configure`.
SchulerResult schuler_load_compensation(SchulerModule *module,
                                        const uint8_t *block,
                                        size_t length);

// One step, to be called once a second whether anything has come or not. Input and output may be in any state; no input makes the
// module unusable. Its time does not depend on the values.
//
// SCHULER_RESULT_NOT_CONFIGURED: nothing was computed; the output says so, too.
//
// # Safety
// `module` comes from `schuler_init`; the others are null or point to their types.
SchulerResult schuler_step(SchulerModule *module,
                           const SchulerInput *input,
                           SchulerOutput *output);

// Length of the saved state, bytes: a matter of the configuration alone.
//
// # Safety
// `module` comes from `schuler_init`; `length` is null or points to its type.
SchulerResult schuler_state_length(SchulerModule *module, size_t *length);

// Saves the whole state, with a version and a checksum: a power cycle then costs nothing but the outage. The module goes on as if
// nothing had been asked. length becomes the bytes written.
//
// SCHULER_RESULT_ROOM: capacity is less than schuler_state_length.
//
// # Safety
// `module` comes from `schuler_init`; `state` is null or has `capacity` bytes; `length` is null or points to its type.
SchulerResult schuler_save(SchulerModule *module,
                           uint8_t *state,
                           size_t capacity,
                           size_t *length);

// Goes on from a saved state, as if it had never stopped: the same inputs give the same bits. What it was configured with is in the
// state. A module that has been configured takes none of another configuration; one that has not takes any. A state that does not fit
// changes nothing; but one that fits its checksum and says something that cannot be leaves a module without configuration.
//
// SCHULER_RESULT_FORM, _CHECKSUM, _VERSION, _CONTENT, _OTHER_CONFIGURATION: what is wrong with the state.
//
// # Safety
// `module` comes from `schuler_init`; `state` is null or has `length` bytes.
SchulerResult schuler_restore(SchulerModule *module,
                              const uint8_t *state,
                              size_t length);

// Which field the last configuration or compensation block was refused for, and why, as text that ends with a zero: "filter.gyro.tau_s:
// must be greater than zero". Empty when it was not refused. What does not fit into capacity is left out.
//
// # Safety
// `module` comes from `schuler_init`; `text` is null or has `capacity` bytes.
SchulerResult schuler_refusal(SchulerModule *module,
                              char *text,
                              size_t capacity);

// Version of the library, as text that ends with a zero; it stays where it is.
const char *schuler_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* SCHULER_H */

#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
_Static_assert(sizeof(SchulerModule) == SCHULER_MODULE_SIZE, "layout of SchulerModule");
_Static_assert(sizeof(SchulerInput) == SCHULER_INPUT_SIZE, "layout of SchulerInput");
_Static_assert(sizeof(SchulerOutput) == SCHULER_OUTPUT_SIZE, "layout of SchulerOutput");
#endif
