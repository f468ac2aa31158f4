//! Exponential regression over the window, form B [TMP-3], [TMP-7].
//!
//! Model, with `s = (t − t_r)/T_p` and the origin `t_r` at the newest entry:
//! `T = z_r + x0 + x1·s + x2·b2(s)`, `b2 = exp(−s) − 1 + s`, `D = (x1 + x2·(1 − exp(−s)))/T_p`.
//!
//! Every entry has the same sigma, so the first column of the least-squares problem is constant and its
//! orthogonalisation is a subtraction of means; the other two are orthogonalised by modified Gram-Schmidt,
//! which is as stable as Householder for least squares (Björck 1967). The weak prior on `x1` and `x2` is two more
//! rows. The triangular factor is the one that Givens rotations of all rows would give, at a fifth of the work:
//! always all 64 places, those not in use masked, so the work does not depend on the data.
use super::window::{Entry, RING, Window};
use super::{Scalar, real};
use crate::number::each;
use crate::saved::{Blank, saved};

/// Prior sigma of the rate, degC/s: 100 degC/h.
const RATE_SIGMA: f64 = 100.0 / 3600.0;
/// Prior sigma of the rate's change, degC/s²: 400 degC/h².
const CURVATURE_SIGMA: f64 = 400.0 / (3600.0 * 3600.0);

/// What the regression needs to know of the model.
#[derive(Clone, Copy, Debug)]
pub struct Model<F> {
    /// Time constant `T_p`, s.
    pub time_constant: F,
    /// Sigma of every entry, degC.
    pub sigma: F,
}

/// The fitted model with the triangular factor of its normal matrix.
#[derive(Clone, Copy, Debug)]
pub struct Fit<F> {
    model: Model<F>,
    /// The newest entry, at `t_r`; `z_r` is kept apart, so that what is measured from it is rounded alike at every
    /// temperature.
    newest: Entry<F>,
    /// x0, degC.
    offset: F,
    /// x1, degC.
    slope: F,
    /// x2, degC.
    curvature: F,
    mean_s: F,
    mean_b2: F,
    /// R22 and R33 of the triangular factor, and R23/R22; the first row is known from the means.
    r_slope: F,
    r_curvature: F,
    shear: F,
    inverse_count: F,
}

/// Temperature and rate of a fit at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<F> {
    /// degC.
    pub temperature: F,
    /// degC/s.
    pub rate: F,
    /// 1-σ, degC.
    pub temperature_sigma: F,
    /// 1-σ, degC/s.
    pub rate_sigma: F,
}

impl<F: Scalar> Fit<F> {
    /// The constant `level` (degC), for a start; its sigmas mean nothing.
    pub fn constant(origin_ms: u64, level: F) -> Self {
        let (zero, one) = (F::zero(), F::one());
        Self {
            model: Model { time_constant: one, sigma: zero },
            newest: Entry::new(origin_ms, level),
            offset: zero,
            slope: zero,
            curvature: zero,
            mean_s: zero,
            mean_b2: zero,
            r_slope: one,
            r_curvature: one,
            shear: zero,
            inverse_count: one,
        }
    }

    /// Fits the model to the entries of `window` [TMP-7].
    pub fn of(window: &Window<F>, model: Model<F>) -> Self {
        let newest = window.newest();
        let inverse_count = F::one() / F::from_usize(window.len()).unwrap_or_else(F::one);

        let mut columns = Columns::empty();
        columns.fill(window, &newest, F::one() / model.time_constant);
        let means =
            [&columns.s, &columns.b2, &columns.z].map(|numbers| total(&sums(numbers)) * inverse_count);
        let [mean_s, mean_b2, mean_z] = means;

        // First column (constant) out; second column's products. The prior's rows are (p1, 0 | 0), (0, p2 | 0).
        let p1 = model.sigma / (real::<F>(RATE_SIGMA) * model.time_constant);
        let p2 = model.sigma / (real::<F>(CURVATURE_SIGMA) * model.time_constant * model.time_constant);
        let [ss, sb, sz] = columns.take_out_means(means).each_ref().map(total);
        let ss = p1 * p1 + ss;

        // Second column out of the third and of the right-hand side.
        let (shear, gain) = (sb / ss, sz / ss);
        let [bb, bz] = columns.products_without_slope(shear, gain).each_ref().map(total);
        let bb = p2 * p2 + shear * shear * p1 * p1 + bb;
        let bz = shear * gain * p1 * p1 + bz;

        let curvature = bz / bb;
        let slope = gain - shear * curvature;
        Self {
            model,
            newest,
            offset: mean_z - slope * mean_s - curvature * mean_b2,
            slope,
            curvature,
            mean_s,
            mean_b2,
            r_slope: ss.sqrt(),
            r_curvature: bb.sqrt(),
            shear,
            inverse_count,
        }
    }

