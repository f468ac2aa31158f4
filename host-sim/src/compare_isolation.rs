//! How often each isolation method names the right gyro, against the likelihood test, by Monte Carlo.
//!
//! One sample, no decision whether anything has failed: the setting of Larin (2015), in which the likelihood test is
//! the optimum for a fault of unknown size. All methods see the same samples. The determinants are made for five gyros;
//! the other methods serve any block from five gyros on.
//!
//! In: geometry and noise of the gyros, fault sizes in σ, magnitude of the rate in σ, number of trials, seed.
//! Out: one row a method and fault size. The rows depend on the seed and not on the number of processors.
//! Equation ids FDI-1, FDI-3, FDI-4.
use std::f64::consts::TAU;

use nalgebra::{DMatrix, SMatrix, SVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_core::config::{ConfigError, Problem};
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::geometry::BlockGeometry;
use schuler_core::isolation::parity::{GYROS, ParitySpace};
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use serde::{Deserialize, Serialize};

use crate::output::Interrupted;
use condition::condition_numbers;

pub mod condition;
pub mod rule;
pub mod tables;

/// Blocks of this many gyros can be compared.
pub const BLOCK_SIZES: std::ops::RangeInclusive<usize> = 5..=12;
/// Trials between looks at the clock and at the user's wishes.
const STRIDE: u64 = 10_000;
/// Eigenvalues of the projector are zero or one.
const HALF: f64 = 0.5;

/// What is compared, and on what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IsolationComparison {
    /// Unit input axes, one row a gyro; five to twelve.
    pub axes: Vec<[f64; 3]>,
    /// 1-σ noise of each gyro, rad/s.
    pub sigma: Vec<f64>,
    /// Fault sizes, in σ of the gyro that fails.
    pub faults: Vec<f64>,
    /// Magnitude of the rate over the least σ; its direction is drawn for each trial.
    pub rate: f64,
    /// Unit in which the condition number sees the measurements, over their σ. The other methods do not care.
    pub condition_unit: f64,
    /// Trials for each fault size; each gyro fails in turn.
    pub trials: u64,
    /// Seed.
    pub seed: u64,
}

impl Default for IsolationComparison {
    /// The cone at rest, faults of 2 to 10 σ, the paper's unit.
    fn default() -> Self {
        Self {
            axes: cone(GYROS),
            sigma: vec![1.0; GYROS],
            faults: vec![2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0],
            rate: 0.0,
            condition_unit: 0.1,
            trials: 200_000,
            seed: 1,
        }
    }
}

/// Axes of gyros evenly spaced on the cone of half-angle arccos 1/√3, on which every direction is measured equally well.
/// Five are the paper's, to its five digits.
pub fn cone(gyros: usize) -> Vec<[f64; 3]> {
    if gyros == GYROS {
        return IsolationConfig::CONE.axes.to_vec();
    }
    let (along, across) = ((1.0_f64 / 3.0).sqrt(), (2.0_f64 / 3.0).sqrt());
    let axis = |gyro: usize| {
        let (sine, cosine) = (TAU * gyro as f64 / gyros as f64).sin_cos();
        [across * cosine, across * sine, along]
    };
    (0..gyros).map(axis).collect()
}

/// Why there is no comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ComparisonError {
    /// A geometry that cannot serve, or a number that makes no sense.
    #[error("{0}")]
    Configuration(ConfigError),
    /// The user has stopped it.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl From<ConfigError> for ComparisonError {
    fn from(error: ConfigError) -> Self {
        Self::Configuration(error)
    }
}

/// A way to name the failed gyro from one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IsolationMethod {
    /// Largest likelihood statistic (v_kᵀp)²/‖v_k‖²: the optimum. The flight module decides by it, over many samples.
    Likelihood,
    /// Least determinant over ‖v_j‖. The flight module watches with it the four gyros that remain.
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

impl std::fmt::Display for IsolationMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
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

    /// Whether it can name one of so many gyros.
    pub fn serves(self, gyros: usize) -> bool {
        match self {
            Self::Determinants | Self::RawDeterminants => gyros == GYROS,
            _ => BLOCK_SIZES.contains(&gyros),
        }
    }

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

    /// Of one trial; a method that does not serve the block names nothing.
    fn of(decisions: &[Option<usize>; METHODS], faulty: usize) -> Self {
        let faulty = Some(faulty);
        let optimum = decisions[0];
        Self {
            right: decisions.map(|gyro| u64::from(gyro == faulty)),
            discordant: decisions.map(|gyro| u64::from((gyro == faulty) != (optimum == faulty))),
            differing: decisions.map(|gyro| u64::from(gyro != optimum)),
        }
    }
}

