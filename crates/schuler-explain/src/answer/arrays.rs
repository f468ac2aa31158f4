//! The arrays behind an explanation, as [`crate::evidence`] takes them.
//!
//! One entry a channel of the nominal model: a sensor, a component of a parity vector (in the unit of its sensors), or the
//! velocity error of a Schuler loop.
use schuler_recording::unit::Unit;

use super::held_out::held_out_s;
use crate::catalogue::{AT_MEAN, Candidate, Port, Search, target_name};
use crate::description::Term;
use crate::diagnostics::{CaseArrays, Cause, Part, SensorArrays};
use crate::exact::{BlockRows, OverRows, added};
use crate::explanation::Finding;
use crate::nominal::{Block, Model};

/// The arrays of a case described with nothing but its noise, `before`, and with the findings, `after`.
pub fn arrays(before: &OverRows<'_>, after: &OverRows<'_>, findings: &[Finding]) -> CaseArrays {
    let model = after.bench.problem.model;
    let terms = after.description.placed.iter().map(|placed| &placed.term);
    let places = findings_of(model, &after.bench.problem.candidates, terms, findings);
    let of_block = |index: usize| arrays_of_block(before, after, index, &places);
    CaseArrays {
        time_s: model.time_s.clone(),
        step_s: model.step_s,
        held_out_s: held_out_s(model, &after.description.noises),
        sensors: (0..model.blocks.len()).flat_map(of_block).collect(),
        ..CaseArrays::default()
    }
}

fn arrays_of_block(
    before: &OverRows<'_>,
    after: &OverRows<'_>,
    index: usize,
    places: &[Option<usize>],
) -> Vec<SensorArrays> {
    let problem = after.bench.problem;
    let block = &problem.model.blocks[index];
    let (rows_before, rows_after) = (&before.blocks[index], &after.blocks[index]);
    let Some(source) = block.sources.first().and_then(|source| problem.model.sources.get(*source)) else {
        return Vec::new();
    };
    let of_channel = |values: &[f64], channel: usize| -> Vec<f64> {
        values.chunks(block.rows()).nth(channel).unwrap_or_default().to_vec()
    };
    // The filter gives 0 where nothing was read.
    let known = |rows: &Option<BlockRows>, channel: usize| -> Vec<f64> {
        let values = rows.as_ref().map(|it| of_channel(&it.innovations, channel)).unwrap_or_default();
        let there = block.present.iter().zip(values);
        there.map(|(there, value)| if *there { value } else { f64::NAN }).collect()
    };
    let placed = after.description.placed.iter().zip(&after.amplitudes).zip(places);
    let parts: Vec<(usize, Vec<f64>, &Term)> = placed
        .filter_map(|((placed, own), finding)| {
            Some(((*finding)?, added(problem.model, block, placed, own)?, &placed.term))
        })
        .collect();
    let sensor = |channel: usize| {
        let parts = parts.iter().map(|(finding, values, term)| Part {
            finding: *finding,
            values: of_channel(values, channel),
            cause: cause(&problem.candidates[term.candidate], term, source.unit, problem.time_s()),
        });
        let residual = rows_after.as_ref().map_or(&block.data, |rows| &rows.residual);
        SensorArrays {
            sensor: name(problem.model, block, channel),
            unit: source.unit,
            residual: of_channel(residual, channel),
            innovation_before: known(rows_before, channel),
            innovation_after: known(rows_after, channel),
            parts: parts.collect(),
        }
    };
    (0..block.channels).map(sensor).collect()
}

/// What an effect depends on, where a plot against it says something: the signature of one amplitude, or time.
fn cause(candidate: &Candidate, term: &Term, unit: Unit, time_s: &[f64]) -> Option<Cause> {
    let time = || Some(Cause { name: "time".to_owned(), unit: "s".to_owned(), values: time_s.to_vec() });
    // Within the loop a velocity does not follow its cause step by step, and a component of a parity vector sees several.
    if candidate.port != Port::Output {
        return None;
    }
    match (&candidate.search, &candidate.amplitudes[..], &term.columns[..]) {
        (Search::Onset(_), ..) => time(),
        // A second amplitude for an unknown reference is a constant in such a plot.
        (
            Search::Linear(_) | Search::Grid { unit_amplitude: false, .. },
            [amplitude, rest @ ..],
            [column, ..],
        ) if rest.iter().all(|other| other.name == AT_MEAN) => {
            let (_, values) = column.parts.first()?;
            let varies = values.windows(2).any(|pair| pair[0] != pair[1]);
            varies.then(|| Cause::of_signature(candidate.effect.formula, amplitude, values, unit))
        }
        _ => None,
    }
}

/// The place of each term among the findings: of the same effect at the same place the one that begins nearest.
pub fn findings_of<'t>(
    model: &Model,
    candidates: &[Candidate],
    terms: impl Iterator<Item = &'t Term>,
    findings: &[Finding],
) -> Vec<Option<usize>> {
    let mut free: Vec<usize> = (0..findings.len()).collect();
    let place = |term: &Term| -> Option<usize> {
        let candidate = candidates.get(term.candidate)?;
        let sensor = target_name(model, candidate);
        let onset_s = match candidate.search {
            Search::Onset(_) => term.nonlinear.first().copied().unwrap_or_default(),
            _ => 0.0,
        };
        let distance = |finding: &Finding| (finding.interval_s[0] - onset_s).abs();
        let nearest = free
            .iter()
            .copied()
            .filter(|k| findings[*k].sensor == sensor && findings[*k].effect == candidate.effect.id)
            .min_by(|a, b| distance(&findings[*a]).total_cmp(&distance(&findings[*b])))?;
        free.retain(|k| *k != nearest);
        Some(nearest)
    };
    terms.map(place).collect()
}

/// Name of a channel of a block.
fn name(model: &Model, block: &Block, channel: usize) -> String {
    let sources = block.sources.iter().filter_map(|source| model.sources.get(*source));
    let mut names: Vec<&str> = sources.map(|source| source.name.as_str()).collect();
    if block.sensors.len() == 1 {
        // The loop's own sources come after that of its velocity.
        names.truncate(1);
        return names.concat();
    }
    format!("parity {} of {}", channel + 1, names.join(", "))
}
