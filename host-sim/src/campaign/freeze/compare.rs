//! Two records beside each other: the cases that both have, where they differ, and how often each
//! is right.
use std::collections::BTreeMap;

use serde::Serialize;

use super::super::explanation::Verdict;
use super::record::{Outcome, Record, Row};

/// Gain from which an effect must be found, nats.
const STRONG_NATS: f64 = 12.0;
/// Reported deviations within which a parameter must lie.
const DEVIATIONS: f64 = 3.0;
/// Share of the oracle's gain on held-out data that counts as all of it.
const HELD_OUT: f64 = 0.95;
/// Two-sided 95 % quantile of the normal distribution.
const Z: f64 = 1.959_963_984_540_054;
/// Probabilities between which findings are counted as right or not.
const RELIABILITY: [(f64, f64); 3] = [(0.95, 0.99), (0.99, 0.999), (0.999, 1.01)];

/// How often something is so, with Wilson's 95 % interval (1927).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rate {
    /// How often it is so.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// Interval of the share; from nought to one where there is nothing.
    pub interval: [f64; 2],
}

/// A figure of both.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// What it is.
    pub name: String,
    /// Of each record.
    pub rates: [Rate; 2],
}

/// A case on which the two do not agree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Set, seed and case.
    pub case: String,
    /// What was concealed; none where no machine can read it.
    pub truth: Option<String>,
    /// What each made of it.
    pub said: [String; 2],
}

/// Processor time of one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Time {
    /// Of all cases, s.
    pub sum_s: f64,
    /// Of half of them at most, s.
    pub median_s: f64,
    /// Of the slowest, s.
    pub most_s: f64,
}

/// The comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// What each is.
    pub names: [String; 2],
    /// Cases that both have.
    pub cases: usize,
    /// Cases that only one has.
    pub alone: [usize; 2],
    /// Where they differ.
    pub differences: Vec<Difference>,
    /// Figures over the cases that both have.
    pub figures: Vec<Figure>,
    /// Processor time over these.
    pub times: [Time; 2],
}

impl Rate {
    /// A rate.
    pub fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Self { hits, of, interval: [0.0, 1.0] };
        }
        let (n, share) = (of as f64, hits as f64 / of as f64);
        let middle = (share + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt() / (1.0 + Z * Z / n);
        Self { hits, of, interval: [(middle - half).max(0.0), (middle + half).min(1.0)] }
    }

    fn count(outcomes: impl Iterator<Item = bool>) -> Self {
        let (mut hits, mut of) = (0, 0);
        for is_so in outcomes {
            hits += usize::from(is_so);
            of += 1;
        }
        Self::new(hits, of)
    }
}

/// Compares what two engines made of the same cases.
pub fn compare(a: &[Record], b: &[Record]) -> Comparison {
    let (rows_a, rows_b) = (by_case(a), by_case(b));
    let both: Vec<(&Key, [&Row; 2])> =
        rows_a.iter().filter_map(|(case, row)| Some((case, [*row, *rows_b.get(case)?]))).collect();
    let differences = both.iter().filter(|(_, [a, b])| differs(a, b)).map(|(case, rows)| Difference {
        case: case.0.clone(),
        truth: truth(rows[0]),
        said: rows.map(said),
    });
    let of = |which: usize| both.iter().map(|(_, rows)| rows[which]).collect::<Vec<_>>();
    let columns = [of(0), of(1)];
    Comparison {
        names: [names(a), names(b)],
        cases: both.len(),
        alone: [rows_a.len() - both.len(), rows_b.len() - both.len()],
        differences: differences.collect(),
        figures: figures(&columns),
        times: columns.map(|rows| time(&rows)),
    }
}

/// Set, seed and case, and the plan's fingerprint: cases of two plans are different ones, whatever
/// their names.
type Key = (String, Option<String>);

