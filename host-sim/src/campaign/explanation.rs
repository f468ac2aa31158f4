//! The answer `schuler-explanation/1`, as far as it is scored. Keys that are not scored are not looked at.
use serde::{Deserialize, Deserializer};

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-explanation/1";

/// An answer.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Explanation {
    /// Format.
    pub format: String,
    /// Verdict.
    pub verdict: Verdict,
    /// Findings, the most certain first.
    pub findings: Vec<Finding>,
    /// The fit.
    #[serde(default)]
    pub fit: Fit,
    /// What is left.
    #[serde(default)]
    pub remainder: Option<Remainder>,
}

/// What nothing that was found explains.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Remainder {
    /// Sensor.
    pub sensor: String,
}

/// Verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Everything is explained.
    Explained,
    /// Something is left.
    PartlyExplained,
    /// Nothing is to be explained.
    NoMismatch,
    /// Something is there that has no name.
    Unexplained,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Finding {
    /// Sensor, group or part of the loop.
    pub sensor: String,
    /// Identifier.
    pub effect: String,
    /// Identifiers that the data cannot tell from it.
    #[serde(default)]
    pub class: Vec<String>,
    /// When it acts, s in the recording's time.
    #[serde(default)]
    pub interval_s: Option<[f64; 2]>,
    /// Parameters.
    #[serde(default)]
    pub parameters: Vec<FoundParameter>,
}

/// A parameter that was found.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FoundParameter {
    /// Name.
    pub name: String,
    /// Value; none where it is null, or a word: of an axis, of a column.
    #[serde(default, deserialize_with = "number")]
    pub value: Option<f64>,
    /// Standard deviation.
    #[serde(default)]
    pub sigma: Option<f64>,
    /// Unit; empty where there is none.
    #[serde(default, deserialize_with = "or_empty")]
    pub unit: String,
}

fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    Ok(serde_json::Value::deserialize(deserializer)?.as_f64())
}

fn or_empty<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or_default())
}

/// The fit before and after.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Fit {
    /// On data that the fit has not seen.
    #[serde(default)]
    pub held_out: HeldOut,
}

/// Fit on data that was held out.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct HeldOut {
    /// Without the findings.
    #[serde(default)]
    pub before: Quality,
    /// With them.
    #[serde(default)]
    pub after: Quality,
    /// The stretches held out, s in the recording's time.
    #[serde(default)]
    pub intervals_s: Vec<[f64; 2]>,
    /// Number of samples over which the likelihood is averaged.
    #[serde(default)]
    pub samples: Option<f64>,
}

/// Quality of a fit.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Quality {
    /// Negative log-likelihood per sample, nats.
    #[serde(default)]
    pub nll_per_sample: Option<f64>,
}

impl Explanation {
    /// Reads an answer.
    ///
    /// # Errors
    /// What is wrong with it, in one line.
    pub fn read(value: serde_json::Value) -> Result<Self, String> {
        let it: Self =
            serde_json::from_value(value).map_err(|error| format!("not an explanation: {error}"))?;
        if it.format != FORMAT {
            return Err(format!("found format \"{}\"; expected \"{FORMAT}\"", it.format));
        }
        Ok(it)
    }
}

impl Finding {
    /// Its identifier and those that it cannot be told from.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.effect.as_str()).chain(self.class.iter().map(String::as_str))
    }
}
