//! The sentences of an explanation, for the terminal and for the page.
use std::fmt::Write;

use schuler_explain::catalogue::{Effect, named};
use schuler_explain::explanation::{BeforeAfter, Finding, Located, Member, Parameter, Remainder, Verdict};
use schuler_explain::sentence::{begun, of_stated, said};
use schuler_recording::error::rounded;

use super::number::{duration, plain, probability, quoted};
use super::{Report, told};

/// A finding that begins or ends within this part of the recording's length from its ends is over the whole of it.
const WHOLE: f64 = 0.001;
/// Columns of the terminal that are used.
const COLUMNS: usize = 100;

/// Places that are told where recording and simulation differ.
pub(super) const LOCATED: usize = 5;

/// The verdict as a heading.
pub(super) fn heading(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "Explained",
        Verdict::PartlyExplained => "Explained in part",
        Verdict::NoMismatch => "No mismatch",
        Verdict::Unexplained => "Not explained",
    }
}

/// What came of it.
pub(super) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "The findings explain where the recording differs from its simulation.",
        Verdict::PartlyExplained => {
            "The findings explain a part of the difference between the recording and its simulation."
        }
        Verdict::NoMismatch => "Nothing was found: the recording agrees with its simulation.",
        Verdict::Unexplained => {
            "The recording differs from its simulation, and nothing in the catalogue fits the difference."
        }
    }
}

/// "From 3 h 12 min on, gyro_x drifts with the rate of its temperature: 1.90 ± 0.04 °/h per K/h."
pub(super) fn finding(finding: &Finding, length_s: f64) -> String {
    let others: Vec<String> =
        finding.parameters.iter().filter(|it| it.text.is_some()).map(|it| parameter(it, false)).collect();
    let others = if others.is_empty() { String::new() } else { format!(" ({})", others.join(", ")) };
    match named(&finding.effect) {
        Some(_) => format!("{}{others}.", in_short(finding, length_s)),
        // The answer's own sentence is for those who have nothing but the answer.
        None => finding.sentence.clone(),
    }
}

/// The same without the parameters that are words, and without a full stop.
pub(super) fn in_short(finding: &Finding, length_s: f64) -> String {
    let Some(effect) = named(&finding.effect) else {
        return finding.sentence.trim_end_matches('.').to_owned();
    };
    let said = said(effect, &finding.subject(), &finding.parameters);
    let numbers: Vec<&Parameter> = finding.parameters.iter().filter(|it| it.text.is_none()).collect();
    let numbers: Vec<String> = numbers.iter().map(|it| parameter(it, numbers.len() == 1)).collect();
    let numbers = if numbers.is_empty() { String::new() } else { format!(": {}", numbers.join(", ")) };
    begun(&format!("{}{said}{numbers}", when(finding.interval_s, length_s)))
}

/// "From 3 h 12 min on, "; nothing for the whole recording.
fn when([start_s, end_s]: [f64; 2], length_s: f64) -> String {
    let margin = WHOLE * length_s;
    let from_start = start_s <= margin;
    let to_end = end_s >= length_s - margin - f64::EPSILON;
    match (from_start, to_end) {
        (true, true) => String::new(),
        (false, true) => format!("From {} on, ", duration(start_s)),
        (true, false) => format!("Until {}, ", duration(end_s)),
        (false, false) => format!("From {} to {}, ", duration(start_s), duration(end_s)),
    }
}

/// A parameter in the sentence: the coefficient without its name where there is no other.
fn parameter(parameter: &Parameter, alone: bool) -> String {
    let value = value(parameter);
    match parameter.name.as_str() {
        "coefficient" if alone => value,
        name => format!("{} {value}", name_of(name)),
    }
}

