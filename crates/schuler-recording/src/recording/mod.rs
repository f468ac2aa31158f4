//! A case and its table together: arrays in SI units on the nominal step grid, with gaps and missing values marked.
//!
//! A value that is missing (an empty cell, `nan`, an infinite number, a row in a gap) is NaN.
mod grid;

use std::path::Path;

use crate::case::{Auxiliary, Case, CaseFile, Quantity, Sensor};
use crate::error::{Error, Problem};
use crate::table::{self, TableReader};
use crate::unit::{AuxConversion, Unit};

use grid::Grid;
pub use grid::{GAP_STEPS, Gap};

/// A recording, in SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The case, as it is written.
    pub case: Case,
    /// Nominal step, s.
    pub step_s: f64,
    /// Time of each row as recorded (any origin), s; in gaps, between the neighbours.
    pub time_s: Vec<f64>,
    /// Which rows are not in the table and were put in for a missing step.
    pub inserted: Vec<bool>,
    /// The gaps, in order.
    pub gaps: Vec<Gap>,
    /// The sensors, in the order of the case.
    pub sensors: Vec<SensorSeries>,
    /// The auxiliary quantities, in the order of the case.
    pub auxiliaries: Vec<AuxiliarySeries>,
    /// What the body did, as far as there are columns for it.
    pub motion: MotionSeries,
    /// Angle of the table in a calibration run, rad; NaN = missing.
    pub table_angle: Option<Vec<f64>>,
    /// What the user should be told: unknown keys, a row cut off, infinite values.
    pub warnings: Vec<String>,
}

/// The readings of a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSeries {
    /// The sensor with every value in SI units.
    pub sensor: Sensor,
    /// The unit in which the case is written, for reports.
    pub written_unit: Unit,
    /// Readings in the SI unit of the sensor; NaN = missing.
    pub values: Vec<f64>,
    /// How complete they are.
    pub quality: Quality,
}

/// The values of an auxiliary quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct AuxiliarySeries {
    /// What it is, with its unit in SI (temperature in °C, unknown units as they are).
    pub auxiliary: Auxiliary,
    /// Values; NaN = missing.
    pub values: Vec<f64>,
    /// How complete they are.
    pub quality: Quality,
}

/// How complete a series is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quality {
    /// Rows with a value.
    pub present: usize,
    /// Rows of the table without one; infinite values count here.
    pub missing: usize,
    /// Of these, rows with an infinite value.
    pub infinite: usize,
    /// Rows put in for missing steps.
    pub in_gaps: usize,
}

/// What the body did: x, y, z (north, east, down; roll, pitch, yaw), one array each; NaN = missing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionSeries {
    /// Inertial rate in body axes, rad/s.
    pub rate: Option<[Vec<f64>; 3]>,
    /// Specific force in body axes, m/s².
    pub specific_force: Option<[Vec<f64>; 3]>,
    /// Velocity north, east, down, m/s.
    pub velocity_ned: Option<[Vec<f64>; 3]>,
    /// Roll, pitch and yaw (body from NED, 3-2-1), rad.
    pub attitude_rad: Option<[Vec<f64>; 3]>,
}

