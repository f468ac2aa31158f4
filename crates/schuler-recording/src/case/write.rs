//! Writing a case file.
use serde::Serialize;

use super::{Case, FORMAT};

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
}
