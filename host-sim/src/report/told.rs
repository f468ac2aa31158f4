//! What stands above the findings and below them: the paragraph, the table, noise, and what could still hide.
use schuler_explain::explanation::{Bound, Explanation, Finding, Impact, NoiseNumbers, NoiseOfSensor};

use super::Report;
use super::number::{duration, percent, plain, printed_unit};
use super::words;

/// Error of a position below which a paragraph does not speak of it, m.
const LEAST_POSITION_M: f64 = 1.0;
/// Arc minutes and seconds of a degree.
const MINUTES: f64 = 60.0;
const SECONDS: f64 = 3600.0;

/// What is wrong, how much of the mismatch it explains, and what it does to a navigation solution.
pub(super) fn paragraph(report: &Report) -> String {
    let explanation = &report.explanation;
    let Some(first) = main_finding(explanation) else {
        return words::verdict(explanation.verdict).to_owned();
    };
    let said = words::in_short(first, report.recorded.length_s);
    let mut sentences = vec![format!(
        "{} (probability {}).",
        said.trim_end_matches('.'),
        words::sure(first.evidence.p_value)
    )];
    let others = explanation.findings.iter().filter(|it| !it.is_no_physics()).count().saturating_sub(1);
    let all = explanation.explained_share.filter(|_| others > 0).map(|share| {
        let findings = if others == 1 { "the other finding" } else { "the other findings" };
        format!(", with {findings} {}", shared(share))
    });
    if let Some(share) = first.share {
        let all = all.unwrap_or_default();
        sentences.push(format!("It explains {} of the mismatch{all}.", shared(share)));
    }
    if let Some(it) = explanation.impact.as_ref().filter(|it| it.position_m >= LEAST_POSITION_M) {
        let (sensor, off) = (&it.sensor, impact(it));
        sentences.push(format!("Left uncorrected, the errors of {sensor} put a navigation solution {off}."));
    }
    if let Some(remainder) = &explanation.remainder {
        sentences.push(format!("Something is left over in {}.", remainder.sensor));
    }
    sentences.join(" ")
}

/// The finding that a paragraph is of: that with the largest share of the mismatch, of physics where there is any.
pub(super) fn main_finding(explanation: &Explanation) -> Option<&Finding> {
    let is_physics = |it: &&Finding| !words::is_noise(it) && !it.is_no_physics();
    let share = |it: &Finding| it.share.unwrap_or(0.0);
    let physics = explanation.findings.iter().filter(is_physics);
    // Of equal shares the one that stands first.
    let main = physics.rev().max_by(|a, b| share(a).total_cmp(&share(b)));
    main.or_else(|| explanation.findings.first())
}

/// "1.2 km and 0.5′ off after 1 h"
pub(super) fn impact(impact: &Impact) -> String {
    let position = if impact.position_m >= 1000.0 {
        format!("{} km", plain(impact.position_m / 1000.0, 2))
    } else {
        format!("{} m", plain(impact.position_m, 2))
    };
    let attitude = match impact.attitude_deg {
        it if it >= 1.0 => format!("{}°", plain(it, 2)),
        it if it >= 1.0 / MINUTES => format!("{}′", plain(it * MINUTES, 2)),
        it => format!("{}″", plain(it * SECONDS, 2)),
    };
    format!("{position} and {attitude} off after {}", duration(impact.after_s))
}

/// A row of the table of findings.
pub(super) struct Row<'r> {
    pub(super) finding: &'r Finding,
    pub(super) value: String,
    pub(super) probability: String,
    pub(super) share: String,
    /// What else it may be, with probabilities.
    pub(super) rivals: Option<String>,
}

/// A share of the mismatch; one that is too small for a number is not called nothing.
pub(super) fn shared(share: f64) -> String {
    if share < LEAST_SHARE { "below 1 %".to_owned() } else { percent(share) }
}

/// Share that is told as a number.
const LEAST_SHARE: f64 = 0.005;

/// The rows of findings of physics, the one with the largest share first; of the noise where there is no other.
pub(super) fn rows(explanation: &Explanation) -> Vec<Row<'_>> {
    let row = |finding| Row {
        finding,
        value: values(finding),
        probability: words::sure(finding.evidence.p_value),
        share: finding.share.map_or_else(|| "–".to_owned(), shared),
        rivals: rivals(finding),
    };
    let (noise, physics): (Vec<&Finding>, Vec<&Finding>) =
        explanation.findings.iter().partition(|it| words::is_noise(it) || it.is_no_physics());
    let mut told = if physics.is_empty() { noise } else { physics };
    let share = |it: &Finding| it.share.unwrap_or(0.0);
    told.sort_by(|a, b| share(b).total_cmp(&share(a)));
    told.into_iter().map(row).collect()
}

/// The numbers of a finding: the coefficient without its name where there is no other.
fn values(finding: &Finding) -> String {
    let numbers: Vec<_> = finding.parameters.iter().filter(|it| it.text.is_none()).collect();
    let one = |it: &&schuler_explain::explanation::Parameter| match it.name.as_str() {
        "coefficient" => words::value(it),
        name => format!("{} {}", words::name_of(name), words::value(it)),
    };
    if numbers.is_empty() { "–".to_owned() } else { numbers.iter().map(one).collect::<Vec<_>>().join(", ") }
}

/// The most probable rival, and how many more there are.
fn rivals(finding: &Finding) -> Option<String> {
    let all = finding.rivals();
    let first = all.iter().max_by(|a, b| a.probability.total_cmp(&b.probability))?;
    let of = if first.sensor == finding.sensor { String::new() } else { format!(" of {}", first.sensor) };
    let more = if all.len() > 1 { format!(", {} more", all.len() - 1) } else { String::new() };
    Some(format!("or {}{of} ({}){more}", first.effect, plain(first.probability, 2)))
}