/// Rows by their cases; of a case that was run twice the last.
fn by_case(records: &[Record]) -> BTreeMap<Key, &Row> {
    let mut rows = BTreeMap::new();
    for record in records {
        let seed = record.header.seed.map(|seed| format!(" {seed}")).unwrap_or_default();
        for row in &record.rows {
            let name = format!("{}{seed} {}", record.header.set, row.case);
            rows.insert((name, record.header.plan_sha256.clone()), row);
        }
    }
    rows
}

fn names(records: &[Record]) -> String {
    let mut names: Vec<String> = records
        .iter()
        .map(|it| {
            format!(
                "{} at {} ({}; {})",
                it.header.engine.name(),
                it.header.commit,
                it.header.date,
                it.header.machine
            )
        })
        .collect();
    names.sort();
    names.dedup();
    names.join(", ")
}

/// Whether the judgements differ or, where nobody can judge, the names.
fn differs(a: &Row, b: &Row) -> bool {
    if a.failure.is_some() != b.failure.is_some() {
        return true;
    }
    match (&a.score, &b.score) {
        (Some(a), Some(b)) => {
            let right = |effects: &[Outcome]| effects.iter().map(|it| it.is_right()).collect::<Vec<_>>();
            right(&a.effects) != right(&b.effects) || sorted(&a.false_findings) != sorted(&b.false_findings)
        }
        _ => sorted(&a.names()) != sorted(&b.names()),
    }
}

fn sorted(names: &[String]) -> Vec<&String> {
    let mut names: Vec<&String> = names.iter().collect();
    names.sort();
    names
}

fn truth(row: &Row) -> Option<String> {
    let effects = row.truth.as_ref()?;
    if effects.is_empty() {
        return Some("nothing".to_owned());
    }
    let text = |it: &super::record::True| format!("{} {} ({:.0})", it.sensor, it.effect, it.gain_nats);
    Some(effects.iter().map(text).collect::<Vec<_>>().join(", "))
}

/// What an engine made of a case, in one line.
fn said(row: &Row) -> String {
    if let Some(failure) = &row.failure {
        return format!("failed: {failure}");
    }
    let Some(score) = &row.score else {
        return listed(&row.names());
    };
    let mut parts: Vec<String> = Vec::new();
    for outcome in &score.effects {
        let word = match outcome {
            Outcome::Right => "right",
            Outcome::RightByClass => "right by class",
            Outcome::Behind => "behind",
            Outcome::Missed => "missed",
        };
        parts.push(word.to_owned());
    }
    if !score.false_findings.is_empty() {
        parts.push(format!("false: {}", listed(&score.false_findings)));
    }
    if parts.is_empty() { "nothing".to_owned() } else { parts.join(", ") }
}

fn listed(names: &[String]) -> String {
    /// Names beyond these are counted.
    const MOST: usize = 6;
    match names.len() {
        0 => "nothing".to_owned(),
        n if n <= MOST => names.join("; "),
        n => format!("{}; and {} more", names[..MOST].join("; "), n - MOST),
    }
}

/// A figure's cases in one row: of each whether it is so.
type Counted<'c> = dyn Fn(&Row) -> Vec<bool> + 'c;

