//! What the user believes, as linear-Gaussian models in blocks of channels that are filtered together.
//!
//! | motion | block | channels |
//! | --- | --- | --- |
//! | any, of a sensor that a simulator predicts, or of kind "other" | one a sensor | output − (1 + scale) · prediction − bias − temperature dependence |
//! | static, recorded | one a sensor | output − (1 + scale) · ideal output − bias − temperature dependence |
//! | unknown | one a dimension | parity vector p = V r with V A = 0, A the sensors' axes [FDI-4] |
//! | velocity error | the Schuler loop | V_ins − V_ref; states δV, δ and the noise of both inertial sensors [FIL-3] |
//!
//! Noise comes from *sources*: one a sensor, and two more for the loop's accelerometer and gyro. Everything is in SI
//! units.
mod block;
mod schuler_step;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::motion::{Prediction, Unpredictable, is_resolved_over_earth, predict};
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::{Dimension, Unit};

pub use self::block::Block;
use self::block::Geometry;
use self::schuler_step::SchulerStep;
use crate::catalogue::{Column, Port};
use crate::inputs::Loudness;
use crate::inputs::redundant::is_checked;
use crate::noise::Noise;

/// Least part of what another sensor of a redundant set reads that a sensor must have: a row counts where all have read. Steps that are
/// missing for all are gaps.
const LEAST_PRESENT: f64 = 0.5;
/// Fewest rows of a block from which anything can be learnt.
pub const FEWEST_ROWS: usize = 50;
/// Eigenvalue, relative to the largest, below which a direction is not seen by any sensor.
const NULL_SPACE: f64 = 1e-9;

/// Where noise comes from.
#[derive(Clone, Debug)]
pub struct Source {
    /// Name in the answer.
    pub name: String,
    /// The recorded sensor.
    pub sensor: usize,
    /// Where it enters.
    pub port: Port,
    /// Noise that the user believes in.
    pub nominal: Noise,
    /// Whether the user says nothing of the noise, so that it is estimated.
    pub unknown: bool,
    /// Unit of the answer.
    pub unit: Unit,
    /// Whether it is an inertial velocity, which is an integral: it neither jumps nor comes late, as a radio sensor's does.
    pub integrates: bool,
}

/// The nominal model of a case.
#[derive(Clone, Debug)]
pub struct Model {
    /// The sources of noise.
    pub sources: Vec<Source>,
    /// The blocks.
    pub blocks: Vec<Block>,
    /// Constants that are fitted and are never a finding.
    pub constants: Vec<Column>,
    /// Number of rows.
    pub rows: usize,
    /// Time of each row from the first, s.
    pub time_s: Vec<f64>,
    /// Step, s.
    pub step_s: f64,
    /// What the user should be told.
    pub notes: Vec<String>,
}

impl Model {
    /// Lets the white levels go with quantities.
    pub fn goes_with(&mut self, loudness: &Arc<[Loudness]>) {
        for block in &mut self.blocks {
            block.loudness = loudness.clone();
        }
    }

    /// The nominal model of `recording`, without the readings in `masked` (one list of flags a sensor).
    ///
    /// # Errors
    /// Why there is nothing to compare.
    pub fn new(recording: &Recording, masked: &[Vec<bool>]) -> Result<Self, String> {
        let mut model = Self {
            sources: Vec::new(),
            blocks: Vec::new(),
            constants: Vec::new(),
            rows: recording.len(),
            time_s: recording.elapsed_s().collect(),
            step_s: recording.step_s,
            notes: Vec::new(),
        };
        match recording.case.motion.kind {
            MotionKind::Static | MotionKind::Recorded => model.add_known(recording, masked),
            MotionKind::Unknown => {
                model.add_alone(recording, masked);
                model.add_redundant(recording, masked);
            }
            MotionKind::VelocityError => model.add_loop(recording, masked),
        }
        if model.blocks.is_empty() {
            return Err(format!("nothing to compare with the simulation: {}", model.notes.join("; ")));
        }
        model.notes.extend(crate::inputs::grade::said(recording));
        for block in &model.blocks {
            for &sensor in &block.sensors {
                if recording.sensors[sensor].sensor.relative {
                    model.constants.push(Column::on(sensor, vec![1.0; model.rows]));
                }
            }
        }
        model.take_out_unknown_constants();
        Ok(model)
    }

