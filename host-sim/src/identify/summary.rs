//! The identification as text, in the units of the case and of the field.
use std::fmt::{self, Write};

use schuler_recording::error::rounded;

use super::report::{Estimate, Identification, ModelReport, Quoted, SensorIdentification};

/// A fit that noise of its own kind beats this often or more is taken for good.
const LEAST_P: f64 = 0.05;

impl fmt::Display for Identification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { title, rows, rows_in_gaps, step_s, .. } = self;
        writeln!(f, "{title}")?;
        writeln!(f, "{rows} steps of {} s, {rows_in_gaps} of them in gaps", rounded(*step_s))?;
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        self.sensors.iter().try_for_each(|sensor| write!(f, "\n{sensor}"))
    }
}

impl fmt::Display for SensorIdentification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = self.written_unit;
        write!(f, "{} ({}), {} values, {} missing", self.id, self.kind, self.present, self.missing)?;
        if self.spikes > 0 {
            write!(f, ", {} set aside, far from the readings around them", self.spikes)?;
        }
        writeln!(f)?;
        let Some(model) = self.structure.models.first() else {
            return writeln!(f, "  too few values, or all the same");
        };
        let mut line = |label: &str, text: &str| writeln!(f, "  {label:<28}{text}");
        line("mean", &format!("{} {unit}", self.written(&model.level, 1.0)))?;
        if let Some(slope) = &model.slope_per_s {
            line("trend", &format!("{} {unit}/h", self.written(slope, 3600.0)))?;
        }
        line("noise", &self.described(model)?)?;
        if let Some(p) = self.structure.whiteness_p.filter(|&p| p < LEAST_P) {
            line("", &format!("its innovations are not white (p = {p:.1e}): there is more in it"))?;
        }
        if let Some(floor) = &self.floor {
            let deviation = floor.deviation / self.written_unit_in_si;
            let reached = if floor.reached { "" } else { ", and not rising again" };
            line(
                "Allan floor",
                &format!("{deviation:.3e} {unit} at {} s{reached}", three_digits(floor.tau_s)),
            )?;
        }
        for coefficient in &self.coefficients {
            let label = format!("{} {}", coefficient.symbol, coefficient.name);
            line(&label, &coefficient.field.described())?;
        }
        if self.power_laws_p.is_some_and(|p| p < LEAST_P) {
            line("", "power laws alone do not describe it: see its noise above")?;
        }
        Ok(())
    }
}

/// A positive number in three digits, without an exponent.
fn three_digits(value: f64) -> String {
    let digits = (2.0 - value.log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

impl SensorIdentification {
    /// An estimate in SI units, times `factor`, in the unit of the case.
    fn written(&self, estimate: &Estimate, factor: f64) -> String {
        let scale = factor / self.written_unit_in_si;
        plus_minus(&Estimate {
            value: estimate.value * scale,
            standard_deviation: estimate.standard_deviation.map(|sigma| sigma * scale),
            ..*estimate
        })
    }

    /// The model in words, in the unit of the case.
    fn described(&self, model: &ModelReport) -> Result<String, fmt::Error> {
        let unit = self.written_unit;
        let written = |estimate: &Estimate| self.written(estimate, 1.0);
        let mut text = format!("white {} {unit}", written(&model.white));
        for markov in &model.markov {
            write!(text, "; Markov {} {unit}, tau {} s", written(&markov.sigma), plus_minus(&markov.tau_s))?;
        }
        if let Some(noise) = &model.exp_cos {
            write!(text, "; exponential-cosine {} {unit}, ", written(&noise.sigma))?;
            write!(text, "alpha {} 1/s, beta {} rad/s", plus_minus(&noise.alpha), plus_minus(&noise.beta))?;
        }
        if let Some(walk) = &model.random_walk {
            write!(text, "; random walk {} {unit}/sqrt(s)", written(walk))?;
        }
        Ok(text)
    }
}

impl Quoted {
    fn described(&self) -> String {
        match (self.value, self.standard_deviation) {
            (Some(value), Some(sigma)) => format!("{value:.3e} ± {sigma:.1e} {}", self.unit),
            _ => format!("not seen, below {:.1e} {}", self.below, self.unit),
        }
    }
}

/// Two digits of the standard deviation, and the value down to the same place.
fn plus_minus(estimate: &Estimate) -> String {
    let Estimate { value, standard_deviation, weak } = *estimate;
    let weak = if weak { " (weak)" } else { "" };
    let Some(sigma) = standard_deviation.filter(|&sigma| sigma > 0.0 && value != 0.0) else {
        return format!("{value:.4e}{weak}");
    };
    let place = |number: f64| number.abs().log10().floor();
    let digits = (place(value) - place(sigma) + 1.0).clamp(1.0, 15.0) as usize;
    format!("{value:.digits$e} ± {sigma:.1e}{weak}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_written_as_far_as_it_is_known() {
        let known = |value, sigma| plus_minus(&Estimate { value, standard_deviation: sigma, weak: false });
        assert_eq!(known(0.026_392_401_2, Some(1.5e-8)), "2.6392401e-2 ± 1.5e-8");
        assert_eq!(known(-170.14, Some(48.2)), "-1.70e2 ± 4.8e1");
        assert_eq!(known(1.0, Some(30.0)), "1.0e0 ± 3.0e1");
        assert_eq!(known(0.5, None), "5.0000e-1");
    }
}
