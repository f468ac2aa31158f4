//! The answer: what differs, which physics was left out, how large it is, how sure that is, and what it gains.
//!
//! [`Explanation`] serialises to `schuler-explanation/2`.
mod bound;
mod consequence;

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

use crate::catalogue::{Effect, IN_COMMON, named};
pub use bound::{At, Bound};
pub use consequence::{Impact, NoiseNumbers, NoiseOfSensor};

/// What the format's key `format` says.
pub const FORMAT: &str = "schuler-explanation/2";

/// Why a recording does not look like its simulation.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// [`FORMAT`].
    pub format: &'static str,
    /// What came of it.
    pub verdict: Verdict,
    /// The findings, the one with the most evidence first; [what is no physics](Finding::is_no_physics) stands after what is.
    pub findings: Vec<Finding>,
    /// How well the record is described before and after, where it was fitted and where it was held out.
    pub fit: Fit,
    /// Where record and simulation differ, before anything is named.
    pub located: Vec<Located>,
    /// What is left where the catalogue does not suffice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remainder: Option<Remainder>,
    /// Share of the mismatch that the findings explain together: of what whitened residuals have more of than noise has. Absent where there
    /// is hardly a mismatch.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explained_share: Option<f64>,
    /// What the findings of the sensor with the largest error do to a navigation solution; absent where they are of no inertial sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impact: Option<Impact>,
    /// The noise of every sensor.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub noise: Vec<NoiseOfSensor>,
    /// What could still hide: of each effect of the mean and each sensor the largest that would not have been found; empty where
    /// [`Config::certify`](crate::config::Config::certify) says not to compute it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub certificate: Vec<Bound>,
    /// What the user should be told.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The findings explain the mismatch.
    Explained,
    /// They explain a part of it; the rest is described in [`Explanation::remainder`].
    PartlyExplained,
    /// Record and simulation agree.
    NoMismatch,
    /// They differ, and nothing in the catalogue fits.
    Unexplained,
}

/// An effect that was left out.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Sensor or group; of sensors that have it in common without being a group their names.
    pub sensor: String,
    /// All sensors that have it in common; empty where it is of one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<String>,
    /// Identifier of the effect.
    pub effect: String,
    /// Probability that it or another of its class is there.
    pub probability: f64,
    /// What it may be, itself first: every pair of a sensor and an effect that the data cannot tell from it.
    pub class: Vec<Member>,
    /// From when to when, s from the start of the recording.
    pub interval_s: [f64; 2],
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// How sure it is.
    pub evidence: Evidence,
    /// Share of the mismatch that it explains; absent where there is hardly one, and of readings that are set aside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub share: Option<f64>,
    /// What it does to a navigation solution; absent where it is of no inertial sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impact: Option<Impact>,
    /// One plain sentence.
    pub sentence: String,
}

impl Finding {
    /// Whether no physics was left out: isolated readings are set aside, or numbers of a noise that the case states are put right, and the data
    /// can tell that from what is no noise.
    pub fn is_no_physics(&self) -> bool {
        let is_noise = |member: &Member| named(&member.effect).is_some_and(Effect::is_noise);
        let are_stated = self.parameters.iter().all(|parameter| parameter.stated.is_some());
        let corrects_stated = !self.parameters.is_empty() && are_stated && self.class.iter().all(is_noise);
        corrects_stated || named(&self.effect).is_some_and(Effect::is_outliers)
    }

    /// What it is of, to stand before what is said of it: the sensor, or what several have in common.
    pub fn subject(&self) -> String {
        subject(&self.sensor, &self.sensors)
    }

    /// Whether it is an effect, or cannot be told from it, on whatever sensor.
    pub fn may_be(&self, effect: &str) -> bool {
        self.class.iter().any(|member| member.effect == effect)
    }

    /// What else it may be.
    pub fn rivals(&self) -> &[Member] {
        self.class.get(1..).unwrap_or_default()
    }
}