fn figures(columns: &[Vec<&Row>; 2]) -> Vec<Figure> {
    let known = |row: &Row| row.score.is_some() && !row.outside;
    let has = |row: &Row| row.truth.as_ref().is_some_and(|effects| !effects.is_empty());
    let is_false = |row: &Row| row.score.as_ref().is_some_and(|score| !score.false_findings.is_empty());
    let found = |row: &Row| {
        row.score.as_ref().is_some_and(|score| score.effects.iter().any(|it| *it != Outcome::Missed))
    };
    let one = |counts: bool, is_so: bool| if counts { vec![is_so] } else { vec![] };
    let held_out = |row: &Row| row.score.as_ref().and_then(|score| score.held_out_nats);
    let counted: Vec<(&str, Box<Counted<'_>>)> = vec![
        (
            "right first, oracle 12 nats or more",
            Box::new(|row| if known(row) { strong(row) } else { vec![] }),
        ),
        ("false on nothing", Box::new(move |row| one(known(row) && !has(row), is_false(row)))),
        (
            "false beside a true one",
            Box::new(move |row| one(known(row) && has(row) && found(row), is_false(row))),
        ),
        ("parameter within 3 sigma", Box::new(|row| if known(row) { within(row) } else { vec![] })),
        (
            "held-out gain 0.95 of the oracle's or more",
            Box::new(move |row| {
                held_out(row).map(|[own, oracle]| own >= HELD_OUT * oracle).into_iter().collect()
            }),
        ),
        (
            "outside the catalogue, told as explained",
            Box::new(move |row| one(row.outside, row.verdict == Some(Verdict::Explained))),
        ),
        ("no answer", Box::new(|row| vec![row.failure.is_some()])),
    ];
    let mut figures: Vec<Figure> = counted
        .into_iter()
        .map(|(name, of)| Figure {
            name: name.to_owned(),
            rates: columns.each_ref().map(|rows| Rate::count(rows.iter().flat_map(|row| of(row)))),
        })
        .collect();
    for (from, to) in RELIABILITY {
        let rates = columns.each_ref().map(|rows| {
            let told = rows.iter().filter(|row| known(row)).flat_map(|row| probable(row, from, to));
            Rate::count(told)
        });
        if rates.iter().any(|rate| rate.of > 0) {
            figures.push(Figure { name: format!("told at {from} to {}: not false", to.min(1.0)), rates });
        }
    }
    figures
}

/// Of each effect that is strong enough to be found: whether it is right.
fn strong(row: &Row) -> Vec<bool> {
    let (Some(truth), Some(score)) = (&row.truth, &row.score) else { return vec![] };
    let effects = truth.iter().zip(&score.effects);
    effects.filter(|(it, _)| it.gain_nats >= STRONG_NATS).map(|(_, outcome)| outcome.is_right()).collect()
}

fn within(row: &Row) -> Vec<bool> {
    let parameters = row.score.iter().flat_map(|score| &score.parameters).filter(|it| it.told.is_some());
    parameters.map(|it| it.deviations.is_some_and(|d| d <= DEVIATIONS)).collect()
}

/// Of each finding told with such a probability: whether it is not false.
fn probable(row: &Row, from: f64, to: f64) -> Vec<bool> {
    let Some(score) = &row.score else { return vec![] };
    let told = row.told.iter().filter(|it| it.probability.is_some_and(|p| p >= from && p < to));
    told.map(|it| !score.false_findings.contains(&format!("{} {}", it.sensor, it.effect))).collect()
}

