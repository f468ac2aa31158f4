//! What the user's simulator says in a table of its own, brought to the rows of the recording.
//!
//! | module | does |
//! | --- | --- |
//! | `interpolate` | values of a table between its rows: cubic, never over a step |
//! | `align` | offset and rate of the simulator's clock, where the case calls it unknown |
mod align;
mod interpolate;

use std::path::{Path, PathBuf};

use super::layout::{Layout, Rows, TIME};
use super::stamps::Timed;
use super::{MotionSeries, Recording};
use crate::case::{CaseFile, Clock, Covers, Motion, MotionKind, Nominal, Simulation, Source};
use crate::document::Lines;
use crate::error::{Error, Problem};
use crate::leniency::Leniency;
use crate::table::{self, Columns, TableReader};
use align::{Pair, Shift};
use interpolate::interpolated;

/// Part of the recording's rows that a simulation may lack at its ends without more than a warning.
const FEW_ROWS: f64 = 0.01;

/// The simulator's table.
pub(super) struct Simulated {
    path: PathBuf,
    simulation: Simulation,
    source: Source,
    leniency: Leniency,
    /// Its rows, with predictions as readings and the motion that it has.
    rows: Recording,
    /// Of each prediction, its sensor's place in the case.
    sensors: Vec<usize>,
    /// Lines of the first and the last row.
    ends: [Option<u64>; 2],
}

impl Simulated {
    /// Reads the table of the simulation of a case from its file; none where it has none of its own.
    ///
    /// # Errors
    /// Columns that it lacks, cells that are not numbers, a clock that goes back.
    pub(super) fn read(file: &CaseFile) -> Result<Option<Self>, Error> {
        let Some(path) = file.simulation_path() else { return Ok(None) };
        Self::of_table(file, table::open_with(&path, file.leniency)?)
    }

