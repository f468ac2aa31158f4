//! Transforms against the sum that defines them. Beside the crate and not in it, so that its kernels are compiled once.
use std::f64::consts::TAU;

use schuler_fourier::{Complex, Forward, Inverse};

/// Against the sum that defines it, for lengths with and without a large prime, odd and even, and the way back.
#[test]
fn a_transform_is_its_sum_and_comes_back() {
    for length in [1, 2, 7, 31, 60, 64, 202] {
        let values: Vec<f64> = (0..length).map(|k| f64::from((k * k + 3 * k) % 17) - 8.0).collect();
        let scale = f64::from(length);
        let bins = Forward::new(values.len()).transform(values.iter().copied());
        assert_eq!(bins.len(), values.len() / 2 + 1);
        for (m, bin) in (0_i32..).zip(&bins) {
            let term = |(k, x): (i32, &f64)| Complex::from_polar(*x, -TAU * f64::from(k * m) / scale);
            let sum: Complex<f64> = (0..).zip(&values).map(term).sum();
            assert!((bin - sum).norm() < 1e-12 * scale * scale, "{length} values, bin {m}: {bin} for {sum}");
        }
        let again = Inverse::new(values.len()).transform(bins);
        assert_eq!(again.len(), values.len());
        for (value, again) in values.iter().zip(again) {
            assert!((again - value * scale).abs() < 1e-12 * scale * scale, "{length}: {again} for {value}");
        }
    }
}

#[test]
fn what_is_short_is_followed_by_zeros_and_what_is_long_is_cut() {
    let of = |values: &[f64]| Forward::new(4).transform(values.iter().copied());
    assert_eq!(of(&[3.0, -1.0]), of(&[3.0, -1.0, 0.0, 0.0]));
    assert_eq!(of(&[3.0, -1.0, 2.0, 5.0, 7.0]), of(&[3.0, -1.0, 2.0, 5.0]));
    let back = |bins: &[Complex<f64>]| Inverse::new(4).transform(bins.iter().copied());
    let [bin, zero] = [Complex::new(2.0, -3.0), Complex::default()];
    assert_eq!(back(&[bin, bin]), back(&[Complex::from(2.0), bin, zero]));
    assert_eq!(back(&[zero, zero, bin, bin]), back(&[zero, zero, Complex::from(2.0)]));
}

#[test]
fn nothing_has_a_bin_of_nothing() {
    assert_eq!(Forward::new(0).transform([1.0]), [Complex::default()]);
    assert!(Inverse::new(0).transform([Complex::default()]).is_empty());
}