    /// The model with rows of its blocks missing.
    #[must_use]
    pub fn without_rows(&self, is_missing: impl Fn(&Block, usize) -> bool) -> Self {
        let mut less = self.clone();
        for (block, whole) in less.blocks.iter_mut().zip(&self.blocks) {
            let rows = block.rows();
            for row in (0..rows).filter(|&row| is_missing(whole, row)) {
                block.present[row] = false;
                for channel in 0..block.channels {
                    block.data[channel * rows + row] = f64::NAN;
                }
            }
        }
        less
    }

    /// Takes out of the data what the unknown constants can hold of their means.
    ///
    /// The constants are fitted anyhow, so that nothing is lost; but readings that stand millions of standard deviations
    /// from zero leave no digits to a likelihood whose differences are a few nats: 0.026 m/s² at 7 · 10⁻⁹ m/s² is a sum
    /// of squares of 10¹⁶.
    fn take_out_unknown_constants(&mut self) {
        let constants = &self.constants;
        for block in &mut self.blocks {
            let (rows, channels) = (block.rows(), block.channels);
            let held: Vec<DVector<f64>> = (constants.iter())
                .filter_map(|constant| block.project(constant, Port::Output))
                .map(|values| DVector::from_fn(channels, |channel, _| values[channel * rows]))
                .collect();
            if held.is_empty() {
                continue;
            }
            let count = block.count().max(1) as f64;
            let means = DVector::from_fn(channels, |channel, _| {
                let present = block.data[channel * rows..][..rows].iter().filter(|value| value.is_finite());
                present.sum::<f64>() / count
            });
            let held = DMatrix::from_columns(&held);
            let Ok(amplitudes) = held.clone().svd(true, true).solve(&means, NULL_SPACE) else { continue };
            let offsets = held * amplitudes;
            for (values, offset) in block.data.chunks_mut(rows).zip(offsets.iter()) {
                for value in values {
                    *value -= offset;
                }
            }
        }
    }

