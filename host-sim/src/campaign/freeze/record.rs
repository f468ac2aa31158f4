//! The file of a frozen run: JSON lines, a header and then a row a case, each number with as many
//! digits as it deserves.
use std::path::{Path, PathBuf};

use schuler_recording::{Error, Problem};
use serde::{Deserialize, Serialize, Serializer};

use super::super::answer::Answer;
use super::super::engine::Engine;
use super::super::explanation::{Explanation, Finding, Verdict};
use super::super::score::CaseScore;
use crate::output;

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-freeze/1";
/// Ending of a record's name.
pub const ENDING: &str = "jsonl";
/// Significant digits that are kept.
const DIGITS: usize = 5;

/// What was run, when, and on what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// [`FORMAT`].
    pub format: String,
    /// Name of the set of cases: cases of one name, set and seed are the same in every record.
    pub set: String,
    /// Engine.
    pub engine: Engine,
    /// Seed of the campaign, of cases of a plan.
    pub seed: Option<u64>,
    /// SHA-256 of the plan.
    pub plan_sha256: Option<String>,
    /// Day on which the run began, UTC.
    pub date: String,
    /// Commit of the program.
    pub commit: String,
    /// Processor and number of its cores.
    pub machine: String,
    /// Processor time after which a case was ended, s.
    pub limit_s: f64,
    /// Cases of the whole set; where the record has fewer, the run was stopped.
    pub cases: usize,
}

/// A case.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Number in the plan, or path in the folder.
    pub case: String,
    /// Group of the plan, or family that its maker gives it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub group: String,
    /// What was concealed; none where no machine can read it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<Vec<True>>,
    /// Whether what was concealed is in no catalogue.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub outside: bool,
    /// Verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// What was told.
    pub told: Vec<Told>,
    /// The told against the true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<Scored>,
    /// What went wrong instead of an answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Processor time of the engine, s.
    #[serde(serialize_with = "rounded")]
    pub processor_s: f64,
}

/// A concealed effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct True {
    /// Sensor.
    pub sensor: String,
    /// Identifier.
    pub effect: String,
    /// Oracle's gain, nats.
    #[serde(serialize_with = "rounded")]
    pub gain_nats: f64,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Told {
    /// Sensor.
    pub sensor: String,
    /// Identifier.
    pub effect: String,
    /// What the data cannot tell from it, as `sensor effect`; the sensor is left out where it is
    /// the finding's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub class: Vec<String>,
    /// Gain, nats.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "rounded_option")]
    pub gain_nats: Option<f64>,
    /// Probability of as much by chance.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "rounded_option")]
    pub p: Option<f64>,
    /// Probability.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "rounded_option")]
    pub probability: Option<f64>,
    /// When it acts, s.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "rounded_pair")]
    pub interval_s: Option<[f64; 2]>,
    /// Parameters.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<Value>,
}

/// A parameter that was told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// Name.
    pub name: String,
    /// Value.
    #[serde(serialize_with = "rounded_option")]
    pub value: Option<f64>,
    /// Standard deviation.
    #[serde(serialize_with = "rounded_option")]
    pub sigma: Option<f64>,
    /// Unit.
    pub unit: String,
}

/// The told against the true.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Of each true effect: what became of it.
    pub effects: Vec<Outcome>,
    /// Findings that name nothing that was concealed, as `sensor effect`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub false_findings: Vec<String>,
    /// Parameters with what they should be.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<Parameter>,
    /// Gain on held-out data: found and the oracle's, nats.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "rounded_pair")]
    pub held_out_nats: Option<[f64; 2]>,
}

/// What became of a concealed effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Among the first findings, as many as there are effects.
    Right,
    /// The same, but only in a class.
    RightByClass,
    /// Found behind something false.
    Behind,
    /// Not found.
    Missed,
}

/// A parameter that was told, and what it should be, in the unit of the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Truth.
    #[serde(serialize_with = "rounded")]
    pub truth: f64,
    /// What was told, if anything in such a unit.
    #[serde(serialize_with = "rounded_option")]
    pub told: Option<f64>,
    /// Error in reported standard deviations; none where it cannot be said, which counts as too
    /// many.
    #[serde(serialize_with = "rounded_option")]
    pub deviations: Option<f64>,
    /// Unit.
    pub unit: String,
}

