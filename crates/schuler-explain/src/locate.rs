//! Where record and simulation differ, before anything is named, and what is left when everything is.
//!
//! Tests on innovations, which are independent standard normals under the description: NIS in windows against χ²,
//! Ljung–Box, the largest cumulative sum (Kolmogorov's distribution), the spectrum in bands against χ², and the mean
//! under each recorded condition in ten bins; and in the end whether each noise that was found is the same at all times
//! ([`crate::constancy`]). All p-values are multiplied by the number of tests.
use rayon::prelude::*;

use crate::constancy::constancy;
use crate::explanation::{Located, Remainder};
use crate::inputs::Inputs;
use crate::noise::Knob;
use crate::second::answer::located::{Binned, bins, conditional, frequency_text, largest_sum, two_tailed};
use crate::smooth::{Dependence, gain_of_one};
use crate::state::{Accepted, Bench, Case, State};
use crate::statistics::ljung_box;

/// p-value, corrected, below which a difference is reported.
const REPORTED: f64 = 0.01;
/// The same for the verdict that something is left.
const LEFT: f64 = 1e-3;
/// Windows of the NIS.
const WINDOWS: usize = 100;
/// Fewest rows of a window.
const FEWEST_ROWS: usize = 30;
/// Lags of the test for whiteness.
const LAGS: usize = 20;

/// A test's result before correction.
struct Result {
    block: usize,
    test: &'static str,
    what: String,
    p: f64,
    interval_s: Option<[f64; 2]>,
    band_hz: Option<[f64; 2]>,
    condition: Option<usize>,
}

/// Differences between the record and a description, most significant first.
pub fn locate(case: &Case<'_>, state: &State, inputs: &Inputs<'_>) -> Vec<Located> {
    let bench = Bench::new(case, &state.terms, &state.noises);
    let (results, tests) = results(&bench, inputs);
    let mut located: Vec<Located> = results
        .into_iter()
        .map(|result| Located {
            sensor: block_name(case, result.block),
            test: result.test.to_owned(),
            what: result.what,
            p_value: (result.p * tests).min(1.0),
            interval_s: result.interval_s,
            band_hz: result.band_hz,
        })
        .filter(|located| located.p_value < REPORTED)
        .collect();
    located.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    located
}

/// Whether the record still differs from a description, and in what: in a dependence that no effect of the catalogue has, of those that
/// were found, or in what tests show.
pub fn left(
    case: &Case<'_>,
    state: &State,
    inputs: &Inputs<'_>,
    dependences: &[Dependence],
) -> (bool, Option<Remainder>) {
    if let Some(strongest) = dependences.iter().max_by(|a, b| a.gain_nats.total_cmp(&b.gain_nats)) {
        let name = |dependence: &Dependence| case.model.sources[dependence.source].name.as_str();
        let what = dependences.iter().map(|it| {
            format!("the mean of {} depends on {}, as no effect of the catalogue does", name(it), it.on)
        });
        let remainder = Remainder {
            sensor: name(strongest).to_owned(),
            what: what.collect::<Vec<_>>().join("; "),
            on: Some(strongest.on.clone()),
            gain_nats: strongest.gain_nats,
        };
        return (true, Some(remainder));
    }
    let bench = Bench::new(case, &state.terms, &state.noises);
    let (mut results, mut tests) = results(&bench, inputs);
    let noises = results_of_noises(&bench, state);
    tests += noises.len() as f64;
    results.extend(noises);
    results.retain(|result| result.p * tests < LEFT);
    results.sort_by(|a, b| a.p.total_cmp(&b.p));
    let Some(worst) = results.first() else { return (false, None) };
    let block = worst.block;
    let words: Vec<&str> = results
        .iter()
        .filter(|result| result.block == block)
        .take(3)
        .map(|result| result.what.as_str())
        .collect();
    let mut remainder =
        Remainder { sensor: block_name(case, block), what: words.join("; "), on: None, gain_nats: 0.0 };
    let conditions = inputs.conditions();
    let on = results.iter().find(|result| result.block == block && result.condition.is_some());
    if let Some(condition) = on.and_then(|result| result.condition).and_then(|index| conditions.get(index))
        && let Some(gain_nats) = gain_of_one(&bench, case.model.blocks[block].sources[0], condition.values)
    {
        remainder.gain_nats = gain_nats;
        remainder.on = Some(condition.name.clone());
    }
    (true, Some(remainder))
}

fn block_name(case: &Case<'_>, block: usize) -> String {
    let sources = &case.model.blocks[block].sources;
    let names = sources.iter().map(|&source| case.model.sources[source].name.as_str());
    names.collect::<Vec<_>>().join(", ")
}

