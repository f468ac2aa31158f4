//! The paper's rule of detection beside the sequential detector of the flight module, by Monte Carlo.
//!
//! Source: Larin (2015), §3, equation (3.5) and the rule under it: a fault is declared as soon as a statistic k_s of the
//! filter exceeds k_s,max, and its gyro is the one with the largest ratio of the last two statistics. Equation ids
//! FDI-3.3, FDI-6.
//!
//! The paper gives no value of k_s,max. Here both detectors have the same mean time between false alarms: k_s is
//! chi-square with one degree of freedom for each of the two gyros after the three that start the filter.
//!
//! In: fault sizes in σ, mean samples between false alarms, runs, seed. Out: one row a fault size.
use nalgebra::{SVector, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_core::config::{ConfigError, Problem};
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::detector::{Alarm, DetectorConfig, FiveGyroDetector};
use schuler_core::isolation::parity::{GYROS, ParitySpace};
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::output::Interrupted;

use super::{ComparisonError, largest};

/// Samples without a fault before it begins, so that the detector's sums are those of a flight.
const HEALTHY: usize = 300;
/// Samples after which a run ends without a decision.
const LONGEST: u64 = 1_000_000;
/// Axes as the filter takes them: the last gyro is processed last.
const LAST: usize = GYROS - 1;

/// What is compared: steps of one gyro of the paper's block in white noise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RuleComparison {
    /// Fault sizes, in σ.
    pub faults: Vec<f64>,
    /// Mean samples between false alarms of both.
    pub false_alarm_interval: f64,
    /// Runs for each fault size; each gyro fails in turn.
    pub runs: u64,
    /// Seed.
    pub seed: u64,
}

impl Default for RuleComparison {
    fn default() -> Self {
        Self { faults: vec![1.0, 2.0, 4.0, 6.0, 8.0, 10.0], false_alarm_interval: 1e5, runs: 500, seed: 1 }
    }
}

/// Both detectors at one fault size; delays are means in samples, shares are of the runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RuleRow {
    /// Fault size, in σ.
    pub fault: f64,
    /// Samples until k_s exceeds k_s,max.
    pub rule_delay: f64,
    /// The ratio at that sample names the right gyro.
    pub rule_right: f64,
    /// Samples until the sequential detector raises its alarm.
    pub detector_delay: f64,
    /// Samples until it names a gyro.
    pub isolation_delay: f64,
    /// That gyro is the right one.
    pub detector_right: f64,
}

/// The threshold k_s,max at which one of two statistics exceeds it once in so many samples on average. `[FDI-6]`
pub fn threshold(false_alarm_interval: f64) -> f64 {
    let of_one = 1.0 - (1.0 - 1.0 / false_alarm_interval).sqrt();
    Normal::standard().inverse_cdf(1.0 - of_one / 2.0).powi(2)
}

/// The paper's rule on one sample: the gyro that it names where it declares a fault.
pub fn rule(
    filter: &SequentialFilter<f64, GYROS>,
    limit: f64,
    whitened: &SVector<f64, GYROS>,
) -> Option<usize> {
    let statistics = filter.statistics(LAST, whitened);
    let declared = statistics.last.max(statistics.previous) > limit;
    declared.then(|| largest(filter.ratios(whitened).as_slice()))
}

/// Compares both; `between` is told how many fault sizes are done, and may end the work. `[FDI-3.3]` `[FDI-6]`
///
/// # Errors
/// A number that makes no sense, or what `between` says.
pub fn compare_rule(
    comparison: &RuleComparison,
    between: impl Fn(u64) -> Result<(), Interrupted>,
) -> Result<Vec<RuleRow>, ComparisonError> {
    check(comparison)?;
    let block = Block::try_build(comparison.false_alarm_interval)?;
    let mut rows = Vec::new();
    for (done, &fault) in comparison.faults.iter().enumerate() {
        between(done as u64)?;
        let sum = (0..comparison.runs)
            .into_par_iter()
            .map(|run| block.run(comparison.seed, done as u64, run, fault))
            // Counts of samples: their sum does not depend on the order of the work.
            .reduce(SVector::<f64, 5>::zeros, |a, b| a + b);
        let [rule_delay, rule_right, detector_delay, isolation_delay, detector_right] =
            (sum / comparison.runs as f64).into();
        rows.push(RuleRow { fault, rule_delay, rule_right, detector_delay, isolation_delay, detector_right });
    }
    Ok(rows)
}

