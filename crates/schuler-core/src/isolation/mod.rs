//! Fault isolation in a block of five gyros with skewed axes.
//!
//! Source: Larin (2015), "On identification of faults of navigation measuring elements", Int. Appl. Mech. 51(6);
//! completed by what flight needs and the paper leaves out: the decision that nothing has failed at a stated rate
//! of false alarms, an isolation margin, faults slower than one sample, unequal gyros, what to do after the
//! isolation, and bad input. Equation ids FDI-1 to FDI-10.
//!
//! | module | computes |
//! | --- | --- |
//! | [`geometry`] | the axes in units of their noise, and whether they can serve |
//! | [`parity`] | what the five measurements say that no rate can explain |
//! | [`determinants`] | the five determinants: the disagreement of each four; they watch the four that are left |
//! | [`rate`] | the rate from five, or from the four that are left |
//! | [`thresholds`] | thresholds for a stated mean time between false alarms |
//! | [`detector`] | alarm, and which gyro: the accumulated likelihood decides |
//! | [`remaining`] | alarm among the four that are left |
//! | [`projector`], [`sequential`] | the paper's other methods, for any number of gyros: cross-checks |
//!
//! Limits. The thresholds hold for white parity noise. A first name is wrong in about one of thirty slow faults at the
//! default margin (ramp of 0.001 σ a sample on simulated tuned gyros: 6 of 199), and later evidence puts it right. What the
//! healthy gyros drift looks like a slow fault, and is one to the sums: with first-order drift of τ = 1 h and 0.025, 0.05,
//! 0.1 and 0.25 σ, 13, 41, 88 and 100 of 100 flights had an alarm in their first 4000 samples (without drift 4 to 5). A
//! drift beyond a fortieth of σ belongs into `sigma`, and what is constant into the measured offset.
//!
//! In: five rates along the input axes, rad/s, once a step. Out: [`IsolationOutput`].
mod calibration;
mod configuration;
pub mod detector;
pub mod determinants;
pub mod geometry;
mod input;
mod investigation;
mod orthogonal;
mod output;
pub mod parity;
pub mod projector;
pub mod rate;
mod recovery;
pub mod remaining;
pub mod sequential;
mod size;
mod sums;
pub mod thresholds;

use nalgebra::{ComplexField, Matrix3, SVector, Vector2};

use crate::config::ConfigError;
use crate::number::select;
use crate::reading::Reading;
use crate::saved::saved;
use calibration::OffsetCalibration;
pub use configuration::IsolationConfig;
use detector::{Alarm, DetectorConfig, FiveGyroDetector};
use determinants::FiveDeterminants;
use input::{GyroMask, InputLimits, InputMonitor};
pub use output::{IsolationFlags, IsolationOutput, Verdict};
use parity::{GYROS, ParitySpace};
use rate::RateEstimator;
use recovery::RecoveryMonitor;
use remaining::FourGyroDetector;
use size::FaultSize;

/// Three standard deviations cover the bound of the relative error.
const BOUND_SIGMAS_SQUARED: f64 = 9.0;
/// Mask of all gyros.
const ALL: GyroMask = (1 << GYROS) - 1;

/// The isolation with its state.
#[derive(Clone, Copy, Debug)]
pub struct FaultIsolation {
    space: ParitySpace<f64>,
    /// The same for the detectors. Readings, parity and rate are double, because a parity is a small difference of large
    /// readings; in what adds up parities, single precision costs a tenth and is lost in their noise.
    lines: ParitySpace<f32>,
    determinants: FiveDeterminants<f64>,
    estimator: RateEstimator<f64>,
    /// `1/σ_k`, s/rad.
    inverse_sigma: SVector<f64, GYROS>,
    /// `ε²·Σσ_k⁻²/9`: what the squared rate adds to the unit variance of the parity, (rad/s)⁻².
    inflation: f64,
    rate_limit_squared: f64,
    /// Largest constant error, in σ of each gyro.
    offset_limit: SVector<f64, GYROS>,
    margin: f64,

    input: InputMonitor,
    calibration: OffsetCalibration,
    five: FiveGyroDetector<f32>,
    four: FourGyroDetector<f32>,
    recovery: RecoveryMonitor,
    size: FaultSize,
    /// Constant error of each gyro, in its σ.
    offset: SVector<f64, GYROS>,
    /// The measured constant was too large to be one.
    offset_rejected: bool,
    /// Gyros declared faulty.
    excluded: GyroMask,
    /// Covariance of the last rate, (rad/s)².
    covariance: Matrix3<f64>,
}

