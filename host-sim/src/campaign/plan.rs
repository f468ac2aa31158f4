//! The plan file `schuler-plan/1`: which cases a campaign consists of, and what it must reach.
//!
//! | key | meaning |
//! | --- | --- |
//! | `format`, `title` | `schuler-plan/1`, for people |
//! | `seed` | seed of the campaign; drawn afresh where it is left out |
//! | `most_rows` | most rows of a recording |
//! | `gain_nats` | range from which an effect's average gain is drawn, uniform in the logarithm |
//! | `inexact` | share of cases whose user knows the noise a little wrong |
//! | `[[group]]` | `name`, `cases`, `families`, `effects` (identifiers), `settings`, `at_once` = most effects of a case, and the three keys above |
//! | `[bars]` | what the results must reach; see [`Bars`] |
use std::path::{Path, PathBuf};

use schuler_recording::document::{Node, Parsed, parse_with};
use schuler_recording::{Error, Leniency, file};
use serde::{Deserialize, Serialize};

use super::effect::{EFFECTS, Entry, Family};
use super::maker::entries;
use super::setting::Kind;

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-plan/1";
/// Most cases of a plan.
const MOST_CASES: usize = 1_000_000;

/// A plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// What it is, for people.
    pub title: String,
    /// Seed, if the plan states one.
    pub seed: Option<u64>,
    /// Groups of cases in their order.
    pub groups: Vec<Group>,
    /// What the results must reach.
    pub bars: Bars,
}

/// Cases of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// Name.
    pub name: String,
    /// How many.
    pub cases: usize,
    /// Families of effects; none and no identifiers: nothing is concealed.
    pub families: Vec<Family>,
    /// Identifiers of effects.
    pub identifiers: Vec<String>,
    /// Settings; none: all that an effect can have.
    pub settings: Vec<Kind>,
    /// Most effects of a case.
    pub effects: usize,
    /// Most rows of a recording.
    pub most_rows: usize,
    /// Range of an effect's average gain, nats.
    pub gain_nats: [f64; 2],
    /// Share of cases whose user knows the noise a little wrong.
    pub inexact: f64,
}

/// What results must reach; a share is missed when its confidence interval lies beyond the bar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bars {
    /// Gain from which an effect must be found, nats.
    pub gain_nats: f64,
    /// Least share of such effects that are named rightly.
    pub right: f64,
    /// Largest share of cases without effects in which one is reported.
    pub false_alarm: f64,
    /// Largest share of cases with effects in which a false one is reported beside them.
    pub false_second: f64,
    /// Least share of parameters within three reported standard deviations.
    pub parameter: f64,
    /// Least median of the gain on held-out data, of the oracle's.
    pub held_out: f64,
    /// Largest gain at which half of the effects are found, nats.
    pub half_nats: f64,
    /// Least share of onsets within 2 % of the recording or three correlation times, of the oracle's share.
    pub onset: f64,
    /// Most time for 24 h at 1 Hz with six sensors, s; others in proportion to rows and sensors.
    pub time_s: f64,
    /// Confidence of the intervals.
    pub confidence: f64,
}

impl Default for Bars {
    fn default() -> Self {
        Self {
            gain_nats: 12.0,
            right: 0.95,
            false_alarm: 0.02,
            false_second: 0.05,
            parameter: 0.97,
            held_out: 0.95,
            half_nats: 8.0,
            onset: 0.95,
            time_s: 5.0,
            confidence: 0.95,
        }
    }
}

impl Group {
    /// The effects that it allows.
    pub fn entries(&self) -> Vec<&'static Entry> {
        let mut all = entries(&self.identifiers, &self.families);
        all.retain(|entry| self.settings.is_empty() || entry.kinds.iter().any(|k| self.settings.contains(k)));
        all
    }

    /// Whether it allows a setting.
    pub fn allows(&self, kind: Kind) -> bool {
        self.settings.is_empty() || self.settings.contains(&kind)
    }
}

impl Plan {
    /// Reads the plan at `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the file, by line and field.
    pub fn read(path: &Path) -> Result<PlanFile, Error> {
        Self::read_with(path, Leniency::Strict)
    }

