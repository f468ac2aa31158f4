//! Scores of steps and ramps at every onset, and of sinusoids at every frequency, from one adjoint pass.
//!
//! With q = R⁻¹r the score of a step at t₀ is Σ q from t₀ on, of a ramp the sum of those sums; the energy of the
//! whitened response of the settled filter is the denominator. The score of a sinusoid is the Fourier transform of q,
//! and the inverse of the model's spectrum its denominator. What is already described is projected out. What stands out
//! is evaluated exactly by the caller. The price of the search is the tail of the maximum over the chain of scores,
//! whose neighbours' correlations follow from the denominators alone.
use nalgebra::{Complex, DMatrix, DVector};
use realfft::RealFftPlanner;

use crate::catalogue::{Column, OnsetShape, Port};
use crate::least_squares::{dot, solve};
use crate::noise::Noise;
use crate::nominal::Block;
use crate::statistics::{ln_frequency_scan_tail, ln_rough_scan_tail, ln_smooth_scan_tail};
use crate::whiten::Filter;

/// Rows that must lie on both sides of an onset.
const MARGIN_ROWS: usize = 10;
/// Part of its energy that a signature must keep when what is described is taken out.
const SEEN: f64 = 0.02;
/// Peaks that are reported.
const PEAKS: usize = 3;
/// Fewest periods in the record.
const FEWEST_PERIODS: f64 = 2.0;
/// Most links of the chain for which correlations are computed one by one.
const CHAIN: usize = 20_000;

/// A place where a signature stands out.
#[derive(Clone, Copy, Debug)]
pub struct Peak {
    /// Onset, s from the first row, or frequency, Hz.
    pub at: f64,
    /// Gain in log-likelihood there.
    pub gain: f64,
}

/// What a scan found.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Where, best first.
    pub peaks: Vec<Peak>,
    /// ln of the effective number of places searched, at the best one's gain.
    pub ln_places: f64,
}

/// A block ready to be scanned.
pub struct Scanner<'b> {
    block: &'b Block,
    filter: &'b Filter,
    /// R⁻¹ of the residual after the regressors, channels.
    scores: Vec<f64>,
    /// R⁻¹ of the regressors.
    regressors: Vec<Vec<f64>>,
    inverse: DMatrix<f64>,
}

impl<'b> Scanner<'b> {
    /// `remainder`: whitened residual after the regressors; `regressors`: whitened.
    pub fn new(block: &'b Block, filter: &'b Filter, remainder: &[f64], regressors: &[Vec<f64>]) -> Self {
        let size = regressors.len();
        let normal = DMatrix::from_fn(size, size, |i, j| dot(&regressors[i], &regressors[j]));
        let inverse =
            if size > 0 { solve(&normal, &DVector::zeros(size)).covariance } else { DMatrix::zeros(0, 0) };
        Self {
            block,
            filter,
            scores: filter.adjoint(remainder),
            regressors: regressors.iter().map(|column| filter.adjoint(column)).collect(),
            inverse,
        }
    }

    /// Scans all onsets of a shape on a sensor.
    pub fn onsets(&self, sensor: usize, port: Port, shape: OnsetShape, time_s: &[f64]) -> Option<Scan> {
        let rows = self.block.rows();
        let summed = |channels: &[f64]| {
            let mut values = self.block.back_project(channels, sensor, port)?;
            reverse_sum(&mut values);
            if shape == OnsetShape::Ramp {
                // Σ (k − t₀) q = sum of the sums that begin one row later.
                values.rotate_left(1);
                if let Some(last) = values.last_mut() {
                    *last = 0.0;
                }
                reverse_sum(&mut values);
            }
            Some(values)
        };
        let scores = summed(&self.scores)?;
        let regressors: Vec<Vec<f64>> = self.regressors.iter().map(|r| summed(r)).collect::<Option<_>>()?;
        let step = self.energy(sensor, port, OnsetShape::Step)?;
        let own = if shape == OnsetShape::Step { step.clone() } else { self.energy(sensor, port, shape)? };
        // Energy of a signature at each onset, less what is missing.
        let mut after = 0.0;
        let mut present = vec![0.0; rows];
        for row in (0..rows).rev() {
            after += f64::from(u8::from(self.block.present[row]));
            present[row] = after / (rows - row) as f64;
        }
        let energy_at = |row: usize| {
            let whole = own[rows - row - 1] * present[row];
            let cross = DVector::from_fn(regressors.len(), |i, _| regressors[i][row]);
            let left = whole - if cross.is_empty() { 0.0 } else { cross.dot(&(&self.inverse * &cross)) };
            if left > SEEN * whole { left } else { 0.0 }
        };
        let first = if shape == OnsetShape::Step { MARGIN_ROWS } else { 0 };
        let last = rows.saturating_sub(MARGIN_ROWS);
        let gains: Vec<f64> = (first..last.max(first))
            .map(|row| {
                let energy = energy_at(row);
                if energy > 0.0 { 0.5 * scores[row] * scores[row] / energy } else { 0.0 }
            })
            .collect();
        let gap = (rows / 50).max(3);
        let peaks: Vec<Peak> = separated(&gains, gap)
            .into_iter()
            .map(|(index, gain)| Peak { at: time_s.get(first + index).copied().unwrap_or_default(), gain })
            .collect();
        let best = peaks.first()?;
        // Neighbours: D(t) = D(t+1) + 2⟨s(t+1), increment⟩ + |increment|², with the increment of a step an impulse and
        // that of a ramp a step.
        let impulse = {
            let mut rest = step.clone();
            rest.truncate(1);
            rest.first().copied().unwrap_or_default()
        };
        let stride = (gains.len() / CHAIN).max(1);
        let mut correlations = Vec::with_capacity(gains.len() / stride);
        for row in (first..last.saturating_sub(1)).step_by(stride) {
            let (here, next) = (own[rows - row - 1], own[rows - row - 2]);
            let increment = if shape == OnsetShape::Step { impulse } else { step[rows - row - 2] };
            let cross = 0.5 * (here - next - increment);
            let correlation = (next + cross) / (here * next).sqrt();
            correlations.push(if correlation.is_finite() { correlation.clamp(-1.0, 1.0) } else { 0.0 });
        }
        let u = (2.0 * best.gain).sqrt();
        let single = crate::statistics::ln_chi_squared_tail(u * u, 1);
        // With a stride each link stands for `stride` of them.
        let repeated = correlations.iter().flat_map(|&c| std::iter::repeat_n(c, stride));
        let whole = match shape {
            OnsetShape::Step => ln_rough_scan_tail(u, repeated),
            OnsetShape::Ramp => ln_smooth_scan_tail(u, repeated),
        };
        Some(Scan { peaks, ln_places: (whole - single).max(0.0) })
    }