/// A parameter's value with its uncertainty and unit, or its word.
pub(super) fn value(parameter: &Parameter) -> String {
    match (&parameter.text, parameter.value) {
        (Some(text), _) => text.clone(),
        (None, Some(value)) => {
            let unit = parameter.unit.as_deref().unwrap_or_default();
            quoted(value, parameter.sigma, unit) + &of_stated(parameter)
        }
        (None, None) => "not fitted".to_owned(),
    }
}

/// A parameter's name in words: its unit stands behind its value.
pub(super) fn name_of(name: &str) -> String {
    let known = match name {
        "tau_s" => "time constant",
        "onset_s" => "onset",
        "frequency_hz" => "frequency",
        "delay_s" => "delay",
        "reference_degC" => "reference temperature",
        "at_mean" => "at its mean",
        "arm_x_m" => "lever arm x",
        "arm_y_m" => "lever arm y",
        "arm_z_m" => "lever arm z",
        other => return other.replace('_', " "),
    };
    known.to_owned()
}

/// "bias_temperature_rate, k·Ṫ"
pub(super) fn left_out(id: &str) -> String {
    match named(id) {
        Some(effect) => format!("{id}, {}", effect.formula),
        None => id.to_owned(),
    }
}

/// The parameters that are beyond what is plausible.
pub(super) fn implausible(finding: &Finding) -> Option<String> {
    let beyond: Vec<String> = (finding.parameters.iter().filter(|it| it.plausible == Some(false)))
        .map(|it| format!("{} {}", name_of(&it.name), value(it)))
        .collect();
    (!beyond.is_empty()).then(|| {
        format!(
            "Not plausible for such a sensor: {}. Check the units in the case, or look for another cause.",
            beyond.join(", ")
        )
    })
}

/// A probability by that of the contrary.
pub(super) fn sure(contrary: f64) -> String {
    if contrary < 1e-4 { "above 0.9999".to_owned() } else { plain(1.0 - contrary, 4) }
}

/// What else the data allow, as a line each.
pub(super) fn rivals(rivals: &[Member]) -> Vec<String> {
    let line = |RivalWords { what, how_likely, experiment }| {
        let experiment =
            if experiment.is_empty() { String::new() } else { format!(" To tell: {experiment}") };
        format!("{what}: {how_likely}.{experiment}")
    };
    rival_words(rivals).into_iter().map(line).collect()
}

/// Rivals that the same experiment tells from the finding, in pieces.
pub(super) struct RivalWords {
    pub(super) what: String,
    pub(super) how_likely: String,
    pub(super) experiment: String,
}

/// What else the data allow, by the experiment that would tell, in the order of the first of each.
pub(super) fn rival_words(rivals: &[Member]) -> Vec<RivalWords> {
    let mut groups: Vec<Vec<&Member>> = Vec::new();
    for rival in rivals {
        match groups.iter_mut().find(|group| group[0].separated_by == rival.separated_by) {
            Some(group) => group.push(rival),
            None => groups.push(vec![rival]),
        }
    }
    let words = |group: Vec<&Member>| {
        let experiment = group[0].separated_by.trim();
        let stop = if experiment.is_empty() || experiment.ends_with('.') { "" } else { "." };
        let name = |it: &&Member| format!("{} of {}", it.effect, it.sensor);
        let names: Vec<String> = group.iter().map(name).collect();
        let together: f64 = group.iter().map(|it| it.probability).sum();
        let how_likely = if names.len() == 1 {
            format!("probability {}", plain(together, 2))
        } else {
            format!("together probability {}", plain(together, 2))
        };
        RivalWords { what: names.join(", "), how_likely, experiment: format!("{experiment}{stop}") }
    };
    groups.into_iter().map(words).collect()
}

/// The few places that are told: of each sensor its most significant before the second of another, by sensor.
pub(super) fn foremost(all: &[Located]) -> Vec<&Located> {
    let rank =
        |index: usize, it: &Located| all[..index].iter().filter(|other| other.sensor == it.sensor).count();
    let mut ranked: Vec<(usize, &Located)> =
        all.iter().enumerate().map(|(index, it)| (rank(index, it), it)).collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.truncate(LOCATED);
    ranked.sort_by(|a, b| a.1.sensor.cmp(&b.1.sensor));
    ranked.into_iter().map(|(_, it)| it).collect()
}