    /// Reads the plan at `path` as strictly or leniently as asked.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_with(path: &Path, leniency: Leniency) -> Result<PlanFile, Error> {
        let text = file::text(path, "read the plan")?;
        let Parsed { value: plan, warnings, .. } = parse_with(path, &text, leniency, read)?;
        Ok(PlanFile { path: path.to_owned(), text, plan, warnings })
    }

    /// Number of cases.
    pub fn cases(&self) -> usize {
        self.groups.iter().map(|g| g.cases).sum()
    }

    /// The group of a case.
    pub fn group(&self, index: usize) -> Option<&Group> {
        let mut first = 0;
        self.groups.iter().find(|group| {
            first += group.cases;
            index < first
        })
    }
}

/// A plan that was read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanFile {
    /// The file.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// What stands in it.
    pub plan: Plan,
    /// What its reader should be told.
    pub warnings: Vec<String>,
}

/// Keys that the plan gives for all of its groups and a group for itself.
#[derive(Clone, Copy)]
struct Common {
    most_rows: usize,
    gain_nats: [f64; 2],
    inexact: f64,
}

fn common(node: &Node<'_>, default: Common) -> Common {
    let rows = node.optional("most_rows").and_then(|f| {
        f.number_where("a whole number from 1200 to 1e7", |n| n.fract() == 0.0 && (1200.0..=1e7).contains(&n))
    });
    let gains = node.optional("gain_nats").and_then(|f| {
        let range = f.numbers::<2>()?;
        if range[0] > 0.0 && range[1] >= range[0] {
            Some(range)
        } else {
            f.wrong("two numbers that increase, above zero")
        }
    });
    let inexact = node
        .optional("inexact")
        .and_then(|f| f.number_where("a share from 0 to 1", |n| (0.0..=1.0).contains(&n)));
    Common {
        most_rows: rows.map_or(default.most_rows, |n| n as usize),
        gain_nats: gains.unwrap_or(default.gain_nats),
        inexact: inexact.unwrap_or(default.inexact),
    }
}

fn read(node: &Node<'_>) -> Option<Plan> {
    let format = node.required("format", &format!("\"{FORMAT}\"")).and_then(|field| {
        let text = field.text()?;
        if text == FORMAT { Some(()) } else { field.wrong(&format!("\"{FORMAT}\"")) }
    });
    let title = node.optional("title").and_then(|f| f.text()).unwrap_or_default();
    let seed = node.optional("seed").map(|f| {
        f.number_where("a whole number from 0 to 2^53", |n| {
            n.fract() == 0.0 && (0.0..=9_007_199_254_740_992.0).contains(&n)
        })
    });
    let default = common(node, Common { most_rows: 86_400, gain_nats: [4.0, 1000.0], inexact: 0.5 });
    let groups = node.tables("group", |node| group(node, default));
    let bars = match node.optional("bars") {
        Some(field) => field.table(|node| Some(bars(node))),
        None => Some(Bars::default()),
    };
    format?;
    let seed = match seed {
        Some(seed) => Some(seed? as u64),
        None => None,
    };
    let (groups, bars) = (groups?, bars?);
    if groups.is_empty() {
        return node.problem_at("group", "missing; expected at least one [[group]]");
    }
    let cases: usize = groups.iter().map(|g| g.cases).sum();
    if cases > MOST_CASES {
        return node.problem_at("group", &format!("found {cases} cases; expected at most {MOST_CASES}"));
    }
    Some(Plan { title, seed, groups, bars })
}

fn group(node: &Node<'_>, default: Common) -> Option<Group> {
    let name = node.required("name", "the name of the group").and_then(|f| f.text());
    let cases = node.required("cases", "the number of cases").and_then(|f| {
        f.number_where("a whole number from 1 to 1e6", |n| n.fract() == 0.0 && (1.0..=1e6).contains(&n))
    });
    let effects = node.optional("at_once").and_then(|f| {
        f.number_where("a whole number from 1 to 4", |n| n.fract() == 0.0 && (1.0..=4.0).contains(&n))
    });
    let families = named(node, "families", &families());
    let settings = named(node, "settings", &settings());
    let known: Vec<(String, String)> =
        EFFECTS.iter().map(|entry| (entry.effect.to_owned(), entry.effect.to_owned())).collect();
    let identifiers = named(node, "effects", &known);
    let Common { most_rows, gain_nats, inexact } = common(node, default);
    let group = Group {
        name: name?,
        cases: cases? as usize,
        families: families?,
        identifiers: identifiers?,
        settings: settings?,
        effects: effects.map_or(1, |n| n as usize),
        most_rows,
        gain_nats,
        inexact,
    };
    let asked = !(group.families.is_empty() && group.identifiers.is_empty());
    if asked && group.entries().is_empty() {
        return node.problem_at(
            "settings",
            "found settings in which none of the effects can be; expected some in which they can",
        );
    }
    Some(group)
}

