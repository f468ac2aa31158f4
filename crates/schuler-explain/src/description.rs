//! A description of a record: nominal model, deterministic terms and noises; its likelihood with all amplitudes free.
use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::catalogue::{Candidate, Column, OnsetShape, Port, Search};
use crate::inputs::series::{Series, delayed_closely, waves};
use crate::noise::Noise;
use crate::nominal::{Block, Model};
use crate::numeric::least_squares::{Solution, dot, solve};
use crate::whitening::filter::Filter;

/// A deterministic term: a candidate with its non-linear parameters at given values.
#[derive(Clone, Debug)]
pub struct Term {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Values of the parameters in which it is not linear.
    pub nonlinear: Vec<f64>,
    /// Its columns.
    pub columns: Arc<Vec<Column>>,
    /// Where it enters.
    pub port: Port,
    /// Whether its amplitudes are exactly 1.
    pub unit_amplitude: bool,
    /// Whether it is of the motion, so that it comes as late as the readings that it is in.
    pub of_the_motion: bool,
    /// The delay of its sensors' readings, s, where that is what it is.
    pub delay_s: Option<f64>,
}

impl Term {
    /// The term of a candidate at given values; for an onset the time, s, for a frequency Hz.
    pub fn new(index: usize, candidate: &Candidate, nonlinear: &[f64], time_s: &[f64]) -> Self {
        Self {
            candidate: index,
            nonlinear: nonlinear.to_vec(),
            columns: Arc::new(columns(candidate, nonlinear, time_s)),
            port: candidate.port,
            unit_amplitude: matches!(candidate.search, Search::Grid { unit_amplitude: true, .. }),
            of_the_motion: candidate.effect.is_of_the_motion(),
            delay_s: nonlinear.first().copied().filter(|_| candidate.effect.is_a_delay()),
        }
    }

    /// The same term at other values of its non-linear parameters.
    #[must_use]
    pub fn at(&self, candidate: &Candidate, nonlinear: &[f64], time_s: &[f64]) -> Self {
        if nonlinear.is_empty() {
            self.clone()
        } else {
            Self::new(self.candidate, candidate, nonlinear, time_s)
        }
    }

    /// The sensors in whose readings it is.
    pub fn sensors(&self) -> Vec<usize> {
        let mut sensors: Vec<usize> =
            self.columns.iter().flat_map(|column| &column.parts).map(|(sensor, _)| *sensor).collect();
        sensors.sort_unstable();
        sensors.dedup();
        sensors
    }

    /// Number of amplitudes that are estimated.
    pub fn amplitudes(&self) -> usize {
        if self.unit_amplitude { 0 } else { self.columns.len() }
    }
}

/// How late the readings of sensors come by the terms of a description.
///
/// An instrument that is late reads y(t) = h(t − d): not only its nominal reading is that of the time t − d, but all that
/// the motion adds to it, a lever arm's ω(t − d) × r as well as a mounting or a scale factor. Read at t instead they
/// would be other functions, and their amplitudes not those of the instrument.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Delays {
    /// Sensor, and delay of its readings, s.
    of_sensor: Vec<(usize, f64)>,
}

impl Delays {
    /// The delays among `terms`.
    pub fn new<'t>(terms: impl IntoIterator<Item = &'t Term>) -> Self {
        let mut delays = Self::default();
        for term in terms {
            let Some(delay_s) = term.delay_s else { continue };
            let sensors = term.columns.iter().flat_map(|column| &column.parts).map(|(sensor, _)| *sensor);
            for sensor in sensors {
                match delays.of_sensor.iter_mut().find(|known| known.0 == sensor) {
                    Some(known) => known.1 += delay_s,
                    None => delays.of_sensor.push((sensor, delay_s)),
                }
            }
        }
        delays
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.of_sensor.is_empty()
    }

    /// Those of some sensors only.
    #[must_use]
    pub fn among(&self, sensors: &[usize]) -> Self {
        let of_sensor = self.of_sensor.iter().filter(|(sensor, _)| sensors.contains(sensor));
        Self { of_sensor: of_sensor.copied().collect() }
    }

    /// That of a sensor, s.
    pub fn of(&self, sensor: usize) -> f64 {
        self.of_sensor.iter().find(|known| known.0 == sensor).map_or(0.0, |known| known.1)
    }

    /// Whether they move a term.
    pub fn move_term(&self, term: &Term) -> bool {
        let mut parts = term.columns.iter().flat_map(|column| &column.parts);
        term.of_the_motion && term.port == Port::Output && parts.any(|(sensor, _)| self.of(*sensor) != 0.0)
    }

    /// A column as it comes in the readings; where the time t − d is not in the record as it is at t.
    pub fn late<'v>(&self, model: &Model, of_the_motion: bool, column: &'v Column) -> Cow<'v, Column> {
        if !of_the_motion || column.parts.iter().all(|(sensor, _)| self.of(*sensor) == 0.0) {
            return Cow::Borrowed(column);
        }
        let late = |(sensor, values): &(usize, Series)| {
            let late = delayed_closely(&model.time_s, values, self.of(*sensor));
            let values = late.into_iter().zip(&**values).map(|(late, &now)| late.unwrap_or(now));
            (*sensor, values.collect::<Series>())
        };
        Cow::Owned(Column::of(column.parts.iter().map(late)))
    }
}