/// Where and when they differ.
pub(super) fn located(located: &Located) -> String {
    let mut text = format!("{}: {}", located.sensor, located.what.trim().trim_end_matches('.'));
    if let Some([from, to]) = located.interval_s {
        let _ = write!(text, ", from {} to {}", duration(from), duration(to));
    }
    if let Some([low, high]) = located.band_hz {
        let _ = write!(text, ", between {} and {} Hz", plain(low, 2), plain(high, 2));
    }
    let _ = write!(text, " ({}, {})", located.test.replace('_', " "), probability(located.p_value));
    text
}

/// What is left.
pub(super) fn remainder(remainder: &Remainder) -> String {
    let what = remainder.what.trim().trim_end_matches('.');
    let on = remainder.on.as_ref().map_or_else(String::new, |on| {
        format!(
            " A smooth function of {on} describes it and gains {} nats; what it stands for is unexplained.",
            plain(remainder.gain_nats, 3)
        )
    });
    format!("Left over in {}: {what}.{on}", remainder.sensor)
}

/// How much better it predicts what it never saw; none where nothing was held out.
pub(super) fn held_out(fit: &BeforeAfter) -> Option<String> {
    let BeforeAfter { before, after, .. } = fit;
    let known = before.rmse > 0.0 && after.rmse > 0.0 && before.rmse.is_finite() && after.rmse.is_finite();
    known.then(|| {
        let (from, to) = (plain(before.rmse, 3), plain(after.rmse, 3));
        let error = if from == to {
            format!("stays at {to}")
        } else if after.rmse < before.rmse {
            format!("falls from {from} to {to}")
        } else {
            format!("rises from {from} to {to}")
        };
        let gain = before.nll_per_sample - after.nll_per_sample;
        let likelihood = if gain < 0.0 { "loses" } else { "gains" };
        format!(
            "On data that the fit never saw, the error of prediction {error} of what the nominal model expects, and \
             the likelihood {likelihood} {} nats per sample.",
            plain(gain.abs(), 3)
        )
    })
}

/// What stands above the findings that are noise.
pub(super) const NOISE: &str = "Noise, and readings far from the others:";

/// Whether a finding is another random part.
pub(super) fn is_noise(finding: &Finding) -> bool {
    named(&finding.effect).is_some_and(Effect::is_noise)
}

/// How sure a finding is.
fn evidence(finding: &Finding) -> String {
    let (odds, sure) = (plain(finding.evidence.gain_nats, 3), sure(finding.evidence.p_value));
    let mut text = format!("Probability {sure}, log odds {odds} nats");
    if let Some(share) = finding.share {
        let _ = write!(text, ", {} of the mismatch", told::shared(share));
    }
    text
}

/// What is not plausible in a finding, and what else it may be.
fn beside_a_finding(text: &mut Paragraphs, finding: &Finding) {
    if let Some(warning) = implausible(finding) {
        text.line(3, &warning);
    }
    for rival in rivals(finding.rivals()) {
        text.line(3, &format!("It may be {rival}"));
    }
}