/// One sample, made ready for the detectors.
struct Sample {
    /// Measurements less their constant errors, in σ; zero where a reading could not be used.
    whitened: SVector<f64, GYROS>,
    /// Gyros that could not be read.
    unusable: GyroMask,
    /// A gyro is stuck just now.
    stuck: bool,
    /// Not to be added up: the rate is above the limit, or the readings are not new.
    suspended: bool,
    /// The constant parity is being measured.
    calibrating: bool,
    /// Parity in σ of the gyros.
    parity: Vector2<f64>,
    /// Factor that makes the variance of the parity one where errors grow with the rate.
    shrink: f64,
    /// Normalised determinants, of unit variance.
    determinants: SVector<f64, GYROS>,
}

impl FaultIsolation {
    /// Checks the configuration and forms everything that is constant.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn try_build(config: &IsolationConfig) -> Result<Self, ConfigError> {
        let space = ParitySpace::try_build(&config.axes, &config.sigma)?;
        config.check()?;
        let inverse_sigma = SVector::from(config.sigma).map(|sigma| 1.0 / sigma);
        let detector = DetectorConfig {
            false_alarm_interval: config.false_alarm_interval as f32,
            margin: config.margin as f32,
            persistence: config.persistence,
            give_up_samples: config.give_up_samples,
        };
        let limits = InputLimits {
            range: config.range,
            stuck_samples: config.stuck_samples,
            lost_samples: config.lost_samples,
        };
        let relative_variance = config.relative_error * config.relative_error / BOUND_SIGMAS_SQUARED;
        Ok(Self {
            determinants: FiveDeterminants::normalised(&space),
            estimator: RateEstimator::new(&space),
            inverse_sigma,
            inflation: relative_variance * inverse_sigma.norm_squared(),
            rate_limit_squared: config.rate_limit * config.rate_limit,
            offset_limit: inverse_sigma * config.offset_limit,
            margin: config.margin,
            input: InputMonitor::new(limits),
            calibration: OffsetCalibration::new(config.calibration_samples),
            five: FiveGyroDetector::new(&detector),
            four: FourGyroDetector::new(&detector),
            recovery: RecoveryMonitor::new(config.readmit_samples),
            size: FaultSize::none(),
            offset: SVector::from(config.offset).component_mul(&inverse_sigma),
            offset_rejected: false,
            excluded: 0,
            covariance: Matrix3::zeros(),
            lines: space.single(),
            space,
        })
    }

    /// One sample of the five gyros, rad/s. `readmit`: ground command to take a gyro back; for a gyro that is in
    /// use it restarts the detection. Never panics; the work does not depend on the data.
    pub fn step(&mut self, gyros: &[Reading<f64>; GYROS], readmit: Option<u8>) -> IsolationOutput {
        self.step_corrected(gyros, &[0.0; GYROS], readmit)
    }

    /// The same with the known error of each gyro in this sample, rad/s, which is taken off its reading. Range and
    /// repetition are judged by the readings as they came: a correction that follows the temperature would make a stuck
    /// gyro move.
    #[inline(never)]
    pub fn step_corrected(
        &mut self,
        gyros: &[Reading<f64>; GYROS],
        errors: &[f64; GYROS],
        readmit: Option<u8>,
    ) -> IsolationOutput {
        let mut flags = self.command(readmit);
        let sample = self.prepare(gyros, errors, &mut flags);

        // Five gyros: detect and isolate, and go on until the isolation is final. [FDI-6]
        let open = self.excluded == 0 || self.five.alarm() == Alarm::Isolated;
        let watched = sample.complete() && open && !sample.calibrating;
        let parity = sample.parity * sample.shrink;
        let five = self.five.step(&self.lines, &parity.map(single), watched, !sample.suspended);
        if five.raised {
            self.size = FaultSize::none();
        }
        let standing = !matches!(five.alarm, Alarm::Quiet | Alarm::Withdrawn);
        self.size.step(&sample.parity, sample.complete() && (standing || self.excluded != 0));
        let isolated = five.isolated.is_some_and(|gyro| self.isolate(1 << gyro));
        let searching = standing && self.excluded == 0;
        // An outlier that is not yet an alarm costs the sample, not the gyro.
        let spike = five.outlier && !standing;
        let spike_margin = spike && f64::from(five.of_sample.margin) >= self.margin;
        let spiked = if spike_margin { 1 << five.of_sample.gyro } else { 0 };

        // Four gyros: the determinant that does not contain the absent one detects. [FDI-9]
        let absent = self.excluded | sample.unusable | spiked;
        let disagreement = if sample.calibrating { None } else { only(absent) }
            .and_then(|gyro| sample.determinants.get(gyro).copied());
        let watched = disagreement.is_some() && !isolated && absent == self.excluded;
        let four = self.four.step(single(disagreement.unwrap_or_default()), watched, !sample.suspended);
        let second_fault = four.alarm == Alarm::Standing;

        // All five in agreement again? [FDI-9]
        let latched = self.excluded != 0 || second_fault || five.alarm == Alarm::GivenUp;
        let agrees = sample.complete() && !sample.suspended && !sample.calibrating && !sample.stuck;
        let recovered = self.recovery.step(&parity, latched && agrees);
        if recovered {
            self.readmit(ALL);
        }
        let absent = if recovered { 0 } else { absent };

        let untrusted = absent.count_ones() > 1 || second_fault || four.outlier;
        let verdict = match only(absent) {
            _ if recovered => Verdict::NoFault,
            _ if untrusted => Verdict::BlockUntrusted,
            _ if searching => Verdict::DetectedNotIsolated,
            Some(gyro) => Verdict::Fault(gyro as u8),
            None if spike => Verdict::DetectedNotIsolated,
            None => Verdict::NoFault,
        };
        flags |= raise(IsolationFlags::OUTLIER, five.outlier || four.outlier)
            | raise(IsolationFlags::ALARM_RAISED, five.raised || four.raised)
            | raise(
                IsolationFlags::ALARM_WITHDRAWN,
                five.alarm == Alarm::Withdrawn || four.alarm == Alarm::Withdrawn,
            )
            | raise(IsolationFlags::ISOLATED, isolated)
            | raise(IsolationFlags::GIVEN_UP, five.alarm == Alarm::GivenUp && !recovered)
            | raise(IsolationFlags::SECOND_FAULT, second_fault && !recovered)
            | raise(IsolationFlags::READMITTED, recovered);

        let trusted = verdict != Verdict::BlockUntrusted;
        let rate = self.estimator.rate(&self.space, &sample.whitened, only(absent));
        self.covariance = self.estimator.covariance(&self.space, only(absent));
        let rate_sigma = self.covariance.diagonal().map(ComplexField::sqrt);
        let (fault_size, fault_sigma) = self.fault_size();
        IsolationOutput {
            verdict,
            flags,
            gyros_used: if trusted { ALL & !absent } else { 0 },
            excluded: self.excluded,
            rate: keep(trusted, rate.into()),
            rate_sigma: keep(trusted, rate_sigma.into()),
            parity: keep(sample.complete(), parity.into()),
            determinants: sample.valid_determinants(),
            alarm_level: f64::from(select(watched, four.level, five.level)),
            margin: f64::from(select(standing, five.suspicion.margin, 0.0)),
            fault_size,
            fault_sigma,
        }
    }

    /// Gyros declared faulty, one bit a gyro.
    pub fn excluded(&self) -> u8 {
        self.excluded
    }

    /// Covariance of the last rate from the noise of the gyros that it came from, (rad/s)²; zero before the first.
    pub fn rate_covariance(&self) -> &Matrix3<f64> {
        &self.covariance
    }

    /// The constant error of each gyro that is being subtracted, rad/s.
    pub fn offset(&self) -> [f64; GYROS] {
        self.offset.component_div(&self.inverse_sigma).into()
    }

    fn command(&mut self, readmit: Option<u8>) -> IsolationFlags {
        match readmit {
            Some(gyro) if usize::from(gyro) < GYROS => {
                self.readmit(1 << gyro);
                IsolationFlags::READMITTED
            }
            Some(_) => IsolationFlags::COMMAND_REJECTED,
            None => IsolationFlags::empty(),
        }
    }

    /// Checks the readings and forms what the detectors need. `[FDI-7]` `[FDI-10]`
    fn prepare(
        &mut self,
        gyros: &[Reading<f64>; GYROS],
        errors: &[f64; GYROS],
        flags: &mut IsolationFlags,
    ) -> Sample {
        let input = self.input.check(gyros);
        self.exclude(input.stuck | input.lost);
        let complete = input.usable == ALL;
        let unusable = ALL & !input.usable;

        let values = SVector::from(input.values) - SVector::from(*errors);
        let mut whitened = values.component_mul(&self.inverse_sigma) - self.offset;
        for (gyro, value) in whitened.iter_mut().enumerate() {
            *value = if unusable >> gyro & 1 == 0 { *value } else { 0.0 };
        }
        let absent = self.excluded | unusable;
        let rate_squared = self.estimator.rate(&self.space, &whitened, only(absent)).norm_squared();
        let fast = absent.count_ones() < 2 && rate_squared > self.rate_limit_squared;
        // Repeated readings are not new evidence.
        let suspended = fast || input.frozen;
        // Scale and alignment errors grow with the rate: they count as noise, and long sums stay out of them.
        let shrink = ComplexField::sqrt(1.0 / (1.0 + self.inflation * rate_squared));

        let parity = self.space.parity(&whitened);
        let calibrating = self.calibration.running();
        if let Some(mean) = self.calibration.step(&parity, complete && !suspended && self.excluded == 0) {
            self.take_offset(&mean);
        }
        *flags |= raise(IsolationFlags::READING_UNUSABLE, !complete)
            | raise(IsolationFlags::STUCK, input.stuck != 0)
            | raise(IsolationFlags::LOST, input.lost != 0)
            | raise(IsolationFlags::FROZEN, input.frozen)
            | raise(IsolationFlags::SUMS_SUSPENDED, suspended)
            | raise(IsolationFlags::CALIBRATING, calibrating)
            | raise(IsolationFlags::OFFSET_REJECTED, self.offset_rejected);
        Sample {
            determinants: self.determinants.of(&whitened) * shrink,
            whitened,
            unusable,
            stuck: input.stuck != 0,
            suspended,
            calibrating,
            parity,
            shrink,
        }
    }

    /// Freezes a measured mean parity as the least constant errors that explain it. `[FDI-7]`
    fn take_offset(&mut self, mean_parity: &Vector2<f64>) {
        let measured = self.space.matrix().tr_mul(mean_parity);
        self.offset_rejected = measured.iter().zip(&self.offset_limit).any(|(x, limit)| x.abs() > *limit);
        self.offset += measured * if self.offset_rejected { 0.0 } else { 1.0 };
    }

    /// Leaves out gyros that cannot be read; they stay out when they can be read again.
    fn exclude(&mut self, gyros: GyroMask) {
        if gyros & !self.excluded != 0 {
            self.excluded |= gyros;
            self.size = FaultSize::none();
            self.five.reset();
            self.four.reset();
            self.recovery.reset();
        }
    }

    /// Leaves out the gyro that the evidence names, instead of one that less evidence had named before. What the
    /// other four said then was said with the wrong four. True when the gyro is new.
    fn isolate(&mut self, gyro: GyroMask) -> bool {
        let new = gyro != self.excluded;
        if new {
            self.excluded = gyro;
            self.four.reset();
            self.recovery.reset();
        }
        new
    }

    /// Takes gyros back.
    fn readmit(&mut self, gyros: GyroMask) {
        self.excluded &= !gyros;
        self.size = FaultSize::none();
        self.five.reset();
        self.four.reset();
        self.recovery.reset();
    }

    /// Size of the excluded gyro's fault and its 1-σ, rad/s.
    fn fault_size(&self) -> (f64, f64) {
        let excluded = only(self.excluded);
        let gyro = excluded.unwrap_or(0);
        let sigma = 1.0 / self.inverse_sigma.get(gyro).copied().unwrap_or(1.0);
        let (size, error) = self.size.of(&self.space, gyro);
        let known = excluded.is_some();
        (select(known, size * sigma, 0.0), select(known, error * sigma, 0.0))
    }
}

