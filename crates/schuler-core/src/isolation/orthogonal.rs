//! QR factorisation of axes with any number of rows.
//!
//! Gram–Schmidt with every projection done twice, which is orthogonal to the last digit for columns that are not
//! dependent (Giraud, Langou and Rozložník 2005). Three columns make it shorter than reflections, and nothing in
//! it can go out of bounds. Matrices are taken apart and put together through their storage: views carry bounds
//! checks that the compiler does not always see through.
use nalgebra::{ArrayStorage, Matrix3, RealField, SMatrix, SVector, Vector3};

/// `A = Q R` with three orthonormal columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ThinQr<T, const N: usize> {
    columns: [SVector<T, N>; 3],
    /// Upper triangular factor with a positive diagonal; zero where a column depends on those before it.
    pub(super) triangle: Matrix3<T>,
}

impl<T: RealField + Copy, const N: usize> ThinQr<T, N> {
    /// Of a matrix given by its rows.
    pub(super) fn new(rows: &[Vector3<T>; N]) -> Self {
        let zero = T::zero();
        let column = |element: fn(&Vector3<T>) -> T| {
            let mut column = SVector::<T, N>::zeros();
            for (slot, row) in column.iter_mut().zip(rows) {
                *slot = element(row);
            }
            column
        };
        let (a, b, c) = (column(|row| row.x), column(|row| row.y), column(|row| row.z));
        let (first, first_norm) = normalised(&a);
        let (b_first, c_first) = (first.dot(&b), first.dot(&c));
        let (second, second_norm) = normalised(&without(b, &[first]));
        let c_second = second.dot(&c);
        let (third, third_norm) = normalised(&without(c, &[first, second]));
        Self {
            columns: [first, second, third],
            triangle: Matrix3::new(
                first_norm,
                b_first,
                c_first,
                zero,
                second_norm,
                c_second,
                zero,
                zero,
                third_norm,
            ),
        }
    }

    /// The orthonormal factor.
    pub(super) fn range(&self) -> SMatrix<T, N, 3> {
        columns(self.columns)
    }

    /// The part of a vector that is orthogonal to the columns and to `others`, orthonormal among themselves.
    pub(super) fn complement(&self, vector: SVector<T, N>, others: &[SVector<T, N>]) -> SVector<T, N> {
        without(without(without(vector, &self.columns), others), &self.columns)
    }
}

/// The matrix with these columns.
pub(super) fn columns<T: RealField + Copy, const R: usize, const C: usize>(
    columns: [SVector<T, R>; C],
) -> SMatrix<T, R, C> {
    SMatrix::from_array_storage(ArrayStorage(columns.map(elements)))
}

/// The elements of a vector.
pub(super) fn elements<T: RealField + Copy, const N: usize>(vector: SVector<T, N>) -> [T; N] {
    let [elements] = vector.data.0;
    elements
}

/// The vector less its parts along orthonormal directions.
fn without<T: RealField + Copy, const N: usize>(
    mut vector: SVector<T, N>,
    directions: &[SVector<T, N>],
) -> SVector<T, N> {
    for _ in 0..2 {
        for direction in directions {
            vector -= direction * direction.dot(&vector);
        }
    }
    vector
}

/// A vector of length one and the length it had; zeros for no length.
pub(super) fn normalised<T: RealField + Copy, const N: usize>(vector: &SVector<T, N>) -> (SVector<T, N>, T) {
    let norm = vector.norm();
    let inverse = if norm > T::zero() { T::one() / norm } else { T::zero() };
    (vector * inverse, norm)
}
