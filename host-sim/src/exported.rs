//! What was found, as a model for a simulation in files.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_explain::export::model::{Model, c, python, rust};
use schuler_recording::{Error, Problem};

use crate::output;

/// In what a model is written.
#[derive(Clone, Copy)]
enum Form {
    Json,
    Python,
    C,
    Rust,
}

impl Form {
    /// The form that the ending of a file says.
    fn of(path: &Path) -> Result<Self, Error> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("json") => Ok(Self::Json),
            Some("py") => Ok(Self::Python),
            Some("c") => Ok(Self::C),
            Some("rs") => Ok(Self::Rust),
            found => {
                let found = found.map_or_else(|| "no ending".to_owned(), |it| format!("the ending .{it}"));
                let problem = format!("{found} for a model; expected .json, .py, .c or .rs");
                Err(Error::one(path, Problem::of_file(problem)))
            }
        }
    }
}

/// Makes sure that models can be written to all of these files.
///
/// # Errors
/// An ending that is none of a model's, a file that cannot be written.
pub fn check(paths: &[PathBuf]) -> Result<(), Error> {
    paths.iter().try_for_each(|path| {
        Form::of(path)?;
        output::check(path)?;
        output::check(&inputs_beside(path))
    })
}

/// Writes a model to files, with its inputs beside them; the files that were written.
///
/// # Errors
/// As [`check`].
pub fn write(model: &Model, paths: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut written: Vec<PathBuf> = Vec::new();
    for path in paths {
        let text = match Form::of(path)? {
            Form::Json => json(model, path)?,
            Form::Python => python::source(model),
            Form::C => c::source(model),
            Form::Rust => rust::source(model),
        };
        output::write(path, text.as_bytes())?;
        written.push(path.clone());
        let inputs = inputs_beside(path);
        if !written.contains(&inputs) {
            let columns: Vec<(&str, &[f64])> =
                model.inputs.iter().map(|input| (input.name.as_str(), &*input.values)).collect();
            output::write_table(&inputs, &columns)?;
            written.push(inputs);
        }
    }
    Ok(written)
}

fn json(model: &Model, path: &Path) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(model);
    let text = text.map_err(|error| Error::one(path, Problem::of_file(error.to_string())))?;
    Ok(text + "\n")
}

/// The table of inputs beside a model.
fn inputs_beside(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push("_inputs.csv");
    path.with_file_name(name)
}

/// What the user of a model should be told.
pub(crate) fn words(cautions: &[String]) -> String {
    let mut text = String::new();
    if !cautions.is_empty() {
        text.push_str("\nIn the model:\n");
    }
    for caution in cautions {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "  {caution}.");
    }
    text
}