impl Sample {
    /// All five could be read.
    fn complete(&self) -> bool {
        self.unusable == 0
    }

    /// Determinants whose four gyros could all be read; zero for the others.
    fn valid_determinants(&self) -> [f64; GYROS] {
        let mut determinants: [f64; GYROS] = self.determinants.into();
        for (removed, determinant) in determinants.iter_mut().enumerate() {
            *determinant = if self.unusable & !(1 << removed) == 0 { *determinant } else { 0.0 };
        }
        determinants
    }
}

/// The gyro of a mask that has exactly one.
fn only(mask: GyroMask) -> Option<usize> {
    mask.is_power_of_two().then_some(mask.trailing_zeros() as usize)
}

fn raise(flag: IsolationFlags, condition: bool) -> IsolationFlags {
    if condition { flag } else { IsolationFlags::empty() }
}

fn keep<const N: usize>(condition: bool, values: [f64; N]) -> [f64; N] {
    values.map(|value| select(condition, value, 0.0))
}

/// In single precision; so far out that the limit matters there is nothing to tell any more.
fn single(deviations: f64) -> f32 {
    const MOST: f64 = 1e15;
    deviations.clamp(-MOST, MOST) as f32
}

saved!([] FaultIsolation {
    input,
    calibration,
    five,
    four,
    recovery,
    size,
    offset,
    offset_rejected,
    excluded,
    covariance,
    space,
    lines,
    determinants,
    estimator,
    inverse_sigma,
    inflation,
    rate_limit_squared,
    offset_limit,
    margin,
});
