//! How well the description predicts what it was not fitted to.
//!
//! Every third of ten blocks of time is held out, with a gap of the longest correlation time on each side; short records
//! hold out their last part. The description's terms and its free noise parameters are fitted to the rest; the filter
//! then runs through the whole record and its one-step predictions are judged on the blocks held out. Before the findings
//! the noise is what the user believes: noise that is fitted swallows what was left out, and would hide the gain.
use rayon::prelude::*;

use crate::description::remainder;
use crate::explanation::{BeforeAfter, Fit, Goodness};
use crate::noise::Noise;
use crate::nominal::Model;
use crate::search::refine_terms;
use crate::state::{Case, State, refitted};
use crate::statistics::ljung_box;

/// Blocks of time, and which of each three is held out.
const BLOCKS: usize = 10;
/// Records with fewer rows hold out their last part.
const SHORT_ROWS: usize = 600;
/// That part.
const LAST_PART: f64 = 0.3;
/// Longest gap, as a part of a block.
const LONGEST_GAP: f64 = 0.2;
/// Lags of the test for whiteness.
const LAGS: usize = 20;

/// Part that a row plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Train,
    Gap,
    HeldOut,
}

fn parts(rows: usize, gap: usize) -> Vec<Part> {
    if rows < SHORT_ROWS {
        let last = ((1.0 - LAST_PART) * rows as f64) as usize;
        let gap = gap.min(rows / 20);
        return (0..rows)
            .map(|row| {
                if row >= last {
                    Part::HeldOut
                } else if row + gap >= last {
                    Part::Gap
                } else {
                    Part::Train
                }
            })
            .collect();
    }
    let length = rows.div_ceil(BLOCKS);
    let gap = gap.min((LONGEST_GAP * length as f64) as usize);
    let held = |row: usize| (row / length) % 3 == 1;
    (0..rows)
        .map(|row| {
            let near = held(row.saturating_sub(gap)) || held((row + gap).min(rows - 1));
            if held(row) {
                Part::HeldOut
            } else if near {
                Part::Gap
            } else {
                Part::Train
            }
        })
        .collect()
}

/// The blocks held out, each to the end of its last step, s from the start of the recording.
pub fn held_out_s(case: &Case<'_>, after: &State) -> Vec<[f64; 2]> {
    let parts = parts_of(case.model, after);
    let of_rows = stretches(case, &parts, Part::HeldOut);
    of_rows.into_iter().map(|[from, to]| [from, to + case.model.step_s]).collect()
}

/// The stretches of a part, from the first row to the last, s from the start of the recording.
fn stretches(case: &Case<'_>, parts: &[Part], part: Part) -> Vec<[f64; 2]> {
    let mut row = 0;
    let mut blocks = Vec::new();
    for block in parts.chunk_by(|a, b| a == b) {
        let from = row;
        row += block.len();
        if block.first() == Some(&part)
            && let (Some(start), Some(end)) = (case.time_s.get(from), case.time_s.get(row - 1))
        {
            blocks.push([*start, *end]);
        }
    }
    blocks
}

fn parts_of(model: &Model, after: &State) -> Vec<Part> {
    let longest_s = after.noises.iter().map(Noise::correlation_time_s).fold(0.0, f64::max);
    parts(model.rows, (longest_s / model.step_s).min(1e9) as usize)
}

/// Goodness of fit of `after` against `before`, both refitted to a part of the record.
pub fn hold_out(case: &Case<'_>, before: &State, after: &State) -> Fit {
    let model = case.model;
    let parts = parts_of(model, after);
    let train = model.without_rows(|_, row| parts[row] != Part::Train);
    let train_case = Case::new(&train, case.candidates, case.time_s, case.watch);
    let nominal = model.nominal_noises();
    let judged: Vec<[(Goodness, usize); 2]> = [before, after]
        .into_par_iter()
        .map(|state| {
            let (fitted, amplitudes) = fitted(&train_case, state);
            judge(model, &fitted, &amplitudes, &nominal, &parts)
        })
        .collect();
    let part = |place: usize, part: Part| {
        let of = |state: usize| judged.get(state).map(|both| both[place]).unwrap_or_default();
        let ((before, _), (after, samples)) = (of(0), of(1));
        BeforeAfter { before, after, intervals_s: stretches(case, &parts, part), samples }
    };
    Fit { train: part(0, Part::Train), held_out: part(1, Part::HeldOut) }
}

/// Terms and the free noise parameters fitted; with the amplitudes.
fn fitted(case: &Case<'_>, state: &State) -> (State, nalgebra::DVector<f64>) {
    let mut state = state.clone();
    refine_terms(case, &mut state, &|_| true);
    let (state, bench) = refitted(case, &state, None);
    (state, bench.solution.amplitudes)
}

/// Goodness on the rows trained on and on those held out, and the number of their samples.
fn judge(
    model: &Model,
    state: &State,
    amplitudes: &nalgebra::DVector<f64>,
    nominal: &[Noise],
    parts: &[Part],
) -> [(Goodness, usize); 2] {
    let mut sums = [Sums::default(), Sums::default()];
    for (index, block) in model.blocks.iter().enumerate() {
        let Some(filter) = block.filter(&state.noises) else { continue };
        let reference = block.filter(nominal);
        let left = remainder(model, index, &state.terms, amplitudes);
        let whitened = filter.whiten(&[&left]).swap_remove(0);
        let (rows, channels) = (block.rows(), block.channels);
        let mut series = [vec![f64::NAN; rows], vec![f64::NAN; rows]];
        for (row, part) in parts.iter().enumerate() {
            let Some((_, whitening)) = filter.gain_and_whitening(row) else { continue };
            let place = match part {
                Part::Train => 0,
                Part::HeldOut => 1,
                Part::Gap => continue,
            };
            let expected = reference.as_ref().and_then(|filter| filter.gain_and_whitening(row));
            let sums = &mut sums[place];
            let mut error = vec![0.0; channels];
            for c in 0..channels {
                let e = whitened[c * rows + row];
                let w = whitening[c * channels + c];
                sums.squares += e * e;
                sums.nll += 0.5 * (std::f64::consts::TAU.ln() + e * e) - w.ln();
                sums.count += 1.0;
                // W ε = e, from the first channel on.
                let known: f64 = (0..c).map(|d| whitening[c * channels + d] * error[d]).sum();
                error[c] = (e - known) / w;
                if let Some((_, expected)) = expected {
                    let standard: f64 = (0..=c).map(|d| expected[c * channels + d] * error[d]).sum();
                    sums.errors += standard * standard;
                }
            }
            series[place][row] = whitened[row];
        }
        for (sums, series) in sums.iter_mut().zip(&series) {
            sums.whiteness.push(ljung_box(series, LAGS));
        }
    }
    sums.map(|sums| (sums.goodness(), sums.count as usize))
}

#[derive(Default)]
struct Sums {
    nll: f64,
    squares: f64,
    errors: f64,
    count: f64,
    whiteness: Vec<f64>,
}

impl Sums {
    fn goodness(&self) -> Goodness {
        let count = self.count.max(1.0);
        let least = self.whiteness.iter().copied().fold(1.0, f64::min);
        Goodness {
            nll_per_sample: self.nll / count,
            rmse: (self.errors / count).sqrt(),
            // The least of several, corrected for their number.
            whiteness_p: 1.0 - (1.0 - least).powf(self.whiteness.len().max(1) as f64),
            nis_mean: self.squares / count,
        }
    }
}
