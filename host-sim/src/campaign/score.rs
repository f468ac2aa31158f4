//! Scoring one case: what was found against what was concealed.
use serde::{Deserialize, Serialize};

use super::answer::{Answer, Effect, Parameter};
use super::effect::Family;
use super::explanation::{Explanation, Finding, FoundParameter};
use super::setting::Kind;
use super::unit_text;

/// Onsets may be off by this share of the recording.
const ONSET_SHARE: f64 = 0.02;
/// Or by so many correlation times.
const ONSET_CORRELATION_TIMES: f64 = 3.0;
/// A parameter of an effect whose formula leaves more than this over is not scored, nats.
const FORMULA_HOLDS_NATS: f64 = 2.0;
/// Held-out gain is scored where the oracle's is at least this, nats.
const HELD_OUT_NATS: f64 = 12.0;

/// The score of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaseScore {
    /// Number in the plan.
    pub index: usize,
    /// Seed.
    pub seed: u64,
    /// Group of the plan.
    pub name: String,
    /// Family.
    pub family: Family,
    /// Setting.
    pub setting: Kind,
    /// Rows.
    pub rows: usize,
    /// Sensors.
    pub sensors: usize,
    /// Time it took, s.
    pub time_s: f64,
    /// What went wrong instead of an answer.
    pub failure: Option<String>,
    /// Verdict.
    pub verdict: Option<super::explanation::Verdict>,
    /// The sensor of what is left.
    #[serde(default)]
    pub left: Option<String>,
    /// Every concealed effect.
    pub effects: Vec<EffectScore>,
    /// Findings that name nothing that was concealed.
    pub false_findings: Vec<[String; 2]>,
    /// All findings in their order: sensor, effect.
    pub findings: Vec<[String; 2]>,
    /// Gain on held-out data: found and the oracle's, nats.
    pub held_out_nats: Option<[f64; 2]>,
    /// Fingerprint of the answer, as it was sealed before.
    pub fingerprint: String,
}

impl CaseScore {
    /// The sensor of the first finding or, where there is none, of what is left.
    pub fn located(&self) -> Option<&str> {
        self.findings.first().map(|[sensor, _]| sensor.as_str()).or(self.left.as_deref())
    }
}

/// The score of one concealed effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectScore {
    /// Sensor.
    pub sensor: String,
    /// Identifier.
    pub effect: String,
    /// Family.
    pub family: Family,
    /// Oracle's gain, nats.
    pub gain_nats: f64,
    /// Average of it over the noise, nats.
    pub expected_gain_nats: f64,
    /// Whether any finding names it.
    pub found: bool,
    /// Whether one of the first findings, as many as there are effects, does.
    pub right: bool,
    /// Whether it is named only among those that cannot be told apart.
    pub in_class_only: bool,
    /// Its parameters.
    pub parameters: Vec<ParameterScore>,
    /// Error of the onset and what is allowed, s.
    pub onset_s: Option<[f64; 2]>,
    /// Error of the onset that the oracle finds, s.
    pub oracle_onset_s: Option<f64>,
}

/// The score of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterScore {
    /// Name.
    pub name: String,
    /// True value, in the answer's unit.
    pub truth: f64,
    /// Found value, in the same unit; none where it is missing or of another dimension.
    pub found: Option<f64>,
    /// Reported standard deviation, in the same unit.
    pub sigma: Option<f64>,
    /// Unit.
    pub unit: String,
}

impl ParameterScore {
    /// Error in reported standard deviations; infinite without one.
    pub fn deviations(&self) -> Option<f64> {
        let found = self.found?;
        Some(match self.sigma {
            Some(sigma) if sigma > 0.0 => (found - self.truth).abs() / sigma,
            _ => f64::INFINITY,
        })
    }
}

/// What is known of a case beside its answer.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances<'c> {
    /// Sensors of the case.
    pub sensors: usize,
    /// Time the explanation took, s.
    pub time_s: f64,
    /// Oracle's gain row by row, nats.
    pub gain: &'c [f64],
    /// Fingerprint of the answer.
    pub fingerprint: &'c str,
}