    /// The block in which a sensor is.
    pub fn block_of(&self, sensor: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.sensors.contains(&sensor))
    }

    /// The block in whose channels a source is, the first if there are several.
    pub fn block_of_source(&self, source: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.sources.contains(&source))
    }

    /// The source of a sensor at a port.
    pub fn source_of(&self, sensor: usize, port: Port) -> Option<usize> {
        self.sources.iter().position(|source| source.sensor == sensor && source.port == port)
    }

    /// White noise of a sensor's output, SI, as the case states it; by the residuals where it states none.
    pub fn white_of(&self, sensor: usize) -> f64 {
        let stated =
            self.source_of(sensor, Port::Output).map_or(0.0, |source| self.sources[source].nominal.white);
        let by_differences = || self.block_of(sensor).map(|block| self.blocks[block].white_by_differences());
        if stated > 0.0 { stated } else { by_differences().unwrap_or_default() }
    }

    /// Noise of every source as the user believes.
    pub fn nominal_noises(&self) -> Vec<Noise> {
        self.sources.iter().map(|source| source.nominal.clone()).collect()
    }

    fn add_source(&mut self, recording: &Recording, index: usize) -> usize {
        let series = &recording.sensors[index];
        let nominal = Noise::nominal(&series.sensor.nominal, series.sensor.quantisation);
        let unknown =
            series.sensor.nominal.white == 0.0 && nominal.markov.is_empty() && nominal.exp_cos.is_empty();
        self.sources.push(Source {
            name: series.sensor.id.clone(),
            sensor: index,
            port: Port::Output,
            unknown,
            nominal,
            unit: series.written_unit,
            integrates: series.sensor.kind == SensorKind::InsVelocity,
        });
        self.sources.len() - 1
    }

    fn add_known(&mut self, recording: &Recording, masked: &[Vec<bool>]) {
        if turns_in_place(recording) {
            self.notes.push("no velocity is recorded: the body is taken to turn where it is".to_owned());
        }
        if compares_over_earth(recording) {
            let taken =
                "no attitude is recorded: the axes of GNSS and INS velocities are taken as north, east, down";
            self.notes.push(taken.to_owned());
        }
        self.note_untold(recording);
        for (index, series) in recording.sensors.iter().enumerate() {
            match prediction_of(recording, series) {
                Ok(prediction) => self.add_direct(recording, masked, index, &prediction),
                Err(reason) => {
                    self.notes.push(format!("{} cannot be predicted: {reason}", series.sensor.id));
                }
            }
        }
    }

    /// The sensors that need no others to be checked: a simulator says what they read, or they are read as they are.
    fn add_alone(&mut self, recording: &Recording, masked: &[Vec<bool>]) {
        self.note_untold(recording);
        for (index, series) in recording.sensors.iter().enumerate() {
            if let Ok(prediction) = prediction_of(recording, series) {
                self.add_direct(recording, masked, index, &prediction);
            }
        }
    }

    /// Notes the sensors that were made relative though the case does not call them so.
    fn note_untold(&mut self, recording: &Recording) {
        let told = recording.sensors.iter().zip(&recording.case.sensors);
        for (series, _) in told.filter(|(series, written)| series.sensor.relative && !written.relative) {
            let sensor = &series.sensor;
            let what = if sensor.kind == SensorKind::Other { "its level" } else { "what it reads at rest" };
            self.notes
                .push(format!("{}: {what} is not told: it is taken for an unknown constant", sensor.id));
        }
    }

    fn add_direct(
        &mut self,
        recording: &Recording,
        masked: &[Vec<bool>],
        index: usize,
        prediction: &Prediction,
    ) {
        let series = &recording.sensors[index];
        let own = own_part(recording, index);
        let scale = 1.0 + 1e-6 * series.sensor.nominal.scale_factor_ppm;
        let data: Vec<f64> = (series.values.iter().zip(&own).enumerate())
            .map(|(row, (value, own))| {
                if is_masked(masked, index, row) {
                    f64::NAN
                } else {
                    value - scale * prediction.at(row) - own
                }
            })
            .collect();
        let source = self.add_source(recording, index);
        self.add_block(vec![index], vec![source], 1, data, Geometry::Direct);
    }

    fn add_redundant(&mut self, recording: &Recording, masked: &[Vec<bool>]) {
        for dimension in [Dimension::AngularRate, Dimension::Acceleration, Dimension::Velocity] {
            let mut indices = Vec::new();
            let present =
                |series: &SensorSeries| series.values.iter().filter(|value| value.is_finite()).count();
            let of_dimension = |series: &&SensorSeries| is_checked(series, dimension);
            let most = recording.sensors.iter().filter(of_dimension).map(present).max().unwrap_or_default();
            for (index, series) in recording.sensors.iter().enumerate() {
                let sensor = &series.sensor;
                if !is_checked(series, dimension) {
                    continue;
                }
                if (present(series) as f64) < LEAST_PRESENT * most as f64 {
                    self.notes.push(format!("{} has too few values to be checked against others", sensor.id));
                } else if sensor.axis.is_none() && dimension != Dimension::Velocity {
                    self.notes.push(format!("{} has no axis", sensor.id));
                } else {
                    indices.push(index);
                }
            }
            if indices.is_empty() {
                continue;
            }
            let axes = DMatrix::from_fn(indices.len(), 3, |row, axis| {
                let along = recording.sensors[indices[row]].sensor.axis.unwrap_or([1.0, 0.0, 0.0]);
                along[axis]
            });
            let parity = left_null_space(&axes);
            let names = || {
                let names = indices.iter().map(|&index| recording.sensors[index].sensor.id.as_str());
                names.collect::<Vec<_>>().join(", ")
            };
            if parity.nrows() == 0 {
                self.notes.push(format!("{} are not redundant: nothing checks them", names()));
                continue;
            }
            let rows = recording.len();
            let mut data = vec![0.0; parity.nrows() * rows];
            for (column, &index) in indices.iter().enumerate() {
                for (row, value) in of_input(recording, masked, index).into_iter().enumerate() {
                    for channel in 0..parity.nrows() {
                        data[channel * rows + row] += parity[(channel, column)] * value;
                    }
                }
            }
            let sources = indices.iter().map(|&index| self.add_source(recording, index)).collect();
            self.add_block(indices, sources, parity.nrows(), data, Geometry::Parity(parity));
        }
    }

    fn add_loop(&mut self, recording: &Recording, masked: &[Vec<bool>]) {
        let velocity =
            recording.sensors.iter().position(|series| series.sensor.kind == SensorKind::InsVelocity);
        let others = (recording.sensors.iter().enumerate()).filter(|(index, _)| Some(*index) != velocity);
        let others: Vec<&str> = others.map(|(_, series)| series.sensor.id.as_str()).collect();
        if !others.is_empty() {
            self.notes.push(format!("not checked in a velocity-error case: {}", others.join(", ")));
        }
        let Some(index) = velocity else {
            self.notes.push("a velocity-error case needs a sensor of kind ins_velocity".to_owned());
            return;
        };
        let series = &recording.sensors[index];
        let own = own_part(recording, index);
        let data: Vec<f64> = (series.values.iter().zip(&own).enumerate())
            .map(|(row, (value, own))| if is_masked(masked, index, row) { f64::NAN } else { value - own })
            .collect();
        let given = recording.case.schuler_loop.unwrap_or_default();
        let mut nominal = Noise::nominal(&series.sensor.nominal, series.sensor.quantisation);
        nominal.white = if given.velocity_white > 0.0 { given.velocity_white } else { nominal.white };
        let noise = |markov: Option<schuler_recording::case::Markov>| Noise {
            markov: markov.into_iter().filter(|part| part.sigma > 0.0).collect(),
            ..Noise::default()
        };
        let inertial = [
            ("accelerometer", Port::Accelerometer, noise(given.accelerometer), Dimension::Acceleration),
            ("gyro", Port::Gyro, noise(given.gyro), Dimension::AngularRate),
        ];
        let first = self.sources.len();
        self.sources.push(Source {
            name: "velocity".to_owned(),
            sensor: index,
            port: Port::Output,
            unknown: nominal.is_none(),
            nominal,
            unit: series.written_unit,
            integrates: true,
        });
        for (name, port, nominal, dimension) in inertial {
            self.sources.push(Source {
                name: name.to_owned(),
                sensor: index,
                port,
                unknown: false,
                nominal,
                unit: dimension.si_unit(),
                integrates: false,
            });
        }
        let start = data.iter().copied().find(|value| value.is_finite()).unwrap_or_default();
        let step = SchulerStep::new(given.gravity, given.radius_m, recording.step_s, start);
        self.add_block(vec![index], vec![first, first + 1, first + 2], 1, data, Geometry::Loop(step));
    }

    fn add_block(
        &mut self,
        sensors: Vec<usize>,
        sources: Vec<usize>,
        channels: usize,
        mut data: Vec<f64>,
        geometry: Geometry,
    ) {
        let rows = self.rows;
        let present: Vec<bool> =
            (0..rows).map(|row| (0..channels).all(|c| data[c * rows + row].is_finite())).collect();
        for (flat, value) in data.iter_mut().enumerate() {
            if !present[flat % rows] {
                *value = f64::NAN;
            }
        }
        let count = present.iter().filter(|&&present| present).count();
        if count < FEWEST_ROWS {
            let names: Vec<&str> = sources.iter().map(|&source| self.sources[source].name.as_str()).collect();
            self.notes.push(format!(
                "{}: {count} usable values; at least {FEWEST_ROWS} are needed",
                names.join(", ")
            ));
            self.sources.truncate(sources.first().copied().unwrap_or(self.sources.len()));
            return;
        }
        self.blocks.push(Block {
            sensors,
            sources,
            channels,
            data,
            present,
            loudness: Arc::default(),
            geometry,
            step_s: self.step_s,
        });
    }
}

