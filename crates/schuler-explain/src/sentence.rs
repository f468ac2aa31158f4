//! Findings in words.
use crate::catalogue::Candidate;
use crate::explanation::Parameter;

/// One plain sentence: since when, what, and how large.
pub fn sentence(
    candidate: &Candidate,
    sensor: &str,
    parameters: &[Parameter],
    interval_s: [f64; 2],
    time_s: &[f64],
) -> String {
    let whole_s = time_s.last().copied().unwrap_or_default();
    let since = if interval_s[0] > 0.001 * whole_s {
        format!("From {} on, ", clock(interval_s[0]))
    } else {
        String::new()
    };
    let text = candidate.effect.sentence;
    // The catalogue's sentence may name the sensor itself.
    let said =
        if text.contains("{sensor}") { text.replace("{sensor}", sensor) } else { format!("{sensor} {text}") };
    let numbers: Vec<String> = parameters
        .iter()
        .filter(|parameter| parameter.name != "onset_s")
        .map(|parameter| {
            let label =
                if parameter.name == "coefficient" { String::new() } else { format!("{} ", parameter.name) };
            match (parameter.value, &parameter.text) {
                (Some(value), _) => {
                    let unit = parameter.unit.as_deref().unwrap_or_default();
                    format!("{label}{}", with_sigma(value, parameter.sigma, unit))
                }
                (None, Some(text)) => format!("{label}{text}"),
                (None, None) => label,
            }
        })
        .collect();
    if numbers.is_empty() {
        format!("{since}{said}.")
    } else {
        format!("{since}{said}: {}.", numbers.join(", "))
    }
}

/// A value with its standard deviation, to the digits that the latter leaves.
fn with_sigma(value: f64, sigma: Option<f64>, unit: &str) -> String {
    let Some(sigma) = sigma.filter(|sigma| *sigma > 0.0 && sigma.is_finite()) else {
        return format!("{value:.4e} {unit}").trim_end().to_owned();
    };
    let digits = 1 - sigma.log10().floor() as i32;
    if (0..=6).contains(&digits) && value.abs() < 1e6 {
        let digits = digits as usize;
        format!("{value:.digits$} ± {sigma:.digits$} {unit}")
    } else if digits < 0 && value.abs() < 1e6 {
        format!("{value:.0} ± {sigma:.0} {unit}")
    } else {
        format!("{value:.4e} ± {sigma:.1e} {unit}")
    }
}

/// Seconds as hours, minutes and seconds.
fn clock(seconds: f64) -> String {
    let (hours, minutes) = ((seconds / 3600.0).floor(), (seconds % 3600.0 / 60.0).floor());
    if hours > 0.0 {
        format!("{hours:.0} h {minutes:.0} min")
    } else if minutes > 0.0 {
        format!("{minutes:.0} min {:.0} s", seconds % 60.0)
    } else {
        format!("{seconds:.3} s")
    }
}
