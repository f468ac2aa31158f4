//! The motion that redundant sensors agree on: weighted least squares on their axes, row by row.
//!
//! Where fewer than three independent axes are there, the estimate is the shortest that fits, whose component along
//! every sensor's axis is still that of the least-squares fit. For a Doppler log beside an inertial system, which
//! measure one quantity, it is their weighted mean.
//!
//! What the residuals tell of the sensors' noise is taken out of it ([`noise_told`]). What is left of the noise is then uncorrelated
//! with the residuals, as that of weighted least squares is where all noise is white. With it the drift of an inertial velocity, which is
//! in the residual as well, would be an input that the log beside it does not answer to: a dead zone, a scale factor.
//!
//! The estimate is then smoothed: its white noise is the sensors' own, which is in their difference as well, so that a
//! lag or a delay of the noise would be found where there is none. What changes from row to row more than the noise does
//! stays.
use std::collections::HashMap;

use nalgebra::{Matrix3xX, MatrixXx3, Vector3};
use schuler_recording::Recording;
use schuler_recording::case::Sensor;
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::Dimension;

use super::series::range;
use super::smoother::{Measurement, process_noise, smooth};
use crate::catalogue::Port;
use crate::common_motion::CommonMotion;
use crate::description::{left_of, project};
use crate::faults::faults;
use crate::noise::Noise;
use crate::nominal::{Block, Model};

/// Singular values below this part of the largest are 0.
pub const RANK_TOLERANCE: f64 = 1e-6;

/// What is known of the noise of a sensor.
pub struct KnownNoise {
    sensor: usize,
    noise: Noise,
    /// Its expected value beside the residuals, SI, in every row.
    told: Vec<f64>,
}

/// What the residuals p tell of the noise n of the sensors, E[n | p] = Cov(n, p) R⁻¹ p. What is left of n is uncorrelated with p. Of sensors
/// that nothing checks there is nothing.
pub fn noise_told(recording: &Recording) -> Vec<KnownNoise> {
    let Ok(model) = Model::new(recording, &[]) else { return Vec::new() };
    let masked = faults(recording, &model).masked;
    let Ok(model) = Model::new(recording, &masked) else { return Vec::new() };
    let motions = CommonMotion::of_model(&model, recording, &masked);
    let noises = motions.iter().fold(model.nominal_noises(), |noises, motion| motion.fitted(&noises));
    let of_block = |(index, block): (usize, &Block)| -> Vec<KnownNoise> {
        let Some(filter) = block.filter(&noises) else { return Vec::new() };
        let left = left_of(&filter, project(&model, index, &[]));
        let innovations = filter.whiten(&[&left]).swap_remove(0);
        let scores = filter.adjoint(&innovations);
        let of_sensor = |(&sensor, &source): (&usize, &usize)| {
            let scores = block.back_project(&scores, sensor, Port::Output)?;
            let noise = noises[source].clone();
            Some(KnownNoise { sensor, told: noise.covariance_times(&scores, model.step_s), noise })
        };
        block.sensors.iter().zip(&block.sources).filter_map(of_sensor).collect()
    };
    model.blocks.iter().enumerate().flat_map(of_block).collect()
}

/// Motion of the given dimension in body axes, SI units; NaN where no sensor has a reading. None without sensors. `known` is what is known
/// of the sensors' noise beside what the user believes.
pub fn estimate(
    recording: &Recording,
    time_s: &[f64],
    dimension: Dimension,
    known: &[KnownNoise],
) -> Option<[Vec<f64>; 3]> {
    let known: Vec<Option<&KnownNoise>> = (recording.sensors.iter().enumerate())
        .filter(|(_, series)| is_checked(series, dimension))
        .map(|(index, _)| known.iter().find(|known| known.sensor == index))
        .collect();
    let sensors: Vec<_> = recording.sensors.iter().filter(|series| is_checked(series, dimension)).collect();
    if sensors.is_empty() {
        return None;
    }
    let axes: Vec<Vector3<f64>> = sensors.iter().map(|series| axis_of(&series.sensor)).collect();
    let noises: Vec<Noise> = (sensors.iter().zip(&known))
        .map(|(series, known)| match known {
            Some(known) => known.noise.clone(),
            None => Noise::nominal(&series.sensor.nominal, series.sensor.quantisation),
        })
        .collect();
    let weights: Vec<f64> = noises.iter().map(|noise| 1.0 / deviation(noise)).collect();
    let mut solutions: HashMap<Vec<bool>, Matrix3xX<f64>> = HashMap::new();
    let white: Vec<f64> = noises.iter().map(Noise::white_variance).collect();
    let mut columns = [(); 3].map(|()| Vec::with_capacity(recording.len()));
    let mut variances = [(); 3].map(|()| Vec::with_capacity(recording.len()));
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
        let mut variance = Vector3::zeros();
        if let Some(solution) = solutions.get(&present) {
            for (index, series) in sensors.iter().enumerate().filter(|&(index, _)| present[index]) {
                let noise = known[index].map_or(0.0, |known| known.told[row]);
                sum += solution.column(index) * (series.values[row] - series.sensor.nominal.bias - noise);
                variance += solution.column(index).map(|weight| weight * weight * white[index]);
            }
        }
        for (column, value) in variances.iter_mut().zip(variance.iter()) {
            column.push(*value);
        }
        for (column, value) in columns.iter_mut().zip(sum.iter()) {
            column.push(*value);
        }
    }
    for (column, variances) in columns.iter_mut().zip(&variances) {
        smoothed(time_s, column, variances);
    }
    Some(columns)
}

/// Whether a sensor measures the given dimension and nothing but others like it says what it should read.
pub fn is_checked(series: &SensorSeries, dimension: Dimension) -> bool {
    series.sensor.kind.dimension() == dimension && series.predicted.is_none()
}

/// Takes white noise of known variance out of a series, as far as the series itself changes less from row to row.
fn smoothed(time_s: &[f64], values: &mut [f64], variances: &[f64]) {
    let measurements: Vec<Measurement> = (values.iter().zip(variances).enumerate())
        .filter(|(_, (value, variance))| value.is_finite() && **variance > 0.0)
        .map(|(row, (&value, &variance))| Measurement { row, before_s: 0.0, value, variance })
        .collect();
    let known: Vec<f64> = measurements.iter().map(|measurement| measurement.value).collect();
    let scale = range(&known);
    let finite = values.iter().filter(|value| value.is_finite()).count();
    if scale == 0.0 || measurements.len() < finite {
        return;
    }
    let (process, _) = process_noise(time_s, &measurements, scale);
    let smoothed = smooth(time_s, &measurements, process, scale);
    for (value, smoothed) in values.iter_mut().zip(smoothed.value) {
        if value.is_finite() && smoothed.is_finite() {
            *value = smoothed;
        }
    }
}

/// Axis of a sensor; a velocity without one is along x.
pub fn axis_of(sensor: &Sensor) -> Vector3<f64> {
    sensor.axis.map_or(Vector3::x(), Vector3::from)
}

/// Standard deviation of what of a noise has one; 1 where nothing has.
fn deviation(noise: &Noise) -> f64 {
    let variance = noise.white.powi(2)
        + noise.markov.iter().map(|part| part.sigma.powi(2)).sum::<f64>()
        + noise.exp_cos.iter().map(|part| part.sigma.powi(2)).sum::<f64>();
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
