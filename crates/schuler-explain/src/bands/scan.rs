//! Scores of a step, a ramp and a line at every place of a source, from the scores of its unit impulses.
use std::f64::consts::TAU;

use schuler_fourier::{Complex, Forward};

/// Zeros behind a record, in its lengths, so that lines between the bins are seen.
const PADDING: usize = 2;

/// Scores of a step that begins at each row: sums of the impulses from there on.
pub fn steps(impulses: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut scores: Vec<f64> = (impulses.iter().rev())
        .map(|value| {
            sum += value;
            sum
        })
        .collect();
    scores.reverse();
    scores
}

/// Scores of a ramp that rises by one a row from each row on.
pub fn ramps(impulses: &[f64]) -> Vec<f64> {
    let mut scores = steps(impulses);
    // A ramp from row k on is the sum of steps from k + 1 on.
    scores.rotate_left(1.min(impulses.len()));
    if let Some(last) = scores.last_mut() {
        *last = 0.0;
    }
    steps(&scores)
}

/// Scores of cos ωt − i sin ωt at frequencies from 0 to half a turn a row.
pub fn lines(impulses: &[f64]) -> Lines {
    let length = padded(impulses.len());
    Lines { scores: Forward::new(length).transform(impulses.iter().copied()), step: TAU / length as f64 }
}

/// Difference of the frequencies at which a record of so many rows is scanned for lines, rad a row, and their number.
pub fn raster(rows: usize) -> (f64, usize) {
    let length = padded(rows);
    (TAU / length as f64, length / 2 + 1)
}

fn padded(rows: usize) -> usize {
    (PADDING * rows).next_power_of_two()
}

/// Scores of lines.
pub struct Lines {
    /// One a frequency.
    pub scores: Vec<Complex<f64>>,
    /// Difference of frequencies, rad a row.
    pub step: f64,
}

/// Values between knots that are given at increasing rows.
pub fn interpolated(knots: &[(usize, f64)], row: usize) -> f64 {
    let after = knots.partition_point(|(at, _)| *at < row);
    match (after.checked_sub(1).and_then(|before| knots.get(before)), knots.get(after)) {
        (Some(&(from, low)), Some(&(to, high))) => {
            low + (high - low) * (row - from) as f64 / (to - from).max(1) as f64
        }
        (Some(&(_, value)), None) | (None, Some(&(_, value))) => value,
        (None, None) => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_products_with_the_shapes() {
        let impulses = [0.5, -1.0, 2.0, 0.25, 1.0];
        let product = |shape: &dyn Fn(usize) -> f64| -> f64 {
            impulses.iter().enumerate().map(|(row, value)| value * shape(row)).sum()
        };
        for onset in 0..impulses.len() {
            let step = product(&|row| f64::from(u8::from(row >= onset)));
            let ramp = product(&|row| row.saturating_sub(onset) as f64);
            assert!((steps(&impulses)[onset] - step).abs() < 1e-12);
            assert!((ramps(&impulses)[onset] - ramp).abs() < 1e-12);
        }
    }

    #[test]
    fn between_knots_values_go_straight() {
        let knots = [(2, 1.0), (6, 3.0)];
        assert_eq!([0, 2, 4, 6, 9].map(|row| interpolated(&knots, row)), [1.0, 1.0, 2.0, 3.0, 3.0]);
    }
}
