//! Channels that are filtered together.
use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::{Complex, DMatrix};

use super::FEWEST_ROWS;
use super::schuler_step::SchulerStep;
use crate::bands::onset_energy::{self, Shapes};
use crate::catalogue::{Column, Port};
use crate::inputs::Loudness;
use crate::inputs::series::Series;
use crate::noise::{Group, Noise, RowsOfLevel};
use crate::numeric::statistics::median;
use crate::whitening::filter::{Filter, Space};

/// One less the cosine of the angle below which two sensors look the same.
const PARALLEL: f64 = 1e-6;
/// Rows that are looked at together.
const RUN_ROWS: usize = 256;

/// Whether all values are numbers; without a way out in each run of rows, which is most of the time otherwise.
fn are_numbers(values: &[f64]) -> bool {
    values.chunks(RUN_ROWS).all(|run| run.iter().fold(true, |all, value| all & value.is_finite()))
}

/// How sensors become channels.
#[derive(Clone, Debug)]
pub(super) enum Geometry {
    /// The one sensor is the one channel.
    Direct,
    /// V, channels by sensors.
    Parity(DMatrix<f64>),
    /// The Schuler loop over a step.
    Loop(SchulerStep),
}

/// Channels that are filtered together.
#[derive(Clone, Debug)]
pub struct Block {
    /// Its sensors, by their places in the recording.
    pub sensors: Vec<usize>,
    /// Its sources, by their places in [`Model::sources`](super::Model::sources).
    pub sources: Vec<usize>,
    /// Number of channels.
    pub channels: usize,
    /// Residuals, channel after channel; NaN where missing.
    pub data: Vec<f64>,
    /// Rows that are present.
    pub present: Vec<bool>,
    /// Quantities that its white level may go with.
    pub loudness: Arc<[Loudness]>,
    pub(super) geometry: Geometry,
    pub(super) step_s: f64,
}

impl Block {
    /// Whether its channels are parities of several sensors.
    pub fn is_redundant(&self) -> bool {
        matches!(self.geometry, Geometry::Parity(_))
    }

