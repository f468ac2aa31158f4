//! Where the columns of a case stand in its table, and what becomes of them.
use super::grid::Gap;
use super::{AuxiliarySeries, FormulaColumn, MotionSeries, Quality, Recording, SensorSeries};
use crate::case::{Auxiliary, Case, CaseFile, Quantity};
use crate::error::{Error, Problem};
use crate::formula::check::Scope;
use crate::motion::roll_pitch_yaw;
use crate::table::{Chunks, Columns, TableReader};
use crate::unit::{AuxConversion, Unit};

/// Place of the time: of a log it decides what the rows are.
pub(super) const TIME: usize = 0;

/// The columns that a case asks of its table. A place is an index into the columns asked for, of which the first is the time, or,
/// where there is none, the number of the row.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    /// Index in the table of each column asked for; the number of the row is none of the table.
    indices: Vec<usize>,
    /// Whether the rows are counted, as there is no column of time.
    counted: bool,
    /// What warnings call each column.
    names: Vec<String>,
    sensors: Vec<usize>,
    /// What a simulator predicts of each sensor, where that is in this table.
    predicted: Vec<Option<usize>>,
    auxiliaries: Vec<(Auxiliary, usize)>,
    rate: Option<[usize; 3]>,
    specific_force: Option<[usize; 3]>,
    velocity_ned: Option<[usize; 3]>,
    attitude_rad: Option<[usize; 3]>,
    /// Of an attitude in another form.
    attitude: Option<Vec<usize>>,
    table_angle: Option<usize>,
    /// Columns in formulas, each with the factor and the offset that make its numbers values in its unit.
    in_formulas: Vec<(String, usize, [f64; 2])>,
    /// What the user is told of formulas.
    pub(super) notes: Vec<String>,
}

/// The rows of a recording.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    pub(super) step_s: f64,
    pub(super) time_s: Vec<f64>,
    pub(super) inserted: Vec<bool>,
    pub(super) gaps: Vec<Gap>,
}

impl Layout {
    /// Looks for the columns of a case in its table, but for what comes from the simulator's own table: predictions, and the motion in columns
    /// of which `simulated` says that they are there.
    ///
    /// # Errors
    /// Those that it lacks.
    pub(super) fn new(
        file: &CaseFile,
        table: &dyn TableReader,
        simulated: impl Fn(&str) -> bool,
    ) -> Result<Self, Error> {
        let mut wanted = Wanted {
            file,
            table,
            indices: Vec::new(),
            names: Vec::new(),
            problems: Vec::new(),
            notes: Vec::new(),
        };
        let case = &file.case;
        match &case.recording.time {
            Some(time) => _ = wanted.column(time, "recording.time"),
            None => wanted.names.push(case.recording.time_name().to_owned()),
        }
        let sensors = (case.sensors.iter().enumerate())
            .map(|(index, it)| wanted.column(&it.column, &format!("sensor[{index}].column")))
            .collect();
        let in_table = case.simulation.as_ref().is_none_or(|simulation| simulation.table.is_none());
        let predicted = (case.sensors.iter().enumerate())
            .map(|(index, it)| {
                let column = it.predicted.as_ref().filter(|_| in_table)?;
                Some(wanted.column(column, &format!("sensor[{index}].predicted")))
            })
            .collect();
        let auxiliaries = (all_auxiliaries(case).into_iter())
            .map(|(it, path)| {
                let place = wanted.column(&it.column, &path);
                (it, place)
            })
            .collect();
        let mut triple = |columns: &Option<[String; 3]>, key: &str| {
            let [x, y, z] =
                columns.as_ref().filter(|columns| !columns.iter().all(|column| simulated(column)))?;
            let places = [(x, 0), (y, 1), (z, 2)];
            Some(places.map(|(name, axis)| wanted.column(name, &format!("motion.{key}[{axis}]"))))
        };
        let motion = &case.motion;
        let rate = triple(&motion.rate, "rate");
        let specific_force = triple(&motion.specific_force, "specific_force");
        let velocity_ned = triple(&motion.velocity_ned, "velocity_ned");
        let attitude_rad = triple(&motion.attitude_rad, "attitude_rad");
        let attitude = (motion.attitude.as_ref())
            .filter(|attitude| !attitude.columns.iter().all(|column| simulated(column)))
            .map(|attitude| {
                let place = |(index, name): (usize, &String)| {
                    wanted.column(name, &format!("motion.attitude.columns[{index}]"))
                };
                attitude.columns.iter().enumerate().map(place).collect()
            });
        let table_angle = case.table().map(|it| wanted.column(&it.column, "calibration.table.column"));
        let in_formulas = wanted.in_formulas();
        let Wanted { indices, names, problems, notes, .. } = wanted;
        if !problems.is_empty() {
            return Err(Error::new(&file.path, problems));
        }
        Ok(Self {
            indices,
            counted: case.recording.time.is_none(),
            names,
            sensors,
            predicted,
            auxiliaries,
            rate,
            specific_force,
            velocity_ned,
            attitude_rad,
            attitude,
            table_angle,
            in_formulas,
            notes,
        })
    }

