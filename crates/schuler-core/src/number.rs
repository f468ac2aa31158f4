//! Numbers: constants in the scalar of the computation, sums that lose nothing.
use crate::saved::{Blank, saved};
use nalgebra::RealField;

/// A constant in the scalar of the computation.
#[inline]
pub(crate) fn real<T: RealField>(value: f64) -> T {
    nalgebra::convert(value)
}

/// One or the other, chosen without a branch: the work does not depend on the condition.
#[inline(always)]
pub(crate) fn select<V>(condition: bool, one: V, other: V) -> V {
    core::hint::select_unpredictable(condition, one, other)
}

/// A sum that carries its rounding error along (Neumaier). Thousands of log-likelihood terms in f32 stay
/// exact to a few units in the last place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CompensatedSum<T> {
    sum: T,
    lost: T,
}

impl<T: RealField + Copy> CompensatedSum<T> {
    pub(crate) const fn new(zero: T) -> Self {
        Self { sum: zero, lost: zero }
    }

    #[inline]
    pub(crate) fn add(&mut self, term: T) {
        let total = self.sum + term;
        self.lost +=
            if self.sum.abs() >= term.abs() { (self.sum - total) + term } else { (term - total) + self.sum };
        self.sum = total;
    }

    pub(crate) fn value(&self) -> T {
        self.sum + self.lost
    }
}

saved!([T: Blank] CompensatedSum<T> { sum, lost });
