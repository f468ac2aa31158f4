//! How often each isolation method names the right gyro, against the likelihood test, by Monte Carlo.
//!
//! One sample, no decision whether anything has failed: the setting of Larin (2015), in which the likelihood test is
//! the optimum for a fault of unknown size. All methods see the same samples.
//!
//! In: geometry and noise of five gyros, fault sizes in σ, magnitude of the rate in σ, number of trials, seed.
//! Out: one row a method and fault size. The rows depend on the seed and not on the number of processors.
use nalgebra::{SMatrix, SVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_core::config::{ConfigError, Problem};
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::{GYROS, ParitySpace};
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use serde::{Deserialize, Serialize};

/// What is compared, and on what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IsolationComparison {
    /// Unit input axes, one row a gyro.
    pub axes: [[f64; 3]; GYROS],
    /// 1-σ noise of each gyro, rad/s.
    pub sigma: [f64; GYROS],
    /// Fault sizes, in σ of the gyro that fails.
    pub faults: Vec<f64>,
    /// Magnitude of the rate over the least σ; its direction is drawn for each trial.
    pub rate: f64,
    /// Unit in which the condition number sees the measurements, over their σ. The other methods do not care.
    pub condition_unit: f64,
    /// Trials for each fault size; each gyro fails in every fifth.
    pub trials: u64,
    /// Seed.
    pub seed: u64,
}

impl Default for IsolationComparison {
    /// The cone at rest, faults of 2 to 10 σ, the paper's unit.
    fn default() -> Self {
        Self {
            axes: IsolationConfig::CONE.axes,
            sigma: [1.0; GYROS],
            faults: vec![2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0],
            rate: 0.0,
            condition_unit: 0.1,
            trials: 200_000,
            seed: 1,
        }
    }
}

/// A way to name the failed gyro from one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IsolationMethod {
    /// Largest likelihood statistic (v_kᵀp)²/‖v_k‖²: the optimum.
    Likelihood,
    /// Least determinant over ‖v_j‖: what flies.
    Determinants,
    /// Least determinant as published, not normalised.
    RawDeterminants,
    /// Least residual, projector by QR.
    Projector,
    /// Least residual, projector by singular values.
    ProjectorBySvd,
    /// Largest innovation ratio of the Kalman filter.
    SequentialFilter,
    /// Largest innovation ratio of the published recursion.
    PublishedRecursion,
    /// Largest condition number of [A y] without row j, as published.
    ConditionNumber,
    /// Largest condition number of [A Gy] without row j: without the rate.
    ConditionNumberOfResidual,
}

impl IsolationMethod {
    /// All methods, the optimum first.
    pub const ALL: [Self; 9] = [
        Self::Likelihood,
        Self::Determinants,
        Self::RawDeterminants,
        Self::Projector,
        Self::ProjectorBySvd,
        Self::SequentialFilter,
        Self::PublishedRecursion,
        Self::ConditionNumber,
        Self::ConditionNumberOfResidual,
    ];

    /// Its name in tables and plots.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Likelihood => "likelihood (optimum)",
            Self::Determinants => "determinants, normalised",
            Self::RawDeterminants => "determinants, as published",
            Self::Projector => "projector, QR",
            Self::ProjectorBySvd => "projector, SVD",
            Self::SequentialFilter => "sequential filter",
            Self::PublishedRecursion => "sequential, as published",
            Self::ConditionNumber => "condition number, as published",
            Self::ConditionNumberOfResidual => "condition number of the residual",
        }
    }
}

/// One method at one fault size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// Method.
    pub method: IsolationMethod,
    /// Fault size, in σ.
    pub fault: f64,
    /// Trials.
    pub trials: u64,
    /// Share of the trials in which the right gyro was named.
    pub probability: f64,
    /// Standard error of that share.
    pub standard_error: f64,
    /// Share over that of the likelihood test on the same trials.
    pub ratio: f64,
    /// Standard error of that ratio, from the trials in which just one of the two was right.
    pub ratio_error: f64,
    /// Share of the trials in which the method named another gyro than the likelihood test.
    pub differing: f64,
}

const METHODS: usize = IsolationMethod::ALL.len();

/// Counts over trials.
#[derive(Clone, Copy, Default)]
struct Counts {
    right: [u64; METHODS],
    /// Just one of the method and the likelihood test was right.
    discordant: [u64; METHODS],
    differing: [u64; METHODS],
}

impl Counts {
    fn add(mut self, other: &Self) -> Self {
        let pairs = [
            (&mut self.right, &other.right),
            (&mut self.discordant, &other.discordant),
            (&mut self.differing, &other.differing),
        ];
        for (mine, theirs) in pairs {
            for (a, b) in mine.iter_mut().zip(theirs) {
                *a += b;
            }
        }
        self
    }

    fn of(decisions: &[usize; METHODS], faulty: usize) -> Self {
        let optimum = decisions[0];
        Self {
            right: decisions.map(|gyro| u64::from(gyro == faulty)),
            discordant: decisions.map(|gyro| u64::from((gyro == faulty) != (optimum == faulty))),
            differing: decisions.map(|gyro| u64::from(gyro != optimum)),
        }
    }
}

/// The methods, ready for one geometry.
struct Methods {
    space: ParitySpace<f64>,
    determinants: FiveDeterminants<f64>,
    raw_determinants: FiveDeterminants<f64>,
    projector: OrthogonalProjector<f64, GYROS>,
    /// Projector by singular value decomposition.
    by_svd: SMatrix<f64, GYROS, GYROS>,
    filter: SequentialFilter<f64, GYROS>,
    published: SequentialFilter<f64, GYROS>,
    condition_unit: f64,
}

