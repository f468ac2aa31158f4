//! Bands of a cosine transform.
use std::f64::consts::PI;
use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};

/// Zeros behind the rows at most, as a part of their number.
const PADDING: f64 = 0.01;
/// Prime factors of a number of coefficients that is transformed fast.
const FACTORS: [usize; 5] = [2, 3, 5, 7, 11];

/// Bands of the coefficients of a cosine transform, and the transform.
///
/// Rows are filled up with zeros to a number of small prime factors, where one is near, as others are transformed many times slower.
/// White noise of the rows then has as much less variance in each coefficient as there are more coefficients, so that the coefficients of
/// a band count for as many less.
pub struct Layout {
    /// Coefficient with which each band begins, and the number of all.
    pub edges: Vec<usize>,
    /// Frequency in the middle of each band, rad a row.
    pub omega: Vec<f64>,
    /// Rows for which the coefficients of each band count.
    pub count: Vec<f64>,
    transform: Arc<dyn TransformType2And3<f64>>,
    rows: usize,
    coefficients: usize,
}

impl Layout {
    /// Bands of the coefficients of `rows`: the first `single` by themselves, then of a constant `ratio`; about the frequencies `resolved`, rad a
    /// row, narrower ones, each as wide as it is away.
    pub fn new(rows: usize, single: usize, ratio: f64, resolved: &[f64]) -> Self {
        let coefficients = coefficients(rows);
        let mut edges: Vec<usize> = (0..=single.min(coefficients)).collect();
        while let Some(&last) = edges.last().filter(|last| **last < coefficients) {
            edges.push(((last as f64 * ratio).ceil() as usize).max(last + 1).min(coefficients));
        }
        let number = coefficients as f64;
        for omega in resolved {
            let middle = (omega * number / PI).round().clamp(0.0, number) as usize;
            let about = std::iter::successors(Some(1), |away| Some(2 * away))
                .take_while(|away| (*away as f64) < (ratio - 1.0) * middle as f64);
            edges.extend(
                about.flat_map(|away| [middle.saturating_sub(away), (middle + away).min(coefficients)]),
            );
        }
        edges.sort_unstable();
        edges.dedup();
        let middle = |pair: &[usize]| {
            let (first, last) = (pair[0] as f64, pair[1] as f64 - 1.0);
            PI / number * (first.max(0.5) * last.max(0.5)).sqrt()
        };
        Self {
            omega: edges.windows(2).map(middle).collect(),
            count: edges.windows(2).map(|pair| (pair[1] - pair[0]) as f64 * rows as f64 / number).collect(),
            edges,
            transform: DctPlanner::new().plan_dct2(coefficients),
            rows,
            coefficients,
        }
    }

    /// The band of a frequency, rad a row.
    pub fn band_of(&self, omega: f64) -> usize {
        let coefficient = (omega * self.coefficients as f64 / PI) as usize;
        let band = self.edges.partition_point(|edge| *edge <= coefficient).saturating_sub(1);
        band.min(self.bands().saturating_sub(1))
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.count.len()
    }

    /// Number of coefficients.
    pub fn coefficients(&self) -> usize {
        self.coefficients
    }

    /// Orthonormal cosine transform, in place: from as many values as there are rows to the coefficients.
    pub fn transform(&self, values: &mut Vec<f64>) {
        values.resize(self.coefficients, 0.0);
        self.transform.process_dct2(values);
        let scale = (2.0 / self.coefficients as f64).sqrt();
        for value in values.iter_mut() {
            *value *= scale;
        }
        if let Some(first) = values.first_mut() {
            *first *= 0.5_f64.sqrt();
        }
    }

    /// Its transpose, which is its inverse: from the coefficients to the rows.
    pub fn inverse(&self, values: &mut Vec<f64>) {
        let scale = (2.0 / self.coefficients as f64).sqrt();
        for value in values.iter_mut() {
            *value *= scale;
        }
        if let Some(first) = values.first_mut() {
            // The transform takes half of the first coefficient.
            *first *= 2.0_f64.sqrt();
        }
        self.transform.process_dct3(values);
        values.truncate(self.rows);
    }

    /// Sums of the products of two series of coefficients by band; the shorter one is zero where it ends.
    pub fn products(&self, a: &[f32], b: &[f32]) -> Vec<f64> {
        let end = a.len().min(b.len());
        let mut sums = vec![0.0; self.bands()];
        for (sum, edge) in sums.iter_mut().zip(self.edges.windows(2)) {
            let (from, to) = (edge[0].min(end), edge[1].min(end));
            *sum = dot(&a[from..to], &b[from..to]);
        }
        sums
    }
}

/// The least number from `rows` on that has small prime factors alone, where it is near.
fn coefficients(rows: usize) -> usize {
    let is_fast = |number: &usize| {
        let divided = |rest: usize, factor: &usize| {
            std::iter::successors(Some(rest), |rest| rest.is_multiple_of(*factor).then(|| rest / factor))
                .last()
        };
        FACTORS.iter().try_fold(*number, divided) == Some(1)
    };
    let most = rows + (PADDING * rows as f64) as usize;
    (rows.max(1)..=most).find(is_fast).unwrap_or(rows)
}

/// Sum of products, in double precision from single.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0_f64; LANES];
    let (a_lanes, b_lanes) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a_lanes.remainder().iter().zip(b_lanes.remainder());
    let rest: f64 = rest.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
    for (a, b) in a_lanes.zip(b_lanes) {
        for lane in 0..LANES {
            sums[lane] += f64::from(a[lane]) * f64::from(b[lane]);
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_filled_up_to_a_number_of_small_factors_where_one_is_near() {
        assert_eq!([1, 121, 149, 1009, 4134, 30_001].map(coefficients), [1, 121, 150, 1009, 4158, 30_184]);
        let layout = Layout::new(4134, 8, 1.2, &[]);
        let values: Vec<f64> = (0..4134).map(|row| (0.37 * row as f64).sin()).collect();
        let mut there = values.clone();
        layout.transform(&mut there);
        assert_eq!(there.len(), layout.coefficients());
        layout.inverse(&mut there);
        assert!(there.len() == 4134 && there.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!((layout.count.iter().sum::<f64>() - 4134.0).abs() < 1e-9);
    }

    #[test]
    fn the_transform_is_orthonormal_and_inverse_to_itself() {
        let rows = 150;
        let layout = Layout::new(rows, 8, 1.2, &[]);
        let values: Vec<f64> = (0..rows).map(|row| (0.37 * row as f64).sin() + 0.01 * row as f64).collect();
        let mut there = values.clone();
        layout.transform(&mut there);
        let energy = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
        assert!((energy(&there) / energy(&values) - 1.0).abs() < 1e-12);
        layout.inverse(&mut there);
        assert!(there.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(layout.edges.last(), Some(&rows));
        assert_eq!(layout.count.iter().sum::<f64>(), rows as f64);
    }

    #[test]
    fn bands_are_narrow_about_what_is_resolved() {
        let omega = 1.0;
        let (wide, narrow) = (Layout::new(10_000, 8, 1.2, &[]), Layout::new(10_000, 8, 1.2, &[omega]));
        let width = |layout: &Layout, omega: f64| layout.count[layout.band_of(omega)];
        assert!(width(&wide, omega) > 100.0);
        assert!(width(&narrow, omega) <= 2.0);
        assert_eq!(width(&narrow, 2.0), width(&wide, 2.0));
        assert_eq!(narrow.count.iter().sum::<f64>(), 10_000.0);
    }
}
