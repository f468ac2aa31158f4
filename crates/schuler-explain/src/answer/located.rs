//! Where record and simulation differ, before anything is named, and what is left when everything is.
//!
//! Tests on innovations, which are independent standard normals under the description: NIS in windows against χ²,
//! Ljung–Box, the largest cumulative sum (Kolmogorov's distribution), the spectrum in bands against χ², and the mean
//! under each recorded condition in ten bins; and in the end whether each noise that was found is the same at all times
//! ([`crate::exact::constancy`]). All p-values are multiplied by the number of tests.
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::evidence::fit::{Bench, Change};
use crate::evidence::system::System;
use crate::exact::constancy::constancy;
use crate::exact::{BlockRows, OverRows};
use crate::explanation::{Located, Remainder};
use crate::noise::weights::Covariances;
use crate::nominal::Block;
use crate::numeric::statistics::{chi_squared_tail, ljung_box};

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
/// Bins of a condition.
const BINS: usize = 10;

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
pub fn located(rows: &OverRows<'_>) -> Vec<Located> {
    let (results, tests) = results(rows);
    let mut located: Vec<Located> = results
        .into_iter()
        .map(|result| Located {
            sensor: block_name(rows.bench, result.block),
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

/// In what the record still differs from a description, by what tests show.
pub fn left(rows: &OverRows<'_>) -> Option<Remainder> {
    let (mut results, mut tests) = results(rows);
    let noises = results_of_noises(rows);
    tests += noises.len() as f64;
    results.extend(noises);
    results.retain(|result| result.p * tests < LEFT);
    results.sort_by(|a, b| a.p.total_cmp(&b.p));
    let worst = results.first()?;
    let block = worst.block;
    let of_block = || results.iter().filter(|result| result.block == block);
    let words: Vec<&str> = of_block().take(3).map(|result| result.what.as_str()).collect();
    let conditions = rows.bench.problem.inputs.conditions();
    let on = of_block().find_map(|result| Some((result.p, conditions.get(result.condition?)?.name.clone())));
    Some(Remainder {
        sensor: block_name(rows.bench, block),
        what: words.join("; "),
        gain_nats: on.as_ref().map_or(0.0, |(p, _)| -(p * tests).max(f64::MIN_POSITIVE).ln()),
        on: on.map(|(_, name)| name),
    })
}

fn block_name(bench: &Bench<'_>, block: usize) -> String {
    let model = bench.problem.model;
    let names = model.blocks[block].sources.iter().map(|&source| model.sources[source].name.as_str());
    names.collect::<Vec<_>>().join(", ")
}

/// Results of all tests on innovations, and their number.
fn results(rows: &OverRows<'_>) -> (Vec<Result>, f64) {
    let conditions: Vec<Binned> = (rows.bench.problem.inputs.conditions())
        .into_par_iter()
        .enumerate()
        .filter_map(|(place, condition)| {
            Some(Binned { place, name: condition.name, bins: bins(condition.values)? })
        })
        .collect();
    let of_block = |index: usize| {
        let tested = Tested {
            index,
            block: &rows.bench.problem.model.blocks[index],
            over_rows: rows.blocks[index].as_ref()?,
            time_s: &rows.bench.problem.model.time_s,
        };
        let mut results: Vec<Result> = tested.in_windows().into_iter().collect();
        for channel in 0..tested.block.channels {
            results.extend(tested.in_time(channel));
            results.extend(conditions.iter().filter_map(|condition| tested.on(channel, condition)));
        }
        results.extend(spectrum(rows, &tested));
        Some(results)
    };
    let all: Vec<Result> = (0..rows.blocks.len()).into_par_iter().filter_map(of_block).flatten().collect();
    let tests = all.len().max(1) as f64;
    (all, tests)
}

/// A block whose innovations are tested.
struct Tested<'t> {
    index: usize,
    block: &'t Block,
    over_rows: &'t BlockRows,
    time_s: &'t [f64],
}

impl Tested<'_> {
    fn result(&self, test: &'static str, what: String, p: f64) -> Result {
        Result { block: self.index, test, what, p, interval_s: None, band_hz: None, condition: None }
    }

    fn at(&self, row: usize) -> f64 {
        self.time_s.get(row).copied().unwrap_or_default()
    }

    /// NIS in windows: the one that is least likely.
    fn in_windows(&self) -> Option<Result> {
        let (rows, channels) = (self.block.rows(), self.block.channels);
        let e = &self.over_rows.innovations;
        let length = (rows / WINDOWS).max(FEWEST_ROWS);
        let of_window = |first: usize| {
            let window = (first..(first + length).min(rows)).filter(|&row| self.block.present[row]);
            let (sum, count) = window.fold((0.0, 0), |(sum, count), row| {
                let squares = (0..channels).map(|c| e[c * rows + row].powi(2)).sum::<f64>();
                (sum + squares, count + channels)
            });
            (count >= FEWEST_ROWS).then(|| (two_tailed(sum, count as f64), first, sum / count as f64))
        };
        let windows: Vec<(f64, usize, f64)> = (0..rows).step_by(length).filter_map(of_window).collect();
        let &(p, first, mean) = windows.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let what = format!("the mean of the normalised innovation squared is {mean:.2} instead of 1");
        let interval_s = Some([self.at(first), self.at((first + length).min(rows) - 1)]);
        Some(Result { interval_s, ..self.result("nis_window", what, p * windows.len() as f64) })
    }

    /// Correlation from row to row, and changes of the mean.
    fn in_time(&self, channel: usize) -> [Result; 2] {
        let rows = self.block.rows();
        let series: Vec<f64> = (self.block.present.iter())
            .zip(&self.over_rows.innovations[channel * rows..])
            .map(|(present, value)| if *present { *value } else { f64::NAN })
            .collect();
        let correlated = "innovations are correlated in time".to_owned();
        let (p, row) = largest_sum(&series);
        let what = format!("the mean changes near {:.0} s", self.at(row));
        let interval_s = Some([self.at(row), self.at(rows - 1)]);
        [
            self.result("ljung_box", correlated, ljung_box(&series, LAGS)),
            Result { interval_s, ..self.result("cumulative_sum", what, p) },
        ]
    }

    /// The mean by a condition.
    fn on(&self, channel: usize, condition: &Binned) -> Option<Result> {
        let e = &self.over_rows.innovations[channel * self.block.rows()..];
        let (p, low, high) = conditional(self.block, e, &condition.bins)?;
        let what =
            format!("the mean depends on {} (from {low:.2} σ to {high:.2} σ of its error)", condition.name);
        Some(Result { condition: Some(condition.place), ..self.result("conditional_mean", what, p) })
    }
}

/// The band in which a block's power is least likely.
fn spectrum(rows: &OverRows<'_>, tested: &Tested<'_>) -> Option<Result> {
    let (bench, description) = (rows.bench, rows.description);
    let sums = bench.sums[tested.index].as_ref()?;
    let system = System { sums: &bench.sums, weights: &description.weights };
    let power = system.power_left(tested.index, &description.described(bench), &description.amplitudes);
    let covariances = Covariances::new(tested.block, sums, &description.noises)?;
    let described = description.described(bench);
    let reaches = |place: &usize| described.regressors[*place].reaches(tested.index);
    let taken = (0..described.regressors.len()).filter(|place| !described.is_unit[*place] && reaches(place));
    let taken = taken.count() as f64;
    let of_band = |(band, quadratic): (usize, f64)| {
        let freedom = sums.layout.count[band] * sums.width() as f64;
        // Amplitudes may have taken all that there was of it.
        let left = if quadratic < freedom { freedom - taken } else { freedom };
        let p = if left > 0.0 { two_tailed(quadratic, left) } else { 1.0 };
        (p, sums.layout.omega[band], quadratic / freedom)
    };
    let (p, omega, excess) = (covariances.quadratics(&power).into_iter().enumerate())
        .map(of_band)
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let hertz = omega / (std::f64::consts::TAU * tested.block.step_s());
    let near = frequency_text(hertz);
    let what = format!("the spectrum near {near} is {excess:.2} times what it should be");
    let band_hz = Some([0.98 * hertz, 1.02 * hertz]);
    Some(Result { band_hz, ..tested.result("spectrum", what, p * sums.layout.bands() as f64) })
}

/// Whether each noise that was found is the same at all times.
fn results_of_noises(rows: &OverRows<'_>) -> Vec<Result> {
    let problem = rows.bench.problem;
    let result = |change: &Change| {
        let block = problem.model.block_of_source(change.source)?;
        let p = constancy(rows, block, change)?;
        let id = problem.candidates[change.candidate].effect.id;
        let name = &problem.model.sources[change.source].name;
        let what = format!("{id} of {name} is not the same at all times");
        let test = "noise_constancy";
        Some(Result { block, test, what, p, interval_s: None, band_hz: None, condition: None })
    };
    // One that changes at a time is not.
    let changes = rows.description.changes.par_iter().filter(|change| !change.is_level());
    changes.filter_map(result).collect()
}

/// A frequency as people say it: a slow one by its period.
fn frequency_text(hertz: f64) -> String {
    let hours = (3600.0 * hertz).recip();
    match hertz {
        1e-3.. => format!("{hertz:.4} Hz"),
        _ if hours < 1.0 => format!("a period of {:.1} min", 60.0 * hours),
        _ => format!("a period of {hours:.2} h"),
    }
}

/// p-value of a sum of squares of standard normals being so small or so large.
fn two_tailed(sum: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(1.0, |chi| 2.0 * chi.cdf(sum).min(chi.sf(sum)))
}

/// p-value of the largest cumulative sum about its line, and where it is.
fn largest_sum(series: &[f64]) -> (f64, usize) {
    let count = series.iter().filter(|value| value.is_finite()).count() as f64;
    let total: f64 = series.iter().filter(|value| value.is_finite()).sum();
    if count < 1.0 {
        return (1.0, 0);
    }
    let (mut sum, mut seen) = (0.0, 0.0);
    let mut largest = (0.0_f64, 0);
    for (row, value) in series.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        sum += value;
        seen += 1.0;
        let bridge: f64 = (sum - total * seen / count) / count.sqrt();
        if bridge.abs() > largest.0 {
            largest = (bridge.abs(), row);
        }
    }
    let x = largest.0;
    let p: f64 = (1..=20)
        .map(|k| {
            let k = f64::from(k);
            2.0 * (-1.0_f64).powf(k - 1.0) * (-2.0 * k * k * x * x).exp()
        })
        .sum();
    (if x < 0.3 { 1.0 } else { p.clamp(0.0, 1.0) }, largest.1)
}