    /// Energy of the whitened response of the settled filter within the first 1, 2, … rows after the onset.
    fn energy(&self, sensor: usize, port: Port, shape: OnsetShape) -> Option<Vec<f64>> {
        let rows = self.block.rows();
        let values = match shape {
            OnsetShape::Step => vec![1.0; rows],
            OnsetShape::Ramp => (0..rows).map(|row| row as f64).collect(),
        };
        let response = self.block.project(&Column { parts: vec![(sensor, values)] }, port)?;
        let whitened = self.filter.settled_filter(rows).whiten(&[&response]).swap_remove(0);
        let mut sum = 0.0;
        Some(
            (0..rows)
                .map(|row| {
                    sum += (0..self.block.channels).map(|c| whitened[c * rows + row].powi(2)).sum::<f64>();
                    sum
                })
                .collect(),
        )
    }

    /// Scans all frequencies of a sinusoid on a sensor.
    pub fn frequencies(&self, sensor: usize, port: Port, noises: &[Noise]) -> Option<Scan> {
        let rows = self.block.rows();
        let count = self.block.count();
        let step_s = self.block.step_s();
        let mut padded = self.block.back_project(&self.scores, sensor, port)?;
        let length = (2 * rows).next_power_of_two();
        padded.resize(length, 0.0);
        let forward = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let mut transform = forward.make_output_vec();
        forward.process(&mut padded, &mut transform).ok()?;
        // Where the sensor enters as a source.
        let place = match port {
            Port::Output => self.block.sensors.iter().position(|&own| own == sensor)?,
            Port::Accelerometer => 1,
            Port::Gyro => 2,
        };
        let first = (FEWEST_PERIODS * length as f64 / rows as f64).ceil() as usize;
        let mut density = Density { block: self.block, noises, place, last: None };
        let gains: Vec<f64> = (first..length / 2)
            .map(|bin| {
                let omega = std::f64::consts::TAU * bin as f64 / length as f64;
                let density = density.at(omega);
                let gain = transform[bin].norm_sqr() / (count as f64 * density);
                if gain.is_finite() { gain } else { 0.0 }
            })
            .collect();
        let hertz = |bin: f64| bin / (length as f64 * step_s);
        let peaks: Vec<Peak> = separated(&gains, 2 * length / rows)
            .into_iter()
            .map(|(index, gain)| {
                // The parabola through the peak and its neighbours.
                let at = |i: usize| gains.get(i).copied().unwrap_or(gain);
                let (left, right) = (at(index.wrapping_sub(1)), at(index + 1));
                let curvature = 2.0 * gain - left - right;
                let shift = if curvature > 0.0 { 0.5 * (right - left) / curvature } else { 0.0 };
                Peak { at: hertz((first + index) as f64 + shift.clamp(-0.5, 0.5)), gain }
            })
            .collect();
        let best = peaks.first()?.gain;
        Some(Scan { peaks, ln_places: (ln_frequency_scan_tail(best, count) + best).max(0.0) })
    }
}

/// tᴴ S⁻¹ t: what a unit sinusoid's energy is multiplied by; constant over small ratios of frequency.
struct Density<'b> {
    block: &'b Block,
    noises: &'b [Noise],
    place: usize,
    last: Option<(f64, f64)>,
}

impl Density<'_> {
    fn at(&mut self, omega: f64) -> f64 {
        if let Some((reach, density)) = self.last
            && omega < reach
        {
            return density;
        }
        let block = self.block;
        let enters = DVector::from_vec(block.transfer(self.place, omega));
        let mut spectrum = DMatrix::<Complex<f64>>::zeros(block.channels, block.channels);
        for (place, &source) in block.sources.iter().enumerate() {
            let through = DVector::from_vec(block.transfer(place, omega));
            let power = self.noises[source].spectrum(omega, block.step_s());
            spectrum += &through * through.adjoint() * Complex::from(power);
        }
        let density = spectrum.cholesky().map_or(f64::INFINITY, |root| enters.dotc(&root.solve(&enters)).re);
        self.last = Some((omega * 1.002, density));
        density
    }
}

fn reverse_sum(values: &mut [f64]) {
    let mut sum = 0.0;
    for value in values.iter_mut().rev() {
        sum += *value;
        *value = sum;
    }
}

/// The highest values that lie at least `gap` apart, with their places.
fn separated(values: &[f64], gap: usize) -> Vec<(usize, f64)> {
    let mut peaks: Vec<(usize, f64)> = Vec::new();
    for _ in 0..PEAKS {
        let free = values.iter().copied().enumerate().filter(|(index, value)| {
            *value > 0.0 && peaks.iter().all(|(peak, _)| index.abs_diff(*peak) > gap)
        });
        let Some(best) = free.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        peaks.push(best);
    }
    peaks
}