impl Recording {
    /// Reads the case at `path` and its table.
    ///
    /// # Errors
    /// What is wrong with either file, by line and field.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::of_case(CaseFile::read(path)?)
    }

    /// Reads the table of a case.
    ///
    /// # Errors
    /// Columns that the table lacks, cells that are not numbers, times that do not increase.
    pub fn of_case(file: CaseFile) -> Result<Self, Error> {
        let table = table::open(&file.table_path())?;
        Self::of_table(file, table)
    }

    /// Reads a case's table from where it is.
    ///
    /// # Errors
    /// As [`of_case`](Self::of_case).
    pub fn of_table(file: CaseFile, table: Box<dyn TableReader>) -> Result<Self, Error> {
        let table_path = file.table_path();
        let mut wanted = Wanted::new(&file, &*table);
        // First: of a log it decides what the rows are.
        let time = wanted.column(&file.case.recording.time, "recording.time");
        let sensors: Vec<usize> = (file.case.sensors.iter().enumerate())
            .map(|(index, sensor)| wanted.column(&sensor.column, &format!("sensor[{index}].column")))
            .collect();
        let auxiliaries = all_auxiliaries(&file.case);
        let auxiliary_columns: Vec<usize> =
            auxiliaries.iter().map(|(auxiliary, path)| wanted.column(&auxiliary.column, path)).collect();
        let motion = &file.case.motion;
        let mut motion_columns = |columns: &Option<[String; 3]>, key: &str| {
            let [x, y, z] = columns.as_ref()?;
            Some(
                [(x, 0), (y, 1), (z, 2)]
                    .map(|(name, axis)| wanted.column(name, &format!("motion.{key}[{axis}]"))),
            )
        };
        let rate = motion_columns(&motion.rate, "rate");
        let specific_force = motion_columns(&motion.specific_force, "specific_force");
        let velocity_ned = motion_columns(&motion.velocity_ned, "velocity_ned");
        let attitude_rad = motion_columns(&motion.attitude_rad, "attitude_rad");
        let table_angle = file.case.table();
        let angle_unit = table_angle.map_or(1.0, |it| it.unit.in_si());
        let table_angle = table_angle.map(|it| wanted.column(&it.column, "calibration.table.column"));
        let indices = wanted.finish()?;

        let mut columns = table.read(&indices)?;
        let recorded_s = columns.values.get(time).map_or(&[][..], Vec::as_slice);
        let step_s = file.case.recording.step_s;
        let grid = Grid::new(&file.case.recording.time, recorded_s, &columns.lines, step_s).map_err(
            |mut problem| {
                if problem.line.is_some() || problem.field == file.case.recording.time {
                    return Error::one(&table_path, problem);
                }
                "recording.step_s".clone_into(&mut problem.field);
                problem.line = file.lines.get(&problem.field);
                Error::one(&file.path, problem)
            },
        )?;

        let mut warnings: Vec<String> =
            file.warnings.iter().map(|warning| format!("{}: {warning}", file.path.display())).collect();
        warnings.extend(columns.warnings.iter().cloned());
        let mut series = |column: usize, name: &str| {
            let values = columns.values.get_mut(column).map(std::mem::take).unwrap_or_default();
            let missing = values.iter().filter(|value| value.is_nan()).count();
            let infinite = columns.infinite.get(column).copied().unwrap_or_default();
            if infinite > 0 {
                warnings.push(format!(
                    "{}: {name}: {infinite} infinite values are missing",
                    table_path.display()
                ));
            }
            let in_gaps = grid.time_s.len() - values.len();
            let quality = Quality { present: values.len() - missing, missing, infinite, in_gaps };
            (grid.spread(values), quality)
        };
        let sensors = (file.case.sensors.iter().zip(sensors))
            .map(|(sensor, column)| {
                let (values, quality) = series(column, &sensor.column);
                let values = scaled(values, sensor.unit.in_si());
                SensorSeries { sensor: sensor.in_si(), written_unit: sensor.unit, values, quality }
            })
            .collect();
        let auxiliaries = (auxiliaries.into_iter().zip(auxiliary_columns))
            .map(|((mut auxiliary, _), column)| {
                let (mut values, quality) = series(column, &auxiliary.column);
                let conversion = AuxConversion::of(&auxiliary.unit);
                if !conversion.is_identity() {
                    for value in &mut values {
                        *value = conversion.apply(*value);
                    }
                }
                auxiliary.unit = conversion.unit;
                AuxiliarySeries { auxiliary, values, quality }
            })
            .collect();
        let table_angle = table_angle.map(|column| scaled(series(column, "calibration.table").0, angle_unit));
        let mut triple = |columns: Option<[usize; 3]>| {
            columns.map(|columns| columns.map(|column| series(column, "motion").0))
        };
        let motion = MotionSeries {
            rate: triple(rate),
            specific_force: triple(specific_force),
            velocity_ned: triple(velocity_ned),
            attitude_rad: triple(attitude_rad),
        };
        Ok(Self {
            step_s: grid.step_s,
            inserted: grid.inserted(),
            case: file.case,
            time_s: grid.time_s,
            gaps: grid.gaps,
            sensors,
            auxiliaries,
            motion,
            table_angle,
            warnings,
        })
    }

    /// Number of rows, recorded and put in.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there are no rows; never for a recording that was read.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Time from the first row, s.
    pub fn elapsed_s(&self) -> impl Iterator<Item = f64> + '_ {
        let start_s = self.time_s.first().copied().unwrap_or_default();
        self.time_s.iter().map(move |time| time - start_s)
    }

    /// The sensor with the given id.
    pub fn sensor(&self, id: &str) -> Option<&SensorSeries> {
        self.sensors.iter().find(|series| series.sensor.id == id)
    }

    /// The auxiliary quantity in the given column.
    pub fn auxiliary(&self, column: &str) -> Option<&AuxiliarySeries> {
        self.auxiliaries.iter().find(|series| series.auxiliary.column == column)
    }
}

/// Values times a factor.
fn scaled(values: Vec<f64>, factor: f64) -> Vec<f64> {
    values.into_iter().map(|value| value * factor).collect()
}

/// The auxiliary quantities with the path of each in the case: those that the case lists, and the temperatures that
/// nominal models depend on without being listed.
fn all_auxiliaries(case: &Case) -> Vec<(Auxiliary, String)> {
    let mut all: Vec<(Auxiliary, String)> = (case.auxiliaries.iter().enumerate())
        .map(|(index, auxiliary)| (auxiliary.clone(), format!("aux[{index}].column")))
        .collect();
    for (index, sensor) in case.sensors.iter().enumerate() {
        let Some(dependence) = &sensor.nominal.temperature_bias else { continue };
        if all.iter().all(|(auxiliary, _)| auxiliary.column != dependence.column) {
            let auxiliary = Auxiliary {
                column: dependence.column.clone(),
                quantity: Quantity::Temperature,
                unit: "degC".to_owned(),
                near: Some(sensor.id.clone()),
                position_m: None,
            };
            all.push((auxiliary, format!("sensor[{index}].nominal.temperature_bias.column")));
        }
    }
    all
}

/// The columns that a case asks of its table.
struct Wanted<'f> {
    file: &'f CaseFile,
    table: &'f dyn TableReader,
    indices: Vec<usize>,
    problems: Vec<Problem>,
}

impl<'f> Wanted<'f> {
    fn new(file: &'f CaseFile, table: &'f dyn TableReader) -> Self {
        Self { file, table, indices: Vec::new(), problems: Vec::new() }
    }

    /// Asks for the column `name`, which stands at `path` in the case; returns its place among the columns asked for.
    fn column(&mut self, name: &str, path: &str) -> usize {
        match self.table.index(name) {
            Ok(index) => self.indices.push(index),
            Err(message) => self.problems.push(Problem::new(self.file.lines.get(path), path, message)),
        }
        self.indices.len().saturating_sub(1)
    }

    fn finish(self) -> Result<Vec<usize>, Error> {
        if self.problems.is_empty() {
            Ok(self.indices)
        } else {
            Err(Error::new(&self.file.path, self.problems))
        }
    }
}
