//! Numbers: constants in the scalar of the computation, sine and cosine, sums that lose nothing.
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

/// An array, element by element: `each!(|i| x[i] + y[i]; 0 1 2 3)`. Written out, as the image does not unroll loops.
macro_rules! each {
    (|$index:ident| $value:expr; $($at:literal)*) => {
        [$({
            let $index: usize = $at;
            $value
        }),*]
    };
}
pub(crate) use each;

/// Ratios of the terms of the power series of cosine and sine, 1/(2k − 1)2k and 1/2k(2k + 1). On an eighth of a turn the first
/// term left out is below 3·10⁻¹⁷ of the sum.
const RATIOS: [[f64; 2]; 8] = {
    let mut ratios = [[0.0; 2]; 8];
    let mut k = 0;
    while k < ratios.len() {
        let even = 2.0 * (k + 1) as f64;
        ratios[k] = [1.0 / ((even - 1.0) * even), 1.0 / (even * (even + 1.0))];
        k += 1;
    }
    ratios
};

/// Sine and cosine of an angle, rad, to a few units in the last place of the larger of the angle and one.
///
/// Those of `libm` go through tables for angles of any size, ten times the code of this; an angle here is a fraction of a turn,
/// and one whose own last digit is more than a turn counts as zero. The work does not depend on the angle.
pub(crate) fn sine_and_cosine<T: RealField + Copy>(angle: T) -> (T, T) {
    let quarters = (angle / T::frac_pi_2()).round();
    let rest = angle - quarters * T::frac_pi_2();
    let rest = select(rest.abs() > T::one(), T::zero(), rest);
    // Horner's scheme, from the last term: sin x = x (1 − x²/2·3 (1 − x²/4·5 (…))), cos x = 1 − x²/1·2 (1 − x²/3·4 (…)).
    let square = rest * rest;
    let (mut sine, mut cosine) = (T::one(), T::one());
    for [of_cosine, of_sine] in RATIOS.into_iter().rev() {
        cosine = T::one() - square * real(of_cosine) * cosine;
        sine = T::one() - square * real(of_sine) * sine;
    }
    let sine = sine * rest;
    // Which quarter, −2 to 2.
    let four = real::<T>(4.0);
    let quarter = quarters - four * (quarters / four).round();
    let odd = quarter.abs() == T::one();
    let (first, second) = (select(odd, cosine, sine), select(odd, sine, cosine));
    let half = quarter.abs() > T::one();
    let sine = select(half | (quarter < T::zero()), -first, first);
    (sine, select(half | (quarter > T::zero()), -second, second))
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
        let of_term = self.sum.abs() >= term.abs();
        let (larger, smaller) = (select(of_term, self.sum, term), select(of_term, term, self.sum));
        self.lost += (larger - total) + smaller;
        self.sum = total;
    }

    pub(crate) fn value(&self) -> T {
        self.sum + self.lost
    }
}

saved!([T: Blank] CompensatedSum<T> { sum, lost });

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    /// Against libm, over four turns to either side and at small angles, where the sine is as good as its argument.
    #[test]
    fn sine_and_cosine_are_good_to_their_last_digits() {
        let steps = crate::repeats(25_000).cast_signed();
        for step in -steps..=steps {
            let x = 25.0 * f64::from(step) / f64::from(steps);
            let (sine, cosine) = sine_and_cosine(x);
            let most = 3.0 * f64::EPSILON * x.abs().max(1.0);
            assert!((sine - libm::sin(x)).abs() < most && (cosine - libm::cos(x)).abs() < most, "{x}");
            let x = x as f32;
            let (sine, cosine) = sine_and_cosine(x);
            let most = 3.0 * f32::EPSILON * x.abs().max(1.0);
            assert!((sine - libm::sinf(x)).abs() < most && (cosine - libm::cosf(x)).abs() < most, "{x}");
        }
        for x in [1e-30f32, 1.2e-3, -0.3] {
            assert!((sine_and_cosine(x).0 / libm::sinf(x) - 1.0).abs() < 1.5e-7);
        }
        assert_eq!(sine_and_cosine(0.0f32), (0.0, 1.0));
    }

    #[test]
    fn sine_and_cosine_of_anything_but_a_number_are_none_and_of_a_huge_one_finite() {
        for x in [f32::MAX, -1e30, 1e15, 3e8] {
            let (sine, cosine) = sine_and_cosine(x);
            assert!(sine.abs() <= 1.0 && cosine.abs() <= 1.0, "{x}");
            let (sine, cosine) = sine_and_cosine(f64::from(x) * 1e200);
            assert!(sine.abs() <= 1.0 && cosine.abs() <= 1.0, "{x}");
        }
        for x in [f32::NAN, f32::INFINITY] {
            let (sine, cosine) = sine_and_cosine(x);
            assert!(sine.is_nan() && cosine.is_nan());
        }
    }
}
