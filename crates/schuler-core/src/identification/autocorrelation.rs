//! Autocorrelation of a sliding window by running sums: fixed memory, fixed work per value.
//!
//! Input: one value per call (any unit), or a gap. Output: R_j = (1/n_j) Σ x_i x_{i−j} over the window [FIL-11],
//! with n_j the pairs in which both values are there; the mean is taken as zero.

use nalgebra::{ComplexField, RealField};

use crate::number::{real, select};
use crate::saved::{Blank, saved};

/// Sums of lagged products over the last `N` values for lags 0 … `LAGS` − 1.
///
/// On arrival of a value its products with the `LAGS` newest are added, those of the value that leaves are
/// taken away. What rounding leaves behind in that exchange never lasts: a second set of sums, begun anew every
/// `N` values, only ever adds, and replaces the first once it spans the window.
///
/// `N` and `LAGS` are limited by `LAGS` ≤ `N`, checked at compile time. Never panics.
#[derive(Clone, Copy, Debug)]
pub struct SlidingAutocorrelation<T, const N: usize, const LAGS: usize> {
    /// The window, oldest value at `head`. A gap holds zero.
    values: [T; N],
    /// Whether the value is there.
    present: [bool; N],
    head: usize,
    sums: [LaggedSum<T>; LAGS],
    fresh: [LaggedSum<T>; LAGS],
    /// Values since the fresh sums were begun.
    age: usize,
}

/// Σ x_i x_{i−j} for one lag, and over how many pairs.
#[derive(Clone, Copy, Debug)]
struct LaggedSum<T> {
    sum: T,
    pairs: u32,
}

impl<T: RealField + Copy, const N: usize, const LAGS: usize> SlidingAutocorrelation<T, N, LAGS> {
    const FITS: () = assert!(LAGS <= N && N < (1 << 24), "more lags than values in the window");

    /// An empty window; `zero` is the scalar's zero, for use in constants.
    pub const fn new(zero: T) -> Self {
        let () = Self::FITS;
        let empty = LaggedSum { sum: zero, pairs: 0 };
        Self {
            values: [zero; N],
            present: [false; N],
            head: 0,
            sums: [empty; LAGS],
            fresh: [empty; LAGS],
            age: 0,
        }
    }

    /// Forgets the window.
    pub fn clear(&mut self) {
        let empty = LaggedSum { sum: T::zero(), pairs: 0 };
        self.values.fill(T::zero());
        self.present.fill(false);
        self.sums.fill(empty);
        self.fresh.fill(empty);
        self.head = 0;
        self.age = 0;
    }

    /// Takes the next value of the series; `None` or a value that is not finite is a gap.
    pub fn push(&mut self, value: Option<T>) {
        self.push_if(true, value);
    }

    /// The same if the value is to be `taken`; otherwise nothing changes, with the same work.
    pub fn push_if(&mut self, taken: bool, value: Option<T>) {
        let value = value.filter(ComplexField::is_finite);
        let (new, new_present) = (value.unwrap_or(T::zero()), value.is_some());

        // The oldest value leaves, with its products with itself and the values after it.
        let (before, from_head) = halves(&self.values, self.head);
        let (before_present, from_head_present) = halves(&self.present, self.head);
        let (oldest, oldest_present) = (from_head.first(), from_head_present.first());
        let (oldest, oldest_present) =
            (oldest.copied().unwrap_or(T::zero()), oldest_present.copied().unwrap_or(false));
        let later = from_head.iter().chain(before).zip(from_head_present.iter().chain(before_present));
        for (lagged, (&x, &present)) in self.sums.iter_mut().zip(later) {
            lagged.sum -= select(taken, oldest * x, T::zero());
            lagged.pairs = lagged.pairs.wrapping_sub(u32::from(taken & oldest_present & present));
        }

        // The new value takes its place and is multiplied with itself and the values before it.
        if let (Some(slot), Some(present)) = (self.values.get_mut(self.head), self.present.get_mut(self.head))
        {
            *slot = select(taken, new, *slot);
            *present = select(taken, new_present, *present);
        }
        let next = select(self.head + 1 < N, self.head + 1, 0);
        self.head = select(taken, next, self.head);
        let (newer, older) = halves(&self.values, self.head);
        let (newer_present, older_present) = halves(&self.present, self.head);
        let earlier = newer.iter().rev().chain(older.iter().rev());
        let earlier_present = newer_present.iter().rev().chain(older_present.iter().rev());
        let sums = self.sums.iter_mut().zip(self.fresh.iter_mut()).enumerate();
        for ((lag, (sliding, fresh)), (&x, &present)) in sums.zip(earlier.zip(earlier_present)) {
            let product = select(taken, new * x, T::zero());
            let pair = u32::from(taken & new_present & present);
            sliding.sum += product;
            sliding.pairs = sliding.pairs.wrapping_add(pair);
            // The fresh sums know only the values since they were begun.
            let within = lag <= self.age;
            fresh.sum += select(within, product, T::zero());
            fresh.pairs = fresh.pairs.wrapping_add(select(within, pair, 0));
        }

        self.age += usize::from(taken);
        let complete = self.age >= N;
        for (sliding, fresh) in self.sums.iter_mut().zip(self.fresh.iter_mut()) {
            *sliding = select(complete, *fresh, *sliding);
            *fresh = select(complete, LaggedSum { sum: T::zero(), pairs: 0 }, *fresh);
        }
        self.age = select(complete, 0, self.age);
    }

