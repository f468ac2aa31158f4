//! The answers `schuler-explanation/1` and `/2`, as far as they are scored. Keys that are not scored
//! are not looked at.
use serde::{Deserialize, Deserializer};

/// What the key `format` must say: names of a class by themselves, or with their sensors and
/// probabilities.
pub const FORMATS: [&str; 2] = ["schuler-explanation/1", "schuler-explanation/2"];

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
    /// What the data cannot tell from it.
    #[serde(default)]
    pub class: Vec<Member>,
    /// When it acts, s in the recording's time.
    #[serde(default)]
    pub interval_s: Option<[f64; 2]>,
    /// Parameters.
    #[serde(default)]
    pub parameters: Vec<FoundParameter>,
    /// How sure it is, where the answer says so in nats and as the probability of as much by
    /// chance.
    #[serde(default)]
    pub evidence: Evidence,
    /// How probable it is, where the answer says so.
    #[serde(default)]
    pub probability: Option<f64>,
}

/// A member of a class.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Member {
    /// An identifier, on the finding's sensor.
    Effect(String),
    /// A pair of its own.
    Pair {
        /// Sensor, group or part of the loop.
        sensor: String,
        /// Identifier.
        effect: String,
    },
}

/// How sure a finding is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
pub struct Evidence {
    /// Gain, nats.
    #[serde(default)]
    pub gain_nats: Option<f64>,
    /// Probability of as much by chance.
    #[serde(default)]
    pub p_value: Option<f64>,
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
        if !FORMATS.contains(&it.format.as_str()) {
            return Err(format!("found format \"{}\"; expected \"{}\"", it.format, FORMATS.join("\" or \"")));
        }
        Ok(it)
    }
}

impl Finding {
    /// Its sensor and identifier and those that it cannot be told from.
    pub fn pairs(&self) -> impl Iterator<Item = [&str; 2]> {
        let class = self.class.iter().map(|member| match member {
            Member::Effect(effect) => [self.sensor.as_str(), effect.as_str()],
            Member::Pair { sensor, effect } => [sensor.as_str(), effect.as_str()],
        });
        std::iter::once([self.sensor.as_str(), self.effect.as_str()]).chain(class)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_is_of_names_or_of_pairs() {
        let of = |format: &str, class: serde_json::Value| {
            let finding = serde_json::json!({ "sensor": "gyro", "effect": "bias_step", "class": class });
            let answer =
                serde_json::json!({ "format": format, "verdict": "explained", "findings": [finding] });
            Explanation::read(answer).map(|it| it.findings[0].pairs().map(|pair| pair.join(" ")).collect())
        };
        let names: Vec<String> = of(FORMATS[0], serde_json::json!(["bias_warmup"])).unwrap();
        assert_eq!(names, ["gyro bias_step", "gyro bias_warmup"]);
        let pair =
            serde_json::json!([{ "sensor": "accelerometer", "effect": "bias_step", "probability": 0.3 }]);
        assert_eq!(of(FORMATS[1], pair).unwrap(), ["gyro bias_step", "accelerometer bias_step"]);
        assert!(of("schuler-explanation/3", serde_json::json!([])).is_err());
    }
}