/// What a sensor should read. One of kind "other" that no simulator predicts is read as it is, against 0 or an unknown constant.
fn prediction_of(recording: &Recording, series: &SensorSeries) -> Result<Prediction, Unpredictable> {
    match predict(recording, &series.sensor) {
        Err(Unpredictable::Other) => Ok(Prediction::Constant(0.0)),
        prediction => prediction,
    }
}

fn is_masked(masked: &[Vec<bool>], sensor: usize, row: usize) -> bool {
    masked.get(sensor).and_then(|rows| rows.get(row)).is_some_and(|&masked| masked)
}

/// Readings of a sensor as its input, by what the user believes of the sensor; NaN where they are missing or masked.
pub fn of_input(recording: &Recording, masked: &[Vec<bool>], index: usize) -> Vec<f64> {
    let (series, own) = (&recording.sensors[index], own_part(recording, index));
    let scale = 1.0 + 1e-6 * series.sensor.nominal.scale_factor_ppm;
    let readings = series.values.iter().zip(&own).enumerate();
    readings
        .map(
            |(row, (value, own))| {
                if is_masked(masked, index, row) { f64::NAN } else { (value - own) / scale }
            },
        )
        .collect()
}

/// Whether velocities are compared with those over the Earth though no attitude is recorded.
fn compares_over_earth(recording: &Recording) -> bool {
    let is_resolved = |series: &SensorSeries| is_resolved_over_earth(recording, &series.sensor);
    recording.motion.velocity_ned.is_some() && recording.sensors.iter().any(is_resolved)
}

