//! A case and its table together: arrays in SI units on the nominal step grid, with gaps and missing values marked.
//!
//! A value that is missing (an empty cell, `nan`, an infinite number, a row in a gap) is NaN. A row that holds nothing but its time
//! is a row in a gap.
//! [`Recording`] holds all of it; [`Stream`] goes through a table of any length and gives recordings of a few thousand
//! rows.
mod alike;
mod clock;
mod degrees;
mod even;
mod grid;
mod layout;
mod simulated;
mod stamps;
mod stream;

use std::path::Path;

use crate::case::{Auxiliary, Case, CaseFile, Sensor};
use crate::error::Error;
use crate::motion::velocity_of_body;
use crate::table::{Columns, TableReader};
use crate::unit::Unit;

use grid::Grid;
pub use grid::{GAP_STEPS, Gap};
use layout::{Layout, Rows, TIME, file_warnings, time_error, time_note};
use simulated::Simulated;
use stamps::Timed;
pub use stamps::unit_of_stamps;
pub use stream::Stream;

/// A recording, in SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The case, as it is written.
    pub case: Case,
    /// Step, s.
    pub step_s: f64,
    /// Time of each row as recorded, or of the even clock where the stamps are those of arrival (any origin), s; in gaps,
    /// between the neighbours.
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
    /// The columns in formulas of the case's effects.
    pub in_formulas: Vec<FormulaColumn>,
    /// What the user should be told: what was left out, a row cut off, infinite values, what was made of the time stamps.
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
    /// What the user's simulator says that it reads, SI, on the recording's rows; NaN = missing. None where the case names no `predicted`.
    pub predicted: Option<Vec<f64>>,
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

/// A column in the formula of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct FormulaColumn {
    /// Its name.
    pub column: String,
    /// Values in the unit that the case states for the column, else as the table has them; NaN = missing.
    pub values: Vec<f64>,
}

/// How complete a series is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quality {
    /// Rows with a value.
    pub present: usize,
    /// Rows of the table without one that hold another value; infinite values count here.
    pub missing: usize,
    /// Rows of the table with an infinite value, those without any other value among them.
    pub infinite: usize,
    /// Rows put in for missing steps; a row of the table that holds nothing but its time is one of them.
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
        let table = file.open_table()?;
        Self::of_table(file, table)
    }

    /// Reads a case's table from where it is.
    ///
    /// # Errors
    /// As [`of_case`](Self::of_case).
    pub fn of_table(file: CaseFile, table: Box<dyn TableReader>) -> Result<Self, Error> {
        Self::of_table_watched(file, table, |_, _| Ok(()))
    }

    /// Reads a case's table and that of its simulation from where they are. A case whose simulation has no table of its own reads none.
    ///
    /// # Errors
    /// As [`of_case`](Self::of_case).
    pub fn of_tables(
        file: CaseFile,
        table: Box<dyn TableReader>,
        simulation: Box<dyn TableReader>,
    ) -> Result<Self, Error> {
        let simulated = Simulated::of_table(&file, simulation)?;
        Self::beside(file, table, simulated, |_, _| Ok(()))
    }

    /// Reads a case's table from where it is; `watch` is told after every few thousand rows how many rows of how many columns are kept so far,
    /// and at last how many there are with those put in for missing steps, and may stop it.
    ///
    /// # Errors
    /// As [`of_case`](Self::of_case), or what `watch` returns.
    pub fn of_table_watched<E: From<Error>>(
        file: CaseFile,
        table: Box<dyn TableReader>,
        watch: impl FnMut(usize, usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let simulated = Simulated::read(&file)?;
        Self::beside(file, table, simulated, watch)
    }

    fn beside<E: From<Error>>(
        file: CaseFile,
        table: Box<dyn TableReader>,
        simulated: Option<Simulated>,
        mut tell: impl FnMut(usize, usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let layout =
            Layout::new(&file, &*table, |column| simulated.as_ref().is_some_and(|it| it.has(column)))?;
        let mut columns = Columns::none(layout.width());
        for chunk in Timed::new(&file, layout.chunks(table)?) {
            columns.append(chunk?);
            tell(columns.rows(), layout.width())?;
        }
        let recorded_s = columns.values.get(TIME).map_or(&[][..], Vec::as_slice);
        let source = &file.case.recording;
        let mut grid = Grid::new(source.time_name(), recorded_s, &columns.lines, source.step_s)
            .map_err(|problem| time_error(&file, problem))?;
        layout::switched_on_within(&file, &grid.time_s)?;
        // Rows are put in only if the user has the memory for them.
        tell(grid.time_s.len(), layout.width())?;
        let mut warnings = alike::said(&file.case, &layout, &columns, &file.table_path());
        warnings.extend(file_warnings(&file));
        warnings.extend_from_slice(&layout.notes);
        warnings.append(&mut columns.warnings);
        warnings.extend(layout.infinite_warnings(&file, &columns.infinite));
        warnings.extend(time_note(&file, grid.note.take()));
        let mut quality = layout.quality(&columns);
        let in_gaps = grid.time_s.len() - columns.rows();
        for quality in &mut quality {
            quality.in_gaps = in_gaps;
        }
        let rows = Rows {
            step_s: grid.step_s,
            inserted: grid.inserted(),
            time_s: std::mem::take(&mut grid.time_s),
            gaps: grid.gaps.clone(),
        };
        let lines = file.lines.clone();
        let path = file.path.clone();
        let mut recording = layout.recording(file.case, rows, &quality, warnings, |place| {
            grid.spread(columns.values.get_mut(place).map(std::mem::take).unwrap_or_default())
        });
        recording.refuse_degrees(&path, &lines)?;
        if let Some(simulated) = simulated {
            simulated.put_beside(&mut recording, &path, &lines)?;
        }
        recording.leave_antenna();
        Ok(recording)
    }

    /// Makes the velocity that of the body where the case says that it is of a point beside it.
    fn leave_antenna(&mut self) {
        let MotionSeries { velocity_ned, attitude_rad, .. } = &mut self.motion;
        if let (Some(position_m), Some(velocity), Some(attitude)) =
            (self.case.motion.velocity_at_m, velocity_ned, attitude_rad)
        {
            *velocity = velocity_of_body(&self.time_s, attitude, velocity, position_m);
        }
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
