//! The explanation as one HTML page: findings first, then the evidence.
//!
//! Everything that comes from the user's files passes through maud, which escapes it, or through JSON in which `<` is
//! escaped. The page's policy forbids it every connection.
use maud::{DOCTYPE, Markup, PreEscaped, html};
use schuler_explain::catalogue::named;
use schuler_explain::explanation::{BeforeAfter, Finding, Fit, Goodness};

use super::charts::{self, Chart};
use super::number::{plain, probability};
use super::{Report, folded, lead, told, words};
use crate::plot::printable;

const PLOT_SCRIPT: &str = include_str!("assets/uPlot.iife.min.js");
const PLOT_STYLE: &str = include_str!("assets/uPlot.min.css");
const PLOT_LICENCE: &str = include_str!("assets/uPlot.LICENSE");
const SCRIPT: &str = include_str!("assets/report.js");
const STYLE: &str = include_str!("assets/report.css");
/// No connection to anywhere; scripts and styles of the page alone.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; \
                      form-action 'none'";

/// A figure of merit and how it is written.
type Figure = (&'static str, fn(&Goodness) -> String);

/// The page.
pub(super) fn html(report: &Report) -> String {
    let charts = charts::of_sensors(report);
    let title = if report.title.is_empty() { &report.recorded.case } else { &report.title };
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta name="generator" content={ "schuler " (env!("CARGO_PKG_VERSION")) };
                title { (title) " – explained" }
                style { (PreEscaped(PLOT_STYLE)) (PreEscaped(STYLE)) }
            }
            body {
                a.skip href="#findings" { "To the findings" }
                (lead::top(report, title))
                main {
                    (lead::screen(report, &charts))
                    (findings(report))
                    (better(&report.explanation.fit))
                    (located(report))
                    (left_over(report))
                    (folded::noise(&report.explanation))
                    (folded::certificate(&report.explanation))
                    (evidence(report, &charts))
                    (about(report))
                }
                script type="application/json" id="charts" { (PreEscaped(embedded(&charts))) }
                script { (PreEscaped(PLOT_SCRIPT)) }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    printable(page.into_string())
}

/// JSON that cannot end the element it stands in.
fn embedded(charts: &[Vec<Chart>]) -> String {
    let flat: Vec<&Chart> = charts.iter().flatten().collect();
    // Numbers, strings and lists of them can always be written.
    serde_json::to_string(&flat).unwrap_or_else(|_| "[]".to_owned()).replace('<', "\\u003c")
}

fn findings(report: &Report) -> Markup {
    let all = &report.explanation.findings;
    html! {
        section #findings aria-labelledby="findings-title" {
            h2 #findings-title { "Findings" }
            @if all.is_empty() { p { (words::verdict(report.explanation.verdict)) } }
            @for (index, it) in all.iter().enumerate().filter(|(_, it)| !words::is_noise(it)) {
                (finding(report, index, it))
            }
            @if all.iter().any(words::is_noise) {
                h3.noise { (words::NOISE.trim_end_matches(':')) }
                @for (index, it) in all.iter().enumerate().filter(|(_, it)| words::is_noise(it)) {
                    (finding(report, index, it))
                }
            }
        }
    }
}

fn finding(report: &Report, index: usize, it: &Finding) -> Markup {
    // A finding of the noise adds to no sensor.
    let sensors = &report.evidence.sensors;
    let shown = sensors.iter().position(|sensor| sensor.findings.contains(&index));
    let shown = shown.or_else(|| sensors.iter().position(|sensor| sensor.sensor == it.sensor));
    html! {
        details.finding {
            summary { (words::finding(it, report.recorded.length_s)) }
            @if let Some(warning) = words::implausible(it) { p.flag role="note" { (warning) } }
            dl {
                dt { "Left out" }
                dd {
                    code { (it.effect) }
                    @if let Some(effect) = named(&it.effect) { " – " (effect.formula) }
                }
                dt { "Evidence" }
                dd {
                    "probability " (words::sure(it.evidence.p_value)) ", log odds " (plain(it.evidence.gain_nats, 3)) " nats"
                    @if let Some(share) = it.share { ", " (told::shared(share)) " of the mismatch" }
                }
                @if let Some(impact) = &it.impact {
                    dt { "Left uncorrected" }
                    dd { "a navigation solution is " (told::impact(impact)) }
                }
            }
            @if !it.parameters.is_empty() {
                (table(&["Parameter", "Value ± 1 σ", "Plausible"], &html! {
                    @for parameter in &it.parameters {
                        tr {
                            th scope="row" { (words::name_of(&parameter.name)) }
                            td { (words::value(parameter)) }
                            td {
                                @match parameter.plausible {
                                    Some(true) => "yes",
                                    Some(false) => { strong.no { "no" } },
                                    None => "not known",
                                }
                            }
                        }
                    }
                }))
            }
            @if !it.rivals().is_empty() {
                h4 { "What else it may be" }
                ul {
                    @for told in words::rival_words(it.rivals()) {
                        li {
                            strong { (told.what) } ": " (told.how_likely) "."
                            @if !told.experiment.is_empty() { " " em { "To tell them apart:" } " " (told.experiment) }
                        }
                    }
                }
            }
            @if let Some(sensor) = shown { p { a href={ "#sensor-" (sensor) } { "See the evidence" } } }
        }
    }
}

