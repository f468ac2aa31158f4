//! The first screen of the page: one paragraph, one picture, one table.
use maud::{Markup, html};

use super::charts::Chart;
use super::number::duration;
use super::page::{plot, table};
use super::{Report, told, words};

/// Rows of the table; the others stand below.
const ROWS: usize = 5;

/// Title, what was recorded, and the buttons of all plots.
pub(super) fn top(report: &Report, title: &str) -> Markup {
    let recorded = &report.recorded;
    html! {
        header.top {
            h1 { (title) }
            p.meta {
                (recorded.case) ": " (duration(recorded.length_s)) " in steps of " (recorded.step_s) " s, "
                (recorded.sensors.len()) @if recorded.sensors.len() == 1 { " sensor" } @else { " sensors" }
                @if recorded.rows_in_gaps > 0 { ", " (recorded.rows_in_gaps) " of " (recorded.rows) " rows in gaps" }
            }
            p.verdict {
                strong { (words::heading(report.explanation.verdict)) "." } " " (told::paragraph(report))
            }
        }
        noscript { p.flag { "The plots need JavaScript. Findings and tables are complete without it." } }
    }
}

/// The picture of the main finding's sensor and the table of findings.
pub(super) fn screen(report: &Report, charts: &[Vec<Chart>]) -> Markup {
    html! {
        nav.bar aria-label="View" {
            fieldset.views {
                legend { "Plots show" }
                @for (value, label) in [("before", "before"), ("after", "after"), ("both", "both")] {
                    label { input type="radio" name="view" value=(value) checked[value == "both"]; span { (label) } }
                }
            }
            button #theme type="button" aria-pressed="false" { "Dark" }
        }
        (picture(report, charts))
        (rows(report))
    }
}

/// The first plot of the sensor that the paragraph is of: the mismatch before and after, and what is explained of it.
fn picture(report: &Report, charts: &[Vec<Chart>]) -> Markup {
    let sensors = &report.evidence.sensors;
    let main = told::main_finding(&report.explanation);
    let sensor_index = main.and_then(|main| {
        let index = report.explanation.findings.iter().position(|it| std::ptr::eq(it, main))?;
        let adds = sensors.iter().position(|sensor| sensor.findings.contains(&index));
        adds.or_else(|| sensors.iter().position(|sensor| sensor.sensor == main.sensor))
    });
    let sensor_index = sensor_index.unwrap_or_default();
    let first: usize = charts.iter().take(sensor_index).map(Vec::len).sum();
    let chart = charts.get(sensor_index).and_then(|own| own.first());
    html! {
        @if let (Some(sensor), Some(chart)) = (sensors.get(sensor_index), chart) {
            section.lead aria-label={ (sensor.sensor) ", before and after" } {
                figure {
                    p.whose { (sensor.sensor) }
                    (plot(first, chart))
                    figcaption { strong { (chart.summary) } }
                }
            }
        }
    }
}

fn rows(report: &Report) -> Markup {
    let rows = told::rows(&report.explanation);
    if rows.is_empty() {
        return html! {};
    }
    html! {
        section.lead aria-label="Findings in a table" {
            (table(&["Sensor", "Effect", "Value ± 1 σ", "Probability", "Share"], &html! {
                @for row in rows.iter().take(ROWS) {
                    tr {
                        th scope="row" { (row.finding.sensor) }
                        td.effect {
                            code { (row.finding.effect) }
                            @if let Some(rivals) = &row.rivals { " " span.rivals { (rivals) } }
                        }
                        td data-label="Value" { (row.value) }
                        td data-label="Probability" { (row.probability) }
                        td data-label="Share" { (row.share) }
                    }
                }
            }))
            @if rows.len() > ROWS { p.hint { (rows.len() - ROWS) " more below." } }
        }
    }
}
