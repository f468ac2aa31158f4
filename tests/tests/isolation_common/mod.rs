//! What the isolation tests share.
#![allow(unreachable_pub)]
use nalgebra::{Matrix5x3, SVector, Vector2};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::detector::DetectorConfig;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::reading::Reading;

/// Five rates along the input axes.
pub type Rates = SVector<f64, 5>;

/// The noise vector behind both tables of the paper: σ√12 (u − 1/2), σ = 0.1, with the first five numbers of the
/// classical uniform generator.
pub fn noise_of_the_paper() -> Rates {
    Rates::new(0.950129285147175, 0.231138513574288, 0.606842583541787, 0.485982468709300, 0.891298966148902)
        .map(|u| 0.1 * f64::sqrt(12.0) * (u - 0.5))
}

/// The axes of the paper.
pub fn axes_of_the_paper() -> Matrix5x3<f64> {
    Matrix5x3::from_row_iterator(IsolationConfig::CONE.axes.into_iter().flatten())
}

/// The symmetric cone with unit noise.
pub fn cone() -> ParitySpace<f64> {
    ParitySpace::try_build(&IsolationConfig::CONE.axes, &[1.0; 5]).expect("the cone can be flown")
}

/// An asymmetric block: an orthogonal triad and two skewed gyros.
pub const SKEWED: [[f64; 3]; 5] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [-0.4708, -0.27389, 0.83865],
    [0.85097, -0.30999, -0.42398],
];

/// The asymmetric block with unit noise.
pub fn skewed() -> ParitySpace<f64> {
    ParitySpace::try_build(&SKEWED, &[1.0; 5]).expect("the asymmetric block can be flown")
}

/// The detector whose run lengths and delays are tabulated: every sample beyond the threshold is an alarm.
pub const TABULATED: DetectorConfig<f64> =
    DetectorConfig { false_alarm_interval: 1e5, margin: 9.2, persistence: 1, give_up_samples: 10_000 };

/// The generator of trial `trial` of an experiment.
pub fn generator(seed: u64, trial: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ trial)
}

/// Independent standard normal numbers.
pub fn noise<const N: usize>(rng: &mut impl Rng) -> SVector<f64, N> {
    SVector::from_fn(|_, _| rng.sample(StandardNormal))
}

/// Parity vector of a fault of `size` σ in gyro `gyro`.
pub fn fault(space: &ParitySpace<f64>, gyro: usize, size: f64) -> Vector2<f64> {
    space.directions()[gyro] * (space.sensitivity()[gyro] * size)
}

/// Good readings of five rates.
pub fn good(rates: &Rates) -> [Reading<f64>; 5] {
    rates.data.0[0].map(Reading::good)
}

/// Index of the largest number.
pub fn argmax<T: PartialOrd + Copy>(values: impl IntoIterator<Item = T>) -> usize {
    let mut values = values.into_iter().enumerate();
    let mut best = values.next().expect("at least one value");
    for candidate in values {
        if candidate.1 > best.1 {
            best = candidate;
        }
    }
    best.0
}
