//! Scores of steps and ramps at every onset, and of sinusoids at every frequency, from one adjoint pass.
//!
//! With q = R⁻¹r the score of a step at t₀ is Σ q from t₀ on, of a ramp the sum of those sums; the energy of its whitened
//! response, from one pass backwards, is the denominator. The score of a sinusoid is the Fourier transform of q, and the inverse
//! of the model's spectrum its denominator. What is already described is projected out. What stands out is evaluated by the
//! caller, which for a sinusoid is another value. The price of the search is the tail of the maximum over the chain of
//! scores. How fast that chain forgets follows from the correlations of two signatures under the settled filter,
//! what is described projected out: scores of a step on white noise forget like a random walk, those of a ramp, or of a step
//! that a Schuler loop has integrated, are smooth.
use std::sync::OnceLock;

use nalgebra::{Complex, DMatrix, DVector};
use schuler_fourier::Forward;

use crate::catalogue::{Column, OnsetShape, Port};
use crate::least_squares::{dot, solve};
use crate::noise::Noise;
use crate::nominal::Block;
use crate::onset_energy::{SHAPES, onset_energies};
use crate::statistics::{ln_frequency_scan_tail, ln_scan_tail, maxima_per_place};
use crate::whiten::Filter;

/// Rows that must lie on both sides of an onset.
const MARGIN_ROWS: usize = 10;
/// Part of its energy that a signature must keep when what is described is taken out.
const SEEN: f64 = 0.02;
/// Peaks that are reported.
const PEAKS: usize = 3;
/// Fewest periods in the record.
const FEWEST_PERIODS: f64 = 2.0;
/// Places between the ends of the chain at which it is computed how fast it forgets; towards the ends their distances double.
const PLACES: usize = 200;

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
    /// Energies of a step and of a ramp that begin at each row, by sensor and port, once they are asked for.
    energies: OnceLock<Vec<(Place, [Vec<f64>; SHAPES])>>,
}

