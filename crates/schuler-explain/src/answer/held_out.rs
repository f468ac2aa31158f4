//! How well the description predicts what it was not fitted to.
//!
//! Every third of ten blocks of time is held out, with a gap of the longest correlation time on each side; short records
//! hold out their last part. The description is fitted to the rest, under its priors; the filter then runs through the whole record and
//! its one-step predictions are judged on the blocks held out. Before the findings the noise is what the user believes: noise that is
//! fitted swallows what was left out, and would hide the gain.
use rayon::prelude::*;

use super::polish::polished;
use crate::evidence::fit::{Bench, Description};
use crate::exact::OverRows;
use crate::explanation::{BeforeAfter, Fit, Goodness};
use crate::noise::Noise;
use crate::nominal::{Block, Model};
use crate::numeric::statistics::ljung_box;
use crate::search::library::whitened_again;
use crate::whitening::filter::Filter;

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
    /// It is fitted.
    Train,
    /// It keeps what is fitted apart from what is held out.
    Gap,
    /// It is predicted.
    HeldOut,
}

fn parts(rows: usize, gap: usize) -> Vec<Part> {
    let is_short = rows < SHORT_ROWS;
    let length = rows.div_ceil(BLOCKS);
    let last = ((1.0 - LAST_PART) * rows as f64) as usize;
    let gap = gap.min(if is_short { rows / 20 } else { (LONGEST_GAP * length as f64) as usize });
    let is_held = |row: usize| if is_short { row >= last } else { (row / length) % 3 == 1 };
    let part = |row: usize| {
        let is_near = is_held(row.saturating_sub(gap)) || is_held((row + gap).min(rows - 1));
        match (is_held(row), is_near) {
            (true, _) => Part::HeldOut,
            (false, true) => Part::Gap,
            (false, false) => Part::Train,
        }
    };
    (0..rows).map(part).collect()
}

/// The blocks held out, each to the end of its last step, s from the start of the recording.
pub fn held_out_s(model: &Model, noises: &[Noise]) -> Vec<[f64; 2]> {
    let of_rows = stretches(model, &parts_of(model, noises), Part::HeldOut);
    of_rows.into_iter().map(|[from, to]| [from, to + model.step_s]).collect()
}

/// The stretches of a part, from the first row to the last, s from the start of the recording.
fn stretches(model: &Model, parts: &[Part], part: Part) -> Vec<[f64; 2]> {
    let mut row = 0;
    let mut blocks = Vec::new();
    for block in parts.chunk_by(|a, b| a == b) {
        let from = row;
        row += block.len();
        if block.first() == Some(&part)
            && let (Some(start), Some(end)) = (model.time_s.get(from), model.time_s.get(row - 1))
        {
            blocks.push([*start, *end]);
        }
    }
    blocks
}

/// The part of each row, under noises whose correlation the gaps leave behind.
fn parts_of(model: &Model, noises: &[Noise]) -> Vec<Part> {
    let longest_s = noises.iter().map(Noise::correlation_time_s).fold(0.0, f64::max);
    parts(model.rows, (longest_s / model.step_s).min(1e9) as usize)
}

/// Goodness of fit of one description against another, both fitted to a part of the record.
pub fn hold_out(whole: &Bench<'_>, before: &Description, after: &Description) -> Fit {
    let model = whole.problem.model;
    let parts = parts_of(model, &after.noises);
    let train = model.without_rows(|_, row| parts[row] != Part::Train);
    let problem = whole.problem.of_model(&train);
    let judged: Vec<[(Goodness, usize); 2]> = [before, after]
        .into_par_iter()
        .map(|description| {
            let bench = Bench::new(&problem, &description.noises, whole.resolved.clone());
            let start = whitened_again(&bench, description);
            let fitted = bench.fitted_whole(&start).map(|it| polished(&bench, &it));
            // What cannot be told from a part of the record stays as it is.
            let fitted = fitted.unwrap_or_else(|| description.clone());
            judge(whole, &bench, &fitted, &parts)
        })
        .collect();
    let part = |place: usize, part: Part| {
        let of = |state: usize| judged.get(state).map(|both| both[place]).unwrap_or_default();
        let ((before, _), (after, samples)) = (of(0), of(1));
        BeforeAfter { before, after, intervals_s: stretches(model, &parts, part), samples }
    };
    Fit { train: part(0, Part::Train), held_out: part(1, Part::HeldOut) }
}