fn families() -> Vec<(String, Family)> {
    use Family::{Additive, Failure, Input, Noise, Outside, Thermal};
    [
        ("additive", Additive),
        ("thermal", Thermal),
        ("input", Input),
        ("noise", Noise),
        ("failure", Failure),
        ("outside", Outside),
    ]
    .map(|(name, family)| (name.to_owned(), family))
    .to_vec()
}

fn settings() -> Vec<(String, Kind)> {
    let name = |kind: Kind| serde_json::to_value(kind).ok().and_then(|v| v.as_str().map(str::to_owned));
    Kind::ALL.into_iter().filter_map(|kind| Some((name(kind)?, kind))).collect()
}

/// A list of names, each of them known; none where the key is absent.
fn named<T: Clone>(node: &Node<'_>, key: &'static str, known: &[(String, T)]) -> Option<Vec<T>> {
    let Some(field) = node.optional(key) else { return Some(vec![]) };
    let names = field.text_list()?;
    let mut all = Vec::new();
    for name in names {
        let Some((_, value)) = known.iter().find(|(known, _)| *known == name) else {
            let meant = schuler_recording::document::suggestion(&name, known.iter().map(|(k, _)| k.as_str()));
            let hint = meant.map(|m| format!("; did you mean \"{m}\"?")).unwrap_or_default();
            return field.problem(format!("found \"{name}\"; expected names of {key}{hint}"));
        };
        all.push(value.clone());
    }
    Some(all)
}

fn bars(node: &Node<'_>) -> Bars {
    let d = Bars::default();
    let share = |key: &'static str, default: f64| {
        let read = node
            .optional(key)
            .and_then(|f| f.number_where("a share from 0 to 1", |n| (0.0..=1.0).contains(&n)));
        read.unwrap_or(default)
    };
    let positive = |key: &'static str, default: f64| {
        let read = node.optional(key).and_then(|f| f.number_where("a number greater than zero", |n| n > 0.0));
        read.unwrap_or(default)
    };
    Bars {
        gain_nats: positive("gain_nats", d.gain_nats),
        right: share("right", d.right),
        false_alarm: share("false_alarm", d.false_alarm),
        false_second: share("false_second", d.false_second),
        parameter: share("parameter", d.parameter),
        held_out: share("held_out", d.held_out),
        half_nats: positive("half_nats", d.half_nats),
        onset: share("onset", d.onset),
        time_s: positive("time_s", d.time_s),
        confidence: share("confidence", d.confidence),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<Plan, Error> {
        parse_with(Path::new("p.toml"), text, Leniency::Strict, read).map(|parsed| parsed.value)
    }

    const SMALL: &str = "format = \"schuler-plan/1\"\n[[group]]\nname = \"a\"\ncases = 3\nfamilies = [\"thermal\"]\n[[group]]\nname = \"nothing\"\ncases = 2\n";

    #[test]
    fn cases_belong_to_groups_in_order() {
        let it = plan(SMALL).unwrap();
        assert_eq!((it.cases(), it.seed), (5, None));
        let names: Vec<_> = (0..6).map(|k| it.group(k).map(|g| g.name.clone())).collect();
        assert_eq!(names[2].as_deref(), Some("a"));
        assert_eq!(names[3].as_deref(), Some("nothing"));
        assert_eq!(names[5], None);
        assert!(it.groups[1].entries().is_empty() && !it.groups[0].entries().is_empty());
    }

    #[test]
    fn mistakes_name_line_field_and_expectation() {
        let wrong = |from: &str, to: &str| plan(&SMALL.replace(from, to)).unwrap_err().to_string();
        assert_eq!(
            wrong("\"thermal\"", "\"termal\""),
            "p.toml:5: group[0].families: found \"termal\"; expected names of families; did you mean \"thermal\"?"
        );
        assert_eq!(
            wrong("cases = 3", "cases = 0"),
            "p.toml:4: group[0].cases: found 0; expected a whole number from 1 to 1e6"
        );
        assert!(wrong("cases = 3", "case = 3").contains("group[0].case"));
    }
}