fn check(comparison: &RuleComparison) -> Result<(), ConfigError> {
    if comparison.runs == 0 {
        return Err(ConfigError::new("comparison.runs", Problem::NotPositive));
    }
    if !comparison.faults.iter().all(|fault| fault.is_finite()) {
        return Err(ConfigError::new("comparison.faults", Problem::NotFinite));
    }
    // Below ten samples the quantiles mean little.
    if !(10.0..=1e12).contains(&comparison.false_alarm_interval) {
        return Err(ConfigError::new("comparison.false_alarm_interval", Problem::OutOfRange));
    }
    Ok(())
}

/// The paper's block with both detectors, fresh.
struct Block {
    space: ParitySpace<f64>,
    filter: SequentialFilter<f64, GYROS>,
    limit: f64,
    detector: FiveGyroDetector<f64>,
}

impl Block {
    fn try_build(false_alarm_interval: f64) -> Result<Self, ConfigError> {
        let space = ParitySpace::try_build(&IsolationConfig::CONE.axes, &[1.0; GYROS])?;
        let flight = IsolationConfig::CONE;
        let config = DetectorConfig {
            false_alarm_interval,
            margin: flight.margin,
            persistence: flight.persistence,
            give_up_samples: flight.give_up_samples,
        };
        Ok(Self {
            filter: SequentialFilter::new(space.geometry(), Recursion::Kalman),
            limit: threshold(false_alarm_interval),
            detector: FiveGyroDetector::new(&config),
            space,
        })
    }

    /// One run of both on the same samples, as the numbers of [`RuleRow`] without the fault.
    fn run(&self, seed: u64, point: u64, run: u64, fault: f64) -> SVector<f64, 5> {
        // Each run has a stream of its own, so that the order of work does not matter.
        let mut rng = Pcg64::seed_from_u64(seed);
        rng.advance(u128::from(point) << 96 | u128::from(run) << 64);
        let faulty = (run % GYROS as u64) as usize;
        let mut detector = self.settled(&mut rng);
        let (mut by_rule, mut raised, mut isolated) = (None, None, None);
        for sample in 1..=LONGEST {
            let mut whitened = SVector::<f64, GYROS>::from_fn(|_, _| rng.sample(StandardNormal));
            whitened[faulty] += fault;
            if by_rule.is_none() {
                by_rule = rule(&self.filter, self.limit, &whitened).map(|gyro| (sample, gyro));
            }
            if isolated.is_none() {
                let seen = detector.step(&self.space, &self.space.parity(&whitened), true, true);
                raised = raised.or(seen.raised.then_some(sample));
                isolated = seen.isolated.map(|gyro| (sample, gyro));
            }
            if by_rule.is_some() && isolated.is_some() {
                break;
            }
        }
        let never = (LONGEST, GYROS);
        let (rule_delay, rule_gyro) = by_rule.unwrap_or(never);
        let (isolation_delay, gyro) = isolated.unwrap_or(never);
        SVector::from([
            rule_delay as f64,
            f64::from(rule_gyro == faulty),
            raised.unwrap_or(LONGEST) as f64,
            isolation_delay as f64,
            f64::from(gyro == faulty),
        ])
    }

    /// The detector after a while without a fault, no alarm standing.
    fn settled(&self, rng: &mut Pcg64) -> FiveGyroDetector<f64> {
        loop {
            let mut detector = self.detector;
            let mut healthy = || Vector2::from_fn(|_, _| rng.sample(StandardNormal));
            if (0..HEALTHY).all(|_| detector.step(&self.space, &healthy(), true, true).alarm == Alarm::Quiet)
            {
                return detector;
            }
        }
    }
}
