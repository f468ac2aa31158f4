//! Cases and recordings as Python has them: files, or dictionaries and arrays.
use std::path::{Path, PathBuf};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use schuler_recording::document::Lines;
use schuler_recording::{CaseFile, Error, Recording};
use toml::Value;

use crate::arrays::Arrays;
use crate::input::wrong;

/// What a case that is no file is called in messages.
const NAME: &str = "case";
/// What a table that is no file is called in messages.
const ARRAYS: &str = "<arrays>";
/// What a simulation's is.
const SIMULATION: &str = "sim";
/// Lists and dictionaries within each other; a case has five.
const DEEPEST: usize = 32;
/// Values of a case; one of ten thousand sensors has a fifth of them.
const MOST_VALUES: usize = 1_000_000;

/// A case, and where its table is.
pub(crate) struct Given {
    file: CaseFile,
    arrays: Option<Arrays>,
    simulation: Option<Arrays>,
}

impl Given {
    /// A case from the path of its file or a dictionary of what would stand there, and its recording from the path that
    /// the case names, from another path, or from a dictionary of arrays.
    ///
    /// # Errors
    /// `ValueError` by file, line, field and expectation; `TypeError` for something else than a path or a mapping.
    pub(crate) fn new(case: &Bound<'_, PyAny>, recording: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let arrays = match recording {
            Some(recording) if recording.cast::<PyMapping>().is_ok() => {
                Some(Arrays::new("recording", ARRAYS, recording)?)
            }
            _ => None,
        };
        let mut file = if case.cast::<PyMapping>().is_ok() {
            from_dictionary(case, arrays.is_some())?
        } else {
            let path = path_of(case, "case", "the path of a case file or a dictionary")?;
            case.py().detach(|| CaseFile::read(&path)).map_err(|error| unusable(&error))?
        };
        if arrays.is_some() {
            file.case.recording.path = ARRAYS.into();
        } else if let Some(recording) = recording {
            let path = path_of(recording, "recording", "a path or a dictionary of arrays")?;
            // Relative to the working directory, not to the case.
            file.case.recording.path = std::path::absolute(path)?;
        }
        Ok(Self { file, arrays, simulation: None })
    }

    /// With the table of its simulation as a dictionary of arrays.
    ///
    /// # Errors
    /// `ValueError` where an array is none, or of another length.
    pub(crate) fn beside(mut self, simulation: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        self.simulation = simulation.map(|it| Arrays::new("simulation", SIMULATION, it)).transpose()?;
        Ok(self)
    }

    /// By what name messages call the case.
    pub(crate) fn path(&self) -> PathBuf {
        self.file.path.clone()
    }

    /// Reads the table.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(crate) fn read(self) -> Result<Recording, Error> {
        let Self { file, arrays, simulation } = self;
        let table = arrays.map_or_else(|| file.open_table(), |arrays| Ok(Box::new(arrays) as _))?;
        match simulation {
            Some(simulation) => Recording::of_tables(file, table, Box::new(simulation)),
            None => Recording::of_table(file, table),
        }
    }
}

/// The exception for a file that cannot be used: the one line that the command prints.
pub(crate) fn unusable(error: &Error) -> PyErr {
    wrong(error.to_string())
}

fn path_of(value: &Bound<'_, PyAny>, name: &str, expected: &str) -> PyResult<PathBuf> {
    value.extract().map_err(|_| {
        let found = value.get_type().name().map_or_else(|_| String::new(), |name| name.to_string());
        PyTypeError::new_err(format!("{name}: found {found}; expected {expected}"))
    })
}

/// A case from a dictionary: written as TOML and read as any other, so that it is judged by the same rules. Lines say
/// nothing to someone who never saw that text, and are left out.
fn from_dictionary(case: &Bound<'_, PyAny>, has_arrays: bool) -> PyResult<CaseFile> {
    let mut value = toml_of(case, NAME)?;
    if let Some(recording) = value.get_mut("recording").and_then(Value::as_table_mut)
        && has_arrays
    {
        recording.entry("path").or_insert_with(|| ARRAYS.into());
    }
    let text = toml::to_string(&value).map_err(|error| wrong(format!("{NAME}: {error}")))?;
    let mut file = CaseFile::parse(Path::new(NAME), &text).map_err(|mut error| {
        for problem in &mut error.problems {
            problem.line = None;
        }
        unusable(&error)
    })?;
    for warning in &mut file.warnings {
        if let Some((_line, rest)) = warning.split_once(": ") {
            *warning = rest.to_owned();
        }
    }
    file.lines = Lines::default();
    file.case.effects.iter_mut().for_each(|effect| effect.lines = [None; 2]);
    Ok(file)
}

/// What would stand in a TOML file; numpy's arrays and numbers as lists and numbers, paths as strings.
///
/// # Errors
/// `ValueError` for what cannot stand there, and for what is nested deeper or larger than any case: a dictionary that
/// contains itself is endlessly deep, and one that holds a list twice that holds a list twice endlessly large.
fn toml_of(value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
    Conversion { depth: 0, left: MOST_VALUES }.value(value, path)
}

/// A case on its way to TOML.
struct Conversion {
    /// How many lists and dictionaries hold the value at hand.
    depth: usize,
    /// Values that may still follow.
    left: usize,
}

impl Conversion {
    fn value(&mut self, value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
        self.left = self.left.checked_sub(1).ok_or_else(|| {
            wrong(format!("{NAME}: found more than {MOST_VALUES} values; expected what a case holds"))
        })?;
        if value.is_instance_of::<PyBool>() {
            return Ok(Value::Boolean(value.extract()?));
        }
        if value.is_instance_of::<PyInt>() {
            let too_large =
                |_| wrong(format!("{path}: found an integer beyond 64 bits; expected a smaller one"));
            return Ok(Value::Integer(value.extract().map_err(too_large)?));
        }
        if value.is_instance_of::<PyFloat>() {
            return Ok(Value::Float(value.extract()?));
        }
        if value.is_instance_of::<PyString>() {
            return Ok(Value::String(value.extract()?));
        }
        if self.depth == DEEPEST {
            let found = format!("{path}: found a value nested {DEEPEST} levels deep");
            return Err(wrong(format!("{found}; expected what a case holds, and nothing that holds itself")));
        }
        self.depth += 1;
        let converted = self.container(value, path);
        self.depth -= 1;
        converted
    }

    fn container(&mut self, value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
        if let Ok(mapping) = value.cast::<PyMapping>() {
            let mut table = toml::Table::new();
            for item in mapping.items()? {
                let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
                let key: String = key.extract().map_err(|_| {
                    wrong(format!("{path}: found the key {key}; expected keys that are strings"))
                })?;
                let value = self.value(&value, &format!("{path}.{key}"))?;
                table.insert(key, value);
            }
            Ok(Value::Table(table))
        } else if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
            let items = value.try_iter()?.enumerate();
            let items = items.map(|(index, item)| self.value(&item?, &format!("{path}[{index}]")));
            Ok(Value::Array(items.collect::<PyResult<_>>()?))
        } else if value.hasattr("tolist")? {
            self.value(&value.call_method0("tolist")?, path)
        } else if let Ok(file) = value.extract::<PathBuf>() {
            Ok(Value::String(file.to_string_lossy().into_owned()))
        } else {
            let found = value.get_type().name()?;
            let expected = "expected a number, a string, true or false, a list or a dictionary";
            Err(wrong(format!("{path}: found {found}; {expected}")))
        }
    }
}