/// Names and units of a candidate's parameters in which it is not linear.
pub fn nonlinear_names(candidate: &Candidate) -> Vec<(&'static str, &'static str)> {
    match &candidate.search {
        Search::Grid { parameters, .. } => parameters.iter().map(|p| (p.name, p.unit)).collect(),
        Search::Onset(_) => vec![("onset_s", "s")],
        Search::Frequency => vec![("frequency_hz", "Hz")],
        Search::Linear(_) | Search::Noise(_) | Search::Readings(_) => Vec::new(),
    }
}

/// The sensors on which a candidate acts.
pub fn sensors_of(candidate: &Candidate) -> Vec<usize> {
    match &candidate.target {
        crate::catalogue::Target::Sensor(sensor) => vec![*sensor],
        crate::catalogue::Target::Group { sensors, .. } => sensors.clone(),
    }
}

/// The columns of a candidate at given values of the parameters in which it is not linear.
pub(crate) fn columns(candidate: &Candidate, nonlinear: &[f64], time_s: &[f64]) -> Vec<Column> {
    // What several sensors have in common has an amplitude of each.
    let of_each = |series: Vec<Vec<f64>>| -> Vec<Column> {
        let series: Vec<Series> = series.into_iter().map(Series::from).collect();
        let of_sensor = |sensor: usize| series.iter().map(move |values| Column::on(sensor, values.clone()));
        sensors_of(candidate).into_iter().flat_map(of_sensor).collect()
    };
    let at = nonlinear.first().copied().unwrap_or_default();
    match &candidate.search {
        Search::Linear(signature) => signature.columns.clone(),
        Search::Grid { signature, .. } => signature(nonlinear).columns,
        Search::Onset(OnsetShape::Step) => {
            of_each(vec![time_s.iter().map(|&time| f64::from(u8::from(time >= at))).collect()])
        }
        Search::Onset(OnsetShape::Ramp) => {
            of_each(vec![time_s.iter().map(|&time| (time - at).max(0.0)).collect()])
        }
        Search::Frequency => of_each(waves(time_s, std::f64::consts::TAU * at).into()),
        Search::Noise(_) | Search::Readings(_) => Vec::new(),
    }
}

/// What a block's channels hold of the terms: data less the terms of unit amplitude, and a regressor for each amplitude
/// that reaches it, by its place among all.
pub struct Projected {
    /// Residuals.
    pub data: Vec<f64>,
    /// Places among all amplitudes.
    pub places: Vec<usize>,
    /// The regressors.
    pub columns: Vec<Vec<f64>>,
}

/// The regressors of a block; all amplitudes number `Projected::places` from 0 in the order constants, terms.
pub fn project(model: &Model, block: usize, terms: &[Term]) -> Projected {
    let block = &model.blocks[block];
    let mut projected = Projected { data: block.data.clone(), places: Vec::new(), columns: Vec::new() };
    for (place, column) in model.constants.iter().enumerate() {
        if let Some(values) = block.project(column, Port::Output) {
            projected.places.push(place);
            projected.columns.push(values.into_owned());
        }
    }
    let mut place = model.constants.len();
    let delays = Delays::new(terms);
    for term in terms {
        for column in &*term.columns {
            let column = delays.late(model, term.of_the_motion, column);
            if let Some(values) = block.project(&column, term.port) {
                if term.unit_amplitude {
                    projected.data.iter_mut().zip(&*values).for_each(|(data, value)| *data -= value);
                } else {
                    projected.places.push(place);
                    projected.columns.push(values.into_owned());
                }
            }
            place += usize::from(!term.unit_amplitude);
        }
    }
    projected
}

