//! Results in plain words.
use std::fmt::Write;

use schuler_recording::error::rounded;

use super::fly::Answer;
use crate::flight::Summary;
use crate::flight::summary::{
    CompensationSummary, FilterSummary, HealthSummary, IdentificationSummary, NoiseSummary,
    ThermometerSummary,
};

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
    put(text, format_args!("{}: {} steps of {} s", summary.channel, summary.steps, rounded(summary.step_s)));
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
    for it in &summary.thermometers {
        thermometer(text, it);
    }
    if let Some(it) = &summary.compensation {
        compensation(text, it);
    }
    if let Some(it) = &summary.health {
        health(text, it);
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

fn thermometer(text: &mut String, it: &ThermometerSummary) {
    let [low, high] = it.temperature;
    let rate = match (it.rate, it.settled_s) {
        (Some([least, greatest]), Some(from)) => {
            let [least, greatest] = [least, greatest].map(|rate| rate * 3600.0);
            format!("rate {least:.2} to {greatest:.2} degC/h, settled from {from:.0} s on")
        }
        _ => "rate never settled".to_owned(),
    };
    let used = 100.0 * it.used_share;
    put(
        text,
        format_args!(
            "  {}: {low:.2} to {high:.2} degC, {rate}; {used:.1} % of the steps with a reading",
            it.column
        ),
    );
}

fn compensation(text: &mut String, it: &CompensationSummary) {
    put(
        text,
        format_args!(
            "  compensation by block {}: inputs missing in {} steps, out of range in {}, limited in {}",
            it.checksum, it.inputs_missing, it.out_of_range, it.limited
        ),
    );
    for sensor in &it.sensors {
        let (mean, unit) = spoken(sensor.mean, sensor.unit);
        let (deviation, _) = spoken(sensor.deviation, sensor.unit);
        put(
            text,
            format_args!(
                "    {:<20} mean {mean:.4} {unit}, standard deviation {deviation:.4} {unit} taken off",
                sensor.sensor
            ),
        );
    }
    let [(accelerometer, _), (gyro, _)] =
        [spoken(it.loop_errors[0], "m/s^2"), spoken(it.loop_errors[1], "rad/s")];
    put(
        text,
        format_args!(
            "    velocity channel: {:.4} m/s, {accelerometer:.3} ug, {gyro:.4} deg/h rms taken off",
            it.velocity
        ),
    );
}

fn health(text: &mut String, it: &HealthSummary) {
    let shares: Vec<String> = it
        .shares
        .iter()
        .map(|(name, share)| format!("{} {:.1} %", name.replace('_', " "), 100.0 * share))
        .collect();
    put(text, format_args!("  radio against inertial velocity: {}", shares.join(", ")));
    let faults = it.verdicts.iter().filter(|change| !["nominal", "unobserved"].contains(&change.verdict));
    for change in faults.clone().take(10) {
        let verdict = change.verdict.replace('_', " ");
        put(text, format_args!("    {:.0} s: {verdict}, suspect: {}", change.time_s, change.suspect));
    }
    let more = faults.count().saturating_sub(10);
    if more > 0 {
        put(text, format_args!("    {more} more verdicts"));
    }
    if it.withheld > 0 {
        put(text, format_args!("    {} velocity measurements withheld from the filter", it.withheld));
    }
    let ([radio, radio_sigma], [inertial, inertial_sigma]) = (it.radio_error, it.inertial_error);
    put(
        text,
        format_args!(
            "    at the end: radio error {radio:.3} ± {radio_sigma:.3} m/s, inertial error {inertial:.3} ± {inertial_sigma:.3} m/s (1 sigma)"
        ),
    );
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
