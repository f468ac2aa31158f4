//! The identification as figures: Allan deviation and autocorrelation of each sensor.

use super::report::{Identification, SensorIdentification};
use crate::output::file_name;
use crate::plot::{Colour, Figure, Panel};

/// One figure for each sensor, with the name of its file.
pub fn all(identification: &Identification) -> Vec<(String, Figure)> {
    identification
        .sensors
        .iter()
        .map(|sensor| {
            let panels = vec![allan(sensor), autocorrelation(sensor)];
            (
                format!("{}_noise", file_name(&sensor.id)),
                Figure { title: format!("{}: noise", sensor.id), panels },
            )
        })
        .collect()
}

/// Allan deviation with its 68 % band and what the fits say of it, on logarithmic axes.
fn allan(sensor: &SensorIdentification) -> Panel {
    let in_unit = |deviation: f64| (deviation / sensor.written_unit_in_si).log10();
    let x: Vec<f64> = sensor.allan.iter().map(|point| point.point.tau_s.log10()).collect();
    let curve = |value: &dyn Fn(&super::report::AllanReport) -> f64| -> Vec<f64> {
        sensor.allan.iter().map(|point| in_unit(value(point))).collect()
    };
    let label = format!("log₁₀ of Allan deviation, {}", sensor.written_unit);
    let lower = curve(&|point| point.point.lower);
    let upper = curve(&|point| point.point.upper);
    Panel::new("log₁₀ of averaging time, s", &label)
        .band("68 %", &x, lower, upper, Colour::Sky)
        .line("measured", &x, curve(&|point| point.point.deviation), Colour::Blue)
        .line("power laws", &x, curve(&|point| point.power_laws.unwrap_or(f64::NAN)), Colour::Orange)
        .line("structure found", &x, curve(&|point| point.structure.unwrap_or(f64::NAN)), Colour::Green)
}

fn autocorrelation(sensor: &SensorIdentification) -> Panel {
    let found = &sensor.autocorrelation;
    let x: Vec<f64> = (0..found.correlation.len()).map(|lag| lag as f64 * found.step_s).collect();
    let variance = found.covariance.first().copied().unwrap_or(f64::NAN);
    let model: Vec<f64> = found.model.iter().map(|value| value / variance).collect();
    // Lag zero holds the white part; the rest would be flat beneath it.
    let tail = |values: &[f64]| values.iter().skip(1).copied().collect::<Vec<f64>>();
    let panel = Panel::new("lag, s", "autocorrelation (lag 0 = 1, not shown)").line(
        "measured",
        &tail(&x),
        tail(&found.correlation),
        Colour::Blue,
    );
    if model.is_empty() {
        panel
    } else {
        panel.line("structure found", &tail(&x), tail(&model), Colour::Green)
    }
}