/// The summary for the terminal: physics before noise.
pub(super) fn text(report: &Report) -> String {
    let Report { recorded, explanation, .. } = report;
    let mut text = Paragraphs::default();
    let title = if report.title.is_empty() { &recorded.case } else { &report.title };
    text.line(0, title);
    text.line(
        0,
        &format!(
            "{} of {} at {} s, {} rows of them in gaps; sensors: {}",
            duration(recorded.length_s),
            recorded.case,
            rounded(recorded.step_s),
            recorded.rows_in_gaps,
            recorded.sensors.join(", ")
        ),
    );
    text.blank();
    text.line(0, &told::paragraph(report));
    let (noise, others): (Vec<&Finding>, Vec<&Finding>) =
        explanation.findings.iter().partition(|it| is_noise(it));
    for (index, it) in others.into_iter().enumerate() {
        text.blank();
        text.line(0, &format!("{}. {}", index + 1, finding(it, recorded.length_s)));
        text.line(3, &format!("Left out: {}. {}.", left_out(&it.effect), evidence(it)));
        beside_a_finding(&mut text, it);
    }
    if !noise.is_empty() {
        text.blank();
        text.line(0, NOISE);
    }
    for it in noise {
        text.line(2, &format!("{} {}.", finding(it, recorded.length_s), evidence(it)));
        beside_a_finding(&mut text, it);
    }
    if let Some(better) = held_out(&explanation.fit.held_out) {
        text.blank();
        text.line(0, &better);
    }
    if !explanation.located.is_empty() {
        text.blank();
        text.line(0, "Where they differ, before anything is named:");
        for it in foremost(&explanation.located) {
            text.line(2, &located(it));
        }
        if explanation.located.len() > LOCATED {
            text.line(2, &format!("and {} more", explanation.located.len() - LOCATED));
        }
    }
    if !explanation.noise.is_empty() {
        text.blank();
        text.line(0, "Noise:");
        explanation.noise.iter().for_each(|it| text.line(2, &told::noise_line(it)));
    }
    if let Some(it) = &explanation.remainder {
        text.blank();
        text.line(0, &remainder(it));
    }
    if !explanation.certificate.is_empty() {
        text.blank();
        text.line(0, "What could still hide, of each sensor the effect that would add most (99 % sure):");
        for (sensor, bounds) in told::certified(explanation) {
            text.line(2, &told::certified_line(sensor, &bounds));
        }
    }
    for note in &explanation.notes {
        text.blank();
        text.line(0, &format!("Note: {note}"));
    }
    text.0
}

/// Everything that could still hide, for the terminal.
pub(super) fn certificate(report: &Report) -> String {
    let mut text = Paragraphs::default();
    text.blank();
    text.line(0, "What could still hide, the largest effects that would not have been found (99 % sure):");
    for line in told::certificate(&report.explanation) {
        text.line(if line.starts_with(' ') { 4 } else { 2 }, &line);
    }
    text.0
}

/// Lines that are wrapped.
#[derive(Default)]
struct Paragraphs(String);

impl Paragraphs {
    fn blank(&mut self) {
        self.0.push('\n');
    }

