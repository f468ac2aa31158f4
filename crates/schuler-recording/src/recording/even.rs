//! An even clock through stamps that come late: in bursts, or by an amount that scatters but does not grow.
//!
//! Row i of the sampling stands at `base + step · (i + lost before it)`; its stamp lags behind that by a delay that varies. The base
//! follows the lags slowly, so that a clock that drifts is followed. Rows are lost where *all* of the stamps of a window, longer
//! than a burst, come later than any delay explains: one late message does not do that.
use std::collections::VecDeque;
use std::sync::Arc;

use super::clock::median;
use crate::error::rounded;

/// Fewer rows than this show no clock.
const LEAST_ROWS: usize = 64;
/// Rows of a block from whose straight line the step is first taken.
const BLOCK_ROWS: std::ops::RangeInclusive<usize> = 32..=4096;
/// Blocks, at least, where there are rows enough.
const BLOCKS: usize = 16;
/// Rows of a window, in bursts, and its bounds.
const WINDOW_BURSTS: usize = 4;
const WINDOW_ROWS: std::ops::RangeInclusive<usize> = 32..=4096;
/// An interval below this part of the step is within a burst.
const WITHIN_BURST: f64 = 0.5;
/// Lags of all of a window beyond the least usual by this part of a step are lost rows.
const LOST: f64 = 0.75;
/// Part of a lag by which the base follows: a drift of 10 ppm is followed to within a fiftieth of a step.
const FOLLOW: f64 = 1.0 / 2000.0;
/// Lags whose mean square is more than this many mean squares of the intervals' deviations, for each row of a burst, grow: of late
/// arrivals it is a half, of bursts of m it is m/12.
const GROWING: f64 = 3.0;
/// Part of the lags that may be beyond the usual ones by more than a step.
const FEW_BEYOND: f64 = 0.02;
/// More rows than this are not counted; a table of which as many are lost is refused.
const MOST_LOST: f64 = 1e12;
/// Rounds of refining the step.
const ROUNDS: usize = 4;
/// A step that changes by less than this part in a round has settled.
const SETTLED: f64 = 1e-6;

/// An even clock that stamps follow.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EvenClock {
    /// Step, s.
    pub(super) step_s: f64,
    /// First stamp, s.
    first_s: f64,
    /// The first row less the first stamp, s.
    base_s: f64,
    /// The usual lags of the stamps behind the rows, least and most, s.
    usual_s: [f64; 2],
    /// Rows of the window in which lost rows show.
    window: usize,
    /// Rows that arrive together.
    burst: usize,
}

/// Where rows are lost: the index of the recorded row behind, and how many.
pub(super) type Lost = Arc<[(usize, usize)]>;

impl EvenClock {
    /// The step by straight lines through blocks of rows: the median of their slopes, s.
    pub(super) fn slope(stamps_s: &[f64]) -> Option<f64> {
        if stamps_s.len() < LEAST_ROWS {
            return None;
        }
        let rows = (stamps_s.len() / BLOCKS).clamp(*BLOCK_ROWS.start(), *BLOCK_ROWS.end());
        let mut slopes: Vec<f64> = stamps_s.chunks_exact(rows).map(line_slope).collect();
        median(&mut slopes)
    }

    /// The clock that the stamps follow, if they follow one.
    pub(super) fn of(stamps_s: &[f64], intervals_s: &[f64]) -> Option<Self> {
        let slope_s = Self::slope(stamps_s).filter(|slope_s| *slope_s > 0.0)?;
        let burst = burst_rows(intervals_s, slope_s);
        // Where rows are lost, the usual burst still says the step.
        let of_bursts = burst_step(stamps_s, burst, slope_s);
        let candidates = [Some(slope_s), of_bursts];
        candidates
            .into_iter()
            .flatten()
            .filter_map(|step_s| Self::refined(stamps_s, intervals_s, step_s))
            .min_by_key(|&(_, lost)| lost)
            .map(|(clock, _)| clock)
    }

    /// The clock that begins with a step and takes that which the whole of the stamps gives, with the number of lost rows.
    fn refined(stamps_s: &[f64], intervals_s: &[f64], mut step_s: f64) -> Option<(Self, usize)> {
        let burst = burst_rows(intervals_s, step_s);
        for _ in 0..ROUNDS {
            let clock = Self::with_step(stamps_s, step_s, burst)?;
            let lost: usize = clock.search(stamps_s).0.iter().map(|(_, count)| count).sum();
            let next_s = step_s + clock.drift(stamps_s, lost);
            let change = (next_s / step_s - 1.0).abs();
            step_s = next_s;
            if step_s <= 0.0 || 2 * lost > stamps_s.len() {
                return None;
            }
            if change < SETTLED {
                break;
            }
        }
        let clock = Self::with_step(stamps_s, step_s, burst)?;
        let (lost, scatter) = clock.search(stamps_s);
        scatter.is_bounded(intervals_s, &clock).then(|| (clock, lost.iter().map(|(_, count)| count).sum()))
    }

