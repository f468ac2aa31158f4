//! The comparison of two records as text: a row a case where they differ, then the counts.
use std::fmt::Write;

use super::compare::{Comparison, Rate, Time};

/// For the terminal and for a page alike.
pub fn text(it: &Comparison) -> String {
    let mut text = format!("A: {}\nB: {}\n", it.names[0], it.names[1]);
    // Writing into a string cannot fail.
    let _ = writeln!(
        text,
        "{} cases in both; {} only in A, {} only in B; they differ in {}\n",
        it.cases,
        it.alone[0],
        it.alone[1],
        it.differences.len()
    );
    if !it.differences.is_empty() {
        text.push_str("| case | concealed (nats) | A | B |\n| --- | --- | --- | --- |\n");
    }
    for row in &it.differences {
        let truth = row.truth.as_deref().unwrap_or("-");
        let _ = writeln!(text, "| {} | {truth} | {} | {} |", row.case, row.said[0], row.said[1]);
    }
    let _ = writeln!(
        text,
        "\n| {:<43} | {:<31} | {:<31} |\n| --- | --- | --- |",
        "share (95 %, Wilson)", "A", "B"
    );
    for figure in it.figures.iter().filter(|figure| figure.rates.iter().any(|rate| rate.of > 0)) {
        let [a, b] = figure.rates.map(rate);
        let _ = writeln!(text, "| {:<43} | {a:<31} | {b:<31} |", figure.name);
    }
    let [a, b] = it.times.map(time);
    let _ = writeln!(text, "| {:<43} | {a:<31} | {b:<31} |", "processor seconds: sum, median, most");
    text
}

fn rate(rate: Rate) -> String {
    if rate.of == 0 {
        return "-".to_owned();
    }
    let [low, high] = rate.interval;
    let share = rate.hits as f64 / rate.of as f64;
    format!("{} of {}: {share:.3} ({low:.3} to {high:.3})", rate.hits, rate.of)
}

fn time(time: Time) -> String {
    format!("{:.1}, {:.2}, {:.1}", time.sum_s, time.median_s, time.most_s)
}

#[cfg(test)]
mod tests {
    use super::super::super::engine::Engine;
    use super::super::compare::compare;
    use super::super::record::{Record, Row, tests::header};
    use super::*;

    #[test]
    fn a_difference_is_a_row() {
        let row = |failure: Option<&str>| Row {
            case: "7".into(),
            failure: failure.map(str::to_owned),
            processor_s: 1.0,
            ..Row::default()
        };
        let of = |row: Row| [Record { header: header(Engine::First), rows: vec![row] }];
        let text = text(&compare(&of(row(None)), &of(row(Some("no memory")))));
        assert!(text.contains("| small 1 7 | - | nothing | failed: no memory |"), "{text}");
        assert!(text.contains("1 of 1: 1.000 (0.207 to 1.000)"), "{text}");
    }
}