/// Goodness on the rows trained on and on those held out, and the number of their samples, of a description fitted to the former.
fn judge(
    whole: &Bench<'_>,
    train: &Bench<'_>,
    description: &Description,
    parts: &[Part],
) -> [(Goodness, usize); 2] {
    let model = whole.problem.model;
    let nominal = model.nominal_noises();
    let mut sums = [Sums::default(), Sums::default()];
    let rows = OverRows::of_model(model, train, description);
    for (block, over_rows) in model.blocks.iter().zip(&rows.blocks) {
        let Some(over_rows) = over_rows else { continue };
        let reference = block.filter(&nominal);
        let judged = Judged { block, filter: &over_rows.filter, reference: reference.as_ref() };
        judged.add_to(&mut sums, &over_rows.innovations, parts);
    }
    sums.map(Sums::goodness_and_count)
}

/// A block under the filter that predicts it, and under that of the nominal noise.
struct Judged<'j> {
    /// The block.
    block: &'j Block,
    /// The filter that predicts it.
    filter: &'j Filter,
    /// That of the nominal noise, if there is one.
    reference: Option<&'j Filter>,
}

impl Judged<'_> {
    /// Adds whitened innovations to the sums of the rows trained on and of those held out.
    fn add_to(&self, sums: &mut [Sums; 2], whitened: &[f64], parts: &[Part]) {
        let (rows, channels) = (self.block.rows(), self.block.channels);
        let mut series = [vec![f64::NAN; rows], vec![f64::NAN; rows]];
        for (row, part) in parts.iter().enumerate() {
            let Some((_, whitening)) = self.filter.gain_and_whitening(row) else { continue };
            let place = match part {
                Part::Train => 0,
                Part::HeldOut => 1,
                Part::Gap => continue,
            };
            let expected = self.reference.and_then(|filter| filter.gain_and_whitening(row));
            let innovations: Vec<f64> = (0..channels).map(|channel| whitened[channel * rows + row]).collect();
            sums[place].add(&innovations, whitening, expected.map(|(_, expected)| expected));
            series[place][row] = whitened[row];
        }
        for (sums, series) in sums.iter_mut().zip(&series) {
            sums.whiteness.push(ljung_box(series, LAGS));
        }
    }
}

/// Sums over the rows of a part.
#[derive(Default)]
struct Sums {
    nll: f64,
    squares: f64,
    errors: f64,
    count: f64,
    whiteness: Vec<f64>,
}

impl Sums {
    /// Adds the whitened innovations of a row, with what whitened them and what would have under the nominal noise.
    fn add(&mut self, innovations: &[f64], whitening: &[f64], expected: Option<&[f64]>) {
        let channels = innovations.len();
        let mut error = vec![0.0; channels];
        for (c, &e) in innovations.iter().enumerate() {
            let own = whitening[c * channels + c];
            self.squares += e * e;
            self.nll += 0.5 * (std::f64::consts::TAU.ln() + e * e) - own.ln();
            self.count += 1.0;
            // W ε = e, from the first channel on.
            let known: f64 = (0..c).map(|d| whitening[c * channels + d] * error[d]).sum();
            error[c] = (e - known) / own;
            if let Some(expected) = expected {
                let standard: f64 = (0..=c).map(|d| expected[c * channels + d] * error[d]).sum();
                self.errors += standard * standard;
            }
        }
    }

    /// Goodness of fit, and the number of samples.
    fn goodness_and_count(self) -> (Goodness, usize) {
        (self.goodness(), self.count as usize)
    }

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
