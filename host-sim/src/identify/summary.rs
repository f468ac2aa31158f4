//! The identification as text, in the units of the case and of the field.
use std::fmt::{self, Write};

use super::report::{Coefficient, Estimate, Identification, ModelReport, Quoted, SensorIdentification};

/// A fit that noise of its own kind beats this often or more is taken for good.
const LEAST_P: f64 = 0.05;

impl fmt::Display for Identification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { title, rows, rows_in_gaps, step_s, .. } = self;
        writeln!(f, "{title}")?;
        writeln!(f, "{rows} steps of {step_s} s, {rows_in_gaps} of them in gaps")?;
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        self.sensors.iter().try_for_each(|sensor| write!(f, "\n{sensor}"))
    }
}

impl fmt::Display for SensorIdentification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = self.written_unit;
        let written = |value: f64| value / self.written_unit_in_si;
        writeln!(f, "{} ({}), {} values, {} missing", self.id, self.kind, self.present, self.missing)?;
        let Some(model) = self.structure.models.first() else {
            return writeln!(f, "  too few values, or all the same");
        };
        let scaled = |estimate: &Estimate, factor: f64| Estimate {
            value: estimate.value * factor,
            standard_deviation: estimate.standard_deviation.map(|sigma| sigma * factor),
            ..*estimate
        };
        writeln!(f, "  mean                {} {unit}", plus_minus(&scaled(&model.level, written(1.0))))?;
        if let Some(slope) = &model.slope_per_s {
            writeln!(f, "  trend               {} {unit}/h", plus_minus(&scaled(slope, written(3600.0))))?;
        }
        writeln!(f, "  noise               {}", self.described(model)?)?;
        if let Some(p) = self.structure.whiteness_p.filter(|&p| p < LEAST_P) {
            writeln!(
                f,
                "                      its innovations are not white (p = {p:.1e}): there is more in it"
            )?;
        }
        if let Some(floor) = &self.floor {
            let (deviation, tau_s) = (written(floor.deviation), floor.tau_s);
            let reached = if floor.reached { "" } else { ", and still falling" };
            writeln!(f, "  Allan floor         {deviation:.3e} {unit} at {tau_s:.0} s{reached}")?;
        }
        for coefficient in &self.coefficients {
            writeln!(f, "  {:<20}{}", coefficient.label(), coefficient.field.described())?;
        }
        if self.power_laws_p.is_some_and(|p| p < LEAST_P) {
            writeln!(f, "                      power laws alone do not describe it: see its noise above")?;
        }
        Ok(())
    }
}

impl SensorIdentification {
    /// The model in words, in the unit of the case.
    fn described(&self, model: &ModelReport) -> Result<String, fmt::Error> {
        let unit = self.written_unit;
        let in_unit = |estimate: &Estimate| {
            let scale = 1.0 / self.written_unit_in_si;
            plus_minus(&Estimate {
                value: estimate.value * scale,
                standard_deviation: estimate.standard_deviation.map(|sigma| sigma * scale),
                ..*estimate
            })
        };
        let mut text = format!("white {} {unit}", in_unit(&model.white));
        if let Some(markov) = &model.markov {
            write!(text, "; Markov {} {unit}, tau {} s", in_unit(&markov.sigma), plus_minus(&markov.tau_s))?;
        }
        if let Some(noise) = &model.exp_cos {
            write!(text, "; exponential-cosine {} {unit}, ", in_unit(&noise.sigma))?;
            write!(text, "alpha {} 1/s, beta {} rad/s", plus_minus(&noise.alpha), plus_minus(&noise.beta))?;
        }
        if let Some(walk) = &model.random_walk {
            write!(text, "; random walk {} {unit}/sqrt(s)", in_unit(walk))?;
        }
        Ok(text)
    }
}

impl Coefficient {
    fn label(&self) -> String {
        format!("{} {}", self.symbol, self.name)
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

fn plus_minus(estimate: &Estimate) -> String {
    let weak = if estimate.weak { " (weak)" } else { "" };
    match estimate.standard_deviation {
        Some(sigma) => format!("{:.4e} ± {sigma:.1e}{weak}", estimate.value),
        None => format!("{:.4e}{weak}", estimate.value),
    }
}
