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
use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::{Complex, DMatrix, DVector};
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::motion::{Prediction, Unpredictable, is_resolved_over_earth, predict};
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::{Dimension, Unit};

use crate::bands::onset_energy::{self, Shapes};
use crate::catalogue::{Column, Port};
use crate::common_motion::CommonMotion;
use crate::inputs::Loudness;
use crate::inputs::redundant::is_checked;
use crate::inputs::series::Series;
use crate::noise::{Group, Noise, RowsOfLevel};
use crate::numeric::statistics::median;
use crate::numeric::within_step::over_step;
use crate::whitening::filter::{Filter, Space};

/// Standard deviations of the loop's velocity error, m/s, and vertical error, rad, at the start.
const LOOP_START: [f64; 2] = [0.1, 1e-4];
/// A first velocity error of this many of its standard deviations means that the loop starts from there.
const START_SIGMAS: f64 = 3.0;
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
enum Geometry {
    /// The one sensor is the one channel.
    Direct,
    /// V, channels by sensors.
    Parity(DMatrix<f64>),
    /// The Schuler loop over a step.
    Loop(SchulerStep),
}

/// The undisturbed loop over a step, and what a constant accelerometer error and gyro drift add.
#[derive(Clone, Copy, Debug)]
struct SchulerStep {
    /// What the rates of change of its states are of them: of the velocity error by the error of the vertical, and the other way round.
    generator: [[f64; 2]; 2],
    transition: [[f64; 2]; 2],
    accelerometer: [f64; 2],
    gyro: [f64; 2],
    start: [f64; 2],
}

/// Channels that are filtered together.
#[derive(Clone, Debug)]
pub struct Block {
    /// Its sensors, by their places in the recording.
    pub sensors: Vec<usize>,
    /// Its sources, by their places in [`Model::sources`].
    pub sources: Vec<usize>,
    /// Number of channels.
    pub channels: usize,
    /// Residuals, channel after channel; NaN where missing.
    pub data: Vec<f64>,
    /// Rows that are present.
    pub present: Vec<bool>,
    /// Quantities that its white level may go with.
    pub loudness: Arc<[Loudness]>,
    geometry: Geometry,
    step_s: f64,
}

/// The nominal model of a case.
#[derive(Clone, Debug)]
pub struct Model {
    /// The sources of noise.
    pub sources: Vec<Source>,
    /// The blocks.
    pub blocks: Vec<Block>,
    /// Redundant sensors, seen beside the motion that they have in common, where the search asks for them.
    pub common_motions: Vec<CommonMotion>,
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
            common_motions: Vec::new(),
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

impl SchulerStep {
    fn new(gravity: f64, radius: f64, step_s: f64, first: f64) -> Self {
        let omega = (gravity / radius).sqrt();
        let speed = (gravity * radius).sqrt();
        let (sin, cos) = (omega * step_s).sin_cos();
        let start = if first.abs() > START_SIGMAS * LOOP_START[0] { first.abs() } else { LOOP_START[0] };
        Self {
            generator: [[0.0, -gravity], [radius.recip(), 0.0]],
            transition: [[cos, -speed * sin], [sin / speed, cos]],
            accelerometer: [sin / omega, (1.0 - cos) / (omega * speed)],
            gyro: [-speed * (1.0 - cos) / omega, sin / omega],
            start: [start, LOOP_START[1]],
        }
    }

    /// Lets parts of the noises inside the loop, each of the source at a place with its first state, drive it between the rows. The rounding of an
    /// angle, which is there at the rows alone, is none of them.
    fn drive(&self, space: &mut Space, inside: &[(usize, usize, &Group)], step_s: f64) {
        let continuous = inside
            .iter()
            .filter_map(|&(place, at, group)| Some((place, at, group, group.rates?, group.density(step_s)?)));
        let parts: Vec<_> = continuous.collect();
        // The loop's two states, and those of the parts, by their places in the whole.
        let own = parts.iter().flat_map(|&(_, at, group, ..)| at..at + group.size);
        let states: Vec<usize> = [0, 1].into_iter().chain(own).collect();
        let size = states.len();
        let (mut generator, mut density) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        let [[_, tilt], [speed, _]] = self.generator;
        (generator[(0, 1)], generator[(1, 0)]) = (tilt, speed);
        let mut fastest = (-tilt * speed).sqrt();
        let mut at = 2;
        for &(place, _, group, [decay, frequency], of_noise) in &parts {
            for i in 0..group.size {
                generator[(at + i, at + i)] = -decay;
                generator[(place - 1, at + i)] = group.seen[i];
                density[(at + i, at + i)] = of_noise;
            }
            if group.size == 2 {
                (generator[(at, at + 1)], generator[(at + 1, at)]) = (-frequency, frequency);
            }
            fastest = fastest.max(decay.hypot(frequency));
            at += group.size;
        }
        let [transition, driven] = over_step(&generator, &density, fastest, step_s);
        for (i, &row) in states.iter().enumerate() {
            for (j, &column) in states.iter().enumerate() {
                space.transition[row * space.states + column] = transition[(i, j)];
                space.driven[row * space.states + column] = driven[(i, j)];
            }
        }
    }

    fn of_port(&self, port: Port) -> Option<[f64; 2]> {
        match port {
            Port::Output => None,
            Port::Accelerometer => Some(self.accelerometer),
            Port::Gyro => Some(self.gyro),
        }
    }
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

impl SchulerStep {
    /// Velocity error that an input over the record causes from rest; between rows the input is taken as its mean.
    fn response(&self, values: &[f64], enters: [f64; 2]) -> Vec<f64> {
        let mut state = [0.0; 2];
        let next = values.iter().skip(1).chain(values.last());
        (values.iter().zip(next))
            .map(|(now, next)| {
                let before = state;
                let mean = 0.5 * (now + next);
                for i in 0..2 {
                    state[i] = self.transition[i][0] * before[0]
                        + self.transition[i][1] * before[1]
                        + enters[i] * mean;
                }
                before[0]
            })
            .collect()
    }

    /// The transpose of [`response`](Self::response).
    fn transposed_response(&self, scores: &[f64], enters: [f64; 2]) -> Vec<f64> {
        let mut result = vec![0.0; scores.len()];
        let mut costate = [0.0; 2];
        for (row, score) in scores.iter().enumerate().rev() {
            let through = 0.5 * (enters[0] * costate[0] + enters[1] * costate[1]);
            result[row] += through;
            if let Some(next) = result.get_mut(row + 1) {
                *next += through;
            } else {
                result[row] += through;
            }
            let before = costate;
            for i in 0..2 {
                costate[i] = self.transition[0][i] * before[0] + self.transition[1][i] * before[1];
            }
            costate[0] += score;
        }
        result
    }
}
