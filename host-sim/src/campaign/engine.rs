//! Which engine gave the answers of a record.
use serde::{Deserialize, Serialize};

/// An engine of `schuler explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The one that grew case by case, of which the records are left.
    First,
    /// One likelihood and one search.
    #[default]
    Second,
}

impl Engine {
    /// Its name in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::First => "first",
            Self::Second => "second",
        }
    }
}