/// The numbers of a noise in words.
pub(super) fn noise(noise: &NoiseNumbers, unit: &str) -> String {
    let unit = printed_unit(unit);
    let level = |value: f64| format!("{} {unit}", plain(value, 3));
    let mut parts: Vec<String> = Vec::new();
    if noise.white > 0.0 {
        parts.push(format!("white {}", level(noise.white)));
    }
    parts.extend(
        noise
            .markov
            .iter()
            .map(|[sigma, tau_s]| format!("Markov {} over {}", level(*sigma), duration(*tau_s))),
    );
    parts.extend(noise.exp_cos.iter().map(|[sigma, _, beta]| {
        let period_s = std::f64::consts::TAU / beta;
        format!("oscillation {} of {}", level(*sigma), duration(period_s))
    }));
    for (name, value) in [
        ("random walk", noise.random_walk),
        ("flicker", noise.flicker),
        ("rounding of the angle", noise.angle),
    ] {
        if value > 0.0 {
            let per = if name == "random walk" { " per √s" } else { "" };
            parts.push(format!("{name} {}{per}", level(value)));
        }
    }
    if parts.is_empty() { "none".to_owned() } else { parts.join(", ") }
}

/// How far a spectrum holds.
pub(super) fn holds(noise: &NoiseOfSensor) -> String {
    if noise.holds_within > 0.0 { percent(noise.holds_within) } else { "as far as can be told".to_owned() }
}

/// A sensor's noise as a line.
pub(super) fn noise_line(it: &NoiseOfSensor) -> String {
    let stated = it.stated.as_ref().map_or_else(
        || "nothing stated".to_owned(),
        |stated| {
            if *stated == it.found {
                "as stated".to_owned()
            } else {
                format!("stated {}", noise(stated, &it.unit))
            }
        },
    );
    let holds = if it.holds_within > 0.0 {
        format!("; its spectrum holds to within {}", percent(it.holds_within))
    } else {
        String::new()
    };
    format!("{}: {} ({stated}){holds}", it.sensor, noise(&it.found, &it.unit))
}

/// Sensors in the order of the certificate, each with its bounds.
pub(super) fn certified(explanation: &Explanation) -> Vec<(&str, Vec<&Bound>)> {
    let mut sensors: Vec<(&str, Vec<&Bound>)> = Vec::new();
    for bound in &explanation.certificate {
        match sensors.iter_mut().find(|(sensor, _)| *sensor == bound.sensor) {
            Some((_, own)) => own.push(bound),
            None => sensors.push((&bound.sensor, vec![bound])),
        }
    }
    sensors
}

/// "0.106 °/h per K (time constant 17 s)"; none where the recording cannot tell.
pub(super) fn bound(it: &Bound) -> Option<String> {
    let unit = printed_unit(&it.unit);
    let value = format!("{} {unit}", plain(it.bound?, 2));
    let at = it
        .at
        .iter()
        .map(|at| format!("{} {} {}", words::name_of(&at.name), plain(at.value, 3), printed_unit(&at.unit)));
    let words = it.variant.iter().map(|(name, word)| format!("{} {word}", words::name_of(name)));
    let beside: Vec<String> = at.chain(words).map(|text| text.trim().to_owned()).collect();
    let beside = if beside.is_empty() { String::new() } else { format!(" ({})", beside.join(", ")) };
    Some(format!("{}{beside}", value.trim()))
}

/// What an effect as large as its bound adds, in the unit of the sensor.
pub(super) fn adds(it: &Bound) -> String {
    let unit = printed_unit(&it.adds_unit);
    it.adds_rms.map_or_else(|| "–".to_owned(), |rms| format!("{} {unit}", plain(rms, 2)).trim().to_owned())
}

/// An effect with the parameter that is bounded, where that is not its only one.
pub(super) fn bounded(it: &Bound) -> String {
    match it.parameter.as_str() {
        "" | "coefficient" | "amplitude" => it.effect.clone(),
        name => format!("{}, {}", it.effect, words::name_of(name)),
    }
}

/// What could still hide in a sensor, in a line.
pub(super) fn certified_line(sensor: &str, bounds: &[&Bound]) -> String {
    let told: Vec<&&Bound> = bounds.iter().filter(|it| it.bound.is_some()).collect();
    let unknown = bounds.len() - told.len();
    let effects = |count: usize| if count == 1 { "1 effect".to_owned() } else { format!("{count} effects") };
    let cannot = if unknown > 0 {
        format!("; of {} the recording cannot tell", effects(unknown))
    } else {
        String::new()
    };
    let largest = told.iter().max_by(|a, b| a.adds_rms.unwrap_or(0.0).total_cmp(&b.adds_rms.unwrap_or(0.0)));
    match largest.and_then(|it| Some((it, bound(it)?))) {
        Some((largest, value)) => format!(
            "{sensor}: at most {} (root mean square), by {} of {value}; of {} each adds less{cannot}",
            adds(largest),
            bounded(largest),
            effects(told.len() - 1)
        ),
        None => format!("{sensor}: no bound{cannot}"),
    }
}

/// Everything that could still hide, as lines of a table.
pub(super) fn certificate(explanation: &Explanation) -> Vec<String> {
    let mut lines = Vec::new();
    for (sensor, bounds) in certified(explanation) {
        lines.push(format!("{sensor}:"));
        for it in &bounds {
            if let Some(value) = bound(it) {
                lines.push(format!("  {}: {value}, which adds {}", bounded(it), adds(it)));
            }
        }
        lines.extend(
            bounds.iter().filter_map(|it| Some(format!("  {}: {}", bounded(it), it.because.as_ref()?))),
        );
    }
    lines
}
