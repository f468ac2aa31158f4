//! Which engine explains a case: the one that users have, or one that grows beside it until a
//! comparison says that it may take over.
use serde::{Deserialize, Serialize};

/// An engine of `schuler explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The engine of `schuler_explain::explain`.
    #[default]
    First,
    /// The engine of `schuler_explain::second`.
    Second,
}

impl Engine {
    /// Its name on the command line and in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::First => "first",
            Self::Second => "second",
        }
    }
}
