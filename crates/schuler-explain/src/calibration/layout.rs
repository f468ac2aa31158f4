//! Where the parameters of a calibration lie in its state, and their prior.
use nalgebra::{DVector, Matrix3, Vector3};

use super::experiment::{Arrangement, Experiment};
use super::kinematics::TriadValues;
use super::result::ACCELEROMETER_MATRIX;

/// Where the parameters lie in the state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// Features of each coefficient.
    pub(super) features: usize,
    /// First gyro parameter; three of the table's base before it if there are any.
    pub(super) gyro: usize,
    /// First accelerometer parameter.
    pub(super) accelerometer: Option<usize>,
    /// First of three mounting errors, the last parameters.
    pub(super) mounting: Option<usize>,
    /// All parameters.
    pub(super) count: usize,
}

impl Layout {
    pub(super) fn of(experiment: &Experiment) -> Self {
        let np = experiment.features.count();
        match experiment.arrangement {
            Arrangement::CompleteUnit => {
                Self { features: np, gyro: 0, accelerometer: Some(12 * np), mounting: None, count: 21 * np }
            }
            Arrangement::GyroBlock { .. } => Self {
                features: np,
                gyro: 3,
                accelerometer: None,
                mounting: Some(3 + 12 * np),
                count: 6 + 12 * np,
            },
        }
    }

    /// Prior sigma of every parameter.
    pub(super) fn prior(&self, experiment: &Experiment) -> Vec<f64> {
        let priors = &experiment.priors;
        let repeat = |prior: super::experiment::PriorSigma, times: usize| {
            (0..times * self.features).map(move |k| prior.at(k % self.features))
        };
        let gyro = repeat(priors.gyro_bias, 3).chain(repeat(priors.gyro_matrix, 9));
        match experiment.arrangement {
            Arrangement::CompleteUnit => {
                let accelerometer =
                    repeat(priors.accelerometer_bias, 3).chain(repeat(priors.accelerometer_matrix, 6));
                gyro.chain(accelerometer).collect()
            }
            Arrangement::GyroBlock { mounting, base, .. } => {
                [base; 3].into_iter().chain(gyro).chain([mounting; 3]).collect()
            }
        }
    }

    /// Value of the coefficient whose parts begin at `first`.
    fn value(&self, p: &DVector<f64>, first: usize, phi: &[f64]) -> f64 {
        phi.iter().zip(p.rows(first, self.features).iter()).map(|(f, p)| f * p).sum()
    }

    pub(super) fn gyro_values(&self, p: &DVector<f64>, phi: &[f64]) -> TriadValues {
        let at = |slot: usize| self.value(p, self.gyro + slot * self.features, phi);
        TriadValues {
            bias: Vector3::from_fn(|i, _| at(i)),
            matrix: Matrix3::identity() + Matrix3::from_fn(|i, j| at(3 + 3 * i + j)),
        }
    }

    pub(super) fn accelerometer_values(&self, first: usize, p: &DVector<f64>, phi: &[f64]) -> TriadValues {
        let at = |slot: usize| self.value(p, first + slot * self.features, phi);
        let mut matrix = Matrix3::identity();
        for (k, (i, j)) in ACCELEROMETER_MATRIX.into_iter().enumerate() {
            matrix[(i, j)] += at(3 + k);
        }
        TriadValues { bias: Vector3::from_fn(|i, _| at(i)), matrix }
    }
}