/// A file.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Header.
    pub header: Header,
    /// Rows in the order in which they were run.
    pub rows: Vec<Row>,
}

impl Outcome {
    /// Whether it counts as right.
    pub fn is_right(self) -> bool {
        matches!(self, Self::Right | Self::RightByClass)
    }
}

impl Row {
    /// A row without truth.
    pub fn of(case: &str, explained: Result<&Explanation, String>, processor_s: f64) -> Self {
        let answer = explained.as_ref().ok();
        Self {
            case: case.to_owned(),
            verdict: answer.map(|it| it.verdict),
            told: answer.map(|it| it.findings.iter().map(Told::of).collect()).unwrap_or_default(),
            processor_s,
            failure: explained.err(),
            ..Self::default()
        }
    }

    /// Adds what was concealed and how the answer stands to it.
    #[must_use]
    pub fn judged(mut self, answer: &Answer, score: &CaseScore) -> Self {
        let truth = |e: &super::super::answer::Effect| True {
            sensor: e.sensor.clone(),
            effect: e.effect.clone(),
            gain_nats: e.gain_nats,
        };
        self.group.clone_from(&answer.name);
        self.truth = Some(answer.effects.iter().map(truth).collect());
        self.outside = answer.family == super::super::effect::Family::Outside;
        self.score = Some(Scored::of(score));
        self
    }

    /// Findings as `sensor effect`.
    pub fn names(&self) -> Vec<String> {
        self.told.iter().map(|it| format!("{} {}", it.sensor, it.effect)).collect()
    }
}

impl Told {
    fn of(finding: &Finding) -> Self {
        let own = [finding.sensor.as_str(), finding.effect.as_str()];
        let mut class = Vec::new();
        for pair in finding.pairs().filter(|pair| *pair != own) {
            let name = if pair[0] == own[0] { pair[1].to_owned() } else { pair.join(" ") };
            if !class.contains(&name) {
                class.push(name);
            }
        }
        let parameters = finding.parameters.iter().filter(|it| it.value.is_some()).map(|it| Value {
            name: it.name.clone(),
            value: it.value,
            sigma: it.sigma,
            unit: it.unit.clone(),
        });
        Self {
            sensor: finding.sensor.clone(),
            effect: finding.effect.clone(),
            class,
            gain_nats: finding.evidence.gain_nats,
            p: finding.evidence.p_value,
            probability: finding.probability,
            interval_s: finding.interval_s,
            parameters: parameters.collect(),
        }
    }
}

impl Scored {
    fn of(score: &CaseScore) -> Self {
        let outcome = |it: &super::super::score::EffectScore| match (it.right, it.in_class_only, it.found) {
            (true, false, _) => Outcome::Right,
            (true, true, _) => Outcome::RightByClass,
            (false, _, true) => Outcome::Behind,
            (false, _, false) => Outcome::Missed,
        };
        let parameters = score.effects.iter().flat_map(|it| &it.parameters).map(|it| Parameter {
            name: it.name.clone(),
            truth: it.truth,
            told: it.found,
            deviations: it.deviations().filter(|d| d.is_finite()),
            unit: it.unit.clone(),
        });
        Self {
            effects: score.effects.iter().map(outcome).collect(),
            false_findings: score.false_findings.iter().map(|pair| pair.join(" ")).collect(),
            parameters: parameters.collect(),
            held_out_nats: score.held_out_nats,
        }
    }
}

