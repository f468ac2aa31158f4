//! The flight module's outputs as a table: one row a step, SI units.
use std::path::Path;

use schuler_core::health;
use schuler_core::isolation::Verdict;
use schuler_core::module::StepOutput;
use schuler_recording::Error;
use schuler_recording::table::{Format, TableWriter};

use super::sensors::Place;
use super::{Channel, Step};
use crate::output::Draft;

/// Names of the filter's states with their units.
pub const STATES: [(&str, &str); 4] =
    [("velocity_error", "m/s"), ("tilt", "rad"), ("accelerometer_error", "m/s^2"), ("gyro_drift", "rad/s")];

/// A verdict as a number: 0 no fault, 1 to 5 this gyro, 6 detected and not isolated, 7 block untrusted.
pub fn verdict_code(verdict: Verdict) -> f64 {
    match verdict {
        Verdict::NoFault => 0.0,
        Verdict::Fault(gyro) => f64::from(gyro) + 1.0,
        Verdict::DetectedNotIsolated => 6.0,
        Verdict::BlockUntrusted => 7.0,
    }
}

/// A verdict of the health monitor as a number: 0 unobserved, 1 nominal, 2 shifted mean, 3 grown noise, 4 both, 5 one of the two,
/// 6 inertial divergence, 7 out of the model, 8 the radio holds its last value.
pub fn health_code(verdict: health::Verdict) -> f64 {
    match verdict {
        health::Verdict::Unobserved => 0.0,
        health::Verdict::Nominal => 1.0,
        health::Verdict::ShiftedMean => 2.0,
        health::Verdict::GrownNoise => 3.0,
        health::Verdict::ShiftedMeanAndGrownNoise => 4.0,
        health::Verdict::UndecidedFault => 5.0,
        health::Verdict::InertialDivergence => 6.0,
        health::Verdict::OutOfModel => 7.0,
        health::Verdict::HeldReading => 8.0,
    }
}

/// What the compensation makes of the sensor at an input: rad/s or m/s².
pub fn corrected(output: &StepOutput, place: Place) -> f64 {
    let it = &output.compensation;
    match place {
        Place::Gyro(k) => it.gyros.get(k),
        Place::Accelerometer(k) => it.accelerometers.get(k),
    }
    .copied()
    .unwrap_or(f64::NAN)
}

/// Rows that are written at a time.
const ROWS: usize = 1 << 12;

/// A column of the table.
type Column = Box<dyn Fn(&StepOutput) -> f64>;

/// Writes the outputs of a channel step by step; the file is there when all are in it.
pub struct Writer {
    draft: Draft,
    table: TableWriter,
    columns: Vec<Column>,
    /// Time and columns of the rows that are not written yet.
    rows: Vec<Vec<f64>>,
}

impl Writer {
    /// Begins the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn of(channel: &Channel, path: &Path) -> Result<Self, Error> {
        let (names, columns): (Vec<String>, Vec<Column>) = columns(channel).into_iter().unzip();
        let names: Vec<&str> = std::iter::once("t").chain(names.iter().map(String::as_str)).collect();
        let draft = Draft::of(path)?;
        let format = Format::of(path).unwrap_or(Format::Csv);
        let table = TableWriter::new(draft.file()?, path, format, &names, &[])?;
        Ok(Self { draft, table, rows: vec![Vec::with_capacity(ROWS); names.len()], columns })
    }

    /// Adds the row of a step.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn add(&mut self, step: &Step, output: &StepOutput) -> Result<(), Error> {
        let [time_s, values @ ..] = &mut self.rows[..] else { return Ok(()) };
        time_s.push(step.time_s);
        for (values, column) in values.iter_mut().zip(&self.columns) {
            values.push(column(output));
        }
        if time_s.len() == ROWS { self.flush() } else { Ok(()) }
    }

    /// Writes what is left and puts the file in its place.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(mut self) -> Result<(), Error> {
        self.flush()?;
        self.table.finish()?;
        self.draft.keep()
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.table.write(&self.rows.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
        self.rows.iter_mut().for_each(Vec::clear);
        Ok(())
    }
}

/// The columns of a table with their names.
#[derive(Default)]
struct Columns(Vec<(String, Column)>);

impl Columns {
    fn put(&mut self, name: impl Into<String>, value: impl Fn(&StepOutput) -> f64 + 'static) {
        self.0.push((name.into(), Box::new(value)));
    }
}