    fn search(&self, stamps_s: &[f64]) -> (Lost, Scatter) {
        let mut search = LostRows::new(self.clone());
        for &stamp_s in stamps_s {
            search.add(stamp_s);
        }
        search.finish()
    }

    /// By how much the step is too short, by the windows at both ends, which hold whole bursts as nearly as may be, s a row.
    fn drift(&self, stamps_s: &[f64], lost: usize) -> f64 {
        let window = self.window.min(stamps_s.len() / 2);
        let behind = stamps_s.len() - window;
        let mean_s = |first: usize, before: usize| {
            let rows = stamps_s.iter().enumerate().skip(first).take(window);
            rows.map(|(row, stamp_s)| stamp_s - self.first_s - self.step_s * (row + before) as f64)
                .sum::<f64>()
                / window as f64
        };
        (mean_s(behind, lost) - mean_s(0, 0)) / (behind + lost) as f64
    }

    /// The lags that are usual under a step.
    fn with_step(stamps_s: &[f64], step_s: f64, burst: usize) -> Option<Self> {
        let &first_s = stamps_s.first()?;
        let longest = (*WINDOW_ROWS.end()).min(stamps_s.len() / 2);
        let bursts = WINDOW_BURSTS.max(WINDOW_ROWS.start().div_ceil(burst));
        let window = (bursts * burst).min(longest);
        let lag_s = |row: usize| stamps_s[row] - first_s - step_s * row as f64;
        let mut bounds = [Vec::new(), Vec::new()];
        let mut base_s = None;
        for first in (0..=stamps_s.len() - window).step_by(window) {
            let mut lags_s: Vec<f64> = (first..first + window).map(lag_s).collect();
            let middle_s = median(&mut lags_s)?;
            base_s.get_or_insert(middle_s);
            bounds[0].push(lags_s.iter().copied().fold(f64::INFINITY, f64::min) - middle_s);
            bounds[1].push(lags_s.iter().copied().fold(f64::NEG_INFINITY, f64::max) - middle_s);
        }
        let [mut least, mut most] = bounds;
        let usual_s = [median(&mut least)?, median(&mut most)?];
        Some(Self { step_s, first_s, base_s: base_s?, usual_s, window, burst })
    }

    /// Between the least and the most usual lag, s.
    pub(super) fn scatter_s(&self) -> f64 {
        self.usual_s[1] - self.usual_s[0]
    }

    /// What the user should be told; `step_s` is the step as it is told.
    pub(super) fn note(&self, column: &str, step_s: f64, rows: usize) -> String {
        let burst = self.burst;
        let bursts = if burst > 2 { format!("come in bursts of about {burst}, ") } else { String::new() };
        format!(
            "{column}: the stamps {bursts}scatter by {:.2e} s about an even clock; the {rows} rows are taken as sampled evenly \
             every {} s",
            self.scatter_s(),
            rounded(step_s)
        )
    }
}

/// Slope of the least-squares line, s a row.
fn line_slope(stamps_s: &[f64]) -> f64 {
    let middle = 0.5 * (stamps_s.len() - 1) as f64;
    let first_s = stamps_s.first().copied().unwrap_or_default();
    let (mut moment, mut square) = (0.0, 0.0);
    for (row, stamp_s) in stamps_s.iter().enumerate() {
        moment += (row as f64 - middle) * (stamp_s - first_s);
        square += (row as f64 - middle).powi(2);
    }
    moment / square
}

/// Rows that usually arrive together: the median over the rows.
fn burst_rows(intervals_s: &[f64], step_s: f64) -> usize {
    let mut runs = Vec::new();
    let mut run: usize = 1;
    for &interval_s in intervals_s {
        if interval_s < WITHIN_BURST * step_s {
            run += 1;
        } else {
            runs.extend(std::iter::repeat_n(run as f64, run));
            run = 1;
        }
    }
    median(&mut runs).map_or(1, |rows| rows as usize)
}

/// The step that whole bursts give: the median distance of their first rows over their usual number of rows, s.
fn burst_step(stamps_s: &[f64], burst: usize, slope_s: f64) -> Option<f64> {
    let starts: Vec<f64> = (stamps_s.windows(2))
        .filter(|pair| pair[1] - pair[0] >= WITHIN_BURST * slope_s)
        .map(|pair| pair[1])
        .collect();
    let mut distances_s: Vec<f64> = starts.windows(2).map(|pair| pair[1] - pair[0]).collect();
    Some(median(&mut distances_s)? / burst as f64).filter(|step_s| burst > 1 && *step_s > 0.0)
}

/// How the lags scatter.
#[derive(Clone, Copy, Debug, Default)]
struct Scatter {
    rows: usize,
    square: f64,
    beyond: usize,
}

impl Scatter {
    /// Whether the lags are those of late arrivals, and do not grow.
    fn is_bounded(&self, intervals_s: &[f64], clock: &EvenClock) -> bool {
        let usual = |interval_s: &f64| (interval_s - clock.step_s).powi(2);
        let mean_square = intervals_s.iter().map(usual).sum::<f64>() / intervals_s.len() as f64;
        let rows = self.rows.max(1) as f64;
        self.square / rows <= GROWING * clock.burst as f64 * mean_square
            && self.beyond as f64 <= FEW_BEYOND * rows
    }
}