    /// Reads that table from where it is.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub(super) fn of_table(file: &CaseFile, table: Box<dyn TableReader>) -> Result<Option<Self>, Error> {
        let Some(simulation) = file.case.simulation.clone() else { return Ok(None) };
        let Some(source) = simulation.table.clone() else { return Ok(None) };
        let Some(path) = file.simulation_path() else { return Ok(None) };
        let sensors: Vec<usize> =
            (0..file.case.sensors.len()).filter(|&it| file.case.sensors[it].predicted.is_some()).collect();
        let own = as_recording(file, &source, &sensors, &*table);
        let layout = Layout::new(&own, &*table, |_| false).map_err(|error| in_case(file, &sensors, error))?;
        let mut columns = Columns::none(layout.width());
        for chunk in Timed::new(&own, layout.chunks(table)?) {
            columns.append(chunk?);
        }
        let time_s = columns.values.get(TIME).cloned().unwrap_or_default();
        goes_on(&time_s, &columns.lines)
            .map_err(|(line, message)| Error::one(&path, Problem::new(line, source.time_name(), message)))?;
        let mut warnings: Vec<String> = columns.warnings.drain(..).collect();
        warnings.extend(source.assumption().map(|said| format!("{} {said}", path.display())));
        warnings.extend(layout.infinite_warnings(&own, &columns.infinite));
        for warning in &mut warnings {
            *warning = warning.replace("recording.time_unit", "simulation.time_unit");
        }
        let ends = [columns.lines.first().copied(), columns.lines.last().copied()];
        let inserted = vec![false; time_s.len()];
        let of_rows = Rows { step_s: step_of(&time_s), time_s, inserted, gaps: Vec::new() };
        let quality = layout.quality(&columns);
        let rows = layout.recording(own.case, of_rows, &quality, warnings, |place| {
            columns.values.get_mut(place).map(std::mem::take).unwrap_or_default()
        });
        let leniency = file.leniency;
        Ok(Some(Self { path, simulation, source, leniency, rows, sensors, ends }))
    }

    /// Whether a column of the motion is taken from this table.
    pub(super) fn has(&self, column: &str) -> bool {
        self.rows.case.motion.columns().any(|it| it == column)
    }

    /// Puts the predictions, and the motion that comes with them, beside the readings of `recording`, row by row.
    ///
    /// # Errors
    /// Times that do not reach over the recording, a clock that no likeness tells.
    pub(super) fn put_beside(
        mut self,
        recording: &mut Recording,
        case: &Path,
        lines: &Lines,
    ) -> Result<(), Error> {
        recording.warnings.append(&mut self.rows.warnings);
        let at_s: Vec<f64> = match self.simulation.clock {
            Clock::Same => recording.time_s.clone(),
            Clock::Unknown => {
                let shift = self.shift(recording).ok_or_else(|| {
                    let message = "found no offset at which the simulation looks like the recording; expected \
                                   \"same\", with times of one clock in both tables";
                    Error::one(case, Problem::new(lines.get("simulation.clock"), "simulation.clock", message))
                })?;
                recording.warnings.push(format!(
                    "{}: {}: {shift}, by the likeness of both",
                    self.path.display(),
                    self.source.time_name()
                ));
                recording.time_s.iter().map(|&time_s| shift.apply(time_s)).collect()
            }
        };
        self.reaches_over(recording, &at_s)?;
        for (series, &sensor) in self.rows.sensors.iter().zip(&self.sensors) {
            if let Some(beside) = recording.sensors.get_mut(sensor) {
                beside.predicted = Some(interpolated(&self.rows.time_s, &series.values, &at_s));
            }
        }
        let of_motion = |columns: &Option<[Vec<f64>; 3]>| {
            Some(columns.as_ref()?.each_ref().map(|values| interpolated(&self.rows.time_s, values, &at_s)))
        };
        let MotionSeries { rate, specific_force, velocity_ned, attitude_rad } = &self.rows.motion;
        let motion = &mut recording.motion;
        for (columns, simulated) in [
            (&mut motion.rate, of_motion(rate)),
            (&mut motion.specific_force, of_motion(specific_force)),
            (&mut motion.velocity_ned, of_motion(velocity_ned)),
            (&mut motion.attitude_rad, of_motion(attitude_rad)),
        ] {
            if simulated.is_some() {
                *columns = simulated;
            }
        }
        Ok(())
    }

    /// What its clock has to do with the recording's, by the likeness of what both say.
    fn shift(&self, recording: &Recording) -> Option<Shift> {
        let pairs: Vec<Pair<'_>> = (self.rows.sensors.iter().zip(&self.sensors))
            .filter_map(|(series, &sensor)| {
                Some(Pair { recorded: &recording.sensors.get(sensor)?.values, simulated: &series.values })
            })
            .collect();
        align::shift(&recording.time_s, &self.rows.time_s, &pairs)
    }

    /// An error where more than a few rows of the recording, which are at the simulator's times `at_s`, are beyond its ends and the case does not
    /// say that they may be; a warning where there are any.
    fn reaches_over(&self, recording: &mut Recording, at_s: &[f64]) -> Result<(), Error> {
        let time_s = &self.rows.time_s;
        let (Some(&first_s), Some(&last_s)) = (time_s.first(), time_s.last()) else { return Ok(()) };
        let tolerance_s = 1e-6 * recording.step_s;
        let before = at_s.iter().filter(|&&at| at < first_s - tolerance_s).count();
        let after = at_s.iter().filter(|&&at| at > last_s + tolerance_s).count();
        if before + after == 0 {
            return Ok(());
        }
        let [begins_s, ends_s] = [at_s.first(), at_s.last()].map(|at| at.copied().unwrap_or_default());
        let (line, what) = if after >= before {
            (
                self.ends[1],
                format!("found the last time {last_s} s, where the recording goes on to {ends_s} s"),
            )
        } else {
            (
                self.ends[0],
                format!("found the first time {first_s} s, where the recording begins at {begins_s} s"),
            )
        };
        let line = line.map(|line| line as usize);
        let left_out = before + after;
        let may = self.simulation.covers == Covers::Part || self.leniency.is_lenient();
        let few = (left_out as f64) <= FEW_ROWS * at_s.len() as f64;
        if left_out < at_s.len() && (may || few) {
            let place = line.map(|line| format!(":{line}")).unwrap_or_default();
            recording.warnings.push(format!(
                "{}{place}: {}: {what}: {left_out} of {} rows have no prediction",
                self.path.display(),
                self.source.time_name(),
                at_s.len()
            ));
            return Ok(());
        }
        let message = format!(
            "{what}; expected a simulation of the whole recording: state simulation.covers = \"part\" to leave the \
             rest out, or simulation.clock = \"unknown\" if its clock is another"
        );
        Err(Error::one(&self.path, Problem::new(line, self.source.time_name(), message)))
    }
}