fn time(rows: &[&Row]) -> Time {
    let mut times: Vec<f64> = rows.iter().map(|row| row.processor_s).collect();
    times.sort_by(f64::total_cmp);
    Time {
        sum_s: times.iter().sum(),
        median_s: times.get(times.len() / 2).copied().unwrap_or_default(),
        most_s: times.last().copied().unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::engine::Engine;
    use super::super::record::{Parameter, Scored, Told, True, tests::header};
    use super::*;

    fn row(case: &str, truth: &[f64], outcomes: &[Outcome], false_findings: &[&str]) -> Row {
        let effects = truth.iter().map(|gain_nats| True {
            sensor: "gyro".into(),
            effect: "bias_step".into(),
            gain_nats: *gain_nats,
        });
        Row {
            case: case.into(),
            truth: Some(effects.collect()),
            verdict: Some(Verdict::Explained),
            score: Some(Scored {
                effects: outcomes.to_vec(),
                false_findings: false_findings.iter().map(|name| (*name).to_owned()).collect(),
                ..Scored::default()
            }),
            processor_s: 2.0,
            ..Row::default()
        }
    }

    fn record(rows: Vec<Row>) -> Record {
        Record { header: header(Engine::First), rows }
    }

    fn rate<'c>(comparison: &'c Comparison, name: &str) -> &'c [Rate; 2] {
        &comparison.figures.iter().find(|it| it.name.starts_with(name)).unwrap().rates
    }

    #[test]
    fn wilsons_interval_is_that_of_the_tables() {
        // Newcombe 1998, table I: 81 of 263, 0.2553 to 0.3662; 0 of 20, 0 to 0.1611.
        let it = Rate::new(81, 263);
        assert!((it.interval[0] - 0.2553).abs() < 5e-5 && (it.interval[1] - 0.3662).abs() < 5e-5, "{it:?}");
        let it = Rate::new(0, 20);
        assert!(it.interval[0] == 0.0 && (it.interval[1] - 0.1611).abs() < 5e-5, "{it:?}");
    }

    #[test]
    fn only_cases_that_both_have_are_counted() {
        use Outcome::{Missed, Right, RightByClass};
        let a = record(vec![
            row("0", &[20.0], &[Missed], &["gyro bias_warmup"]),
            row("1", &[], &[], &[]),
            row("2", &[20.0, 5.0], &[RightByClass, Missed], &[]),
            row("3", &[50.0], &[Right], &[]),
        ]);
        let b = record(vec![
            row("0", &[20.0], &[Right], &[]),
            row("1", &[], &[], &["gyro scale_factor"]),
            row("2", &[20.0, 5.0], &[Right, Missed], &["gyro scale_factor"]),
        ]);
        let it = compare(&[a], &[b]);
        assert_eq!((it.cases, it.alone), (3, [1, 0]));
        let pair = |name: &str| rate(&it, name).map(|rate| (rate.hits, rate.of));
        assert_eq!(pair("right first"), [(1, 2), (2, 2)]);
        assert_eq!(pair("false on nothing"), [(0, 1), (1, 1)]);
        assert_eq!(pair("false beside"), [(0, 1), (1, 2)]);
        assert_eq!(it.differences.len(), 3);
        assert_eq!(it.differences[0].said[0], "missed, false: gyro bias_warmup");
        assert_eq!(it.differences[1].truth.as_deref(), Some("nothing"));
        assert_eq!(it.times[0].sum_s, 6.0);
    }

    #[test]
    fn parameters_probabilities_and_names_are_compared() {
        let mut a = row("0", &[20.0], &[Outcome::Right], &["gyro bias_warmup"]);
        let parameter = |deviations| Parameter {
            name: "coefficient".into(),
            truth: 1.0,
            told: Some(1.1),
            deviations,
            unit: String::new(),
        };
        let score = a.score.as_mut().unwrap();
        score.parameters = vec![parameter(Some(2.0)), parameter(Some(4.0)), parameter(None)];
        score.held_out_nats = Some([9.6, 10.0]);
        let told = |effect: &str| Told {
            sensor: "gyro".into(),
            effect: effect.into(),
            class: vec![],
            gain_nats: None,
            p: None,
            probability: Some(0.96),
            interval_s: None,
            parameters: vec![],
        };
        a.told = vec![told("bias_step"), told("bias_warmup")];
        let mut b = a.clone();
        b.told.pop();
        let it = compare(&[record(vec![a.clone()])], &[record(vec![b.clone()])]);
        assert!(it.differences.is_empty());
        assert_eq!(rate(&it, "parameter")[0], Rate::new(1, 3));
        assert_eq!(rate(&it, "held-out")[0], Rate::new(1, 1));
        assert_eq!(rate(&it, "told at 0.95 to 0.99")[0], Rate::new(1, 2));
        let mut other = record(vec![a.clone()]);
        other.header.plan_sha256 = Some("0f".into());
        assert_eq!(compare(&[record(vec![a.clone()])], &[other]).alone, [1, 1]);
        // Where nobody can judge, the names differ.
        (a.score, b.score) = (None, None);
        let it = compare(&[record(vec![a])], &[record(vec![b])]);
        assert_eq!(it.differences[0].said, ["gyro bias_step; gyro bias_warmup", "gyro bias_step"]);
    }
}
