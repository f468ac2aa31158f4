//! Findings in words.
use crate::catalogue::{Candidate, Effect};
use crate::explanation::Parameter;

/// The parameter that names what a noise level goes with.
pub const QUANTITY: &str = "quantity";

/// What the catalogue says of a sensor with the effect, as its parameters have it: a delay below zero is no delay, and
/// what comes late then is the reference; and a noise level that goes with a quantity is not one that changes once.
pub fn said(effect: &Effect, sensor: &str, parameters: &[Parameter]) -> String {
    let text = effect.sentence;
    // The catalogue's sentence may name the sensor itself.
    let said =
        if text.contains("{sensor}") { text.replace("{sensor}", sensor) } else { format!("{sensor} {text}") };
    let quantity = parameters.iter().find(|parameter| parameter.name == QUANTITY);
    if let Some(quantity) = quantity.and_then(|quantity| quantity.text.as_deref()) {
        return format!("{said} with the {quantity}");
    }
    if let Some(function) = function_of(parameters) {
        return said.replace("another recorded quantity", &function);
    }
    if is_early(parameters) { said.replace("comes late", "comes early, or its reference late") } else { said }
}

/// The function of recorded quantities that a dependence is on, where it is not the quantity itself.
fn function_of(parameters: &[Parameter]) -> Option<String> {
    let text = |name: &str| parameters.iter().find(|it| it.name == name)?.text.as_deref();
    let column = text("column")?;
    Some(match (text("function")?, text("with")) {
        ("square", _) => format!("the square of {column}"),
        ("cube", _) => format!("the cube of {column}"),
        ("abs", _) => format!("the absolute value of {column}"),
        ("sign", _) => format!("the sign of {column}"),
        ("odd_square", _) => format!("the square of {column} with its sign"),
        ("rate", _) => format!("the rate of {column}"),
        ("delay", _) => format!("{column} late"),
        ("product", Some(with)) => format!("the product of {column} and {with}"),
        _ => return None,
    })
}

fn is_early(parameters: &[Parameter]) -> bool {
    parameters.iter().any(|it| it.name == "delay_s" && it.value.is_some_and(|value| value < 0.0))
}

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
    let said = said(candidate.effect, sensor, parameters);
    let numbers: Vec<String> = parameters
        .iter()
        .filter(|parameter| parameter.name != "onset_s")
        .map(|parameter| {
            let label =
                if parameter.name == "coefficient" { String::new() } else { format!("{} ", parameter.name) };
            match (parameter.value, &parameter.text) {
                (Some(value), _) => {
                    let unit = parameter.unit.as_deref().unwrap_or_default();
                    format!("{label}{}{}", with_sigma(value, parameter.sigma, unit), of_stated(parameter))
                }
                (None, Some(text)) => format!("{label}{text}"),
                (None, None) => label,
            }
        })
        .collect();
    let begun = begun(&format!("{since}{said}"));
    if numbers.is_empty() { format!("{begun}.") } else { format!("{begun}: {}.", numbers.join(", ")) }
}

/// A sentence whose first word is a capital where it is no name of the user's: that of what several sensors have in common.
pub fn begun(text: &str) -> String {
    text.strip_prefix("what ").map_or_else(|| text.to_owned(), |rest| format!("What {rest}"))
}

/// How many times what the case states a parameter is, where it states it.
pub fn of_stated(parameter: &Parameter) -> String {
    let ratio = parameter.value.zip(parameter.stated).map(|(value, stated)| value / stated);
    ratio.map_or_else(String::new, |ratio| {
        if (0.1..100.0).contains(&ratio) {
            format!(" ({ratio:.2} × stated)")
        } else {
            format!(" ({ratio:.1e} × stated)")
        }
    })
}

/// A value with its standard deviation, to the digits that the latter leaves.
pub(crate) fn with_sigma(value: f64, sigma: Option<f64>, unit: &str) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::CATALOGUE;

    fn delay(value: f64) -> Vec<Parameter> {
        let (name, unit) = ("delay_s".to_owned(), Some("s".to_owned()));
        vec![Parameter { name, value: Some(value), sigma: Some(0.01), unit, ..Parameter::default() }]
    }

    #[test]
    fn what_comes_early_is_not_called_late() {
        let effect = CATALOGUE.iter().find(|effect| effect.id == "time_delay").expect("a row");
        assert_eq!(said(effect, "log", &delay(0.3)), "log comes late");
        assert_eq!(said(effect, "log", &delay(-1.46)), "log comes early, or its reference late");
    }

    #[test]
    fn names_keep_their_letters_where_a_sentence_begins() {
        assert_eq!(begun("what ax and ay have in common jumps"), "What ax and ay have in common jumps");
        assert_eq!(begun("gyro_x jumps"), "gyro_x jumps");
    }

    #[test]
    fn the_function_of_a_recorded_quantity_is_said() {
        let effect = CATALOGUE.iter().find(|effect| effect.id == "bias_on_aux").expect("a row");
        let text = |name: &str, text: &str| Parameter {
            name: name.to_owned(),
            text: Some(text.to_owned()),
            ..Parameter::default()
        };
        let column = text("column", "velocity");
        let plain = said(effect, "torque", std::slice::from_ref(&column));
        assert_eq!(plain, "torque follows another recorded quantity");
        let sign = said(effect, "torque", &[column.clone(), text("function", "sign")]);
        assert_eq!(sign, "torque follows the sign of velocity");
        let product = [column, text("function", "product"), text("with", "current")];
        assert_eq!(said(effect, "torque", &product), "torque follows the product of velocity and current");
    }

    #[test]
    fn what_the_case_states_is_compared_with() {
        let sigma = Parameter {
            name: "sigma".to_owned(),
            value: Some(0.0252),
            sigma: Some(0.0002),
            unit: Some("deg/s".to_owned()),
            stated: Some(0.024),
            ..Parameter::default()
        };
        assert_eq!(of_stated(&sigma), " (1.05 × stated)");
        let in_other_unit = Parameter { stated: Some(25.2), ..sigma.clone() };
        assert_eq!(of_stated(&in_other_unit), " (1.0e-3 × stated)");
        assert_eq!(of_stated(&Parameter { stated: None, ..sigma }), "");
    }

    #[test]
    fn what_a_noise_level_goes_with_is_said() {
        let effect = CATALOGUE.iter().find(|effect| effect.id == "noise_variance_step").expect("a row");
        let (name, text) = (QUANTITY.to_owned(), Some("turn rate".to_owned()));
        let quantity = Parameter { name, text, ..Parameter::default() };
        assert_eq!(said(effect, "log", &[]), "log changes its noise level");
        assert_eq!(said(effect, "log", &[quantity]), "log changes its noise level with the turn rate");
    }
}