/// The columns of a channel beside the time, with their names.
fn columns(channel: &Channel) -> Vec<(String, Column)> {
    let mut all = Columns::default();
    all.put("status", move |o| f64::from(o.status.bits()));
    if channel.has_velocity {
        for (k, (state, _)) in STATES.iter().enumerate() {
            all.put(*state, move |o| f64::from(o.filter.estimate[k]));
            all.put(format!("{state}.sigma"), move |o| f64::from(o.filter.sigma[k]));
            all.put(format!("{state}.averaged"), move |o| f64::from(o.identification.averaged.estimate[k]));
            all.put(format!("{state}.averaged_sigma"), move |o| {
                f64::from(o.identification.averaged.sigma[k])
            });
        }
        // 0 the filter, 1 the wide bank, 2 the narrow bank.
        all.put("averaged_source", move |o| f64::from(o.identification.averaged.source as u8));
        all.put("innovation", move |o| f64::from(o.filter.innovation));
        all.put("innovation_variance", move |o| f64::from(o.filter.innovation_variance));
        all.put("nis", move |o| f64::from(o.filter.nis));
        all.put("retunes", move |o| f64::from(o.identification.retunes));
        for (name, noise) in [("accelerometer", 0), ("gyro", 1)] {
            let of = move |o: &StepOutput| {
                let estimate =
                    if noise == 0 { &o.identification.accelerometer } else { &o.identification.gyro };
                estimate.noise
            };
            all.put(format!("{name}.sigma"), move |o| f64::from(of(o).sigma));
            all.put(format!("{name}.alpha"), move |o| f64::from(of(o).alpha));
            all.put(format!("{name}.beta"), move |o| f64::from(of(o).beta));
        }
    }
    if channel.gyros.is_some() {
        all.put("verdict", move |o| verdict_code(o.isolation.verdict));
        all.put("alarm_level", move |o| o.isolation.alarm_level);
        all.put("margin", move |o| o.isolation.margin);
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            all.put(format!("rate_{axis}"), move |o| o.isolation.rate[k]);
        }
        for k in 0..2 {
            all.put(format!("parity_{}", k + 1), move |o| o.isolation.parity[k]);
        }
        for k in 0..5 {
            all.put(format!("determinant_{}", k + 1), move |o| o.isolation.determinants[k]);
        }
        all.put("fault_size", move |o| o.isolation.fault_size);
        all.put("fault_size.sigma", move |o| o.isolation.fault_sigma);
    }
    for (k, column) in channel.thermometers.iter().enumerate() {
        let of = move |o: &StepOutput| o.thermometers.get(k).copied().unwrap_or_default();
        all.put(format!("{column}.temperature"), move |o| f64::from(of(o).temperature));
        all.put(format!("{column}.temperature.sigma"), move |o| f64::from(of(o).temperature_sigma));
        all.put(format!("{column}.rate"), move |o| f64::from(of(o).rate));
        all.put(format!("{column}.rate.sigma"), move |o| f64::from(of(o).rate_sigma));
        all.put(format!("{column}.status"), move |o| f64::from(of(o).status.bits()));
    }
    if channel.compensation.is_some() {
        all.put("compensation.calibration", move |o| f64::from(o.compensation.calibration.bits()));
        all.put("compensation.terms", move |o| f64::from(o.compensation.terms.bits()));
        all.put("compensation.velocity", move |o| f64::from(o.compensation.velocity));
        all.put("compensation.accelerometer", move |o| f64::from(o.compensation.loop_errors[0]));
        all.put("compensation.gyro", move |o| f64::from(o.compensation.loop_errors[1]));
        for &(ref id, place) in &channel.sensors {
            all.put(format!("{id}.corrected"), move |o| corrected(o, place));
        }
    }
    if channel.has_health {
        all.put("health.verdict", move |o| health_code(o.health.verdict));
        all.put("health.suspect", move |o| f64::from(o.health.suspect as u8));
        all.put("health.status", move |o| f64::from(o.health.status.bits()));
        all.put("health.p_jump", move |o| f64::from(o.health.p_jump));
        all.put("health.p_noise", move |o| f64::from(o.health.p_noise));
        all.put("health.p_memory", move |o| f64::from(o.health.p_memory));
        all.put("health.p_fault", move |o| f64::from(o.health.p_fault));
        for (mode, name) in ["nominal", "noise", "jump", "jump_and_noise"].iter().enumerate() {
            all.put(format!("health.mode.{name}"), move |o| {
                f64::from(o.health.mode_probability.as_flattened().get(mode).copied().unwrap_or(f32::NAN))
            });
        }
        all.put("health.residual", move |o| f64::from(o.health.residual));
        for name in ["radio_error", "inertial_error", "jump"] {
            let of = move |o: &StepOutput| match name {
                "radio_error" => o.health.radio_error,
                "inertial_error" => o.health.inertial_error,
                _ => o.health.jump,
            };
            all.put(format!("health.{name}"), move |o| f64::from(of(o).value));
            all.put(format!("health.{name}.sigma"), move |o| f64::from(of(o).sigma));
        }
    }
    all.0
}