/// The methods, ready for one geometry.
struct Methods<const N: usize> {
    axes: SMatrix<f64, N, 3>,
    /// Lines v_k of all gyros in parity space, one a column, from the eigenvectors of the projector.
    lines: DMatrix<f64>,
    /// For five gyros: normalised, and as published.
    determinants: Option<[FiveDeterminants<f64>; 2]>,
    projector: OrthogonalProjector<f64, N>,
    /// Projector by singular value decomposition.
    by_svd: SMatrix<f64, N, N>,
    filter: SequentialFilter<f64, N>,
    published: SequentialFilter<f64, N>,
    condition_unit: f64,
}

impl<const N: usize> Methods<N> {
    fn new(comparison: &IsolationComparison) -> Result<Self, ConfigError> {
        let (mut axes, mut sigma) = ([[0.0; 3]; N], [0.0; N]);
        axes.iter_mut().zip(&comparison.axes).for_each(|(to, from)| *to = *from);
        sigma.iter_mut().zip(&comparison.sigma).for_each(|(to, from)| *to = *from);
        let geometry = BlockGeometry::<f64, N>::try_build(&axes, &sigma)?;
        let determinants = if N == GYROS {
            let five = |from: &[[f64; 3]; N]| -> [[f64; 3]; GYROS] { std::array::from_fn(|k| from[k]) };
            let space = ParitySpace::try_build(&five(&axes), &std::array::from_fn(|k| sigma[k]))?;
            let raw = FiveDeterminants::new(space.geometry().axes());
            Some([FiveDeterminants::normalised(&space), raw])
        } else {
            None
        };
        let matrix = geometry.matrix();
        let dynamic = DMatrix::from_iterator(N, 3, matrix.iter().copied());
        let range = dynamic.svd(true, false).u.unwrap_or_else(|| DMatrix::zeros(N, 3));
        let by_svd = DMatrix::identity(N, N) - &range * range.transpose();
        // Eigenvectors, because nalgebra's singular vectors of a singular matrix with exact zeros need not be such.
        let parity = by_svd.clone().symmetric_eigen();
        let kept: Vec<usize> = (0..N).filter(|k| parity.eigenvalues[*k] > HALF).collect();
        Ok(Self {
            lines: parity.eigenvectors.select_columns(&kept).transpose(),
            determinants,
            projector: OrthogonalProjector::new(&geometry),
            by_svd: SMatrix::from_fn(|row, column| by_svd[(row, column)]),
            filter: SequentialFilter::new(&geometry, Recursion::Kalman),
            published: SequentialFilter::new(&geometry, Recursion::CovarianceFirst),
            condition_unit: comparison.condition_unit,
            axes: matrix,
        })
    }

    /// The gyro that each method names, in the order of [`IsolationMethod::ALL`]. `[FDI-3]`
    fn decide(&self, whitened: &SVector<f64, N>) -> [Option<usize>; METHODS] {
        let residual = self.by_svd * whitened;
        let least_determinant = |which: usize| {
            let five = SVector::<f64, GYROS>::from_fn(|k, _| whitened[k]);
            self.determinants.as_ref().map(|both| largest((-both[which].of(&five).abs()).as_slice()))
        };
        IsolationMethod::ALL.map(|method| match method {
            IsolationMethod::Likelihood => Some(self.likeliest(whitened)),
            IsolationMethod::Determinants => least_determinant(0),
            IsolationMethod::RawDeterminants => least_determinant(1),
            IsolationMethod::Projector => {
                Some(largest((-self.projector.project(whitened).unexplained).as_slice()))
            }
            IsolationMethod::ProjectorBySvd => {
                let explained =
                    residual.zip_map(&self.by_svd.diagonal(), |element, square| element * element / square);
                Some(largest(explained.as_slice()))
            }
            IsolationMethod::SequentialFilter => Some(largest(self.filter.ratios(whitened).as_slice())),
            IsolationMethod::PublishedRecursion => {
                let ratios = SVector::<f64, N>::from_fn(|gyro, _| {
                    self.published.statistics(gyro, whitened).last_ratio()
                });
                Some(largest(ratios.as_slice()))
            }
            IsolationMethod::ConditionNumber => Some(self.largest_condition(whitened)),
            IsolationMethod::ConditionNumberOfResidual => Some(self.largest_condition(&residual)),
        })
    }

    /// Largest (v_kᵀp)²/‖v_k‖² with p = V y. `[FDI-1]`
    fn likeliest(&self, whitened: &SVector<f64, N>) -> usize {
        // On the stack: parity space has N − 3 dimensions, which the type system cannot say.
        let mut parity = [0.0; N];
        for (sum, row) in parity.iter_mut().zip(self.lines.row_iter()) {
            *sum = row.iter().zip(whitened.iter()).map(|(v, y)| v * y).sum();
        }
        let statistic = |gyro: usize, _| {
            let line = self.lines.column(gyro);
            let along: f64 = line.iter().zip(&parity).map(|(v, p)| v * p).sum();
            along * along / line.norm_squared()
        };
        largest(SVector::<f64, N>::from_fn(statistic).as_slice())
    }