/// A table that can be scrolled to its sides.
pub(super) fn table(heads: &[&str], rows: &Markup) -> Markup {
    html! {
        div.table tabindex="0" role="region" aria-label=(heads.join(", ")) {
            table {
                thead { tr { @for head in heads { th scope="col" { (head) } } } }
                tbody { (rows) }
            }
        }
    }
}

fn better(fit: &Fit) -> Markup {
    let Some(sentence) = words::held_out(&fit.held_out) else { return html! {} };
    let figures: [Figure; 4] = [
        ("−log-likelihood, nats per sample", |it| format!("{:.4}", it.nll_per_sample)),
        ("error of prediction, nominal σ", |it| plain(it.rmse, 3)),
        ("normalised innovation squared (1 is right)", |it| plain(it.nis_mean, 3)),
        ("whiteness (Ljung–Box; above 0.05 is white)", |it| probability(it.whiteness_p)),
    ];
    let cells = |it: &BeforeAfter, of: fn(&Goodness) -> String| {
        html! { td { (of(&it.before)) } td { (of(&it.after)) } }
    };
    html! {
        section aria-labelledby="better-title" {
            h2 #better-title { "How much better it predicts" }
            p { (sentence) }
            (table(&["", "held out, before", "held out, after", "fitted, before", "fitted, after"], &html! {
                @for (name, of) in figures {
                    tr { th scope="row" { (name) } (cells(&fit.held_out, of)) (cells(&fit.train, of)) }
                }
            }))
        }
    }
}

fn located(report: &Report) -> Markup {
    let all = &report.explanation.located;
    html! {
        section aria-labelledby="located-title" {
            h2 #located-title { "Where they differ" }
            @if all.is_empty() {
                p { "No test found a place where the recording differs from its simulation." }
            } @else {
                p { "Before anything is named; p-values are corrected for the number of tests." }
                ul { @for it in words::foremost(all) { li { (words::located(it)) } } }
                @if all.len() > words::LOCATED {
                    details {
                        summary { "All " (all.len()) }
                        ul { @for it in all { li { (words::located(it)) } } }
                    }
                }
            }
        }
    }
}

fn left_over(report: &Report) -> Markup {
    let Some(remainder) = &report.explanation.remainder else { return html! {} };
    html! {
        section aria-labelledby="left-title" {
            h2 #left-title { "What is left over" }
            p { (words::remainder(remainder)) }
        }
    }
}

fn evidence(report: &Report, charts: &[Vec<Chart>]) -> Markup {
    let firsts = charts.iter().scan(0, |next, of_sensor| {
        let first = *next;
        *next += of_sensor.len();
        Some(first)
    });
    html! {
        section aria-labelledby="evidence-title" {
            h2 #evidence-title { "Evidence" }
            @if charts.iter().all(Vec::is_empty) { p { "There is nothing to plot." } } @else {
                p.hint {
                    "Drag across a plot to look closer, double-click to see all of it. With the keyboard: arrows move \
                     the read-out, + and − zoom, 0 shows all. On a touch screen: one finger reads, two zoom."
                }
            }
            @for (index, ((sensor, of_sensor), first)) in
                report.evidence.sensors.iter().zip(charts).zip(firsts).enumerate()
            {
                details.sensor id={ "sensor-" (index) } {
                    summary { (sensor.sensor) ": " (of_sensor.len()) " plots" }
                    div.plots {
                        @for (place, chart) in of_sensor.iter().enumerate() { (figure(first + place, chart)) }
                    }
                }
            }
        }
    }
}

fn figure(index: usize, chart: &Chart) -> Markup {
    html! {
        figure {
            h4 { (chart.title) }
            (plot(index, chart))
            div.tools {
                @for (act, sign, label) in [
                    ("in", "+", "Zoom in"),
                    ("out", "−", "Zoom out"),
                    ("left", "←", "Move left"),
                    ("right", "→", "Move right"),
                    ("all", "all", "Show all"),
                ] {
                    button type="button" data-act=(act) aria-label=(label) title=(label) { (sign) }
                }
            }
            figcaption { (chart.caption) " " strong { (chart.summary) } }
        }
    }
}

/// The place of a plot, with what it shows for those who do not see it.
pub(super) fn plot(index: usize, chart: &Chart) -> Markup {
    html! {
        div.plot data-chart=(index) tabindex="0" role="group"
            aria-label={ (chart.title) ": " (chart.y_label) " over " (chart.x_label) ". " (chart.summary) } {}
    }
}

fn about(report: &Report) -> Markup {
    html! {
        section aria-labelledby="about-title" {
            h2 #about-title { "Notes" }
            ul {
                @for note in &report.explanation.notes { li { (note) } }
                li {
                    "Residual: recorded output less what the case's nominal model predicts. Innovation: what a reading \
                     adds to its prediction from all earlier ones. Before: with the noise fitted and no finding; after: \
                     with the findings and the noise fitted beside them."
                }
                li { "Long series are drawn as the smallest and largest value of each of 2000 stretches of time." }
            }
            details {
                summary { "Made by schuler " (env!("CARGO_PKG_VERSION")) ", drawn with uPlot" }
                pre { (PLOT_LICENCE) }
            }
        }
    }
}