/// A sensor and a port.
type Place = (usize, Port);

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
            energies: OnceLock::new(),
        }
    }

    /// Energy of the whitened response to a shape that begins at each row.
    fn energies(&self, sensor: usize, port: Port, shape: OnsetShape) -> Option<&[f64]> {
        let all = self.energies.get_or_init(|| {
            let ports = [Port::Output, Port::Accelerometer, Port::Gyro];
            let (places, shapes): (Vec<Place>, Vec<_>) = (self.block.sensors.iter())
                .flat_map(|&sensor| ports.map(|port| (sensor, port)))
                .filter_map(|place| Some((place, self.block.begins(place.0, place.1)?)))
                .unzip();
            places.into_iter().zip(onset_energies(self.filter, &shapes)).collect()
        });
        let (_, [step, ramp]) = all.iter().find(|(place, _)| *place == (sensor, port))?;
        Some(match shape {
            OnsetShape::Step => step,
            OnsetShape::Ramp => ramp,
        })
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
        let energies = self.energies(sensor, port, shape)?;
        let response = self.response(sensor, port, shape)?;
        // How shapes that begin at two rows are correlated is told by a filter that has settled, with nothing missing.
        let settled = energy(&response, rows, 0);
        // What is left of an energy when what is described is taken out, by its products with that.
        let left = |whole: f64, cross: &dyn Fn(&[f64]) -> f64| {
            let cross = DVector::from_fn(regressors.len(), |i, _| cross(&regressors[i]));
            whole - if cross.is_empty() { 0.0 } else { cross.dot(&(&self.inverse * &cross)) }
        };
        let seen = |row: usize, whole: f64| {
            let left = left(whole, &|products| products[row]);
            if left > SEEN * whole { left } else { 0.0 }
        };
        let first = if shape == OnsetShape::Step { MARGIN_ROWS } else { 0 };
        let last = rows.saturating_sub(MARGIN_ROWS);
        let gains: Vec<f64> = (first..last.max(first))
            .map(|row| {
                let energy = seen(row, energies[row]);
                if energy > 0.0 { 0.5 * scores[row] * scores[row] / energy } else { 0.0 }
            })
            .collect();
        let gap = (rows / 50).max(3);
        let peaks: Vec<Peak> = separated(&gains, gap)
            .into_iter()
            .map(|(index, gain)| Peak { at: time_s.get(first + index).copied().unwrap_or_default(), gain })
            .collect();
        let best = peaks.first()?;
        let u = (2.0 * best.gain).sqrt();
        let single = crate::statistics::ln_chi_squared_tail(u * u, 1);
        // 1 − ρ of the scores at two onsets, from the energy of the difference of their signatures.
        let places = places(first, last);
        let lags: Vec<usize> = std::iter::successors(Some(1), |lag| Some(2 * lag))
            .take_while(|lag| 2 * lag < last.saturating_sub(first))
            .collect();
        let mut forgotten = vec![Vec::new(); places.len()];
        for &lag in &lags {
            let differences = energy(&response, rows, lag);
            for (&row, forgotten) in places.iter().zip(&mut forgotten).filter(|(row, _)| **row + lag < last) {
                let (here, there) = (energies[row], energies[row + lag]);
                let of_settled = [settled[rows - row - 1], settled[rows - row - lag - 1]];
                let correlation = 0.5 * (of_settled[0] + of_settled[1] - differences[rows - row - 1])
                    / (of_settled[0] * of_settled[1]).sqrt();
                let whole = here + there - 2.0 * correlation * (here * there).sqrt();
                let apart = left(whole, &|products| products[row] - products[row + lag]);
                let (here, there) = (seen(row, here), seen(row + lag, there));
                let one_less = 0.5 * (apart - (here.sqrt() - there.sqrt()).powi(2)) / (here * there).sqrt();
                forgotten.push(if one_less.is_finite() { one_less.max(0.0) } else { 0.0 });
            }
        }
        let rates: Vec<f64> = forgotten.iter().map(|forgotten| maxima_per_place(u, forgotten)).collect();
        let maxima: f64 = (places.windows(2).zip(rates.windows(2)))
            .map(|(rows, rates)| 0.5 * (rates[0] + rates[1]) * (rows[1] - rows[0]) as f64)
            .sum();
        Some(Scan { peaks, ln_places: (ln_scan_tail(u, maxima) - single).max(0.0) })
    }

    /// Whitened response of the settled filter to a shape that begins with the record.
    fn response(&self, sensor: usize, port: Port, shape: OnsetShape) -> Option<Vec<f64>> {
        let rows = self.block.rows();
        let values = match shape {
            OnsetShape::Step => vec![1.0; rows],
            OnsetShape::Ramp => (0..rows).map(|row| row as f64).collect(),
        };
        let course = Column::on(sensor, values);
        let response = self.block.project(&course, port)?;
        Some(self.filter.settled_filter(rows).whiten(&[&response]).swap_remove(0))
    }

    /// Scans all frequencies of a sinusoid on a sensor.
    pub fn frequencies(&self, sensor: usize, port: Port, noises: &[Noise]) -> Option<Scan> {
        let rows = self.block.rows();
        let count = self.block.count();
        let step_s = self.block.step_s();
        let scores = self.block.back_project(&self.scores, sensor, port)?;
        let length = (2 * rows).next_power_of_two();
        let transform = Forward::new(length).transform(scores);
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
            let through = DVector::from_vec(block.noise_transfer(place, omega));
            let power = self.noises[source].spectrum(omega, block.step_s());
            spectrum += &through * through.adjoint() * Complex::from(power);
        }
        let density = spectrum.cholesky().map_or(f64::INFINITY, |root| enters.dotc(&root.solve(&enters)).re);
        self.last = Some((omega * 1.002, density));
        density
    }
}

/// Energy within the first 1, 2, … rows of a response of `rows` rows a channel, and with a lag of its difference from the same so
/// many rows later.
fn energy(response: &[f64], rows: usize, lag: usize) -> Vec<f64> {
    let mut sum = 0.0;
    let of = |row: usize| -> f64 {
        let difference = |channel: &[f64]| {
            let later = if lag > 0 && row >= lag { channel[row - lag] } else { 0.0 };
            (channel[row] - later).powi(2)
        };
        response.chunks_exact(rows).map(difference).sum()
    };
    (0..rows)
        .map(|row| {
            sum += of(row);
            sum
        })
        .collect()
}

/// Places of a chain from `first` to before `last`, close together near its ends, where scores forget fast.
fn places(first: usize, last: usize) -> Vec<usize> {
    let length = last.saturating_sub(first);
    let doubled = std::iter::successors(Some(1), |distance| Some(2 * distance));
    let ends = doubled.take_while(|distance| 2 * distance < length);
    let mut places: Vec<usize> = (ends.flat_map(|distance| [first + distance - 1, last - distance]))
        .chain((0..PLACES).map(|place| first + place * length / PLACES))
        .filter(|place| (first..last).contains(place))
        .collect();
    places.sort_unstable();
    places.dedup();
    places
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