    /// The rows of these columns in a table.
    ///
    /// # Errors
    /// As [`TableReader::chunks`].
    pub(super) fn chunks(&self, table: Box<dyn TableReader>) -> Result<Chunks, Error> {
        if self.counted { table.numbered_chunks(&self.indices) } else { table.chunks(&self.indices) }
    }

    /// Number of the columns, the time among them.
    pub(super) fn width(&self) -> usize {
        self.names.len()
    }

    /// Place of the column of a sensor.
    pub(super) fn sensor(&self, index: usize) -> Option<usize> {
        self.sensors.get(index).copied()
    }

    /// How complete each column is, by place, before rows are put in.
    pub(super) fn quality(&self, columns: &Columns) -> Vec<Quality> {
        let of = |place: usize| {
            let values = columns.values.get(place).map_or(&[][..], Vec::as_slice);
            let missing = values.iter().filter(|value| value.is_nan()).count();
            let infinite = columns.infinite.get(place).copied().unwrap_or_default();
            Quality { present: values.len() - missing, missing, infinite, in_gaps: 0 }
        };
        (0..self.width()).map(of).collect()
    }

    /// What the user is told of infinite values, given their number in each column.
    pub(super) fn infinite_warnings<'l>(
        &'l self,
        file: &CaseFile,
        infinite: &'l [usize],
    ) -> impl Iterator<Item = String> + use<'l> {
        let table = file.table_path();
        (self.names.iter().zip(infinite).skip(TIME + 1)).filter(|&(_, &infinite)| infinite > 0).map(
            move |(name, infinite)| {
                format!("{}: {name}: {infinite} infinite values are missing", table.display())
            },
        )
    }

    /// The recording of these rows. `values` gives the column at a place as it was read, NaN in the rows put in.
    pub(super) fn recording(
        &self,
        case: Case,
        rows: Rows,
        quality: &[Quality],
        warnings: Vec<String>,
        mut values: impl FnMut(usize) -> Vec<f64>,
    ) -> Recording {
        let quality = |place: usize| quality.get(place).copied().unwrap_or_default();
        let sensors = (case.sensors.iter().zip(&self.sensors).zip(&self.predicted))
            .map(|((sensor, &place), predicted)| SensorSeries {
                sensor: sensor.in_si(),
                written_unit: sensor.unit,
                values: scaled(values(place), sensor.scale.unwrap_or(1.0) * sensor.unit.in_si()),
                predicted: predicted
                    .map(|place| scaled(values(place), sensor.predicted_unit.unwrap_or(sensor.unit).in_si())),
                quality: quality(place),
            })
            .collect();
        let auxiliaries = (self.auxiliaries.iter())
            .map(|(auxiliary, place)| {
                let mut values = values(*place);
                if auxiliary.scale.is_some() || auxiliary.offset.is_some() {
                    let (scale, offset) = (auxiliary.scale.unwrap_or(1.0), auxiliary.offset.unwrap_or(0.0));
                    for value in &mut values {
                        *value = scale * *value + offset;
                    }
                }
                let conversion = AuxConversion::of(&auxiliary.unit);
                if !conversion.is_identity() {
                    for value in &mut values {
                        *value = conversion.apply(*value);
                    }
                }
                let auxiliary = Auxiliary { unit: conversion.unit, ..auxiliary.clone() };
                AuxiliarySeries { auxiliary, values, quality: quality(*place) }
            })
            .collect();
        let in_si = |unit: Option<Unit>| unit.map_or(1.0, Unit::in_si);
        let mut triple = |places: Option<[usize; 3]>, factor: f64| {
            places.map(|places| places.map(|place| scaled(values(place), factor)))
        };
        let mut motion = MotionSeries {
            rate: triple(self.rate, in_si(case.motion.rate_unit)),
            specific_force: triple(self.specific_force, in_si(case.motion.specific_force_unit)),
            velocity_ned: triple(self.velocity_ned, 1.0),
            attitude_rad: triple(self.attitude_rad, 1.0),
        };
        if let (Some(form), Some(places)) = (&case.motion.attitude, &self.attitude) {
            let columns: Vec<Vec<f64>> = places.iter().map(|&place| values(place)).collect();
            motion.attitude_rad = Some(roll_pitch_yaw(form, &columns));
        }
        let angle_unit = case.table().map_or(1.0, |it| it.unit.in_si());
        let table_angle = self.table_angle.map(|place| scaled(values(place), angle_unit));
        let in_formulas = (self.in_formulas.iter())
            .map(|(column, place, [factor, offset])| FormulaColumn {
                column: column.clone(),
                values: values(*place).into_iter().map(|value| factor * value + offset).collect(),
            })
            .collect();
        Recording {
            case,
            step_s: rows.step_s,
            time_s: rows.time_s,
            inserted: rows.inserted,
            gaps: rows.gaps,
            sensors,
            auxiliaries,
            motion,
            table_angle,
            in_formulas,
            warnings,
        }
    }
}

