//! Results in plain words.
use std::fmt::Write;

use super::fly::Answer;
use crate::flight::Summary;
use crate::flight::summary::{FilterSummary, IdentificationSummary, NoiseSummary};

const ARC_SECONDS: f64 = 180.0 / std::f64::consts::PI * 3600.0;
const DEGREES_PER_HOUR: f64 = ARC_SECONDS;
const MICRO_G: f64 = 1e6 / 9.80665;

/// A value in the unit in which people speak of it.
pub(super) fn spoken(value: f64, unit: &str) -> (f64, &'static str) {
    match unit {
        "rad" => (value * ARC_SECONDS, "arc seconds"),
        "rad/s" => (value * DEGREES_PER_HOUR, "deg/h"),
        "m/s^2" => (value * MICRO_G, "ug"),
        _ => (value, "m/s"),
    }
}

/// A flight.
pub(super) fn flight(answer: &Answer) -> String {
    let mut text = String::new();
    let title =
        if answer.title.is_empty() { answer.case.display().to_string() } else { answer.title.clone() };
    put(&mut text, format_args!("{title} (on {})", answer.on));
    for summary in &answer.channels {
        channel(&mut text, summary);
    }
    if !answer.files.is_empty() {
        put(&mut text, format_args!("written:"));
        for path in &answer.files {
            put(&mut text, format_args!("  {}", path.display()));
        }
    }
    text
}

/// Adds a line.
pub(super) fn put(text: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing into a string cannot fail.
    let _ = writeln!(text, "{line}");
}

fn channel(text: &mut String, summary: &Summary) {
    put(text, format_args!("{}: {} steps of {} s", summary.channel, summary.steps, summary.step_s));
    if let Some(it) = &summary.filter {
        measurements(text, it);
        consistency(text, "", it);
        for state in &it.end {
            let (value, unit) = spoken(state.estimate, state.unit);
            let (sigma, _) = spoken(state.sigma, state.unit);
            put(
                text,
                format_args!("  at the end: {:<20} {value:.4} ± {sigma:.4} {unit} (1 sigma)", state.state),
            );
        }
    }
    if let Some(it) = &summary.filter_since_retuning {
        consistency(text, "since the last retuning: ", it);
    }
    if let Some(it) = &summary.identification {
        identification(text, it);
    }
    if let Some(it) = &summary.gyros {
        let faults: Vec<_> = it.verdicts.iter().filter(|change| change.verdict != "no_fault").collect();
        if faults.is_empty() {
            put(text, format_args!("  five gyros: no fault"));
        }
        for change in faults.iter().take(10) {
            let what = match (&change.gyro, change.verdict) {
                (Some(gyro), _) => format!("{gyro} has failed"),
                (None, "detected") => "a fault, not yet which gyro".to_owned(),
                (None, _) => "block not to be trusted".to_owned(),
            };
            put(text, format_args!("  five gyros: {:.0} s: {what}", change.time_s));
        }
        if faults.len() > 10 {
            put(text, format_args!("  five gyros: {} more changes", faults.len() - 10));
        }
        if let (Some(gyro), Some(size), Some(sigma)) = (&it.excluded, it.fault_size, it.fault_sigma) {
            let (size, sigma) = (size * DEGREES_PER_HOUR, sigma * DEGREES_PER_HOUR);
            put(text, format_args!("  five gyros: fault of {gyro}: {size:.4} ± {sigma:.4} deg/h (1 sigma)"));
        }
    }
    if let Some(truth) = &summary.truth {
        put(text, format_args!("  against the truth from {:.0} s on:", truth.from_s));
        for state in &truth.states {
            let (rmse, unit) = spoken(state.rmse, state.unit);
            put(
                text,
                format_args!(
                    "    {:<20} rms error {rmse:.4} {unit}, beyond 3 sigma {:.2} %, mean (error/sigma)^2 {:.2}",
                    state.state,
                    100.0 * state.beyond_three_sigma,
                    state.nees
                ),
            );
        }
    }
}

fn measurements(text: &mut String, it: &FilterSummary) {
    put(
        text,
        format_args!(
            "  measurements: {} used, {} missing, {} beyond the gate ({:.2} %), {} refused; {} upsets",
            it.used,
            it.missing,
            it.gated,
            100.0 * it.gated_share,
            it.refused,
            it.upsets
        ),
    );
}

fn consistency(text: &mut String, when: &str, it: &FilterSummary) {
    let (mean, sigma) = (it.innovation_mean, it.innovation_mean_sigma);
    put(text, format_args!("  {when}innovation: mean {mean:.5} ± {sigma:.5} m/s (1 sigma)"));
    let [low, high] = it.nis.interval;
    let verdict = if (low..=high).contains(&it.nis.mean) { "consistent" } else { "not consistent" };
    put(
        text,
        format_args!(
            "  {when}NIS: mean {:.3}, expected {low:.3} to {high:.3} (95 %): {verdict}",
            it.nis.mean
        ),
    );
    let white = if it.whiteness.p_value >= 0.05 { "white" } else { "not white" };
    put(
        text,
        format_args!(
            "  {when}whiteness: Ljung-Box Q = {:.1} over {} lags, p = {:.3e}: {white}",
            it.whiteness.statistic, it.whiteness.lags, it.whiteness.p_value
        ),
    );
}

fn identification(text: &mut String, it: &IdentificationSummary) {
    for (name, noise, unit) in [("accelerometer", &it.accelerometer, "m/s^2"), ("gyro", &it.gyro, "rad/s")] {
        put(text, format_args!("  noise in use: {name} {}", noise_line(noise, unit)));
    }
    let times: Vec<String> = it.retuned_at_s.iter().map(|t| format!("{t:.0}")).collect();
    if times.is_empty() {
        put(text, format_args!("  never retuned"));
    } else {
        put(text, format_args!("  retuned at {} s", times.join(", ")));
    }
}

/// Noise in one line.
pub(super) fn noise_line(noise: &NoiseSummary, unit: &str) -> String {
    let (sigma, spoken_unit) = spoken(noise.sigma, unit);
    let cosine = if noise.beta > 0.0 {
        format!(", period {:.0} s", std::f64::consts::TAU / noise.beta)
    } else {
        String::new()
    };
    let status = noise.status.replace('_', " ");
    format!("sigma {sigma:.4} {spoken_unit}, tau {:.0} s{cosine} ({status})", noise.tau_s)
}