    /// The white noise that the differences of its first channel from row to row would have.
    pub fn white_by_differences(&self) -> f64 {
        let mut differences: Vec<f64> = (self.data[..self.rows()].windows(2))
            .map(|pair| (pair[1] - pair[0]).abs())
            .filter(|difference| difference.is_finite())
            .collect();
        let middle = differences.len() / 2;
        let median = if differences.is_empty() {
            0.0
        } else {
            *differences.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let largest = self.data.iter().filter(|value| value.is_finite()).fold(0.0_f64, |a, b| a.max(b.abs()));
        // Readings of which most are equal have a median of zero, which is no noise level.
        let squares: f64 = differences.iter().map(|difference| difference * difference).sum();
        let spread = if median > 0.0 {
            // Median of |difference| of normal values: 0.6745 √2 σ.
            median / 0.954
        } else {
            (0.5 * squares / differences.len().max(1) as f64).sqrt()
        };
        spread.max(1e-6 * largest).max(f64::MIN_POSITIVE.sqrt())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.present.len()
    }

    /// Number of rows present.
    pub fn count(&self) -> usize {
        self.present.iter().filter(|&&present| present).count()
    }

    /// What a column at a port adds to the channels; `None` where it does not reach them.
    ///
    /// What is not a number counts as 0.
    pub fn project<'v>(&self, column: &'v Column, port: Port) -> Option<Cow<'v, [f64]>> {
        let mut values = self.projected(column, port)?;
        let all = self.channels * self.rows();
        if values.len() != all || !are_numbers(&values) {
            let own = values.to_mut();
            own.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
            own.resize(all, 0.0);
        }
        Some(values)
    }

    /// Whether its one channel is what a sensor reads less what it should.
    pub fn is_of_one_sensor(&self) -> bool {
        matches!(self.geometry, Geometry::Direct)
    }

    fn projected<'v>(&self, column: &'v Column, port: Port) -> Option<Cow<'v, [f64]>> {
        let reaches = |(sensor, _): &&(usize, Series)| self.sensors.contains(sensor);
        match &self.geometry {
            Geometry::Direct if port != Port::Output => None,
            Geometry::Direct => column.parts.iter().find(reaches).map(|(_, values)| Cow::from(&**values)),
            Geometry::Parity(parity) => {
                let rows = self.rows();
                let mut data: Option<Vec<f64>> = None;
                for (sensor, values) in column.parts.iter().filter(reaches) {
                    let place = self.sensors.iter().position(|own| own == sensor)?;
                    let data = data.get_or_insert_with(|| vec![0.0; self.channels * rows]);
                    for channel in 0..self.channels {
                        let weight = parity[(channel, place)];
                        for (sum, value) in data[channel * rows..].iter_mut().zip(&**values) {
                            *sum += weight * value;
                        }
                    }
                }
                data.map(Cow::from)
            }
            Geometry::Loop(step) => {
                let (_, values) = column.parts.iter().find(reaches)?;
                let values: &[f64] = values;
                Some(match step.of_port(port) {
                    Some(enters) => Cow::from(step.response(values, enters)),
                    None => Cow::from(values),
                })
            }
        }
    }

    /// The transpose of [`project`](Self::project): scores of the channels become scores of a sensor's unit impulses.
    pub fn back_project(&self, scores: &[f64], sensor: usize, port: Port) -> Option<Vec<f64>> {
        let place = self.sensors.iter().position(|&own| own == sensor)?;
        match &self.geometry {
            Geometry::Direct => (port == Port::Output).then(|| scores.to_vec()),
            Geometry::Parity(parity) => {
                let rows = self.rows();
                let mut data = vec![0.0; rows];
                for channel in 0..self.channels {
                    let weight = parity[(channel, place)];
                    for (sum, value) in data.iter_mut().zip(&scores[channel * rows..]) {
                        *sum += weight * value;
                    }
                }
                Some(data)
            }
            Geometry::Loop(step) => Some(
                step.of_port(port)
                    .map_or_else(|| scores.to_vec(), |enters| step.transposed_response(scores, enters)),
            ),
        }
    }

    /// What a step and a ramp at a port of a sensor add to the channels from the row on at which they begin, 0 in the rows before; `None`
    /// where they do not reach them. A ramp rises by 1 a row. As [`project`](Self::project) of their columns, but for a step into a
    /// loop at the first row, which here has half a row before it.
    pub(crate) fn begins(&self, sensor: usize, port: Port) -> Option<Shapes> {
        let place = self.sensors.iter().position(|&own| own == sensor)?;
        let through = match &self.geometry {
            Geometry::Loop(step) => step.of_port(port).map(|enters| (step.transition, enters)),
            _ if port != Port::Output => return None,
            _ => None,
        };
        let weights = match &self.geometry {
            Geometry::Parity(parity) => parity.column(place).iter().copied().collect(),
            _ => vec![1.0],
        };
        // States: those of the loop, the ramp, its slope.
        let (ramp, slope) = (2, 3);
        let mut transition = [[0.0; onset_energy::MOST]; onset_energy::MOST];
        let mut seen = [0.0; onset_energy::MOST];
        let mut starts = [[0.0; onset_energy::MOST]; onset_energy::SHAPES];
        (transition[ramp][ramp], transition[ramp][slope], transition[slope][slope]) = (1.0, 1.0, 1.0);
        (starts[0][ramp], starts[1][slope]) = (1.0, 1.0);
        match through {
            Some((own, enters)) => {
                for i in 0..2 {
                    transition[i][..2].copy_from_slice(&own[i]);
                    // The mean over a row, which for a step that before the first has a half of.
                    (transition[i][ramp], transition[i][slope]) = (enters[i], 0.5 * enters[i]);
                    starts[0][i] = 0.5 * enters[i];
                }
                seen[0] = 1.0;
            }
            None => seen[ramp] = 1.0,
        }
        Some(Shapes { weights, transition, seen, starts })
    }

    /// Whether the one sensor of the block has another white level where a quantity is large.
    pub fn has_level(&self, noises: &[Noise]) -> bool {
        let of_source = |&source: &usize| noises.get(source).and_then(|noise| noise.step);
        let step = self.sources.first().filter(|_| self.is_of_one_sensor()).and_then(of_source);
        step.is_some_and(|step| matches!(step.rows, RowsOfLevel::Above { .. }))
    }

    /// Brings the data of one sensor to one white level, where it is louder in some rows: by how much is seen on what each row is off the mean
    /// of its neighbours, the middle one of which knows of no spikes.
    pub fn level(&mut self, noises: &[Noise]) {
        let Some(step) = self.sources.first().and_then(|&source| noises.get(source)?.step) else { return };
        if !self.has_level(noises) {
            return;
        }
        let louder = self.rows_of_level(step.rows);
        let level_of = |is_louder: bool| {
            let alike = |row: &usize| {
                let three = louder.get(row - 1..=row + 1);
                three.is_some_and(|three| three.iter().all(|louder| *louder == is_louder))
            };
            let off = |row: usize| (self.data[row] - 0.5 * (self.data[row - 1] + self.data[row + 1])).abs();
            let rows = 1..self.rows().saturating_sub(1);
            let mut off: Vec<f64> = rows.filter(alike).map(off).filter(|off| off.is_finite()).collect();
            (off.len() >= FEWEST_ROWS).then(|| median(&mut off))
        };
        let seen = level_of(true).zip(level_of(false)).map(|(louder, other)| louder / other);
        let ratio = seen.filter(|ratio| ratio.is_finite() && *ratio > 0.0).unwrap_or(step.ratio);
        let scaled = self.data.iter_mut().zip(&*louder).filter(|(_, louder)| **louder);
        scaled.for_each(|(value, _)| *value /= ratio);
    }

    /// The rows that have another white level.
    pub fn rows_of_level(&self, rows: RowsOfLevel) -> Arc<[bool]> {
        match rows {
            RowsOfLevel::From(first) => (0..self.rows()).map(|row| row >= first).collect(),
            RowsOfLevel::Above { quantity, value } => match self.loudness.get(quantity) {
                Some(loudness) => loudness.values.iter().map(|&of_row| of_row > value).collect(),
                None => Arc::default(),
            },
        }
    }

    /// The model in state-space form with the given noises of all sources.
    pub fn space(&self, noises: &[Noise]) -> Space {
        let parts: Vec<_> = self.sources.iter().map(|&source| noises[source].states(self.step_s)).collect();
        let navigation = if matches!(self.geometry, Geometry::Loop(_)) { 2 } else { 0 };
        let n = navigation + parts.iter().map(crate::noise::States::len).sum::<usize>();
        let m = self.channels;
        let mut space = Space {
            states: n,
            channels: m,
            transition: vec![0.0; n * n],
            driven: vec![0.0; n * n],
            start: vec![0.0; n * n],
            seen: vec![0.0; m * n],
            white: vec![0.0; m * m],
            other_white: None,
        };
        if let Geometry::Loop(step) = &self.geometry {
            for i in 0..2 {
                for j in 0..2 {
                    space.transition[i * n + j] = step.transition[i][j];
                }
                space.start[i * n + i] = step.start[i] * step.start[i];
            }
            space.seen[0] = 1.0;
        }
        let mut at = navigation;
        // Place of the source, of the first state, and the states of a part that is inside a loop.
        let mut inside: Vec<(usize, usize, &Group)> = Vec::new();
        for (place, parts) in parts.iter().enumerate() {
            for group in &parts.groups {
                for i in 0..group.size {
                    for j in 0..group.size {
                        space.transition[(at + i) * n + at + j] = group.transition[i][j];
                    }
                    space.driven[(at + i) * n + at + i] = group.driven[i];
                    space.start[(at + i) * n + at + i] = group.start[i];
                    match &self.geometry {
                        Geometry::Parity(parity) => {
                            for channel in 0..m {
                                space.seen[channel * n + at + i] = parity[(channel, place)] * group.seen[i];
                            }
                        }
                        Geometry::Loop(_) if place > 0 => {}
                        Geometry::Loop(_) | Geometry::Direct => space.seen[at + i] = group.seen[i],
                    }
                }
                if navigation > 0 && place > 0 {
                    inside.push((place, at, group));
                }
                at += group.size;
            }
        }
        if let Geometry::Loop(step) = &self.geometry {
            step.drive(&mut space, &inside, self.step_s);
            for (port, &source) in
                [Port::Accelerometer, Port::Gyro].into_iter().zip(self.sources.iter().skip(1))
            {
                let variance = noises[source].white * noises[source].white;
                if let (Some(enters), true) = (step.of_port(port), variance > 0.0) {
                    for i in 0..2 {
                        for j in 0..2 {
                            space.driven[i * n + j] += enters[i] * enters[j] * variance;
                        }
                    }
                }
            }
        }
        let white = |other: bool| {
            let variance_of = |place: usize, source: usize| {
                let noise = &noises[source];
                let ratio = noise.step.filter(|_| other).map_or(1.0, |step| step.ratio);
                let rounding = noise.white_variance() - noise.white * noise.white;
                if matches!(self.geometry, Geometry::Loop(_)) && place > 0 {
                    0.0
                } else {
                    (noise.white * ratio).powi(2) + rounding
                }
            };
            let mut white = vec![0.0; m * m];
            for (place, &source) in self.sources.iter().enumerate() {
                let variance = variance_of(place, source);
                for c in 0..m {
                    for d in 0..m {
                        let weight = match &self.geometry {
                            Geometry::Parity(parity) => parity[(c, place)] * parity[(d, place)],
                            _ => 1.0,
                        };
                        white[c * m + d] += weight * variance;
                    }
                }
            }
            white
        };
        space.white = white(false);
        let step = self.sources.iter().find_map(|&source| noises[source].step);
        space.other_white = step.map(|step| (self.rows_of_level(step.rows), white(true)));
        space
    }

    /// The filter with the given noises of all sources; `None` where they are singular or too many.
    pub fn filter(&self, noises: &[Noise]) -> Option<Filter> {
        self.filter_over(noises, &self.present)
    }

    /// The filter over other rows than those present.
    pub fn filter_over(&self, noises: &[Noise], present: &[bool]) -> Option<Filter> {
        Filter::new(&self.space(noises), present)
    }

    /// How a tone of a source enters the channels at `omega` rad a step: into a loop by the mean of what is before and after a step.
    pub fn transfer(&self, place: usize, omega: f64) -> Vec<Complex<f64>> {
        self.enters(place, omega, (0.5 * omega).cos())
    }

    /// How its noise does, which goes on between the rows: of what walks from row to row the means over steps have the part
    /// 1 − ⅔ sin² ½ω of its power.
    pub fn noise_transfer(&self, place: usize, omega: f64) -> Vec<Complex<f64>> {
        let sin = (0.5 * omega).sin();
        self.enters(place, omega, (1.0 - sin * sin / 1.5).sqrt())
    }

    /// The same with the part that the mean over a step has of what is sampled.
    fn enters(&self, place: usize, omega: f64, mean: f64) -> Vec<Complex<f64>> {
        match &self.geometry {
            Geometry::Direct => vec![Complex::from(1.0)],
            Geometry::Parity(parity) => (0..self.channels).map(|c| parity[(c, place)].into()).collect(),
            Geometry::Loop(step) => {
                let Some(enters) =
                    step.of_port([Port::Output, Port::Accelerometer, Port::Gyro][place.min(2)])
                else {
                    return vec![Complex::from(1.0)];
                };
                let z = Complex::from_polar(1.0, omega);
                let [[a, b], [c, d]] = step.transition;
                let determinant = (z - a) * (z - d) - b * c;
                let mean = Complex::from_polar(mean, 0.5 * omega);
                vec![mean * ((z - d) * enters[0] + b * enters[1]) / determinant]
            }
        }
    }

    /// Place of the sensor whose error would look most like a vector of the channels.
    pub fn nearest(&self, vector: &[f64]) -> usize {
        let Geometry::Parity(parity) = &self.geometry else { return 0 };
        let along = |place: usize| {
            let column = parity.column(place);
            let dot: f64 = column.iter().zip(vector).map(|(a, b)| a * b).sum();
            dot.abs() / column.norm().max(1e-12)
        };
        (0..self.sensors.len()).max_by(|&a, &b| along(a).total_cmp(&along(b))).unwrap_or_default()
    }

    /// Step, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Places of the sensors whose errors look the same as those of the one at `place`, itself among them: a pair of which
    /// nothing but the difference is seen.
    pub fn alike(&self, place: usize) -> Vec<usize> {
        let Geometry::Parity(parity) = &self.geometry else { return vec![place] };
        let own = parity.column(place);
        let parallel = |other: &usize| {
            let column = parity.column(*other);
            own.dot(&column).abs() > (1.0 - PARALLEL) * own.norm() * column.norm()
        };
        (0..self.sensors.len()).filter(parallel).collect()
    }

    /// How strongly a source reaches the channels, 0…1.
    pub fn weight(&self, place: usize) -> f64 {
        match &self.geometry {
            Geometry::Parity(parity) => parity.column(place).norm(),
            _ => 1.0,
        }
    }
}