    /// R_j for all lags [FIL-11]; zero where no pair of values is there.
    pub fn autocorrelation(&self) -> [T; LAGS] {
        self.sums.map(|lagged| {
            let inverse = real::<T>(f64::from(lagged.pairs.max(1))).recip();
            lagged.sum * inverse
        })
    }

    /// Values in the window.
    pub fn count(&self) -> u32 {
        self.sums.first().map_or(0, |lagged| lagged.pairs)
    }
}

/// What stands before the head of a ring, and what from it on.
fn halves<X>(ring: &[X], head: usize) -> (&[X], &[X]) {
    ring.split_at_checked(head).unwrap_or((ring, &[]))
}

saved!([T: Blank] LaggedSum<T> { sum, pairs });
saved!([T: Blank, const N: usize, const LAGS: usize] SlidingAutocorrelation<T, N, LAGS> {
    values,
    present,
    head < N,
    sums,
    fresh,
    age < N,
});

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    const N: usize = 16;
    const LAGS: usize = 5;

    fn directly(window: &[Option<f64>], lag: usize) -> f64 {
        let products: Vec<f64> =
            (lag..window.len()).filter_map(|i| Some(window[i]? * window[i - lag]?)).collect();
        products.iter().sum::<f64>() / products.len().max(1) as f64
    }

    proptest! {
        #[test]
        fn fil_11_running_sums_equal_the_sum_over_the_window(
            series in prop::collection::vec(prop::option::weighted(0.9, -1e3..1e3f64), 1..100),
        ) {
            let mut sliding = SlidingAutocorrelation::<f64, N, LAGS>::new(0.0);
            for (end, value) in series.iter().enumerate() {
                sliding.push(*value);
                let window = &series[(end + 1).saturating_sub(N)..=end];
                for (lag, found) in sliding.autocorrelation().into_iter().enumerate() {
                    prop_assert!((found - directly(window, lag)).abs() < 1e-7);
                }
            }
        }
    }

    #[test]
    fn fil_11_rounding_does_not_pile_up_in_f32() {
        let mut sliding = SlidingAutocorrelation::<f32, 1024, 256>::new(0.0);
        let mut exact = SlidingAutocorrelation::<f64, 1024, 256>::new(0.0);
        let mut state = 1u64;
        for _ in 0..100_000 {
            state = 16807 * state % 2_147_483_647;
            let value = state as f32 / 2_147_483_647.0 - 0.5;
            sliding.push(Some(value));
            exact.push(Some(f64::from(value)));
        }
        let exact = exact.autocorrelation();
        for (found, exact_lag) in sliding.autocorrelation().into_iter().zip(exact) {
            assert!((f64::from(found) - exact_lag).abs() < 3e-6 * exact[0]);
        }
    }

    #[test]
    fn a_value_that_is_not_finite_is_a_gap() {
        let mut sliding = SlidingAutocorrelation::<f32, 4, 2>::new(0.0);
        for value in [1.0, f32::NAN, f32::INFINITY, 1.0] {
            sliding.push(Some(value));
        }
        assert_eq!(sliding.autocorrelation(), [1.0, 0.0]);
        assert_eq!(sliding.count(), 2);
    }
}
