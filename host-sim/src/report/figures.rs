//! An explanation as figures in files: for each sensor what is explained, and what shows that it holds.
use schuler_explain::diagnostics::{Dependence, SensorEvidence};

use super::Report;
use super::number::printed_unit;
use crate::output::file_name;
use crate::plot::{Colour, Figure, Layer, Panel};

/// Two figures for each sensor, and one for each finding against its cause.
pub(super) fn all(report: &Report) -> Vec<(String, Figure)> {
    let mut figures = Vec::new();
    for sensor in &report.evidence.sensors {
        let name = file_name(&sensor.sensor);
        figures.push((format!("{name}_explained"), explained(report, sensor)));
        figures.push((format!("{name}_whiteness"), whiteness(sensor)));
        for it in &sensor.dependences {
            let effect = report.explanation.findings.get(it.finding).map_or("effect", |found| &found.effect);
            let title = format!("{}: {effect} against {}", sensor.sensor, it.cause.name);
            let figure = Figure { title, panels: vec![dependence(sensor, it)] };
            let effect = file_name(&effect.replace(' ', "_"));
            figures.push((format!("{name}_{}_{effect}", it.finding + 1), figure));
        }
    }
    figures
}

fn explained(report: &Report, sensor: &SensorEvidence) -> Figure {
    let x: Vec<f64> = report.evidence.time_s.iter().map(|time| time / 3600.0).collect();
    let in_unit = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| v / sensor.unit.in_si()).collect() };
    let unit = printed_unit(sensor.unit.name());
    let mut before = Panel::new("time, h", &format!("residual, {unit}"))
        .line("recorded − simulated", &x, in_unit(&sensor.residual), Colour::Red)
        .line("explained", &x, in_unit(&sensor.explained), Colour::Green);
    let after = Panel::new("time, h", &format!("remainder, {unit}")).line(
        "remainder",
        &x,
        in_unit(&sensor.remainder),
        Colour::Blue,
    );
    let held_out = |panel: Panel| {
        report.evidence.held_out_s.iter().flatten().enumerate().fold(panel, |panel, (k, edge)| {
            let label = if k == 0 { "held out between" } else { "" };
            panel.with(Layer::Vertical { label: label.into(), x: edge / 3600.0, colour: Colour::Grey })
        })
    };
    for finding in sensor.findings.iter().filter_map(|k| report.explanation.findings.get(*k)) {
        let inside = |edge: &&f64| **edge > 0.0 && **edge < 0.999 * report.recorded.length_s;
        for edge in finding.interval_s.iter().filter(inside) {
            let label = finding.effect.clone();
            before = before.with(Layer::Vertical { label, x: edge / 3600.0, colour: Colour::Orange });
        }
    }
    Figure {
        title: format!("{}: before and after the findings", sensor.sensor),
        panels: vec![held_out(before), held_out(after)],
    }
}

fn whiteness(sensor: &SensorEvidence) -> Figure {
    let correlation = &sensor.autocorrelation;
    let (before, after) = (&correlation.before, &correlation.after);
    let below = before.band.iter().map(|value| -value).collect();
    let lags = Panel::new("lag, s", "correlation of innovations")
        .band("95 % of white noise", &before.lag_s, below, before.band.clone(), Colour::Grey)
        .line("before", &before.lag_s, before.correlation.clone(), Colour::Red)
        .line("after", &after.lag_s, after.correlation.clone(), Colour::Blue);
    let spectrum = &sensor.whiteness;
    let (before, after) = (&spectrum.before, &spectrum.after);
    let log = |values: &[f64]| -> Vec<f64> { values.iter().map(|value| value.log10()).collect() };
    let (x, x_after) = (log(&before.frequency_hz), log(&after.frequency_hz));
    let power = Panel::new("log₁₀ of frequency, Hz", "log₁₀ of power, white = 0")
        .band("95 % of white noise", &x, log(&before.low), log(&before.high), Colour::Grey)
        .line("before", &x, log(&before.power), Colour::Red)
        .line("after", &x_after, log(&after.power), Colour::Blue);
    Figure { title: format!("{}: innovations", sensor.sensor), panels: vec![lags, power] }
}

fn dependence(sensor: &SensorEvidence, it: &Dependence) -> Panel {
    let si = sensor.unit.in_si();
    let column = |of: &dyn Fn(&schuler_explain::diagnostics::Bin) -> f64| -> Vec<f64> {
        it.bins.iter().map(|bin| of(bin) / si).collect()
    };
    let x: Vec<f64> = it.bins.iter().map(|bin| bin.cause).collect();
    let label = format!("{}, {}", it.cause.name, printed_unit(&it.cause.unit));
    Panel::new(&label, &format!("residual less other findings, {}", printed_unit(sensor.unit.name())))
        .band(
            "mean ± 2 σ, before",
            &x,
            column(&|bin| bin.residual - 2.0 * bin.sigma),
            column(&|bin| bin.residual + 2.0 * bin.sigma),
            Colour::Orange,
        )
        .band(
            "mean ± 2 σ, after",
            &x,
            column(&|bin| bin.residual - bin.explained - 2.0 * bin.sigma),
            column(&|bin| bin.residual - bin.explained + 2.0 * bin.sigma),
            Colour::Sky,
        )
        .line("effect found", &x, column(&|bin| bin.explained), Colour::Green)
}