/// Results of all tests on innovations, and their number.
fn results(bench: &Bench<'_>, inputs: &Inputs<'_>) -> (Vec<Result>, f64) {
    let conditions: Vec<Binned> = inputs
        .conditions()
        .into_par_iter()
        .enumerate()
        .filter_map(|(place, condition)| {
            Some(Binned { place, name: condition.name, bins: bins(condition.values)? })
        })
        .collect();
    let of_blocks: Vec<(Vec<Result>, f64)> = (0..bench.blocks.len())
        .into_par_iter()
        .filter_map(|index| results_of_block(bench, index, &conditions))
        .collect();
    let tests: f64 = of_blocks.iter().map(|(_, tests)| tests).sum();
    (of_blocks.into_iter().flat_map(|(results, _)| results).collect(), tests.max(1.0))
}

/// The same of a block, if it has a filter.
fn results_of_block(bench: &Bench<'_>, index: usize, conditions: &[Binned]) -> Option<(Vec<Result>, f64)> {
    let case = bench.case;
    let whitened = bench.blocks[index].as_ref()?;
    let mut results = Vec::new();
    let mut tests = 0.0_f64;
    let at = |row: usize| case.time_s.get(row).copied().unwrap_or_default();
    let block = &case.model.blocks[index];
    let (rows, channels) = (block.rows(), block.channels);
    let e = &whitened.remainder;
    let mut push = |test, what, p: f64, number: f64, interval_s, band_hz, condition| {
        results.push(Result { block: index, test, what, p: p * number, interval_s, band_hz, condition });
    };
    // NIS in windows.
    let length = (rows / WINDOWS).max(FEWEST_ROWS);
    let mut worst: Option<(f64, usize, f64)> = None;
    let mut windows = 0.0;
    for first in (0..rows).step_by(length) {
        let window = first..(first + length).min(rows);
        let (mut sum, mut count) = (0.0, 0);
        for row in window.filter(|&row| block.present[row]) {
            sum += (0..channels).map(|c| e[c * rows + row].powi(2)).sum::<f64>();
            count += channels;
        }
        if count < FEWEST_ROWS {
            continue;
        }
        windows += 1.0;
        let p = two_tailed(sum, count as f64);
        if worst.is_none_or(|worst| p < worst.0) {
            worst = Some((p, first, sum / count as f64));
        }
    }
    if let Some((p, first, mean)) = worst {
        let what = format!("the mean of the normalised innovation squared is {mean:.2} instead of 1");
        let interval = [at(first), at((first + length).min(rows) - 1)];
        push("nis_window", what, p, windows, Some(interval), None, None);
        tests += 1.0;
    }
    for channel in 0..channels {
        let series: Vec<f64> = (0..rows)
            .map(|row| if block.present[row] { e[channel * rows + row] } else { f64::NAN })
            .collect();
        let p = ljung_box(&series, LAGS);
        push("ljung_box", "innovations are correlated in time".to_owned(), p, 1.0, None, None, None);
        let (p, row) = largest_sum(&series);
        let what = format!("the mean changes near {:.0} s", at(row));
        push("cumulative_sum", what, p, 1.0, Some([at(row), at(rows - 1)]), None, None);
        tests += 2.0;
    }
    if let Some(spectrum) = bench.spectrum(index) {
        let mut bands = 0.0;
        let mut worst: Option<(f64, f64, f64)> = None;
        for (omega, weight, excess) in spectrum.excess() {
            bands += 1.0;
            let freedom = 2.0 * weight * channels as f64;
            let p = two_tailed(freedom * excess, freedom);
            if worst.is_none_or(|worst| p < worst.0) {
                worst = Some((p, omega, excess));
            }
        }
        if let Some((p, omega, excess)) = worst {
            let hertz = omega / (std::f64::consts::TAU * block.step_s());
            let near = frequency_text(hertz);
            let what = format!("the spectrum near {near} is {excess:.2} times what it should be");
            push("spectrum", what, p, bands, None, Some([0.98 * hertz, 1.02 * hertz]), None);
            tests += 1.0;
        }
    }
    for condition in conditions {
        for channel in 0..channels {
            let Some((p, low, high)) = conditional(block, &e[channel * rows..], &condition.bins) else {
                continue;
            };
            let what = format!(
                "the mean depends on {} (from {low:.2} σ to {high:.2} σ of its error)",
                condition.name
            );
            push("conditional_mean", what, p, 1.0, None, None, Some(condition.place));
            tests += 1.0;
        }
    }
    Some((results, tests))
}

/// Whether each noise that was found is the same at all times.
fn results_of_noises(bench: &Bench<'_>, state: &State) -> Vec<Result> {
    let model = bench.case.model;
    // One that changes at a time is not.
    let is_of_all_times = |change: &&Accepted| !change.knobs.contains(&Knob::StepRatio);
    let result = |change: &Accepted| {
        let block = model.block_of_source(change.source)?;
        let p = constancy(bench, block, change)?;
        let id = bench.case.candidates[change.candidate].effect.id;
        let what = format!("{id} of {} is not the same at all times", model.sources[change.source].name);
        let test = "noise_constancy";
        Some(Result { block, test, what, p, interval_s: None, band_hz: None, condition: None })
    };
    state.changes.par_iter().filter(is_of_all_times).filter_map(result).collect()
}
