//! Products of several series, octave by octave: a cascade of two-tap averages and differences.
//!
//! Two neighbours x₁, x₂ become the difference (x₁ − x₂)/√2, which counts in this octave, and the average (x₁ + x₂)/√2, which
//! goes on to the next one. The transform is orthonormal (Haar's), so that white noise of variance one has variance one in
//! every octave, and the products of all rows add up to those of the values themselves.
//!
//! The values of a step that is absent are not pushed: neighbours are neighbours among those that are present.
use crate::number::select;
use crate::saved::saved;

/// Coefficients that a row counts. With more, one more would not change an f32: the row stays as it is.
const FULL: u32 = 1 << 23;
/// A step with a value beyond this is left out: its products could exceed the range of an f32 before the row is full.
const LARGEST: f32 = 1e12;
const HALF: f32 = core::f32::consts::FRAC_1_SQRT_2;

/// The sums Σ z zᵀ of vectors z of `N` series over `ROWS − 1` octaves, and over what is left: averages of
/// 2^(`ROWS` − 1) values.
///
/// `PRODUCTS` is N(N + 1)/2, which is checked when the program is compiled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandSums<const N: usize, const PRODUCTS: usize, const ROWS: usize> {
    rows: [Row<N, PRODUCTS>; ROWS],
    /// Vectors pushed. It may wrap.
    pushed: u32,
}

/// One octave.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row<const N: usize, const PRODUCTS: usize> {
    /// Upper triangle of the sums, row by row.
    products: [f32; PRODUCTS],
    /// Coefficients in the sums.
    count: u32,
    /// What came from the octave before and waits for a neighbour or its turn.
    held: [[f32; N]; 2],
    waiting: u32,
}

/// What one octave has added up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band<'a> {
    /// Coefficients in each sum.
    pub count: u32,
    /// Upper triangle of Σ z zᵀ, row by row.
    pub products: &'a [f32],
}

impl<const N: usize, const PRODUCTS: usize, const ROWS: usize> BandSums<N, PRODUCTS, ROWS> {
    /// Sums over nothing.
    pub const EMPTY: Self = {
        assert!(PRODUCTS == N * (N + 1) / 2 && ROWS > 1 && ROWS <= 32);
        Self { rows: [Row::EMPTY; ROWS], pushed: 0 }
    };

    /// Takes the vector of a step, or nothing where it is absent, with the same work. Never panics.
    ///
    /// One octave has its turn in a step: the first in every second step, the next in every fourth, and so on. That is often
    /// enough for every octave and makes the work of all steps the same.
    #[inline(never)]
    pub fn push(&mut self, vector: &[f32; N], present: bool) {
        let usable = vector.iter().fold(true, |usable, x| usable & (x.abs() <= LARGEST));
        let present = present & usable;
        self.pushed = self.pushed.wrapping_add(u32::from(present));
        let octave = (self.pushed.trailing_zeros() as usize).min(ROWS - 1);
        let (mut average, mut ready) = ([0.0; N], false);
        if let Some(row) = self.rows.get_mut(octave) {
            (average, ready) = row.take_turn(present, octave == ROWS - 1);
        }
        if let Some(next) = self.rows.get_mut(octave + 1) {
            next.hold(&average, ready);
        }
        if let Some(first) = self.rows.first_mut() {
            first.hold(vector, present);
        }
    }

    /// Ends the record: what waits for a neighbour counts as an average over what it is the average of. For read-outs on the
    /// ground and for short records; what is pushed afterwards is a new record in the same sums.
    pub fn settle(&mut self) {
        for octave in 0..ROWS {
            let (mut average, mut ready) = ([0.0; N], false);
            let mut rest = [([0.0; N], false); 2];
            if let Some(row) = self.rows.get_mut(octave) {
                let pair = row.waiting == 2;
                (average, ready) = row.take_turn(pair, octave == ROWS - 1);
                for ((value, left), (held, at)) in rest.iter_mut().zip(row.held.iter().zip(0..)) {
                    (*value, *left) = (*held, at < row.waiting);
                }
                row.waiting = 0;
            }
            if let Some(next) = self.rows.get_mut(octave + 1) {
                next.hold(&average, ready);
            }
            if let Some(last) = self.rows.last_mut() {
                for (value, left) in &rest {
                    last.add(value, *left);
                }
            }
        }
        self.pushed = 0;
    }