/// A condition in bins of equal number.
struct Binned {
    /// Its place among the conditions.
    place: usize,
    name: String,
    /// The bin of each row; `None` where there is no value.
    bins: Vec<Option<u8>>,
}

/// The bins of a condition's values; `None` where they take too few values.
fn bins(values: &[f64]) -> Option<Vec<Option<u8>>> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let number = sorted.len();
    if number < BINS {
        return None;
    }
    // The edges alone in their places, the last one first: the rest need no order.
    let mut below = sorted.as_mut_slice();
    let mut edges: Vec<f64> = (1..BINS)
        .rev()
        .map(|bin| {
            let (lower, edge, _) =
                std::mem::take(&mut below).select_nth_unstable_by(bin * number / BINS, f64::total_cmp);
            below = lower;
            *edge
        })
        .collect();
    edges.reverse();
    if edges.first()? >= edges.last()? {
        return None;
    }
    let bin = |value: &f64| value.is_finite().then(|| edges.partition_point(|edge| edge < value) as u8);
    Some(values.iter().map(bin).collect())
}

/// p-value of the means in the bins of a condition, with the least and the largest mean in standard deviations.
fn conditional(block: &Block, e: &[f64], bins: &[Option<u8>]) -> Option<(f64, f64, f64)> {
    let mut sums = [(0.0, 0.0); BINS];
    for ((bin, e), _) in bins.iter().zip(e).zip(&block.present).filter(|(_, present)| **present) {
        if let Some(bin) = bin {
            let (sum, count) = &mut sums[usize::from(*bin)];
            *sum += e;
            *count += 1.0;
        }
    }
    let standard: Vec<f64> =
        sums.iter().filter(|(_, count)| *count > 0.0).map(|(sum, count)| sum / f64::sqrt(*count)).collect();
    if standard.len() < 2 {
        return None;
    }
    let statistic: f64 = standard.iter().map(|z| z * z).sum();
    let low = standard.iter().copied().fold(f64::INFINITY, f64::min);
    let high = standard.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some((chi_squared_tail(statistic, standard.len()), low, high))
}

#[cfg(test)]
mod tests {
    use super::frequency_text;

    #[test]
    fn slow_frequencies_are_said_by_their_periods() {
        assert_eq!(frequency_text(0.25), "0.2500 Hz");
        assert_eq!(frequency_text(1.0 / 1800.0), "a period of 30.0 min");
        assert_eq!(frequency_text(1.221e-4), "a period of 2.28 h");
    }
}