/// The case of the simulator's table alone, whose sensors are the predictions.
fn as_recording(file: &CaseFile, source: &Source, sensors: &[usize], table: &dyn TableReader) -> CaseFile {
    let mut own = file.clone();
    own.warnings = Vec::new();
    own.case.recording = source.clone();
    own.case.simulation = None;
    own.case.calibration = None;
    own.case.auxiliaries = Vec::new();
    own.case.effects = Vec::new();
    own.case.sensors = (sensors.iter())
        .map(|&place| {
            let mut sensor = file.case.sensors[place].clone();
            sensor.column = sensor.predicted.take().unwrap_or_default();
            sensor.scale = None;
            sensor.unit = sensor.predicted_unit.take().unwrap_or(sensor.unit);
            sensor.nominal = Nominal::default();
            sensor
        })
        .collect();
    let there = |columns: &Option<[String; 3]>| {
        columns.clone().filter(|columns| columns.iter().all(|column| table.index(column).is_ok()))
    };
    let motion = &file.case.motion;
    own.case.motion = Motion {
        kind: MotionKind::Unknown,
        attitude_deg: None,
        rate: there(&motion.rate),
        rate_unit: motion.rate_unit,
        specific_force: there(&motion.specific_force),
        specific_force_unit: motion.specific_force_unit,
        velocity_ned: there(&motion.velocity_ned),
        velocity_at_m: None,
        attitude_rad: there(&motion.attitude_rad),
        attitude: (motion.attitude.clone())
            .filter(|attitude| attitude.columns.iter().all(|column| table.index(column).is_ok())),
    };
    own
}

/// The error of the simulator's table alone as one of the fields that the case has for it.
fn in_case(file: &CaseFile, sensors: &[usize], error: Error) -> Error {
    let renamed = |mut problem: Problem| {
        problem.field = if problem.field == "recording.time" {
            "simulation.time".to_owned()
        } else {
            let column = |place: &usize| format!("sensor[{place}].column") == problem.field;
            match (0..sensors.len()).find(column) {
                Some(place) => format!("sensor[{}].predicted", sensors[place]),
                None => problem.field,
            }
        };
        problem.line = file.lines.get(&problem.field);
        problem
    };
    Error::new(error.file, error.problems.into_iter().map(renamed).collect())
}

/// Whether times never go back; two rows of one time are before and after a step.
fn goes_on(time_s: &[f64], lines: &[u64]) -> Result<(), (Option<usize>, String)> {
    let line = |row: usize| lines.get(row).map(|&line| line as usize);
    if let Some(row) = time_s.iter().position(|time| !time.is_finite()) {
        return Err((line(row), format!("row {}: found no time; expected seconds", row + 1)));
    }
    if let Some(row) = time_s.windows(2).position(|pair| pair[1] < pair[0]) {
        let (before, after) = (time_s[row], time_s[row + 1]);
        let message = format!(
            "row {}: found time {after} after {before}; expected a simulator's clock, which does not go back",
            row + 2
        );
        return Err((line(row + 1), message));
    }
    if time_s.len() < 2 || time_s.first() == time_s.last() {
        let message = format!("found {} rows of one time; expected a simulation over time", time_s.len());
        return Err((line(0), message));
    }
    Ok(())
}

/// The mean step, s.
fn step_of(time_s: &[f64]) -> f64 {
    let span = time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
    span / time_s.len().saturating_sub(1).max(1) as f64
}
