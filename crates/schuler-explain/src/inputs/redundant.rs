//! The motion that redundant sensors agree on: weighted least squares on their axes, row by row.
//!
//! Where fewer than three independent axes are there, the estimate is the shortest that fits, whose component along
//! every sensor's axis is still that of the least-squares fit. For a Doppler log beside an inertial system, which
//! measure one quantity, it is their weighted mean.
use std::collections::HashMap;

use nalgebra::{Matrix3xX, MatrixXx3, Vector3};
use schuler_recording::Recording;
use schuler_recording::case::Sensor;
use schuler_recording::unit::Dimension;

/// Singular values below this part of the largest are 0.
const RANK_TOLERANCE: f64 = 1e-6;

/// Motion of the given dimension in body axes, SI units; NaN where no sensor has a reading. None without sensors.
pub fn estimate(recording: &Recording, dimension: Dimension) -> Option<[Vec<f64>; 3]> {
    let sensors: Vec<_> =
        recording.sensors.iter().filter(|series| series.sensor.kind.dimension() == dimension).collect();
    if sensors.is_empty() {
        return None;
    }
    let axes: Vec<Vector3<f64>> = sensors.iter().map(|series| axis_of(&series.sensor)).collect();
    let weights: Vec<f64> = sensors.iter().map(|series| 1.0 / noise_of(&series.sensor)).collect();
    let mut solutions: HashMap<Vec<bool>, Matrix3xX<f64>> = HashMap::new();
    let mut columns = [(); 3].map(|()| Vec::with_capacity(recording.len()));
    let mut present = vec![false; sensors.len()];
    let mut last: Option<Vec<bool>> = None;
    for row in 0..recording.len() {
        for (present, series) in present.iter_mut().zip(&sensors) {
            *present = series.values.get(row).is_some_and(|value| value.is_finite());
        }
        if last.as_ref() != Some(&present) {
            if !solutions.contains_key(&present) {
                solutions.insert(present.clone(), solution(&axes, &weights, &present));
            }
            last = Some(present.clone());
        }
        let mut sum = Vector3::repeat(if present.contains(&true) { 0.0 } else { f64::NAN });
        if let Some(solution) = solutions.get(&present) {
            for (index, series) in sensors.iter().enumerate().filter(|&(index, _)| present[index]) {
                sum += solution.column(index) * (series.values[row] - series.sensor.nominal.bias);
            }
        }
        for (column, value) in columns.iter_mut().zip(sum.iter()) {
            column.push(*value);
        }
    }
    Some(columns)
}

/// Axis of a sensor; a velocity without one is along x.
pub fn axis_of(sensor: &Sensor) -> Vector3<f64> {
    sensor.axis.map_or(Vector3::x(), Vector3::from)
}

/// Standard deviation of the sensor's nominal noise, in its unit.
fn noise_of(sensor: &Sensor) -> f64 {
    let nominal = &sensor.nominal;
    let variance = nominal.white.powi(2)
        + nominal.markov.map_or(0.0, |markov| markov.sigma.powi(2))
        + nominal.exp_cos.map_or(0.0, |noise| noise.sigma.powi(2));
    if variance > 0.0 { variance.sqrt() } else { 1.0 }
}

/// The matrix that turns readings into the estimate, 0 for absent sensors.
fn solution(axes: &[Vector3<f64>], weights: &[f64], present: &[bool]) -> Matrix3xX<f64> {
    let weight = |index: usize| if present[index] { weights[index] } else { 0.0 };
    let largest = (0..axes.len()).map(weight).fold(0.0, f64::max);
    let relative = |index: usize| if largest > 0.0 { weight(index) / largest } else { 0.0 };
    let weighted = MatrixXx3::from_fn(axes.len(), |row, column| relative(row) * axes[row][column]);
    let mut inverse =
        weighted.pseudo_inverse(RANK_TOLERANCE).unwrap_or_else(|_| Matrix3xX::zeros(axes.len()));
    for (index, mut column) in inverse.column_iter_mut().enumerate() {
        column *= relative(index);
    }
    inverse
}
