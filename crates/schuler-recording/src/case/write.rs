//! Writing a case file.
use std::path::Path;

use serde::Serialize;

use super::{Case, FORMAT};
use crate::error::{Error, Problem};

#[derive(Serialize)]
struct Document<'c> {
    format: &'static str,
    #[serde(flatten)]
    case: &'c Case,
}

impl Case {
    /// The case as the text of a case file, which reads back to the same case.
    ///
    /// # Errors
    /// Never for a case that was read; a path that is not UTF-8 cannot be written.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&Document { format: FORMAT, case: self })
    }

    /// Writes the case to `path`.
    ///
    /// # Errors
    /// As [`Case::to_toml`], and when the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let text = self
            .to_toml()
            .map_err(|error| Error::one(path, Problem::of_file(format!("cannot write the case: {error}"))))?;
        std::fs::write(path, text).map_err(|error| Error::io(path, "write the case", &error))
    }
}
