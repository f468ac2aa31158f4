//! What others say is concealed in their cases, `independent-answer/1`: one file of JSON a case,
//! its parameters in SI units.
use std::collections::BTreeMap;
use std::path::Path;

use schuler_recording::{Error, Problem};
use serde::Deserialize;

use super::super::answer::{Answer, Effect, FORMAT, Pair, Parameter};
use super::super::effect::Family;
use super::super::explanation::Explanation;
use super::super::setting::Kind;
use super::super::unit_text::si_factor;

/// An answer of another maker.
#[derive(Clone, Debug, Deserialize)]
pub struct Theirs {
    /// Whether something is hidden, nothing, or what no catalogue has.
    kind: Concealed,
    family: String,
    step_s: f64,
    rows: usize,
    #[serde(default)]
    effects: Vec<TheirEffect>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Concealed {
    Hidden,
    Null,
    OutOfCatalogue,
}

#[derive(Clone, Debug, Deserialize)]
struct TheirEffect {
    sensor: String,
    effect: String,
    /// Other names of the same physics on this sensor.
    #[serde(default)]
    also: Vec<String>,
    /// And on others.
    #[serde(default)]
    also_at: Vec<[String; 2]>,
    #[serde(default)]
    onset_s: Option<f64>,
    gain_nats: f64,
    #[serde(default)]
    parameters: BTreeMap<String, f64>,
    /// A coefficient in a unit of a recorded quantity that has no unit of SI.
    #[serde(default)]
    per_unit: Option<PerUnit>,
    /// The sign of the coefficient has no meaning.
    #[serde(default)]
    unsigned: bool,
}

#[derive(Clone, Debug, Deserialize)]
struct PerUnit {
    coefficient: f64,
    unit: String,
}

impl Theirs {
    /// Reads the answer to a case.
    ///
    /// # Errors
    /// A file that cannot be read or is no such answer.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text =
            std::fs::read_to_string(path).map_err(|error| Error::io(path, "read the answer", &error))?;
        serde_json::from_str(&text)
            .map_err(|error| Error::one(path, Problem::of_file(format!("not an answer: {error}"))))
    }

    /// As an answer of a campaign; parameters in the units of the explanation, where that names the
    /// effect.
    pub fn answer(&self, explanation: Option<&Explanation>) -> Answer {
        let (family, name) = match self.kind {
            Concealed::Hidden => (Family::Additive, self.family.clone()),
            Concealed::Null => (Family::Nothing, "nothing".to_owned()),
            Concealed::OutOfCatalogue => (Family::Outside, "outside".to_owned()),
        };
        let effects: Vec<Effect> =
            self.effects.iter().map(|it| self.effect(it, family, explanation)).collect();
        Answer {
            format: FORMAT.to_owned(),
            seed: 0,
            index: 0,
            name,
            family,
            // Of their setting and family nothing is scored.
            setting: Kind::Bench,
            rows: self.rows,
            step_s: self.step_s,
            gain_nats: effects.iter().map(|it| it.gain_nats).sum(),
            effects,
            tolerated: vec![],
        }
    }

    fn effect(&self, it: &TheirEffect, family: Family, explanation: Option<&Explanation>) -> Effect {
        let own = it.also.iter().map(|name| Pair::new(&it.sensor, name));
        let other = it.also_at.iter().map(|[sensor, name]| Pair::new(sensor, name));
        let end_s = self.rows as f64 * self.step_s;
        Effect {
            sensor: it.sensor.clone(),
            effect: it.effect.clone(),
            family,
            same: own.chain(other).collect(),
            interval_s: it.onset_s.map(|onset_s| [onset_s, end_s]),
            oracle_onset_s: None,
            parameters: explanation.map(|it_said| it.parameters(it_said)).unwrap_or_default(),
            gain_nats: it.gain_nats,
            expected_gain_nats: it.gain_nats,
            form_error_nats: 0.0,
            correlation_time_s: 0.0,
        }
    }
}

impl TheirEffect {
    /// The true parameters that the finding of this effect has as well, in its units: theirs are in
    /// SI, whose names they do not say.
    fn parameters(&self, explanation: &Explanation) -> Vec<Parameter> {
        let mut findings = explanation.findings.iter();
        let Some(finding) = findings.find(|it| it.sensor == self.sensor && it.effect == self.effect) else {
            return vec![];
        };
        let in_their_unit = |told: &super::super::explanation::FoundParameter| {
            let coefficient = told.name == "coefficient";
            let per_unit = || {
                let it = self.per_unit.as_ref().filter(|_| coefficient)?;
                Some(it.coefficient / si_factor(&it.unit)?)
            };
            let si = self.parameters.get(&told.name).copied().or_else(per_unit)?;
            let mut value = si / si_factor(&told.unit)?;
            if self.unsigned && coefficient {
                value = value.abs().copysign(told.value?);
            }
            told.sigma?;
            Some(Parameter { name: told.name.clone(), value, unit: told.unit.clone() })
        };
        finding.parameters.iter().filter_map(in_their_unit).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn their_parameters_are_compared_in_the_units_of_the_explanation() {
        let theirs: Theirs = serde_json::from_value(json!({
            "format": "independent-answer/1", "kind": "hidden", "family": "at rest", "step_s": 1.0,
            "duration_s": 999.0, "rows": 1000, "units": { "gyro": "deg/h" },
            "effects": [{ "sensor": "gyro", "effect": "bias_step", "also": ["intermittent_jump"], "onset_s": 400.0,
                          "gain_nats": 30.0, "unsigned": true, "parameters": { "coefficient": 0.02 } }] }))
        .unwrap();
        let explanation = Explanation::read(json!({
            "format": "schuler-explanation/1", "verdict": "explained", "findings": [
                { "sensor": "gyro", "effect": "bias_step", "parameters": [
                    { "name": "coefficient", "value": -19.0, "sigma": 1.0, "unit": "mrad/s" }] }] }))
        .unwrap();
        let answer = theirs.answer(Some(&explanation));
        let parameter = &answer.effects[0].parameters[0];
        assert!((parameter.value + 20.0).abs() < 1e-9, "{parameter:?}");
        assert!(answer.effects[0].is("gyro", "intermittent_jump"));
        assert_eq!(answer.effects[0].interval_s, Some([400.0, 1000.0]));
    }
}