    /// The gyro without which [A y] is conditioned worst. `[FDI-3.5]`
    fn largest_condition(&self, measurements: &SVector<f64, N>) -> usize {
        let numbers = condition_numbers(&self.axes, &(measurements * self.condition_unit));
        largest(numbers.as_slice())
    }
}

/// Compares all methods.
///
/// # Errors
/// A geometry that cannot serve, or a number that makes no sense.
pub fn compare_isolation(comparison: &IsolationComparison) -> Result<Vec<ComparisonRow>, ConfigError> {
    match compare_isolation_watched(comparison, |_| Ok(())) {
        Ok(rows) => Ok(rows),
        Err(ComparisonError::Configuration(error)) => Err(error),
        // Nobody asked.
        Err(ComparisonError::Interrupted(_)) => Ok(Vec::new()),
    }
}

/// Compares all methods; `watch` is told now and then how many trials are done, and may end the work. `[FDI-4]`
///
/// # Errors
/// A geometry that cannot serve, a number that makes no sense, or what `watch` says.
pub fn compare_isolation_watched(
    comparison: &IsolationComparison,
    watch: impl Fn(u64) -> Result<(), Interrupted>,
) -> Result<Vec<ComparisonRow>, ComparisonError> {
    check(comparison)?;
    match comparison.axes.len() {
        5 => compared::<5>(comparison, &watch),
        6 => compared::<6>(comparison, &watch),
        7 => compared::<7>(comparison, &watch),
        8 => compared::<8>(comparison, &watch),
        9 => compared::<9>(comparison, &watch),
        10 => compared::<10>(comparison, &watch),
        11 => compared::<11>(comparison, &watch),
        12 => compared::<12>(comparison, &watch),
        _ => Err(ConfigError::new("comparison.axes", Problem::OutOfRange).into()),
    }
}

fn check(comparison: &IsolationComparison) -> Result<(), ConfigError> {
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
    if comparison.sigma.len() != comparison.axes.len() {
        return Err(ConfigError::new("comparison.sigma", Problem::OutOfRange));
    }
    Ok(())
}

fn compared<const N: usize>(
    comparison: &IsolationComparison,
    watch: &impl Fn(u64) -> Result<(), Interrupted>,
) -> Result<Vec<ComparisonRow>, ComparisonError> {
    let methods = Methods::<N>::new(comparison)?;
    let mut rows = Vec::new();
    for (point, &fault) in comparison.faults.iter().enumerate() {
        let point = point as u64;
        let mut counts = Counts::default();
        for first in (0..comparison.trials).step_by(STRIDE as usize) {
            watch(point * comparison.trials + first)?;
            let part = (first..comparison.trials.min(first + STRIDE))
                .into_par_iter()
                .fold(Counts::default, |counts, trial| {
                    let faulty = (trial % N as u64) as usize;
                    let whitened = sample(&methods.axes, comparison, point, trial, faulty, fault);
                    counts.add(&Counts::of(&methods.decide(&whitened), faulty))
                })
                .reduce(Counts::default, |a, b| a.add(&b));
            counts = counts.add(&part);
        }
        rows.extend(rows_of(&counts, fault, comparison.trials, N));
    }
    Ok(rows)
}

/// Whitened measurements of one trial: rate, fault and noise.
fn sample<const N: usize>(
    axes: &SMatrix<f64, N, 3>,
    comparison: &IsolationComparison,
    point: u64,
    trial: u64,
    faulty: usize,
    fault: f64,
) -> SVector<f64, N> {
    // Each trial has a stream of its own, so that the order of work does not matter.
    let mut rng = Pcg64::seed_from_u64(comparison.seed);
    rng.advance(u128::from(point) << 80 | u128::from(trial) << 16);
    let direction = Vector3::<f64>::from_fn(|_, _| rng.sample(StandardNormal)).normalize();
    let noise = SVector::<f64, N>::from_fn(|_, _| rng.sample(StandardNormal));
    let mut measured = axes * direction * comparison.rate + noise;
    measured[faulty] += fault;
    measured
}

/// Rows of the methods that serve a block of this many gyros.
fn rows_of(counts: &Counts, fault: f64, trials: u64, gyros: usize) -> Vec<ComparisonRow> {
    let all = trials as f64;
    let optimum = counts.right[0] as f64;
    IsolationMethod::ALL
        .into_iter()
        .enumerate()
        .filter(|(_, method)| method.serves(gyros))
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
fn largest(values: &[f64]) -> usize {
    values.iter().enumerate().fold(0, |best, (index, value)| if *value > values[best] { index } else { best })
}