/// Scores an explanation, or the failure to give one.
pub fn score(
    answer: &Answer,
    explained: Result<&Explanation, String>,
    about: &Circumstances<'_>,
) -> CaseScore {
    let findings = explained.as_ref().map(|it| it.findings.as_slice()).unwrap_or_default();
    let mut taken = vec![None; findings.len()];
    let mut effects: Vec<EffectScore> = answer.effects.iter().map(missed).collect();
    // Findings in their order, each to the first effect that it names by itself, then by its class.
    for by_class in [false, true] {
        for (f, finding) in findings.iter().enumerate() {
            if taken[f].is_some() {
                continue;
            }
            let open = answer.effects.iter().enumerate().find(|(e, effect)| {
                !effects[*e].found
                    && if by_class { names_in_class(finding, effect) } else { names(finding, effect) }
            });
            if let Some((e, effect)) = open {
                taken[f] = Some(e);
                let it = &mut effects[e];
                it.found = true;
                it.right = f < answer.effects.len();
                it.in_class_only = by_class;
                // On the other of two sensors that are only compared the same effect has another coefficient.
                let named = finding.sensor == effect.sensor && finding.effect == effect.effect;
                if named && effect.form_error_nats <= FORMULA_HOLDS_NATS {
                    it.parameters =
                        effect.parameters.iter().map(|p| parameter(p, &finding.parameters)).collect();
                }
                it.onset_s = onset(answer, effect, finding);
            }
        }
    }
    let pair = |f: &Finding| [f.sensor.clone(), f.effect.clone()];
    let false_findings = findings
        .iter()
        .zip(&taken)
        .filter(|(finding, taken)| taken.is_none() && !tolerated(answer, finding))
        .map(|(finding, _)| pair(finding))
        .collect();
    CaseScore {
        index: answer.index,
        seed: answer.seed,
        name: answer.name.clone(),
        family: answer.family,
        setting: answer.setting,
        rows: answer.rows,
        sensors: about.sensors,
        time_s: about.time_s,
        verdict: explained.as_ref().ok().map(|it| it.verdict),
        left: explained.as_ref().ok().and_then(|it| it.remainder.as_ref()).map(|left| left.sensor.clone()),
        effects,
        false_findings,
        findings: findings.iter().map(pair).collect(),
        held_out_nats: explained.as_ref().ok().and_then(|it| held_out(answer, it, about)),
        failure: explained.err(),
        fingerprint: about.fingerprint.to_owned(),
    }
}

fn missed(effect: &Effect) -> EffectScore {
    EffectScore {
        sensor: effect.sensor.clone(),
        effect: effect.effect.clone(),
        family: effect.family,
        gain_nats: effect.gain_nats,
        expected_gain_nats: effect.expected_gain_nats,
        found: false,
        right: false,
        in_class_only: false,
        parameters: vec![],
        onset_s: None,
        oracle_onset_s: effect
            .interval_s
            .zip(effect.oracle_onset_s)
            .map(|([from, _], found)| (found - from).abs()),
    }
}

fn names(finding: &Finding, effect: &Effect) -> bool {
    effect.is(&finding.sensor, &finding.effect)
}

fn names_in_class(finding: &Finding, effect: &Effect) -> bool {
    finding.pairs().any(|[sensor, name]| effect.is(sensor, name))
}

fn tolerated(answer: &Answer, finding: &Finding) -> bool {
    answer.tolerated.iter().any(|pair| {
        finding.pairs().any(|[sensor, name]| {
            pair.sensor == sensor && (name == pair.effect || (pair.effect == "*" && sensor == finding.sensor))
        })
    })
}

fn parameter(truth: &Parameter, found: &[FoundParameter]) -> ParameterScore {
    let mut it = ParameterScore {
        name: truth.name.clone(),
        truth: truth.value,
        found: None,
        sigma: None,
        unit: truth.unit.clone(),
    };
    let Some(found) = found.iter().find(|p| p.name == truth.name) else { return it };
    let (Some(own), Some(theirs)) = (unit_text::parse(&truth.unit), unit_text::parse(&found.unit)) else {
        return it;
    };
    if own.powers == theirs.powers {
        let factor = theirs.factor / own.factor;
        it.found = found.value.filter(|v| v.is_finite()).map(|v| v * factor);
        it.sigma = found.sigma.filter(|v| v.is_finite()).map(|v| v * factor);
    }
    it
}

fn onset(answer: &Answer, effect: &Effect, finding: &Finding) -> Option<[f64; 2]> {
    let [from, _] = effect.interval_s?;
    let allowed = (ONSET_SHARE * answer.rows as f64 * answer.step_s)
        .max(ONSET_CORRELATION_TIMES * effect.correlation_time_s);
    // A finding without an interval is one over the whole record.
    let told = finding.interval_s.map_or(0.0, |interval| interval[0]);
    Some([(told - from).abs(), allowed])
}

