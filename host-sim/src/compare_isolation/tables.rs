//! Both tables of the isolation paper, calculated, with the published digits beside them.
//!
//! Source: Larin (2015), Tables 1 and 2. Equation id FDI-11.
//!
//! The paper draws its noise by a generator whose first five numbers are known, so that every digit can be compared.
//! The rate of the body changes neither table; it changes the condition numbers, for which the paper prints none.
use nalgebra::{SMatrix, SVector, Vector3};
use schuler_core::config::ConfigError;
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::{GYROS, ParitySpace};
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use serde::Serialize;

use super::condition::condition_numbers;

/// A table of the paper: five rows of five numbers.
pub type Table = [[f64; GYROS]; GYROS];

/// Table 1 as printed: row i, column r.
pub const PUBLISHED_RATIOS: Table = [
    [0.2849, 0.0303, 0.3440, 1.4821, 367.6578],
    [0.0091, 0.2664, 1.1265, 24.3626, 0.6189],
    [0.6098, 3.5288, 5.7698, 0.0232, 0.1194],
    [2.8948, 10.2930, 0.0438, 0.0988, 0.5483],
    [58.3723, 0.1144, 0.0634, 0.4445, 2.0705],
];

/// Table 2 as printed: row i, column j.
pub const PUBLISHED_DETERMINANTS: Table = [
    [0.0814, 0.6730, 1.0075, 0.9572, 0.5413],
    [0.4245, 0.1671, 0.6949, 0.9572, 0.8539],
    [0.7371, 0.3388, 0.1890, 0.6446, 0.8539],
    [0.8999, 0.9857, 0.6949, 0.1387, 0.4705],
    [0.5873, 0.9857, 1.0075, 0.6446, 0.0354],
];

/// Standard deviation of the paper's noise; its fault is one.
const SIGMA: f64 = 0.1;
/// First five numbers of the uniform generator that the paper draws its noise from.
const UNIFORM: [f64; GYROS] =
    [0.950129285147175, 0.231138513574288, 0.606842583541787, 0.485982468709300, 0.891298966148902];

/// The paper's example, calculated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperTables {
    /// Rate of the body.
    pub rate: [f64; 3],
    /// Noise of the five gyros.
    pub noise: [f64; GYROS],
    /// Table 1 by the published recursion: row i has its fault in gyro 6 − i, column r has gyro r + 1 last.
    pub ratios: Table,
    /// Table 1 as printed.
    pub published_ratios: Table,
    /// Table 1 with the gain of the Kalman filter.
    pub kalman_ratios: Table,
    /// Table 2: row i has its fault in gyro i, column j leaves gyro j out.
    pub determinants: Table,
    /// Table 2 as printed.
    pub published_determinants: Table,
    /// Condition numbers of the matrices of Table 2.
    pub conditions: Table,
    /// Condition numbers of the same with G y in place of y, which does not contain the rate.
    pub residual_conditions: Table,
}

impl PaperTables {
    /// The paper's block at this rate of the body. `[FDI-11]`
    ///
    /// # Errors
    /// None in practice: the paper's geometry passes the guards.
    pub fn try_build(rate: [f64; 3]) -> Result<Self, ConfigError> {
        let space = ParitySpace::<f64>::try_build(&IsolationConfig::CONE.axes, &[1.0; GYROS])?;
        let axes: SMatrix<f64, GYROS, 3> = space.geometry().matrix();
        let noise = SVector::from(UNIFORM.map(|u| SIGMA * 12.0_f64.sqrt() * (u - 0.5)));
        let measured = |faulty: usize| {
            let fault = SVector::<f64, GYROS>::from_fn(|k, _| f64::from(k == faulty));
            axes * Vector3::from(rate) + noise + fault
        };
        let ratios = |recursion| -> Table {
            let filter = SequentialFilter::new(space.geometry(), recursion);
            std::array::from_fn(|i| {
                let measured = measured(GYROS - 1 - i);
                std::array::from_fn(|r| filter.statistics(r, &measured).last_ratio())
            })
        };
        let minors = FiveDeterminants::new(space.geometry().axes());
        let projector = space.geometry().projector();
        let table = |row: &dyn Fn(SVector<f64, GYROS>) -> SVector<f64, GYROS>| -> Table {
            std::array::from_fn(|faulty| row(measured(faulty)).into())
        };
        Ok(Self {
            rate,
            noise: noise.into(),
            ratios: ratios(Recursion::CovarianceFirst),
            published_ratios: PUBLISHED_RATIOS,
            kalman_ratios: ratios(Recursion::Kalman),
            determinants: table(&|y| minors.of(&y).abs()),
            published_determinants: PUBLISHED_DETERMINANTS,
            conditions: table(&|y| condition_numbers(&axes, &y)),
            residual_conditions: table(&|y| condition_numbers(&axes, &(projector * y))),
        })
    }
}

/// Numbers of a table that differ from the printed ones by more than half a unit of the fourth decimal.
pub fn differing(calculated: &Table, published: &Table) -> usize {
    // Half a unit, and what decimal fractions lose in binary.
    let both = calculated.iter().flatten().zip(published.iter().flatten());
    both.filter(|(a, b)| (*a - *b).abs() > 5.1e-5).count()
}