/// Looks for lost rows among stamps, in order.
#[derive(Debug)]
pub(super) struct LostRows {
    clock: EvenClock,
    line: Line,
    /// Stamps that are not decided on: what each is later than `first + step · row`, s.
    waiting: VecDeque<f64>,
    /// Of these the possible least ones of a window, with the rows.
    least: VecDeque<(usize, f64)>,
    rows: usize,
    lost: Vec<(usize, usize)>,
    scatter: Scatter,
}

impl LostRows {
    pub(super) fn new(clock: EvenClock) -> Self {
        let line = Line::new(&clock);
        let (waiting, least) = (VecDeque::new(), VecDeque::new());
        Self { clock, line, waiting, least, rows: 0, lost: Vec::new(), scatter: Scatter::default() }
    }

    pub(super) fn add(&mut self, stamp_s: f64) {
        let over_s = stamp_s - self.clock.first_s - self.clock.step_s * self.rows as f64;
        self.waiting.push_back(over_s);
        while self.least.back().is_some_and(|&(_, least_s)| least_s >= over_s) {
            self.least.pop_back();
        }
        self.least.push_back((self.rows, over_s));
        self.rows += 1;
        if self.waiting.len() == self.clock.window {
            self.decide(true);
        }
    }

    /// Decides on the oldest row that waits.
    fn decide(&mut self, whole_window: bool) {
        let row = self.rows - self.waiting.len();
        let step_s = self.clock.step_s;
        if let Some(&(_, least_s)) = self.least.front().filter(|_| whole_window) {
            let late_s = least_s - self.line.over_s(step_s) - self.clock.usual_s[0];
            if late_s > LOST * step_s {
                let count = (late_s / step_s).round().clamp(1.0, MOST_LOST) as usize;
                self.lost.push((row, count));
                self.line.lost += count;
            }
        }
        if let Some(over_s) = self.waiting.pop_front() {
            let lag_s = over_s - self.line.over_s(step_s);
            self.line.follow(&self.clock, lag_s);
            let [least_s, most_s] = self.clock.usual_s;
            let beyond = lag_s < least_s - step_s || lag_s > most_s + step_s;
            self.scatter.rows += 1;
            self.scatter.beyond += usize::from(beyond);
            self.scatter.square += if beyond { 0.0 } else { lag_s * lag_s };
        }
        if self.least.front().is_some_and(|&(least, _)| least == row) {
            self.least.pop_front();
        }
    }

    /// Where rows are lost; those lost behind the last whole window are not seen.
    fn finish(mut self) -> (Lost, Scatter) {
        while !self.waiting.is_empty() {
            self.decide(false);
        }
        (self.lost.into(), self.scatter)
    }

    /// As [`finish`](Self::finish), without the scatter.
    pub(super) fn lost(self) -> Lost {
        self.finish().0
    }
}

/// The even clock as far as it has been followed.
#[derive(Clone, Debug, PartialEq)]
struct Line {
    base_s: f64,
    lost: usize,
}

impl Line {
    fn new(clock: &EvenClock) -> Self {
        Self { base_s: clock.base_s, lost: 0 }
    }

    /// What a row without delay is later than `first + step · row`.
    fn over_s(&self, step_s: f64) -> f64 {
        self.base_s + step_s * self.lost as f64
    }

    fn follow(&mut self, clock: &EvenClock, lag_s: f64) {
        let [least_s, most_s] = clock.usual_s;
        self.base_s += FOLLOW * lag_s.clamp(least_s - clock.step_s, most_s + clock.step_s);
    }
}

/// The even clock row by row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EvenWalk {
    clock: EvenClock,
    lost: Lost,
    line: Line,
    /// Next recorded row.
    row: usize,
    /// Next entry of `lost`.
    next: usize,
    /// Rows of it that were put in.
    put_in: usize,
}

impl EvenWalk {
    pub(super) fn new(clock: EvenClock, lost: Lost) -> Self {
        let line = Line::new(&clock);
        Self { clock, lost, line, row: 0, next: 0, put_in: 0 }
    }

    /// The time of the next row and whether it is put in; `stamp_s` is that of the next recorded one.
    pub(super) fn next(&mut self, stamp_s: f64) -> (f64, bool) {
        let EvenClock { step_s, first_s, .. } = self.clock;
        if let Some(&(row, count)) = self.lost.get(self.next)
            && row == self.row
        {
            if self.put_in < count {
                let time_s = first_s + step_s * self.row as f64 + self.line.over_s(step_s);
                self.line.lost += 1;
                self.put_in += 1;
                return (time_s, true);
            }
            self.next += 1;
            self.put_in = 0;
        }
        let time_s = first_s + step_s * self.row as f64 + self.line.over_s(step_s);
        self.line.follow(&self.clock, stamp_s - time_s);
        self.row += 1;
        (time_s, false)
    }
}
