#![doc = include_str!("../README.md")]
use std::iter;
use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

pub use realfft::num_complex::Complex;

/// The transform of a real series, Σ x(k) exp(−2πi k m / length), not scaled.
///
/// Never panics.
pub struct Forward(Arc<dyn RealToComplex<f64>>);

impl Forward {
    /// Of `length` values.
    pub fn new(length: usize) -> Self {
        Self(RealFftPlanner::new().plan_fft_forward(length))
    }

    /// The bins from 0 to half of the length, length/2 + 1. Zeros follow `values` up to the length; what is beyond it is not taken.
    pub fn transform(&self, values: impl IntoIterator<Item = f64>) -> Vec<Complex<f64>> {
        let mut series: Vec<f64> = values.into_iter().chain(iter::repeat(0.0)).take(self.0.len()).collect();
        let mut bins = self.0.make_output_vec();
        // Fails only for buffers of another length than these have.
        let _ = self.0.process(&mut series, &mut bins);
        bins
    }
}

/// The way back, which gives `length` times the series.
///
/// Never panics.
pub struct Inverse(Arc<dyn ComplexToReal<f64>>);

impl Inverse {
    /// To `length` values.
    pub fn new(length: usize) -> Self {
        Self(RealFftPlanner::new().plan_fft_inverse(length))
    }

    /// The series of the bins from 0 to half of the length. Zeros follow `bins` up to that; what is beyond it is not taken, nor what no
    /// real series has: an imaginary part of the first bin, and of the last of an even length.
    pub fn transform(&self, bins: impl IntoIterator<Item = Complex<f64>>) -> Vec<f64> {
        let length = self.0.len();
        let zeros = iter::repeat(Complex::default());
        let mut bins: Vec<Complex<f64>> = bins.into_iter().chain(zeros).take(length / 2 + 1).collect();
        let mut series = self.0.make_output_vec();
        // Fails only for buffers of another length than these have, and tells of imaginary parts that it left out.
        let _ = self.0.process(&mut bins, &mut series);
        series
    }
}