impl Record {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read or is no record, by line.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text =
            std::fs::read_to_string(path).map_err(|error| Error::io(path, "read the record", &error))?;
        let wrong = |line: usize, message: String| Error::one(path, Problem::new(Some(line), "", message));
        let mut lines = text.lines().enumerate();
        let (_, first) =
            lines.next().ok_or_else(|| wrong(1, "found nothing; expected a header".to_owned()))?;
        let header: Header =
            serde_json::from_str(first).map_err(|error| wrong(1, format!("no header: {error}")))?;
        if header.format != FORMAT {
            return Err(wrong(1, format!("found format \"{}\"; expected \"{FORMAT}\"", header.format)));
        }
        let row = |(line, text): (usize, &str)| {
            serde_json::from_str(text).map_err(|error| wrong(line + 1, format!("no row: {error}")))
        };
        Ok(Self { header, rows: lines.map(row).collect::<Result<_, _>>()? })
    }

    /// Reads a file, or every record of a folder in the order of their names.
    ///
    /// # Errors
    /// A folder or file that cannot be read, a folder without records.
    pub fn read_all(path: &Path) -> Result<Vec<Self>, Error> {
        if !path.is_dir() {
            return Ok(vec![Self::read(path)?]);
        }
        let entries = std::fs::read_dir(path).map_err(|error| Error::io(path, "read the folder", &error))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|ending| ending == ENDING));
        files.sort();
        if files.is_empty() {
            let found = format!("found no file that ends in .{ENDING}; expected records of campaign freeze");
            return Err(Error::one(path, Problem::of_file(found)));
        }
        files.iter().map(|file| Self::read(file)).collect()
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let mut text = serde_json::to_string(&self.header).unwrap_or_default();
        for row in &self.rows {
            text.push('\n');
            text.push_str(&serde_json::to_string(row).unwrap_or_default());
        }
        text.push('\n');
        output::write(path, text.as_bytes())
    }
}

/// The nearest number of as many significant digits.
fn short(value: f64) -> f64 {
    format!("{value:.*e}", DIGITS - 1).parse().unwrap_or(value)
}

// The signature is serde's.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn rounded<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    short(*value).serialize(serializer)
}

#[allow(clippy::ref_option, clippy::trivially_copy_pass_by_ref)]
fn rounded_option<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    value.map(short).serialize(serializer)
}

#[allow(clippy::ref_option)]
fn rounded_pair<S: Serializer>(value: &Option<[f64; 2]>, serializer: S) -> Result<S::Ok, S::Error> {
    value.map(|pair| pair.map(short)).serialize(serializer)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn header(engine: Engine) -> Header {
        Header {
            format: FORMAT.into(),
            set: "small".into(),
            engine,
            seed: Some(1),
            plan_sha256: None,
            date: "2026-01-02".into(),
            commit: "0123abc".into(),
            machine: "a processor, 2 cores".into(),
            limit_s: 60.0,
            cases: 2,
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let value = serde_json::json!({ "format": "schuler-explanation/1", "verdict": "explained", "findings": [
            { "sensor": "gyro", "effect": "bias_step", "class": ["bias_step", "bias_warmup"], "interval_s": [1.0, 2.0],
              "parameters": [{ "name": "coefficient", "value": 1.2345678, "sigma": 0.1, "unit": "deg/h" },
                             { "name": "axis", "value": null, "text": "y" }],
              "evidence": { "gain_nats": 12.34567, "p_value": 1e-9 } }] });
        let explanation = Explanation::read(value).unwrap();
        let rows =
            vec![Row::of("0000", Ok(&explanation), 0.25), Row::of("0001", Err("no memory".into()), 1.0)];
        let record = Record { header: header(Engine::First), rows };
        let folder = tempfile::tempdir().unwrap();
        record.write(&folder.path().join("small.jsonl")).unwrap();
        let read = Record::read_all(folder.path()).unwrap();
        assert_eq!((read.len(), &read[0].header), (1, &record.header));
        let told = &read[0].rows[0].told[0];
        assert_eq!(
            (told.class.as_slice(), told.gain_nats),
            (["bias_warmup".to_owned()].as_slice(), Some(12.346))
        );
        assert_eq!((told.parameters.len(), told.parameters[0].value), (1, Some(1.2346)));
        assert_eq!(read[0].rows[1].failure.as_deref(), Some("no memory"));
    }

    #[test]
    fn what_is_no_record_is_refused_by_its_line() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Record::read_all(folder.path()).is_err());
        let path = folder.path().join("a.jsonl");
        let head = serde_json::to_string(&header(Engine::First)).unwrap();
        std::fs::write(&path, format!("{head}\n{{\"case\": 1}}\n")).unwrap();
        let said = Record::read(&path).unwrap_err().to_string();
        assert!(said.contains(":2:") && said.contains("no row"), "{said}");
        std::fs::write(&path, "{}\n").unwrap();
        assert!(Record::read(&path).unwrap_err().to_string().contains("no header"));
    }
}