/// What a finding is of, to stand before what is said of it.
pub(crate) fn subject(sensor: &str, sensors: &[String]) -> String {
    match sensors {
        [others @ .., last] if !others.is_empty() && sensors.join(IN_COMMON) == sensor => {
            format!("what {} and {last} have in common", others.join(", "))
        }
        _ => sensor.to_owned(),
    }
}

/// A fitted number, or a word that says which of several (a column, an axis).
///
/// In the answer each has the keys `name`, `value`, `sigma` and `unit`: a word is a `value` without the last two, which are
/// null then.
#[derive(Clone, Debug, Default)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value in `unit`.
    pub value: Option<f64>,
    /// Standard deviation in `unit`.
    pub sigma: Option<f64>,
    /// Unit.
    pub unit: Option<String>,
    /// The word, where it is not a number.
    pub text: Option<String>,
    /// Whether the value lies within the catalogue's plausible magnitude; absent where that is not known.
    pub plausible: Option<bool>,
    /// What the case states in its place, in `unit`, where it is of a noise that the case states.
    pub stated: Option<f64>,
}

/// Standard deviations within which a value may be another.
const MAY_BE: f64 = 2.0;

/// Whether a value that is known within `sigma` may be of a magnitude in `range`; what may be zero always is.
pub(crate) fn is_plausible(value: f64, sigma: f64, [least, most]: [f64; 2]) -> bool {
    let magnitude = value.abs();
    let [low, high] = [magnitude - MAY_BE * sigma, magnitude + MAY_BE * sigma];
    low <= 0.0 || (low <= most && high >= least)
}

impl Serialize for Parameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let keys = 4 + usize::from(self.plausible.is_some()) + usize::from(self.stated.is_some());
        let mut written = serializer.serialize_struct("Parameter", keys)?;
        written.serialize_field("name", &self.name)?;
        match &self.text {
            Some(word) => written.serialize_field("value", word)?,
            None => written.serialize_field("value", &self.value)?,
        }
        written.serialize_field("sigma", &self.sigma)?;
        written.serialize_field("unit", &self.unit)?;
        if let Some(plausible) = self.plausible {
            written.serialize_field("plausible", &plausible)?;
        }
        if let Some(stated) = self.stated {
            written.serialize_field("stated", &stated)?;
        }
        written.end()
    }
}

/// How sure a finding is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Evidence {
    /// Logarithm of the odds that it or another of its class is there, nats.
    pub gain_nats: f64,
    /// Probability that none of them is there.
    pub p_value: f64,
}

/// What a finding may be.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Member {
    /// Sensor or group; of sensors that have it in common without being a group their names.
    pub sensor: String,
    /// Identifier of the effect.
    pub effect: String,
    /// Probability that it is this one, given that it is one of the class.
    pub probability: f64,
    /// The experiment that would tell it from the finding; empty of the finding itself.
    pub separated_by: String,
}

/// Goodness of fit before and after.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Fit {
    /// On the blocks that were fitted.
    pub train: BeforeAfter,
    /// On the blocks that were not.
    pub held_out: BeforeAfter,
}

/// Before and after the findings.
#[derive(Clone, Debug, Default, Serialize)]
pub struct BeforeAfter {
    /// Without the findings: what the user believes, and fitted where nothing is known.
    pub before: Goodness,
    /// With them.
    pub after: Goodness,
    /// The stretches that were judged, from the first row to the last, s from the start of the recording.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub intervals_s: Vec<[f64; 2]>,
    /// Number of samples over which the likelihood is averaged, those of all sensors.
    #[serde(skip_serializing_if = "is_zero")]
    pub samples: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// How well a description predicts.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Goodness {
    /// Negative log-likelihood per sample, nats.
    pub nll_per_sample: f64,
    /// RMS of the one-step prediction error over the standard deviation that was expected of the nominal model.
    pub rmse: f64,
    /// p-value of the Ljung–Box test on the standardised innovations.
    pub whiteness_p: f64,
    /// Mean of the normalised innovation squared.
    pub nis_mean: f64,
}

