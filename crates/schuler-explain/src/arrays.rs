//! The arrays behind an explanation, as [`crate::evidence`] takes them.
//!
//! One entry a channel of the nominal model: a sensor, a component of a parity vector (in the unit of its sensors), or the
//! velocity error of a Schuler loop.

use crate::catalogue::Port;
use crate::description::{Delays, Term};
use crate::evidence::{CaseArrays, Part, SensorArrays};
use crate::explanation::Finding;
use crate::nominal::Block;
use crate::second::answer::arrays::{cause, findings_of, name};
use crate::second::answer::held_out::held_out_s;
use crate::state::{Bench, Case, State};

/// The arrays of a case described by `before`, nothing but the noise fitted, and by `after`, with the findings.
pub fn arrays(case: &Case<'_>, before: &State, after: &State, findings: &[Finding]) -> CaseArrays {
    let null = Bench::new(case, &before.terms, &before.noises);
    let bench = Bench::new(case, &after.terms, &after.noises);
    let amplitudes: Vec<f64> = bench.solution.amplitudes.iter().copied().collect();
    let constants = case.model.constants.len();
    let places = findings_of(case.model, case.candidates, after.terms.iter(), findings);
    let mut sensors = Vec::new();
    for (index, block) in case.model.blocks.iter().enumerate() {
        let rows = block.rows();
        let Some(source) = block.sources.first().and_then(|source| case.model.sources.get(*source)) else {
            continue;
        };
        let mut data = block.data.clone();
        for (column, amplitude) in case.model.constants.iter().zip(&amplitudes) {
            if let Some(values) = block.project(column, Port::Output) {
                data.iter_mut().zip(&*values).for_each(|(data, value)| *data -= amplitude * value);
            }
        }
        let whitened = |bench: &Bench<'_>| {
            bench.blocks.get(index).and_then(Option::as_ref).map(|it| it.remainder.clone())
        };
        let (whitened_before, whitened_after) = (whitened(&null), whitened(&bench));
        let mut parts: Vec<(usize, Vec<f64>, &Term)> = Vec::new();
        let mut first = constants;
        let delays = Delays::new(&after.terms);
        for (term, finding) in after.terms.iter().zip(&places) {
            let own = amplitudes.get(first..first + term.amplitudes()).unwrap_or_default();
            first += term.amplitudes();
            if let (Some(finding), Some(values)) =
                (*finding, added(block, &delays.late_term(case.model, term), own))
            {
                parts.push((finding, values, term));
            }
        }
        for channel in 0..block.channels {
            let of_channel = |values: &[f64]| -> Vec<f64> {
                values.get(channel * rows..(channel + 1) * rows).unwrap_or_default().to_vec()
            };
            // The filter gives 0 where nothing was read.
            let known = |values: &Option<Vec<f64>>| -> Vec<f64> {
                let values = of_channel(values.as_deref().unwrap_or_default());
                let there = block.present.iter().zip(values);
                there.map(|(there, value)| if *there { value } else { f64::NAN }).collect()
            };
            let parts = parts.iter().map(|(finding, values, term)| Part {
                finding: *finding,
                values: of_channel(values),
                cause: case
                    .candidates
                    .get(term.candidate)
                    .and_then(|it| cause(it, term, source.unit, case.time_s)),
            });
            sensors.push(SensorArrays {
                sensor: name(case.model, block, channel),
                unit: source.unit,
                residual: of_channel(&data),
                innovation_before: known(&whitened_before),
                innovation_after: known(&whitened_after),
                parts: parts.collect(),
            });
        }
    }
    CaseArrays {
        time_s: case.time_s.to_vec(),
        step_s: case.model.step_s,
        held_out_s: held_out_s(case.model, &after.noises),
        sensors,
    }
}

/// What a term adds to the channels of a block.
fn added(block: &Block, term: &Term, amplitudes: &[f64]) -> Option<Vec<f64>> {
    let mut sum: Option<Vec<f64>> = None;
    for (place, column) in term.columns.iter().enumerate() {
        let Some(values) = block.project(column, term.port) else { continue };
        let amplitude =
            if term.unit_amplitude { 1.0 } else { amplitudes.get(place).copied().unwrap_or_default() };
        let sum = sum.get_or_insert_with(|| vec![0.0; values.len()]);
        sum.iter_mut().zip(&*values).for_each(|(sum, value)| *sum += amplitude * value);
    }
    sum
}