    /// How far the model lies above `value` (degC) at `time_ms`: the same to the last bit at every temperature, when
    /// `value` lies on the grid of the thermometer.
    pub fn above(&self, value: F, time_ms: u64) -> F {
        let s = self.newest.seconds_until(time_ms) / self.model.time_constant;
        (self.newest.value - value) + self.above_reference(s, exponential_remainder(-s))
    }

    /// `x0 + x1·s + x2·b2`, degC [TMP-3].
    fn above_reference(&self, s: F, b2: F) -> F {
        self.offset + (self.slope * s + self.curvature * b2)
    }

    /// Temperature and rate at `time_ms` [TMP-3] with their sigmas `|R^-T b|` [TMP-7].
    pub fn at(&self, time_ms: u64) -> Estimate<F> {
        let tp = self.model.time_constant;
        let s = self.newest.seconds_until(time_ms) / tp;
        let b2 = exponential_remainder(-s);
        // 1 − exp(−s), without its cancellation.
        let rise = s - b2;

        // Forward substitution of (1, s, b2) and of (0, 1, rise) with R^T.
        let t1 = (s - self.mean_s) / self.r_slope;
        let t2 = (b2 - self.mean_b2 - self.shear * (s - self.mean_s)) / self.r_curvature;
        let d1 = F::one() / self.r_slope;
        let d2 = (rise - self.shear) / self.r_curvature;
        Estimate {
            temperature: self.newest.value + self.above_reference(s, b2),
            rate: (self.slope + self.curvature * rise) / tp,
            temperature_sigma: self.model.sigma * (self.inverse_count + t1 * t1 + t2 * t2).sqrt(),
            rate_sigma: self.model.sigma * (d1 * d1 + d2 * d2).sqrt() / tp,
        }
    }
}

/// A sum is made of four, of every fourth number each, so that a host takes four at once.
const SUMS: usize = 4;
const _: () = assert!(RING.is_multiple_of(SUMS));

/// The least-squares problem: a row for each place of the window, zero where there is no entry.
struct Columns<F> {
    /// One where there is an entry: the column of the constant.
    used: [F; RING],
    s: [F; RING],
    b2: [F; RING],
    /// Right-hand side z − z_r, degC.
    z: [F; RING],
}

/// What follows is not in line: a compiler that sees how the four sums are added up in the end pairs them for that from the beginning,
/// and takes two at a time instead of four.
impl<F: Scalar> Columns<F> {
    /// Of no entry.
    fn empty() -> Self {
        Self { used: [F::zero(); RING], s: [F::zero(); RING], b2: [F::zero(); RING], z: [F::zero(); RING] }
    }

    /// `inverse_tp`: 1/T_p, 1/s.
    #[inline(always)]
    fn fill(&mut self, window: &Window<F>, newest: &Entry<F>, inverse_tp: F) {
        for place in 0..RING {
            let (used, seconds, above) = window.beside(newest, place);
            self.used[place] = used;
            self.s[place] = seconds * inverse_tp;
            self.z[place] = above;
        }
        // From both halves at once: what is done to one need not wait for what was done to it before.
        let (one_s, other_s) = self.s.split_at(RING / 2);
        let (one_b2, other_b2) = self.b2.split_at_mut(RING / 2);
        for (((b2, s), other_b2), other_s) in one_b2.iter_mut().zip(one_s).zip(other_b2).zip(other_s) {
            *b2 = exponential_remainder(-*s);
            *other_b2 = exponential_remainder(-*other_s);
        }
    }