    /// The octaves, the fastest first, and last what is left.
    pub fn bands(&self) -> impl Iterator<Item = Band<'_>> {
        self.rows.iter().map(|row| Band { count: row.count, products: &row.products })
    }

    /// Vectors pushed since the start; it wraps at 2³².
    pub fn pushed(&self) -> u32 {
        self.pushed
    }
}

impl<const N: usize, const PRODUCTS: usize> Row<N, PRODUCTS> {
    const EMPTY: Self = Self { products: [0.0; PRODUCTS], count: 0, held: [[0.0; N]; 2], waiting: 0 };

    /// Adds the difference of the two that wait and gives back their average for the next octave, if it is their turn. In the
    /// last row there is no difference: what waits is added as it is.
    fn take_turn(&mut self, turn: bool, is_last: bool) -> ([f32; N], bool) {
        let ready = turn & (self.waiting >= select(is_last, 1, 2));
        let [one, other] = &self.held;
        let (mut difference, mut average) = ([0.0; N], [0.0; N]);
        let both = difference.iter_mut().zip(&mut average);
        for ((difference, average), (one, other)) in both.zip(one.iter().zip(other)) {
            *difference = select(is_last, *one, HALF * (one - other));
            *average = HALF * (one + other);
        }
        self.waiting = select(ready, 0, self.waiting);
        self.add(&difference, ready);
        (average, ready & !is_last)
    }

    /// Adds the products of one vector, or nothing with the same work.
    fn add(&mut self, vector: &[f32; N], counts: bool) {
        let counts = counts & (self.count < FULL);
        self.count += u32::from(counts);
        let vector = vector.map(|x| select(counts, x, 0.0));
        let mut sums = self.products.iter_mut();
        for (first, x) in vector.iter().enumerate() {
            for (y, sum) in vector.iter().skip(first).zip(&mut sums) {
                *sum += x * y;
            }
        }
    }

    /// Keeps a vector until its turn.
    fn hold(&mut self, vector: &[f32; N], arrived: bool) {
        for (slot, at) in self.held.iter_mut().zip(0..) {
            let here = arrived & (self.waiting == at);
            for (slot, x) in slot.iter_mut().zip(vector) {
                *slot = select(here, *x, *slot);
            }
        }
        self.waiting = (self.waiting + u32::from(arrived)).min(2);
    }
}

saved!([const N: usize, const PRODUCTS: usize] Row<N, PRODUCTS> { products, count, held, waiting < 3 });
saved!([const N: usize, const PRODUCTS: usize, const ROWS: usize] BandSums<N, PRODUCTS, ROWS> { rows, pushed });

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of vectors may wrap, and a full row stays as it is.
    #[test]
    fn nothing_is_lost_where_the_count_wraps() {
        // After a multiple of 2⁵ vectors all octaves are where they are in the beginning.
        let mut sums = BandSums::<1, 1, 5> { pushed: u32::MAX - 63, ..BandSums::EMPTY };
        let total = |sums: &BandSums<1, 1, 5>| sums.bands().map(|band| band.products[0]).sum::<f32>();
        for k in 0..100 {
            sums.push(&[k as f32], true);
        }
        sums.settle();
        assert_eq!(sums.rows.iter().map(|row| row.count).sum::<u32>(), 100);
        let squares: u32 = (0..100_u32).map(|k| k * k).sum();
        assert!((total(&sums) / squares as f32 - 1.0).abs() < 1e-5);
        sums.rows.iter_mut().for_each(|row| row.count = FULL);
        let before = total(&sums);
        (0..100).for_each(|_| sums.push(&[1e12], true));
        assert_eq!(total(&sums), before);
    }
}
