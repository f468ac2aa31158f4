//! A campaign's results as text, Markdown and a figure.
use std::fmt::Write;

use super::plan::Bars;
use super::score::CaseScore;
use super::summary::{FamilySummary, Figure, Standing, Summary, logistic};
use crate::plot::{Colour, Figure as Plot, Layer, Panel};

/// Bins of the gain in the figure.
const BINS: usize = 12;
/// Points of a curve.
const CURVE: usize = 200;

fn family_name(it: &FamilySummary) -> String {
    it.family
        .and_then(|family| serde_json::to_value(family).ok())
        .and_then(|value| value.as_str().map(str::to_owned))
        .unwrap_or_else(|| "all".to_owned())
}

fn standing(figure: &Figure) -> &'static str {
    match figure.standing {
        Standing::Reached => "reached",
        Standing::Open => "open",
        Standing::Missed => "MISSED",
        Standing::Unknown => "-",
    }
}

fn number(value: f64) -> String {
    if value.is_nan() {
        "-".to_owned()
    } else if value.is_infinite() {
        if value > 0.0 { "inf" } else { "-inf" }.to_owned()
    } else {
        format!("{value:.3}")
    }
}

/// A row of a table of figures: name, value, interval, count, bar, standing.
fn row(figure: &Figure) -> [String; 6] {
    [
        figure.name.clone(),
        number(figure.value),
        format!("{} .. {}", number(figure.interval[0]), number(figure.interval[1])),
        figure.count.to_string(),
        format!("{} {}", if figure.at_least { ">=" } else { "<=" }, (figure.bar * 1e3).round() / 1e3),
        standing(figure).to_owned(),
    ]
}

/// For the terminal.
pub fn text(summary: &Summary) -> String {
    let mut text = String::new();
    for family in &summary.families {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{} ({} cases)", family_name(family), family.cases);
        for figure in family.figures.iter().filter(|f| f.standing != Standing::Unknown) {
            let [name, value, interval, count, bar, standing] = row(figure);
            let _ = writeln!(
                text,
                "  {name:<42} {value:>9}  [{interval:<16}]  n {count:<5} bar {bar:<8} {standing}"
            );
        }
    }
    let [located, claimed] = &summary.outside;
    if located.of > 0 {
        let _ = writeln!(
            text,
            "in no catalogue ({} cases): right sensor {:.2}, explained by a known effect {:.2}",
            located.of, located.share, claimed.share
        );
    }
    if summary.failures.hits > 0 {
        let _ = writeln!(text, "{} of {} explanations failed", summary.failures.hits, summary.failures.of);
    }
    text
}

/// As Markdown, with the figure beside it.
pub fn markdown(title: &str, seed: u64, summary: &Summary, picture: &str) -> String {
    let mut text = format!(
        "# {title}\n\nSeed {seed}. Intervals are exact for shares (Clopper and Pearson).\n\n![Detection against the oracle's gain]({picture})\n"
    );
    for family in &summary.families {
        let _ = write!(
            text,
            "\n## {} ({} cases)\n\n| figure | value | interval | n | bar | |\n| --- | --- | --- | --- | --- | --- |\n",
            family_name(family),
            family.cases
        );
        for figure in family.figures.iter().filter(|f| f.standing != Standing::Unknown) {
            let _ = writeln!(text, "| {} |", row(figure).join(" | "));
        }
    }
    let _ = write!(
        text,
        "\n## By effect\n\n| effect | right where the oracle gains enough | found at any gain |\n| --- | --- | --- |\n"
    );
    for it in &summary.effects {
        let _ = writeln!(
            text,
            "| `{}` | {} of {} | {} of {} |",
            it.effect, it.right.hits, it.right.of, it.found.hits, it.found.of
        );
    }
    let [located, claimed] = &summary.outside;
    let _ = write!(
        text,
        "\n## In no catalogue\n\nRight sensor: {} of {}. Claimed to be explained by a known effect: {} of {}.\n",
        located.hits, located.of, claimed.hits, claimed.of
    );
    text
}

/// Detection against the oracle's gain: shares in bins with their intervals, and the logistic fit.
pub fn picture(title: &str, scores: &[CaseScore], bars: &Bars) -> Plot {
    let points: Vec<(f64, bool)> = scores
        .iter()
        .flat_map(|s| &s.effects)
        .filter(|e| e.gain_nats.is_finite())
        .map(|e| (e.gain_nats.clamp(0.1, 1e5).log10(), e.found))
        .collect();
    let low = points.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let mut panel = Panel::new("log10 of the oracle's gain, nats", "share found");
    panel.y_range = Some((-0.02, 1.02));
    if points.is_empty() || high <= low {
        return Plot { title: title.to_owned(), panels: vec![panel] };
    }
    let width = (high - low) / BINS as f64;
    let (mut x, mut share, mut lower, mut upper) = (vec![], vec![], vec![], vec![]);
    for bin in 0..BINS {
        let from = low + width * bin as f64;
        let last = bin + 1 == BINS;
        let own: Vec<bool> =
            points.iter().filter(|p| p.0 >= from && (p.0 < from + width || last)).map(|p| p.1).collect();
        if own.is_empty() {
            continue;
        }
        let it = super::summary::Share::new(own.iter().filter(|f| **f).count(), own.len(), bars.confidence);
        x.push(from + 0.5 * width);
        share.push(it.share);
        lower.push(it.interval[0]);
        upper.push(it.interval[1]);
    }
    let panel = panel.band("interval", &x, lower, upper, Colour::Sky).line("share", &x, share, Colour::Blue);
    let panel = match logistic(&points) {
        Some(([a, b], _)) if b > 0.0 => {
            let at: Vec<f64> = (0..=CURVE).map(|k| low + (high - low) * k as f64 / CURVE as f64).collect();
            let curve = at.iter().map(|x| 1.0 / (1.0 + (-a - b * x).exp())).collect();
            panel.line("logistic fit", &at, curve, Colour::Red)
        }
        _ => panel,
    };
    let bar = bars.half_nats.log10();
    let panel = panel
        .with(Layer::Vertical { label: "bar of half".into(), x: bar, colour: Colour::Grey })
        .with(Layer::Horizontal { label: String::new(), y: 0.5, colour: Colour::Grey });
    Plot { title: title.to_owned(), panels: vec![panel] }
}