/// Sums of a block: log-likelihood without regressors, normal matrix and scores of its regressors.
pub struct Sums {
    /// Log-likelihood with all amplitudes zero.
    pub log_likelihood: f64,
    /// Normal matrix.
    pub normal: DMatrix<f64>,
    /// Scores.
    pub scores: DVector<f64>,
}

impl Sums {
    /// Sums of projected data under a filter.
    pub fn new(filter: &Filter, projected: &Projected) -> Self {
        let columns: Vec<&[f64]> =
            std::iter::once(&projected.data).chain(&projected.columns).map(Vec::as_slice).collect();
        let whitened = filter.whiten(&columns);
        Self::of_whitened(filter, &whitened)
    }

    /// Sums of whitened data (first) and regressors.
    pub fn of_whitened(filter: &Filter, whitened: &[Vec<f64>]) -> Self {
        Self::beside(filter, whitened, |_, _| None)
    }

    /// The same where some products of a regressor with another one, or with the data, may be known, by their places among
    /// the columns.
    pub fn beside(
        filter: &Filter,
        whitened: &[Vec<f64>],
        known: impl Fn(usize, usize) -> Option<f64>,
    ) -> Self {
        let size = whitened.len() - 1;
        let data = &whitened[0];
        let product = |i: usize, j: usize| known(i, j).unwrap_or_else(|| dot(&whitened[i], &whitened[j]));
        let mut normal = DMatrix::zeros(size, size);
        for i in 0..size {
            for j in 0..=i {
                let sum = product(i + 1, j + 1);
                normal[(i, j)] = sum;
                normal[(j, i)] = sum;
            }
        }
        let count = filter.count as f64;
        Self {
            log_likelihood: -0.5
                * (count * std::f64::consts::TAU.ln() + filter.log_variances + dot(data, data)),
            normal,
            scores: DVector::from_fn(size, |i, _| product(i + 1, 0)),
        }
    }

    /// The regressors' amplitudes at their best, and what they gain.
    pub fn solution(&self) -> Solution {
        solve_or_none(&self.normal, &self.scores)
    }
}

/// The solution of the normal equations; of none without regressors.
pub(crate) fn solve_or_none(normal: &DMatrix<f64>, scores: &DVector<f64>) -> Solution {
    if scores.is_empty() {
        Solution { gain: 0.0, amplitudes: DVector::zeros(0), covariance: DMatrix::zeros(0, 0), rank: 0 }
    } else {
        solve(normal, scores)
    }
}

/// What the regressors of a block leave of its data at their best.
pub fn left_of(filter: &Filter, projected: Projected) -> Vec<f64> {
    let amplitudes = Sums::new(filter, &projected).solution().amplitudes;
    let mut data = projected.data;
    take_off(&mut data, &projected.columns, amplitudes.iter().copied());
    data
}

/// Log-likelihood of a block under `noises`, its regressors at their best; −∞ where it cannot be computed.
pub fn log_likelihood(block: &Block, noises: &[Noise], projected: &Projected) -> f64 {
    let Some(filter) = block.filter(noises) else { return f64::NEG_INFINITY };
    let sums = Sums::new(&filter, projected);
    let best = sums.log_likelihood + sums.solution().gain;
    if best.is_finite() { best } else { f64::NEG_INFINITY }
}

/// Residuals of a block after the terms at their fitted amplitudes; NaN where missing.
pub fn remainder(model: &Model, block: usize, terms: &[Term], amplitudes: &DVector<f64>) -> Vec<f64> {
    let projected = project(model, block, terms);
    let mut data = projected.data;
    let own = projected.places.iter().map(|place| amplitudes.get(*place).copied().unwrap_or_default());
    take_off(&mut data, &projected.columns, own);
    data
}

/// Takes columns off the data, each times its amplitude.
pub(crate) fn take_off(data: &mut [f64], columns: &[Vec<f64>], amplitudes: impl IntoIterator<Item = f64>) {
    for (column, amplitude) in columns.iter().zip(amplitudes) {
        data.iter_mut().zip(column).for_each(|(data, value)| *data -= amplitude * value);
    }
}

/// The blocks that a set of terms reaches.
pub fn blocks_of(model: &Model, terms: &[Term]) -> Vec<usize> {
    let mut blocks: Vec<usize> = (terms.iter().flat_map(|term| &*term.columns))
        .flat_map(|column| &column.parts)
        .filter_map(|(sensor, _)| model.block_of(*sensor))
        .collect();
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}