    /// Control characters of the user's files would reach the terminal: they become spaces.
    fn line(&mut self, indent: usize, line: &str) {
        let clean: String = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let mut column = 0;
        for word in clean.split_whitespace() {
            let width = word.chars().count();
            if column == 0 {
                self.0.push_str(&" ".repeat(indent));
                column = indent;
            } else if column + 1 + width > COLUMNS {
                self.0.push('\n');
                self.0.push_str(&" ".repeat(indent + 2));
                column = indent + 2;
            } else {
                self.0.push(' ');
                column += 1;
            }
            self.0.push_str(word);
            column += width;
        }
        self.0.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schuler_explain::explanation::{Evidence, Goodness};

    fn example() -> Finding {
        Finding {
            sensor: "gyro_x".into(),
            sensors: Vec::new(),
            effect: "bias_temperature_rate".into(),
            probability: 1.0,
            class: Vec::new(),
            interval_s: [11_520.0, 86_400.0],
            parameters: vec![Parameter {
                name: "coefficient".into(),
                value: Some(1.9012),
                sigma: Some(0.0401),
                unit: Some("deg/h/(K/h)".into()),
                plausible: Some(true),
                ..Parameter::default()
            }],
            evidence: Evidence { gain_nats: 812.4, p_value: 1e-12 },
            share: None,
            impact: None,
            sentence: "gyro_x drifts with the rate of its temperature".into(),
        }
    }

    #[test]
    fn rivals_that_one_experiment_tells_are_one_line() {
        let rival = |effect: &str, probability, separated_by: &str| Member {
            sensor: "gyro".into(),
            effect: effect.into(),
            probability,
            separated_by: separated_by.into(),
        };
        let all = [
            rival("bias_temperature", 0.31, "tilt it"),
            rival("periodic_line", 0.042, "sample faster."),
            rival("bias_warmup", 0.2, "tilt it"),
        ];
        assert_eq!(
            rivals(&all),
            [
                "bias_temperature of gyro, bias_warmup of gyro: together probability 0.51. To tell: tilt it.",
                "periodic_line of gyro: probability 0.042. To tell: sample faster."
            ]
        );
    }

    #[test]
    fn a_finding_is_a_sentence() {
        assert_eq!(
            finding(&example(), 86_400.0),
            "From 3 h 12 min on, gyro_x drifts with the rate of its temperature: 1.90 ± 0.04 °/h per K/h."
        );
        let whole = Finding { interval_s: [0.0, 86_399.0], ..example() };
        assert!(finding(&whole, 86_400.0).starts_with("gyro_x drifts"));
        let early = Finding { interval_s: [0.0, 3600.0], ..example() };
        assert!(finding(&early, 86_400.0).starts_with("Until 1 h, gyro_x"));
        let middle = Finding { interval_s: [3600.0, 7200.0], ..example() };
        assert!(finding(&middle, 86_400.0).starts_with("From 1 h to 2 h, gyro_x"));
    }

    #[test]
    fn several_parameters_have_their_names_and_words_stay_words() {
        let mut it = example();
        it.parameters.push(Parameter {
            name: "tau_s".into(),
            value: Some(600.0),
            sigma: Some(20.0),
            unit: Some("s".into()),
            plausible: Some(false),
            ..Parameter::default()
        });
        it.parameters.push(Parameter {
            name: "column".into(),
            text: Some("temp_x".into()),
            ..Parameter::default()
        });
        let said = finding(&it, 86_400.0);
        assert!(
            said.ends_with("coefficient 1.90 ± 0.04 °/h per K/h, time constant 600 ± 20 s (column temp_x).")
        );
        assert!(implausible(&it).unwrap().contains("time constant 600 ± 20 s"));
        assert!(implausible(&example()).is_none());
    }

    #[test]
    fn worse_is_called_worse_and_nothing_is_said_of_nothing() {
        let good = Goodness { nll_per_sample: 1.42, rmse: 1.0, whiteness_p: 0.4, nis_mean: 1.0 };
        let bad = Goodness { nll_per_sample: 1.76, rmse: 1.39, ..good };
        let better = held_out(&BeforeAfter { before: bad, after: good, ..BeforeAfter::default() }).unwrap();
        assert!(better.contains("prediction falls from 1.39 to 1.00"), "{better}");
        let worse = held_out(&BeforeAfter { before: good, after: bad, ..BeforeAfter::default() }).unwrap();
        assert!(worse.contains("prediction rises from 1.00 to 1.39"), "{worse}");
        assert!(
            better.contains("gains 0.340 nats") && worse.contains("loses 0.340 nats"),
            "{better} {worse}"
        );
        let same = held_out(&BeforeAfter { before: good, after: good, ..BeforeAfter::default() }).unwrap();
        assert!(same.contains("stays at 1.00"), "{same}");
        assert!(held_out(&BeforeAfter::default()).is_none());
    }

    #[test]
    fn long_lines_are_wrapped_and_control_characters_do_not_reach_the_terminal() {
        let mut text = Paragraphs::default();
        text.line(3, &format!("\u{1b}[31m{}", "word ".repeat(50)));
        assert!(text.0.lines().all(|line| line.chars().count() <= COLUMNS));
        assert!(!text.0.contains('\u{1b}'));
    }
}