/// Whether accelerometers are predicted from an attitude alone.
fn turns_in_place(recording: &Recording) -> bool {
    let motion = &recording.motion;
    let is_accelerometer = |series: &SensorSeries| series.sensor.kind == SensorKind::Accelerometer;
    motion.attitude_rad.is_some()
        && motion.velocity_ned.is_none()
        && motion.specific_force.is_none()
        && recording.sensors.iter().any(is_accelerometer)
}

/// What a sensor adds of itself: bias and the dependence on temperature.
fn own_part(recording: &Recording, index: usize) -> Vec<f64> {
    let nominal = &recording.sensors[index].sensor.nominal;
    let mut own = vec![nominal.bias; recording.len()];
    if let Some(dependence) = &nominal.temperature_bias
        && let Some(temperature) = recording.auxiliary(&dependence.column)
    {
        for (own, temperature) in own.iter_mut().zip(&temperature.values) {
            let off = temperature - dependence.reference_deg_c;
            *own += off * dependence.coefficients.iter().rev().fold(0.0, |sum, c| sum * off + c);
        }
    }
    own
}

/// Orthonormal rows V with V A = 0 [FDI-4].
fn left_null_space(axes: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = (axes * axes.transpose()).symmetric_eigen();
    let largest = eigen.eigenvalues.amax();
    let null: Vec<_> = (0..axes.nrows())
        .filter(|&index| eigen.eigenvalues[index] < NULL_SPACE * largest)
        .map(|index| eigen.eigenvectors.column(index).transpose())
        .collect();
    if null.is_empty() { DMatrix::zeros(0, axes.nrows()) } else { DMatrix::from_rows(&null) }
}