/// What the user is told of the case itself, and of what it lets assume of the table.
pub(super) fn file_warnings(file: &CaseFile) -> Vec<String> {
    let of_case = file.warnings.iter().map(|warning| format!("{}: {warning}", file.path.display()));
    let of_table = file.case.recording.assumption();
    of_case.chain(of_table.map(|said| format!("{} {said}", file.table_path().display()))).collect()
}

/// What the user is told of the times.
pub(super) fn time_note(file: &CaseFile, note: Option<String>) -> Option<String> {
    note.map(|note| format!("{}: {note}", file.table_path().display()))
}

/// A problem of the times is one of the table, or of the step that the case gives.
pub(super) fn time_error(file: &CaseFile, mut problem: Problem) -> Error {
    if problem.line.is_some() || problem.field == file.case.recording.time_name() {
        return Error::one(file.table_path(), problem);
    }
    "recording.step_s".clone_into(&mut problem.field);
    problem.line = file.lines.get(&problem.field);
    Error::one(&file.path, problem)
}

/// Whether the times that the case states for switching on are those of a table with these times.
///
/// # Errors
/// The first that is not.
pub(super) fn switched_on_within(file: &CaseFile, time_s: &[f64]) -> Result<(), Error> {
    let stated = file.case.recording.switched_on_s.as_deref().unwrap_or_default();
    let (Some(&first), Some(&last)) = (time_s.first(), time_s.last()) else { return Ok(()) };
    let Some((index, stated_s)) =
        (stated.iter().enumerate()).find(|(_, time)| !(first..=last).contains(*time))
    else {
        return Ok(());
    };
    let message = format!("found {stated_s}; expected a time of the table, {first} to {last} s");
    let path = "recording.switched_on_s";
    let line = file.lines.get(path);
    Err(Error::one(&file.path, Problem::new(line, format!("{path}[{index}]"), message)))
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
                scale: None,
                offset: None,
                near: Some(sensor.id.clone()),
                position_m: None,
            };
            all.push((auxiliary, format!("sensor[{index}].nominal.temperature_bias.column")));
        }
    }
    all
}

/// Factor and offset that make the numbers of a column values in the unit that the case states for it.
fn in_unit(case: &Case, column: &str) -> [f64; 2] {
    if let Some(sensor) = case.sensors.iter().find(|sensor| sensor.column == column) {
        return [sensor.scale.unwrap_or(1.0), 0.0];
    }
    let auxiliary = case.auxiliaries.iter().find(|auxiliary| auxiliary.column == column);
    auxiliary.map_or([1.0, 0.0], |it| [it.scale.unwrap_or(1.0), it.offset.unwrap_or(0.0)])
}

/// Columns that are looked for.
struct Wanted<'f> {
    file: &'f CaseFile,
    table: &'f dyn TableReader,
    indices: Vec<usize>,
    names: Vec<String>,
    problems: Vec<Problem>,
    notes: Vec<String>,
}

impl Wanted<'_> {
    /// Asks for the columns in the formulas of effects, whose names it checks.
    fn in_formulas(&mut self) -> Vec<(String, usize, [f64; 2])> {
        let case = &self.file.case;
        for (index, effect) in case.effects.iter().enumerate() {
            let path = format!("effect[{index}].formula");
            let free: Vec<&str> = effect.free.keys().map(String::as_str).collect();
            let scope = Scope { columns: self.table.names(), free: &free };
            if let Some(name) = free.iter().find(|name| self.table.index(name).is_ok()) {
                let path = format!("effect[{index}].free.{name}");
                let message = "found the name of a column of the table; expected one of its own".to_owned();
                self.problems.push(Problem::new(self.file.lines.get(&path), path, message));
            } else if let Err(mistake) = effect.formula.amplitudes(&scope) {
                self.problems.push(Problem::new(self.file.lines.get(&path), path, mistake.to_string()));
            } else if let Some((name, column)) = effect.formula.resembling(&scope) {
                let case = self.file.path.display();
                self.notes.push(format!(
                    "{case}: {path}: {name} is no column and taken for an amplitude; a column is called {column}"
                ));
            }
        }
        let names = case.names_in_formulas().into_iter().filter(|name| self.table.index(name).is_ok());
        let names: Vec<&str> = names.collect();
        names
            .into_iter()
            .map(|name| (name.to_owned(), self.column(name, name), in_unit(case, name)))
            .collect()
    }

    /// Asks for the column `name`, which stands at `path` in the case; returns its place.
    fn column(&mut self, name: &str, path: &str) -> usize {
        match self.table.index(name) {
            Ok(index) => {
                self.indices.push(index);
                self.names.push(name.to_owned());
            }
            Err(message) => self.problems.push(Problem::new(self.file.lines.get(path), path, message)),
        }
        self.names.len().saturating_sub(1)
    }
}
