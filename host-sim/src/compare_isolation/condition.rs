//! Condition numbers of a block without each of its gyros.
//!
//! Source: Larin (2015), §4, the alternative to the determinants. Equation id FDI-3.5.
use nalgebra::{Matrix4, SMatrix, SVector};

/// Condition number of [A y] without row j, for each gyro j; dimensionless. `[FDI-3.5]`
///
/// The four gyros that remain agree where the fourth column lies nearly in the range of A, and the number is large. It
/// depends on the rate of the body and on the unit of the measurements.
pub fn condition_numbers<const N: usize>(
    axes: &SMatrix<f64, N, 3>,
    measurements: &SVector<f64, N>,
) -> SVector<f64, N> {
    let columns = [0, 1, 2, 3].map(|k| match k {
        3 => *measurements,
        _ => axes.column(k).into_owned(),
    });
    SVector::from_fn(|removed, _| {
        // A row of zeros leaves the singular values of the others as they are.
        let values = triangle(columns.map(|mut column| {
            column[removed] = 0.0;
            column
        }))
        .singular_values();
        values.max() / values.min()
    })
}

/// Triangular factor of the matrix with these columns, which has the same singular values: Gram–Schmidt, every projection
/// done twice.
fn triangle<const N: usize>(mut columns: [SVector<f64, N>; 4]) -> Matrix4<f64> {
    let mut factor = Matrix4::zeros();
    for k in 0..4 {
        let (done, rest) = columns.split_at_mut(k);
        let column = &mut rest[0];
        for _ in 0..2 {
            for (j, direction) in done.iter().enumerate() {
                let along = direction.dot(column);
                *column -= *direction * along;
                factor[(j, k)] += along;
            }
        }
        let norm = column.norm();
        factor[(k, k)] = norm;
        *column /= if norm > 0.0 { norm } else { 1.0 };
    }
    factor
}