    /// Takes the constant out of s, b2 and z, whose means are given. Returns the sums of s·s, s·b2 and s·z.
    #[inline(never)]
    fn take_out_means(&mut self, [mean_s, mean_b2, mean_z]: [F; 3]) -> [[F; SUMS]; 3] {
        let [mut ss, mut sb, mut sz] = [[F::zero(); SUMS]; 3];
        let columns = self.s.as_chunks_mut::<SUMS>().0.iter_mut().zip(self.b2.as_chunks_mut::<SUMS>().0);
        let rows = columns.zip(self.z.as_chunks_mut::<SUMS>().0).zip(self.used.as_chunks::<SUMS>().0);
        for (((s, b2), z), used) in rows {
            *s = each!(|i| s[i] - used[i] * mean_s; 0 1 2 3);
            *b2 = each!(|i| b2[i] - used[i] * mean_b2; 0 1 2 3);
            *z = each!(|i| z[i] - used[i] * mean_z; 0 1 2 3);
            ss = each!(|i| ss[i] + s[i] * s[i]; 0 1 2 3);
            sb = each!(|i| sb[i] + s[i] * b2[i]; 0 1 2 3);
            sz = each!(|i| sz[i] + s[i] * z[i]; 0 1 2 3);
        }
        [ss, sb, sz]
    }

    /// The sums of b2·b2 and b2·z, with `shear` times s out of b2 and `gain` times s out of z.
    #[inline(never)]
    fn products_without_slope(&self, shear: F, gain: F) -> [[F; SUMS]; 2] {
        let [mut bb, mut bz] = [[F::zero(); SUMS]; 2];
        let rows = self
            .s
            .as_chunks::<SUMS>()
            .0
            .iter()
            .zip(self.b2.as_chunks::<SUMS>().0)
            .zip(self.z.as_chunks::<SUMS>().0);
        for ((s, b2), z) in rows {
            let b2 = each!(|i| b2[i] - shear * s[i]; 0 1 2 3);
            let z = each!(|i| z[i] - gain * s[i]; 0 1 2 3);
            bb = each!(|i| bb[i] + b2[i] * b2[i]; 0 1 2 3);
            bz = each!(|i| bz[i] + b2[i] * z[i]; 0 1 2 3);
        }
        [bb, bz]
    }
}

/// Four sums of numbers; not in line either.
#[inline(never)]
fn sums<F: Scalar>(numbers: &[F; RING]) -> [F; SUMS] {
    let mut sums = [F::zero(); SUMS];
    for n in numbers.as_chunks::<SUMS>().0 {
        sums = each!(|i| sums[i] + n[i]; 0 1 2 3);
    }
    sums
}

/// Not in line: once is enough in flash.
#[inline(never)]
fn total<F: Scalar>([a, b, c, d]: &[F; SUMS]) -> F {
    (*a + *b) + (*c + *d)
}

/// 1/9!, 1/8!, … 1/2!.
const SERIES: [f64; 8] =
    [1.0 / 362880.0, 1.0 / 40320.0, 1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];

/// `exp(u) − 1 − u` to working precision for |u| ≤ 4: a polynomial at u/8, then
/// `r(2v) = (exp(v) − 1)² + 2·r(v)` three times. No term cancels, unlike the definition at small u.
pub fn exponential_remainder<F: Scalar>(u: F) -> F {
    let mut v = u * real(0.125);
    let [first, others @ ..] = &SERIES;
    let mut remainder = others.iter().fold(real(*first), |sum: F, c| sum * v + real(*c)) * v * v;
    for _ in 0..3 {
        let growth = v + remainder;
        remainder = growth * growth + (remainder + remainder);
        v += v;
    }
    remainder
}

saved!([F: Blank] Model<F> { time_constant, sigma });
saved!([F: Blank] Fit<F> {
    model,
    newest,
    offset,
    slope,
    curvature,
    mean_s,
    mean_b2,
    r_slope,
    r_curvature,
    shear,
    inverse_count,
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tmp_3_exponential_remainder_matches_its_definition() {
        for k in -400..=400 {
            let u = f64::from(k) / 100.0;
            // expm1 is exact enough where the definition is not.
            let expected = libm_expm1(u) - u;
            let got = exponential_remainder(u);
            assert!((got - expected).abs() <= 2e-9 * expected.abs() + 1e-16, "{u}: {got} {expected}");
            let single = f64::from(exponential_remainder(u as f32));
            assert!((single - expected).abs() <= 2e-6 * expected.abs() + 1e-12, "{u}: {single} {expected}");
        }
    }

    fn libm_expm1(u: f64) -> f64 {
        nalgebra::ComplexField::exp_m1(u)
    }
}