/// A place where record and simulation differ.
#[derive(Clone, Debug, Serialize)]
pub struct Located {
    /// Sensor or group.
    pub sensor: String,
    /// The test that says so.
    pub test: String,
    /// What it says, in words and units.
    pub what: String,
    /// Its p-value, corrected for the number of tests.
    pub p_value: f64,
    /// Interval, s from the start of the recording, where it is local in time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interval_s: Option<[f64; 2]>,
    /// Frequency band, Hz, where it is local in frequency.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
}

/// What remains where the catalogue does not suffice.
#[derive(Clone, Debug, Serialize)]
pub struct Remainder {
    /// Sensor.
    pub sensor: String,
    /// Description: band, dependence, shape.
    pub what: String,
    /// The recorded quantities on which a smooth term was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on: Option<String>,
    /// Gain of that term, nats.
    pub gain_nats: f64,
}

#[cfg(test)]
mod tests {
    use super::{Evidence, Finding, Member, Parameter, is_plausible, subject};

    fn number(value: f64, stated: Option<f64>) -> Parameter {
        Parameter {
            name: "sigma".to_owned(),
            value: Some(value),
            unit: Some("K".to_owned()),
            stated,
            ..Parameter::default()
        }
    }

    #[test]
    fn what_may_be_zero_or_in_the_range_is_plausible() {
        let range = [0.01, 1.0];
        for (value, sigma, expected) in [
            (0.0004, 0.0011, true),
            (-0.0004, 0.0001, false),
            (0.5, 0.01, true),
            (-0.5, 0.01, true),
            (3.0, 0.1, false),
            (-3.0, 2.0, true),
            (1.1, 0.06, true),
            (0.009, 0.001, true),
        ] {
            assert_eq!(is_plausible(value, sigma, range), expected, "{value} ± {sigma}");
        }
    }

    #[test]
    fn every_parameter_has_the_keys_of_the_format() {
        let axis = Parameter { name: "axis".to_owned(), text: Some("y".to_owned()), ..Parameter::default() };
        let written = |parameter: &Parameter| serde_json::to_string(parameter).unwrap();
        assert_eq!(written(&axis), r#"{"name":"axis","value":"y","sigma":null,"unit":null}"#);
        let (plain, stated) = (number(2.5, None), number(2.5, Some(2.0)));
        assert_eq!(written(&plain), r#"{"name":"sigma","value":2.5,"sigma":null,"unit":"K"}"#);
        assert_eq!(written(&stated), r#"{"name":"sigma","value":2.5,"sigma":null,"unit":"K","stated":2.0}"#);
    }

    #[test]
    fn what_several_sensors_have_in_common_is_said_so() {
        let three = ["ax", "ay", "az"].map(str::to_owned);
        assert_eq!(subject("ax, ay, az", &three), "what ax, ay and az have in common");
        assert_eq!(subject("block", &three), "block");
        assert_eq!(subject("ax", &[]), "ax");
    }

    #[test]
    fn spikes_and_stated_numbers_that_are_put_right_are_no_physics() {
        let is_no_physics_beside = |effect: &str, other: &str, parameters: Vec<Parameter>| {
            let member = |effect: &str| Member { effect: effect.to_owned(), ..Member::default() };
            let finding = Finding {
                sensor: "gyro_x".to_owned(),
                sensors: Vec::new(),
                effect: effect.to_owned(),
                probability: 1.0,
                class: vec![member(effect), member(other)],
                interval_s: [0.0, 1.0],
                parameters,
                evidence: Evidence { gain_nats: 20.0, p_value: 1e-6 },
                share: None,
                impact: None,
                sentence: String::new(),
            };
            finding.is_no_physics()
        };
        let is_no_physics = |effect, parameters| is_no_physics_beside(effect, "noise_white", parameters);
        let corrects = |parameters| is_no_physics("noise_markov", parameters);
        assert!(corrects(vec![number(1.1, Some(1.0)), number(3.0, Some(1.0))]));
        assert!(!is_no_physics_beside("noise_markov", "bias_drift_linear", vec![number(1.1, Some(1.0))]));
        assert!(!corrects(vec![number(1.1, Some(1.0)), number(1.0, None)]));
        assert!(!corrects(vec![]));
        assert!(is_no_physics("noise_outliers", vec![number(4.0, None)]));
    }
}