impl Methods {
    fn new(space: &ParitySpace<f64>, condition_unit: f64) -> Self {
        let geometry = space.geometry();
        let by_svd = geometry
            .matrix()
            .svd(true, false)
            .u
            .map_or_else(SMatrix::identity, |range| SMatrix::identity() - range * range.transpose());
        Self {
            determinants: FiveDeterminants::normalised(space),
            raw_determinants: FiveDeterminants::new(geometry.axes()),
            projector: OrthogonalProjector::new(geometry),
            by_svd,
            filter: SequentialFilter::new(geometry, Recursion::Kalman),
            published: SequentialFilter::new(geometry, Recursion::CovarianceFirst),
            condition_unit,
            space: *space,
        }
    }

    /// The gyro that each method names, in the order of [`IsolationMethod::ALL`].
    fn decide(&self, whitened: &SVector<f64, GYROS>) -> [usize; METHODS] {
        let residual = self.by_svd * whitened;
        IsolationMethod::ALL.map(|method| match method {
            IsolationMethod::Likelihood => largest(self.space.likelihood(&self.space.parity(whitened), 1.0)),
            IsolationMethod::Determinants => largest(self.determinants.of(whitened).map(|d| -d.abs())),
            IsolationMethod::RawDeterminants => largest(self.raw_determinants.of(whitened).map(|d| -d.abs())),
            IsolationMethod::Projector => largest(-self.projector.project(whitened).unexplained),
            IsolationMethod::ProjectorBySvd => largest(
                residual.zip_map(&self.by_svd.diagonal(), |element, square| element * element / square),
            ),
            IsolationMethod::SequentialFilter => largest(self.filter.ratios(whitened)),
            IsolationMethod::PublishedRecursion => largest(SVector::<f64, GYROS>::from_fn(|gyro, _| {
                self.published.statistics(gyro, whitened).last_ratio()
            })),
            IsolationMethod::ConditionNumber => self.largest_condition(whitened),
            IsolationMethod::ConditionNumberOfResidual => self.largest_condition(&residual),
        })
    }

    fn largest_condition(&self, measurements: &SVector<f64, GYROS>) -> usize {
        let augmented = SMatrix::<f64, GYROS, 4>::from_fn(|row, column| match column {
            3 => measurements[row] * self.condition_unit,
            _ => self.space.geometry().matrix()[(row, column)],
        });
        largest(SVector::<f64, GYROS>::from_fn(|removed, _| {
            let singular = augmented.remove_row(removed).singular_values();
            singular.max() / singular.min()
        }))
    }
}

/// Compares all methods.
///
/// # Errors
/// A geometry that cannot serve, or a number that makes no sense.
pub fn compare_isolation(comparison: &IsolationComparison) -> Result<Vec<ComparisonRow>, ConfigError> {
    let not_finite = |field| Err(ConfigError::new(field, Problem::NotFinite));
    if comparison.trials == 0 {
        return Err(ConfigError::new("comparison.trials", Problem::NotPositive));
    }
    if !comparison.faults.iter().all(|fault| fault.is_finite()) {
        return not_finite("comparison.faults");
    }
    if !comparison.rate.is_finite() {
        return not_finite("comparison.rate");
    }
    if !(comparison.condition_unit > 0.0 && comparison.condition_unit.is_finite()) {
        return Err(ConfigError::new("comparison.condition_unit", Problem::NotPositive));
    }
    let methods = Methods::new(
        &ParitySpace::try_build(&comparison.axes, &comparison.sigma)?,
        comparison.condition_unit,
    );
    let rows = comparison.faults.iter().enumerate().flat_map(|(point, &fault)| {
        let counts = (0..comparison.trials)
            .into_par_iter()
            .fold(Counts::default, |counts, trial| {
                let faulty = (trial % GYROS as u64) as usize;
                let whitened = sample(&methods.space, comparison, point as u64, trial, faulty, fault);
                counts.add(&Counts::of(&methods.decide(&whitened), faulty))
            })
            .reduce(Counts::default, |a, b| a.add(&b));
        rows_of(&counts, fault, comparison.trials)
    });
    Ok(rows.collect())
}

/// Whitened measurements of one trial: rate, fault and noise.
fn sample(
    space: &ParitySpace<f64>,
    comparison: &IsolationComparison,
    point: u64,
    trial: u64,
    faulty: usize,
    fault: f64,
) -> SVector<f64, GYROS> {
    // Each trial has a stream of its own, so that the order of work does not matter.
    let mut rng = Pcg64::seed_from_u64(comparison.seed);
    rng.advance(u128::from(point) << 80 | u128::from(trial) << 16);
    let direction = Vector3::<f64>::from_fn(|_, _| rng.sample(StandardNormal)).normalize();
    let noise = SVector::<f64, GYROS>::from_fn(|_, _| rng.sample(StandardNormal));
    space.geometry().matrix() * direction * comparison.rate + noise + SVector::ith(faulty, fault)
}

fn rows_of(counts: &Counts, fault: f64, trials: u64) -> Vec<ComparisonRow> {
    let all = trials as f64;
    let optimum = counts.right[0] as f64;
    IsolationMethod::ALL
        .into_iter()
        .enumerate()
        .map(|(index, method)| {
            let right = counts.right[index] as f64;
            let probability = right / all;
            ComparisonRow {
                method,
                fault,
                trials,
                probability,
                standard_error: (probability * (1.0 - probability) / all).sqrt(),
                ratio: right / optimum,
                ratio_error: (counts.discordant[index] as f64).sqrt() / optimum,
                differing: counts.differing[index] as f64 / all,
            }
        })
        .collect()
}

/// Index of the largest value.
fn largest(values: impl Into<[f64; GYROS]>) -> usize {
    let values: [f64; GYROS] = values.into();
    (0..GYROS).fold(0, |best, index| if values[index] > values[best] { index } else { best })
}