fn held_out(answer: &Answer, explained: &Explanation, about: &Circumstances<'_>) -> Option<[f64; 2]> {
    let it = &explained.fit.held_out;
    let (before, after) = (it.before.nll_per_sample?, it.after.nll_per_sample?);
    if it.intervals_s.is_empty() || answer.effects.is_empty() {
        return None;
    }
    let inside = |k: usize| {
        let t = (k + 1) as f64 * answer.step_s;
        it.intervals_s.iter().any(|[from, to]| t >= *from && t <= *to)
    };
    let rows: Vec<f64> = (about.gain.iter().enumerate())
        .filter(|(k, gain)| gain.is_finite() && inside(*k))
        .map(|(_, gain)| *gain)
        .collect();
    let oracle: f64 = rows.iter().sum();
    let samples = it.samples.unwrap_or((rows.len() * about.sensors) as f64);
    (oracle >= HELD_OUT_NATS).then_some([(before - after) * samples, oracle])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::answer::{FORMAT, Pair};
    use serde_json::json;

    fn effect(sensor: &str, effect: &str) -> Effect {
        Effect {
            sensor: sensor.into(),
            effect: effect.into(),
            family: Family::Thermal,
            same: vec![],
            interval_s: None,
            oracle_onset_s: None,
            parameters: vec![Parameter {
                name: "coefficient".into(),
                value: 3.6,
                unit: "deg/h/(K/h)".into(),
            }],
            gain_nats: 50.0,
            expected_gain_nats: 48.0,
            form_error_nats: 0.0,
            correlation_time_s: 10.0,
        }
    }

    fn answer(effects: Vec<Effect>) -> Answer {
        Answer {
            format: FORMAT.into(),
            seed: 1,
            index: 0,
            name: "n".into(),
            family: Family::Thermal,
            setting: Kind::Bench,
            rows: 1000,
            step_s: 1.0,
            effects,
            tolerated: vec![Pair::new("gyro_x", "noise_white"), Pair::new("gyro_z", "*")],
            gain_nats: 50.0,
        }
    }

    fn scored(answer: &Answer, findings: &serde_json::Value) -> CaseScore {
        let value =
            json!({ "format": "schuler-explanation/1", "verdict": "explained", "findings": findings });
        let explanation = Explanation::read(value).unwrap();
        let gain = vec![0.05; 1000];
        score(
            answer,
            Ok(&explanation),
            &Circumstances { sensors: 1, time_s: 0.1, gain: &gain, fingerprint: "" },
        )
    }

    #[test]
    fn a_right_finding_is_right_with_its_parameter_in_another_unit() {
        let it = scored(
            &answer(vec![effect("gyro_x", "bias_temperature_rate")]),
            &json!([{ "sensor": "gyro_x", "effect": "bias_temperature_rate", "parameters": [
                { "name": "coefficient", "value": 219.96, "sigma": 3.6, "unit": "deg/h/(K/min)" } ] }]),
        );
        assert!(it.effects[0].right && !it.effects[0].in_class_only && it.false_findings.is_empty());
        let p = &it.effects[0].parameters[0];
        assert!((p.found.unwrap() - 3.666).abs() < 1e-9 && (p.deviations().unwrap() - 1.1).abs() < 1e-6);
    }

    #[test]
    fn the_class_counts_and_another_sensor_does_not() {
        let one = answer(vec![effect("gyro_x", "bias_temperature_rate")]);
        let finding = |sensor: &str| {
            json!([{ "sensor": sensor, "effect": "bias_temperature",
            "class": ["bias_temperature", "bias_temperature_rate"] }])
        };
        let it = scored(&one, &finding("gyro_x"));
        assert!(it.effects[0].right && it.effects[0].in_class_only && it.effects[0].parameters.is_empty());
        let it = scored(&one, &finding("gyro_y"));
        assert!(!it.effects[0].found);
        assert_eq!(it.false_findings, [["gyro_y".to_owned(), "bias_temperature".to_owned()]]);
    }

    #[test]
    fn what_is_physically_the_same_counts_on_its_sensor() {
        let mut e = effect("gyro", "bias_constant");
        e.same.push(Pair::new("accelerometer", "bias_drift_linear"));
        let it =
            scored(&answer(vec![e]), &json!([{ "sensor": "accelerometer", "effect": "bias_drift_linear" }]));
        assert!(it.effects[0].right && it.false_findings.is_empty());
    }

    #[test]
    fn a_group_is_a_sensor_of_its_own() {
        let one = answer(vec![effect("unit", "time_delay")]);
        let it = scored(&one, &json!([{ "sensor": "gyro_x", "effect": "time_delay" }]));
        assert!(!it.effects[0].found && it.false_findings.len() == 1);
        let it = scored(&one, &json!([{ "sensor": "unit", "effect": "time_delay" }]));
        assert!(it.effects[0].right);
    }

    #[test]
    fn a_true_finding_behind_a_false_one_is_found_but_not_right() {
        let one = answer(vec![effect("gyro_x", "bias_temperature_rate")]);
        let it = scored(
            &one,
            &json!([{ "sensor": "gyro_y", "effect": "bias_step" },
                    { "sensor": "gyro_x", "effect": "bias_temperature_rate" }]),
        );
        assert!(it.effects[0].found && !it.effects[0].right && it.false_findings.len() == 1);
    }

    #[test]
    fn what_is_tolerated_is_not_false_and_a_finding_twice_is() {
        let one = answer(vec![effect("gyro_x", "bias_step")]);
        let it = scored(
            &one,
            &json!([{ "sensor": "gyro_x", "effect": "bias_step" },
                    { "sensor": "gyro_x", "effect": "noise_white" },
                    { "sensor": "gyro_z", "effect": "anything" },
                    { "sensor": "gyro_x", "effect": "bias_step" }]),
        );
        assert_eq!(it.false_findings, [["gyro_x".to_owned(), "bias_step".to_owned()]]);
    }

    #[test]
    fn onsets_are_off_by_what_they_are_off() {
        let mut e = effect("gyro_x", "bias_step");
        e.interval_s = Some([400.0, 1000.0]);
        let one = answer(vec![e]);
        let it = scored(
            &one,
            &json!([{ "sensor": "gyro_x", "effect": "bias_step", "interval_s": [425.0, 1000.0] }]),
        );
        assert_eq!(it.effects[0].onset_s, Some([25.0, 30.0]));
        let it = scored(&one, &json!([{ "sensor": "gyro_x", "effect": "bias_step" }]));
        assert_eq!(it.effects[0].onset_s, Some([400.0, 30.0]));
    }

    #[test]
    fn a_parameter_of_another_dimension_or_without_deviation_is_no_hit() {
        let one = answer(vec![effect("gyro_x", "bias_temperature_rate")]);
        let found = |unit: &str, sigma: f64| {
            let it = scored(
                &one,
                &json!([{ "sensor": "gyro_x", "effect": "bias_temperature_rate", "parameters": [
                    { "name": "coefficient", "value": 3.6, "sigma": sigma, "unit": unit } ] }]),
            );
            it.effects[0].parameters[0].deviations()
        };
        assert_eq!(found("deg/h/K", 0.1), None);
        assert_eq!(found("deg/h/(K/h)", 0.0), Some(f64::INFINITY));
        assert_eq!(found("deg/h/(K/h)", 0.1), Some(0.0));
    }

    #[test]
    fn held_out_gain_is_summed_over_the_stretches_held_out() {
        let value = json!({ "format": "schuler-explanation/1", "verdict": "explained", "findings": [],
            "fit": { "held_out": { "before": { "nll_per_sample": 1.6 }, "after": { "nll_per_sample": 1.5525 },
                                   "intervals_s": [[601.0, 1000.0]], "samples": 400 } } });
        let explanation = Explanation::read(value).unwrap();
        let gain = vec![0.05; 1000];
        let about = Circumstances { sensors: 1, time_s: 0.1, gain: &gain, fingerprint: "" };
        let it = score(&answer(vec![effect("g", "e")]), Ok(&explanation), &about);
        let [found, oracle] = it.held_out_nats.unwrap();
        assert!((found - 19.0).abs() < 1e-9 && (oracle - 20.0).abs() < 1e-9);
    }

    #[test]
    fn an_explainer_that_fails_finds_nothing() {
        let about = Circumstances { sensors: 1, time_s: 0.1, gain: &[], fingerprint: "" };
        let it = score(&answer(vec![effect("g", "e")]), Err("broken".into()), &about);
        assert!(it.failure.is_some() && !it.effects[0].found);
        assert!(Explanation::read(json!({ "format": "x", "verdict": "explained", "findings": [] })).is_err());
    }
}
